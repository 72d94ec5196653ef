"""One ramp of the commands, followed exactly or by a catch-up step, with its energy account and certificate.

Along a ramp the rest lengths and the friction go in straight lines from the values in force (s = 0) to the
commanded ones (s = 1). The solution is then piecewise linear in s.

`exact` follows it from event to event. Between events every contact is free (strictly inside its bounds, at
rest) or at a bound, and the rates of the tensions solve the projection of `chain_kernel` with infinite bounds
where a contact is free. An event is a free contact that reaches a bound. A free contact is a wall: an event
changes only the block of neighbouring contacts at their bounds around it, so only that block is solved again, and
links and contacts elsewhere are brought up to date when their turn comes. The status of a contact is data that
events change, never a comparison of rounded numbers; a contact that leaves its bound counts as free as soon as s
has grown.

`catch_up` projects once, with the friction of the ramp's end; the translation uses the ramp's mean friction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import chain_kernel
from ._compiled import compiled
from .chain_kernel import EPS, project
from .state import (
    ACTUATION,
    ACTUATION_REF,
    AMBIGUOUS,
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    COMPLEMENTARITY,
    COMPLIANCE,
    DISSIPATION,
    EVENTS,
    FORWARD,
    GAIN_LEAST,
    GAIN_MOST,
    GAINED,
    OVERSPENT,
    RESIDUAL,
    SHAPE,
    STIFFNESS,
    TENSION,
    TENSION_REF,
    VIOLATION,
    VISITED,
    WORK,
    X_REST,
    X,
    add_ramp,
    shift,
)
from .uniqueness import CRITICAL, choose_translation, is_wide, nearness

# Rows of the scratch floats.
(
    _RATE,
    _LINK_SINCE,
    _V,
    _SINCE,
    _NEXT,
    _ENTERED,  # the event that stands in the tournament
    _D_ACTUATION,
    _D_FORWARD,
    _D_BACKWARD,
    _TRIAL,
    _BACKWARD,
    _FORWARD,
    _GRAIN,
    _ZEROS,  # stay so
) = range(14)
_FLOAT_ROWS = 14
# Rows of the scratch bytes.
_SIDE, _LEAVING, _COMING, _MOVED = range(4)
_BYTE_ROWS = 4

_FEW_FREE, _FEW_CONTACTS = 2, 256
"""All contacts are looked at after an event when at most so many are free, where looking is no dearer than solving, or
when there are at most so many. For longer chains the visited margin is otherwise sampled at the ends of ramps."""

_STRETCH = 1e-6
"""A piece shorter than this part of its ramp is an isolated instant: that all contacts are at their bounds is seen with
a tolerance, so an instant looks as long as the slowest contact takes to cross it."""

_NOISE = 1e-14
"""A velocity below this part of the sum of the shape rates around it is rounding."""


class Scratch(NamedTuple):
    """Memory that ramps reuse; it holds nothing between them."""

    floats: np.ndarray
    bytes: np.ndarray
    tree: np.ndarray
    stacks: np.ndarray


def scratch(contacts: int) -> Scratch:
    """Make the scratch memory for a chain.

    Args:
        contacts: number of contacts N.

    Returns:
        The arrays that `follow` takes.
    """
    leaves = 1 << max(contacts - 1, 1).bit_length()
    return Scratch(
        np.zeros((_FLOAT_ROWS, contacts)),
        np.zeros((_BYTE_ROWS, contacts), np.int8),
        np.full(2 * leaves + contacts, -1, np.int64),
        chain_kernel.workspace(contacts),
    )


@compiled
def _sooner(next_event, a, b):
    """Choose of two contacts (or -1) the one with the earlier event."""
    if a < 0:
        return b
    if b < 0:
        return a
    return a if next_event[a] <= next_event[b] else b


@compiled
def _announce(tree, leaves, floats, i):
    """Restore the tournament where contact i's event changed."""
    if floats[_NEXT, i] == floats[_ENTERED, i]:
        return
    floats[_ENTERED, i] = floats[_NEXT, i]
    node = (leaves + i) >> 1
    while node >= 1:
        tree[node] = _sooner(floats[_NEXT], tree[2 * node], tree[2 * node + 1])
        node >>= 1


