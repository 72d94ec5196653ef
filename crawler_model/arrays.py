"""Checks of array lengths, and read-only copies."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .errors import SceneError


def spread(values: Any, size: int, field: str, item: str) -> np.ndarray:
    """Spread one number over all entries, or check that there is one per entry.

    Args:
        values: one number or `size` of them.
        size: number of entries.
        field: name of the field that holds the values, for error messages.
        item: noun for what one entry belongs to, for error messages.

    Returns:
        A new array of shape (size,).

    Raises:
        SceneError: if there is neither one number nor one per entry.
    """
    given = np.asarray(values, dtype=np.float64)
    if given.ndim == 0:
        return np.full(size, float(given))
    if given.shape != (size,):
        raise SceneError(f"{field}: {given.size} value(s) for {size} {item}(s); give one number or {size}")
    return given.copy()


def frozen(array: ArrayLike, dtype: type[np.generic] = np.float64) -> np.ndarray:
    """Copy an array and make the copy read-only.

    Args:
        array: any shape.
        dtype: data type of the copy.

    Returns:
        A read-only copy.
    """
    copy = np.array(array, dtype=dtype)
    copy.flags.writeable = False
    return copy
