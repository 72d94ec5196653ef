"""The linear pieces of an exact path, noted by the event loops for those who ask for them.

Without rows nothing is noted, and nothing is spent.
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
PIECES_A_RAMP = 16
"""Pieces of a ramp for which there is room at first."""

NO_PIECES = np.zeros((0, 0))
"""For those who do not ask."""


def _room_for_pieces(pieces: int, contacts: int) -> np.ndarray:
    """Allocate the rows for so many pieces at most, shape (pieces + 1, 3 + 2 N)."""
    return np.zeros((pieces + 1, HEADER + 2 * contacts))


def follow_pieces(
    motion: Any, state: Any, scratch: Any, targets: np.ndarray, budget: int, account: np.ndarray, records: np.ndarray
) -> np.ndarray:
    """Follow straight ramps exactly and note their pieces; again with more room if there are more than expected.

    Args:
        motion: of a body on a line.
        state: changed in place.
        scratch: memory from the motion.
        targets: as for `Motion.follow`, shape (V, F).
        budget: upper limit of work in one ramp.
        account: entries as in `motion.state`, shape (15,), added to.
        records: output, as for `Motion.follow`.

    Returns:
        The pieces, shape (K, 3 + 2 N), with the columns RAMP, FROM, UNTIL, velocities and bounds that are reached.
    """
    before, spent = state.copy(), account.copy()
    room = PIECES_A_RAMP * targets.shape[0] + 64
    while True:
        pieces = _room_for_pieces(room, state.gained.size)
        motion.follow(state, scratch, targets, True, budget, account, records, pieces)
        met = int(pieces[0, COUNT])
        if met <= room:
            return pieces[1 : 1 + met]
        room = met
        state.restore(before)
        account[:] = spent
