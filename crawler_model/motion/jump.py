"""Jumps: contacts that slip at once, at fixed commands, onto ground that holds less."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .borders import COUNT, JUMP_CONTACT, JUMP_PART, JUMP_RAMP


@dataclass(frozen=True)
class Jump:
    """A contact that crossed a border onto ground that holds less, and where that led.

    Attributes:
        ramp: number of the ramp, counted from 0 in the call that followed it.
        part: place on that ramp, 0 .. 1 [1].
        contact: the contact, counted along the body.
        border: position of the border on the track [m].
        distance: from the border to where the contact came to rest or to the next border, towards +x positive [m].
        loss: energy lost beside that lost to friction, >= 0 [J].
    """

    ramp: int
    part: float
    contact: int
    border: float
    distance: float
    loss: float


def read_jumps(rows: np.ndarray, ramp: int, done: float) -> tuple[Jump, ...]:
    """Read the jumps that a compiled loop has written.

    Args:
        rows: as in `Patches.jumps`, shape (J + 1, 7).
        ramp: the number of the first ramp that the loop followed.
        done: the part of it that had been followed before, 0 .. 1 [1].

    Returns:
        The jumps that have ended, with ramps and parts counted as in `Jump`.
    """
    found = []
    for *row, is_open in rows[1 : 1 + int(rows[0, COUNT])].tolist():
        if is_open:
            continue
        of_ramp, part = int(row[JUMP_RAMP]), row[JUMP_PART]
        if of_ramp == 0:
            part = done + part * (1.0 - done)
        found.append(Jump(ramp + of_ramp, part, int(row[JUMP_CONTACT]), *row[JUMP_CONTACT + 1 :]))
    return tuple(found)
