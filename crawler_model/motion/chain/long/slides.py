"""Displacements of contacts in long blocks, summed over the lives of the blocks.

A block first..last that lived for ds with rate `rate` and its anchor at a moves each of its contacts by

    P_i ds + Q_i rate ds - (P_a + rate Q_a) ds

with the sums P and Q of `turning`: three numbers that are the same for all of them. They are added at its first
contact and subtracted behind its last; their sums over all contacts up to i hold for contact i. All are sums of two
floats, because displacements are small differences of them. `SPAN` and `SPAN` squared contacts also have one sum each,
so that the displacement of a single contact can be estimated at any time. The estimate only divides the dissipation of
a contact that slides both ways in one ramp.
"""

from __future__ import annotations

from ....compiled import lean
from ....rounding import EPS
from ...state import BACKWARD, DISSIPATION, FORWARD, shift
from ..memory import P_LOW, Q_LOW, SETTLED, SPAN, P, Q
from ..wide import add, multiply, subtract
from .turning import difference

_ROUNDING = 16.0 * EPS
"""A displacement below this part of the terms that it is the difference of is rounding."""
ENDS, SLID = range(2)
"""Rows of the marks: at the first and at the last contact of a long block the other one, elsewhere -1; 1 or -1 for
contacts that slid forward or backward in a long block, else 0."""


@lean
def _add_to(sums, row, column, high, low):
    """Add a number of two floats to a sum of two floats, of which the second collects the rounding of the first."""
    before = sums[row, column]
    after = before + high
    part = after - before
    sums[row, column] = after
    sums[row, column + 1] += ((before - (after - part)) + (high - part)) + low


@lean
def add_slide(lines, sums, first, last, anchor, rate, ds):
    """Add the displacements of the contacts of a block.

    Args:
        lines: tables of the ramp, shape (10, N).
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
    for i, sign in ((first, 1.0), (last + 1, -1.0)):
        if i >= n:
            break
        _add_to(sums, i, 0, sign * ds, 0.0)
        _add_to(sums, i, 2, sign * rated[0], sign * rated[1])
        _add_to(sums, i, 4, sign * anchored[0], sign * anchored[1])
        fine = n + i // SPAN
        coarse = n + n // SPAN + 1 + i // SPAN // SPAN
        for row in (fine, coarse):
            sums[row, 0] += sign * ds
            sums[row, 2] += sign * rated[0]
            sums[row, 4] += sign * anchored[0]


@lean
def _sum_rows(sums, a, b):
    """Sum the rows a..b - 1, without the second floats."""
    time = 0.0
    rated = 0.0
    anchored = 0.0
    for row in range(a, b):
        time += sums[row, 0]
        rated += sums[row, 2]
        anchored += sums[row, 4]
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
        lines: tables of the ramp, shape (10, N).
        sums: sums for displacements, shape (R, 6).
        marks: row SLID is changed in place, shape (2, N).
        i: the contact.
        side: 1 forward, -1 backward.
    """
    if marks[SLID, i] != 0:
        n = lines.shape[1]
        fine = i // SPAN
        coarse = fine // SPAN
        start = n + n // SPAN + 1
        far = _sum_rows(sums, start, start + coarse)
        middle = _sum_rows(sums, n + coarse * SPAN, n + fine)
        near = _sum_rows(sums, fine * SPAN, i + 1)
        time = far[0] + middle[0] + near[0]
        rated = far[1] + middle[1] + near[1]
        anchored = far[2] + middle[2] + near[2]
        _settle(contacts, account, lines, marks, i, lines[P, i] * time + lines[Q, i] * rated - anchored)
    marks[SLID, i] = side


@lean
def finish_slides(contacts, account, lines, sums, marks):
    """Move the contacts by what they slid in long blocks, and add the rest of the dissipation.

    Args:
        contacts: rows of the contacts, as in `follow_events`, changed in place.
        account: account of the ramp, added to.
        lines: tables of the ramp, shape (10, N).
        sums: sums for displacements, shape (R, 6).
        marks: row SLID, shape (2, N).
    """
    nothing = (0.0, 0.0)
    total = (nothing, nothing, nothing)
    known = 0  # the last contact whose displacement was computed from two floats, and that displacement
    start = 0.0
    for i in range(contacts.shape[1]):
        if sums[i, 0] != 0.0 or sums[i, 1] != 0.0 or sums[i, 2] != 0.0 or sums[i, 4] != 0.0:
            time = add(total[0], (sums[i, 0], sums[i, 1]))
            rated = add(total[1], (sums[i, 2], sums[i, 3]))
            anchored = add(total[2], (sums[i, 4], sums[i, 5]))
            total = (time, rated, anchored)
            known = i
            start = _displacement(lines, total, i)
        if marks[SLID, i] != 0:
            displacement = start
            if i > known:
                displacement += difference(lines, P, known, i) * total[0][0]
                displacement += difference(lines, Q, known, i) * total[1][0]
            size = abs(lines[P, i] * total[0][0]) + abs(lines[Q, i] * total[1][0]) + abs(total[2][0])
            if abs(displacement) <= _ROUNDING * size:  # the contact was at its bound, but did not move
                displacement = 0.0
            _settle(contacts, account, lines, marks, i, displacement)
            shift(contacts, displacement, 1.0, i, 0.5)
