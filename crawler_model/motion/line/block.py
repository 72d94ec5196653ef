"""A block of contacts at their bounds, found around a contact: its rows, for `pivot`.

A contact strictly inside its bounds is a wall. Where the springs of a block form a path, its rows are in their order,
and a sleeping cluster of contacts is one row; in others, rows are in the order of elimination.
"""

from __future__ import annotations

import numpy as np

from ...compiled import inlined, lean
from ...rounding import EPS
from .advance import place_of
from .clusters import enter_cluster, find_cluster, find_span, wake_all
from .ground.bounds import enter_ground
from .ground.couplings import couplings_of, follow_couplings, is_coupled, place_couplings
from .ground.gradual import is_given, is_gradual
from .ground.steps import enter_end
from .pivot import ROUNDING
from .records import BACKWARD, FORWARD
from .springs.bends import is_flat
from .springs.parts import find_pull

BEGINS = 1e-300
"""Velocity of a contact that begins to slide, until its block's is known: its sign tells where to."""


@inlined
def leave_bounds(c, ramp):
    """Mark a contact as inside the bounds that it left before the present place on the ramp."""
    if c.leaving != 0 and c.since < place_of(c, ramp):
        c.bounds_met &= ~c.leaving
        c.leaving = 0


@inlined
def list_contact(contacts, listed, i, count):
    """List a contact among the contacts around which rates change, unless it is listed.

    Args:
        count: how many are listed.

    Returns:
        How many are listed now.
    """
    if contacts[i].listed:
        return count
    contacts[i].listed = 1
    listed[count] = i
    return count + 1


@inlined
def _is_wall(c, ramp):
    """Determine whether a contact is strictly inside its bounds, and so rests; in an implicit step none is."""
    leave_bounds(c, ramp)
    return c.bounds_met == 0 and not ramp.stepping


@inlined
def size_of_terms(contacts, springs, ends, c):
    """Sum the magnitudes of what the spring force on a contact is a difference of; it is large if springs are stiff.

    Returns:
        The sum [N].
    """
    size = 0.0
    for k in range(c.first, c.last):
        spring = springs[ends[k].spring]
        lengths = abs(c.x) + abs(contacts[ends[k].other].x) + abs(spring.length) + abs(spring.d_length)
        size += spring.stiffness * lengths + abs(spring.tension)
    return size


@inlined
def _blur_of_step(contacts, springs, model, curves, c):
    """Find how exactly forces are known at the start of an implicit step of bent springs, as `blur` of a BLOCK."""
    if curves is None:
        return 0.0
    return EPS / ROUNDING * size_of_terms(contacts, springs, model.ends, c)


@inlined
def _enter(contacts, springs, model, ramp, row, i):
    """Enter contact i in a row of the block: the limits of the rate of its force, and how it moved before.

    In an implicit step they are limits of the force; what flat springs pull is left out of all.
    """
    c, e = contacts[i], model.block[row]
    c.mark, c.row = ramp.search.block, row
    e.contact, e.cluster = i, -1
    e.load = 0.0 if ramp.fall.falling else c.pull
    pull = 0.0
    if ramp.stepping:
        pull = find_pull(contacts, springs, model, model.curves, i)
        e.load = (c.force - pull) + ramp.fraction * c.pull
        e.upper = (c.forward + ramp.fraction * c.d_forward) - pull
        e.lower = -(c.backward + ramp.fraction * c.d_backward) - pull
        e.blur = _blur_of_step(contacts, springs, model, model.curves, c)
    else:
        moves = not ramp.fall.falling or c.since < 0.0  # else it has yet to be drawn into the fall
        e.upper = (c.d_forward if moves else 0.0) if c.bounds_met & FORWARD else np.inf
        e.lower = (-c.d_backward if moves else 0.0) if c.bounds_met & BACKWARD else -np.inf
        changing = moves and (c.d_forward != 0.0 or c.d_backward != 0.0)
        e.blur = abs(c.forward) + abs(c.backward) if changing else 0.0
        enter_ground(c, e, model.ground, ramp, i, 0.0)
    if e.lower > e.upper:  # both bounds are met by rounding just before the interval between them vanishes
        e.upper = e.lower = 0.5 * (e.lower + e.upper)
    if ramp.stepping:
        enter_end(c, e, model.ground, ramp, i, pull)
    e.v = c.v
    e.side = 1 if c.v > 0.0 else (-1 if c.v < 0.0 else 0)
    if (e.side == 1 and e.upper == np.inf) or (e.side == -1 and e.lower == -np.inf):
        e.side = 0


