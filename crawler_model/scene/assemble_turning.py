"""Assemble bodies in the plane whose springs have lengths, so that they can turn: body, friction and start."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import frozen, spread
from ..body.body import Body
from ..body.build_turning import build_frames, build_heading, build_joints, build_links, build_turning_body
from ..body.turning import SIDES, Turning, check_sides, forward_angles, load_of_friction
from ..errors import SceneError
from ..rounding import EPS
from .assemble_links import read_links
from .assembly import Assembly
from .parts import SceneParts

_ROUNDING = 1e3 * 32.0 * EPS


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
    field = "body.contacts" if given.points is None else "body.points"
    points = np.array(given.places, dtype=np.float64).reshape(-1, 2)
    between, stiffness = read_links(given)
    for i, pair in enumerate(between or ()):
        for end in pair:
            if not isinstance(end, int):
                raise SceneError(f"body.links.between: link {i} joins {end!r}; with `springs: length` points by number")
    ends = build_links(points, between, field)  # type: ignore[arg-type]
    joints, joint_stiffness = np.zeros((0, 3), np.int64), np.zeros(0)
    if given.joints is not None:
        joints, joint_stiffness = build_joints(points, given.joints.between, given.joints.stiffness)
    offset = spread(0.0 if friction.angle is None else friction.angle, len(points), "friction.angle", "point")
    turning = Turning(
        joints,
        joint_stiffness,
        build_frames(points, ends, friction.frame),
        frozen(offset),
        friction.law == "along_velocity",
        build_heading(points, parts.heading),
        parts.on_instability != "refuse",
    )
    bare = (turning_friction(parts) == 0.0).all(axis=1)
    if bare.all():
        raise SceneError("friction: 0 for all points; at least one needs friction, or nothing determines the motion")
    return build_turning_body(points, ends, stiffness, turning, bare)


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
