"""A ramp in the plane, followed in parts of the body that contacts at rest separate from each other.

Across two neighbours that both stay at rest, the tension depends on the command alone. So the contacts that move form
parts that do not feel each other: each takes the stretches of its own events only, which would otherwise end the
stretches of all. A part contains contacts at rest around those that move; as long as its outermost ones stay at rest,
it is exactly the motion of the body. If one of them moves, the part is enlarged and followed again.
"""

from __future__ import annotations

import numpy as np

from ....compiled import compiled, lean
from ...state import ACCOUNT_SIZE, EVENTS, OVERSPENT, RESIDUAL, VISITED, WORK, add_ramp
from ...state import PLANAR_ACTUATION as ACTUATION
from ...state import PLANAR_GAINED as GAINED
from ...state import PLANAR_LOAD as LOAD
from ...state import PLANAR_TENSION as TENSION
from ...state import PLANAR_X as X
from ...state import PLANAR_X_REST as X_REST
from ..friction import corners_of
from ..ramp import follow_ramp, set_spring, visited_margin
from ..walk import NOT_UNIQUE, PATIENCE, STAGES, friction_at, load_at, pull, stretch
from .division import divide, mark_beyond, sort_by, spread, springs_between

LARGE = 64
"""Bodies of fewer contacts are followed as a whole."""
_ATTEMPTS = 12
"""Times that parts are enlarged before the body is followed as a whole."""
_MOST = 0.95
"""Part of the contacts that may move in a ramp that is followed in parts."""
_LARGEST = 0.5
"""Part of the contacts that may be in one part."""
_SHORTEST = 1.0 / 16.0
"""Stretches of a ramp that would be shorter are not followed in parts."""
_INSIDE = 1.0 - 1e-6
"""A contact with no more than this part of its friction stays at rest whatever rounding does."""


@lean
def _has_moved(moved, contacts, i):
    """Return whether a contact has another displacement than before."""
    displaced = moved[X, i, 0] != contacts[X, i, 0] or moved[X, i, 1] != contacts[X, i, 1]
    return displaced or moved[X_REST, i, 0] != contacts[X_REST, i, 0] or moved[X_REST, i, 1] != contacts[X_REST, i, 1]


@lean
def _holds(springs, contacts, owner, moved, loose):
    """Return whether some contact, and those around it, rest while its force remains inside its bounds.

    Then never can all contacts slide together, and the translation is determined.
    """
    for i in range(loose.shape[0]):
        if not loose[i]:
            continue
        rests = True
        for e in range(springs.first[i], springs.first[i + 1]):
            j = springs.other[e]
            rests = rests and not (owner[j] >= 0 and _has_moved(moved, contacts, j))
        if rests:
            return True
    return False