@inlined
def _enter_spring(springs, e, ramp, j, sign):
    """Enter the spring before the contact of a row, its index and its sign along the path; -1 if there is none."""
    e.spring, e.cluster, e.sign = j, -1, sign
    e.trial = e.compliance = 0.0
    if j >= 0:
        spring = springs[j]
        e.compliance = spring.compliance
        if not ramp.fall.falling:
            e.trial = -sign * spring.stiffness * spring.d_length
        if ramp.stepping:
            e.trial = ramp.fraction * e.trial + sign * spring.tension


@inlined
def _leave_by(c, springs, model, came):
    """Find the end of a contact of at most two springs that is not on the spring `came`; -1 if none leads on."""
    for k in range(c.first, c.last):
        spring = model.ends[k].spring
        if spring != came and not is_flat(springs[spring], model.curves):
            return k
    return -1


@lean
def _find_path(contacts, springs, model, clusters, ramp, i):
    """Find the block around contact i if its springs form a path; returns the number of its rows, else 0.

    It is 0, too, if the path leads through sleeping clusters from their last contact to their first, or if nothing at
    rest determines their velocities.
    """
    ends = model.ends
    start = contacts[i]
    if start.last - start.first > 2:
        return 0
    ramp.search.before = ramp.search.behind = -1
    here, came = i, ends[start.first].spring if start.last - start.first == 2 else -1
    k = _leave_by(start, springs, model, came)
    while k >= 0:  # to one end of the path
        o = contacts[ends[k].other]
        came = ends[k].spring
        if _is_wall(o, ramp):
            ramp.search.before = ends[k].other
            break
        if o.last - o.first > 2 or ends[k].other == i:
            return 0
        here, last, spring = find_span(clusters, ramp, ends[k].other)
        if last != ends[k].other:
            return 0
        k = _leave_by(contacts[here], springs, model, came if spring < 0 else spring + 1)
    if k < 0:
        came = -1
    count = path = 0
    before, sign = -1, 1.0  # end of the next spring at the contact before
    if k >= 0:
        before = _end_at(contacts[ends[k].other], ends, came)
        sign = ends[before].sign
    while True:
        first, last, spring = find_span(clusters, ramp, here)
        if first != here:
            return 0
        if spring >= 0:
            enter_cluster(contacts, clusters, model.block[count], find_cluster(clusters, ramp, here))
            here, came = last, spring + last - first
        else:
            _enter_spring(springs, model.block[count], ramp, came if before >= 0 else -1, sign)
            _enter(contacts, springs, model, ramp, count, here)
        count += 1
        path += 1 + last - first
        before = _leave_by(contacts[here], springs, model, came)
        if before < 0:
            break
        came, sign = ends[before].spring, ends[before].sign
        o = contacts[ends[before].other]
        if _is_wall(o, ramp):
            ramp.search.behind = ends[before].other
            break
        if o.last - o.first > 2 or o.mark == ramp.search.block:
            return 0
        here = ends[before].other
    _enter_spring(springs, model.block[count], ramp, came if before >= 0 else -1, sign)
    ramp.search.anchored = ramp.search.before >= 0 or ramp.search.behind >= 0
    if path > count and not ramp.search.anchored:
        return 0
    ramp.search.path = path
    return count


@inlined
def _both_rest(contacts, ramp, i, beyond):
    """Determine whether contact i and the one beyond it rest at their bounds: only i could set that in motion."""
    return contacts[i].v == 0.0 and contacts[beyond].v == 0.0 and ramp.begun and not ramp.shifted


@inlined
def _find_stretch(contacts, springs, model, clusters, ramp, i):
    """Find the block around contact i of a chain, with a row for each sleeping cluster; returns the number of rows.

    Where neighbours rest at their bounds, the block ends with one of them, its guard, and `passes_guard` extends it.
    """
    n, first, last, left, right = contacts.shape[0], i, i, 0, 0
    curves = model.curves
    ramp.search.guards = 0
    while first > 0 and not is_flat(springs[first - 1], curves) and not _is_wall(contacts[first - 1], ramp):
        left += _both_rest(contacts, ramp, first, first - 1)
        if left > ramp.search.reach:
            ramp.search.guards |= BACKWARD
            break
        first = find_span(clusters, ramp, first - 1)[0]
    while last < n - 1 and not is_flat(springs[last], curves) and not _is_wall(contacts[last + 1], ramp):
        right += _both_rest(contacts, ramp, last, last + 1)
        if right > ramp.search.reach:
            ramp.search.guards |= FORWARD
            break
        last = find_span(clusters, ramp, last + 1)[1]
    if first == 0 and last == n - 1:  # nothing at rest determines the velocities of clusters
        wake_all(contacts, springs, clusters, ramp)
    joined_before = first > 0 and not is_flat(springs[first - 1], curves)
    joined_behind = last < n - 1 and not is_flat(springs[last], curves)
    ramp.search.anchored = joined_before or joined_behind
    ramp.search.before = first - 1 if joined_before and not ramp.search.guards & BACKWARD else -1
    ramp.search.behind = last + 1 if joined_behind and not ramp.search.guards & FORWARD else -1
    ramp.search.path = last + 1 - first
    count = 0
    while first <= last:
        e = model.block[count]
        k = find_cluster(clusters, ramp, first)
        if k >= 0:
            enter_cluster(contacts, clusters, e, k)
            first = e.contact + 1
        else:
            _enter_spring(springs, e, ramp, first - 1 if count > 0 or joined_before else -1, 1.0)
            _enter(contacts, springs, model, ramp, count, first)
            first += 1
        count += 1
    _enter_spring(springs, model.block[count], ramp, last if joined_behind else -1, 1.0)
    return count


