"""Arrays that nobody writes to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .errors import SceneError


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


def frozen(array: ArrayLike, dtype: type[np.generic] = np.float64) -> np.ndarray:
    """Copy an array and forbid writing to the copy.

    Args:
        array: any shape.
        dtype: of the copy.

    Returns:
        A read-only copy.
    """
    copy = np.array(array, dtype=dtype)
    copy.flags.writeable = False
    return copy
