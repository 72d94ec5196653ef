"""One ramp of the commands, followed from event to event to a tolerance, with its account."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled, lean
from ..state import AMBIGUOUS, COMPLEMENTARITY, DISSIPATION, EVENTS, LOADS_WORK, OVERSPENT, RESIDUAL, VIOLATION, WORK
from .elastic import energy_of, pull
from .frame import yaw_of
from .friction import load_part, resistance
from .stage import solve_stage
from .walk import AT_ONCE, FAILED, START, TAKEN, attempt, command_at

_GLANCE = 1e-6
"""Part of a ramp in which velocities are measured."""
_BAND = 1e-9
"""A point this close to the boundary of its set, relative to its size, is on it."""
LEAST_PART = 1e-9
"""Shortest part of a ramp that is tried before a body is called unstable."""
_BEYOND = 0.3 * AT_ONCE
"""A part ends where a point that starts has moved by this part of the tolerance."""
_MOST_PARTS = 1 << 14
"""Upper limit of parts of a ramp that are tried."""


@lean
def _time_to_reach(u0, u1, rate0, rate1):
    """Compute when a force that changes linearly reaches the unit circle from inside; infinite if never."""
    inside = 1.0 - u0 * u0 - u1 * u1
    if inside <= _BAND:
        return np.inf
    bend = rate0 * rate0 + rate1 * rate1
    outwards = u0 * rate0 + u1 * rate1
    bottom = outwards + math.sqrt(outwards * outwards + bend * inside)
    return inside / bottom if bottom > 0.0 else np.inf


@compiled
def glance(frame, x, command, target, velocity, force):
    """Measure the velocities at the start of a ramp, and predict when the first point starts to slide.

    Args:
        frame: the body.
        x: displacements, shape (N, 2) [m].
        command: in force, shape (C,).
        target: end of the ramp, shape (C,).
        velocity: changed in place: a guess, then the velocities, shape (N, 2) [m per unit of the ramp].
        force: output: the force that friction balances at the start, shape (N, 2) [N].

    Returns:
        Whether there is a solution, and the part of the ramp.
    """
    n = x.shape[0]
    now = np.empty(command.shape[0])
    size = np.empty(n)
    after = np.empty((n, 2))
    pull(frame, command, x, force, size)
    command_at(command, target, _GLANCE, now)
    moved = x + _GLANCE * velocity
    solved, _ = solve_stage(frame, now, x, moved, after, 0.0)
    if not solved:
        velocity[:] = 0.0
        return False, np.inf
    first = np.inf
    for i in range(n):
        velocity[i, 0] = (moved[i, 0] - x[i, 0]) / _GLANCE
        velocity[i, 1] = (moved[i, 1] - x[i, 1]) / _GLANCE
        if velocity[i, 0] != 0.0 or velocity[i, 1] != 0.0:
            continue
        u0, u1 = load_part(frame, command, x, i, force[i, 0], force[i, 1])
        if u0 < np.inf:
            v0, v1 = load_part(frame, now, moved, i, after[i, 0], after[i, 1])
            first = min(first, _time_to_reach(u0, u1, (v0 - u0) / _GLANCE, (v1 - u1) / _GLANCE))
    return True, first


@compiled
def _take(frame, state, target, part, best, account):
    """Apply a part of a ramp to the state; return whether friction balances the forces afterwards."""
    x, gained, command, yaw = state
    n = x.shape[0]
    force = np.empty((n, 2))
    now = np.empty(command.shape[0])
    stored = energy_of(frame, command, x)
    command_at(command, target, part, now)
    base = x + best[:n]
    after = base.copy()
    solved, regular = solve_stage(frame, now, base, after, force, 0.0)
    if not solved:
        return False
    dissipated, worked, pulled = best[n, 0], best[n, 1], best[n + 1, 0]
    for i in range(n):
        change0 = after[i, 0] - base[i, 0]
        change1 = after[i, 1] - base[i, 1]
        lost = resistance(frame, now, after, i, change0, change1)
        dissipated += lost
        u0, u1 = load_part(frame, now, after, i, force[i, 0], force[i, 1])
        size = math.hypot(force[i, 0], force[i, 1])
        if u0 < np.inf:
            over = math.hypot(u0, u1)
            account[VIOLATION] = max(account[VIOLATION], (over - 1.0) / over * size if over > 1.0 else 0.0)
        else:
            account[VIOLATION] = max(account[VIOLATION], size)
        moved0 = after[i, 0] - x[i, 0]
        moved1 = after[i, 1] - x[i, 1]
        lost = resistance(frame, now, after, i, moved0, moved1) - force[i, 0] * moved0 - force[i, 1] * moved1
        account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], lost)
        gained[i, 0] += moved0
        gained[i, 1] += moved1
    before = yaw_of(frame, x)
    turned = yaw_of(frame, after) - before
    yaw[0] += turned - 2.0 * math.pi * math.floor(turned / (2.0 * math.pi) + 0.5)
    x[:] = after
    command[:] = now
    account[WORK] += worked
    account[DISSIPATION] += dissipated - pulled
    account[LOADS_WORK] += pulled
    account[RESIDUAL] += energy_of(frame, now, after) - stored + dissipated - worked - pulled
    account[EVENTS] += 1.0
    account[AMBIGUOUS] = max(account[AMBIGUOUS], 0.0 if regular else 1.0)
    return True


@lean
def _find_start(length, moved, later, guess, beyond):
    """Estimate the length of a part that ends just beyond the start of a point.

    Args:
        length: of a part that is too long.
        moved: by how much the point moved in it [m].
        later: the same two of a longer part, infinite if there is none.
        guess: estimate of the factor without a longer part.
        beyond: by how much the point shall move [m].

    Returns:
        The length.
    """
    if not moved < later[1] or later[0] == np.inf:
        return max(guess, 0.3) * length
    speed = (later[1] - moved) / (later[0] - length)
    return min(max(length - (moved - beyond) / speed, 0.1 * length), 0.999 * length)


@compiled
def follow_ramp(frame, state, target, tolerance, velocity, account, progress):
    """Follow a ramp of the commands, until it ends or the body becomes unstable.

    Args:
        frame: the body.
        state: displacements and what was gained, shape (N, 2) [m]; the command in force, shape (C,); the yaw, shape
            (1,) [rad]; changed in place.
        target: end of the ramp, shape (C,).
        tolerance: largest error of the displacements [m].
        velocity: of the points along the ramp, a guess, changed in place, shape (N, 2) [m].
        account: added to, shape (14,).
        progress: place on the ramp, changed in place; parts tried, shape (2,).

    Returns:
        Whether the end was reached.
    """
    x, _, command, _ = state
    n = x.shape[0]
    best = np.empty((n + 2, 2))
    force = np.empty((n, 2))
    length = 1.0
    aim = np.inf
    while progress[0] < 1.0:
        rest = 1.0 - progress[0]
        solved, first = glance(frame, x, command, target, velocity, force)
        fastest = 0.0
        for i in range(n):
            fastest = max(fastest, math.hypot(velocity[i, 0], velocity[i, 1]))
        if first < np.inf and fastest > 0.0:
            first += _BEYOND * tolerance / fastest
        aim = first * rest
        wanted = length
        later = moved = np.inf
        while True:
            length = min(wanted, aim, rest)
            part = 1.0 if length >= rest else length / rest
            progress[1] += 1.0
            limits = max(tolerance * length, 1e-14), tolerance
            outcome, error, growth, unique = attempt(frame, (x, command, target), part, velocity, force, limits, best)
            if outcome == TAKEN and error <= limits[0] and _take(frame, state, target, part, best, account):
                break
            if outcome == START:
                aim = _find_start(length, error, (later, moved), growth, _BEYOND * tolerance)
                later = length
                moved = error
            else:
                wanted = min(max(growth, 0.05), 0.9) * length if outcome == TAKEN or outcome > FAILED else 0.5 * length
            if min(aim, wanted) < LEAST_PART or progress[1] > _MOST_PARTS:
                return False
        if not unique and part * rest > _GLANCE:
            account[AMBIGUOUS] = 1.0
        scale = 1.0 - part
        for i in range(n):
            for c in range(2):
                velocity[i, c] *= scale
        progress[0] = 1.0 if part == 1.0 else progress[0] + length
        length = max(wanted, min(max(growth, 0.3), 4.0) * length) if length >= aim else min(max(growth, 0.3), 4.0) * length
    return True
