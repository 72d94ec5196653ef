"""Assemble bodies in the plane whose springs have lengths, so that they can turn: body, friction and start."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import frozen, spread
from ..body.body import Body
from ..body.build_body import check_connected
from ..body.turning import SIDES, Turning, check_sides, forward_angles, load_of_friction
from ..errors import SceneError
from ..rounding import EPS
from .assemble_links import read_links
from .assembly import Assembly
from .parts import SceneParts

_ROUNDING = 1e3 * 32.0 * EPS
_COINCIDE = 1e-6
"""Points nearer to each other than this part of the size of the body coincide."""


def check_turning(parts: SceneParts) -> None:
    """Check which keys belong to a body whose springs have lengths.

    Args:
        parts: the parts of the scene.

    Raises:
        SceneError: if it has keys of other bodies, or another body has its keys.
    """
    body, friction = parts.body, parts.friction
    if body.springs == "length":
        _check_own(parts)
        return
    given: Any = None if friction is None else friction.given
    for key, value in (
        ("body.points", body.points),
        ("body.joints", body.joints),
        ("heading", parts.heading),
        ("on_instability", parts.on_instability),
        *((f"friction.{name}", getattr(given, name, None)) for name in ("left", "right")),
        *((f"friction.{name}", getattr(friction, name, None)) for name in ("frame", "angle", "law")),
        *((f"drive.friction.{name}", getattr(_friction_of_drive(parts), name, None)) for name in ("left", "right")),
    ):
        if value is not None:
            raise SceneError(f"{key}: only for bodies that turn; write `springs: length` in the body, or remove it")


def _friction_of_drive(parts: SceneParts) -> Any:
    return None if parts.drive is None else parts.drive.friction


def _check_own(parts: SceneParts) -> None:
    body, friction = parts.body, parts.friction
    if parts.dimension != 2:
        raise SceneError("body.springs: length; on a line springs always have lengths: write `dimension: 2`")
    if (body.points is None) == (not body.contacts):
        both = "both `points` and `contacts`" if body.contacts else "neither `points` nor `contacts`"
        raise SceneError(f"body.points: {both}; give one of them")
    if friction is None:
        return
    if friction.given.directions is not None:
        raise SceneError(
            "friction.directions: they are fixed to the ground; with `springs: length` give `forward`, `backward`, "
            "`left` and `right` of each point's frame, or `isotropic`"
        )
    for where, given in (("friction", friction.given), ("drive.friction", _friction_of_drive(parts))):
        if given is not None and given.isotropic is None and getattr(given, "left", None) is None:
            raise SceneError(f"{where}.left: missing; with `springs: length` give {', '.join(SIDES)}, or `isotropic`")


def assemble_turning_body(parts: SceneParts) -> Body:
    """Build a body that turns.

    Args:
        parts: the parts of the scene.

    Returns:
        The body.

    Raises:
        SceneError: if a point, link, joint or frame is invalid; the message names it.
    """
    given, friction = parts.body, parts.friction
    assert friction is not None
    points = np.array(given.places, dtype=np.float64).reshape(-1, 2)
    count = len(points)
    if count < 2:
        field = "body.contacts" if given.points is None else "body.points"
        raise SceneError(f"{field}: {count} point(s); a body needs at least 2")
    between, given_stiffness = read_links(given)
    ends = _find_links(points, between)
    joints, joint_stiffness = np.zeros((0, 3), np.int64), np.zeros(0)
    if given.joints is not None:
        joints = _find_joints(points, given.joints.between)
        joint_stiffness = _read_stiffness(given.joints.stiffness, len(joints), "joint", "N m/rad")
    offset = spread(0.0 if friction.angle is None else friction.angle, count, "friction.angle", "point")
    turning = Turning(
        joints,
        joint_stiffness,
        _find_frames(points, ends, friction.frame),
        frozen(offset),
        friction.law == "along_velocity",
        _find_heading(points, parts.heading),
        parts.on_instability != "refuse",
    )
    touching = (turning_friction(parts) != 0.0).any(axis=1)
    if not touching.any():
        raise SceneError("friction: 0 for all points; at least one needs friction, or nothing determines the motion")
    body = Body(
        position=frozen(points),
        ends=ends,
        stiffness=_read_stiffness(given_stiffness, len(ends), "link", "N/m"),
        share=frozen(touching / touching.sum()),
        ground=frozen(np.ones(count)),
        isolated=frozen(np.arange(count), np.int64),
        link_springs=frozen(np.arange(len(ends)), np.int64),
        segments=(),
        turning=turning,
    )
    check_connected(body, range(count), np.arange(count), "point")
    return body


def _find_links(points: np.ndarray, between: Sequence[Sequence[int | str]] | None) -> np.ndarray:
    """Find the two points of each link, int64, shape (S, 2); without pairs each point is joined to the next."""
    pairs = list(itertools.pairwise(range(len(points)))) if between is None else between
    for i, pair in enumerate(pairs):
        for end in pair:
            if not isinstance(end, int):
                raise SceneError(f"body.links.between: link {i} joins {end!r}; with `springs: length` points by number")
        _check_points(f"body.links.between: link {i}", pair, points, "a link needs a length > 0")
    return frozen(pairs, np.int64).reshape(-1, 2)


def _find_joints(points: np.ndarray, between: Sequence[Sequence[int]] | None) -> np.ndarray:
    """Find the three points of each joint, int64, shape (J, 3); without triples all points that follow each other."""
    triples = [(i, i + 1, i + 2) for i in range(len(points) - 2)] if between is None else between
    for i, triple in enumerate(triples):
        _check_points(f"body.joints.between: joint {i}", triple, points, "an angle needs three places")
    return frozen(triples, np.int64).reshape(-1, 3)


def _read_stiffness(values: Any, count: int, spring: str, unit: str) -> np.ndarray:
    """Read the stiffnesses of all links or joints, shape (count,) [`unit`]."""
    field = f"body.{spring}s.stiffness"
    stiffness = spread(values, count, field, spring)
    for i in np.flatnonzero(~(stiffness > 0.0)):
        raise SceneError(f"{field}: {spring} {i} has {stiffness[i]:g} {unit}; it must be > 0")
    return frozen(stiffness)


def _find_frames(points: np.ndarray, ends: np.ndarray, given: Sequence[Sequence[int]] | None) -> np.ndarray:
    """Find the two points of the frame of each point, int64, shape (N, 2); by default the ends of its first link."""
    count = len(points)
    if given is None:
        rows = [np.flatnonzero((ends == i).any(axis=1)) for i in range(count)]
        return frozen([ends[row[0]] if row.size else (0, 0) for row in rows], np.int64)
    if len(given) != count:
        raise SceneError(f"friction.frame: {len(given)} pair(s) for {count} points; give one each")
    linked = {tuple(pair) for pair in np.concatenate((ends, ends[:, ::-1])).tolist()}
    for i, pair in enumerate(given):
        _check_points(f"friction.frame: point {i}", pair, points, "a direction needs two places")
        if tuple(pair) not in linked:
            raise SceneError(
                f"friction.frame: point {i} has {list(pair)}, which no link joins; name the two ends of a link"
            )
    return frozen(given, np.int64)


def _find_heading(points: np.ndarray, given: Sequence[int] | None) -> np.ndarray:
    """Find the two points whose direction is the yaw, int64, shape (2,); by default the first and the last one."""
    pair = (0, len(points) - 1) if given is None else given
    hint = "" if given is not None else "; give two other points"
    _check_points("heading: it", pair, points, f"a direction needs two places{hint}")
    return frozen(pair, np.int64)


def _check_points(where: str, numbers: Sequence[Any], points: np.ndarray, needs: str) -> None:
    """Check that points exist, differ and do not coincide."""
    count, shown = len(points), list(numbers)
    for number in numbers:
        if not 0 <= number < count:
            raise SceneError(f"{where} has {shown}, but there are points 0 .. {count - 1}")
    near = _COINCIDE * float(np.linalg.norm(np.ptp(points, axis=0)))
    for one, other in itertools.combinations(numbers, 2):
        if one == other:
            raise SceneError(f"{where} has {shown}, point {one} twice; {needs}")
        if float(np.linalg.norm(points[one] - points[other])) <= near:
            at = ", ".join(f"{v:g}" for v in points[one])
            raise SceneError(f"{where} has {shown}, but points {one} and {other} are both at [{at}] m; {needs}")


def turning_friction(parts: SceneParts) -> np.ndarray:
    """Read the friction of the points of a body that turns.

    Args:
        parts: the parts of the scene.

    Returns:
        Forward, backward, left and right of each point, shape (N, 4) [N], or coefficients [1].

    Raises:
        SceneError: if an array has a wrong length, or the friction of a point does not fit.
    """
    assert parts.friction is not None
    given, count = parts.friction.given, len(parts.body.places)
    names = SIDES if given.isotropic is None else ("isotropic",) * len(SIDES)
    values = zip(names, given.quarters, strict=True)
    friction = np.stack([spread(value, count, f"friction.{name}", "point") for name, value in values], axis=1)
    check_sides(friction, "friction", SceneError)
    return friction


def check_turning_start(assembly: Assembly) -> None:
    """Check that friction holds the forces of links, joints and loads at the start.

    Args:
        assembly: the assembly of a body that turns.

    Raises:
        SceneError: if a force exceeds the friction of its point; the message names the point and the excess.
    """
    body, drive, x = assembly.body, assembly.drive, assembly.start_displacement
    assert body.turning is not None
    place = body.position + x
    spans = np.linalg.norm(place[body.ends[:, 1]] - place[body.ends[:, 0]], axis=1)
    for i in np.flatnonzero(~(spans > 0.0)):
        raise SceneError(f"start.displacement: the two points of link {i} coincide; a link needs a length > 0")
    tension = body.tension(body.elongation(x), drive.actuation[0])
    loads = drive.loads[0].reshape(-1, 2) if assembly.columns.loads else np.zeros(x.shape)
    force = body.force_at(x, tension) + loads
    friction = drive.targets[0, body.lengths :][: assembly.columns.frictions].reshape(body.contacts, -1)
    friction = assembly.ground.scale_friction(friction, place)
    size = np.abs(tension[: body.springs]).sum() + np.abs(tension[body.springs :]).sum() / spans.min()
    near = _ROUNDING * (size + np.abs(loads).sum() + friction.max(axis=1))
    near += 64.0 * EPS * (body.stiffness.max() * np.abs(place).max() + body.turning.joint_stiffness.sum() / spans.min())
    part = load_of_friction(force, forward_angles(body.turning, place), friction)
    pull = np.hypot(force[:, 0], force[:, 1])
    excess = np.where(part > 1.0, pull - pull / np.maximum(part, 1.0), 0.0) - near
    worst = int(np.argmax(excess))
    if excess[worst] <= 0.0:
        return
    proposal = "`start: relaxed` is a start without tension"
    if loads[worst].any():
        proposal = "start where links carry its load to others, or let `drive.loads` raise it from 0"
    pulled = f"start.displacement: point {worst} is pulled by [{force[worst, 0]:g}, {force[worst, 1]:g}] N"
    if not friction[worst].any():
        raise SceneError(f"{pulled}, but has no friction; {proposal}")
    raise SceneError(f"{pulled}, {excess[worst]:g} N more than its friction; {proposal}")
