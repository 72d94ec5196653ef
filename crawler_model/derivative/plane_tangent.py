"""Derivatives of implicit steps in the plane, and of parts of ramps that are extrapolated from them.

At the end of an implicit step the miss of each point that moves is zero, see `motion.plane.friction`, and so is its
derivative: the places of the points change by the matrix of the Newton search that found them, with another right side.
A point that sticks takes the derivative of its place along. Derivatives are extrapolated as displacements are, because
they depend on the length of the steps in the same way; their error is known from the extrapolation, too.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiled import compiled, lean
from ..motion.plane.elastic import pull, stretch_link, stretch_vector, turn_joint
from ..motion.plane.frame import columns_of, friction_of
from ..motion.plane.friction import axis_of, linearise
from ..motion.plane.polygon import corner_of, nearest_face
from ..motion.plane.ramp import glance
from ..motion.plane.stage import find_step, solve_stage
from ..motion.plane.translation import choose_translation
from ..motion.plane.walk import command_at

_WALKS = 8
"""Largest number of walks that are extrapolated."""
_ENOUGH, _CONVERGING = 1e-11, 0.5
"""Another walk follows until derivatives change by no more than this part, as long as it reduces the change to this
part."""
_ALLOWED, _LEAST_LENGTH = 1e-9, 2.0**-12
"""A part is divided as long as its error is larger, down to this length relative to the part."""
_LEAST_SIZE = 1e-3
"""Derivatives are compared with the largest of their parameter, and at least with this [m per unit]."""


class Rates(NamedTuple):
    """Derivatives of what makes a body, with respect to P parameters.

    Attributes:
        stiffness: of the stiffnesses, as in a `Frame`, shape (K, P).
        rest: of the rest lengths and angles, shape (K, P).
        offset: of the angles of the axes of friction, shape (N, P).
    """

    stiffness: np.ndarray
    rest: np.ndarray
    offset: np.ndarray


class Course(NamedTuple):
    """A part of a ramp.

    Attributes:
        command: the command at its start, shape (C,).
        target: the command at the end of the ramp, shape (C,).
        d_command: derivatives of `command`, shape (C, P).
        d_target: derivatives of `target`, shape (C, P).
        part: the part of the way to the target that it takes.
    """

    command: np.ndarray
    target: np.ndarray
    d_command: np.ndarray
    d_target: np.ndarray
    part: float


@lean
def _stretch(frame, command, x, spring, slope):
    """Compute the tension of a link, of a component of a vector spring, or the torque of a joint."""
    links = frame.ends.shape[0]
    if frame.vector:
        return stretch_vector(frame, command, x, spring // 2, spring % 2)
    if spring < links:
        return stretch_link(frame, command, x, spring)[0]
    return turn_joint(frame, command, x, spring - links, slope)[0]


@lean
def _stretch_rate(frame, command, x, spring, rate, slope):
    """Compute how a length, a component of a length, or an angle changes with places that change by `rate`."""
    links = frame.ends.shape[0]
    if frame.vector:
        a, b = frame.ends[spring // 2]
        return rate[b, spring % 2] - rate[a, spring % 2]
    if spring < links:
        a, b = frame.ends[spring]
        _, _, e0, e1 = stretch_link(frame, command, x, spring)
        return e0 * (rate[b, 0] - rate[a, 0]) + e1 * (rate[b, 1] - rate[a, 1])
    turn_joint(frame, command, x, spring - links, slope)
    total = 0.0
    for k in range(3):
        i = frame.joints[spring - links, k]
        total += slope[2 * k] * rate[i, 0] + slope[2 * k + 1] * rate[i, 1]
    return total


@lean
def _add_force(frame, command, x, spring, tension, force):
    """Add the forces of a link, or of a component of a vector spring, on its points, were this its tension."""
    if frame.vector:
        a, b = frame.ends[spring // 2]
        force[a, spring % 2] += tension
        force[b, spring % 2] -= tension
        return
    a, b = frame.ends[spring]
    _, _, e0, e1 = stretch_link(frame, command, x, spring)
    force[a, 0] += tension * e0
    force[a, 1] += tension * e1
    force[b, 0] -= tension * e0
    force[b, 1] -= tension * e1


@compiled
def _force_rate(frame, rates, commands, x, p, force):
    """Compute how the force on each point changes with a parameter while no point moves, shape (N, 2)."""
    command, d_command = commands
    slope = np.empty(6)
    links = frame.ends.shape[0]
    loads = frame.stiffness.shape[0] + columns_of(frame) * x.shape[0]
    for i in range(x.shape[0]):
        for c in range(2):
            force[i, c] = d_command[loads + 2 * i + c, p] if loads < command.shape[0] else 0.0
    for k in range(frame.stiffness.shape[0]):
        stiffness = frame.stiffness[k]
        if rates.stiffness[k, p] == 0.0 and rates.rest[k, p] == 0.0 and d_command[k, p] == 0.0:
            continue
        change = rates.stiffness[k, p] * (_stretch(frame, command, x, k, slope) / stiffness)
        change -= stiffness * (rates.rest[k, p] + d_command[k, p])
        if frame.vector or k < links:
            _add_force(frame, command, x, k, change, force)
            continue
        for q in range(3):
            i = frame.joints[k - links, q]
            force[i, 0] -= change * slope[2 * q]
            force[i, 1] -= change * slope[2 * q + 1]


@lean
def _miss_rate(frame, commands, state, turn, i):
    """Compute how the miss of a point that moves changes with its friction and its axis, at fixed force and places.

    `commands` holds the command and its derivative, shape (C,), and `turn` is the derivative of the angle of the axis.
    """
    command, change = commands
    x, base, force, rows = state
    at, least, most = friction_of(frame, command, i)
    v0 = x[i, 0] - base[i, 0]
    v1 = x[i, 1] - base[i, 1]
    if frame.directions.shape[0] > 0:
        m = frame.directions.shape[0]
        r = frame.grip[i]
        face, _, _ = nearest_face(frame, command, at, force[i, 0] + r * v0, force[i, 1] + r * v1, 0.0)
        if face >= m:
            c0, c1 = corner_of(frame, change, at, face - m)
            return -c0 / most, -c1 / most
        along = change[at + max(face, 0)] / most
        return -along * frame.directions[face, 0], -along * frame.directions[face, 1]
    cos, sin, _, _ = axis_of(frame, x, i)
    s0 = cos * force[i, 0] + sin * force[i, 1]
    s1 = cos * force[i, 1] - sin * force[i, 0]
    w0 = cos * v0 + sin * v1
    w1 = cos * v1 - sin * v0
    ahead = at if s0 >= 0.0 else at + 1
    left = at + 2 if s1 >= 0.0 else at + 3
    u0 = s0 / command[ahead]
    u1 = s1 / command[left]
    du0 = -u0 * change[ahead] / command[ahead]
    du1 = -u1 * change[left] / command[left]
    rho = frame.grip[i] / (least * most)
    dz0 = du0
    dz1 = du1
    r0 = r1 = rho * most
    if not frame.along_velocity:
        ahead = ahead if w0 == 0.0 else at if w0 > 0.0 else at + 1
        left = left if w1 == 0.0 else at + 2 if w1 > 0.0 else at + 3
        r0 = rho * command[ahead]
        r1 = rho * command[left]
        dz0 += rho * change[ahead] * w0
        dz1 += rho * change[left] * w1
    z0 = u0 + r0 * w0
    z1 = u1 + r1 * w1
    length = math.hypot(z0, z1)
    across = (z0 * dz1 - z1 * dz0) / (length * length * length)
    return du0 + across * z1 + rows[i, 10] * turn, du1 - across * z0 + rows[i, 11] * turn


@compiled
def _differentiate_step(frame, rates, commands, base, x, place, rests):
    """Carry the derivatives of the places of all points through an implicit step.

    Args:
        frame: the body.
        rates: its derivatives.
        commands: the command at the end of the step, shape (C,), and its derivatives, shape (C, P).
        base: displacements at its start, shape (N, 2) [m].
        x: displacements at its end, shape (N, 2) [m].
        place: changed in place: derivatives of the places, shape (N, 2, P).
        rests: points that are taken to stick, shape (N,).
    """
    n, _, columns = place.shape
    force = np.empty((n, 2))
    change = np.empty((n, 2))
    step = np.empty((n, 2))
    rows = np.empty((n, 13))
    size = np.empty(n)
    pull(frame, commands[0], x, force, size)
    linearise(frame, commands[0], x, base, force, size, rows)
    for i in range(n):
        rows[i, 12] = 0.0 if rests[i] else rows[i, 12]
    column = np.empty(commands[0].shape[0])
    for p in range(columns):
        for k in range(column.shape[0]):
            column[k] = commands[1][k, p]
        _force_rate(frame, rates, commands, x, p, change)
        for i in range(n):
            d0 = step[i, 0] = place[i, 0, p]
            d1 = step[i, 1] = place[i, 1, p]
            row = rows[i]
            row[0] = row[1] = 0.0
            if row[12] == 0.0:
                continue
            if friction_of(frame, commands[0], i)[2] > 0.0:
                row[0], row[1] = _miss_rate(frame, (commands[0], column), (x, base, force, rows), rates.offset[i, p], i)
            row[0] += row[2] * change[i, 0] + row[3] * change[i, 1] + row[6] * d0 + row[7] * d1
            row[1] += row[4] * change[i, 0] + row[5] * change[i, 1] + row[8] * d0 + row[9] * d1
        find_step(frame, commands[0], x, rows, step, 0.0)
        for i in range(n):
            place[i, 0, p] = step[i, 0]
            place[i, 1, p] = step[i, 1]


@compiled
def _work_rate(frame, rates, before, after, x, place, work):
    """Add half the derivative of the work of the actuators while the command changes and no point moves, shape (P,).

    `before` and `after` hold the command, shape (C,), and its derivatives, shape (C, P).
    """
    n, _, columns = place.shape
    slope = np.empty(6)
    rate = np.empty((n, 2))
    for p in range(columns):
        for i in range(n):
            rate[i, 0] = place[i, 0, p]
            rate[i, 1] = place[i, 1, p]
        for k in range(frame.stiffness.shape[0]):
            change = after[0][k] - before[0][k]
            d_change = after[1][k, p] - before[1][k, p]
            if change == 0.0 and d_change == 0.0:
                continue
            stiffness = frame.stiffness[k]
            tension = _stretch(frame, before[0], x, k, slope)
            lengthens = _stretch_rate(frame, before[0], x, k, rate, slope) - rates.rest[k, p] - before[1][k, p]
            middle = tension - 0.5 * stiffness * change
            d_middle = rates.stiffness[k, p] * (middle / stiffness) + stiffness * (lengthens - 0.5 * d_change)
            work[p] -= 0.5 * (middle * d_change + d_middle * change)


@lean
def _command_on(course, part, now, d_now):
    """Interpolate the command on its way, and its derivatives."""
    command_at(course.command, course.target, part, now)
    for k in range(now.shape[0]):
        for p in range(d_now.shape[1]):
            d_now[k, p] = course.d_command[k, p] + part * (course.d_target[k, p] - course.d_command[k, p])


@lean
def _rows_of(n, columns):
    """Return where displacements, rates of derivatives, velocities and work begin, behind the derivatives of places."""
    many = 2 * n * columns
    return many, many + 2 * n, 2 * many + 2 * n, 2 * many + 4 * n


@compiled
def _differentiate_walk(frame, rates, course, pieces, start, found):
    """Take a part of a ramp in equal steps, with derivatives.

    `start` has displacements, a guess of what is gained, the derivatives of places, and which points rest; `found`, in
    rows as `_rows_of` lays them out, receives by how much derivatives and displacements change, in all and at the rate
    of the last step, and the derivatives of the work. Returns whether all steps were solved, and are unique.
    """
    x0, moved, place0, rests = start
    n, _, columns = place0.shape
    base = x0.copy()
    x = np.empty((n, 2))
    force = np.empty((n, 2))
    place = place0.copy()
    last_place = place0
    first_x, first_rate, first_velocity, first_work = _rows_of(n, columns)
    before = course.command.copy(), course.d_command.copy()
    now = np.empty(before[0].shape), np.empty(before[1].shape)
    work = found[first_work:]
    work[:] = 0.0
    unique = True
    for piece in range(pieces):
        _command_on(course, course.part * ((piece + 1) / pieces), now[0], now[1])
        for i in range(n):
            for c in range(2):
                guess = moved[i, c] / pieces if piece == 0 else x[i, c] - base[i, c]
                base[i, c] = base[i, c] if piece == 0 else x[i, c]
                x[i, c] = base[i, c] + guess
        solved, _ = solve_stage(frame, now[0], base, x, force, 0.0)
        if not solved:
            return False, unique
        if frame.vector and not choose_translation(frame, now[0], base, x, force):
            unique = False
        if piece == pieces - 1:
            last_place = place.copy()
        _work_rate(frame, rates, before, now, base, place, work)
        _differentiate_step(frame, rates, now, base, x, place, rests)
        _work_rate(frame, rates, before, now, x, place, work)
        before[0][:] = now[0]
        before[1][:] = now[1]
    for i in range(n):
        for c in range(2):
            at = 2 * i + c
            found[first_x + at] = x[i, c] - x0[i, c]
            found[first_velocity + at] = pieces * (x[i, c] - base[i, c])
            for p in range(columns):
                found[at * columns + p] = place[i, c, p] - place0[i, c, p]
                found[first_rate + at * columns + p] = pieces * (place[i, c, p] - last_place[i, c, p])
    return True, unique


@lean
def _extrapolate(table, newest, pieces, scale, compared):
    """Add a walk to the Aitken-Neville scheme in 1/steps.

    Returns by how much the first `compared` numbers change at most, relative to the scale of their column.
    """
    error = 0.0
    for i in range(newest.shape[0]):
        value = newest[i]
        before = value
        for column in range(pieces - 1):
            before = value
            value = before + (before - table[column, i]) * ((pieces - column - 1.0) / (column + 1.0))
            table[column, i] = before
        table[pieces - 1, i] = value
        newest[i] = value
        if i < compared:
            error = max(error, abs(value - before) / scale[i % scale.shape[0]])
    return error


@compiled
def _attempt(frame, rates, course, start, best):
    """Extrapolate walks over a part of a ramp; the arguments are those of `_differentiate_walk`.

    Returns the error of the derivatives relative to the largest of their parameter, infinite if no step was solved, and
    whether the displacement is unique.
    """
    n, _, columns = start[2].shape
    table = np.zeros((_WALKS, best.shape[0]))
    found = np.empty(best.shape[0])
    scale = np.full(columns, _LEAST_SIZE)
    for i in range(n):
        for c in range(2):
            for p in range(columns):
                scale[p] = max(scale[p], abs(start[2][i, c, p]))
    error = np.inf
    unique = True
    for pieces in range(1, _WALKS + 1):
        solved, also = _differentiate_walk(frame, rates, course, pieces, start, found)
        if not solved:
            break
        unique = unique and also
        last = error
        change = _extrapolate(table, found, pieces, scale, 2 * n * columns)
        if pieces == 1 or change <= last:
            best[:] = found
        if pieces > 1:
            error = min(change, last)
        if error <= _ENOUGH or (pieces > 2 and change > _CONVERGING * last):
            break
    return error, unique


@compiled
def differentiate_part(frame, rates, course, way, rests, tangent, d_work):
    """Carry derivatives through a part of a ramp, in shorter parts where they have kinks.

    A point that starts at its end moves in some walks by a rounding error and in others not at all; its derivative
    would jump in some of them. It must rest in all.

    Args:
        frame: the body.
        rates: its derivatives.
        course: the part.
        way: displacements at its start, and what is gained to its end; output: velocities at its end, per part, and
            by how much they decrease there, per part, shape (N, 2) [m].
        rests: points that do not slide, shape (N,).
        tangent: derivatives of the places of all points, changed in place; output: their rates at its end, per part,
            shape (N, 2, P).
        d_work: added to: derivatives of the work of the actuators, shape (P,).

    Returns:
        An estimate of the error of the derivatives relative to the largest of the same parameter, infinite if no step
        was solved; and whether the displacement is unique.
    """
    x0, moved, velocity, slowing = way
    place, rate = tangent
    n, _, columns = place.shape
    first_x, first_rate, first_velocity, first_work = _rows_of(n, columns)
    best = np.zeros(first_work + columns)
    base = np.empty((n, 2))
    force = np.empty((n, 2))
    x = x0.copy()
    guess = np.empty((n, 2))
    now = course.command.copy(), course.d_command.copy()
    total = 0.0
    unique = True
    done = 0.0
    length = 1.0
    while done < 1.0:
        length = min(length, 1.0 - done)
        for i in range(n):
            for c in range(2):
                guess[i, c] = length * moved[i, c]
        part = course.part * length / (1.0 - course.part * done)
        sub = Course(
            now[0], course.target, now[1], course.d_target, 1.0 if course.part == done + length == 1.0 else part
        )
        error, also = _attempt(frame, rates, sub, (x, guess, place, rests), best)
        if error > _ALLOWED and length > _LEAST_LENGTH:
            length *= 0.5
            continue
        unique = unique and also
        total += error
        done += length
        for i in range(n):
            for c in range(2):
                at = 2 * i + c
                gained = best[first_x + at]
                base[i, c] = x[i, c] + gained
                x[i, c] = x0[i, c] + moved[i, c] if done == 1.0 else base[i, c]
                velocity[i, c] = best[first_velocity + at] / length
                slowing[i, c] = 2.0 * (gained / length - velocity[i, c]) / length
                for p in range(columns):
                    place[i, c, p] += best[at * columns + p]
                    rate[i, c, p] = best[first_rate + at * columns + p] / length
        for p in range(columns):
            d_work[p] += best[first_work + p]
        _command_on(course, course.part * done, now[0], now[1])
        solved, _ = solve_stage(frame, now[0], base, x, force, 0.0)
        if not solved:
            return np.inf, unique
        _differentiate_step(frame, rates, now, base, x, place, rests)
        length *= 2.0
    return total, unique


@compiled
def find_velocity(frame, way, negligible, velocity):
    """Compute the velocities at the start of a ramp.

    Args:
        frame: the body.
        way: displacements, shape (N, 2) [m]; the command in force and the end of the ramp, shape (C,).
        negligible: a point that starts and moves by no more is taken to have started before [m].
        velocity: changed in place: a guess, then the velocities, shape (N, 2) [m per ramp].
    """
    glance(frame, way, negligible, velocity, np.empty(velocity.shape))
