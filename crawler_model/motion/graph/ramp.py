"""One ramp of the commands on a body of any connected springs: exact, event to event, or a catch-up step.

As in `chain.ramp`, but rates are solved by `active_set`. The displacements are integrated; the tensions follow from
them, and at the end of a ramp the sliding contacts are put exactly onto their bounds, so that no error accumulates.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled, inlined, lean
from ...rounding import EPS
from ..pieces import begin_ramp
from ..state import (
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
    UNSOLVED,
    VIOLATION,
    VISITED,
    WORK,
    add_ramp,
    advance_loads,
    begin_loads,
    end_loads,
    is_in_force,
    record,
    shift,
)
from ..translation import choose_translation, is_wide
from .elimination import eliminate
from .events import INSTANT, follow_events
from .margin import margin_at_rest, slides_at_once
from .memory import (
    CHANGE,
    RATE,
    ROW_ALL,
    ROW_BEFORE,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    ROW_FORCE,
    ROW_LAST,
    ROW_LOAD,
    ROW_LOWER,
    ROW_MAGNITUDE,
    ROW_MIDDLE,
    ROW_MIDDLE_B,
    ROW_NO_STATUS,
    ROW_SIDE,
    ROW_UPPER,
    ROW_V,
    contact_forces,
    displace,
)
from .paths import project_ring


@lean
def _set_tensions(ends, stiffness, contacts, links):
    """Compute z and T of all springs from the displacements of the contacts."""
    for s in range(ends.shape[0]):
        z = contacts[RELATIVE, ends[s, 1]] - contacts[RELATIVE, ends[s, 0]]
        links[SHAPE, s] = z
        links[TENSION, s] = stiffness[s] * (z - links[ACTUATION, s])


@lean
def _stored_energy(stiffness, links):
    """Compute the elastic energy of all springs [J]."""
    stored = 0.0
    for s in range(stiffness.shape[0]):
        stored += 0.5 * links[TENSION, s] * links[TENSION, s] / stiffness[s]
    return stored


@lean
def _extremes(contacts):
    """Find the least and the largest of the relative displacements."""
    least = np.inf
    most = -np.inf
    for i in range(contacts.shape[1]):
        least = min(least, contacts[RELATIVE, i])
        most = max(most, contacts[RELATIVE, i])
    return least, most


@lean
def _rebase(contacts):
    """Shift the relative displacements to stay small; the shift is a power of two and loses no digits."""
    least, most = _extremes(contacts)
    nearest = least if least > 0.0 else (most if most < 0.0 else 0.0)
    if abs(nearest) <= 4.0 * (most - least) or nearest == 0.0:
        return
    away = 2.0 ** np.floor(np.log2(abs(nearest)))
    for i in range(contacts.shape[1]):
        contacts[RELATIVE, i] -= away if nearest > 0.0 else -away


@lean
def _catch_up(
    ends,
    stiffness,
    network,
    work,
    ring,
    contacts,
    links,
    status,
    target,
    memory,
    account,
    rounds,
    elements,
    share,
):
    """Take one implicit step from the present state to `target`; return False if it did not converge."""
    n, springs = contacts.shape[1], ends.shape[0]
    floats, changes, bytes_, _, lists = memory
    change, tension = changes[CHANGE], changes[RATE]
    for s in range(springs):
        change[s] = target[s] - links[ACTUATION, s]
        z = contacts[RELATIVE, ends[s, 1]] - contacts[RELATIVE, ends[s, 0]]
        tension[s] = stiffness[s] * (z - target[s])
    contact_forces(ends, tension, floats[ROW_LOAD])
    for i in range(n):
        floats[ROW_UPPER, i] = target[springs + i]
        floats[ROW_LOWER, i] = -target[springs + n + i]
        floats[ROW_MAGNITUDE, i] = 0.0
        floats[ROW_V, i] = 0.0
        bytes_[ROW_SIDE, i] = 1 if status[i] == AT_FORWARD else (-1 if status[i] == AT_BACKWARD else 0)
    for s in range(springs):
        floats[ROW_MAGNITUDE, ends[s, 0]] += abs(tension[s])
        floats[ROW_MAGNITUDE, ends[s, 1]] += abs(tension[s])
    if ring is not None:
        cut = -1
        for p in range(n):
            cut = p if status[ring.order[p]] == 0 else cut
        for _ in range(2):  # a contact that rested before, then one that seems to rest now: most sides are then known
            if cut >= 0:
                cut = project_ring(ends, stiffness, ring, tension, floats, bytes_, work[4], cut)
    verdict, _ = displace(network, work, floats, bytes_, rounds, lists[ROW_ALL, :n])
    if verdict < 0:
        return False
    v = floats[ROW_V]
    for s in range(springs):
        new = tension[s] + stiffness[s] * (v[ends[s, 1]] - v[ends[s, 0]])
        account[WORK] -= 0.5 * (links[TENSION, s] + new) * change[s]
        tension[s] = new
    contact_forces(ends, tension, floats[ROW_FORCE])
    whole = 0.0
    for i in range(n):
        whole += floats[ROW_UPPER, i] - floats[ROW_LOWER, i]
        floats[ROW_D_FORWARD, i] = floats[ROW_UPPER, i] - contacts[FORWARD, i]
        floats[ROW_D_BACKWARD, i] = -floats[ROW_LOWER, i] - contacts[BACKWARD, i]
        floats[ROW_MIDDLE, i] = 0.5 * (contacts[FORWARD, i] + target[springs + i])
        floats[ROW_MIDDLE_B, i] = 0.5 * (contacts[BACKWARD, i] + target[springs + n + i])
    # without status, the distances of contacts with side 0 are computed from their forces
    critical, _ = slides_at_once(
        ends, stiffness, contacts, links, changes, bytes_[ROW_NO_STATUS], bytes_[ROW_SIDE], floats, 1.0, whole
    )
    if critical or verdict == 1:
        least, most = choose_translation(v, floats[ROW_MIDDLE], floats[ROW_MIDDLE_B], elements, share)
        if is_wide(least, most, v):
            account[AMBIGUOUS] = 1.0
            account[GAIN_LEAST] += least
            account[GAIN_MOST] += most
    for i in range(n):
        g = floats[ROW_FORCE, i]
        if v[i] > 0.0:
            account[DISSIPATION] += floats[ROW_MIDDLE, i] * v[i]
            gap = floats[ROW_UPPER, i] - g
        else:
            account[DISSIPATION] -= floats[ROW_MIDDLE_B, i] * v[i]
            gap = g - floats[ROW_LOWER, i]
        account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], abs(v[i] * gap))
        shift(contacts, v[i], 1.0, i, 0.5)
        contacts[RELATIVE, i] += v[i]
        side = bytes_[ROW_SIDE, i]
        status[i] = AT_FORWARD if side == 1 else (AT_BACKWARD if side == -1 else 0)
        if side != 0 and floats[ROW_UPPER, i] == floats[ROW_LOWER, i]:
            status[i] = AT_FORWARD | AT_BACKWARD
    return True


@inlined
def _finish(ends, stiffness, network, work, contacts, links, status, target, memory, account, energy):
    """Set the state to the end of the ramp, with sliding contacts exactly on their bounds; complete the account."""
    n, springs = contacts.shape[1], ends.shape[0]
    floats, _, bytes_, _, lists = memory
    sliding = bytes_[ROW_LAST]
    for s in range(springs):
        links[ACTUATION, s] = target[s]
    for i in range(n):
        contacts[FORWARD, i] = target[springs + i]
        contacts[BACKWARD, i] = target[springs + n + i]
    _set_tensions(ends, stiffness, contacts, links)
    contact_forces(ends, links[TENSION], floats[ROW_FORCE])
    layout, conductances = network
    net, order = (conductances, *layout[5:]), layout[0]
    band_work, rows, ints = work[:3]
    load, result = rows[3], rows[4]  # as in `move`
    some = False
    for p in range(n):
        i = order[p]
        sliding[p] = contacts[RELATIVE, i] != floats[ROW_BEFORE, i] and status[i] != 0
        if sliding[p]:
            bound = contacts[FORWARD, i] if status[i] & AT_FORWARD else -contacts[BACKWARD, i]
            load[p] = floats[ROW_FORCE, i] - bound
            some = True
    if some:
        eliminate(net, band_work, rows[0], ints, load, sliding, result, lists[ROW_ALL, :n])
        least, most = _extremes(contacts)
        close = 1e6 * EPS * max(abs(most), abs(least))
        rounding = True
        for p in range(n):
            rounding = rounding and abs(result[p]) <= close
        if rounding:  # correct rounding errors only
            for p in range(n):
                if result[p] != 0.0:
                    contacts[RELATIVE, order[p]] += result[p]
                    shift(contacts, result[p], 1.0, order[p], 1.0)
            _set_tensions(ends, stiffness, contacts, links)
            contact_forces(ends, links[TENSION], floats[ROW_FORCE])
        _rebase(contacts)
    for i in range(n):
        above = contacts[FORWARD, i] - floats[ROW_FORCE, i]
        below = contacts[BACKWARD, i] + floats[ROW_FORCE, i]
        account[VIOLATION] = max(account[VIOLATION], -min(above, below))
    account[VISITED] = min(account[VISITED], margin_at_rest(status, floats, contacts, sliding))
    account[RESIDUAL] = (_stored_energy(stiffness, links) - energy) + account[DISSIPATION] - account[WORK]


@compiled
def follow(
    ends,
    stiffness,
    network,
    work,
    ring,
    contacts,
    links,
    status,
    targets,
    exact,
    budget,
    elements,
    share,
    rounds,
    memory,
    account,
    records,
    pieces,
):
    """Follow straight ramps to each of the targets in turn.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        network: layout and conductances of the `Network`.
        work: memory from `GraphMotion.scratch`, as the next one.
        ring: a `RingMemory`; None for other bodies, and for short rings.
        contacts: rows X .. RELATIVE, shape (6, N), changed in place.
        links: rows SHAPE .. ACTUATION_REF (the last two unused here), shape (5, S), changed in place.
        status: bits AT_FORWARD and AT_BACKWARD, int8, shape (N,), changed in place.
        targets: L, mu_plus and mu_minus at each ramp's end, shape (V, S + 2 N).
        exact: True to follow every event, False for one catch-up step per ramp.
        budget: upper limit of contacts solved in one ramp, counted in every round of the active set; beyond it a
            catch-up step completes the ramp.
        elements: both contacts of each element of a segment, shape (P, 2).
        share: weight of each contact in the net translation, shape (N,).
        rounds: upper limit of rounds of the active set.
        memory: from `memory.scratch`.
        account: total account, shape (14,), added to.
        records: output: displacement, its rest and tension after each ramp, shape (V, 2 N + S), or no rows.
        pieces: output, from `room_for_pieces`, or without rows.
    """
    n, springs = contacts.shape[1], ends.shape[0]
    ramp = np.zeros(account.shape[0])
    floats, bytes_ = memory[0], memory[2]
    contacts[GAINED, :] = 0.0
    for v in range(targets.shape[0]):
        target = targets[v]
        if not is_in_force(contacts, links, target):
            energy = _stored_energy(stiffness, links)
            floats[ROW_BEFORE] = contacts[RELATIVE]
            ramp[:] = 0.0
            ramp[VISITED] = np.inf
            begin_loads(contacts, target)
            begin_ramp(pieces, v)
            done = 0.0
            solved = True
            if exact:
                done, solved = follow_events(
                    ends,
                    stiffness,
                    network,
                    work,
                    ring,
                    contacts,
                    links,
                    status,
                    target,
                    memory,
                    ramp,
                    budget,
                    rounds,
                    elements,
                    share,
                    pieces,
                )
                if done < 1.0:
                    if done < 1.0 - INSTANT:
                        ramp[OVERSPENT if solved else UNSOLVED] = 1.0
                    for s in range(springs):
                        links[ACTUATION, s] += done * (target[s] - links[ACTUATION, s])
                    for i in range(n):
                        contacts[FORWARD, i] += done * (target[springs + i] - contacts[FORWARD, i])
                        contacts[BACKWARD, i] += done * (target[springs + n + i] - contacts[BACKWARD, i])
                    advance_loads(contacts, done)
            else:
                ramp[EVENTS] = 1.0
            if done < 1.0:
                ambiguous, least, most = ramp[AMBIGUOUS], ramp[GAIN_LEAST], ramp[GAIN_MOST]
                if not _catch_up(
                    ends,
                    stiffness,
                    network,
                    work,
                    ring,
                    contacts,
                    links,
                    status,
                    target,
                    memory,
                    ramp,
                    rounds,
                    elements,
                    share,
                ):
                    ramp[UNSOLVED] = 1.0
                if done >= 1.0 - INSTANT:  # an instant without friction is not a stretch
                    ramp[AMBIGUOUS], ramp[GAIN_LEAST], ramp[GAIN_MOST] = ambiguous, least, most
            _finish(ends, stiffness, network, work, contacts, links, status, target, memory, ramp, energy)
            end_loads(contacts, target, ramp)
            add_ramp(account, ramp)
        if records.shape[0] > 0:
            record(contacts, links, account, records[v])
    if account[VISITED] == np.inf:  # no command changed
        contact_forces(ends, links[TENSION], floats[ROW_FORCE])
        account[VISITED] = margin_at_rest(status, floats, contacts, bytes_[ROW_LAST])
