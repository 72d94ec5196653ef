"""The objective around an optimum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .regime import Regime
from .space import Space
from .unknowns import Unknowns

if TYPE_CHECKING:
    from .optimum import Optimum

_MOST_RUNS = {1: 2000, 2: 160}
"""By the dimension of the body: in the plane a gait takes a hundred times longer."""
MAPPED = 41
"""Places of each of two unknowns over which the objective is mapped."""


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


def can_be_mapped(unknowns: Unknowns) -> bool:
    """Determine whether a picture shows the objective over two unknowns: in the plane that would be too many gaits.

    Args:
        unknowns: the unknowns.

    Returns:
        True on a line, for two unknowns and more.
    """
    return unknowns.base.dimension == 1 and unknowns.low.size > 1


def plane_points(space: Space, point: np.ndarray, lines: np.ndarray) -> tuple[tuple[int, int], np.ndarray]:
    """Move the two unknowns of a candidate that the objective depends on most between their bounds.

    Args:
        point: the candidate in the unit box, shape (P,).
        lines: the objective with one unknown at a time moved between its bounds, shape (P, samples).

    Returns:
        The two unknowns, and points in the unit box, shape (MAPPED * MAPPED, P), the first unknown changing fastest.
    """
    order = np.argsort(-np.ptp(np.nan_to_num(_rounded(space, lines)), axis=1), kind="stable")
    pair = int(order[0]), int(order[1])
    part = np.linspace(0.0, 1.0, MAPPED)
    points = np.tile(point, (MAPPED, MAPPED, 1))
    points[:, :, pair[0]], points[:, :, pair[1]] = part, part[:, None]
    return pair, points.reshape(-1, point.size)


def map_plane(optimum: Optimum) -> tuple[tuple[int, int], np.ndarray, np.ndarray, np.ndarray]:
    """Show the objective over the two unknowns that it depends on most, as the examination computed it.

    Args:
        optimum: an optimum whose plane was requested.

    Returns:
        The two unknowns; values of the first, shape (X,), and of the second, shape (Y,); the objective, shape (Y, X),
        NaN as for `profile`.
    """
    assert optimum.plane is not None
    pair, table = optimum.plane
    part = np.linspace(0.0, 1.0, MAPPED)
    x, y = (optimum.low[i] + part * (optimum.high[i] - optimum.low[i]) for i in pair)
    return pair, x, y, _rounded(optimum.space, table)


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
