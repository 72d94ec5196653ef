"""From the weights, the slope and the patches of a scene to the ground of its contacts."""

from __future__ import annotations

import itertools
import math

import numpy as np

from ..arrays import frozen, spread
from ..body.body import Body
from ..body.ground import Ground, build_flat_ground
from ..errors import SceneError
from .parts import GroundPart, PatchPart, SceneParts


def assemble_ground(parts: SceneParts, body: Body) -> Ground:
    """Build the ground of a scene.

    Args:
        parts: the parts of the scene.
        body: its body.

    Returns:
        The ground.

    Raises:
        SceneError: when a slope has no weights to act on, or a weight is negative.
    """
    ground = parts.ground or GroundPart()
    patches = ground.patches
    sloping = ground.slope != 0.0 or any(p.slope is not None for p in patches)
    if sloping and parts.body.weights is None:
        raise SceneError("body.weights: missing; a slope acts on the weight of each contact")
    if parts.ground is None and parts.body.weights is None:
        return build_flat_ground(body.contacts)
    theta = math.radians(ground.slope)
    border, regions = _regions(patches)
    angles = [theta if r is None or r.slope is None else math.radians(r.slope) for r in regions]
    tilt = [math.cos(a) / math.cos(theta) if uses_coefficients(parts) else 1.0 for a in angles]
    return Ground(
        weight=frozen(weights_of(parts, body)),
        by_coefficient=uses_coefficients(parts),
        slope=theta,
        border=frozen(border),
        forward=frozen([t * _factor(r, "forward") for t, r in zip(tilt, regions, strict=True)]),
        backward=frozen([t * _factor(r, "backward") for t, r in zip(tilt, regions, strict=True)]),
        pull=frozen([math.sin(theta) - math.sin(a) for a in angles]),
    )


def weights_of(parts: SceneParts, body: Body) -> np.ndarray:
    """Read the weight of each contact.

    Args:
        parts: the parts of the scene.
        body: its body.

    Returns:
        Shape (N,) [N]; 0 where the scene gives none.

    Raises:
        SceneError: when a weight is negative.
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
    """Tell whether friction is given by coefficients, and so depends on the slope.

    Args:
        parts: the parts of the scene.

    Returns:
        True where the friction of the contacts or of a segment is.
    """
    of_contacts = parts.friction is not None and parts.friction.coefficient is not None
    return of_contacts or any(s.friction.coefficient is not None for s in parts.body.segments)


def _regions(patches: tuple[PatchPart, ...]) -> tuple[list[float], list[PatchPart | None]]:
    """Find the borders, and the patch of each region between them; None off the patches."""
    if not patches:
        return [], [None]
    border: list[float] = []
    regions: list[PatchPart | None] = [None]
    for before, patch in itertools.zip_longest((None, *patches[:-1]), patches):
        if before is not None and before.stop == patch.start:  # the region between them is empty
            regions[-1] = patch
        else:
            border.append(patch.start)
            regions.append(patch)
        border.append(patch.stop)
        regions.append(None)
    return border, regions


def _factor(patch: PatchPart | None, side: str) -> float:
    if patch is None:
        return 1.0
    value = patch.friction if patch.friction is not None else getattr(patch, side)
    return 1.0 if value is None else float(value)
