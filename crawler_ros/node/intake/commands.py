"""Commands between their arrival and the tick that follows them: checked on arrival, ordered, never dropped."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence

import numpy as np

from crawler_model.body.columns import Columns
from crawler_model.errors import CommandError

from . import checks
from .commanded_path import CommandedPath, Trajectory, Vertex, Vertices
from .decode import wrong_point
from .limits import Limits

MOST_ROWS, MOST_BYTES = 100_000, 1 << 27
"""The largest queue: command rows, and the memory that they take."""
MOST_TRAJECTORIES = 10_000
"""The largest number of trajectories that one tick joins to the path, which takes some 20 µs each."""
_ROW_BYTES = 128  # of an array or a vertex, besides its numbers


class CommandQueue:
    """Turns messages into the vertices of the next ticks. `accept_*` may be called from any thread.

    In lock-step, messages trigger the ticks, one after another: an actuation array triggers one tick, which follows the
    pending friction arrays as well; a trajectory triggers ticks for its whole duration. No message replaces another, so
    that the ticks depend only on the order of the messages and never on when they arrive.
    """

    def __init__(
        self, columns: Columns, in_force: np.ndarray, lock_step: bool = False, limits: Limits | None = None
    ) -> None:
        """Start with nothing pending.

        Args:
            columns: the columns that can be commanded.
            in_force: the command row in force, shape (C,).
            lock_step: whether messages trigger the ticks.
            limits: the largest sizes accepted; None to accept all that doubles can hold.
        """
        self._columns = columns
        self._lock_step = lock_step
        self._limits = Limits.none(columns) if limits is None else limits
        self.full = 0
        """Messages refused because the queue was full."""
        self.unheld = 0
        """Rows dropped because no equilibrium holds their loads, or the frictions of a point do not fit together."""
        self.overdue = 0
        """Trajectories that began when their last point was past, so that one tick followed them from end to end."""
        self.most_waiting = min(MOST_ROWS, MOST_BYTES // (8 * columns.count + _ROW_BYTES))
        """Largest number of waiting rows: each becomes a full row of commands at its tick."""
        self._lengths = columns.lengths
        self._needs_checks = bool(columns.loads) or columns.joints is not None  # rows, before they are followed
        self._lock = threading.Lock()
        self.reset(in_force)

    def reset(self, in_force: np.ndarray) -> None:
        """Drop all pending and running commands."""
        with self._lock:
            self._actuation: list[np.ndarray] = []
            self._beside: dict[int, list[np.ndarray]] = {}
            self._trajectories: list[Trajectory] = []
            self._last_was_trajectory = False
            self._turns: deque[np.ndarray | Trajectory] = deque()
            self._pending = self._pending_beside = 0
            self.now_ns = self._tick_ns = 0
        self._checking = False  # whether the rows ahead are to be checked, each of them against the row before
        self._in_force = np.array(in_force)
        self._path = CommandedPath(Vertex(0, self._in_force))

    @property
    def in_force(self) -> np.ndarray:
        """The last row that a tick took, shape (C,)."""
        return self._in_force

    def resume(self, in_force: np.ndarray, now_ns: int) -> None:
        """Continue from an earlier row after the rows of a tick were refused.

        A running trajectory ends. Messages that wait for later ticks remain; in lock-step each of them still triggers a
        tick.

        Args:
            in_force: the command row in force, shape (C,).
            now_ns: simulated time at the end of that tick [ns].
        """
        self._in_force, self.now_ns = in_force, now_ns
        self._path.end(Vertex(now_ns, in_force))

    @property
    def waiting(self) -> int:
        """Number of waiting command rows, including a running trajectory's."""
        return self._pending + self._pending_beside + len(self._path.ahead)

    def _reserve(self, rows: int) -> None:
        """Refuse rows for which the queue has no room; call it with the lock held."""
        if self.waiting + rows > self.most_waiting:
            self._refuse(
                f"{self.waiting} command rows are waiting and {rows} more are too many: at most {self.most_waiting} "
                "may wait"
            )

    def _refuse(self, reason: str) -> None:
        """Count and refuse a message for which there is no room."""
        self.full += 1
        raise CommandError(
            f"{reason}; send commands no faster than they are followed (a paused simulator follows none)"
        )

    def accept_actuation(self, values: Sequence[float] | np.ndarray) -> None:
        """Accept a command for all links and segments.

        Args:
            values: L of each link [m], then the strain of each segment; in the plane x and y of each link; for a body
                that turns of each link, then the change of the angle of each joint [rad].

        Raises:
            CommandError: on a wrong length, a value that is not finite or beyond its limit, or a full queue.
        """
        array = np.array(values, dtype=np.float64)
        sizes = self._columns.actuation_sizes
        planar = self._columns.planar is not None
        if array.size != (self._lengths if planar else sizes.size):
            counts = f"{sizes.size}, one per {self._columns.items('link')}"
            if planar:
                turns = self._columns.joints is not None
                counts = f"{self._lengths}, {'one per link, then per joint' if turns else 'x and y of each link'}"
            raise CommandError(f"actuation command has {array.size} value(s); it needs {counts}")
        row = array if array.size == self._lengths else np.repeat(array, sizes)
        if not self._limits.hold(row):  # both checks in one
            checks.check_finite("actuation command", array)
            self._limits.check("actuation command", self._columns.names, row)
        self._queue_lengths(row)

    def accept_joints(self, names: Sequence[str], positions: np.ndarray) -> None:
        """Accept commands for links, segments and joints by name; those that are not named keep theirs.

        Args:
            names: their N names, in any order.
            positions: of each, as in a trajectory; NaN where nothing is commanded, shape (N,).

        Raises:
            CommandError: naming the invalid name or value, or on a full queue.
        """
        what = "joint command"
        places = checks.named_columns(self._columns, names, only_lengths=True, what=what)
        if positions.size != len(names):
            raise CommandError(
                f"{what}: {positions.size} position(s) for {len(names)} name(s); it needs one each, NaN to hold a joint"
            )
        row = np.full(self._lengths, np.nan)
        for columns, value in zip(places, positions, strict=True):
            row[columns] = value
        self._limits.check(what, self._columns.names, row)
        self._queue_lengths(row)

    def _queue_lengths(self, row: np.ndarray) -> None:
        """Queue what commands all lengths, strains and angles, shape (lengths,); NaN holds."""
        with self._lock:
            self._reserve(1)
            self._pending += 1
            if self._lock_step:
                self._turns.append(row)
                return
            self._actuation.append(row)
            self._last_was_trajectory = False

    def accept_friction(self, values: Sequence[float] | np.ndarray) -> None:
        """Accept a command for all frictions.

        Args:
            values: a single value, one per isolated contact [N] and then per segment [N/m], or all forward and then all
                backward values; for a body that turns one, one per point, or forward, backward, left and right of each.

        Raises:
            CommandError: on a wrong length, a value that is negative, not finite or beyond its limit, or a full queue.
        """
        row = checks.spread_friction(self._columns, values)
        self._limits.check("friction command", self._columns.names[self._lengths :], row, self._lengths)
        self._accept_beside("friction command", self._lengths, row)

    def accept_loads(self, values: Sequence[float] | np.ndarray) -> None:
        """Accept a command for all loads.

        Args:
            values: one, or one per isolated contact [N] then segment [N/m]; in the plane x and y, for all or of each.

        Raises:
            CommandError: on a wrong length, a value that is not finite or beyond its limit, loads that no equilibrium
                holds, or a full queue.
        """
        columns = self._columns
        array = checks.spread_loads(columns, values)
        first = columns.count - columns.loads
        self._limits.check("load command", columns.names[first:], array, first)
        self._accept_beside("load command", first, array)

    def _accept_beside(self, what: str, first: int, values: np.ndarray) -> None:
        """Queue values that take effect with the next rest lengths."""
        with self._lock:
            if self._columns.loads:
                row = self._in_force.copy()
                for column, waiting in self._beside.items():
                    row[column : column + waiting[-1].size] = waiting[-1]
                row[first : first + values.size] = values
                self._columns.check_equilibrium(self._columns.target(row), what, CommandError)
            self._reserve(1)
            self._pending_beside += 1
            self._beside.setdefault(first, []).append(values)
            self._last_was_trajectory = False

    def accept_trajectory(
        self,
        names: Sequence[str],
        times_ns: Sequence[int] | np.ndarray,
        positions: Sequence[Sequence[float]] | np.ndarray,
        stamp_ns: int,
        only_lengths: bool = False,
    ) -> None:
        """Accept a trajectory: straight lines through its points, replacing the running one from its start on.

        Args:
            names: the N names of the numbers it commands.
            times_ns: time_from_start of each point, not decreasing [ns].
            positions: of each point, one number per name, shape (P, N).
            stamp_ns: when it starts [ns, simulated]; 0 to start as soon as possible.
            only_lengths: whether only links and segments may be named, not friction.

        Raises:
            CommandError: naming the invalid name, point or value.
        """
        columns = checks.named_columns(self._columns, names, only_lengths)
        times = np.array(times_ns, dtype=np.int64)
        if times.size == 0:
            raise CommandError("trajectory: it has no points; it needs at least one (commands that are left out hold)")
        if not isinstance(positions, np.ndarray):
            for i, row in enumerate(positions):
                if len(row) != len(names):
                    raise wrong_point(i, len(row), len(names))
        table = np.array(positions, dtype=np.float64).reshape(times.size, len(names))
        checks.check_points(names, columns, times, table, self._limits)
        checks.check_times(stamp_ns, self.now_ns, self._tick_ns, int(times[-1]))
        checks.check_rows(self._columns, self._in_force, columns, table)
        trajectory = Trajectory(stamp_ns or None, columns, times, table)
        with self._lock:
            if len(self._trajectories) == MOST_TRAJECTORIES:
                self._refuse(f"{MOST_TRAJECTORIES} trajectories are waiting for the next tick, the most it can join")
            self._reserve(times.size + 1)
            self._pending += times.size + 1
            if self._lock_step:
                self._turns.append(trajectory)
                return
            self._trajectories.append(trajectory)
            self._last_was_trajectory = True

    @property
    def is_running(self) -> bool:
        """Whether a trajectory goes on after the last tick."""
        return bool(self._path.ahead)

    @property
    def is_idle(self) -> bool:
        """Whether there is no message left that would trigger a tick in lock-step."""
        return not (self._path.ahead or self._turns)

    def take_vertices(self, times_ns: np.ndarray) -> Vertices:
        """Take the vertices of the next ticks, in the order in which they must be followed.

        Messages that wait are taken for one tick. The k-th actuation, friction and load array make one vertex; arrays
        without a partner make one each. Arrays take equal shares of the tick. A trajectory's points keep their own
        times, those already past coming first; where it extends beyond a tick, its straight line is followed up to the
        end of the tick. What is past and followed by nothing takes the whole tick, as an array does. Arrays and
        trajectories replace each other; the last to arrive counts.

        Args:
            times_ns: simulated time at the start of the first tick and at the end of each, shape (K + 1,) [ns].

        Returns:
            The vertices of K ticks or fewer: of one where messages wait or rows must be checked, in lock-step of those
            in which the running trajectory goes on.
        """
        path = self._path
        if self._lock_step:
            waits = not path.ahead
        else:
            waits = bool(self._actuation or self._beside or self._trajectories)
        if waits or self._checking:
            times_ns = times_ns[:2]
        elif self._lock_step:
            times_ns = times_ns[: 2 + np.searchsorted(times_ns[1:], path.ahead[-1].due_ns)]
        before_ns, self.now_ns = times_ns[-2:].tolist()
        self._tick_ns = self.now_ns - before_ns
        if waits:
            self._lay_messages(before_ns, self.now_ns)
            self._checking = self._needs_checks and self._change_bounds(path.ahead)
        taken = path.pass_waypoints(times_ns, self._in_force)
        if self._checking:
            taken = self._without_unheld(taken)
        if taken.due_ns.size:
            self._in_force = taken.rows[-1]
        return taken

    def _change_bounds(self, vertices: list[Vertex]) -> bool:
        """Determine whether vertices change the friction or the loads in force: others can always be followed."""
        bounds = self._in_force[self._lengths :].tobytes()
        return any(vertex.row[self._lengths :].tobytes() != bounds for vertex in vertices)

    def _lay_messages(self, start_ns: int, end_ns: int) -> None:
        """Lay what waits for the tick on the path: in lock-step the earliest message with the arrays beside it."""
        actuation: list[np.ndarray] = []
        beside: dict[int, list[np.ndarray]] = {}
        trajectories: list[Trajectory] = []
        with self._lock:
            if self._lock_step:
                if not self._turns:
                    return
                turn = self._turns.popleft()
                if isinstance(turn, Trajectory):
                    trajectories = [turn]
                    self._pending -= turn.times_ns.size + 1
                else:
                    actuation, beside, self._beside = [turn], self._beside, {}
                    self._pending -= 1
                    self._pending_beside = 0
            else:
                actuation, self._actuation = self._actuation, []
                beside, self._beside = self._beside, {}
                trajectories, self._trajectories = self._trajectories, []
                self._pending = self._pending_beside = 0
            trajectory_last = self._last_was_trajectory
        if not (actuation or beside):
            self._join_all(trajectories, start_ns, end_ns)
        elif trajectory_last:
            self._lay_arrays(actuation, beside, start_ns, start_ns)
            self._join_all(trajectories, start_ns, end_ns)
        else:
            self._join_all(trajectories, start_ns, end_ns)
            self._lay_arrays(actuation, beside, start_ns, end_ns)

    def _without_unheld(self, taken: Vertices) -> Vertices:
        """Drop and count the vertices of a tick that cannot be followed; leave out what then repeats the row before."""
        kept, in_force = [], self._in_force
        for k, row in enumerate(taken.rows):
            if checks.is_held(self._columns, row, in_force):
                if row.tobytes() != in_force.tobytes():
                    kept.append(k)
                    in_force = row
                continue
            self.unheld += 1
            anchor = self._path.anchor
            if anchor.row.tobytes() == row.tobytes():  # commands that follow do not start from it
                self._path.anchor = Vertex(anchor.due_ns, in_force)
        if len(kept) == taken.due_ns.size:
            return taken
        first = np.array([0, len(kept)])
        return taken._replace(due_ns=taken.due_ns[kept], rows=taken.rows[kept], first=first)

    def _lay_arrays(
        self, actuation: list[np.ndarray], beside: dict[int, list[np.ndarray]], start_ns: int, end_ns: int
    ) -> None:
        """Replace the path after `start_ns` by a vertex for each set of arrays."""
        row, vertices = self._path.value_at(start_ns), []
        count = max(len(actuation), *map(len, beside.values()), 0)
        for k in range(count):
            row = row.copy()
            if k < len(actuation):
                np.copyto(row[: self._lengths], actuation[k], where=actuation[k] == actuation[k])  # NaN holds
            for first, waiting in beside.items():
                if k < len(waiting):
                    row[first : first + waiting[k].size] = waiting[k]
            vertices.append(Vertex(start_ns + (end_ns - start_ns) * (k + 1) // count, row))
        self._path.replace(start_ns, vertices)

    def _join_all(self, trajectories: list[Trajectory], now_ns: int, end_ns: int) -> None:
        fresh = 0
        for trajectory in trajectories:
            fresh = self._join(trajectory, now_ns, end_ns, fresh)

    def _join(self, trajectory: Trajectory, now_ns: int, end_ns: int, fresh: int) -> int:
        """Let a trajectory replace the path as `CommandedPath.join` does, and count it if all of it is past."""
        start_ns, lasts_ns = trajectory.start_ns, int(trajectory.times_ns[-1])
        self.overdue += start_ns is not None and 0 < lasts_ns <= now_ns - start_ns
        return self._path.join(trajectory, now_ns, end_ns, fresh)
