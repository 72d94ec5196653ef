"""From the parts of a scene to the arrays of the model, each checked against the others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import spread
from ..body.body import Body
from ..body.build import End, Interval, build_body
from ..body.columns import Columns, build_columns, build_planar_columns
from ..errors import SceneError
from .assemble_start import check_start
from .elements import MOST_UNMEASURED, MOST_WAVES_MEASURED, average, count_elements, count_elements_of_waves
from .scene import FrictionRowsPart, Scene, SegmentPart, TablePart

if TYPE_CHECKING:
    from collections.abc import Callable


def check_scene(scene: Scene) -> None:
    """Build all parts of a scene and check them against each other.

    Args:
        scene: the scene.

    Raises:
        SceneError: naming the part, contact, link, segment or row that does not fit.
    """
    if scene.dimension == 2:
        if scene.tolerance is not None and not 1e-9 <= scene.tolerance <= 0.5:
            raise SceneError(f"tolerance: {scene.tolerance:g}; it must be between 1e-9 and 0.5")
        _check_planar(scene)
    elif scene.tolerance is not None:
        raise SceneError("tolerance: only planar scenes take one; on a line the answer is exact")
    names = [s.name for s in scene.body.segments]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"body.segments: two segments are called {name!r}; names must differ")
    if scene.body.links is None and (scene.dimension == 2 or len(scene.body.contacts) + len(names) > 1):
        raise SceneError("body.links: missing; it gives the springs between contacts and segments, {stiffness: ...}")
    if scene.friction is None and scene.body.contacts:
        raise SceneError("friction: missing; it is that of the isolated contacts")
    check_start(scene)


def _check_planar(scene: Scene) -> None:
    from ..motion.plane.friction import check_directions

    if scene.body.segments:
        raise SceneError("body.segments: segments lie on a line; leave them out of a planar scene")
    for i, contact in enumerate(scene.body.contacts):
        if not isinstance(contact, tuple) or len(contact) != 2:
            raise SceneError(f"body.contacts: contact {i} is {contact}; a planar scene gives [x, y] of each contact")
    friction, drive = scene.friction, scene.drive
    if friction is not None and friction.isotropic is None and friction.directions is None:
        raise SceneError(
            "friction: in the plane give `isotropic`, or `directions` and `value`, not forward and backward"
        )
    if drive is not None and drive.times is None:
        raise SceneError("drive: a planar scene takes `times` and `actuation`; waves and strategies are for a line")
    if drive is not None and isinstance(drive.friction, FrictionRowsPart) and drive.friction.isotropic is None:
        raise SceneError("drive.friction: a planar scene takes `isotropic` only")
    if friction is not None and friction.directions is not None:
        for row in _planar_friction(scene):
            check_directions(np.array(friction.directions), row)


def _field(part: float | TablePart) -> Callable[[np.ndarray], np.ndarray]:
    if isinstance(part, TablePart):
        at, value = np.array(part.at), np.array(part.value)
        return lambda x: np.interp(x, at, value)
    return lambda x: np.full(x.shape, part)


def _breaks(part: float | TablePart) -> np.ndarray:
    return np.array(part.at) if isinstance(part, TablePart) else np.zeros(0)


def _check_field(part: float | TablePart, field: str, unit: str, least: str) -> None:
    for value in part.value if isinstance(part, TablePart) else (part,):
        if value < 0.0 or (value == 0.0 and least == "> 0"):
            raise SceneError(f"{field}: {value:g} {unit}; it must be {least}")


def _interval(part: SegmentPart, place: int, elements: int) -> Interval:
    field = f"body.segments.{place}"
    _check_field(part.stiffness, f"{field}.stiffness", "N", "> 0")
    for side, value in zip(("forward", "backward"), part.friction.sides, strict=True):
        _check_field(value, f"{field}.friction.{side}", "N/m", ">= 0")
    for name, value in (("stiffness", part.stiffness), *zip(("forward", "backward"), part.friction.sides, strict=True)):
        if isinstance(value, TablePart) and not (value.at[0] <= part.stop and value.at[-1] >= part.start):
            raise SceneError(
                f"{field}: the table of {name} is given at {value.at[0]:g} .. {value.at[-1]:g} m, outside the "
                f"segment's {part.start:g} .. {part.stop:g} m"
            )
    nodes = np.linspace(part.start, part.stop, elements + 1)
    modulus = _field(part.stiffness)
    if isinstance(part.stiffness, TablePart):
        compliance = average(lambda x: 1.0 / modulus(x), nodes, _breaks(part.stiffness))
    else:
        compliance = np.full(elements, 1.0 / part.stiffness)
    return Interval(part.name, nodes, 1.0 / (compliance * (part.stop - part.start) / elements))


def _end(value: int | str, link: int) -> End:
    if isinstance(value, int):
        return value
    name, _, end = value.rpartition(".")
    if end == "from":
        return name, "from"
    if end == "to":
        return name, "to"
    raise SceneError(f"body.links.between: link {link} joins {value!r}; an end is a number, `name.from` or `name.to`")


def build_mesh(scene: Scene) -> Body:
    """Build a scene's body.

    Args:
        scene: the scene.

    Returns:
        The body, segments cut into as many elements as they ask for, or as their accuracy needs.

    Raises:
        SceneError: naming the contact, segment or link that does not fit.
    """
    given = scene.body
    for i, contact in enumerate(given.contacts):
        if isinstance(contact, tuple) and scene.dimension == 1:
            raise SceneError(
                f"body.contacts: contact {i} is {list(contact)}; on a line it is a number (or dimension: 2)"
            )
    counts = [s.elements or _count(scene, i) for i, s in enumerate(given.segments)]
    segments = [_interval(s, i, n) for i, (s, n) in enumerate(zip(given.segments, counts, strict=True))]
    links = given.links
    between = None
    if links is not None and links.between is not None:
        between = [(_end(a, i), _end(b, i)) for i, (a, b) in enumerate(links.between)]
    contacts = np.array(given.contacts, dtype=np.float64)
    if scene.dimension == 2:
        contacts = contacts.reshape(-1, 2)
    return build_body(contacts, 1.0 if links is None else links.stiffness, between, segments)


def _with_elements(scene: Scene, counts: list[int]) -> Scene:
    """Copy a scene with other numbers of elements, unchecked."""
    segments = tuple(s.model_copy(update={"elements": n}) for s, n in zip(scene.body.segments, counts, strict=True))
    fields = {name: getattr(scene, name) for name in Scene.model_fields}
    fields["body"] = scene.body.model_copy(update={"segments": segments})
    return Scene.model_construct(**fields)


_OTHERS = 31
"""Elements of the other segments while one is refined."""
_FINE = 587
"""The reference grid where waves sweep a segment: a prime, so that it shares no contact with the coarse ones."""
_FINE_STANDING = 293
"""The reference grid where the error of contacts that stand is known and taken off."""


def _count(scene: Scene, place: int) -> int:
    """Find how many elements a segment needs for its accuracy under the scene's drive."""
    from ..run.simulate import simulate
    from .standing import find_standing

    part = scene.body.segments[place]
    assert part.accuracy is not None
    asked = part.accuracy / len(scene.body.segments)
    counts = [s.elements or _OTHERS for s in scene.body.segments]

    def with_elements(n: int) -> Scene:
        counts[place] = n
        return _with_elements(scene, counts)

    def gains(n: int) -> np.ndarray:
        trial = with_elements(n)
        check_start(trial)
        period = trial.commands.period
        if period is None:
            duration = float(trial.commands.times[-1])
            return simulate(trial, rate=1.0 / duration).waypoint_net_translation
        return simulate(trial, duration=3.0 * period, rate=max(1.0 / period, 1e-9)).per_period[1:]

    coarse = with_elements(1)
    scale = _largest_change(coarse)
    if scene.drive is None or scale == 0.0:
        return min(int(np.ceil(1.0 / asked)), MOST_UNMEASURED)
    if scene.drive.times is None:
        waves = [w for w in (scene.drive.wave, scene.drive.friction_wave) if w is not None]
        count = (part.stop - part.start) / min(abs(w.wavelength) for w in waves)
        if count > MOST_WAVES_MEASURED:
            return count_elements_of_waves(count, asked)
        return count_elements(gains, gains(_FINE), lambda n: np.zeros(n.size), scale, asked, count)
    exact, standing = find_standing(with_elements(_FINE_STANDING), place)
    return count_elements(gains, exact, standing.error, scale, asked)


