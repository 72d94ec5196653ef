"""The unknowns of a request: strokes, friction and numbers of a scene within bounds."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from crawler_model.body.body import Body
from crawler_model.body.names import name_joints
from crawler_model.errors import LARGEST, CommandError, SceneError
from crawler_model.scene.scene import Scene

from ..derivative.parameters import changing_keys
from ..sweep.keys import expand_keys, find_path, is_friction, key_steps, overlap, with_loads
from ..sweep.vary import Variations
from .goal import SCREW, TURNING_OBJECTIVES
from .unknowns import Table, Unknowns

DEFAULT_WAYPOINTS = 6
_MOST_UNKNOWNS = 2000
_MOST_COUNTED = 10_000
_COUNTS = ("samples", "elements", "shown")
_TIMES = ("times", "period")
Bounds = tuple[float, float]


class Request(NamedTuple):
    """What is sought: the arguments of `optimise` of the same names, which describes them."""

    objective: str
    waypoints: int | None = None
    stroke: Bounds | Mapping[str, Bounds] | None = None
    free: Mapping[str, Bounds] | None = None
    rate: float | None = None
    tension: float | None = None
    robust: Mapping[str, Bounds] | None = None
    period: float | None = None
    seconds: float | None = None
    seed: int = 0
    target: Sequence[float] | None = None
    towards: float | None = None
    periods: int | None = None
    slower_than: float | None = None
    mapped: bool = False


def build_unknowns(scene: Scene, request: Request) -> Unknowns:
    """Build the unknowns of a request.

    Args:
        request: what is sought, its objective a key of `OBJECTIVES`.

    Returns:
        The unknowns.

    Raises:
        SceneError: with one line about the first mistake.
        CommandError: if the target is missing, or a number is out of range.
    """
    _check_kind(scene, request)
    waypoints, stroke, free, period = request.waypoints, request.stroke, request.free or {}, request.period
    scene = with_loads(scene, (*free, *(request.robust or ())))
    given = {key: check_bounds(f"free: {key}", bounds) for key, bounds in free.items()}
    friction = given.pop("friction", None)
    plays = scene.parts.drive is not None and scene.drive.period is not None
    with_table = waypoints is not None or stroke is not None or friction is not None or not given or not plays
    if not with_table:
        if period is not None:
            raise SceneError(f"period: {period:g} s; without waypoints the period of the scene's drive counts")
        base = Scene.model_validate(scene.document() | {"start": "relaxed"})
        keys, low, high = _expand(base, given)
        return Unknowns(base, keys, None, low, high, scene)
    for key in given:
        if key_steps(key)[0] == "drive":
            raise SceneError(f"free: {key}: no effect, as the waypoints replace the drive")
    document = scene.document()
    document.pop("drive", None)
    document["start"] = "relaxed"
    base = Scene.model_validate(document)
    table = _build_table(scene, base, waypoints, stroke, friction, period)
    if friction is not None:
        for key in given:
            if is_friction(key_steps(key)):
                raise SceneError(f"free: {key}: no effect, as the waypoints command friction")
    keys, low, high = _expand(base, given)
    low, high = (np.append(v, np.tile(w, table.waypoints)) for v, w in ((low, table.low), (high, table.high)))
    if low.size > _MOST_UNKNOWNS:
        raise SceneError(f"waypoints: {low.size} unknowns; at most {_MOST_UNKNOWNS}: choose fewer waypoints")
    return Unknowns(base, keys, table, low, high, scene)


def _check_kind(scene: Scene, request: Request) -> None:
    """Check a request, whose objective is a key of `OBJECTIVES`, against the kind of scene."""
    objective, target, turns = request.objective, request.target, scene.body.turning is not None
    if turns and objective not in TURNING_OBJECTIVES:
        names = ", ".join(TURNING_OBJECTIVES)
        raise SceneError(f"objective: {objective!r}; {scene.name} turns, so it must be one of {names}")
    if not turns and objective in ("turn", SCREW):
        raise SceneError(f"objective: {objective!r}; {scene.name} does not turn, as it has no `springs: length`")
    for name in ("rate", "tension"):
        if turns and getattr(request, name):
            raise SceneError(f"{name}: not available for {scene.name}, which turns; leave it out")
    if request.tension and not scene.has_exact_derivatives:
        raise SceneError(
            f"tension: not available for {scene.name}, which {scene.inexact}; limit stroke or rate instead"
        )
    _check_towards_and_periods(scene, request.towards, request.periods)
    if (target is not None) != (objective == SCREW):
        given = "missing" if target is None else list(target)
        raise CommandError(f"target: {given}; the objective {SCREW!r} needs dx, dy, dyaw per period, others none")
    if target is not None and (len(target) != 3 or not all(math.isfinite(value) for value in target)):
        raise CommandError(f"target: {list(target)}; it must be three finite numbers: dx, dy [m], dyaw [rad]")


def _check_towards_and_periods(scene: Scene, towards: object, periods: object) -> None:
    if towards is not None:
        if scene.dimension == 1:
            raise SceneError(f"towards: {scene.name} is on a line, where the gain towards +x counts; leave it out")
        if not isinstance(towards, (int, float)) or not math.isfinite(towards):
            raise CommandError(f"towards: {towards!r}; it must be an angle in degrees, 0 for +x, 90 for +y")
    if periods is not None:
        if not scene.ground.differs:
            raise SceneError(
                f"periods: {scene.name} has one ground everywhere, so that its periods repeat; leave it out"
            )
        if not isinstance(periods, int) or not 1 <= periods <= _MOST_COUNTED:
            raise CommandError(f"periods: {periods!r}; it must be a whole number between 1 and {_MOST_COUNTED}")
    if scene.ground.differs and scene.body.turning is not None:
        raise SceneError(
            f"{scene.name} has {scene.ground.differs}, over which gaits of bodies that turn are not sought; `crawler "
            "sweep` varies a given one"
        )
    if scene.ground.differs and scene.parts.start not in (None, "relaxed"):
        raise SceneError(
            f"start.displacement: {scene.name} has {scene.ground.differs}, where gaits are sought from a relaxed "
            "start; leave it out, and move body.contacts instead"
        )


def check_bounds(name: str, given: Any) -> Bounds:
    """Check bounds.

    Args:
        name: what they bound, for the error message.
        given: two numbers.

    Returns:
        The lower and the upper one.

    Raises:
        SceneError: if they are not two finite numbers, the lower one first.
    """
    try:
        low, high = (float(value) for value in given)
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"{name}: {given!r}; bounds are two numbers, the lower one first") from None
    if not (math.isfinite(low) and math.isfinite(high)) or max(abs(low), abs(high)) > LARGEST:
        raise SceneError(f"{name}: {low:g} to {high:g}; bounds must be finite")
    if not low < high:
        raise SceneError(f"{name}: {low:g} to {high:g}; the lower bound must be less than the upper one")
    return low, high


def _expand(scene: Scene, given: Mapping[str, Bounds]) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """List the numbers that keys name, with their bounds."""
    keys: list[str] = []
    bounds: list[Bounds] = []
    for key, both in given.items():
        steps = key_steps(key)
        if steps[0] == "drive" and steps[1:2] and (steps[1] in _TIMES or steps[-1] == "period"):
            raise SceneError(f"free: {key}: no effect, as the motion does not depend on how fast the drive is")
        if steps[-1] in _COUNTS:
            raise SceneError(f"free: {key}: it is a whole number; only numbers that change continuously can be free")
        try:
            names = expand_keys(scene, [key], "free")
            for name in names:
                Variations(scene, {name: np.zeros(1)}, (1,)).origin(name)
        except SceneError as error:
            raise SceneError(str(error).replace("vary: ", "free: ").replace("; vary ", "; free ")) from None
        used = [name for name in names if changing_keys(scene, name, find_path(scene, name))]
        if not used:
            raise SceneError(f"free: {key}: the last row of the drive repeats the first one; free that one")
        for name in used:
            if name in keys:
                raise SceneError(f"free: {name} is named twice")
            keys.append(name)
            bounds.append(both)
    for (key, path), (other, way) in itertools.combinations([(key, find_path(scene, key)) for key in keys], 2):
        if overlap(path, way):
            raise SceneError(f"free: {key} and {other} set the same number")
    low, high = np.array(bounds).reshape(-1, 2).T
    return tuple(keys), low.copy(), high.copy()


def _build_table(
    scene: Scene,
    base: Scene,
    waypoints: int | None,
    stroke: Bounds | Mapping[str, Bounds] | None,
    friction: Bounds | None,
    period: float | None,
) -> Table:
    count = DEFAULT_WAYPOINTS if waypoints is None else waypoints
    if not isinstance(count, int) or not 2 <= count <= _MOST_UNKNOWNS:
        raise SceneError(f"waypoints: {count!r}; it must be a whole number between 2 and {_MOST_UNKNOWNS}")
    if period is None:
        period = 1.0 if scene.drive.period is None else scene.drive.period
    if not 1e-6 <= period <= 1e6:
        raise SceneError(f"period: {period:g} s; it must be between 1e-6 and 1e6")
    if base.body.dimension == 2:
        return _build_planar_table(scene, count, float(period), stroke, friction)
    columns, body = base.columns, base.body
    moves, strokes = find_strokes(scene, stroke)
    held = np.where(moves, np.nan, held_lengths(scene))
    span = np.array([1.0] * columns.links + [segment.length for segment in body.segments])[moves]
    column_of = np.full(columns.count, -1)
    own = np.where(moves, np.cumsum(moves) - 1, -1)
    column_of[: columns.lengths] = np.repeat(own, columns.actuation_sizes)
    bounds = list(strokes)
    if friction is not None:
        if friction[0] < 0.0:
            raise SceneError(f"free: friction: {friction[0]:g} to {friction[1]:g}; friction must be >= 0")
        one_side = np.repeat(len(strokes) + np.arange(columns.friction_sizes.size), columns.friction_sizes)
        column_of[columns.lengths :][: columns.frictions] = np.tile(one_side, 2)
        bounds += [friction] * columns.friction_sizes.size
        row = base.drive.rows[0].copy()
        row[columns.lengths :][: columns.frictions] = friction[0]
        columns.check_equilibrium(columns.target(row), f"free: friction: {friction[0]:g}", SceneError)
    low, high = np.array(bounds).T
    frees = friction is not None
    return Table(count, float(period), len(strokes), frees, column_of, low.copy(), high.copy(), span, held)


def find_driven(body: Body) -> np.ndarray:
    """Find which links, segments and joints of a body a command moves: all that are not passive springs without more.

    Args:
        body: the body.

    Returns:
        Shape (links and segments or joints,), bool; in the plane of each component of a link.
    """
    if body.dimension == 2:
        return np.ones(body.lengths, np.bool_)
    passive = {bend.spring for bend in body.bends if not bend.actuator.slopes.any()}
    first = [*body.link_springs.tolist(), *(segment.first_spring for segment in body.segments)]
    return np.array([spring not in passive for spring in first], np.bool_)


def held_lengths(scene: Scene) -> np.ndarray:
    """Return the first command of the drive of a scene, or the one in force without a drive.

    Returns:
        The command for each link and segment or joint, in the plane for each component of a link; for a segment whose
        strain varies, for its first element [m, 1, rad].
    """
    row, columns = scene.drive.rows[0], scene.columns
    if scene.dimension == 2:
        return np.asarray(row[: columns.lengths])
    return np.asarray(row[np.cumsum(columns.actuation_sizes) - columns.actuation_sizes])


def _build_planar_table(
    scene: Scene,
    count: int,
    period: float,
    stroke: Bounds | Mapping[str, Bounds] | None,
    friction: Bounds | None,
) -> Table:
    """Build the waypoints of a body in the plane: what has no stroke stays as the scene has it."""
    if friction is not None:
        kind, key = ("turns", "left") if scene.body.turning is not None else ("is in the plane", "isotropic")
        raise SceneError(f"free: friction: {scene.name} {kind}; free a number such as friction.{key} instead")
    moves, strokes = find_strokes(scene, stroke)
    low, high = np.array(strokes).T
    column_of = np.full(scene.columns.count, -1)
    column_of[: moves.size][moves] = np.arange(low.size)
    held = np.where(moves, np.nan, held_lengths(scene))
    axes = 1 if scene.body.turning is not None else 2
    return Table(count, period, int(low.size), False, column_of, low.copy(), high.copy(), np.ones(low.size), held, axes)


def find_strokes(scene: Scene, stroke: Bounds | Mapping[str, Bounds] | None) -> tuple[np.ndarray, list[Bounds]]:
    """Find which links, segments and joints move, and how far; what has no stroke stays as the scene has it.

    Args:
        stroke: bounds by name [m, 1, rad], or one of all, in the plane of all that the drive of the scene moves; None
            for the range of this drive. In the plane a link that has no length has two components, link_0/x and
            link_0/y; its own name stands for both.

    Returns:
        Whether each link and segment or joint, or component, moves, bool, shape (J,), and the bounds of all that move.

    Raises:
        SceneError: with one line about the first mistake.
    """
    planar = scene.dimension == 2
    names = list(scene.columns.names[: scene.columns.lengths]) if planar else name_joints(scene.body)
    driven = find_driven(scene.body)
    if not driven.any():
        raise SceneError(f"stroke: the links and segments of {scene.name} are all passive; no command moves it")
    low, high = _range_of_drive(scene)
    moves = driven & (low < high)
    if isinstance(stroke, Mapping):
        given = _strokes_by_name(scene, stroke, names, driven)
        return np.array([name in given for name in names]), [given[name] for name in names if name in given]
    if stroke is not None:
        moves = moves if planar and moves.any() else driven
        return moves, [check_bounds("stroke", stroke)] * int(moves.sum())
    if scene.parts.drive is None:
        raise SceneError("stroke: missing; give the bounds of the rest lengths, for example 0 to 0.1 m")
    if not moves.any():
        able = ", ".join(itertools.compress(names, driven))
        raise SceneError(f"stroke: missing, and the drive of the scene moves none of {able}")
    return moves, list(zip(low[moves].tolist(), high[moves].tolist(), strict=True))


def _range_of_drive(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Compute the least and the largest command of each link, segment and joint, in the plane of each component."""
    columns = scene.columns
    rows = scene.drive.rows[:, : columns.lengths]
    sizes = np.ones(columns.lengths, np.int64) if scene.dimension == 2 else columns.actuation_sizes
    first = np.cumsum(sizes) - sizes
    return np.minimum.reduceat(rows.min(axis=0), first), np.maximum.reduceat(rows.max(axis=0), first)


