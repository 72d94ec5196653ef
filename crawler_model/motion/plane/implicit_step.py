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
from ...rounding import EPS
from .friction import CLOSE_ENOUGH, STUCK, corners_of, excess, largest, resistance
from .newton import take_newton_step
from .springs import diagonal
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
        if motion[i] == STUCK and velocity[i, 0] == 0.0 and velocity[i, 1] == 0.0 and size < np.inf:
            awake[i] = False
            spring[i, 0] = q0
            spring[i, 1] = q1
            continue
        velocity[i, 0] = e0 / diagonal(springs, i)
        velocity[i, 1] = e1 / diagonal(springs, i)
        for e in range(springs.first[i] + 1, springs.first[i + 1]):
            awake[springs.other[e]] = True


@lean
def _distance(g0, g1, v0, v1, speed, mu, directions, corners, motion):
    """Compute the distance of the spring force g from dR(v)."""
    m = directions.shape[0]
    if motion == STUCK:
        _, e0, e1 = excess(g0, g1, mu, directions, corners, 0.0)
        return math.hypot(e0, e1)
    if m == 0:
        return math.hypot(g0 - mu[0] * v0 / speed, g1 - mu[0] * v1 / speed) if speed > 0.0 else abs(mu[0])
    if motion > m:
        corner = corners[motion - 1 - m]
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
        speed = math.hypot(v0, v1) if motion[i] != STUCK else 0.0
        push = diagonal(springs, i) * speed
        size = magnitude[i] + push
        if motion[i] != STUCK and directions.shape[0] == 0 and push > 0.0:
            size *= 1.0 + 4.0 * EPS / CLOSE_ENOUGH * friction[i, 0] / push
        gap = _distance(g0, g1, v0, v1, speed, friction[i], directions, corners[i], motion[i])
        if not gap + size <= np.inf:
            return np.inf
        if gap > worst * size:
            worst = gap / size
    return worst


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
            if not take_newton_step(springs, *rules, *state):
                blocked = 1
            blocked -= 1
            residual = _residual(springs, force, *rules, *state)
        solved = residual <= CLOSE_ENOUGH
    unique = True
    if solved and springs.tied.size == 0:
        unique = choose_translation(velocity, spring, friction, directions, magnitude, motion)
    return solved, residual, unique, sweeps
