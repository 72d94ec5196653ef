"""A ramp of a graph of springs followed from event to event.

As in `chain.events`: contacts inside their bounds are walls, and an event changes only the rates of the block of
contacts at their bounds around it; see `rates`. Where the blocks of a ring are long, `ring` follows it.
"""

from __future__ import annotations

import numpy as np

from ...compiled import inlined, lean
from ...rounding import SHORTEST_STRETCH
from ..pieces import note_piece
from ..state import (
    ACTUATION,
    AMBIGUOUS,
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    EVENTS,
    FORWARD,
    GAIN_LEAST,
    GAIN_MOST,
    TENSION,
    VISITED,
)
from ..tournament import begin_tournament, enter_event
from ..translation import FEW_CONTACTS, FEW_FREE, choose_translation, is_wide
from .margin import slides_at_once
from .memory import (
    CHANGE,
    RATE,
    ROW_ALL,
    ROW_ARRIVAL,
    ROW_COMING,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    ROW_FORCE,
    ROW_HITS,
    ROW_LEAVING,
    ROW_LOAD,
    ROW_MAGNITUDE,
    ROW_MARKS,
    ROW_MIDDLE,
    ROW_MIDDLE_B,
    ROW_PLACES,
    ROW_QUEUE,
    ROW_SIDE,
    ROW_SINCE,
    ROW_V,
    SPRING_SINCE,
    add_load,
    contact_forces,
)
from .paths import find_path, solve_path
from .rates import advance, find_arrival, find_block, settle, solve
from .ring import can_follow, follow_ring

INSTANT = 1e-12
"""A failure within this part of a ramp's end is ignored: where all friction vanishes at the end, no rate may exist."""


@lean
def _solve_around(
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
    marks,
    number,
    queue,
    places,
    rounds,
    budget,
    s,
    contact,
):
    """Solve for the rates of the block around a contact that is at a bound at s; contacts outside keep their rates.

    Its contacts are marked by `number`, or by the number before it. The positions of all contacts whose next events may
    have changed are written into `places`.

    Returns the verdict of `move`, the number of these positions, how many of their contacts were free or leaving
    before, and the work.
    """
    layout = network[0]
    paths = work[4]
    first, last = find_path(layout, status, floats, bytes_, marks, number - 1, paths, s, contact)
    if last > first:
        graph = ends, stiffness, layout, contacts, links, status, floats, changes, bytes_, account
        found, was_free, effort = solve_path(*graph, paths, first, last, places, s)
        if found > 0:
            return 0, found, was_free, effort
    found = find_block(layout, status, floats, bytes_, marks, number, queue, places, s, contact)
    was_free = 0
    for p in places[:found]:
        was_free += bytes_[ROW_SIDE, layout[0][p]] == 0
    common = ends, stiffness, network, work, contacts, links, status, floats, changes, bytes_, account
    verdict, effort = solve(*common, rounds, budget, places[:found], s)
    return verdict, found, was_free, effort


@inlined
def _begin(
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
    tree,
    leaves,
    lists,
    block,
    rounds,
    budget,
    s,
):
    """Solve for the rates of all contacts at s, and enter their next events in the tournament.

    Returns the verdict of `move`, the work, the number of the last block, and how many contacts are free or leaving.
    """
    n = contacts.shape[1]
    common = ends, stiffness, network, work, contacts, links, status, floats, changes, bytes_, account
    spent = 0
    verdict = 0
    if n <= FEW_CONTACTS:  # all blocks together take less time than one by one
        verdict, spent = solve(*common, rounds, budget, lists[ROW_ALL, :n], s)
    else:
        marks, queue, places = lists[ROW_MARKS : ROW_MARKS + 2], lists[ROW_QUEUE], lists[ROW_PLACES]
        before = block
        for i in range(n):
            if status[i] == 0 or marks[0, i] > before or verdict < 0:
                continue
            block += 2
            verdict, _, _, effort = _solve_around(*common, marks, block, queue, places, rounds, budget - spent, s, i)
            spent += effort
        for i in range(n):
            if status[i] == 0:
                find_arrival(ends, stiffness, network[0], contacts, links, status, floats, changes, bytes_, s, i)
    begin_tournament(tree, leaves, floats[ROW_ARRIVAL])
    free = 0
    for i in range(n):
        free += bytes_[ROW_SIDE, i] == 0
    return verdict, spent, block, free


