"""Velocities in long blocks as lines over lines, and the search for contacts that turn round.

The contacts of a sliding block behind a wall p have the velocities

    v_i = (P_i - P_p) + rate (Q_i - Q_p) + W

with the lines P and Q of `tables`, the rate of the tension of the first link, and, while friction changes, the sum W
over the contacts before i in the block of the rates of their forces, each times the compliance between it and i. A
block is a tuple of its first and last contact and that rate.

A contact turns round when its velocity contradicts the bound that it slides at. Contacts are collected in leaves of
`LEAF` contacts, and these in a binary tree. A node stores a lower bound of the velocities of its contacts that slide
forward, and an upper bound of those that slide backward, both for the rate and the velocity of its first contact that
were in force when it was last searched. Velocities differ from the former ones by a line over Q, so a node whose bounds
still exclude turning is not searched again.
"""

from __future__ import annotations

import numpy as np

from ....compiled import lean
from ..memory import LEAF, ROW_SIDE, SLIDE_GROWTH, P, Q
from .tables import LEAST, MOST, RATE, START, difference, fold, is_changing, sum_range


@lean
def state_at(lines, nodes, marks, block, i):
    """Compute the velocity of a contact of a block, and the rate of the tension before it.

    Args:
        lines: tables of the ramp, shape (15, N).
        nodes: the tree, shape (2 M, 10).
        marks: rows ENDS and STALE, shape (2, N).
        block: first and last contact, and the rate of the tension before the first one.
        i: the contact.

    Returns:
        Velocity [m per unit of the ramp] and rate [N per unit of the ramp].
    """
    first, last, rate = block
    if first > 0:
        v = difference(lines, P, first - 1, i) + rate * difference(lines, Q, first - 1, i)
        if is_changing(nodes):
            before = sum_range(lines, nodes, marks, first, i - 1)
            v += before[3]
            rate += before[2]
        return v, rate
    v = -difference(lines, P, i, last + 1)
    if is_changing(nodes):
        rate = sum_range(lines, nodes, marks, first, i - 1)[2]
        v -= rate * difference(lines, Q, i, last + 1) + sum_range(lines, nodes, marks, i, last)[3]
    return v, rate


@lean
def forget(nodes, i):
    """Mark the nodes above a contact as not searched yet, as its bound has changed.

    Args:
        nodes: the tree, shape (2 M, 10).
        i: the contact.
    """
    node = nodes.shape[0] // 2 + i // LEAF
    while node >= 1 and (nodes[node, LEAST] != -np.inf or nodes[node, MOST] != np.inf):
        nodes[node, LEAST] = -np.inf
        nodes[node, MOST] = np.inf
        node >>= 1


@lean
def _bounds(nodes, node, state, length):
    """Compute the bounds of the velocities in a node, whose first contact now has the given state."""
    first = state[0] - nodes[node, START]
    last = first + (state[1] - nodes[node, RATE]) * length
    return nodes[node, LEAST] + min(first, last), nodes[node, MOST] + max(first, last)


@lean
def _search_leaf(lines, nodes, marks, bytes_, state, a, b, wanted):
    """Compute the least velocity of the contacts a..b that slide forward, and the largest of the others.

    Also returns the last contact whose velocity contradicts its bound by `wanted`, or -1.
    """
    least = np.inf
    most = -np.inf
    found = -1
    start, rate = state
    change = 0.0
    changing = is_changing(nodes)
    for i in range(a, b + 1):
        v = start + difference(lines, P, a, i) + rate * difference(lines, Q, a, i)
        if changing:
            v += change
            rise = lines[SLIDE_GROWTH, i]
            # the tensions behind contact i have another rate: continue the line over Q from here
            change -= rise * difference(lines, Q, a, i)
            rate += rise
        side = bytes_[ROW_SIDE, fold(marks, i)]
        if side > 0:
            least = min(least, v)
        elif side < 0:
            most = max(most, v)
        if side * v == -wanted:
            found = i
    return least, most, found


