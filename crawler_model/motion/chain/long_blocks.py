"""Long sliding blocks of a chain, whose contacts are not touched while the block grows, shrinks, splits or merges.

While friction is constant, the tensions of all links of a block change at one rate, and velocities are lines over
tables (`turning`). An event then changes the few numbers of a block, not its contacts:

* The rate follows from the two walls at rest beside the block; it is 0 where the block reaches an end of the chain.
* Contacts that turn round are found by a tree of bounds. The worst one stops and becomes a wall, then both parts are
  searched again. If that does not lead to a solution, the projection solves the whole block as if it were short.
* Tensions are followed at the two links to the walls. Others follow from the bounds of the contacts in between.
* Displacements follow at the end of the ramp, from three numbers for each piece of the life of a block (`slides`).
* Work needs the integral of each tension, which is T t at the end of its time in a block less T t at the start, less
  the integral of t times the rate: one sum for each link and one for each block.
"""

from __future__ import annotations

import numpy as np

from ...compiled import lean
from ...rounding import CRITICAL, EPS
from ..state import (
    AT_FORWARD,
    COMPLEMENTARITY,
    STIFFNESS,
    TENSION,
    VIOLATION,
    WORK,
)
from .memory import (
    LEAF,
    MOST_TURNS,
    ROW_D_ACTUATION,
    ROW_LEAVING,
    ROW_LINK_SINCE,
    ROW_MOVED,
    ROW_NEXT,
    ROW_RATE,
    ROW_SIDE,
    ROW_SINCE,
    ROW_V,
)
from .rates import advance_link, find_event, update, update_tournament
from .slides import ENDS, SETTLED, SLID, add_slide, begin_slide
from .turning import FORCE, SIZE, P, Q, difference, find_turning, forget, slide_force, sum_forces, tabulate, velocity_at

_RATE, _SINCE, _LEAST, _MOST = 5, 6, 8, 9
"""Rows of the lines, used at the first contact of a block: its rate, and the place since which it holds; a lower bound
of the velocities of its contacts that slide forward, and an upper bound of the others."""
_STOPPED = 2
"""Column of the parts of a block where the contacts that stop are listed."""


@lean
def begin_long(compliance, floats, lines, sums, nodes, marks):
    """Prepare a ramp with long blocks; there are none yet.

    Args:
        compliance: 1 / k, shape (N - 1,) [m/N].
        floats: row ROW_D_ACTUATION [m per unit of the ramp].
        lines: tables of the ramp, and numbers of the blocks, shape (10, N), changed in place.
        sums: sums for displacements, shape (R, 6), changed in place.
        nodes: tree of bounds, shape (2 M, 5), changed in place.
        marks: rows ENDS and SLID, shape (2, N), changed in place.
    """
    tabulate(compliance, floats, lines, nodes)
    sums[:] = 0.0
    lines[SETTLED] = 0.0
    marks[ENDS] = -1
    marks[SLID] = 0


@lean
def _anchor(first, last):
    """Return a wall beside a block."""
    return first - 1 if first > 0 else last + 1


@lean
def _remember(lines, marks, first, last):
    """Return a block that ends now: its ends, its rate and the bounds of its velocities; none if last < first."""
    if last < first or marks[ENDS, first] != last:
        return 0, -1, 0.0, np.inf, -np.inf
    return first, last, lines[_RATE, first], lines[_LEAST, first], lines[_MOST, first]


@lean
def _carry_bounds(lines, former, a, b, anchor, rate):
    """Bound the velocities of those of the contacts a..b that were in a former block, from its rate and bounds."""
    first, last, rate_before, least, most = former
    low = max(a, first)
    high = min(b, last)
    if high < low:
        return np.inf, -np.inf
    shift = velocity_at(lines, anchor, rate, low) - velocity_at(lines, _anchor(first, last), rate_before, low)
    other = shift + (rate - rate_before) * difference(lines, Q, low, high)
    return least + min(shift, other), most + max(shift, other)


