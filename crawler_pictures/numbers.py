"""Numbers as people read them."""

from __future__ import annotations

from typing import Any

import numpy as np


def write_length(value: Any, size: float) -> str:
    """Write a length, or one in the plane; what is rounding beside `size` is 0.

    Args:
        value: a number or two [m].
        size: of the numbers it comes from [m].

    Returns:
        Text.
    """
    return ", ".join(f"{0.0 if abs(v) <= 1e-13 * size else v:.12g}" for v in np.atleast_1d(value))
