"""The stasis domain: the tensions at which nothing moves.

    C_sh = { T : -mu_minus_i <= T_i - T_{i-1} <= mu_plus_i },   T_{-1} = T_{N-1} = 0

Strictly inside it a crawler is at rest; motion starts at its boundary ([G] Remark on stasis domains).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def spring_force(tension: ArrayLike) -> np.ndarray:
    """Compute the force of the springs on each contact, g_i = T_i - T_{i-1}.

    Args:
        tension: T, shape (..., N - 1) [N].

    Returns:
        g, shape (..., N) [N].
    """
    t = np.asarray(tension, dtype=np.float64)
    ends = np.zeros((*t.shape[:-1], 1))
    return np.diff(np.concatenate((ends, t, ends), axis=-1), axis=-1)


def stasis_margins(tension: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> np.ndarray:
    """Compute each contact's distance from its nearest bound.

    Args:
        tension: T, shape (N - 1,) [N].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        min(mu_plus - g, g + mu_minus), shape (N,) [N]: positive inside, negative by the excess outside.
    """
    g = spring_force(tension)
    return np.minimum(np.asarray(forward) - g, g + np.asarray(backward))


def rounding_of_forces(tension: ArrayLike, friction: ArrayLike) -> np.ndarray:
    """Compute how far rounding may put each contact's spring force from a bound that it is at.

    Args:
        tension: T, shape (N - 1,) [N].
        friction: mu_plus + mu_minus, shape (N,) [N].

    Returns:
        A small multiple of the precision of the numbers that meet at each contact, shape (N,) [N].
    """
    t = np.abs(np.asarray(tension, dtype=np.float64))
    beside = np.concatenate((t, [0.0])) + np.concatenate(([0.0], t))
    return 32.0 * np.finfo(np.float64).eps * (beside + np.asarray(friction))


def is_in_stasis(tension: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> bool:
    """Tell whether the tensions belong to the (closed) stasis domain.

    Args:
        tension: T, shape (N - 1,) [N].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        True inside and on the boundary.
    """
    return bool((stasis_margins(tension, forward, backward) >= 0.0).all())


def stasis_bounds(tension: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Compute, for each link, between which tensions it may be while the others keep theirs.

    Args:
        tension: T, shape (..., N - 1) [N].
        forward: mu_plus, shape (..., N) [N].
        backward: mu_minus, shape (..., N) [N].

    Returns:
        The least and the greatest tension of each link, each of shape (..., N - 1) [N].
    """
    t = np.asarray(tension, dtype=np.float64)
    plus, minus = np.asarray(forward), np.asarray(backward)
    ends = np.zeros((*t.shape[:-1], 1))
    before = np.concatenate((ends, t[..., :-1]), axis=-1)
    after = np.concatenate((t[..., 1:], ends), axis=-1)
    least = np.maximum(before - minus[..., :-1], after - plus[..., 1:])
    most = np.minimum(before + plus[..., :-1], after + minus[..., 1:])
    return least, most


def tension_ranges(forward: ArrayLike, backward: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Compute the projection of the stasis domain onto each link's tension.

    Link i can be held from either side: -min(sum_{j<=i} mu_minus_j, sum_{j>i} mu_plus_j) <= T_i <=
    min(sum_{j<=i} mu_plus_j, sum_{j>i} mu_minus_j).

    Args:
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        The least and the greatest tension of each link, each of shape (N - 1,) [N].
    """
    plus, minus = np.asarray(forward, dtype=np.float64), np.asarray(backward, dtype=np.float64)
    behind_plus, behind_minus = np.cumsum(plus)[:-1], np.cumsum(minus)[:-1]
    ahead_plus, ahead_minus = np.cumsum(plus[::-1])[::-1][1:], np.cumsum(minus[::-1])[::-1][1:]
    return -np.minimum(behind_minus, ahead_plus), np.minimum(behind_plus, ahead_minus)


def stasis_polygon(forward: ArrayLike, backward: ArrayLike) -> np.ndarray:
    """Compute the stasis domain of three contacts: a triangle if one friction exceeds the two others, else more sides.

    Args:
        forward: mu_plus, shape (3,) [N].
        backward: mu_minus, shape (3,) [N].

    Returns:
        Its vertices (T_0, T_1), anticlockwise, shape (V, 2) [N].

    Raises:
        ValueError: when there are not three contacts.
    """
    plus, minus = np.asarray(forward, dtype=np.float64), np.asarray(backward, dtype=np.float64)
    if plus.shape != (3,) or minus.shape != (3,):
        raise ValueError(f"forward, backward: shapes {plus.shape} and {minus.shape}; a polygon needs three contacts")
    # the box of contacts 0 and 2, then cut by the two half planes of contact 1
    left, right, low, high = -minus[0], plus[0], -plus[2], minus[2]
    corners = np.array([[left, low], [right, low], [right, high], [left, high]])
    for normal, bound in ((np.array([-1.0, 1.0]), plus[1]), (np.array([1.0, -1.0]), minus[1])):
        corners = _cut(corners, normal, bound)
    return corners


def _cut(corners: np.ndarray, normal: np.ndarray, bound: float) -> np.ndarray:
    """Keep the part of a convex polygon where normal . T <= bound (Sutherland and Hodgman)."""
    kept: list[np.ndarray] = []
    for here, there in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        a, b = float(normal @ here - bound), float(normal @ there - bound)
        if a <= 0.0:
            kept.append(here)
        if (a < 0.0 < b) or (b < 0.0 < a):
            kept.append(here + (there - here) * (a / (a - b)))
    distinct = [p for i, p in enumerate(kept) if i == 0 or not np.allclose(p, kept[i - 1], rtol=0.0, atol=1e-15)]
    return np.array(distinct)
