"""Pieces that follow each other because contacts of a segment begin to slide, taken as one.

When a segment is stretched, its contacts begin to slide one after another, and each is an event. Those that begin to
slide do not remember anything, so the derivatives are computed only where the last of these pieces ends: a ramp costs
as much as a few pieces, and each event only what it changes. How contacts moved in between follows from the balance of
those that slide at the end,

    K_SS (way)_S = (change of the pull of the actuators)_S - (bounds - forces at the start)_S,

their velocities from its rates, and the work from the balance of the energy,

    work = change of sum T^2 / (2 k) + sum of g_i (way of contact i),

as the force g_i on a contact that slides is its bound. This needs linear springs and bounds that do not change on the
ramp; the changes of contacts are then noted, see `motion.pieces`.
"""

from __future__ import annotations

from crawler_model.compiled import inlined, lean
from crawler_model.motion.pieces import CHANGED, FROM, RAMP, REACHES, SPEED, STATE

from .elimination import eliminate_many
from .kinks import AT_BOUND, INSTANT, find_slack, note_kink, sum_forces

TO_THE_END = 1.0 - 1e-13
"""A piece that ends later on its ramp ends with it."""


@lean
def _store_energy(system, derivative, piece, sign):
    """Add the elastic energy and its derivative to the work, or subtract them."""
    for s in range(system.springs.shape[0]):
        stretch = system.springs[s].tension / system.springs[s].stiffness
        piece.work += sign * 0.5 * stretch * system.springs[s].tension
        for c in range(system.parameters.shape[0]):
            d_energy = stretch * (derivative.tension[s, c] - 0.5 * stretch * derivative.stiffness[s, c])
            system.parameters[c].d_work += sign * d_energy


@lean
def begin_ways(system, derivative, piece):
    """Begin the account of pieces that are taken as one.

    Args:
        system: a `System`, at the start of the first piece.
        derivative: a `Derivative`, at the same place.
        piece: the PIECE.
    """
    _store_energy(system, derivative, piece, -1.0)


@lean
def end_ways(system, derivative, commands, piece):
    """Add the work of pieces that were taken as one, and its derivative.

    Args:
        system: a `System`, at the end of the last piece.
        derivative: a `Derivative`, at the same place, but with the displacements at the start of the first one.
        commands: a `Commands`, at the end of the last piece.
        piece: the PIECE.
    """
    contacts, n, first = system.contacts, system.contacts.shape[0], system.springs.shape[0]
    _store_energy(system, derivative, piece, 1.0)
    for i in range(n):
        way = contacts[i].way
        if way == 0.0:
            continue
        row, sign = (first + i, 1.0) if way > 0.0 else (first + n + i, -1.0)
        piece.work += sign * commands.target[row] * way
        for c in range(system.parameters.shape[0]):
            moved = commands.target[row] * (derivative.dx[i, c] - derivative.earlier[i, c])
            system.parameters[c].d_work += sign * (commands.d_target[row, c] * way + moved)


@inlined
def _direction(state):
    """Return the direction in which a contact slides, 0 if it does not."""
    return state if abs(state) == 1 else 0


@lean
def _read_instant(contacts, changes, piece):
    """Read what changes at the end of the piece: states, and the bounds that are reached; returns the row behind."""
    row = piece.next
    while row < changes.shape[0] and changes[row, RAMP] == piece.ramp and changes[row, FROM] <= piece.until + INSTANT:
        contact, reaches = contacts[int(changes[row, CHANGED])], int(changes[row, REACHES])
        if reaches != 0:
            contact.arriving |= reaches
        else:
            contact.state, contact.speed = int(changes[row, STATE]), changes[row, SPEED]
        row += 1
    return row


@lean
def _find_end(changes, piece):
    """Find where the piece of the ramp that begins ends: at the next change."""
    piece.begin, piece.until = piece.until, 1.0
    row = piece.next
    if row < changes.shape[0] and changes[row, RAMP] == piece.ramp and changes[row, FROM] <= TO_THE_END:
        piece.until = changes[row, FROM]


