"""Whether friction determines the translation in the plane, or how a body that turns moves, and the choice if not."""

from __future__ import annotations

import numpy as np

from ...compiled import entry, inner, lean
from ...rounding import CRITICAL, EPS
from .elastic import pull
from .frame import friction_of, norm, span
from .friction import gap_of

_CLOSE = 2e-13
"""Rounding error of a force, relative to the magnitude of its terms."""
_SAME_SHAPE = 1e-9
"""Steps that differ from a translation by no more than this part have the same shape."""
_SLOW, _FREE = 1e-3, 1e-10
"""A point that moves by less than this part of the longest way may have rested; and an eigenvalue below this part of
the others is none."""
_SURELY = 1e-6
"""A contact this far inside its set, relative to its friction, fixes the translation."""


@inner
def _normal_cones(frame, command, velocity, force, size, normals, offsets):
    """Write the translations t with every v_i + t normal to C_i at its force as half-planes normals . t >= offsets.

    Returns their number, or -1 if a contact inside its C_i, or two contacts together, fix the translation.
    """
    directions = frame.directions
    m = directions.shape[0]
    count = 0
    ray = np.zeros(2)
    for i in range(velocity.shape[0]):
        at, _, most = friction_of(frame, command, i)
        close = CRITICAL * most + _CLOSE * size[i]
        start = count
        single = False
        # a disc: rest inside of it, and one normal on its circle
        if m == 0:
            strength = norm(force[i, 0], force[i, 1])
            if most <= 0.0:
                continue
            if strength < most - close:
                return -1
            single = True
            d0 = force[i, 0] / strength
            d1 = force[i, 1] / strength
        # a polygon: a cone between the normals d_j of the two edges that meet at the force, or one normal on an edge
        else:
            first = -1
            last = -1
            for k in range(m + 1):
                j = k % m
                if k == m and first < 0:
                    return -1
                if k == m:
                    j = first
                elif force[i, 0] * directions[j, 0] + force[i, 1] * directions[j, 1] < command[at + j] - close:
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
        # v_i + t on one ray: two half-planes for its line and one for its direction; two rays that cross fix t
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


@inner
def choose_translation(frame, command, base, x, force):
    """Add to a step of vector springs the translation of equal cost that brings its mean nearest to zero.

    The cost sum_i R_i(v_i + t) - f_i . (v_i + t) is as low for every t with v_i + t normal to C_i at f_i: a convex
    polygon of translations, of which the point nearest to the negative mean of v is chosen.

    Args:
        command: the command at the end of the step.
        x: displacements at its end, shape (N, 2) [m], changed in place.
        force: force that friction balances at its end, shape (N, 2) [N].

    Returns:
        Whether the translation is unique.
    """
    n = x.shape[0]
    for i in range(n):
        most = friction_of(frame, command, i)[2]
        if most > 0.0 and gap_of(frame, command, x, i, force) > _SURELY * most:
            return True
    size = np.empty(n)
    pull(frame, command, x, force, size)
    velocity = np.empty((n, 2))
    for i in range(n):
        for c in range(2):
            velocity[i, c] = x[i, c] - base[i, c]
    normals = np.empty((6 * n, 2))
    offsets = np.empty(6 * n)
    count = _normal_cones(frame, command, velocity, force, size, normals, offsets)
    if count < 0:
        return True
    # the goal, and what is near but for rounding
    near = 0.0
    longest = 0.0
    goal0 = 0.0
    goal1 = 0.0
    for i in range(n):
        longest = max(longest, norm(velocity[i, 0], velocity[i, 1]))
        goal0 -= velocity[i, 0] / n
        goal1 -= velocity[i, 1] / n
        near = max(near, CRITICAL * longest + 4.0 * EPS * (abs(x[i, 0]) + abs(x[i, 1])))
    if longest <= near:
        return True
    # a goal inside of all half-planes is the answer; t = 0 is inside, whatever rounding makes of its offsets
    inside = True
    for c in range(count):
        if offsets[c] > -near:
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
        for o in range(count):  # the other half-planes leave a part of the edge
            rise = normals[o, 0] * u0 + normals[o, 1] * u1
            need = offsets[o] - (normals[o, 0] * p0 + normals[o, 1] * p1)
            if abs(rise) <= 10.0 * CRITICAL:
                if need > near:
                    least = np.inf
            elif rise > 0.0:
                least = max(least, need / rise)
            else:
                most = min(most, need / rise)
        if least == np.inf or most < least - near:
            continue
        if most - least > near:
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
        stays = norm(velocity[i, 0] + t0, velocity[i, 1] + t1) <= near
        x[i, 0] = base[i, 0] if stays else x[i, 0] + t0
        x[i, 1] = base[i, 1] if stays else x[i, 1] + t1
    return False


@entry
def is_held(frame, command, x, moved):
    """Determine whether friction determines how a body that turns moves as a whole.

    A point that rests holds the body in both directions, one that slides across its way: along it, its friction does
    not change. Where a translation or rotation of the body moves all points along their ways, it is free.

    Args:
        moved: the way of each point in a part of a ramp, shape (N, 2) [m].

    Returns:
        Whether it does.
    """
    n = x.shape[0]
    longest = 0.0
    size = 0.0
    for i in range(n):
        longest = max(longest, norm(moved[i, 0], moved[i, 1]))
        y0, y1 = span(frame, x, 0, i)
        size = max(size, norm(y0, y1))
    a = b = c = d = e = f = 0.0  # of the matrix [[a, b, c], [b, d, e], [c, e, f]], by which the points hold the body
    for i in range(n):
        if friction_of(frame, command, i)[2] <= 0.0:
            continue
        y0, y1 = span(frame, x, 0, i)
        way = norm(moved[i, 0], moved[i, 1])
        slides = way > _SLOW * longest
        for k in range(1 if slides else 2):
            r0 = -moved[i, 1] / way if slides else 1.0 - k  # a direction in which it is held
            r1 = moved[i, 0] / way if slides else 1.0 * k
            turn = (r1 * y0 - r0 * y1) / size
            a += r0 * r0
            b += r0 * r1
            c += r0 * turn
            d += r1 * r1
            e += r1 * turn
            f += turn * turn
    trace = a + d + f
    minors = (a * d - b * b) + (a * f - c * c) + (d * f - e * e)
    determinant = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    return minors > _FREE * trace * trace and determinant > _FREE * trace * minors


@lean
def stay(base, guess, x):
    """Undo the choice of a translation where it is undetermined only at the end of a straight step.

    Loads that change pass through forces at which friction balances; up to there the translation is the guess's.

    Args:
        guess: the step according to the velocities at its start, shape (N, 2) [m].
        x: displacements at its end, shape (N, 2) [m], changed in place.

    Returns:
        Whether the step and the guess differ only by a translation.
    """
    rests = 0
    longest = 0.0
    for i in range(x.shape[0]):
        longest = max(longest, norm(guess[i, 0], guess[i, 1]))
        if guess[i, 0] == 0.0 and guess[i, 1] == 0.0:
            rests = i
    shift0 = guess[rests, 0] - (x[rests, 0] - base[rests, 0])
    shift1 = guess[rests, 1] - (x[rests, 1] - base[rests, 1])
    for i in range(x.shape[0]):
        left0 = guess[i, 0] - (x[i, 0] - base[i, 0]) - shift0
        left1 = guess[i, 1] - (x[i, 1] - base[i, 1]) - shift1
        if norm(left0, left1) > _SAME_SHAPE * longest:
            return False
    for i in range(x.shape[0]):
        x[i, 0] += shift0
        x[i, 1] += shift1
    return True
