"""Many graphs of springs that join the same contacts, each along its own targets, in one compiled call."""

from __future__ import annotations

import numpy as np

from ...compiled import compiled
from ..state import WORK, dissipated
from .ramp import follow


@compiled
def follow_many(
    ends,
    stiffness,
    network,
    work,
    ring,
    contacts,
    links,
    status,
    targets,
    rows,
    legs,
    exact,
    budget,
    elements,
    share,
    rounds,
    memory,
    accounts,
    spent,
    records,
):
    """Follow straight ramps, for each of M variations.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: stiffness of the springs, shape (M, S).
        network: layout of the springs, and their conductances, shape (M, C).
        work: memory from `GraphMotion.scratch`, as the next one.
        ring: a `RingMemory`; None for other bodies, and for short rings.
        contacts: states as for `follow`, like the next two with a leading axis of variations, changed in place.
        links: rows of the springs, shape (M, 5, S).
        status: bits of the contacts, int8, shape (M, N).
        targets: targets to choose from, shape (M, W, F).
        rows: which of them end the ramps, the same for all variations, shape (V,).
        legs: the ramps at which the account is read, increasing from 0 to V, shape (L + 1,).
        exact: True to follow every event, False for one catch-up step per ramp.
        budget: upper limit of work in one ramp.
        elements: both contacts of each element of a segment, shape (P, 2).
        share: weight of each contact in the net translation, shape (N,).
        rounds: upper limit of rounds of the active set.
        memory: from `memory.scratch`.
        accounts: total accounts, shape (M, 14), added to.
        spent: output: work, and energy lost to friction, since the start of the call at the end of each leg, shape
            (M, L, 2) [J].
        records: output: displacement, its rest and tension after each ramp, shape (M, V, 2 N + S).
    """
    layout, conductances = network
    path = np.empty((rows.shape[0], targets.shape[2]))
    pieces = np.empty((0, 0))
    for m in range(targets.shape[0]):
        for v in range(rows.shape[0]):
            path[v] = targets[m, rows[v]]
        for leg in range(legs.shape[0] - 1):
            follow(
                ends,
                stiffness[m],
                (layout, conductances[m]),
                work,
                ring,
                contacts[m],
                links[m],
                status[m],
                path[legs[leg] : legs[leg + 1]],
                exact,
                budget,
                elements,
                share,
                rounds,
                memory,
                accounts[m],
                records[m, legs[leg] : legs[leg + 1]],
                pieces,
            )
            spent[m, leg, 0] = accounts[m, WORK]
            spent[m, leg, 1] = dissipated(accounts[m])
