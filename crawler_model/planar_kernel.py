"""One implicit step of a crawler in the plane.

Contact i is displaced by x_i in R^2. Link s from contact a to contact b is a spring that sees rotations, with the
commanded vector L_s as its rest length:

    T_s = k_s (x_b - x_a - L_s),    E = sum_s |T_s|^2 / (2 k_s),    g_i = sum_{s from i} T_s - sum_{s to i} T_s.

Friction dissipates R_i(v): mu_i |v|, or, with shared directions d_1 .. d_m, linear between neighbouring directions
with the value mu_ik at d_k. Its forces fill C_i, a disc or the polygon {f : f . d_k <= mu_ik}; corner k of it joins
the edges of d_k and d_{k+1}. The evolution 0 in dR(x') + DE(x) says: g_i lies in C_i, x_i' is normal to it there.

An implicit step of displacement v, from spring forces r that the new L would cause on the old x, solves

    minimise  1/2 v . K v - r . v + sum_i R_i(v_i),    K the weighted Laplacian of the links.

A sweep over the contacts has a closed form, K_ii v_i = q_i - (nearest point of C_i to q_i) with
q_i = r_i - sum_{j != i} K_ij v_j. It finds who slides and how; Newton's method on the sliding contacts, searched along
its direction, does the rest. Both only lower a convex cost. What counts in the end is how far r - K v is from dR.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ._compiled import compiled
from .errors import SceneError
from .uniqueness import CRITICAL

EPS = float(np.finfo(np.float64).eps)
CLOSE_ENOUGH = 1e-13
"""A step is solved when no force is further from dR than this part of the numbers that it was summed from."""
MOST_SWEEPS = 300

STUCK = 0
"""A contact's motion: stuck; 1 sliding on a disc; 1 + k along direction k; 1 + m + k between k and k + 1."""


@compiled
def laplacian_of(ends, stiffness, contacts):
    """Build the weighted Laplacian K of the links.

    Args:
        ends: the contacts a, b of each link, int, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        contacts: number of contacts n.

    Returns:
        K, shape (n, n) [N/m]; the same for both coordinates.
    """
    laplacian = np.zeros((contacts, contacts))
    for s in range(ends.shape[0]):
        a = ends[s, 0]
        b = ends[s, 1]
        laplacian[a, a] += stiffness[s]
        laplacian[b, b] += stiffness[s]
        laplacian[a, b] -= stiffness[s]
        laplacian[b, a] -= stiffness[s]
    return laplacian


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


@compiled
def _sweep(laplacian, force, friction, directions, corners, backwards, velocity, motion, grain):
    """Let each contact in turn solve its own problem; `grain` gets the size of what its force is summed from."""
    n = force.shape[0]
    for j in range(n):
        i = n - 1 - j if backwards else j
        q0 = force[i, 0]
        q1 = force[i, 1]
        size = abs(q0) + abs(q1) + friction[i].max()
        for other in range(n):
            c = laplacian[i, other]
            if other != i and c != 0.0:
                q0 -= c * velocity[other, 0]
                q1 -= c * velocity[other, 1]
                size += abs(c) * (abs(velocity[other, 0]) + abs(velocity[other, 1]))
        grain[i] = size
        motion[i], e0, e1 = excess(q0, q1, friction[i], directions, corners[i], 8.0 * EPS * size)
        velocity[i, 0] = e0 / laplacian[i, i]
        velocity[i, 1] = e1 / laplacian[i, i]


@compiled
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


