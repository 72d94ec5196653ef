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
from .horizon import Limits, Problem, find_plan
from .robot import Robot

Path = Callable[[np.ndarray], np.ndarray]
"""From times since the first state, shape (K,) [s], to net translations since then, shape (K,) [m]."""
_SEEN = 40
"""States from which friction and loads are estimated."""


class Tracker:
    """Follows a path of the net translation with a robot whose friction and loads are not known.

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
        self._times, self._rows = [0], [self.robot.base[: self.robot.springs]]
        self._start_ns, self._origin = 0, 0.0
        self._errors = np.zeros(3)  # their number, sum of squares, largest

    def warm_up(self, x: np.ndarray) -> None:
        """Compile what plans need.

        Args:
            x: displacement at the start, shape (N,) [m].
        """
        for k in range(4):
            self.see(k * self.step_ns, self.robot.joints_by_contacts @ x)
            self.plan(k * self.step_ns)
        self.restart()

    def see(self, stamp_ns: int, positions: np.ndarray) -> None:
        """Take in a state.

        Args:
            stamp_ns: when it was, later than the one before [ns].
            positions: as in joint_states, shape (1 + J,) [m].
        """
        x = self.robot.contacts_by_joints @ positions
        y = float(self.robot.scene.body.share @ x)
        if not self._seen:
            self._start_ns, self._origin = stamp_ns, y
        self._seen = [*self._seen[-_SEEN:], (stamp_ns, x)]
        error = abs(y - float(self._wanted(np.array([stamp_ns]))[0]))
        self._errors[:] = self._errors[0] + 1.0, self._errors[1] + error * error, max(self._errors[2], error)

    def plan(self, begin_ns: int, stop: Callable[[], bool] = lambda: False) -> np.ndarray:
        """Plan from the last state.

        Args:
            begin_ns: when the plan begins [ns]; until then the last one goes on.
            stop: whether no time is left, see `find_plan`.

        Returns:
            Rest lengths at the ends of the steps, shape (H, S) [m].
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
    def net_translation(self) -> float:
        """Net translation in the last state [m]."""
        return float(self.robot.scene.body.share @ self._seen[-1][1])

    def describe(self) -> str:
        """Describe how well the path was followed, and what was estimated, in a line."""
        count, squares, largest = self._errors
        forward, backward, *loads = self.factors.tolist()
        return (
            f"error {(squares / max(count, 1.0)) ** 0.5:.3g} m (root mean square), at most {largest:.3g} m; friction "
            f"forward {forward:.3f}, backward {backward:.3f} of the scene's, loads "
            f"{', '.join(f'{load:.4f}' for load in loads)} N"
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
        """Return the rest lengths in force at a time, shape (S,) [m]."""
        k = bisect.bisect_right(self._times, ns)
        if k in (0, len(self._times)):
            return self._rows[max(k - 1, 0)]
        begin, end = self._times[k - 1], self._times[k]
        return self._rows[k - 1] + (ns - begin) / (end - begin) * (self._rows[k] - self._rows[k - 1])

    def _commands_between(self, after_ns: int, until_ns: int) -> np.ndarray:
        """Return the rest lengths at the waypoints between two times, and at the second, shape (V, S) [m]."""
        k, m = bisect.bisect_right(self._times, after_ns), bisect.bisect_left(self._times, until_ns)
        return np.array([*self._rows[k:m], self._command_at(until_ns)])


def read_path(speed: float, path: Any) -> Path:
    """Read the path that is to be followed.

    Args:
        speed: of the net translation [m/s].
        path: times [s] and net translations [m] in turn; a single one leaves it to the speed.

    Returns:
        The path.

    Raises:
        CommandError: if it is no list of pairs, or times do not increase from 0.
    """
    numbers = np.array(path, dtype=np.float64)
    if numbers.size % 2 or not numbers.size or not np.isfinite(numbers).all():
        raise CommandError(
            f"path: {numbers.tolist()}; it must be times (s) and places (m) in turn, as [0.0, 0.0, 9.0, 0.1]"
        )
    times, places = numbers[::2], numbers[1::2]
    if times[0] != 0.0 or (np.diff(times) <= 0.0).any():
        raise CommandError(f"path: its times are {times.tolist()} s; they must increase from 0")
    return (lambda at: places[0] + speed * at) if times.size == 1 else (lambda at: np.interp(at, times, places))
