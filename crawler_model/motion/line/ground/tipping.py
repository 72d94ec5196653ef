"""The beginning of a jump on gradual ground: the contact whose bound falls faster than the force on it."""

from __future__ import annotations

import numpy as np

from ....compiled import lean
from ..pivot import find_sides
from ..records import BACKWARD, FORWARD
from .bounds import set_bounds
from .chords import is_long
from .couplings import is_coupled
from .driving import STIFF
from .falls import let_tip
from .gradual import NEUTRAL, is_given


@lean
def tip(contacts, springs, model, ground, ramp, count):
    """Let a contact of a block without a solution jump.

    A contact can begin to if, at fixed commands, its force does not fall below its bound when it is moved and the
    others follow. Where several can, the one whose force falls fastest as it moves does, because its falling bound then
    leads it longest, and the end of the jump is one of several. So it is where two blocks jump at one instant, and
    where a contact begins within the jump of another, unless both slide one way and springs add nothing to bounds.

    Args:
        ground: the `Terrain`; `due` of the ramp is then the contact.
    """
    if ground is not None:
        _tip(contacts, springs, model, ground, ground.profile, ramp, count)


@lean
def _tip(contacts, springs, model, ground, profile, ramp, count):
    if profile is None:
        return
    if ramp.search.loose != 0 and is_given(model.curves):  # a part behind a flat spring slides instead
        return
    if ramp.stepping or ramp.effort > ramp.budget or is_long(ground, ramp):
        return
    block, first, way, found, least = model.block, -1, 0, 0, np.inf
    ambiguous = ramp.account.ambiguous
    falling, ramp.fall.falling = ramp.fall.falling, 1  # in a fall commands rest
    for row in range(count):
        e = block[row]
        ahead, behind = e.ahead, e.behind
        for side in (FORWARD, BACKWARD):
            slope = ahead if side == FORWARD else behind
            compliance = _push(contacts, springs, model, count, row, side)
            if compliance == 0.0:
                continue
            if find_sides(contacts, springs, model, ramp, count):
                foot = ground.feet[e.contact]
                slope += foot.grows_forward if side == FORWARD else foot.grows_backward  # it moves at a velocity of 1
                sign = 1.0 if side == FORWARD else -1.0
                size = abs(slope) + 1.0 / compliance
                if sign * (e.force - slope * e.v) > -NEUTRAL * size:
                    found += 1
                    if sign * e.force < least - NEUTRAL * size:
                        first, way, least = e.contact, side, sign * e.force
            e.ahead, e.behind = ahead, behind
    waits = ramp.fall.due > 0  # until the jump of another block, which begins at the same instant, is over
    several = found > 1 or (found == 1 and (waits or (falling != 0 and _races(contacts, model, way, count))))
    ramp.account.ambiguous = 1.0 if several else ambiguous
    ramp.fall.falling = falling
    if ramp.chords > 0.0:  # along a chord that was given up, velocities may be large, and with them rounding
        for i in range(contacts.shape[0]):
            if contacts[i].fallen == 0:
                set_bounds(contacts[i], ground.feet[i], ground, ramp)
    if found > 0 and not waits:
        let_tip(contacts[first], ground, ramp, first, way)


@lean
def _races(contacts, model, way, count):
    """Determine whether where a jump ends depends on how fast a contact of it slides in relation to another."""
    if is_coupled(model.ground.couplings):
        return True
    for j in range(count):
        fallen = contacts[model.block[j].contact].fallen
        if fallen != 0 and fallen != way:
            return True
    return False


@lean
def _push(contacts, springs, model, count, row, side):
    """Let commands rest, and move one contact at a velocity of 1, its force free.

    Returns:
        The compliance of its springs [m/N]; 0 if it is not at that bound.
    """
    block = model.block
    for j in range(count):
        e = block[j]
        c = contacts[e.contact]
        e.load = e.v = 0.0
        e.side = 0
        e.upper = 0.0 if c.bounds_met & FORWARD else np.inf
        e.lower = 0.0 if c.bounds_met & BACKWARD else -np.inf
    e = block[row]
    c, stiffness = contacts[e.contact], 0.0
    if c.fallen != 0 or not c.bounds_met & side:
        return 0.0
    for k in range(c.first, c.last):
        stiffness += springs[model.ends[k].spring].stiffness
    e.ahead = e.behind = STIFF * stiffness
    e.upper, e.lower = (-e.ahead, -np.inf) if side == FORWARD else (np.inf, e.ahead)
    e.side = 1 if side == FORWARD else -1
    return 1.0 / stiffness
