"""The most frequent events of long blocks: a wall between them starts to slide, or hands over to its neighbour.

A contact at rest beside a long block, a wall, reaches a bound. Either it joins the blocks beside it, or one of its
neighbours turns round and is the wall from then on. The velocities of all other contacts change by lines, and the
bounds of the blocks' velocities mostly exclude that any of them turns. All is decided before anything is changed:
whatever is more than such an event is left to `solve_long`.
"""

from __future__ import annotations

import numpy as np

from ....compiled import lean
from ....rounding import CRITICAL
from ...state import AT_BACKWARD, AT_FORWARD, TENSION, WORK
from ..memory import ROW_D_ACTUATION, ROW_LEAVING, ROW_RATE, ROW_SINCE
from ..rates import advance_link, find_event, update_tournament
from .blocks import (
    bound_part,
    close_block,
    enter_block,
    former_block,
    is_driven_out,
    open_block,
    rate_block,
    stop_contact,
)
from .tables import ENDS, add_contact, fold, is_changing, remove_contacts
from .turning import find_likely, state_at


@lean
def _close_around(links, floats, account, lines, nodes, marks, s, first, last, contact):
    """Close the blocks beside a contact, and update the links beside it to s."""
    i = fold(marks, contact)
    before = fold(marks, contact - 1) if contact > 0 else -1
    if contact > first:
        close_block(links, floats, account, lines, nodes, marks, first, s)
        marks[ENDS, fold(marks, first)] = -1
        marks[ENDS, before] = -1
        account[WORK] += floats[ROW_D_ACTUATION, before] * links[TENSION, before] * s
    elif contact > 0:
        account[WORK] += advance_link(links, floats, s, before)
    if contact < last:
        close_block(links, floats, account, lines, nodes, marks, contact + 1, s)
        marks[ENDS, fold(marks, contact + 1)] = -1
        marks[ENDS, fold(marks, last)] = -1
        account[WORK] += floats[ROW_D_ACTUATION, i] * links[TENSION, i] * s
    elif contact < lines.shape[1] - 1:
        account[WORK] += advance_link(links, floats, s, i)
    floats[ROW_SINCE, i] = s


@lean
def move_wall(
    contacts,
    links,
    status,
    floats,
    bytes_,
    tree,
    leaves,
    account,
    lines,
    nodes,
    marks,
    s,
    first,
    last,
    contact,
):
    """Let a contact at rest beside long blocks slide at s, if no contact but one of its neighbours turns round.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: tensions, changed in place.
        status: bounds at which contacts are.
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links, changed in place.
        tree: tournament of the next events, changed in place.
        leaves: number of its leaves.
        account: account of the ramp, added to.
        lines: tables of the ramp, shape (15, N), changed in place.
        nodes: the tree, shape (2 M, 10), changed in place.
        marks: rows ENDS and STALE, shape (2, N), changed in place.
        s: place on the ramp, 0 .. 1.
        first: first contact of the block before `contact`, or `contact` itself.
        last: last contact of the block behind it, or `contact` itself.
        contact: the contact, which reached a bound at s.

    Returns:
        Whether it was such an event; if not, nothing has changed. Then by how much the number of free contacts grew.
    """
    n = lines.shape[1]
    i = fold(marks, contact)
    before = former_block(lines, marks, first, contact - 1)
    behind = former_block(lines, marks, contact + 1, last)
    if (contact > first and before[0][1] < 0) or (contact < last and behind[0][1] < 0) or first == last:
        return False, 0
    if (first == 0 and last == n - 1) or status[i] == AT_FORWARD | AT_BACKWARD:
        return False, 0
    side = 1 if status[i] & AT_FORWARD else -1
    if is_changing(nodes):  # else its force does not count in rates
        add_contact(contacts, floats, lines, nodes, marks, i, side)  # also if it is left to `solve_long`
    block, rise, size = rate_block(lines, nodes, marks, first, last)
    if -side * state_at(lines, nodes, marks, block, contact)[0] > CRITICAL * size:
        return False, 0
    neighbours = (contact - 1, contact + 1)
    stopped = find_likely(lines, nodes, marks, bytes_, block, neighbours, CRITICAL * size)
    if stopped in (first, last):
        return False, 0
    other, rise_behind, size_behind = block, 0.0, 0.0
    least_behind = np.inf
    most_behind = -np.inf
    if stopped >= 0:
        block, rise, size = rate_block(lines, nodes, marks, first, stopped - 1)
        other, rise_behind, size_behind = rate_block(lines, nodes, marks, stopped + 1, last)
        least_behind, most_behind = bound_part(lines, nodes, marks, before, behind, contact, side, other, size_behind)
        if least_behind < -CRITICAL * size_behind or most_behind > CRITICAL * size_behind:
            return False, 0
        if is_driven_out(status, floats, fold(marks, stopped), block[2] + rise, other[2]):
            return False, 0
    least, most = bound_part(lines, nodes, marks, before, behind, contact, side, block, size)
    if least < -CRITICAL * size or most > CRITICAL * size:
        return False, 0

    _close_around(links, floats, account, lines, nodes, marks, s, first, last, contact)
    freed = enter_block(contacts, status, floats, bytes_, tree, leaves, lines, nodes, marks, i)
    left = fold(marks, first - 1) if first > 0 else -1
    right = fold(marks, last + 1) if last < n - 1 else -1
    left_rate = floats[ROW_RATE, left] if left >= 0 else 0.0
    right_rate = floats[ROW_RATE, fold(marks, last)] if right >= 0 else 0.0
    if stopped >= 0:
        stop_contact(contacts, links, floats, bytes_, account, lines, nodes, marks, s, first, last, stopped, contact)
        remove_contacts(lines, nodes, marks, stopped, stopped)
        i = fold(marks, stopped)
        bytes_[ROW_LEAVING, i] = status[i]
        open_block(floats, bytes_, lines, marks, s, other, rise_behind, least_behind, most_behind)
        freed -= 1
    open_block(floats, bytes_, lines, marks, s, block, rise, least, most)
    if stopped >= 0:
        find_event(contacts, links, status, floats, bytes_, s, i)
        update_tournament(tree, leaves, floats, i)
    if left >= 0 and floats[ROW_RATE, left] != left_rate:
        find_event(contacts, links, status, floats, bytes_, s, left)
        update_tournament(tree, leaves, floats, left)
    if right >= 0 and floats[ROW_RATE, fold(marks, last)] != right_rate:
        find_event(contacts, links, status, floats, bytes_, s, right)
        update_tournament(tree, leaves, floats, right)
    return True, -freed