@compiled
def _residual(laplacian, force, friction, directions, corners, velocity, motion, grain, spring):
    """Compute the spring forces r - K v and their largest distance from dR(v), relative to their rounding.

    Rounding turns the direction of a slow velocity; what that does to its friction is not held against it.
    """
    n = force.shape[0]
    worst = 0.0
    for i in range(n):
        g0 = force[i, 0]
        g1 = force[i, 1]
        for j in range(n):
            g0 -= laplacian[i, j] * velocity[j, 0]
            g1 -= laplacian[i, j] * velocity[j, 1]
        spring[i, 0] = g0
        spring[i, 1] = g1
        v0 = velocity[i, 0]
        v1 = velocity[i, 1]
        push = laplacian[i, i] * math.hypot(v0, v1)
        size = grain[i] + push
        if motion[i] != STUCK and directions.shape[0] == 0 and push > 0.0:
            size *= 1.0 + 4.0 * EPS / CLOSE_ENOUGH * friction[i, 0] / push
        gap = _distance(g0, g1, v0, v1, friction[i], directions, corners[i], motion[i])
        if not gap <= np.inf:
            return np.inf
        if gap > worst * size:
            worst = gap / size
    return worst


@compiled
def _solve_in_place(matrix, right):
    """Solve a positive definite system by Cholesky's method; both arguments are overwritten."""
    n = right.shape[0]
    for j in range(n):
        root = math.sqrt(max(matrix[j, j], 1e-300))
        for c in range(j, n):
            matrix[j, c] /= root
        right[j] /= root
        for i in range(j + 1, n):
            factor = matrix[j, i]
            if factor != 0.0:
                for c in range(i, n):
                    matrix[i, c] -= factor * matrix[j, c]
                right[i] -= factor * right[j]
    for j in range(n - 1, -1, -1):
        total = right[j]
        for c in range(j + 1, n):
            total -= matrix[j, c] * right[c]
        right[j] = total / matrix[j, j]


@compiled
def _search_discs(friction, linear, quadratic, velocity, step):
    """Find how far to go along `step`, at most 1: until the slope of the cost is small or changes sign.

    Returns also the contact that is brought to rest by that, -1 if there is none.
    """
    low = 0.0
    high = 1.0
    at = 0.0
    first = 0.0
    for trial in range(60):
        slope = linear + at * quadratic
        for i in range(velocity.shape[0]):
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
    who = -1
    nearest = 1e-6
    for i in range(velocity.shape[0]):
        left = math.hypot(velocity[i, 0] + low * step[i, 0], velocity[i, 1] + low * step[i, 1])
        speed = math.hypot(velocity[i, 0], velocity[i, 1])
        if left < nearest * speed and friction[i, 0] > 0.0:
            nearest = left / speed
            who = i
    return low, who


