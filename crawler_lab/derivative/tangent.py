"""Derivatives of a piecewise linear path with respect to parameters, carried from piece to piece.

At a fixed place on the ramp the sliding contacts follow from the stuck ones, as their forces stay at their bounds:

    K_SS Dx_S = (D of the pull of the actuators)_S - (DK x)_S - K_SM Dx_M - (D of the bounds)_S,

so only contacts that stop remember. At an event, where a free contact reaches its bound or a bent spring a knot at the
place s*,

    Ds* = - D slack / (d slack / ds),

and as x is continuous there, Dx changes by (v before - v after) Ds*. At a vertex of the commands Ds* = 0.
"""

from __future__ import annotations

from crawler_model.compiled import entry, lean
from crawler_model.motion.pieces import CHANGE, FROM, HEADER, RAMP, UNTIL

from .curves import (
    find_mean_pull,
    find_own_of_bends,
    find_pulls_of_bends,
    look_at_knots,
    look_at_loose,
    mark_spring,
    place_bends,
)
from .elimination import eliminate_many
from .kinks import INSTANT, look_at_bounds, look_at_choice, mark, pass_end
from .records import FREE, NO_END
from .standing import begin_standing, end_standing
from .starts import TO_THE_END, begin_changed, begin_ways, end_changed, end_ways, pass_starts

_STILL = 1e-12
"""A velocity below this part of the largest one is rounding."""


@lean
def _find_sliding(contacts, commands, springs, piece):
    """Find which contacts slide on a piece, and how far, and let the others rest; returns how many slide.

    A contact without friction that rests keeps the direction in which it slid last, as friction would hold it there.
    """
    n, length = contacts.shape[0], piece.until - piece.begin
    middle = 0.5 * (piece.begin + piece.until)
    fastest = 0.0
    for i in range(n):
        fastest = max(fastest, abs(contacts[i].v))
    count = 0
    for i in range(n):
        contact = contacts[i]
        before, contact.sliding = contact.sliding, 0
        width = 0.0
        for row in (springs + i, springs + n + i):
            width += commands.start[row] + middle * commands.change[row]
        if abs(contact.v) > _STILL * fastest:
            contact.sliding = 1 if contact.v > 0.0 else -1
        else:
            contact.v = 0.0
            if width == 0.0:
                contact.sliding = FREE if before == 0 else before
        contact.way = length * contact.v
        count += contact.sliding != 0
    return count


@lean
def _balance(system, derivative, commands):
    """Solve for the derivatives of the sliding contacts at a fixed place; returns False if none is stuck."""
    contacts, springs, load = system.contacts, system.springs, derivative.load
    n, columns = load.shape
    for i in range(n):
        for c in range(columns):
            if contacts[i].sliding == FREE:
                load[i, c] = 0.0
            elif contacts[i].sliding > 0:
                load[i, c] = -commands.d_target[springs.shape[0] + i, c]
            elif contacts[i].sliding < 0:
                load[i, c] = commands.d_target[springs.shape[0] + n + i, c]
    for s in range(springs.shape[0]):
        spring = springs[s]
        for c in range(columns):
            pull = derivative.own[s, c] - spring.command * commands.d_target[s, c]
            load[spring.a, c] += pull
            load[spring.b, c] -= pull
    return eliminate_many(contacts, system.band, load, derivative.dx)


@lean
def _shift_all(system, derivative, piece):
    """Choose the translation where all contacts slide, as `choose_translation` does: a kink."""
    contacts, dx, earlier = system.contacts, derivative.dx, derivative.earlier
    n = contacts.shape[0]
    for c in range(dx.shape[1]):
        shift = 0.0
        for i in range(n):
            shift += contacts[i].share * (earlier[i, c] - dx[i, c])
        for i in range(n):
            dx[i, c] += shift
        system.parameters[c].one_sided = True
    for i in range(n):
        mark(system.kinks, piece.ramp, piece.begin, i)