@compiled
def _shape_gain(tension, trial, compliance):
    """Compute by how much a link's shape changes when its tension comes out other than tried; rounding is none."""
    change = tension - trial
    return change * compliance if abs(change) > 16.0 * EPS * (abs(tension) + abs(trial)) else 0.0


@compiled
def _chain_velocities(shape_rate, side, velocity, first, last):
    """Integrate v_{i+1} = v_i + w_i over contacts first..last, at rest where `side` is 0 and beyond the range.

    Returns True where nothing fixes the translation: the range is the whole chain and no contact is at rest.
    """
    n = side.shape[0]
    anchor = first
    free_translation = False
    if first > 0:
        velocity[first] = shape_rate[first - 1] if side[first] != 0 else 0.0
    else:
        while anchor <= last and side[anchor] != 0:
            anchor += 1
        if anchor <= last:
            velocity[anchor] = 0.0
        elif last == n - 1:
            free_translation = True
            anchor = first
            velocity[first] = 0.0
        else:
            anchor = last
            velocity[last] = -shape_rate[last]
    size = 0.0
    for i in range(max(first - 1, 0), min(last, n - 2) + 1):
        size += abs(shape_rate[i])
    for i in range(anchor - 1, first - 1, -1):
        velocity[i] = velocity[i + 1] - shape_rate[i]
    for i in range(anchor + 1, last + 1):
        velocity[i] = velocity[i - 1] + shape_rate[i - 1] if side[i] != 0 else 0.0
    if not free_translation:
        for i in range(first, last + 1):
            v = velocity[i]
            if abs(v) <= _NOISE * size or (v * side[i] < 0.0 and abs(v) <= CRITICAL * size):
                velocity[i] = 0.0
    return free_translation


@compiled
def _slack(contacts, links, floats, s, i):
    """Compute the distances of contact i's force from its upper and lower bound at s."""
    n = contacts.shape[1]
    g = 0.0
    if i < n - 1:
        g += links[TENSION, i] + floats[_RATE, i] * (s - floats[_LINK_SINCE, i])
    if i > 0:
        g -= links[TENSION, i - 1] + floats[_RATE, i - 1] * (s - floats[_LINK_SINCE, i - 1])
    above = contacts[FORWARD, i] + s * floats[_D_FORWARD, i] - g
    below = contacts[BACKWARD, i] + s * floats[_D_BACKWARD, i] + g
    return above, below


@compiled
def _update(contacts, links, floats, account, s, first, last):
    """Bring contacts first..last and the links between and beside them from their last change up to s."""
    n = contacts.shape[1]
    tension = links[TENSION]
    work = 0.0
    for i in range(max(first - 1, 0), min(last, n - 2) + 1):
        ds = s - floats[_LINK_SINCE, i]
        if ds > 0.0:
            gain = floats[_RATE, i] * ds
            work -= (tension[i] + 0.5 * gain) * floats[_D_ACTUATION, i] * ds
            tension[i] += gain
        floats[_LINK_SINCE, i] = s
    dissipation = 0.0
    complementarity = account[COMPLEMENTARITY]
    violation = account[VIOLATION]
    for i in range(first, last + 1):
        ds = s - floats[_SINCE, i]
        v = floats[_V, i]
        if ds > 0.0 and v != 0.0:
            middle = 0.5 * (s + floats[_SINCE, i])
            g = (tension[i] if i < n - 1 else 0.0) - (tension[i - 1] if i > 0 else 0.0)
            above = contacts[FORWARD, i] + s * floats[_D_FORWARD, i] - g
            below = contacts[BACKWARD, i] + s * floats[_D_BACKWARD, i] + g
            if v > 0.0:
                dissipation += (contacts[FORWARD, i] + middle * floats[_D_FORWARD, i]) * v * ds
                gap = above
            else:
                dissipation -= (contacts[BACKWARD, i] + middle * floats[_D_BACKWARD, i]) * v * ds
                gap = below
            complementarity = max(complementarity, abs(v * gap))
            violation = max(violation, -min(above, below))
            shift(contacts, v, ds, i)
        floats[_SINCE, i] = s
    account[WORK] += work
    account[DISSIPATION] += dissipation
    account[COMPLEMENTARITY] = complementarity
    account[VIOLATION] = violation


