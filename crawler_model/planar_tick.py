"""One ramp of the commands in the plane, to a tolerance, with its energy account.

The path along a ramp is curved. It is walked in one, in two and in three implicit steps, which is extrapolated to
third order where no contact starts or stops. A contact that stays put stays put exactly. A step without displacement
is exact.
"""

from __future__ import annotations

import math

import numpy as np

from . import planar_kernel
from ._compiled import compiled
from .planar_cone import solve_with_clarabel
from .planar_friction import corners_of, excess, resistance
from .planar_kernel import laplacian_of, project_planar
from .state import (
    AMBIGUOUS,
    COMPLEMENTARITY,
    DISSIPATION,
    EVENTS,
    OVERSPENT,
    RESIDUAL,
    VIOLATION,
    VISITED,
    WORK,
)
from .state import PLANAR_ACTUATION as ACTUATION
from .state import PLANAR_GAINED as GAINED
from .state import PLANAR_TENSION as TENSION
from .state import PLANAR_X as X
from .state import PLANAR_X_REST as X_REST

# Where `follow` stands: the ramp, the place on it, the length of the substep tried (0 before a ramp), the error
# left to spend where the motion is not smooth, substeps tried, stages of this one that are known, which are not unique.
_RAMP, _PLACE, _LENGTH, _PURSE, _TRIALS, _KNOWN, _DOUBTS = range(7)
_STAGES = 7
"""Implicit steps of a substep: 1 + 2 + 3, and one that corrects the extrapolation."""
_ROUNDING = 1e-12
"""Errors below this part of the displacement that friction withstands are rounding."""
_SHORT = 1.0 / 4096.0
"""A shorter substep may err as much as this part of a ramp: its error need not shrink with it where sliding directions
have yet to settle."""
_LAST_STEP = 1.0 / 256.0
"""Part of a ramp that a step takes when all substeps are spent."""
_LAST_SWEEPS = 20
"""Sweeps that polish what Clarabel found."""


@compiled
def _step(stage, spring, mu, directions, laplacian, most_sweeps, stages, motions, problem, progress):
    """Solve the implicit step number `stage` unless it is known; False if that failed: `problem` then holds it."""
    if stage < progress[_KNOWN]:
        return True
    solved, _, unique, _ = project_planar(laplacian, spring, mu, directions, most_sweeps, stages[stage], motions[stage])
    if solved:
        progress[_KNOWN] = stage + 1
        progress[_DOUBTS + stage] = not unique
    else:
        problem[:, :2] = spring
        problem[:, 2:] = mu
    return solved


@compiled
def _load(ends, tension, spring):
    """Sum the tensions at both ends of each link to the spring forces."""
    spring[:] = 0.0
    for s in range(ends.shape[0]):
        for c in range(2):
            spring[ends[s, 0], c] += tension[s, c]
            spring[ends[s, 1], c] -= tension[s, c]


@compiled
def _stretch(ends, stiffness, moved, target, links, part, tension):
    """Change the tensions by displacements of the contacts and by a part of the way to the commanded rest lengths."""
    for s in range(ends.shape[0]):
        for c in range(2):
            pull = moved[ends[s, 1], c] - moved[ends[s, 0], c]
            tension[s, c] += stiffness[s] * (pull - part * (target[2 * s + c] - links[ACTUATION, s, c]))


@compiled
def _friction_at(friction, target, part):
    """Compute the friction at a part of the way to its target."""
    commanded = target[target.shape[0] - friction.size :].reshape(friction.shape)
    return (1.0 - part) * friction + part * commanded


@compiled
def _walk(
    first, pieces, part, body, directions, links, friction, target, most_sweeps, stages, motions, problem, progress
):
    """Go `part` of the way to the target in equal implicit steps, which are stages first, first + 1, ...

    Returns whether all were solved, and their displacement.
    """
    laplacian, ends, stiffness = body
    total = np.zeros((laplacian.shape[0], 2))
    spring = np.empty_like(total)
    tension = links[TENSION].copy()
    rest = np.zeros_like(total)
    for piece in range(pieces):
        _stretch(ends, stiffness, rest, target, links, part / pieces, tension)
        _load(ends, tension, spring)
        mu = _friction_at(friction, target, part * (piece + 1) / pieces)
        stage = first + piece
        if stage >= progress[_KNOWN] and stage > 0:  # begin the search at the last stage's displacement
            stages[stage] = stages[stage - 1] if piece > 0 else stages[0] / pieces
        if not _step(stage, spring, mu, directions, laplacian, most_sweeps, stages, motions, problem, progress):
            return False, total
        _stretch(ends, stiffness, stages[stage], target, links, 0.0, tension)
        total += stages[stage]
    return True, total


