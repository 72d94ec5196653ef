"""Assemble the ground of a scene: its weights, its slope and its friction."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import frozen, spread
from ..body.body import Body
from ..body.columns import Columns
from ..body.ground import Ground, Track
from ..errors import SceneError
from .friction_parts import FrictionPart, SegmentFrictionPart, average, breaks_of, field_of
from .parts import GroundPart, SceneParts


def assemble_ground(parts: SceneParts, body: Body) -> Ground:
    """Build the ground of a scene.

    Args:
        parts: the parts of the scene.
        body: its body.

    Returns:
        The ground.

    Raises:
        SceneError: if a slope has no weights to act on, or a weight is negative.
    """
    ground = parts.ground or GroundPart()
    if ground.slope != 0.0 and parts.body.weights is None:
        raise SceneError("body.weights: missing; a slope acts on the weight of each contact")
    weight = frozen(weights_of(parts, body))
    return Ground(weight, uses_coefficients(parts), math.radians(ground.slope), _assemble_track(parts, body, weight))


def _assemble_track(parts: SceneParts, body: Body, weight: np.ndarray) -> Track | None:
    """Divide the track into stretches; None if it is the same everywhere."""
    ground = parts.ground or GroundPart()
    if not ground.patches:
        return None
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
    theta, track = np.radians(slope)[:, None], math.radians(ground.slope)
    pressed = np.where(_pressed(parts, body), np.cos(theta) / math.cos(track), 1.0)
    tilt = -weight * (np.sin(theta) - math.sin(track))
    return Track(frozen(borders), frozen(np.stack((forward, backward))[:, :, None] * pressed), frozen(tilt))


def _pressed(parts: SceneParts, body: Body) -> np.ndarray:
    """Find the contacts whose friction follows from their weight, and so from the slope, shape (N,)."""
    pressed = np.zeros(body.contacts, np.bool_)
    pressed[body.isolated] = _has_coefficient(parts.friction)
    for part, segment in zip(parts.body.segments, body.segments, strict=True):
        pressed[segment.contacts] = _has_coefficient(part.friction)
    return pressed


def weights_of(parts: SceneParts, body: Body) -> np.ndarray:
    """Read the weight of each contact.

    Args:
        parts: the parts of the scene.
        body: its body.

    Returns:
        Shape (N,) [N]; 0 if the scene has none.

    Raises:
        SceneError: if a weight is negative.
    """
    weight = np.zeros(body.contacts)
    if parts.body.weights is None:
        return weight
    item = "contact(s) and segment" if body.segments else "contact"
    given = spread(parts.body.weights, body.isolated.size + len(body.segments), "body.weights", item)
    for i in np.flatnonzero(given < 0.0):
        raise SceneError(f"body.weights: entry {i} is {given[i]:g}; a weight must be >= 0")
    weight[body.isolated] = given[: body.isolated.size]
    for segment, value in zip(body.segments, given[body.isolated.size :], strict=True):
        weight[segment.contacts] = value * body.ground[segment.contacts]
    return weight


def uses_coefficients(parts: SceneParts) -> bool:
    """Determine whether friction is given by coefficients and so depends on the slope.

    Args:
        parts: the parts of the scene.

    Returns:
        True if the friction of the contacts or of a segment is given so.
    """
    of_contacts = parts.friction is not None and parts.friction.coefficient is not None
    return of_contacts or any(s.friction.coefficient is not None for s in parts.body.segments)


def planar_friction(parts: SceneParts) -> np.ndarray:
    """Build the friction array of a planar scene.

    Args:
        parts: the parts of the scene.

    Returns:
        Shape (N, max(m, 1)) [N].

    Raises:
        SceneError: if a friction is negative or an array has a wrong length.
    """
    friction, n = parts.friction, len(parts.body.contacts)
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


def assemble_friction(parts: SceneParts, body: Body, columns: Columns, ground: Ground) -> np.ndarray:
    """Build the last columns of a command row from the friction and the loads of a scene.

    Args:
        parts: the parts of the scene.
        body: its body.
        columns: layout of its commands.
        ground: its ground; coefficients of friction multiply its weights.

    Returns:
        Shape (C - lengths,) [N, N/m].

    Raises:
        SceneError: if a friction is negative, an array has a wrong length, or a coefficient has no weight to act on.
    """
    if parts.dimension == 2:
        return planar_friction(parts).ravel()
    if uses_coefficients(parts) and parts.body.weights is None:
        raise SceneError("body.weights: missing; a coefficient of friction acts on the weight of each contact")
    sides = (0.0, 0.0) if parts.friction is None else parts.friction.sides
    if parts.friction is not None and parts.friction.directions is not None:
        raise SceneError("friction.directions: only for planar scenes; on a line give `forward` and `backward`")
    press = ground.weight * np.cos(ground.slope)
    of_contacts = press[body.isolated] if _has_coefficient(parts.friction) else 1.0
    values = []
    for side, name in enumerate(("forward", "backward")):
        mu = _not_negative(spread(sides[side], body.isolated.size, f"friction.{name}", "contact"), name)
        values.append(mu * of_contacts)
        for part, segment, (_, _, size) in zip(parts.body.segments, body.segments, columns.segments, strict=True):
            varies = size == segment.elements + 1
            field = part.friction.sides[side]
            if _has_coefficient(part.friction):
                field *= float(press[segment.first] / body.ground[segment.first])  # weight per length
            if not varies:
                values.append(np.array([field]))
                continue
            nodes = body.position[segment.contacts]
            edges = np.concatenate((nodes[:1], 0.5 * (nodes[:-1] + nodes[1:]), nodes[-1:]))
            values.append(average(field_of(field), edges, breaks_of(field)))
    if columns.loads:
        item = "contact(s) and segment" if body.segments else "contact"
        values.append(spread(0.0 if parts.loads is None else parts.loads, columns.loads, "loads", item))
    return np.concatenate(values)


def _has_coefficient(part: FrictionPart | SegmentFrictionPart | None) -> bool:
    return part is not None and part.coefficient is not None
