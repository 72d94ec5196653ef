"""A ramp of vector springs, followed in parts of the body that contacts at rest separate from each other.

Across two neighbours that both stay at rest, the tension depends on the command alone. So the contacts that move form
parts that do not feel each other: each takes the stretches of its own events only, which would otherwise end the
stretches of all. A part contains contacts at rest around those that move; as long as its outermost ones stay at rest,
it is exactly the motion of the body, and the springs to contacts outside are loads. If one of them moves, the part is
enlarged and followed again.
"""

from __future__ import annotations

import numpy as np

from ....compiled import compiled, lean
from ...state import ACCOUNT_SIZE, EVENTS, RESIDUAL, VISITED, WORK, add_ramp
from ..elastic import pull, stretch_vector
from ..frame import columns_of, load_of
from ..friction import gap_of
from ..ramp import LEFT, LENGTH, MARGIN, PATIENCE, follow_ramp, part_of_friction
from ..walk import command_at
from .division import divide, frame_of, list_neighbours, mark_beyond, sort_by, spread

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
def _has_moved(moved, x, i):
    """Return whether a contact has another displacement than before."""
    return moved[i, 0] != x[i, 0] or moved[i, 1] != x[i, 1]


@lean
def _holds(neighbours, x, owner, moved, loose):
    """Return whether some contact, and those around it, rest while its force remains inside its bounds.

    Then never can all contacts slide together, and the translation is determined.
    """
    for i in range(loose.shape[0]):
        if not loose[i]:
            continue
        rests = True
        for e in range(neighbours.first[i], neighbours.first[i + 1]):
            j = neighbours.other[e]
            rests = rests and not (owner[j] >= 0 and _has_moved(moved, x, j))
        if rests:
            return True
    return False


@lean
def _command_of(frame, command, tied, members, strings, own):
    """Write the command of a part: that of the body, and the forces of the springs to contacts outside as loads."""
    at = 2 * strings.shape[0]
    columns = columns_of(frame)
    for b in range(strings.shape[0]):
        own[2 * b] = command[2 * strings[b]]
        own[2 * b + 1] = command[2 * strings[b] + 1]
    for a in range(members.shape[0]):
        i = members[a]
        for k in range(columns):
            own[at + columns * a + k] = command[frame.stiffness.shape[0] + columns * i + k]
        for c in range(2):
            own[at + columns * members.shape[0] + 2 * a + c] = tied[i, c] + load_of(frame, command, i, c)


@compiled
def _follow_part(frame, neighbours, ramp, tied, part, moved, account):
    """Follow a part on its own.

    Args:
        frame: the body.
        neighbours: the neighbours of each contact.
        ramp: the state as for `follow_ramp`, the end of the ramp, and its tolerance [m].
        tied: forces of the springs between parts at the start and the end of the ramp, shape (2, n, 2) [N].
        part: the part of each contact, the contacts of the part, and the springs between them.
        moved: output: displacements of the members at the end, shape (n, 2) [m].
        account: output: account of the part, shape (14,).

    Returns:
        Whether it was followed to the end; whether an outermost contact moved.
    """
    (x, _, command, yaw), target, tolerance = ramp
    owner, members, strings = part
    m = members.shape[0]
    own = frame_of(frame, members, strings, np.empty(owner.shape[0], np.int64))
    now = np.empty(2 * strings.shape[0] + (columns_of(frame) + 2) * m)
    goal = np.empty(now.shape[0])
    _command_of(frame, command, tied[0], members, strings, now)
    _command_of(frame, target, tied[1], members, strings, goal)
    account[:] = 0.0
    account[VISITED] = np.inf
    progress = np.zeros(5)
    progress[LENGTH] = 1.0
    progress[LEFT] = tolerance
    progress[MARGIN] = progress[PATIENCE] = np.inf
    places = x[members]
    own_state = places, np.zeros((m, 2)), now, yaw.copy()
    if not follow_ramp(own, own_state, goal, tolerance, np.zeros((m, 2)), account, progress):
        return False, False
    account[VISITED] = np.inf  # that of the part
    too_small = False
    for a in range(m):
        i = members[a]
        for c in range(2):
            moved[i, c] = places[a, c]
        if _has_moved(moved, x, i):
            for e in range(neighbours.first[i], neighbours.first[i + 1]):
                too_small = too_small or owner[neighbours.other[e]] != owner[i]
    return True, too_small


