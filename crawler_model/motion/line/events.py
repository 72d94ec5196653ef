"""A ramp followed from event to event.

Between events every contact is free (strictly inside its bounds, at rest) or at a bound, and the rates of forces and
displacements are constant. A free contact is a wall: an event changes only the rates of the block around it.
"""

from __future__ import annotations

import numpy as np

from ...compiled import inlined, lean
from ...rounding import CRITICAL
from .advance import advance, advance_spring
from .block import BEGINS, find_block, leave_bounds, list_contact, passes_guard
from .clusters import fall_asleep, set_clusters
from .critical.interval import follow_strays, follow_strays_of_block
from .critical.margin import sample_margin
from .critical.translation import choose, chooses_alone, note_interval, release_parts
from .ground.borders import catch, is_any_at_border, leave_border, reach_border, rest_on_border
from .ground.bounds import follow_ground, rate_at_bound
from .ground.chords import begin_chord, end_chord, halve_chord, is_curved, meets_chord
from .ground.couplings import couplings_of, follow_couplings, is_coupled
from .ground.driving import drive
from .ground.falls import begin_fall, draw, draw_spring, end_fall, find_due, find_due_at_end, has_fallen, is_due
from .ground.gradual import is_gradual
from .ground.tipping import tip
from .ground.turns import turns
from .ground.unstable import end_of_instant, meet_close_bounds
from .notes import note_all, note_arrival, note_piece, note_state
from .path import elongation_rate
from .pivot import ROUNDING, find_sides
from .records import AHEAD, BACKWARD, BEHIND, CATCH, DONE, FORWARD, INTERPRETED, KINK, KNOT, SPENT, UNSOLVED, WALL
from .springs.bends import is_flat
from .springs.knots import pass_knots, passes_singly, time_knots
from .springs.parts import begin_parts, next_part
from .timing import schedule_next
from .tournament import find_earliest, schedule


@lean
def _touch_wall(contacts, springs, model, ramp, i):
    """Find the rate of the force on a wall from the rates of its springs, and its next event."""
    c = contacts[i]
    if ramp.fall.falling:
        draw(contacts, model.ground, ramp, i)
    advance(c, ramp, ramp.s)
    c.force_rate = 0.0
    for k in range(c.first, c.last):
        end = model.ends[k]
        if not ramp.fall.falling or springs[end.spring].since < 0.0:
            c.force_rate += end.sign * springs[end.spring].rate
    if ramp.begun:
        schedule_next(contacts, springs, model, ramp, i)


@inlined
def _set_rates_of_mesh(contacts, springs, model, matrix, ramp, count):
    """Advance the springs of a solved block that is no path to s, and give them the rates that were found."""
    if matrix is None:
        return
    block, ends, s = model.block, model.ends, ramp.s
    for j in range(count):
        c = contacts[block[j].contact]
        for k in range(c.first, c.last):
            o = contacts[ends[k].other]
            if o.mark == c.mark and ends[k].sign < 0.0:
                continue  # its other end is in the block, too
            spring = springs[ends[k].spring]
            draw_spring(spring, model.curves, model.ground, ramp)
            advance_spring(spring, model.curves, ramp, s)
            stretch = ends[k].sign * ((o.v if o.mark == c.mark else 0.0) - c.v)
            flow = spring.stiffness * (stretch - spring.d_length)
            spring.rate = flow if ramp.stepping else ends[k].sign * ends[k].flow
            spring.moved |= stretch != 0.0


