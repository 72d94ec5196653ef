"""Arrays that nobody writes to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .errors import SceneError


def frozen_integers(values: ArrayLike) -> np.ndarray:
    """Copy an array of integers and forbid writing to the copy.

    Args:
        values: any shape.

    Returns:
        A read-only int64 copy.
    """
    array = np.array(values, dtype=np.int64)
    array.flags.writeable = False
    return array


def spread(values: Any, size: int, field: str, item: str) -> np.ndarray:
    """Spread one number over all entries, or check that there is one per entry.

    Args:
        values: one number or `size` of them.
        size: how many entries there are.
        field: where the values come from, for the error.
        item: what one entry belongs to, for the error.

    Returns:
        A new array of shape (size,).

    Raises:
        SceneError: when there is neither one number nor one per entry.
    """
    given = np.asarray(values, dtype=np.float64)
    if given.ndim == 0:
        return np.full(size, float(given))
    if given.shape != (size,):
        raise SceneError(f"{field}: {given.size} value(s) for {size} {item}(s); give one number or {size}")
    return given.copy()


def frozen(array: ArrayLike) -> np.ndarray:
    """Copy an array of floats and forbid writing to the copy.

    Args:
        array: any shape.

    Returns:
        A read-only float64 copy.
    """
    copy = np.array(array, dtype=np.float64)
    copy.flags.writeable = False
    return copy
