"""Long sliding blocks of a chain, whose contacts are not touched while the block grows, shrinks, splits or merges.

While friction is constant, the tensions of all links of a block change at one rate, and velocities are lines over
tables (`turning`). An event then changes the few numbers of a block, not its contacts:

* The rate follows from the two walls at rest beside the block; it is 0 where the block reaches an end of the chain.
* Contacts that turn round are found by a tree of bounds. The worst one stops and becomes a wall, then both parts are
  searched again. If that does not lead to a solution, the projection solves the whole block as if it were short.
* Tensions are followed at the two links to the walls. Others follow from the bounds of the contacts in between.
* Displacements follow at the end of the ramp. A block that lived for ds with its anchor at a adds to each of its
  contacts P_i ds + Q_i rate ds - (P_a + rate Q_a) ds: three numbers that are the same for all of them, added at its
  first contact and subtracted behind its last. All are sums of two floats, because their differences are small.
* Work needs the integral of each tension, which is T t at the end of its time in a block less T t at the start, less
  the integral of t times the rate: one sum for each link and one for each block.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled
from ...rounding import CRITICAL, EPS
from ..state import (
    AT_FORWARD,
    BACKWARD,
    COMPLEMENTARITY,
    DISSIPATION,
    FORWARD,
    STIFFNESS,
    TENSION,
    VIOLATION,
    WORK,
    shift,
)
from .memory import (
    COARSE,
    LEAF,
    MOST_TURNS,
    ROW_D_ACTUATION,
    ROW_LEAVING,
    ROW_LINK_SINCE,
    ROW_MOVED,
    ROW_NEXT,
    ROW_RATE,
    ROW_SIDE,
    ROW_SINCE,
    ROW_V,
)
from .rates import advance_link, find_event, update
from .tournament import update_tournament
from .turning import P_LOW, Q_LOW, SIZE, P, Q, difference, find_turning, forget, tabulate, velocity_at
from .wide import add, multiply, subtract

_TIME, _RATED, _ANCHORED = range(0, 6, 2)
"""Columns of the sums for displacements, two floats each: ds, rate ds, (P_a + rate Q_a) ds."""
_RATE, _SINCE, _SETTLED = range(3)
"""Rows of the numbers of blocks, stored at their first contact: rate, and place since which it holds; and of contacts:
displacement whose dissipation is in the account."""


@compiled
def begin_long(compliance, floats, long):
    """Prepare a ramp with long blocks; there are none yet.

    Args:
        compliance: 1 / k, shape (N - 1,) [m/N].
        floats: row ROW_D_ACTUATION [m per unit of the ramp].
        long: memory from `memory.scratch`, changed in place.
    """
    tabulate(compliance, floats, long.tables, long.nodes)
    long.sums[:] = 0.0
    long.coarse[:] = 0.0
    long.forces[:] = 0.0
    long.numbers[_SETTLED] = 0.0
    long.ends[:] = -1
    long.slid[:] = 0


@compiled
def _bound(contacts, side, i):
    """Return the force of a contact that slides."""
    return contacts[FORWARD, i] if side[i] > 0 else -contacts[BACKWARD, i]


@compiled
def _add_to(sums, i, column, term):
    total = add((sums[i, column], sums[i, column + 1]), term)
    sums[i, column] = total[0]
    sums[i, column + 1] = total[1]


@compiled
def _displacement(tables, total, i):
    """Compute the displacement of a contact from the sums for displacements over all contacts up to it."""
    at = multiply((tables[P, i], tables[P_LOW, i]), (total[_TIME], total[_TIME + 1]))
    turned = multiply((tables[Q, i], tables[Q_LOW, i]), (total[_RATED], total[_RATED + 1]))
    moved = subtract(add(at, turned), (total[_ANCHORED], total[_ANCHORED + 1]))
    return moved[0] + moved[1]


@compiled
def _displacement_so_far(long, i):
    """Compute the displacement of a contact within long blocks so far, in O(sqrt(N))."""
    total = np.zeros(6)
    for block in range(i // COARSE):
        for column in range(0, 6, 2):
            term = (total[column], total[column + 1])
            term = add(term, (long.coarse[block, column], long.coarse[block, column + 1]))
            total[column], total[column + 1] = term
    for j in range(i // COARSE * COARSE, i + 1):
        for column in range(0, 6, 2):
            term = add((total[column], total[column + 1]), (long.sums[j, column], long.sums[j, column + 1]))
            total[column], total[column + 1] = term
    return _displacement(long.tables, total, i)


@compiled
def _settle_dissipation(contacts, account, long, i, displacement):
    """Add to the account what contact i dissipated since the last time."""
    moved = displacement - long.numbers[_SETTLED, i]
    account[DISSIPATION] += _bound(contacts, long.slid, i) * moved
    long.numbers[_SETTLED, i] = displacement


@compiled
def _anchor(first, last):
    """Return a wall beside a block."""
    return first - 1 if first > 0 else last + 1


@compiled
def _close(contacts, links, floats, account, long, first, s):
    """Account for a block up to s, and update its links to the walls."""
    last = long.ends[first]
    n = contacts.shape[1]
    since = long.numbers[_SINCE, first]
    ds = s - since
    if ds > 0.0:
        tables = long.tables
        rate = long.numbers[_RATE, first]
        a = _anchor(first, last)
        rated = multiply((rate, 0.0), (ds, 0.0))
        at = multiply((tables[P, a], tables[P_LOW, a]), (ds, 0.0))
        anchored = add(at, multiply((tables[Q, a], tables[Q_LOW, a]), rated))
        for i in (first, last + 1):
            if i < n:
                sign = 1.0 if i == first else -1.0
                for row, j in ((long.sums, i), (long.coarse, i // COARSE)):
                    _add_to(row, j, _TIME, (sign * ds, 0.0))
                    _add_to(row, j, _RATED, (sign * rated[0], sign * rated[1]))
                    _add_to(row, j, _ANCHORED, (sign * anchored[0], sign * anchored[1]))
        account[WORK] += difference(tables, P, first, last) * rate * ds * (0.5 * (s + since))
        long.numbers[_SINCE, first] = s
    if first > 0:
        account[WORK] += advance_link(links, floats, s, first - 1)
    if last < n - 1:
        account[WORK] += advance_link(links, floats, s, last)


@compiled
def _enter(contacts, status, floats, bytes_, tree, leaves, account, long, i):
    """Let contact i, updated to s, slide in a long block; returns 1 if it was free or leaving."""
    side = bytes_[ROW_SIDE]
    was_free = side[i] == 0
    side[i] = 1 if status[i] & AT_FORWARD else -1
    bytes_[ROW_LEAVING, i] = 0
    floats[ROW_NEXT, i] = np.inf
    update_tournament(tree, leaves, floats, i)
    long.forces[i // LEAF] += _bound(contacts, side, i)
    forget(long.nodes, i)
    if long.slid[i] != side[i]:
        if long.slid[i] != 0:
            _settle_dissipation(contacts, account, long, i, _displacement_so_far(long, i))
        long.slid[i] = side[i]
    return 1 if was_free else 0


@compiled
def _leave_link(links, floats, bytes_, account, s, j, tension):
    """Set the tension of a link that was inside a long block up to s."""
    links[TENSION, j] = tension
    floats[ROW_LINK_SINCE, j] = s
    account[WORK] -= floats[ROW_D_ACTUATION, j] * tension * s
    bytes_[ROW_MOVED, j] = 1


@compiled
def _sum_forces(contacts, side, forces, a, b):
    """Sum the forces of the sliding contacts a..b."""
    total = 0.0
    i = a
    while i <= b and i % LEAF != 0:
        total += _bound(contacts, side, i)
        i += 1
    while i + LEAF <= b + 1:
        total += forces[i // LEAF]
        i += LEAF
    while i <= b:
        total += _bound(contacts, side, i)
        i += 1
    return total


@compiled
def _stop(contacts, links, floats, bytes_, account, long, s, first, last, j):
    """Stop a contact of the block first..last, closed at s: it becomes a wall that leaves its bound."""
    n = contacts.shape[1]
    side = bytes_[ROW_SIDE]
    force = _bound(contacts, side, j)
    if j - first < last - j:
        before = links[TENSION, first - 1] if first > 0 else 0.0
        after = before + _sum_forces(contacts, side, long.forces, first, j)
    else:
        after = links[TENSION, last] if last < n - 1 else 0.0
        after -= _sum_forces(contacts, side, long.forces, j + 1, last)
    if j > first:
        _leave_link(links, floats, bytes_, account, s, j - 1, after - force)
    if j < last:
        _leave_link(links, floats, bytes_, account, s, j, after)
    long.forces[j // LEAF] -= force
    side[j] = 0
    floats[ROW_V, j] = 0.0
    floats[ROW_SINCE, j] = s


@compiled
def _release(contacts, links, floats, bytes_, account, long, s, first, last, known):
    """Compute tensions in a block, closed at s, so that it becomes a short block; rates and velocities if known."""
    n = contacts.shape[1]
    side = bytes_[ROW_SIDE]
    rate = long.numbers[_RATE, first]
    anchor = _anchor(first, last)
    tension = links[TENSION, first - 1] if first > 0 else 0.0
    v = 0.0
    for i in range(first, last + 1):
        force = _bound(contacts, side, i)
        long.forces[i // LEAF] -= force
        tension += force
        if known:
            v = velocity_at(long.tables, anchor, rate, i)
        floats[ROW_V, i] = v
        floats[ROW_SINCE, i] = s
        if i < last:
            floats[ROW_RATE, i] = rate
            _leave_link(links, floats, bytes_, account, s, i, tension)
    gap = abs((links[TENSION, last] if last < n - 1 else 0.0) - tension)
    account[VIOLATION] = max(account[VIOLATION], gap)
    account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], abs(v * gap))
    long.ends[first] = -1
    long.ends[last] = -1


@compiled
def release_long(contacts, links, floats, bytes_, account, long, s):
    """Turn all long blocks into short ones.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: tensions, changed in place.
        floats: rates, velocities, and the places since which they hold, changed in place.
        bytes_: sides and moved links.
        account: account of the ramp, added to.
        long: memory from `memory.scratch`, changed in place.
        s: place on the ramp, 0 .. 1.
    """
    n = contacts.shape[1]
    i = 0
    while i < n:
        last = long.ends[i]
        if last >= 0:
            _close(contacts, links, floats, account, long, i, s)
            _release(contacts, links, floats, bytes_, account, long, s, i, last, True)
            i = last
        i += 1


@compiled
def finish_long(contacts, account, long):
    """Move the contacts by what they slid in long blocks, all of which have become short, and add the dissipation.

    Args:
        contacts: rows of the contacts, as in `follow_events`, changed in place.
        account: account of the ramp, added to.
        long: memory from `memory.scratch`.
    """
    total = np.zeros(6)
    for i in range(contacts.shape[1]):
        for column in range(0, 6, 2):
            term = add((total[column], total[column + 1]), (long.sums[i, column], long.sums[i, column + 1]))
            total[column], total[column + 1] = term
        if long.slid[i] != 0:
            displacement = _displacement(long.tables, total, i)
            _settle_dissipation(contacts, account, long, i, displacement)
            shift(contacts, displacement, 1.0, i, 0.5)


@compiled
def _gather(contacts, links, status, floats, bytes_, tree, leaves, account, long, s, first, last):
    """Update all contacts first..last that are not in long blocks to s, and close the long blocks among them.

    Returns how many were not in a long block, and how many of these were free.
    """
    entered = 0
    freed = 0
    i = first
    while i <= last:
        end = long.ends[i]
        if end >= 0:
            _close(contacts, links, floats, account, long, i, s)
            long.ends[i] = -1
            long.ends[end] = -1
        else:
            end = i
            while end < last and long.ends[end + 1] < 0:
                end += 1
            update(contacts, links, floats, account, s, i, end)
            for j in range(i, end + 1):
                freed += _enter(contacts, status, floats, bytes_, tree, leaves, account, long, j)
            for j in range(max(i - 1, first), min(end, last - 1) + 1):
                account[WORK] += floats[ROW_D_ACTUATION, j] * links[TENSION, j] * s
            entered += end - i + 1
        i = end + 1
    return entered, freed


@compiled
def _give_up(contacts, links, floats, bytes_, account, long, s, first, last):
    """Turn all contacts first..last into short blocks at s, with rates that are not known."""
    side = bytes_[ROW_SIDE]
    a = first
    while a <= last:
        b = a
        if side[a] != 0:
            while b < last and side[b + 1] != 0:
                b += 1
            _release(contacts, links, floats, bytes_, account, long, s, a, b, False)
        a = b + 1


@compiled
def _find_events(contacts, links, status, floats, bytes_, tree, leaves, long, stops, s, first, last):
    """Find the next events of the walls beside and in first..last.

    Returns False if a contact that stopped would be driven beyond its bound.
    """
    n = contacts.shape[1]
    for k in range(stops):
        j = long.stopped[k]
        right = floats[ROW_RATE, j] if j < n - 1 else 0.0
        left = floats[ROW_RATE, j - 1] if j > 0 else 0.0
        outwards = right - left if status[j] & AT_FORWARD else left - right
        if outwards > 16.0 * EPS * (abs(right) + abs(left)):
            return False
        find_event(contacts, links, status, floats, bytes_, s, j)
        update_tournament(tree, leaves, floats, j)
    if first > 0:
        find_event(contacts, links, status, floats, bytes_, s, first - 1)
        update_tournament(tree, leaves, floats, first - 1)
    if last < n - 1:
        find_event(contacts, links, status, floats, bytes_, s, last + 1)
        update_tournament(tree, leaves, floats, last + 1)
    return True


@compiled
def solve_long(
    elasticity, contacts, links, status, floats, bytes_, tree, leaves, account, long, s, first, last, contact
):
    """Solve for the rates of the contacts first..last at s, all at their bounds, as long blocks.

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (2, N - 1).
        contacts: updated in place to s where they were not in long blocks.
        links: likewise.
        status: bounds at which contacts are.
        floats: rates and next events are written.
        bytes_: sides and leaving contacts are written.
        tree: tournament of the next events, changed in place.
        leaves: number of its leaves.
        account: account of the ramp, added to.
        long: memory from `memory.scratch`, changed in place.
        s: place on the ramp, 0 .. 1.
        first: the first contact, next to a wall or at the end of the chain.
        last: the last contact, likewise.
        contact: one that has reached its bound at s.

    Returns:
        Whether it succeeded; if not, all blocks have become short, and their rates are not known. Then by how much the
        number of free contacts grew, and the work, in contacts.
    """
    n = contacts.shape[1]
    side = bytes_[ROW_SIDE]
    tables, numbers, parts = long.tables, long.numbers, long.parts
    effort, freed = _gather(contacts, links, status, floats, bytes_, tree, leaves, account, long, s, first, last)
    stops = 0
    todo = 1
    parts[0, 0] = first
    parts[0, 1] = last
    solved = first > 0 or last < n - 1
    while todo > 0 and solved:
        todo -= 1
        a = parts[todo, 0]
        b = parts[todo, 1]
        if b < a:  # the link between two walls
            floats[ROW_RATE, b] = -elasticity[STIFFNESS, b] * floats[ROW_D_ACTUATION, b]
            continue
        rate = 0.0
        if a > 0 and b < n - 1:
            rate = -difference(tables, P, a - 1, b + 1) / difference(tables, Q, a - 1, b + 1)
        anchor = _anchor(a, b)
        low = max(a - 1, 0)
        high = min(b + 1, n - 1)
        size = tables[SIZE, high] - tables[SIZE, low] + abs(rate) * difference(tables, Q, low, high)
        turning = -1
        worst = CRITICAL * size
        for i in (a, b, contact - 1, contact + 1):  # likely ones first
            if a <= i <= b and -side[i] * velocity_at(tables, anchor, rate, i) > worst:
                worst = -side[i] * velocity_at(tables, anchor, rate, i)
                turning = i
        if turning < 0:
            turning, looked = find_turning(tables, long.nodes, long.order, side, anchor, rate, a, b, CRITICAL * size)
            effort += looked
        if turning >= 0:
            solved = stops < MOST_TURNS
            if solved:
                _stop(contacts, links, floats, bytes_, account, long, s, a, b, turning)
                long.stopped[stops] = turning
                stops += 1
                if turning > 0:
                    parts[todo, 0] = a
                    parts[todo, 1] = turning - 1
                    todo += 1
                if turning < n - 1:
                    parts[todo, 0] = turning + 1
                    parts[todo, 1] = b
                    todo += 1
            continue
        for wall in (a - 1, b):
            if 0 <= wall < n - 1:
                floats[ROW_RATE, wall] = rate
                bytes_[ROW_MOVED, wall] = 1
        numbers[_RATE, a] = rate
        numbers[_SINCE, a] = s
        long.ends[a] = b
        long.ends[b] = a
    for k in range(stops):
        bytes_[ROW_LEAVING, long.stopped[k]] = status[long.stopped[k]]
    if solved:
        solved = _find_events(contacts, links, status, floats, bytes_, tree, leaves, long, stops, s, first, last)
    if not solved:
        _give_up(contacts, links, floats, bytes_, account, long, s, first, last)
        return False, stops - freed, effort
    a = first
    while a <= last:
        b = long.ends[a]
        if 0 <= b < a - 1 + long.shortest // 2:
            _release(contacts, links, floats, bytes_, account, long, s, a, b, True)
        a = max(a, b) + 1
    return True, stops - freed, effort
