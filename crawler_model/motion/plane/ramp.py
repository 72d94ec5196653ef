"""One ramp of the commands, followed from event to event to a tolerance, with its account."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled, inner, lean
from ...rounding import CRITICAL, EPS
from ..account import (
    AMBIGUOUS,
    COMPLEMENTARITY,
    DISSIPATION,
    EVENTS,
    LOADS_WORK,
    RESIDUAL,
    VIOLATION,
    VISITED,
    WORK,
)
from .elastic import BALANCED, energy_of, is_balanced, pull
from .ends import find_end, round_down, snap
from .equal_steps import farthest, settles_within
from .frame import Frame, columns_of, friction_of, load_of, norm, unwind, yaw_of
from .friction import ON_BOUNDARY, gap_of, load_part, resistance
from .implicit_step import approach, solve_stage
from .polygon import time_to_edge
from .stability import UNSTABLE, decreases, least_eigenvalue, stiffness_of
from .translation import choose_translation, is_held
from .walk import (
    AT_END,
    AT_ONCE,
    BORDER,
    CROSS,
    FAILED,
    LONG,
    START,
    STOP,
    TAKEN,
    command_at,
    extrapolate_part,
    take_equal_steps,
)

_GLANCE, _TURNING_GLANCE, _LONG_GLANCE, _SHORTER = 1e-6, 1e-5, 1e-4, 1e-2
"""Parts of a ramp in which velocities are measured: in general, of bodies that turn, where longer parts lose accuracy
and shorter ones invariance, and with polygons, whose paths are straight; and by how much a part is shortened in which
velocities change."""
_INWARDS = 1e-9
"""A force on the boundary that moves inwards more slowly than this stays there, of bodies that turn [1 per ramp]."""
_LEAST_PART, _LEAST_STRAIGHT = 1e-9, 1e-13
"""Shortest part of a ramp that is tried before the body jumps; and, for vector springs, before a step is forced, and up
to a point that starts or stops."""
_LEAST_FALL = 1e-6
"""Shortest part of a ramp in whose end an equilibrium may become unstable."""
_BEYOND = 0.3 * AT_ONCE
"""A part ends where a point that starts has moved by this part of the tolerance."""
_SHORT_OF = 0.95
"""A part is shortened at least by this factor where a point stops inside, or starts unseen."""
_FAR_STOP = 0.9
"""A stop that is estimated behind this fraction of a part is far: such estimates are too long."""
_FAR_BEYOND = 1.5
"""A change in the first half of a part is looked for again in a part that is so much longer: the estimate is coarse."""
_SPENT, _AT_ONCE = 0.02, 0.125
"""Fractions of the remaining error that a part of the ramp is planned to take in addition to its share of the
tolerance, and that it may take."""
_LEAST_SHARE, _RESOLVED = 1e-5, 512.0 * EPS
"""What any part of the ramp may take, relative to the tolerance, and to the size of positions and displacements:
rounding errors do not become smaller in shorter parts."""
_LONGER = 4.0
"""Upper limit of the length of a part, relative to the one before."""
_CREEPING = 8
"""A body that turns creeps where so many parts for each point follow less than `_LEAST_FALL` of the ramp together."""
_MOST_TRIALS = 100
"""Upper limit of lengths that are tried at a place of a ramp."""
PLACE, LENGTH, LEFT, MARGIN, PATIENCE, LONGEST = range(6)
"""Entries of the progress on a ramp: the place, 0 to 1; length of the next part; the error that is left [m]; the least
stability margin; the number of parts after which the caller goes on; the longest part of vector springs that may be
followed in several steps, 0 after an event."""


def begin_ramp(tolerance: float, margin: float) -> np.ndarray:
    """Build the progress at the start of a ramp.

    Args:
        tolerance: largest error of the displacements [m].
        margin: the least stability margin so far [1].

    Returns:
        The entries, see `PLACE`, shape (6,).
    """
    return np.array([0.0, 1.0, tolerance, margin, np.inf, 0.0])


@lean
def _time_to_reach(u0, u1, rate0, rate1, growth, inwards):
    """Compute when a force that changes linearly reaches a unit circle that grows, from inside; infinite if never.

    One on the circle that moves inwards, faster than a given rate, reaches it on the other side.
    """
    inside = 1.0 - u0 * u0 - u1 * u1
    bend = rate0 * rate0 + rate1 * rate1 - growth * growth
    outwards = u0 * rate0 + u1 * rate1 - growth
    under = outwards * outwards + bend * inside
    if (inside <= ON_BOUNDARY and outwards > -inwards) or under <= 0.0:
        return np.inf
    if outwards < 0.0:
        return (math.sqrt(under) - outwards) / bend if bend > 0.0 else np.inf
    return inside / (math.sqrt(under) + outwards)


@compiled
def predict_first_slide(frame, x, command, target, negligible, velocity, force):
    """Measure the velocities at the start of a ramp, and predict when the first point starts to slide.

    Args:
        negligible: a point that starts and moves by no more is taken to have started before [m].
        velocity: changed in place: a guess, then the velocities, shape (N, 2) [m per unit of the ramp].
        force: output: the force that friction balances at the start, shape (N, 2) [N].

    Returns:
        The part of the ramp; infinite if none does, or no velocities were found; and whether the velocities are unique.
    """
    n = x.shape[0]
    now = np.empty(command.shape[0])
    moved = np.empty((n, 2))
    after = np.empty((n, 2))
    pull(frame, command, x, force, np.empty(n))
    fraction = _TURNING_GLANCE if not frame.vector else (_GLANCE if frame.directions.shape[0] == 0 else _LONG_GLANCE)
    while True:
        unique = True
        command_at(command, target, fraction, now)
        for i in range(n):
            for c in range(2):
                moved[i, c] = x[i, c] + fraction * velocity[i, c]
        solved, _ = solve_stage(frame, now, x, moved, after, 0.0)
        if not solved:
            return np.inf, unique
        if frame.vector:
            unique = choose_translation(frame, now, x, moved, after)
        first = np.inf
        for i in range(n):
            velocity[i, 0] = (moved[i, 0] - x[i, 0]) / fraction
            velocity[i, 1] = (moved[i, 1] - x[i, 1]) / fraction
            speed = norm(velocity[i, 0], velocity[i, 1])
            gap = gap_of(frame, command, x, i, force)
            if frame.directions.shape[0] > 0 and gap < np.inf:
                first = min(first, fraction * time_to_edge(frame, command, now, i, force, after))
            elif gap < np.inf and speed == 0.0 and frame.vector:
                at, _, mu = friction_of(frame, command, i)
                f0, f1 = force[i]
                rates = (after[i, 0] - f0) / mu, (after[i, 1] - f1) / mu, now[at] / mu - 1.0
                first = min(first, fraction * _time_to_reach(f0 / mu, f1 / mu, *rates, np.inf))
            elif gap < np.inf and speed == 0.0:
                u0, u1 = load_part(frame, command, x, i, force[i, 0], force[i, 1])
                v0, v1 = load_part(frame, now, moved, i, after[i, 0], after[i, 1])
                first = min(first, _time_to_reach(u0, u1, (v0 - u0) / fraction, (v1 - u1) / fraction, 0.0, _INWARDS))
            elif frame.grip[i] * negligible < gap < np.inf:  # it starts within sight
                first = min(first, fraction * gap / (gap + frame.grip[i] * fraction * speed))
        if not first < fraction or fraction <= _LEAST_PART:
            return first, unique
        fraction *= _SHORTER  # an event within changed the velocities


@inner
def _finish_part(frame, x, command, target, fraction, best, after, allowed, solved):
    """Solve for the end of a part of a ramp, where friction balances the forces, as at the end of an implicit step.

    The displacement, the dissipation and the work of the loads in `best` then extend to that end. `allowed` is
    the error of that [m], and `solved` whether `best` is one implicit step.

    Returns whether there is such an end; whether it is stable and the energies balance: where they do not, the body has
    jumped; their residual; and how far a point moves: beyond the error, one has started before the end, unseen by the
    steps.
    """
    n = x.shape[0]
    force = np.empty((n, 2))
    now = np.empty(command.shape[0])
    base = np.empty((n, 2))
    command_at(command, target, fraction, now)
    for i in range(n):
        for c in range(2):
            base[i, c] = after[i, c] = x[i, c] + best[i, c]
    shift = 0.0
    if not solved:
        solved, _ = solve_stage(frame, now, base, after, force, 0.0)
    for i in range(n):
        best[n, 0] += resistance(frame, now, after, i, after[i, 0] - base[i, 0], after[i, 1] - base[i, 1])
        for c in range(2):
            best[n + 1, 0] += load_of(frame, now, i, c) * (after[i, c] - base[i, c])
        best[i, 0] = after[i, 0] - x[i, 0]
        best[i, 1] = after[i, 1] - x[i, 1]
        shift = max(shift, norm(after[i, 0] - base[i, 0], after[i, 1] - base[i, 1]))
    gained = energy_of(frame, now, after) - energy_of(frame, command, x)
    residual = gained + best[n, 0] - best[n, 1] - best[n + 1, 0]
    spent = best[n, 0] + abs(best[n, 1]) + abs(best[n + 1, 0]) + abs(gained)
    balanced = is_balanced(frame, now, after, spent, residual, allowed, BALANCED)
    if frame.vector:
        return solved, balanced, residual, shift
    matrix, owner, _ = stiffness_of(frame, now, after, best, 1.0)
    return solved, balanced and not decreases(frame, now, matrix, owner, UNSTABLE)[0], residual, shift


@lean
def _part_of_friction(frame, command, force):
    """Relate the sum of the distances of forces from their bounds to all friction: the visited margin.

    Args:
        force: the sum [N].

    Returns:
        The part [1].
    """
    total = 0.0
    columns = columns_of(frame)
    first = frame.stiffness.shape[0]
    for k in range(first, first + columns * frame.position.shape[0]):
        total += (2.0 if frame.vector else 1.0) * command[k] / columns
    return force / total if total > 0.0 else 0.0


@inner
def _take(frame, x, gained, command, yaw, target, fraction, best, after, account):
    """Apply a part of a ramp to the state, and write its account."""
    n = x.shape[0]
    force = np.empty((n, 2))
    size = np.empty(n)
    command_at(command, target, fraction, command)
    before = yaw_of(frame, x) if not frame.vector else 0.0
    for i in range(n):
        for c in range(2):
            gained[i, c] += best[i, c]
            x[i, c] = after[i, c]
    pull(frame, command, x, force, size)
    near = 0.0
    for i in range(n):
        gap = gap_of(frame, command, x, i, force)
        near += max(gap, 0.0) if gap < np.inf else 0.0
        strength = norm(force[i, 0], force[i, 1])
        account[VIOLATION] = max(account[VIOLATION], -gap if gap < np.inf else strength)
        lost = resistance(frame, command, x, i, best[i, 0], best[i, 1])
        lost -= force[i, 0] * best[i, 0] + force[i, 1] * best[i, 1]
        account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], lost)
    account[VISITED] = min(account[VISITED], _part_of_friction(frame, command, near))
    if not frame.vector:
        yaw[0] += unwind(yaw_of(frame, x) - before)
    account[WORK] += best[n, 1]
    account[DISSIPATION] += best[n, 0] - best[n + 1, 0]
    account[LOADS_WORK] += best[n + 1, 0]
    account[EVENTS] += 1.0


@inner
def _advance(frame, x, gained, command, yaw, target, tolerance, velocity, account, progress, best):
    """Follow a ramp to the next event, or as far as the tolerance allows; return the part of the way, 0 if none.

    Lengths are parts of the whole ramp, parts belong to what is left of it. `aim` is the event that is aimed at,
    `wanted` the length that the tolerance allows; each trial corrects one of them.
    """
    n = velocity.shape[0]
    place = progress[PLACE]
    rest = 1.0 - place
    force = np.empty((n, 2))
    after = np.empty((n, 2))
    first, determined = predict_first_slide(frame, x, command, target, AT_ONCE * tolerance, velocity, force)
    fastest = farthest(velocity, n)
    if first < np.inf and fastest > 0.0 and frame.directions.shape[0] == 0:  # paths with polygons are straight
        first += _BEYOND * tolerance / fastest
    # where the first point starts, from the rates at the start
    aim = first * rest
    if fastest > 0.0:
        aim = snap(frame, place, aim, _BEYOND * tolerance * rest / fastest)
    rounding = _RESOLVED * (farthest(frame.position, n) + farthest(x, n))
    wanted = progress[LENGTH]
    longest = (
        progress[LONGEST]
        if progress[LONGEST] > 0.0
        else settles_within(frame, command, velocity, AT_ONCE * tolerance) * rest
    )
    longer = crossed = np.inf, np.inf
    stops = 0
    for _ in range(_MOST_TRIALS):
        length = min(wanted, aim, rest)
        fraction = 1.0 if length >= rest * (1.0 - CRITICAL) else length / rest
        share = max(tolerance * max(length, _LEAST_SHARE), rounding)
        allowed = max(share, _SPENT * progress[LEFT])
        # a longer part may miss more: in proportion to its length, and what earlier parts have left
        outcome, error, growth, unique = extrapolate_part(
            frame, x, command, target, fraction, velocity, force, allowed, tolerance, longest / rest, determined, best
        )
        # an event lies within the part: aim at it, just beyond a start or just short of a stop
        if outcome == START:
            beyond = _BEYOND * tolerance
            aim = find_end(frame, place, length, error, longer, growth + (1.0 - growth) * beyond / error, beyond)
            longer = length, error
        elif outcome == STOP:
            stops = stops + 1 if growth > _FAR_STOP else 1
            aim = min(growth, _SHORT_OF) ** stops * length  # the first estimates of a far stop are too long
            aim = snap(frame, place, aim, (1.0 - _SHORT_OF) * length)
        elif outcome == CROSS:
            guess = growth * (1.0 + 0.5 * BORDER if growth > 0.5 else _FAR_BEYOND)
            excess = 1.0 / growth - 1.0
            aim = find_end(frame, place, length, excess, crossed, guess, 0.5 * BORDER)
            crossed = length, excess
        elif outcome == LONG:
            wanted = growth * length
        # no event: take the part if its error is paid for, else a shorter one
        else:
            paid = max(error - share, 0.0)
            if outcome >= TAKEN and paid <= _AT_ONCE * progress[LEFT]:
                solved, lasts, residual, shift = _finish_part(
                    frame, x, command, target, fraction, best, after, allowed, outcome == AT_END
                )
                settled = solved and lasts
                # a fall that ends far away begins before the end of the part
                if settled and shift > allowed and length > _LEAST_FALL:
                    aim = _SHORT_OF * length
                    continue
                if settled:
                    account[RESIDUAL] += residual
                    progress[LEFT] -= paid
                    after_this = round_down(frame, min(max(growth, 0.3), _LONGER) * length)
                    progress[LENGTH] = max(wanted, after_this) if length >= aim else after_this
                    progress[LONGEST] = 0.0 if length >= aim else _LONGER * length
                    _take(frame, x, gained, command, yaw, target, fraction, best, after, account)
                    unique = unique and (frame.vector or is_held(frame, command, after, best))
                    account[AMBIGUOUS] = max(account[AMBIGUOUS], 0.0 if unique or length < _GLANCE else 1.0)
                    return fraction
                if length < _LEAST_FALL:
                    break
                growth = 0.5
            wanted = round_down(frame, (0.5 if outcome == FAILED else min(max(growth, 0.05), 0.9)) * length)
        if aim < _LEAST_STRAIGHT or wanted < (_LEAST_STRAIGHT if frame.vector else _LEAST_PART):
            break
    return 0.0


@compiled
def follow_ramp(fields, state, target, tolerance, velocity, account, progress):
    """Follow a ramp of the commands until it ends, or patience does, or no part of it can be followed.

    Args:
        fields: the fields of the `Frame`, as a plain tuple, which Python passes faster.
        state: displacements and what was gained, shape (N, 2) [m]; the command in force, shape (C,); the yaw, shape
            (1,) [rad]; changed in place.
        tolerance: largest error of the displacements [m].
        velocity: of the points along the ramp, a guess, changed in place: how far they moved last, where the body
            jumps, shape (N, 2) [m].
        progress: changed in place, shape (6,), see `PLACE`.

    Returns:
        Whether it can be followed further.
    """
    n = velocity.shape[0]
    frame = Frame(*fields)
    x, gained, command, yaw = state
    best = np.zeros((n + 2, 2))
    if (command == target).all():
        progress[PLACE] = 1.0
    parts = 0
    begin = progress[PLACE]
    while progress[PLACE] < 1.0 and progress[PATIENCE] > 0.0:
        progress[PATIENCE] -= 1.0
        creeps = parts == _CREEPING * n and progress[PLACE] - begin < _LEAST_FALL and not frame.vector
        fraction = 0.0
        if not creeps:
            fraction = _advance(frame, x, gained, command, yaw, target, tolerance, velocity, account, progress, best)
        if fraction == 0.0:
            for i in range(n):
                for c in range(2):
                    velocity[i, c] = best[i, c]
            return False
        for i in range(n):  # of several solutions, the last part's goes on
            for c in range(2):
                velocity[i, c] = best[i, c] * (1.0 - fraction) / fraction
        if parts == _CREEPING * n:
            parts = 0
            begin = progress[PLACE]
        parts += 1
        rest = 1.0 - progress[PLACE]
        progress[PLACE] = 1.0 if fraction == 1.0 else progress[PLACE] + fraction * rest
        if frame.vector:
            continue
        margin = least_eigenvalue(stiffness_of(frame, command, x, best, 2.0)[0])
        progress[MARGIN] = min(progress[MARGIN], margin)
    return True


@compiled
def complete_ramp(fields, state, target, account, progress):
    """Take one implicit step of vector springs to the end of a ramp, whatever its error.

    Args:
        fields: as for `follow_ramp`.
        state: as for `follow_ramp`, changed in place.
        progress: as for `follow_ramp`, changed in place.

    Returns:
        Whether it was solved; else nothing has changed.
    """
    x, gained, command, yaw = state
    n = x.shape[0]
    frame = Frame(*fields)
    best = np.zeros((n + 2, 2))
    after = np.empty((n, 2))
    if not approach(frame, target, x, after, np.empty((n, 2))):
        return False
    walked, _ = take_equal_steps(frame, x, command, target, 1.0, 1, False, after - x, best, np.empty((n, 2)))
    solved, _, residual, _ = _finish_part(frame, x, command, target, 1.0, best, after, 0.0, False)
    if not (walked and solved):
        return False
    account[RESIDUAL] += residual
    _take(frame, x, gained, command, yaw, target, 1.0, best, after, account)
    progress[PLACE] = 1.0
    return True
