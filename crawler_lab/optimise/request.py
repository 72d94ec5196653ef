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
from ..sweep.keys import expand_keys, find_path, key_steps, overlap, with_loads
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
    if scene.body.springs == 0:
        raise SceneError(f"optimise: {scene.name} has neither links nor segments; nothing can move it")
    waypoints, stroke, free, period = request.waypoints, request.stroke, request.free or {}, request.period
    scene = with_loads(scene, (*free, *(request.robust or ())))
    given = {key: check_bounds(f"free: {key}", bounds) for key, bounds in free.items()}
    friction = given.pop("friction", None)
    plays = scene.parts.drive is not None and scene.drive.period is not None
    with_table = waypoints is not None or stroke is not None or friction is not None or not given or not plays
    if not with_table:
        if period is not None:
            raise SceneError(f"period: {period:g} s; without waypoints the period is that of the scene's drive")
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
            if "friction" in key_steps(key):
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
        raise SceneError(f"objective: {objective!r}; that of {scene.name}, which turns, must be one of {names}")
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
        if scene.ground.track is None:
            raise SceneError(f"periods: {scene.name} has no ground.patches, so that its periods repeat; leave it out")
        if not isinstance(periods, int) or not 1 <= periods <= _MOST_COUNTED:
            raise CommandError(f"periods: {periods!r}; it must be a whole number between 1 and {_MOST_COUNTED}")
    if scene.ground.track is not None and scene.parts.start not in (None, "relaxed"):
        raise SceneError(
            f"start.displacement: {scene.name} has {scene.ground.track.key}, where gaits are sought from a relaxed "
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
    columns, body = base.columns, base.body
    names = name_joints(body)
    if body.dimension == 2:
        return _build_planar_table(scene, count, float(period), stroke, friction)
    moves = find_driven(body)
    chosen = [name for name, is_driven in zip(names, moves, strict=True) if is_driven]
    if not chosen:
        raise SceneError(f"optimise: the links of {scene.name} are all passive; no command moves it")
    strokes = find_strokes(scene, chosen, stroke)
    span = np.array([1.0] * columns.links + [segment.length for segment in body.segments])[moves]
    column_of = np.full(columns.count, -1)
    own = np.where(moves, np.cumsum(moves) - 1, -1)
    column_of[: columns.lengths] = np.repeat(own, columns.actuation_sizes)
    bounds = list(strokes)
    if friction is not None:
        if friction[0] < 0.0:
            raise SceneError(f"free: friction: {friction[0]:g} to {friction[1]:g}; friction must be >= 0")
        one_side = np.repeat(len(chosen) + np.arange(columns.friction_sizes.size), columns.friction_sizes)
        column_of[columns.lengths :][: columns.frictions] = np.tile(one_side, 2)
        bounds += [friction] * columns.friction_sizes.size
        row = base.drive.rows[0].copy()
        row[columns.lengths :][: columns.frictions] = friction[0]
        columns.check_equilibrium(columns.target(row), f"free: friction: {friction[0]:g}", SceneError)
    low, high = np.array(bounds).T
    held = np.where(moves, np.nan, scene.drive.rows[0, : len(names)])  # passive links come before all segments
    frees = friction is not None
    return Table(count, float(period), len(chosen), frees, column_of, low.copy(), high.copy(), span, held)


def find_driven(body: Body) -> np.ndarray:
    """Find which links and segments of a body on a line a command moves: all but links that are passive alone.

    Args:
        body: the body.

    Returns:
        Shape (links + segments,), bool; False for links that are passive alone.
    """
    passive = {bend.spring for bend in body.bends if not bend.actuator.slopes.any()}
    links = [spring not in passive for spring in body.link_springs.tolist()]
    return np.array(links + [True] * len(body.segments), np.bool_)


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
    moves, strokes = find_planar_strokes(scene, stroke)
    low, high = np.array(strokes).T
    column_of = np.full(scene.columns.count, -1)
    column_of[: moves.size][moves] = np.arange(low.size)
    held = np.where(moves, np.nan, scene.drive.rows[0, : moves.size])
    axes = 1 if scene.body.turning is not None else 2
    return Table(count, period, int(low.size), False, column_of, low.copy(), high.copy(), np.ones(low.size), held, axes)


def find_planar_strokes(scene: Scene, stroke: Bounds | Mapping[str, Bounds] | None) -> tuple[np.ndarray, list[Bounds]]:
    """Find which links and joints of a body in the plane move, and how far.

    Args:
        stroke: bounds by name [m, rad], or of all that the drive of the scene moves; None for the range of this drive.
            A link that has no length has two components, link_0/x and link_0/y; its own name stands for both.

    Returns:
        Whether each link and joint, or component, moves, bool, shape (columns,), and the bounds of those that do.

    Raises:
        SceneError: with one line about the first mistake.
    """
    names = scene.columns.names[: scene.columns.lengths]
    rows = scene.drive.rows[:, : len(names)]
    moves = np.ptp(rows, axis=0) > 0.0
    if isinstance(stroke, Mapping):
        stroke = {
            column: bounds
            for name, bounds in stroke.items()
            for column in ([n for n in names if n.partition("/")[0] == name] or [name])
        }
        for name in stroke:
            if name not in names:
                raise SceneError(f"stroke: {name!r}; the links and joints are {', '.join(names)}")
        moves = np.array([name in stroke for name in names])
    elif stroke is None and scene.parts.drive is not None:
        if not moves.any():
            raise SceneError(f"stroke: missing, and the drive of the scene moves none of {', '.join(names)}")
        return moves, [(float(column.min()), float(column.max())) for column in rows.T[moves]]
    elif not moves.any():
        moves[:] = True
    chosen = [name for name, moved in zip(names, moves, strict=True) if moved]
    return moves, find_strokes(scene, chosen, stroke)


def find_strokes(scene: Scene, names: Sequence[str], stroke: Bounds | Mapping[str, Bounds] | None) -> list[Bounds]:
    """Find the bounds of the rest length of each link and of the strain of each segment.

    Args:
        names: its links, then its segments, of these those that a command moves.
        stroke: bounds of all [m, strain], or of each by name; None for those of the scene's drive.

    Returns:
        The bounds, in the order of the names.

    Raises:
        SceneError: with one line about the first mistake.
    """
    if isinstance(stroke, Mapping):
        for name in stroke:
            if name not in names:
                raise SceneError(f"stroke: {name!r}; the links and segments are {', '.join(names)}")
        missing = [name for name in names if name not in stroke]
        if missing:
            raise SceneError(f"stroke: {missing[0]} has none; give one stroke for all, or one for each")
        return [check_bounds(f"stroke: {name}", stroke[name]) for name in names]
    if stroke is not None:
        return [check_bounds("stroke", stroke)] * len(names)
    if scene.parts.drive is None:
        raise SceneError("stroke: missing; give the bounds of the rest lengths, for example 0 to 0.1 m")
    columns, rows, whole = scene.columns, scene.drive.rows, name_joints(scene.body)
    found = []
    for i, (first, size) in enumerate(
        zip(np.cumsum(columns.actuation_sizes) - columns.actuation_sizes, columns.actuation_sizes, strict=True)
    ):
        if whole[i] not in names:
            continue
        part = rows[:, first : first + size]
        if not part.min() < part.max():
            raise SceneError(f"stroke: missing, and the drive of the scene does not move {whole[i]}")
        found.append((float(part.min()), float(part.max())))
    return found


def first_points(unknowns: Unknowns) -> list[np.ndarray]:
    """Find the points to begin with.

    Returns:
        The unit point of the scene as it is, its waypoints those of its drive at these times, but not of a scene
        without a drive; and the middle of the unit box.
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
