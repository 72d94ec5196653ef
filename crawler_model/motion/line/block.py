"""A block of contacts at their bounds: found around a contact, and which of its contacts slide, by principal pivoting.

The rates in a block solve a complementarity problem: a contact at its forward bound either slides forward, its force
moving along the bound, or rests with a force that rises no faster than the bound. An implicit step is the same problem
for the whole body with forces instead of rates. The search exchanges all contacts that violate their condition; where
that does not reduce their number, the last one alone (Murty's rule), which ends for every body that something holds.
"""

from __future__ import annotations

import numpy as np

from ...compiled import lean
from ...rounding import EPS, NOISE
from .advance import place_of
from .mesh import solve_mesh
from .path import limit_of, solve_path
from .project import project
from .records import BACKWARD, FORWARD
from .runs import enter_run, find_run, wake_all, wake_block, wake_turning

_SOON = 5
"""Rounds after which a path is solved by `project`, and the search goes on from there; an implicit step begins with it:
it is far from the velocities before it, while an event changes few of them."""
_PATIENCE = 10
"""Rounds, beside one for each contact, without fewer violations before contacts are exchanged one by one: sliding may
spread from both ends of a body by one contact a round."""
ROUNDING = 32.0 * EPS
"""A force beyond its limit by less than this part of the terms that it is a sum of is at its limit."""


@lean
def settle(c, ramp):
    """Mark a contact as inside the bounds that it left before the present place on the ramp.

    Args:
        c: a CONTACT.
        ramp: the RAMP.
    """
    if c.leaving != 0 and c.since < place_of(c, ramp):
        c.at &= ~c.leaving
        c.leaving = 0


@lean
def list_contact(contacts, block, i, count):
    """List a contact among those around which rates change, unless it is listed.

    Args:
        contacts: CONTACT, shape (N,).
        block: BLOCK, which holds the list.
        i: the contact.
        count: how many are listed.

    Returns:
        How many are listed now.
    """
    if contacts[i].listed:
        return count
    contacts[i].listed = 1
    block[count].hit = i
    return count + 1


@lean
def is_wall(c, ramp):
    """Determine whether a contact is strictly inside its bounds, and so rests whatever its neighbours do.

    Args:
        c: a CONTACT.
        ramp: the RAMP.

    Returns:
        True if it is; in an implicit step none is.
    """
    settle(c, ramp)
    return c.at == 0 and not ramp.stepping


@lean
def _enter(contacts, block, ramp, row, i):
    """Enter contact i in a row of the block: the limits of the rate of its force, and how it moved before."""
    c, e = contacts[i], block[row]
    c.mark, c.row = ramp.block, row
    e.contact, e.run = i, -1
    e.load = 0.0 if ramp.falling else c.pull
    if ramp.stepping:
        e.load = c.force + ramp.part * c.pull
        e.upper, e.lower = c.forward + ramp.part * c.d_forward, -(c.backward + ramp.part * c.d_backward)
        e.blur = 0.0
    else:
        moves = not ramp.falling or c.since < 0.0  # else it has yet to be drawn into the fall
        e.upper = (c.d_forward if moves else 0.0) if c.at & FORWARD else np.inf
        e.lower = (-c.d_backward if moves else 0.0) if c.at & BACKWARD else -np.inf
        changing = moves and (c.d_forward != 0.0 or c.d_backward != 0.0)
        e.blur = abs(c.forward) + abs(c.backward) if changing else 0.0
    if e.lower > e.upper:  # both bounds are met by rounding just before the interval between them vanishes
        e.upper = e.lower = 0.5 * (e.lower + e.upper)
    e.side = 1 if c.v > 0.0 else (-1 if c.v < 0.0 else 0)
    if (e.side == 1 and e.upper == np.inf) or (e.side == -1 and e.lower == -np.inf):
        e.side = 0


@lean
def _enter_spring(springs, ends, e, ramp, k):
    """Enter the spring before the contact of a row; k is the end of it at the contact before, -1 if there is none."""
    e.spring = e.run = -1
    e.trial = e.compliance = 0.0
    if k >= 0:
        end = ends[k]
        spring = springs[end.spring]
        e.spring, e.sign, e.compliance = end.spring, end.sign, spring.compliance
        if not ramp.falling:
            e.trial = -end.sign * spring.stiffness * spring.d_length
        if ramp.stepping:
            e.trial = ramp.part * e.trial + end.sign * spring.tension


@lean
def _leave_by(c, ends, came):
    """Find the end of a contact of at most two springs that is not that of the spring `came`; -1 if there is none."""
    for k in range(c.first, c.last):
        if ends[k].spring != came:
            return k
    return -1


