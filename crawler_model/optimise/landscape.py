"""The objective around an optimum."""

from __future__ import annotations

import numpy as np

from .optimise import worst_value
from .optimum import Optimum

_MOST_RUNS = 2000


def profile(optimum: Optimum) -> tuple[np.ndarray, np.ndarray]:
    """Compute the objective with one unknown at a time moved between its bounds.

    Args:
        optimum: the optimum.

    Returns:
        The places, 0 at the lower and 1 at the upper bound, shape (samples,), and the objective, shape (P, samples);
        NaN outside of the limits of the search and where there is no value.
    """
    count = optimum.point.size
    part = np.linspace(0.0, 1.0, int(np.clip(_MOST_RUNS // count, 5, 41)))
    values = np.empty((count, part.size))
    for i in range(count):
        for j, place in enumerate(part):
            values[i, j] = _value(optimum, {i: float(place)})
    return part, values


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
    table = np.array([[_value(optimum, {pair[0]: float(x), pair[1]: float(y)}) for x in part] for y in part])
    x, y = (optimum.low[i] + part * (optimum.high[i] - optimum.low[i]) for i in pair)
    return pair, x, y, table


def _value(optimum: Optimum, places: dict[int, float]) -> float:
    point = optimum.point.copy()
    for i, place in places.items():
        point[i] = place
    space = optimum.space
    regimes = space.regimes(point)
    if any(regime is None or space.goal.excess(regime) > 0.0 for regime in regimes):
        return float("nan")
    return worst_value(space, point)
