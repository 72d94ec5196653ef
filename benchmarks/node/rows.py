"""Rows of results: plain numbers and text by name."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

Row = dict[str, Any]


def summarise(values: Sequence[float], name: str) -> Row:
    """Compute the median and the spread of repetitions.

    Returns:
        Both by name; the spread is the largest value minus the smallest.
    """
    return {name: statistics.median(values), f"{name}_spread": max(values) - min(values)}
