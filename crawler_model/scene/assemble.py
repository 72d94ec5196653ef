"""Assemble the arrays of a scene from its parts, and check the parts against each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import frozen
from ..body.directions import check_directions
from ..errors import SceneError
from .assemble_body import assemble_body, assemble_columns, reuse_body
from .assemble_drive import assemble_drive
from .assemble_friction import assemble_friction, assemble_ground, planar_friction
from .assemble_start import assemble_start, check_start, relax_loaded, starts_beyond
from .assemble_turning import check_turning
from .assembly import Assembly
from .elements import MOST_UNMEASURED, MOST_WAVES_MEASURED, count_elements, count_elements_of_waves
from .friction_parts import FrictionRowsPart
from .link_parts import SegmentPart
from .parts import LEAST_TOLERANCE, SceneParts
from .standing import find_standing, measure_gains

_OTHERS = 31
"""Number of elements of the other segments while one segment is refined."""
_FINE = 587
"""Reference grid for segments with waves: a prime, so that it shares no inner contact with the coarse grids."""
_FINE_STANDING = 293
"""Reference grid if the error due to standing contacts is known and subtracted."""


def assemble(parts: SceneParts, like: Assembly | None = None) -> Assembly:
    """Build the arrays of a scene and check its parts against each other.

    Args:
        parts: the parts of the scene.
        like: an assembly with the same body and the same kind of drive; its body and columns are reused.

    Returns:
        The assembly.

    Raises:
        SceneError: if a part, contact, link, segment or row is invalid; the message names it.
    """
    _check_parts(parts)
    elements = [] if like is not None else _count_all(parts)
    assembly = _assemble(parts, elements, like)
    check_start(assembly)
    return assembly


def assemble_together(parts: SceneParts, like: Assembly, count: int) -> tuple[Assembly, np.ndarray]:
    """Build the arrays of variations of a scene on a line with the same mesh, valid or not.

    Args:
        parts: the parts of the scene, in which a number that varies is an array of shape (M, 1), see `arrays`.
        like: an assembly with the same mesh and the same kind of drive.
        count: number of variations M.

    Returns:
        The assembly, with a leading axis of variations in what varies; and which variations may be invalid, bool, shape
        (M,): these must be validated one by one.
    """
    doubts = np.zeros(count, np.bool_)
    with np.errstate(all="ignore"):
        assembly = _assemble(parts, (), like, doubts)
        doubts |= starts_beyond(assembly)
        for array, axes in (
            (assembly.body.stiffness, 1),
            (assembly.drive.targets, 2),
            (assembly.start_displacement, 1),
        ):
            doubts |= ~np.isfinite(array).all(axis=tuple(range(-axes, 0)))
    return assembly, doubts


def _assemble(
    parts: SceneParts, elements: Sequence[int], like: Assembly | None = None, doubts: np.ndarray | None = None
) -> Assembly:
    """Build the arrays of a scene for given numbers of elements; the start is not checked."""
    body = assemble_body(parts, elements) if like is None else reuse_body(parts, like.body, doubts)
    ground = assemble_ground(parts, body, doubts)
    columns = assemble_columns(parts, body, ground, None if like is None else like.columns)
    drive = assemble_drive(parts, body, columns, assemble_friction(parts, body, columns, ground, doubts), doubts)
    return relax_loaded(Assembly(parts, body, ground, columns, drive, frozen(assemble_start(parts, body, drive))))


def _check_parts(parts: SceneParts) -> None:
    check_turning(parts)
    if parts.dimension == 2:
        if parts.tolerance is not None and not LEAST_TOLERANCE <= parts.tolerance <= 0.5:
            raise SceneError(
                f"tolerance: {parts.tolerance:g}; it must be between {LEAST_TOLERANCE:g} and 0.5, as errors may exceed "
                "smaller ones"
            )
        _check_planar(parts)
    elif parts.tolerance is not None:
        raise SceneError("tolerance: only planar scenes have a tolerance; on a line the solution is exact")
    names = [s.name for s in parts.body.segments]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"body.segments: two segments are named {name!r}; names must be unique")
    if parts.body.links is None and (parts.dimension == 2 or parts.body.gaps > 0):
        apart = " that do not touch" if parts.body.segments else ""
        raise SceneError(
            f"body.links: missing; give the springs between contacts and segments{apart} as {{stiffness: ...}}"
        )
    if parts.body.places and (parts.friction is None or parts.friction.is_bare):
        raise SceneError("friction: missing; isolated contacts need it")
    if parts.ground is not None and parts.ground.profile is not None:
        _check_profile(parts)
    if parts.couplings:
        _check_couplings(parts)


def _check_profile(parts: SceneParts) -> None:
    """Refuse what is not followed exactly on ground that changes gradually."""
    assert parts.ground is not None
    assert parts.ground.profile is not None
    frictions = (parts.friction, *(segment.friction for segment in parts.body.segments))
    if parts.ground.profile.slope is not None and any(f is not None and f.coefficient is not None for f in frictions):
        raise SceneError(
            "ground.profile.slope: a coefficient of friction acts on the cosine of the slope, which is not linear "
            "between places; give `friction` as forces"
        )


def _check_couplings(parts: SceneParts) -> None:
    """Refuse what is not followed exactly where friction changes with elongations."""
    if parts.dimension == 2:
        raise SceneError(
            "friction.with_elongation: only on a line; in the plane paths are followed in steps, which would pass over "
            "its elongations"
        )
    if any(f is not None and f.coefficient for f in (parts.friction, *(s.friction for s in parts.body.segments))):
        raise SceneError(
            "friction.with_elongation: not supported with coefficients of friction; give `friction` as forces"
        )


def _check_planar(parts: SceneParts) -> None:
    if parts.body.is_bent:
        raise SceneError(
            "body.links: `curve`, `tension`, `passive`, `hysteresis` and `backlash` are for bodies on a line, which "
            "are followed from knot to knot; in the plane paths are followed in steps, which would pass over knots: "
            "give only `stiffness`"
        )
    if parts.body.segments:
        raise SceneError("body.segments: segments lie on a line; a planar scene cannot have any")
    key, turns = "contact" if parts.body.points is None else "point", parts.body.springs == "length"
    for i, contact in enumerate(parts.body.places):
        if not isinstance(contact, tuple) or len(contact) != 2:
            raise SceneError(f"body.{key}s: {key} {i} is {contact}; in a planar scene each {key} is [x, y]")
    friction, drive = parts.friction, parts.drive
    if not turns and friction is not None and friction.given.isotropic is None and friction.given.directions is None:
        raise SceneError(
            "friction: in the plane use `isotropic`, or `directions` and `value`, not forward and backward"
        )
    if drive is not None and drive.times is None:
        raise SceneError("drive: a planar scene needs `times` and `actuation`; waves and strategies need a line")
    rows = None if drive is None or turns else drive.friction
    if isinstance(rows, FrictionRowsPart) and rows.isotropic is None:
        raise SceneError("drive.friction: in a planar scene only `isotropic` is possible")
    if parts.ground is not None and parts.ground.varies:
        if parts.ground.patches:
            raise SceneError("ground.patches: only on a line; in the plane give ground.regions")
        what, passed = ("profile", "its places") if parts.ground.profile else ("walls", "walls")
        raise SceneError(
            f"ground.{what}: only on a line; in the plane paths are followed in steps, which would pass over {passed}"
        )
    if friction is not None and friction.given.directions is not None:
        check_directions(
            friction.given.directions, planar_friction(parts), "N" if friction.coefficient is None else "of its weight"
        )


def _count_all(parts: SceneParts) -> list[int]:
    """Find the number of elements of each segment; equal segments get equal numbers, so that they look equal."""
    segments = parts.body.segments
    counts = [s.elements or _count(parts, i) for i, s in enumerate(segments)]
    kinds = [None if s.elements else _describe(s) for s in segments]
    return [
        n if kind is None else max(counts[i] for i, k in enumerate(kinds) if k == kind)
        for n, kind in zip(counts, kinds, strict=True)
    ]


def _describe(segment: SegmentPart) -> dict[str, Any]:
    """Describe a segment in the way in which segments of different names at different places may be equal."""
    length = segment.stop - segment.start

    def describe(name: str, value: Any) -> Any:
        if isinstance(value, dict):
            return {key: describe(key, inner) for key, inner in value.items()}
        return [f"{(at - segment.start) / length:.9f}" for at in value] if name == "at" else value

    return {"length": f"{length:.9g}"} | describe("", segment.model_dump(exclude={"name", "start", "stop", "shown"}))


def _count(parts: SceneParts, place: int) -> int:
    """Find the number of elements that a segment needs for its accuracy under the drive of the scene.

    Patches, profiles and walls are left out: with them the periods differ from each other, and so do their errors. So
    is friction that changes with elongations, of which the errors are not known.
    """
    if parts.ground is not None and parts.ground.varies:
        parts = parts.model_copy(update={"ground": parts.ground.even})
    if parts.friction is not None and parts.couplings:
        parts = parts.model_copy(update={"friction": parts.friction.constant})
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
        return measure_gains(trial)

    scale = _largest_change(with_elements(1))
    if parts.drive is None or scale == 0.0:
        return min(int(np.ceil(1.0 / asked)), MOST_UNMEASURED)
    if parts.drive.times is None:
        waves = [w for w in (parts.drive.wave, parts.drive.friction_wave) if w is not None]
        count = (segments[place].stop - segments[place].start) / min(abs(w.wavelength) for w in waves)
        if count > MOST_WAVES_MEASURED:
            return count_elements_of_waves(count, asked)
        return count_elements(gains, gains(_FINE), lambda n: np.zeros(n.size), scale, asked, count)
    if parts.body.is_bent or parts.body.shares_contacts:  # a point at rest need not be one of uniform strain
        return count_elements(gains, gains(_FINE), lambda n: np.zeros(n.size), scale, asked)
    exact, standing = find_standing(with_elements(_FINE_STANDING), place)
    return count_elements(gains, exact, standing.error, scale, asked)


def _largest_change(assembly: Assembly) -> float:
    """Compute the largest change of length that a drive commands for a link, or for a segment through its strain."""
    drive, body = assembly.drive, assembly.body
    change = np.ptp(drive.rows, axis=0)
    sizes = [1.0] * body.link_springs.size + [s.length for s in body.segments]
    each = np.split(change[: drive.columns.lengths], np.cumsum(drive.columns.actuation_sizes)[:-1])
    return max((size * float(part.max()) for size, part in zip(sizes, each, strict=True)), default=0.0)
