"""One ramp of the commands on a body of any connected springs: exact, event to event, or a catch-up step.

As `chain_tick`, with the rates of all contacts solved at every event by `graph_kernel`. What is integrated is the
displacement; the tensions follow from it, and at the end of a ramp the contacts that slide are put exactly onto their
bounds, so that no error adds up from ramp to ramp.
"""

from __future__ import annotations

import numpy as np

from ._compiled import compiled
from .graph_kernel import EPS, eliminate, move
from .state import (
    ACTUATION,
    AMBIGUOUS,
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    COMPLEMENTARITY,
    DISSIPATION,
    EVENTS,
    FORWARD,
    GAIN_LEAST,
    GAIN_MOST,
    GAINED,
    OVERSPENT,
    RELATIVE,
    RESIDUAL,
    SHAPE,
    TENSION,
    VIOLATION,
    VISITED,
    WORK,
    X_REST,
    X,
    add_ramp,
    shift,
)
from .uniqueness import CRITICAL, choose_translation, is_wide, nearness

_STRETCH = 1e-6
"""A piece shorter than this part of its ramp is an isolated instant, see `chain_tick`."""

_INSTANT = 1e-12
"""At the end of a ramp on which all friction vanishes there may be no rate, but there is no time left either."""

# Rows of the scratch floats.
_D_FORWARD, _D_BACKWARD, _V, _FORCE, _FORCE_RATE, _LOAD, _LOWER, _UPPER, _GRAIN, _GUESS, _MIDDLE, _MIDDLE_B = range(12)
_FLOAT_ROWS = 12


