"""A ramp of a graph of springs followed from event to event."""

from __future__ import annotations

import numpy as np

from ...compiled import compiled
from ...rounding import SHORTEST_STRETCH
from ..borders import find_border, mark_reached
from ..pieces import note_piece
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
    RELATIVE,
    TENSION,
    VISITED,
    WORK,
    shift,
)
from ..translation import choose_translation, is_wide
from .margin import defer_arrivals, slides_at_once
from .memory import (
    ROW_ARRIVAL,
    ROW_COMING,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    ROW_FORCE,
    ROW_FORCE_RATE,
    ROW_GUESS,
    ROW_HELD,
    ROW_LOAD,
    ROW_LOWER,
    ROW_MAGNITUDE,
    ROW_MIDDLE,
    ROW_MIDDLE_B,
    ROW_SIDE,
    ROW_UPPER,
    ROW_V,
    add_load,
    contact_forces,
    displace,
)

INSTANT = 1e-12
"""A failure within this part of a ramp's end is ignored: where all friction vanishes at the end, no rate may exist."""


@compiled
def follow_events(
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
    share,
    ground,
    reached,
    pieces_met,
):
    """Follow the straight ramp to `target` from event to event, or until a contact reaches a border of the ground.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: stiffness of the springs, shape (S,) [N/m].
        network: order and band of the `Network`.
        work: memory from `active_set.workspace`.
        contacts: rows X .. RELATIVE, shape (6, N), changed in place.
        links: rows SHAPE .. ACTUATION_REF, shape (5, S), changed in place.
        status: bits AT_FORWARD and AT_BACKWARD, int8, shape (N,), changed in place.
        target: L, mu_plus and mu_minus at the ramp's end, shape (S + 2 N,) [m, N].
        floats: memory of the ramp, from `memory.scratch`, which also allocates the next two.
        changes: changes of the rest lengths and tensions.
        bytes_: sides of the contacts.
        account: account of the ramp, shape (14,), added to.
        budget: upper limit of contacts solved, counted in every round of the active set.
        rounds: upper limit of rounds of the active set.
        elements: both contacts of each element of a segment, shape (P, 2).
        share: weight of each contact in the net translation, shape (N,).
        ground: rows as in `Track.find_ground`, shape (8, N); None on ground that is the same everywhere.
        reached: output: the contacts that reached a border, from `mark_reached`, int8, shape (N,); or None.
        pieces_met: output, from `room_for_pieces`, or without rows.

    Returns:
        The place reached, 1 for the end; False if the active set did not converge there, else True.
    """
    n = contacts.shape[1]
    springs = ends.shape[0]
    change = changes[0]
    whole = 0.0
    for s in range(springs):
        change[s] = target[s] - links[ACTUATION, s]
    for i in range(n):
        floats[ROW_D_FORWARD, i] = target[springs + i] - contacts[FORWARD, i]
        floats[ROW_D_BACKWARD, i] = target[springs + n + i] - contacts[BACKWARD, i]
        whole += contacts[FORWARD, i] + contacts[BACKWARD, i] + target[springs + i] + target[springs + n + i]
        floats[ROW_GUESS, i] = 0.0
    contact_forces(ends, links[TENSION], floats[ROW_FORCE])
    at = 0.0
    pieces = 0
    spent = 0
    while True:
        for i in range(n):
            upper = floats[ROW_D_FORWARD, i] if status[i] & AT_FORWARD else np.inf
            lower = -floats[ROW_D_BACKWARD, i] if status[i] & AT_BACKWARD else -np.inf
            if lower > upper:  # both bounds met by rounding just before the friction vanishes
                upper = 0.5 * (lower + upper)
                lower = upper
            floats[ROW_UPPER, i] = upper
            floats[ROW_LOWER, i] = lower
            changing = floats[ROW_D_FORWARD, i] != 0.0 or floats[ROW_D_BACKWARD, i] != 0.0
            floats[ROW_MAGNITUDE, i] = contacts[FORWARD, i] + contacts[BACKWARD, i] if changing else 0.0
            floats[ROW_LOAD, i] = 0.0
        add_load(ends, stiffness, change, floats[ROW_LOAD], floats[ROW_MAGNITUDE])
        verdict, turns = displace(network, work, floats, bytes_, min(rounds, 1 + (budget - spent) // n))
        spent += turns * n
        if verdict < 0:
            return at, spent >= budget
        v = floats[ROW_V]
        rate = changes[1]
        for s in range(springs):
            rate[s] = stiffness[s] * (v[ends[s, 1]] - v[ends[s, 0]] - change[s])
        contact_forces(ends, rate, floats[ROW_FORCE_RATE])
        when = np.inf
        for i in range(n):
            bytes_[ROW_COMING, i] = 0
            g, g_rate = floats[ROW_FORCE, i], floats[ROW_FORCE_RATE, i]
            if bytes_[ROW_SIDE, i] != 0 and floats[ROW_UPPER, i] == floats[ROW_LOWER, i]:
                bytes_[ROW_HELD, i] = AT_FORWARD | AT_BACKWARD
            else:
                bytes_[ROW_HELD, i] = (
                    AT_FORWARD if bytes_[ROW_SIDE, i] == 1 else (AT_BACKWARD if bytes_[ROW_SIDE, i] == -1 else 0)
                )
            floats[ROW_ARRIVAL, i] = np.inf
            closing = g_rate - floats[ROW_D_FORWARD, i]
            if closing > 0.0 and not status[i] & AT_FORWARD:
                above = contacts[FORWARD, i] + at * floats[ROW_D_FORWARD, i] - g
                floats[ROW_ARRIVAL, i] = at + max(above, 0.0) / closing
                bytes_[ROW_COMING, i] = AT_FORWARD
            closing = -g_rate - floats[ROW_D_BACKWARD, i]
            if closing > 0.0 and not status[i] & AT_BACKWARD:
                below = contacts[BACKWARD, i] + at * floats[ROW_D_BACKWARD, i] + g
                other = at + max(below, 0.0) / closing
                if other < floats[ROW_ARRIVAL, i]:
                    floats[ROW_ARRIVAL, i] = other
                    bytes_[ROW_COMING, i] = AT_BACKWARD
            when = min(when, floats[ROW_ARRIVAL, i])
        when = defer_arrivals(ends, stiffness, contacts, links, change, bytes_[ROW_COMING], floats, when)
        ending = not when < 1.0
        until = 1.0 if ending else when
        ds = until - at
        middle = 0.5 * (at + until)

        critical, margin = slides_at_once(
            ends, stiffness, contacts, links, change, status, bytes_[ROW_SIDE], floats, at, whole
        )
        account[VISITED] = min(account[VISITED], margin)
        if critical or verdict == 1:
            for i in range(n):
                floats[ROW_MIDDLE, i] = contacts[FORWARD, i] + middle * floats[ROW_D_FORWARD, i]
                floats[ROW_MIDDLE_B, i] = contacts[BACKWARD, i] + middle * floats[ROW_D_BACKWARD, i]
            least, most = choose_translation(v, floats[ROW_MIDDLE], floats[ROW_MIDDLE_B], elements, share)
            if ground is not None:
                ds = min(ds, find_border(contacts, v, np.full(n, at), at, ground) - at)
            if ds > SHORTEST_STRETCH and is_wide(least, most, v):
                account[AMBIGUOUS] = 1.0
                account[GAIN_LEAST] += least * ds
                account[GAIN_MOST] += most * ds
        at_border = False
        if ground is not None:
            meeting = find_border(contacts, v, np.full(n, at), at, ground)
            if meeting < until or (ending and meeting <= 1.0):
                until = meeting
                ending = False
                at_border = True
            ds = until - at
            middle = 0.5 * (at + until)
        if not ending and spent > budget:
            return at, True
        note_piece(pieces_met, at, until, v, floats[ROW_ARRIVAL], bytes_[ROW_COMING])
        if ds > 0.0 or (pieces == 0 and not at_border):
            pieces += 1
            account[EVENTS] += 1
        if ds > 0.0:
            for s in range(springs):
                gain = rate[s] * ds
                account[WORK] -= (links[TENSION, s] + 0.5 * gain) * change[s] * ds
                links[TENSION, s] += gain
            for i in range(n):
                floats[ROW_FORCE, i] += floats[ROW_FORCE_RATE, i] * ds
                if v[i] != 0.0:
                    mu_forward = contacts[FORWARD, i] + middle * floats[ROW_D_FORWARD, i]
                    mu_backward = contacts[BACKWARD, i] + middle * floats[ROW_D_BACKWARD, i]
                    force = floats[ROW_FORCE, i] - 0.5 * floats[ROW_FORCE_RATE, i] * ds
                    if v[i] > 0.0:
                        account[DISSIPATION] += mu_forward * v[i] * ds
                        gap = mu_forward - force
                    else:
                        account[DISSIPATION] -= mu_backward * v[i] * ds
                        gap = mu_backward + force
                    account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], abs(v[i] * gap))
                    shift(contacts, v[i], ds, i, at + 0.5 * ds)
                    contacts[RELATIVE, i] += v[i] * ds
                status[i] &= bytes_[ROW_HELD, i]
        at = until
        if ground is not None and at_border:
            mark_reached(contacts, v, ground, reached)
            return at, True
        if ending:
            return 1.0, True
        for i in range(n):
            if floats[ROW_ARRIVAL, i] <= at:
                status[i] |= bytes_[ROW_COMING, i]
            floats[ROW_GUESS, i] = v[i]
