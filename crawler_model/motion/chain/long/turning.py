"""Velocities in long blocks of a chain as lines over lines, and the search for contacts that turn round.

With constant friction the contacts of a sliding block between walls p and q (see `solve`) have the velocities

    v_i = (P_i - P_p) + rate (Q_i - Q_p)

with P and Q the sums of the rates of the rest lengths and of the compliances of all links before a contact: lines that
are fixed for the ramp, and one number for each block, the common rate of its tensions. The lines are sums of two
floats, so that differences of neighbouring entries do not suffer from the length of the body.

A contact turns round when its velocity contradicts the bound that it slides at. Contacts are collected in leaves of
`LEAF` contacts, and these in a binary tree. A node stores a lower bound of the velocities of its contacts that slide
forward, and an upper bound of those that slide backward, both for the rate and the velocity of its first contact that
were in force when it was last searched. Velocities differ from the former ones by a line over Q, so a node whose bounds
still exclude turning is not searched again.
"""

from __future__ import annotations

import numpy as np

from ....compiled import lean
from ...state import BACKWARD, FORWARD
from ..memory import LEAF, ROW_D_ACTUATION, ROW_SIDE, SIZE, P, Q

START, RATE, LEAST, MOST, FORCE = range(5)
"""Columns of a node: velocity of its first contact and rate when it was last searched; lower bound of the velocities of
its contacts that slide forward, upper bound of those that slide backward; and of a leaf, the sum of the forces of its
contacts that slide in long blocks."""


@lean
def _extend(lines, row, i, step):
    """Compute entry i of a sum of two floats from entry i - 1."""
    before = lines[row, i - 1]
    after = before + step
    part = after - before
    lines[row, i] = after
    lines[row + 1, i] = lines[row + 1, i - 1] + ((before - (after - part)) + (step - part))


@lean
def tabulate(compliance, floats, lines, nodes):
    """Compute the lines for a ramp, and mark all nodes as not searched yet.

    Args:
        compliance: 1 / k, shape (N - 1,) [m/N].
        floats: row ROW_D_ACTUATION [m per unit of the ramp].
        lines: output, shape (10, N).
        nodes: output, the tree, shape (2 M, 5).
    """
    lines[:, 0] = 0.0
    for i in range(1, lines.shape[1]):
        change = floats[ROW_D_ACTUATION, i - 1]
        _extend(lines, P, i, change)
        _extend(lines, Q, i, compliance[i - 1])
        lines[SIZE, i] = lines[SIZE, i - 1] + abs(change)
    nodes[:, LEAST] = -np.inf
    nodes[:, MOST] = np.inf
    nodes[:, FORCE] = 0.0


@lean
def difference(lines, row, a, b):
    """Compute the difference of two entries of a table of two floats.

    Args:
        lines: shape (10, N).
        row: P or Q.
        a: first contact.
        b: last contact.

    Returns:
        Entry b minus entry a.
    """
    return (lines[row, b] - lines[row, a]) + (lines[row + 1, b] - lines[row + 1, a])


@lean
def velocity_at(lines, anchor, rate, i):
    """Compute the velocity of a contact of a block.

    Args:
        lines: shape (10, N).
        anchor: a wall beside the block, at rest.
        rate: common rate of the tensions of the block [N per unit of the ramp].
        i: the contact.

    Returns:
        Its velocity [m per unit of the ramp].
    """
    return difference(lines, P, anchor, i) + rate * difference(lines, Q, anchor, i)


@lean
def slide_force(contacts, bytes_, i):
    """Return the spring force on a contact that slides.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        bytes_: row ROW_SIDE, the bound that each contact is at.
        i: the contact.

    Returns:
        The force [N].
    """
    return contacts[FORWARD, i] if bytes_[ROW_SIDE, i] > 0 else -contacts[BACKWARD, i]


