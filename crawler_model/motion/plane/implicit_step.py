"""One implicit step of a crawler in the plane.

Contact i is displaced by x_i in R^2. Link s from contact a to contact b is a spring whose energy depends on
rotations, with the commanded vector L_s as its rest length:

    T_s = k_s (x_b - x_a - L_s),    E = sum_s |T_s|^2 / (2 k_s),    g_i = sum_{s from i} T_s - sum_{s to i} T_s.

Friction dissipates R_i(v): mu_i |v|, or, with shared directions d_1 .. d_m, linear between neighbouring directions
with the value mu_ik at d_k. Its admissible forces form C_i, a disc or the polygon {f : f . d_k <= mu_ik}, whose corner
k joins the edges of d_k and d_{k+1}. The evolution 0 in dR(x') + DE(x) means that g_i lies in C_i and x_i' is normal to
C_i there.

An implicit step with displacement v, from the spring forces r of the new L at the old x, solves

    minimise  1/2 v . K v - r . v + sum_i R_i(v_i),    K the weighted Laplacian of the links.

A sweep over the contacts has a closed form, K_ii v_i = q_i - (nearest point of C_i to q_i) with
q_i = r_i - sum_{j != i} K_ij v_j. Sweeps find which contacts slide and how; Newton's method
with line search on the sliding contacts then converges quickly. Both only lower a convex cost. The stopping criterion
is the distance of r - K v from dR.
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled, lean
from ...rounding import CRITICAL, EPS
from .friction import CLOSE_ENOUGH, STUCK, corners_of, excess, largest, resistance
from .springs import diagonal, solve_band_in_place
from .translation import choose_translation

MOST_SWEEPS = 300


@lean
def _sweep(springs, force, friction, directions, corners, backwards, velocity, motion, magnitude, spring, awake):
    """Solve the problem of each contact in turn.

    A contact that its friction holds is asleep until the velocity of a neighbour changes.

    Args:
        springs: the springs, with K, as in `Springs`.
        force: r, shape (n, 2) [N].
        friction: mu, shape (n, max(m, 1)) [N].
        directions: unit vectors d_k, shape (m, 2).
        corners: corners of the polygons, shape (n, m, 2) [N].
        backwards: whether to begin with the last contact.
        velocity: changed in place, shape (n, 2) [m].
        motion: motion of each contact, changed in place, shape (n,).
        magnitude: sum of the absolute terms of the force on each contact, changed in place, shape (n,) [N].
        spring: r - K v of contacts that fall asleep, changed in place, shape (n, 2) [N].
        awake: the contacts to solve, changed in place, shape (n,).
    """
    n = force.shape[0]
    for j in range(n):
        i = n - 1 - j if backwards else j
        if not awake[i]:
            continue
        q0 = force[i, 0]
        q1 = force[i, 1]
        size = abs(q0) + abs(q1) + largest(friction[i])
        for e in range(springs.first[i] + 1, springs.first[i + 1]):
            c = springs.entry[e]
            other = springs.other[e]
            q0 -= c * velocity[other, 0]
            q1 -= c * velocity[other, 1]
            size += abs(c) * (abs(velocity[other, 0]) + abs(velocity[other, 1]))
        magnitude[i] = size
        motion[i], e0, e1 = excess(q0, q1, friction[i], directions, corners[i], 8.0 * EPS * size)
        if motion[i] == STUCK and velocity[i, 0] == 0.0 and velocity[i, 1] == 0.0:
            awake[i] = False
            spring[i, 0] = q0
            spring[i, 1] = q1
            continue
        velocity[i, 0] = e0 / diagonal(springs, i)
        velocity[i, 1] = e1 / diagonal(springs, i)
        for e in range(springs.first[i] + 1, springs.first[i + 1]):
            awake[springs.other[e]] = True


@lean
def _distance(g0, g1, v0, v1, mu, directions, corners, motion):
    """Compute the distance of the spring force g from dR(v)."""
    m = directions.shape[0]
    if motion == STUCK:
        _, e0, e1 = excess(g0, g1, mu, directions, corners, 0.0)
        return math.hypot(e0, e1)
    if m == 0:
        speed = math.hypot(v0, v1)
        return math.hypot(g0 - mu[0] * v0 / speed, g1 - mu[0] * v1 / speed) if speed > 0.0 else abs(mu[0])
    if motion > m:
        corner = corners[motion - 1 - m]
        speed = math.hypot(v0, v1)
        lacking = resistance(mu, corners, v0, v1) - (corner[0] * v0 + corner[1] * v1)  # > 0: v left the cone
        return math.hypot(g0 - corner[0], g1 - corner[1]) + (lacking / speed if speed > 0.0 else 0.0)
    k = motion - 1
    d0 = directions[k, 0]
    d1 = directions[k, 1]
    before = (corners[k - 1, 1] - g1) * d0 - (corners[k - 1, 0] - g0) * d1
    after = (g1 - corners[k, 1]) * d0 - (g0 - corners[k, 0]) * d1
    return math.hypot(g0 * d0 + g1 * d1 - mu[k], max(before, after, 0.0))


@lean
def _residual(springs, force, friction, directions, corners, velocity, motion, magnitude, spring, awake):
    """Compute the spring forces r - K v and their largest distance from dR(v), relative to their rounding.

    Friction holds the contacts that are asleep, and their forces have not changed.

    Rounding changes the direction of a slow velocity; the resulting change of its friction is tolerated.
    """
    n = force.shape[0]
    worst = 0.0
    for i in range(n):
        if not awake[i]:
            continue
        g0 = force[i, 0]
        g1 = force[i, 1]
        for e in range(springs.first[i], springs.first[i + 1]):
            g0 -= springs.entry[e] * velocity[springs.other[e], 0]
            g1 -= springs.entry[e] * velocity[springs.other[e], 1]
        spring[i, 0] = g0
        spring[i, 1] = g1
        v0 = velocity[i, 0]
        v1 = velocity[i, 1]
        push = diagonal(springs, i) * math.hypot(v0, v1)
        size = magnitude[i] + push
        if motion[i] != STUCK and directions.shape[0] == 0 and push > 0.0:
            size *= 1.0 + 4.0 * EPS / CLOSE_ENOUGH * friction[i, 0] / push
        gap = _distance(g0, g1, v0, v1, friction[i], directions, corners[i], motion[i])
        if not gap <= np.inf:
            return np.inf
        if gap > worst * size:
            worst = gap / size
    return worst


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
            length = math.hypot(step[i, 0], step[i, 1])
            v0 = velocity[i, 0] + at * step[i, 0]
            v1 = velocity[i, 1] + at * step[i, 1]
            speed = math.hypot(v0, v1)
            slope += friction[i, 0] * ((v0 * step[i, 0] + v1 * step[i, 1]) / speed if speed > 0.0 else length)
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
    nearest = 1e-6
    for i in range(velocity.shape[0]):
        if step[i, 0] == 0.0 and step[i, 1] == 0.0:
            continue
        left = math.hypot(velocity[i, 0] + low * step[i, 0], velocity[i, 1] + low * step[i, 1])
        speed = math.hypot(velocity[i, 0], velocity[i, 1])
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


@compiled
def _newton(springs, friction, directions, corners, velocity, motion, spring, magnitude, awake):
    """Take a Newton step for all sliding contacts, the others fixed; return whether a contact shortened it."""
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
    for p in range(count):
        i = owner[p]
        v0 = velocity[i, 0]
        v1 = velocity[i, 1]
        speed = math.hypot(v0, v1)
        for e in range(springs.first[i], springs.first[i + 1]):
            j = springs.other[e]
            for c in range(max(first[j], p), last[j] + 1):
                along = axis[p, 0] * axis[c, 0] + axis[p, 1] * axis[c, 1]
                matrix[p, c - p] = springs.entry[e] * along
                if i == j and m == 0 and speed > 0.0:
                    turn = (axis[p, 1] * v0 - axis[p, 0] * v1) / speed
                    matrix[p, c - p] += friction[i, 0] / speed * turn * ((axis[c, 1] * v0 - axis[c, 0] * v1) / speed)
        matrix[p, 0] += CRITICAL * diagonal(springs, i)  # a translation may be free if all contacts slide
        if m == 0:
            pull0 = spring[i, 0] - (friction[i, 0] * v0 / speed if speed > 0.0 else 0.0)
            pull1 = spring[i, 1] - (friction[i, 0] * v1 / speed if speed > 0.0 else 0.0)
        else:
            corner = corners[i, (motion[i] - 1) % m]
            pull0 = spring[i, 0] - corner[0]
            pull1 = spring[i, 1] - corner[1]
        right[p] = pull0 * axis[p, 0] + pull1 * axis[p, 1]
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


@compiled
def project_planar(springs, force, friction, directions, most_sweeps, velocity, motion):
    """Solve one implicit step: minimise 1/2 v . K v - r . v + sum_i R_i(v_i).

    Args:
        springs: the springs, with K, as in `Springs`.
        force: r, the spring forces at v = 0, shape (n, 2) [N].
        friction: mu, shape (n, 1) for isotropic friction, else (n, m) [N].
        directions: unit vectors d_k, counterclockwise, shape (m, 2); m = 0 for isotropic friction.
        most_sweeps: upper limit of sweeps.
        velocity: v, shape (n, 2) [m], changed in place; on entry the start of the search.
        motion: output, int64, shape (n,): motion of each contact, see `STUCK`.

    Returns:
        Whether the step was solved to rounding; the largest distance of r - K v from dR(v), relative to the magnitude
        of its terms; whether the minimiser is unique (if not, the one with mean nearest to zero is returned); number
        of sweeps.
    """
    n = force.shape[0]
    corners = corners_of(friction, directions)
    magnitude = np.empty(n)
    spring = np.empty((n, 2))
    awake = np.ones(n, np.bool_)
    rules = friction, directions, corners
    state = velocity, motion, magnitude, spring, awake
    residual = np.inf
    sweeps = 0
    solved = False
    while sweeps < most_sweeps and not solved:
        _sweep(springs, force, *rules, sweeps % 2 == 1, *state)
        sweeps += 1
        residual = _residual(springs, force, *rules, *state)
        blocked = 2 * n
        while residual > CLOSE_ENOUGH and blocked > 0:
            if not _newton(springs, *rules, velocity, motion, spring, magnitude, awake):
                blocked = 1
            blocked -= 1
            residual = _residual(springs, force, *rules, *state)
        solved = residual <= CLOSE_ENOUGH
    unique = not solved or choose_translation(velocity, spring, friction, directions, magnitude, motion)
    return solved, residual, unique, sweeps