def scratch(contacts: int, springs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Make the scratch memory for a graph.

    Args:
        contacts: number of contacts N.
        springs: number of springs S.

    Returns:
        Floats of the contacts, floats of the springs, and flags of the contacts, as `follow` takes them.
    """
    return np.zeros((_FLOAT_ROWS, contacts)), np.zeros((2, springs)), np.zeros((3, contacts), np.int8)


@compiled
def _forces(ends, tension, force):
    """Compute the force of the springs on each contact."""
    for i in range(force.shape[0]):
        force[i] = 0.0
    for s in range(ends.shape[0]):
        force[ends[s, 0]] += tension[s]
        force[ends[s, 1]] -= tension[s]


@compiled
def _set_tensions(ends, stiffness, contacts, links):
    """Compute z and T of all springs from where the contacts stand."""
    for s in range(ends.shape[0]):
        z = contacts[RELATIVE, ends[s, 1]] - contacts[RELATIVE, ends[s, 0]]
        links[SHAPE, s] = z
        links[TENSION, s] = stiffness[s] * (z - links[ACTUATION, s])


@compiled
def _rebase(contacts):
    """Keep relative displacements small; the shift is a power of two and takes no digits from them."""
    n = contacts.shape[1]
    least = contacts[RELATIVE].min()
    most = contacts[RELATIVE].max()
    nearest = least if least > 0.0 else (most if most < 0.0 else 0.0)
    if abs(nearest) <= 4.0 * (most - least) or nearest == 0.0:
        return
    away = 2.0 ** np.floor(np.log2(abs(nearest)))
    for i in range(n):
        contacts[RELATIVE, i] -= away if nearest > 0.0 else -away


@compiled
def _load(ends, stiffness, change, load, grain):
    """Compute the force on each contact when the springs' rest lengths change, and its numbers' size."""
    for s in range(ends.shape[0]):
        pull = stiffness[s] * change[s]
        load[ends[s, 0]] -= pull
        load[ends[s, 1]] += pull
        grain[ends[s, 0]] += abs(pull)
        grain[ends[s, 1]] += abs(pull)


@compiled
def _move(network, stiffness_work, floats, bytes_, rounds):
    """Call `move` with the contacts in the order of the band; lower, upper, load and grain are rows of floats."""
    order, band = network
    work, kernel_floats, sliding = stiffness_work
    n = order.shape[0]
    load, lower, upper, grain, v = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    side = np.empty(n, np.int8)
    for p in range(n):
        i = order[p]
        load[p], lower[p], upper[p] = floats[_LOAD, i], floats[_LOWER, i], floats[_UPPER, i]
        grain[p], v[p] = floats[_GRAIN, i], floats[_GUESS, i]
    verdict = move(band, load, lower, upper, grain, rounds, work, kernel_floats, sliding, v, side)
    for p in range(n):
        floats[_V, order[p]] = v[p]
        bytes_[0, order[p]] = side[p]
    return verdict


@compiled
def _nearness(floats, contacts, s, ds):
    """Compute the sum of all contacts' distances from their nearest bounds, and of all bounds, at s + ds."""
    near = 0.0
    total = 0.0
    for i in range(contacts.shape[1]):
        g = floats[_FORCE, i] + ds * floats[_FORCE_RATE, i]
        above = contacts[FORWARD, i] + (s + ds) * floats[_D_FORWARD, i] - g
        below = contacts[BACKWARD, i] + (s + ds) * floats[_D_BACKWARD, i] + g
        near += abs(min(above, below))
        total += max(above + below, 0.0)
    return near, total


@compiled
def _exact(
    ends,
    stiffness,
    network,
    work,
    contacts,
    links,
    status,
    target,
    floats,
    changes,
    bytes_,
    account,
    budget,
    rounds,
    elements,
):
    """Follow the straight ramp to `target` from event to event. Returns how far it came, 1 for all the way."""
    n = contacts.shape[1]
    springs = ends.shape[0]
    change = changes[0]
    whole = 0.0
    for s in range(springs):
        change[s] = target[s] - links[ACTUATION, s]
    for i in range(n):
        floats[_D_FORWARD, i] = target[springs + i] - contacts[FORWARD, i]
        floats[_D_BACKWARD, i] = target[springs + n + i] - contacts[BACKWARD, i]
        whole += contacts[FORWARD, i] + contacts[BACKWARD, i] + target[springs + i] + target[springs + n + i]
        floats[_GUESS, i] = 0.0
    _forces(ends, links[TENSION], floats[_FORCE])
    at = 0.0
    pieces = 0
    while True:
        for i in range(n):
            upper = floats[_D_FORWARD, i] if status[i] & AT_FORWARD else np.inf
            lower = -floats[_D_BACKWARD, i] if status[i] & AT_BACKWARD else -np.inf
            if lower > upper:  # both bounds met by rounding just before the friction vanishes
                upper = 0.5 * (lower + upper)
                lower = upper
            floats[_UPPER, i] = upper
            floats[_LOWER, i] = lower
            changing = floats[_D_FORWARD, i] != 0.0 or floats[_D_BACKWARD, i] != 0.0
            floats[_GRAIN, i] = contacts[FORWARD, i] + contacts[BACKWARD, i] if changing else 0.0
            floats[_LOAD, i] = 0.0
        _load(ends, stiffness, change, floats[_LOAD], floats[_GRAIN])
        verdict = _move(network, work, floats, bytes_, rounds)
        if verdict < 0:
            return at
        v = floats[_V]
        rate = changes[1]
        for s in range(springs):
            rate[s] = stiffness[s] * (v[ends[s, 1]] - v[ends[s, 0]] - change[s])
        _forces(ends, rate, floats[_FORCE_RATE])
        when = np.inf
        for i in range(n):
            bytes_[1, i] = 0
            g, g_rate = floats[_FORCE, i], floats[_FORCE_RATE, i]
            if bytes_[0, i] != 0 and floats[_UPPER, i] == floats[_LOWER, i]:
                bytes_[2, i] = AT_FORWARD | AT_BACKWARD
            else:
                bytes_[2, i] = AT_FORWARD if bytes_[0, i] == 1 else (AT_BACKWARD if bytes_[0, i] == -1 else 0)
            floats[_GRAIN, i] = np.inf  # from here on: when the contact reaches a bound
            closing = g_rate - floats[_D_FORWARD, i]
            if closing > 0.0 and not status[i] & AT_FORWARD:
                above = contacts[FORWARD, i] + at * floats[_D_FORWARD, i] - g
                floats[_GRAIN, i] = at + max(above, 0.0) / closing
                bytes_[1, i] = AT_FORWARD
            closing = -g_rate - floats[_D_BACKWARD, i]
            if closing > 0.0 and not status[i] & AT_BACKWARD:
                below = contacts[BACKWARD, i] + at * floats[_D_BACKWARD, i] + g
                other = at + max(below, 0.0) / closing
                if other < floats[_GRAIN, i]:
                    floats[_GRAIN, i] = other
                    bytes_[1, i] = AT_BACKWARD
            when = min(when, floats[_GRAIN, i])
        ending = not when < 1.0
        until = 1.0 if ending else when
        ds = until - at
        middle = 0.5 * (at + until)

        near, total = _nearness(floats, contacts, at, 0.0)
        account[VISITED] = min(account[VISITED], near / total if total > 0.0 else 0.0)
        critical = False
        if near <= CRITICAL * whole or whole == 0.0:  # at the ramp's ends friction may be gone: look between
            some, total_some = _nearness(floats, contacts, at, (1.0 - at) / 3.0)
            more, total_more = _nearness(floats, contacts, at, (1.0 - at) / 1.5)
            close = 8.0 * EPS * whole
            critical = some <= CRITICAL * total_some + close and more <= CRITICAL * total_more + close
            critical = critical or whole == 0.0
        if critical or verdict == 1:
            for i in range(n):
                floats[_MIDDLE, i] = contacts[FORWARD, i] + middle * floats[_D_FORWARD, i]
                floats[_MIDDLE_B, i] = contacts[BACKWARD, i] + middle * floats[_D_BACKWARD, i]
            least, most = choose_translation(v, floats[_MIDDLE], floats[_MIDDLE_B], elements)
            if ds > _STRETCH and is_wide(least, most, v):
                account[AMBIGUOUS] = 1.0
                account[GAIN_LEAST] += least * ds
                account[GAIN_MOST] += most * ds
        if not ending and pieces > budget:
            return at
        if ds > 0.0 or pieces == 0:
            pieces += 1
            account[EVENTS] += 1
        if ds > 0.0:
            for s in range(springs):
                gain = rate[s] * ds
                account[WORK] -= (links[TENSION, s] + 0.5 * gain) * change[s] * ds
                links[TENSION, s] += gain
            for i in range(n):
                floats[_FORCE, i] += floats[_FORCE_RATE, i] * ds
                if v[i] != 0.0:
                    mu_forward = contacts[FORWARD, i] + middle * floats[_D_FORWARD, i]
                    mu_backward = contacts[BACKWARD, i] + middle * floats[_D_BACKWARD, i]
                    force = floats[_FORCE, i] - 0.5 * floats[_FORCE_RATE, i] * ds
                    if v[i] > 0.0:
                        account[DISSIPATION] += mu_forward * v[i] * ds
                        gap = mu_forward - force
                    else:
                        account[DISSIPATION] -= mu_backward * v[i] * ds
                        gap = mu_backward + force
                    account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], abs(v[i] * gap))
                    shift(contacts, v[i], ds, i)
                    contacts[RELATIVE, i] += v[i] * ds
                status[i] &= bytes_[2, i]
        at = until
        if ending:
            return 1.0
        for i in range(n):
            if floats[_GRAIN, i] <= at:
                status[i] |= bytes_[1, i]
            floats[_GUESS, i] = v[i]


