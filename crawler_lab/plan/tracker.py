"""What the controller knows: what it saw and commanded; from this follow the next commands."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.errors import CommandError

from .estimate import Window, estimate
from .horizon import Problem, find_plan
from .limits import Limits
from .robot import Robot

Path = Callable[[np.ndarray], np.ndarray]
"""From times since the first state, shape (K,) [s], to the place since then, shape (K, D) [m, rad]."""


class Tracker:
    """Follows a path with a robot whose friction and loads are not known.

    Attributes:
        robot: the body.
        step_ns: duration of a step [ns].
        steps: number of steps in a plan, H.
        factors: friction factors and loads as estimated, see `Robot.nominal`.
    """

    def __init__(self, robot: Robot, limits: Limits, path: Path, step_ns: int, steps: int, noise: float) -> None:
        """Begin before the first state.

        Args:
            robot: the body.
            limits: of its commands.
            path: the path.
            step_ns: duration of a step [ns].
            steps: number of steps in a plan, H.
            noise: error of a measured displacement [m].
        """
        self.robot, self._limits, self._path = robot, limits, path
        self.step_ns, self.steps, self._noise = step_ns, steps, noise
        self.restart()

    def restart(self) -> None:
        """Forget all that was seen, as at the start of a run."""
        self.factors = self.robot.nominal
        self._seen: list[tuple[int, np.ndarray]] = []
        self._times, self._rows = [0], [self.robot.before]
        self._start_ns, self._origin = 0, np.zeros(self.robot.scale.size)
        self._missed: list[np.ndarray] = []

    def warm_up(self, x: np.ndarray) -> None:
        """Compile what plans need.

        Args:
            x: displacement at the start, shape (N,), in the plane (N, 2) [m].
        """
        for k in range(4):
            self._see(k * self.step_ns, x)
            self.plan(k * self.step_ns)
        self.restart()

    def see(self, stamp_ns: int, positions: np.ndarray) -> None:
        """Take in a state.

        Args:
            stamp_ns: when it was, later than the one before [ns].
            positions: as in joint_states, shape (1 + J,), of bodies that turn more [m, rad].
        """
        self._see(stamp_ns, self.robot.read(positions))

    def _see(self, stamp_ns: int, x: np.ndarray) -> None:
        place = self.robot.locate(x)
        if not self._seen:
            self._start_ns, self._origin = stamp_ns, place
        self._seen = [*self._seen[-self.robot.remembers :], (stamp_ns, x)]
        self._missed.append(self.robot.miss(place, self._wanted(np.array([stamp_ns]))[0]))

    def plan(self, begin_ns: int, stop: Callable[[], bool] = lambda: False) -> np.ndarray:
        """Plan from the last state.

        Args:
            begin_ns: when the plan begins [ns]; until then the last one goes on.
            stop: whether no time is left, see `find_plan`.

        Returns:
            Rest lengths and angles at the ends of the steps, shape (H, J) [m, rad].
        """
        if len(self._seen) > 2:
            self.factors = estimate(self.robot, self._build_window(), self.factors, self._noise)
        stamp, x = self._seen[-1]
        start = self.robot.begin(x, self._command_at(stamp), self.factors)
        if begin_ns > stamp:
            try:
                ahead = start.follow(self._commands_between(stamp, begin_ns))[-1]
            except CommandError:  # it stays where it was seen
                ahead = x
            start = self.robot.begin(ahead, self._command_at(begin_ns), self.factors)
        ends = begin_ns + self.step_ns * np.arange(1, self.steps + 1)
        problem = Problem(start, self._limits, self._wanted(ends))
        rows = find_plan(problem, np.array([self._command_at(end) for end in ends.tolist()]), stop)
        self._keep(begin_ns, ends.tolist(), rows)
        return rows

    @property
    def passed_ns(self) -> int:
        """Time from the first state to the last one [ns]."""
        return self._seen[-1][0] - self._start_ns

    @property
    def place(self) -> np.ndarray:
        """Place in the last state, shape (D,) [m, rad]."""
        return self.robot.locate(self._seen[-1][1])

    def describe(self) -> str:
        """Describe how well the path was followed, and what was estimated, in a line."""
        missed = np.array(self._missed)
        way = np.hypot(*missed[:, :2].T) if missed.shape[1] > 1 else np.abs(missed[:, 0])
        angle = "" if missed.shape[1] == 1 else f"; of the yaw {np.sqrt(np.mean(np.square(missed[:, 2]))):.3g} rad"
        return (
            f"error {np.sqrt(np.mean(np.square(way))):.3g} m (root mean square), at most {way.max():.3g} m{angle}; "
            f"{self.robot.describe(self.factors)}"
        )

    def _wanted(self, times_ns: np.ndarray) -> np.ndarray:
        return self._origin + self._path((times_ns - self._start_ns) / NS)

    def _build_window(self) -> Window:
        parts = [self._commands_between(a, b) for (a, _), (b, _) in itertools.pairwise(self._seen)]
        x = np.array([x for _, x in self._seen])
        return Window(x, self._command_at(self._seen[0][0]), np.vstack(parts), np.cumsum([len(p) for p in parts]))

    def _keep(self, begin_ns: int, ends: list[int], rows: np.ndarray) -> None:
        """Let a plan replace what was commanded from its begin on, and forget what nothing needs."""
        now, old = self._command_at(begin_ns), bisect.bisect_left(self._times, begin_ns)
        first = max(bisect.bisect_right(self._times, self._seen[0][0]) - 1, 0)
        self._times = [*self._times[first:old], begin_ns, *ends]
        self._rows = [*self._rows[first:old], now, *rows]

    def _command_at(self, ns: int) -> np.ndarray:
        """Return the rest lengths and angles in force at a time, shape (J,) [m, rad]."""
        k = bisect.bisect_right(self._times, ns)
        if k in (0, len(self._times)):
            return self._rows[max(k - 1, 0)]
        begin, end = self._times[k - 1], self._times[k]
        return self._rows[k - 1] + (ns - begin) / (end - begin) * (self._rows[k] - self._rows[k - 1])

    def _commands_between(self, after_ns: int, until_ns: int) -> np.ndarray:
        """Return those at the waypoints between two times, and at the second, shape (V, J) [m, rad]."""
        k, m = bisect.bisect_right(self._times, after_ns), bisect.bisect_left(self._times, until_ns)
        return np.array([*self._rows[k:m], self._command_at(until_ns)])


def read_path(speed: float, path: Any, turns: bool = False) -> Path:
    """Read the path that is to be followed.

    Args:
        speed: of the net translation, in the plane along x [m/s].
        path: times [s] and places in turn: net translations [m], of bodies that turn x, y [m] and yaw [rad]; a single
            one leaves it to the speed.
        turns: whether the body turns.

    Returns:
        The path.

    Raises:
        CommandError: if numbers are missing, or times do not increase from 0.
    """
    numbers, size = np.array(path, dtype=np.float64), 4 if turns else 2
    if turns and numbers.tolist() == [0.0, 0.0]:  # the default, of all bodies
        numbers = np.zeros(4)
    if numbers.size % size or not numbers.size or not np.isfinite(numbers).all():
        right = "x (m), y (m) and yaw (rad) in turn, as [0.0, 0.0, 0.0, 0.0, 9.0, 0.1, 0.0, 0.0]"
        right = right if turns else "places (m) in turn, as [0.0, 0.0, 9.0, 0.1]"
        raise CommandError(f"path: {numbers.tolist()}; it must be times (s) and {right}")
    times, places = numbers[::size], numbers.reshape(-1, size)[:, 1:]
    if times[0] != 0.0 or (np.diff(times) <= 0.0).any():
        raise CommandError(f"path: its times are {times.tolist()} s; they must increase from 0")
    if times.size == 1:
        return lambda at: places + np.multiply.outer(speed * at, np.eye(size - 1)[0])
    return lambda at: np.column_stack([np.interp(at, times, each) for each in places.T])
