"""Search for the best gait of a scene."""

from __future__ import annotations

import dataclasses
import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from ..body.plan import refuse_turning
from ..derivative.sensitivities import Kink, group_kinks
from ..errors import CommandError, CrawlerError, SceneError
from ..run.cycle import limit_cycle
from ..scene.file import coerce_scene
from ..scene.scene import Scene
from .bodies import Over, Uncertain, check_uncertain, spread_over, verify
from .goal import OBJECTIVES, Goal, measure
from .optimum import ActiveBound, Alternative, Optimum, Weakness
from .polish import best_step
from .regime import Regime, RegimeDerivatives, differentiate_regime, find_regime
from .request import Bounds, build_unknowns, check_bounds, given_points
from .search import Found, search
from .space import Evaluator, Space
from .turning import check_turning, find_turning_peak, find_turning_regime, turning_goal
from .unknowns import Unknowns, with_numbers

_MOST_ROBUST = 5
_TURNING_ROUNDS = 4
"""As `_STALE_ROUNDS` of the search: one of each kind, as each gait takes a hundred times longer than on a line."""
_NEAR = 1e-9
_FLAT_STEP, _FLAT = 2e-3, 1e-9
_ALTERNATIVES = 5
_FACTORS = np.geomspace(1.0, 100.0, 49)[1:]


def optimise(
    scene: Scene | str | Path,
    objective: str = "translation",
    waypoints: int | None = None,
    stroke: Bounds | Mapping[str, Bounds] | None = None,
    free: Mapping[str, Bounds] | None = None,
    rate: float | None = None,
    tension: float | None = None,
    robust: Mapping[str, Bounds] | None = None,
    period: float | None = None,
    seconds: float | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    robust_to: Uncertain | None = None,
    robust_of: Over = "expected",
    target: Sequence[float] | None = None,
) -> Optimum:
    """Find the periodic drive that is best in the periodic regime.

    Random gaits, waves and CMA-ES find good regions; flips to bounds and steps along exact derivatives find the local
    optima in them. The search ends when several rounds found nothing better.

    Args:
        scene: a scene on a line or of a body that turns, a path or a gallery name; it needs no drive.
        objective: "translation", the gain per period towards +x, of bodies that turn along their heading;
            "cost-of-transport", work / (distance * force), the smaller the better; "travel", gain / sum of all changes
            of rest lengths, on a line; of bodies that turn "turn", the turn per period to the left, or "screw", the
            least distance of the motion per period from `target`.
        waypoints: number of evenly spaced waypoints of the drive, all unknown; None for 6, or for none if `free` names
            numbers of the scene and the scene has a periodic drive.
        stroke: bounds of the links' rest lengths [m] and of the segments' strains, or of each by name; None for the
            range of the scene's drive. Of bodies that turn also of the joints' angles [rad]; links and joints that are
            not named, or that the drive does not move, stay as they are.
        free: bounds of further unknowns by dotted key, as for `vary`; `friction` frees the friction of each contact [N]
            and segment [N/m] at each waypoint, the same in both directions.
        rate: fastest change of a rest length [m/s].
        tension: largest tension of a spring [N].
        robust: bounds of factors by dotted key: the gait is best where it is worst, over all corners of this box.
        period: of the waypoints [s]; None for that of the scene's drive, or 1 s.
        seconds: time limit [s], on which the result then depends; None for none.
        seed: of the random numbers; same seed, same result, on any number of cores.
        progress: called with the completed part, in [0, 1].
        robust_to: what is known about the numbers of the scene, a `Posterior`: the gait is best over bodies drawn from
            it, always the same ones.
        robust_of: "expected" for the best mean over these bodies, "worst" for the best gait where it is worst.
        target: of "screw": dx, dy [m] and dyaw [rad] per period, in the frame of the body. An angle counts as a
            distance by the largest distance of two points of the body.

    Returns:
        The best gait; after Ctrl-C or the time limit, the best so far.

    Raises:
        SceneError: if the scene is in the plane and does not turn, or a key, bound or other argument is wrong.
        CommandError: if a limit is out of range, or no gait keeps within the limits.
        ModuleNotFoundError: without the package `cma`.
    """
    began = time.perf_counter()
    scene = coerce_scene(scene, "optimise")
    if robust_to is not None:
        check_uncertain(robust_of, objective, robust)
        scene = robust_to.apply(scene)
    if robust_to is not None:
        refuse_turning(scene, "robust_to")
    unknowns, space = build_space(
        scene, objective, waypoints, stroke, free, rate, tension, robust, period, seconds, seed, target
    )
    if robust_to is not None:
        space = spread_over(space, unknowns, robust_to, robust_of)
    begin = [*given_points(unknowns), np.full(space.size, 0.5)]
    more = {} if scene.body.turning is None else {"rounds": _TURNING_ROUNDS}
    found = search(space, seed, seconds, begin, progress, **more)
    check_found(space, found)
    best = finish(unknowns, space, found, tuple(robust or ()), seed, seconds, began)
    if robust_to is None:
        return best
    return dataclasses.replace(best, robustness=verify(space, best.point, unknowns, robust_to, robust_of))


