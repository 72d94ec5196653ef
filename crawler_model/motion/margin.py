"""How close all contacts of a body on a line are to sliding at once: then nothing determines its translation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def visited_margin(force: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> float:
    """Compute how close all contacts are to sliding at once in one state.

        sum_i min(mu_plus_i - g_i, g_i + mu_minus_i) / sum_i (mu_plus_i + mu_minus_i)

    It is never smaller than `uniqueness_margin` of the friction of the same contacts. (Here the contacts of a segment
    count individually, while `commanded_margin` treats the segment as one block.)

    Args:
        force: spring force g on each contact, shape (N,) [N].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        The margin [1]; 0 if all contacts are at a bound or there is no friction.
    """
    return float(visited_margins(force, forward, backward))


def visited_margins(force: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> np.ndarray:
    """Compute the visited margin of each of several states, as `visited_margin` does.

    Args:
        force: spring force g on each contact, shape (..., N) [N].
        forward: mu_plus, of the same shape [N].
        backward: mu_minus, of the same shape [N].

    Returns:
        Shape (...,) [1].
    """
    g, plus, minus = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (force, forward, backward)))
    total = (plus + minus).sum(axis=-1)
    near = np.maximum(np.minimum(plus - g, g + minus), 0.0).sum(axis=-1)
    return np.divide(near, total, out=np.zeros_like(total), where=total > 0.0)
