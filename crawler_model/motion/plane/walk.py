"""A stretch of a ramp in the plane, followed in 1, 2, 3, ... equal implicit steps and extrapolated.

One implicit step is exact where the path is straight, and its energy bounds its error otherwise (`missed`). A path
that bends, as with discs, is followed again in 2, 3, ... steps, whose displacements and energies are extrapolated by
the Aitken-Neville scheme, as long as the same contacts slide in all of them as at the start. If contacts start or stop
inside the stretch, it is shortened instead.
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled, lean
from ..equal_steps import farthest, find_stop
from ..state import PLANAR_ACTUATION as ACTUATION
from ..state import PLANAR_TENSION as TENSION
from .friction import STUCK, corners_of, resistance
from .implicit_step import project_planar
from .rates import missed
from .springs import diagonal

# Progress of `ramp.follow_ramp`: the ramp, the place on it, the length of the present substep (0 before a ramp), the
# length after which a contact starts according to the last trial, the error still allowed at starts and stops, implicit
# steps tried, substeps left until the caller may try to go on in parts, whether there are loads and the translation is
# determined at the start of this substep, its solved stages, and which of them are not unique.
RAMP, PLACE, LENGTH, START, ERROR_LEFT, TRIALS, PATIENCE, DETERMINED, KNOWN, NOT_UNIQUE = range(10)
_WALKS = 6
STAGES = _WALKS * (_WALKS + 1) // 2 + 1
"""Implicit steps of a substep: 1 + 2 + ... plus one that corrects the extrapolation."""
_AT_ONCE = 1e-3
"""Starts and stops of contacts within this part of the tolerance count as immediate."""
_SAME_SHAPE = 1e-9
"""Steps that differ from a translation by no more than this part have the same shape."""
_CONVERGING = 0.3
"""Another walk follows as long as the last one reduced the error at least to this part."""


@lean
def _stay(guess, moved):
    """Undo the choice of a translation where it is undetermined only at the end of a straight step.

    Loads that change pass through forces at which friction balances; up to there the translation is that of the guess.

    Returns whether `moved` and the guess differ by a translation alone.
    """
    rests = 0
    for i in range(moved.shape[0]):
        if guess[i, 0] == 0.0 and guess[i, 1] == 0.0:
            rests = i
    shift0 = guess[rests, 0] - moved[rests, 0]
    shift1 = guess[rests, 1] - moved[rests, 1]
    near = _SAME_SHAPE * farthest(guess, guess.shape[0])
    for i in range(moved.shape[0]):
        if math.hypot(guess[i, 0] - moved[i, 0] - shift0, guess[i, 1] - moved[i, 1] - shift1) > near:
            return False
    for i in range(moved.shape[0]):
        moved[i, 0] += shift0
        moved[i, 1] += shift1
    return True


@compiled
def step(stage, spring, mu, directions, springs, most_sweeps, stages, motions, problem, progress):
    """Solve an implicit step unless it is already solved.

    Args:
        stage: number of the step.
        spring: spring forces before the step, shape (n, 2) [N].
        mu: friction after the step, shape (n, max(m, 1)) [N].
        directions: unit vectors, shape (m, 2).
        springs: the springs, with K, as in `Springs`.
        most_sweeps: upper limit of sweeps.
        stages: displacements of the stages, changed in place, shape (STAGES, n, 2) [m].
        motions: motions of the contacts in the stages, changed in place, int64, shape (STAGES, n).
        problem: `spring` and `mu` of a failed step, changed in place, shape (n, 2 + max(m, 1)).
        progress: progress of `follow`, changed in place.

    Returns:
        Whether it is solved.
    """
    if stage < progress[KNOWN]:
        return True
    determined = stage == 0 and progress[DETERMINED] > 0.0
    guess = stages[stage].copy() if determined else stages[stage]
    solved, _, unique, _ = project_planar(springs, spring, mu, directions, most_sweeps, stages[stage], motions[stage])
    if solved and not unique and determined:
        unique = _stay(guess, stages[stage])
    if solved:
        progress[KNOWN] = stage + 1
        progress[NOT_UNIQUE + stage] = not unique
    else:
        problem[:, :2] = spring
        problem[:, 2:] = mu
    return solved


@lean
def pull(ends, tension, loads, target, part, spring):
    """Compute the force that friction balances on each contact: that of its springs and its load.

    Args:
        ends: the contacts of each link, int, shape (S, 2).
        tension: shape (S, 2) [N].
        loads: present loads, shape (1, n, 2) [N]; shape (0, n, 2) without loads.
        target: end of the ramp, loads last.
        part: part of the way to the target, for the loads.
        spring: output, shape (n, 2) [N].
    """
    if loads.shape[0] == 0:
        spring[:] = 0.0
    else:
        for i in range(spring.shape[0]):
            for c in range(2):
                spring[i, c] = load_at(loads, target, part, i, c)
    for s in range(ends.shape[0]):
        for c in range(2):
            spring[ends[s, 0], c] += tension[s, c]
            spring[ends[s, 1], c] -= tension[s, c]


@lean
def load_at(loads, target, part, i, c):
    """Interpolate a load on the way to its target.

    Args:
        loads: present loads, shape (1, n, 2) [N].
        target: end of the ramp, loads last.
        part: part of the way.
        i: the contact.
        c: the coordinate.

    Returns:
        The load there [N].
    """
    goal = target[target.size - loads.size + 2 * i + c]
    return goal if part == 1.0 else loads[0, i, c] + part * (goal - loads[0, i, c])


@lean
def stretch(ends, stiffness, moved, target, links, part, tension):
    """Update tensions for displacements of the contacts and part of the change of the rest lengths.

    Args:
        ends: the contacts of each link, int, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        moved: displacements, shape (n, 2) [m].
        target: end of the ramp, L first.
        links: rows TENSION and ACTUATION, shape (2, S, 2).
        part: part of the way to the target.
        tension: changed in place, shape (S, 2) [N].
    """
    for s in range(ends.shape[0]):
        for c in range(2):
            pull = moved[ends[s, 1], c] - moved[ends[s, 0], c]
            tension[s, c] += stiffness[s] * (pull - part * (target[2 * s + c] - links[ACTUATION, s, c]))


@compiled
def friction_at(friction, loads, target, part):
    """Interpolate the friction on the way to its target.

    Args:
        friction: present mu, shape (n, max(m, 1)) [N].
        loads: present loads, shape (1, n, 2) [N]; shape (0, n, 2) without loads.
        target: end of the ramp: L, mu, loads.
        part: part of the way.

    Returns:
        mu there, in the same shape [N].
    """
    last = target.size - loads.size
    commanded = target[last - friction.size : last].reshape(friction.shape)
    return (1.0 - part) * friction + part * commanded


@compiled
def _walk(
    pieces, part, springs, directions, links, friction, loads, target, most_sweeps, stages, motions, problem, progress
):
    """Take `part` of the way to the target in equal implicit steps.

    Returns whether all were solved; their displacement; in one further row dissipation and work; with loads, in one
    more row, their work.
    """
    ends, stiffness = springs.ends, springs.stiffness
    n = friction.shape[0]
    first = pieces * (pieces - 1) // 2
    total = np.zeros((n + 1 + loads.shape[0], 2))
    spring = np.empty((n, 2))
    tension = links[TENSION].copy()
    rest = np.zeros((n, 2))
    mu = friction
    for piece in range(pieces):
        before = tension.copy()
        mu_before = mu
        stretch(ends, stiffness, rest, target, links, part / pieces, tension)
        pull(ends, tension, loads, target, part * (piece + 1) / pieces, spring)
        mu = friction_at(friction, loads, target, part * (piece + 1) / pieces)
        stage = first + piece
        if stage >= progress[KNOWN] and stage > 0:  # start the search from the last stage
            stages[stage] = stages[stage - 1] if piece > 0 else stages[0] / pieces
        if not step(stage, spring, mu, directions, springs, most_sweeps, stages, motions, problem, progress):
            return False, total
        stretch(ends, stiffness, stages[stage], target, links, 0.0, tension)
        total[:n] += stages[stage]
        mean = 0.5 * (mu + mu_before)
        corners = corners_of(mean, directions)
        for i in range(n):
            if stages[stage, i, 0] == 0.0 and stages[stage, i, 1] == 0.0:
                continue
            total[n, 0] += resistance(mean[i], corners[i], stages[stage, i, 0], stages[stage, i, 1])
        for s in range(ends.shape[0]):
            for c in range(2):
                lengthened = (target[2 * s + c] - links[ACTUATION, s, c]) * part / pieces
                total[n, 1] -= 0.5 * (before[s, c] + tension[s, c]) * lengthened
        if loads.shape[0] > 0:
            middle = part * (piece + 0.5) / pieces
            for i in range(n):
                for c in range(2):
                    total[n + 1, 0] += load_at(loads, target, middle, i, c) * stages[stage, i, c]
    return True, total


@lean
def _steady_part(moved, motion, velocity, part, spring, friction, springs, loose, tolerance):
    """Estimate the part of a stretch in which no contact starts or stops; 1 if none does.

    Also returns whether it ends with a start, whose place is known well, and not with a stop.
    """
    steady = 1.0
    starts = False
    for i in range(moved.shape[0]):
        if motion[i] == STUCK:
            if part * math.hypot(velocity[i, 0], velocity[i, 1]) > _AT_ONCE * tolerance and steady > 0.3:
                steady = 0.3
                starts = False
            continue
        moves = math.hypot(moved[i, 0], moved[i, 1])
        gap = friction[i, 0] - math.hypot(spring[i, 0], spring[i, 1])
        if gap > loose and moves > _AT_ONCE * tolerance:
            before = max(gap / (gap + diagonal(springs, i) * moves), 0.05)
            if before < steady:
                steady = before
                starts = True
    return steady, starts


@lean
def _same_sliding(motions, stages, pieces, negligible):
    """Return whether the same contacts slide in a walk as in a single step, except by negligible displacements."""
    for stage in range(pieces * (pieces - 1) // 2, pieces * (pieces + 1) // 2):
        for i in range(motions.shape[1]):
            if motions[stage, i] != motions[0, i]:
                one = math.hypot(stages[0, i, 0], stages[0, i, 1])
                if max(one, math.hypot(stages[stage, i, 0], stages[stage, i, 1])) > negligible:
                    return False
    return True


@lean
def _growth(allowed, error, last, pieces):
    """Choose the factor for the length of the next stretch: for the same number of walks or one more, at least work."""
    if error == 0.0:
        return 4.0
    growth = 0.8 * (allowed / error) ** (1.0 / (pieces - 1.0))
    if 2 < pieces < _WALKS and error < last:
        more = 0.8 * (allowed * last / (error * error)) ** (1.0 / pieces)
        if more * pieces > growth * (pieces + 2.0):  # the walks take pieces (pieces + 1) / 2 steps
            growth = more
    return growth


@compiled
def attempt(
    part,
    velocity,
    spring,
    band,
    tolerance,
    allowed,
    springs,
    directions,
    links,
    friction,
    loads,
    target,
    *memory,
):
    """Compute the displacement over a part of the ramp and its error.

    Args:
        part: part of the way to the target.
        velocity: velocities at the start, shape (n, 2) [m per unit of the way].
        spring: spring forces at the start, shape (n, 2) [N].
        band: rounding band of each contact, see `missed`, shape (n,) [N].
        tolerance: tolerance of the whole ramp [m].
        allowed: error allowed for this part [m].
        springs: the springs, with K, as in `Springs`.
        directions: unit vectors, shape (m, 2).
        links: rows TENSION and ACTUATION, shape (2, S, 2).
        friction: present mu, shape (n, max(m, 1)) [N].
        loads: present loads, shape (1, n, 2) [N]; shape (0, n, 2) without loads.
        target: end of the ramp.
        memory: upper limit of sweeps, and the arrays of `step`.

    Returns:
        Whether all steps were solved; the displacement and, in further rows, dissipation and work, and the work of the
        loads if there are any; its error; the number of walks used, 0 if it is too long because a contact starts
        or stops inside; the factor for the next part.
    """
    n = spring.shape[0]
    ok, one = _walk(1, part, springs, directions, links, friction, loads, target, *memory)
    if not ok or farthest(one, n) == 0.0:
        return ok, one, 0.0, 1, 4.0
    bound = missed(one[:n], spring, friction, directions, corners_of(friction, directions), band, springs.compliance)
    if bound <= allowed:
        return True, one, bound, 1, 4.0
    if directions.shape[0] > 0:
        return True, one, bound, 1, 0.5
    motions = memory[2]
    loose = max(band.max(), _AT_ONCE * tolerance / springs.compliance)
    steady, starts = _steady_part(one[:n], motions[0], velocity, part, spring, friction, springs, loose, tolerance)
    if steady < 1.0:
        return True, one, bound, 0 if starts else 1, steady
    stop = find_stop(velocity, part, one, memory[1][0], 1, _AT_ONCE * tolerance)
    if stop < 1.0:
        return True, one, bound, 0, stop
    error = bound
    table = np.zeros((_WALKS, *one.shape))
    table[0] = one
    total = friction.sum()
    growth = 0.0
    for pieces in range(2, _WALKS + 1):
        ok, newest = _walk(pieces, part, springs, directions, links, friction, loads, target, *memory)
        if not ok:
            return False, newest, error, pieces, 1.0
        if not _same_sliding(motions, memory[1], pieces, _AT_ONCE * tolerance):
            return True, one, bound, 1, 0.5
        last_step = memory[1][pieces * (pieces + 1) // 2 - 1]
        stop = find_stop(velocity, part, newest, last_step, pieces, _AT_ONCE * tolerance)
        if stop < 1.0:
            return True, one, bound, 0, stop
        plain = newest
        before = newest
        for column in range(pieces - 1):  # Aitken and Neville, in 1/steps
            before = newest
            newest = before + (before - table[column]) * ((pieces - column - 1.0) / (column + 1.0))
            table[column] = before
        table[pieces - 1] = newest
        last = error
        error = max(farthest(newest - before, n), abs(newest[n, 0] - before[n, 0]) / total if total > 0.0 else 0.0)
        growth = _growth(allowed, error, last, pieces)
        if error <= allowed and pieces == 2:  # otherwise steps for which two walks suffice would stay short
            return True, plain, error, 2, max(growth, 2.0)
        if error <= allowed or (pieces > 2 and error > _CONVERGING * last):
            break
    return True, newest, error, pieces, growth
