"""Search for the best gait of a scene."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from crawler_model.compiled import clock
from crawler_model.errors import CommandError, SceneError
from crawler_model.scene.file import coerce_scene
from crawler_model.scene.scene import Scene

from ..sweep.keys import expand_keys
from .bodies import Over, Uncertain, check_uncertain, count_bodies, spread_over, verify
from .examine import count_candidates, finish
from .followed import followed_goal
from .goal import DEFAULT_PERIODS, OBJECTIVES, Goal
from .limit import TimeLimit
from .optimum import Optimum
from .request import Bounds, Request, build_unknowns, check_bounds, first_points
from .search import Found, search
from .slow import check_slower_than, slow_down
from .space import Space
from .unknowns import Unknowns, with_numbers

_MOST_ROBUST = 5


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
    towards: float | None = None,
    periods: int | None = None,
    slower_than: float | None = None,
    mapped: bool = False,
) -> Optimum:
    """Find the periodic drive that is best in the periodic regime; on patches of ground, over the first periods.

    Random gaits, waves and CMA-ES find good regions; flips to bounds and steps along exact derivatives find the local
    optima in them, in the plane and on patches steps of single unknowns. The search ends when several rounds found
    nothing better.

    Args:
        scene: a scene, a path or a gallery name; it needs no drive. Where waypoints are unknown, its drive is replaced,
            with all that it commands: friction and loads are the scene's own.
        objective: "translation", the gain per period `towards` a direction; "cost-of-transport", work / (distance *
            force), the smaller the better; "travel", gain / sum of all changes of rest lengths, not of bodies that
            turn; for these "turn", the turn per period to the left, or "screw", the least distance of the motion per
            period from `target`.
        waypoints: number of evenly spaced waypoints of the drive, all unknown; None for 6, or for none if `free` names
            numbers of the scene and the scene has a periodic drive.
        stroke: bounds of the links' rest lengths [m] and of the segments' strains, or of each by name; None for the
            range of the scene's drive. For bodies that turn also bounds of the joints' angles [rad]. What is not named,
            or what the drive does not move, stays as it is. In the plane a link without a length has two components,
            link_0/x and link_0/y, and its own name stands for both.
        free: bounds of further unknowns by dotted key, as for `vary`; `friction` frees the friction of each contact [N]
            and segment [N/m] at each waypoint, the same in both directions.
        rate: fastest change of a rest length [m/s].
        tension: largest tension of a spring [N].
        robust: bounds of factors by dotted key: the gait is best where it is worst, over all corners of this box.
        period: of the waypoints [s]; None for the period of the scene's drive, or 1 s.
        seconds: time limit, compiling aside [s], on which the result then depends; None for none.
        seed: of the random numbers; same seed, same result, on any number of cores.
        progress: called with the completed part, in [0, 1].
        robust_to: what is known about the numbers of the scene, a `Posterior`: the gait is best over bodies drawn from
            it, always the same ones.
        robust_of: "expected" for the best mean over these bodies, "worst" for the best gait where it is worst.
        target: of "screw": dx, dy [m] and dyaw [rad] per period, in the frame of the body. An angle counts as a
            distance by the largest distance of two points of the body.
        towards: in the plane, the direction in which a gain counts, counterclockwise from +x, for a body that turns
            from its heading [degrees]; None for 0. On a line +x counts.
        periods: on patches of ground, number of first periods whose mean counts; None for 10.
        slower_than: largest inertia number [1]; the period becomes as long as it needs to be, which changes no gain.
        mapped: on a line, whether the objective over the two unknowns it depends on most is examined, too, for a
            picture.

    Returns:
        The best gait; after Ctrl-C or the time limit, the best so far.

    Raises:
        SceneError: if the kind of scene cannot have what is requested, or a key, bound or other argument is wrong.
        CommandError: if a limit is out of range, or no gait keeps within the limits.
        ModuleNotFoundError: without the package `cma`.
    """
    began = clock()
    scene = coerce_scene(scene, "optimise")
    if robust_to is not None:
        check_uncertain(robust_of, objective, robust)
        scene = robust_to.apply(scene)
    request = Request(
        objective,
        waypoints=waypoints,
        stroke=stroke,
        free=free,
        rate=rate,
        tension=tension,
        robust=robust,
        period=period,
        seconds=seconds,
        seed=seed,
        target=target,
        towards=towards,
        periods=periods,
        slower_than=slower_than,
        mapped=mapped,
    )
    check_slower_than(scene, slower_than)
    unknowns, space = build_space(scene, request)
    if robust_to is not None:
        space = spread_over(space, unknowns, robust_to, robust_of)
    verified = 0 if robust_to is None else -(-count_bodies(robust_to) // len(space.scenes))
    limit = TimeLimit(began, seconds, *count_candidates(unknowns, request, verified))
    found = search(space, seed, limit, first_points(unknowns), progress)
    check_found(space, found)
    limit.stopped = found.interrupted
    try:
        return _conclude(unknowns, space, found, request, limit, robust_to)
    except KeyboardInterrupt:
        limit.stopped = found.interrupted = True
        return _conclude(unknowns, space, found, request, limit, robust_to)


def _conclude(
    unknowns: Unknowns, space: Space, found: Found, request: Request, limit: TimeLimit, uncertain: Uncertain | None
) -> Optimum:
    """Examine the best gait, and verify it on other bodies if its own is uncertain."""
    best = _keep_slow(finish(unknowns, space, found, request, limit), request.slower_than)
    if uncertain is None or limit.stopped:
        return best
    over: Over = "expected" if space.mean else "worst"
    return dataclasses.replace(best, robustness=verify(space, best.point, unknowns, uncertain, over, limit))


def _keep_slow(best: Optimum, slower_than: float | None) -> Optimum:
    """Lengthen the periods of a gait and of its alternatives until their inertia numbers are small enough."""
    if slower_than is None:
        return best
    scene, factor = slow_down(best.scene, slower_than)
    document = best.scene.document()
    alternatives = []
    for one in best.alternatives:
        slow, _ = slow_down(Scene.model_validate(document | {"drive": one.drive}), slower_than)
        alternatives.append(dataclasses.replace(one, drive=slow.document()["drive"]))
    kinks = tuple(dataclasses.replace(kink, time=factor * kink.time) for kink in best.kinks)
    return dataclasses.replace(best, scene=scene, kinks=kinks, alternatives=tuple(alternatives))


def build_space(scene: Scene, request: Request) -> tuple[Unknowns, Space]:
    """Check a request, and build the candidates.

    Returns:
        The unknowns of the scene itself, and the candidates on all scenes of the box.

    Raises:
        SceneError: as for `optimise`.
        CommandError: as for `optimise`.
    """
    objective, rate, tension, seed = request.objective, request.rate, request.tension, request.seed
    if objective not in OBJECTIVES:
        raise CommandError(f"objective: {objective!r}; it must be one of {', '.join(OBJECTIVES)}")
    for name, value, unit in (("rate", rate, " m/s"), ("tension", tension, " N"), ("seconds", request.seconds, " s")):
        if value is not None and not 0.0 < value < math.inf:
            raise CommandError(f"{name}: {value:g}{unit}; it must be > 0")
    if not isinstance(seed, int) or seed < 0:
        raise CommandError(f"seed: {seed!r}; it must be a whole number >= 0")
    unknowns = build_unknowns(scene, request)
    goal = Goal(
        objective,
        math.inf if tension is None else tension,
        math.inf if rate is None else rate,
        towards=math.radians(request.towards or 0.0),
        periods=request.periods or DEFAULT_PERIODS,
    )
    corners = _build_corners(unknowns, request.robust or {})
    return unknowns, Space(corners, followed_goal(scene, goal, request.target))


def _build_corners(unknowns: Unknowns, robust: Mapping[str, Bounds]) -> tuple[Unknowns, ...]:
    if len(robust) > _MOST_ROBUST:
        raise CommandError(f"robust: {len(robust)} keys; at most {_MOST_ROBUST}, as every corner of their box is run")
    factors = []
    for key, given in robust.items():
        both = check_bounds(f"robust: {key}", given)
        if any(name in unknowns.keys for name in expand_keys(unknowns.base, [key], "robust")):
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
            raise CommandError("optimise: no gait can be followed exactly: its ramps are too long or not solved")
        if space.goal.excess(regime) > 0.0:
            raise CommandError(
                f"optimise: no gait was found within the limits; one has {regime.peak:g} N and {regime.speed:g} m/s"
            )
