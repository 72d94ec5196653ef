"""Contacts of a chain that cross borders of patches within a ramp, each with the block of contacts around it.

What happens at a border is described in `motion.ground.walk`, which also does what is left out here: jumps during which
other contacts reach borders or nothing holds the body. Then the ramp stops at the border.
"""

from __future__ import annotations

import numpy as np

from ...body.places import find_bounds, survey
from ...compiled import compiled, lean
from ..borders import (
    COUNT,
    JUMP_BORDER,
    JUMP_CONTACT,
    JUMP_DISTANCE,
    JUMP_LOSS,
    JUMP_PART,
    JUMP_RAMP,
    LOST,
    OF_RAMP,
    SAME,
    find_meeting,
    gap_ahead,
    is_moving,
)
from ..state import AT_BACKWARD, AT_FORWARD, BACKWARD, FORWARD, LOAD, LOAD_CHANGE, X
from .fall import ENDED, LEFT_OUT, bound_at, fall
from .memory import ROW_D_BACKWARD, ROW_D_FORWARD, ROW_LEAVING, ROW_MEETING, ROW_SINCE, ROW_V
from .rates import begin_tournament, enter_event, update

# -- the next border --------------------------------------------------------------------------------------------------


@compiled
def begin_meetings(contacts, floats, patches, leaves):
    """Find where all contacts reach their next borders, and begin the tournament of these places.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N).
        floats: velocities, and the places since which they hold.
        patches: the ground; `meetings` is changed in place.
        leaves: number of leaves of the tournament.

    Returns:
        The largest velocity [m per unit of the ramp].
    """
    fastest = np.abs(floats[ROW_V]).max()
    for i in range(contacts.shape[1]):
        floats[ROW_MEETING, i] = np.inf
        if is_moving(floats[ROW_V, i], fastest):
            floats[ROW_MEETING, i] = find_meeting(contacts, floats[ROW_V, i], floats[ROW_SINCE, i], patches.ground, i)
    begin_tournament(patches.meetings, leaves, floats[ROW_MEETING])
    return fastest


@compiled
def update_meetings(contacts, floats, patches, leaves, first, last, fastest):
    """Find again where contacts first..last reach their next borders.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N).
        floats: velocities, and the places since which they hold.
        patches: the ground; `meetings` is changed in place.
        leaves: number of leaves of the tournament.
        first: the first contact.
        last: the last contact.
        fastest: the largest velocity on the ramp so far [m per unit of the ramp].

    Returns:
        The largest velocity on the ramp so far.
    """
    for i in range(first, last + 1):
        fastest = max(fastest, abs(floats[ROW_V, i]))
    for i in range(first, last + 1):
        meeting = np.inf
        if is_moving(floats[ROW_V, i], fastest):
            meeting = find_meeting(contacts, floats[ROW_V, i], floats[ROW_SINCE, i], patches.ground, i)
        enter_event(patches.meetings, leaves, meeting, i)
    return fastest


@compiled
def next_meeting(floats, patches, leaves, s, fastest):
    """Find where on the ramp the first contact reaches a border.

    Args:
        floats: velocities.
        patches: the ground; contacts that do not move are removed from `meetings`.
        leaves: number of leaves of the tournament.
        s: present place on the ramp.
        fastest: the largest velocity on the ramp so far [m per unit of the ramp].

    Returns:
        The place on the ramp, at least s; infinite if no contact slides towards a border.
    """
    tree = patches.meetings
    while tree[2] < np.inf and not is_moving(floats[ROW_V, int(tree[3])], fastest):
        enter_event(tree, leaves, np.inf, int(tree[3]))
    return max(tree[2], s)


# -- crossing ---------------------------------------------------------------------------------------------------------


