"""Critical states: all contacts of a part of the body at their bounds for a stretch, and the choice of its translation.

Without bent springs the body is one part; flat springs divide it, see `parts`.
"""

from __future__ import annotations

import numpy as np

from ....compiled import inlined, lean
from ....rounding import CRITICAL, NOISE, SHORTEST_STRETCH
from ..advance import advance
from ..block import leave_bounds, list_contact
from ..clusters import wake_all
from ..ground.falls import draw_all
from ..records import BACKWARD, FORWARD, KNOT, SEVERAL
from ..springs.bends import find_lengths, is_flat, near_of
from ..springs.knots import time_contact
from ..springs.parts import begin_parts, find_pull, member, next_part, present_part, side_of
from ..timing import schedule_next
from .interval import follow_all_strays, follow_strays, forget_strays, let_stray
from .margin import find_near_part, is_critical, is_held_by_ground, is_near, sample_margin


@inlined
def _is_free(contacts, curves, ramp):
    """Determine whether all contacts of the present part slide, and nothing was found to determine its translation."""
    if not ramp.search.undetermined:
        return False
    if curves is None:  # the part is the body
        return True
    for r in range(ramp.first, ramp.last):
        c = contacts[member(curves, r)]
        if c.bounds_met == 0 or c.side == 0:
            return False
    return True


@lean
def _slope(contacts, curves, ramp, middle, translation):
    """Compute the slope of the dissipation just above a translation, with the friction at `middle` [N]."""
    slope = 0.0
    first, last = present_part(contacts, curves, ramp)
    for r in range(first, last):
        c = contacts[member(curves, r)]
        if -c.v <= translation:
            slope += c.forward + middle * c.d_forward
        else:
            slope -= c.backward + middle * c.d_backward
    return slope


@lean
def _find_quantile(contacts, curves, ramp, middle, level):
    """Find the least translation above which the slope of the dissipation is above a level.

    Candidates are the translations that bring one contact to rest; each trial removes all on one side of it.
    """
    low, high = -np.inf, np.inf
    first, last = present_part(contacts, curves, ramp)
    slope = _slope(contacts, curves, ramp, middle, -np.inf)
    if slope > level:
        return -np.inf
    while True:
        inside = 0
        for r in range(first, last):
            inside += low < -contacts[member(curves, r)].v < high
        if inside == 0:
            return high
        rank, trial = inside // 2, 0.0
        for r in range(first, last):
            v = contacts[member(curves, r)].v
            if low < -v < high:
                trial = -v
                rank -= 1
                if rank < 0:
                    break
        slope = _slope(contacts, curves, ramp, middle, trial)
        if slope > level:
            high = trial
        else:
            low = trial


@lean
def _is_held_inside(contacts, springs, model, curves, ramp, middle, translation):
    """Determine whether an element of a segment has friction, and ends that slide in opposite directions.

    A point between them that rests has friction on both sides of it, so friction in one direction is enough.
    """
    first, last = present_part(contacts, curves, ramp)
    for r in range(first, last):
        a = contacts[member(curves, r)]
        for k in range(a.first, a.last):
            spring = springs[model.ends[k].spring]
            if model.ends[k].sign < 0.0 or not spring.element or not _is_within(spring, curves, ramp):
                continue
            b = contacts[spring.b]
            held = a.forward + a.backward + middle * (a.d_forward + a.d_backward) > 0.0
            held = held and b.forward + b.backward + middle * (b.d_forward + b.d_backward) > 0.0
            if held and (a.v + translation) * (b.v + translation) < 0.0:
                return True
    return False


@inlined
def _is_within(spring, curves, ramp):
    """Determine whether both ends of a spring are in the present part."""
    if curves is None:
        return True
    return curves.strays[spring.a].part == ramp.present and curves.strays[spring.b].part == ramp.present