@lean
def _solve_motion(system, commands, piece):
    """Solve for the velocities on the piece, and for how contacts moved on all that are taken as one with it."""
    contacts, springs, load, motion = system.contacts, system.springs, system.load, system.motion
    n, first, length = contacts.shape[0], springs.shape[0], piece.until - piece.first
    for i in range(n):
        contact = contacts[i]
        for c in range(2):
            load[i, c] = motion[i, c] = 0.0
        if contact.sliding > 0:
            load[i, 0] = contact.force - commands.start[first + i]
        elif contact.sliding < 0:
            load[i, 0] = contact.force + commands.start[first + n + i]
    for s in range(first):
        pull = -springs[s].stiffness * commands.change[s]
        for c in range(2):
            load[springs[s].a, c] += pull if c == 1 else length * pull
            load[springs[s].b, c] -= pull if c == 1 else length * pull
    eliminate_many(contacts, system.band, load, motion)
    for i in range(n):
        contacts[i].way, contacts[i].v = motion[i, 0], motion[i, 1]


@lean
def begin_changed(system, commands, changes, piece):
    """Begin a piece where the last one ended, on a ramp whose changes are noted.

    Args:
        system: a `System`, at the end of the last piece; states and velocities are written.
        commands: a `Commands`, on the ramp.
        changes: as the pieces of a `Course`.
        piece: the PIECE, changed to the next one.

    Returns:
        How many contacts slide.
    """
    contacts = system.contacts
    piece.next = _read_instant(contacts, changes, piece)
    _find_end(changes, piece)
    piece.first, piece.riders, sliding = piece.begin, 0, 0
    for i in range(contacts.shape[0]):
        contact = contacts[i]
        contact.sliding, contact.arriving = _direction(contact.state), 0
        contact.held = contact.state if contact.sliding == 0 else 0
        contact.v = contact.way = 0.0
        sliding += contact.sliding != 0
    sum_forces(contacts, system.springs)
    if sliding == contacts.shape[0]:
        for i in range(sliding):  # no contact at rest determines them
            contacts[i].v = contacts[i].speed
    elif sliding > 0:
        _solve_motion(system, commands, piece)
    return sliding


@lean
def end_changed(system, commands, piece, sliding):
    """Find how contacts moved up to the end of a piece that changes end, and of pieces that are taken as one with it.

    Args:
        system: a `System`, with forces at the start of the first piece.
        commands: a `Commands`, on the ramp.
        piece: the PIECE.
        sliding: how many contacts slide.
    """
    contacts = system.contacts
    if 0 < sliding < contacts.shape[0]:
        _solve_motion(system, commands, piece)
    else:
        for i in range(contacts.shape[0]):
            contacts[i].way = (piece.until - piece.begin) * contacts[i].v


@lean
def _rests_at_bound(system, commands, piece, i):
    """Determine whether a contact that rests among others that did so far is at a bound, as in `look_at_bounds`."""
    contact, first, n = system.contacts[i], system.springs.shape[0], system.contacts.shape[0]
    if contact.held != 0:
        return True
    force = size = 0.0
    for e in range(system.first[i], system.first[i + 1]):
        tension = _tension_at(system, commands, piece, system.around[e])
        force += tension if system.springs[system.around[e]].a == i else -tension
        size += abs(tension)
    forward, backward = commands.start[first + i], commands.start[first + n + i]
    slack = min(forward - force, backward + force)
    return slack <= AT_BOUND * (size + abs(forward) + abs(backward))


@inlined
def _tension_at(system, commands, piece, s):
    """Return the tension of a spring between contacts that rest, at the end of the piece."""
    spring = system.springs[s]
    return spring.tension - spring.stiffness * commands.change[s] * (piece.until - piece.first)


