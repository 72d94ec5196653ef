"""One ramp of the commands, followed exactly or by a catch-up step, with its energy account and certificate.

Along a ramp the rest lengths and the friction change linearly from the values in force (s = 0) to the commanded
values (s = 1). The solution is then piecewise linear in s.

`exact` follows it from event to event (`events`).

`catch_up` projects once, with the friction of the ramp's end; the translation uses the ramp's mean friction.

Where stiffness spans many decades the projection uses double-double arithmetic (`wide`), and the account includes an
estimate of the displacement error due to rounding.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled, inlined, lean
from ...rounding import EPS
from ..pieces import begin_ramp
from ..state import (
    ACTUATION,
    ACTUATION_REF,
    AT_FORWARD,
    BACKWARD,
    COMPLIANCE,
    DISSIPATION,
    EVENTS,
    FORWARD,
    GAINED,
    OVERSPENT,
    RESIDUAL,
    ROUNDING,
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
    begin_loads,
    end_loads,
    is_in_force,
    record,
)
from ..translation import nearness
from .events import follow_events
from .implicit_step import catch_up
from .memory import ROW_MOVED, ROW_TRIAL, carve
from .wide import spans_decades


@lean
def _discord(compliance, contacts, links):
    """Compute the difference between elongations from tensions and from displacements beyond rounding of the latter.

    The displacement that would bring the worst force beyond its bound back onto it is added.
    """
    worst = 0.0
    excess = 0.0
    before = 0.0
    for i in range(contacts.shape[1]):
        after = links[TENSION, i] if i < links.shape[1] else 0.0
        over = max((after - before) - contacts[FORWARD, i], (before - after) - contacts[BACKWARD, i])
        if over > 0.0:
            softest = max(compliance[max(i - 1, 0)], compliance[min(i, links.shape[1] - 1)])
            excess = max(excess, over * softest)
        before = after
    for i in range(links.shape[1]):
        z = (contacts[X, i + 1] - contacts[X, i]) + (contacts[X_REST, i + 1] - contacts[X_REST, i])
        least = 4.0 * EPS * (abs(contacts[X, i]) + abs(contacts[X, i + 1]) + abs(links[ACTUATION, i]))
        worst = max(worst, abs(z - links[SHAPE, i]) - least)
    return worst + excess


@lean
def _lean_on_softest(compliance, contacts, tension, status, moved, first):
    """Compute the tensions from `first` to the softest link of its sliding block from that of the softest link.

    Otherwise the rounding of stiff links' tensions would show in its elongation.
    """
    softest = first
    end = first
    while end + 1 < tension.shape[0] and status[end + 1] != 0 and moved[end + 1]:
        end += 1
        if compliance[end] > compliance[softest]:
            softest = end
    for j in range(softest, first, -1):
        bound = contacts[FORWARD, j] if status[j] & AT_FORWARD else -contacts[BACKWARD, j]
        tension[j - 1] = tension[j] - bound


@inlined
def _finish(elasticity, contacts, links, status, target, bytes_, account, energy, wide):
    """Set the state to the end of the ramp, with contacts at a bound exactly on it, and complete the account.

    Returns the energy of the springs; `energy` is their energy before the ramp.
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
        if not bytes_[ROW_MOVED, i]:
            change = target[i] - links[ACTUATION_REF, i]
            tension[i] = links[TENSION_REF, i] - stiffness[i] * change
        elif status[i] != 0:
            bound = forward[i] if status[i] & AT_FORWARD else -backward[i]
            tension[i] = (tension[i - 1] if i > 0 else 0.0) + bound
        elif wide:
            _lean_on_softest(elasticity[COMPLIANCE], contacts, tension, status, bytes_[ROW_MOVED], i)
    for i in range(n - 1, 0, -1):
        if status[i] == 0:
            break
        if bytes_[ROW_MOVED, i - 1]:
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
            if bytes_[ROW_MOVED, i]:
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
    if wide:
        account[ROUNDING] += _discord(elasticity[COMPLIANCE], contacts, links)
    account[RESIDUAL] = (stored - energy) + account[DISSIPATION] - account[WORK]
    return stored


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
    share,
    floats,
    bytes_,
    tree,
    stacks,
    long_floats,
    long_ints,
    account,
    records,
    pieces,
):
    """Follow straight ramps to each of the targets in turn.

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (2, N - 1).
        contacts: rows X .. RELATIVE (unused here), shape (6, N), changed in place.
        links: rows SHAPE .. ACTUATION_REF, shape (5, N - 1), changed in place.
        status: bits AT_FORWARD and AT_BACKWARD, int8, shape (N,), changed in place.
        targets: L, mu_plus and mu_minus at each ramp's end, shape (V, 3 N - 1).
        exact: True to follow every event, False for one catch-up step per ramp.
        budget: upper limit of work in one ramp, see `follow_events`; beyond it a catch-up step completes the ramp.
        elements: both contacts of each element of a segment, shape (P, 2).
        share: weight of each contact in the net translation, shape (N,).
        floats: memory from `scratch(N)`, which also allocates the next five.
        bytes_: statuses within a ramp.
        tree: tournament of the next events of the contacts.
        stacks: memory for `project`.
        long_floats: memory for long blocks, empty if the chain is too short for them.
        long_ints: likewise.
        account: total account, shape (14,), added to.
        records: output: displacement, its rest and tension after each ramp, shape (V, 3 N - 1), or no rows.
        pieces: output, from `room_for_pieces`, or without rows.
    """
    n = contacts.shape[1]
    ramp = np.zeros(account.shape[0])
    contacts[GAINED, :] = 0.0
    tables = carve(long_floats, long_ints)
    wide = spans_decades(elasticity[COMPLIANCE])
    energy = 0.0
    for i in range(n - 1):
        energy += 0.5 * links[TENSION, i] * links[TENSION, i] * elasticity[COMPLIANCE, i]
    for v in range(targets.shape[0]):
        target = targets[v]
        if not is_in_force(contacts, links, target):
            bytes_[ROW_MOVED] = 0
            ramp[:] = 0.0
            ramp[VISITED] = np.inf
            begin_loads(contacts, target)
            begin_ramp(pieces, v)
            finished = False
            if exact:
                finished, _ = follow_events(
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
                    ramp,
                    budget,
                    elements,
                    share,
                    wide,
                    pieces,
                )
            if not finished:
                if exact:
                    ramp[OVERSPENT] = 1.0
                else:
                    ramp[EVENTS] = 1.0
                catch_up(
                    elasticity, contacts, links, status, target, floats, bytes_, stacks, ramp, elements, share, wide
                )
            energy = _finish(elasticity, contacts, links, status, target, bytes_, ramp, energy, wide)
            end_loads(contacts, target, ramp)
            add_ramp(account, ramp)
        if records.shape[0] > 0:
            record(contacts, links, account, records[v])
    if account[VISITED] == np.inf:  # no command changed
        force = floats[ROW_TRIAL]
        for i in range(n):
            force[i] = (links[TENSION, i] if i < n - 1 else 0.0) - (links[TENSION, i - 1] if i > 0 else 0.0)
        account[VISITED] = nearness(force, contacts[FORWARD], contacts[BACKWARD])
