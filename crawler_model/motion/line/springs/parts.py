"""The parts of a body that flat springs separate: each may slide as a whole without changing its shape.

Without bent springs the whole body is one part, and contacts are visited in their order.
"""

from __future__ import annotations

from ....compiled import inlined, lean
from .bends import is_flat


@inlined
def list_beside(contacts, springs, model, curves, ramp, i):
    """List the contacts that springs which are not flat join to a listed one; they are of the same part.

    Args:
        curves: the `Curves`, in which the contacts are listed behind the `last` place.
        ramp: the RAMP; `present` is the number of the part.
        i: the listed contact.
    """
    for k in range(contacts[i].first, contacts[i].last):
        other = model.ends[k].other
        if curves.strays[other].part != ramp.present and not is_flat(springs[model.ends[k].spring], curves):
            curves.strays[other].part, curves.members[ramp.last] = ramp.present, other
            ramp.last += 1


@lean
def begin_parts(contacts, springs, model, curves, ramp):
    """Find the parts of a body, unless they are known; `next_part` then goes on to the first of them."""
    _list_parts(contacts, springs, model, curves, ramp)
    ramp.last = 0


@lean
def _list_parts(contacts, springs, model, curves, ramp):
    """List the contacts of each part together, unless they are listed."""
    if curves is None or ramp.parted:
        return
    ramp.parted = 1
    n, members, strays, read = contacts.shape[0], curves.members, curves.strays, 0
    ramp.last = 0
    for i in range(n):
        strays[i].part = -1
    for i in range(n):
        if strays[i].part >= 0:
            continue
        ramp.present = strays[i].part = ramp.last
        members[ramp.last] = i
        ramp.last += 1
        while read < ramp.last:
            list_beside(contacts, springs, model, curves, ramp, members[read])
            read += 1


@inlined
def member(curves, r):
    """Find the contact at a place in the list of parts.

    Args:
        r: the place, 0 .. N - 1.

    Returns:
        The contact.
    """
    if curves is None:
        return r
    return curves.members[r]


@inlined
def next_part(curves, ramp, n):
    """Go on to the next part of the body.

    Returns:
        Whether there is one.
    """
    if ramp.last == n:
        return False
    if curves is None:
        ramp.last = n
        return True
    ramp.first = ramp.present = ramp.last
    ramp.last += 1
    while ramp.last < n and curves.strays[curves.members[ramp.last]].part == ramp.present:
        ramp.last += 1
    if not ramp.first <= ramp.witness < ramp.last:
        ramp.witness = ramp.first
    return True


@inlined
def begin_alone(curves, ramp, i):
    """Begin to list the part of only one contact; it becomes the present one.

    Args:
        ramp: the RAMP; the parts of the body are unknown afterwards.
    """
    ramp.parts -= 1  # numbers below the list of all parts
    ramp.parted, ramp.present, ramp.first, ramp.last, ramp.witness = 0, ramp.parts, 0, 1, 0
    curves.strays[i].part, curves.members[0] = ramp.parts, i


@lean
def find_part(contacts, springs, model, curves, ramp, i):
    """List the part of only one contact, in proportion to its size; it becomes the present one, see `begin_alone`."""
    begin_alone(curves, ramp, i)
    read = 0
    while read < ramp.last:
        list_beside(contacts, springs, model, curves, ramp, curves.members[read])
        read += 1


@inlined
def present_part(contacts, curves, ramp):
    """Find the places of the present part in the list of parts, from the first to behind the last.

    Returns:
        Both.
    """
    if curves is None:
        return 0, contacts.shape[0]
    return ramp.first, ramp.last


@inlined
def find_pull(contacts, springs, model, curves, i):
    """Find the force of the flat springs on a contact; springs within a part cancel in its sum.

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
def side_of(spring, curves, part):
    """Find which end of a spring is in a part, if one is and the other is not.

    Args:
        part: number of the part.

    Returns:
        1 if it is the end at b, so that the spring grows as the part slides forward; -1 if that at a; else 0.
    """
    return int(curves.strays[spring.b].part == part) - int(curves.strays[spring.a].part == part)