@compiled
def _search_polygons(directions, friction, corners, linear, quadratic, velocity, step, motion):
    """Find how far to go along `step`, at most 1, to the least cost; its slope is a line with jumps.

    Returns also the contact whose jump ends the search and the direction it then stays on, -1 where there is none.
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
def _newton(laplacian, friction, directions, corners, velocity, motion, spring, grain):
    """Improve the velocities of the sliding contacts together, the others held; tell if a contact stopped that."""
    n = velocity.shape[0]
    m = directions.shape[0]
    owner = np.empty(2 * n, np.int64)
    axis = np.empty((2 * n, 2))
    count = 0
    for i in range(n):
        if motion[i] == STUCK:
            continue
        owner[count] = i
        if 1 <= motion[i] <= m:
            axis[count] = directions[motion[i] - 1]
            count += 1
            continue
        owner[count + 1] = i
        axis[count, 0] = 1.0
        axis[count, 1] = 0.0
        axis[count + 1, 0] = 0.0
        axis[count + 1, 1] = 1.0
        count += 2
    if count == 0:
        return False
    matrix = np.empty((count, count))
    right = np.empty(count)
    for p in range(count):
        i = owner[p]
        v0 = velocity[i, 0]
        v1 = velocity[i, 1]
        speed = math.hypot(v0, v1)
        for c in range(p, count):
            j = owner[c]
            along = axis[p, 0] * axis[c, 0] + axis[p, 1] * axis[c, 1]
            matrix[p, c] = laplacian[i, j] * along
            if i == j and m == 0 and speed > 0.0:
                turn = axis[p, 1] * v0 - axis[p, 0] * v1
                matrix[p, c] += friction[i, 0] / speed * (turn / speed) * ((axis[c, 1] * v0 - axis[c, 0] * v1) / speed)
        matrix[p, p] += CRITICAL * laplacian[i, i]  # a translation may be free when all slide
        if m == 0:
            pull0 = spring[i, 0] - (friction[i, 0] * v0 / speed if speed > 0.0 else 0.0)
            pull1 = spring[i, 1] - (friction[i, 0] * v1 / speed if speed > 0.0 else 0.0)
        else:
            corner = corners[i, (motion[i] - 1) % m]
            pull0 = spring[i, 0] - corner[0]
            pull1 = spring[i, 1] - corner[1]
        right[p] = pull0 * axis[p, 0] + pull1 * axis[p, 1]
    _solve_in_place(matrix, right)
    step = np.zeros((n, 2))
    for p in range(count):
        step[owner[p], 0] += right[p] * axis[p, 0]
        step[owner[p], 1] += right[p] * axis[p, 1]

    reach = 0.0
    longest = 0.0
    for i in range(n):
        reach = max(reach, math.hypot(velocity[i, 0], velocity[i, 1]), grain[i] / laplacian[i, i])
        longest = max(longest, math.hypot(step[i, 0], step[i, 1]))
    if longest > 8.0 * reach:  # a free translation
        step *= 8.0 * reach / longest
    linear = 0.0
    quadratic = 0.0
    for i in range(n):
        linear -= spring[i, 0] * step[i, 0] + spring[i, 1] * step[i, 1]
        for j in range(n):
            quadratic += laplacian[i, j] * (step[i, 0] * step[j, 0] + step[i, 1] * step[j, 1])
    who = -1
    k = -1
    if m == 0:
        at, who = _search_discs(friction, linear, quadratic, velocity, step)
    else:
        at, who, k = _search_polygons(directions, friction, corners, linear, quadratic, velocity, step, motion)
    for i in range(n):
        velocity[i, 0] += at * step[i, 0]
        velocity[i, 1] += at * step[i, 1]
    if who < 0:
        return False
    along = 0.0
    if m > 0 and motion[who] > m:
        along = max(velocity[who, 0] * directions[k, 0] + velocity[who, 1] * directions[k, 1], 0.0)
    motion[who] = 1 + k if along > 0.0 else STUCK
    for c in range(2):
        velocity[who, c] = along * directions[k, c] if along > 0.0 else 0.0
    return True


@compiled
def _normal_cones(velocity, spring, friction, directions, grain, normals, offsets):
    """Write the translations t that keep every v_i + t normal to C_i at g_i as half-planes normals . t >= offsets.

    Returns their number, or -1 where a contact inside its C_i fixes the translation, or two do together.
    """
    n = velocity.shape[0]
    m = directions.shape[0]
    count = 0
    ray = np.zeros(2)
    for i in range(n):
        size = friction[i].max()
        close = CRITICAL * size + 2.0 * CLOSE_ENOUGH * grain[i]
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
                    if j == last or a0 * b1 - a1 * b0 <= 8.0 * EPS:  # nothing for half a turn from a to b
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
def _choose_translation(velocity, spring, friction, directions, grain, motion):
    """Add the translation that brings the mean nearest to zero at no cost; tell if there was no choice."""
    n = velocity.shape[0]
    size = 0.0
    goal0 = 0.0
    goal1 = 0.0
    for i in range(n):
        size = max(size, math.hypot(velocity[i, 0], velocity[i, 1]))
        goal0 -= velocity[i, 0] / n
        goal1 -= velocity[i, 1] / n
    if size == 0.0:
        return True
    normals = np.empty((6 * n, 2))
    offsets = np.empty(6 * n)
    count = _normal_cones(velocity, spring, friction, directions, grain, normals, offsets)
    if count < 0:
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
    for c in range(count):  # the nearest point on each edge
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


@compiled
def project_planar(laplacian, force, friction, directions, most_sweeps, velocity, motion):
    """Solve one implicit step: minimise 1/2 v . K v - r . v + sum_i R_i(v_i).

    Args:
        laplacian: K, shape (n, n) [N/m].
        force: r, the spring forces at v = 0, shape (n, 2) [N].
        friction: mu, shape (n, 1) for isotropic friction, else (n, m) [N].
        directions: unit vectors d_k, counterclockwise, shape (m, 2); m = 0 for isotropic friction.
        most_sweeps: when to give up.
        velocity: v, shape (n, 2) [m], changed in place; what it holds is where the search starts.
        motion: output, int64, shape (n,): `STUCK`, or how the contact slides.

    Returns:
        Whether the step was solved to rounding; the largest distance of r - K v from dR(v), relative to what it was
        summed from; whether the minimiser is unique (if not: the one whose mean is nearest to zero); sweeps made.
    """
    n = force.shape[0]
    corners = corners_of(friction, directions)
    grain = np.empty(n)
    spring = np.empty((n, 2))
    residual = np.inf
    sweeps = 0
    solved = False
    while sweeps < most_sweeps and not solved:
        _sweep(laplacian, force, friction, directions, corners, sweeps % 2 == 1, velocity, motion, grain)
        sweeps += 1
        residual = _residual(laplacian, force, friction, directions, corners, velocity, motion, grain, spring)
        blocked = 2 * n
        while residual > CLOSE_ENOUGH and blocked > 0:
            if not _newton(laplacian, friction, directions, corners, velocity, motion, spring, grain):
                blocked = 1
            blocked -= 1
            residual = _residual(laplacian, force, friction, directions, corners, velocity, motion, grain, spring)
        solved = residual <= CLOSE_ENOUGH
    unique = not solved or _choose_translation(velocity, spring, friction, directions, grain, motion)
    return solved, residual, unique, sweeps


def solve_with_clarabel(laplacian: np.ndarray, force: np.ndarray, friction: np.ndarray, directions: np.ndarray):
    """Solve the problem of `project_planar` as a second-order-cone program, by interior points.

    Args:
        laplacian: K, shape (n, n) [N/m].
        force: r, the spring forces at v = 0, shape (n, 2) [N].
        friction: mu, shape (n, 1) for isotropic friction, else (n, m) [N].
        directions: unit vectors d_k, shape (m, 2); m = 0 for isotropic friction.

    Returns:
        v, shape (n, 2) [m]: to about 1e-8 of its size, contacts at rest included.
    """
    import clarabel
    from scipy import sparse

    n, m = force.shape[0], directions.shape[0]
    newton = max(np.abs(force).max(), friction.max())
    metre = newton / np.diag(laplacian).max()
    if newton == 0.0:
        return np.zeros((n, 2))
    scaled = np.diag(laplacian).max()
    quadratic = sparse.block_diag((np.kron(laplacian / scaled, np.eye(2)), np.zeros((n, n))), format="csc")
    linear = np.concatenate((-force.ravel() / newton, np.zeros(n)))  # unknowns v_i, then t_i = R_i(v_i)
    if m == 0:
        linear[2 * n :] = friction[:, 0] / newton
        rows = sparse.lil_array((3 * n, 3 * n))
        for i in range(n):
            rows[3 * i, 2 * n + i] = rows[3 * i + 1, 2 * i] = rows[3 * i + 2, 2 * i + 1] = -1.0
            if friction[i, 0] == 0.0:
                linear[2 * n + i] = 0.0
                rows[3 * i + 1, 2 * i] = rows[3 * i + 2, 2 * i + 1] = 0.0
        cones = [clarabel.SecondOrderConeT(3)] * n
    else:
        linear[2 * n :] = 1.0
        corners = corners_of(friction, directions) / newton
        rows = sparse.lil_array((m * n, 3 * n))
        for i in range(n):
            rows[m * i : m * (i + 1), 2 * i : 2 * i + 2] = corners[i]
            rows[m * i : m * (i + 1), [2 * n + i]] = -np.ones((m, 1))
        cones = [clarabel.NonnegativeConeT(m * n)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-13
    matrix = rows.tocsc()
    answer = clarabel.DefaultSolver(
        sparse.triu(quadratic).tocsc(), linear, matrix, np.zeros(matrix.shape[0]), cones, settings
    )
    return np.asarray(answer.solve().x)[: 2 * n].reshape(n, 2) * metre


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
