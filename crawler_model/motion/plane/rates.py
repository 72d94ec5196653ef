"""The velocities of a body in the plane at an instant of a ramp, and the time at which a contact reaches its bound.

A force on the boundary of C_i restrains its contact along the outer normals d_a there: one for a disc, those of the
adjacent edges for a polygon. The contact slides along them, x_i' = sum_a lambda_a d_a, lambda_a >= 0, and with
the rate g_i' of its spring force

    g_i' . d_a <= mu_a',    with equality where lambda_a > 0:

a linear complementarity problem, equivalent to least squares with lambda >= 0. While normals and sliding contacts stay
the same, paths are straight: always between events for polygons, and for discs as long as no direction changes.
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled, entry, lean
from ...rounding import CRITICAL, EPS
from .friction import resistance
from .springs import diagonal, solve_band_in_place

BAND = 1e-11
"""A force is on the boundary if it is no farther from it than this part of the magnitude of its terms."""
_TOGETHER = 8
"""Rounds in which all contacts that are pulled begin to slide together; then one at a time, which surely ends."""
_TURNS = 1e-9
"""A force that leaves the boundary of its disc tangentially within this part of its rate is taken not to return."""


@compiled
def _normals_at(order, spring, friction, growth, directions, band, normals, owner, rise):
    """Write the outer normals of all friction sets at the spring forces, their contacts and the growth rates of mu.

    A disc without friction counts as a square. Returns the number of normals.
    """
    m = directions.shape[0]
    count = 0
    for i in order:
        if m == 0:
            size = math.hypot(spring[i, 0], spring[i, 1])
            slippery = friction[i, 0] <= band[i]
            if not slippery and size < friction[i, 0] - band[i]:
                continue
            for k in range(4 if slippery else 1):
                normals[count, 0] = (1.0 - k if k % 2 == 0 else 0.0) if slippery else spring[i, 0] / size
                normals[count, 1] = (2.0 - k if k % 2 == 1 else 0.0) if slippery else spring[i, 1] / size
                owner[count] = i
                rise[count] = growth[i, 0]
                count += 1
            continue
        for k in range(m):
            if spring[i, 0] * directions[k, 0] + spring[i, 1] * directions[k, 1] >= friction[i, k] - band[i]:
                normals[count] = directions[k]
                owner[count] = i
                rise[count] = growth[i, k]
                count += 1
    return count


@compiled
def _slide_alone(springs, normals, owner, first, last, chosen, right):
    """Solve for the speeds along the chosen normals, as if the contacts slid along no others; zero for the others.

    `first` and `last` are those of the normals of each contact.
    """
    count = owner.shape[0]
    place = np.empty(count, np.int64)
    active = 0
    for a in range(count):
        place[a] = active
        active += chosen[a]
    width = 1
    for a in range(count):
        if chosen[a]:
            for e in range(springs.first[owner[a]], springs.first[owner[a] + 1]):
                b = last[springs.other[e]]
                while b > a and not chosen[b]:
                    b -= 1
                width = max(width, place[b] - place[a] + 1 if b > a else 1)
    matrix = np.zeros((active, width))
    goal = np.empty(active)
    for a in range(count):
        if not chosen[a]:
            continue
        goal[place[a]] = right[a]
        for e in range(springs.first[owner[a]], springs.first[owner[a] + 1]):
            j = springs.other[e]
            for b in range(max(first[j], a), last[j] + 1):
                if chosen[b]:
                    along = normals[a, 0] * normals[b, 0] + normals[a, 1] * normals[b, 1]
                    matrix[place[a], place[b] - place[a]] = springs.entry[e] * along
        matrix[place[a], 0] += CRITICAL * diagonal(springs, owner[a])  # normals, or a translation, may be dependent
    solve_band_in_place(matrix, goal)
    speed = np.zeros(count)
    for a in range(count):
        if chosen[a]:
            speed[a] = goal[place[a]]
    return speed


@compiled
def _slide(springs, push, normals, owner, rise, velocity):
    """Solve for lambda >= 0 with the active set of Lawson and Hanson; write the resulting velocities.

    Lawson and Hanson add one variable at a time, which takes as many rounds as contacts begin to slide along the body.
    Therefore all contacts that are pulled begin to slide together in the first rounds, and before them those that slid
    at the instant before, in `velocity`.
    """
    count = owner.shape[0]
    first = np.full(push.shape[0], 0)
    last = np.full(push.shape[0], -1)
    right = np.empty(count)
    size = np.empty(count)
    chosen = np.empty(count, np.bool_)
    for a in range(count):
        i = owner[a]
        if last[i] < 0:
            first[i] = a
        last[i] = a
        right[a] = push[i, 0] * normals[a, 0] + push[i, 1] * normals[a, 1] - rise[a]
        size[a] = abs(push[i, 0]) + abs(push[i, 1]) + abs(rise[a])
        slid = velocity[i, 0] * normals[a, 0] + velocity[i, 1] * normals[a, 1] > 0.0
        chosen[a] = slid or right[a] > CRITICAL * size[a]
    rate = np.zeros(count)
    velocity[:] = 0.0
    for turn in range(4 * count + 4 + _TOGETHER):
        while chosen.any():
            goal = _slide_alone(springs, normals, owner, first, last, chosen, right)
            reach = 1.0
            for a in range(count):
                if chosen[a] and goal[a] <= 0.0:
                    reach = min(reach, rate[a] / (rate[a] - goal[a]) if rate[a] > 0.0 else 0.0)
            blocked = False
            for a in range(count):
                if not chosen[a]:
                    continue
                back = goal[a] <= 0.0 and (rate[a] <= 0.0 or rate[a] / (rate[a] - goal[a]) <= reach * (1.0 + 4.0 * EPS))
                rate[a] = 0.0 if back else rate[a] + reach * (goal[a] - rate[a])
                chosen[a] = not back
                blocked = blocked or back
            if not blocked:
                break
        most = 0.0
        enters = -1
        for a in range(count):
            if chosen[a]:
                continue
            pull = right[a]
            scale = size[a]
            for e in range(springs.first[owner[a]], springs.first[owner[a] + 1]):
                j = springs.other[e]
                for b in range(first[j], last[j] + 1):
                    along = normals[a, 0] * normals[b, 0] + normals[a, 1] * normals[b, 1]
                    pull -= springs.entry[e] * along * rate[b]
                    scale += abs(springs.entry[e] * along) * rate[b]
            if pull > CRITICAL * scale and pull > most:
                enters = a
                if turn < _TOGETHER:
                    chosen[a] = True
                else:
                    most = pull
        if enters < 0:
            break
        chosen[enters] = True
    for a in range(count):
        velocity[owner[a], 0] += rate[a] * normals[a, 0]
        velocity[owner[a], 1] += rate[a] * normals[a, 1]


@lean
def _reaches_disc(g0, g1, rate0, rate1, mu, growth, band, sliding):
    """Compute when a force that changes linearly reaches the boundary of its disc."""
    size = math.hypot(g0, g1)
    outwards = g0 * rate0 + g1 * rate1 - mu * growth
    bend = rate0 * rate0 + rate1 * rate1 - growth * growth
    if size >= mu - band:  # on the boundary: it may return after a chord
        speed = math.sqrt(max(bend, 0.0))
        if sliding or mu <= band or bend <= 0.0 or outwards >= -_TURNS * mu * speed:
            return np.inf
        return -2.0 * outwards / bend
    inside = (mu - size) * (mu + size)
    under = outwards * outwards + bend * inside
    if under < 0.0:
        return np.inf
    bottom = outwards + math.sqrt(under)
    return inside / bottom if bottom > 0.0 else np.inf


@compiled
def find_rates(springs, spring, push, friction, growth, directions, band, velocity):
    """Solve for the velocities at an instant, and how long they remain valid on straight paths.

    Args:
        springs: the springs, with K, as in `Springs`.
        spring: spring forces, shape (n, 2) [N].
        push: rates of the spring forces at rest, shape (n, 2) [N per unit of the ramp].
        friction: mu, shape (n, 1) for isotropic friction, else (n, m) [N].
        growth: rates of mu, in the same shape [N per unit of the ramp].
        directions: unit vectors d_k, counterclockwise, shape (m, 2); m = 0 for isotropic friction.
        band: forces this close to the boundary count as on it, shape (n,) [N].
        velocity: changed in place, shape (n, 2) [m per unit of the ramp]: the search starts with the contacts that
            slide on entry.

    Returns:
        Part of the ramp after which a contact reaches a bound, infinite if none does.
    """
    n = spring.shape[0]
    m = directions.shape[0]
    most = n * max(m, 4)
    normals = np.empty((most, 2))
    owner = np.empty(most, np.int64)
    rise = np.empty(most)
    count = _normals_at(springs.order, spring, friction, growth, directions, band, normals, owner, rise)
    _slide(springs, push, normals[:count], owner[:count], rise[:count], velocity)
    first = np.inf
    for i in range(n):
        rate0 = push[i, 0]
        rate1 = push[i, 1]
        for e in range(springs.first[i], springs.first[i + 1]):
            rate0 -= springs.entry[e] * velocity[springs.other[e], 0]
            rate1 -= springs.entry[e] * velocity[springs.other[e], 1]
        if m == 0:
            sliding = velocity[i, 0] != 0.0 or velocity[i, 1] != 0.0
            at = _reaches_disc(spring[i, 0], spring[i, 1], rate0, rate1, friction[i, 0], growth[i, 0], band[i], sliding)
            first = min(first, at)
            continue
        for k in range(m):
            gap = friction[i, k] - spring[i, 0] * directions[k, 0] - spring[i, 1] * directions[k, 1]
            closing = rate0 * directions[k, 0] + rate1 * directions[k, 1] - growth[i, k]
            if gap > band[i] and closing > 0.0:
                first = min(first, gap / closing)
    return first


@entry
def missed(moved, spring, friction, directions, corners, band, compliance):
    """Bound the error of an implicit step, taken as a straight path.

    While C_i changes linearly too, the path is exact if it is normal to C_i at its start, as it is at its end;
    otherwise the unbalanced energy bounds the distance to the exact path in the metric of K:

        1/2 e . K e <= 1/2 sum_i (R_i(v_i) - g_i . v_i),    R_i and g_i at the start.

    Args:
        moved: v, shape (n, 2) [m].
        spring: spring forces at the start, shape (n, 2) [N].
        friction: mu at the start, shape (n, 1) for isotropic friction, else (n, m) [N].
        directions: unit vectors d_k, shape (m, 2); m = 0 for isotropic friction.
        corners: corners of the polygons at the start, shape (n, m, 2) [N].
        band: forces this close to the boundary count as on it, shape (n,) [N].
        compliance: largest compliance between two contacts [m/N].

    Returns:
        The bound [m].
    """
    energy = 0.0
    for i in range(moved.shape[0]):
        speed = math.hypot(moved[i, 0], moved[i, 1])
        if speed == 0.0:
            continue
        v0 = moved[i, 0] / speed
        v1 = moved[i, 1] / speed
        along = spring[i, 0] * v0 + spring[i, 1] * v1
        if directions.shape[0] > 0:
            gap = resistance(friction[i], corners[i], v0, v1) - along
            energy += gap * speed if gap > band[i] else 0.0
            continue
        size = math.hypot(spring[i, 0], spring[i, 1])
        gap = friction[i, 0] - size
        gap = gap if gap > band[i] else 0.0
        if size > band[i]:  # |g| - g . v, without cancellation
            across = spring[i, 0] * v1 - spring[i, 1] * v0
            gap += across * across / (size + along) if along > 0.0 else size - along
        energy += gap * speed
    return math.sqrt(compliance * energy)
