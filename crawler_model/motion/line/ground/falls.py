"""Falls: bounds that fall at fixed commands, wherever contacts come to ground that holds less.

A fall takes part of no length of the ramp: commands rest at `rests`, and the bounds that the ground does not hold fall
to bounds that it does, along a line of their own from -1 to 0. Only contacts that the fall moves, or whose forces it
changes, are drawn into it; `since` < 0 marks them, and their events come before all others in the tournament. So the
same loop follows ramps and falls, and a jump costs no more than the contacts that take part in it.

All that fall at one instant fall together; where others come to such borders on the way, the rest of the fall begins
anew with them. Lowering a forward bound moves contacts forward only, as the forces of springs on a contact grow with
the displacements of the others, so the end is the least displacement at which all bounds hold.
"""

from __future__ import annotations

import numpy as np

from ....compiled import inlined, lean
from ..advance import advance, advance_spring, place_of
from ..block import leave_bounds, list_contact
from ..records import AHEAD, BACKWARD, BEHIND, FORWARD
from ..tournament import schedule
from .borders import (
    ROUNDING,
    SLIDES,
    close_jump,
    compare,
    gap_of,
    open_jump,
    reach_border,
    rest_on_border,
)
from .bounds import hold, set_bound, set_bounds
from .couplings import more_on, rest_couplings
from .gradual import is_gradual
from .walls import is_at_wall

_BEGIN, _END = -1.0, -1e-300
"""The line of a fall. Its end is as good as 0, where the bounds are the ground's, and still before the ramp."""
_SLOWEST = 1e-4
"""Contacts that slide slower than this part of the velocity of one that falls are not looked for at their borders."""


@inlined
def is_due(c, ground, ramp, i):
    """Determine whether a sliding contact is now at a border beyond which the ground holds less, and note it as `due`.

    Returns:
        Whether it is.
    """
    if ground is None or abs(c.v) <= SLIDES:
        return False
    foot, coming = ground.feet[i], AHEAD if c.v > 0.0 else BEHIND
    if gap_of(c, foot, ground, coming, place_of(c, ramp)) > ROUNDING * (ramp.span + abs(c.v)):
        return False
    return _is_due(c, foot, ground, coming, ramp, i)


@lean
def _is_due(c, foot, ground, coming, ramp, i):
    if foot.place % 2 == 1 or (c.fallen != 0 and is_gradual(ground)):  # it falls further
        return False
    if compare(c, foot, ground, coming, ramp) >= 0:
        return False
    if is_at_wall(c, foot, ground.walls, i, ROUNDING * ramp.span):
        return False
    ramp.fall.due = i + 1
    return True


@lean
def find_due(contacts, block, ground, ramp, count):
    """Note as `due` a contact of a block at a border beyond which the ground holds less, before its rates change.

    Returns:
        Whether there is one.
    """
    if ground is None:
        return False
    for j in range(count):
        i = block[j].contact
        if contacts[i].v != 0.0 and is_due(contacts[i], ground, ramp, i):
            return True
    return False


@lean
def find_due_at_end(contacts, ground, ramp):
    """Note as `due` a contact that is at such a border at the end of the ramp or of the fall.

    Returns:
        Whether there is one.
    """
    if ground is None:
        return False
    for j in range(ramp.fall.drawn if ramp.fall.falling else contacts.shape[0]):
        i = ground.drawn[j].contact if ramp.fall.falling else j
        if contacts[i].v != 0.0 and is_due(contacts[i], ground, ramp, i):
            return True
    return False


@lean
def has_fallen(contacts, ground):
    """Determine whether a contact stands on ground that does not hold its bounds, and so has to fall.

    Returns:
        Whether one does.
    """
    if ground is None:
        return False
    fallen = 0
    for i in range(contacts.shape[0]):
        fallen |= contacts[i].fallen
    return fallen != 0


@lean
def draw(contacts, ground, ramp, i):
    """Draw contact i into the present fall, if there is one: its bounds rest, and so does it until it is solved."""
    if ground is None:
        return
    c = contacts[i]
    if not ramp.fall.falling or c.since < 0.0:
        return
    leave_bounds(c, ramp)
    advance(c, ramp, ramp.fall.rests)
    c.forward += ramp.fall.rests * c.d_forward
    c.backward += ramp.fall.rests * c.d_backward
    c.load += ramp.fall.rests * c.d_load
    c.d_forward = c.d_backward = c.d_load = 0.0
    c.v = 0.0 if c.fallen == 0 else (SLIDES if c.fallen == FORWARD else -SLIDES)
    c.force_rate = 0.0
    c.leaving = c.side = 0
    c.since = ramp.s
    schedule(contacts, i, np.inf)
    drawn = ground.drawn[ramp.fall.drawn]
    drawn.contact, drawn.held = i, c.forward + c.backward
    ramp.fall.drawn += 1