@compiled
def _farthest(a):
    """Compute the greatest length of the rows of an array of shape (n, 2)."""
    most = 0.0
    for i in range(a.shape[0]):
        most = max(most, math.hypot(a[i, 0], a[i, 1]))
    return most


@compiled
def _commit(moved, part, ends, stiffness, directions, contacts, links, friction, target, account):
    """Take a substep: change the state and add to the account."""
    n = moved.shape[0]
    for i in range(n):
        for c in range(2):
            contacts[GAINED, i, c] += moved[i, c]
            change = moved[i, c] + contacts[X_REST, i, c]
            before = contacts[X, i, c]
            after = before + change
            kept = after - before
            contacts[X, i, c] = after
            contacts[X_REST, i, c] = (before - (after - kept)) + (change - kept)
    gained = 0.0
    work = 0.0
    for s in range(ends.shape[0]):
        a = ends[s, 0]
        b = ends[s, 1]
        for c in range(2):
            old = links[TENSION, s, c]
            length = links[ACTUATION, s, c]
            goal = target[2 * s + c] if part == 1.0 else length + part * (target[2 * s + c] - length)
            shape = contacts[X, b, c] - contacts[X, a, c] + (contacts[X_REST, b, c] - contacts[X_REST, a, c])
            new = stiffness[s] * (shape - goal)
            work -= 0.5 * (old + new) * (goal - length)
            gained += 0.5 * (new - old) * (new + old) / stiffness[s]
            links[TENSION, s, c] = new
            links[ACTUATION, s, c] = goal
    after_friction = _friction_at(friction, target, part)
    mean = 0.5 * (friction + after_friction)
    friction[:] = after_friction
    corners = corners_of(friction, directions)
    mean_corners = corners_of(mean, directions)
    spring = np.empty((n, 2))
    _load(ends, links[TENSION], spring)
    dissipated = 0.0
    near = 0.0
    sizes = 0.0
    for i in range(n):
        g0 = spring[i, 0]
        g1 = spring[i, 1]
        v0 = moved[i, 0]
        v1 = moved[i, 1]
        dissipated += resistance(mean[i], mean_corners[i], v0, v1)
        _, e0, e1 = excess(g0, g1, friction[i], directions, corners[i], 0.0)
        account[VIOLATION] = max(account[VIOLATION], math.hypot(e0, e1))
        lost = resistance(friction[i], corners[i], v0, v1) - (g0 * v0 + g1 * v1)
        account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], lost)
        if directions.shape[0] == 0:
            near += max(friction[i, 0] - math.hypot(g0, g1), 0.0)
            sizes += 2.0 * friction[i, 0]
            continue
        least = np.inf
        size = 0.0
        for k in range(directions.shape[0]):
            gap = friction[i, k] - g0 * directions[k, 0] - g1 * directions[k, 1]
            if gap < least:
                least = gap
                size = friction[i, k] + resistance(friction[i], corners[i], -directions[k, 0], -directions[k, 1])
        near += max(least, 0.0)
        sizes += size
    account[WORK] += work
    account[DISSIPATION] += dissipated
    account[RESIDUAL] += gained + dissipated - work
    account[VISITED] = min(account[VISITED], near / sizes if sizes > 0.0 else 0.0)
    account[EVENTS] += 1.0


@compiled
def _is_still(links, friction, target):
    """Tell whether a target changes nothing."""
    for s in range(links.shape[1]):
        if target[2 * s] != links[ACTUATION, s, 0] or target[2 * s + 1] != links[ACTUATION, s, 1]:
            return False
    return bool(np.all(_friction_at(friction, target, 1.0) == friction))


