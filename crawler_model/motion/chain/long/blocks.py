"""Long sliding blocks of a chain or a ring: their numbers, and what happens to a contact that enters or leaves one.

A block is known by its first and last contact and by the rate of the tension before it. Tensions are stored only for
its links to the walls, the contacts at rest beside it, and velocities not at all: `turning` computes them. In a ring,
contacts are known by their positions (`tables`).
"""

from __future__ import annotations

import numpy as np

from ....compiled import lean
from ....rounding import EPS
from ...state import AT_FORWARD, COMPLEMENTARITY, DISSIPATION, TENSION, VIOLATION, WORK
from ..memory import (
    ELONGATION,
    LEAF,
    LEAST_OF,
    MOST_OF,
    RATE_OF,
    ROW_D_ACTUATION,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    ROW_GAIN,
    ROW_LEAVING,
    ROW_MOVED,
    ROW_NEXT,
    ROW_RATE,
    ROW_SIDE,
    ROW_SINCE,
    ROW_V,
    SINCE_OF,
    SIZE,
    SLIDE_FORCE,
    SLIDE_GROWTH,
    P,
    Q,
)
from ..rates import advance_link, update_tournament
from ..wide import add
from .slides import leave_block, leave_link, move_contacts
from .tables import ENDS, START, add_contact, difference, fold, is_changing, sum_range
from .turning import forget, state_at


@lean
def former_block(lines, marks, first, last):
    """Read a block that ends now.

    Args:
        lines: tables of the ramp, shape (15, N).
        marks: row ENDS, shape (2, N).
        first: first contact of the block.
        last: last contact of the block.

    Returns:
        The block, for `state_at`; its last contact is -1 if there is no such block. Then bounds of its velocities.
    """
    start = fold(marks, first)
    if last < first or marks[ENDS, start] != last - first:
        return (0, -1, 0.0), np.inf, -np.inf
    return (first, last, lines[RATE_OF, start]), lines[LEAST_OF, start], lines[MOST_OF, start]


@lean
def _carry_bounds(lines, nodes, marks, former, part):
    """Bound the velocities of those contacts of a part that were in a former block.

    Args:
        lines: tables of the ramp, shape (15, N).
        nodes: the tree, shape (2 M, 10).
        marks: rows ENDS and STALE, shape (2, N).
        former: from `former_block`; the sums still hold what its contacts added.
        part: a block, as for `state_at`.

    Returns:
        A lower bound of the velocities of those that slide forward, and an upper bound of the others.
    """
    block, least, most = former
    low = max(part[0], block[0])
    high = min(part[1], block[1])
    if high < low:
        return np.inf, -np.inf
    now = state_at(lines, nodes, marks, part, low)
    before = state_at(lines, nodes, marks, block, low)
    shift = now[0] - before[0]
    other = shift + (now[1] - before[1]) * difference(lines, Q, low, high)
    return least + min(shift, other), most + max(shift, other)


@lean
def open_block(floats, bytes_, lines, marks, s, block, rise, least, most):
    """Begin a block at s.

    Args:
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links, changed in place.
        lines: tables of the ramp, shape (15, N), changed in place.
        marks: row ENDS is changed in place, shape (2, N).
        s: place on the ramp, 0 .. 1.
        block: as for `state_at`.
        rise: rate of the tension behind it less that of the tension before it [N per unit of the ramp].
        least: lower bound of the velocities of its contacts that slide forward.
        most: upper bound of those of the others.
    """
    first, last, rate = block
    start = fold(marks, first)
    end = fold(marks, last)
    if first > 0:
        before = fold(marks, first - 1)
        floats[ROW_RATE, before] = rate
        bytes_[ROW_MOVED, before] = 1
    if last < lines.shape[1] - 1:
        floats[ROW_RATE, end] = rate + rise
        bytes_[ROW_MOVED, end] = 1
    lines[RATE_OF, start] = rate
    lines[SINCE_OF, start] = s
    lines[LEAST_OF, start] = least
    lines[MOST_OF, start] = most
    marks[ENDS, start] = last - first
    marks[ENDS, end] = last - first


