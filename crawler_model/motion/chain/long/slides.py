"""Tensions and displacements of contacts in long blocks.

Both are computed only where a contact stops or a block ends. Along a block the tensions grow from contact to contact by
the forces at their bounds. Elongations follow from tensions and rest lengths, and the displacement of a contact from
that of a contact at rest beside it and from the elongations in between, less those at the place where long blocks began
in this ramp. A contact stays at one bound while it is in long blocks, so its dissipation there follows from its
displacement; the part that the change of friction adds is in the account of the block.
"""

from __future__ import annotations

from ....compiled import lean
from ....rounding import EPS
from ...state import DISSIPATION, TENSION, WORK, X_REST, X, shift
from ..memory import (
    ELONGATION,
    ROW_D_ACTUATION,
    ROW_LINK_SINCE,
    ROW_MOVED,
    SINCE_REST,
    SINCE_X,
    SIZE,
    SLIDE_FORCE,
    SLIDE_GROWTH,
    P,
    Q,
)
from .tables import START, difference, fold, sum_range

_ROUNDING = 16.0 * EPS
"""A displacement below this part of the terms that it is the difference of is rounding."""


@lean
def displaced(contacts, lines, i):
    """Compute how far a contact that is not in a long block has moved since long blocks began in the ramp.

    Args:
        contacts: displacements.
        lines: tables of the ramp, shape (15, N).
        i: the contact.

    Returns:
        The displacement [m].
    """
    return (contacts[X, i] - lines[SINCE_X, i]) + (contacts[X_REST, i] - lines[SINCE_REST, i])


@lean
def _move_contact(contacts, lines, account, i, displacement, size):
    """Move a contact that leaves a long block, and add the dissipation by the friction at the start of the ramp.

    `displacement` is that since long blocks began in the ramp, `size` the sum of its absolute terms.
    """
    before = displaced(contacts, lines, i)
    change = displacement - before
    if abs(change) > _ROUNDING * (size + abs(before)):  # else the contact was at its bound, but did not move
        account[DISSIPATION] += lines[SLIDE_FORCE, i] * change
        shift(contacts, change, 1.0, i, 0.5)


@lean
def _extension(links, lines, marks, part, i):
    """Compute how much longer the link behind contact i became since long blocks began in the ramp.

    Also returns the sum of the absolute terms.
    """
    stretch = links[TENSION, fold(marks, i)] * difference(lines, Q, i, i + 1)
    before = difference(lines, ELONGATION, i, i + 1)
    change = difference(lines, P, i, i + 1) * part
    return change + (stretch - before), abs(change) + abs(stretch) + abs(before)


@lean
def move_contacts(contacts, links, lines, marks, account, gains, part, first, last, size):
    """Move the contacts of a long block that ends, and add the dissipation by the friction at the start of the ramp.

    Between two contacts at rest the elongations do not quite sum up to their distance, as rounding in the tension of
    one link is in those of all links behind it. The difference is distributed like an elongation by one tension.

    Args:
        contacts: displacements, changed in place.
        links: tensions at the end of the block.
        lines: tables of the ramp, shape (15, N).
        marks: rows ENDS and STALE, shape (2, N).
        account: account of the ramp, added to.
        gains: displacements since long blocks began in the ramp less that of the first contact, shape (N,) [m].
        part: the part of the ramp since then.
        first: first contact of the block.
        last: last contact of the block.
        size: sum of the absolute elongations of its links [m].
    """
    n = lines.shape[1]
    base = 0.0
    near = 0.0
    if first > 0:
        longer, near = _extension(links, lines, marks, part, first - 1)
        base = displaced(contacts, lines, fold(marks, first - 1)) + longer
    slope = 0.0
    if last < n - 1:
        longer, near_other = _extension(links, lines, marks, part, last)
        other = displaced(contacts, lines, fold(marks, last + 1)) - longer - gains[fold(marks, last)]
        if first > 0:
            slope = (other - base) / difference(lines, Q, first - 1, last + 1)
        else:
            base = other
            near = near_other
    near += abs(base)
    reach = 0.0
    for i in range(first, last + 1):
        j = fold(marks, i)
        terms = near
        if first > 0:
            terms += reach + (lines[SIZE, i] - lines[SIZE, first]) * part
            displacement = base + gains[j] + slope * difference(lines, Q, first - 1, i)
        else:
            terms += (size - reach) + (lines[SIZE, last] - lines[SIZE, i]) * part
            displacement = base + gains[j]
        if i < last:
            reach += abs(links[TENSION, j]) * difference(lines, Q, i, i + 1)
        _move_contact(contacts, lines, account, j, displacement, terms)