@lean
def sum_forces(contacts, bytes_, nodes, a, b):
    """Sum the spring forces on contacts of a long block.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        bytes_: row ROW_SIDE, the bound that each contact is at.
        nodes: the tree, with the sums of its leaves, shape (2 M, 5).
        a: first contact.
        b: last contact.

    Returns:
        The sum [N].
    """
    total = 0.0
    i = a
    while i <= b and i % LEAF != 0:
        total += slide_force(contacts, bytes_, i)
        i += 1
    while i + LEAF <= b + 1:
        total += nodes[nodes.shape[0] // 2 + i // LEAF, FORCE]
        i += LEAF
    while i <= b:
        total += slide_force(contacts, bytes_, i)
        i += 1
    return total


@lean
def forget(nodes, i):
    """Mark the nodes above a contact as not searched yet, as its bound has changed.

    Args:
        nodes: the tree, shape (2 M, 5).
        i: the contact.
    """
    node = nodes.shape[0] // 2 + i // LEAF
    while node >= 1 and (nodes[node, LEAST] != -np.inf or nodes[node, MOST] != np.inf):
        nodes[node, LEAST] = -np.inf
        nodes[node, MOST] = np.inf
        node >>= 1


@lean
def _bounds(nodes, node, start, rate, length):
    """Compute the bounds of the velocities in a node, whose first contact now has the velocity `start`."""
    first = start - nodes[node, START]
    last = first + (rate - nodes[node, RATE]) * length
    return nodes[node, LEAST] + min(first, last), nodes[node, MOST] + max(first, last)


@lean
def _search_leaf(lines, bytes_, anchor, rate, a, b):
    """Compute the least velocity of the contacts a..b that slide forward, and the largest of the others."""
    least = np.inf
    most = -np.inf
    for i in range(a, b + 1):
        v = velocity_at(lines, anchor, rate, i)
        if bytes_[ROW_SIDE, i] > 0:
            least = min(least, v)
        elif bytes_[ROW_SIDE, i] < 0:
            most = max(most, v)
    return least, most


@lean
def find_likely(lines, bytes_, anchor, rate, first, last, likely, tolerance):
    """Find which of a few contacts contradicts its bound most with its velocity.

    Args:
        lines: shape (10, N).
        bytes_: row ROW_SIDE, the bound that each contact is at, 1 or -1 in the block.
        anchor: a wall beside the block, at rest.
        rate: common rate of the tensions of the block [N per unit of the ramp].
        first: first contact of the block.
        last: last contact.
        likely: the contacts, a tuple; those outside the block are left out.
        tolerance: velocity that counts as zero [m per unit of the ramp].

    Returns:
        The contact, or -1 if none of them turns.
    """
    worst = tolerance
    found = -1
    for i in likely:
        if first <= i <= last:
            against = -bytes_[ROW_SIDE, i] * velocity_at(lines, anchor, rate, i)
            if against > worst:
                worst = against
                found = i
    return found


@lean
def find_turning(lines, nodes, order, bytes_, anchor, rate, first, last, tolerance):
    """Find the contact of a block whose velocity contradicts its bound most.

    Args:
        lines: shape (10, N).
        nodes: the tree, shape (2 M, 5), changed in place.
        order: memory for the nodes that are visited, int64, shape (2 M, 3).
        bytes_: row ROW_SIDE, the bound that each contact is at, 1 or -1 in the block.
        anchor: a wall beside the block, at rest.
        rate: common rate of the tensions of the block [N per unit of the ramp].
        first: first contact of the block.
        last: last contact.
        tolerance: velocity that counts as zero [m per unit of the ramp].

    Returns:
        The contact, or -1 if none turns; the work, in contacts; and if none turns, a lower bound of the velocities of
        the contacts that slide forward, and an upper bound of the others.
    """
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
            least, most = _bounds(nodes, node, velocity_at(lines, anchor, rate, a), rate, difference(lines, Q, a, b))
            if least >= -tolerance and most <= tolerance:
                lower = min(lower, least)
                upper = max(upper, most)
                order[k - 1, 2] = 0  # nothing to refresh
                continue
        if node >= leaves:
            low = max(a, first)
            high = min(b, last)
            least, most = _search_leaf(lines, bytes_, anchor, rate, low, high)
            effort += high - low + 1
            lower = min(lower, least)
            upper = max(upper, most)
            if whole:
                nodes[node, START] = velocity_at(lines, anchor, rate, a)
                nodes[node, RATE] = rate
                nodes[node, LEAST] = least
                nodes[node, MOST] = most
            if -least > worst or most > worst:
                worst = max(-least, most)
                for i in range(low, high + 1):
                    v = velocity_at(lines, anchor, rate, i)
                    if bytes_[ROW_SIDE, i] * v == -worst:
                        found = i
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
        start = velocity_at(lines, anchor, rate, a)
        middle = a + width // 2
        least, most = _bounds(nodes, 2 * node, start, rate, difference(lines, Q, a, middle - 1))
        other = velocity_at(lines, anchor, rate, middle)
        low, high = _bounds(nodes, 2 * node + 1, other, rate, difference(lines, Q, middle, a + width - 1))
        nodes[node, START] = start
        nodes[node, RATE] = rate
        nodes[node, LEAST] = min(least, low)
        nodes[node, MOST] = max(most, high)
    return found, effort + 4 * count, lower, upper
