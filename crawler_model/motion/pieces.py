"""The linear pieces of an exact path, noted by the event loops on request.

Without rows nothing is noted, and nothing is spent. A piece is a row with the velocities of all contacts. Where most of
them slide on at an event, the changes of contacts may be noted instead.
"""

from __future__ import annotations

from typing import Any

import numpy as np

RAMP, FROM, UNTIL = range(3)
"""First columns of a piece: the ramp, and the part of it that the piece spans. The velocities of all contacts follow
[m per unit of the ramp], then the bounds that they reach at its end, as bits FORWARD and BACKWARD of `line.records`."""
COUNT = 0
"""Column of the first row: the number of pieces met, which may exceed the rows there are."""
HEADER = 3
CHANGED, STATE, REACHES, SPEED = range(2, 6)
"""Further columns of a change: the contact; its state from there on, 1 or -1 while it slides, 2 or -2 at rest at its
forward or backward bound, else 0; or, if it reaches bounds there, these as bits; and its velocity then."""
CHANGE = 6
"""Number of columns of a change; a piece has more."""
PIECES_A_RAMP = 16
"""Pieces of a ramp for which there is room at first."""

NO_PIECES = np.zeros((0, 0))
"""Where nothing is requested."""


_CHANGES_A_RAMP = 6
"""Changes of a contact in a ramp for which there is room at first."""


def locate_parts(pieces: np.ndarray, ramp: np.ndarray, begin: np.ndarray, end: np.ndarray) -> None:
    """Locate pieces that were met in parts of ramps on these ramps.

    Args:
        pieces: the pieces behind the row with their number, not changes, shape (K + 1, 3 + 2 N); changed in place.
        ramp: the ramp of each part, shape (W,).
        begin: the place on it at which the part begins, shape (W,) [1].
        end: the place on it at which the part ends, shape (W,) [1].
    """
    if not pieces.shape[0]:
        return
    met = pieces[1 : 1 + int(pieces[0, COUNT])]
    part = met[:, RAMP].astype(np.int64)
    width = (end - begin)[part]
    for column in (FROM, UNTIL):
        met[:, column] = begin[part] + met[:, column] * width
    contacts = (pieces.shape[1] - HEADER) // 2
    met[:, HEADER : HEADER + contacts] /= width[:, None]
    met[:, RAMP] = ramp[part]


def follow_pieces(
    motion: Any,
    state: Any,
    scratch: Any,
    targets: np.ndarray,
    budget: int,
    account: np.ndarray,
    records: np.ndarray,
    changes: bool = False,
) -> np.ndarray:
    """Follow straight ramps exactly and note their pieces; again with more room if there are more than expected.

    Args:
        motion: of a body on a line.
        state: changed in place.
        scratch: memory from the motion.
        targets: as for `Motion.follow`, shape (V, F).
        budget: upper limit of work in one ramp.
        account: entries as in `motion.account`, shape (15,), added to.
        records: output, as for `Motion.follow`.
        changes: whether to note the changes of contacts instead.

    Returns:
        The pieces, shape (K, 3 + 2 N), with the columns RAMP, FROM, UNTIL, velocities and bounds that are reached; or
        the changes, in order, shape (K, 6), with the columns RAMP, FROM, CHANGED, STATE, REACHES and SPEED.
    """
    before, spent = state.copy(), account.copy()
    n, room = state.gained.size, PIECES_A_RAMP * targets.shape[0] + 64
    columns = HEADER + 2 * n
    if changes:
        room, columns = room + _CHANGES_A_RAMP * n * targets.shape[0], CHANGE
    while True:
        pieces = np.zeros((room + 1, columns))
        motion.follow(state, scratch, targets, True, budget, account, records, pieces)
        met = int(pieces[0, COUNT])
        if met <= room:
            return pieces[1 : 1 + met]
        room = met
        state.restore(before)
        account[:] = spent
