"""Assemble the ground of a scene from its weights and its slope."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import frozen, spread
from ..body.body import Body
from ..body.ground import Ground
from ..errors import SceneError
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
    return Ground(weight, uses_coefficients(parts), math.radians(ground.slope))


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
