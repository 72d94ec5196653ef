"""Bent springs: curves of tension with knots, where the stiffness changes.

A bent spring has an actuator, whose tension is a function of u = z - L, and in parallel a passive spring, a function of
z. Between knots it is linear with the stiffness in force, and all else knows it as such: `spring.stiffness` is the sum
of both slopes, `spring.d_length` the change of a rest length that changes the tension as the command does. Where both
are flat, the tension is constant: the spring is a load on both contacts, which ends blocks and joins nothing.

At a knot the slope depends on the direction in which the spring goes on, and that on the rates of its block. A spring
whose rate leads out of its present piece passes the knot at once, and the block is solved anew. The direction is the
same with either slope, as tensions do not decrease, so this ends.
"""

from __future__ import annotations

import numpy as np

from ....compiled import inlined, lean
from ....rounding import EPS, NOISE
from ..advance import advance_spring
from .sliders import TURN, energy_of_sliders, find_turn, force_of_sliders, line_of_sliders, settle_sliders


@inlined
def tension_on(piece, length):
    """Compute the tension at a length on the line of a piece, which may reach beyond the piece.

    Args:
        piece: a PIECE.
        length: the length [m].

    Returns:
        The tension [N].
    """
    return piece.value + piece.slope * (length - piece.at)


@inlined
def _energy_on(piece, length):
    """Compute the energy at a length on a piece."""
    way = length - piece.at
    return piece.energy + (piece.value + 0.5 * piece.slope * way) * way


@inlined
def _find_piece(pieces, p, length, direction):
    """Find the piece at a length from another one of its curve; at a knot, the piece that the direction leads to."""
    while length < pieces[p].begin or (length == pieces[p].begin and direction < 0.0):
        p -= 1
    while length > pieces[p].end or (length == pieces[p].end and direction > 0.0):
        p += 1
    return p


@inlined
def near_of(z, length, ramp):
    """Find how far from a knot a bent spring may be at it, but for the rounding of displacements.

    Args:
        z: elongation [m].
        length: commanded length [m].

    Returns:
        The distance [m].
    """
    return 64.0 * EPS * (abs(z) + abs(length) + ramp.span)


@inlined
def _find_softer(pieces, p, length, near):
    """Find the softer one of two pieces that meet near a length, whichever of them p is; p itself elsewhere."""
    if length - pieces[p].begin <= near and pieces[p - 1].slope < pieces[p].slope:
        return p - 1
    if pieces[p].end - length <= near and pieces[p + 1].slope < pieces[p].slope:
        return p + 1
    return p


@inlined
def find_pieces(bend, pieces, u, z, direction):
    """Find the present pieces of both curves of a bent spring.

    Args:
        bend: a BEND; its pieces are written.
        direction: in which u goes on from a knot, opposite to z's; 0 if either piece will do.
    """
    bend.actuator = _find_piece(pieces, bend.actuator, u, direction)
    bend.passive = _find_piece(pieces, bend.passive, z, -direction)


@inlined
def _set_stiffness(spring, bend, pieces, sliders):
    """Make a spring linear, as it is on its present pieces."""
    actuator, passive = pieces[bend.actuator], pieces[bend.passive]
    elastic, yielding = line_of_sliders(sliders, bend)
    slope = actuator.slope
    stiffness = slope + (passive.slope + elastic)
    spring.stiffness, spring.compliance, spring.d_length, bend.share = stiffness, 0.0, 0.0, 0.0
    if stiffness > 0.0:
        spring.compliance = 1.0 / stiffness
        bend.share = slope / stiffness
        spring.d_length = bend.share * bend.command
    other = (passive.value - passive.slope * passive.at) + yielding
    bend.back = -slope * (1.0 - bend.share)
    bend.offset = (actuator.value - slope * actuator.at) * (1.0 - bend.share) - bend.share * other
    if slope == 0.0:
        bend.back, bend.offset = 0.0, actuator.value


@inlined
def find_way(bend, pieces, z, u, direction):
    """Find how far a spring can grow or shrink until it is at a knot.

    Args:
        direction: > 0 if it grows, < 0 if it shrinks.

    Returns:
        The way, < 0 if it is beyond the knot [m]; the knot, as `coming` of a BEND.
    """
    actuator, passive = pieces[bend.actuator], pieces[bend.passive]
    if direction > 0.0:
        way, other = actuator.end - u, passive.end - z
        return (way, 1) if way <= other else (other, 2)
    way, other = u - actuator.begin, z - passive.begin
    return (way, -1) if way <= other else (other, -2)


