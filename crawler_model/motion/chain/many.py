"""Many chains with the same springs between contacts, each along its own targets, in one compiled call."""

from __future__ import annotations

import numpy as np

from ...compiled import compiled
from ..state import WORK, dissipated
from .ramp import follow


@compiled
def follow_many(
    elasticity,
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
    floats,
    bytes_,
    tree,
    stacks,
    long_floats,
    long_ints,
    accounts,
    spent,
    records,
):
    """Follow straight ramps, for each of M variations.

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (M, 2, N - 1).
        contacts: states as for `follow`, like the next two with a leading axis of variations, changed in place.
        links: rows of the springs, shape (M, 5, N - 1).
        status: bits of the contacts, int8, shape (M, N).
        targets: targets to choose from, shape (M, W, F).
        rows: which of them end the ramps, the same for all variations, shape (V,).
        legs: the ramps at which the account is read, increasing from 0 to V, shape (L + 1,).
        exact: True to follow every event, False for one catch-up step per ramp.
        budget: upper limit of work in one ramp.
        elements: both contacts of each element of a segment, shape (P, 2).
        share: weight of each contact in the net translation, shape (N,).
        floats: memory from `scratch(N)`, like the next five.
        bytes_: statuses within a ramp.
        tree: tournament of the next events of the contacts.
        stacks: memory for `project`.
        long_floats: memory for long blocks, empty if the chain is too short for them.
        long_ints: likewise.
        accounts: total accounts, shape (M, 14), added to.
        spent: output: work, and energy lost to friction, since the start of the call at the end of each leg, shape
            (M, L, 2) [J].
        records: output: displacement, its rest and tension after each ramp, shape (M, V, 3 N - 1).
    """
    path = np.empty((rows.shape[0], targets.shape[2]))
    pieces = np.empty((0, 0))
    for m in range(targets.shape[0]):
        for v in range(rows.shape[0]):
            path[v] = targets[m, rows[v]]
        for leg in range(legs.shape[0] - 1):
            follow(
                elasticity[m],
                contacts[m],
                links[m],
                status[m],
                path[legs[leg] : legs[leg + 1]],
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
                accounts[m],
                records[m, legs[leg] : legs[leg + 1]],
                pieces,
            )
            spent[m, leg, 0] = accounts[m, WORK]
            spent[m, leg, 1] = dissipated(accounts[m])
