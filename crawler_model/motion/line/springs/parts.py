"""The parts of a body that flat springs separate: each may slide as a whole without changing its shape.

Without bent springs the whole body is one part, and contacts are visited in their order.
"""

from __future__ import annotations

from ....compiled import inlined, lean
from .bends import is_flat


@lean
def begin_parts(contacts, springs, model, curves, ramp):
    """Find the parts of a body, unless they are known.

    Args:
        contacts: CONTACT, shape (N,).
        springs: SPRING, shape (S,).
        model: a `Model`, in whose block the contacts of each part are listed together.
        curves: its `Curves`, or None.
        ramp: the RAMP.
    """
    if curves is None:
        return
    if ramp.parted:
        return
    ramp.parted = 1
    n, block, count = contacts.shape[0], model.block, 0
    for i in range(n):
        block[i].part = -1
    for i in range(n):
        if block[i].part >= 0:
            continue
        first = read = count
        block[i].part, block[count].member = first, i
        count += 1
        while read < count:
            c = contacts[block[read].member]
            read += 1
            for k in range(c.first, c.last):
                other = model.ends[k].other
                if block[other].part < 0 and not is_flat(springs[model.ends[k].spring], curves):
                    block[other].part, block[count].member = first, other
                    count += 1


@inlined
def member(block, curves, r):
    """Find the contact at a place in the list of parts.

    Args:
        block: BLOCK.
        curves: a `Curves`, or None.
        r: the place, 0 .. N - 1.

    Returns:
        The contact.
    """
    if curves is None:
        return r
    return block[r].member


@inlined
def find_last(block, curves, first, n):
    """Find the end of a part.

    Args:
        block: BLOCK.
        curves: a `Curves`, or None.
        first: place of its first contact.
        n: number of contacts N.

    Returns:
        The place behind its last contact.
    """
    if curves is None:
        return n
    last = first
    while last < n and block[block[last].member].part == first:
        last += 1
    return last


@inlined
def find_pull(contacts, springs, model, curves, i):
    """Find the force of the flat springs on a contact; those within a part cancel in its sum.

    Args:
        contacts: CONTACT, shape (N,).
        springs: SPRING, shape (S,).
        model: a `Model`.
        curves: its `Curves`, or None.
        i: the contact.

    Returns:
        The force [N].
    """
    if curves is None:
        return 0.0
    pull = 0.0
    for k in range(contacts[i].first, contacts[i].last):
        spring = springs[model.ends[k].spring]
        if is_flat(spring, curves):
            pull += model.ends[k].sign * spring.tension
    return pull


@inlined
def side_of(spring, block, first):
    """Find which end of a spring is in a part, if one is and the other is not.

    Args:
        spring: a SPRING.
        block: BLOCK, with the list of parts.
        first: place of the first contact of the part.

    Returns:
        1 if it is the end at b, so that the spring grows as the part slides forward; -1 if that at a; else 0.
    """
    return int(block[spring.b].part == first) - int(block[spring.a].part == first)