@inlined
def follow_events(
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
    budget,
    rounds,
    elements,
    share,
    pieces_met,
):
    """Follow the straight ramp to `target` from event to event.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: stiffness of the springs, shape (S,) [N/m].
        network: layout and conductances of the `Network`.
        work: memory from `GraphMotion.scratch`, as the next one.
        ring: a `RingMemory`; None for other bodies, and for short rings.
        contacts: rows X .. RELATIVE, shape (6, N), changed in place.
        links: rows SHAPE .. ACTUATION_REF, shape (5, S), changed in place.
        status: bits AT_FORWARD and AT_BACKWARD, int8, shape (N,), changed in place.
        target: L, mu_plus and mu_minus at the ramp's end, shape (S + 2 N,) [m, N].
        memory: from `memory.scratch`.
        account: account of the ramp, shape (14,), added to.
        budget: upper limit of contacts solved, counted in every round of the active set.
        rounds: upper limit of rounds of the active set.
        elements: both contacts of each element of a segment, shape (P, 2).
        share: weight of each contact in the net translation, shape (N,).
        pieces_met: output, from `room_for_pieces`, or without rows.

    Returns:
        The place reached, 1 for the end; False if the active set did not converge there, else True.
    """
    n = contacts.shape[1]
    springs = ends.shape[0]
    order = network[0][0]
    floats, changes, bytes_, tree, lists = memory
    marks, queue, hits, places = lists[ROW_MARKS : ROW_MARKS + 2], lists[ROW_QUEUE], lists[ROW_HITS], lists[ROW_PLACES]
    change = changes[CHANGE]
    whole = 0.0
    for j in range(springs):
        change[j] = target[j] - links[ACTUATION, j]
        changes[SPRING_SINCE, j] = 0.0
        changes[RATE, j] = -stiffness[j] * change[j]
    for i in range(n):
        floats[ROW_D_FORWARD, i] = target[springs + i] - contacts[FORWARD, i]
        floats[ROW_D_BACKWARD, i] = target[springs + n + i] - contacts[BACKWARD, i]
        whole += contacts[FORWARD, i] + contacts[BACKWARD, i] + target[springs + i] + target[springs + n + i]
        changing = floats[ROW_D_FORWARD, i] != 0.0 or floats[ROW_D_BACKWARD, i] != 0.0
        floats[ROW_MAGNITUDE, i] = contacts[FORWARD, i] + contacts[BACKWARD, i] if changing else 0.0
        floats[ROW_LOAD, i] = 0.0
        floats[ROW_V, i] = 0.0
        floats[ROW_SINCE, i] = 0.0
        floats[ROW_ARRIVAL, i] = np.inf
        bytes_[ROW_LEAVING, i] = 0
        marks[0, i] = 0
        marks[1, i] = 0
        bytes_[ROW_SIDE, i] = 1 if status[i] & AT_FORWARD else (-1 if status[i] & AT_BACKWARD else 0)
    add_load(ends, stiffness, change, floats[ROW_LOAD], floats[ROW_MAGNITUDE])
    contact_forces(ends, links[TENSION], floats[ROW_FORCE])
    leaves = 1
    while leaves < n:
        leaves *= 2
    v = floats[ROW_V]
    common = ends, stiffness, network, work, contacts, links, status, floats, changes, bytes_, account
    verdict, spent, block, free = _begin(*common, tree, leaves, lists, 0, rounds, budget, 0.0)
    if verdict < 0:
        return 0.0, spent >= budget
    in_ring = False
    if ring is not None:
        in_ring = pieces_met.shape[0] == 0 and can_follow(contacts, target, springs, ring, stiffness)
    visits = 0
    handed_back = False
    at = 0.0
    pieces = 0
    while True:
        if ring is not None and in_ring and visits > ring.scratch.long_ints[4] and verdict == 0 and free > 0:
            advance(contacts, links, status, floats, changes, bytes_, account, at)
            at, effort = follow_ring(
                ends, stiffness, contacts, links, status, floats, changes, bytes_, account, ring, budget - spent, at
            )
            spent += effort
            if at == 1.0:
                return at, True
            verdict, effort, block, free = _begin(*common, tree, leaves, lists, block, rounds, budget - spent, at)
            spent += effort
            if verdict < 0:
                return at, spent >= budget
            visits = 0
            handed_back = True
        when = tree[2]
        ending = not when < 1.0
        until = 1.0 if ending else when
        ds = until - at
        shifted = False
        if free <= FEW_FREE or n <= FEW_CONTACTS or handed_back:
            handed_back = False
            advance(contacts, links, status, floats, changes, bytes_, account, at)
            critical, margin = slides_at_once(
                ends, stiffness, contacts, links, changes, status, bytes_[ROW_SIDE], floats, at, whole
            )
            account[VISITED] = min(account[VISITED], margin)
            if critical or verdict == 1:
                # friction at the middle of the stretch, as it may be zero at its start
                middle = 0.5 * (at + until)
                for i in range(n):
                    floats[ROW_MIDDLE, i] = contacts[FORWARD, i] + middle * floats[ROW_D_FORWARD, i]
                    floats[ROW_MIDDLE_B, i] = contacts[BACKWARD, i] + middle * floats[ROW_D_BACKWARD, i]
                least, most = choose_translation(v, floats[ROW_MIDDLE], floats[ROW_MIDDLE_B], elements, share)
                shifted = True
                if ds > SHORTEST_STRETCH and is_wide(least, most, v):
                    account[AMBIGUOUS] = 1.0
                    account[GAIN_LEAST] += least * ds
                    account[GAIN_MOST] += most * ds
        if not ending and spent > budget:
            advance(contacts, links, status, floats, changes, bytes_, account, at)
            return at, True
        note_piece(pieces_met, at, until, v, floats[ROW_ARRIVAL], bytes_[ROW_COMING])
        if until > at or pieces == 0:
            pieces += 1
            account[EVENTS] += 1
        at = until
        if ending:
            advance(contacts, links, status, floats, changes, bytes_, account, at)
            return at, True

        count = 0
        while tree[2] <= at:  # ties: collect all simultaneous arrivals, then solve
            first = int(tree[3])
            settle(status, floats, bytes_, at, first)
            status[first] |= bytes_[ROW_COMING, first]
            enter_event(tree, leaves, np.inf, first)
            hits[count] = first
            count += 1
        before = block
        for j in range(count):
            if marks[0, hits[j]] > before:
                continue
            block += 2
            if shifted:
                for i in range(n):
                    settle(status, floats, bytes_, at, i)
                    marks[0, i] = block
                    places[i] = i
                    free -= bytes_[ROW_SIDE, i] == 0
                found = n
                verdict, effort = solve(*common, rounds, budget - spent, places[:n], at)
            else:
                verdict, found, was_free, effort = _solve_around(
                    *common, marks, block, queue, places, rounds, budget - spent, at, hits[j]
                )
                free -= was_free
            spent += effort
            visits += effort
            if verdict < 0:
                advance(contacts, links, status, floats, changes, bytes_, account, at)
                return at, spent >= budget
            for p in places[:found]:
                i = order[p]
                free += bytes_[ROW_SIDE, i] == 0
                enter_event(tree, leaves, floats[ROW_ARRIVAL, i], i)
