"""Segments cut into elements: how many, and what each element and contact is made of.

An element is a spring, a contact stands for the ground halfway to its neighbours ([G] sections 3.3 and 3.4). The error
of the net translation is of first order in the length of an element, with a changing sign: the place where the body
stands still falls on a contact or between two. So it is measured, not guessed: the drive is run on coarse grids
and on a fine one, and the number of elements is read off the envelope of the errors.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .errors import SceneError

MOST_UNMEASURED = 1000
"""Elements at most where no drive tells what accuracy takes."""
MOST_ELEMENTS = 1_000_000
"""More elements than this are refused."""

_TRIED = (*range(1, 25), 27, 29, 31, 34, 36, 39, 41, 44, 47, 50, 53)
"""Coarse grids."""
_FINE = 587
"""The reference grid; a prime, so that it shares no contact with the coarse ones."""
_MARGIN = 1.5
"""Safety on a number of elements that is extrapolated."""

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)


def average(field: Callable[[np.ndarray], np.ndarray], edges: np.ndarray, breaks: np.ndarray) -> np.ndarray:
    """Compute the mean of a field over each interval between edges, by Gauss' rule between its breaks.

    Args:
        field: value at positions.
        edges: shape (M + 1,), increasing [m].
        breaks: where the field is not smooth, shape (B,) [m].

    Returns:
        Shape (M,).
    """
    inner = breaks[(breaks > edges[0]) & (breaks < edges[-1])]
    cuts = np.union1d(edges, inner)
    half, middle = 0.5 * np.diff(cuts), 0.5 * (cuts[:-1] + cuts[1:])
    values = field(middle[:, None] + half[:, None] * _POINTS) @ (0.5 * _WEIGHTS)
    weighted = np.concatenate(([0.0], np.cumsum(values * 2.0 * half)))
    return np.diff(weighted[np.searchsorted(cuts, edges)]) / np.diff(edges)


def count_elements(gains: Callable[[int], np.ndarray], scale: float, accuracy: float) -> int:
    """Find a number of elements at which the net translation is as accurate as asked.

    Args:
        gains: what is compared: net translation of each period (or of the whole run) with so many elements [m].
        scale: largest change of length commanded [m].
        accuracy: error allowed, relative to `scale` [1].

    Returns:
        The number: more than the least number from which on every grid is accurate enough, at most a few times more.

    Raises:
        SceneError: when it would be more than a million.
    """
    exact = gains(_FINE)
    tried = np.array(_TRIED)
    errors = np.array([np.abs(gains(n) - exact).max(initial=0.0) for n in _TRIED]) / scale
    good_from = 1 + int(tried[errors > accuracy].max(initial=0))
    if 2 * good_from <= _TRIED[-1]:  # good on every grid tried, up to twice as fine
        return good_from if good_from <= _TRIED[-1] // 4 else good_from + good_from // 4
    coarse, fine = (_envelope(tried, errors, *span) for span in ((6, 16), (27, _TRIED[-1])))
    order = np.log(coarse[1] / fine[1]) / np.log(fine[0] / coarse[0])
    order = 1.0 if order < 1.5 else 2.0  # the theory knows no order between
    wanted = int(np.ceil(_MARGIN * fine[0] * max(fine[1] / accuracy, 1.0) ** (1.0 / order)))
    if wanted > MOST_ELEMENTS:
        raise SceneError(f"accuracy {accuracy:g} would take {wanted} elements; at most {MOST_ELEMENTS} are allowed")
    return wanted


def _envelope(tried: np.ndarray, errors: np.ndarray, first: int, last: int) -> tuple[float, float]:
    """Find the number of elements between two at which the error, grown with it, is largest, and the error there."""
    span = (tried >= first) & (tried <= last)
    worst = int((errors * tried)[span].argmax())
    return float(tried[span][worst]), float(errors[span][worst])
