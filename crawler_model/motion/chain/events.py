"""A ramp of a chain followed from event to event.

Between events every contact is free (strictly inside its bounds, at rest) or at a bound, and the rates of the tensions
solve the problem of `projection.project` with infinite bounds for free contacts. At an event a free contact reaches a
bound. A free contact is a wall: an event changes only the block of neighbouring contacts at their bounds around it, so
only that block is solved again; other links and contacts are updated when they are next needed. The status of a contact
is data that events change, never a comparison of rounded numbers; a contact that leaves its bound counts as free as
soon as s has increased.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled, lean
from ...rounding import SHORTEST_STRETCH
from ..pieces import note_piece
from ..state import (
    ACTUATION,
    AMBIGUOUS,
    BACKWARD,
    COMPLIANCE,
    CONTACT_ROWS,
    EVENTS,
    FORWARD,
    GAIN_LEAST,
    GAIN_MOST,
    LOAD_CHANGE,
    ROUNDING,
    advance_loads,
)
from ..tournament import begin_tournament
from ..translation import FEW_CONTACTS, FEW_FREE, choose_translation, is_wide
from .criticality import is_near_criticality
from .long.monotone import follow_monotone
from .long.solve import release_long, solve_long
from .long.tables import ENDS, tabulate
from .memory import (
    ROW_BACKWARD,
    ROW_COMING,
    ROW_D_ACTUATION,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    ROW_FORWARD,
    ROW_LEAVING,
    ROW_LINK_SINCE,
    ROW_NEXT,
    ROW_RATE,
    ROW_SIDE,
    ROW_SINCE,
    ROW_V,
    ROW_V_BEFORE,
)
from .rates import settle, solve, update, update_tournament
from .wide import uncertainty


@lean
def _survey(floats, bytes_):
    """Count the contacts that are free or are leaving their bound, and find the place of the next event."""
    free = 0
    soonest = np.inf
    for i in range(bytes_.shape[1]):
        free += bytes_[ROW_SIDE, i] == 0
        soonest = min(soonest, floats[ROW_NEXT, i])
    return free, soonest


@lean
def _sum_bounds(contacts, target):
    """Add up all bounds, at the start of the ramp and at its end [N]."""
    n = contacts.shape[1]
    begin = end = 0.0
    for i in range(n):
        begin += contacts[FORWARD, i] + contacts[BACKWARD, i]
        end += target[n - 1 + i] + target[2 * n - 1 + i]
    return begin, end


@compiled
def _sort(hits):
    """Sort the contacts of one event; this allocates."""
    hits.sort()


@lean
def follow_events(
    elasticity,
    contacts,
    links,
    status,
    target,
    floats,
    bytes_,
    tree,
    stacks,
    long_ints,
    tables,
    account,
    budget,
    elements,
    share,
    wide,
    pieces_met,
):
    """Follow the straight ramp to `target` from event to event.

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (2, N - 1).
        contacts: rows X .. RELATIVE, shape (6, N), changed in place.
        links: rows SHAPE .. ACTUATION_REF, shape (5, N - 1), changed in place.
        status: bits AT_FORWARD and AT_BACKWARD, int8, shape (N,), changed in place.
        target: L, mu_plus and mu_minus at the ramp's end, shape (3 N - 1,) [m, N].
        floats: memory of the ramp, from `memory.scratch`, which also allocates the next four.
        bytes_: statuses within the ramp.
        tree: memory for the tournament of the next events, and behind it for the contacts of one event,
            shape (4 M + N,).
        stacks: memory for `project`.
        long_ints: memory for long blocks.
        tables: from `memory.carve`.
        account: account of the ramp, shape (14,), added to.
        budget: upper limit of work: contacts solved plus breakpoints passed in the projection.
        elements: both contacts of each element of a segment, shape (P, 2).
        share: weight of each contact in the net translation, shape (N,).
        wide: True to use the projection in double-double arithmetic.
        pieces_met: output, from `room_for_pieces`, or without rows.

    Returns:
        False if the budget was exceeded before the end; and the place on the ramp that was reached, 1 for the end, to
        which state and commands belong.
    """
    n = contacts.shape[1]
    leaves = 1
    while leaves < n:
        leaves *= 2
    hits = tree[4 * leaves :]
    shortest = long_ints[0]
    until_long = long_ints[4]
    lines, nodes, order, marks, parts = tables
    whole = _sum_bounds(contacts, target)
    may_be_long = marks.shape[1] > 0 and not wide and pieces_met.shape[0] == 0
    any_long = False
    for i in range(n):
        floats[ROW_RATE, i] = 0.0
        floats[ROW_V, i] = 0.0
        floats[ROW_LINK_SINCE, i] = 0.0
        floats[ROW_SINCE, i] = 0.0
        floats[ROW_D_ACTUATION, i] = target[i] - links[ACTUATION, i] if i < n - 1 else 0.0
        floats[ROW_D_FORWARD, i] = target[n - 1 + i] - contacts[FORWARD, i]
        floats[ROW_D_BACKWARD, i] = target[2 * n - 1 + i] - contacts[BACKWARD, i]
        may_be_long &= contacts[FORWARD, i] + contacts[BACKWARD, i] > 0.0
        may_be_long &= target[n - 1 + i] + target[2 * n - 1 + i] > 0.0
        if contacts.shape[0] > CONTACT_ROWS:
            may_be_long &= contacts[LOAD_CHANGE, i] == 0.0
        bytes_[ROW_LEAVING, i] = 0

    s = 0.0
    in_steps = may_be_long and n > FEW_CONTACTS
    while True:
        free_translation, spent = solve(
            elasticity, contacts, links, status, floats, bytes_, stacks, account, 0.0, 0, n - 1, wide
        )
        free, soonest = _survey(floats, bytes_)
        if not in_steps or free <= FEW_FREE or not soonest < 1.0:
            break
        part = follow_monotone(elasticity, contacts, links, status, target, floats, bytes_, stacks, account)
        if part == 1.0:
            return True, 1.0
        if part == 0.0:
            break
        in_steps = False  # what is left of the ramp is the ramp from now on
    if soonest < 1.0:
        begin_tournament(tree, leaves, floats[ROW_NEXT])
    else:
        tree[3] = 0.0  # no contact has an event on this ramp
    pieces = 1
    done = True
    while True:
        shifted = False
        least = 0.0
        most = 0.0
        first_hit = int(tree[3])
        when = floats[ROW_NEXT, first_hit]
        ending = not when < 1.0
        until = 1.0 if ending else when
        look = free <= FEW_FREE or n <= FEW_CONTACTS
        critical = look and is_near_criticality(contacts, links, floats, bytes_[ROW_SIDE], account, whole, s)
        if critical or free_translation:
            # friction at the middle of the stretch, as it may be zero at its start
            middle = 0.5 * (s + until)
            if any_long:
                release_long(contacts, links, floats, bytes_, account, lines, nodes, marks, s, False)
            update(contacts, links, floats, account, s, 0, n - 1)
            for i in range(n):
                floats[ROW_FORWARD, i] = contacts[FORWARD, i] + middle * floats[ROW_D_FORWARD, i]
                floats[ROW_BACKWARD, i] = contacts[BACKWARD, i] + middle * floats[ROW_D_BACKWARD, i]
            least, most = choose_translation(floats[ROW_V], floats[ROW_FORWARD], floats[ROW_BACKWARD], elements, share)
            shifted = True
        if shifted and until - s > SHORTEST_STRETCH and is_wide(least, most, floats[ROW_V]):
            account[AMBIGUOUS] = 1.0
            account[GAIN_LEAST] += least * (until - s)
            account[GAIN_MOST] += most * (until - s)
        note_piece(pieces_met, s, until, floats[ROW_V], floats[ROW_NEXT], bytes_[ROW_COMING])
        if ending:
            break
        spent += n if look or shifted else 0
        if spent > budget:
            done = False
            break
        pieces += when > s
        s = when

        count = 0
        blur = 0.0
        while floats[ROW_NEXT, first_hit] <= s:  # ties: collect all simultaneous arrivals, then solve
            settle(status, floats, bytes_, s, first_hit)
            if wide:
                blur += uncertainty(contacts, links, floats, bytes_[ROW_COMING, first_hit], s, first_hit)
            status[first_hit] |= bytes_[ROW_COMING, first_hit]
            floats[ROW_NEXT, first_hit] = np.inf
            update_tournament(tree, leaves, floats, first_hit)
            hits[count] = first_hit
            count += 1
            first_hit = int(tree[3])
        solved_to = -1
        if count > 1:
            _sort(hits[:count])
        for j in range(count):
            contact = int(hits[j])
            if contact <= solved_to:
                continue
            if shifted:
                first = 0
                last = n - 1
                for i in range(n):
                    settle(status, floats, bytes_, s, i)
            else:
                beside_long = False
                first = contact
                while first > 0:
                    settle(status, floats, bytes_, s, first - 1)
                    if status[first - 1] == 0:
                        break
                    first -= 1
                    if any_long and marks[ENDS, first] >= 0:
                        first -= marks[ENDS, first]
                        beside_long = True
                last = contact
                while last < n - 1:
                    settle(status, floats, bytes_, s, last + 1)
                    if status[last + 1] == 0:
                        break
                    last += 1
                    if any_long and marks[ENDS, last] >= 0:
                        last += marks[ENDS, last]
                        beside_long = True
            solved_to = last
            longish = may_be_long and not shifted and (beside_long or last - first + 1 >= shortest)
            if longish and until_long <= 0:
                if not any_long:
                    for i in range(n):
                        settle(status, floats, bytes_, s, i)
                    update(contacts, links, floats, account, s, 0, n - 1)
                    tabulate(elasticity[COMPLIANCE], contacts, links, floats, lines, nodes, marks, s)
                    any_long = True
                solved, freed, effort = solve_long(
                    elasticity,
                    contacts,
                    links,
                    status,
                    floats,
                    bytes_,
                    tree,
                    leaves,
                    account,
                    lines,
                    nodes,
                    marks,
                    order,
                    parts,
                    shortest,
                    s,
                    first,
                    last,
                    contact,
                )
                free += freed
                spent += effort
                if solved:
                    free_translation = False
                    continue
            for i in range(first, last + 1):
                free -= bytes_[ROW_SIDE, i] == 0
            if wide:
                for i in range(first, last + 1):
                    floats[ROW_V_BEFORE, i] = floats[ROW_V, i]
            free_translation, effort = solve(
                elasticity, contacts, links, status, floats, bytes_, stacks, account, s, first, last, wide
            )
            spent += effort
            if longish:
                until_long -= effort
            if wide:
                turn = 0.0
                for i in range(first, last + 1):
                    turn = max(turn, abs(floats[ROW_V, i] - floats[ROW_V_BEFORE, i]))
                account[ROUNDING] += blur * turn
            for i in range(first, last + 1):
                free += bytes_[ROW_SIDE, i] == 0
            for i in range(max(first - 1, 0), min(last + 1, n - 1) + 1):
                update_tournament(tree, leaves, floats, i)

    end = 1.0 if done else s
    if any_long:
        release_long(contacts, links, floats, bytes_, account, lines, nodes, marks, end, True)
    update(contacts, links, floats, account, end, 0, n - 1)
    for i in range(n):
        status[i] &= ~bytes_[ROW_LEAVING, i]
        if not done:
            contacts[FORWARD, i] += s * floats[ROW_D_FORWARD, i]
            contacts[BACKWARD, i] += s * floats[ROW_D_BACKWARD, i]
    if not done:
        for i in range(n - 1):
            links[ACTUATION, i] += s * floats[ROW_D_ACTUATION, i]
        advance_loads(contacts, s)
    account[EVENTS] += pieces
    return done, end