@inlined
def _set_rates(contacts, springs, model, ramp, count):
    """Advance a solved block to s, and give its contacts and springs the rates that were found."""
    block, s = model.block, ramp.s
    if chooses_alone(model) and not ramp.stepping:
        follow_strays_of_block(contacts, springs, model, model.curves, ramp, count)
    set_clusters(springs, block, model.clusters, ramp, count)
    for j in range(count + 1):
        e = block[j]
        if e.cluster >= 0:
            continue
        if j < count:
            c = contacts[e.contact]
            stops = e.v == 0.0 and c.v != 0.0 and not ramp.stepping
            if ramp.fall.falling:
                draw(contacts, model.ground, ramp, e.contact)
            advance(c, ramp, s)
            c.v = e.v
            if stops:
                rest_on_border(c, model.ground, ramp, e.contact)
        if ramp.search.path > 0 and e.spring >= 0:
            spring = springs[e.spring]
            draw_spring(spring, model.curves, model.ground, ramp)
            advance_spring(spring, model.curves, ramp, s)
            spring.rate = e.sign * e.flow - (spring.tension if ramp.stepping else 0.0)
            spring.moved |= elongation_rate(e.flow, e.trial, e.compliance) != 0.0
    if ramp.search.path == 0:
        _set_rates_of_mesh(contacts, springs, model, model.matrix, ramp, count)


@inlined
def _hold_sides(contacts, springs, model, ramp, count):
    """Put the contacts of a solved block onto their bounds, or let them leave, and find their next events.

    A contact that was at its bound stays there if it slides, or if the rate of its force is the rate of the bound.
    """
    block, s = model.block, ramp.s
    follow_couplings(contacts, couplings_of(model.ground), s)
    for j in range(count):
        e = block[j]
        if e.cluster >= 0:
            continue
        c = contacts[e.contact]
        follow_ground(c, model.ground, ramp, e.contact)
        side = e.side
        if side == 0:  # at rest; it stays at its bound if its force changes as the bound does
            close = ROUNDING * (e.scale + e.blur)
            side = 1 if e.force >= e.upper - close else (-1 if e.force <= e.lower + close else 0)
        if side != 0 and not c.bounds_met & (FORWARD if side > 0 else BACKWARD):
            side = 0  # it has just come to rest on a border beyond which the ground holds more
        c.side = side  # the force then changes with the bound, and starts from it without rounding
        c.force_rate = e.force if side == 0 else rate_at_bound(c, e, model.ground, side)
        held = 0
        if side != 0:
            held = FORWARD if side > 0 else BACKWARD
            c.force = c.forward + s * c.d_forward if side > 0 else -(c.backward + s * c.d_backward)
            if c.bounds_met == FORWARD | BACKWARD and c.d_forward + c.d_backward <= 0.0:  # no room between the bounds
                held = FORWARD | BACKWARD
        c.leaving = c.bounds_met & ~held  # it counts as at the bound for this instant, see `leave_bounds`
        note_state(model.pieces, ramp, c, e.contact)
        if leave_border(c, model.ground, ramp, e.contact):
            follow_ground(c, model.ground, ramp, e.contact)
        schedule_next(contacts, springs, model, ramp, e.contact)
        if ramp.search.path == 0:  # springs of a graph lead to walls, whose forces change with the velocity
            for k in range(c.first, c.last):
                end = model.ends[k]
                if contacts[end.other].mark != ramp.search.block and not is_flat(springs[end.spring], model.curves):
                    _touch_wall(contacts, springs, model, ramp, end.other)
    if ramp.search.path > 0:  # a path has one wall at each end
        if ramp.search.before >= 0:
            _touch_wall(contacts, springs, model, ramp, ramp.search.before)
        if ramp.search.behind >= 0 and ramp.search.behind != ramp.search.before:
            _touch_wall(contacts, springs, model, ramp, ramp.search.behind)


@inlined
def _solve_around(contacts, springs, model, ramp, i):
    """Solve for the rates of the block around contact i at s, and update all that depends on them.

    Returns:
        False if no rates were found.
    """
    ramp.search.reach = 1
    while True:
        ramp.search.woken = 0
        count = find_block(contacts, springs, model, model.matrix, ramp, i)
        if not ramp.stepping and find_due(contacts, model.block, model.ground, ramp, count):
            return False
        solved = find_sides(contacts, springs, model, ramp, count)
        if solved or drive(contacts, springs, model, model.ground, ramp, count):
            if turns(contacts, springs, model, model.ground, ramp, count):
                return False
            if not passes_guard(contacts, model.block, ramp, count):
                break
        elif not ramp.search.woken:
            tip(contacts, springs, model, model.ground, ramp, count)
            return False
    ramp.search.rows = count
    _set_rates(contacts, springs, model, ramp, count)
    if not ramp.stepping:
        _hold_sides(contacts, springs, model, ramp, count)
        time_knots(contacts, springs, model, model.curves, ramp, count)
        fall_asleep(contacts, springs, model.block, model.clusters, ramp, count)
    return True


