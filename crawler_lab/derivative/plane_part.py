"""Derivatives of parts of ramps in the plane.

They are extrapolated from equal implicit steps as displacements are, because they depend on the length of the steps in
the same way; their error is known from the extrapolation, too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crawler_model.compiled import compiled, inner, lean
from crawler_model.motion.plane.equal_steps import extrapolate_number
from crawler_model.motion.plane.implicit_step import solve_stage
from crawler_model.motion.plane.translation import choose_translation
from crawler_model.motion.plane.walk import command_at

from .plane_step import differentiate_step, work_rate

_WALKS = 8
"""Largest number of walks that are extrapolated."""
_ENOUGH, _CONVERGING = 1e-11, 0.5
"""Another walk follows until derivatives change by no more than this part, as long as it reduces the change to this
part."""
_ALLOWED, _LEAST_LENGTH = 1e-9, 2.0**-12
"""A part is divided as long as its error is larger, down to this length relative to the part."""
_LEAST_SIZE = 1e-3
"""Derivatives are compared with the largest of their parameter, and at least with this [m per unit]."""


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


@inner
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
        work_rate(frame, rates, before, now, base, place, work)
        differentiate_step(frame, rates, now, base, x, place, rests)
        work_rate(frame, rates, before, now, x, place, work)
        before, now = now, before
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
        value, before = extrapolate_number(table, i, newest[i], pieces)
        newest[i] = value
        if i < compared:
            error = max(error, abs(value - before) / scale[i % scale.shape[0]])
    return error


@inner
def _attempt(frame, rates, course, start, best):
    """Extrapolate walks over a part of a ramp, with the arguments of `_differentiate_walk`.

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
            for k in range(best.shape[0]):  # a slice that is assigned takes seconds to compile
                best[k] = found[k]
        if pieces > 1:
            error = min(change, last)
        if error <= _ENOUGH or (pieces > 2 and change > _CONVERGING * last):
            break
    return error, unique


@compiled
def differentiate_part(frame, rates, course, way, rests, tangent, d_work):
    """Carry derivatives through a part of a ramp, in shorter parts where they have kinks.

    The derivative of an implicit step follows from its equations by the implicit function theorem; walks of 1, 2, 3 ...
    steps are extrapolated as in the motion itself, see `extrapolate_part` in `crawler_model/motion/plane/walk.py`.

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
        Whether all steps were solved, and whether the displacement is unique.
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
    unique = True
    done = 0.0
    length = 1.0
    while done < 1.0:
        length = min(length, 1.0 - done)
        for i in range(n):
            for c in range(2):
                guess[i, c] = length * moved[i, c]
        # walks over the next part
        part = course.part * length / (1.0 - course.part * done)
        sub = Course(
            now[0], course.target, now[1], course.d_target, 1.0 if course.part == done + length == 1.0 else part
        )
        error, also = _attempt(frame, rates, sub, (x, guess, place, rests), best)
        if error > _ALLOWED and length > _LEAST_LENGTH:
            length *= 0.5
            continue
        if error == np.inf:
            return False, unique
        # its end is the end of the motion, to the bit; rates there come from the last steps
        unique = unique and also
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
        # one more step there takes out what extrapolation leaves
        _command_on(course, course.part * done, now[0], now[1])
        solved, _ = solve_stage(frame, now[0], base, x, force, 0.0)
        if not solved:
            return False, unique
        differentiate_step(frame, rates, now, base, x, place, rests)
        length *= 2.0
    return True, unique
