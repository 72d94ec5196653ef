"""The next border of each contact of a chain, and what happens to the bounds of a contact at a border."""

from __future__ import annotations

import numpy as np

from ....body.places import find_bounds, survey
from ....compiled import lean
from ...borders import SAME, SUM_BACKWARD, SUM_FORWARD, find_meeting, is_moving, largest
from ...state import AT_BACKWARD, AT_FORWARD, BACKWARD, FORWARD, LOAD, LOAD_CHANGE
from ...tournament import begin_tournament, enter_event
from ..memory import ROW_D_BACKWARD, ROW_D_FORWARD, ROW_MEETING, ROW_SINCE, ROW_V


@lean
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
    fastest = largest(floats[ROW_V])
    for i in range(contacts.shape[1]):
        floats[ROW_MEETING, i] = np.inf
        if is_moving(floats[ROW_V, i], fastest):
            floats[ROW_MEETING, i] = find_meeting(contacts, floats[ROW_V, i], floats[ROW_SINCE, i], patches.ground, i)
    begin_tournament(patches.meetings, leaves, floats[ROW_MEETING])
    return fastest


@lean
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


@lean
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


@lean
def _bound(contacts, floats, s, i, direction):
    """Compute the bound of contact i in a direction at s."""
    if direction > 0:
        return contacts[FORWARD, i] + s * floats[ROW_D_FORWARD, i]
    return contacts[BACKWARD, i] + s * floats[ROW_D_BACKWARD, i]


@lean
def enter(contacts, floats, patches, commands, target, i, place):
    """Put a contact onto a place, with the bounds and the load that it has there.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N), changed in place.
        floats: changes of the bounds, changed in place.
        patches: the ground, changed in place.
        commands: the targets at the start and at the end of the ramp, for ground without patches.
        target: the target at its end for the places of the contacts, shape (4 N - 1,), changed in place.
        i: the contact.
        place: its place, as in `Track`.
    """
    n = contacts.shape[1]
    sums = patches.jumps[0]
    sums[SUM_FORWARD] -= target[n - 1 + i]
    sums[SUM_BACKWARD] -= target[2 * n - 1 + i]
    patches.place[i] = place
    survey(patches.stretches, patches.position[i], place, i, patches.ground, i)
    forward, backward, load = find_bounds(commands[0], n - 1, n, i, patches.ground, i)
    target[n - 1 + i], target[2 * n - 1 + i], target[3 * n - 1 + i] = find_bounds(
        commands[1], n - 1, n, i, patches.ground, i
    )
    sums[SUM_FORWARD] += target[n - 1 + i]
    sums[SUM_BACKWARD] += target[2 * n - 1 + i]
    contacts[FORWARD, i] = forward
    contacts[BACKWARD, i] = backward
    contacts[LOAD, i] = load
    floats[ROW_D_FORWARD, i] = target[n - 1 + i] - forward
    floats[ROW_D_BACKWARD, i] = target[2 * n - 1 + i] - backward
    contacts[LOAD_CHANGE, i] = target[3 * n - 1 + i] - load


@lean
def meet(contacts, status, floats, patches, commands, target, s, i, direction):
    """Let a contact at its bound leave the border that it stands on, or stand on the one that it has reached, or pass.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N), changed in place.
        status: bounds at which contacts are, changed in place.
        floats: changes of the bounds, changed in place.
        patches: the ground, changed in place.
        commands: the targets at the start and at the end of the ramp, for ground without patches.
        target: the target at its end for the places of the contacts, shape (4 N - 1,), changed in place.
        s: place on the ramp, 0 .. 1.
        i: the contact.
        direction: of its motion, 1 forward, -1 backward.

    Returns:
        By how much its bound has to fall after it has passed, else 0; and by how much it is larger than before where it
        stands, else 0 [N].
    """
    place = patches.place[i]
    bit = AT_FORWARD if direction > 0 else AT_BACKWARD
    now = _bound(contacts, floats, s, i, direction)
    size = abs(_bound(contacts, floats, s, i, 1)) + abs(_bound(contacts, floats, s, i, -1))
    leaves_border = place % 2 == 1
    enter(contacts, floats, patches, commands, target, i, place + (direction if leaves_border else 2 * direction))
    new = _bound(contacts, floats, s, i, direction)
    near = SAME * (size + abs(new))
    if not leaves_border and new > now + near:
        enter(contacts, floats, patches, commands, target, i, place + direction)
        status[i] &= ~bit
        return 0.0, new - now
    none = _bound(contacts, floats, s, i, 1) + _bound(contacts, floats, s, i, -1) == 0.0
    status[i] = AT_FORWARD | AT_BACKWARD if none else bit
    return (now - new if not leaves_border and new < now - near else 0.0), 0.0


@lean
def sum_bounds(contacts, target):
    """Sum the bounds of all contacts at the start and at the end of a ramp.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        target: L, mu_plus and mu_minus at the end, shape (3 N - 1 or more,).

    Returns:
        Both sums [N].
    """
    n = contacts.shape[1]
    begin = 0.0
    end = 0.0
    for i in range(n):
        begin += contacts[FORWARD, i] + contacts[BACKWARD, i]
        end += target[n - 1 + i] + target[2 * n - 1 + i]
    return begin, end
