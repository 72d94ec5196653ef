"""A step of Newton's method on the sliding contacts in the plane, with line search."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled, lean
from ...rounding import CRITICAL
from .friction import STUCK, resistance
from .springs import diagonal, solve_band_in_place


@lean
def _search_discs(friction, linear, quadratic, velocity, step):
    """Find the step length along `step`, at most 1, at which the slope of the cost is small or changes sign.

    Also returns the contact that comes to rest there, -1 if there is none.
    """
    low = 0.0
    high = 1.0
    at = 0.0
    first = 0.0
    for trial in range(60):
        slope = linear + at * quadratic
        for i in range(velocity.shape[0]):
            if step[i, 0] == 0.0 and step[i, 1] == 0.0:
                continue
            v0 = velocity[i, 0] + at * step[i, 0]
            v1 = velocity[i, 1] + at * step[i, 1]
            speed = math.hypot(v0, v1)
            along = (v0 * step[i, 0] + v1 * step[i, 1]) / speed if speed > 0.0 else math.hypot(step[i, 0], step[i, 1])
            slope += friction[i, 0] * along
        if trial == 0:
            first = abs(slope)
            at = 1.0
            continue
        if slope <= 0.1 * first:
            low = at
        else:
            high = at
        if low == 1.0 or abs(slope) <= 0.1 * first:
            break
        at = 0.5 * (low + high)
    stopped = -1
    nearest = 1e-12  # squared, as a part of the velocity
    for i in range(velocity.shape[0]):
        if step[i, 0] == 0.0 and step[i, 1] == 0.0:
            continue
        left = (velocity[i, 0] + low * step[i, 0]) ** 2 + (velocity[i, 1] + low * step[i, 1]) ** 2
        speed = velocity[i, 0] ** 2 + velocity[i, 1] ** 2
        if left < nearest * speed and friction[i, 0] > 0.0:
            nearest = left / speed
            stopped = i
    return low, stopped


@compiled
def _search_polygons(directions, friction, corners, linear, quadratic, velocity, step, motion):
    """Find the step length along `step`, at most 1, of least cost; the slope of the cost is a line with jumps.

    Also returns the contact whose jump ends the search and the direction on which it then stays, -1 if none.
    """
    n = velocity.shape[0]
    m = directions.shape[0]
    count = 0
    places = np.empty(n * m)
    jumps = np.empty(n * m)
    whose = np.empty(n * m, np.int64)
    slope = linear
    for i in range(n):
        s0 = step[i, 0]
        s1 = step[i, 1]
        if motion[i] == STUCK or (s0 == 0.0 and s1 == 0.0):
            continue
        own = (motion[i] - 1) % m
        slope += corners[i, own, 0] * s0 + corners[i, own, 1] * s1
        if motion[i] <= m:
            along = s0 * directions[own, 0] + s1 * directions[own, 1]
            if along < 0.0:
                back = resistance(friction[i], corners[i], -directions[own, 0], -directions[own, 1])
                places[count] = -(velocity[i, 0] * directions[own, 0] + velocity[i, 1] * directions[own, 1]) / along
                jumps[count] = -along * (friction[i, own] + back)
                whose[count] = i * m + own
                count += 1
            continue
        for k in range(m):
            d0 = directions[k, 0]
            d1 = directions[k, 1]
            turning = d0 * s1 - d1 * s0  # > 0: crosses d_k counterclockwise
            if turning == 0.0:
                continue
            place = (d1 * velocity[i, 0] - d0 * velocity[i, 1]) / turning
            if (k == own and turning < 0.0) or (k == (own + 1) % m and turning > 0.0):
                place = max(place, 0.0)
            elif place <= 0.0 or k == own or k == (own + 1) % m:
                continue
            if d0 * (velocity[i, 0] + place * s0) + d1 * (velocity[i, 1] + place * s1) > 0.0:
                jump0 = corners[i, k, 0] - corners[i, k - 1, 0]
                jump1 = corners[i, k, 1] - corners[i, k - 1, 1]
                places[count] = place
                jumps[count] = abs(jump0 * s0 + jump1 * s1)
                whose[count] = i * m + k
                count += 1
    order = np.argsort(places[:count])
    at = 0.0
    for j in order:
        place = min(places[j], 1.0)
        if slope + quadratic * (place - at) >= 0.0 or places[j] >= 1.0:
            break
        slope += quadratic * (place - at)
        at = place
        if slope + jumps[j] >= 0.0:
            return at, whose[j] // m, whose[j] % m
        slope += jumps[j]
    return min(at - slope / quadratic if quadratic > 0.0 else 1.0, 1.0), -1, -1


@lean
def _assemble_discs(springs, friction, velocity, motion, spring, first, matrix, right):
    """Write the band of the Hessian and the negative gradient of the cost, in x and y of each sliding contact."""
    for i in springs.order:
        if motion[i] == STUCK:
            continue
        p = first[i]
        mu = friction[i, 0]
        speed = math.hypot(velocity[i, 0], velocity[i, 1])
        d0 = velocity[i, 0] / speed if speed > 0.0 else 0.0
        d1 = velocity[i, 1] / speed if speed > 0.0 else 0.0
        turn = mu / speed if speed > 0.0 else 0.0
        own = diagonal(springs, i) * (1.0 + CRITICAL)  # a translation may be free if all contacts slide
        matrix[p, 0] = own + turn * d1 * d1
        matrix[p, 1] = -turn * d0 * d1
        matrix[p + 1, 0] = own + turn * d0 * d0
        for e in range(springs.first[i] + 1, springs.first[i + 1]):
            apart = first[springs.other[e]] - p
            if apart > 0:
                matrix[p, apart] = springs.entry[e]
                matrix[p + 1, apart] = springs.entry[e]
        right[p] = spring[i, 0] - mu * d0
        right[p + 1] = spring[i, 1] - mu * d1


@lean
def _assemble_polygons(springs, directions, corners, motion, spring, owner, axis, first, last, matrix, right):
    """Write the band of the Hessian and the negative gradient of the cost, along the axes of the sliding contacts."""
    for p in range(owner.size):
        i = owner[p]
        for e in range(springs.first[i], springs.first[i + 1]):
            j = springs.other[e]
            for c in range(max(first[j], p), last[j] + 1):
                matrix[p, c - p] = springs.entry[e] * (axis[p, 0] * axis[c, 0] + axis[p, 1] * axis[c, 1])
        matrix[p, 0] += CRITICAL * diagonal(springs, i)  # a translation may be free if all contacts slide
        corner = corners[i, (motion[i] - 1) % directions.shape[0]]
        right[p] = (spring[i, 0] - corner[0]) * axis[p, 0] + (spring[i, 1] - corner[1]) * axis[p, 1]


@compiled
def take_newton_step(springs, friction, directions, corners, velocity, motion, magnitude, spring, awake):
    """Take a Newton step for all sliding contacts, the others fixed.

    Args:
        springs: the springs, with K, as in `Springs`.
        friction: mu, shape (n, max(m, 1)) [N].
        directions: unit vectors d_k, shape (m, 2).
        corners: corners of the polygons, shape (n, m, 2) [N].
        velocity: v, changed in place, shape (n, 2) [m].
        motion: motion of each contact, see `STUCK`, changed in place, int64, shape (n,).
        magnitude: magnitude of the terms of the force on each contact, shape (n,) [N].
        spring: r - K v, shape (n, 2) [N].
        awake: set for the neighbours of contacts whose velocity changes, shape (n,).

    Returns:
        Whether a contact that came to rest, or turned to another direction, shortened the step.
    """
    n = velocity.shape[0]
    m = directions.shape[0]
    owner = np.empty(2 * n, np.int64)
    axis = np.empty((2 * n, 2))
    first = np.full(n, -1)  # unknowns of each contact
    last = np.full(n, -2)
    count = 0
    for i in springs.order:
        if motion[i] == STUCK:
            continue
        first[i] = count
        owner[count] = i
        if 1 <= motion[i] <= m:
            axis[count] = directions[motion[i] - 1]
            count += 1
        else:
            owner[count + 1] = i
            axis[count, 0] = 1.0
            axis[count, 1] = 0.0
            axis[count + 1, 0] = 0.0
            axis[count + 1, 1] = 1.0
            count += 2
        last[i] = count - 1
    if count == 0:
        return False
    width = 1
    for p in range(count):
        for e in range(springs.first[owner[p]], springs.first[owner[p] + 1]):
            width = max(width, last[springs.other[e]] - p + 1)
    matrix = np.zeros((count, width))
    right = np.empty(count)
    if m == 0:
        _assemble_discs(springs, friction, velocity, motion, spring, first, matrix, right)
    else:
        _assemble_polygons(
            springs, directions, corners, motion, spring, owner[:count], axis, first, last, matrix, right
        )
    solve_band_in_place(matrix, right)
    step = np.zeros((n, 2))
    for p in range(count):
        step[owner[p], 0] += right[p] * axis[p, 0]
        step[owner[p], 1] += right[p] * axis[p, 1]

    reach = 0.0
    longest = 0.0
    for i in range(n):
        reach = max(reach, magnitude[i] / diagonal(springs, i))
        if motion[i] != STUCK:
            reach = max(reach, math.hypot(velocity[i, 0], velocity[i, 1]))
            longest = max(longest, math.hypot(step[i, 0], step[i, 1]))
    if longest > 8.0 * reach:  # a free translation
        step *= 8.0 * reach / longest
    linear = 0.0
    quadratic = 0.0
    for i in range(n):
        if motion[i] == STUCK:
            continue
        linear -= spring[i, 0] * step[i, 0] + spring[i, 1] * step[i, 1]
        for e in range(springs.first[i], springs.first[i + 1]):
            j = springs.other[e]
            quadratic += springs.entry[e] * (step[i, 0] * step[j, 0] + step[i, 1] * step[j, 1])
    stopped = -1
    k = -1
    if m == 0:
        at, stopped = _search_discs(friction, linear, quadratic, velocity, step)
    else:
        at, stopped, k = _search_polygons(directions, friction, corners, linear, quadratic, velocity, step, motion)
    for i in range(n):
        if motion[i] == STUCK:
            continue
        velocity[i, 0] += at * step[i, 0]
        velocity[i, 1] += at * step[i, 1]
        for e in range(springs.first[i] + 1, springs.first[i + 1]):
            awake[springs.other[e]] = True
    if stopped < 0:
        return False
    along = 0.0
    if m > 0 and motion[stopped] > m:
        along = max(velocity[stopped, 0] * directions[k, 0] + velocity[stopped, 1] * directions[k, 1], 0.0)
    motion[stopped] = 1 + k if along > 0.0 else STUCK
    for c in range(2):
        velocity[stopped, c] = along * directions[k, c] if along > 0.0 else 0.0
    return True
