"""How close a part of the body is to a critical state, in which all its contacts are at their bounds."""

from __future__ import annotations

import numpy as np

from ....compiled import inlined, lean
from ....rounding import CRITICAL, EPS
from ..block import size_of_terms
from ..ground.couplings import couplings_of, is_coupled
from ..ground.gradual import commands_at, slopes_of
from ..ground.walls import blocked_sides
from ..pivot import ROUNDING
from ..records import BACKWARD, FORWARD
from ..springs.parts import begin_alone, begin_parts, find_pull, list_beside, member, next_part, present_part

_LATER = 2.0 / 3.0
"""Part of the rest of a ramp after which a critical part must still be critical."""


@inlined
def _slack(c, ground, ramp, i, when):
    """Find how far the force on a contact is from its bounds at a later place; in a fall, what takes no part rests.

    The force on a contact that is at a bound is that bound where it was last advanced to, whatever rounding made of it.
    """
    s = ramp.fall.rests if ramp.fall.falling and c.since >= 0.0 else when
    ds = s - c.since
    force = c.force + c.force_rate * ds
    above, below = c.forward + s * c.d_forward - force, c.backward + s * c.d_backward + force
    if c.bounds_met & FORWARD:
        above = ds * (c.d_forward - c.force_rate)
    if c.bounds_met & BACKWARD:
        below = ds * (c.d_backward + c.force_rate)
    blocked = blocked_sides(ground, i)
    if blocked & FORWARD:
        above = np.inf
    if blocked & BACKWARD:
        below = np.inf
    return above, below


@inlined
def _distance(contacts, springs, model, ramp, i, when, limit):
    """Find how far the force on a contact is from its nearest bound, less its rounding if it is more than a limit."""
    c = contacts[i]
    if c.bounds_met != 0 and c.side != 0:
        return 0.0
    above, below = _slack(c, model.ground, ramp, i, when)
    distance = abs(min(above, below))
    if c.bounds_met == 0 and distance > limit:
        distance = max(distance - ROUNDING * size_of_terms(contacts, springs, model.ends, c), 0.0)
    return distance


@lean
def is_near(contacts, springs, model, curves, ramp, when, limit):
    """Determine whether all contacts of the present part are at their bounds at a later place, within a limit.

    The limit is in addition to the rounding of forces. The forces of a spring on its two contacts are opposite. So
    bounds at which all contacts slide sum to the force of flat springs, which is known however stiff the others are.
    The search begins with the contact that ended the one before: mostly, that one is still far from its bounds.

    Args:
        when: the place on the ramp.
        limit: sum of the distances from the bounds up to which they count as zero [N].

    Returns:
        Whether all are.
    """
    first, last = present_part(contacts, curves, ramp)
    near = 0.0
    for j in range(last - first):
        r = ramp.witness + j
        r = r if r < last else r - (last - first)
        near += _distance(contacts, springs, model, ramp, member(curves, r), when, limit)
        if near > limit:
            ramp.witness = r
            return False
    return abs(_imbalance(contacts, springs, model, curves, ramp, when)) <= limit


@inlined
def _imbalance(contacts, springs, model, curves, ramp, when):
    """Sum the bounds that the contacts of the present part are at, or nearest to, less the force of flat springs."""
    balance = 0.0
    first, last = present_part(contacts, curves, ramp)
    for r in range(first, last):
        i = member(curves, r)
        c = contacts[i]
        s = ramp.fall.rests if ramp.fall.falling and c.since >= 0.0 else when
        side = c.side if c.bounds_met != 0 else 0
        if side == 0:
            above, below = _slack(c, model.ground, ramp, i, when)
            side = 1 if above < below else -1
        balance += c.forward + s * c.d_forward if side > 0 else -(c.backward + s * c.d_backward)
        balance -= find_pull(contacts, springs, model, curves, i)
    return balance


@lean
def is_held_by_ground(contacts, ground, curves, ramp, when):
    """Determine whether a contact of the present part, all of which are at their bounds, stands on a gradient.

    The ground then determines the translation. A contact may be at its bound but for rounding.

    Args:
        when: the place on the ramp.

    Returns:
        Whether one does.
    """
    if ground is None:
        return False
    return _is_held_by_ground(contacts, ground, ground.profile, curves, ramp, when)


