"""The rates of a block of contacts of a chain, and the next event of each contact."""

from __future__ import annotations

import numpy as np

from ...compiled import lean
from ...rounding import EPS, LATE, NOISE
from ..state import (
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    COMPLEMENTARITY,
    COMPLIANCE,
    DISSIPATION,
    FORWARD,
    STIFFNESS,
    TENSION,
    VIOLATION,
    WORK,
    shift,
)
from ..tournament import enter_event
from .memory import (
    ROW_BACKWARD,
    ROW_COMING,
    ROW_D_ACTUATION,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    ROW_FORWARD,
    ROW_GAIN,
    ROW_LEAVING,
    ROW_LINK_SINCE,
    ROW_MAGNITUDE,
    ROW_MOVED,
    ROW_NEXT,
    ROW_RATE,
    ROW_SIDE,
    ROW_SINCE,
    ROW_TRIAL,
    ROW_V,
)
from .projection import chain_velocities, project, shape_gain
from .wide import project_wide


@lean
def update_tournament(tree, leaves, floats, i):
    """Update the tournament after the next event of contact i has changed.

    Args:
        tree: from `tournament.begin_tournament`, changed in place.
        leaves: number of its leaves.
        floats: row ROW_NEXT.
        i: the contact.
    """
    enter_event(tree, leaves, floats[ROW_NEXT, i], i)


@lean
def settle(status, floats, bytes_, s, i):
    """Mark contact i as free if it left its bound before s.

    Args:
        status: bounds at which contacts are, changed in place.
        floats: row ROW_SINCE.
        bytes_: row ROW_LEAVING, changed in place.
        s: place on the ramp, 0 .. 1.
        i: the contact.
    """
    if bytes_[ROW_LEAVING, i] != 0 and floats[ROW_SINCE, i] < s:
        status[i] &= ~bytes_[ROW_LEAVING, i]
        bytes_[ROW_LEAVING, i] = 0


@lean
def link_before(contacts, links, i):
    """Find the link before a contact.

    Args:
        contacts: rows of the contacts, shape (6, N).
        links: rows of the links; as many as contacts in a ring, where the last link ends at the first contact.
        i: the contact.

    Returns:
        The link, -1 if there is none.
    """
    if i > 0 or links.shape[1] < contacts.shape[1]:
        return i - 1
    return links.shape[1] - 1


@lean
def slack(contacts, links, floats, s, i):
    """Compute the distances of a contact's force from its bounds.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: elongations and tensions at their last change.
        floats: rates, and the places since which they hold.
        s: place on the ramp, 0 .. 1.
        i: the contact.

    Returns:
        Distances from the upper and from the lower bound [N].
    """
    before = link_before(contacts, links, i)
    g = 0.0
    if i < links.shape[1]:
        g += links[TENSION, i] + floats[ROW_RATE, i] * (s - floats[ROW_LINK_SINCE, i])
    if before >= 0:
        g -= links[TENSION, before] + floats[ROW_RATE, before] * (s - floats[ROW_LINK_SINCE, before])
    above = contacts[FORWARD, i] + s * floats[ROW_D_FORWARD, i] - g
    below = contacts[BACKWARD, i] + s * floats[ROW_D_BACKWARD, i] + g
    return above, below


@lean
def advance_link(links, floats, s, i):
    """Update the tension of a link from its last change to s.

    Args:
        links: row TENSION is changed in place.
        floats: rates, and the places since which they hold.
        s: place on the ramp, 0 .. 1.
        i: the link.

    Returns:
        The work of its actuator since then [J].
    """
    ds = s - floats[ROW_LINK_SINCE, i]
    floats[ROW_LINK_SINCE, i] = s
    if not ds > 0.0:
        return 0.0
    before = links[TENSION, i]
    gain = floats[ROW_RATE, i] * ds
    links[TENSION, i] = before + gain
    return -(before + 0.5 * gain) * floats[ROW_D_ACTUATION, i] * ds


