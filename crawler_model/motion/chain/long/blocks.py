"""Long sliding blocks of a chain: their numbers, and what happens to a contact that enters or leaves one.

A block is known by its first and last contact. Tensions are stored only for its links to the walls, the contacts at
rest beside it, and velocities not at all: `turning` computes them from the rate of the block.
"""

from __future__ import annotations

import numpy as np

from ....compiled import lean
from ....rounding import EPS
from ...state import AT_FORWARD, COMPLEMENTARITY, TENSION, VIOLATION, WORK
from ..memory import (
    LEAF,
    LEAST_OF,
    MOST_OF,
    RATE_OF,
    ROW_D_ACTUATION,
    ROW_LEAVING,
    ROW_LINK_SINCE,
    ROW_MOVED,
    ROW_NEXT,
    ROW_RATE,
    ROW_SIDE,
    ROW_SINCE,
    ROW_V,
    SINCE_OF,
    SIZE,
    P,
    Q,
)
from ..rates import advance_link, update_tournament
from .slides import ENDS, SLID, add_slide, begin_slide
from .turning import FORCE, difference, forget, slide_force, sum_forces, velocity_at


@lean
def wall_beside(first, last):
    """Choose a wall beside a block.

    Args:
        first: first contact of the block.
        last: last contact of the block.

    Returns:
        The contact before it, or the one behind it if the block begins the chain.
    """
    return first - 1 if first > 0 else last + 1


@lean
def former_block(lines, marks, first, last):
    """Read a block that ends now.

    Args:
        lines: numbers of the blocks, shape (10, N).
        marks: row ENDS, shape (2, N).
        first: first contact of the block.
        last: last contact of the block.

    Returns:
        Its first and last contact, rate, and bounds of its velocities; last is -1 if there is no such block.
    """
    if last < first or marks[ENDS, first] != last:
        return 0, -1, 0.0, np.inf, -np.inf
    return first, last, lines[RATE_OF, first], lines[LEAST_OF, first], lines[MOST_OF, first]


@lean
def carry_bounds(lines, former, a, b, anchor, rate):
    """Bound the velocities of those of the contacts a..b that were in a former block.

    Args:
        lines: tables of the ramp, shape (10, N).
        former: from `former_block`.
        a: first contact of the part.
        b: last contact of the part.
        anchor: a wall beside the block, at rest.
        rate: rate of its tensions [N per unit of the ramp].

    Returns:
        A lower bound of the velocities of those that slide forward, and an upper bound of the others.
    """
    first, last, rate_before, least, most = former
    low = max(a, first)
    high = min(b, last)
    if high < low:
        return np.inf, -np.inf
    shift = velocity_at(lines, anchor, rate, low) - velocity_at(lines, wall_beside(first, last), rate_before, low)
    other = shift + (rate - rate_before) * difference(lines, Q, low, high)
    return least + min(shift, other), most + max(shift, other)


@lean
def open_block(floats, bytes_, lines, marks, s, first, last, rate, least, most):
    """Begin a block at s.

    Args:
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links, changed in place.
        lines: tables of the ramp, and numbers of the blocks, shape (10, N), changed in place.
        marks: rows ENDS and SLID, shape (2, N), changed in place.
        s: place on the ramp, 0 .. 1.
        first: first contact of the block.
        last: last contact of the block.
        rate: rate of its tensions [N per unit of the ramp].
        least: lower bound of the velocities of its contacts that slide forward.
        most: upper bound of those of the others.
    """
    for link in (first - 1, last):
        if 0 <= link < marks.shape[1] - 1:
            floats[ROW_RATE, link] = rate
            bytes_[ROW_MOVED, link] = 1
    lines[RATE_OF, first] = rate
    lines[SINCE_OF, first] = s
    lines[LEAST_OF, first] = least
    lines[MOST_OF, first] = most
    marks[ENDS, first] = last
    marks[ENDS, last] = first


@lean
def is_driven_out(status, left, right):
    """Check whether the force on a contact that stops would grow beyond its bound.

    Args:
        status: the bound at which it is.
        left: rate of the tension on its left [N per unit of the ramp].
        right: rate of the tension on its right.

    Returns:
        True if it would.
    """
    outwards = right - left if status & AT_FORWARD else left - right
    return outwards > 16.0 * EPS * (abs(right) + abs(left))


@lean
def common_rate(lines, first, last):
    """Compute the rate of the tensions of a block.

    Args:
        lines: tables of the ramp, shape (10, N).
        first: first contact of the block.
        last: last contact of the block.

    Returns:
        The rate [N per unit of the ramp], 0 if the block reaches an end of the chain; and the velocities whose
        rounding counts, the sum of the absolute terms [m per unit of the ramp].
    """
    n = lines.shape[1]
    rate = 0.0
    if first > 0 and last < n - 1:
        rate = -difference(lines, P, first - 1, last + 1) / difference(lines, Q, first - 1, last + 1)
    low = max(first - 1, 0)
    high = min(last + 1, n - 1)
    return rate, lines[SIZE, high] - lines[SIZE, low] + abs(rate) * difference(lines, Q, low, high)