@inlined
def solve_listed(contacts, springs, model, ramp, count):
    """Solve for the rates of the blocks around the listed contacts at s, and update all that depends on them.

    Args:
        count: how many contacts are listed. Contacts inside their bounds are in no block, except in an implicit step.

    Returns:
        False if no rates are found around one of them; where it jumps, the others are solved for as well.
    """
    before, due = ramp.search.block, 0
    for j in range(count):
        i = model.listed[j]
        acts = contacts[i].bounds_met != 0 or is_coupled(couplings_of(model.ground))
        solves = ramp.stepping or (acts and contacts[i].mark <= before)
        if solves and not _solve_around(contacts, springs, model, ramp, i):
            if due == 0:
                due = ramp.fall.due
            if due == 0 or not is_gradual(model.ground):
                return False
            ramp.fall.due = due
    return due == 0


@inlined
def _list_blocks(contacts, springs, model, ramp, count):
    """List all contacts at bounds, each advanced to s; returns how many are listed."""
    for i in range(contacts.shape[0]):
        c = contacts[i]
        leave_bounds(c, ramp)
        advance(c, ramp, ramp.s)
        meet_close_bounds(contacts, springs, model, model.ground, ramp, i)
        if c.bounds_met != 0:
            count = list_contact(contacts, model.listed, i, count)
    return count


@lean
def _stop(contacts, springs, model, ramp, i, count):
    """List the contacts at bounds next to one that has stopped at a border; springs to free ones keep their ends."""
    c = contacts[i]
    for k in range(c.first, c.last):
        o = contacts[model.ends[k].other]
        leave_bounds(o, ramp)
        if o.bounds_met != 0:
            count = list_contact(contacts, model.listed, model.ends[k].other, count)
        else:
            spring = springs[model.ends[k].spring]
            draw_spring(spring, model.curves, model.ground, ramp)  # a flat one may rest until here
            advance_spring(spring, model.curves, ramp, ramp.s)
            spring.rate = 0.0 if ramp.fall.falling else -spring.stiffness * spring.d_length
    return count


@inlined
def _meet(contacts, springs, model, ramp):
    """Let all contacts whose event is due at s reach their bound or border; returns how many are listed."""
    count, until = 0, end_of_instant(model.ground, ramp)
    i = find_earliest(contacts)
    while contacts[i].next <= until:
        c = contacts[i]
        if chooses_alone(model):
            follow_strays(contacts, springs, model, model.curves, ramp, i)
        leave_bounds(c, ramp)
        advance(c, ramp, ramp.s)
        if is_due(c, model.ground, ramp, i):
            pass  # it falls with all others that do
        elif c.coming == AHEAD or c.coming == BEHIND or c.coming == WALL:
            if reach_border(c, model.ground, ramp, i) > 0:
                count = _stop(contacts, springs, model, ramp, i, count)
        elif c.coming == CATCH:
            catch(c, model.ground, ramp, i)
        elif c.coming == KNOT:
            count = pass_knots(contacts, springs, model, model.curves, ramp, i, count)
        elif c.coming == KINK:
            pass  # the body is solved anew
        else:
            note_arrival(model.pieces, ramp, c, i)
            c.bounds_met |= c.coming
            c.v = BEGINS if c.coming == FORWARD else -BEGINS
        schedule(contacts, i, np.inf)
        count = list_contact(contacts, model.listed, i, count)
        i = find_earliest(contacts)
        if passes_singly(model.curves, ramp):
            break
    if chooses_alone(model):
        return release_parts(contacts, springs, model, model.curves, ramp, count)
    if ramp.shifted or is_curved(model.ground, ramp):
        count = _list_blocks(contacts, springs, model, ramp, count)
    return count


