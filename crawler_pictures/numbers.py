"""Numbers as text."""

from __future__ import annotations

from typing import Any

import numpy as np


def write_length(value: Any, size: float) -> str:
    """Write a length, or a vector in the plane; numbers that are rounding relative to `size` are 0.

    Args:
        value: a number or two [m].
        size: size of the numbers from which it was computed [m].

    Returns:
        The text.
    """
    return ", ".join(f"{0.0 if abs(v) <= 1e-13 * size else v:.12g}" for v in np.atleast_1d(value))
