"""From the parts of a scene to an assembly of arrays, each part checked against the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import frozen
from ..body.directions import check_directions
from ..errors import SceneError
from ..run.simulate import simulate
from .assemble_body import assemble_body, assemble_columns
from .assemble_drive import assemble_drive
from .assemble_friction import assemble_friction, planar_friction
from .assemble_ground import assemble_ground
from .assemble_start import assemble_start, check_start
from .assembly import Assembly
from .elements import MOST_UNMEASURED, MOST_WAVES_MEASURED, count_elements, count_elements_of_waves
from .parts import FrictionRowsPart, SceneParts
from .standing import find_standing

_OTHERS = 31
"""Elements of the other segments while one is refined."""
_FINE = 587
"""The reference grid where waves sweep a segment: a prime, so that it shares no contact with the coarse ones."""
_FINE_STANDING = 293
"""The reference grid where the error of contacts that stand is known and taken off."""


def assemble(parts: SceneParts, like: Assembly | None = None) -> Assembly:
    """Build the arrays of a scene and check its parts against each other.

    Args:
        parts: the parts of the scene.
        like: an assembly of parts with the same body and the same kind of drive, whose body and columns are shared.

    Returns:
        The assembly.

    Raises:
        SceneError: naming the part, contact, link, segment or row that does not fit.
    """
    _check_parts(parts)
    elements = [] if like is not None else [s.elements or _count(parts, i) for i, s in enumerate(parts.body.segments)]
    assembly = _assemble(parts, elements, like)
    check_start(assembly)
    return assembly


def _assemble(parts: SceneParts, elements: Sequence[int], like: Assembly | None = None) -> Assembly:
    """Build the arrays of a scene whose segments are cut into so many elements; the start is not checked."""
    body = assemble_body(parts, elements) if like is None else like.body
    ground = assemble_ground(parts, body)
    columns = assemble_columns(parts, body, ground) if like is None else like.columns
    drive = assemble_drive(parts, body, columns, assemble_friction(parts, body, columns, ground))
    return Assembly(parts, body, ground, columns, drive, frozen(assemble_start(parts, body, drive)))


def _check_parts(parts: SceneParts) -> None:
    if parts.dimension == 2:
        if parts.tolerance is not None and not 1e-9 <= parts.tolerance <= 0.5:
            raise SceneError(f"tolerance: {parts.tolerance:g}; it must be between 1e-9 and 0.5")
        _check_planar(parts)
    elif parts.tolerance is not None:
        raise SceneError("tolerance: only planar scenes take one; on a line the answer is exact")
    names = [s.name for s in parts.body.segments]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"body.segments: two segments are called {name!r}; names must differ")
    if parts.body.links is None and (parts.dimension == 2 or len(parts.body.contacts) + len(names) > 1):
        raise SceneError("body.links: missing; it gives the springs between contacts and segments, {stiffness: ...}")
    if parts.friction is None and parts.body.contacts:
        raise SceneError("friction: missing; it is that of the isolated contacts")


def _check_planar(parts: SceneParts) -> None:
    if parts.body.segments:
        raise SceneError("body.segments: segments lie on a line; leave them out of a planar scene")
    for i, contact in enumerate(parts.body.contacts):
        if not isinstance(contact, tuple) or len(contact) != 2:
            raise SceneError(f"body.contacts: contact {i} is {contact}; a planar scene gives [x, y] of each contact")
    friction, drive = parts.friction, parts.drive
    if friction is not None and friction.isotropic is None and friction.directions is None:
        raise SceneError(
            "friction: in the plane give `isotropic`, or `directions` and `value`, not forward and backward"
        )
    if drive is not None and drive.times is None:
        raise SceneError("drive: a planar scene takes `times` and `actuation`; waves and strategies are for a line")
    if drive is not None and isinstance(drive.friction, FrictionRowsPart) and drive.friction.isotropic is None:
        raise SceneError("drive.friction: a planar scene takes `isotropic` only")
    if friction is not None and friction.directions is not None:
        for row in planar_friction(parts):
            check_directions(np.array(friction.directions), row)


def _count(parts: SceneParts, place: int) -> int:
    """Find how many elements a segment needs for its accuracy under the scene's drive."""
    segments = parts.body.segments
    accuracy = segments[place].accuracy
    assert accuracy is not None
    asked = accuracy / len(segments)
    counts = [s.elements or _OTHERS for s in segments]

    def with_elements(n: int) -> Assembly:
        counts[place] = n
        return _assemble(parts, counts)

    def gains(n: int) -> np.ndarray:
        trial = with_elements(n)
        check_start(trial)
        period = trial.drive.period
        if period is None:
            duration = float(trial.drive.times[-1])
            return simulate(trial, rate=1.0 / duration).waypoint_net_translation
        return simulate(trial, duration=3.0 * period, rate=max(1.0 / period, 1e-9)).per_period[1:]

    scale = _largest_change(with_elements(1))
    if parts.drive is None or scale == 0.0:
        return min(int(np.ceil(1.0 / asked)), MOST_UNMEASURED)
    if parts.drive.times is None:
        waves = [w for w in (parts.drive.wave, parts.drive.friction_wave) if w is not None]
        count = (segments[place].stop - segments[place].start) / min(abs(w.wavelength) for w in waves)
        if count > MOST_WAVES_MEASURED:
            return count_elements_of_waves(count, asked)
        return count_elements(gains, gains(_FINE), lambda n: np.zeros(n.size), scale, asked, count)
    exact, standing = find_standing(with_elements(_FINE_STANDING), place)
    return count_elements(gains, exact, standing.error, scale, asked)


def _largest_change(assembly: Assembly) -> float:
    """Compute the largest change of length that a drive commands of a link, or of a segment's length by its strain."""
    drive, body = assembly.drive, assembly.body
    change = np.ptp(drive.rows, axis=0)
    sizes = [1.0] * body.link_springs.size + [s.length for s in body.segments]
    each = np.split(change[: drive.columns.lengths], np.cumsum(drive.columns.actuation_sizes)[:-1])
    return max((size * float(part.max()) for size, part in zip(sizes, each, strict=True)), default=0.0)