@lean
def is_driven_out(status, floats, j, left, right):
    """Check whether the force on a contact that stops would grow beyond its bound.

    Args:
        status: bounds at which contacts are.
        floats: rates of the bounds.
        j: the contact.
        left: rate of the tension on its left [N per unit of the ramp].
        right: rate of the tension on its right.

    Returns:
        True if it would.
    """
    if status[j] & AT_FORWARD:
        growth = floats[ROW_D_FORWARD, j]
        outwards = (right - left) - growth
    else:
        growth = floats[ROW_D_BACKWARD, j]
        outwards = (left - right) - growth
    return outwards > 16.0 * EPS * (abs(right) + abs(left) + abs(growth))


@lean
def rate_block(lines, nodes, marks, first, last):
    """Compute the rates of the tensions of a block.

    Args:
        lines: tables of the ramp, shape (15, N).
        nodes: the tree, shape (2 M, 10).
        marks: rows ENDS and STALE, shape (2, N).
        first: first contact of the block.
        last: last contact of the block.

    Returns:
        The block with the rate of the tension before it [N per unit of the ramp], as for `state_at`; the rate of the
        tension behind it less that one; and the velocities whose rounding counts, the sum of the absolute terms [m per
        unit of the ramp].
    """
    n = lines.shape[1]
    low = max(first - 1, 0)
    high = min(last + 1, n - 1)
    length = difference(lines, Q, low, high)
    rise = 0.0
    pull = 0.0
    spread = 0.0
    if is_changing(nodes):
        growing = sum_range(lines, nodes, marks, first, last)
        rise = growing[2]
        pull = growing[3]
        spread = np.sqrt(length * max(growing[5], 0.0))
    rate = 0.0
    if last == n - 1:
        rate = -rise
    elif first > 0:
        rate = -(difference(lines, P, low, high) + pull) / length
    size = lines[SIZE, high] - lines[SIZE, low] + abs(rate) * length + spread
    return (first, last, rate), rise, size


@lean
def bound_part(lines, nodes, marks, before, behind, contact, side, part, size):
    """Bound the velocities of a part of two former blocks and the contact between them.

    Args:
        lines: tables of the ramp, shape (15, N).
        nodes: the tree, shape (2 M, 10); the sums still hold what the contacts of the former blocks added.
        marks: rows ENDS and STALE, shape (2, N).
        before: the block before the contact, from `former_block`.
        behind: the block behind it.
        contact: the contact that reached its bound.
        side: that bound, 1 forward, -1 backward.
        part: a block, as for `state_at`.
        size: velocities whose rounding counts [m per unit of the ramp].

    Returns:
        A lower bound of the velocities of those that slide forward, and an upper bound of the others.
    """
    left = _carry_bounds(lines, nodes, marks, before, part)
    right = _carry_bounds(lines, nodes, marks, behind, part)
    least = min(left[0], right[0]) - 4.0 * EPS * size
    most = max(left[1], right[1]) + 4.0 * EPS * size
    if part[0] <= contact <= part[1]:
        v = state_at(lines, nodes, marks, part, contact)[0]
        if side > 0:
            least = min(least, v)
        else:
            most = max(most, v)
    return least, most


@lean
def close_block(links, floats, account, lines, nodes, marks, first, s):
    """Account for a block up to s, and update its links to the walls.

    Args:
        links: tensions, changed in place.
        floats: rates, velocities, and the places since which they hold, changed in place.
        account: account of the ramp, added to.
        lines: tables of the ramp, shape (15, N), changed in place.
        nodes: the tree, shape (2 M, 10).
        marks: rows ENDS and STALE, shape (2, N).
        first: first contact of the block.
        s: place on the ramp, 0 .. 1.
    """
    start = fold(marks, first)
    last = first + marks[ENDS, start]
    n = lines.shape[1]
    since = lines[SINCE_OF, start]
    ds = s - since
    if ds > 0.0:
        rate = lines[RATE_OF, start]
        work = difference(lines, P, first, last) * rate
        if is_changing(nodes):
            _, _, growth, stretch, pulled, square = sum_range(lines, nodes, marks, first, last)
            # forces times velocities, summed by parts: tensions times the velocities of the links
            lost = -(pulled + rate * stretch + square)
            if last < n - 1:
                work += pulled - growth * difference(lines, P, last, last + 1)
            else:
                work += pulled
                lost += growth * state_at(lines, nodes, marks, (first, last, rate), last)[0]
            account[DISSIPATION] += lost * ds * (0.5 * (s + since))
        account[WORK] += work * ds * (0.5 * (s + since))
        lines[SINCE_OF, start] = s
    if first > 0:
        account[WORK] += advance_link(links, floats, s, fold(marks, first - 1))
    if last < n - 1:
        account[WORK] += advance_link(links, floats, s, fold(marks, last))