@lean
def leave_link(links, floats, bytes_, account, s, j, tension):
    """Set the tension of a link that was inside a long block up to s.

    Args:
        links: tensions, changed in place.
        floats: the places since which tensions hold, changed in place.
        bytes_: moved links, changed in place.
        account: account of the ramp, added to.
        s: place on the ramp, 0 .. 1.
        j: the link.
        tension: its tension at s [N].
    """
    links[TENSION, j] = tension
    floats[ROW_LINK_SINCE, j] = s
    account[WORK] -= floats[ROW_D_ACTUATION, j] * tension * s
    bytes_[ROW_MOVED, j] = 1


@lean
def leave_block(contacts, links, floats, bytes_, account, lines, nodes, marks, s, first, last, j, contact):
    """Compute tensions and displacement at s of a contact inside a block that is closed at s.

    The tensions of the links to the walls and of those beside `contact` are known at s.

    Args:
        contacts: displacements, changed in place.
        links: tensions, changed in place.
        floats: the places since which tensions hold, changed in place.
        bytes_: moved links, changed in place.
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
    n = lines.shape[1]
    i = fold(marks, j)
    part = s - nodes[0, START]
    force = lines[SLIDE_FORCE, j] + s * lines[SLIDE_GROWTH, j]
    left = first - 1  # contacts at rest on both sides, -1 or N if there is none
    right = last + 1
    if first <= contact < j:
        left = contact
    elif j < contact <= last:
        right = contact
    if contact == j:
        before = links[TENSION, fold(marks, j - 1)] if j > 0 else 0.0
        after = links[TENSION, i] if j < n - 1 else 0.0
    elif left >= 0 and (j - left <= right - j or right == n):
        between = sum_range(lines, nodes, marks, left + 1, j - 1)
        base = links[TENSION, fold(marks, left)]
        before = base + (between[0] + s * between[2])
        after = before + force
        stretch = base * difference(lines, Q, left, j) + (between[1] + s * between[3])
        at_start = difference(lines, ELONGATION, left, j)
        longer = difference(lines, P, left, j) * part + (stretch - at_start)
        size = (lines[SIZE, j] - lines[SIZE, left]) * part + abs(stretch) + abs(at_start)
        _move_contact(contacts, lines, account, i, displaced(contacts, lines, fold(marks, left)) + longer, size)
    else:
        between = sum_range(lines, nodes, marks, j + 1, right - 1)
        base = links[TENSION, fold(marks, right - 1)]
        after = base - (between[0] + s * between[2])
        before = after - force
        stretch = after * difference(lines, Q, j, right) + (between[1] + s * between[3])
        at_start = difference(lines, ELONGATION, j, right)
        longer = difference(lines, P, j, right) * part + (stretch - at_start)
        size = (lines[SIZE, right] - lines[SIZE, j]) * part + abs(stretch) + abs(at_start)
        _move_contact(contacts, lines, account, i, displaced(contacts, lines, fold(marks, right)) - longer, size)
    if j > first:
        leave_link(links, floats, bytes_, account, s, fold(marks, j - 1), before)
    if j < last:
        leave_link(links, floats, bytes_, account, s, i, after)