@compiled
def _catch_up(
    ends, stiffness, network, work, contacts, links, status, target, floats, changes, bytes_, account, rounds, elements
):
    """Go from the present state to `target` in one implicit step. Returns False when it was not found."""
    n = contacts.shape[1]
    springs = ends.shape[0]
    change = changes[0]
    tension = changes[1]
    for s in range(springs):
        change[s] = target[s] - links[ACTUATION, s]
        z = contacts[RELATIVE, ends[s, 1]] - contacts[RELATIVE, ends[s, 0]]
        tension[s] = stiffness[s] * (z - target[s])
    _forces(ends, tension, floats[_LOAD])
    for i in range(n):
        floats[_UPPER, i] = target[springs + i]
        floats[_LOWER, i] = -target[springs + n + i]
        floats[_GRAIN, i] = 0.0
        floats[_GUESS, i] = 0.0
    for s in range(springs):
        floats[_GRAIN, ends[s, 0]] += abs(tension[s])
        floats[_GRAIN, ends[s, 1]] += abs(tension[s])
    verdict = _move(network, work, floats, bytes_, rounds)
    if verdict < 0:
        return False
    v = floats[_V]
    for s in range(springs):
        new = tension[s] + stiffness[s] * (v[ends[s, 1]] - v[ends[s, 0]])
        account[WORK] -= 0.5 * (links[TENSION, s] + new) * change[s]
        tension[s] = new
    _forces(ends, tension, floats[_FORCE])
    near = 0.0
    total = 0.0
    for i in range(n):
        g = floats[_FORCE, i]
        near += max(min(floats[_UPPER, i] - g, g - floats[_LOWER, i]), 0.0)
        total += floats[_UPPER, i] - floats[_LOWER, i]
        floats[_MIDDLE, i] = 0.5 * (contacts[FORWARD, i] + target[springs + i])
        floats[_MIDDLE_B, i] = 0.5 * (contacts[BACKWARD, i] + target[springs + n + i])
    if verdict == 1 or total == 0.0 or near <= CRITICAL * total:
        least, most = choose_translation(v, floats[_MIDDLE], floats[_MIDDLE_B], elements)
        if is_wide(least, most, v):
            account[AMBIGUOUS] = 1.0
            account[GAIN_LEAST] += least
            account[GAIN_MOST] += most
    for i in range(n):
        g = floats[_FORCE, i]
        if v[i] > 0.0:
            account[DISSIPATION] += floats[_MIDDLE, i] * v[i]
            gap = floats[_UPPER, i] - g
        else:
            account[DISSIPATION] -= floats[_MIDDLE_B, i] * v[i]
            gap = g - floats[_LOWER, i]
        account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], abs(v[i] * gap))
        shift(contacts, v[i], 1.0, i)
        contacts[RELATIVE, i] += v[i]
        side = bytes_[0, i]
        status[i] = AT_FORWARD if side == 1 else (AT_BACKWARD if side == -1 else 0)
        if side != 0 and floats[_UPPER, i] == floats[_LOWER, i]:
            status[i] = AT_FORWARD | AT_BACKWARD
    return True


