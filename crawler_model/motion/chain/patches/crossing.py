"""Contacts of a chain that cross borders of patches within a ramp, each with the block of contacts around it.

What happens at a border is described in `motion.ground.walk`, which also does what is left out here: jumps in both
directions at once, and bodies that nothing holds. Then the ramp stops at the border.
"""

from __future__ import annotations

import numpy as np

from ....compiled import lean
from ...borders import find_meeting, gap_ahead, is_moving, surely_holds
from ...state import AT_BACKWARD, AT_FORWARD, COMPLIANCE
from ...tournament import enter_event
from ..memory import ROW_HIT, ROW_LEAVING, ROW_SINCE, ROW_V
from ..rates import update
from .border import enter, meet
from .fall import add_hit, jump


@lean
def _collect(contacts, floats, bytes_, patches, leaves, hits, s, fastest):
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
            count = add_hit(bytes_, hits, count, i)
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
            bytes_[ROW_HIT, i] = 0
            meeting = find_meeting(contacts, floats[ROW_V, i], floats[ROW_SINCE, i], patches.ground, i)
            enter_event(tree, leaves, meeting, i)
    return kept


@lean
def cross_borders(
    elasticity, contacts, links, status, floats, bytes_, account, hits, leaves, patches, commands, target, s, fastest
):
    """Let the contacts that have reached borders at s stand there, go on or jump.

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (2, N - 1).
        contacts: rows X .. LOAD_WORK, shape (9, N), changed in place.
        links: rows of the springs, shape (5, N - 1), changed in place.
        status: bounds at which contacts are, changed in place.
        floats: rates, velocities and changes of the bounds, changed in place.
        bytes_: moved links, leaving contacts and hits, changed in place.
        account: account of the ramp, added to.
        hits: output: the contacts whose blocks have to be solved again.
        leaves: number of leaves of the tournament.
        patches: the ground, changed in place.
        commands: the targets at the start and at the end of the ramp, for ground without patches.
        target: the target at its end for the places of the contacts, shape (4 N - 1,), changed in place.
        s: place on the ramp, 0 .. 1.
        fastest: the largest velocity on the ramp so far [m per unit of the ramp].

    Returns:
        The number of hits; and whether all is done. If not, the ramp has to stop here for `motion.ground.walk`: with
        the contacts that are marked in `patches.reached`, and jumps that have not ended.
    """
    reached = patches.reached
    count = _collect(contacts, floats, bytes_, patches, leaves, hits, s, fastest)
    arrived = count
    ended = True
    for k in range(arrived):
        i = int(hits[k])
        status[i] &= ~bytes_[ROW_LEAVING, i]
        bytes_[ROW_LEAVING, i] = 0
        update(contacts, links, floats, account, s, i, i)
        before = status[i]
        ended &= before & (AT_FORWARD if reached[i] > 0 else AT_BACKWARD) != 0
        if not ended:
            break
        place = patches.place[i]
        excess, _ = meet(contacts, status, floats, patches, commands, target, s, i, reached[i])
        if excess > 0.0:  # it jumps after the others have stopped or passed
            enter(contacts, floats, patches, commands, target, i, place)
            status[i] = before
        else:
            reached[i] = 0
    for k in range(arrived):
        i = int(hits[k])
        if ended and reached[i] != 0:
            ended &= status[i] & (AT_FORWARD if reached[i] > 0 else AT_BACKWARD) != 0
        if ended and reached[i] != 0:
            count, ended = jump(
                elasticity[COMPLIANCE],
                contacts,
                links,
                status,
                floats,
                bytes_,
                account,
                hits,
                count,
                patches,
                commands,
                target,
                s,
                i,
                reached[i],
            )
    for k in range(count):
        bytes_[ROW_HIT, int(hits[k])] = 0
    return count, ended and surely_holds(patches.jumps)
