"""Slides at fixed commands, of what nothing holds any more: a part of a body between flat springs, or all of it.

It goes to the next knot of these springs or to the next border or wall. All forces rest on the way, so what friction
takes is paid by flat springs and by loads.
"""

from __future__ import annotations

import numpy as np

from ....compiled import lean
from ....rounding import CRITICAL, EPS
from ..advance import move
from ..ground.borders import gap_of, leave_border, open_jump, reach_border
from ..ground.bounds import excess_of
from ..ground.falls import has_fallen
from ..ground.walls import room_of
from ..records import AHEAD, BACKWARD, BEHIND, FORWARD
from .bends import find_way, is_flat
from .parts import begin_parts, find_part, member, side_of

_MOST = 1000
"""Slides in one ramp before it is completed by an implicit step."""
_TINY = 1e-290
"""A way that leads beyond a knot at 0 where all lengths are 0 [m]."""


@lean
def _find_runaway(contacts):
    """Find the direction in which nothing holds the body: all contacts are at bounds of one side, which sum to zero.

    Returns:
        1 or -1; 0 if the body is held.
    """
    size = forward = backward = 0.0
    both = FORWARD | BACKWARD
    for i in range(contacts.shape[0]):
        c = contacts[i]
        size += abs(c.forward) + abs(c.backward)
        forward += c.forward
        backward += c.backward
        both &= c.bounds_met
    if both & FORWARD and abs(forward) <= CRITICAL * size:
        return 1
    return -1 if both & BACKWARD and abs(backward) <= CRITICAL * size else 0


@lean
def _find_loose(contacts, springs, model, curves, ramp):
    """Find what slides, which becomes the present part, and its direction; 0 if the body is held."""
    if curves is not None and ramp.search.loose != 0:
        find_part(contacts, springs, model, curves, ramp, abs(ramp.search.loose) - 1)
        return 1 if ramp.search.loose > 0 else -1
    begin_parts(contacts, springs, model, curves, ramp)
    ramp.first, ramp.last = 0, contacts.shape[0]
    ramp.present = ramp.last  # all parts
    return _find_runaway(contacts)


@lean
def _find_knot(springs, curves, ramp, direction):
    """Find how far the present part can slide until it is just beyond a knot of a flat spring at its ends."""
    distance = np.inf
    if curves is None:
        return distance
    for j in range(springs.shape[0]):
        spring = springs[j]
        side = side_of(spring, curves, ramp.present)
        if side != 0:
            bend = curves.bends[spring.bend]
            z, u = spring.elongation, spring.elongation - spring.length
            way, _ = find_way(bend, curves.pieces, z, u, side * direction)
            if curves.pieces[bend.actuator].slope + curves.pieces[bend.passive].slope > 0.0:
                way = 0.0  # rounding has led it beyond the knot
            way = max(way, 0.0)
            distance = min(distance, way + 4.0 * EPS * (abs(z) + ramp.span + way) + _TINY)
    return distance


@lean
def _slide_on_ground(contacts, model, ground, ramp, direction, knot):
    """Slide a part to its next border or wall, or by `knot` if that is nearer; returns False if there is none.

    It rests if one of its contacts has come to a border just as nothing else held the part, and is held by the ground.
    """
    coming, side = (AHEAD, FORWARD) if direction > 0 else (BEHIND, BACKWARD)
    for r in range(ramp.first, ramp.last):
        if not contacts[member(model.curves, r)].bounds_met & side:
            return True
    distance, nearest = knot, -1
    for r in range(ramp.first, ramp.last):
        i = member(model.curves, r)
        contacts[i].v = float(direction)
        contacts[i].coming = coming
        leave_border(contacts[i], ground, ramp, i)
        gap = _way_of(contacts[i], ground.feet[i], ground, coming, side, i)
        if gap < distance:
            distance, nearest = gap, i
    if distance == np.inf:
        ramp.fall.runaway = direction
        return False
    distance = max(distance, 0.0)
    near = 1e-14 * (ramp.span + distance)
    if distance > 0.0 and knot == np.inf and not has_fallen(contacts, ground):
        c, foot = contacts[nearest], ground.feet[nearest]
        open_jump(c, ground, ramp, nearest, foot.home + c.x + direction * distance)
    for r in range(ramp.first, ramp.last):
        i = member(model.curves, r)
        c = contacts[i]
        gap = _way_of(c, ground.feet[i], ground, coming, side, i)
        c.lost += excess_of(c, ground.feet[i], ground) * distance
        _move(c, ramp, direction, distance)
        c.bounds_met |= side
        if gap <= distance + near:
            reach_border(c, ground, ramp, i)
    return True


@lean
def _way_of(c, foot, ground, coming, side, i):
    """Compute the distance of a contact from its next border or wall."""
    way = gap_of(c, foot, ground, coming, c.since)
    return min(way, room_of(c, foot, ground.walls, side, i, c.since))


@lean
def _move(c, ramp, direction, distance):
    """Move a contact, and account for its friction and its load."""
    ramp.account.dissipation += (c.forward if direction > 0 else c.backward) * distance
    ramp.account.loads_work += c.load * direction * distance
    move(c, direction * distance)


@lean
def _keep_flat(contacts, springs, curves, ramp, direction):
    """Note the elongations of flat springs, whose tensions rest, and which of them the slide has led over a knot."""
    if curves is None:
        return
    for j in range(springs.shape[0]):
        spring = springs[j]
        if is_flat(spring, curves):
            a, b = contacts[spring.a], contacts[spring.b]
            spring.elongation = (b.x - a.x) + (b.residue - a.residue)
            spring.still_tension, spring.still_length = spring.tension, spring.length
            side = side_of(spring, curves, ramp.present)
            if side != 0:
                bend, z, u = curves.bends[spring.bend], spring.elongation, spring.elongation - spring.length
                way, _ = find_way(bend, curves.pieces, z, u, side * direction)
                bend.slid = 1 if way < 0.0 else 0


@lean
def slide(contacts, springs, model, ground, curves, ramp):
    """Slide contacts that nothing holds any more to the next knot or border.

    Args:
        ramp: the RAMP; `loose` may be one of the contacts. `runaway` is set if no knot and no border is on the way.

    Returns:
        Whether they have moved.
    """
    if curves is not None:
        ramp.slides += 1
        if ramp.slides >= _MOST:
            return False
    elif ground is None:
        return False
    direction = _find_loose(contacts, springs, model, curves, ramp)
    if direction == 0:
        return False
    knot = _find_knot(springs, curves, ramp, direction)
    if ground is not None:
        if not _slide_on_ground(contacts, model, ground, ramp, direction, knot):
            return False
    elif knot == np.inf:
        ramp.fall.runaway = direction
        return False
    else:
        for r in range(ramp.first, ramp.last):
            _move(contacts[member(curves, r)], ramp, direction, knot)
    _keep_flat(contacts, springs, curves, ramp, direction)
    return True
