"""Gaits of bodies that turn: their periodic regime, which is a rigid motion, and what can be asked for."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from ..body.turning import TURNING_TOLERANCE
from ..crawler.crawler import Crawler
from ..errors import CommandError, SceneError
from ..run.cycle import repeat_period
from ..run.screw import largest_distance
from ..run.simulate import simulate
from ..scene.scene import Scene
from .goal import SCREW, TURNING_OBJECTIVES, Goal
from .regime import Regime
from .unknowns import Cycle

_MOST_PERIODS = 12
_TOLERANCE = 1e-8
_PEAK_PERIODS, _PEAK_TICKS = 4, 200


def find_turning_regime(cycle: Cycle) -> Regime | None:
    """Compute the periodic regime of a candidate that turns.

    Args:
        cycle: the candidate.

    Returns:
        The regime, with NaN for the peak; its travel and speed are those of links. None if the body loses its
        stability, and its scene does not let it jump.
    """
    plan, targets = cycle.plan, cycle.plan.drive.targets
    body = plan.body
    crawler = Crawler(plan)
    try:
        crawler.follow(targets[1:2])
        found = repeat_period(crawler, np.vstack((targets[2:], targets[1:2])), _TOLERANCE, _MOST_PERIODS)
    except CommandError:
        return None
    change = np.abs(np.diff(targets[1:, : body.springs], axis=0, append=targets[1:2, : body.springs]))
    speed = (change / np.roll(cycle.seconds, -1)[:, None]).max(initial=0.0)
    friction = targets[1:, body.lengths :][:, : plan.columns.frictions].sum(axis=1) / plan.columns.sides
    force = float(plan.ground.weight.sum()) or float(friction @ cycle.share)
    dx, dy, dyaw = (float(value) for value in np.asarray(found.gain))
    return Regime(
        dx, found.work, float(change.sum()), force, math.nan, float(speed), found.settled, motion=(dx, dy, dyaw)
    )


def find_turning_peak(scene: Scene) -> float:
    """Find the largest tension of a link in the first periods of a gait.

    Args:
        scene: a scene that plays it.

    Returns:
        The tension [N], at 200 times a period.
    """
    period = scene.drive.period
    assert period is not None
    run = simulate(scene, _PEAK_PERIODS * period, rate=_PEAK_TICKS / period)
    return float(np.abs(run.tension[:, : scene.body.springs]).max(initial=0.0))


def turning_goal(scene: Scene, goal: Goal, target: Sequence[float] | None) -> Goal:
    """Set the target and the resolution of the goal of a body that turns.

    Args:
        scene: the scene.
        goal: the objective.
        target: dx, dy [m] and dyaw [rad] of the screw, or None.

    Returns:
        The goal, which does not count differences below the tolerance of the scene.
    """
    length, tolerance = largest_distance(scene.body), scene.tolerance or TURNING_TOLERANCE
    if target is not None:
        dx, dy, dyaw = (float(value) for value in target)
        goal = dataclasses.replace(goal, target=(dx, dy, dyaw, length))
    unit = length if goal.objective in ("translation", SCREW) else 1.0
    return dataclasses.replace(goal, resolution=tolerance * unit)


def check_turning(scene: Scene, objective: str, target: Sequence[float] | None, limits: dict[str, object]) -> None:
    """Check a request against the kind of body.

    Args:
        scene: the scene.
        objective: a key of `OBJECTIVES`.
        target: dx, dy [m] and dyaw [rad] of the screw, or None.
        limits: what else is requested, by the name of the argument; None or empty for nothing.

    Raises:
        SceneError: if a body that turns cannot have it, or a body that does not turn.
        CommandError: if the target is missing, or is not three finite numbers.
    """
    turns = scene.body.turning is not None
    if turns and objective not in TURNING_OBJECTIVES:
        names = ", ".join(TURNING_OBJECTIVES)
        raise SceneError(f"objective: {objective!r}; that of {scene.name}, which turns, must be one of {names}")
    if not turns and objective in ("turn", SCREW):
        raise SceneError(f"objective: {objective!r}; {scene.name} does not turn, as it has no `springs: length`")
    for name, given in limits.items():
        if turns and given:
            raise SceneError(f"{name}: not available for {scene.name}, which turns; leave it out")
    if (target is not None) != (objective == SCREW):
        raise CommandError(f"target: {target}; the objective {SCREW!r} needs dx, dy, dyaw per period, others none")
    if target is not None and (len(target) != 3 or not all(math.isfinite(value) for value in target)):
        raise CommandError(f"target: {list(target)}; it must be three finite numbers: dx, dy [m], dyaw [rad]")