@lean
def _close(contacts, links, floats, account, lines, sums, marks, first, s):
    """Account for a block up to s, and update its links to the walls."""
    last = marks[ENDS, first]
    n = contacts.shape[1]
    since = lines[_SINCE, first]
    ds = s - since
    if ds > 0.0:
        rate = lines[_RATE, first]
        add_slide(lines, sums, first, last, _anchor(first, last), rate, ds)
        account[WORK] += difference(lines, P, first, last) * rate * ds * (0.5 * (s + since))
        lines[_SINCE, first] = s
    if first > 0:
        account[WORK] += advance_link(links, floats, s, first - 1)
    if last < n - 1:
        account[WORK] += advance_link(links, floats, s, last)


@lean
def _enter(contacts, status, floats, bytes_, tree, leaves, account, lines, sums, nodes, marks, i):
    """Let contact i, updated to s, slide in a long block; returns 1 if it was free or leaving."""
    was_free = bytes_[ROW_SIDE, i] == 0
    bytes_[ROW_SIDE, i] = 1 if status[i] & AT_FORWARD else -1
    bytes_[ROW_LEAVING, i] = 0
    floats[ROW_NEXT, i] = np.inf
    if was_free:
        update_tournament(tree, leaves, floats, i)
    nodes[nodes.shape[0] // 2 + i // LEAF, FORCE] += slide_force(contacts, bytes_, i)
    forget(nodes, i)
    if marks[SLID, i] != bytes_[ROW_SIDE, i]:
        begin_slide(contacts, account, lines, sums, marks, i, bytes_[ROW_SIDE, i])
    return 1 if was_free else 0


@lean
def _leave_link(links, floats, bytes_, account, s, j, tension):
    """Set the tension of a link that was inside a long block up to s."""
    links[TENSION, j] = tension
    floats[ROW_LINK_SINCE, j] = s
    account[WORK] -= floats[ROW_D_ACTUATION, j] * tension * s
    bytes_[ROW_MOVED, j] = 1


@lean
def _stop(contacts, links, floats, bytes_, account, nodes, s, first, last, j, contact):
    """Stop a contact of the block first..last, closed at s: it becomes a wall that leaves its bound.

    The tensions of the links to the walls and of those beside `contact` are known at s.
    """
    n = contacts.shape[1]
    force = slide_force(contacts, bytes_, j)
    left = first - 1  # a link with a known tension on the left of contact j, and one on the right
    right = last
    if first <= contact < j:
        left = contact
    elif j <= contact <= last:
        right = contact if j == contact else contact - 1
    if j - left <= right - j:
        before = links[TENSION, left] if left >= 0 else 0.0
        after = before + sum_forces(contacts, bytes_, nodes, left + 1, j)
    else:
        after = links[TENSION, right] if right < n - 1 else 0.0
        after -= sum_forces(contacts, bytes_, nodes, j + 1, right)
    if j > first:
        _leave_link(links, floats, bytes_, account, s, j - 1, after - force)
    if j < last:
        _leave_link(links, floats, bytes_, account, s, j, after)
    nodes[nodes.shape[0] // 2 + j // LEAF, FORCE] -= force
    bytes_[ROW_SIDE, j] = 0
    floats[ROW_V, j] = 0.0
    floats[ROW_SINCE, j] = s


@lean
def _release(contacts, links, floats, bytes_, account, lines, nodes, marks, s, first, last, known):
    """Compute tensions in a block, closed at s, so that it becomes a short block; rates and velocities if known."""
    n = contacts.shape[1]
    rate = lines[_RATE, first]
    anchor = _anchor(first, last)
    tension = links[TENSION, first - 1] if first > 0 else 0.0
    v = 0.0
    for i in range(first, last + 1):
        force = slide_force(contacts, bytes_, i)
        nodes[nodes.shape[0] // 2 + i // LEAF, FORCE] -= force
        tension += force
        if known:
            v = velocity_at(lines, anchor, rate, i)
        floats[ROW_V, i] = v
        floats[ROW_SINCE, i] = s
        if i < last:
            floats[ROW_RATE, i] = rate
            _leave_link(links, floats, bytes_, account, s, i, tension)
    gap = abs((links[TENSION, last] if last < n - 1 else 0.0) - tension)
    account[VIOLATION] = max(account[VIOLATION], gap)
    account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], abs(v * gap))
    marks[ENDS, first] = -1
    marks[ENDS, last] = -1


@lean
def release_long(contacts, links, floats, bytes_, account, lines, sums, nodes, marks, s):
    """Turn all long blocks into short ones.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: tensions, changed in place.
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links.
        account: account of the ramp, added to.
        lines: tables of the ramp, and numbers of the blocks, shape (10, N), changed in place.
        sums: sums for displacements, shape (R, 6), changed in place.
        nodes: tree of bounds, shape (2 M, 5), changed in place.
        marks: rows ENDS and SLID, shape (2, N), changed in place.
        s: place on the ramp, 0 .. 1.
    """
    n = contacts.shape[1]
    i = 0
    while i < n:
        last = marks[ENDS, i]
        if last >= 0:
            _close(contacts, links, floats, account, lines, sums, marks, i, s)
            _release(contacts, links, floats, bytes_, account, lines, nodes, marks, s, i, last, True)
            i = last
        i += 1


@lean
def _gather(contacts, links, status, floats, bytes_, tree, leaves, account, lines, sums, nodes, marks, s, first, last):
    """Update all contacts first..last that are not in long blocks to s, and close the long blocks among them.

    Returns how many were not in a long block, and how many of these were free.
    """
    entered = 0
    freed = 0
    i = first
    while i <= last:
        end = marks[ENDS, i]
        if end >= 0:
            _close(contacts, links, floats, account, lines, sums, marks, i, s)
            marks[ENDS, i] = -1
            marks[ENDS, end] = -1
        else:
            end = i
            while end < last and marks[ENDS, end + 1] < 0:
                end += 1
            update(contacts, links, floats, account, s, i, end)
            for j in range(i, end + 1):
                freed += _enter(contacts, status, floats, bytes_, tree, leaves, account, lines, sums, nodes, marks, j)
            for j in range(max(i - 1, first), min(end, last - 1) + 1):
                account[WORK] += floats[ROW_D_ACTUATION, j] * links[TENSION, j] * s
            entered += end - i + 1
        i = end + 1
    return entered, freed


@lean
def _give_up(contacts, links, floats, bytes_, account, lines, nodes, marks, s, first, last):
    """Turn all contacts first..last into short blocks at s, with rates that are not known."""
    a = first
    while a <= last:
        b = a
        if bytes_[ROW_SIDE, a] != 0:
            while b < last and bytes_[ROW_SIDE, b + 1] != 0:
                b += 1
            _release(contacts, links, floats, bytes_, account, lines, nodes, marks, s, a, b, False)
        a = b + 1


@lean
def _find_events(contacts, links, status, floats, bytes_, tree, leaves, parts, stops, s, first, last):
    """Find the next events of the walls beside and in first..last.

    Returns False if a contact that stopped would be driven beyond its bound.
    """
    n = contacts.shape[1]
    for k in range(stops):
        j = parts[k, _STOPPED]
        right = floats[ROW_RATE, j] if j < n - 1 else 0.0
        left = floats[ROW_RATE, j - 1] if j > 0 else 0.0
        outwards = right - left if status[j] & AT_FORWARD else left - right
        if outwards > 16.0 * EPS * (abs(right) + abs(left)):
            return False
        find_event(contacts, links, status, floats, bytes_, s, j)
        update_tournament(tree, leaves, floats, j)
    if first > 0:
        find_event(contacts, links, status, floats, bytes_, s, first - 1)
        update_tournament(tree, leaves, floats, first - 1)
    if last < n - 1:
        find_event(contacts, links, status, floats, bytes_, s, last + 1)
        update_tournament(tree, leaves, floats, last + 1)
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
    sums,
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

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (2, N - 1).
        contacts: updated in place to s where they were not in long blocks.
        links: likewise.
        status: bounds at which contacts are.
        floats: rates and next events are written.
        bytes_: sides and leaving contacts are written.
        tree: tournament of the next events, changed in place.
        leaves: number of its leaves.
        account: account of the ramp, added to.
        lines: tables of the ramp, and numbers of the blocks, shape (10, N), changed in place.
        sums: sums for displacements, shape (R, 6), changed in place.
        nodes: tree of bounds, shape (2 M, 5), changed in place.
        marks: rows ENDS and SLID, shape (2, N), changed in place.
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
    n = contacts.shape[1]
    # what is known of the velocities, if `contact` is the only one that was not in a long block
    before = _remember(lines, marks, first, contact - 1)
    behind = _remember(lines, marks, contact + 1, last)
    known = (before[1] >= 0 or contact == first) and (behind[1] >= 0 or contact == last)
    effort, freed = _gather(
        contacts, links, status, floats, bytes_, tree, leaves, account, lines, sums, nodes, marks, s, first, last
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
            floats[ROW_RATE, b] = -elasticity[STIFFNESS, b] * floats[ROW_D_ACTUATION, b]
            continue
        rate = 0.0
        if a > 0 and b < n - 1:
            rate = -difference(lines, P, a - 1, b + 1) / difference(lines, Q, a - 1, b + 1)
        anchor = _anchor(a, b)
        low = max(a - 1, 0)
        high = min(b + 1, n - 1)
        size = lines[SIZE, high] - lines[SIZE, low] + abs(rate) * difference(lines, Q, low, high)
        turning = -1
        worst = CRITICAL * size
        for i in (a, b, contact - 1, contact + 1):  # likely ones first
            if a <= i <= b and -bytes_[ROW_SIDE, i] * velocity_at(lines, anchor, rate, i) > worst:
                worst = -bytes_[ROW_SIDE, i] * velocity_at(lines, anchor, rate, i)
                turning = i
        if turning < 0:
            least = np.inf
            most = -np.inf
            if known:
                left = _carry_bounds(lines, before, a, b, anchor, rate)
                right = _carry_bounds(lines, behind, a, b, anchor, rate)
                least = min(left[0], right[0]) - 4.0 * EPS * size
                most = max(left[1], right[1]) + 4.0 * EPS * size
                if a <= contact <= b:
                    v = velocity_at(lines, anchor, rate, contact)
                    least = min(least, v if bytes_[ROW_SIDE, contact] > 0 else np.inf)
                    most = max(most, v if bytes_[ROW_SIDE, contact] < 0 else -np.inf)
            if not known or least < -CRITICAL * size or most > CRITICAL * size:
                turning, looked, least, most = find_turning(
                    lines, nodes, order, bytes_, anchor, rate, a, b, CRITICAL * size
                )
                effort += looked
        if turning >= 0:
            solved = stops < MOST_TURNS
            if solved:
                _stop(contacts, links, floats, bytes_, account, nodes, s, a, b, turning, contact)
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
        for wall in (a - 1, b):
            if 0 <= wall < n - 1:
                floats[ROW_RATE, wall] = rate
                bytes_[ROW_MOVED, wall] = 1
        lines[_RATE, a] = rate
        lines[_SINCE, a] = s
        lines[_LEAST, a] = least
        lines[_MOST, a] = most
        marks[ENDS, a] = b
        marks[ENDS, b] = a
    for k in range(stops):
        bytes_[ROW_LEAVING, parts[k, _STOPPED]] = status[parts[k, _STOPPED]]
    if solved:
        solved = _find_events(contacts, links, status, floats, bytes_, tree, leaves, parts, stops, s, first, last)
    if not solved:
        _give_up(contacts, links, floats, bytes_, account, lines, nodes, marks, s, first, last)
        return False, stops - freed, effort
    a = first
    while a <= last:
        b = marks[ENDS, a]
        if 0 <= b < a - 1 + shortest // 2:
            _release(contacts, links, floats, bytes_, account, lines, nodes, marks, s, a, b, True)
        a = max(a, b) + 1
    return True, stops - freed, effort
