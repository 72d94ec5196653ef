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

from ...compiled import compiled
from ...rounding import CRITICAL, EPS
from .friction import resistance
from .implicit_step import solve_in_place

BAND = 1e-11
"""A force is on the boundary if it is no farther from it than this part of the magnitude of its terms."""
_TURNS = 1e-9
"""A force that leaves the boundary of its disc tangentially within this part of its rate is taken not to return."""


@compiled
def _normals_at(spring, friction, growth, directions, band, normals, owner, rise):
    """Write the outer normals of all friction sets at the spring forces, their contacts and the growth rates of mu.

    A disc without friction counts as a square. Returns the number of normals.
    """
    n = spring.shape[0]
    m = directions.shape[0]
    count = 0
    for i in range(n):
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
def _slide(laplacian, push, normals, owner, rise, count, velocity):
    """Solve for lambda >= 0 with the active set of Lawson and Hanson; write the resulting velocities."""
    matrix = np.empty((count, count))
    right = np.empty(count)
    size = np.empty(count)
    for a in range(count):
        i = owner[a]
        for b in range(count):
            along = normals[a, 0] * normals[b, 0] + normals[a, 1] * normals[b, 1]
            matrix[a, b] = laplacian[i, owner[b]] * along
        matrix[a, a] += CRITICAL * laplacian[i, i]  # normals of a contact, or a translation, may be linearly dependent
        right[a] = push[i, 0] * normals[a, 0] + push[i, 1] * normals[a, 1] - rise[a]
        size[a] = abs(push[i, 0]) + abs(push[i, 1]) + abs(rise[a])
    rate = np.zeros(count)
    chosen = right > CRITICAL * size
    for _ in range(4 * count + 4):
        while chosen.any():
            active = np.flatnonzero(chosen)
            small = np.empty((active.size, active.size))
            goal = np.empty(active.size)
            for p in range(active.size):
                goal[p] = right[active[p]]
                for q in range(active.size):
                    small[p, q] = matrix[active[p], active[q]]
            solve_in_place(small, goal)
            reach = 1.0
            for p in range(active.size):
                if goal[p] <= 0.0:
                    reach = min(reach, rate[active[p]] / (rate[active[p]] - goal[p]) if rate[active[p]] > 0.0 else 0.0)
            blocked = False
            for p in range(active.size):
                a = active[p]
                back = goal[p] <= 0.0 and (rate[a] <= 0.0 or rate[a] / (rate[a] - goal[p]) <= reach * (1.0 + 4.0 * EPS))
                rate[a] = 0.0 if back else rate[a] + reach * (goal[p] - rate[a])
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
            for b in range(count):
                pull -= matrix[a, b] * rate[b]
                scale += abs(matrix[a, b]) * rate[b]
            if pull > CRITICAL * scale and pull > most:
                most = pull
                enters = a
        if enters < 0:
            break
        chosen[enters] = True
    for a in range(count):
        velocity[owner[a], 0] += rate[a] * normals[a, 0]
        velocity[owner[a], 1] += rate[a] * normals[a, 1]


@compiled
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
def find_rates(laplacian, spring, push, friction, growth, directions, band, velocity):
    """Solve for the velocities at an instant, and how long they remain valid on straight paths.

    Args:
        laplacian: K, shape (n, n) [N/m].
        spring: spring forces, shape (n, 2) [N].
        push: rates of the spring forces at rest, shape (n, 2) [N per unit of the ramp].
        friction: mu, shape (n, 1) for isotropic friction, else (n, m) [N].
        growth: rates of mu, in the same shape [N per unit of the ramp].
        directions: unit vectors d_k, counterclockwise, shape (m, 2); m = 0 for isotropic friction.
        band: forces this close to the boundary count as on it, shape (n,) [N].
        velocity: output, shape (n, 2) [m per unit of the ramp].

    Returns:
        Part of the ramp after which a contact reaches a bound, infinite if none does.
    """
    n = spring.shape[0]
    m = directions.shape[0]
    most = n * max(m, 4)
    normals = np.empty((most, 2))
    owner = np.empty(most, np.int64)
    rise = np.empty(most)
    velocity[:] = 0.0
    count = _normals_at(spring, friction, growth, directions, band, normals, owner, rise)
    if count > 0:
        _slide(laplacian, push, normals, owner, rise, count, velocity)
    first = np.inf
    for i in range(n):
        rate0 = push[i, 0]
        rate1 = push[i, 1]
        for j in range(n):
            rate0 -= laplacian[i, j] * velocity[j, 0]
            rate1 -= laplacian[i, j] * velocity[j, 1]
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


@compiled
def greatest_compliance(laplacian):
    """Compute a bound on the compliance between any two contacts, by inverting K with contact 0 held.

    Args:
        laplacian: K, shape (n, n) [N/m].

    Returns:
        Largest relative displacement of two contacts per force between them [m/N].
    """
    n = laplacian.shape[0] - 1
    inverse = laplacian[1:, 1:].copy()
    for p in range(n):  # Gauss-Jordan, in place
        pivot = 1.0 / inverse[p, p]
        inverse[p, p] = 1.0
        for c in range(n):
            inverse[p, c] *= pivot
        for i in range(n):
            if i != p:
                factor = inverse[i, p]
                inverse[i, p] = 0.0
                for c in range(n):
                    inverse[i, c] -= factor * inverse[p, c]
    most = 0.0
    second = 0.0
    for i in range(n):
        if inverse[i, i] > most:
            second = most
            most = inverse[i, i]
        else:
            second = max(second, inverse[i, i])
    return most + second


@compiled
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
