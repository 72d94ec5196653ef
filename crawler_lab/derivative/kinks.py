"""The ends of pieces: which contacts reach a bound there, when, and whether the derivative is one-sided.

The derivative is one-sided where the order of two events decides who stops, and where a contact is at its bound without
sliding although a change of the parameters would lift it off or push it over: such a kink is noted.
"""

from __future__ import annotations

from crawler_model.compiled import lean

from .records import CORNER, EVENT, TIE

AT_BOUND = 1e-10
"""A force closer to its bound than this, relative to the forces around the contact, is at its bound."""
SAME = 1e-8
"""Derivatives closer than this, relative to the terms whose difference they are, are equal."""
_ROUNDING = 1e-11
"""Derivatives smaller than this part of the largest terms met are rounding, their parameters' included."""
_SHORTEST = 1e-8
"""On a shorter part of a ramp a contact that has just left its bound is still close to it."""
INSTANT = 1e-11
"""Events closer together than this part of a ramp are simultaneous."""


@lean
def mark(kinks, ramp, place, contact):
    """Note a kink.

    Args:
        kinks: ramp, place and contact, shape (rows, 3); the first row counts.
        ramp: the ramp.
        place: the place on it.
        contact: the contact.
    """
    kinks[0, 0] += 1.0
    row = int(kinks[0, 0])
    if row < kinks.shape[0]:
        kinks[row, 0] = ramp
        kinks[row, 1] = place
        kinks[row, 2] = contact


@lean
def pass_end(system, dx, piece):
    """Carry the derivatives over the end of the last piece, and find the kinks there.

    Args:
        system: a `System`, with the velocities and directions of the next piece.
        dx: derivatives of the displacements, shape (N, P), changed in place.
        piece: the next PIECE.

    Returns:
        Whether contacts begin to slide, or springs are at knots, there at places that depend on the parameters in
        different ways.
    """
    contacts, parameters = system.contacts, system.parameters
    kind = piece.ended
    stopped, arrived = False, piece.knots > 0
    for i in range(contacts.shape[0]):
        stopped |= contacts[i].v_before != 0.0 and contacts[i].sliding == 0
        arrived |= contacts[i].arrived > 1
    tied = stopped and (kind == TIE or (kind == CORNER and arrived))
    for i in range(contacts.shape[0]):
        contact = contacts[i]
        moved = contact.v_before != 0.0 and contact.sliding == 0
        if (contact.arrived > 1 and (contact.sliding == 0 or tied)) or (tied and moved):
            mark(system.kinks, piece.ramp, piece.begin, i)
            for c in range(parameters.shape[0]):
                parameters[c].one_sided |= parameters[c].moves
        change = contact.v_before - contact.v
        if kind >= EVENT and change != 0.0:
            for c in range(parameters.shape[0]):
                dx[i, c] += change * parameters[c].d_place
    return arrived and kind in (TIE, CORNER)


@lean
def sum_forces(contacts, springs):
    """Sum the spring forces on the contacts, their rates, and the sizes of both.

    Args:
        contacts: CONTACT, shape (N,), changed in place.
        springs: SPRING, shape (S,).
    """
    for i in range(contacts.shape[0]):
        contact = contacts[i]
        contact.force = contact.force_rate = contact.size = contact.rate_size = 0.0
    for s in range(springs.shape[0]):
        spring = springs[s]
        for i, sign in ((spring.a, 1.0), (spring.b, -1.0)):
            contact = contacts[i]
            contact.force += sign * spring.tension
            contact.force_rate += sign * spring.rate
            contact.size += abs(spring.tension)
            contact.rate_size += abs(spring.rate)


@lean
def find_slack(system, derivative, d_target, i, ahead):
    """Find the derivatives of the distance of a force from its bound.

    Args:
        system: a `System`, whose parameters are written.
        derivative: a `Derivative`.
        d_target: derivatives of the commands, shape (F, P).
        i: the contact.
        ahead: whether the bound is the forward one.

    Returns:
        Whether any parameter changes it.
    """
    springs, parameters = system.springs, system.parameters
    row = springs.shape[0] + (i if ahead else system.contacts.shape[0] + i)
    for c in range(parameters.shape[0]):
        parameters[c].d_slack = d_target[row, c]
        parameters[c].d_size = abs(d_target[row, c])
    for e in range(system.first[i], system.first[i + 1]):
        s = system.around[e]
        spring = springs[s]
        sign = 1.0 if (spring.a == i) == ahead else -1.0
        for c in range(parameters.shape[0]):
            terms = abs(derivative.dx[spring.a, c]) + abs(derivative.dx[spring.b, c]) + abs(d_target[s, c])
            parameters[c].d_slack -= sign * derivative.tension[s, c]
            parameters[c].d_size += spring.stiffness * terms + abs(derivative.own[s, c])
    return find_moves(parameters)


@lean
def find_moves(parameters):
    """Determine whether any parameter changes a slack, and note which do.

    Args:
        parameters: PARAMETER, shape (P,), with the derivatives of the slack.

    Returns:
        Whether any does.
    """
    found = False
    for c in range(parameters.shape[0]):
        parameter = parameters[c]
        parameter.scale = max(parameter.scale, parameter.d_size)
        if abs(parameter.d_slack) > SAME * parameter.d_size + _ROUNDING * parameter.scale:
            parameter.moves = found = True
    return found


