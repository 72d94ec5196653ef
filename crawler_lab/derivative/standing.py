"""The point of a segment at rest while everything else slides: how it moves with the parameters.

A segment slides away from this point or towards it, so only the point determines the translation. It divides the
friction: with the force g on the contact that rests in its place, it lies at the part

    q = (mu_plus - g) / (mu_plus + mu_minus)

of the cell of that contact where the segment lengthens, and at 1 - q where it shortens. On the grid the contact rests
instead, whatever the parameters, and at some of their values another one takes over: there the displacement jumps, and
between them it does not change. In the continuous body all contacts are displaced by the elongation between the point
and the contact; the derivative of this displacement is added to the grid's derivatives.
"""

from __future__ import annotations

from crawler_model.compiled import lean

from .records import EVENT

_OPPOSITE = 1e-9
"""Velocities that differ by less than this part of the largest one are opposite to each other."""


@lean
def _find_pair(contacts, elements):
    """Find the element of a segment whose ends slide at opposite velocities; -1 without one."""
    fastest, pair = 0.0, -1
    for i in range(contacts.shape[0]):
        fastest = max(fastest, abs(contacts[i].v))
    for j in range(elements.shape[0]):
        a, b = contacts[elements[j, 0]].v, contacts[elements[j, 1]].v
        if a * b < 0.0 and abs(a + b) <= _OPPOSITE * fastest:
            pair = j
    return pair


@lean
def _find_alone(system, commands):
    """Find the only contact at rest, if it is one of a segment whose neighbours slide apart or together; else -1."""
    contacts, beside, elements = system.contacts, system.beside, system.elements
    alone = 0
    while contacts[alone].sliding != 0:
        alone += 1
    if beside[alone, 0] < 0 and beside[alone, 1] < 0:
        return -1
    row, n = system.springs.shape[0] + alone, contacts.shape[0]
    if commands.target[row] + commands.target[row + n] <= 0.0:
        return -1
    if beside[alone, 0] >= 0 and beside[alone, 1] >= 0:
        left, right = elements[beside[alone, 0], 0], elements[beside[alone, 1], 1]
        if contacts[left].v * contacts[right].v > 0.0:
            return -1
    return alone


@lean
def _size(system, i):
    """Return the length of the cell of a contact, in elements: 1, or 1/2 at the ends of a segment."""
    return 1.0 if system.beside[i, 0] >= 0 and system.beside[i, 1] >= 0 else 0.5


@lean
def _divide(system, derivative, commands, piece):
    """Find where in the cell of the contact at rest the point is, and the derivatives of that.

    What is written is the place of the contact, measured from the point, in elements.
    """
    i, springs, n = piece.standing, system.springs, system.contacts.shape[0]
    row, other = springs.shape[0] + i, springs.shape[0] + n + i
    width, size = commands.target[row] + commands.target[other], _size(system, i)
    force = 0.0
    for e in range(system.first[i], system.first[i + 1]):
        spring = springs[system.around[e]]
        force += spring.tension if spring.a == i else -spring.tension
    part = (commands.target[row] - force) / width
    before = 0.5 if system.beside[i, 0] >= 0 else 0.0
    piece.offset = before - size * (part if piece.lengthens else 1.0 - part)
    for c in range(system.parameters.shape[0]):
        d_width = commands.d_target[row, c] + commands.d_target[other, c]
        d_part = (commands.d_target[row, c] - part * d_width) / width
        for e in range(system.first[i], system.first[i + 1]):
            s = system.around[e]
            d_part += (-derivative.tension[s, c] if springs[s].a == i else derivative.tension[s, c]) / width
        system.parameters[c].d_offset = -size * d_part if piece.lengthens else size * d_part