@compiled
def _collect(contacts, floats, patches, leaves, hits, s, fastest):
    """Mark and list the contacts that have reached a border; those about to leave one only if none arrives."""
    tree = patches.meetings
    count = 0
    arriving = False
    while tree[2] < np.inf:
        i = int(tree[3])
        v = floats[ROW_V, i]
        gap, near = gap_ahead(contacts, patches.ground, i, v)
        if tree[2] > s and gap - abs(v) * (s - floats[ROW_SINCE, i]) > 2.0 * near:
            break
        enter_event(tree, leaves, np.inf, i)
        if is_moving(v, fastest):
            patches.reached[i] = 1 if v > 0.0 else -1
            arriving |= patches.place[i] % 2 == 0
            hits[count] = i
            count += 1
    if not arriving:
        return count
    kept = 0
    for k in range(count):
        i = int(hits[k])
        if patches.place[i] % 2 == 0:
            hits[kept] = i
            kept += 1
        else:
            patches.reached[i] = 0
            meeting = find_meeting(contacts, floats[ROW_V, i], floats[ROW_SINCE, i], patches.ground, i)
            enter_event(tree, leaves, meeting, i)
    return kept


@lean
def _hold(contacts, floats, s, i, direction, bound):
    """Set the bound of contact i in a direction at s."""
    if direction > 0:
        contacts[FORWARD, i] = bound
        floats[ROW_D_FORWARD, i] = 0.0
    else:
        contacts[BACKWARD, i] = bound
        floats[ROW_D_BACKWARD, i] = 0.0


@compiled
def _enter(contacts, floats, patches, begin, end, target, i, place):
    """Put contact i onto a place."""
    n = contacts.shape[1]
    patches.place[i] = place
    survey(patches.stretches, patches.position[i], place, i, patches.ground, i)
    forward, backward, load = find_bounds(begin, n - 1, n, i, patches.ground, i)
    target[n - 1 + i], target[2 * n - 1 + i], target[3 * n - 1 + i] = find_bounds(end, n - 1, n, i, patches.ground, i)
    contacts[FORWARD, i] = forward
    contacts[BACKWARD, i] = backward
    contacts[LOAD, i] = load
    floats[ROW_D_FORWARD, i] = target[n - 1 + i] - forward
    floats[ROW_D_BACKWARD, i] = target[2 * n - 1 + i] - backward
    contacts[LOAD_CHANGE, i] = target[3 * n - 1 + i] - load


@compiled
def _meet(contacts, status, floats, patches, begin, end, target, s, i, direction):
    """Let contact i, at its bound, leave the border that it stands on, or stand on the one that it has reached or pass.

    Returns whether its bound has to fall then, and the bound on the ground that it comes from.
    """
    place = patches.place[i]
    bit = AT_FORWARD if direction > 0 else AT_BACKWARD
    now = bound_at(contacts, floats, s, i, direction)
    size = abs(bound_at(contacts, floats, s, i, 1)) + abs(bound_at(contacts, floats, s, i, -1))
    leaves_border = place % 2 == 1
    _enter(contacts, floats, patches, begin, end, target, i, place + (direction if leaves_border else 2 * direction))
    new = bound_at(contacts, floats, s, i, direction)
    near = SAME * (size + abs(new))
    if not leaves_border and new > now + near:
        _enter(contacts, floats, patches, begin, end, target, i, place + direction)
        status[i] &= ~bit
        return False, now
    none = bound_at(contacts, floats, s, i, 1) + bound_at(contacts, floats, s, i, -1) == 0.0
    status[i] = AT_FORWARD | AT_BACKWARD if none else bit
    return not leaves_border and new < now - near, now