@inlined
def change_piece(contacts, spring, bend, curves, ramp, coming):
    """Let a spring go on on the piece behind a knot, with what its command pulls on its contacts there.

    Args:
        curves: the `Curves`.
        ramp: the RAMP; the parts of the body are unknown afterwards if the spring was or is flat.
        coming: the knot, as `coming` of a BEND; 0 or a turn if the pieces and sliders are set already.
    """
    flat, pull = spring.stiffness == 0.0, spring.stiffness * spring.d_length
    if abs(coming) == 1:
        bend.actuator += coming
    elif coming < TURN:
        bend.passive += coming // 2
    _set_stiffness(spring, bend, curves.pieces, curves.sliders)
    change = pull - spring.stiffness * spring.d_length
    contacts[spring.a].pull += change
    contacts[spring.b].pull -= change
    if flat or spring.stiffness == 0.0:
        ramp.parted = 0


@inlined
def begin_bend(spring, curves, ramp):
    """Begin the ramp of a spring: its stiffness, and how its tension changes with the command.

    Args:
        spring: a SPRING; `d_length` is the change of its command.
    """
    if curves is None or spring.bend < 0:
        return
    bend = curves.bends[spring.bend]
    bend.command, bend.excess, bend.next = spring.d_length, 0.0, np.inf
    bend.begun = 0.0
    bend.yielded = 0.0 if bend.slid else np.inf
    bend.slipped = 0
    u, z = spring.elongation - spring.length, spring.elongation
    find_pieces(bend, curves.pieces, u, z, -bend.command)
    if bend.command == 0.0 and not bend.slid:
        near = near_of(z, spring.length, ramp)
        bend.actuator = _find_softer(curves.pieces, bend.actuator, u, near)
        bend.passive = _find_softer(curves.pieces, bend.passive, z, near)
    bend.slid = 0
    _set_stiffness(spring, bend, curves.pieces, curves.sliders)


@inlined
def energy_of(spring, curves):
    """Compute the energy of a spring at the end of a ramp.

    Returns:
        The energy [J].
    """
    if curves is None or spring.bend < 0:
        return 0.5 * spring.tension * spring.tension * spring.compliance
    bend = curves.bends[spring.bend]
    u = spring.elongation - spring.length
    find_pieces(bend, curves.pieces, u, spring.elongation, 0.0)
    energy = _energy_on(curves.pieces[bend.actuator], u) + _energy_on(curves.pieces[bend.passive], spring.elongation)
    return energy + energy_of_sliders(curves.sliders, bend, spring.elongation)


@inlined
def _tension_of(bend, pieces, u, z):
    """Compute the tension of a bent spring without its sliders from its lengths."""
    find_pieces(bend, pieces, u, z, 0.0)
    return tension_on(pieces[bend.actuator], u) + tension_on(pieces[bend.passive], z)


@inlined
def leash_of(contacts, spring, ramp):
    """Compute by how much rounding of displacements may move a tension from the tension of its elongation.

    Returns:
        The difference [N].
    """
    return 32.0 * EPS * spring.stiffness * (abs(contacts[spring.a].x) + abs(contacts[spring.b].x) + ramp.span)


@inlined
def finish_bend(contacts, spring, curves, ramp, length):
    """Advance a spring to the end of what was followed of a ramp, if it is bent.

    Args:
        length: L at the end of the ramp [m].

    Returns:
        Whether the spring is bent.
    """
    if curves is None or spring.bend < 0:
        return False
    bend, pieces = curves.bends[spring.bend], curves.pieces
    a, b = contacts[spring.a], contacts[spring.b]
    z = (b.x - a.x) + (b.residue - a.residue)
    before = spring.elongation - spring.length
    if not ramp.stepping:
        advance_spring(spring, curves, ramp, ramp.s)
    spring.length = length if ramp.s == 1.0 else spring.length + ramp.s * bend.command
    if ramp.stepping:
        _account_step(spring, bend, pieces, ramp, before, z)
    u, leash = z - spring.length, leash_of(contacts, spring, ramp)
    settle_sliders(curves.sliders, bend, ramp, z)
    if z == spring.elongation and not bend.slipped:
        change = _tension_of(bend, pieces, u, z) - _tension_of(bend, pieces, z - spring.still_length, z)
        spring.tension = spring.still_tension + change
    else:
        tension = _tension_of(bend, pieces, u, z) + force_of_sliders(curves.sliders, bend, z)
        spring.tension = min(max(spring.tension, tension - leash), tension + leash)
        if ramp.stepping:
            spring.tension = tension
        spring.elongation = z
        spring.still_tension, spring.still_length = spring.tension, spring.length
    return True


@lean
def _account_step(spring, bend, pieces, ramp, before, z):
    """Account for the work of an actuator in an implicit step, in which u goes straight from `before` to its end."""
    u = z - spring.length
    find_pieces(bend, pieces, before, spring.elongation, 0.0)
    first = bend.actuator
    find_pieces(bend, pieces, u, z, 0.0)
    tension = way = 0.0
    for p in range(min(first, bend.actuator), max(first, bend.actuator) + 1):
        begin, end = max(min(before, u), pieces[p].begin), min(max(before, u), pieces[p].end)
        part = max(end - begin, 0.0)
        tension += tension_on(pieces[p], 0.5 * (begin + end)) * part
        way += part
    tension = tension / way if way > 0.0 else tension_on(pieces[bend.actuator], u)
    ramp.account.work -= tension * bend.command


