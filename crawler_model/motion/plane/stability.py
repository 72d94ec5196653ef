"""Whether an equilibrium is stable, by the second derivative of the energy at the points that are free to move.

Two matrices are of interest, both relative to how stiffly the body holds its points. In all directions, a negative
eigenvalue means that a small deviation grows along the path, as of a contact that is pushed. In the directions in which
contacts slide, and in both where a point has no friction, the energy must not decrease along any forward motion: where
it does, there is no equilibrium to follow any more, and the body jumps.
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import inner, lean
from .band import solve_band
from .elastic import pull, stiffen
from .frame import friction_of, norm
from .friction import axis_of

UNSTABLE = -1e-7
"""An equilibrium with an eigenvalue below this one is left."""
_INVERSIONS = 4
_ROUNDS, _DOWNHILL = 40, 0.3
"""Rounds of the search for a forward motion in which the energy decreases, and the length of its steps."""


@lean
def _list_axes(frame, command, moved, freedom, owner, axis, first):
    """List the directions in which points are free; return their number.

    Args:
        freedom: 1 if contacts are free along their displacements only, 2 in both directions.
        owner: output: point of each direction, shape (2 N,).
        axis: output: the directions, shape (2 N, 2).
        first: output: number of the first direction of each point and of the next one, shape (N + 1, 2).
    """
    count = 0
    for i in frame.order:
        _, _, most = friction_of(frame, command, i)
        size = norm(moved[i, 0], moved[i, 1])
        first[i, 0] = count
        if most == 0.0 or (size > 0.0 and freedom > 1.0):
            for c in range(2):
                owner[count] = i
                axis[count, c] = 1.0
                axis[count, 1 - c] = 0.0
                count += 1
        elif size > 0.0:
            owner[count] = i
            axis[count, 0] = moved[i, 0] / size
            axis[count, 1] = moved[i, 1] / size
            count += 1
        first[i, 1] = count
    return count


@lean
def _add(matrix, axis, first, i, j, block, u, v):
    """Add the coupling of two points, in the lower band: two rows and columns of the block, from u and v on."""
    for p in range(first[i, 0], first[i, 1]):
        for q in range(first[j, 0], first[j, 1]):
            if p >= q:
                push0 = block[u, v] * axis[q, 0] + block[u, v + 1] * axis[q, 1]
                push1 = block[u + 1, v] * axis[q, 0] + block[u + 1, v + 1] * axis[q, 1]
                matrix[p, p - q] += axis[p, 0] * push0 + axis[p, 1] * push1


@inner
def _add_frames(frame, command, x, axis, first, matrix):
    """Add by how much friction along the motion of a contact changes as its axis turns, the symmetric part of it.

    With the direction n of the motion, the force s and J n a quarter turn ahead of n, it changes by -s . J n times the
    angle, and by twice as much with the law along the velocity.
    """
    n = x.shape[0]
    force = np.empty((n, 2))
    pull(frame, command, x, force, np.empty(n))
    law = 2.0 if frame.along_velocity else 1.0
    for i in range(n):
        p = first[i, 0]
        if friction_of(frame, command, i)[2] == 0.0 or first[i, 1] == p:
            continue
        turn = law * (force[i, 0] * axis[p, 1] - force[i, 1] * axis[p, 0])
        _, _, by0, by1 = axis_of(frame, x, i)
        for end in range(2):
            j = frame.guide[i, end]
            for q in range(first[j, 0], first[j, 1]):
                change = turn * (by0 * axis[q, 0] + by1 * axis[q, 1])
                change = change if end == 1 else -change
                matrix[max(p, q), abs(p - q)] += change if p == q else 0.5 * change


@inner
def stiffness_of(frame, command, x, moved, freedom):
    """Build how stiffly the body resists motions in the directions in which points are free, relative to their grip.

    That is the second derivative of the energy, and along displacements how friction changes as frames turn.

    Args:
        freedom: 1 if contacts are free along their displacements only, 2 in both directions.

    Returns:
        The lower band: element (p, p - d) at [p, d], shape (D, width); point of each direction, shape (D,); the
        directions, shape (D, 2).
    """
    n = x.shape[0]
    owner = np.empty(2 * n, np.int64)
    axis = np.empty((2 * n, 2))
    first = np.empty((n, 2), np.int64)
    count = _list_axes(frame, command, moved, freedom, owner, axis, first)
    width = 2
    for k in range(frame.pairs.shape[0]):
        a, b = frame.pairs[k]
        width = max(width, max(first[a, 1] - first[b, 0], first[b, 1] - first[a, 0]))
    matrix = np.zeros((count, min(width, max(count, 1))))
    block = np.empty((6, 6))
    for k in range(frame.stiffness.shape[0]):
        stiffen(frame, command, x, k, block)
        points = 2 if frame.points[k, 2] < 0 else 3
        for p in range(points):
            for q in range(points):
                _add(matrix, axis, first, frame.points[k, p], frame.points[k, q], block, 2 * p, 2 * q)
    if freedom == 1.0:
        _add_frames(frame, command, x, axis, first, matrix)
    for p in range(count):
        for d in range(min(p + 1, matrix.shape[1])):
            matrix[p, d] /= math.sqrt(frame.grip[owner[p]] * frame.grip[owner[p - d]])
    return matrix, owner[:count], axis[:count]


@lean
def _has_below(matrix, shift, work):
    """Return whether an eigenvalue lies below a shift, by the signs of the pivots."""
    count, width = matrix.shape
    for p in range(count):
        for d in range(width):
            work[p, d] = matrix[p, d]
    for p in range(count):
        for d in range(min(p, width - 1), 0, -1):
            q = p - d
            total = work[p, d]
            for e in range(1, min(q, width - 1 - d) + 1):
                total -= work[p, d + e] * work[q, e] * work[q - e, 0]
            work[p, d] = total / work[q, 0]
        pivot = matrix[p, 0] - shift
        for d in range(1, min(p, width - 1) + 1):
            pivot -= work[p, d] * work[p, d] * work[p - d, 0]
        if not pivot > 0.0:
            return True
        work[p, 0] = pivot
    return False


@inner
def least_eigenvalue(matrix):
    """Find the least eigenvalue of a symmetric band matrix by bisection.

    Args:
        matrix: the lower band, shape (D, width).

    Returns:
        The eigenvalue, to three digits; infinite without rows.
    """
    count, width = matrix.shape
    if count == 0:
        return np.inf
    work = np.empty_like(matrix)
    low = high = matrix[0, 0]
    radius = np.zeros(count)
    for p in range(count):
        high = min(high, matrix[p, 0])
        for d in range(1, min(p, width - 1) + 1):
            radius[p] += abs(matrix[p, d])
            radius[p - d] += abs(matrix[p, d])
    for p in range(count):
        low = min(low, matrix[p, 0] - radius[p])
    if low < 0.0 < high and not _has_below(matrix, 0.0, work):
        low = 0.0
    elif low < 0.0:
        high = min(high, 0.0)
    while high - low > 1e-3 * max(abs(high), abs(low)) + 1e-9:
        middle = 0.5 * (low + high)
        if _has_below(matrix, middle, work):
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


@inner
def _eigenvector_of(matrix, value):
    """Compute the eigenvector of an eigenvalue by inverse iteration."""
    count, width = matrix.shape
    reach = width - 1
    found = np.empty(count)
    for p in range(count):
        found[p] = 1.0 + 0.1 * (p % 7)  # no symmetry
    for _ in range(_INVERSIONS):
        band = np.zeros((count, 3 * reach + 1))
        for p in range(count):
            band[p, 2 * reach] = matrix[p, 0] - value
            for d in range(1, min(p, reach) + 1):
                band[p, 2 * reach - d] = matrix[p, d]
                band[p - d, 2 * reach + d] = matrix[p, d]
        solve_band(band, reach, found)
        size = 0.0
        for p in range(count):
            size += found[p] * found[p]
        for p in range(count):
            found[p] /= math.sqrt(size)
    return found


@lean
def _push(matrix, one_sided, motion, slope):
    """Make a motion forward and of length 1; write half the derivative of its energy, and return the energy."""
    count, width = matrix.shape
    size = 0.0
    for p in range(count):
        motion[p] = max(motion[p], 0.0) if one_sided[p] else motion[p]
        size += motion[p] * motion[p]
        slope[p] = 0.0
    value = 0.0
    for p in range(count):
        motion[p] /= math.sqrt(size) if size > 0.0 else 1.0
        slope[p] += matrix[p, 0] * motion[p]
        for d in range(1, min(p, width - 1) + 1):
            slope[p] += matrix[p, d] * motion[p - d]
            slope[p - d] += matrix[p, d] * motion[p]
    for p in range(count):
        value += slope[p] * motion[p]
    return value


@inner
def decreases(frame, command, matrix, owner, unstable):
    """Determine whether the energy decreases along a forward motion.

    Args:
        matrix: from `stiffness_of`, along the displacements.
        owner: point of each direction, shape (D,).
        unstable: an energy of a motion of length 1 below this one is a decrease [1].

    Returns:
        Whether it does; a motion forward in which it decreases most, as far as was found, shape (D,).
    """
    count = owner.size
    best = np.zeros(count)
    if count == 0 or not _has_below(matrix, unstable, np.empty_like(matrix)):
        return False, best
    one_sided = np.empty(count, np.bool_)
    for p in range(count):
        one_sided[p] = friction_of(frame, command, owner[p])[2] > 0.0
    value = least_eigenvalue(matrix)
    vector = _eigenvector_of(matrix, value - 1e-3 * abs(value))
    least = unstable
    motion = np.empty(count)
    slope = np.empty(count)
    for sign in (1.0, -1.0):
        for p in range(count):
            motion[p] = sign * vector[p]
        for _ in range(_ROUNDS):
            value = _push(matrix, one_sided, motion, slope)
            if value < least:
                least = value
                for p in range(count):
                    best[p] = motion[p]
            for p in range(count):
                motion[p] -= _DOWNHILL * slope[p]
    return least < unstable, best
