"""Long sliding blocks, whose contacts are not touched while the block grows, shrinks, splits or merges.

The tensions of all links of a block change at one rate, and where friction changes, at rates that differ by what
contacts add; velocities are lines over tables (`turning`). An event then changes the few numbers of a block, not its
contacts:

* The rate follows from the two walls at rest beside the block, or from the end of the chain that it reaches.
* Contacts that turn round are found by a tree of bounds. The worst one stops and becomes a wall, then both parts are
  searched again. If that does not lead to a solution, the projection solves the whole block as if it were short.
* Tensions are followed at the two links to the walls. Others follow from the bounds of the contacts in between, and
  displacements from the tensions, where a contact stops and at the end of the ramp (`slides`).
* Work needs the integral of each tension, which is T t at the end of its time in a block less T t at the start, less
  the integral of t times the rate: one sum for each link and one for each block.
"""

from __future__ import annotations

import numpy as np

from ....compiled import lean
from ....rounding import CRITICAL
from ...state import STIFFNESS, TENSION, WORK
from ..memory import MOST_TURNS, ROW_D_ACTUATION, ROW_LEAVING, ROW_RATE, ROW_SIDE, ROW_SINCE, ROW_V
from ..rates import find_event, update, update_tournament
from .blocks import (
    bound_part,
    close_block,
    enter_block,
    former_block,
    is_driven_out,
    open_block,
    rate_block,
    release_block,
    stop_contact,
)
from .slides import leave_block
from .tables import ENDS, fold, remove_contacts
from .turning import find_likely, find_turning
from .walls import move_wall

_STOPPED = 2
"""Column of the parts of a block where the contacts that stop are listed."""


@lean
def release_long(contacts, links, floats, bytes_, account, lines, nodes, marks, s, over):
    """Turn all long blocks into short ones.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: tensions, changed in place.
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links.
        account: account of the ramp, added to.
        lines: tables of the ramp, shape (15, N), changed in place.
        nodes: the tree, shape (2 M, 10), changed in place.
        marks: rows ENDS and STALE, shape (2, N), changed in place.
        s: place on the ramp, 0 .. 1.
        over: True if the ramp ends here.
    """
    n = contacts.shape[1]
    begin = 0
    if lines.shape[1] > n:  # walk around a ring from a contact at rest, so that no block ends first
        while begin < n and bytes_[ROW_SIDE, begin] != 0:
            begin += 1
    i = begin
    while i < begin + n:
        length = marks[ENDS, fold(marks, i)]
        if length >= 0:
            last = i + length
            close_block(links, floats, account, lines, nodes, marks, i, s)
            release_block(contacts, links, floats, bytes_, account, lines, nodes, marks, s, i, last, True)
            if not over:
                remove_contacts(lines, nodes, marks, i, last)
            i = last
        i += 1


@lean
def _gather(contacts, links, status, floats, bytes_, tree, leaves, account, lines, nodes, marks, s, first, last):
    """Update all contacts first..last that are not in long blocks to s, and close the long blocks among them.

    Returns how many were not in a long block, and how many of these were free.
    """
    entered = 0
    freed = 0
    i = first
    while i <= last:
        start = fold(marks, i)
        if marks[ENDS, start] >= 0:
            end = i + marks[ENDS, start]
            close_block(links, floats, account, lines, nodes, marks, i, s)
            marks[ENDS, start] = -1
            marks[ENDS, fold(marks, end)] = -1
        else:
            end = i
            while end < last and marks[ENDS, fold(marks, end + 1)] < 0:
                end += 1
            stop = fold(marks, end)
            if stop >= start:
                update(contacts, links, floats, account, s, start, stop)
            else:
                update(contacts, links, floats, account, s, start, contacts.shape[1] - 1)
                update(contacts, links, floats, account, s, 0, stop)
            for k in range(i, end + 1):
                j = fold(marks, k)
                freed += enter_block(contacts, status, floats, bytes_, tree, leaves, lines, nodes, marks, j)
            for k in range(max(i - 1, first), min(end, last - 1) + 1):
                j = fold(marks, k)
                account[WORK] += floats[ROW_D_ACTUATION, j] * links[TENSION, j] * s
            entered += end - i + 1
        i = end + 1
    return entered, freed


@lean
def _give_up(contacts, links, floats, bytes_, account, lines, nodes, marks, s, first, last, contact):
    """Turn all contacts first..last into short blocks at s, with rates that are not known."""
    a = first
    while a <= last:
        b = a
        if bytes_[ROW_SIDE, fold(marks, a)] != 0:
            while b < last and bytes_[ROW_SIDE, fold(marks, b + 1)] != 0:
                b += 1
            marks[ENDS, fold(marks, a)] = -1
            marks[ENDS, fold(marks, b)] = -1
            end = b
            if a <= contact <= b:  # its place is known, even if no contact is at rest
                leave_block(contacts, links, floats, bytes_, account, lines, nodes, marks, s, a, b, contact, contact)
                floats[ROW_V, fold(marks, contact)] = 0.0
                floats[ROW_SINCE, fold(marks, contact)] = s
                if contact < b:
                    release_block(
                        contacts, links, floats, bytes_, account, lines, nodes, marks, s, contact + 1, b, False
                    )
                end = contact - 1
            if a <= end:
                release_block(contacts, links, floats, bytes_, account, lines, nodes, marks, s, a, end, False)
            remove_contacts(lines, nodes, marks, a, b)
        a = b + 1