@compiled
def _commit_parts(frame, state, target, owner, moved, account):
    """Apply the ends of all parts to the body, and complete its account."""
    x, gained, command, _ = state
    for s in range(frame.ends.shape[0]):
        part = owner[frame.ends[s, 0]]
        if part >= 0 and part == owner[frame.ends[s, 1]]:  # the account of a part contains its springs
            continue
        for c in range(2):
            before = stretch_vector(frame, command, x, s, c)
            after = stretch_vector(frame, target, x, s, c)
            work = -0.5 * (before + after) * (target[2 * s + c] - command[2 * s + c])
            account[WORK] += work
            account[RESIDUAL] += 0.5 * (after - before) * (after + before) / frame.stiffness[2 * s + c] - work
    for i in range(owner.shape[0]):
        if owner[i] >= 0:
            for c in range(2):
                gained[i, c] += moved[i, c] - x[i, c]
                x[i, c] = moved[i, c]
    command[:] = target
    n = owner.shape[0]
    force, size = np.empty((n, 2)), np.empty(n)
    pull(frame, command, x, force, size)
    near = 0.0
    for i in range(n):
        gap = gap_of(frame, command, x, i, force)
        near += max(gap, 0.0) if gap < np.inf else 0.0
    account[VISITED] = min(account[VISITED], part_of_friction(frame, command, near))


@compiled
def _follow_stretch(frame, neighbours, state, target, tolerance, account):
    """Follow a stretch of a ramp in parts if no part contains most of the body; the arguments are `follow_in_parts`'s.

    Returns whether it was followed; if not, nothing has changed.
    """
    x, _, command, _ = state
    n = x.shape[0]
    force, size = np.empty((n, 2)), np.empty(n)
    moving, ready, loose = np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty(n, np.bool_)
    pull(frame, target, x, force, size)
    if mark_beyond(frame, target, force, 1.0, moving) > _MOST * n:
        return False
    mark_beyond(frame, target, force, _INSIDE, loose)
    pull(frame, command, x, force, size)
    mark_beyond(frame, command, force, _INSIDE, ready)
    loose = ~(loose | ready)
    total = spread(neighbours, ready, moving)
    owner, followed = np.empty(n, np.int64), np.full(n, -1)
    tied, accounts, moved = np.empty((2, n, 2)), np.empty((n, ACCOUNT_SIZE)), np.empty((n, 2))
    springs = frame.ends.shape[0]
    for _ in range(_ATTEMPTS):
        if total > _MOST * n:
            return False
        divide(neighbours, moving, owner)
        between = np.full(springs, -1)
        tied[:] = 0.0
        for s in range(springs):
            a, b = frame.ends[s]
            if owner[a] == owner[b]:
                between[s] = owner[a]
                continue
            for c in range(2):
                for end in range(2):
                    tension = stretch_vector(frame, target if end == 1 else command, x, s, c)
                    tied[end, a, c] += tension
                    tied[end, b, c] -= tension
        members, begin = sort_by(owner, frame.order, n)
        if np.diff(begin).max() > _LARGEST * n:
            return False
        strings, start = sort_by(between, np.arange(springs), n)
        enlarged = False
        for k in range(n):
            own = members[begin[k] : begin[k + 1]]
            if own.shape[0] == 0 or np.all(followed[own] == own.shape[0] * n + k):
                continue
            part = owner, own, strings[start[k] : start[k + 1]]
            ramp = state, target, tolerance
            solved, too_small = _follow_part(frame, neighbours, ramp, tied, part, moved, accounts[k])
            if not solved:
                return False
            followed[own] = -1 if too_small else own.shape[0] * n + k
            if too_small:
                enlarged = True
                for i in own:
                    moving[i] = moving[i] or _has_moved(moved, x, i)
        if not enlarged:
            if not _holds(neighbours, x, owner, moved, loose):
                return False
            if total == 0:
                account[EVENTS] += 1.0
            for k in range(n):
                if begin[k + 1] > begin[k]:
                    add_ramp(account, accounts[k])
            _commit_parts(frame, state, target, owner, moved, account)
            return True
        total = spread(neighbours, ready, moving)
    return False


@compiled
def follow_in_parts(frame, state, target, tolerance, account):
    """Follow a straight ramp of the commands in parts, as far as no part contains most of the body.

    Args:
        frame: the body.
        state: as for `follow_ramp`, changed in place.
        target: end of the ramp, shape (C,).
        tolerance: largest error of the displacements [m].
        account: added to, shape (14,).

    Returns:
        The part of the ramp that was followed, from 0 to 1.
    """
    place = 0.0
    length = 1.0
    command = state[2]
    neighbours = list_neighbours(frame.ends, frame.position.shape[0])
    goal = np.empty(target.shape[0])
    while place < 1.0 and length >= _SHORTEST:
        part = length / (1.0 - place) if place + length < 1.0 else 1.0
        command_at(command, target, part, goal)
        if _follow_stretch(frame, neighbours, state, goal, tolerance * length, account):
            place += length
        else:
            length *= 0.5
    return place
