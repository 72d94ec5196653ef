"""The choice of the translation in the plane when all contacts slide: the one nearest to rest."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled
from ...rounding import CRITICAL, EPS
from .friction import CLOSE_ENOUGH, STUCK


@compiled
def _normal_cones(velocity, spring, friction, directions, magnitude, normals, offsets):
    """Write the translations t that leave every v_i + t normal to C_i at g_i as half-planes normals . t >= offsets.

    Returns their number, or -1 if a contact inside its C_i, or two contacts together, fix the translation.
    """
    n = velocity.shape[0]
    m = directions.shape[0]
    count = 0
    ray = np.zeros(2)
    for i in range(n):
        size = friction[i].max()
        close = CRITICAL * size + 2.0 * CLOSE_ENOUGH * magnitude[i]
        start = count
        single = False
        if m == 0:
            force = math.hypot(spring[i, 0], spring[i, 1])
            if size <= 0.0:
                continue
            if force < size - close:
                return -1
            single = True
            d0 = spring[i, 0] / force
            d1 = spring[i, 1] / force
        else:
            first = -1
            last = -1
            for k in range(m + 1):
                j = k % m
                if k == m and first < 0:
                    return -1
                if k == m:
                    j = first
                elif spring[i, 0] * directions[j, 0] + spring[i, 1] * directions[j, 1] < friction[i, j] - close:
                    continue
                if last >= 0:
                    a0 = directions[last, 0]
                    a1 = directions[last, 1]
                    b0 = directions[j, 0]
                    b1 = directions[j, 1]
                    if j == last or a0 * b1 - a1 * b0 <= 8.0 * EPS:  # half a turn or more from a to b
                        normals[count, 0] = a1
                        normals[count, 1] = -a0
                        normals[count + 1, 0] = -b1
                        normals[count + 1, 1] = b0
                        count += 2
                        single = j == last
                else:
                    first = j
                last = j
            d0 = directions[last, 0]
            d1 = directions[last, 1]
        if single:
            if (ray[0] != 0.0 or ray[1] != 0.0) and abs(ray[0] * d1 - ray[1] * d0) > 10.0 * CRITICAL:
                return -1
            ray[0] = d0
            ray[1] = d1
            if m == 0:
                normals[count, 0] = d1
                normals[count, 1] = -d0
                normals[count + 1, 0] = -d1
                normals[count + 1, 1] = d0
                count += 2
            normals[count, 0] = d0
            normals[count, 1] = d1
            count += 1
        for c in range(start, count):
            offsets[c] = -(normals[c, 0] * velocity[i, 0] + normals[c, 1] * velocity[i, 1])
    return count


@compiled
def choose_translation(velocity, spring, friction, directions, magnitude, motion):
    """Add the translation of equal cost that brings the mean nearest to zero.

    Args:
        velocity: displacements of a step in which all contacts may slide, shape (N, 2) [m], changed in place.
        spring: force of the springs on each contact, shape (N, 2) [N].
        friction: bounds, shape (N, 1), or (N, m) for shared directions [N].
        directions: unit vectors, shape (m, 2); m = 0 for discs.
        magnitude: magnitude of the terms of each spring force, for its rounding, shape (N,) [N].
        motion: motion of each contact, see `STUCK`, int64, shape (N,), changed in place.

    Returns:
        Whether the translation is unique.
    """
    n = velocity.shape[0]
    normals = np.empty((6 * n, 2))
    offsets = np.empty(6 * n)
    count = _normal_cones(velocity, spring, friction, directions, magnitude, normals, offsets)
    if count < 0:
        return True
    size = 0.0
    goal0 = 0.0
    goal1 = 0.0
    for i in range(n):
        size = max(size, math.hypot(velocity[i, 0], velocity[i, 1]))
        goal0 -= velocity[i, 0] / n
        goal1 -= velocity[i, 1] / n
    if size == 0.0:
        return True
    inside = True
    for c in range(count):
        if offsets[c] > -CRITICAL * size:
            offsets[c] = 0.0
        inside = inside and normals[c, 0] * goal0 + normals[c, 1] * goal1 >= offsets[c]
    unique = count > 0
    best = np.inf
    t0 = 0.0
    t1 = 0.0
    for c in range(count):  # nearest point on each edge
        p0 = normals[c, 0] * offsets[c]
        p1 = normals[c, 1] * offsets[c]
        u0 = -normals[c, 1]
        u1 = normals[c, 0]
        least = -np.inf
        most = np.inf
        for o in range(count):
            rise = normals[o, 0] * u0 + normals[o, 1] * u1
            need = offsets[o] - (normals[o, 0] * p0 + normals[o, 1] * p1)
            if abs(rise) <= 10.0 * CRITICAL:
                if need > CRITICAL * size:
                    least = np.inf
            elif rise > 0.0:
                least = max(least, need / rise)
            else:
                most = min(most, need / rise)
        if least == np.inf or most < least - CRITICAL * size:
            continue
        if most - least > CRITICAL * size:
            unique = False
        at = min(max(goal0 * u0 + goal1 * u1, least), most)
        far = (p0 + at * u0 - goal0) ** 2 + (p1 + at * u1 - goal1) ** 2
        if far < best:
            best = far
            t0 = p0 + at * u0
            t1 = p1 + at * u1
    if unique:
        return True
    if inside:
        t0 = goal0
        t1 = goal1
    for i in range(n):
        velocity[i, 0] += t0
        velocity[i, 1] += t1
        if math.hypot(velocity[i, 0], velocity[i, 1]) <= CRITICAL * size:
            velocity[i, 0] = 0.0
            velocity[i, 1] = 0.0
            motion[i] = STUCK
    return False
