"""Examine the best gait of a search: what it is worth, which bounds it reaches, and where it fails."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crawler_model.compiled import clock
from crawler_model.errors import CrawlerError
from crawler_model.run.cycle import limit_cycle
from crawler_model.scene.scene import Scene

from ..derivative.sensitivities import Kink, group_kinks
from .followed import find_followed_peak
from .goal import WORST, Goal, best_first, measure
from .landscape import MAPPED, can_be_mapped, count_samples, plane_points, profile_points, value_inside
from .limit import OutOfTime, TimeLimit
from .optimum import ActiveBound, Alternative, Optimum, Plane, Weakness
from .polish import best_step, improve, improves
from .regime import Regime, RegimeDerivatives, differentiate_regime, find_peak
from .request import Request
from .search import Found
from .space import Evaluator, Space
from .unknowns import Unknowns, with_numbers

_NEAR = 1e-9
_FLAT_STEP, _COARSE_STEP, _FLAT = 2e-3, 5e-2, 1e-9
"""Steps that show which unknowns change nothing, of exact scores and of coarse ones, and a change that is none."""
_ALTERNATIVES = 5
_EXACT_PERIODS, _FOLLOWED_PERIODS = 1000, 50
"""Periods in which the transient of the best gait is judged at most, where a run is exact and where it is not."""
_FACTORS = np.geomspace(1.0, 100.0, 49)[1:]
_LOOKS = 2
"""How often there is time to look around, as a better gait that is seen there is looked around anew."""
_ELSE = 40
"""Candidates that peak, transient, derivatives and alternatives cost."""


def count_candidates(unknowns: Unknowns, request: Request, bodies: int) -> tuple[int, int]:
    """Count the candidates that are run after a search.

    Args:
        bodies: number of candidates that cost as much as verifying the best gait on other bodies.

    Returns:
        Number of candidates around the best gait, and of candidates that follow.
    """
    size = unknowns.low.size
    around = size * (2 + count_samples(unknowns.base.dimension, size))
    if request.mapped and can_be_mapped(unknowns):
        around += MAPPED**2
    return _LOOKS * around, _ELSE + bodies + len(request.robust or {}) * 2 * _FACTORS.size


class Around(NamedTuple):
    """What was seen around a gait.

    Attributes:
        flat: which unknowns change nothing, shape (P,).
        lines: the objective with one unknown at a time moved between its bounds, shape (P, samples).
        plane: the two unknowns that it depends on most, and the objective over both; None if it was not requested.
    """

    flat: tuple[bool, ...]
    lines: np.ndarray
    plane: Plane | None


def confirm_best(space: Space, found: Found, limit: TimeLimit, mapped: bool) -> Around:
    """Look around the best point of a search, and search on where it is beaten, until nothing around it is better.

    Args:
        found: what the search found, changed in place.
        limit: the time limit; some of it is kept for what follows.
        mapped: whether to look over the two unknowns that matter most, too.

    Returns:
        What is around the best point.
    """
    kept = limit.keep(limit.last, (clock() - limit.began) / max(found.evaluations, 1))
    evaluator = Evaluator(space, lambda: limit.over(kept), found.evaluations)

    def look(points: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray, bool]:
        """Compute scores and objective of points, and search on from the best one if it is better."""
        regimes = evaluator.regimes(points)
        scores = np.array([-math.inf if one is None else space.score(one) for one in regimes])
        best = int(best_first(scores)[0])
        if improves(float(scores[best]), found.score):
            found.point, found.score = improve(evaluator, points[best], float(scores[best]), evaluator.is_over)
            found.found_after_s = clock() - limit.began
            found.optima.insert(0, (found.score, found.point.copy()))
            return scores, np.zeros(0), True
        return scores, np.array([math.nan if one is None else value_inside(space, one) for one in regimes]), False

    try:
        while True:
            _begin_first(evaluator, found)
            near, places = _near_moves(space, found.point), profile_points(space, found.point)
            scores, values, moved = look([*(point for _, point in near), *places.reshape(-1, space.size)])
            if moved:
                continue
            lines, plane = values[len(near) :].reshape(places.shape[:2]), None
            if mapped and can_be_mapped(space.scenes[0]):
                pair, points = plane_points(space, found.point, lines)
                _, values, moved = look(list(points))
                plane = None if moved else (pair, values.reshape(MAPPED, MAPPED))
            if not moved:
                break
    finally:
        evaluator.close()
        found.evaluations = evaluator.evaluations
    beside = zip(near, scores, strict=False)
    flat = {i for (i, _), score in beside if abs(score - found.score) <= _FLAT * abs(found.score)}
    return Around(tuple(i in flat for i in range(space.size)), lines, plane)


def _begin_first(evaluator: Evaluator, found: Found) -> None:
    """Let a period begin at the waypoint at which equal gaits do, unless its score is then less, as in the plane."""
    point = evaluator.space.canonical(found.point)
    score = float(evaluator.scores([point])[0])
    if score > -math.inf and not improves(found.score, score):
        found.point, found.score = point, score


def finish(unknowns: Unknowns, space: Space, found: Found, request: Request, limit: TimeLimit) -> Optimum:
    """Examine the best point of a search; what the time limit leaves no time for is left out.

    Args:
        found: what the search found.
        limit: the time limit.

    Returns:
        The optimum.
    """
    around = confirm_best(space, found, limit, request.mapped)
    goal, point = space.goal, found.point
    values = space.values(point)
    regime = _find_regime(space, unknowns, point)
    assert regime is not None
    scene = Scene.model_validate(unknowns.document(values))
    exact = scene.has_exact_derivatives
    peak = find_peak(unknowns.cycle(values)) if exact else find_followed_peak(scene, goal.periods)
    regime = dataclasses.replace(regime, peak=peak)
    patched = scene.ground.differs != ""
    value = _worst_value(space, point)
    one_sided, kinks = (True, ()) if limit.over() else _find_kinks(unknowns, values, goal)
    others = [
        (score, other)
        for score, other in found.optima
        if score > -WORST and not np.allclose(space.canonical(other), space.canonical(point), atol=1e-3)
    ]
    shown = itertools.takewhile(lambda _: not limit.over(), others[:_ALTERNATIVES])
    alternatives = [_alternative(unknowns, space, other) for _, other in shown]
    flat = () if math.isnan(value) else tuple(itertools.compress(unknowns.names, around.flat))
    as_good = any(score >= found.score - _NEAR * abs(found.score) for score, _ in others)
    return Optimum(
        objective=goal.objective,
        value=value,
        scene=scene,
        names=unknowns.names,
        values=values,
        low=unknowns.low,
        high=unknowns.high,
        gain=regime.gain,
        cost_of_transport=measure("cost-of-transport", regime),
        travel=regime.travel,
        peak_tension=regime.peak,
        transient_left=math.nan if patched else _find_transient(scene, regime, limit),
        found_after_s=found.found_after_s,
        evaluations=found.evaluations,
        gradient_norm=math.nan if limit.over() else _gradient_norm(space, point, value),
        differentiable=not one_sided,
        kinks=kinks,
        active_bounds=_active_bounds(unknowns, space, point, regime),
        alternatives=tuple(one for one in alternatives if not math.isnan(one.value)),
        flat=flat,
        unique=not (as_good or flat or math.isnan(value) or limit.over()),
        weaknesses=_find_weaknesses(unknowns, space, point, request, limit),
        space=space,
        point=point,
        seed=request.seed,
        complete=found.complete and not (found.interrupted or limit.over()),
        wall_s=clock() - limit.began,
        motion=regime.motion,
        periods=goal.periods if patched else None,
        interrupted=found.interrupted,
        exhausted=found.exhausted,
        untried=() if found.complete else tuple(kind.value for kind in found.untried),
        around=around.lines,
        plane=around.plane,
    )


def _find_regime(space: Space, unknowns: Unknowns, point: np.ndarray) -> Regime | None:
    """Compute the regime of a candidate in the unit box on one scene; None if it cannot be followed."""
    return dataclasses.replace(space, scenes=(unknowns,)).regimes(point[None])[0][0]


def _find_transient(scene: Scene, regime: Regime, limit: TimeLimit) -> float:
    """Estimate how far the gain is from the limit cycle's [m]; infinite if the time is over before that is known."""
    most_periods = _EXACT_PERIODS if scene.has_exact_derivatives else _FOLLOWED_PERIODS
    try:
        cycle = limit_cycle(scene, most_periods=most_periods, progress=limit.check)
    except OutOfTime:
        return math.inf
    apart = np.subtract(cycle.gain, regime.gain if regime.motion is None else regime.motion)
    return float(cycle.transient_left + np.linalg.norm(np.atleast_1d(apart)[:2]))


