"""Friction that changes with elongations: a spring adds to the bounds of contacts what its length makes of it.

With z the elongation of a spring and a the slope of what it adds to the forward bound F of a contact,

    F' = a z' + what the ground and the commands change,

whether the contact slides or rests, and wherever it is. So a spring acts on all contacts at once: every block is the
whole body, in which contacts inside their bounds are rows that rest. The matrix of a block is not symmetric, and is
solved by `dense`. Rates are constant between the kinks of what springs add. At a kink the slope depends on the
direction in which the spring goes on, and that on the rates: a spring at a kink has a side, as a contact at its bound.
"""

from __future__ import annotations

import numpy as np

from ....compiled import inlined, lean
from ....rounding import EPS, NOISE
from ..advance import place_of
from ..records import BACKWARD, FORWARD, KINK

_ROUNDING = 64.0 * EPS
"""Part of displacements within which a spring is at a kink."""
_MOST_KINKED = 40
"""Springs at kinks that are counted: with more, there are too many combinations of directions to try in any case."""


@inlined
def couplings_of(ground):
    """Return the couplings, of which a kernel knows that they are None if they are passed on as an argument.

    Returns:
        The `Couplings`; None without any.
    """
    if ground is None:
        return None
    return ground.couplings


@lean
def is_coupled(couplings):
    """Determine whether friction changes with elongations.

    Returns:
        Whether it does.
    """
    return couplings is not None


@inlined
def more_on(foot, side, s):
    """Compute the friction that springs add to a bound at s.

    Args:
        side: FORWARD or BACKWARD.

    Returns:
        The friction [N].
    """
    if side == FORWARD:
        return foot.more_forward + s * foot.d_more_forward
    return foot.more_backward + s * foot.d_more_backward


@lean
def _near(contacts, coupling):
    """Find how far from a kink a spring may be that is at it, but for the rounding of displacements [m]."""
    return _ROUNDING * (abs(contacts[coupling.a].x) + abs(contacts[coupling.b].x) + abs(coupling.z))


@lean
def place_couplings(contacts, couplings, ramp):
    """Find the elongations where a block is to be solved, their pieces, and which springs are at kinks."""
    if couplings is None:
        return
    for k in range(couplings.each.shape[0]):
        coupling = couplings.each[k]
        a, b, pieces, p = contacts[coupling.a], contacts[coupling.b], couplings.pieces, coupling.piece
        way_a, way_b = a.v * (place_of(a, ramp) - a.since), b.v * (place_of(b, ramp) - b.since)
        z = coupling.z = (b.x - a.x) + ((b.residue + way_b) - (a.residue + way_a))
        while z < pieces[p].begin:
            p -= 1
        while z > pieces[p].end:
            p += 1
        near, below, above = _near(contacts, coupling), z - pieces[p].begin, pieces[p].end - z
        due = coupling.next <= ramp.s
        coupling.kinked = not ramp.stepping and (due or min(below, above) <= near)
        coupling.low = p - 1 if below < above else p
        if not coupling.kinked or abs(2 * (coupling.piece - coupling.low) - 1) != 1:
            coupling.piece = p


@lean
def pass_kinks(contacts, couplings, changed, one_only):
    """Find the pieces of springs at the end of an implicit step, each at most one further than it was solved with.

    Args:
        changed: whether something else has changed already.
        one_only: whether only one thing changes.

    Returns:
        Whether something has changed.
    """
    if couplings is None:
        return changed
    for k in range(couplings.each.shape[0]):
        if changed and one_only:
            break
        coupling = couplings.each[k]
        piece, near = couplings.pieces[coupling.piece], _near(contacts, coupling)
        z = coupling.z + (contacts[coupling.b].v - contacts[coupling.a].v)
        way = 1 if z > piece.end + near else (-1 if z < piece.begin - near else 0)
        coupling.piece += way
        changed |= way != 0
    return changed


@lean
def follow_couplings(contacts, couplings, s):
    """Let what springs add to bounds change with the velocities of contacts, which are advanced to s."""
    if couplings is None:
        return
    for i in range(contacts.shape[0]):
        foot = couplings.feet[i]
        foot.more_forward = foot.more_backward = foot.d_more_forward = foot.d_more_backward = 0.0
    for k in range(couplings.each.shape[0]):
        coupling = couplings.each[k]
        a, b, piece = contacts[coupling.a], contacts[coupling.b], couplings.pieces[coupling.piece]
        foot = couplings.feet[coupling.contact]
        coupling.z, coupling.rate, coupling.next = (b.x - a.x) + (b.residue - a.residue), _rate_of(a.v, b.v), np.inf
        away = coupling.z - piece.at - s * coupling.rate
        foot.more_forward += piece.forward + piece.d_forward * away
        foot.more_backward += piece.backward + piece.d_backward * away
        foot.d_more_forward += piece.d_forward * coupling.rate
        foot.d_more_backward += piece.d_backward * coupling.rate