@inlined
def _touch_stopped(contacts, springs, model, ramp, count):
    """Find the next events of the listed contacts that have stopped, and of their neighbours at rest."""
    for j in range(count):
        i = model.listed[j]
        contacts[i].listed = 0
        if contacts[i].bounds_met == 0:
            for k in range(contacts[i].first, contacts[i].last):
                o = model.ends[k].other
                if contacts[o].bounds_met == 0 and (not ramp.fall.falling or contacts[o].since < 0.0):
                    _touch_wall(contacts, springs, model, ramp, o)
            _touch_wall(contacts, springs, model, ramp, i)


@inlined
def _schedule_resting(contacts, springs, model, ramp):
    """Find the next events of contacts at rest at the start; all events are then known."""
    if ramp.begun:
        return
    for i in range(contacts.shape[0]):
        if contacts[i].bounds_met == 0:
            schedule_next(contacts, springs, model, ramp, i)


@inlined
def _choose(contacts, springs, model, ground, curves, ramp, count):
    """Choose the translation at s if it is free; borders and knots are then met at other instants."""
    choose(contacts, springs, model, curves, ramp, count)
    if ramp.shifted and ground is not None:
        for i in range(contacts.shape[0]):
            leave_border(contacts[i], ground, ramp, i)
            schedule_next(contacts, springs, model, ramp, i)


@lean
def _give_up(contacts, springs, model, ramp, count):
    """Return from an unfinished fall to the ramp, and clear the list."""
    if ramp.fall.falling:
        count = end_fall(contacts, springs, model, model.ground, ramp, count)
    for j in range(count):
        contacts[model.listed[j]].listed = 0


@lean
def _is_over(contacts, springs, ramp):
    """Determine whether the rest of the ramp or fall changes forces only by rounding, and end it there if so.

    Friction that vanishes with it then holds to its end, and what is loose behind it stays where it is.
    """
    change = size = 0.0
    for i in range(contacts.shape[0]):
        c = contacts[i]
        if not ramp.fall.falling or c.since < 0.0:
            change += abs(c.d_forward) + abs(c.d_backward) + abs(c.d_load)
        size += c.forward + c.backward + abs(c.load)
    for j in range(springs.shape[0]):
        if not ramp.fall.falling:
            change += springs[j].stiffness * abs(springs[j].d_length)
        size += abs(springs[j].tension)
    over = (ramp.end - ramp.s) * change <= CRITICAL * size
    if over:
        ramp.s = ramp.end
    return over


@lean
def _return_to_ramp(contacts, springs, model, ground, ramp, count):
    """Go on with the ramp after a fall; returns how many contacts are listed."""
    count = end_fall(contacts, springs, model, ground, ramp, count)
    if is_curved(ground, ramp):
        begin_chord(ground, ramp)
        count = _list_blocks(contacts, springs, model, ramp, count)
    return count


@lean
def _solve_blocks(contacts, springs, model, ramp, count):
    """Solve for the rates around the listed contacts, unless one falls; returns False if none were found."""
    ramp.search.undetermined = ramp.search.loose = 0
    if not solve_listed(contacts, springs, model, ramp, count):
        return ramp.fall.due > 0
    _touch_stopped(contacts, springs, model, ramp, count)
    return True


@lean
def _sample(contacts, springs, model, curves, ramp):
    """Update the visited margin by all parts at s."""
    begin_parts(contacts, springs, model, curves, ramp)
    while next_part(curves, ramp, contacts.shape[0]):
        sample_margin(contacts, springs, model, curves, ramp)


@lean
def _advance_ramp(contacts, springs, model, ground, curves, ramp, s):
    """Advance the ramp to the end of a stretch, where borders change bounds at once, and springs that are flat stiffen.

    The visited margin is updated before, except between two events that are met together but for rounding, and at the
    start of a ramp where no bound has changed at once since the last one ended.
    """
    begin, ramp.s = ramp.s, s
    if ground is None and curves is None:
        return
    if contacts.shape[0] > ramp.few or ramp.fall.falling:  # `sample_margin` would do nothing, for each part
        return
    if s - begin <= CRITICAL:
        return
    if begin > 0.0 or ramp.fall.jumps > 0 or curves is not None or is_any_at_border(contacts, ground, ramp):
        ramp.s = begin
        _sample(contacts, springs, model, curves, ramp)
        ramp.s = s
    if s < ramp.end or ground is not None:  # at the end, bounds may already be those behind a border
        _sample(contacts, springs, model, curves, ramp)


