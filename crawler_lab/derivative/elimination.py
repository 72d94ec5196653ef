"""Solution of K_SS u = r for many right-hand sides at once: the sliding contacts, with the stuck ones given.

The springs are a band of conductances, in the order of `motion.line.build_records.order_contacts`; a chain is a band
of width 1 in its own order. The elimination only adds conductances, as `motion.line.mesh` does.
"""

from __future__ import annotations

import numpy as np

from crawler_model.body.body import Body
from crawler_model.compiled import lean

from .records import Band


def build_band(body: Body, springs: np.ndarray) -> Band:
    """Order the contacts of a body so that its stiffness matrix is a narrow band.

    Args:
        body: any body on a line.
        springs: SPRING, shape (S,); their places in the band are written.

    Returns:
        The band, with memory.
    """
    place, width = np.arange(body.contacts), 1
    if not body.is_chain:
        from crawler_model.motion.line.build_records import order_contacts

        place, width = order_contacts(body)
    ends = np.sort(place[body.ends], axis=1)
    springs["row"], springs["column"] = ends[:, 0], ends[:, 1] - ends[:, 0] - 1
    band = np.zeros((body.contacts, width))
    np.add.at(band, (springs["row"], springs["column"]), springs["stiffness"])
    return Band(np.argsort(place), band, np.empty(band.shape))


@lean
def _is_free(contacts, band, pinned, p):
    """Determine whether the contact at position p slides and is not pinned."""
    return contacts[band.order[p]].sliding != 0 and p != pinned


@lean
def _connect(contacts, band, load, solution, pinned):
    """Enter the springs in the matrix; one between a free contact and another is a conductance to the ground."""
    order, memory = band.order, band.memory
    n, width = memory.shape
    for p in range(n):
        contacts[order[p]].ground = 0.0
        for d in range(width):
            memory[p, d] = band.stiffness[p, d]
    for p in range(n):
        for d in range(min(width, n - 1 - p)):
            k = memory[p, d]
            free = _is_free(contacts, band, pinned, p)
            if k == 0.0 or free == _is_free(contacts, band, pinned, p + 1 + d):
                continue
            memory[p, d] = 0.0
            inner, outer = (p, p + 1 + d) if free else (p + 1 + d, p)
            a, b = order[inner], order[outer]
            contacts[a].ground += k
            for c in range(load.shape[1]):
                load[a, c] += k * solution[b, c]


@lean
def _find_pivot(contacts, band, pinned, p):
    """Sum the conductances of the contact at position p that are left."""
    pivot = contacts[band.order[p]].ground
    for d in range(min(band.memory.shape[1], band.memory.shape[0] - 1 - p)):
        if _is_free(contacts, band, pinned, p + 1 + d):
            pivot += band.memory[p, d]
    return pivot


@lean
def _eliminate(contacts, band, load, pinned):
    """Eliminate the free contacts in their order."""
    order, memory = band.order, band.memory
    n, width = memory.shape
    for p in range(n):
        a = order[p]
        if not _is_free(contacts, band, pinned, p):
            continue
        pivot = _find_pivot(contacts, band, pinned, p)
        if pivot == 0.0:
            continue
        reach = min(width, n - 1 - p)
        for d in range(reach):
            k = memory[p, d]
            if k == 0.0 or not _is_free(contacts, band, pinned, p + 1 + d):
                continue
            b = order[p + 1 + d]
            part = k / pivot
            for c in range(load.shape[1]):
                load[b, c] += part * load[a, c]
            contacts[b].ground += part * contacts[a].ground
            for e in range(d + 1, reach):
                if memory[p, e] != 0.0 and _is_free(contacts, band, pinned, p + 1 + e):
                    memory[p + 1 + d, e - d - 1] += part * memory[p, e]


@lean
def eliminate_many(contacts, band, load, solution):
    """Solve the balance of the sliding contacts, K_SS u_S = load_S - K_SM u_M.

    Args:
        contacts: CONTACT, shape (N,), some of them sliding.
        band: a `Band`.
        load: by contact, shape (N, P); overwritten for sliding contacts.
        solution: by contact, shape (N, P); read for stuck contacts, output for sliding ones.

    Returns:
        False if no contact is stuck. The last one in the order then keeps its solution, and the others are balanced; so
        do the last ones of parts of a body that no spring joins to stuck contacts, which are marked as loose.
    """
    n, width = band.memory.shape
    held = False
    for i in range(n):
        held |= contacts[i].sliding == 0
    pinned = -1 if held else n - 1
    _connect(contacts, band, load, solution, pinned)
    _eliminate(contacts, band, load, pinned)
    for p in range(n - 1, -1, -1):
        a = band.order[p]
        if not _is_free(contacts, band, pinned, p):
            continue
        for d in range(min(width, n - 1 - p)):
            if _is_free(contacts, band, pinned, p + 1 + d):
                k = band.memory[p, d]
                for c in range(load.shape[1]):
                    load[a, c] += k * solution[band.order[p + 1 + d], c]
        pivot = _find_pivot(contacts, band, pinned, p)
        contacts[a].loose = pivot == 0.0
        if pivot > 0.0:
            for c in range(load.shape[1]):
                solution[a, c] = load[a, c] / pivot
    return held
