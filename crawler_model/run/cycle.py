"""The periodic regime of a drive: what a period gains once the transient is over.

The tensions of two solutions under the same drive never move apart in the norm of the elastic energy ([G] section 4:
the shape is a sweeping process), so that the tensions at the ends of periods settle. Often they repeat after a few
periods, exactly; otherwise their difference shrinks by a ratio a period, from which the rest of the transient follows.

On ground that differs from place to place a regime lasts where a body walks in place, as at a wall, and where all its
contacts have left all borders and walls behind; before that no two periods need be equal.

A period of a body that turns may displace and turn it as a whole: the positions in its own frame have to repeat, within
the tolerance of its steps. Loads do not turn with it, so that under loads the positions about its origin have to.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import frozen
from ..body.drive import NS
from ..body.plan import Plan, check_plan
from ..body.turning import TURNING_TOLERANCE
from ..crawler.crawler import Crawler
from ..crawler.step import Step
from ..errors import CommandError
from ..notebook import write_html
from ..rounding import EPS
from .account import average_displacement
from .repeats import REPEATS, determining_stiffness, determining_tension, has_left_all_ground, tensions_repeat
from .screw import Screw, find_screw, gain_in_frame, places_in_frame
from .transport import length_of

_RATIOS = 3
"""Ratios of successive differences that have to agree on how fast the transient decays."""


@dataclass(frozen=True, eq=False, repr=False)
class LimitCycle:
    """The periodic regime of a drive.

    Attributes:
        gain: y gained in the last period [m]; in the plane shape (2,); for a body that turns dx, dy [m] and dyaw [rad]
            in its frame, as in `Trajectory.per_period`, shape (3,).
        work: work of the actuators in the last period [J].
        transient_left: estimate of how far `gain` is from the periodic regime's [m]: where the tensions repeat,
            the rounding of the gain, and what it hides of a slow transient; the tail of a geometric series where their
            difference shrinks; infinite where it does not shrink yet.
        settled: whether `transient_left` is within the tolerance.
        ratio: by which the difference of the tensions shrank in each of the last periods, at worst [1]; 0 where they
            repeat.
        periods: number of periods run.
        gains: y gained in each period, shape (periods,), in the plane (periods, 2), for a body that turns (periods, 3)
            [m, rad].
    """

    gain: float | np.ndarray
    work: float
    transient_left: float
    settled: bool
    ratio: float
    periods: int
    gains: np.ndarray

    @property
    def screw(self) -> Screw | None:
        """The motion of a body that turns in the last period, as a rotation; None for bodies that do not turn."""
        return find_screw(self.gains[-1]) if self.gains.shape[1:] == (3,) else None

    def __repr__(self) -> str:
        """State the gain, and whether it has settled."""
        if self.settled:
            end = f"settled after {self.periods} periods, at most {self.transient_left:.1e} m left"
        elif math.isfinite(self.transient_left):
            shrinks = 100.0 * (1.0 - self.ratio)
            end = f"not settled after {self.periods} periods: the transient shrinks by {shrinks:.2g} % a period"
        else:
            end = f"not settled after {self.periods} periods: the transient does not shrink yet"
        unit = "m" if self.screw is None else "m, m, rad"
        return f"LimitCycle({self.gain} {unit} a period, {end})"

    def _repr_html_(self) -> str:
        """Show the regime in a notebook."""
        names = {"gain": "m", "work": "J", "transient_left": "m", "settled": "1", "ratio": "1", "periods": "1"}
        return write_html("LimitCycle", [(f"{name} [{unit}]", getattr(self, name)) for name, unit in names.items()])


def limit_cycle(
    scene: Plan,
    tolerance: float = 1e-9,
    most_periods: int = 1000,
    progress: Callable[[float], None] | None = None,
) -> LimitCycle:
    """Run a drive until its periods repeat.

    Args:
        scene: a scene whose drive has a period.
        tolerance: of the gain, relative to the largest displacement within a period [1]; for a body that turns at least
            the tolerance of its scene, within which its periods differ.
        most_periods: number of periods to run at most.
        progress: called with the completed part of these, in [0, 1].

    Returns:
        The periodic regime, or how far the run came.

    Raises:
        CommandError: if the drive has no period, the body still comes to other ground when all periods are run, a ramp
            is not solved, or an argument is out of range.
        SceneError: if `scene` is not a scene.
    """
    check_plan(scene, "limit_cycle")
    drive = scene.drive
    if drive.period is None or drive.holds:
        raise CommandError(f"limit_cycle: {scene.name} has no drive with a period")
    if not tolerance > 0.0:
        raise CommandError(f"limit_cycle: tolerance {tolerance:g}; it must be > 0")
    if not most_periods >= 1:
        raise CommandError(f"limit_cycle: most_periods {most_periods}; it must be at least 1")
    _, rows = drive.waypoints_between(0, round(drive.period * NS))
    targets = np.ascontiguousarray(drive.targets[rows])
    found = repeat_period(Crawler(scene), targets, tolerance, most_periods, progress)
    if scene.ground.differs and not found.settled:
        raise CommandError(
            f"limit_cycle: {scene.name} has {scene.ground.differs}, and after {most_periods} periods it still comes "
            "to other ground or is not settled, so that periods differ; `per_period` of simulate lists their gains"
        )
    return found


def repeat_period(
    crawler: Crawler,
    targets: np.ndarray,
    tolerance: float,
    most_periods: int,
    progress: Callable[[float], None] | None = None,
) -> LimitCycle:
    """Repeat a period until the motion repeats.

    Args:
        crawler: at the start of a period; it moves on.
        targets: the ramps of a period, shape (V, F).
        tolerance: as for `limit_cycle` [1].
        most_periods: as for `limit_cycle`.
        progress: as for `limit_cycle`.

    Returns:
        The periodic regime, or how far the run came.
    """
    run = _Periods(crawler, targets)
    while run.count < most_periods:
        run.run_period()
        if run.is_settled(tolerance):
            break
        if progress is not None:
            progress(run.count / most_periods)
    return run.finish(tolerance)


def check_solved(step: Step, what: str) -> None:
    """Refuse to judge a period of which a ramp was not solved.

    Args:
        step: the period.
        what: what it is followed for.

    Raises:
        CommandError: if a ramp was not solved.
    """
    if step.unsolved:
        raise CommandError(f"{what}: {step.unsolved} ramp(s) of a period were not solved; `simulate` shows the error")


class _Periods:
    """Periods of a drive in progress."""

    def __init__(self, crawler: Crawler, targets: np.ndarray) -> None:
        self.crawler, self.targets = crawler, targets
        self.turns = crawler.body.turning is not None
        self.error = (crawler.scene.tolerance or TURNING_TOLERANCE) if self.turns else 0.0
        self.tension = self.determine()
        self.shrinks = 0.0
        self.differences: list[float] = []
        self.gains: list[np.ndarray] = []
        self.work, self.travel, self.count = 0.0, 0.0, 0
        self.scale = np.array([1.0, 1.0, length_of(crawler.body)]) if self.turns else np.ones(1)  # of gains, to lengths
        self.records = np.empty((targets.shape[0], 2 * crawler.displacement.size + crawler.tension.size))

    def determine(self) -> np.ndarray:
        """Return what the motion goes on from: tensions, or positions in the frame of a body that turns."""
        return places_in_frame(self.crawler) if self.turns else determining_tension(self.crawler.body, self.crawler)

    def run_period(self) -> None:
        """Run one more period."""
        crawler, body = self.crawler, self.crawler.body
        begin, yaw = crawler.displacement, crawler.yaw
        start = begin.ravel()
        step = crawler.follow(self.targets, self.records)
        check_solved(step, "limit_cycle")
        x = self.records[:, : start.size]
        self.begin = begin
        self.travel = float(np.abs(x - start).max())
        self.work = step.work
        moved = crawler.gained[None]
        if self.turns:
            gained = gain_in_frame(body, begin[None], moved, np.array([crawler.yaw - yaw]))
        else:
            gained = average_displacement(body, moved)
        self.gains.append(gained[0])
        before, self.tension = self.tension, self.determine()
        scale = np.ones(1) if self.turns else determining_stiffness(body)
        energy = (self.tension - before) ** 2 / scale.reshape(-1, *(1,) * (body.dimension - 1))
        self.differences.append(math.sqrt(float(energy.sum())))
        # a slow transient is in each period a small part of what is left of it
        part = 1.0 - self.shrinks
        if self.turns:  # its steps end in other places when it is turned
            self.repeats = float(np.abs(self.tension - before).max()) <= self.error * self.travel * part
        else:
            self.repeats = bool(tensions_repeat(body, self.targets, self.tension, before, REPEATS * part))
        self.count += 1
        if not self.repeats and self.ratio() < 1.0:
            self.shrinks = self.ratio()

    def ratio(self) -> float:
        """Compute the worst ratio of the last differences; 1 where there are too few."""
        if self.repeats:
            return 0.0
        last = self.differences[-1 - _RATIOS :]
        if len(last) <= _RATIOS:
            return 1.0
        return max(b / a if a > 0.0 else 0.0 for a, b in itertools.pairwise(last))

    def transient_left(self) -> float:
        """Estimate how far the last gain is from the gain of a regime that lasts [m].

        On ground that differs, and is not all left behind, that is the regime of a body that walks in place.
        """
        ground, gain = self.crawler.scene.ground, self.gains[-1]
        lasts = not ground.differs or (
            ground.regions is None and has_left_all_ground(self.crawler, self.begin, float(gain), self.travel)
        )
        return self._transient_on_this_ground() + (0.0 if lasts else float(np.abs(gain).max()))

    def _transient_on_this_ground(self) -> float:
        if self.repeats and self.turns:
            return self.error * self.travel
        if self.repeats:
            return 8.0 * EPS * self.travel / (1.0 - self.shrinks if self.differences[-1] > 0.0 else 1.0)
        ratio = self.ratio()
        if ratio >= 1.0:
            return math.inf
        change = max(
            float(np.abs((b - a) * self.scale).max())
            for a, b in zip(self.gains[-_RATIOS - 1 : -1], self.gains[-_RATIOS:], strict=True)
        )
        return change * ratio / (1.0 - ratio)

    def is_settled(self, tolerance: float) -> bool:
        """Determine whether the gain is within the tolerance [1] of the gain of a regime that lasts."""
        return self.transient_left() <= max(tolerance, self.error) * self.travel

    def finish(self, tolerance: float) -> LimitCycle:
        """Build the result."""
        gain = self.gains[-1]
        return LimitCycle(
            gain=frozen(gain) if gain.ndim else float(gain),
            work=self.work,
            transient_left=self.transient_left(),
            settled=self.is_settled(tolerance),
            ratio=self.ratio(),
            periods=self.count,
            gains=frozen(self.gains),
        )
