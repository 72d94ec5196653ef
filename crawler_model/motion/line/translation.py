"""Critical states: all contacts at their bounds for a stretch, and the translation that is chosen from its interval."""

from __future__ import annotations

import numpy as np

from ...compiled import lean
from ...rounding import CRITICAL, EPS, NOISE, SHORTEST_STRETCH
from ..margin import FEW_CONTACTS
from .advance import advance
from .ground.falls import draw_all
from .pivot import ROUNDING
from .records import BACKWARD, FORWARD
from .runs import wake_all


@lean
def _blur(contacts, springs, ends, c):
    """Find the rounding of the spring force on a contact, a small difference of large numbers if springs are stiff."""
    size = 0.0
    for k in range(c.first, c.last):
        spring = springs[ends[k].spring]
        lengths = abs(c.x) + abs(contacts[ends[k].other].x) + abs(spring.length) + abs(spring.d_length)
        size += spring.stiffness * lengths + abs(spring.tension)
    return ROUNDING * size


@lean
def _slack(c, ramp, when):
    """Find how far the force on a contact is from its bounds at a later place; in a fall, what takes no part rests.

    The force on a contact that is at a bound is that bound where it was last advanced to, whatever rounding made of it.
    """
    s = ramp.rests if ramp.falling and c.since >= 0.0 else when
    ds = s - c.since
    force = c.force + c.force_rate * ds
    above, below = c.forward + s * c.d_forward - force, c.backward + s * c.d_backward + force
    if c.at & FORWARD:
        above = ds * (c.d_forward - c.force_rate)
    if c.at & BACKWARD:
        below = ds * (c.d_backward + c.force_rate)
    return above, below


@lean
def _is_near(contacts, springs, model, ramp, when, limit):
    """Determine whether all contacts are at their bounds at a later place, within a limit and the rounding of forces.

    The forces of a spring on its two contacts are opposite. So bounds at which all contacts slide sum to zero, which is
    known however stiff the springs are. The search begins with the contact that ended the one before: mostly, that one
    is still far from its bounds.
    """
    n, near = contacts.shape[0], 0.0
    for j in range(n):
        i = ramp.witness + j
        c = contacts[i if i < n else i - n]
        if c.at != 0 and c.side != 0:
            continue
        above, below = _slack(c, ramp, when)
        distance = abs(min(above, below))
        if c.at == 0 and distance > limit:
            distance = max(distance - _blur(contacts, springs, model.ends, c), 0.0)
        near += distance
        if near > limit:
            ramp.witness = i if i < n else i - n
            return False
    return abs(_imbalance(contacts, ramp, when)) <= limit


@lean
def _imbalance(contacts, ramp, when):
    """Sum the bounds that contacts are at, or nearest to, with their signs."""
    balance = 0.0
    for i in range(contacts.shape[0]):
        c = contacts[i]
        s = ramp.rests if ramp.falling and c.since >= 0.0 else when
        side = c.side if c.at != 0 else 0
        if side == 0:
            above, below = _slack(c, ramp, when)
            side = 1 if above < below else -1
        balance += c.forward + s * c.d_forward if side > 0 else -(c.backward + s * c.d_backward)
    return balance


@lean
def find_margin(contacts, ramp, when):
    """Compute how close all contacts are to sliding at once, at least as far as their bounds are from a balance.

    Args:
        contacts: CONTACT, shape (N,).
        ramp: the RAMP.
        when: place on the ramp, at or behind that where contacts were last advanced to.

    Returns:
        The margin [1]; 0 without friction.
    """
    near = total = balance = 0.0
    free = 0
    for i in range(contacts.shape[0]):
        c = contacts[i]
        s = ramp.rests if ramp.falling and c.since >= 0.0 else when
        forward, backward = c.forward + s * c.d_forward, c.backward + s * c.d_backward
        side = c.side if c.at != 0 else 0
        total += forward + backward
        if side == 0:
            above, below = _slack(c, ramp, when)
            side = 1 if above < below else -1
            if c.at == 0 or c.since < s:
                near += max(min(above, below), 0.0)
                free += 1
        balance += forward if side > 0 else -backward
    if free < 2:
        near = 0.0  # a single force away from its bound is the imbalance of all bounds
    return max(near, abs(balance)) / total if total > 0.0 else 0.0


@lean
def sample_margin(contacts, ramp):
    """Update the visited margin of a small body by the forces and bounds at s, unless it jumps.

    Args:
        contacts: CONTACT, shape (N,).
        ramp: the RAMP, whose margin is updated.
    """
    if contacts.shape[0] <= FEW_CONTACTS and not ramp.falling:
        ramp.visited = min(ramp.visited, find_margin(contacts, ramp, ramp.s))


@lean
def _is_critical(contacts, springs, model, ramp):
    """Update the visited margin at s, and determine whether all contacts stay at their bounds up to the ramp's end.

    A distance from the nearest bound is concave in s and never negative: if it vanishes at two later instants, it
    vanishes from here on. The ends of the ramp are not used, as friction may vanish there.
    """
    sample_margin(contacts, ramp)
    whole = 2.0 * ramp.friction + ramp.d_friction
    if whole == 0.0:
        return True
    for part in (2.0 / 3.0, 1.0 / 3.0):  # contacts that leave their bounds are then away from them
        s = ramp.s + part * (ramp.end - ramp.s)
        friction = ramp.friction + (ramp.rests if ramp.falling else s) * ramp.d_friction
        limit = CRITICAL * max(friction, 0.0) + 8.0 * EPS * whole
        if not _is_near(contacts, springs, model, ramp, s, limit):
            return False
    return _is_near(contacts, springs, model, ramp, ramp.s, CRITICAL * whole)


