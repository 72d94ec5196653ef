"""What equal implicit steps in the plane show about the motion between their ends."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import lean
from .frame import friction_of, norm

_SETTLED = 2.0
"""Length of a part in which the forces on discs settle, relative to friction per stiffness."""


@lean
def farthest(a, n):
    """Compute the largest Euclidean norm of the first rows of an array.

    Args:
        a: shape (m, 2), m >= n.
        n: number of rows.

    Returns:
        The norm.
    """
    most = 0.0
    for i in range(n):
        most = max(most, norm(a[i, 0], a[i, 1]))
    return most


@lean
def extrapolate_number(table, at, value, pieces):
    """Add a number that a walk found to the Aitken-Neville scheme in 1/steps.

    Args:
        table: what walks of fewer steps left, a column for each number, shape (walks, m), changed in place.
        at: the column.
        value: the number.
        pieces: number of steps of the walk.

    Returns:
        The extrapolated number, and the one before in the scheme.
    """
    before = value
    for column in range(pieces - 1):
        previous = table[column, at]
        table[column, at] = before = value
        value = before + (before - previous) * ((pieces - column - 1.0) / (column + 1.0))
    table[pieces - 1, at] = value
    return value, before


@lean
def find_stop(velocity, fraction, total, last, pieces, negligible):
    """Estimate the part of a walk up to where the first point stops, from its velocity before and in the last step.

    Steps do not show a point that stops and moves back, unless it moves back by more than it moves forward in one of
    them. Its velocity is taken to change evenly to the last step's, from its value at the start or from the mean of the
    other steps; and, where there are other steps, like the parabola that has all three.

    Args:
        velocity: at the start, shape (N, 2) [m per unit of the way].
        fraction: of the way, which the walk takes.
        total: displacement of the walk in its first N rows, shape (M, 2) [m].
        last: displacement of its last step, shape (N, 2) [m].
        pieces: number of its steps.
        negligible: a point may have moved back by this distance [m].

    Returns:
        The part of the walk; 1 if no point stops.
    """
    first = 1.0
    others = 1.0 - 1.0 / pieces
    for i in range(last.shape[0]):
        size = norm(total[i, 0], total[i, 1])
        if size == 0.0:
            continue
        start = fraction * (velocity[i, 0] * total[i, 0] + velocity[i, 1] * total[i, 1]) / size
        latest = (last[i, 0] * total[i, 0] + last[i, 1] * total[i, 1]) * pieces / size
        before = start if pieces == 1 else (size - latest / pieces) / others
        slowing = 2.0 * (before - latest)
        end = latest - 0.5 * slowing / pieces
        stop = 1.0 + end / slowing if slowing > 0.0 else 1.0
        if pieces > 1 and start > 0.0:
            bend = 3.0 * (latest - before - size + start) / others
            curved = 2.0 * size - start + bend / 3.0
            if bend < 0.0 and curved < end:
                slope = curved - start - bend
                slowing = math.sqrt(slope * slope - 4.0 * bend * start)
                stop = 2.0 * start / (slowing - slope)
                end = curved
        if end < 0.0 < before and end * end > 2.0 * slowing * negligible:
            first = min(first, stop)
    return first


@lean
def settles_within(frame, command, velocity, negligible):
    """Compute in which part of a ramp the forces on discs settle after an event.

    They turn until friction balances them, while contacts move by about friction per stiffness. In far longer steps all
    of that lies in the first one, and walks of any number of steps agree on a translation that is wrong.

    Args:
        velocity: at the start, shape (N, 2) [m per unit of the way].
        negligible: contacts that move by less while their forces settle do not count [m].

    Returns:
        The part of the way; infinite if no contact counts, or paths are straight.
    """
    fraction = np.inf
    if not frame.vector or frame.directions.shape[0] > 0:
        return fraction
    for i in range(velocity.shape[0]):
        speed = norm(velocity[i, 0], velocity[i, 1])
        most = friction_of(frame, command, i)[2]
        if speed > 0.0 and most > frame.grip[i] * negligible:
            fraction = min(fraction, _SETTLED * most / (frame.grip[i] * speed))
    return fraction


@lean
def settling_way(frame, command, moved, force):
    """Estimate how far contacts on discs move aside while the forces on them settle.

    Args:
        moved: displacement of the contacts in one step, shape (N, 2) or more rows [m].
        force: that friction balances at its start, shape (N, 2) [N].

    Returns:
        The way [m].
    """
    most = 0.0
    for i in range(force.shape[0]):
        size = norm(moved[i, 0], moved[i, 1]) * norm(force[i, 0], force[i, 1])
        if size > 0.0:
            turn = abs(force[i, 0] * moved[i, 1] - force[i, 1] * moved[i, 0]) / size
            turn = turn if force[i, 0] * moved[i, 0] + force[i, 1] * moved[i, 1] > 0.0 else 1.0
            most = max(most, turn * friction_of(frame, command, i)[2] / frame.grip[i])
    return most
