"""Quantities along a segment: constants and tables as functions of position, and their means over intervals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import SceneError
from .friction_parts import TablePart

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)


def field_of(part: float | TablePart) -> Callable[[np.ndarray], np.ndarray]:
    """Build the function of position for a quantity along a segment.

    Args:
        part: a constant, or a table.

    Returns:
        A function of positions [m] of any shape.
    """
    if isinstance(part, TablePart):
        at, value = np.array(part.at), np.array(part.value)
        return lambda x: np.interp(x, at, value)
    return lambda x: np.full(x.shape, part)


def breaks_of(part: float | TablePart) -> np.ndarray:
    """Find the positions at which a quantity along a segment is not smooth.

    Args:
        part: a constant, or a table.

    Returns:
        Positions, shape (B,) [m].
    """
    return np.array(part.at) if isinstance(part, TablePart) else np.zeros(0)


def check_field(part: float | TablePart, field: str, unit: str, least: str) -> None:
    """Check the sign of a quantity along a segment.

    Args:
        part: a constant, or a table.
        field: its key.
        unit: its unit.
        least: "> 0" or ">= 0".

    Raises:
        SceneError: if a value has the wrong sign.
    """
    for value in part.value if isinstance(part, TablePart) else (part,):
        if value < 0.0 or (value == 0.0 and least == "> 0"):
            raise SceneError(f"{field}: {value:g} {unit}; it must be {least}")


def average(field: Callable[[np.ndarray], np.ndarray], edges: np.ndarray, breaks: np.ndarray) -> np.ndarray:
    """Compute the mean of a field over each interval between edges, with Gauss quadrature between its breaks.

    Args:
        field: function of position.
        edges: shape (M + 1,), increasing [m].
        breaks: positions at which the field is not smooth, shape (B,) [m].

    Returns:
        Shape (M,).
    """
    inner = breaks[(breaks > edges[0]) & (breaks < edges[-1])]
    cuts = np.union1d(edges, inner)
    half, middle = 0.5 * np.diff(cuts), 0.5 * (cuts[:-1] + cuts[1:])
    values = field(middle[:, None] + half[:, None] * _POINTS) @ (0.5 * _WEIGHTS)
    weighted = np.concatenate(([0.0], np.cumsum(values * 2.0 * half)))
    return np.diff(weighted[np.searchsorted(cuts, edges)]) / np.diff(edges)
