"""Tables of a ramp with long blocks, and sums over ranges of contacts that slide in them.

Two lines are fixed for the ramp: P, the sum of the rates of the rest lengths, and Q, the sum of the compliances, of all
links before a contact. They are sums of two floats, so that differences of neighbouring entries do not suffer from the
length of the body.

A contact that slides in a long block adds its spring force, which grows with its friction, to the tensions of all links
behind it. Along a range of contacts that slide, the forces add up to the tensions, and the tensions times compliances
to elongations. Such sums are stored for leaves of `LEAF` contacts and for the nodes of a binary tree above them. A leaf
whose contacts have changed is stale until its sums are next needed.

In a ring, the tables go around it twice: contact i has the positions i and N + i, so that every block is a range of
positions. The lines then have 2 N columns; the displacements where long blocks began and the numbers of a block are
stored at its contacts.
"""

from __future__ import annotations

import numpy as np

from ....compiled import lean
from ...state import BACKWARD, FORWARD, TENSION, X_REST, X
from ..memory import (
    ELONGATION,
    LEAF,
    ROW_D_ACTUATION,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    SINCE_REST,
    SINCE_X,
    SIZE,
    SLIDE_FORCE,
    SLIDE_GROWTH,
    P,
    Q,
)

START, RATE, LEAST, MOST, FORCE, STRETCH, GROWTH, GROWTH_STRETCH, GROWTH_WORK, GROWTH_SQUARE = range(10)
"""Columns of a node: velocity of its first contact, and rate of the tension before it, when it was last searched; lower
bound of the velocities of its contacts that slide forward, upper bound of those that slide backward (`turning`). With
forces f, and tensions T that begin at 0 before its first contact: the sums of f and of T / k; with rates m of the
forces, and rates M of the tensions that begin at 0: the sums of m, M / k, M times the rate of the rest length, and
M^2 / k. The force of a stale leaf is nan. Row 0 is no node: it begins with the place on the ramp where long blocks
began, and 1 if friction changes."""
ENDS, STALE = range(2)
"""Rows of the marks: at the first and at the last contact of a long block the distance between them, elsewhere -1; the
number of stale leaves, and these leaves."""


@lean
def _extend(lines, row, i, step):
    """Compute entry i of a sum of two floats from entry i - 1."""
    before = lines[row, i - 1]
    after = before + step
    part = after - before
    lines[row, i] = after
    lines[row + 1, i] = lines[row + 1, i - 1] + ((before - (after - part)) + (step - part))


@lean
def tabulate(compliance, contacts, links, floats, lines, nodes, marks, s):
    """Compute the lines for the rest of a ramp, and empty the tree. There are no long blocks yet.

    Args:
        compliance: 1 / k, shape (N - 1,), of a ring (N,) [m/N].
        contacts: present displacements.
        links: present tensions.
        floats: rates of the commands.
        lines: output, shape (15, N).
        nodes: output, the tree, shape (2 M, 10).
        marks: output, rows ENDS and STALE, shape (2, N).
        s: place on the ramp, 0 .. 1.
    """
    n = contacts.shape[1]
    lines[:, 0] = 0.0
    lines[SLIDE_FORCE] = 0.0
    lines[SLIDE_GROWTH] = 0.0
    for i in range(1, lines.shape[1]):
        j = fold(marks, i - 1)
        change = floats[ROW_D_ACTUATION, j]
        _extend(lines, P, i, change)
        _extend(lines, Q, i, compliance[j])
        _extend(lines, ELONGATION, i, compliance[j] * links[TENSION, j])
        lines[SIZE, i] = lines[SIZE, i - 1] + abs(change)
    changing = 0.0
    for i in range(n):
        lines[SINCE_X, i] = contacts[X, i]
        lines[SINCE_REST, i] = contacts[X_REST, i]
        if floats[ROW_D_FORWARD, i] != 0.0 or floats[ROW_D_BACKWARD, i] != 0.0:
            changing = 1.0
    nodes[:, LEAST] = -np.inf
    nodes[:, MOST] = np.inf
    nodes[:, FORCE:] = 0.0
    nodes[0, START] = s
    nodes[0, RATE] = changing
    marks[ENDS] = -1
    marks[STALE, 0] = 0


@lean
def fold(marks, i):
    """Find the contact at a position, or the link behind it.

    Args:
        marks: a column for each contact, shape (2, N).
        i: the position.

    Returns:
        The position itself, or in a ring, where position N + i is contact i once more, the contact.
    """
    n = marks.shape[1]
    return i if i < n else i - n


@lean
def difference(lines, row, a, b):
    """Compute the difference of two entries of a table of two floats.

    Args:
        lines: shape (15, N).
        row: P, Q or ELONGATION.
        a: first contact.
        b: last contact.

    Returns:
        Entry b minus entry a.
    """
    return (lines[row, b] - lines[row, a]) + (lines[row + 1, b] - lines[row + 1, a])


@lean
def is_changing(nodes):
    """Check whether friction changes on the ramp.

    Args:
        nodes: the tree, shape (2 M, 10).

    Returns:
        True if it does.
    """
    return nodes[0, RATE] != 0.0


@lean
def _go_stale(nodes, marks, i):
    leaf = nodes.shape[0] // 2 + i // LEAF
    if not np.isnan(nodes[leaf, FORCE]):
        nodes[leaf, FORCE] = np.nan
        marks[STALE, 0] += 1
        marks[STALE, marks[STALE, 0]] = leaf


