"""The path of commands that trajectories lay ahead of the ticks: waypoints, with straight lines between them."""

from __future__ import annotations

import operator
from bisect import bisect_right
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .waypoints import follow_waypoints


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A checked trajectory: when it starts, and its waypoints.

    Attributes:
        start_ns: simulated time [ns]; None to start as soon as possible.
        columns: the numbers of a command row that it sets, one array of indices per name.
        times_ns: time_from_start of each point, shape (points,) [ns].
        positions: shape (points, names).
    """

    start_ns: int | None
    columns: list[np.ndarray]
    times_ns: np.ndarray
    positions: np.ndarray


class Vertex(NamedTuple):
    """The end of a ramp within a tick: its simulated time [ns] and the row commanded there."""

    due_ns: int
    row: np.ndarray


_due_ns = operator.attrgetter("due_ns")


class Vertices(NamedTuple):
    """What K ticks follow: their vertices in order.

    Attributes:
        times_ns: simulated time at the start of the first tick and at the end of each, shape (K + 1,) [ns].
        due_ns: times of the vertices, shape (V,) [ns].
        rows: the rows commanded there, shape (V, C).
        first: the first vertex of each tick, then V, shape (K + 1,).
        ended: the tick in which the commands ended; -1 if they go on after all of the ticks.
    """

    times_ns: np.ndarray
    due_ns: np.ndarray
    rows: np.ndarray
    first: np.ndarray
    ended: int

    def refuse(self, tick: int) -> Vertices:
        """Leave out the vertices of a tick, which is the last one, and all later ticks: the commands end in it."""
        count, first = self.first[tick], self.first[: tick + 2].copy()
        first[-1] = count
        return Vertices(self.times_ns[: tick + 2], self.due_ns[:count], self.rows[:count], first, tick)


def hold(times_ns: np.ndarray, columns: int) -> Vertices:
    """Build ticks that hold the row in force.

    Args:
        times_ns: as in `Vertices`, shape (K + 1,) [ns].
        columns: number of columns of a row C.

    Returns:
        K ticks without vertices.
    """
    return Vertices(times_ns, np.empty(0, np.int64), np.empty((0, columns)), np.zeros(times_ns.size, np.int64), -1)


class CommandedPath:
    """The waypoints ahead, from the last one that was passed."""

    def __init__(self, anchor: Vertex) -> None:
        """Start with no waypoint ahead.

        Args:
            anchor: where the commands are.
        """
        self.anchor = anchor
        """The last waypoint passed: the straight line to the next one starts from it."""
        self.ahead: list[Vertex] = []

    def end(self, anchor: Vertex) -> None:
        """Drop the waypoints ahead.

        Args:
            anchor: where the commands are now.
        """
        self.anchor, self.ahead = anchor, []

    def value_at(self, ns: int) -> np.ndarray:
        """Compute the row commanded at a time.

        Args:
            ns: simulated time [ns].

        Returns:
            Shape (C,).
        """
        after = bisect_right(self.ahead, ns, key=_due_ns)
        before = self.ahead[after - 1] if after else self.anchor
        if after == len(self.ahead) or ns <= before.due_ns:
            return before.row
        vertex = self.ahead[after]
        part = (ns - before.due_ns) / (vertex.due_ns - before.due_ns)
        return before.row + part * (vertex.row - before.row)

    def replace(self, after_ns: int, vertices: list[Vertex]) -> None:
        """Replace the waypoints after a time.

        Args:
            after_ns: simulated time [ns].
            vertices: the waypoints that follow it.
        """
        self.ahead[bisect_right(self.ahead, after_ns, key=_due_ns) :] = vertices

    def join(self, trajectory: Trajectory, now_ns: int, end_ns: int, fresh: int) -> int:
        """Let a trajectory replace the path from its start on.

        Trajectories that arrive in the same tick lose no vertex that is due in it: of the last `fresh` vertices of the
        path, all that are due by its end stay. Times never decrease along the path, so a search by halving finds what
        stays: the cost is proportional to the number of points of the trajectory and of points that it replaces.

        Args:
            trajectory: the trajectory.
            now_ns: simulated time at the start of the tick [ns].
            end_ns: simulated time at its end [ns].
            fresh: the number of vertices of the path that belong to trajectories that arrived in this tick.

        Returns:
            The same number, this trajectory's vertices included.
        """
        start = now_ns if trajectory.start_ns is None else trajectory.start_ns
        cut = max(start, now_ns)
        ahead, first_fresh = self.ahead, len(self.ahead) - fresh
        fresh_stay = bisect_right(ahead, max(cut, end_ns), first_fresh, key=_due_ns)
        last = ahead[fresh_stay - 1] if fresh_stay > first_fresh else None
        row = last.row if last is not None and last.due_ns > cut else self.value_at(cut)
        del ahead[fresh_stay:]
        stays = bisect_right(ahead, cut, 0, first_fresh, key=_due_ns)
        del ahead[stays:first_fresh]
        due = max(cut, ahead[-1].due_ns if ahead else cut)
        rows = np.tile(row, (trajectory.times_ns.size, 1))
        for column, values in zip(trajectory.columns, trajectory.positions.T, strict=True):
            rows[:, column] = values[:, None]
        ahead.append(Vertex(due, row))
        ahead.extend(map(Vertex, np.maximum(start + trajectory.times_ns, due).tolist(), rows))
        return len(ahead) - stays

    def pass_waypoints(self, times_ns: np.ndarray, in_force: np.ndarray) -> Vertices:
        """Follow the path through consecutive ticks, and drop the waypoints that are passed.

        Args:
            times_ns: simulated time at the start of the first tick and at the end of each, shape (K + 1,) [ns].
            in_force: the command row in force, shape (C,).

        Returns:
            The waypoints passed, those already past at the start of the first tick, and where the path extends beyond
            the end of a tick, the point on the straight line there; without those that repeat the row before them.
            What is past and followed by nothing takes the whole tick.
        """
        ahead = self.ahead
        if not ahead:
            return hold(times_ns, in_force.size)
        if len(ahead) == 1 and times_ns.size == 2 and ahead[0].due_ns <= times_ns[1]:  # what an array commands
            return self._pass_only_one(times_ns, in_force)
        count = bisect_right(ahead, times_ns[-1], key=_due_ns)
        near = [self.anchor, *ahead[: count + 1]]
        self.anchor = near[count]
        del ahead[:count]
        due = np.array([v.due_ns for v in near], np.int64)
        found = Vertices(times_ns, *follow_waypoints(due, np.array([v.row for v in near]), times_ns, in_force))
        if found.due_ns.size and not ahead and self.anchor.due_ns <= times_ns[0]:
            found.due_ns[-1] = times_ns[1]
        return found

    def _pass_only_one(self, times_ns: np.ndarray, in_force: np.ndarray) -> Vertices:
        """Pass the only waypoint ahead in a single tick, as `pass_waypoints` does: calls of kernels take longer."""
        self.anchor = due_ns, row = self.ahead.pop()
        start_ns, end_ns = times_ns.tolist()
        count = int(row.tobytes() != in_force.tobytes())
        due = np.array([due_ns if due_ns > start_ns else end_ns][:count], np.int64)
        return Vertices(times_ns, due, row[None][:count], np.array([0, count]), 0)
