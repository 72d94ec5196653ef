"""Assemble the ground of a scene: its weights, its slope and its friction."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import numpy as np

from ..arrays import frozen, join, refuse, spread
from ..body.body import Body
from ..body.columns import Columns
from ..body.couplings import Coupling
from ..body.ground import Ground, Track, Walls
from ..body.regions import Regions
from ..errors import SceneError
from .assemble_turning import turning_friction
from .friction_parts import FrictionPart, Numbers, SegmentFrictionPart, average
from .parts import GroundPart, SceneParts

_RADIANS = math.pi / 180.0
_TOUCHING = 1e-9
"""Regions that share a disc of less than this part of their distance from the origin touch."""


def assemble_ground(parts: SceneParts, body: Body, doubts: np.ndarray | None = None) -> Ground:
    """Build the ground of a scene.

    Args:
        parts: the parts of the scene.
        body: its body.
        doubts: of variations, as for `refuse`.

    Returns:
        The ground.

    Raises:
        SceneError: if a slope has no weights to act on, a weight is negative, a slope on a line has a direction, or
            walls leave a contact no place.
    """
    ground = parts.ground or GroundPart()
    direction = ground.direction
    if parts.dimension == 2:
        direction = direction or 0.0
    elif direction is not None:
        raise SceneError("ground.direction: only in the plane; on a line a slope is negative if it falls towards +x")
    if np.any(ground.slope != 0.0) and parts.body.weights is None:
        raise SceneError("body.weights: missing; a slope acts on the weight of each contact")
    weight = frozen(_read_weights(parts, body, doubts))
    masses = parts.body.masses
    mass = None if masses is None else frozen(_read_each(masses, "body.masses", "a mass", body, doubts))
    follows = _follow_weights(parts, body)
    track = _assemble_track(parts, body, weight, follows)
    regions = _assemble_regions(ground, parts.dimension)
    return Ground(weight, follows, ground.slope * _RADIANS, direction, track, mass, regions)


def _follow_weights(parts: SceneParts, body: Body) -> np.ndarray:
    """Determine where friction follows from weight, shape (N,): on no contact if the drive commands friction."""
    follows = np.zeros(body.contacts, np.bool_)
    drive = parts.drive
    if drive is None or not drive.commands_friction:
        follows[body.isolated] = _has_coefficient(parts.friction)
        for part, segment in zip(parts.body.segments, body.segments, strict=True):
            follows[segment.contacts] = _has_coefficient(part.friction)
        given = [(i, _has_coefficient(parts.friction)) for i in body.isolated.tolist()]
        for part, segment in zip(parts.body.segments, body.segments, strict=True):
            given += [(i, _has_coefficient(part.friction)) for i in (segment.first, segment.last)]
        for i, by_coefficient in given:
            if by_coefficient != follows[i]:
                raise SceneError(
                    f"friction: of the parts that touch at {body.position[i]:g} m some have coefficients and some have "
                    "forces; give all of them the same kind"
                )
    follows.flags.writeable = False
    return follows


def _assemble_regions(ground: GroundPart, dimension: int) -> Regions | None:
    """Collect the regions of the plane; None without any."""
    if not ground.regions:
        return None
    if dimension == 1:
        raise SceneError("ground.regions: only in the plane; on a line give ground.patches")
    half_planes = [region.half_planes for region in ground.regions]
    for i, j in itertools.combinations(range(len(half_planes)), 2):
        if _overlap(half_planes[i], half_planes[j]):
            raise SceneError(
                f"ground.regions: regions {i} and {j} overlap, so that the friction there is not determined; regions "
                "may touch"
            )
    normals, offsets = (tuple(map(frozen, each)) for each in zip(*half_planes, strict=True))
    return Regions(normals, offsets, frozen([*(region.friction for region in ground.regions), 1.0]))


def _overlap(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> bool:
    """Determine whether two regions share more than a border: whether a small disc fits into both."""
    from scipy.optimize import linprog

    normals, offsets = (np.concatenate(pair) for pair in zip(one, other, strict=True))
    size = float(np.abs(offsets).max()) or 1.0
    rows = np.column_stack((-normals, np.ones(len(normals))))  # the radius of the disc as third unknown
    found = linprog([0.0, 0.0, -1.0], rows, -offsets / size, bounds=[(None, None), (None, None), (None, 1.0)])
    return bool(found.x[2] > _TOUCHING)


def _assemble_track(parts: SceneParts, body: Body, weight: np.ndarray, follows: np.ndarray) -> Track | None:
    """Divide the track into stretches; None if it is the same everywhere."""
    ground = parts.ground or GroundPart()
    couplings = _assemble_couplings(parts, body)
    if not ground.varies and not couplings:
        return None
    if ground.profile is not None:
        gradual = _assemble_gradual_track(parts, ground, body, (weight, follows))
        return dataclasses.replace(gradual, couplings=couplings)
    stretches: list[tuple[float, float, float]] = []  # factors forward and backward, slope
    borders: list[float] = []
    between = (1.0, 1.0, ground.slope)
    for patch in ground.patches:
        if not borders or patch.start > borders[-1]:
            stretches.append(between)
            borders.append(patch.start)
        stretches.append((*patch.factors, ground.slope if patch.slope is None else patch.slope))
        borders.append(patch.stop)
    stretches.append(between)
    if parts.body.weights is None and any(slope != ground.slope for _, _, slope in stretches):
        raise SceneError("body.weights: missing; the slope of a patch acts on the weight of each contact")
    forward, backward, slope = np.array(stretches).T
    theta, track = np.radians(slope), math.radians(ground.slope)
    pressed, rise = np.cos(theta) / math.cos(track), np.sin(theta) - math.sin(track)
    rows = (frozen(borders), frozen(np.stack((forward, backward))), frozen(pressed), frozen(rise))
    profile = frozen(np.zeros((4, len(stretches)))) if couplings else None
    return Track(*rows, follows, weight, _assemble_walls(ground, body), profile, couplings)


def _assemble_couplings(parts: SceneParts, body: Body) -> tuple[Coupling, ...]:
    """Build what changes friction with elongations, sorted by contact and spring; elements add half to each contact."""
    if parts.couplings and body.has_flat_springs:
        raise SceneError(
            "friction.with_elongation: with links or segments whose tension can stay constant as they change their "
            "length (`tension`, flat pieces of a `curve`) nothing may tell where a part between them slides to; give "
            "flat pieces a slope in a `curve`, such as a millionth of the stiffness"
        )
    found: list[tuple[int, int, np.ndarray, np.ndarray]] = []
    names = {segment.name: segment for segment in body.segments}
    for k, part in enumerate(parts.couplings):
        key, at, added = f"friction.with_elongation: entry {k}", np.array(part.knots), np.array(part.sides)
        if part.link is not None:
            _check_index(part.link, body.link_springs.size, f"{key}: link", "the links are")
            for i in part.contacts or ():
                _check_index(i, body.isolated.size, f"{key}: contacts", "the isolated contacts are")
                found.append((int(body.isolated[i]), int(body.link_springs[part.link]), at, added))
            continue
        if part.segment not in names:
            known = f"the segments are {', '.join(names)}" if names else "there are none"
            raise SceneError(f"{key}: segment: {part.segment!r}; {known}")
        segment = names[part.segment]
        for j in range(segment.elements):
            for i in (segment.first + j, segment.first + j + 1):
                half = 0.5 * segment.element
                found.append((i, segment.first_spring + j, at * segment.element, added * half))
    found.sort(key=lambda coupling: coupling[:2])
    return tuple(
        Coupling(i, j, (int(body.ends[j, 0]), int(body.ends[j, 1])), frozen(at), frozen(added))
        for i, j, at, added in found
    )


def _check_index(index: int, count: int, field: str, known: str) -> None:
    if not 0 <= index < count:
        raise SceneError(
            f"{field}: {index}; {known} 0 .. {count - 1}" if count else f"{field}: {index}; there are none"
        )


def _assemble_gradual_track(
    parts: SceneParts, ground: GroundPart, body: Body, feet: tuple[np.ndarray, np.ndarray]
) -> Track:
    """Divide a track into stretches at places of its profile and at borders of patches; see `assemble_ground`."""
    profile, (weight, follows) = ground.profile, feet
    assert profile is not None
    track = math.sin(ground.slope * _RADIANS)
    sine = np.full(len(profile.at), track) if profile.slope is None else np.sin(np.radians(profile.slope))
    rows = np.array([*profile.factors, sine])
    ends = [x for patch in ground.patches for x in (patch.start, patch.stop)]
    inner = [x for x in profile.at if all(abs(x - y) > 1e-12 * (abs(x) + abs(y)) for y in ends)]
    borders = np.unique([*ends, *inner])
    left, right = np.append(borders[0], borders), np.append(borders, borders[-1])
    first, last = (np.array([np.interp(at, profile.at, row) for row in rows]) for at in (left, right))
    pressed = np.ones(left.size)
    for patch in ground.patches:
        inside = (left >= patch.start) & (right <= patch.stop) & (left < right)
        for values in (first, last):
            values[:2, inside] *= np.array(patch.factors)[:, None]
            if patch.slope is not None:
                values[2, inside] = math.sin(patch.slope * _RADIANS)
        if patch.slope is not None:
            pressed[inside] = math.cos(patch.slope * _RADIANS) / math.cos(ground.slope * _RADIANS)
    length = np.where(left < right, right - left, 1.0)
    growth = np.where(left < right, (last - first) / length, 0.0)
    if parts.body.weights is None and np.any(first[2] != track):
        raise SceneError("body.weights: missing; the slope of a profile acts on the weight of each contact")
    return Track(
        frozen(borders),
        frozen(first[:2]),
        frozen(pressed),
        frozen(first[2] - track),
        follows,
        weight,
        _assemble_walls(ground, body),
        frozen(np.vstack((left, growth))),
    )


def _assemble_walls(ground: GroundPart, body: Body) -> Walls | None:
    """Find the nearest walls of each contact; None without walls."""
    if not ground.walls:
        return None
    place = np.stack((np.full(body.contacts, np.inf), np.full(body.contacts, -np.inf)))
    index = np.full((2, body.contacts), -1)
    for k, wall in enumerate(ground.walls):
        contacts = np.arange(body.contacts)
        if wall.contacts is not None:
            for i in wall.contacts:
                if not 0 <= i < body.isolated.size:
                    last = body.isolated.size - 1
                    raise SceneError(f"ground.walls: wall {k}: contacts: {i}; the isolated contacts are 0 .. {last}")
            contacts = body.isolated[list(wall.contacts)]
        side, sign = (0, 1.0) if wall.stops == "forward" else (1, -1.0)
        nearer = contacts[sign * (place[side, contacts] - wall.at) > 0.0]
        place[side, nearer], index[side, nearer] = wall.at, k
    crossed = np.flatnonzero(place[1] > place[0])
    if crossed.size:
        i = int(crossed[0])
        raise SceneError(
            f"ground.walls: wall {index[1, i]}, which stops backward at {place[1, i]:g} m, is ahead of wall "
            f"{index[0, i]}, which stops forward at {place[0, i]:g} m; they leave no place for {body.name_of(i)}"
        )
    return Walls(frozen(place), frozen(index, np.int64))


def _read_weights(parts: SceneParts, body: Body, doubts: np.ndarray | None) -> np.ndarray:
    """Read the weight of each contact, shape (N,), for variations (M, N) [N]; 0 if the scene has none."""
    if parts.body.weights is None:
        return np.zeros(body.contacts)
    return _read_each(parts.body.weights, "body.weights", "a weight", body, doubts)


def _read_each(values: Numbers, field: str, what: str, body: Body, doubts: np.ndarray | None) -> np.ndarray:
    """Read what each contact has, and each segment per length, shape (N,), for variations (M, N)."""
    item = "contact(s) and segment" if body.segments else "contact"
    given = spread(values, body.isolated.size + len(body.segments), field, item)
    refuse(given < 0.0, 1, lambda i: f"{field}: entry {i} is {given[i]:g}; {what} must be >= 0", doubts)
    each = np.zeros((*given.shape[:-1], body.contacts))
    each[..., body.isolated] = given[..., : body.isolated.size]
    for k, segment in enumerate(body.segments, body.isolated.size):
        each[..., segment.contacts] += given[..., k : k + 1] * segment.cells
    return each


def planar_friction(parts: SceneParts) -> np.ndarray:
    """Build the friction array of a planar scene.

    Args:
        parts: the parts of the scene.

    Returns:
        Shape (N, max(m, 1)) [N], or coefficients [1].

    Raises:
        SceneError: if a friction is negative or an array has a wrong length.
    """
    n = len(parts.body.contacts)
    assert parts.friction is not None
    friction = parts.friction.given
    if friction.directions is None:
        mu = spread(friction.isotropic, n, "friction.isotropic", "contact")
        return _not_negative(mu, "isotropic")[:, None]
    m = len(friction.directions)
    value = friction.value if isinstance(friction.value, tuple) else (friction.value,) * m
    if value and isinstance(value[0], tuple):
        if len(value) != n:
            raise SceneError(
                f"friction.value: {len(value)} row(s) for {n} contact(s); give one row, or one per contact"
            )
        return np.array([spread(row, m, f"friction.value: row {i}", "direction") for i, row in enumerate(value)])
    return np.tile(spread(value, m, "friction.value", "direction"), (n, 1))


def planar_loads(value: Any, contacts: int, field: str) -> np.ndarray:
    """Read the loads of a planar scene, or a row of them.

    Args:
        value: [x, y] for all contacts, or one pair each; 0 for none.
        contacts: number of contacts.
        field: its key.

    Returns:
        x and y of each contact in turn, shape (2 N,) [N].

    Raises:
        SceneError: if it is anything else.
    """
    right = f"in the plane give [x, y] for all of {contacts} contact(s), or one pair each"
    if not isinstance(value, tuple):
        if value != 0.0:
            raise SceneError(f"{field}: {value:g}; {right}")
        return np.zeros(2 * contacts)
    pairs = value if any(isinstance(pair, tuple) for pair in value) else (value,) * contacts
    if len(pairs) != contacts:
        raise SceneError(f"{field}: {len(pairs)} entries; {right}")
    for i, pair in enumerate(pairs):
        if not isinstance(pair, tuple) or len(pair) != 2:
            given = f"{len(value)} number(s)" if pair is value else f"entry {i} is {_written(pair)}"
            raise SceneError(f"{field}: {given}; {right}")
    return np.array(pairs).ravel()


def _written(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else f"[{', '.join(f'{v:g}' for v in value[:6])}]"


def _not_negative(mu: np.ndarray, side: str, doubts: np.ndarray | None = None) -> np.ndarray:
    def negative(i: int) -> str:
        return f"friction.{side}: contact {i} has {mu[i]:g} N; friction must be >= 0"

    refuse(~(mu >= 0.0), 1, negative, doubts)
    return mu


def assemble_friction(
    parts: SceneParts, body: Body, columns: Columns, ground: Ground, doubts: np.ndarray | None = None
) -> np.ndarray:
    """Build the last columns of a command row from the friction and the loads of a scene.

    Args:
        parts: the parts of the scene.
        body: its body.
        columns: layout of its commands.
        ground: its ground; coefficients of friction multiply its weights.
        doubts: of variations, as for `refuse`.

    Returns:
        Shape (C - lengths,), for variations (M, C - lengths) [N, N/m].

    Raises:
        SceneError: if a friction is negative, an array has a wrong length, or a coefficient has no weight to act on.
    """
    frictions = (parts.friction, *(segment.friction for segment in parts.body.segments))
    if any(map(_has_coefficient, frictions)) and parts.body.weights is None:
        raise SceneError("body.weights: missing; a coefficient of friction acts on the weight of each contact")
    if parts.dimension == 2:
        press = ground.weight * np.cos(ground.slope)
        planar = planar_friction(parts) if body.turning is None else turning_friction(parts)
        if _has_coefficient(parts.friction):
            planar = planar * press[:, None]
        given = 0.0 if parts.loads is None else parts.loads
        loads = planar_loads(given, body.contacts, "loads") if columns.loads else np.zeros(0)
        return np.concatenate((planar.ravel(), loads))
    sides = (0.0, 0.0) if parts.friction is None or not body.isolated.size else parts.friction.sides
    if parts.angles:
        raise SceneError("friction.directions: only for planar scenes; on a line give `forward` and `backward`")
    count = body.isolated.size
    weights = np.zeros(count + len(body.segments))
    if parts.body.weights is not None:
        weights = spread(parts.body.weights, weights.size, "body.weights", "contact(s) and segment")
    of_contacts = weights[..., :count] * np.cos(ground.slope) if _has_coefficient(parts.friction) else 1.0
    values = []
    for side, name in enumerate(("forward", "backward")):
        mu = _not_negative(spread(sides[side], body.isolated.size, f"friction.{name}", "contact"), name, doubts)
        values.append(mu * of_contacts)
        given = zip(parts.body.segments, body.segments, columns.segments, strict=True)
        for k, (part, segment, (_, _, size)) in enumerate(given, count):
            varies = size == segment.elements + 1
            field = part.friction.sides[side]
            if _has_coefficient(part.friction):
                field = field * (weights[..., k, None] * np.cos(ground.slope))
            values.append(_over_contacts(field, body.position[segment.contacts]) if varies else field)
    if columns.loads:
        item = "contact(s) and segment" if body.segments else "contact"
        if isinstance(parts.loads, tuple) and any(isinstance(load, tuple) for load in parts.loads):
            raise SceneError("loads: pairs; on a line each load is a number (or dimension: 2)")
        values.append(spread(0.0 if parts.loads is None else parts.loads, columns.loads, "loads", item))
    return join(values)


def _over_contacts(field: Any, nodes: np.ndarray) -> np.ndarray:
    """Average a field over the ground of each contact of a segment; of a number that varies for each variation."""
    edges = np.concatenate((nodes[:1], 0.5 * (nodes[:-1] + nodes[1:]), nodes[-1:]))
    if not isinstance(field, np.ndarray):
        return average(field, edges)
    rows = [average(float(value), edges) for value in field.ravel()]
    return np.array(rows).reshape(*field.shape[:-1], nodes.size)


def _has_coefficient(part: FrictionPart | SegmentFrictionPart | None) -> bool:
    return part is not None and part.coefficient is not None
