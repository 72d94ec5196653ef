"""Pieces that follow each other because contacts of a segment begin to slide, taken as one.

When a segment is stretched, its contacts begin to slide one after another, and each is an event. Those that begin to
slide do not remember anything, so the derivatives are computed only where the last of these pieces ends: a ramp costs
as much as a few pieces. The derivative of the work in between follows from its balance,

    work = change of sum T^2 / (2 k) + sum of g_i (way of contact i),

as the force g_i on a contact that slides is its bound. This needs linear springs and bounds that do not change on the
ramp.
"""

from __future__ import annotations

from crawler_model.compiled import lean
from crawler_model.motion.pieces import FROM, HEADER, RAMP, UNTIL

from .kinks import AT_BOUND, INSTANT, find_slack, note_kink, sum_forces

STILL = 1e-12
"""A velocity below this part of the largest one is rounding."""
TO_THE_END = 1.0 - 1e-13
"""A piece that ends later on its ramp ends with it."""


@lean
def is_steady(system, commands):
    """Determine whether pieces of a ramp may be taken as one.

    Args:
        system: a `System`.
        commands: a `Commands`, on the ramp.

    Returns:
        Whether a body with segments has linear springs, and on the ramp friction everywhere, which does not change.
    """
    first, n = system.springs.shape[0], system.contacts.shape[0]
    if system.elements.shape[0] == 0 or system.curves is not None:
        return False
    for f in range(first, commands.change.shape[0]):
        if commands.change[f] != 0.0:
            return False
        for c in range(system.parameters.shape[0]):
            if commands.d_end[f, c] != commands.d_start[f, c]:
                return False
    held = True
    for i in range(n):
        held &= commands.start[first + i] + commands.start[first + n + i] > 0.0
    return held


@lean
def _store_energy(system, derivative, sign):
    """Add the derivative of the elastic energy to that of the work, or subtract it."""
    for s in range(system.springs.shape[0]):
        stretch = system.springs[s].tension / system.springs[s].stiffness
        for c in range(system.parameters.shape[0]):
            d_energy = stretch * (derivative.tension[s, c] - 0.5 * stretch * derivative.stiffness[s, c])
            system.parameters[c].d_work += sign * d_energy


@lean
def begin_ways(system, derivative):
    """Begin the account of pieces that are taken as one.

    Args:
        system: a `System`, at the start of the first piece.
        derivative: a `Derivative`, likewise.
    """
    for i in range(system.contacts.shape[0]):
        system.contacts[i].way = 0.0
    _store_energy(system, derivative, -1.0)


@lean
def go_on(contacts, piece):
    """Add what contacts slide on a piece to their ways.

    Args:
        contacts: CONTACT, shape (N,).
        piece: the PIECE.
    """
    for i in range(contacts.shape[0]):
        contacts[i].way += (piece.until - piece.begin) * contacts[i].v


@lean
def end_ways(system, derivative, commands):
    """Add the derivative of the work of pieces that were taken as one.

    Args:
        system: a `System`, at the end of the last piece.
        derivative: a `Derivative`, likewise, with the displacements at the start of the first one.
        commands: a `Commands`, likewise.
    """
    contacts, n, first = system.contacts, system.contacts.shape[0], system.springs.shape[0]
    _store_energy(system, derivative, 1.0)
    for i in range(n):
        way = contacts[i].way
        if way == 0.0:
            continue
        row, sign = (first + i, 1.0) if way > 0.0 else (first + n + i, -1.0)
        for c in range(system.parameters.shape[0]):
            moved = commands.target[row] * (derivative.dx[i, c] - derivative.earlier[i, c])
            system.parameters[c].d_work += sign * (commands.d_target[row, c] * way + moved)


@lean
def _direction(pieces, row, fastest, i):
    """Return in which direction a contact slides on a piece, 0 if it does not."""
    v = pieces[row, HEADER + i]
    if abs(v) <= STILL * fastest:
        return 0
    return 1 if v > 0.0 else -1


