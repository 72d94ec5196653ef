"""A jump: where no equilibrium is left to follow, the body moves at fixed commands to another one.

In each step the energy and the friction of the step are minimised, and springs to where the points are hold the step
short. Short steps follow the path of points in a liquid, whose drag on each is proportional to how stiffly the body
holds it, and to the velocity. The end of this path is one selection among several.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled, inner, lean
from ..account import DISSIPATION, EVENTS, LOADS_WORK, WORK
from .elastic import energy_of
from .frame import assign, friction_of, load_of, norm, span, unwind, yaw_of
from .friction import ON_BOUNDARY, gap_of, resistance
from .implicit_step import solve_stage
from .stability import decreases, least_eigenvalue, stiffness_of
from .walk import command_at, work_of

_MOST_STEPS = 200_000
COLLAPSED = 1e-3
"""Where a link is shorter than this part of its reference length, no equilibrium is looked for any more."""
_NUDGE = 1e-6
"""An unstable equilibrium is left by a displacement of this part of the shortest link."""
_STILL = 1e-11
"""A step that is shorter than this part of the shortest link is the last one."""
_LONG = 0.002
"""After a longer step, as a part of the shortest link, the springs are stiffer; after a shorter one, softer."""
_TOO_LONG = 4.0 * _LONG
"""A longer step is taken again with stiffer springs: it may lead to another place than the path of short steps."""
_SOFT = 1e-9
"""Stiffness of the springs, relative to grips, at which a body at rest has arrived; less is rounding."""
_STIFFEST = 1e6
"""Beyond this stiffness, relative to grips, rounding errors of the springs exceed friction."""
_BALANCED, _ROUNDING = 0.02, 1e-13
"""Energy that a step may gain beyond the works of friction and loads: as a part of friction's, and for rounding of the
stored energy and of all friction along the body. Frames turn and links push more in a longer step than along the path,
and the body would go round for ever."""


@inner
def _nudge(frame, command, x, moved, tie):
    """Displace an unstable equilibrium to `tie`, where the energy decreases most; return whether it is unstable."""
    assign(tie, x)
    matrix, owner, axis = stiffness_of(frame, command, x, moved, 1.0)
    falls, best = decreases(frame, command, matrix, owner, -_SOFT)
    if not falls:
        return False
    largest = 0
    free = True
    for p in range(best.size):
        if abs(best[p]) > abs(best[largest]) * (1.0 + 1e-9):
            largest = p
        free = free and not (moved[owner[p], 0] != 0.0 or moved[owner[p], 1] != 0.0)
    along = best[largest] * (axis[largest, 0] + axis[largest, 1])
    sign = -1.0 if free and along < 0.0 else 1.0  # the largest component, of the first such point, is positive
    size = _NUDGE * frame.shortest * sign
    for p in range(best.size):
        for c in range(2):
            tie[owner[p], c] += size * best[p] * axis[p, c]
    return True


@lean
def _measure_step(frame, command, base, x):
    """Compute how far a point moves in a step at most [m], and the works against friction and of the loads [J]."""
    longest = friction = loads = 0.0
    for i in range(x.shape[0]):
        v0 = x[i, 0] - base[i, 0]
        v1 = x[i, 1] - base[i, 1]
        longest = max(longest, norm(v0, v1))
        friction += resistance(frame, command, x, i, v0, v1)
        loads += load_of(frame, command, i, 0) * v0 + load_of(frame, command, i, 1) * v1
    return longest, friction, loads


@lean
def _keep_path(frame, command, x, base, force, path):
    """Write how points moved last, if they move or are about to: their force is on the boundary of its set."""
    for i in range(x.shape[0]):
        if x[i, 0] != base[i, 0] or x[i, 1] != base[i, 1]:
            path[i, 0] = x[i, 0] - base[i, 0]
            path[i, 1] = x[i, 1] - base[i, 1]
        elif gap_of(frame, command, x, i, force) > ON_BOUNDARY * friction_of(frame, command, i)[2]:
            path[i, 0] = path[i, 1] = 0.0


@lean
def _shrinks(frame, x):
    """Determine whether a link has all but shrunk to a point."""
    for k in range(frame.links):
        e0, e1 = span(frame, x, frame.points[k, 0], frame.points[k, 1])
        if norm(e0, e1) < COLLAPSED * frame.rest[k]:
            return True
    return False


@compiled
def jump(frame, state, target, fraction, moved, account):
    """Move to another equilibrium at a place of a ramp.

    Args:
        state: as for `follow_ramp`, changed in place.
        fraction: part of the way to the target at which the body jumps.

    Returns:
        Whether there is one; the contact that moved farthest, how far [m], and the energy lost in addition to friction
        [J].
    """
    x, gained, command, yaw = state
    n = x.shape[0]
    now = np.empty(command.shape[0])
    command_at(command, target, fraction, now)
    force = np.empty((n, 2))
    before = energy_of(frame, command, x)
    work = work_of(frame, x, command, now)
    base = x.copy()
    start = np.empty((n, 2))
    path = moved.copy()
    _nudge(frame, now, x, moved, start)
    assign(base, start)
    eta = 1.0
    dissipated = pulled = least = 0.0
    stored = energy_of(frame, now, base)
    held = 0.0
    for i in range(n):
        held += friction_of(frame, now, i)[2]
    rounding = _ROUNDING * (stored + held * frame.rest[: frame.links].sum())
    done = False
    for _ in range(_MOST_STEPS):
        solved, _ = solve_stage(frame, now, base, start, force, eta)
        longest, friction, loads = _measure_step(frame, now, base, start)
        if solved and longest > _TOO_LONG * frame.shortest and 4.0 * eta <= _STIFFEST:
            assign(start, base)
            eta *= 4.0
            continue
        after = energy_of(frame, now, start)
        if not solved or after - stored + friction - loads > _BALANCED * friction + rounding:
            assign(start, base)
            least = 2.0 * eta
            eta *= 4.0
            if eta > _STIFFEST:
                break
            continue
        stored = after
        dissipated += friction
        pulled += loads
        _keep_path(frame, now, start, base, force, path)
        assign(base, start)
        if _shrinks(frame, base):
            break
        still = longest <= _STILL * frame.shortest
        if still and eta <= max(_SOFT, least):
            if _nudge(frame, now, base, path, start):
                assign(base, start)
                stored = energy_of(frame, now, base)
            elif (longest == 0.0 and eta <= 1.0) or solve_stage(frame, now, base, start, force, 0.0)[0]:
                done = True
                break
            else:
                assign(start, base)
        matrix, owner, _ = stiffness_of(frame, now, start, path, 1.0)
        falls = least_eigenvalue(matrix) if decreases(frame, now, matrix, owner, -_SOFT)[0] else 0.0
        eta *= 0.25 if longest < _LONG * frame.shortest else 2.0
        least = max(least if still else 0.9 * least, -2.0 * falls)  # else a step may end in a maximum
        eta = max(eta, least, 0.5 * _SOFT)
    if not done:
        return False, 0, 0.0, 0.0
    farthest = 0
    distance = 0.0
    for i in range(n):
        move = norm(start[i, 0] - x[i, 0], start[i, 1] - x[i, 1])
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