@compiled
def _unaccounted(moved, part, ends, stiffness, directions, links, friction, target):
    """Compute dE + dissipation - work = R(v) - (mean spring force) . v of a substep, as a length: by all friction."""
    tension = links[TENSION].copy()
    _stretch(ends, stiffness, moved, target, links, part, tension)
    tension += links[TENSION]
    spring = np.empty_like(moved)
    _load(ends, tension, spring)
    mean = 0.5 * (friction + _friction_at(friction, target, part))
    corners = corners_of(mean, directions)
    energy = 0.0
    total = 0.0
    for i in range(moved.shape[0]):
        energy += resistance(mean[i], corners[i], moved[i, 0], moved[i, 1])
        energy -= 0.5 * (spring[i, 0] * moved[i, 0] + spring[i, 1] * moved[i, 1])
        total += mean[i].max()
    return abs(energy) / total if total > 0.0 else 0.0


@compiled
def _attempt(part, body, directions, links, friction, target, tolerance, forced, *memory):
    """Find the displacement over a part of the ramp and how uncertain it is.

    Returns whether all steps were solved, the displacement, its error, and whether that was met by extrapolation.
    """
    ok, one = _walk(0, 1, part, body, directions, links, friction, target, *memory)
    if not ok or forced or _farthest(one) == 0.0:
        return ok, one, 0.0, False
    ok, two = _walk(1, 2, part, body, directions, links, friction, target, *memory)
    error = _farthest(two - one)
    if not ok or error <= tolerance:
        return ok, two, error, False
    ok, three = _walk(3, 3, part, body, directions, links, friction, target, *memory)
    if not ok:
        return ok, three, error, False
    motions = memory[2]
    for stage in range(1, 6):
        if not np.array_equal(motions[stage], motions[0]):  # a contact starts, stops or turns: nothing to extrapolate
            return True, three, _farthest(three - two), False
    change = 0.5 * ((3.0 * three - 2.0 * two) - (2.0 * two - one))  # Aitken and Neville, in 1/steps
    return True, 3.0 * three - 2.0 * two + change, _farthest(change), True


@compiled
def _follow(
    body, directions, contacts, links, friction, targets, tolerance, most_steps, account, records, progress, *memory
):
    """Follow the ramps from where `progress` stands; return False where a step needs help from outside."""
    laplacian, ends, stiffness = body
    most_sweeps, stages, motions, problem = memory
    n = laplacian.shape[0]
    blur = 0.0
    for i in range(n):
        blur = max(blur, _ROUNDING * friction[i].max() / laplacian[i, i])
    while progress[_RAMP] < targets.shape[0]:
        target = targets[int(progress[_RAMP])]
        done = False
        if progress[_LENGTH] == 0.0:  # a new ramp
            done = _is_still(links, friction, target)
            progress[_PLACE] = 0.0
            progress[_LENGTH] = 1.0
            progress[_PURSE] = tolerance
            progress[_TRIALS] = 0.0
            stages[0] = 0.0
        if not done:
            length = progress[_LENGTH]
            forced = progress[_TRIALS] >= most_steps
            if forced:  # the rest goes in equal steps, however far off they are
                length = _LAST_STEP
            last = progress[_PLACE] + length >= 1.0 - 1e-12
            if last:
                length = 1.0 - progress[_PLACE]
            part = 1.0 if last else length / (1.0 - progress[_PLACE])
            allowed = max(tolerance * max(length, _SHORT), blur)
            ok, moved, error, extrapolated = _attempt(
                part, body, directions, links, friction, target, allowed, forced, *memory, progress
            )
            if not ok:
                return False
            error = max(error, _unaccounted(moved, part, ends, stiffness, directions, links, friction, target))
            accepted = forced or error <= allowed
            paid = 0.0
            if not accepted and error <= 0.125 * progress[_PURSE]:  # where the motion is not smooth
                paid = error
                accepted = True
            if accepted and extrapolated:  # put the spring forces back onto the friction sets
                tension = links[TENSION].copy()
                spring = np.empty((n, 2))
                _stretch(ends, stiffness, moved, target, links, part, tension)
                _load(ends, tension, spring)
                mu = _friction_at(friction, target, part)
                if progress[_KNOWN] < _STAGES:
                    stages[_STAGES - 1] = 0.0
                if not _step(
                    _STAGES - 1, spring, mu, directions, laplacian, most_sweeps, stages, motions, problem, progress
                ):
                    return False
                moved = moved + stages[_STAGES - 1]
            if accepted:
                _commit(moved, part, ends, stiffness, directions, contacts, links, friction, target, account)
                progress[_PLACE] += length
                progress[_PURSE] -= paid
                if progress[_DOUBTS:].max() > 0.0:
                    account[AMBIGUOUS] = 1.0
                account[OVERSPENT] += forced and last
            done = accepted and last
            growth = min(0.8 * math.sqrt(allowed / error), 4.0) if error > 0.0 else 4.0
            growth = max(growth, 0.3) if accepted else min(max(growth, 0.1), 0.5)
            if accepted and not extrapolated:  # steps so short that two of them do would stay short for ever
                growth = max(growth, 2.0)
            stages[0] *= growth
            progress[_LENGTH] = growth * length
            progress[_TRIALS] += 1.0
            progress[_KNOWN] = 0.0
            progress[_DOUBTS:] = 0.0
        if done:
            v = int(progress[_RAMP])
            if records.shape[0] > 0:
                records[v, : 2 * n] = contacts[X].ravel()
                records[v, 2 * n : 4 * n] = contacts[X_REST].ravel()
                records[v, 4 * n :] = links[TENSION].ravel()
            progress[_RAMP] += 1.0
            progress[_LENGTH] = 0.0
    return True


