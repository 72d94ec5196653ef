"""Whether the elements of segments resolve the derivatives of the continuous body.

The derivatives of a grid are those of a body of springs. They tend to those of the continuous body as the grid gets
finer, but where waves run along a segment, or other contacts rest with it, they may do so more slowly than the motion.

Where the point at rest is exactly between two cells, the grid has a kink, and the continuous body has none: on either
side of it another contact rests in place of the point. The derivatives are then the mean of those on both sides.
"""

from __future__ import annotations

import math

import numpy as np

from crawler_model.scene.assembly import Assembly
from crawler_model.scene.scene import Scene

_OTHERS = ((24, (2.1, 3.3)), (400, (0.62, 1.55)), (math.inf, (0.62, 0.79)))
"""Elements of the other grids, as parts of those of the scene, where a segment has up to so many: some derivatives are
zero on coarse grids."""
RESOLVED = 0.025
"""Derivatives that differ by a larger part between grids are not those of the continuous body: as they converge with
the size of the elements, their own error is about twice the difference."""
_TILT = 1e-8
"""Part by which forward friction differs from its value on either side of a kink."""
_SMALL = 0.02
"""A derivative counts as this part of the travel, while the parameter changes by its own value, if it is smaller."""


def other_grids(scene: Scene) -> list[Scene]:
    """Build a scene with other numbers of elements.

    Args:
        scene: a scene with segments.

    Returns:
        The scenes.

    Raises:
        SceneError: if the start is not valid on such a grid.
    """
    counts = [segment.elements for segment in scene.body.segments]
    scenes = []
    for part in next(parts for most, parts in _OTHERS if min(counts) <= most):
        segments = tuple(
            segment.model_copy(update={"elements": int(np.ceil(part * count))})
            for segment, count in zip(scene.parts.body.segments, counts, strict=True)
        )
        body = scene.parts.body.model_copy(update={"segments": segments})
        scenes.append(Scene.from_parts(scene.parts.model_copy(update={"body": body})))
    return scenes


def tilt(scene: Scene) -> list[Assembly]:
    """Build a scene with a little less and a little more forward friction: the point at rest lies elsewhere.

    Args:
        scene: a scene on a line.

    Returns:
        Both assemblies.
    """
    springs, n = scene.body.springs, scene.body.contacts
    forward = np.unique(scene.columns.index[springs : springs + n])
    sides = []
    for factor in (1.0 - _TILT, 1.0 + _TILT):
        rows = scene.drive.rows.copy()
        rows[:, forward] *= factor
        sides.append(scene.with_arrays(scene.arrays() | {"rows": rows}))
    return sides


def compare_grids(own: np.ndarray, others: list[np.ndarray], travel: float, values: np.ndarray) -> np.ndarray:
    """Estimate by how much derivatives of the net translation differ from those of the continuous body.

    Args:
        own: the derivatives, shape (K, P).
        others: those on other grids.
        travel: how far the body moves [m].
        values: of the parameters, shape (P,).

    Returns:
        The largest differences, as parts of the largest derivative with respect to the same parameter, shape (P,).
    """
    size = np.abs(np.stack((own, *others))).max(axis=(0, 1), initial=0.0)
    least = _SMALL * travel / np.where(values == 0.0, 1.0, np.abs(values))
    differences = np.abs(np.stack(others) - own).max(axis=(0, 1), initial=0.0)
    return np.asarray(differences / np.maximum(np.maximum(size, least), np.finfo(np.float64).tiny))