@lean
def enter_block(contacts, status, floats, bytes_, tree, leaves, lines, nodes, marks, i):
    """Let contact i, updated to s, slide in a long block.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        status: bounds at which contacts are.
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links, changed in place.
        tree: tournament of the next events, changed in place.
        leaves: number of its leaves.
        lines: tables of the ramp, shape (15, N), changed in place.
        nodes: the tree, shape (2 M, 10), changed in place.
        marks: row STALE is changed in place, shape (2, N).
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
    add_contact(contacts, floats, lines, nodes, marks, i, bytes_[ROW_SIDE, i])
    for p in range(i, lines.shape[1], marks.shape[1]):
        forget(nodes, p)
    return 1 if was_free else 0


@lean
def stop_contact(contacts, links, floats, bytes_, account, lines, nodes, marks, s, first, last, j, contact):
    """Stop a contact of a block that is closed at s: it becomes a wall that leaves its bound.

    The sums still hold what it added; `remove_contacts` removes that.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: tensions, changed in place.
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links, changed in place.
        account: account of the ramp, added to.
        lines: tables of the ramp, shape (15, N).
        nodes: the tree, shape (2 M, 10).
        marks: rows ENDS and STALE, shape (2, N).
        s: place on the ramp, 0 .. 1.
        first: first contact of the block.
        last: last contact of the block.
        j: the contact that stops.
        contact: the contact that reached its bound at s.
    """
    leave_block(contacts, links, floats, bytes_, account, lines, nodes, marks, s, first, last, j, contact)
    j = fold(marks, j)
    bytes_[ROW_SIDE, j] = 0
    floats[ROW_V, j] = 0.0
    floats[ROW_SINCE, j] = s


@lean
def release_block(contacts, links, floats, bytes_, account, lines, nodes, marks, s, first, last, known):
    """Compute tensions and displacements of a block, closed at s, so that it becomes a short one.

    The sums still hold what its contacts added; `remove_contacts` removes that.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: tensions, changed in place.
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links, changed in place.
        account: account of the ramp, added to.
        lines: tables of the ramp, shape (15, N), changed in place.
        nodes: the tree, shape (2 M, 10), changed in place.
        marks: rows ENDS and STALE, shape (2, N), changed in place.
        s: place on the ramp, 0 .. 1.
        first: first contact of the block.
        last: last contact of the block.
        known: True if its velocities are known.
    """
    n = lines.shape[1]
    part = s - nodes[0, START]
    tension = 0.0
    if first > 0:
        tension = links[TENSION, fold(marks, first - 1)]
    v = 0.0
    rate = 0.0
    if known:
        v, rate = state_at(lines, nodes, marks, (first, last, lines[RATE_OF, fold(marks, first)]), first)
    stretch = (0.0, 0.0)  # of the links from the first contact on, by their tensions
    latest = 0.0  # of those of them that are not in the sum of two floats yet
    size = 0.0
    for i in range(first, last + 1):
        j = fold(marks, i)
        tension += lines[SLIDE_FORCE, i] + s * lines[SLIDE_GROWTH, i]
        rate += lines[SLIDE_GROWTH, i]
        floats[ROW_V, j] = v
        floats[ROW_SINCE, j] = s
        start = difference(lines, ELONGATION, first, i)
        floats[ROW_GAIN, j] = difference(lines, P, first, i) * part + ((stretch[0] - start) + (stretch[1] + latest))
        if i < last:
            floats[ROW_RATE, j] = rate
            leave_link(links, floats, bytes_, account, s, j, tension)
            compliance = difference(lines, Q, i, i + 1)
            latest += tension * compliance
            if (i - first) % LEAF == LEAF - 1:
                stretch = add(stretch, (latest, 0.0))
                latest = 0.0
            size += abs(tension) * compliance
            if known:
                v += floats[ROW_D_ACTUATION, j] + rate * compliance
    end = links[TENSION, fold(marks, last)] if last < n - 1 else 0.0
    gap = abs(end - tension)
    account[VIOLATION] = max(account[VIOLATION], gap)
    account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], abs(v * gap))
    move_contacts(contacts, links, lines, marks, account, floats[ROW_GAIN], part, first, last, size)
    marks[ENDS, fold(marks, first)] = -1
    marks[ENDS, fold(marks, last)] = -1
