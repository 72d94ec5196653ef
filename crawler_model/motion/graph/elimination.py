"""The linear system of the sliding contacts of a graph, eliminated like a network of resistors (star-mesh transform).

Conductances are only added, never subtracted, so that large stiffness ratios lose no digits. Contacts are numbered to
make the matrix a narrow band (reverse Cuthill-McKee), and a row holds only the next `width` contacts; beyond the last
one that slides, a row is not read.
"""

from __future__ import annotations

from ...compiled import lean


@lean
def conductance(band, p, q):
    """Compute the stiffness between two positions that springs join.

    Args:
        band: as in `Network`, shape (N, width) [N/m].
        p: one position.
        q: the other one.

    Returns:
        The sum of the stiffnesses of these springs [N/m].
    """
    return band[p, q - p - 1] if q > p else band[q, p - q - 1]


@lean
def _lengthen(work, lengths, p, length):
    """Fill row p with zeros up to a length."""
    for d in range(lengths[p], length):
        work[p, d] = 0.0
    lengths[p] = max(lengths[p], length)


@lean
def eliminate(net, work, ground, lengths, groups, load, sliding, result, places):
    """Solve K v = load for the sliding contacts, with the others at rest; all arrays in the order of the band.

    Args:
        net: band of the `Network`, and heads and near of its `Layout`.
        work: scratch memory, same shape as `band`.
        ground: scratch memory, shape (N,).
        lengths: scratch memory, int, shape (N,).
        groups: output, int, shape (N,): for each sliding contact the last position in the group of sliding contacts
            that springs join to it; for the others their own position.
        load: forces, shape (N,) [N].
        sliding: 1 for sliding contacts, else 0, int8, shape (N,).
        result: output, v, shape (N,).
        places: positions of the sliding contacts and of all that springs join to them, increasing, int, shape (P,).

    Returns:
        False if none of these contacts is at rest. The last one is then set at rest, and K v = load holds for the
        others.
    """
    band, heads, near = net
    grounded = False
    for p in places:
        ground[p] = 0.0
        lengths[p] = 0
        groups[p] = p
        result[p] = load[p] if sliding[p] else 0.0
        grounded = grounded or not sliding[p]
    for p in places:
        if not sliding[p]:
            continue
        for k in range(heads[p], heads[p + 1]):
            q = near[k]
            if not sliding[q]:  # a spring to a contact at rest is a spring to the ground
                ground[p] += conductance(band, p, q)
            elif q > p:
                _lengthen(work, lengths, p, q - p)
                work[p, q - p - 1] = band[p, q - p - 1]
    for p in places:
        if not sliding[p]:
            continue
        length = lengths[p]
        to_ground = ground[p]
        pivot = to_ground
        for d in range(length):
            pivot += work[p, d]
        ground[p] = pivot
        if pivot == 0.0:
            continue
        pull = result[p]
        for d in range(length):
            k = work[p, d]
            if k == 0.0:
                continue
            q = p + 1 + d
            if groups[p] == p:
                groups[p] = q
            part = k / pivot
            result[q] += part * pull
            ground[q] += part * to_ground
            if d + 1 < length:
                _lengthen(work, lengths, q, length - d - 1)
                row, added = work[q], work[p, d + 1 : length]
                for e in range(length - d - 1):
                    row[e] += part * added[e]
    for k in range(places.shape[0] - 1, -1, -1):
        p = places[k]
        if not sliding[p]:
            continue
        groups[p] = groups[groups[p]]
        total = result[p]
        for d in range(lengths[p]):
            total += work[p, d] * result[p + 1 + d]
        result[p] = total / ground[p] if ground[p] > 0.0 else 0.0
    return grounded


@lean
def pull_at(net, v, load, p):
    """Compute the force on a contact at rest.

    Args:
        net: band of the `Network`, and heads and near of its `Layout`.
        v: velocities, shape (N,).
        load: shape (N,) [N].
        p: position of the contact.

    Returns:
        The load plus the forces of the springs [N]; the sum of the absolute values of these terms [N]; the sum of the
        stiffnesses of its springs [N/m].
    """
    band, heads, near = net
    pull = load[p]
    size = abs(pull)
    total = 0.0
    for j in range(heads[p], heads[p + 1]):
        q = near[j]
        k = conductance(band, p, q)
        pull += k * v[q]
        size += abs(k * v[q])
        total += k
    return pull, size, total
