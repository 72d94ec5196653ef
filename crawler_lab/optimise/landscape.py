"""The objective around an optimum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .regime import Regime
from .space import Space

if TYPE_CHECKING:
    from .optimum import Optimum

_MOST_RUNS = {1: 2000, 2: 160}
"""By the dimension of the body: in the plane a gait takes a hundred times longer."""
_TOGETHER = 64


def count_samples(dimension: int, count: int) -> int:
    """Count the places of an unknown at which the objective is computed.

    Args:
        dimension: of the body.
        count: number of unknowns.

    Returns:
        Their number.
    """
    return int(np.clip(_MOST_RUNS[dimension] // count, 5, 41))


def profile_points(space: Space, point: np.ndarray) -> np.ndarray:
    """Move one unknown of a candidate at a time between its bounds.

    Args:
        space: what may be chosen.
        point: the candidate in the unit box, shape (P,).

    Returns:
        In the unit box, shape (P, samples, P).
    """
    part = np.linspace(0.0, 1.0, count_samples(space.scenes[0].base.dimension, point.size))
    points = np.tile(point, (point.size, part.size, 1))
    for i in range(point.size):
        points[i, :, i] = part
    return points


def profile(optimum: Optimum) -> tuple[np.ndarray, np.ndarray]:
    """Show the objective with one unknown at a time moved between its bounds, as the examination computed it.

    Args:
        optimum: the optimum.

    Returns:
        The places, 0 at the lower and 1 at the upper bound, shape (samples,), and the objective, shape (P, samples);
        NaN outside of the limits of the search, where there is no value, and what the time limit left out.
    """
    return np.linspace(0.0, 1.0, optimum.around.shape[1]), _rounded(optimum.space, optimum.around)


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
    """Compute the objective of candidates, over all scenes; NaN outside of the limits, and after the time limit."""
    space, values = optimum.space, list[float]()
    for first in range(0, points.shape[0], _TOGETHER):
        part = points[first : first + _TOGETHER]
        if optimum.limit.over():
            values += [math.nan] * len(part)
        else:
            values += [value_inside(space, regimes) for regimes in space.regimes(part)]
    return _rounded(space, np.array(values))


def value_inside(space: Space, regimes: Sequence[Regime | None]) -> float:
    """Compute the objective of a candidate.

    Args:
        regimes: its regimes on all scenes.

    Returns:
        The objective [m, rad or 1]; NaN outside of the limits.
    """
    inside = [regime for regime in regimes if regime is not None and space.goal.excess(regime) == 0.0]
    return math.nan if len(inside) < len(regimes) else space.value(inside)


def _rounded(space: Space, table: np.ndarray) -> np.ndarray:
    resolution = space.goal.resolution
    return resolution * np.round(table / resolution) if resolution else table