@lean
def _find_path(contacts, springs, model, ramp, i):
    """Find the block around contact i if its springs form a path; returns the number of its contacts, else 0."""
    ends = model.ends
    start = contacts[i]
    if start.last - start.first > 2:
        return 0
    ramp.before = ramp.behind = -1
    here, came = i, ends[start.first].spring if start.last - start.first == 2 else -1
    k = _leave_by(start, ends, came)
    while k >= 0:  # to one end of the path
        o = contacts[ends[k].other]
        came = ends[k].spring
        if is_wall(o, ramp):
            ramp.before = ends[k].other
            break
        if o.last - o.first > 2 or ends[k].other == i:
            return 0
        here = ends[k].other
        k = _leave_by(o, ends, came)
    if k < 0:
        came = -1
    count = 0
    before = -1  # end of the next spring at the contact before
    if k >= 0:
        before = _end_at(contacts[ends[k].other], ends, came)
    while True:
        _enter_spring(springs, ends, model.block[count], ramp, before)
        _enter(contacts, model.block, ramp, count, here)
        count += 1
        before = _leave_by(contacts[here], ends, came)
        if before < 0:
            break
        came = ends[before].spring
        o = contacts[ends[before].other]
        if is_wall(o, ramp):
            ramp.behind = ends[before].other
            break
        if o.last - o.first > 2 or o.mark == ramp.block:
            return 0
        here = ends[before].other
    _enter_spring(springs, ends, model.block[count], ramp, before)
    ramp.path = count
    return count


@lean
def _find_stretch(contacts, springs, model, runs, ramp, i):
    """Find the block around contact i of a long chain, with a row for each sleeping run; returns the number of rows."""
    if runs is None:
        return 0
    n, first, last = contacts.shape[0], i, i
    while first > 0 and not is_wall(contacts[first - 1], ramp):
        k = find_run(runs, ramp, first - 1)
        first = runs[k].first if k >= 0 else first - 1
    while last < n - 1 and not is_wall(contacts[last + 1], ramp):
        k = find_run(runs, ramp, last + 1)
        last = runs[k].last if k >= 0 else last + 1
    if first == 0 and last == n - 1:  # nothing at rest determines the velocities of runs
        wake_all(contacts, springs, runs, ramp)
    ramp.before, ramp.behind = first - 1, last + 1 if last < n - 1 else -1
    count = 0
    while first <= last:
        e = model.block[count]
        k = find_run(runs, ramp, first)
        if k >= 0:
            enter_run(contacts, runs, e, k)
            first = runs[k].last + 1
        else:
            _enter_spring(springs, model.ends, e, ramp, contacts[first - 1].first if first > 0 else -1)
            _enter(contacts, model.block, ramp, count, first)
            first += 1
        count += 1
    _enter_spring(springs, model.ends, model.block[count], ramp, contacts[last].first if last < n - 1 else -1)
    ramp.path = last - ramp.before
    return count


@lean
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
def _find_mesh(contacts, model, ramp, i):
    """Find the block around contact i of a graph; returns the number of its contacts."""
    block, ends = model.block, model.ends
    contacts[i].mark = ramp.block
    block[0].contact = i
    count, read = 1, 0
    while read < count:
        c = contacts[block[read].contact]
        read += 1
        for k in range(c.first, c.last):
            o = contacts[ends[k].other]
            if o.mark != ramp.block and not is_wall(o, ramp):
                o.mark = ramp.block
                block[count].contact = ends[k].other
                count += 1
    _sort_rows(contacts, block, count)
    for row in range(count):
        _enter(contacts, block, ramp, row, block[row].contact)
    return count


@lean
def find_block(contacts, springs, model, ramp, i):
    """Enter in the block all contacts at their bounds that springs join to contact i without passing a wall.

    Args:
        contacts: CONTACT, shape (N,).
        springs: SPRING, shape (S,).
        model: a `Model`, whose block is written.
        ramp: the RAMP.
        i: the contact.

    Returns:
        The number of contacts.
    """
    ramp.block += 1
    ramp.path = 0
    count = _find_stretch(contacts, springs, model, model.runs, ramp, i)
    if count == 0:
        count = _find_path(contacts, springs, model, ramp, i)
    if count == 0:
        ramp.block += 1
        count = _find_mesh(contacts, model, ramp, i)
    return count


@lean
def _count_resting(contacts, block, count):
    """Count the contacts of the whole body at rest, and find the last of them; 2 if the block is not the whole body."""
    if count < contacts.shape[0]:
        return 2, -1
    resting, last = 0, -1
    for j in range(count):
        if block[j].side == 0:
            resting, last = resting + 1, j
    return resting, last


@lean
def _balance(block, count, row):
    """Find the force on the only contact at rest: forces of springs sum to zero, however they are rounded."""
    force = size = 0.0
    for j in range(count):
        if j != row:
            force -= limit_of(block[j])
            size += abs(limit_of(block[j])) + block[j].blur
    block[row].force, block[row].scale = force, size


