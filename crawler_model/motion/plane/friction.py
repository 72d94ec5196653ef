"""Friction in the plane: discs, or polygons with shared directions; what it resists, and which forces it can bear."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ...compiled import compiled
from ...errors import SceneError

EPS = float(np.finfo(np.float64).eps)
CLOSE_ENOUGH = 1e-13
"""A step is solved when no force is further from dR than this part of the numbers that it was summed from."""
STUCK = 0
"""A contact's motion: stuck; 1 sliding on a disc; 1 + k along direction k; 1 + m + k between k and k + 1."""


@compiled
def corners_of(friction, directions):
    """Compute the corners of all friction polygons.

    Args:
        friction: mu, shape (n, m) [N].
        directions: unit vectors d_k, shape (m, 2).

    Returns:
        Shape (n, m, 2) [N].
    """
    n = friction.shape[0]
    m = directions.shape[0]
    corners = np.empty((n, m, 2))
    for k in range(m):
        a = directions[k]
        b = directions[(k + 1) % m]
        across = a[0] * b[1] - a[1] * b[0]
        for i in range(n):
            f = friction[i, k]
            g = friction[i, (k + 1) % m]
            corners[i, k, 0] = (f * b[1] - g * a[1]) / across
            corners[i, k, 1] = (g * a[0] - f * b[0]) / across
    return corners


@compiled
def resistance(mu, corners, v0, v1):
    """Compute R(v) of one contact.

    Args:
        mu: its friction, shape (max(m, 1),) [N].
        corners: of its polygon, shape (m, 2) [N]; m = 0 for a disc.
        v0: velocity along x.
        v1: velocity along y.

    Returns:
        R(v), force times velocity.
    """
    m = corners.shape[0]
    if m == 0:
        return mu[0] * math.hypot(v0, v1)
    most = -np.inf
    for k in range(m):
        most = max(most, corners[k, 0] * v0 + corners[k, 1] * v1)
    return most


@compiled
def excess(q0, q1, mu, directions, corners, close):
    """Subtract from a force the nearest one that friction can bear.

    Args:
        q0: force along x [N].
        q1: force along y [N].
        mu: friction of the contact, shape (max(m, 1),) [N].
        directions: unit vectors d_k, shape (m, 2).
        corners: of its polygon, shape (m, 2) [N].
        close: what lies so little outside counts as inside [N].

    Returns:
        The motion that this means, and the difference, x and y [N].
    """
    m = directions.shape[0]
    if m == 0:
        size = math.hypot(q0, q1)
        if size <= mu[0] + close:
            return STUCK, 0.0, 0.0
        part = (size - mu[0]) / size
        return 1, part * q0, part * q1
    outside = False
    for k in range(m):
        outside = outside or q0 * directions[k, 0] + q1 * directions[k, 1] > mu[k] + close
    if not outside:
        return STUCK, 0.0, 0.0
    nearest = np.inf
    motion = STUCK
    e0 = 0.0
    e1 = 0.0
    for k in range(m):
        d0 = directions[k, 0]
        d1 = directions[k, 1]
        from_first = (q1 - corners[k - 1, 1]) * d0 - (q0 - corners[k - 1, 0]) * d1
        from_last = (q1 - corners[k, 1]) * d0 - (q0 - corners[k, 0]) * d1
        if from_first > 0.0 and from_last < 0.0:
            beyond = q0 * d0 + q1 * d1 - mu[k]
            if beyond > 0.0 and beyond * beyond < nearest:
                nearest = beyond * beyond
                motion = 1 + k
                e0 = beyond * d0
                e1 = beyond * d1
        else:
            corner = k if from_first > 0.0 else (k - 1) % m
            w0 = q0 - corners[corner, 0]
            w1 = q1 - corners[corner, 1]
            if w0 * w0 + w1 * w1 < nearest:
                nearest = w0 * w0 + w1 * w1
                motion = 1 + m + corner
                e0 = w0
                e1 = w1
    return motion, e0, e1


def check_directions(angles: ArrayLike, values: ArrayLike) -> None:
    """Check that direction-dependent friction is a convex dissipation.

    Args:
        angles: angles of the directions, shape (m,) [rad], strictly increasing within one turn.
        values: mu of each direction, shape (m,) or one row per contact (n, m) [N].

    Raises:
        SceneError: naming the direction that is out of order, too far from the next, negative or not convex.
    """
    angle = np.asarray(angles, dtype=np.float64)
    mu = np.atleast_2d(np.asarray(values, dtype=np.float64))
    m = angle.size
    if angle.ndim != 1 or m < 3:
        raise SceneError(f"friction.directions: {m} given; it takes at least 3 to span the plane")
    if mu.ndim != 2 or mu.shape[1] != m:
        raise SceneError(f"friction.directions: {mu.shape[-1]} value(s) for {m} directions; give one for each")
    for k in np.flatnonzero(~np.isfinite(angle)):
        raise SceneError(f"friction.directions: the angle of direction {k} is {angle[k]}; it must be finite")
    gaps = np.diff(np.append(angle, angle[0] + 2.0 * np.pi))
    for k in np.flatnonzero(gaps <= 0.0):
        raise SceneError(
            f"friction.directions: direction {(k + 1) % m} at {angle[(k + 1) % m]:g} rad follows {angle[k]:g} rad; "
            "angles must increase strictly, within one turn" + (" (they are in rad)" if angle.max() > 7.0 else "")
        )
    for k in np.flatnonzero(gaps >= np.pi * (1.0 - 4.0 * EPS)):
        raise SceneError(
            f"friction.directions: {gaps[k]:g} rad from direction {k} to the next; it must be less than half a turn"
        )
    for i, k in np.argwhere(~((mu >= 0.0) & np.isfinite(mu))):
        raise SceneError(f"friction.directions: contact {i} has {mu[i, k]:g} N in direction {k}; it must be >= 0")
    before, after = np.roll(gaps, 1), gaps
    # d_k is a combination of its neighbours; R is convex if it is nowhere above the same combination of their values
    most = np.roll(mu, 1, axis=1) * np.sin(after) + np.roll(mu, -1, axis=1) * np.sin(before)
    bend = most - mu * np.sin(before + after)
    for i, k in np.argwhere(bend < -16.0 * EPS * np.maximum(mu.max(axis=1, keepdims=True), 0.0)):
        raise SceneError(
            f"friction.directions: not convex: contact {i} has {mu[i, k]:g} N in direction {k} at {angle[k]:g} rad; "
            f"its neighbours allow at most {most[i, k] / np.sin(before[k] + after[k]):g} N"
        )