@lean
def _check_flags(ramp, count):
    """Check what the flags of a ramp mean together, before the rates around an event are found.

    In a fall commands rest at `rests`, and s is a place on the line of the fall, which is before the ramp. A chosen
    translation belongs to the stretch that ends here, so the first one has begun. What is due to fall begins to fall
    before anything is solved.
    """
    falling = ramp.fall.falling != 0
    assert falling == (ramp.s < 0.0)
    assert falling == (ramp.end < 0.0)
    assert ramp.s <= 1.0
    assert not falling or (ramp.begun and 0.0 <= ramp.fall.rests <= 1.0 and ramp.fall.drawn > 0)
    assert not ramp.shifted or ramp.begun
    assert 0 <= ramp.fall.due <= count
    assert not ramp.stepping


@lean
def follow_events(contacts, springs, model, ramp):
    """Follow a ramp from event to event.

    At each event: which contacts slide, and how fast, in the blocks around what has changed; then the translation where
    friction does not determine it; then the earliest next event of all contacts.

    Args:
        ramp: the RAMP; at the end `s` is the place that was reached, to which contacts and springs have yet to advance.

    Returns:
        DONE, SPENT or UNSOLVED.
    """
    ground = model.ground
    ramp.account.events += 1.0
    count = _list_blocks(contacts, springs, model, ramp, 0)
    begin_chord(ground, ramp)
    if has_fallen(contacts, ground):
        count = begin_fall(contacts, springs, model, ground, ramp, count)
    while True:
        if INTERPRETED:
            _check_flags(ramp, contacts.shape[0])
        # rates
        if ramp.fall.due == 0 and not _solve_blocks(contacts, springs, model, ramp, count):
            if halve_chord(ground, ramp):
                count = _list_blocks(contacts, springs, model, ramp, count)
                continue
            over = _is_over(contacts, springs, ramp)
            if over and ramp.fall.falling:
                count = _return_to_ramp(contacts, springs, model, ground, ramp, count)
                continue
            _give_up(contacts, springs, model, ramp, count)
            if ramp.effort > ramp.budget and 0.0 < ramp.s < 1.0:  # a jump was not looked for
                return SPENT
            return DONE if over else UNSOLVED
        # a contact whose bound has fallen below its force jumps: commands rest until it is held again
        if ramp.fall.due > 0:
            count = begin_fall(contacts, springs, model, ground, ramp, count)
            continue
        _schedule_resting(contacts, springs, model, ramp)
        _choose(contacts, springs, model, ground, model.curves, ramp, count)
        ramp.begun, count = 1, 0
        # the next event
        s = contacts[find_earliest(contacts)].next
        if meets_chord(ground, ramp, s):
            count = _list_blocks(contacts, springs, model, ramp, count)
            continue
        s = end_chord(ground, ramp, s)
        if (ramp.shifted or ramp.strays) and not chooses_alone(model):
            note_interval(contacts, springs, model.curves, ramp, min(s, ramp.end))
        note_piece(model.pieces, contacts, ramp, min(s, 1.0))
        if ramp.shifted:
            note_all(model.pieces, contacts, ramp)
        if not s < ramp.end:
            _advance_ramp(contacts, springs, model, ground, model.curves, ramp, ramp.end)
            if find_due_at_end(contacts, ground, ramp):
                continue
            if not ramp.fall.falling:
                return DONE
            count = _return_to_ramp(contacts, springs, model, ground, ramp, count)
            continue
        if ramp.effort > ramp.budget:
            _give_up(contacts, springs, model, ramp, count)
            return SPENT
        if s > ramp.s:
            ramp.account.events += 1.0
            ramp.passed = 0
        _advance_ramp(contacts, springs, model, ground, model.curves, ramp, s)
        begin_chord(ground, ramp)
        count = _meet(contacts, springs, model, ramp)