@compiled
def _follow_part(
    springs,
    directions,
    contacts,
    links,
    friction,
    target,
    after,
    tied,
    owner,
    members,
    strings,
    limits,
    moved,
    account,
):
    """Follow a part on its own.

    Args:
        springs: the springs of the body.
        directions: unit vectors, shape (m, 2).
        contacts: rows of the body, as the next three.
        links: rows of the springs.
        friction: mu before the ramp.
        target: end of the ramp.
        after: mu at its end.
        tied: forces of the springs between parts at the start and the end of the ramp, shape (2, n, 2) [N].
        owner: the part of each contact.
        members: the contacts of the part.
        strings: the springs between them.
        limits: tolerance, and upper limits of steps and of sweeps.
        moved: output: rows X, X_REST and GAINED of the members at the end, shape (3, n, 2).
        account: output: account of the part, shape (14,).

    Returns:
        Whether all steps were solved; whether an outermost contact moved.
    """
    tolerance, most_steps, most_sweeps = limits
    columns = friction.shape[1]
    m = members.shape[0]
    s = strings.shape[0]
    own = springs_between(springs, members, strings, owner)
    part = np.zeros((LOAD + 1, m, 2))
    bounds = np.empty((m, columns))
    goal = np.empty(2 * s + m * columns + 2 * m)
    loads = contacts[LOAD:]
    for a in range(m):
        i = members[a]
        for c in range(2):
            for row in range(LOAD):
                part[row, a, c] = contacts[row, i, c]
            load = load_at(loads, target, 1.0, i, c) if loads.shape[0] > 0 else 0.0
            part[LOAD, a, c] = tied[0, i, c] + (loads[0, i, c] if loads.shape[0] > 0 else 0.0)
            goal[2 * s + m * columns + 2 * a + c] = tied[1, i, c] + load
        for k in range(columns):
            bounds[a, k] = friction[i, k]
            goal[2 * s + columns * a + k] = after[i, k]
    lines = np.empty((2, s, 2))
    for b in range(s):
        for c in range(2):
            lines[TENSION, b, c] = links[TENSION, strings[b], c]
            lines[ACTUATION, b, c] = links[ACTUATION, strings[b], c]
            goal[2 * b + c] = target[2 * strings[b] + c]
    stages, motions = np.zeros((STAGES, m, 2)), np.zeros((STAGES, m), np.int64)
    account[:] = 0.0
    account[VISITED] = np.inf
    memory = most_sweeps, stages, motions, np.empty((m, 2 + columns))
    progress = np.zeros(NOT_UNIQUE + STAGES)
    progress[PATIENCE] = np.inf
    if not follow_ramp(own, directions, part, lines, bounds, goal, tolerance, most_steps, account, progress, *memory):
        return False, False
    if account[OVERSPENT] > 0.0:
        return False, False
    account[VISITED] = np.inf  # that of the part
    for a in range(m):
        for row in range(LOAD):
            for c in range(2):
                moved[row, members[a], c] = part[row, a, c]
    too_small = False
    for a in own.tied:
        too_small = too_small or _has_moved(moved, contacts, members[a])
    return True, too_small


@compiled
def _commit_parts(springs, directions, contacts, links, friction, target, after, owner, moved, account):
    """Apply the ends of all parts to the body, and complete its account."""
    for i in range(friction.shape[0]):
        if owner[i] >= 0:
            for row in (X, X_REST, GAINED):
                for c in range(2):
                    contacts[row, i, c] = moved[row, i, c]
    for s in range(springs.ends.shape[0]):
        part = owner[springs.ends[s, 0]]
        for c in range(2):
            old = links[TENSION, s, c]
            goal = target[2 * s + c]
            change = goal - links[ACTUATION, s, c]
            gained = set_spring(springs.ends, springs.stiffness, contacts, links, s, c, goal)
            if part < 0 or part != owner[springs.ends[s, 1]]:  # the account of a part contains its springs
                work = -0.5 * (old + links[TENSION, s, c]) * change
                account[WORK] += work
                account[RESIDUAL] += gained - work
    friction[:] = after
    loads = contacts[LOAD:]
    if loads.shape[0] > 0:
        for i in range(friction.shape[0]):
            for c in range(2):
                loads[0, i, c] = load_at(loads, target, 1.0, i, c)
    spring = np.empty((friction.shape[0], 2))
    pull(springs.ends, links[TENSION], loads, target, 1.0, spring)
    account[VISITED] = min(
        account[VISITED], visited_margin(spring, friction, directions, corners_of(after, directions))
    )


