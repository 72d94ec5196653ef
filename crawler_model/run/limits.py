"""The limits of a drive: the steepest slope and the largest tow against which a period still gains.

Both are judged by the gain of the periodic regime: the loads are applied slowly at the start, then the drive runs until
the tensions at the end of a period repeat. More load never carries a body further (spring forces are monotone), so
the largest tow is found by bisection. A slope also lowers the friction of coefficients, which may help or
hinder: slopes are scanned first, from the steepest down, and the end of the highest stretch that gains is bisected.

On patches of ground there is no periodic regime before the last border is passed. The whole path counts there: against
a load that is not too large, the body still gains behind the last border in its direction, or nothing holds it back
before the search ends. Less load brings it at least as far, so that the bisection holds on patches, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..body.ground import Ground
from ..body.plan import Plan, check_plan
from ..crawler.crawler import Crawler
from ..errors import CommandError
from ..theory.holding import steepest_held
from .account import average_displacement
from .repeats import REPEATS, determining_tension, has_left_all_ground, tensions_repeat

RESOLUTION = 1e-9
"""Width of the final bracket: of a slope [rad], and of a tow relative to the largest tow that has an equilibrium."""
SLOPES_TRIED = 33
"""Evenly spaced slopes that are tried, the steepest first, before the bisection."""
_MOST_PERIODS = 500
_GAINED = 1e-11
"""A gain below this part of the stroke is rounding."""
_NO_STROKE = 1e-6
"""The least stroke assumed, as a part of the body's length: friction may drive a body without any stroke."""

Cause = Literal["gain", "equilibrium", "no travel", "budget"]


@dataclass(frozen=True)
class Limit:
    """The largest load against which a drive gains.

    Attributes:
        cause: why there is no more. "gain": beyond it the body no longer advances, or goes back. "equilibrium": it
            gains as long as an equilibrium exists; beyond, it runs away. "no travel": without the load it does not
            advance either. "budget": the search ended early; the limit lies between `value` and `beyond`.
        value: the largest load that gains: a slope [rad] or a tow [N], a positive number; 0 if it does not travel.
        beyond: the least load found to be too much, within RESOLUTION of `value` unless the budget ended the search
            [rad or N].
        direction: direction of travel without the load, and so of `gain`: 1 forward, -1 backward, 0 none. The load acts
            against it.
        free_gain: gain of a period without the load, in that direction [m].
        gain: gain of a period at `value`, in that direction [m].
        settled: whether every run became periodic.
        periods: number of periods simulated.
    """

    cause: Cause
    value: float
    beyond: float
    direction: int
    free_gain: float
    gain: float
    settled: bool
    periods: int


def steepest_climb(scene: Plan, budget: int = 10_000_000, progress: Callable[[float], None] | None = None) -> Limit:
    """Find the steepest slope, uphill in the direction of travel, on which a period of the drive still gains.

    The direction is taken on level ground; the slope of the scene does not matter, its other loads do. On patches of
    ground the whole path of the body counts; they are tilted with the track.

    A gain need not fall steadily with the slope, as friction by coefficients falls with it: of SLOPES_TRIED slopes up
    to the steepest that is held, the steepest that gains is taken, and the end of the stretch around it is found by
    bisection. A steeper stretch that is narrower than their distance is not found.

    Args:
        scene: a body on a line with weights, and a drive with a period.
        budget: upper limit of periods times waypoints times contacts.
        progress: called with the completed part, in [0, 1].

    Returns:
        The limit; its value is a slope [rad].

    Raises:
        CommandError: if the scene has no weights, no periodic drive, no equilibrium on level ground, walls, or ground
            with slopes of its own from place to place.
        SceneError: if `scene` is not a scene.
    """
    check_plan(scene, "steepest_climb")
    search = _Search(scene, "steepest_climb", budget, progress)
    if not scene.ground.weight.any():
        raise CommandError("steepest_climb: the scene has no body.weights, so that a slope does not load it")
    if not scene.ground.has_one_slope:
        raise CommandError(
            "steepest_climb: the ground has slopes of its own, so that the track has no one slope to "
            "vary; the largest tow shows against which force the drive carries the body over them"
        )
    if not search.holds(search.on_slope(0.0)):
        raise CommandError("steepest_climb: the loads of the scene have no equilibrium on level ground")
    return search.find(search.on_slope, search.steepest, SLOPES_TRIED, RESOLUTION)


