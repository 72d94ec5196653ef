"""Derivatives of implicit steps in the plane.

At the end of an implicit step the miss of each point that moves is zero, see `motion.plane.friction`, and so is its
derivative: the places of the points change by the matrix of the Newton search that found them, with another right side.
A point that sticks takes the derivative of its place along.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crawler_model.compiled import inner, lean
from crawler_model.motion.plane.elastic import pull, stretch
from crawler_model.motion.plane.frame import columns_of, friction_of, norm
from crawler_model.motion.plane.friction import axis_of, linearise
from crawler_model.motion.plane.implicit_step import find_step
from crawler_model.motion.plane.polygon import corner_of, nearest_face


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


@lean
def _force_rate(frame, rates, commands, x, p, force):
    """Compute how the force on each point changes with a parameter while no point moves, shape (N, 2)."""
    command, d_command = commands
    loads = frame.stiffness.shape[0] + columns_of(frame) * x.shape[0]
    for i in range(x.shape[0]):
        for c in range(2):
            force[i, c] = d_command[loads + 2 * i + c, p] if loads < command.shape[0] else 0.0
    for k in range(frame.stiffness.shape[0]):
        stiffness = frame.stiffness[k]
        if rates.stiffness[k, p] == 0.0 and rates.rest[k, p] == 0.0 and d_command[k, p] == 0.0:
            continue
        tension, _, slope = stretch(frame, command, x, k)
        change = rates.stiffness[k, p] * (tension / stiffness) - stiffness * (rates.rest[k, p] + d_command[k, p])
        for q in range(3):
            i = frame.points[k, q]
            if i >= 0:
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
    length = norm(z0, z1)
    across = (z0 * dz1 - z1 * dz0) / (length * length * length)
    return du0 + across * z1 + rows[i, 10] * turn, du1 - across * z0 + rows[i, 11] * turn


@inner
def differentiate_step(frame, rates, commands, base, x, place, rests):
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


@inner
def work_rate(frame, rates, before, after, x, place, work):
    """Add half the derivative of the work of the actuators while the command changes and no point moves.

    Args:
        frame: the body.
        rates: its derivatives.
        before: the command before, shape (C,), and its derivatives, shape (C, P).
        after: the same after.
        x: displacements, shape (N, 2) [m].
        place: derivatives of the places, shape (N, 2, P).
        work: added to, shape (P,).
    """
    for p in range(place.shape[2]):
        for k in range(frame.stiffness.shape[0]):
            change = after[0][k] - before[0][k]
            d_change = after[1][k, p] - before[1][k, p]
            if change == 0.0 and d_change == 0.0:
                continue
            stiffness = frame.stiffness[k]
            tension, _, slope = stretch(frame, before[0], x, k)
            lengthens = -(rates.rest[k, p] + before[1][k, p])
            for q in range(3):
                i = frame.points[k, q]
                if i >= 0:
                    lengthens += slope[2 * q] * place[i, 0, p] + slope[2 * q + 1] * place[i, 1, p]
            middle = tension - 0.5 * stiffness * change
            d_middle = rates.stiffness[k, p] * (middle / stiffness) + stiffness * (lengthens - 0.5 * d_change)
            work[p] -= 0.5 * (middle * d_change + d_middle * change)