@compiled
def _settle(status, floats, bytes_, s, i):
    """Let contact i go that left its bound before s."""
    if bytes_[_LEAVING, i] != 0 and floats[_SINCE, i] < s:
        status[i] &= ~bytes_[_LEAVING, i]
        bytes_[_LEAVING, i] = 0


@compiled
def _slide_together(compliance, status, floats, side, first, last):
    """Try whether contacts first..last, between two walls, all slide along their bounds.

    What meets all conditions of the projection is its solution. True then: rates, velocities and sides are written.
    """
    trial, rate, velocity = floats[_TRIAL], floats[_RATE], floats[_V]
    d_forward, d_backward = floats[_D_FORWARD], floats[_D_BACKWARD]
    rise = 0.0
    give = compliance[first - 1]
    pull = trial[first - 1] * give
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
        give += compliance[i]
        pull += (trial[i] - rise) * compliance[i]
    base = pull / give
    rate[first - 1] = base
    v = 0.0
    size = 0.0
    for i in range(first, last + 1):
        gain = _shape_gain(rate[i - 1], trial[i - 1], compliance[i - 1])
        v += gain
        size += abs(gain)
        if not v * side[i] > _NOISE * size:
            return False
        velocity[i] = v
        rate[i] += base
    return True


@compiled
def _solve(elasticity, contacts, links, status, floats, bytes_, stacks, account, s, first, last):
    """Find the rates of the block of contacts first..last at s, and the next event of each of them.

    The block ends at walls or at the ends of the chain. Returns True where the translation is free.
    """
    n = contacts.shape[1]
    start = max(first - 1, 0)
    stop = min(last + 1, n - 1)
    _update(contacts, links, floats, account, s, start, stop)
    stiffness, compliance = elasticity[STIFFNESS], elasticity[COMPLIANCE]
    rate, trial, velocity, side = floats[_RATE], floats[_TRIAL], floats[_V], bytes_[_SIDE]
    forward, backward, grain = floats[_FORWARD], floats[_BACKWARD], floats[_GRAIN]
    d_actuation, d_forward, d_backward = floats[_D_ACTUATION], floats[_D_FORWARD], floats[_D_BACKWARD]
    for i in range(start, stop):
        trial[i] = -stiffness[i] * d_actuation[i]
    free_translation = False
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
        if block == start or end == stop or not _slide_together(compliance, status, floats, side, block, end):
            left = max(block - 1, start)
            right = min(end + 1, stop)
            for i in range(left, right + 1):
                forward[i] = d_forward[i] if status[i] & AT_FORWARD else np.inf
                backward[i] = d_backward[i] if status[i] & AT_BACKWARD else np.inf
                if -backward[i] > forward[i]:  # both bounds met by rounding just before the friction vanishes
                    forward[i] = 0.5 * (forward[i] - backward[i])
                    backward[i] = -forward[i]
                changing = d_forward[i] != 0.0 or d_backward[i] != 0.0
                grain[i] = contacts[FORWARD, i] + contacts[BACKWARD, i] if changing else 0.0
            project(
                trial[left:right],
                compliance[left:right],
                backward[left : right + 1],
                forward[left : right + 1],
                grain[left : right + 1],
                rate[left:right],
                side[left : right + 1],
                stacks,
            )
            for i in range(left, right):
                grain[i] = _shape_gain(rate[i], trial[i], compliance[i])  # no longer needed: the links' gains
            free_translation = _chain_velocities(grain, side, velocity, block, end)
        block = end + 1
    moved = bytes_[_MOVED]
    for i in range(start, stop):
        moved[i] |= _shape_gain(rate[i], trial[i], compliance[i]) != 0.0
    leaving, coming, next_event = bytes_[_LEAVING], bytes_[_COMING], floats[_NEXT]
    for i in range(start, stop + 1):
        held = 0
        if side[i] != 0:
            held = AT_FORWARD if side[i] == 1 else AT_BACKWARD
            if status[i] == AT_FORWARD | AT_BACKWARD and d_forward[i] + d_backward[i] <= 0.0:
                held = AT_FORWARD | AT_BACKWARD
        if first <= i <= last:
            leaving[i] = status[i] & ~held
        if held != 0 and d_forward[i] + d_backward[i] >= 0.0:
            next_event[i] = np.inf  # it goes with its bound, and the other one does not come nearer
            continue
        climb = 0.0
        if i < n - 1:
            climb += rate[i]
        if i > 0:
            climb -= rate[i - 1]
        above, below = _slack(contacts, links, floats, s, i)
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
        next_event[i] = when
    return free_translation


