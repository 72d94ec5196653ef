"""Solution of K_SS u = r for many right-hand sides at once: the sliding contacts, with the stuck ones given.

The springs are a band of conductances, in the order of `motion.line.build.order_contacts`; a chain is a band of width 1
in its own order. The elimination only adds conductances, as `motion.line.mesh` does.
"""

from __future__ import annotations

import numpy as np

from ..body.body import Body
from ..compiled import compiled


def build_band(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Order the contacts of a body so that its stiffness matrix is a narrow band.

    Args:
        body: any body on a line.

    Returns:
        The contact at each position of the band, shape (N,), and the stiffness between the contacts at positions p and
        p + 1 + d, shape (N, width) [N/m].
    """
    if body.is_chain:
        return np.arange(body.contacts), np.append(body.stiffness, 0.0)[:, None]
    from ..motion.line.build import order_contacts

    place, width = order_contacts(body)
    ends = np.sort(place[body.ends], axis=1)
    band = np.zeros((body.contacts, width))
    np.add.at(band, (ends[:, 0], ends[:, 1] - ends[:, 0] - 1), body.stiffness)
    return np.argsort(place), band


@compiled
def eliminate_many(order, band, sliding, work, ground, load, solution):
    """Solve the balance of the sliding contacts, K_SS u_S = load_S - K_SM u_M.

    Args:
        order: from `build_band`, like the next one, shape (N,).
        band: shape (N, width) [N/m].
        sliding: 0 for stuck contacts, int8, shape (N,), by contact.
        work: scratch memory, shape (N, width).
        ground: scratch memory, shape (N,).
        load: by contact, shape (N, P); that of sliding contacts is overwritten.
        solution: by contact, shape (N, P); read for stuck contacts, output for sliding ones.

    Returns:
        False if no contact is stuck. The last one in the order then keeps its solution, and the others are balanced.
    """
    n, width = band.shape
    columns = load.shape[1]
    pinned = -1
    held = False
    for p in range(n):
        held |= sliding[order[p]] == 0
        pinned = p
    if held:
        pinned = -1
    for p in range(n):
        ground[p] = 0.0
        for d in range(width):
            work[p, d] = band[p, d]
    for p in range(n):
        for d in range(min(width, n - 1 - p)):
            k = work[p, d]
            if k == 0.0:
                continue
            q = p + 1 + d
            a, b = order[p], order[q]
            free_p = sliding[a] != 0 and p != pinned
            free_q = sliding[b] != 0 and q != pinned
            if free_p != free_q:
                work[p, d] = 0.0
                if free_p:
                    ground[p] += k
                    for c in range(columns):
                        load[a, c] += k * solution[b, c]
                else:
                    ground[q] += k
                    for c in range(columns):
                        load[b, c] += k * solution[a, c]
    for p in range(n):
        a = order[p]
        if sliding[a] == 0 or p == pinned:
            continue
        reach = min(width, n - 1 - p)
        pivot = ground[p]
        for d in range(reach):
            if sliding[order[p + 1 + d]] != 0 and p + 1 + d != pinned:
                pivot += work[p, d]
        if pivot == 0.0:
            continue
        for d in range(reach):
            k = work[p, d]
            b = order[p + 1 + d]
            if k == 0.0 or sliding[b] == 0 or p + 1 + d == pinned:
                continue
            part = k / pivot
            for c in range(columns):
                load[b, c] += part * load[a, c]
            ground[p + 1 + d] += part * ground[p]
            for e in range(d + 1, reach):
                if work[p, e] != 0.0 and sliding[order[p + 1 + e]] != 0 and p + 1 + e != pinned:
                    work[p + 1 + d, e - d - 1] += part * work[p, e]
    for p in range(n - 1, -1, -1):
        a = order[p]
        if sliding[a] == 0 or p == pinned:
            continue
        pivot = ground[p]
        for d in range(min(width, n - 1 - p)):
            b = order[p + 1 + d]
            k = work[p, d]
            if k != 0.0 and sliding[b] != 0 and p + 1 + d != pinned:
                pivot += k
                for c in range(columns):
                    load[a, c] += k * solution[b, c]
        for c in range(columns):
            solution[a, c] = load[a, c] / pivot if pivot > 0.0 else solution[a, c]
    return held