@lean
def _look_at(system, derivative, commands, piece, i):
    """Note a kink if a contact is at its bound, among contacts at rest, and parameters would change that."""
    springs, d_target, place = system.springs, commands.d_target, piece.until
    force = 0.0
    for e in range(system.first[i], system.first[i + 1]):
        s = system.around[e]
        spring, tension = springs[s], _tension_at(system, commands, piece, s)
        force += tension if spring.a == i else -tension
        for c in range(system.parameters.shape[0]):
            d_target[s, c] = commands.d_start[s, c] + place * (commands.d_end[s, c] - commands.d_start[s, c])
            derivative.own[s, c] = derivative.stiffness[s, c] * tension / spring.stiffness
            growth = derivative.dx[spring.b, c] - derivative.dx[spring.a, c] - d_target[s, c]
            derivative.tension[s, c] = spring.stiffness * growth + derivative.own[s, c]
    row, n = springs.shape[0] + i, system.contacts.shape[0]
    ahead = commands.start[row] - force < commands.start[row + n] + force
    if find_slack(system, derivative, d_target, i, ahead):
        note_kink(system, piece, i)


@lean
def _look_beside(system, derivative, commands, piece, i):
    """Look at the contacts at rest next to one that begins to slide: at their bounds they may have a kink.

    A contact that stays at its bound next to one that slides is a rider: whether it goes on so depends on all others.
    """
    contacts, springs = system.contacts, system.springs
    for e in range(system.first[i], system.first[i + 1]):
        spring = springs[system.around[e]]
        j = spring.b if spring.a == i else spring.a
        if _direction(contacts[j].state) != 0:
            continue
        piece.riders += contacts[j].state != 0
        among = True
        for f in range(system.first[j], system.first[j + 1]):
            beyond = springs[system.around[f]]
            among &= contacts[beyond.b if beyond.a == j else beyond.a].sliding == 0
        if among and _rests_at_bound(system, commands, piece, j):
            _look_at(system, derivative, commands, piece, j)


@lean
def _is_start(system, changes, piece, behind, sliding):
    """Count contacts that slide after an instant if all that arrive at bounds begin to slide there; 0 if others do."""
    contacts = system.contacts
    for row in range(piece.next, behind):
        contact = contacts[int(changes[row, CHANGED])]
        direction = _direction(contact.state)
        if contact.sliding != 0 and direction != contact.sliding:
            return 0
        if contact.sliding == 0 and (contact.arriving != 0) != (direction != 0):
            return 0
        sliding += changes[row, REACHES] != 0.0
    return sliding if sliding < contacts.shape[0] - 1 and piece.riders == 0 else 0


@lean
def pass_starts(system, derivative, commands, changes, piece, sliding):
    """Go on to the piece of the ramp that ends otherwise than by contacts that begin to slide.

    Args:
        system: a `System`, at the start of the piece; states are changed to the states at the end.
        derivative: a `Derivative`, at the start of the piece.
        commands: a `Commands`, on the ramp.
        changes: as the pieces of a `Course`.
        piece: the PIECE, changed to the last one that is taken as one with it.
        sliding: how many contacts slide at its start.

    Returns:
        How many slide at its end.
    """
    contacts = system.contacts
    while True:
        behind = _read_instant(contacts, changes, piece)
        more = 0
        if piece.until < 1.0 and sliding < contacts.shape[0] - 1:
            more = _is_start(system, changes, piece, behind, sliding)
        if more == 0:
            return sliding
        sliding = more
        for row in range(piece.next, behind):
            if changes[row, REACHES] != 0.0:
                _look_beside(system, derivative, commands, piece, int(changes[row, CHANGED]))
        for row in range(piece.next, behind):
            contact = contacts[int(changes[row, CHANGED])]
            contact.sliding, contact.arriving = _direction(contact.state), 0
            contact.held = contact.state if contact.sliding == 0 else 0
        piece.next = behind
        _find_end(changes, piece)
