"""The linear system of the sliding contacts of a graph, eliminated like a network of resistors (star-mesh transform).

Conductances are only added, never subtracted, so that large stiffness ratios lose no digits. Contacts are numbered to
make the matrix a narrow band (reverse Cuthill-McKee), and a row holds only the next `width` contacts; beyond the last
one that slides, a row is not read.
"""

from __future__ import annotations

from ...compiled import lean


@lean
def eliminate(band, work, ground, lengths, groups, load, sliding, result, places):
    """Solve K v = load for the sliding contacts, with the others at rest; all arrays in the order of the band.

    Args:
        band: as in `Network`, shape (N, width) [N/m].
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
    n, width = band.shape
    grounded = False
    for p in places:
        ground[p] = 0.0
        result[p] = load[p] if sliding[p] else 0.0
        grounded = grounded or not sliding[p]
    for p in places:  # a spring to a contact at rest is a spring to the ground
        length = 0
        for d in range(min(width, n - 1 - p)):
            k = band[p, d]
            work[p, d] = 0.0
            if k == 0.0:
                continue
            if sliding[p]:
                if sliding[p + 1 + d]:
                    work[p, d] = k
                    length = d + 1
                else:
                    ground[p] += k
            elif sliding[p + 1 + d]:
                ground[p + 1 + d] += k
        lengths[p] = length
        groups[p] = p
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
                lengths[q] = max(lengths[q], length - d - 1)
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
def pull_at(band, v, load, p):
    """Compute the force on a contact at rest.

    Args:
        band: as in `Network`, shape (N, width) [N/m].
        v: velocities, shape (N,).
        load: shape (N,) [N].
        p: position of the contact.

    Returns:
        The load plus the forces of the springs [N]; the sum of the absolute values of these terms [N]; the sum of the
        stiffnesses of its springs [N/m].
    """
    n, width = band.shape
    pull = load[p]
    size = abs(pull)
    total = 0.0
    for d in range(min(width, n - 1 - p)):
        k = band[p, d]
        if k != 0.0:
            pull += k * v[p + 1 + d]
            size += abs(k * v[p + 1 + d])
            total += k
    for d in range(min(width, p)):
        k = band[p - 1 - d, d]
        if k != 0.0:
            pull += k * v[p - 1 - d]
            size += abs(k * v[p - 1 - d])
            total += k
    return pull, size, total