def _largest_change(scene: Scene) -> float:
    """Compute the largest change of length that a drive commands of a link, or of a segment's length by its strain."""
    drive, mesh = scene.commands, scene.mesh
    change = np.ptp(drive.rows, axis=0)
    sizes = [1.0] * mesh.link_springs.size + [s.length for s in mesh.segments]
    parts = np.split(change[: drive.columns.lengths], np.cumsum(drive.columns.actuation_sizes)[:-1])
    return max((size * float(part.max()) for size, part in zip(sizes, parts, strict=True)), default=0.0)


def build_scene_columns(scene: Scene) -> Columns:
    """Lay out what can be commanded of a scene's body.

    Args:
        scene: the scene.

    Returns:
        The columns. A segment has one for its strain unless a wave runs along it, and one a side for its friction
        unless that varies along it.
    """
    if scene.dimension == 2:
        return build_planar_columns(scene.mesh, scene.directions.shape[0])
    drive = scene.drive
    strain = drive is not None and drive.wave is not None
    wave = drive is not None and drive.friction_wave is not None
    fields = [(strain, wave or any(isinstance(v, TablePart) for v in s.friction.sides)) for s in scene.body.segments]
    return build_columns(scene.mesh, fields)


def _planar_friction(scene: Scene) -> np.ndarray:
    """Read the friction of a planar scene, shape (N, max(m, 1)) [N]."""
    friction, n = scene.friction, len(scene.body.contacts)
    assert friction is not None
    if friction.directions is None:
        return _not_negative(spread(friction.isotropic or 0.0, n, "friction.isotropic", "contact"), "isotropic")[
            :, None
        ]
    m = len(friction.directions)
    value = friction.value if isinstance(friction.value, tuple) else (friction.value,) * m
    if value and isinstance(value[0], tuple):
        if len(value) != n:
            raise SceneError(
                f"friction.value: {len(value)} row(s) for {n} contact(s); give one row, or one per contact"
            )
        return np.array([spread(row, m, f"friction.value: row {i}", "direction") for i, row in enumerate(value)])
    return np.tile(spread(value, m, "friction.value", "direction"), (n, 1))