@inlined
def is_flat(spring, curves):
    """Determine whether the tension of a spring is constant, so that it joins nothing.

    Returns:
        Whether it is.
    """
    if curves is None:
        return False
    return spring.stiffness == 0.0


@inlined
def _gained(c, ramp):
    """Find what a contact has gained since it was last advanced, and its present velocity."""
    if ramp.fall.falling and c.since >= 0.0:
        return c.v * (ramp.fall.rests - c.since), 0.0
    return c.v * (ramp.s - c.since), c.v


@inlined
def find_lengths(contacts, spring, bend, ramp):
    """Find the elongations of a bent spring at s and their rates.

    Returns:
        z [m], L [m], and their rates [m].
    """
    a, b = contacts[spring.a], contacts[spring.b]
    way_a, v_a = _gained(a, ramp)
    way_b, v_b = _gained(b, ramp)
    z = (b.x - a.x) + ((b.residue + way_b) - (a.residue + way_a))
    length = spring.length + (ramp.fall.rests if ramp.fall.falling else ramp.s) * bend.command
    change = 0.0 if ramp.fall.falling else bend.command
    stretch = v_b - v_a
    if abs(stretch) <= NOISE * (abs(v_a) + abs(v_b)):
        stretch = 0.0
    return z, length, stretch, change


@inlined
def _reach(piece, length, rate):
    """Compute how long a length takes to the end of its piece that its rate leads to; infinite if it does not move."""
    if rate == 0.0:
        return np.inf
    return max(((piece.end if rate > 0.0 else piece.begin) - length) / rate, 0.0)


@inlined
def _find_flat(pieces, p, length, rate, near):
    """Find at which end of its piece a curve rests, if it is flat behind it: 1, -1 or 0."""
    if rate != 0.0 or pieces[p].slope == 0.0:
        return 0
    if pieces[p].end - length <= near and pieces[p + 1].slope == 0.0:
        return 1
    return -1 if length - pieces[p].begin <= near and pieces[p - 1].slope == 0.0 else 0


@lean
def find_yielding(bend, pieces, ramp, z, length, rate, stretch):
    """Find whether a spring rests at knots behind which it is flat: what moves may then move with it or without it.

    The flat side knows both, unless a stop or another knot lets nothing move there; the spring then comes back.

    Args:
        z: elongation [m].
        length: L [m].
        rate: of u [m]; 0 if the actuator rests.
        stretch: of z [m], likewise.

    Returns:
        The first knot to pass, as `coming`; 0 if there is none.
    """
    near = near_of(z, length, ramp)
    first = _find_flat(pieces, bend.actuator, z - length, rate, near)
    other = _find_flat(pieces, bend.passive, z, stretch, near)
    if (first == 0 and pieces[bend.actuator].slope > 0.0) or (other == 0 and pieces[bend.passive].slope > 0.0):
        return 0
    return first if first != 0 else 2 * other


@lean
def find_next_knot(contacts, spring, curves, ramp):
    """Find when a bent spring comes to its next knot.

    Returns:
        The place on the ramp; infinite if it comes to none.
    """
    bend = curves.bends[spring.bend]
    z, length, stretch, change = find_lengths(contacts, spring, bend, ramp)
    rate = stretch - change
    if abs(rate) <= NOISE * (abs(stretch) + abs(change)):
        rate = 0.0
    first = _reach(curves.pieces[bend.actuator], z - length, rate)
    other = _reach(curves.pieces[bend.passive], z, stretch)
    bend.coming = 1 if rate > 0.0 else -1
    bend.yields = 0
    if other < first:
        first = other
        bend.coming = 2 if stretch > 0.0 else -2
    first, turning = find_turn(curves.sliders, bend, z, stretch, first)
    if turning >= 0:
        bend.coming = TURN + turning
    when, closing = ramp.s + first, max(abs(rate), abs(stretch))
    if when < ramp.end and closing * (ramp.end - when) <= near_of(z, length, ramp):
        when = ramp.end  # within rounding of the end of the ramp, it is one at its end
    if change == 0.0 and abs(stretch) <= NOISE * abs(contacts[spring.a].v):
        rate = stretch = 0.0
    rests = rate == 0.0 or stretch == 0.0
    if rests and when > ramp.s and spring.stiffness > 0.0 and bend.yielded != ramp.s:
        way = find_yielding(bend, curves.pieces, ramp, z, length, rate, stretch)
        if way != 0:
            when, bend.coming, bend.yields = ramp.s, way, 1
    bend.next = when
    return when