def _worst_value(space: Space, point: np.ndarray) -> float:
    """Compute the objective of a candidate in the unit box over all scenes [m or 1]; NaN where it has none."""
    return space.value(space.regimes(point[None])[0])


def _alternative(unknowns: Unknowns, space: Space, point: np.ndarray) -> Alternative:
    point = space.canonical(point)
    values = space.values(point)
    return Alternative(_worst_value(space, point), values, unknowns.document(values)["drive"])


def _find_kinks(unknowns: Unknowns, values: np.ndarray, goal: Goal) -> tuple[bool, tuple[Kink, ...]]:
    """Find whether the derivative at a point is one-sided, and where."""
    if not unknowns.base.has_exact_derivatives:
        return True, ()
    try:
        cycle, derivatives = unknowns.differentiate(values)
        found: RegimeDerivatives = differentiate_regime(cycle, derivatives)
    except CrawlerError:
        return True, ()
    one_sided = bool(found.one_sided.any())
    if goal.objective == "travel":
        one_sided |= bool(found.travel_one_sided.any())
    ends = np.cumsum(cycle.seconds)
    shift = cycle.seconds[0] if unknowns.table is not None else 0.0
    times = [
        float((ends[ramp] - (1.0 - place) * cycle.seconds[ramp] - shift) % ends[-1]) for ramp, place, _ in found.kinks
    ]
    return one_sided, group_kinks(cycle.plan.body, times, [contact for _, _, contact in found.kinks])