@lean
def note_arrival(parameters, piece, closing, fastest):
    """Note the derivative of the place of an event, or that parameters change its order with another event.

    Args:
        parameters: PARAMETER, shape (P,), with the derivatives of the slack.
        piece: the PIECE that ends there.
        closing: how fast the slack shrinks [N per ramp].
        fastest: how fast the fastest one of earlier events at the same place does; 0 without one [N per ramp].
    """
    if fastest > 0.0:  # another event is at the same place
        for c in range(parameters.shape[0]):
            parameter = parameters[c]
            terms = parameter.d_size / closing + parameter.place_size
            if abs(parameter.d_slack / closing - parameter.d_place) > SAME * terms:
                piece.ended = TIE
    if closing > fastest:
        for c in range(parameters.shape[0]):
            parameter = parameters[c]
            parameter.d_place = parameter.d_slack / closing
            parameter.place_size = parameter.d_size / closing


@lean
def note_kink(system, piece, i):
    """Note a kink at the end of a piece: a slack is zero there, and parameters would change that.

    Args:
        system: a `System`; its parameters hold the derivatives of the slack.
        piece: the PIECE.
        i: the contact.
    """
    mark(system.kinks, piece.ramp, piece.until, i)
    for c in range(system.parameters.shape[0]):
        parameter = system.parameters[c]
        parameter.one_sided |= abs(parameter.d_slack) > SAME * parameter.d_size + _ROUNDING * parameter.scale


@lean
def look_at_bounds(system, derivative, commands, piece):
    """Find at the end of a piece which contacts reach a bound, and the derivative of where on the ramp they do.

    Args:
        system: a `System`, with the tensions at the end; arrivals are written.
        derivative: a `Derivative`, at the end.
        commands: a `Commands`, at the end.
        piece: the PIECE; how it ended is written.

    Returns:
        How fast the arriving contact that does so fastest approaches its bound; 0 if none arrives [N per ramp].
    """
    contacts, parameters = system.contacts, system.parameters
    n, springs = contacts.shape[0], system.springs.shape[0]
    sum_forces(contacts, system.springs)
    piece.ended = CORNER if piece.until == 1.0 else EVENT
    for c in range(parameters.shape[0]):
        parameter = parameters[c]
        parameter.d_place = parameter.place_size = 0.0
        parameter.moves = False
    fastest = 0.0
    for i in range(n):
        contact = contacts[i]
        contact.arrived = 0
        forward, backward = commands.target[springs + i], commands.target[springs + n + i]
        if contact.sliding != 0 or forward + backward == 0.0:
            continue
        above, below = forward - contact.force, backward + contact.force
        near = AT_BOUND * (contact.size + abs(forward) + abs(backward))
        arrives = contact.arriving != 0
        ahead = contact.arriving == 1 if arrives else above < below
        bound_rate = commands.change[springs + i] if ahead else commands.change[springs + n + i]
        closing = (contact.force_rate if ahead else -contact.force_rate) - bound_rate
        slack = above if ahead else below
        if contact.held != 0 and not arrives:  # its force stays at the bound to the last bit
            ahead, closing, slack = contact.held > 0, 0.0, 0.0
        if closing > AT_BOUND * (contact.rate_size + abs(bound_rate)):
            arrives |= slack <= closing * INSTANT + 1e-4 * near
        if not arrives and (slack > near or piece.until - piece.begin < _SHORTEST):
            continue
        depends = find_slack(system, derivative, commands.d_target, i, ahead)
        if not arrives:
            if depends:
                note_kink(system, piece, i)
            continue
        contact.arrived = 2 if depends else 1
        if piece.until < 1.0:
            note_arrival(parameters, piece, closing, fastest)
            fastest = max(fastest, closing)
    return fastest


@lean
def look_at_choice(system, derivative, commands, piece):
    """Find at the end of a piece whether its translation was chosen, and is at a kink of the choice.

    Where all contacts stay at their bounds, the translation nearest to no net translation is chosen from those that
    friction admits. At a kink no net translation and an end of these, where a contact rests, are the same: beyond it
    either the one or the other is chosen.

    Args:
        system: a `System`, with the forces and rates at the end.
        derivative: a `Derivative`, at the end, with the displacements at the start of the piece as `earlier`.
        commands: a `Commands`, at the end.
        piece: the PIECE.
    """
    contacts, springs = system.contacts, system.springs.shape[0]
    n = contacts.shape[0]
    drift = fastest = 0.0
    for i in range(n):
        contact = contacts[i]
        drift += contact.share * contact.v
        fastest = max(fastest, abs(contact.v))
        if contact.sliding != 0:
            continue
        ahead = commands.target[springs + i] - contact.force < commands.target[springs + n + i] + contact.force
        bound, change = commands.target[springs + n + i], commands.change[springs + n + i]
        force, rate = -contact.force, -contact.force_rate
        if ahead:
            bound, change = commands.target[springs + i], commands.change[springs + i]
            force, rate = contact.force, contact.force_rate
        near = bound - force <= AT_BOUND * (contact.size + abs(bound))
        stays = near and abs(rate - change) <= AT_BOUND * (contact.rate_size + abs(change))
        if not stays and contact.held == 0:
            return
    if abs(drift) > SAME * fastest:
        return
    marked = False
    for c in range(system.parameters.shape[0]):
        moved = size = 0.0
        for i in range(n):
            change = contacts[i].share * (derivative.dx[i, c] - derivative.earlier[i, c])
            moved += change
            size += abs(change)
        if abs(moved) > SAME * size:
            system.parameters[c].one_sided = marked = True
    for i in range(n if marked else 0):
        if contacts[i].sliding == 0:
            mark(system.kinks, piece.ramp, piece.begin, i)