@lean
def _balance_about(system, derivative, commands, element):
    """Solve for the derivatives where all contacts slide and the middle of an element is at rest.

    What the bounds lack of a balance moves the point at rest, see `standing`, so that one of its contacts does without.
    """
    dx, earlier = derivative.dx, derivative.earlier
    a, b = system.elements[element, 0], system.elements[element, 1]
    contact = system.contacts[a]
    direction, contact.sliding = contact.sliding, 0
    _balance(system, derivative, commands)
    contact.sliding = direction
    for c in range(dx.shape[1]):
        shift = 0.5 * (earlier[a, c] - dx[a, c] + earlier[b, c] - dx[b, c])
        for i in range(dx.shape[0]):
            dx[i, c] += shift


@lean
def _find_own(system, derivative, commands):
    """Compute the derivatives of the tensions at fixed displacements and commands."""
    springs = system.springs
    for s in range(springs.shape[0]):
        spring = springs[s]
        if spring.bend < 0:
            stretch = spring.tension / spring.stiffness
            for c in range(derivative.own.shape[1]):
                derivative.own[s, c] = derivative.stiffness[s, c] * stretch
    find_own_of_bends(system, system.curves, derivative, commands)


@lean
def _find_tensions(system, derivative, commands):
    """Compute the derivatives of the tensions, from the derivatives at fixed displacements."""
    springs, dx, d_target = system.springs, derivative.dx, commands.d_target
    for s in range(springs.shape[0]):
        spring = springs[s]
        for c in range(dx.shape[1]):
            growth = spring.stiffness * (dx[spring.b, c] - dx[spring.a, c]) - spring.command * d_target[s, c]
            derivative.tension[s, c] = growth + derivative.own[s, c]
    find_pulls_of_bends(system, system.curves, derivative, d_target)


@lean
def _place_commands(commands, place):
    """Find the commands at a place on the ramp, and their derivatives."""
    for f in range(commands.change.shape[0]):
        commands.target[f] = commands.start[f] + place * commands.change[f]
        for c in range(commands.d_start.shape[1]):
            start = commands.d_start[f, c]
            commands.d_target[f, c] = start + place * (commands.d_end[f, c] - start)


@lean
def _begin_ramp(system, commands, course, piece, v):
    """Begin ramp v: what its commands change, their derivatives, and the tensions at its start."""
    springs, parameters = system.springs, system.parameters
    before, after, part = course.before[v], course.after[v], course.part[v]
    for f in range(commands.change.shape[0]):
        commands.change[f] = course.targets[v, f] - commands.start[f]
        step = course.rows[after, f] - course.rows[before, f]
        for c in range(parameters.shape[0]):
            start = course.d_rows[before, f, c]
            grown = part * (course.d_rows[after, f, c] - start)
            commands.d_end[f, c] = start + grown + step * course.d_part[v, c]
    for s in range(springs.shape[0]):
        spring = springs[s]
        spring.tension, spring.rate = course.tensions[v, s], 0.0
        if spring.bend >= 0:
            spring.elongation = course.elongations[v, spring.bend]
    for c in range(parameters.shape[0]):
        parameters[c].d_work = 0.0
    piece.ramp, piece.until, piece.work = v, 0.0, 0.0
    for i in range(system.contacts.shape[0]):
        system.contacts[i].state = 0
    while piece.next < course.pieces.shape[0] and course.pieces[piece.next, RAMP] < v:
        piece.next += 1  # an instant at the end of the ramp before


@lean
def _look_at_start(system, derivative, commands, piece):
    """Find the kinks at the very start: a contact at its bound is at one unless it stays there."""
    for i in range(system.contacts.shape[0]):
        system.contacts[i].sliding = system.contacts[i].arriving = system.contacts[i].held = 0
    for f in range(commands.change.shape[0]):
        commands.change[f] = 0.0
    place_bends(system, system.curves, commands, piece)
    _place_commands(commands, 0.0)
    _find_own(system, derivative, commands)
    _find_tensions(system, derivative, commands)
    piece.begin = -1.0  # it has been at rest for long
    look_at_knots(
        system, system.curves, derivative, commands, piece, look_at_bounds(system, derivative, commands, piece)
    )
    piece.ended = NO_END