def _strokes_by_name(
    scene: Scene, stroke: Mapping[str, Bounds], names: Sequence[str], driven: np.ndarray
) -> dict[str, Bounds]:
    """Check bounds by name, and give both components of a link in the plane its bounds."""
    able = list(itertools.compress(names, driven))
    found = dict[str, Bounds]()
    for name, bounds in stroke.items():
        columns = [column for column in names if name in (column, column.partition("/")[0])]
        if columns and not set(columns) <= set(able):
            raise SceneError(f"stroke: {name!r} of {scene.name} is passive, and no command moves it; leave it out")
        if not columns:
            kind = "joints" if scene.dimension == 2 else "segments"
            raise SceneError(f"stroke: {name!r}; the links and {kind} are {', '.join(able)}")
        found |= dict.fromkeys(columns, check_bounds(f"stroke: {name}", bounds))
    if not found:
        raise SceneError(f"stroke: {{}}; it must name at least one of {', '.join(able)}")
    return found


def first_points(unknowns: Unknowns) -> list[np.ndarray]:
    """Find the points to begin with.

    Returns:
        The unit point of the scene as it is, with its drive at the times of the waypoints, unless it has no drive; and
        the middle of the unit box.
    """
    middle = np.full(unknowns.low.size, 0.5)
    scene, table = unknowns.original, unknowns.table
    base = unknowns.base
    numbers = np.array([Variations(base, {key: np.zeros(1)}, (1,)).origin(key) for key in unknowns.keys])
    values = numbers
    if table is not None:
        if scene.parts.drive is None or scene.drive.period is None:
            return [middle]
        drive = scene.drive
        assert drive.period is not None
        times = np.arange(table.waypoints) / table.waypoints * drive.period
        closed = np.append(drive.times, drive.period) if drive.period > drive.times[-1] else drive.times
        rows = drive.rows[np.arange(closed.size) % drive.times.size]
        places = [int(np.flatnonzero(table.column_of == j)[0]) for j in range(table.width)]
        waypoints = np.column_stack([np.interp(times, closed, rows[:, i]) for i in places])
        values = np.concatenate((numbers, waypoints.ravel()))
    return [np.clip((values - unknowns.low) / (unknowns.high - unknowns.low), 0.0, 1.0), middle]