def _gradient_norm(space: Space, point: np.ndarray, value: float) -> float:
    slopes = space.slopes(point)
    if not slopes:
        return math.nan
    size = 1e-6
    planes = [(point, score, slope) for score, slope in slopes]
    step = best_step(space, point, planes, size) - point
    ahead = min(score + slope @ step for _, score, slope in planes) - min(score for _, score, _ in planes)
    per_score = 1.0 + value**2 if space.goal.objective == "cost-of-transport" else 1.0
    return max(float(ahead) / size * per_score, 0.0)


def _near_moves(space: Space, point: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """List points at which one unknown is moved a little, with the unknown."""
    size = _COARSE_STEP if space.goal.resolution else _FLAT_STEP
    found = []
    for i, step in itertools.product(range(point.size), (size, -size)):
        moved = point.copy()
        moved[i] = np.clip(point[i] + step, 0.0, 1.0)
        if moved[i] != point[i]:
            found.append((i, moved))
    return found


def _active_bounds(unknowns: Unknowns, space: Space, point: np.ndarray, regime: Regime) -> tuple[ActiveBound, ...]:
    found = []
    for name, place, low, high in zip(unknowns.names, point, unknowns.low, unknowns.high, strict=True):
        if place <= _NEAR:
            found.append(ActiveBound(name, "lower", float(low)))
        elif place >= 1.0 - _NEAR:
            found.append(ActiveBound(name, "upper", float(high)))
    goal = space.goal
    for name, reached, limit in (("rate", regime.speed, goal.rate), ("tension", regime.peak, goal.tension)):
        if reached >= (1.0 - 1e-6) * limit:
            found.append(ActiveBound(name, "upper", limit))
    return tuple(found)


def _find_weaknesses(
    unknowns: Unknowns, space: Space, point: np.ndarray, request: Request, limit: TimeLimit
) -> tuple[Weakness, ...]:
    """Find where a gait fails, number by number, while time is left."""
    found = []
    try:
        for key in request.robust or ():
            found.append(_find_weakness(space, unknowns, key, point, limit))
    except OutOfTime:
        pass
    return tuple(found)


def _find_weakness(space: Space, unknowns: Unknowns, key: str, point: np.ndarray, limit: TimeLimit) -> Weakness:
    """Find the factors of a number at which a gait no longer moves as it should."""
    goal = space.goal

    def moves(factor: float) -> bool:
        limit.check()
        try:
            regime = _find_regime(space, with_numbers(unknowns, {key: factor}), point)
        except CrawlerError:
            return True
        return regime is None or goal.progress(regime) > max(_NEAR * regime.travel, goal.resolution)

    def edge(factors: np.ndarray) -> float | None:
        inside = 1.0
        for factor in factors:
            if not moves(float(factor)):
                outside = float(factor)
                while abs(outside - inside) > 1e-6 * inside:
                    middle = math.sqrt(inside * outside)
                    inside, outside = (middle, outside) if moves(middle) else (inside, middle)
                return outside
            inside = float(factor)
        return None

    if not moves(1.0):
        return Weakness(key, 1.0, 1.0)
    return Weakness(key, edge(1.0 / _FACTORS), edge(_FACTORS))