@compiled
def cross_borders(
    compliance, contacts, links, status, floats, bytes_, account, hits, leaves, patches, begin, end, target, s, fastest
):
    """Let the contacts that have reached borders at s stand there, go on or jump.

    Args:
        compliance: 1 / k, shape (N - 1,) [m/N].
        contacts: rows X .. LOAD_WORK, shape (9, N), changed in place.
        links: rows of the springs, shape (5, N - 1), changed in place.
        status: bounds at which contacts are, changed in place.
        floats: rates, velocities and changes of the bounds, changed in place.
        bytes_: moved links and leaving contacts, changed in place.
        account: account of the ramp, added to.
        hits: output: the contacts whose blocks have to be solved again.
        leaves: number of leaves of the tournament.
        patches: the ground, changed in place.
        begin: the target in force at the start of the ramp, for ground without patches.
        end: the target at its end, likewise.
        target: the target at its end for the places of the contacts, shape (4 N - 1,), changed in place.
        s: place on the ramp, 0 .. 1.
        fastest: the largest velocity on the ramp so far [m per unit of the ramp].

    Returns:
        The number of hits, 0 if contacts are left to `motion.ground.walk`: those marked in `patches.reached`; and by
        how much the sums of all bounds grew, at the start and at the end of the ramp.
    """
    reached = patches.reached
    count = _collect(contacts, floats, patches, leaves, hits, s, fastest)
    whole = 0.0
    change = 0.0
    for k in range(count):
        i = int(hits[k])
        whole -= contacts[FORWARD, i] + contacts[BACKWARD, i]
        change -= floats[ROW_D_FORWARD, i] + floats[ROW_D_BACKWARD, i]
        status[i] &= ~bytes_[ROW_LEAVING, i]
        bytes_[ROW_LEAVING, i] = 0
        update(contacts, links, floats, account, s, i, i)
        before = status[i]
        if not before & (AT_FORWARD if reached[i] > 0 else AT_BACKWARD):
            return 0, 0.0, 0.0
        place = patches.place[i]
        falls, _ = _meet(contacts, status, floats, patches, begin, end, target, s, i, reached[i])
        if falls:  # after the others
            _enter(contacts, floats, patches, begin, end, target, i, place)
            status[i] = before
        else:
            reached[i] = 0
    solved = count
    for k in range(count):
        i = int(hits[k])
        if reached[i] != 0:
            solved = _jump(
                compliance,
                contacts,
                links,
                status,
                floats,
                bytes_,
                account,
                hits,
                solved,
                patches,
                begin,
                end,
                target,
                s,
                i,
            )
            if solved == 0:
                return 0, 0.0, 0.0
    for k in range(count):
        i = int(hits[k])
        whole += contacts[FORWARD, i] + contacts[BACKWARD, i]
        change += floats[ROW_D_FORWARD, i] + floats[ROW_D_BACKWARD, i]
    return solved, whole, whole + change


@compiled
def _jump(compliance, contacts, links, status, floats, bytes_, account, hits, count, patches, begin, end, target, s, i):
    """Let contact i jump, and jump again at further borders; return the number of hits, 0 if something is left out."""
    direction = patches.reached[i]
    jumps = patches.jumps
    while True:
        before = status[i]
        place = patches.place[i]
        start = contacts[X, i]
        falls, now = _meet(contacts, status, floats, patches, begin, end, target, s, i, direction)
        if not falls:
            break
        ending = LEFT_OUT
        if jumps[0, COUNT] + 1 < jumps.shape[0]:
            ending, first, last, bound, loss, pieces = fall(
                compliance, contacts, links, status, floats, bytes_, account, patches, s, i, direction, now
            )
        if ending == LEFT_OUT:
            _enter(contacts, floats, patches, begin, end, target, i, place)
            _hold(contacts, floats, s, i, direction, now)
            status[i] = before
            return 0
        jumps[0, COUNT] += 1
        jumps[0, LOST] += loss
        row = int(jumps[0, COUNT])
        jumps[row, JUMP_RAMP] = jumps[0, OF_RAMP]
        jumps[row, JUMP_PART] = s
        jumps[row, JUMP_CONTACT] = i
        jumps[row, JUMP_BORDER] = patches.stretches.borders[(place + direction) // 2]
        jumps[row, JUMP_DISTANCE] = contacts[X, i] - start
        jumps[row, JUMP_LOSS] = loss
        if pieces > 0:
            count = _let_go(status, bytes_, hits, count, first - 1, direction)
            count = _let_go(status, bytes_, hits, count, last + 1, direction)
        if ending == ENDED:
            break
        _hold(contacts, floats, s, i, direction, bound)
    patches.reached[i] = 0
    return count


@compiled
def _let_go(status, bytes_, hits, count, wall, direction):
    """Note that a contact beside those that slid has left its other bound, if it was there; return the number of hits.

    The force on it has changed in the direction of the fall.
    """
    if wall < 0 or wall >= status.shape[0] or status[wall] & (AT_FORWARD if direction > 0 else AT_BACKWARD):
        return count
    if status[wall] == 0:
        return count
    status[wall] = 0
    bytes_[ROW_LEAVING, wall] = 0
    for k in range(count):
        if hits[k] == wall:
            return count
    hits[count] = wall
    return count + 1
