"""Friction whose set of admissible forces is a polygon {f : f . d_k <= mu_k}, with unit vectors d_k of the ground.

Corner k joins the edges of d_k and d_{k+1}. Friction balances a force s during a displacement w if s is the point of
the polygon nearest to s + r w, for any r > 0.
"""

from __future__ import annotations

import numpy as np

from ...compiled import lean
from .frame import friction_of, norm

ON = 1e-11
"""A force this close to an edge, relative to the friction of the point, is on it."""
INSIDE = -1
"""The face of the polygon nearest to a force inside; otherwise k for edge k, m + k for corner k."""


@lean
def corner_of(frame, command, at, k):
    """Compute a corner of a polygon.

    Args:
        k: the corner.

    Returns:
        Its two coordinates [N].
    """
    m = frame.directions.shape[0]
    after = k + 1 if k + 1 < m else 0
    a0, a1 = frame.directions[k]
    b0, b1 = frame.directions[after]
    across = a0 * b1 - a1 * b0
    f = command[at + k]
    g = command[at + after]
    return (f * b1 - g * a1) / across, (g * a0 - f * b0) / across


@lean
def gap_in(frame, command, at, f0, f1):
    """Compute the distance of a force from the nearest edge.

    Args:
        f0: the force along x [N].
        f1: the force along y [N].

    Returns:
        The distance, negative outside [N].
    """
    least = np.inf
    for k in range(frame.directions.shape[0]):
        least = min(least, command[at + k] - f0 * frame.directions[k, 0] - f1 * frame.directions[k, 1])
    return least


@lean
def time_to_edge(frame, command, later, i, before, after):
    """Compute when a force that changes linearly reaches an edge on which it is not yet.

    Args:
        later: the command after a unit of time.
        before: forces on all points, shape (N, 2) [N].
        after: forces after a unit of time, shape (N, 2) [N].

    Returns:
        The time; infinite if never [1].
    """
    first = np.inf
    at, _, most = friction_of(frame, command, i)
    for k in range(frame.directions.shape[0]):
        d0, d1 = frame.directions[k]
        gap = command[at + k] - before[i, 0] * d0 - before[i, 1] * d1
        left = later[at + k] - after[i, 0] * d0 - after[i, 1] * d1
        if gap > ON * most and left < gap:
            first = min(first, gap / (gap - left))
    return first


@lean
def work_against(frame, command, at, v0, v1):
    """Compute the work against friction of a displacement.

    Args:
        v0: the displacement along x [m].
        v1: the displacement along y [m].

    Returns:
        The work [J].
    """
    most = -np.inf
    for k in range(frame.directions.shape[0]):
        c0, c1 = corner_of(frame, command, at, k)
        most = max(most, c0 * v0 + c1 * v1)
    return most


@lean
def nearest_face(frame, command, at, z0, z1, close):
    """Find the face of a polygon that is nearest to a force.

    Args:
        z0: the force along x [N].
        z1: the force along y [N].
        close: a force outside by no more than this is inside [N].

    Returns:
        The face, see `INSIDE`, and the nearest point, two coordinates [N].
    """
    m = frame.directions.shape[0]
    face = INSIDE
    best = np.inf
    p0 = z0
    p1 = z1
    if gap_in(frame, command, at, z0, z1) >= -close:
        return face, p0, p1
    before0, before1 = corner_of(frame, command, at, m - 1)
    for k in range(m):
        d0, d1 = frame.directions[k]
        after0, after1 = corner_of(frame, command, at, k)
        beyond = -(command[at + k] - z0 * d0 - z1 * d1)  # rounded as in gap_in: a force is inside or beyond an edge
        beside = (z1 - before1) * d0 - (z0 - before0) * d1 > 0.0 > (z1 - after1) * d0 - (z0 - after0) * d1
        if beside and beyond > 0.0 and beyond * beyond <= best:
            best = beyond * beyond
            face = k
            p0 = z0 - beyond * d0
            p1 = z1 - beyond * d1
        far = (z0 - after0) ** 2 + (z1 - after1) ** 2
        if far < best:
            best = far
            face = m + k
            p0 = after0
            p1 = after1
        before0 = after0
        before1 = after1
    return face, p0, p1


@lean
def linearise_polygon(frame, command, i, at, force, moved, close, most, row):
    """Compute by how much a point misses the law of friction, and the derivatives of that.

    Args:
        force: two components [N].
        moved: its displacement, two components [m].
        close: a point at rest outside the polygon by no more than this part of its friction sticks.
        most: its largest friction [N].
        row: output, zero before, as for `linearise`.

    Returns:
        The miss, relative to the largest friction.
    """
    r = frame.grip[i]
    rests = moved[0] == 0.0 and moved[1] == 0.0
    face, p0, p1 = nearest_face(
        frame, command, at, force[0] + r * moved[0], force[1] + r * moved[1], close * most if rests else 0.0
    )
    if face == INSIDE:
        row[0] = -r * moved[0] / most
        row[1] = -r * moved[1] / most
        return norm(row[0], row[1])
    row[0] = (force[0] - p0) / most
    row[1] = (force[1] - p1) / most
    d0 = d1 = 1.0
    if face < frame.directions.shape[0]:  # along an edge
        d0, d1 = frame.directions[face]
        row[6] = r * d1 * d1 / most
        row[7] = row[8] = -r * d0 * d1 / most
        row[9] = r * d0 * d0 / most
        row[3] = row[4] = d0 * d1 / most
    row[2] = d0 * d0 / most
    row[5] = d1 * d1 / most
    row[12] = 1.0
    return norm(row[0], row[1])