@lean
def _limit(contacts, springs, model, curves, ramp, ds):
    """Find the translations of the present part at which the flat springs at its ends stay flat for a while.

    If `ds` is 0, springs that are at knots must not pass them; others do not count.
    """
    least, most = -np.inf, np.inf
    if curves is None:
        return least, most
    for r in range(ramp.first, ramp.last):
        c = contacts[curves.members[r]]
        for k in range(c.first, c.last):
            spring = springs[model.ends[k].spring]
            side = side_of(spring, curves, ramp.present)
            if side == 0:
                continue
            bend = curves.bends[spring.bend]
            z, length, stretch, change = find_lengths(contacts, spring, bend, ramp)
            near = near_of(z, length, ramp)
            below, above = _stay_on(curves.pieces[bend.actuator], z - length, stretch - change, ds, near)
            low, high = _stay_on(curves.pieces[bend.passive], z, stretch, ds, near)
            below, above = max(below, low), min(above, high)
            least, most = max(least, below if side > 0 else -above), min(most, above if side > 0 else -below)
    return least, most


@inlined
def _stay_on(piece, length, rate, ds, near):
    """Find what may be added to the rate of a length that is to stay on a piece for a while, from where to where."""
    if ds > 0.0:
        return (piece.begin - length) / ds - rate, (piece.end - length) / ds - rate
    return -rate if length - piece.begin <= near else -np.inf, -rate if piece.end - length <= near else np.inf


@inlined
def _put_on_bound(c, s):
    """Put a contact of a critical part, whose force is at a bound but for rounding, onto that at which it slides."""
    if c.v > 0.0:
        c.bounds_met, c.side = FORWARD, 1
        c.force, c.force_rate = c.forward + s * c.d_forward, c.d_forward
    else:
        c.bounds_met, c.side = BACKWARD, -1
        c.force, c.force_rate = -(c.backward + s * c.d_backward), -c.d_backward
    c.leaving = 0


@lean
def _shift(contacts, springs, model, curves, ramp, s, until):
    """Add to the velocities of the present part the admissible translation that is nearest to no net translation.

    With all contacts at their bounds the body may move by any t that minimises the dissipation less the pull of what
    it is tied to,

        sum_i f_i max(v_i + t, 0) + b_i max(-v_i - t, 0)  -  p t,

    which is convex and piecewise linear in t: an interval, whose ends bring a contact to rest ([G] Remark 9).

    Its interval is kept for `note_interval`. The friction in the middle of the stretch, which begins at s and ends at
    `until`, counts: it may vanish at an end. Where contacts represent lengths of ground, an interval may be an artefact
    of the mesh: if at its middle the two ends of an element with friction slide in opposite directions, a point at rest
    between them determines the translation. The middle is then chosen, and the translation counts as unique.
    """
    net = size = total = pull = weight = 0.0
    first, last = present_part(contacts, curves, ramp)
    middle = 1.0 if ramp.stepping and curves is not None else 0.5 * (s + until)  # flat springs balance it at the end
    for r in range(first, last):
        i = member(curves, r)
        c = contacts[i]
        net += c.share * c.v
        weight += c.share
        size = max(size, abs(c.v))
        total += (c.forward + middle * c.d_forward) + (c.backward + middle * c.d_backward)
        pull += find_pull(contacts, springs, model, curves, i)
    # the interval: where the slope of the dissipation is the pull, but for rounding
    if curves is not None:
        total = max(total, ramp.friction)  # a part without friction may balance flat springs but for rounding
    below = np.nextafter(pull - CRITICAL * total, -np.inf)
    least = _find_quantile(contacts, curves, ramp, middle, below)
    most = _find_quantile(contacts, curves, ramp, middle, pull + CRITICAL * total)
    # flat springs at the ends of the part must stay flat
    slower, faster = least, most  # what friction admits
    if not ramp.stepping:
        low, high = _limit(contacts, springs, model, curves, ramp, 0.0)
        least, most = min(max(least, low), most), max(min(most, high), least)
    slowest, fastest = least, most  # what is admissible for a while; what is chosen lasts until the stretch ends
    if until > s:
        low, high = _limit(contacts, springs, model, curves, ramp, until - s)
        least, most = min(max(least, low), most), max(min(most, high), least)
    # the choice
    chosen = min(max(-net / weight if curves is not None else -net, least), most)
    center = 0.5 * (least + most)
    several = least < most and abs(center) < np.inf
    if several and _is_held_inside(contacts, springs, model, curves, ramp, middle, center):
        chosen = slowest = fastest = center
    # contacts go on at the bound that opposes them
    most_v = 0.0
    for r in range(first, last):
        c = contacts[member(curves, r)]
        c.v += chosen
        if abs(c.v) <= NOISE * size:
            c.v = 0.0
        elif not ramp.stepping and not c.bounds_met & ~c.leaving & (FORWARD if c.v > 0.0 else BACKWARD):
            _put_on_bound(c, ramp.s)
        most_v = max(most_v, abs(c.v))
    if fastest > slowest and fastest - slowest > CRITICAL * most_v:
        ramp.shifted = SEVERAL
        ramp.slower += slowest - chosen
        ramp.faster += fastest - chosen
        let_stray(curves, ramp, slower - chosen, faster - chosen)


