"""Critical states: all contacts at their bounds for a stretch, and the translation that is chosen from its interval."""

from __future__ import annotations

import numpy as np

from ...compiled import lean
from ...rounding import CRITICAL, EPS, NOISE, SHORTEST_STRETCH
from ..translation import FEW_CONTACTS
from .advance import advance
from .falls import draw_all


@lean
def _distance(contacts, ramp, when, limit):
    """Sum the distances of all forces from their nearest bounds, up to the first contact beyond a limit.

    They are those at the place `when`; in a fall, what does not take part in it rests.
    """
    near = 0.0
    for i in range(contacts.shape[0]):
        c = contacts[i]
        s = ramp.rests if ramp.falling and c.since >= 0.0 else when
        if c.at == 0 or c.side == 0:
            force = c.force + c.force_rate * (s - c.since)
            above = c.forward + s * c.d_forward - force
            near += abs(min(above, c.backward + s * c.d_backward + force))
            if near > limit:
                break
    return near


@lean
def sample_margin(contacts, ramp):
    """Update the visited margin of a small body by the forces and bounds at s, unless it jumps.

    Args:
        contacts: CONTACT, shape (N,).
        ramp: the RAMP, whose margin is updated.
    """
    if contacts.shape[0] > FEW_CONTACTS or ramp.falling:
        return
    total, s = 0.0, ramp.s
    for i in range(contacts.shape[0]):
        c = contacts[i]
        total += (c.forward + s * c.d_forward) + (c.backward + s * c.d_backward)
    near = _distance(contacts, ramp, s, np.inf)
    ramp.visited = min(ramp.visited, near / total if total > 0.0 else 0.0)


@lean
def _is_critical(contacts, ramp):
    """Update the visited margin at s, and determine whether all contacts stay at their bounds up to the ramp's end.

    A distance from the nearest bound is concave in s and never negative: if it vanishes at two later instants, it
    vanishes from here on. The ends of the ramp are not used, as friction may vanish there.
    """
    sample_margin(contacts, ramp)
    whole = 2.0 * ramp.friction + ramp.d_friction
    if whole == 0.0:
        return True
    if _distance(contacts, ramp, ramp.s, CRITICAL * whole) > CRITICAL * whole:
        return False
    for part in (1.0 / 3.0, 2.0 / 3.0):
        s = ramp.s + part * (ramp.end - ramp.s)
        friction = ramp.friction + (ramp.rests if ramp.falling else s) * ramp.d_friction
        limit = CRITICAL * max(friction, 0.0) + 8.0 * EPS * whole
        if _distance(contacts, ramp, s, limit) > limit:
            return False
    return True


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
    if not _is_critical(contacts, ramp) and not ramp.undetermined:
        return
    until = ramp.end
    draw_all(contacts, model, model.ground, ramp)
    for i in range(contacts.shape[0]):
        advance(contacts[i], ramp, ramp.s)
        until = min(until, contacts[i].next)
    shift(contacts, springs, ramp, ramp.s, until)
    ramp.shifted = 1


@lean
def choose_step(contacts, springs, ramp):
    """Choose the translation of an implicit step, if all forces at its end are at their bounds.

    Args:
        contacts: CONTACT, shape (N,), with the rates of their forces.
        springs: SPRING, shape (S,).
        ramp: the RAMP.
    """
    end = ramp.friction + ramp.d_friction
    near = _distance(contacts, ramp, 1.0, CRITICAL * end)
    if near <= CRITICAL * end or ramp.undetermined:
        shift(contacts, springs, ramp, 0.0, 1.0)