@compiled
def _visited(contacts, links, floats, side, whole, s):
    """Compute the sum of all contacts' distances from their nearest bounds, and the sum of all bounds, at s."""
    near = 0.0
    for i in range(contacts.shape[1]):
        if side[i] == 0:
            above, below = _slack(contacts, links, floats, s, i)
            near += abs(min(above, below))
    return near, max(whole[0] + s * (whole[1] - whole[0]), 0.0)


@compiled
def _near_criticality(contacts, links, floats, side, account, whole, s):
    """Note how near all contacts are to sliding at once; tell whether it stays critical up to the ramp's end.

    A distance from the nearest bound is concave in s and never negative: what vanishes at two instants later on
    vanishes from here on. The ramp's ends are not among them: friction may be gone there. `whole` is the sum of all
    bounds at the ramp's beginning and at its end.
    """
    near, total = _visited(contacts, links, floats, side, whole, s)
    account[VISITED] = min(account[VISITED], near / total if total > 0.0 else 0.0)
    both = whole[0] + whole[1]
    if both == 0.0:
        return True
    if near > CRITICAL * both:
        return False
    some, total_some = _visited(contacts, links, floats, side, whole, s + (1.0 - s) / 3.0)
    more, total_more = _visited(contacts, links, floats, side, whole, s + (1.0 - s) / 1.5)
    close = 8.0 * EPS * both
    return some <= CRITICAL * total_some + close and more <= CRITICAL * total_more + close


@compiled
def _finish(elasticity, contacts, links, status, target, bytes_, account, energy):
    """Put the state onto the ramp's end, tensions of contacts at a bound exactly on it, and close the account.

    Returns the energy of the springs; `energy` is what it was before the ramp.
    """
    n = contacts.shape[1]
    stiffness = elasticity[STIFFNESS]
    forward = contacts[FORWARD]
    backward = contacts[BACKWARD]
    tension = links[TENSION]
    for i in range(n):
        forward[i] = target[n - 1 + i]
        backward[i] = target[2 * n - 1 + i]
    for i in range(n - 1):
        if not bytes_[_MOVED, i]:
            change = target[i] - links[ACTUATION_REF, i]
            tension[i] = links[TENSION_REF, i] - stiffness[i] * change
        elif status[i] != 0:
            bound = forward[i] if status[i] & AT_FORWARD else -backward[i]
            tension[i] = (tension[i - 1] if i > 0 else 0.0) + bound
    for i in range(n - 1, 0, -1):
        if status[i] == 0:
            break
        if bytes_[_MOVED, i - 1]:
            bound = forward[i] if status[i] & AT_FORWARD else -backward[i]
            tension[i - 1] = (tension[i] if i < n - 1 else 0.0) - bound
    stored = 0.0
    near = 0.0
    total = 0.0
    violation = account[VIOLATION]
    before = 0.0
    for i in range(n):
        after = tension[i] if i < n - 1 else 0.0
        if i < n - 1:
            links[ACTUATION, i] = target[i]
            stretch = after * elasticity[COMPLIANCE, i]
            if bytes_[_MOVED, i]:
                links[TENSION_REF, i] = after
                links[ACTUATION_REF, i] = target[i]
                links[SHAPE, i] = target[i] + stretch
            stored += 0.5 * after * stretch
        distance = min(forward[i] - (after - before), backward[i] + (after - before))
        violation = max(violation, -distance)
        near += max(distance, 0.0)
        total += forward[i] + backward[i]
        before = after
    account[VIOLATION] = violation
    account[VISITED] = min(account[VISITED], near / total if total > 0.0 else 0.0)
    account[RESIDUAL] = (stored - energy) + account[DISSIPATION] - account[WORK]
    return stored