@lean
def note_interval(contacts, springs, curves, ramp, until):
    """Add the interval of the translations that were chosen to the account, unless they last an instant.

    Args:
        until: where the stretch that begins at s ends.
    """
    ds = until - ramp.s
    if ramp.shifted == SEVERAL and ds * (1.0 - ramp.done) > SHORTEST_STRETCH and not ramp.fall.falling:
        ramp.account.ambiguous = 1.0
        if curves is None:
            ramp.account.gain_least += ramp.slower * ds
            ramp.account.gain_most += ramp.faster * ds
    follow_all_strays(contacts, springs, curves, ramp, until)
    if curves is not None and not ramp.fall.falling:
        forget_strays(curves)


@inlined
def _choose_in_part(contacts, springs, model, curves, ramp):
    """Choose the translation of the present part if it is free at s."""
    if curves is None and model.ground is None:  # else bounds and parts count if they last, see `events`
        sample_margin(contacts, springs, model, curves, ramp)
    critical = is_critical(contacts, springs, model, curves, ramp)
    free = critical or _is_free(contacts, curves, ramp)
    if free and not is_held_by_ground(contacts, model.ground, curves, ramp, ramp.s):
        if chooses_alone(model):
            _shift_part(contacts, springs, model, curves, ramp)
            return
        if not ramp.shifted:
            _begin_shift(contacts, springs, model, ramp)
        _shift(contacts, springs, model, curves, ramp, ramp.s, ramp.until)


@inlined
def chooses_alone(model):
    """Determine whether the translation of each part lasts until an event of its own: springs are bent, without ground.

    Returns:
        Whether it does.
    """
    return model.curves is not None and model.ground is None


@lean
def _shift_part(contacts, springs, model, curves, ramp):
    """Choose the translation of the present part for the rest of the ramp, and find the next events that it changes.

    Flat springs at the ends of the part must stay flat up to there, so that another choice on the way is the same one.
    """
    if curves is None:
        return
    ramp.shifted = max(ramp.shifted, 1)
    wake_all(contacts, springs, model.clusters, ramp)
    for r in range(ramp.first, ramp.last):
        follow_strays(contacts, springs, model, curves, ramp, curves.members[r])
    for r in range(ramp.first, ramp.last):
        c = contacts[curves.members[r]]
        leave_bounds(c, ramp)
        advance(c, ramp, ramp.s)
        curves.strays[curves.members[r]].begun = ramp.s
    _shift(contacts, springs, model, curves, ramp, ramp.s, ramp.end)
    for r in range(ramp.first, ramp.last):
        i = curves.members[r]
        c = contacts[i]
        curves.strays[i].chosen = 1
        schedule_next(contacts, springs, model, ramp, i)
        for k in range(c.first, c.last):
            end = model.ends[k]
            if end.sign < 0.0 and side_of(springs[end.spring], curves, ramp.present) != 0:
                time_contact(contacts, springs, model, ramp, end.other)