def build_space(
    scene: Scene,
    objective: str,
    waypoints: int | None,
    stroke: Bounds | Mapping[str, Bounds] | None,
    free: Mapping[str, Bounds] | None,
    rate: float | None,
    tension: float | None,
    robust: Mapping[str, Bounds] | None,
    period: float | None,
    seconds: float | None,
    seed: int,
    target: Sequence[float] | None = None,
) -> tuple[Unknowns, Space]:
    """Check the arguments of `optimise`, and build the candidates.

    Args:
        scene: as for `optimise`, like all that follow.
        objective: likewise.
        waypoints: likewise.
        stroke: likewise.
        free: likewise.
        rate: likewise [m/s].
        tension: likewise [N].
        robust: likewise.
        period: likewise [s].
        seconds: likewise [s].
        seed: likewise.
        target: likewise [m, m, rad].

    Returns:
        The unknowns of the scene itself, and the candidates on all scenes of the box.

    Raises:
        SceneError: as for `optimise`.
        CommandError: likewise.
    """
    if objective not in OBJECTIVES:
        raise CommandError(f"objective: {objective!r}; it must be one of {', '.join(OBJECTIVES)}")
    for name, value, unit in (("rate", rate, " m/s"), ("tension", tension, " N"), ("seconds", seconds, " s")):
        if value is not None and not 0.0 < value < math.inf:
            raise CommandError(f"{name}: {value:g}{unit}; it must be > 0")
    if not isinstance(seed, int) or seed < 0:
        raise CommandError(f"seed: {seed!r}; it must be a whole number >= 0")
    check_turning(scene, objective, target, {"rate": rate, "tension": tension, "robust": robust})
    unknowns = build_unknowns(scene, waypoints, stroke, free or {}, period)
    goal = Goal(objective, math.inf if tension is None else tension, math.inf if rate is None else rate)
    if scene.body.turning is not None:
        goal = turning_goal(scene, goal, target)
    return unknowns, Space(_build_corners(unknowns, robust or {}), goal)


def _build_corners(unknowns: Unknowns, robust: Mapping[str, Bounds]) -> tuple[Unknowns, ...]:
    if len(robust) > _MOST_ROBUST:
        raise CommandError(f"robust: {len(robust)} keys; at most {_MOST_ROBUST}, as every corner of their box is run")
    factors = []
    for key, given in robust.items():
        both = check_bounds(f"robust: {key}", given)
        if key in unknowns.keys:
            raise SceneError(f"robust: {key} is free; it cannot be uncertain, too")
        if key.startswith("drive"):
            raise SceneError(f"robust: {key}; the drive is what is sought, only other numbers can be uncertain")
        if both[0] < 0.0:
            raise SceneError(f"robust: {key}: {both[0]:g} to {both[1]:g}; factors must be >= 0")
        factors.append(both)
    if not robust:
        return (unknowns,)
    try:
        return tuple(
            with_numbers(unknowns, dict(zip(robust, corner, strict=True))) for corner in itertools.product(*factors)
        )
    except SceneError as error:
        raise SceneError(str(error).replace("vary: ", "robust: ")) from None


def check_found(space: Space, found: Found) -> None:
    """Check that a search has found a gait.

    Args:
        space: the candidates.
        found: what was found.

    Raises:
        SceneError: if no candidate is valid, with the reason of the last one.
        CommandError: if none keeps within the limits, or none was run.
    """
    if found.score == -math.inf:
        raise CommandError("optimise: stopped before the first gait was run")
    regimes = space.regimes(found.point[None])[0]
    for unknowns, regime in zip(space.scenes, regimes, strict=True):
        if regime is None:
            unknowns.cycle(space.values(found.point))
            raise CommandError("optimise: no gait can be followed exactly; its ramps have too many events")
        if space.goal.excess(regime) > 0.0:
            raise CommandError(
                f"optimise: no gait was found within the limits; one has {regime.peak:g} N and {regime.speed:g} m/s"
            )