@lean
def bound_part(lines, before, behind, contact, side, a, b, anchor, rate, size):
    """Bound the velocities of the contacts a..b, a part of two former blocks and the contact between them.

    Args:
        lines: tables of the ramp, shape (10, N).
        before: the block before the contact, from `former_block`.
        behind: the block behind it.
        contact: the contact that reached its bound.
        side: that bound, 1 forward, -1 backward.
        a: first contact of the part.
        b: last contact of the part.
        anchor: a wall beside the part, at rest.
        rate: rate of the tensions of the part [N per unit of the ramp].
        size: velocities whose rounding counts [m per unit of the ramp].

    Returns:
        A lower bound of the velocities of those that slide forward, and an upper bound of the others.
    """
    left = carry_bounds(lines, before, a, b, anchor, rate)
    right = carry_bounds(lines, behind, a, b, anchor, rate)
    least = min(left[0], right[0]) - 4.0 * EPS * size
    most = max(left[1], right[1]) + 4.0 * EPS * size
    if a <= contact <= b:
        v = velocity_at(lines, anchor, rate, contact)
        if side > 0:
            least = min(least, v)
        else:
            most = max(most, v)
    return least, most


@lean
def close_block(contacts, links, floats, account, lines, sums, marks, first, s):
    """Account for a block up to s, and update its links to the walls.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: tensions, changed in place.
        floats: rates, velocities, and the places since which they hold, changed in place.
        account: account of the ramp, added to.
        lines: tables of the ramp, and numbers of the blocks, shape (10, N), changed in place.
        sums: sums for displacements, shape (R, 6), changed in place.
        marks: rows ENDS and SLID, shape (2, N), changed in place.
        first: first contact of the block.
        s: place on the ramp, 0 .. 1.
    """
    last = marks[ENDS, first]
    n = contacts.shape[1]
    since = lines[SINCE_OF, first]
    ds = s - since
    if ds > 0.0:
        rate = lines[RATE_OF, first]
        add_slide(lines, sums, first, last, wall_beside(first, last), rate, ds)
        account[WORK] += difference(lines, P, first, last) * rate * ds * (0.5 * (s + since))
        lines[SINCE_OF, first] = s
    if first > 0:
        account[WORK] += advance_link(links, floats, s, first - 1)
    if last < n - 1:
        account[WORK] += advance_link(links, floats, s, last)


@lean
def enter_block(contacts, status, floats, bytes_, tree, leaves, account, lines, sums, nodes, marks, i):
    """Let contact i, updated to s, slide in a long block.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        status: bounds at which contacts are.
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links, changed in place.
        tree: tournament of the next events, changed in place.
        leaves: number of its leaves.
        account: account of the ramp, added to.
        lines: tables of the ramp, and numbers of the blocks, shape (10, N), changed in place.
        sums: sums for displacements, shape (R, 6), changed in place.
        nodes: tree of bounds, shape (2 M, 5), changed in place.
        marks: rows ENDS and SLID, shape (2, N), changed in place.
        i: the contact.

    Returns:
        1 if it was free or leaving, else 0.
    """
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
def leave_link(links, floats, bytes_, account, s, j, tension):
    """Set the tension of a link that was inside a long block up to s.

    Args:
        links: tensions, changed in place.
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links, changed in place.
        account: account of the ramp, added to.
        s: place on the ramp, 0 .. 1.
        j: the link.
        tension: tension of the link at s [N].
    """
    links[TENSION, j] = tension
    floats[ROW_LINK_SINCE, j] = s
    account[WORK] -= floats[ROW_D_ACTUATION, j] * tension * s
    bytes_[ROW_MOVED, j] = 1


@lean
def stop_contact(contacts, links, floats, bytes_, account, nodes, s, first, last, j, contact):
    """Stop a contact of a block that is closed at s: it becomes a wall that leaves its bound.

    The tensions of the links to the walls and of those beside `contact` are known at s.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: tensions, changed in place.
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links, changed in place.
        account: account of the ramp, added to.
        nodes: tree of bounds, shape (2 M, 5), changed in place.
        s: place on the ramp, 0 .. 1.
        first: first contact of the block.
        last: last contact of the block.
        j: the contact that stops.
        contact: the contact that reached its bound at s.
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
        leave_link(links, floats, bytes_, account, s, j - 1, after - force)
    if j < last:
        leave_link(links, floats, bytes_, account, s, j, after)
    nodes[nodes.shape[0] // 2 + j // LEAF, FORCE] -= force
    bytes_[ROW_SIDE, j] = 0
    floats[ROW_V, j] = 0.0
    floats[ROW_SINCE, j] = s


@lean
def release_block(contacts, links, floats, bytes_, account, lines, nodes, marks, s, first, last, known):
    """Compute the tensions of a block, closed at s, so that it becomes a short one.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: tensions, changed in place.
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links, changed in place.
        account: account of the ramp, added to.
        lines: tables of the ramp, and numbers of the blocks, shape (10, N), changed in place.
        nodes: tree of bounds, shape (2 M, 5), changed in place.
        marks: rows ENDS and SLID, shape (2, N), changed in place.
        s: place on the ramp, 0 .. 1.
        first: first contact of the block.
        last: last contact of the block.
        known: True if its velocities are known.
    """
    n = contacts.shape[1]
    rate = lines[RATE_OF, first]
    anchor = wall_beside(first, last)
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
            leave_link(links, floats, bytes_, account, s, i, tension)
    gap = abs((links[TENSION, last] if last < n - 1 else 0.0) - tension)
    account[VIOLATION] = max(account[VIOLATION], gap)
    account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], abs(v * gap))
    marks[ENDS, first] = -1
    marks[ENDS, last] = -1