@lean
def _is_start(contacts, pieces, row, fastest):
    """Determine whether contacts that arrive at their bounds begin to slide on a piece, and nothing else changes."""
    n, count = contacts.shape[0], 0
    for i in range(n):
        contact, direction = contacts[i], _direction(pieces, row, fastest, i)
        if contact.sliding != 0:
            if direction != contact.sliding:
                return False
        elif (contact.arriving != 0) != (direction != 0):
            return False
        count += direction != 0
    return count < n - 1


@lean
def _is_at_bound(contact, commands, first, n, i):
    """Determine whether a force is at a bound, as in `look_at_bounds`."""
    forward, backward = commands.start[first + i], commands.start[first + n + i]
    slack = min(forward - contact.force, backward + contact.force)
    return slack <= AT_BOUND * (contact.size + abs(forward) + abs(backward))


@lean
def _stays(system, pieces, row, fastest, i):
    """Find whether the force on a contact at rest is constant on the piece, and also on the next one."""
    contacts = system.contacts
    before = abs(contacts[i].force_rate) <= AT_BOUND * contacts[i].rate_size
    after = before
    for e in range(system.first[i], system.first[i + 1]):
        spring = system.springs[system.around[e]]
        o = spring.b if spring.a == i else spring.a
        before &= contacts[o].sliding == 0
        after &= _direction(pieces, row, fastest, o) == 0
    return before, after


@lean
def _look_at(system, derivative, commands, piece, i):
    """Note a kink if a contact is at its bound, among contacts at rest, and parameters would change that."""
    springs, d_target, place = system.springs, commands.d_target, piece.until
    for e in range(system.first[i], system.first[i + 1]):
        s = system.around[e]
        spring = springs[s]
        for c in range(system.parameters.shape[0]):
            d_target[s, c] = commands.d_start[s, c] + place * (commands.d_end[s, c] - commands.d_start[s, c])
            derivative.own[s, c] = derivative.stiffness[s, c] * spring.tension / spring.stiffness
            growth = derivative.dx[spring.b, c] - derivative.dx[spring.a, c] - d_target[s, c]
            derivative.tension[s, c] = spring.stiffness * growth + derivative.own[s, c]
    row, n = springs.shape[0] + i, system.contacts.shape[0]
    ahead = commands.start[row] - system.contacts[i].force < commands.start[row + n] + system.contacts[i].force
    if find_slack(system, derivative, d_target, i, ahead):
        note_kink(system, piece, i)


@lean
def pass_start(system, derivative, commands, pieces, piece):
    """Begin the next piece of the ramp, if contacts begin to slide there and nothing else happens.

    Args:
        system: a `System`, at the end of the piece; changed to the next one.
        derivative: a `Derivative`, at the start of the first piece that is taken as one with the others.
        commands: a `Commands`, on the ramp.
        pieces: as in a `Course`.
        piece: the PIECE, changed to the next one.

    Returns:
        Whether it did.
    """
    contacts, row = system.contacts, piece.next
    n, first = contacts.shape[0], system.springs.shape[0]
    if piece.until == 1.0 or row == pieces.shape[0] or pieces[row, RAMP] != piece.ramp:
        return False
    until = pieces[row, UNTIL] if pieces[row, UNTIL] <= TO_THE_END else 1.0
    if pieces[row, FROM] != piece.until or until - pieces[row, FROM] < INSTANT:
        return False
    fastest = 0.0
    for i in range(n):
        fastest = max(fastest, abs(pieces[row, HEADER + i]))
    if not _is_start(contacts, pieces, row, fastest):
        return False
    sum_forces(contacts, system.springs)
    for looking in (False, True):
        for i in range(n):
            contact = contacts[i]
            if contact.sliding != 0 or contact.arriving != 0 or not _is_at_bound(contact, commands, first, n, i):
                continue
            before, after = _stays(system, pieces, row, fastest, i)
            if not before:
                return False
            if looking and not after:
                _look_at(system, derivative, commands, piece, i)
    for i in range(n):
        contacts[i].sliding = _direction(pieces, row, fastest, i)
        contacts[i].v = pieces[row, HEADER + i] if contacts[i].sliding != 0 else 0.0
        contacts[i].arriving = int(pieces[row, HEADER + n + i])
    piece.next += 1
    piece.begin, piece.until = piece.until, until
    return True
