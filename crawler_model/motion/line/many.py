"""Many bodies whose springs join the same contacts, each along its own targets, in one compiled call."""

from __future__ import annotations

import numpy as np

from ...compiled import compiled
from ..state import WORK, dissipated
from .follow import follow


@compiled
def follow_many(contacts, springs, ramps, memory, targets, course, output):
    """Follow straight ramps, for each of M variations.

    Args:
        contacts: CONTACT, shape (M, N), changed in place.
        springs: SPRING, shape (M, S), changed in place.
        ramps: RAMP, memory with the budget and the method, shape (1,).
        memory: the fields of a `Model`.
        targets: targets to choose from, shape (M, W, F).
        course: which of them end the ramps, the same for all variations, shape (V,); and the ramps at which the account
            is read, increasing from 0 to V, shape (L + 1,).
        output: total accounts, shape (M, 14), added to; work, and energy lost to friction, since the start of the call
            at the end of each leg, shape (M, L, 2) [J]; displacement, its rest and tension after each ramp, shape
            (M, V, 2 N + S).
    """
    rows, legs = course
    accounts, spent, records = output
    path = np.empty((rows.shape[0], targets.shape[2]))
    for m in range(targets.shape[0]):
        for v in range(rows.shape[0]):
            for f in range(path.shape[1]):  # a slice that is assigned takes long to compile
                path[v, f] = targets[m, rows[v], f]
        for leg in range(legs.shape[0] - 1):
            first, last = legs[leg], legs[leg + 1]
            follow(contacts[m], springs[m], ramps, memory, path[first:last], accounts[m], records[m, first:last])
            spent[m, leg, 0] = accounts[m, WORK]
            spent[m, leg, 1] = dissipated(accounts[m])