def _not_negative(mu: np.ndarray, side: str) -> np.ndarray:
    for i in np.flatnonzero(~(mu >= 0.0)):
        raise SceneError(f"friction.{side}: contact {i} has {mu[i]:g} N; friction must be >= 0")
    return mu


def friction_row(scene: Scene) -> np.ndarray:
    """Lay out a scene's own friction as the last columns of a command row.

    Args:
        scene: the scene.

    Returns:
        Shape (C - lengths,) [N, N/m].

    Raises:
        SceneError: naming the contact whose friction is negative, or the wrong length.
    """
    if scene.dimension == 2:
        return _planar_friction(scene).ravel()
    mesh, columns = scene.mesh, scene.columns
    sides = (0.0, 0.0) if scene.friction is None else scene.friction.sides
    if scene.friction is not None and scene.friction.directions is not None:
        raise SceneError("friction.directions: for planar scenes; on a line give `forward` and `backward`")
    values = []
    for side, name in enumerate(("forward", "backward")):
        values.append(_not_negative(spread(sides[side], mesh.isolated.size, f"friction.{name}", "contact"), name))
        for part, segment, (_, _, size) in zip(scene.body.segments, mesh.segments, columns.segments, strict=True):
            varies = size == segment.elements + 1
            field = part.friction.sides[side]
            if not varies:
                values.append(np.array([field]))
                continue
            nodes = mesh.position[segment.contacts]
            edges = np.concatenate((nodes[:1], 0.5 * (nodes[:-1] + nodes[1:]), nodes[-1:]))
            values.append(average(_field(field), edges, _breaks(field)))
    return np.concatenate(values)