@lean
def _find_brake(block, count, last_only):
    """Find the contact that stops where all would slide and nothing would hold the body, and whether friction balances.

    Forces of springs sum to zero. If the limits at which the contacts slide do not, the body would fly off, and one of
    those that slide the other way stops: the slowest or, by Murty's rule, the last. If they do, the translation is
    free, and any contact may stand for the reference of the velocities.
    """
    excess = size = 0.0
    for j in range(count):
        e = block[j]
        excess -= limit_of(e)
        size += abs(limit_of(e)) + e.blur
    balances = abs(excess) <= 64.0 * EPS * size
    brake, slowest = -1, np.inf
    for j in range(count):
        e = block[j]
        if (balances or e.side * excess < 0.0) and (last_only or abs(e.v) < slowest):
            brake, slowest = j, abs(e.v)
    return brake, balances


@lean
def _center(block, count):
    """Choose a free translation: the one nearest to no net velocity at which all contacts slide as their sides demand.

    If there is none, it is the one without net velocity, the limit of a body that weak springs tie to the ground.
    """
    mean = most = 0.0
    least, highest = -np.inf, np.inf
    for j in range(count):
        e = block[j]
        mean += e.v / count
        if e.side > 0:
            least = max(least, -e.v)
        else:
            highest = min(highest, -e.v)
    translation = min(max(-mean, least), highest) if least <= highest else -mean
    for j in range(count):
        block[j].v += translation
        most = max(most, abs(block[j].v))
    for j in range(count):
        if abs(block[j].v) <= 10.0 * NOISE * most:
            block[j].v = 0.0


@lean
def violation_of(e):
    """Find how a contact violates its condition.

    Args:
        e: a BLOCK, with the rates that its side leads to.

    Returns:
        The side that it must have instead: 0 if it slides against its bound, 1 or -1 if it rests with a force beyond
        the forward or the backward limit; its own if it violates nothing.
    """
    if e.run >= 0:  # else it would have woken
        return e.side
    if e.side != 0:
        return 0 if e.v * e.side < 0.0 else e.side
    close = ROUNDING * (e.scale + e.blur)
    if e.force > e.upper + close:
        return 1
    return -1 if e.force < e.lower - close else 0


@lean
def _exchange(block, count, last_only):
    """Count the contacts that violate their condition, and change the sides of all of them, or of the last one."""
    found, last, change = 0, -1, 0
    for j in range(count):
        side = violation_of(block[j])
        if side != block[j].side:
            found += 1
            last, change = j, side
            if not last_only:
                block[j].side = side
    if found > 0 and last_only:
        block[last].side = change
    return found


@lean
def _solve_sides(contacts, springs, model, ramp, count):
    """Solve for the rates of a block with given sides."""
    if ramp.path > 0:
        solve_path(model.block, count)
    else:
        solve_mesh(contacts, springs, model, count)


@lean
def find_sides(contacts, springs, model, ramp, count):
    """Find which contacts of the block slide, and the rates in it.

    Args:
        contacts: CONTACT, shape (N,).
        springs: SPRING, shape (S,).
        model: a `Model`, whose block is changed in place.
        ramp: the RAMP; `undetermined` is set if the whole body slides and friction balances.
        count: number of contacts of the block.

    Returns:
        False if no sides were found, or no equilibrium is left; or if runs woke, and the block has to be found anew.
    """
    block = model.block
    best, waited, last_only = count + 1, 0, False
    hurries = ramp.hurries != 0 and ramp.path == 0  # the search begins elsewhere if it takes long
    patience = _PATIENCE if hurries else _PATIENCE + count
    for j in range(count):
        block[j].v = contacts[block[j].contact].v
    ramp.undetermined = 0
    for turn in range(50 + 10 * count):
        ramp.effort += count
        if turn == (0 if ramp.stepping else _SOON) and ramp.path > 0:
            if wake_block(contacts, springs, block, model.runs, ramp, count):
                return False
            project(model, ramp, count)
        brake, balances, side = -1, False, 0
        resting, last = _count_resting(contacts, block, count)
        if resting == 0:
            brake, balances = _find_brake(block, count, last_only)
            if brake < 0:
                return False
            side = block[brake].side
            block[brake].side = 0
        _solve_sides(contacts, springs, model, ramp, count)
        if wake_turning(contacts, springs, block, model.runs, ramp, count):
            return False
        if resting == 1:
            _balance(block, count, last)
        if balances:
            block[brake].side = side
            _center(block, count)
            block[brake].force = limit_of(block[brake])
        found = _exchange(block, count, last_only)
        if found == 0:
            ramp.undetermined = balances
            return True
        last_only = False
        if found < best:
            best, waited = found, 0
        elif waited < patience:
            waited += 1
        elif hurries:
            return False
        else:
            last_only = True
    return False
