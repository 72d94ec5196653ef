"""The objective around an optimum."""

from __future__ import annotations

import math

import numpy as np

from .optimum import Optimum

_MOST_RUNS = {1: 2000, 2: 160}
"""By the dimension of the body: in the plane a gait takes a hundred times longer."""
_TOGETHER = 64


def profile(optimum: Optimum) -> tuple[np.ndarray, np.ndarray]:
    """Compute the objective with one unknown at a time moved between its bounds.

    Args:
        optimum: the optimum.

    Returns:
        The places, 0 at the lower and 1 at the upper bound, shape (samples,), and the objective, shape (P, samples);
        NaN outside of the limits of the search and where there is no value.
    """
    count = optimum.point.size
    part = np.linspace(0.0, 1.0, int(np.clip(_MOST_RUNS[optimum.scene.dimension] // count, 5, 41)))
    points = np.tile(optimum.point, (count, part.size, 1))
    for i in range(count):
        points[i, :, i] = part
    return part, _values(optimum, points.reshape(-1, count)).reshape(count, part.size)


def map_plane(optimum: Optimum) -> tuple[tuple[int, int], np.ndarray, np.ndarray, np.ndarray]:
    """Compute the objective over the two unknowns that it depends on most between their bounds.

    Args:
        optimum: the optimum, with at least two unknowns.

    Returns:
        The two unknowns; values of the first, shape (X,), and of the second, shape (Y,); the objective, shape (Y, X).
    """
    _, values = profile(optimum)
    order = np.argsort(-np.ptp(np.nan_to_num(values), axis=1), kind="stable")
    pair = int(order[0]), int(order[1])
    part = np.linspace(0.0, 1.0, 41)
    points = np.tile(optimum.point, (part.size, part.size, 1))
    points[:, :, pair[0]], points[:, :, pair[1]] = part, part[:, None]
    table = _values(optimum, points.reshape(-1, optimum.point.size)).reshape(part.size, part.size)
    x, y = (optimum.low[i] + part * (optimum.high[i] - optimum.low[i]) for i in pair)
    return pair, x, y, table


def _values(optimum: Optimum, points: np.ndarray) -> np.ndarray:
    """Compute the objective of candidates, over all scenes; NaN outside of the limits."""
    goal, values = optimum.space.goal, []
    for first in range(0, points.shape[0], _TOGETHER):
        for regimes in optimum.space.regimes(points[first : first + _TOGETHER]):
            inside = [regime for regime in regimes if regime is not None and goal.excess(regime) == 0.0]
            values.append(math.nan if len(inside) < len(regimes) else optimum.space.value(inside))
    table = np.array(values)
    return goal.resolution * np.round(table / goal.resolution) if goal.resolution else table