@lean
def _divide_pair(system, commands, piece):
    """Find the derivatives of the point between the two contacts of an element: all contacts are at their bounds."""
    contacts, springs = system.contacts, system.springs
    n, width = contacts.shape[0], 0.0
    for i in system.elements[piece.element]:
        row = springs.shape[0] + i
        width += 0.5 * (commands.target[row] + commands.target[row + n]) / _size(system, i)
    piece.offset = 0.0
    for c in range(system.parameters.shape[0]):
        total = 0.0
        for i in range(n):
            row = springs.shape[0] + i
            total += commands.d_target[row, c] if contacts[i].sliding > 0 else -commands.d_target[row + n, c]
        system.parameters[c].d_offset = (-total if piece.lengthens else total) / width


@lean
def _find_point(system, derivative, commands, piece):
    """Find the point at rest at the place of the commands."""
    if piece.standing >= 0:
        _divide(system, derivative, commands, piece)
    else:
        _divide_pair(system, commands, piece)


@lean
def _growth(system, piece):
    """Compute the rate of the elongation of an element at the point."""
    contacts, elements, growth, count = system.contacts, system.elements, 0.0, 0
    for j in (piece.element, piece.element_after):
        if j >= 0:
            growth += contacts[elements[j, 1]].v - contacts[elements[j, 0]].v
            count += 1
    return growth / count


@lean
def _d_elongation(system, dx, piece, c):
    """Compute a derivative of the elongation of an element at the point."""
    elements, growth, count = system.elements, 0.0, 0
    for j in (piece.element, piece.element_after):
        if j >= 0:
            growth += dx[elements[j, 1], c] - dx[elements[j, 0], c]
            count += 1
    return growth / count


@lean
def _move_all(dx, c, way):
    """Add to a derivative of all displacements."""
    for i in range(dx.shape[0]):
        dx[i, c] += way


@lean
def begin_standing(system, derivative, commands, piece, sliding):
    """Find the point at rest at the start of a piece, and carry the derivatives of its displacement over that start.

    Args:
        system: a `System`, with the velocities and directions of the piece.
        derivative: a `Derivative`, at the start of the piece; the displacements are written.
        commands: a `Commands`, at that place.
        piece: the PIECE, changed in place.
        sliding: number of contacts that slide.
    """
    contacts = system.contacts
    before, after_event = piece.drift, piece.ended >= EVENT
    piece.standing = piece.element = piece.element_after = -1
    piece.drift = 0.0
    if system.elements.shape[0] == 0:
        return
    if sliding == contacts.shape[0]:
        piece.element = _find_pair(contacts, system.elements)
        piece.between |= piece.element >= 0
    elif sliding == contacts.shape[0] - 1:
        piece.standing = _find_alone(system, commands)
        if piece.standing >= 0:
            piece.element = system.beside[piece.standing, 0]
            piece.element_after = system.beside[piece.standing, 1]
    if piece.element >= 0 or piece.element_after >= 0:
        growth = _growth(system, piece)
        piece.lengthens = growth > 0.0
        _find_point(system, derivative, commands, piece)
        piece.drift = piece.offset * growth
    for c in range(system.parameters.shape[0]):
        parameter = system.parameters[c]
        parameter.d_begin = parameter.d_offset
        if after_event and before != piece.drift:
            _move_all(derivative.dx, c, (before - piece.drift) * parameter.d_place)


@lean
def end_standing(system, derivative, commands, piece):
    """Add the displacement of the point at rest along a piece to the derivatives.

    Args:
        system: a `System`, at the end of the piece.
        derivative: a `Derivative`, at the end too; the displacements are written.
        commands: a `Commands`, at the end too.
        piece: the PIECE, changed in place.
    """
    if piece.element < 0 and piece.element_after < 0:
        return
    growth, begin = _growth(system, piece), piece.offset
    _find_point(system, derivative, commands, piece)
    piece.drift = piece.offset * growth
    stretch, mean = growth * (piece.until - piece.begin), 0.5 * (begin + piece.offset)
    for c in range(system.parameters.shape[0]):
        parameter = system.parameters[c]
        grown = _d_elongation(system, derivative.dx, piece, c) - _d_elongation(system, derivative.earlier, piece, c)
        _move_all(derivative.dx, c, mean * grown + 0.5 * stretch * (parameter.d_begin + parameter.d_offset))
