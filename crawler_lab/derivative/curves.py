"""Bent springs on a path with derivatives: the pieces of their curves in force, their own derivatives, their knots.

On its pieces a bent spring is linear, T = k_a (u - at) + value of its actuator and the same of its passive spring over
z; its own derivative is the line's at fixed u and z. A knot is an event, like an arrival at a bound.
"""

from __future__ import annotations

from crawler_model.body.curves import AT, BEGIN, END, SLOPE, VALUE
from crawler_model.compiled import lean
from crawler_model.motion.line.springs.bends import find_pieces, tension_on

from .kinks import AT_BOUND, INSTANT, find_moves, mark, note_arrival, note_kink


@lean
def place_bends(system, curves, commands, piece):
    """Find the pieces of the curves that are in force on a piece of the path, and the stiffness that follows.

    Args:
        system: a `System`; springs, their curves and the band are written. Velocities hold on the piece, elongations at
            its start.
        curves: its `Curves`, or None.
        commands: a `Commands`.
        piece: the PIECE of the path.
    """
    if curves is None:
        return
    contacts, springs, band = system.contacts, system.springs, system.band
    half = 0.5 * (piece.until - piece.begin)
    middle = piece.begin + half
    band.stiffness[:] = 0.0
    for s in range(springs.shape[0]):
        spring = springs[s]
        if spring.bend >= 0:
            bend = curves.bends[spring.bend]
            z = spring.elongation + half * (contacts[spring.b].v - contacts[spring.a].v)
            find_pieces(bend, curves.pieces, z - commands.start[s] - middle * commands.change[s], z, 0.0)
            spring.command = curves.pieces[bend.actuator].slope
            spring.stiffness = spring.command + curves.pieces[bend.passive].slope
        band.stiffness[spring.row, spring.column] += spring.stiffness


@lean
def _own_of(d_pieces, pieces, p, length, c):
    """Compute the derivative of the tension of a piece at a fixed length."""
    slope = d_pieces[p, SLOPE, c] * (length - pieces[p].at)
    return d_pieces[p, VALUE, c] + slope - pieces[p].slope * d_pieces[p, AT, c]


@lean
def find_own_of_bends(system, curves, derivative, commands):
    """Compute the derivatives of the tensions of bent springs at fixed displacements and commands.

    Args:
        system: a `System`; elongations belong to the place of the commands.
        curves: its `Curves`, or None.
        derivative: a `Derivative`; `own` is written, and `pull` with the part of the actuators.
        commands: a `Commands`, at that place.
    """
    if curves is None:
        return
    pieces = curves.pieces
    for s in range(system.springs.shape[0]):
        spring = system.springs[s]
        if spring.bend < 0:
            continue
        bend = curves.bends[spring.bend]
        u = spring.elongation - commands.target[s]
        for c in range(derivative.own.shape[1]):
            derivative.pull[s, c] = _own_of(derivative.pieces, pieces, bend.actuator, u, c)
            passive = _own_of(derivative.pieces, pieces, bend.passive, spring.elongation, c)
            derivative.own[s, c] = derivative.pull[s, c] + passive


@lean
def find_pulls_of_bends(system, curves, derivative, d_target):
    """Compute the derivatives of the tensions of all actuators, if any spring is bent.

    Args:
        system: a `System`.
        curves: its `Curves`, or None.
        derivative: a `Derivative`; `pull` is written, for bent springs from what they have at fixed displacements.
        d_target: derivatives of the commands, shape (F, P).
    """
    if curves is None:
        return
    for s in range(system.springs.shape[0]):
        spring = system.springs[s]
        for c in range(derivative.pull.shape[1]):
            if spring.bend < 0:
                derivative.pull[s, c] = derivative.tension[s, c]
            else:
                growth = derivative.dx[spring.b, c] - derivative.dx[spring.a, c] - d_target[s, c]
                derivative.pull[s, c] += spring.command * growth


@lean
def find_mean_pull(system, curves, commands, s, place, growth):
    """Compute the mean tension of the actuator of a bent spring along a piece of the path.

    Args:
        system: a `System`; the elongation belongs to the start of the piece.
        curves: its `Curves`, or None.
        commands: a `Commands`.
        s: the spring.
        place: the middle of the piece on the ramp.
        growth: by how much the spring has grown there since the start of the piece [m].

    Returns:
        The tension [N].
    """
    if curves is None:
        return 0.0
    spring = system.springs[s]
    u = spring.elongation + growth - commands.start[s] - place * commands.change[s]
    return tension_on(curves.pieces[curves.bends[spring.bend].actuator], u)


