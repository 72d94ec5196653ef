"""Bent springs that pass knots, on the way along a ramp and in implicit steps."""

from __future__ import annotations

import numpy as np

from ....compiled import inlined, lean
from ....rounding import EPS
from ..advance import advance, advance_spring
from ..block import leave_bounds, list_contact
from ..ground.falls import draw, draw_spring
from ..timing import schedule_next
from .bends import change_piece, find_lengths, find_pieces, find_way, find_yielding, tension_on
from .parts import find_part, side_of
from .sliders import TURN, change_sliders, force_of_sliders, keep_sliders, return_sliders, turn_slider


@inlined
def _pass_knot(contacts, spring, ground, curves, ramp):
    """Let a spring that is at a knot go on on its next piece."""
    bend = curves.bends[spring.bend]
    draw_spring(spring, curves, ground, ramp)
    advance_spring(spring, curves, ramp, ramp.s)
    z, length, stretch, _ = find_lengths(contacts, spring, bend, ramp)
    if bend.coming >= TURN:
        turn_slider(curves.sliders, bend, ramp, z, bend.coming - TURN)
    change_piece(contacts, spring, bend, curves, ramp, bend.coming)
    bend.next, bend.begun = np.inf, ramp.s
    if bend.yields:
        bend.yielded = ramp.s
        if spring.stiffness > 0.0:  # it rests at a knot of its other curve, too
            way = find_yielding(bend, curves.pieces, ramp, z, length, 0.0, 0.0)
            change_piece(contacts, spring, bend, curves, ramp, way)
    spring.rate = spring.stiffness * (stretch - (0.0 if ramp.fall.falling else spring.d_length))


@inlined
def pass_knots(contacts, springs, model, curves, ramp, i, count):
    """Let the springs that begin at a contact pass the knots that they are at; the contacts of both ends are listed.

    Args:
        count: how many contacts are listed.

    Returns:
        How many are listed now.
    """
    if curves is None:
        return count
    for k in range(contacts[i].first, contacts[i].last):
        spring = springs[model.ends[k].spring]
        if model.ends[k].sign > 0.0 and spring.bend >= 0 and curves.bends[spring.bend].next <= ramp.s:
            ramp.passed += 1
            _pass_knot(contacts, spring, model.ground, curves, ramp)
            leave_bounds(contacts[spring.b], ramp)
            count = list_contact(contacts, model.listed, spring.b, count)
            if passes_singly(curves, ramp):
                break
    return count


@inlined
def passes_singly(curves, ramp):
    """Determine whether knots at one place on the ramp are passed one after another: together they have led to no end.

    Returns:
        Whether they are.
    """
    if curves is None:
        return False
    return ramp.passed > ramp.together


@inlined
def time_knots(contacts, springs, model, curves, ramp, count):
    """Find anew when springs between a solved block and other contacts, at which they begin, come to knots."""
    if curves is None:
        return
    for j in range(count):
        c = contacts[model.block[j].contact]
        for k in range(c.first, c.last):
            end = model.ends[k]
            o = contacts[end.other]
            if end.sign < 0.0 and o.mark != c.mark and springs[end.spring].bend >= 0:
                time_contact(contacts, springs, model, ramp, end.other)


@lean
def time_contact(contacts, springs, model, ramp, i):
    """Advance a contact to s, and find its next event anew."""
    if ramp.fall.falling:
        draw(contacts, model.ground, ramp, i)
    leave_bounds(contacts[i], ramp)
    advance(contacts[i], ramp, ramp.s)
    schedule_next(contacts, springs, model, ramp, i)


@lean
def _change_step(contacts, spring, bend, curves, ramp, coming):
    """Let a spring go on behind a knot, and its tension at the start of an implicit step be that on the lines there."""
    change_piece(contacts, spring, bend, curves, ramp, coming)
    actuator, passive = curves.pieces[bend.actuator], curves.pieces[bend.passive]
    z, u = spring.elongation, spring.elongation - spring.length
    change = (tension_on(actuator, u) + (tension_on(passive, z) + force_of_sliders(curves.sliders, bend, z))) - (
        spring.tension
    )
    bend.excess += change
    spring.tension += change
    spring.rate = 0.0
    contacts[spring.a].force += change
    contacts[spring.b].force -= change


@inlined
def _is_on(piece, length, near):
    """Determine whether a length is on a piece, within rounding."""
    return piece.begin - near <= length <= piece.end + near