@lean
def _is_held_by_ground(contacts, ground, profile, curves, ramp, when):
    if profile is None:
        return False
    first, last = present_part(contacts, curves, ramp)
    for r in range(first, last):
        i = member(curves, r)
        c, foot = contacts[i], ground.feet[i]
        bounds = c.bounds_met
        if bounds == 0:
            above, below = _slack(c, ground, ramp, i, when)
            bounds = FORWARD if above < below else BACKWARD
        ahead, behind = slopes_of(foot, profile, (foot.place + 1) // 2, foot.place // 2, commands_at(ramp))
        if (bounds & FORWARD and ahead != 0.0) or (bounds & BACKWARD and behind != 0.0):
            return True
    return False


@inlined
def _margin_of_part(contacts, springs, model, curves, ramp, when):
    """Compute how close the contacts of the present part are to sliding at once, as `find_margin` does for all.

    The imbalance of the bounds is the sum of the distances from them, with signs. Where it is the same as the sum
    without, it is more exact: of a single distance, and of distances near their rounding.
    """
    near = total = 0.0
    free = 0
    first, last = present_part(contacts, curves, ramp)
    for r in range(first, last):
        i = member(curves, r)
        c = contacts[i]
        s = ramp.fall.rests if ramp.fall.falling and c.since >= 0.0 else when
        total += (c.forward + s * c.d_forward) + (c.backward + s * c.d_backward)
        if c.bounds_met == 0 or (c.side == 0 and c.since < s):
            above, below = _slack(c, model.ground, ramp, i, when)
            near += max(min(above, below), 0.0)
            free += 1
    if not total > 0.0:
        return 0.0
    if free < 2:
        near = 0.0
    if near <= CRITICAL * total:
        near = max(near, abs(_imbalance(contacts, springs, model, curves, ramp, when)))
    return min(near / total, 1.0)  # contacts between two walls cannot slide


@lean
def find_margin(contacts, springs, model, curves, ramp, when):
    """Compute how close all contacts of a part are to sliding at once, not less than its bounds are from a balance.

    Args:
        when: place on the ramp, at or behind that where contacts were last advanced to.

    Returns:
        The margin of the part that is closest, relative to the friction of the part [1]; 0 without friction.
    """
    begin_parts(contacts, springs, model, curves, ramp)
    margin = np.inf
    while next_part(curves, ramp, contacts.shape[0]):
        margin = min(margin, _margin_of_part(contacts, springs, model, curves, ramp, when))
    return margin


@inlined
def sample_margin(contacts, springs, model, curves, ramp):
    """Update the visited margin of a small body by the present part at s, unless it jumps."""
    if contacts.shape[0] <= ramp.few and not ramp.fall.falling:
        ramp.account.visited = min(
            ramp.account.visited, _margin_of_part(contacts, springs, model, curves, ramp, ramp.s)
        )


@inlined
def _find_limit(ramp, part):
    """Find a later place on the ramp, and the distance from bounds that counts as zero there."""
    s = ramp.s + part * (ramp.end - ramp.s)
    friction = ramp.friction + (ramp.fall.rests if ramp.fall.falling else s) * ramp.d_friction
    return s, CRITICAL * max(friction, 0.0) + 8.0 * EPS * (2.0 * ramp.friction + ramp.d_friction)


@lean
def find_near_part(contacts, springs, model, curves, ramp, i):
    """List the part of a contact, as `find_part`, as long as none of its contacts is away from its bounds.

    Returns:
        Whether the whole part is listed, so that it may be critical; it is then the present one.
    """
    begin_alone(curves, ramp, i)
    when, limit = _find_limit(ramp, _LATER)
    read = 0
    while read < ramp.last:
        near = curves.members[read]
        if _distance(contacts, springs, model, ramp, near, when, limit) > limit:
            return False
        read += 1
        list_beside(contacts, springs, model, curves, ramp, near)
    return True


@inlined
def is_critical(contacts, springs, model, curves, ramp):
    """Determine whether all contacts of the present part stay at their bounds up to the ramp's end.

    A distance from the nearest bound is concave in s and never negative: if it vanishes at two later instants, it
    vanishes from here on. The ends of the ramp are not used, as friction may vanish there.

    Returns:
        Whether they do.
    """
    whole = 2.0 * ramp.friction + ramp.d_friction
    if whole == 0.0 and not is_coupled(couplings_of(model.ground)):
        return True
    for part in (_LATER, 0.5 * _LATER):  # contacts that leave their bounds are then away from them
        s, limit = _find_limit(ramp, part)
        if not is_near(contacts, springs, model, curves, ramp, s, limit):
            return False
    return is_near(contacts, springs, model, curves, ramp, ramp.s, CRITICAL * whole)