def follow(
    ends: np.ndarray,
    stiffness: np.ndarray,
    directions: np.ndarray,
    contacts: np.ndarray,
    links: np.ndarray,
    friction: np.ndarray,
    targets: np.ndarray,
    tolerance: float,
    most_steps: int,
    account: np.ndarray,
    records: np.ndarray,
) -> None:
    """Follow straight ramps of the commands to each of the targets in turn.

    Args:
        ends: the contacts a, b of each link, int, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        directions: unit vectors d_k, counterclockwise, shape (m, 2); m = 0 for isotropic friction.
        contacts: rows X, X_REST (what rounding took from X) and GAINED (since the call), shape (3, n, 2) [m],
            changed in place.
        links: rows TENSION [N] and ACTUATION [m], shape (2, S, 2), changed in place; the tension must be
            k (x_b - x_a - L), it is derived from the displacements anew, rest and all, after every substep.
        friction: mu, shape (n, max(m, 1)) [N], changed in place.
        targets: L and then mu at each ramp's end, flattened, shape (V, 2 S + n max(m, 1)).
        tolerance: about the largest error of any displacement that one ramp may add [m].
        most_steps: most substeps tried in one ramp; the rest of it then goes in equal implicit steps.
        account: shape (12,), added to.
        records: x, its rest and tension after each ramp, flattened, shape (V, 4 n + 2 S) or (0, ...) for none.
    """
    n = contacts.shape[1]
    contacts[GAINED] = 0.0
    laplacian = laplacian_of(ends, stiffness, n)
    progress = np.zeros(_DOUBTS + _STAGES)
    stages, motions = np.zeros((_STAGES, n, 2)), np.zeros((_STAGES, n), np.int64)
    problem = np.empty((n, 2 + friction.shape[1]))
    body, memory = (laplacian, ends, stiffness), (planar_kernel.MOST_SWEEPS, stages, motions, problem)
    state = (directions, contacts, links, friction, targets, tolerance, most_steps, account, records, progress)
    while not _follow(body, *state, *memory):
        stage = int(progress[_KNOWN])
        spring, mu = problem[:, :2].copy(), problem[:, 2:].copy()
        stages[stage] = solve_with_clarabel(laplacian, spring, mu, directions)
        unique = project_planar(laplacian, spring, mu, directions, _LAST_SWEEPS, stages[stage], motions[stage])[2]
        progress[_KNOWN] = stage + 1
        progress[_DOUBTS + stage] = not unique