@compiled
def _follow_stretch(
    springs, directions, contacts, links, friction, target, tolerance, most_steps, account, most_sweeps
):
    """Follow a stretch of a ramp in parts if no part contains most of the body; the arguments are `follow_in_parts`'s.

    Returns whether it was followed; if not, nothing has changed.
    """
    n = friction.shape[0]
    loads = contacts[LOAD:]
    after = friction_at(friction, loads, target, 1.0)
    held = links[TENSION].copy()
    force = np.zeros((n, 2))
    stretch(springs.ends, springs.stiffness, force, target, links, 1.0, held)
    pull(springs.ends, held, loads, target, 1.0, force)
    moving, ready, loose = np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty(n, np.bool_)
    if mark_beyond(force, after, directions, 1.0, moving) > _MOST * n:
        return False
    mark_beyond(force, after, directions, _INSIDE, loose)
    pull(springs.ends, links[TENSION], loads, target, 0.0, force)
    mark_beyond(force, friction, directions, _INSIDE, ready)
    loose = ~(loose | ready)
    total = spread(springs, ready, moving)
    owner, followed = np.empty(n, np.int64), np.full(n, -1)
    tied, accounts = np.empty((2, n, 2)), np.empty((n, ACCOUNT_SIZE))
    moved = np.empty((LOAD, n, 2))
    body = springs, directions, contacts, links, friction, target, after
    for _ in range(_ATTEMPTS):
        if total > _MOST * n:
            return False
        divide(springs, moving, owner)
        between = np.full(held.shape[0], -1)
        tied[:] = 0.0
        for s in range(held.shape[0]):
            a = springs.ends[s, 0]
            b = springs.ends[s, 1]
            if owner[a] == owner[b]:
                between[s] = owner[a]
                continue
            for c in range(2):
                tied[0, a, c] += links[TENSION, s, c]
                tied[0, b, c] -= links[TENSION, s, c]
                tied[1, a, c] += held[s, c]
                tied[1, b, c] -= held[s, c]
        members, begin = sort_by(owner, springs.order, n)
        if np.diff(begin).max() > _LARGEST * n:
            return False
        strings, start = sort_by(between, np.arange(held.shape[0]), n)
        enlarged = False
        for k in range(n):
            part = members[begin[k] : begin[k + 1]]
            if part.shape[0] == 0 or np.all(followed[part] == part.shape[0] * n + k):
                continue
            own = strings[start[k] : start[k + 1]]
            solved, too_small = _follow_part(
                *body, tied, owner, part, own, (tolerance, most_steps, most_sweeps), moved, accounts[k]
            )
            if not solved:
                return False
            followed[part] = -1 if too_small else part.shape[0] * n + k
            if too_small:
                enlarged = True
                for i in part:
                    moving[i] = moving[i] or _has_moved(moved, contacts, i)
        if not enlarged:
            if not _holds(springs, contacts, owner, moved, loose):
                return False
            if total == 0:
                account[EVENTS] += 1.0
            for k in range(n):
                if begin[k + 1] > begin[k]:
                    add_ramp(account, accounts[k])
            _commit_parts(*body, owner, moved, account)
            return True
        total = spread(springs, ready, moving)
    return False


@compiled
def follow_in_parts(
    springs, directions, contacts, links, friction, target, tolerance, most_steps, account, most_sweeps
):
    """Follow a straight ramp of the commands in parts, as far as no part contains most of the body.

    Args:
        springs: as for `follow_ramp`, like all but the last.
        directions: shape (m, 2).
        contacts: shape (3, n, 2) or (4, n, 2), changed in place.
        links: shape (2, S, 2), changed in place.
        friction: shape (n, max(m, 1)), changed in place.
        target: end of the ramp.
        tolerance: approximate largest displacement error [m].
        most_steps: upper limit of implicit steps tried in a part.
        account: total account, shape (14,), added to.
        most_sweeps: upper limit of sweeps of a step.

    Returns:
        The part of the ramp that was followed, from 0 to 1.
    """
    place = 0.0
    length = 1.0
    loads = contacts[LOAD:]
    while place < 1.0 and length >= _SHORTEST:
        goal = target.copy()
        if place + length < 1.0:
            part = length / (1.0 - place)
            now = np.concatenate((links[ACTUATION].ravel(), friction.ravel(), loads.ravel()))
            goal = now + part * (target - now)
        limits = goal, tolerance * length, most_steps, account, most_sweeps
        if _follow_stretch(springs, directions, contacts, links, friction, *limits):
            place += length
        else:
            length *= 0.5
    return place
