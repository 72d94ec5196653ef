"""Friction in the plane: the sets of admissible forces, and by how much a step misses the law of friction.

A set consists of four quarter ellipses in the frame of a link or of the ground (discs, where all four frictions are the
same), or it is a polygon {f : f . d_k <= mu_k} with directions d_k of the ground, see `polygon`.

In the frame of the axis of an ellipse, with the friction D of the quadrant, a force has the coordinates u = D^-1 s and
a displacement d = D w; friction balances the force if u lies in the unit disc, and u = d / |d| where the point slides,
that is, if u = P(u + rho d) with the projection P onto the unit disc. Nothing is singular where a displacement goes to
zero.
With the law along the velocity, d = w.
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled, entry, lean
from ...rounding import EPS
from .frame import friction_of, norm, span
from .polygon import gap_in, linearise_polygon, nearest_face, work_against

_CLOSE = 32.0 * EPS
"""Rounding error of a force, relative to the magnitude of its terms."""
ON_BOUNDARY = 1e-9
"""A force this close to the boundary of its set, relative to its size, is on it."""
SLACK = 4.0
"""A point sticks if it is beyond the boundary of its set by no more than so many rounding errors."""


@lean
def axis_of(frame, x, i):
    """Compute the axis of the friction of a point, and what turns it.

    Returns:
        Cosine and sine of its angle, and the derivative of the angle by the position of the second point of its guide,
        two components [rad/m]; that by the position of the first point is its negative.
    """
    if frame.guide[i, 0] == frame.guide[i, 1]:
        return 1.0, 0.0, 0.0, 0.0
    e0, e1 = span(frame, x, frame.guide[i, 0], frame.guide[i, 1])
    square = e0 * e0 + e1 * e1
    length = math.sqrt(square)
    ahead = math.cos(frame.offset[i]) / length
    left = math.sin(frame.offset[i]) / length
    return e0 * ahead - e1 * left, e1 * ahead + e0 * left, -e1 / square, e0 / square


@lean
def resistance(frame, command, x, i, v0, v1):
    """Compute the work against friction of a displacement of a point.

    Args:
        x: displacements, for the axis, shape (N, 2) [m].
        v0: its displacement along x [m].
        v1: its displacement along y [m].

    Returns:
        The work [J].
    """
    at, _, most = friction_of(frame, command, i)
    if most == 0.0 or (v0 == 0.0 and v1 == 0.0):
        return 0.0
    if frame.directions.shape[0] > 0:
        return work_against(frame, command, at, v0, v1)
    cos, sin, _, _ = axis_of(frame, x, i)
    w0 = cos * v0 + sin * v1
    w1 = cos * v1 - sin * v0
    along = command[at] if w0 >= 0.0 else command[at + 1]
    across = command[at + 2] if w1 >= 0.0 else command[at + 3]
    if frame.along_velocity:
        way = norm(w0, w1)
        return (along * w0 * w0 + across * w1 * w1) / way if way > 0.0 else 0.0
    return math.sqrt((along * w0) ** 2 + (across * w1) ** 2)


@entry
def resist_all(frame, command, x, moved):
    """Compute the work against friction of displacements of all points.

    Args:
        x: displacements, for the axes, shape (N, 2) [m].
        moved: shape (N, 2) [m].

    Returns:
        The work [J].
    """
    total = 0.0
    for i in range(moved.shape[0]):
        total += resistance(frame, command, x, i, moved[i, 0], moved[i, 1])
    return total


@lean
def load_part(frame, command, x, i, f0, f1):
    """Compute a force in the coordinates in which the admissible forces are the unit disc.

    Args:
        x: displacements, for the axis, shape (N, 2) [m].
        f0: the force along x [N].
        f1: the force along y [N].

    Returns:
        Its two coordinates [1]; both infinite on a point without friction.
    """
    at, _, most = friction_of(frame, command, i)
    if most == 0.0:
        return np.inf, np.inf
    cos, sin, _, _ = axis_of(frame, x, i)
    s0 = cos * f0 + sin * f1
    s1 = cos * f1 - sin * f0
    along = command[at] if s0 >= 0.0 else command[at + 1]
    across = command[at + 2] if s1 >= 0.0 else command[at + 3]
    return s0 / along, s1 / across


@lean
def gap_of(frame, command, x, i, force):
    """Compute how far a force is from the boundary of its set, along itself.

    Args:
        force: of all points, shape (N, 2) [N].

    Returns:
        The gap; without a force the least friction; of a polygon the distance from it; infinite on a point without
        friction [N].
    """
    if frame.directions.shape[0] > 0:
        at, _, most = friction_of(frame, command, i)
        return gap_in(frame, command, at, force[i, 0], force[i, 1]) if most > 0.0 else np.inf
    u0, u1 = load_part(frame, command, x, i, force[i, 0], force[i, 1])
    size = math.sqrt(u0 * u0 + u1 * u1)
    if size == 0.0:
        return friction_of(frame, command, i)[1]
    return (1.0 - size) * math.sqrt(force[i, 0] ** 2 + force[i, 1] ** 2) / size if size < np.inf else np.inf


@lean
def linearise(frame, command, x, base, force, size, rows):
    """Compute by how much each point misses the law of friction, and the derivatives of that.

    On ellipses the miss is u - P(u + rho d), see the beginning of this file: where u + rho d = z lies in the unit disc,
    it is -rho d, and the point sticks; elsewhere it is u - n with n = z / |z|, whose derivatives come from

        dn = (1 - n n^T) / |z| (du + rho dd).

    Args:
        base: displacements from which the points move, shape (N, 2) [m].
        force: from `pull`, shape (N, 2) [N].
        size: from `pull`, shape (N,) [N].
        rows: output, shape (N, 13): the miss, two entries [1]; its derivative by the force, four [1/N], and by the
            negative displacement, four [1/m]; its derivative by the angle of the axis, two [1/rad]; 1 if the point is
            free to move, 0 if it sticks.

    Returns:
        The largest miss relative to its rounding error, and the largest miss.
    """
    worst = largest = 0.0
    for i in range(x.shape[0]):
        at, least, most = friction_of(frame, command, i)
        row = rows[i]
        row[:] = 0.0
        if not abs(force[i, 0]) + abs(force[i, 1]) < np.inf:
            return np.inf, np.inf
        # no friction: the force itself is the miss
        if most == 0.0:
            scale = size[i] if size[i] > 0.0 else 1.0
            row[0] = force[i, 0] / scale
            row[1] = force[i, 1] / scale
            row[2] = row[5] = 1.0 / scale
            row[12] = 1.0
            miss = math.sqrt(row[0] * row[0] + row[1] * row[1])
            worst = max(worst, miss / _CLOSE)
            largest = max(largest, miss)
            continue
        if frame.directions.shape[0] > 0:
            rounding = 1.0 + (size[i] + frame.grip[i] * (abs(x[i, 0]) + abs(x[i, 1]))) / most
            moved = x[i, 0] - base[i, 0], x[i, 1] - base[i, 1]
            close = SLACK * _CLOSE * rounding
            miss = linearise_polygon(frame, command, i, at, force[i], moved, close, most, row)
            worst = max(worst, miss / (_CLOSE * rounding))
            largest = max(largest, miss)
            continue
        # force and displacement along the axes of the ellipse, in the quadrants of the force and of the displacement
        cos, sin, _, _ = axis_of(frame, x, i)
        v0 = x[i, 0] - base[i, 0]
        v1 = x[i, 1] - base[i, 1]
        s0 = cos * force[i, 0] + sin * force[i, 1]
        s1 = cos * force[i, 1] - sin * force[i, 0]
        w0 = cos * v0 + sin * v1
        w1 = cos * v1 - sin * v0
        mu0 = command[at] if s0 >= 0.0 else command[at + 1]
        mu1 = command[at + 2] if s1 >= 0.0 else command[at + 3]
        rho = frame.grip[i] / (least * most)
        r0 = rho * most
        r1 = r0
        if not frame.along_velocity:
            ahead = s0 >= 0.0 if w0 == 0.0 else w0 > 0.0  # a point starts along its force
            left = s1 >= 0.0 if w1 == 0.0 else w1 > 0.0
            r0 = rho * (command[at] if ahead else command[at + 1])
            r1 = rho * (command[at + 2] if left else command[at + 3])
        u0 = s0 / mu0
        u1 = s1 / mu1
        z0 = u0 + r0 * w0
        z1 = u1 + r1 * w1
        # it sticks
        length = math.sqrt(z0 * z0 + z1 * z1)
        rounding = _CLOSE * (1.0 + size[i] / least)
        if length <= 1.0 or (length <= 1.0 + SLACK * rounding and w0 == 0.0 and w1 == 0.0):
            row[0] = -r0 * w0
            row[1] = -r1 * w1
            miss = math.sqrt(row[0] * row[0] + row[1] * row[1])
            worst = max(worst, miss / rounding)
            largest = max(largest, miss)
            continue
        # it slides
        n0 = z0 / length
        n1 = z1 / length
        row[0] = u0 - n0
        row[1] = u1 - n1
        rounding += _CLOSE * max(r0, r1) * norm(x[i, 0], x[i, 1]) / length
        miss = math.sqrt(row[0] * row[0] + row[1] * row[1])
        worst = max(worst, miss / rounding)
        largest = max(largest, miss)
        # E = (1 - n n^T) / |z|: du counts with F = 1 - E, rho dd with -E
        e00 = n1 * n1 / length
        e01 = -n0 * n1 / length
        e11 = n0 * n0 / length
        f00 = 1.0 - e00
        f11 = 1.0 - e11
        row[2] = f00 * cos / mu0 + e01 * sin / mu1
        row[3] = f00 * sin / mu0 - e01 * cos / mu1
        row[4] = -e01 * cos / mu0 - f11 * sin / mu1
        row[5] = -e01 * sin / mu0 + f11 * cos / mu1
        row[6] = e00 * r0 * cos - e01 * r1 * sin
        row[7] = e00 * r0 * sin + e01 * r1 * cos
        row[8] = e01 * r0 * cos - e11 * r1 * sin
        row[9] = e01 * r0 * sin + e11 * r1 * cos
        # what turns the axis by an angle turns s and w by its negative
        u_by0 = s1 / mu0
        u_by1 = -s0 / mu1
        d_by0 = r0 * w1
        d_by1 = -r1 * w0
        row[10] = f00 * u_by0 - e01 * u_by1 - (e00 * d_by0 + e01 * d_by1)
        row[11] = -e01 * u_by0 + f11 * u_by1 - (e01 * d_by0 + e11 * d_by1)
        row[12] = 1.0
    return worst, largest


@compiled
def measure_margins(frame, command, x, force, margins):
    """Compute how far forces are from the boundaries of their sets, along themselves.

    Args:
        force: that friction balances, shape (N, 2) [N].
        margins: output, 0 on points without friction, shape (N,) [N].
    """
    for i in range(x.shape[0]):
        gap = gap_of(frame, command, x, i, force)
        margins[i] = gap if gap < np.inf else 0.0


@entry
def find_slip(frame, command, x, force, slip):
    """Find the directions in which points slide: normals of their sets at forces on the boundary, or little beyond.

    Args:
        force: that friction balances, shape (N, 2) [N].
        slip: output, of any length, shape (N, 2).
    """
    for i in range(x.shape[0]):
        at, least, _ = friction_of(frame, command, i)
        s0, s1 = force[i, 0], force[i, 1]
        if frame.directions.shape[0] > 0:
            _, p0, p1 = nearest_face(frame, command, at, s0, s1, 0.0)
            slip[i, 0], slip[i, 1] = s0 - p0, s1 - p1
        elif least == 0.0:
            slip[i, 0], slip[i, 1] = s0, s1
        else:
            cos, sin, _, _ = axis_of(frame, x, i)
            w0, w1 = load_part(frame, command, x, i, s0, s1)
            if not frame.along_velocity:
                w0 /= command[at] if w0 >= 0.0 else command[at + 1]
                w1 /= command[at + 2] if w1 >= 0.0 else command[at + 3]
            slip[i, 0], slip[i, 1] = cos * w0 - sin * w1, sin * w0 + cos * w1