def largest_tow(
    scene: Plan, contact: int = -1, budget: int = 10_000_000, progress: Callable[[float], None] | None = None
) -> Limit:
    """Find the largest constant force on one contact, against the travel, with which a period still gains.

    The scene with its own slope and loads determines the direction of travel. On patches of ground the whole path of
    the body counts.

    Args:
        scene: a body on a line, and a drive with a period.
        contact: index of the contact along the body, from 0; negative ones count from the last contact.
        budget: upper limit of periods times waypoints times contacts.
        progress: called with the completed part, in [0, 1].

    Returns:
        The limit; its value is a force [N].

    Raises:
        CommandError: if the scene has no periodic drive, no such contact, or walls.
        SceneError: if `scene` is not a scene.
    """
    check_plan(scene, "largest_tow")
    search = _Search(scene, "largest_tow", budget, progress)
    n = scene.body.contacts
    if not -n <= contact < n:
        raise CommandError(f"largest_tow: contact {contact}; it must be between {-n} and {n - 1}")
    force = np.zeros(n)
    force[contact] = -1.0
    reserve = search.reserve()

    def most(direction: int) -> float:
        return reserve[1] if direction > 0 else reserve[0]

    return search.find(lambda tow: search.loaded(tow * force), most, 1, RESOLUTION * max(*reserve, 1e-300))