@inlined
def _rate_of(a, b):
    """Compute the rate of an elongation from the velocities of both ends; 0 if it is their rounding [m]."""
    return b - a if abs(b - a) > NOISE * (abs(a) + abs(b)) else 0.0


@lean
def rest_couplings(couplings, s):
    """Let what springs add to bounds stay as it is at s, where a ramp or a fall ends."""
    if couplings is None:
        return
    for i in range(couplings.feet.shape[0]):
        foot = couplings.feet[i]
        foot.more_forward, foot.more_backward = more_on(foot, FORWARD, s), more_on(foot, BACKWARD, s)
        foot.d_more_forward = foot.d_more_backward = 0.0
    for k in range(couplings.each.shape[0]):
        couplings.each[k].rate, couplings.each[k].next = 0.0, np.inf


@lean
def find_kink(contacts, c, couplings, ramp, i, when):
    """Find when a spring that adds to the bounds of contact i comes to a kink, if that is before another event.

    Args:
        when: place of that event on the ramp.

    Returns:
        The place on the ramp, or `when`; `coming` is then KINK.
    """
    if couplings is None:
        return when
    for k in range(couplings.each.shape[0]):
        coupling = couplings.each[k]
        if coupling.contact != i or coupling.rate == 0.0:
            continue
        piece, rate = couplings.pieces[coupling.piece], coupling.rate
        gap = piece.end - coupling.z if rate > 0.0 else coupling.z - piece.begin
        coupling.next = ramp.s + max(gap, 0.0) / abs(rate)
        if coupling.next < ramp.end and abs(rate) * (ramp.end - coupling.next) <= _near(contacts, coupling):
            coupling.next = ramp.end  # within rounding of the end of the ramp, it is one at its end
        if coupling.next < when:
            when = coupling.next
            c.coming = KINK
    return when


@lean
def keep_limits(couplings, block, count):
    """Keep the limits of a block before the velocities in it add to them."""
    if couplings is None:
        return
    for r in range(count):
        foot = couplings.feet[block[r].contact]
        foot.upper, foot.lower = block[r].upper, block[r].lower


@lean
def restore_limits(couplings, block, count):
    """Restore the limits of a block before the velocities in it added to them."""
    if couplings is None:
        return
    for r in range(count):
        foot = couplings.feet[block[r].contact]
        block[r].upper, block[r].lower = foot.upper, foot.lower


@lean
def add_growth(contacts, couplings, block, count):
    """Add to the limits of a block what springs add to the rates of bounds at the velocities that were found."""
    if couplings is None:
        return
    for r in range(count):
        foot = couplings.feet[block[r].contact]
        foot.grows_forward = foot.grows_backward = 0.0
    for k in range(couplings.each.shape[0]):
        coupling = couplings.each[k]
        piece, foot = couplings.pieces[coupling.piece], couplings.feet[coupling.contact]
        coupling.rate = _rate_of(block[contacts[coupling.a].row].v, block[contacts[coupling.b].row].v)
        foot.grows_forward += piece.d_forward * coupling.rate
        foot.grows_backward += piece.d_backward * coupling.rate
    for r in range(count):
        foot, fallen = couplings.feet[block[r].contact], contacts[block[r].contact].fallen
        block[r].upper = foot.upper + (0.0 if fallen & FORWARD else foot.grows_forward)
        block[r].lower = foot.lower - (0.0 if fallen & BACKWARD else foot.grows_backward)


@lean
def exchange_pieces(couplings, changes):
    """Count the springs at kinks that go on in the other direction than they should; one that rests grows.

    Args:
        changes: whether they change their direction.

    Returns:
        Their number.
    """
    found = 0
    if couplings is None:
        return found
    for k in range(couplings.each.shape[0]):
        coupling = couplings.each[k]
        if coupling.kinked and (coupling.rate < 0.0) != (coupling.piece == coupling.low):
            found += 1
            if changes:
                coupling.piece = 2 * coupling.low + 1 - coupling.piece
    return found


@lean
def choose_pieces(couplings, choice):
    """Choose the directions of all springs at kinks.

    Args:
        choice: number of the combination.

    Returns:
        How many combinations there are.
    """
    count = 0
    if couplings is None:
        return 1
    for k in range(couplings.each.shape[0]):
        coupling = couplings.each[k]
        if coupling.kinked and count < _MOST_KINKED:
            coupling.piece = coupling.low + ((choice >> count) & 1)
            count += 1
    return 1 << count


@lean
def is_dominant(couplings, block, count):
    """Determine whether the matrix of a block is an M-matrix whatever the sides are: it then has one solution.

    That is so if springs are `gentle`, and the ground does not hold less and less: no entry beside the diagonal is
    positive, and no row has a negative sum.

    Returns:
        Whether it is.
    """
    if couplings is None:
        return True
    for r in range(count):
        if (block[r].upper < np.inf and block[r].ahead < 0.0) or (block[r].lower > -np.inf and block[r].behind < 0.0):
            return False
    return couplings.gentle[0]
