"""The derivatives of a continuous body, from the derivatives of several grids.

A grid is a body of springs. Its derivatives tend to the continuous body's as the grid gets finer, but where waves run
along a segment, or other contacts rest with it, they may do so slowly, and scatter from grid to grid, as contacts lie
differently. The mean of several grids then is much closer than any of them, and its standard error tells how close.

Where the point at rest is exactly between two cells, the grid has a kink, and the continuous body has none: on either
side of it another contact rests in place of the point. The derivatives are then the mean of both sides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from crawler_model.scene.assembly import Assembly
from crawler_model.scene.scene import Scene

_OTHERS = (
    (24, (2.1, 2.4, 2.7, 3.1, 3.3)),
    (400, (1.1, 1.21, 1.34, 1.55, 1.89)),
    (math.inf, (0.55, 0.62, 0.7, 0.79, 0.89)),
)
"""Elements of the other grids, relative to the scene's, where a segment has up to so many: some derivatives are zero on
coarse grids."""
_ERRORS = 2.5
"""Standard errors of the mean by which it may differ from the derivatives of the continuous body."""
RESOLVED = 0.05
"""Derivatives that may differ by a larger part do not describe the continuous body."""
SCATTERED = 0.01
"""Derivatives that differ by a larger part from grid to grid share the error of the gain."""
SIDES = 0.025
"""The same for the derivatives on both sides of a kink of the grid."""
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
    forward = scene.columns.lengths + np.arange(scene.columns.frictions // 2)
    sides = []
    for factor in (1.0 - _TILT, 1.0 + _TILT):
        rows = scene.drive.rows.copy()
        rows[:, forward] *= factor
        sides.append(scene.with_arrays(scene.arrays() | {"rows": rows}))
    return sides


def _find_size(grids: np.ndarray, travel: float, values: np.ndarray) -> np.ndarray:
    """Find what differences of derivatives are compared to: the largest one, unless it is small, shape (P,)."""
    size = np.abs(grids).max(axis=(0, 1), initial=0.0)
    least = _SMALL * travel / np.where(values == 0.0, 1.0, np.abs(values))
    return np.asarray(np.maximum(np.maximum(size, least), np.finfo(np.float64).tiny))


def compare_sides(first: np.ndarray, second: np.ndarray, travel: float, values: np.ndarray) -> np.ndarray:
    """Compare derivatives of the net translation on both sides of a kink.

    Args:
        first: derivatives on one side, shape (K, P).
        second: derivatives on the other.
        travel: how far the body moves [m].
        values: of the parameters, shape (P,).

    Returns:
        The largest differences, as parts of the largest derivative with respect to the same parameter, shape (P,).
    """
    size = _find_size(np.stack((first, second)), travel, values)
    return np.asarray(np.abs(second - first).max(axis=0, initial=0.0) / size)


def are_small(derivatives: np.ndarray, travel: float, values: np.ndarray) -> np.ndarray:
    """Find the parameters whose derivatives are all smaller than what their errors are compared to.

    Args:
        derivatives: shape (K, P).
        travel: how far the body moves [m].
        values: of the parameters, shape (P,).

    Returns:
        Shape (P,).
    """
    return np.asarray(np.abs(derivatives).max(axis=0, initial=0.0) < _find_size(derivatives[None], travel, values))


def average_grids(grids: np.ndarray, travel: float, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average derivatives of the net translation over grids.

    Args:
        grids: the derivatives on each, shape (G, K, P).
        travel: how far the body moves [m].
        values: of the parameters, shape (P,).

    Returns:
        Their mean, shape (K, P); and its largest error, as a part of the largest derivative with respect to the same
        parameter, shape (P,).
    """
    mean = grids.mean(axis=0)
    error = _ERRORS * grids.std(axis=0, ddof=1) / math.sqrt(len(grids))
    return mean, np.asarray(error.max(axis=0, initial=0.0) / _find_size(mean[None], travel, values))


def compare_steps(sides: np.ndarray, travel: float, values: np.ndarray) -> np.ndarray:
    """Compare differences of the net translation on grids, by steps of two sizes to both sides.

    Args:
        sides: to both sides by the shorter steps, then by longer ones twice as long, shape (G, 4, K, P).
        travel: how far the body moves [m].
        values: of the parameters, shape (P,).

    Returns:
        The largest amount by which the sizes disagree, or by which a kink parts the sides for certain, as a part of the
        largest derivative with respect to the same parameter, shape (P,).
    """
    fine, coarse = sides[:, :2], sides[:, 2:]
    apart = np.abs(fine.mean(axis=(0, 1)) - coarse.mean(axis=(0, 1)))
    bend = 2.0 * (fine[:, 0] - fine[:, 1]) - (coarse[:, 0] - coarse[:, 1])  # without what is curved
    sure = np.abs(bend.mean(axis=0)) - _ERRORS * bend.std(axis=0, ddof=1) / math.sqrt(len(bend))
    size = _find_size(sides.mean(axis=(0, 1))[None], travel, values)
    return np.asarray(np.maximum(apart, sure).max(axis=0, initial=0.0) / size)


def find_trend(gains: Sequence[float], elements: Sequence[int]) -> float:
    """Find how far gains on grids are off on average, if their errors are proportional to the size of an element.

    Args:
        gains: the gain on each grid [m].
        elements: their numbers.

    Returns:
        The error, as a part of the gain [1].
    """
    size = 1.0 / np.array(elements)
    slope, gain = np.polyfit(size, gains, 1)
    return float(abs(slope) * size.mean() / max(abs(gain), np.finfo(np.float64).tiny))