@lean
def draw_all(contacts, ground, ramp):
    """Draw all contacts into the present fall, if there is one."""
    if ground is not None and ramp.fall.falling:
        for i in range(contacts.shape[0]):
            draw(contacts, ground, ramp, i)


@lean
def draw_spring(spring, curves, ground, ramp):
    """Draw a spring whose rate changes into the present fall, if there is one."""
    if ground is not None and ramp.fall.falling and spring.since >= 0.0:
        advance_spring(spring, curves, ramp, ramp.fall.rests)
        spring.since, spring.rate = ramp.s, 0.0


@lean
def _let_fall(contacts, model, ground, ramp, i, count):
    """Put contact i onto its border if it falls there; returns how many contacts are listed."""
    c = contacts[i]
    if not is_due(c, ground, ramp, i):
        return count
    advance(c, ramp, place_of(c, ramp))
    c.coming = AHEAD if c.v > 0.0 else BEHIND
    reach_border(c, ground, ramp, i)
    return list_contact(contacts, model.listed, i, count)


@lean
def _let_all_fall(contacts, model, ground, ramp, count):
    """Put all contacts that fall now onto their borders; returns how many contacts are listed.

    The tournament is descended to all events that come within the rounding of positions, unless that is beyond them.
    """
    n, nodes, first = contacts.shape[0], ground.nodes, ramp.fall.due - 1
    until = np.inf
    if ramp.begun:
        until = ramp.s + ROUNDING / _SLOWEST * (1.0 + ramp.span / abs(contacts[first].v))
    listed = count
    count = _let_fall(contacts, model, ground, ramp, first, count)
    for j in range(listed):
        count = _let_fall(contacts, model, ground, ramp, model.listed[j], count)
    if ramp.fall.falling:
        for j in range(ramp.fall.drawn):
            count = _let_fall(contacts, model, ground, ramp, ground.drawn[j].contact, count)
        return count
    if until > 1.0:
        for i in range(n):
            count = _let_fall(contacts, model, ground, ramp, i, count)
        return count
    nodes[0] = 1
    left = 1
    while left > 0:
        left -= 1
        node = nodes[left]
        i = node - n if node >= n else contacts[node].winner
        if contacts[i].next > until:
            continue
        if node >= n:
            count = _let_fall(contacts, model, ground, ramp, i, count)
        else:
            nodes[left], nodes[left + 1] = 2 * node, 2 * node + 1
            left += 2
    return count


@lean
def _rewind(contacts, springs, model, ground, ramp):
    """Advance what takes part in the present fall, and let its line begin anew from there."""
    for j in range(ramp.fall.drawn):
        c = contacts[ground.drawn[j].contact]
        leave_bounds(c, ramp)
        advance(c, ramp, ramp.s)
        for k in range(c.first, c.last):
            spring = springs[model.ends[k].spring]
            if spring.since < 0.0:
                advance_spring(spring, model.curves, ramp, ramp.s)
                spring.since, spring.rate = _BEGIN, 0.0
        c.forward += ramp.s * c.d_forward
        c.backward += ramp.s * c.d_backward
        c.d_forward = c.d_backward = c.force_rate = 0.0
        if c.fallen == 0:
            c.v = 0.0
        c.leaving = c.side = 0
        c.since = _BEGIN


@lean
def _fall_to(c, foot, ground, side, ramp):
    """Find how far a bound of a contact falls from that in force: to that of the ground at its place.

    On gradual ground it falls to the least on its way, to which springs add nothing, until it meets that of the ground
    where it then is.

    Args:
        side: FORWARD or BACKWARD.
    """
    bound = c.forward if side == FORWARD else c.backward
    set_bound(c, foot, ground, side, ramp)
    least = c.forward if side == FORWARD else c.backward
    if is_gradual(ground):
        least = _least_beyond(foot, ground, side, ramp.fall.rests, least - more_on(foot, side, ramp.s))
    if side == FORWARD:
        c.forward, c.d_forward = least, min(least - bound, 0.0)
    else:
        c.backward, c.d_backward = least, min(least - bound, 0.0)


