"""Displacements of contacts in long blocks, summed over the lives of the blocks.

A block first..last that lived for ds with rate `rate` and its anchor at a moves each of its contacts by

    P_i ds + Q_i rate ds - (P_a + rate Q_a) ds

with the sums P and Q of `turning`: three numbers that are the same for all of them. They are added at its first
contact and subtracted behind its last; their sums over all contacts up to i hold for contact i. All are sums of two
floats, because displacements are small differences of them. `SPAN` and `SPAN` squared contacts also have one sum each,
so that the displacement of a single contact is known at any time.
"""

from __future__ import annotations

from ...compiled import lean
from ..state import BACKWARD, DISSIPATION, FORWARD, shift
from .memory import SPAN
from .turning import P_LOW, Q_LOW, P, Q, difference
from .wide import add, multiply, subtract

SETTLED = 7
"""Row of the lines: displacement of a contact whose dissipation is in the account."""
ENDS, SLID = range(2)
"""Rows of the marks: at the first and at the last contact of a long block the other one, elsewhere -1; 1 or -1 for
contacts that slid forward or backward in a long block, else 0."""


@lean
def _add_to(sums, row, column, term):
    total = add((sums[row, column], sums[row, column + 1]), term)
    sums[row, column] = total[0]
    sums[row, column + 1] = total[1]


@lean
def add_slide(lines, sums, first, last, anchor, rate, ds):
    """Add the displacements of the contacts of a block.

    Args:
        lines: tables of the ramp, shape (8, N).
        sums: sums for displacements, shape (R, 6), changed in place.
        first: first contact.
        last: last contact.
        anchor: a wall beside the block, at rest.
        rate: common rate of the tensions [N per unit of the ramp].
        ds: part of the ramp.
    """
    n = lines.shape[1]
    rated = multiply((rate, 0.0), (ds, 0.0))
    at = multiply((lines[P, anchor], lines[P_LOW, anchor]), (ds, 0.0))
    anchored = add(at, multiply((lines[Q, anchor], lines[Q_LOW, anchor]), rated))
    i = first
    sign = 1.0
    while i < n:
        row = i
        start = 0
        width = n
        for _ in range(3):
            _add_to(sums, row, 0, (sign * ds, 0.0))
            _add_to(sums, row, 2, (sign * rated[0], sign * rated[1]))
            _add_to(sums, row, 4, (sign * anchored[0], sign * anchored[1]))
            start += width
            width = width // SPAN + 1
            i //= SPAN
            row = start + i
        if sign < 0.0:
            break
        i = last + 1
        sign = -1.0


@lean
def _sum_rows(sums, a, b, total):
    """Add the rows a..b - 1 to the sums `total`."""
    time, rated, anchored = total
    for row in range(a, b):
        time = add(time, (sums[row, 0], sums[row, 1]))
        rated = add(rated, (sums[row, 2], sums[row, 3]))
        anchored = add(anchored, (sums[row, 4], sums[row, 5]))
    return time, rated, anchored


@lean
def _displacement(lines, total, i):
    """Compute the displacement of a contact from the sums over all contacts up to it."""
    at = multiply((lines[P, i], lines[P_LOW, i]), total[0])
    turned = multiply((lines[Q, i], lines[Q_LOW, i]), total[1])
    moved = subtract(add(at, turned), total[2])
    return moved[0] + moved[1]


@lean
def _settle(contacts, account, lines, marks, i, displacement):
    """Add to the account what contact i dissipated since the last time."""
    moved = displacement - lines[SETTLED, i]
    force = contacts[FORWARD, i] if marks[SLID, i] > 0 else -contacts[BACKWARD, i]
    account[DISSIPATION] += force * moved
    lines[SETTLED, i] = displacement


@lean
def begin_slide(contacts, account, lines, sums, marks, i, side):
    """Note that a contact slides in a long block at another bound from now on.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        account: account of the ramp; if the contact slid at the other bound before, that dissipation is added.
        lines: tables of the ramp, shape (8, N).
        sums: sums for displacements, shape (R, 6).
        marks: row SLID is changed in place, shape (2, N).
        i: the contact.
        side: 1 forward, -1 backward.
    """
    if marks[SLID, i] != 0:
        n = lines.shape[1]
        nothing = (0.0, 0.0)
        fine = i // SPAN
        coarse = fine // SPAN
        start = n + n // SPAN + 1
        total = _sum_rows(sums, start, start + coarse, (nothing, nothing, nothing))
        total = _sum_rows(sums, n + coarse * SPAN, n + fine, total)
        total = _sum_rows(sums, fine * SPAN, i + 1, total)
        _settle(contacts, account, lines, marks, i, _displacement(lines, total, i))
    marks[SLID, i] = side


@lean
def finish_slides(contacts, account, lines, sums, marks):
    """Move the contacts by what they slid in long blocks, and add the rest of the dissipation.

    Args:
        contacts: rows of the contacts, as in `follow_events`, changed in place.
        account: account of the ramp, added to.
        lines: tables of the ramp, shape (8, N).
        sums: sums for displacements, shape (R, 6).
        marks: row SLID, shape (2, N).
    """
    nothing = (0.0, 0.0)
    total = (nothing, nothing, nothing)
    known = 0  # the last contact whose displacement was computed from two floats, and that displacement
    start = 0.0
    for i in range(contacts.shape[1]):
        if sums[i, 0] != 0.0 or sums[i, 1] != 0.0 or sums[i, 2] != 0.0 or sums[i, 4] != 0.0:
            total = _sum_rows(sums, i, i + 1, total)
            known = i
            start = _displacement(lines, total, i)
        if marks[SLID, i] != 0:
            displacement = start
            if i > known:
                displacement += difference(lines, P, known, i) * total[0][0]
                displacement += difference(lines, Q, known, i) * total[1][0]
            _settle(contacts, account, lines, marks, i, displacement)
            shift(contacts, displacement, 1.0, i, 0.5)
