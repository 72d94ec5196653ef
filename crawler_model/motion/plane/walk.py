"""A part of a ramp, followed in 1, 2, 3, ... equal implicit steps and extrapolated.

Displacements and energies are extrapolated by the Aitken-Neville scheme, as long as the same points slide in all steps.
If a point starts or stops inside the part, the part is shortened to there instead: the path has a kink.
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import inner, lean
from ...rounding import EPS
from .elastic import pull, stretch
from .equal_steps import extrapolate_number, farthest, find_stop, settling_way
from .frame import friction_of, load_of, norm
from .friction import gap_of, load_part, resistance
from .implicit_step import solve_stage
from .polygon import ON
from .translation import choose_translation, stay

_WALKS = 6
AT_ONCE = 1e-2
"""Starts and stops of points within this part of the tolerance count as immediate."""
_CONVERGING = 0.3
"""Another walk follows as long as the last one reduced the error at least to this part."""
_AT_ONE_PLACE = 0.1
"""A force is on the boundary of its set if its contact starts within this part of what is negligible."""
BORDER = 1e-3
"""A force that changes to another quarter of its set within this part of an end of a part of the way does so there."""
FAILED, START, STOP, CROSS, LONG, TAKEN, AT_END = range(7)
"""Outcomes of `extrapolate_part`: a step has no solution; a point starts inside; one stops inside; a force changes to
another quarter of its set inside; steps of vector springs would not show how the forces settle; done, with some error;
done in one step of vector springs, at whose end friction balances the forces."""


@lean
def command_at(command, target, fraction, now):
    """Interpolate a command on the way to its target.

    Args:
        command: the command in force, shape (C,).
        fraction: part of the way.
        now: output, shape (C,).
    """
    for k in range(command.shape[0]):
        now[k] = target[k] if fraction == 1.0 else command[k] + fraction * (target[k] - command[k])


@lean
def work_of(frame, x, before, after):
    """Compute the work of the actuators while the body does not move.

    Args:
        before: the command before, shape (C,).
        after: the command after, shape (C,).

    Returns:
        Minus each tension and torque, in the middle of the change, times the change [J].
    """
    total = 0.0
    for k in range(frame.stiffness.shape[0]):
        change = after[k] - before[k]
        if change != 0.0:
            tension, _, _ = stretch(frame, before, x, k)
            total -= (tension - 0.5 * frame.stiffness[k] * change) * change
    return total


@inner
def take_equal_steps(frame, start, command, target, fraction, pieces, determined, step, total, slid):
    """Take part of the way in equal steps.

    Args:
        start: displacements at the start, shape (N, 2) [m].
        fraction: part of the way to the target.
        pieces: number of steps.
        determined: whether the translation is determined at the start.
        step: guess of the first step, changed in place, shape (N, 2) [m].
        total: output: displacement gained; then dissipation and work; then the work of the loads, shape (N + 2, 2).
        slid: output: number of steps in which each point slid, and the longest of these steps, shape (N, 2).

    Returns:
        Whether all were solved; whether all are unique.
    """
    n = start.shape[0]
    base = start.copy()
    x = np.empty((n, 2))
    force = np.empty((n, 2))
    before = command.copy()
    now = np.empty(command.shape[0])
    middle = np.empty(command.shape[0])
    total[:] = 0.0
    slid[:] = 0.0
    unique = True
    for piece in range(pieces):
        command_at(command, target, fraction if piece == pieces - 1 else fraction * (piece + 1) / pieces, now)
        for i in range(n):
            for c in range(2):
                x[i, c] = base[i, c] + step[i, c]
        solved, regular = solve_stage(frame, now, base, x, force, 0.0)
        if not solved:
            return False, unique
        if frame.vector:
            regular = choose_translation(frame, now, base, x, force)
            if determined and not regular:
                regular = stay(base, step, x)
        unique = unique and regular
        work = 0.5 * (work_of(frame, base, before, now) + work_of(frame, x, before, now))
        command_at(before, now, 0.5, middle)
        for i in range(n):
            step[i, 0] = x[i, 0] - base[i, 0]
            step[i, 1] = x[i, 1] - base[i, 1]
            size = norm(step[i, 0], step[i, 1])
            if size > 0.0:
                slid[i, 0] += 1.0
                slid[i, 1] = max(slid[i, 1], size)
            total[n, 0] += resistance(frame, middle, x, i, step[i, 0], step[i, 1])
            for c in range(2):
                total[i, c] += step[i, c]
                total[n + 1, 0] += load_of(frame, middle, i, c) * step[i, c]
                base[i, c] = x[i, c]
        total[n, 1] += work
        command_at(before, now, 1.0, before)
    return True, unique


@lean
def _blur(start, i, friction):
    """Bound the rounding error of the work of a displacement from a position [J]."""
    return 8.0 * EPS * (abs(start[i, 0]) + abs(start[i, 1])) * friction


@lean
def _foresee(frame, start, command, moved, expected, force, negligible):
    """Find whether a point starts inside a part of the way, from the forces at its start, or stops at once.

    Returns the outcome, TAKEN if none does, an estimate of the part of the part up to there, and by how much the first
    point to start has moved, infinite if a point stops.
    """
    first = 1.0
    started = 0.0
    stops = False
    for i in range(start.shape[0]):
        moves = norm(moved[i, 0], moved[i, 1])
        hopes = norm(expected[i, 0], expected[i, 1])
        if max(moves, hopes) <= negligible:
            continue
        gap = gap_of(frame, command, start, i, force)
        if frame.directions.shape[0] > 0 and moves > 0.0:
            work = resistance(frame, command, start, i, moved[i, 0], moved[i, 1])
            work -= _blur(start, i, friction_of(frame, command, i)[2])
            gap = (work - force[i, 0] * moved[i, 0] - force[i, 1] * moved[i, 1]) / moves
        if moves <= negligible:
            stops = stops or (moves == 0.0 and gap <= frame.grip[i] * negligible)
        elif hopes == 0.0 and frame.vector and gap <= frame.grip[i] * negligible:
            stops = True  # it leaves the boundary inwards, and starts elsewhere
        elif frame.grip[i] * negligible < gap < np.inf:
            at = gap / (gap + frame.grip[i] * moves)
            if at < first:
                first = at
                started = moves
    if started > 0.0:
        return START, first, started
    return (TAKEN, 0.3, np.inf) if stops else (TAKEN, 1.0, 0.0)


@inner
def _find_crossing(frame, start, command, target, fraction, moved, force, negligible):
    """Estimate the part of a step up to where the force on a point that slides changes to another quarter of its set.

    The boundary has another curvature there, and so have paths: extrapolation across it converges only by chance.

    Returns the part; 1 if there is none inside.
    """
    if frame.vector:
        return 1.0
    n = start.shape[0]
    now = np.empty(command.shape[0])
    x = np.empty((n, 2))
    after = np.empty((n, 2))
    command_at(command, target, fraction, now)
    for i in range(n):
        x[i, 0] = start[i, 0] + moved[i, 0]
        x[i, 1] = start[i, 1] + moved[i, 1]
    pull(frame, now, x, after, np.empty(n))
    first = 1.0
    for i in range(n):
        at, _, most = friction_of(frame, command, i)
        if most == 0.0 or norm(moved[i, 0], moved[i, 1]) <= negligible:
            continue
        before = load_part(frame, command, start, i, force[i, 0], force[i, 1])
        later = load_part(frame, now, x, i, after[i, 0], after[i, 1])
        for c in range(2):
            if before[c] * later[c] < 0.0 and command[at + 2 * c] != command[at + 2 * c + 1]:
                place = before[c] / (before[c] - later[c])
                first = min(first, place) if place > BORDER else first
    return first if first < 1.0 - BORDER else 1.0


@lean
def _same_points(one, slid, pieces, negligible):
    """Return whether the same points slide in all steps of a walk as in a single step, but for negligible moves."""
    for i in range(slid.shape[0]):
        moves = norm(one[i, 0], one[i, 1])
        if slid[i, 0] != (pieces if moves > 0.0 else 0.0) and max(slid[i, 1], moves) > negligible:
            return False
    return True


@lean
def _extrapolate(table, newest, pieces, n, per_force):
    """Add a walk to the Aitken-Neville scheme in 1/steps.

    Returns by how much the displacement of a point, or dissipation and work per force, change at most; `newest` becomes
    the extrapolated walk.
    """
    error = 0.0
    for i in range(newest.shape[0]):
        change = 0.0
        for c in range(2):
            value, before = extrapolate_number(table, 2 * i + c, newest[i, c], pieces)
            newest[i, c] = value
            change = norm(change, value - before)
        if i <= n:
            error = max(error, change if i < n else change * per_force)
    return error


@lean
def _growth(allowed, error, last, pieces):
    """Choose the factor for the length of the next part: for the same number of walks or one more, at least work."""
    if error == 0.0:
        return 4.0
    growth = 0.8 * (allowed / error) ** (1.0 / pieces)
    if pieces == 2 and error <= allowed:
        return max(growth, 2.0)  # parts for which two walks suffice would stay short
    if 2 < pieces < _WALKS and error < last:
        more = 0.8 * (allowed * last / (error * error)) ** (1.0 / (pieces + 1.0))
        if more * pieces > growth * (pieces + 2.0):  # the walks take pieces (pieces + 1) / 2 steps
            growth = more
    return growth


@inner
def _missed(frame, start, command, moved, force, negligible):
    """Bound the error of an implicit step of vector springs, taken as a straight path.

    While the sets of friction forces change linearly, too, the path is exact if it is normal to them at its start, as
    it is at its end; otherwise the unbalanced energy bounds the distance to the exact path e in the metric of the
    stiffness K of the body,

        1/2 e . K e <= 1/2 sum_i (R_i(v_i) - f_i . v_i),    R_i and f_i at the start.

    Returns the bound [m].
    """
    energy = 0.0
    for i in range(start.shape[0]):
        v0 = moved[i, 0]
        v1 = moved[i, 1]
        if v0 == 0.0 and v1 == 0.0:
            continue
        speed = norm(v0, v1)
        most = friction_of(frame, command, i)[2]
        band = max(ON * most, frame.grip[i] * negligible)
        along = force[i, 0] * v0 + force[i, 1] * v1
        if frame.directions.shape[0] > 0:
            gap = resistance(frame, command, start, i, v0, v1) - along
            energy += gap if gap > band * speed + _blur(start, i, most) else 0.0
            continue
        strength = norm(force[i, 0], force[i, 1])
        gap = most - strength
        energy += gap * speed if gap > band else 0.0
        if along > 0.0:  # |f| |v| - f . v, without cancellation
            energy += (force[i, 0] * v1 - force[i, 1] * v0) ** 2 / (strength * speed + along)
        else:
            energy += strength * speed - along
    return math.sqrt(frame.compliance * energy)


@inner
def extrapolate_part(
    frame, start, command, target, fraction, velocity, force, allowed, tolerance, longest, determined, best
):
    """Compute the displacement over a part of the way and its error.

    Walks of 1, 2, 3 ... implicit steps are extrapolated in 1 / steps (Aitken and Neville), whose error is a series in
    that; the last change is the error. All of it holds as long as the same points slide in all steps, so a part ends
    where one starts or stops.

    Args:
        start: displacements at the start, shape (N, 2) [m].
        fraction: part of the way to the target.
        velocity: at the start, shape (N, 2) [m per unit of the way].
        force: that friction balances at the start, shape (N, 2) [N].
        allowed: the error allowed for this part [m].
        tolerance: of the whole ramp [m].
        longest: the longest part that is followed in several steps.
        determined: whether the velocities are unique.
        best: output: displacement gained; then dissipation and work; then the work of the loads, shape (N + 2, 2).

    Returns:
        The outcome; the error, infinite if points start or stop at unknown places, or by how much the point that
        started has moved [m]; the factor for the length of this part, or of the next one where it is done; and whether
        the displacement is unique.
    """
    n = velocity.shape[0]
    negligible = AT_ONCE * tolerance
    slid = np.empty((n, 2))
    expected = np.empty((n, 2))
    step = np.empty((n, 2))
    one = np.empty((n, 2))
    table = np.zeros((_WALKS, 2 * (n + 2)))
    error = np.inf
    growth = 0.0
    unique = True
    total = 0.0
    for i in range(n):
        total += friction_of(frame, command, i)[2]
        for c in range(2):
            expected[i, c] = step[i, c] = fraction * velocity[i, c]
    per_force = 1.0 / total if total > 0.0 else 0.0
    for pieces in range(1, _WALKS + 1):
        keeps = determined and pieces == 1
        solved, also = take_equal_steps(frame, start, command, target, fraction, pieces, keeps, step, best, slid)
        unique = unique and also
        if not solved:
            return FAILED, np.inf, 0.5, True
        last = error
        # after the first walk: is it exact already, or is there an event within the part?
        if pieces == 1:
            if farthest(best, n) == 0.0:
                return TAKEN, 0.0, 4.0, True
            if frame.vector:
                error = _missed(frame, start, command, best, force, _AT_ONE_PLACE * negligible)
                if error <= allowed:
                    return AT_END, error, 4.0, unique
                if fraction > longest and settling_way(frame, command, best, force) > allowed:
                    return LONG, np.inf, longest / fraction, unique
            outcome, factor, moves = _foresee(frame, start, command, best, expected, force, negligible)
            if outcome != TAKEN or moves > 0.0:
                return outcome, moves, factor, unique
            crossing = _find_crossing(frame, start, command, target, fraction, best, force, negligible)
            if crossing < 1.0:
                return CROSS, np.inf, crossing, unique
        elif not _same_points(one, slid, pieces, negligible):
            return TAKEN, np.inf, 0.5, unique
        # a point that turns back has stopped before
        stop = find_stop(velocity, fraction, best, step, pieces, negligible)
        if stop < 1.0:
            return STOP, np.inf, stop, unique
        if pieces == 1:
            for i in range(n):
                one[i, 0] = best[i, 0]
                one[i, 1] = best[i, 1]
            _extrapolate(table, best, pieces, n, per_force)
        else:
            error = _extrapolate(table, best, pieces, n, per_force)
            growth = _growth(allowed, error, last, pieces)
            if error <= allowed or (pieces > 2 and error > _CONVERGING * last):
                break
        # the next walk starts from shorter steps of the same kind
        for i in range(n):
            for c in range(2):
                step[i, c] = one[i, c] / (pieces + 1.0)
    if error <= tolerance:  # a single step may end short of a change
        crossing = _find_crossing(frame, start, command, target, fraction, best, force, negligible)
        if crossing < 1.0:
            return CROSS, np.inf, crossing, unique
    return TAKEN, error, growth, unique