@lean
def _least_beyond(foot, ground, side, s, least):
    """Find the least bound of the ground that a contact may slide onto, which is at an end of a stretch."""
    last = ground.borders.shape[0]
    begin, end = ((foot.place + 1) // 2, last) if side == FORWARD else (0, foot.place // 2)
    for stretch in range(begin, end + 1):
        for j in (stretch - 1, stretch):
            if 0 <= j < last:
                least = min(least, hold(foot, ground, stretch, side, s, ground.borders[j]))
    return least


@lean
def begin_fall(contacts, springs, model, ground, ramp, count):
    """Begin a fall of all contacts that are now at borders beyond which the ground holds less, or one anew with them.

    Args:
        ramp: the RAMP; `due` is one of these contacts, or 0 if all that fall stand on their borders already.
        count: how many contacts are listed.

    Returns:
        How many contacts are listed now: all that take part.
    """
    if ground is None:
        return count
    first = ramp.fall.due - 1
    if ramp.fall.due > 0:
        count = _let_all_fall(contacts, model, ground, ramp, count)
    ramp.fall.due = 0
    rest_couplings(ground.couplings, ramp.s)
    if ramp.fall.falling:
        _rewind(contacts, springs, model, ground, ramp)
        ramp.s = _BEGIN
    else:
        ramp.fall.rests, ramp.s, ramp.end = ramp.s, _BEGIN, _END
        ramp.fall.falling, ramp.fall.drawn = 1, 0
        if not ramp.begun:
            draw_all(contacts, ground, ramp)
            ramp.begun = 1
    for j in range(count):
        draw(contacts, ground, ramp, model.listed[j])
    if first >= 0:
        draw(contacts, ground, ramp, first)
    for j in range(ramp.fall.drawn):
        i = ground.drawn[j].contact
        c, foot = contacts[i], ground.feet[i]
        schedule(contacts, i, np.inf)
        count = list_contact(contacts, model.listed, i, count)
        if c.fallen & FORWARD:
            _fall_to(c, foot, ground, FORWARD, ramp)
        if c.fallen & BACKWARD:
            _fall_to(c, foot, ground, BACKWARD, ramp)
    return count


@lean
def let_tip(c, ground, ramp, i, side):
    """Let a contact begin to jump, whose bound falls faster with its displacement than the force on it.

    Args:
        c: CONTACT i.
        side: FORWARD or BACKWARD, the bound that it is at.
    """
    if ground is None:
        return
    advance(c, ramp, place_of(c, ramp))
    c.fallen = side
    open_jump(c, ground, ramp, i, ground.feet[i].home + (c.x + c.residue))
    ramp.fall.due = i + 1


@lean
def end_fall(contacts, springs, model, ground, ramp, count):
    """Return from a fall to the ramp, with the bounds of the ground, or with what is left of an unfinished fall.

    Args:
        ramp: the RAMP; the fall is finished if `s` is at its end.
        count: how many contacts are listed.

    Returns:
        How many contacts are listed now: all that have taken part.
    """
    if ground is None:
        return count
    rest_couplings(ground.couplings, ramp.s)
    s, ramp.s, ramp.end, ramp.fall.falling = ramp.s, ramp.fall.rests, 1.0, 0
    for j in range(ramp.fall.drawn):
        i = ground.drawn[j].contact
        c, foot = contacts[i], ground.feet[i]
        if c.leaving != 0 and c.since < s:
            c.bounds_met &= ~c.leaving
        advance(c, ramp, s)
        for k in range(c.first, c.last):
            spring = springs[model.ends[k].spring]
            if spring.since < 0.0:
                advance_spring(spring, model.curves, ramp, s)
                spring.since = ramp.fall.rests
                spring.rate = -spring.stiffness * spring.d_length
        c.leaving = c.side = 0
        c.since = ramp.fall.rests
        c.forward += s * c.d_forward
        c.backward += s * c.d_backward
        c.d_forward = c.d_backward = 0.0
        if s == _END and is_gradual(ground):  # its bound may be the least just where the next stretch begins
            close_jump(c, ground, ramp, i)
            c.fallen = 0
        rest_on_border(c, ground, ramp, i)
        forward, backward = c.forward, c.backward
        set_bounds(c, foot, ground, ramp)
        ramp.friction += (c.forward + c.backward) - ground.drawn[j].held
        if s == _END:
            close_jump(c, ground, ramp, i)
            c.fallen = 0
        if c.fallen & FORWARD:
            c.forward, c.d_forward = max(forward, c.forward + c.since * c.d_forward), 0.0
        if c.fallen & BACKWARD:
            c.backward, c.d_backward = max(backward, c.backward + c.since * c.d_backward), 0.0
        if c.bounds_met == 0:
            c.v = 0.0
        schedule(contacts, i, np.inf)
        count = list_contact(contacts, model.listed, i, count)
    ramp.fall.drawn = 0
    return count