@lean
def _find_events(contacts, links, status, floats, bytes_, tree, leaves, n, marks, parts, stops, s, first, last):
    """Find the next events of the walls beside and in first..last, of n positions.

    Returns False if a contact that stopped would be driven beyond its bound.
    """
    for k in range(stops):
        j = parts[k, _STOPPED]
        left = floats[ROW_RATE, fold(marks, j - 1)] if j > 0 else 0.0
        right = floats[ROW_RATE, fold(marks, j)] if j < n - 1 else 0.0
        j = fold(marks, j)
        if is_driven_out(status, floats, j, left, right):
            return False
        find_event(contacts, links, status, floats, bytes_, s, j)
        update_tournament(tree, leaves, floats, j)
    if first > 0:
        find_event(contacts, links, status, floats, bytes_, s, fold(marks, first - 1))
        update_tournament(tree, leaves, floats, fold(marks, first - 1))
    if last < n - 1:
        find_event(contacts, links, status, floats, bytes_, s, fold(marks, last + 1))
        update_tournament(tree, leaves, floats, fold(marks, last + 1))
    return True


@lean
def solve_long(
    elasticity,
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
    order,
    parts,
    shortest,
    s,
    first,
    last,
    contact,
):
    """Solve for the rates of the contacts first..last at s, all at their bounds, as long blocks.

    In a ring, `first`, `last` and `contact` are positions (`tables`).

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (2, N - 1), of a ring (2, N).
        contacts: updated in place to s where they were not in long blocks.
        links: likewise.
        status: bounds at which contacts are.
        floats: rates and next events are written.
        bytes_: sides and leaving contacts are written.
        tree: tournament of the next events, changed in place.
        leaves: number of its leaves.
        account: account of the ramp, added to.
        lines: tables of the ramp, shape (15, N), changed in place.
        nodes: the tree, shape (2 M, 10), changed in place.
        marks: rows ENDS and STALE, shape (2, N), changed in place.
        order: memory for `find_turning`.
        parts: memory for the parts of the block, and for the contacts that stop, shape (P, 3).
        shortest: number of contacts from which a block is long.
        s: place on the ramp, 0 .. 1.
        first: the first contact, next to a wall or at the end of the chain.
        last: the last contact, likewise.
        contact: one that has reached its bound at s.

    Returns:
        Whether it succeeded; if not, all blocks have become short, and their rates are not known. Then by how much the
        number of free contacts grew, and the work, in contacts.
    """
    n = lines.shape[1]
    solved, freed = move_wall(  # most events
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
    )
    if solved:
        return True, freed, 1
    # what is known of the velocities, if `contact` is the only one that was not in a long block
    before = former_block(lines, marks, first, contact - 1)
    behind = former_block(lines, marks, contact + 1, last)
    known = (before[0][1] >= 0 or contact == first) and (behind[0][1] >= 0 or contact == last)
    effort, freed = _gather(
        contacts, links, status, floats, bytes_, tree, leaves, account, lines, nodes, marks, s, first, last
    )
    stops = 0
    todo = 1
    parts[0, 0] = first
    parts[0, 1] = last
    solved = first > 0 or last < n - 1
    while todo > 0 and solved:
        todo -= 1
        a = parts[todo, 0]
        b = parts[todo, 1]
        if b < a:  # the link between two walls
            j = fold(marks, b)
            floats[ROW_RATE, j] = -elasticity[STIFFNESS, j] * floats[ROW_D_ACTUATION, j]
            continue
        part, rise, size = rate_block(lines, nodes, marks, a, b)
        likely = (a, b, contact - 1, contact + 1)
        turning = find_likely(lines, nodes, marks, bytes_, part, likely, CRITICAL * size)
        if turning < 0:
            least = -np.inf
            most = np.inf
            if known:
                side = bytes_[ROW_SIDE, fold(marks, contact)]
                least, most = bound_part(lines, nodes, marks, before, behind, contact, side, part, size)
            if least < -CRITICAL * size or most > CRITICAL * size:
                turning, looked, least, most = find_turning(lines, nodes, marks, order, bytes_, part, CRITICAL * size)
                effort += looked
        if turning >= 0:
            solved = stops < MOST_TURNS
            if solved:
                stop_contact(contacts, links, floats, bytes_, account, lines, nodes, marks, s, a, b, turning, contact)
                parts[stops, _STOPPED] = turning
                stops += 1
                if turning > 0:
                    parts[todo, 0] = a
                    parts[todo, 1] = turning - 1
                    todo += 1
                if turning < n - 1:
                    parts[todo, 0] = turning + 1
                    parts[todo, 1] = b
                    todo += 1
            continue
        open_block(floats, bytes_, lines, marks, s, part, rise, least, most)
    for k in range(stops):
        stopped = fold(marks, parts[k, _STOPPED])
        bytes_[ROW_LEAVING, stopped] = status[stopped]
        remove_contacts(lines, nodes, marks, parts[k, _STOPPED], parts[k, _STOPPED])
    if solved:
        solved = _find_events(
            contacts, links, status, floats, bytes_, tree, leaves, n, marks, parts, stops, s, first, last
        )
    if not solved:
        _give_up(contacts, links, floats, bytes_, account, lines, nodes, marks, s, first, last, contact)
        return False, stops - freed, effort
    a = first
    while a <= last:
        length = marks[ENDS, fold(marks, a)]
        b = a + length
        if 0 <= length < shortest // 2 - 1:
            release_block(contacts, links, floats, bytes_, account, lines, nodes, marks, s, a, b, True)
            remove_contacts(lines, nodes, marks, a, b)
        a = max(a, b) + 1
    return True, stops - freed, effort