@compiled
def _finish(ends, stiffness, network, work, contacts, links, status, target, floats, moved, account, energy):
    """Put the state onto the ramp's end, contacts that slid exactly onto their bounds, and close the account."""
    n = contacts.shape[1]
    springs = ends.shape[0]
    for s in range(springs):
        links[ACTUATION, s] = target[s]
    for i in range(n):
        contacts[FORWARD, i] = target[springs + i]
        contacts[BACKWARD, i] = target[springs + n + i]
    _set_tensions(ends, stiffness, contacts, links)
    _forces(ends, links[TENSION], floats[_FORCE])
    order, band = network
    some = False
    load = np.zeros(n)
    sliding = np.zeros(n, np.int8)
    for p in range(n):
        i = order[p]
        if moved[i] and status[i] != 0:
            bound = contacts[FORWARD, i] if status[i] & AT_FORWARD else -contacts[BACKWARD, i]
            load[p] = floats[_FORCE, i] - bound
            sliding[p] = 1
            some = True
    if some:
        result = np.empty(n)
        eliminate(band, work[0], work[1][0], load, sliding, result)
        size = max(abs(contacts[RELATIVE].max()), abs(contacts[RELATIVE].min()))
        largest = np.abs(result).max()
        if largest <= 1e6 * EPS * size:  # rounding, and nothing else, is put right
            for p in range(n):
                if result[p] != 0.0:
                    contacts[RELATIVE, order[p]] += result[p]
                    shift(contacts, result[p], 1.0, order[p])
            _set_tensions(ends, stiffness, contacts, links)
            _forces(ends, links[TENSION], floats[_FORCE])
        _rebase(contacts)
    stored = 0.0
    for s in range(springs):
        stored += 0.5 * links[TENSION, s] * links[TENSION, s] / stiffness[s]
    near = 0.0
    total = 0.0
    for i in range(n):
        above = contacts[FORWARD, i] - floats[_FORCE, i]
        below = contacts[BACKWARD, i] + floats[_FORCE, i]
        account[VIOLATION] = max(account[VIOLATION], -min(above, below))
        near += max(min(above, below), 0.0)
        total += contacts[FORWARD, i] + contacts[BACKWARD, i]
    account[VISITED] = min(account[VISITED], near / total if total > 0.0 else 0.0)
    account[RESIDUAL] = (stored - energy) + account[DISSIPATION] - account[WORK]


