"""What is noted of a path on request, see `motion.pieces`: its pieces, or the changes of contacts.

A change is noted where it is found, so its cost does not depend on the number of contacts.
"""

from __future__ import annotations

from ...compiled import inlined, lean
from ..pieces import CHANGE, CHANGED, COUNT, FROM, HEADER, RAMP, REACHES, SPEED, STATE, UNTIL
from .records import BACKWARD, FORWARD

_NEVER = 9
"""The state of no contact."""


@inlined
def note_piece(pieces, contacts, ramp, until):
    """Note a piece of the path, if pieces are asked for: its velocities, and the bounds reached at its end.

    Args:
        pieces: as in a `Model`.
        until: where it ends.
    """
    if pieces.shape[1] <= CHANGE or until <= ramp.s:
        return
    pieces[0, COUNT] += 1.0
    row = int(pieces[0, COUNT])
    if row >= pieces.shape[0]:
        return
    n = contacts.shape[0]
    pieces[row, RAMP] = ramp.number
    pieces[row, FROM] = ramp.s
    pieces[row, UNTIL] = until
    for i in range(n):
        c = contacts[i]
        pieces[row, HEADER + i] = c.v
        pieces[row, HEADER + n + i] = c.coming & (FORWARD | BACKWARD) if c.next <= until else 0.0


@lean
def _write_change(pieces, ramp, c, i, reaches):
    """Write a row."""
    pieces[0, COUNT] += 1.0
    row = int(pieces[0, COUNT])
    if row >= pieces.shape[0]:
        return
    pieces[row, RAMP] = ramp.number
    pieces[row, FROM] = ramp.s
    pieces[row, CHANGED] = i
    pieces[row, STATE] = c.noted
    pieces[row, REACHES] = reaches
    pieces[row, SPEED] = c.v


@inlined
def note_state(pieces, ramp, c, i):
    """Note whether a contact slides, or rests at its bound, if that is new and changes are asked for.

    Args:
        pieces: as in a `Model`.
    """
    if pieces.shape[1] != CHANGE:
        return
    state = 2 * c.side if c.v == 0.0 else (1 if c.v > 0.0 else -1)
    if state != c.noted:
        c.noted = state
        _write_change(pieces, ramp, c, i, 0)


@inlined
def note_arrival(pieces, ramp, c, i):
    """Note that a contact reaches the bound that it comes to, if changes are asked for.

    Args:
        pieces: as in a `Model`.
    """
    if pieces.shape[1] == CHANGE:
        _write_change(pieces, ramp, c, i, c.coming)


@lean
def note_all(pieces, contacts, ramp):
    """Note the states and velocities of all contacts after their translation was chosen, if changes are asked for.

    Args:
        pieces: as in a `Model`.
    """
    for i in range(contacts.shape[0] if pieces.shape[1] == CHANGE else 0):
        contacts[i].noted = _NEVER
        note_state(pieces, ramp, contacts[i], i)