@lean
def update(contacts, links, floats, account, s, first, last):
    """Update contacts first..last and the links between and beside them from their last change to s.

    Args:
        contacts: rows of the contacts, as in `follow_events`, changed in place.
        links: elongations and tensions.
        floats: rates, and the places since which they hold.
        account: account of the ramp, added to.
        s: place on the ramp, 0 .. 1.
        first: the first contact.
        last: the last contact.
    """
    n = contacts.shape[1]
    tension = links[TENSION]
    work = 0.0
    if first == 0 and links.shape[1] == n:
        work += advance_link(links, floats, s, n - 1)
    for i in range(max(first - 1, 0), min(last, links.shape[1] - 1) + 1):
        work += advance_link(links, floats, s, i)
    dissipation = 0.0
    complementarity = account[COMPLEMENTARITY]
    violation = account[VIOLATION]
    for i in range(first, last + 1):
        ds = s - floats[ROW_SINCE, i]
        v = floats[ROW_V, i]
        if ds > 0.0 and v != 0.0:
            middle = 0.5 * (s + floats[ROW_SINCE, i])
            before = link_before(contacts, links, i)
            g = (tension[i] if i < links.shape[1] else 0.0) - (tension[before] if before >= 0 else 0.0)
            above = contacts[FORWARD, i] + s * floats[ROW_D_FORWARD, i] - g
            below = contacts[BACKWARD, i] + s * floats[ROW_D_BACKWARD, i] + g
            if v > 0.0:
                dissipation += (contacts[FORWARD, i] + middle * floats[ROW_D_FORWARD, i]) * v * ds
                gap = above
            else:
                dissipation -= (contacts[BACKWARD, i] + middle * floats[ROW_D_BACKWARD, i]) * v * ds
                gap = below
            complementarity = max(complementarity, abs(v * gap))
            violation = max(violation, -min(above, below))
            shift(contacts, v, ds, i, middle)
        floats[ROW_SINCE, i] = s
    account[WORK] += work
    account[DISSIPATION] += dissipation
    account[COMPLEMENTARITY] = complementarity
    account[VIOLATION] = violation


@lean
def _slide_together(compliance, status, floats, side, first, last):
    """Check whether contacts first..last, between two walls, all slide along their bounds.

    If so, the result satisfies all conditions of the projection; rates, velocities and sides are then written.
    """
    trial, rate, velocity = floats[ROW_TRIAL], floats[ROW_RATE], floats[ROW_V]
    d_forward, d_backward = floats[ROW_D_FORWARD], floats[ROW_D_BACKWARD]
    rise = 0.0
    block_compliance = compliance[first - 1]
    pull = trial[first - 1] * block_compliance
    for i in range(first, last + 1):
        if status[i] == AT_FORWARD:
            rise += d_forward[i]
            side[i] = 1
        elif status[i] == AT_BACKWARD:
            rise -= d_backward[i]
            side[i] = -1
        else:
            return False
        rate[i] = rise
        block_compliance += compliance[i]
        pull += (trial[i] - rise) * compliance[i]
    base = pull / block_compliance
    rate[first - 1] = base
    v = 0.0
    size = 0.0
    for i in range(first, last + 1):
        gain = shape_gain(rate[i - 1], trial[i - 1], compliance[i - 1])
        v += gain
        size += abs(gain)
        if not v * side[i] > NOISE * size:
            return False
        velocity[i] = v
        rate[i] += base
    return True


@lean
def find_event(contacts, links, status, floats, bytes_, s, i):
    """Find the next event of a contact that does not move with a bound.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: elongations and tensions at their last change.
        status: bounds at which contacts are.
        floats: rates, and the places since which they hold; the event is written.
        bytes_: the bound that the contact reaches is written.
        s: place on the ramp, 0 .. 1.
        i: the contact.
    """
    rate, d_forward, d_backward = floats[ROW_RATE], floats[ROW_D_FORWARD], floats[ROW_D_BACKWARD]
    coming = bytes_[ROW_COMING]
    before = link_before(contacts, links, i)
    climb = 0.0
    if i < links.shape[1]:
        climb += rate[i]
    if before >= 0:
        climb -= rate[before]
    above, below = slack(contacts, links, floats, s, i)
    when = np.inf
    closing = climb - d_forward[i]
    if closing > 0.0 and not status[i] & AT_FORWARD:
        when = s + max(above, 0.0) / closing
        coming[i] = AT_FORWARD
    closing = -climb - d_backward[i]
    if closing > 0.0 and not status[i] & AT_BACKWARD:
        other = s + max(below, 0.0) / closing
        if other < when:
            when = other
            coming[i] = AT_BACKWARD
    if LATE < when < 1.0:
        # if its force would exceed the bound by no more than rounding, it arrives at the end of the ramp
        excess = (closing if coming[i] == AT_BACKWARD else climb - d_forward[i]) * (1.0 - when)
        size = contacts[FORWARD, i] + contacts[BACKWARD, i] + abs(d_forward[i]) + abs(d_backward[i])
        for j in (before, i):
            if 0 <= j < links.shape[1]:
                size += abs(links[TENSION, j]) + abs(rate[j])
        if excess <= 8.0 * EPS * size:
            when = 1.0
    floats[ROW_NEXT, i] = when