@compiled
def _catch_up(elasticity, contacts, links, status, target, floats, bytes_, stacks, account, elements):
    """Go from the present state to `target` in one implicit step."""
    n = contacts.shape[1]
    stiffness = elasticity[STIFFNESS]
    tension = links[TENSION]
    forward = target[n - 1 : 2 * n - 1]
    backward = target[2 * n - 1 :]
    trial = floats[_TRIAL]
    new = floats[_RATE]
    side = bytes_[_SIDE]
    for i in range(n - 1):
        origin = links[TENSION_REF, i] - stiffness[i] * (links[ACTUATION, i] - links[ACTUATION_REF, i])
        if tension[i] == origin:
            trial[i] = links[TENSION_REF, i] - stiffness[i] * (target[i] - links[ACTUATION_REF, i])
        else:
            trial[i] = tension[i] - stiffness[i] * (target[i] - links[ACTUATION, i])
    project(trial[: n - 1], elasticity[COMPLIANCE], backward, forward, floats[_ZEROS], new[: n - 1], side, stacks)
    work = 0.0
    for i in range(n - 1):
        gain = _shape_gain(new[i], trial[i], elasticity[COMPLIANCE, i])
        bytes_[_MOVED, i] |= gain != 0.0
        work -= 0.5 * (tension[i] + new[i]) * (target[i] - links[ACTUATION, i])
        tension[i] = new[i]
        trial[i] = gain
    account[WORK] += work
    velocity = floats[_V]
    free_translation = _chain_velocities(trial, side, velocity, 0, n - 1)
    near = 0.0
    total = 0.0
    for i in range(n):
        if side[i] == 0:
            g = (tension[i] if i < n - 1 else 0.0) - (tension[i - 1] if i > 0 else 0.0)
            near += max(min(forward[i] - g, backward[i] + g), 0.0)
        total += forward[i] + backward[i]
    if free_translation or near <= CRITICAL * total:
        for i in range(n):
            floats[_FORWARD, i] = 0.5 * (contacts[FORWARD, i] + forward[i])
            floats[_BACKWARD, i] = 0.5 * (contacts[BACKWARD, i] + backward[i])
        least, most = choose_translation(velocity, floats[_FORWARD], floats[_BACKWARD], elements)
        if is_wide(least, most, velocity):
            account[AMBIGUOUS] = 1.0
            account[GAIN_LEAST] += least
            account[GAIN_MOST] += most
    dissipation = 0.0
    complementarity = account[COMPLEMENTARITY]
    for i in range(n):
        v = velocity[i]
        if v != 0.0:
            g = (tension[i] if i < n - 1 else 0.0) - (tension[i - 1] if i > 0 else 0.0)
            if v > 0.0:
                dissipation += 0.5 * (contacts[FORWARD, i] + forward[i]) * v
                gap = forward[i] - g
            else:
                dissipation -= 0.5 * (contacts[BACKWARD, i] + backward[i]) * v
                gap = backward[i] + g
            complementarity = max(complementarity, abs(v * gap))
            shift(contacts, v, 1.0, i)
        if side[i] == 0:
            status[i] = 0
        elif forward[i] + backward[i] == 0.0:
            status[i] = AT_FORWARD | AT_BACKWARD
        else:
            status[i] = AT_FORWARD if side[i] == 1 else AT_BACKWARD
    account[DISSIPATION] += dissipation
    account[COMPLEMENTARITY] = complementarity


@compiled
def _count_free(bytes_):
    """Count the contacts that are free or leave their bound."""
    free = 0
    for i in range(bytes_.shape[1]):
        if bytes_[_SIDE, i] == 0:
            free += 1
    return free