@lean
def change_pieces(contacts, springs, curves, ramp, one_only):
    """Find the pieces on which bent springs are at the end of an implicit step that has been solved.

    Args:
        one_only: whether only the last spring changes that has to, by Murty's rule.

    Returns:
        Whether some have changed, so that the step has to be solved anew.
    """
    changed = False
    for j in range(springs.shape[0] - 1, -1, -1):
        spring = springs[j]
        if spring.bend < 0 or (changed and one_only):
            continue
        bend = curves.bends[spring.bend]
        z = spring.elongation + (contacts[spring.b].v - contacts[spring.a].v)
        u = z - (spring.length + ramp.fraction * bend.command)
        actuator, passive = bend.actuator, bend.passive
        near = 64.0 * EPS * (abs(contacts[spring.a].x) + abs(contacts[spring.b].x) + abs(z) + abs(u))
        turned = change_sliders(curves.sliders, bend, z, near)
        if not (_is_on(curves.pieces[actuator], u, near) and _is_on(curves.pieces[passive], z, near)):
            find_pieces(bend, curves.pieces, u, z, 0.0)
            if one_only:
                bend.actuator = actuator + min(max(bend.actuator - actuator, -1), 1)
                bend.passive = passive + min(max(bend.passive - passive, -1), 1)
        if turned or bend.actuator != actuator or bend.passive != passive:
            changed = True
            _change_step(contacts, spring, bend, curves, ramp, 0)
    return changed


@lean
def tighten(contacts, springs, model, curves, ramp):
    """Let the flat spring of a part that has no solution in an implicit step go on to its next piece.

    The part slides as far as it needs to, so the spring that is the first to come to a knot is not flat at the end.

    Args:
        ramp: the RAMP; `loose` is a contact of the part.

    Returns:
        Whether there is such a spring.
    """
    if ramp.search.loose == 0:
        return False
    find_part(contacts, springs, model, curves, ramp, abs(ramp.search.loose) - 1)
    nearest, found, coming = np.inf, -1, 0
    for j in range(springs.shape[0]):
        spring = springs[j]
        side = side_of(spring, curves, ramp.present)
        if side == 0:
            continue
        bend = curves.bends[spring.bend]
        z, u = spring.elongation, spring.elongation - (spring.length + ramp.fraction * bend.command)
        way, knot = find_way(bend, curves.pieces, z, u, side if ramp.search.loose > 0 else -side)
        if way < nearest:
            nearest, found, coming = way, j, knot
    if found < 0:
        return False
    spring = springs[found]
    _change_step(contacts, spring, curves.bends[spring.bend], curves, ramp, coming)
    return True


@lean
def keep_part(contacts, curves, part):
    """Keep the velocities and the pieces of curves of a part of an implicit step that has been solved.

    Args:
        part: of the change of the commands; where it is 0, nothing moves.
    """
    for i in range(contacts.shape[0]):
        contacts[i].kept = contacts[i].v if part > 0.0 else 0.0
    if curves is None:
        return
    keep_sliders(curves.sliders)
    for b in range(curves.bends.shape[0]):
        bend = curves.bends[b]
        bend.kept_actuator, bend.kept_passive = bend.actuator, bend.passive


@lean
def return_to_part(contacts, springs, model, curves, ramp):
    """Return to the velocities and pieces of `keep_part`."""
    for i in range(contacts.shape[0]):
        contacts[i].v = contacts[i].kept
    if curves is None:
        return
    for j in range(springs.shape[0]):
        spring = springs[j]
        if spring.bend < 0:
            continue
        bend = curves.bends[spring.bend]
        turned = return_sliders(curves.sliders, bend)
        if turned or bend.actuator != bend.kept_actuator or bend.passive != bend.kept_passive:
            bend.actuator, bend.passive = bend.kept_actuator, bend.kept_passive
            _change_step(contacts, spring, bend, curves, ramp, 0)


@lean
def end_step(contacts, springs, curves):
    """Restore the tensions and forces at the start of an implicit step, with rates to their values at its end."""
    if curves is None:
        return
    for j in range(springs.shape[0]):
        spring = springs[j]
        if spring.bend >= 0:
            excess = curves.bends[spring.bend].excess
            spring.tension -= excess
            spring.rate += excess
            contacts[spring.a].force -= excess
            contacts[spring.b].force += excess
            curves.bends[spring.bend].excess = 0.0