@lean
def release_parts(contacts, springs, model, curves, ramp, count):
    """List all contacts of the parts of listed ones whose translation is chosen: it is then chosen anew.

    Args:
        ramp: the RAMP; `shifted` is set if there are any.
        count: how many contacts are listed.

    Returns:
        How many are listed now.
    """
    if curves is None:
        return count
    ramp.shifted, read = 0, 0
    while read < count:
        i = model.listed[read]
        c, stray = contacts[i], curves.strays[i]
        read += 1
        if not stray.chosen:
            continue
        follow_strays(contacts, springs, model, curves, ramp, i)
        ramp.shifted, stray.chosen, stray.slower, stray.faster = 1, 0, 0.0, 0.0
        leave_bounds(c, ramp)
        advance(c, ramp, ramp.s)
        for k in range(c.first, c.last):
            end = model.ends[k]
            if curves.strays[end.other].chosen and not is_flat(springs[end.spring], curves):
                count = list_contact(contacts, model.listed, end.other, count)
    return count


@lean
def _choose_where_new(contacts, springs, model, curves, ramp, count):
    """Choose the translation of each part that is free at s and in which rates are new: others did not change."""
    known = ramp.parts
    for j in range(count):
        i = model.listed[j]
        seen = known > curves.strays[i].part >= ramp.parts
        if not seen and find_near_part(contacts, springs, model, curves, ramp, i):
            _choose_in_part(contacts, springs, model, curves, ramp)


@inlined
def choose(contacts, springs, model, curves, ramp, count):
    """Choose the translation of each part that is free at s: `shifted` is then set.

    Where springs are bent, without ground, it lasts until an event of its part, see `release_parts`. Elsewhere all
    blocks are solved at the next event, and all parts looked at, as at the start of the ramp. The contacts of a
    critical part need not be listed there: their forces may have come to their bounds just as a ramp ended.

    Args:
        count: number of contacts that were listed to be solved around.
    """
    anew = ramp.shifted != 0 or not ramp.begun
    alone = chooses_alone(model) and ramp.begun
    ramp.shifted = 0
    if curves is None:
        _choose_in_part(contacts, springs, model, curves, ramp)
        return
    if alone or (contacts.shape[0] > ramp.few and not anew):
        _choose_where_new(contacts, springs, model, curves, ramp, count)
        return
    begin_parts(contacts, springs, model, curves, ramp)
    while next_part(curves, ramp, contacts.shape[0]):
        _choose_in_part(contacts, springs, model, curves, ramp)


@inlined
def _begin_shift(contacts, springs, model, ramp):
    """Advance the body to s, and find the next event; knots of flat springs limit the translation instead."""
    ramp.shifted = 1
    ramp.slower = ramp.faster = 0.0
    ramp.until = ramp.end
    wake_all(contacts, springs, model.clusters, ramp)
    draw_all(contacts, model.ground, ramp)
    for i in range(contacts.shape[0]):
        leave_bounds(contacts[i], ramp)
        advance(contacts[i], ramp, ramp.s)
        if contacts[i].coming != KNOT:
            ramp.until = min(ramp.until, contacts[i].next)


@lean
def choose_step(contacts, springs, model, curves, ramp):
    """Choose the translation of each part in an implicit step, if all its forces at its end are at their bounds."""
    end = ramp.friction + ramp.d_friction
    ramp.slower = ramp.faster = 0.0
    begin_parts(contacts, springs, model, curves, ramp)
    while next_part(curves, ramp, contacts.shape[0]):
        free = _is_free(contacts, curves, ramp)
        free = free or is_near(contacts, springs, model, curves, ramp, 1.0, CRITICAL * end)
        if free and not is_held_by_ground(contacts, model.ground, curves, ramp, 1.0):
            _shift(contacts, springs, model, curves, ramp, 0.0, 1.0)
    note_interval(contacts, springs, curves, ramp, 1.0)