@lean
def _read_piece(contacts, pieces, piece):
    """Read the next piece of the ramp that is not an instant; returns False if there is none.

    On a ramp without pieces nothing moves.
    """
    n = contacts.shape[0]
    piece.begin = piece.until
    found = False
    while not found and piece.next < pieces.shape[0] and pieces[piece.next, RAMP] == piece.ramp:
        row = piece.next
        piece.next += 1
        piece.begin, piece.until = pieces[row, FROM], pieces[row, UNTIL]
        if piece.until > TO_THE_END:
            piece.until = 1.0
        found = piece.until == 1.0 or piece.until - piece.begin >= INSTANT
        for i in range(n):
            contacts[i].held = 0
            contacts[i].v = pieces[row, HEADER + i]
            contacts[i].arriving = int(pieces[row, HEADER + n + i])
    if found:
        return True
    if piece.until > 0.0:
        return False
    piece.until = 1.0
    for i in range(n):
        contacts[i].v = 0.0
        contacts[i].arriving = contacts[i].held = 0
    return True


@lean
def _add_work(springs, parameters, derivative, commands, length):
    """Add the derivative of the work at one end of a piece, by the trapezoidal rule."""
    for s in range(springs.shape[0]):
        for c in range(parameters.shape[0]):
            parameters[c].d_work -= 0.5 * length * derivative.pull[s, c] * commands.change[s]


@lean
def _advance_springs(system, commands, piece, alone):
    """Advance the tensions to the end of a piece; if it stands by itself, with the work and its derivatives."""
    first = piece.begin if alone else piece.first
    length = piece.until - first
    for s in range(system.springs.shape[0]):
        spring, change = system.springs[s], commands.change[s]
        a, b = system.contacts[spring.a], system.contacts[spring.b]
        growth, way = b.v - a.v, b.way - a.way
        spring.rate = spring.stiffness * (growth - change)
        pull = spring.stiffness * (way - length * change)
        mean = spring.tension + 0.5 * pull
        if spring.bend >= 0:
            spring.rate = spring.stiffness * growth - spring.command * change
            pull = spring.stiffness * way - length * spring.command * change
            mean = find_mean_pull(system, system.curves, commands, s, 0.5 * (first + piece.until), 0.5 * way)
            spring.elongation += way
        if alone:
            piece.work -= mean * change * length
        for c in range(system.parameters.shape[0] if alone else 0):
            system.parameters[c].d_work -= length * mean * (commands.d_end[s, c] - commands.d_start[s, c])
        spring.tension += pull


@lean
def _balance_all(system, derivative, commands, piece, sliding):
    """Solve for the derivatives at the end of a piece."""
    n = system.contacts.shape[0]
    if sliding == 0:
        return
    for i in range(n):
        for c in range(system.parameters.shape[0]):
            derivative.earlier[i, c] = derivative.dx[i, c]
    if sliding == n and piece.element >= 0:
        _balance_about(system, derivative, commands, piece.element)
    elif not _balance(system, derivative, commands):
        _shift_all(system, derivative, piece)
    look_at_loose(system, system.curves, piece)