@compiled
def follow(
    ends,
    stiffness,
    network,
    work,
    contacts,
    links,
    status,
    targets,
    exact,
    budget,
    elements,
    floats,
    changes,
    bytes_,
    account,
    records,
):
    """Follow straight ramps to each of the targets in turn.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        network: order and band of the `Network`.
        work: from `graph_kernel.workspace`.
        contacts: rows X .. RELATIVE, shape (6, N), changed in place.
        links: rows SHAPE .. ACTUATION_REF (the last two unused here), shape (5, S), changed in place.
        status: bits AT_FORWARD and AT_BACKWARD, int8, shape (N,), changed in place.
        targets: L, mu_plus and mu_minus at each ramp's end, shape (V, S + 2 N).
        exact: True to follow every event, False for one catch-up step a ramp.
        budget: most linear pieces of one ramp; beyond it the rest of that ramp is a catch-up step.
        elements: both contacts of each element of a segment, shape (P, 2).
        floats: from `scratch(N, S)`, as are the next two.
        changes: of the springs.
        bytes_: of the contacts.
        account: shape (11,), added to.
        records: displacement, its rest and tension after each ramp, shape (V, 2 N + S) or (0, 2 N + S) for none.
    """
    n = contacts.shape[1]
    springs = ends.shape[0]
    rounds = 200 + 40 * n
    ramp = np.zeros(account.shape[0])
    before = np.empty(n)
    moved = np.zeros(n, np.int8)
    for i in range(n):
        contacts[GAINED, i] = 0.0
    for v in range(targets.shape[0]):
        target = targets[v]
        still = True
        for s in range(springs):
            still = still and target[s] == links[ACTUATION, s]
        for i in range(n):
            still = still and target[springs + i] == contacts[FORWARD, i]
            still = still and target[springs + n + i] == contacts[BACKWARD, i]
        if not still:
            energy = 0.0
            for s in range(springs):
                energy += 0.5 * links[TENSION, s] * links[TENSION, s] / stiffness[s]
            for i in range(n):
                before[i] = contacts[RELATIVE, i]
            for i in range(ramp.shape[0]):
                ramp[i] = 0.0
            ramp[VISITED] = np.inf
            done = 0.0
            if exact:
                done = _exact(
                    ends,
                    stiffness,
                    network,
                    work,
                    contacts,
                    links,
                    status,
                    target,
                    floats,
                    changes,
                    bytes_,
                    ramp,
                    budget,
                    rounds,
                    elements,
                )
                if done < 1.0:
                    if done < 1.0 - _INSTANT:
                        ramp[OVERSPENT] = 1.0
                    for s in range(springs):
                        links[ACTUATION, s] += done * (target[s] - links[ACTUATION, s])
                    for i in range(n):
                        contacts[FORWARD, i] += done * (target[springs + i] - contacts[FORWARD, i])
                        contacts[BACKWARD, i] += done * (target[springs + n + i] - contacts[BACKWARD, i])
            else:
                ramp[EVENTS] = 1.0
            if done < 1.0:
                doubt, least, most = ramp[AMBIGUOUS], ramp[GAIN_LEAST], ramp[GAIN_MOST]
                found = _catch_up(
                    ends,
                    stiffness,
                    network,
                    work,
                    contacts,
                    links,
                    status,
                    target,
                    floats,
                    changes,
                    bytes_,
                    ramp,
                    rounds,
                    elements,
                )
                if not found:
                    ramp[OVERSPENT] = 1.0
                if done >= 1.0 - _INSTANT:  # an instant without friction makes no stretch
                    ramp[AMBIGUOUS], ramp[GAIN_LEAST], ramp[GAIN_MOST] = doubt, least, most
            for i in range(n):
                moved[i] = contacts[RELATIVE, i] != before[i]
            _finish(ends, stiffness, network, work, contacts, links, status, target, floats, moved, ramp, energy)
            add_ramp(account, ramp)
        if records.shape[0] > 0:
            for i in range(n):
                records[v, i] = contacts[X, i]
                records[v, n + i] = contacts[X_REST, i]
            for s in range(springs):
                records[v, 2 * n + s] = links[TENSION, s]
    if account[VISITED] == np.inf:  # nothing but holding
        _forces(ends, links[TENSION], floats[_FORCE])
        account[VISITED] = nearness(floats[_FORCE], contacts[FORWARD], contacts[BACKWARD])