@lean
def solve(elasticity, contacts, links, status, floats, bytes_, stacks, account, s, first, last, wide):
    """Solve for the rates of the block of contacts first..last at s, and find the next event of each contact.

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (2, N - 1).
        contacts: updated in place to s.
        links: likewise.
        status: bounds at which contacts are.
        floats: rates and next events are written.
        bytes_: sides and leaving contacts are written.
        stacks: memory for `project`.
        account: account of the ramp, added to.
        s: place on the ramp, 0 .. 1.
        first: the first contact of the block, next to a wall or at the end of the chain.
        last: the last contact, likewise.
        wide: True to use the projection in double-double arithmetic.

    Returns:
        True if the translation is free; the work: contacts solved plus breakpoints passed.
    """
    n = contacts.shape[1]
    start = max(first - 1, 0)
    stop = min(last + 1, n - 1)
    update(contacts, links, floats, account, s, start, stop)
    stiffness, compliance = elasticity[STIFFNESS], elasticity[COMPLIANCE]
    rate, trial, velocity, side = floats[ROW_RATE], floats[ROW_TRIAL], floats[ROW_V], bytes_[ROW_SIDE]
    forward, backward = floats[ROW_FORWARD], floats[ROW_BACKWARD]
    magnitude, gain = floats[ROW_MAGNITUDE], floats[ROW_GAIN]
    d_actuation, d_forward, d_backward = floats[ROW_D_ACTUATION], floats[ROW_D_FORWARD], floats[ROW_D_BACKWARD]
    for i in range(start, stop):
        trial[i] = -stiffness[i] * d_actuation[i]
    free_translation = False
    effort = stop - start + 1
    block = start
    while block <= stop:
        if status[block] == 0:
            side[block] = 0
            velocity[block] = 0.0
            if block < stop and status[block + 1] == 0:
                rate[block] = trial[block]
            block += 1
            continue
        end = block
        while end < stop and status[end + 1] != 0:
            end += 1
        if wide or block == start or end == stop or not _slide_together(compliance, status, floats, side, block, end):
            left = max(block - 1, start)
            right = min(end + 1, stop)
            for i in range(left, right + 1):
                forward[i] = d_forward[i] if status[i] & AT_FORWARD else np.inf
                backward[i] = d_backward[i] if status[i] & AT_BACKWARD else np.inf
                if -backward[i] > forward[i]:  # both bounds met by rounding just before the friction vanishes
                    forward[i] = 0.5 * (forward[i] - backward[i])
                    backward[i] = -forward[i]
                changing = d_forward[i] != 0.0 or d_backward[i] != 0.0
                magnitude[i] = contacts[FORWARD, i] + contacts[BACKWARD, i] if changing else 0.0
            trials, compliances, rates = trial[left:right], compliance[left:right], rate[left:right]
            lower, upper, blur = backward[left : right + 1], forward[left : right + 1], magnitude[left : right + 1]
            if wide:
                effort += project_wide(trials, compliances, lower, upper, blur, rates, side[left : right + 1])
            else:
                effort += project(trials, compliances, lower, upper, blur, rates, side[left : right + 1], stacks)
            effort += right - left
            for i in range(left, right):
                gain[i] = shape_gain(rate[i], trial[i], compliance[i])
            free_translation = chain_velocities(gain, side, velocity, block, end)
        block = end + 1
    moved = bytes_[ROW_MOVED]
    for i in range(start, stop):
        moved[i] |= shape_gain(rate[i], trial[i], compliance[i]) != 0.0
    leaving, next_event = bytes_[ROW_LEAVING], floats[ROW_NEXT]
    for i in range(start, stop + 1):
        held = 0
        if side[i] != 0:
            held = AT_FORWARD if side[i] == 1 else AT_BACKWARD
            if status[i] == AT_FORWARD | AT_BACKWARD and d_forward[i] + d_backward[i] <= 0.0:
                held = AT_FORWARD | AT_BACKWARD
        if first <= i <= last:
            leaving[i] = status[i] & ~held
        if held != 0 and d_forward[i] + d_backward[i] >= 0.0:
            next_event[i] = np.inf  # it moves with its bound, and the other bound does not approach
            continue
        find_event(contacts, links, status, floats, bytes_, s, i)
    return free_translation, effort