@compiled
def _exact(elasticity, contacts, links, status, target, floats, bytes_, tree, stacks, account, budget, elements):
    """Follow the straight ramp to `target` from event to event. Returns False when the budget was spent."""
    n = contacts.shape[1]
    leaves = 1
    while leaves < n:
        leaves *= 2
    hits = tree[2 * leaves :]
    whole = (0.0, 0.0)
    for i in range(n):
        floats[_RATE, i] = 0.0
        floats[_V, i] = 0.0
        floats[_LINK_SINCE, i] = 0.0
        floats[_SINCE, i] = 0.0
        floats[_D_ACTUATION, i] = target[i] - links[ACTUATION, i] if i < n - 1 else 0.0
        floats[_D_FORWARD, i] = target[n - 1 + i] - contacts[FORWARD, i]
        floats[_D_BACKWARD, i] = target[2 * n - 1 + i] - contacts[BACKWARD, i]
        whole = (
            whole[0] + contacts[FORWARD, i] + contacts[BACKWARD, i],
            whole[1] + target[n - 1 + i] + target[2 * n - 1 + i],
        )
        bytes_[_LEAVING, i] = 0
        tree[leaves + i] = i
    for i in range(leaves + n, 2 * leaves):
        tree[i] = -1

    s = 0.0
    free_translation = _solve(elasticity, contacts, links, status, floats, bytes_, stacks, account, 0.0, 0, n - 1)
    for i in range(n):
        floats[_ENTERED, i] = floats[_NEXT, i]
    for node in range(leaves - 1, 0, -1):
        tree[node] = _sooner(floats[_NEXT], tree[2 * node], tree[2 * node + 1])
    free = _count_free(bytes_)
    pieces = 1
    done = True
    while True:
        shifted = False
        least = 0.0
        most = 0.0
        first_hit = tree[1]
        when = floats[_NEXT, first_hit]
        ending = not when < 1.0
        until = 1.0 if ending else when
        look = free <= _FEW_FREE or n <= _FEW_CONTACTS
        critical = look and _near_criticality(contacts, links, floats, bytes_[_SIDE], account, whole, s)
        if critical or free_translation:
            # friction in the middle of the stretch: at its start it may have been zero
            middle = 0.5 * (s + until)
            _update(contacts, links, floats, account, s, 0, n - 1)
            for i in range(n):
                floats[_FORWARD, i] = contacts[FORWARD, i] + middle * floats[_D_FORWARD, i]
                floats[_BACKWARD, i] = contacts[BACKWARD, i] + middle * floats[_D_BACKWARD, i]
            least, most = choose_translation(floats[_V], floats[_FORWARD], floats[_BACKWARD], elements)
            shifted = True
        if shifted and until - s > _STRETCH and is_wide(least, most, floats[_V]):
            account[AMBIGUOUS] = 1.0
            account[GAIN_LEAST] += least * (until - s)
            account[GAIN_MOST] += most * (until - s)
        if ending:
            break
        if pieces > budget:
            done = False
            break
        if when > s:
            pieces += 1
        s = when

        count = 0
        while floats[_NEXT, first_hit] <= s:  # ties: all that arrive at once, then solve
            _settle(status, floats, bytes_, s, first_hit)
            status[first_hit] |= bytes_[_COMING, first_hit]
            floats[_NEXT, first_hit] = np.inf
            _announce(tree, leaves, floats, first_hit)
            hits[count] = first_hit
            count += 1
            first_hit = tree[1]
        solved_to = -1
        hits[:count].sort()
        for j in range(count):
            contact = hits[j]
            if contact <= solved_to:
                continue
            if shifted:
                first = 0
                last = n - 1
                for i in range(n):
                    _settle(status, floats, bytes_, s, i)
            else:
                first = contact
                while first > 0:
                    _settle(status, floats, bytes_, s, first - 1)
                    if status[first - 1] == 0:
                        break
                    first -= 1
                last = contact
                while last < n - 1:
                    _settle(status, floats, bytes_, s, last + 1)
                    if status[last + 1] == 0:
                        break
                    last += 1
            solved_to = last
            for i in range(first, last + 1):
                free -= bytes_[_SIDE, i] == 0
            free_translation = _solve(
                elasticity, contacts, links, status, floats, bytes_, stacks, account, s, first, last
            )
            for i in range(first, last + 1):
                free += bytes_[_SIDE, i] == 0
            for i in range(max(first - 1, 0), min(last + 1, n - 1) + 1):
                _announce(tree, leaves, floats, i)

    end = 1.0 if done else s
    _update(contacts, links, floats, account, end, 0, n - 1)
    for i in range(n):
        status[i] &= ~bytes_[_LEAVING, i]
        if not done:
            contacts[FORWARD, i] += s * floats[_D_FORWARD, i]
            contacts[BACKWARD, i] += s * floats[_D_BACKWARD, i]
            links[ACTUATION, i] += s * floats[_D_ACTUATION, i]
    account[EVENTS] += pieces
    return done


