"""The next event of a contact: a bound, a border or a wall, or a knot of a spring that begins at it."""

from __future__ import annotations

import numpy as np

from ...compiled import inlined
from ...rounding import EPS, LATE
from .ground.borders import find_meeting
from .ground.couplings import couplings_of, find_kink
from .ground.gradual import find_catch
from .ground.walls import blocked_sides, find_wall
from .records import BACKWARD, FORWARD, KNOT
from .springs.bends import find_next_knot
from .tournament import schedule


@inlined
def _find_arrival(c, springs, ends, ground, ramp, i):
    """Find when a contact at s reaches a bound that its force is not at, and which; infinite if it reaches none."""
    s, when, closing = ramp.s, np.inf, 0.0
    above = c.force_rate - c.d_forward
    below = -c.force_rate - c.d_backward
    passed = c.bounds_met | blocked_sides(ground, i)
    if above > 0.0 and not passed & FORWARD:
        when, closing = s + max(c.forward + s * c.d_forward - c.force, 0.0) / above, above
        c.coming = FORWARD
    if below > 0.0 and not passed & BACKWARD:
        other = s + max(c.backward + s * c.d_backward + c.force, 0.0) / below
        if other < when:
            when, closing = other, below
            c.coming = BACKWARD
    if ramp.end - (1.0 - LATE) < when < ramp.end:  # an arrival within rounding of the end of the ramp is one at its end
        size = abs(c.forward) + abs(c.backward) + abs(c.d_forward) + abs(c.d_backward)
        for k in range(c.first, c.last):
            spring = springs[ends[k].spring]
            size += abs(spring.tension) + abs(spring.rate)
        if closing * (ramp.end - when) <= 8.0 * EPS * size:
            return ramp.end
    return when


@inlined
def _find_knots(contacts, c, springs, ends, curves, ramp, when):
    """Find when a spring that begins at contact c comes to a knot, if that is before another event at `when`."""
    if curves is None:
        return when
    for k in range(c.first, c.last):
        spring = springs[ends[k].spring]
        if ends[k].sign > 0.0 and spring.bend >= 0:
            knot = find_next_knot(contacts, spring, curves, ramp)
            if knot < when:
                when = knot
                c.coming = KNOT
    return when


@inlined
def schedule_next(contacts, springs, model, ramp, i):
    """Find the next event of a contact at s whose rates are known, if there is one up to the end of the ramp."""
    c = contacts[i]
    when = find_wall(c, model.ground, i, find_meeting(c, model.ground, i))
    when = find_catch(c, model.ground, ramp, when)
    if c.bounds_met == 0 or c.side == 0 or c.d_forward + c.d_backward < 0.0:
        border = c.coming
        other = _find_arrival(c, springs, model.ends, model.ground, ramp, i)
        if other < when:
            when = other
        else:
            c.coming = border
    when = _find_knots(contacts, c, springs, model.ends, model.curves, ramp, when)
    when = find_kink(contacts, c, couplings_of(model.ground), ramp, i, when)
    schedule(contacts, i, when if when <= 1.0 else np.inf)