class _Search:
    """Runs of one drive under loads that are not the scene's."""

    def __init__(self, scene: Plan, call: str, budget: int, progress: Callable[[float], None] | None) -> None:
        if scene.body.dimension != 1:
            raise CommandError(f"{call}: only for bodies on a line; {scene.name} lies in the plane")
        if scene.drive.period is None or scene.drive.holds:
            raise CommandError(f"{call}: {scene.name} has no drive with a period")
        if scene.ground.track is not None and scene.ground.track.walls is not None:
            raise CommandError(f"{call}: {scene.name} has ground.walls, so what a period gains depends on the place")
        self.scene, self.progress = scene, progress
        drive, n = scene.drive, scene.body.contacts
        self.targets = drive.targets[drive.times < drive.period]
        self.bounds = slice(scene.body.springs, scene.body.springs + 2 * n)
        self.load = drive.loads[: self.targets.shape[0]] if scene.columns.loads else np.zeros((1, n))
        if scene.ground.track is not None and not scene.columns.loads:  # there friction is multiplied, loads are not
            self.targets = np.hstack((self.targets, np.zeros((self.targets.shape[0], n))))
        stroke = float(np.ptp(self.targets[:, : scene.body.springs], axis=0).sum())
        self.least_gain = _GAINED * max(stroke, _NO_STROKE * float(np.ptp(scene.body.position)))
        self.most_periods = budget // (self.targets.shape[0] * n)
        self.periods, self.settled = 0, True

    def loaded(self, extra: np.ndarray, friction: np.ndarray | float = 1.0) -> np.ndarray:
        """Add loads of shape (N,) to the targets of a period, and multiply the friction of each contact."""
        targets = self.targets.copy()
        n = self.scene.body.contacts
        forward, backward = targets[:, self.bounds][:, :n], targets[:, self.bounds][:, n:]
        if not np.isscalar(friction):
            forward += (friction - 1.0) * (forward + self.load)
            backward += (friction - 1.0) * (backward - self.load)
        forward -= extra
        backward += extra
        targets[:, self.bounds.stop :] += extra if targets.shape[1] > self.bounds.stop else 0.0
        return targets

    def on_slope(self, slope: float) -> np.ndarray:
        """Tilt the track to a slope [rad], uphill towards +x."""
        ground = self.scene.ground
        tilted = Ground(ground.weight, ground.by_coefficient, slope)
        scale = np.where(ground.by_coefficient, math.cos(slope) / math.cos(ground.slope), 1.0)
        return self.loaded(tilted.slope_load - ground.slope_load, scale)

    def steepest(self, direction: int) -> float:
        """Compute the slope uphill in a direction up to which every waypoint has an equilibrium."""
        ground, n = self.scene.ground, self.scene.body.contacts
        bounds = self.targets[:, self.bounds]
        held = bounds[:, n:] - self.load if direction > 0 else bounds[:, :n] + self.load
        if ground.track is not None:
            side = 1 if direction > 0 else 0
            held = held * ground.track.largest_factor[side] + ground.track.largest_added[side]
        others = direction * (self.load - ground.slope_load)
        return min(
            steepest_held(ground, mu, p) for mu, p in zip(held, np.broadcast_to(others, held.shape), strict=True)
        )

    def reserve(self) -> tuple[float, float]:
        """Compute the largest forces, forward and backward, with which every waypoint has an equilibrium somewhere."""
        drive, track, n = self.scene.drive, self.scene.ground.track, self.scene.body.contacts
        sides = [drive.forward[None], drive.backward[None]]
        if track is not None:
            last = track.borders.size
            ends = [(j, max(j - 1, 0)) for j in range(last + 1)] + [(j, j) for j in range(last)]
            commanded = self.targets[:, self.bounds.start :]
            bounds = [
                track.bounds(commanded, np.full(n, 2 * j), track.borders[border] if last else np.zeros(n))
                for j, border in ends
            ]
            sides = [np.array([pair[k] for pair in bounds]) + track.largest_added[k] for k in (0, 1)]
        forward, backward = (float(side.max(axis=0).sum(axis=1).min()) for side in sides)
        return forward, backward

    def holds(self, targets: np.ndarray) -> bool:
        """Return whether every waypoint has an equilibrium; on patches only their run can tell."""
        if self.scene.ground.track is not None:
            return True
        n = self.scene.body.contacts
        bounds = targets[:, self.bounds]
        near = 1e-12 * np.abs(bounds).sum(axis=1)
        return bool((bounds[:, :n].sum(axis=1) >= -near).all() and (bounds[:, n:].sum(axis=1) >= -near).all())

    def gain(self, targets: np.ndarray) -> float | None:
        """Run until periodic; return the gain of the last period [m], None without an equilibrium."""
        if not self.holds(targets):
            return None
        crawler = Crawler(self.scene).placed(self.scene.start_displacement, self.targets[0])
        period = np.vstack((targets[1:], targets[:1]))
        try:
            crawler.follow(targets[:1])
            return self._repeat_periods(crawler, period)
        except CommandError:  # it reaches ground on which nothing holds it
            return None

    def _repeat_periods(self, crawler: Crawler, period: np.ndarray) -> float:
        """Follow periods until they repeat; return the gain of the last one [m]."""
        body, gained = self.scene.body, 0.0
        tension = determining_tension(body, crawler)
        records = np.empty((period.shape[0], 2 * body.contacts + body.springs))
        for _ in range(_MOST_PERIODS):
            if self.periods >= self.most_periods:
                raise _Spent
            self.periods += 1
            begin = crawler.displacement
            crawler.follow(period, records)
            before, tension = tension, determining_tension(body, crawler)
            gained = float(average_displacement(body, crawler.gained[None])[0])
            if not tensions_repeat(body, period, tension, before, REPEATS):
                continue
            travel = float(np.abs(records[:, : begin.size] - begin).max())
            if abs(gained) <= self.least_gain or has_left_all_ground(crawler, begin, gained, travel):
                return gained
        self.settled = False
        return gained

    def report(self, part: float) -> None:
        """Report the completed part."""
        if self.progress is not None:
            self.progress(min(part, 1.0))

    def find(
        self,
        at: Callable[[float], np.ndarray],
        most: Callable[[int], float],
        scanned: int,
        resolution: float,
    ) -> Limit:
        """Find the largest load that gains.

        Args:
            at: targets of a period under a load of a given size, positive against forward travel.
            most: the largest load against a direction of travel that has an equilibrium.
            scanned: number of loads to try before the bisection.
            resolution: final width of the bracket.

        Returns:
            The limit.
        """
        try:
            free = self.gain(at(0.0))
        except _Spent:
            return Limit("budget", 0.0, math.inf, 0, 0.0, 0.0, self.settled, self.periods)
        if free is None or abs(free) <= self.least_gain:
            return Limit("no travel", 0.0, 0.0, 0, 0.0, 0.0, self.settled, self.periods)
        direction = 1 if free > 0.0 else -1
        bracket = _Bracket(0.0, max(most(direction), 0.0), direction * free)

        def gains(load: float) -> bool:
            """Try a load and narrow the bracket."""
            gained = self.gain(at(direction * load))
            if gained is None or direction * gained <= self.least_gain:
                bracket.beyond, bracket.lost = load, gained is None
                return False
            bracket.value, bracket.gain = load, direction * gained
            return True

        try:
            cause = self._narrow(bracket, gains, scanned, resolution)
        except _Spent:
            cause = "budget"
        value, beyond, gain = bracket.value, bracket.beyond, bracket.gain
        return Limit(cause, value, beyond, direction, direction * free, gain, self.settled, self.periods)

    def _narrow(self, bracket: _Bracket, gains: Callable[[float], bool], scanned: int, resolution: float) -> Cause:
        """Narrow a bracket: loads from the largest down until one gains, then the middle again and again."""
        top = bracket.beyond
        if top > resolution:
            for k, load in enumerate(np.linspace(top - resolution, 0.0, scanned, endpoint=False)):
                self.report(0.5 * k / scanned)
                if gains(float(load)):
                    break
            if bracket.value == top - resolution:
                bracket.value = top
                return "equilibrium"
        width = bracket.beyond - bracket.value
        while bracket.beyond - bracket.value > resolution:
            middle = 0.5 * (bracket.value + bracket.beyond)
            if not bracket.value < middle < bracket.beyond:
                break
            gains(middle)
            self.report(0.5 + 0.5 * math.log(width / (bracket.beyond - bracket.value)) / math.log(width / resolution))
        return "equilibrium" if bracket.lost else "gain"


@dataclass
class _Bracket:
    """A load that gains, one that does not, the gain at the first, and whether the second one has no equilibrium."""

    value: float
    beyond: float
    gain: float
    lost: bool = False


class _Spent(Exception):
    """The budget is spent."""