@inlined
def _find_stretch_of_chain(contacts, springs, model, ramp, i):
    """Find the block around contact i as `_find_stretch`, without guards on gradual ground.

    Args:
        model: of a chain that has a matrix, because it has bent springs or ground.
    """
    if not (is_given(model.ground) or is_given(model.curves)):
        return 0
    if is_gradual(model.ground):
        ramp.search.reach = contacts.shape[0]
    return _find_stretch(contacts, springs, model, model.clusters, ramp, i)


@inlined
def passes_guard(contacts, block, ramp, count):
    """Let a guard of a solved block slide, and find out if one does: the block has to be found anew, further beyond it.

    Returns:
        Whether one does.
    """
    passes = False
    for bit, j in ((BACKWARD, 0), (FORWARD, count - 1)):
        if ramp.search.guards & bit and block[j].side != 0:
            contacts[block[j].contact].v = BEGINS * block[j].side
            passes = True
    ramp.search.reach *= 4
    return passes


@inlined
def _end_at(c, ends, spring):
    """Find the end of a spring at a contact."""
    for k in range(c.first, c.last):
        if ends[k].spring == spring:
            return k
    return -1


@lean
def _sort_rows(contacts, block, count):
    """Sort the contacts of a block by the order of elimination (Shell's sort)."""
    gap = 1
    while gap < count // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for j in range(gap, count):
            i = block[j].contact
            k = j
            while k >= gap and contacts[block[k - gap].contact].order > contacts[i].order:
                block[k].contact = block[k - gap].contact
                k -= gap
            block[k].contact = i
        gap //= 3


@lean
def _find_mesh(contacts, springs, model, ramp, i):
    """Find the block around contact i of a graph; returns the number of its contacts."""
    block, ends = model.block, model.ends
    contacts[i].mark = ramp.search.block
    block[0].contact = i
    count, read = 1, 0
    ramp.search.anchored = 0
    while read < count:
        c = contacts[block[read].contact]
        read += 1
        for k in range(c.first, c.last):
            o = contacts[ends[k].other]
            if o.mark == ramp.search.block or is_flat(springs[ends[k].spring], model.curves):
                continue
            if _is_wall(o, ramp):
                ramp.search.anchored = 1
            else:
                o.mark = ramp.search.block
                block[count].contact = ends[k].other
                count += 1
    _sort_rows(contacts, block, count)
    for row in range(count):
        _enter(contacts, springs, model, ramp, row, block[row].contact)
    return count


@inlined
def _find_whole(contacts, springs, model, ramp):
    """Enter all contacts in the block: elongations change the bounds of any contact; returns their number."""
    if ramp.stepping:
        follow_couplings(contacts, couplings_of(model.ground), 0.0)
    else:
        place_couplings(contacts, couplings_of(model.ground), ramp)
    ramp.search.anchored = 0
    for i in range(contacts.shape[0]):
        leave_bounds(contacts[i], ramp)
        _enter(contacts, springs, model, ramp, i, i)
    return contacts.shape[0]


@inlined
def find_block(contacts, springs, model, matrix, ramp, i):
    """Enter in the block all contacts at their bounds that springs join to contact i without passing a wall.

    Where friction changes with elongations, it is the whole body.

    Returns:
        The number of rows.
    """
    ramp.search.block += 1
    ramp.search.path = ramp.search.guards = 0
    if matrix is None:
        return _find_stretch(contacts, springs, model, model.clusters, ramp, i)
    if is_coupled(couplings_of(model.ground)):
        return _find_whole(contacts, springs, model, ramp)
    if ramp.search.chain and not (is_gradual(model.ground) and ramp.stepping):
        return _find_stretch_of_chain(contacts, springs, model, ramp, i)
    count = 0 if is_gradual(model.ground) else _find_path(contacts, springs, model, model.clusters, ramp, i)
    if count == 0 and wake_all(contacts, springs, model.clusters, ramp):
        ramp.search.block += 1
        count = _find_path(contacts, springs, model, model.clusters, ramp, i)
    if count == 0:
        ramp.search.block += 1
        count = _find_mesh(contacts, springs, model, ramp, i)
    return count