@lean
def _set_slide(lines, nodes, marks, i, force, growth):
    """Set the force of contact i and its rate at each of its positions."""
    for p in range(i, lines.shape[1], marks.shape[1]):
        lines[SLIDE_FORCE, p] = force
        lines[SLIDE_GROWTH, p] = growth
        _go_stale(nodes, marks, p)


@lean
def add_contact(contacts, floats, lines, nodes, marks, i, side):
    """Let the spring force on a contact, from now on at a bound, count in the sums.

    Args:
        contacts: bounds at the start of the ramp.
        floats: rates of the bounds.
        lines: tables of the ramp, shape (15, N), changed in place.
        nodes: the tree, shape (2 M, 10), changed in place.
        marks: row STALE is changed in place, shape (2, N).
        i: the contact.
        side: 1 for the forward bound, -1 for the backward one.
    """
    force = contacts[FORWARD, i] if side > 0 else -contacts[BACKWARD, i]
    growth = floats[ROW_D_FORWARD, i] if side > 0 else -floats[ROW_D_BACKWARD, i]
    _set_slide(lines, nodes, marks, i, force, growth)


@lean
def remove_contacts(lines, nodes, marks, first, last):
    """Let the spring forces on the contacts first..last no longer count in the sums.

    Args:
        lines: tables of the ramp, shape (15, N), changed in place.
        nodes: the tree, shape (2 M, 10), changed in place.
        marks: row STALE is changed in place, shape (2, N).
        first: first contact.
        last: last contact.
    """
    for i in range(first, last + 1):
        _set_slide(lines, nodes, marks, fold(marks, i), 0.0, 0.0)


@lean
def _append_contact(lines, total, i):
    """Extend sums over a range of contacts by the next contact and the link behind it."""
    force, stretch, growth, growth_stretch, growth_work, growth_square = total
    behind = min(i + 1, lines.shape[1] - 1)
    compliance = difference(lines, Q, i, behind)
    force += lines[SLIDE_FORCE, i]
    stretch += force * compliance
    if lines[SLIDE_GROWTH, i] != 0.0 or growth != 0.0:
        growth += lines[SLIDE_GROWTH, i]
        growth_stretch += growth * compliance
        growth_work += growth * difference(lines, P, i, behind)
        growth_square += growth * growth * compliance
    return force, stretch, growth, growth_stretch, growth_work, growth_square


@lean
def _append_node(lines, nodes, total, node, a, b):
    """Extend sums over a range of contacts by those of a node, which begins at contact a and ends before b."""
    force, stretch, growth, growth_stretch, growth_work, growth_square = total
    end = min(b, lines.shape[1] - 1)
    compliance = difference(lines, Q, a, end)
    stretch += force * compliance + nodes[node, STRETCH]
    force += nodes[node, FORCE]
    if is_changing(nodes):
        growth_square += growth * (2.0 * nodes[node, GROWTH_STRETCH] + growth * compliance) + nodes[node, GROWTH_SQUARE]
        growth_stretch += growth * compliance + nodes[node, GROWTH_STRETCH]
        growth_work += growth * difference(lines, P, a, end) + nodes[node, GROWTH_WORK]
        growth += nodes[node, GROWTH]
    return force, stretch, growth, growth_stretch, growth_work, growth_square


@lean
def _store(nodes, node, total):
    for k in range(6):
        nodes[node, FORCE + k] = total[k]


@lean
def _freshen(lines, nodes, marks):
    """Compute the sums of all stale leaves and of the nodes above them."""
    n = lines.shape[1]
    leaves = nodes.shape[0] // 2
    for k in range(1, marks[STALE, 0] + 1):
        leaf = marks[STALE, k]
        total = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        first = (leaf - leaves) * LEAF
        for i in range(first, min(first + LEAF, n)):
            total = _append_contact(lines, total, i)
        _store(nodes, leaf, total)
    width = LEAF
    level = leaves
    while level > 1:  # the nodes above leaves, level by level; neighbours in the list often share them
        before = 0
        for k in range(1, marks[STALE, 0] + 1):
            node = marks[STALE, k] >> 1
            marks[STALE, k] = node
            if node == before:
                continue
            before = node
            first = (2 * node - level) * width
            total = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            if first < n:
                total = _append_node(lines, nodes, total, 2 * node, first, first + width)
            if first + width < n:
                total = _append_node(lines, nodes, total, 2 * node + 1, first + width, first + 2 * width)
            _store(nodes, node, total)
        level //= 2
        width *= 2
    marks[STALE, 0] = 0


@lean
def sum_range(lines, nodes, marks, a, b):
    """Sum over the contacts a..b that slide in a long block, and over the link behind each of them.

    Args:
        lines: tables of the ramp, shape (15, N).
        nodes: the tree, shape (2 M, 10), changed in place.
        marks: row STALE is changed in place, shape (2, N).
        a: first contact.
        b: last contact; if less than a, all sums are zero.

    Returns:
        The sums in columns FORCE .. GROWTH_SQUARE of a node, for this range.
    """
    total = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if b - a >= LEAF - 1 and marks[STALE, 0] > 0:
        _freshen(lines, nodes, marks)
    leaves = nodes.shape[0] // 2
    i = a
    while i <= b:
        if i % LEAF != 0 or i + LEAF - 1 > b:
            total = _append_contact(lines, total, i)
            i += 1
            continue
        node = leaves + i // LEAF
        width = LEAF
        while node % 2 == 0 and i + 2 * width - 1 <= b:
            node //= 2
            width *= 2
        total = _append_node(lines, nodes, total, node, i, i + width)
        i += width
    return total
