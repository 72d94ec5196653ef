"""Gaits without exact derivatives: in the plane, for bodies that turn, and on patches of ground.

Candidates are followed period by period. In the plane the periodic regime is judged as on a line; on patches, where no
two periods are the same, the mean of the first periods from the start is.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from crawler_model.crawler.crawler import Crawler
from crawler_model.errors import CommandError
from crawler_model.rounding import EPS
from crawler_model.run.account import average_displacement, tolerance_of
from crawler_model.run.cycle import check_solved, repeat_period
from crawler_model.run.screw import largest_distance
from crawler_model.run.simulate import simulate
from crawler_model.scene.scene import Scene

from .goal import SCREW, Goal
from .regime import Regime
from .unknowns import Cycle

_MOST_PERIODS = 12
_SETTLED = 0.1
"""Part of the tolerance of the scene within which the gains of periods have to settle."""
_LITTLE = 1e-2
"""Part of the gain that may be left of the transient where a gait has a cost of transport."""
_ROUNDING = 1e-13
"""Gains below this part of the size of the body are rounding."""
_PEAK_PERIODS, _PEAK_TICKS = 4, 200


def find_followed_regime(cycle: Cycle, goal: Goal) -> Regime | None:
    """Follow a candidate period by period.

    Args:
        cycle: the candidate, in the plane, on patches or with hysteresis.
        goal: the direction, and the number of periods whose gain counts.

    Returns:
        The regime, with NaN for the peak; its travel and speed belong to links, in the plane to their components. None
        if the body loses its stability, comes to ground on which nothing holds it, or is in a ramp that is not solved.
    """
    plan, targets = cycle.plan, cycle.plan.drive.targets
    body, period = plan.body, np.vstack((targets[2:], targets[1:2]))
    crawler = Crawler(plan)
    motion = None
    try:
        crawler.follow(targets[1:2])
        if plan.ground.differs:
            mean, work = _average_periods(crawler, period, goal.periods)
            left = 0.0
        else:
            found = repeat_period(crawler, period, _SETTLED * tolerance_of(plan), _MOST_PERIODS)
            least = _ROUNDING * largest_distance(body)
            mean, work = np.atleast_1d(found.gain), found.work
            mean = np.where(np.abs(mean) > least, mean, 0.0)
            motion = tuple(mean.tolist()) if body.dimension == 2 else None
            left = 0.0 if found.settled else found.transient_left
        gain = float(mean[0])
        if body.dimension == 2:
            gain = math.cos(goal.towards) * float(mean[0]) + math.sin(goal.towards) * float(mean[1])
            gain = gain if abs(gain) > EPS * math.hypot(*mean[:2]) else 0.0
    except CommandError:
        return None
    lengths = body.springs if body.turning is not None else body.lengths
    change = np.abs(np.diff(targets[1:, :lengths], axis=0, append=targets[1:2, :lengths]))
    speed = (change / np.roll(cycle.seconds, -1)[:, None]).max(initial=0.0)
    each = 2 if plan.columns.planar is None else max(plan.columns.planar, 1)
    friction = targets[1:, body.lengths :][:, : each * body.contacts].sum(axis=1) / each
    force = float(plan.ground.weight.sum()) or float(friction @ cycle.share)
    return Regime(gain, work, float(change.sum()), force, math.nan, float(speed), left <= _LITTLE * abs(gain), motion)


def _average_periods(crawler: Crawler, period: np.ndarray, count: int) -> tuple[np.ndarray, float]:
    """Compute the mean gain, shape (1,), in the plane (2,) [m], and work [J] of the next periods."""
    gain, work = np.zeros(crawler.body.dimension), 0.0
    for _ in range(count):
        step = crawler.follow(period)
        check_solved(step, "optimise")
        work += step.work
        gain += average_displacement(crawler.body, crawler.gained[None])[0]
    return gain / count, work / count


def find_followed_peak(scene: Scene, periods: int) -> float:
    """Find the largest tension of a link in the first periods of a gait.

    Args:
        scene: a scene that plays it.
        periods: on patches, number of periods that count; elsewhere four are enough.

    Returns:
        The tension [N], at 200 times a period.
    """
    period = scene.drive.period
    assert period is not None
    count = _PEAK_PERIODS if not scene.ground.differs else periods
    tension = simulate(scene, count * period, rate=_PEAK_TICKS / period).tension[:, : scene.body.springs]
    vectors = tension.reshape(*tension.shape[:2], -1)
    return float(np.linalg.norm(vectors, axis=2).max(initial=0.0))


def followed_goal(scene: Scene, goal: Goal, target: Sequence[float] | None) -> Goal:
    """Set the target and the resolution of the goal of a body in the plane.

    Args:
        goal: the objective.
        target: dx, dy [m] and dyaw [rad] of the screw, or None.

    Returns:
        The goal, which does not count differences below the tolerance of the scene.
    """
    if scene.dimension == 1:
        return goal
    length = largest_distance(scene.body)
    if target is not None:
        dx, dy, dyaw = (float(value) for value in target)
        goal = dataclasses.replace(goal, target=(dx, dy, dyaw, length))
    unit = length if goal.objective in ("translation", SCREW) else 1.0
    return dataclasses.replace(goal, resolution=tolerance_of(scene) * unit)
