"""A jump: where no equilibrium is left to follow, the body moves at fixed commands to another one.

In each step the energy and the friction of the step are minimised, and springs to where the points are hold the step
short. Where the path leads depends on these springs: the end is one selection among several.
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled, inner
from ..state import DISSIPATION, EVENTS, LOADS_WORK, WORK
from .elastic import energy_of
from .frame import assign, load_of, unwind, yaw_of
from .friction import resistance
from .stability import UNSTABLE, decreases, least_eigenvalue, stiffness_of
from .stage import solve_stage
from .walk import command_at, work_of

_MOST_STEPS = 4000
_NUDGE = 1e-6
"""An unstable equilibrium is left by a displacement of this part of the shortest link."""
_STILL = 1e-11
"""A step that is shorter than this part of the shortest link is the last one."""
_LONG = 0.02
"""After a longer step, as a part of the shortest link, the springs are stiffer; after a shorter one, softer."""
_SOFT = 1e-9
"""Stiffness of the springs, relative to grips, at which a body at rest has arrived."""


@inner
def nudge(frame, command, x, moved, tie):
    """Displace an unstable equilibrium along the motion in which the energy decreases most.

    Args:
        frame: the body.
        command: the command.
        x: displacements, shape (N, 2) [m].
        moved: last displacements of the points, shape (N, 2) [m].
        tie: output: the displacements after the nudge; `x` where it is stable, shape (N, 2) [m]. Of the two
            directions of a motion that is free to both sides, the one is taken whose largest component, of the first
            of these points, is positive.
    """
    assign(tie, x)
    matrix, owner, axis = stiffness_of(frame, command, x, moved, 1.0)
    falls, best = decreases(frame, command, matrix, owner, UNSTABLE)
    if not falls:
        return
    largest = 0
    free = True
    for p in range(best.size):
        if abs(best[p]) > abs(best[largest]) * (1.0 + 1e-9):
            largest = p
        free = free and not (moved[owner[p], 0] != 0.0 or moved[owner[p], 1] != 0.0)
    along = best[largest] * (axis[largest, 0] + axis[largest, 1])
    sign = -1.0 if free and along < 0.0 else 1.0
    size = _NUDGE * frame.rest[: frame.ends.shape[0]].min() * sign
    for p in range(best.size):
        for c in range(2):
            tie[owner[p], c] += size * best[p] * axis[p, c]


@compiled
def jump(frame, state, target, part, moved, account):
    """Move to another equilibrium at a place of a ramp.

    Args:
        frame: the body.
        state: as for `follow_ramp`, changed in place.
        target: end of the ramp, shape (C,).
        part: part of the way to the target at which the body jumps.
        moved: last displacements of the points, shape (N, 2) [m].
        account: added to, shape (14,).

    Returns:
        Whether there is one; the contact that moved farthest, how far [m], and the energy lost beside friction [J].
    """
    x, gained, command, yaw = state
    n = x.shape[0]
    now = np.empty(command.shape[0])
    command_at(command, target, part, now)
    slope = np.empty(6)
    force = np.empty((n, 2))
    before = energy_of(frame, command, x)
    work = work_of(frame, x, command, now, slope)
    base = x.copy()
    start = np.empty((n, 2))
    step = np.empty((n, 2))
    nudge(frame, now, x, moved, start)
    assign(base, start)
    shortest = frame.rest[: frame.ends.shape[0]].min()
    eta = 1.0
    dissipated = pulled = 0.0
    least = 0.0
    done = False
    for _ in range(_MOST_STEPS):
        solved, _ = solve_stage(frame, now, base, start, force, eta)
        if not solved:
            assign(start, base)
            least = eta
            eta *= 4.0
            continue
        longest = 0.0
        for i in range(n):
            for c in range(2):
                step[i, c] = start[i, c] - base[i, c]
            longest = max(longest, math.hypot(step[i, 0], step[i, 1]))
            dissipated += resistance(frame, now, start, i, step[i, 0], step[i, 1])
            pulled += load_of(frame, now, i, 0) * step[i, 0] + load_of(frame, now, i, 1) * step[i, 1]
        assign(base, start)
        if longest <= _STILL * shortest and eta <= max(_SOFT, 2.0 * least):
            done, _ = solve_stage(frame, now, base, start, force, 0.0)
            if done:
                break
        matrix, owner, _ = stiffness_of(frame, now, start, step, 1.0)
        falls = least_eigenvalue(matrix) if decreases(frame, now, matrix, owner, -_SOFT)[0] else 0.0
        eta *= 0.25 if longest < _LONG * shortest else 2.0
        eta = max(eta, 2.0 * least, -2.0 * falls, 0.5 * _SOFT)  # else a step may end in a maximum
        least *= 0.9
    if not done:
        return False, 0, 0.0, 0.0
    farthest = 0
    distance = 0.0
    for i in range(n):
        move = math.hypot(start[i, 0] - x[i, 0], start[i, 1] - x[i, 1])
        if move > distance:
            farthest = i
            distance = move
        for c in range(2):
            gained[i, c] += start[i, c] - x[i, c]
    yaw[0] += unwind(yaw_of(frame, start) - yaw_of(frame, x))
    assign(x, start)
    command_at(command, now, 1.0, command)
    account[WORK] += work
    account[DISSIPATION] += dissipated - pulled
    account[LOADS_WORK] += pulled
    account[EVENTS] += 1.0
    return True, farthest, distance, before + work + pulled - dissipated - energy_of(frame, now, x)
