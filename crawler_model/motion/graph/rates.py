"""The rates of a block of contacts of a graph, and the next event of each contact.

A contact strictly inside its bounds is at rest while it stays there: it is a wall. An event changes the rates only of
the block of contacts at their bounds that springs join to the contact of the event without passing a wall, of the
springs at them and of the forces on the walls around. Everything else is updated when it is next needed.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled, inlined, lean
from ...rounding import LATE
from ..state import (
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    COMPLEMENTARITY,
    DISSIPATION,
    FORWARD,
    RELATIVE,
    TENSION,
    WORK,
    shift,
)
from .margin import BLUR, round_spring
from .memory import (
    CHANGE,
    RATE,
    ROW_ARRIVAL,
    ROW_COMING,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    ROW_FORCE,
    ROW_FORCE_RATE,
    ROW_LEAVING,
    ROW_LOWER,
    ROW_SIDE,
    ROW_SINCE,
    ROW_UPPER,
    ROW_V,
    SPRING_SINCE,
    displace,
)

_SPREAD = 8
"""Positions per contact of a block above which it takes longer to visit all positions in between than to sort."""


@lean
def settle(status, floats, bytes_, s, i):
    """Mark contact i as inside the bound that it left before s.

    Args:
        status: bits of the contacts, changed in place.
        floats: places since which rates hold.
        bytes_: bounds that contacts leave, changed in place.
        s: place on the ramp, 0 .. 1.
        i: the contact.
    """
    if bytes_[ROW_LEAVING, i] != 0 and floats[ROW_SINCE, i] < s:
        status[i] &= ~bytes_[ROW_LEAVING, i]
        bytes_[ROW_LEAVING, i] = 0


@inlined
def advance_contact(contacts, floats, s, i):
    """Update the force on a contact and its displacement from its last change to s.

    Args:
        contacts: rows X .. RELATIVE, changed in place.
        floats: forces, velocities and rates, and the places since which they hold; changed in place.
        s: place on the ramp, 0 .. 1.
        i: the contact.

    Returns:
        The energy lost to friction since then [J]; the product of velocity and distance from the bound [J].
    """
    since = floats[ROW_SINCE, i]
    ds = s - since
    floats[ROW_SINCE, i] = s
    if not ds > 0.0:
        return 0.0, 0.0
    gain = floats[ROW_FORCE_RATE, i] * ds
    floats[ROW_FORCE, i] += gain
    v = floats[ROW_V, i]
    if v == 0.0:
        return 0.0, 0.0
    middle = 0.5 * (since + s)
    force = floats[ROW_FORCE, i] - 0.5 * gain
    if v > 0.0:
        bound = contacts[FORWARD, i] + middle * floats[ROW_D_FORWARD, i]
        lost = bound * v * ds
        gap = bound - force
    else:
        bound = contacts[BACKWARD, i] + middle * floats[ROW_D_BACKWARD, i]
        lost = -bound * v * ds
        gap = bound + force
    shift(contacts, v, ds, i, middle)
    contacts[RELATIVE, i] += v * ds
    return lost, abs(v * gap)


@lean
def advance_spring(links, changes, s, spring):
    """Update the tension of a spring from its last change to s.

    Args:
        links: row TENSION is changed in place.
        changes: rates, and the places since which they hold; changed in place.
        s: place on the ramp, 0 .. 1.
        spring: the spring.

    Returns:
        The work of its actuator since then [J].
    """
    ds = s - changes[SPRING_SINCE, spring]
    changes[SPRING_SINCE, spring] = s
    if not ds > 0.0:
        return 0.0
    gain = changes[RATE, spring] * ds
    before = links[TENSION, spring]
    links[TENSION, spring] = before + gain
    return -(before + 0.5 * gain) * changes[CHANGE, spring] * ds


@lean
def advance(contacts, links, status, floats, changes, bytes_, account, s):
    """Update all contacts and springs to s.

    Args:
        contacts: rows X .. RELATIVE, changed in place.
        links: row TENSION is changed in place.
        status: bits of the contacts, changed in place.
        floats: memory of the ramp, like the next two.
        changes: rates of the springs.
        bytes_: bounds that contacts leave.
        account: account of the ramp, added to.
        s: place on the ramp, 0 .. 1.
    """
    for spring in range(links.shape[1]):
        account[WORK] += advance_spring(links, changes, s, spring)
    for i in range(contacts.shape[1]):
        settle(status, floats, bytes_, s, i)
        lost, gap = advance_contact(contacts, floats, s, i)
        account[DISSIPATION] += lost
        account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], gap)


@compiled
def _sort(numbers):
    """Sort numbers in place."""
    numbers.sort()


@lean
def find_block(layout, status, floats, bytes_, marks, number, queue, places, s, contact):
    """Find the block of contacts at their bounds around a contact, and the walls around them.

    Args:
        layout: fields of the `Layout`.
        status: bits of the contacts; they are settled.
        floats: places since which rates hold.
        bytes_: bounds that contacts leave.
        marks: row 0: number of the last block that a contact is in; row 1: that it is next to; int, shape (2, N),
            changed in place.
        number: of the new block, larger than those of all others.
        queue: scratch memory, int, shape (N,).
        places: output: positions of its contacts and of the walls around, increasing, int, shape (N,).
        s: place on the ramp, 0 .. 1.
        contact: the contact, at a bound.

    Returns:
        How many positions there are.
    """
    order, place, starts, others, _ = layout[:5]
    queue[0] = contact
    marks[0, contact] = number
    places[0] = place[contact]
    lowest = place[contact]
    highest = lowest
    read = 0
    count = 1
    found = 1
    while read < count:
        i = queue[read]
        read += 1
        for k in range(starts[i], starts[i + 1]):
            j = others[k]
            if marks[0, j] == number or marks[1, j] == number:
                continue
            settle(status, floats, bytes_, s, j)
            places[found] = place[j]
            found += 1
            lowest = min(lowest, place[j])
            highest = max(highest, place[j])
            if status[j] != 0:
                marks[0, j] = number
                queue[count] = j
                count += 1
            else:
                marks[1, j] = number
    if highest - lowest > _SPREAD * found:
        _sort(places[:found])
        return found
    found = 0
    for p in range(lowest, highest + 1):
        if marks[0, order[p]] == number or marks[1, order[p]] == number:
            places[found] = p
            found += 1
    return found


@inlined
def find_arrival(ends, stiffness, layout, contacts, links, status, floats, changes, bytes_, s, i):
    """Find the bounds that a contact leaves at s, the rate of the force on it, and the bound that it reaches next.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: stiffness of the springs, shape (S,) [N/m].
        layout: fields of the `Layout`.
        contacts: rows X .. RELATIVE, shape (6, N).
        links: rows SHAPE .. ACTUATION_REF, shape (5, S).
        status: bits of the contacts.
        floats: memory of the ramp, with the force at s; the rate of the force and the event are written.
        changes: rates of the springs, which are known.
        bytes_: the sides are known; bounds that are approached and bounds that are left are written.
        s: place on the ramp, 0 .. 1.
        i: the contact.
    """
    held = 0
    if bytes_[ROW_SIDE, i] != 0:
        held = AT_FORWARD if bytes_[ROW_SIDE, i] == 1 else AT_BACKWARD
        if floats[ROW_UPPER, i] == floats[ROW_LOWER, i]:
            held = AT_FORWARD | AT_BACKWARD
    bytes_[ROW_LEAVING, i] = status[i] & ~held
    if held != 0 and floats[ROW_D_FORWARD, i] + floats[ROW_D_BACKWARD, i] >= 0.0:
        # it moves with its bound, and the other bound does not approach
        floats[ROW_FORCE_RATE, i] = floats[ROW_UPPER if bytes_[ROW_SIDE, i] == 1 else ROW_LOWER, i]
        floats[ROW_ARRIVAL, i] = np.inf
        bytes_[ROW_COMING, i] = 0
        return
    _, _, starts, others, springs = layout[:5]
    g = floats[ROW_FORCE, i]
    rate = 0.0
    for k in range(starts[i], starts[i + 1]):
        rate += changes[RATE, springs[k]] if ends[springs[k], 0] == i else -changes[RATE, springs[k]]
    floats[ROW_FORCE_RATE, i] = rate
    arrival = np.inf
    coming = 0
    forward, backward = floats[ROW_D_FORWARD, i], floats[ROW_D_BACKWARD, i]
    closing = 0.0
    if rate - forward > 0.0 and not status[i] & AT_FORWARD:
        closing = rate - forward
        arrival = s + max(contacts[FORWARD, i] + s * forward - g, 0.0) / closing
        coming = AT_FORWARD
    if -rate - backward > 0.0 and not status[i] & AT_BACKWARD:
        other = s + max(contacts[BACKWARD, i] + s * backward + g, 0.0) / (-rate - backward)
        if other < arrival:
            closing = -rate - backward
            arrival = other
            coming = AT_BACKWARD
    if LATE < arrival < 1.0:  # beyond the bound by no more than rounding at the end of the ramp: it arrives there
        blur = BLUR * (contacts[FORWARD, i] + contacts[BACKWARD, i] + abs(forward) + abs(backward))
        for k in range(starts[i], starts[i + 1]):
            blur += round_spring(stiffness, contacts, links, changes, springs[k], i, others[k])
        if closing * (1.0 - arrival) <= blur:
            arrival = 1.0
    floats[ROW_ARRIVAL, i] = arrival
    bytes_[ROW_COMING, i] = coming


@lean
def bound_rates(status, floats, i):
    """Set the bounds of the rate of the force on a contact: none where it is inside its bounds.

    Args:
        status: bits of the contacts.
        floats: rates of the bounds; rows ROW_UPPER and ROW_LOWER are written.
        i: the contact.
    """
    upper = floats[ROW_D_FORWARD, i] if status[i] & AT_FORWARD else np.inf
    lower = -floats[ROW_D_BACKWARD, i] if status[i] & AT_BACKWARD else -np.inf
    if lower > upper:  # both bounds met by rounding just before the friction vanishes
        upper = 0.5 * (lower + upper)
        lower = upper
    floats[ROW_UPPER, i] = upper
    floats[ROW_LOWER, i] = lower


@inlined
def _set_rates(ends, stiffness, layout, contacts, links, status, floats, changes, bytes_, account, places, s):
    """Set the rates of the springs at contacts that can slide, then the rates of forces and the next events."""
    order, _, starts, _, springs = layout[:5]
    for p in places:
        i = order[p]
        if status[i] == 0:
            continue
        for k in range(starts[i], starts[i + 1]):
            spring = springs[k]
            if ends[spring, 0] != i and status[ends[spring, 0]] != 0:
                continue  # it is updated from its other end
            account[WORK] += advance_spring(links, changes, s, spring)
            gain = floats[ROW_V, ends[spring, 1]] - floats[ROW_V, ends[spring, 0]]
            changes[RATE, spring] = stiffness[spring] * (gain - changes[CHANGE, spring])
    for p in places:
        find_arrival(ends, stiffness, layout, contacts, links, status, floats, changes, bytes_, s, order[p])


@lean
def solve(
    ends,
    stiffness,
    network,
    work,
    contacts,
    links,
    status,
    floats,
    changes,
    bytes_,
    account,
    rounds,
    budget,
    places,
    s,
):
    """Solve for the rates of a block at s, and find the next event of each of its contacts and of the walls around.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: stiffness of the springs, shape (S,) [N/m].
        network: layout and conductances of the `Network`.
        work: memory from `GraphMotion.scratch`.
        contacts: rows X .. RELATIVE, updated in place to s.
        links: rows SHAPE .. ACTUATION_REF, likewise.
        status: bits of the contacts.
        floats: memory of the ramp: the loads and their magnitudes are given; velocities, rates and events are written.
        changes: changes of the springs; rates are written.
        bytes_: sides, bounds that are approached and bounds that are left are written.
        account: account of the ramp, added to.
        rounds: upper limit of rounds of the active set.
        budget: upper limit of contacts solved, counted in every round, of which there is at least one.
        places: positions of the contacts of the block and of the walls around, int, shape (P,).
        s: place on the ramp, 0 .. 1.

    Returns:
        The verdict of `active_set.move`, and the contacts solved, counted in every round.
    """
    order = network[0][0]
    for p in places:
        i = order[p]
        lost, gap = advance_contact(contacts, floats, s, i)
        account[DISSIPATION] += lost
        account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], gap)
        bound_rates(status, floats, i)
        if floats[ROW_ARRIVAL, i] <= s:
            bytes_[ROW_SIDE, i] = 1 if bytes_[ROW_COMING, i] == AT_FORWARD else -1
        elif s > 0.0 and floats[ROW_V, i] == 0.0:
            bytes_[ROW_SIDE, i] = 0
    most = min(rounds, 1 + max(budget, 0) // places.shape[0])
    verdict, turns = displace(network, work, floats, bytes_, most, places)
    if verdict >= 0:
        _set_rates(ends, stiffness, network[0], contacts, links, status, floats, changes, bytes_, account, places, s)
    return verdict, turns * places.shape[0]