@lean
def find_likely(lines, nodes, marks, bytes_, block, likely, tolerance):
    """Find which of a few contacts contradicts its bound most with its velocity.

    Args:
        lines: tables of the ramp, shape (15, N).
        nodes: the tree, shape (2 M, 10).
        marks: rows ENDS and STALE, shape (2, N).
        bytes_: row ROW_SIDE, the bound that each contact is at, 1 or -1 in the block.
        block: as for `state_at`.
        likely: the contacts, a tuple; those outside the block are left out.
        tolerance: velocity that counts as zero [m per unit of the ramp].

    Returns:
        The contact, or -1 if none of them turns.
    """
    worst = tolerance
    found = -1
    for i in likely:
        if block[0] <= i <= block[1]:
            against = -bytes_[ROW_SIDE, fold(marks, i)] * state_at(lines, nodes, marks, block, i)[0]
            if against > worst:
                worst = against
                found = i
    return found


@lean
def find_turning(lines, nodes, marks, order, bytes_, block, tolerance):
    """Find the contact of a block whose velocity contradicts its bound most.

    Args:
        lines: tables of the ramp, shape (15, N).
        nodes: the tree, shape (2 M, 10), changed in place.
        marks: rows ENDS and STALE, shape (2, N).
        order: memory for the nodes that are visited, int64, shape (2 M, 3).
        bytes_: row ROW_SIDE, the bound that each contact is at, 1 or -1 in the block.
        block: as for `state_at`.
        tolerance: velocity that counts as zero [m per unit of the ramp].

    Returns:
        The contact, or -1 if none turns; the work, in contacts; and if none turns, a lower bound of the velocities of
        the contacts that slide forward, and an upper bound of the others.
    """
    first, last, _ = block
    leaves = nodes.shape[0] // 2
    top = leaves + first // LEAF
    other = leaves + last // LEAF
    size = LEAF
    while top != other:
        top >>= 1
        other >>= 1
        size *= 2
    order[0, 0] = top
    order[0, 1] = first // size * size
    order[0, 2] = size
    count = 1
    k = 0
    worst = tolerance
    found = -1
    effort = 0
    lower = np.inf
    upper = -np.inf
    while k < count:
        node = order[k, 0]
        a = order[k, 1]
        width = order[k, 2]
        b = a + width - 1
        k += 1
        whole = a >= first and b <= last
        if whole:
            state = state_at(lines, nodes, marks, block, a)
            least, most = _bounds(nodes, node, state, difference(lines, Q, a, b))
            if least >= -tolerance and most <= tolerance:
                lower = min(lower, least)
                upper = max(upper, most)
                order[k - 1, 2] = 0  # nothing to refresh
                continue
        if node >= leaves:
            low = max(a, first)
            high = min(b, last)
            state = state_at(lines, nodes, marks, block, low)
            least, most, _ = _search_leaf(lines, nodes, marks, bytes_, state, low, high, np.inf)
            effort += high - low + 1
            lower = min(lower, least)
            upper = max(upper, most)
            if whole:
                nodes[node, START] = state[0]
                nodes[node, RATE] = state[1]
                nodes[node, LEAST] = least
                nodes[node, MOST] = most
            if -least > worst or most > worst:
                worst = max(-least, most)
                found = _search_leaf(lines, nodes, marks, bytes_, state, low, high, worst)[2]
            continue
        half = width // 2
        if a + half > first:
            order[count, 0] = 2 * node
            order[count, 1] = a
            order[count, 2] = half
            count += 1
        if a + half <= last:
            order[count, 0] = 2 * node + 1
            order[count, 1] = a + half
            order[count, 2] = half
            count += 1
    for k in range(count - 1, -1, -1):
        node = order[k, 0]
        a = order[k, 1]
        width = order[k, 2]
        if width == 0 or node >= leaves or a < first or a + width - 1 > last:
            continue
        state = state_at(lines, nodes, marks, block, a)
        middle = a + width // 2
        least, most = _bounds(nodes, 2 * node, state, difference(lines, Q, a, middle - 1))
        other = state_at(lines, nodes, marks, block, middle)
        low, high = _bounds(nodes, 2 * node + 1, other, difference(lines, Q, middle, a + width - 1))
        nodes[node, START] = state[0]
        nodes[node, RATE] = state[1]
        nodes[node, LEAST] = min(least, low)
        nodes[node, MOST] = max(most, high)
    return found, effort + 4 * count, lower, upper