def finish(
    unknowns: Unknowns,
    space: Space,
    found: Found,
    robust: tuple[str, ...],
    seed: int,
    seconds: float | None,
    began: float,
) -> Optimum:
    """Examine the best point of a search.

    Args:
        unknowns: of the scene itself.
        space: the candidates.
        found: what the search found.
        robust: the uncertain numbers.
        seed: of the random numbers.
        seconds: the time limit [s], or None.
        began: when the optimisation began [s].

    Returns:
        The optimum.
    """
    goal, point = space.goal, space.canonical(found.point)
    values = space.values(point)
    cycle = unknowns.cycle(values)
    turns = unknowns.base.body.turning is not None
    regime = find_turning_regime(cycle) if turns else find_regime(cycle)
    assert regime is not None
    scene = Scene.model_validate(unknowns.document(values))
    if turns:
        regime = dataclasses.replace(regime, peak=find_turning_peak(scene))
    value = worst_value(space, point)
    one_sided, kinks = _find_kinks(unknowns, values, goal)
    others = [
        (score, other) for score, other in found.optima if not np.allclose(space.canonical(other), point, atol=1e-3)
    ]
    alternatives = tuple(_alternative(unknowns, space, other) for _, other in others[:_ALTERNATIVES])
    flat = tuple(name for name, is_flat in zip(unknowns.names, _find_flat(space, point), strict=True) if is_flat)
    as_good = any(score >= found.score - _NEAR * abs(found.score) for score, _ in others)
    return Optimum(
        goal.objective,
        value,
        scene,
        unknowns.names,
        values,
        unknowns.low,
        unknowns.high,
        regime.gain,
        measure("cost-of-transport", regime),
        regime.travel,
        regime.peak,
        float(limit_cycle(scene).transient_left),
        found.found_after_s,
        found.evaluations,
        _gradient_norm(space, point, value),
        not one_sided,
        kinks,
        _active_bounds(unknowns, space, point, regime),
        alternatives,
        flat,
        not as_good and not flat,
        tuple(_find_weakness(unknowns, key, values) for key in robust),
        space,
        point,
        seed,
        seconds is None and not found.interrupted,
        time.perf_counter() - began,
        motion=regime.motion,
    )


def worst_value(space: Space, point: np.ndarray) -> float:
    """Compute the objective of a candidate over all scenes.

    Args:
        space: the candidates.
        point: in the unit box, shape (P,).

    Returns:
        The value [m or 1]; NaN where it has none.
    """
    return space.value(space.regimes(point[None])[0])


def _alternative(unknowns: Unknowns, space: Space, point: np.ndarray) -> Alternative:
    point = space.canonical(point)
    values = space.values(point)
    return Alternative(worst_value(space, point), values, unknowns.drive_of(values))


def _find_kinks(unknowns: Unknowns, values: np.ndarray, goal: Goal) -> tuple[bool, tuple[Kink, ...]]:
    """Find whether the derivative at a point is one-sided, and where."""
    if unknowns.base.body.turning is not None:
        return True, ()  # without derivatives
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
    evaluator, size = Evaluator(space, 1), 1e-6
    planes = [(point, score, slope) for score, slope in slopes]
    step = best_step(evaluator, point, planes, size) - point
    ahead = min(score + slope @ step for _, score, slope in planes) - min(score for _, score, _ in planes)
    per_score = 1.0 + value**2 if space.goal.objective == "cost-of-transport" else 1.0
    return max(float(ahead) / size * per_score, 0.0)


def _find_flat(space: Space, point: np.ndarray) -> list[bool]:
    """Find the unknowns that change nothing near a point."""
    moves = [(i, np.clip(point[i] + step, 0.0, 1.0)) for i in range(point.size) for step in (_FLAT_STEP, -_FLAT_STEP)]
    moves = [(i, place) for i, place in moves if place != point[i]]
    others = np.repeat(point[None], len(moves), axis=0)
    for other, (i, place) in zip(others, moves, strict=True):
        other[i] = place
    score, *scores = space.scores([point, *others])
    same = [abs(other - score) <= _FLAT * abs(score) for other in scores]
    flat = {i for (i, _), is_same in zip(moves, same, strict=True) if is_same}
    return [i in flat for i in range(point.size)]


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


def _find_weakness(unknowns: Unknowns, key: str, values: np.ndarray) -> Weakness:
    """Find the factors of a number at which a gait no longer moves forward."""

    def moves(factor: float) -> bool:
        try:
            regime = find_regime(with_numbers(unknowns, {key: factor}).cycle(values))
        except CrawlerError:
            return True
        return regime is None or regime.gain > _NEAR * max(regime.travel, 1e-300)

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