@lean
def _slope(contacts, middle, translation):
    """Compute the slope of the dissipation just above a translation, with the friction at `middle` [N]."""
    slope = 0.0
    for i in range(contacts.shape[0]):
        c = contacts[i]
        if -c.v <= translation:
            slope += c.forward + middle * c.d_forward
        else:
            slope -= c.backward + middle * c.d_backward
    return slope


@lean
def _find_quantile(contacts, middle, level):
    """Find the least translation above which the slope of the dissipation is above a level.

    Candidates are the translations that bring one contact to rest; each trial removes those on one side of it.
    """
    low, high = -np.inf, np.inf
    slope = _slope(contacts, middle, -np.inf)
    if slope > level:
        return -np.inf
    while True:
        inside = 0
        for i in range(contacts.shape[0]):
            inside += low < -contacts[i].v < high
        if inside == 0:
            return high
        rank, trial = inside // 2, 0.0
        for i in range(contacts.shape[0]):
            if low < -contacts[i].v < high:
                trial = -contacts[i].v
                rank -= 1
                if rank < 0:
                    break
        slope = _slope(contacts, middle, trial)
        if slope > level:
            high = trial
        else:
            low = trial


@lean
def _is_held_inside(contacts, springs, middle, translation):
    """Determine whether an element of a segment has friction, and ends that slide in opposite directions."""
    for j in range(springs.shape[0]):
        if not springs[j].element:
            continue
        a, b = contacts[springs[j].a], contacts[springs[j].b]
        held = min(a.forward + middle * a.d_forward, a.backward + middle * a.d_backward) > 0.0
        held = held and min(b.forward + middle * b.d_forward, b.backward + middle * b.d_backward) > 0.0
        if held and (a.v + translation) * (b.v + translation) < 0.0:
            return True
    return False


@lean
def shift(contacts, springs, ramp, s, until):
    """Add to all velocities the admissible translation that is nearest to no net translation, and note its interval.

    Where contacts represent lengths of ground, an interval may be an artefact of the mesh: if at its middle the two
    ends of an element with friction slide in opposite directions, a point at rest between them determines the
    translation. The middle is then chosen, and the translation counts as unique.

    Args:
        contacts: CONTACT, shape (N,), at s; their velocities are changed.
        springs: SPRING, shape (S,).
        ramp: the RAMP, whose account is added to.
        s: where the stretch begins.
        until: where it ends; the friction in its middle counts, as it may vanish at an end.
    """
    net = size = total = 0.0
    middle = 0.5 * (s + until)
    for i in range(contacts.shape[0]):
        c = contacts[i]
        net += c.share * c.v
        size = max(size, abs(c.v))
        total += (c.forward + middle * c.d_forward) + (c.backward + middle * c.d_backward)
    least = _find_quantile(contacts, middle, np.nextafter(-CRITICAL * total, -np.inf))
    most = _find_quantile(contacts, middle, CRITICAL * total)
    chosen = min(max(-net, least), most)
    center = 0.5 * (least + most)
    if least < most and abs(center) < np.inf and _is_held_inside(contacts, springs, middle, center):
        chosen = least = most = center
    most_v = 0.0
    for i in range(contacts.shape[0]):
        c = contacts[i]
        c.v += chosen
        if abs(c.v) <= NOISE * size:
            c.v = 0.0
        most_v = max(most_v, abs(c.v))
    lasts = (until - s) * (1.0 - ramp.done) > SHORTEST_STRETCH and not ramp.falling
    if lasts and most - least > CRITICAL * most_v and most > least:
        ramp.ambiguous = 1.0
        ramp.gain_least += (least - chosen) * (until - s)
        ramp.gain_most += (most - chosen) * (until - s)


@lean
def choose(contacts, springs, model, ramp):
    """Choose the translation at s if it is free: `shifted` is then set, and all blocks are solved at the next event.

    Args:
        contacts: CONTACT, shape (N,), with their next events.
        springs: SPRING, shape (S,).
        model: a `Model`.
        ramp: the RAMP.
    """
    ramp.shifted = 0
    if not _is_critical(contacts, springs, model, ramp) and not ramp.undetermined:
        return
    until = ramp.end
    wake_all(contacts, springs, model.runs, ramp)
    draw_all(contacts, model, model.ground, ramp)
    for i in range(contacts.shape[0]):
        advance(contacts[i], ramp, ramp.s)
        until = min(until, contacts[i].next)
    shift(contacts, springs, ramp, ramp.s, until)
    ramp.shifted = 1


@lean
def choose_step(contacts, springs, model, ramp):
    """Choose the translation of an implicit step, if all forces at its end are at their bounds.

    Args:
        contacts: CONTACT, shape (N,), with the rates of their forces.
        springs: SPRING, shape (S,).
        model: a `Model`.
        ramp: the RAMP.
    """
    end = ramp.friction + ramp.d_friction
    if ramp.undetermined or _is_near(contacts, springs, model, ramp, 1.0, CRITICAL * end):
        shift(contacts, springs, ramp, 0.0, 1.0)
