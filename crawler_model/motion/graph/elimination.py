"""The linear system of the sliding contacts of a graph, eliminated like a network of resistors (star-mesh transform).

Conductances are only added, never subtracted, so that large stiffness ratios lose no digits. Contacts are numbered to
make the matrix a narrow band (reverse Cuthill-McKee), and a row holds only the next `width` sliding contacts; beyond
the last one that it joins, a row is not read.
"""

from __future__ import annotations

from ...compiled import lean

WIDE = 8
"""Width of a band above which the smaller bands of groups of contacts are worth their numbering."""


@lean
def _lengthen(work, lengths, r, length):
    """Fill row r with zeros up to a length."""
    for d in range(lengths[r], length):
        work[r, d] = 0.0
    lengths[r] = max(lengths[r], length)


@lean
def _number(sliding, ints, places):
    """Number the sliding contacts in the order of the band; return how many there are."""
    groups, ranks, members = ints[1], ints[3], ints[4]
    count = 0
    for p in places:
        groups[p] = p
        if sliding[p]:
            ranks[p] = count
            members[count] = p
            count += 1
    return count


@lean
def _number_groups(heads, near, sliding, ints, places):
    """Find the groups of sliding contacts that springs join, and number their contacts, group by group.

    Returns the number of sliding contacts.
    """
    groups, sizes, ranks, members = ints[1], ints[2], ints[3], ints[4]
    for p in places:
        groups[p] = p
        if not sliding[p]:
            continue
        for k in range(heads[p], heads[p + 1]):
            q = near[k]
            if q > p:
                break
            if sliding[q]:
                while groups[q] != q:
                    groups[q] = groups[groups[q]]
                    q = groups[q]
                groups[q] = p
    for k in range(places.shape[0] - 1, -1, -1):  # the last contact of a group, which stands for it, comes first
        p = places[k]
        if sliding[p]:
            groups[p] = groups[groups[p]]
            sizes[p] = 0
            sizes[groups[p]] += 1
    count = 0
    for p in places:
        if sliding[p] and groups[p] == p:
            ranks[p] = count  # that of the first one of the group, then of the next
            count += sizes[p]
    for p in places:
        if sliding[p]:
            g = groups[p]
            rank = ranks[g]
            ranks[g] = rank + 1
            ranks[p] = rank
            members[rank] = p
    return count


@lean
def eliminate(net, work, ground, ints, load, sliding, result, places):
    """Solve K v = load for the sliding contacts, with the others at rest; all arrays in the order of the band.

    In a wide band, the contacts of a group, which springs join without passing a contact at rest, are numbered one
    after the other: the band of a small group is narrow, wherever its contacts are in the band of the body.

    Args:
        net: conductances of the `Network`, and heads and near of its `Layout`.
        work: scratch memory, shape (N, width).
        ground: scratch memory, shape (N,).
        ints: scratch memory, int, shape (5, N). Row 1 is an output: for each sliding contact the last position in its
            group; for the others their own position.
        load: forces, shape (N,) [N].
        sliding: 1 for sliding contacts, else 0, int8, shape (N,).
        result: output, v, shape (N,).
        places: positions of the sliding contacts and of all that springs join to them, increasing, int, shape (P,).

    Returns:
        False if none of these contacts is at rest. The last one is then set at rest, and K v = load holds for the
        others.
    """
    conductances, heads, near = net
    lengths, groups, ranks, members = ints[0], ints[1], ints[3], ints[4]
    wide = work.shape[1] > WIDE
    count = _number_groups(heads, near, sliding, ints, places) if wide else _number(sliding, ints, places)
    for p in places:
        result[p] = load[p] if sliding[p] else 0.0
    for r in range(count):
        p = members[r]
        ground[p] = 0.0
        lengths[r] = 0
        for k in range(heads[p], heads[p + 1]):
            q = near[k]
            if not sliding[q]:  # a spring to a contact at rest is a spring to the ground
                ground[p] += conductances[k]
            elif q > p:
                d = ranks[q] - r - 1
                _lengthen(work, lengths, r, d + 1)
                work[r, d] = conductances[k]
    for r in range(count):
        p = members[r]
        length = lengths[r]
        to_ground = ground[p]
        pivot = to_ground
        for d in range(length):
            pivot += work[r, d]
        ground[p] = pivot
        if pivot == 0.0:
            continue
        pull = result[p]
        for d in range(length):
            k = work[r, d]
            if k == 0.0:
                continue
            q = members[r + 1 + d]
            if groups[p] == p:
                groups[p] = q
            part = k / pivot
            result[q] += part * pull
            ground[q] += part * to_ground
            if d + 1 < length:
                _lengthen(work, lengths, r + 1 + d, length - d - 1)
                row, added = work[r + 1 + d], work[r, d + 1 : length]
                for e in range(length - d - 1):
                    row[e] += part * added[e]
    for r in range(count - 1, -1, -1):
        p = members[r]
        groups[p] = groups[groups[p]]
        total = result[p]
        for d in range(lengths[r]):
            total += work[r, d] * result[members[r + 1 + d]]
        result[p] = total / ground[p] if ground[p] > 0.0 else 0.0
    return count < places.shape[0]


@lean
def pull_at(net, v, load, p):
    """Compute the force on a contact at rest.

    Args:
        net: conductances of the `Network`, and heads and near of its `Layout`.
        v: velocities, shape (N,).
        load: shape (N,) [N].
        p: position of the contact.

    Returns:
        The load plus the forces of the springs [N]; the sum of the absolute values of these terms [N]; the sum of the
        stiffnesses of its springs [N/m].
    """
    conductances, heads, near = net
    pull = load[p]
    size = abs(pull)
    total = 0.0
    for j in range(heads[p], heads[p + 1]):
        q = near[j]
        k = conductances[j]
        pull += k * v[q]
        size += abs(k * v[q])
        total += k
    return pull, size, total
