"""Friction in the plane: the sets of admissible forces (discs, or polygons with shared directions) and resistance."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled, lean

CLOSE_ENOUGH = 1e-13
"""A step is solved if no force is farther from dR than this part of the magnitude of its terms."""
STUCK = 0
"""Motion of a contact: STUCK; 1 sliding on a disc; 1 + k along direction k; 1 + m + k between k and k + 1."""


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


@lean
def largest(mu):
    """Return the largest friction of one contact.

    Args:
        mu: friction of the contact, shape (max(m, 1),) [N].

    Returns:
        The largest of them [N].
    """
    most = mu[0]
    for k in range(1, mu.shape[0]):
        most = max(most, mu[k])
    return most


@lean
def resistance(mu, corners, v0, v1):
    """Compute R(v) of one contact.

    Args:
        mu: friction of the contact, shape (max(m, 1),) [N].
        corners: corners of its polygon, shape (m, 2) [N]; m = 0 for a disc.
        v0: velocity along x.
        v1: velocity along y.

    Returns:
        R(v), friction force times velocity.
    """
    m = corners.shape[0]
    if m == 0:
        return mu[0] * math.hypot(v0, v1)
    most = -np.inf
    for k in range(m):
        most = max(most, corners[k, 0] * v0 + corners[k, 1] * v1)
    return most


@lean
def excess(q0, q1, mu, directions, corners, close):
    """Subtract from a force the nearest admissible friction force.

    Args:
        q0: force along x [N].
        q1: force along y [N].
        mu: friction of the contact, shape (max(m, 1),) [N].
        directions: unit vectors d_k, shape (m, 2).
        corners: corners of its polygon, shape (m, 2) [N].
        close: forces outside by no more than this count as inside [N].

    Returns:
        The corresponding motion, and the difference, x and y [N].
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