@lean
def _follow_piece(system, derivative, commands, pieces, piece, sliding):
    """Carry the derivatives along a piece, or along several at whose events contacts begin to slide."""
    contacts, springs = system.contacts, system.springs
    n = contacts.shape[0]
    mixed = pass_end(system, derivative.dx, piece)
    place_bends(system, system.curves, commands, piece)
    _place_commands(commands, piece.begin)
    _find_own(system, derivative, commands)
    if mixed and sliding < n:
        _balance(system, derivative, commands)
    _find_tensions(system, derivative, commands)
    begin_standing(system, derivative, commands, piece, sliding)
    alone = not piece.steady or sliding >= n - 1
    if alone:
        _add_work(springs, system.parameters, derivative, commands, piece.until - piece.begin)
    else:
        begin_ways(system, derivative, piece)
    if piece.steady:
        sliding = pass_starts(system, derivative, commands, pieces, piece, sliding)
        end_changed(system, commands, piece, sliding)
    _advance_springs(system, commands, piece, alone)
    _place_commands(commands, piece.until)
    _find_own(system, derivative, commands)
    _balance_all(system, derivative, commands, piece, sliding)
    _find_tensions(system, derivative, commands)
    end_standing(system, derivative, commands, piece)
    if alone:
        _add_work(springs, system.parameters, derivative, commands, piece.until - piece.begin)
    else:
        end_ways(system, derivative, commands, piece)
    look_at_knots(
        system, system.curves, derivative, commands, piece, look_at_bounds(system, derivative, commands, piece)
    )
    if 0 < sliding < n:
        look_at_choice(system, derivative, commands, piece)


@lean
def _finish_piece(system, piece, samples):
    """Keep the velocities for the next piece; the displacement at a ramp's end has a kink where a contact arrives."""
    for i in range(system.contacts.shape[0]):
        system.contacts[i].v_before = system.contacts[i].v
    if not samples or piece.until < 1.0:
        return
    late = False
    for i in range(system.contacts.shape[0]):
        if system.contacts[i].arrived > 1:
            mark(system.kinks, piece.ramp, piece.until, i)
            late = True
    for s in range(system.springs.shape[0] if piece.knots > 0 else 0):
        if system.springs[s].arrived > 1:
            mark_spring(system, piece, s)
            late = True
    for c in range(system.parameters.shape[0]):
        system.parameters[c].one_sided |= late and system.parameters[c].moves


@entry
def follow_tangent(system, derivative, commands, course, pieces, output, samples):
    """Carry derivatives along ramps whose pieces are known.

    Args:
        system: a `System`, changed in place.
        derivative: a `Derivative`, changed in place.
        commands: `Commands`, at the start of the first ramp; afterwards at the start of the next one.
        course: a `Course`.
        pieces: PIECE, shape (1,), changed in place.
        output: derivatives of the displacements after each ramp, shape (V, N, P); work of the actuators in each ramp,
            shape (V,) [J]; its derivatives, shape (V, P); velocities at the end of each ramp, shape (V, N) [m].
        samples: whether the displacement at the end of every ramp is a result: it has a kink where a contact reaches
            its bound just there, even if it slides on.
    """
    d_records, works, d_works, speeds = output
    piece = pieces[0]
    columns = system.parameters.shape[0]
    piece.next, piece.steady = 0, course.pieces.shape[1] == CHANGE
    for v in range(course.targets.shape[0]):
        _begin_ramp(system, commands, course, piece, v)
        if piece.ended == NO_END:
            _look_at_start(system, derivative, commands, piece)
            _begin_ramp(system, commands, course, piece, v)
        while piece.until < 1.0:
            if piece.steady:
                sliding = begin_changed(system, commands, course.pieces, piece)
            elif _read_piece(system.contacts, course.pieces, piece):
                sliding = _find_sliding(system.contacts, commands, system.springs.shape[0], piece)
            else:
                break
            _follow_piece(system, derivative, commands, course.pieces, piece, sliding)
            _finish_piece(system, piece, samples)
        for f in range(commands.start.shape[0]):
            commands.start[f] = course.targets[v, f]
            for c in range(columns):
                commands.d_start[f, c] = commands.d_end[f, c]
        works[v] = piece.work
        for c in range(columns):
            d_works[v, c] = system.parameters[c].d_work
            for i in range(system.contacts.shape[0]):
                d_records[v, i, c] = derivative.dx[i, c]
        for i in range(system.contacts.shape[0]):
            speeds[v, i] = system.contacts[i].v