@compiled
def _is_in_force(contacts, links, target):
    """Tell whether `target` is where the crawler is."""
    n = contacts.shape[1]
    for i in range(n - 1):
        if target[i] != links[ACTUATION, i]:
            return False
    for i in range(n):
        if target[n - 1 + i] != contacts[FORWARD, i] or target[2 * n - 1 + i] != contacts[BACKWARD, i]:
            return False
    return True


@compiled
def follow(
    elasticity,
    contacts,
    links,
    status,
    targets,
    exact,
    budget,
    elements,
    floats,
    bytes_,
    tree,
    stacks,
    account,
    records,
):
    """Follow straight ramps to each of the targets in turn.

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (2, N - 1).
        contacts: rows X .. RELATIVE (unused here), shape (6, N), changed in place.
        links: rows SHAPE .. ACTUATION_REF, shape (5, N - 1), changed in place.
        status: bits AT_FORWARD and AT_BACKWARD, int8, shape (N,), changed in place.
        targets: L, mu_plus and mu_minus at each ramp's end, shape (V, 3 N - 1).
        exact: True to follow every event, False for one catch-up step a ramp.
        budget: most linear pieces of one ramp; beyond it the rest of that ramp is a catch-up step.
        elements: both contacts of each element of a segment, shape (P, 2).
        floats: from `scratch(N)`, as are the next three.
        bytes_: statuses within a ramp.
        tree: a tournament of the contacts' next events.
        stacks: for `project`.
        account: shape (11,), added to.
        records: displacement, its rest and tension after each ramp, shape (V, 3 N - 1) or (0, 3 N - 1) for none.
    """
    n = contacts.shape[1]
    ramp = np.zeros(account.shape[0])
    for i in range(n):
        contacts[GAINED, i] = 0.0
    energy = 0.0
    for i in range(n - 1):
        energy += 0.5 * links[TENSION, i] * links[TENSION, i] * elasticity[COMPLIANCE, i]
    for v in range(targets.shape[0]):
        target = targets[v]
        if not _is_in_force(contacts, links, target):
            bytes_[_MOVED] = 0
            ramp[:] = 0.0
            ramp[VISITED] = np.inf
            finished = exact and _exact(
                elasticity, contacts, links, status, target, floats, bytes_, tree, stacks, ramp, budget, elements
            )
            if not finished:
                if exact:
                    ramp[OVERSPENT] = 1.0
                else:
                    ramp[EVENTS] = 1.0
                _catch_up(elasticity, contacts, links, status, target, floats, bytes_, stacks, ramp, elements)
            energy = _finish(elasticity, contacts, links, status, target, bytes_, ramp, energy)
            add_ramp(account, ramp)
        if records.shape[0] > 0:
            for i in range(n):
                records[v, i] = contacts[X, i]
                records[v, n + i] = contacts[X_REST, i]
            for i in range(n - 1):
                records[v, 2 * n + i] = links[TENSION, i]
    if account[VISITED] == np.inf:  # nothing but holding
        force = floats[_TRIAL]
        for i in range(n):
            force[i] = (links[TENSION, i] if i < n - 1 else 0.0) - (links[TENSION, i - 1] if i > 0 else 0.0)
        account[VISITED] = nearness(force, contacts[FORWARD], contacts[BACKWARD])