@lean
def look_at_loose(system, curves, piece):
    """Mark all derivatives as one-sided if a sliding part of the body has no spring to a stuck one.

    Args:
        system: a `System`, after its balance was solved.
        curves: its `Curves`, or None.
        piece: the PIECE of the path.
    """
    if curves is None:
        return
    for i in range(system.contacts.shape[0]):
        contact = system.contacts[i]
        if contact.sliding != 0 and contact.loose != 0:
            mark(system.kinks, piece.ramp, piece.begin, i)
            for c in range(system.parameters.shape[0]):
                system.parameters[c].one_sided = True


@lean
def mark_spring(system, piece, s):
    """Note a kink at both contacts of a spring at the end of a piece of the path.

    Args:
        system: a `System`.
        piece: the PIECE of the path.
        s: the spring.
    """
    mark(system.kinks, piece.ramp, piece.until, system.springs[s].a)
    mark(system.kinks, piece.ramp, piece.until, system.springs[s].b)


@lean
def _find_way(system, curves, derivative, d_target, s, knot):
    """Find the derivatives of the way of a bent spring to a knot, numbered as `coming` of a BEND, as a force.

    Returns whether any parameter changes it.
    """
    spring, parameters = system.springs[s], system.parameters
    bend = curves.bends[spring.bend]
    sign = 1.0 if knot > 0 else -1.0
    of_actuator = abs(knot) == 1
    row, column = bend.actuator if of_actuator else bend.passive, END if knot > 0 else BEGIN
    for c in range(parameters.shape[0]):
        a, b, at = derivative.dx[spring.a, c], derivative.dx[spring.b, c], derivative.pieces[row, column, c]
        command = d_target[s, c] if of_actuator else 0.0
        parameters[c].d_slack = sign * spring.scale * (at - ((b - a) - command))
        parameters[c].d_size = spring.scale * (abs(at) + abs(a) + abs(b) + abs(command))
    return find_moves(parameters)


@lean
def _is_in_motion(contact):
    """Determine whether the force on a contact matters at once: it slides, or arrives at its bound."""
    return contact.sliding != 0 or contact.arrived != 0


@lean
def look_at_knots(system, curves, derivative, commands, piece, fastest):
    """Find at the end of a piece of the path which bent springs are at a knot, as `look_at_bounds` does for contacts.

    The ways to knots are compared with distances of forces from their bounds by a stiffness of the spring.

    Args:
        system: a `System`; arrivals at knots are written.
        curves: its `Curves`, or None.
        derivative: a `Derivative`, at the end.
        commands: a `Commands`, at the end.
        piece: the PIECE; how it ended is written.
        fastest: from `look_at_bounds`.
    """
    if curves is None:
        return
    contacts, pieces = system.contacts, curves.pieces
    piece.knots = 0
    for s in range(system.springs.shape[0]):
        spring = system.springs[s]
        spring.arrived = 0
        if spring.bend < 0:
            continue
        bend = curves.bends[spring.bend]
        growth = contacts[spring.b].v - contacts[spring.a].v
        blur = AT_BOUND * (abs(growth) + abs(commands.change[s]))
        near = 1e-4 * AT_BOUND * (abs(spring.elongation) + abs(commands.target[s]))
        for knot in (-2, -1, 1, 2):
            of_actuator, sign = abs(knot) == 1, 1.0 if knot > 0 else -1.0
            length = spring.elongation - (commands.target[s] if of_actuator else 0.0)
            closing = sign * (growth - (commands.change[s] if of_actuator else 0.0))
            curve = pieces[bend.actuator if of_actuator else bend.passive]
            way = sign * ((curve.end if knot > 0 else curve.begin) - length)
            if closing < -blur or way > max(closing, 0.0) * INSTANT + near:
                continue
            depends = _find_way(system, curves, derivative, commands.d_target, s, knot)
            if closing > blur:
                spring.arrived = max(spring.arrived, 2 if depends else 1)
                piece.knots += depends
                if piece.until < 1.0:
                    note_arrival(system.parameters, piece, closing * spring.scale, fastest)
                    fastest = max(fastest, closing * spring.scale)
            elif depends and (_is_in_motion(contacts[spring.a]) or _is_in_motion(contacts[spring.b])):
                note_kink(system, piece, spring.a)
                note_kink(system, piece, spring.b)
