"""Jumps: contacts that slip at once, at fixed commands, onto ground that holds less."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Jump:
    """A contact that crossed a border onto ground that holds less, and where that led.

    Attributes:
        ramp: number of the ramp, counted from 0 in the call that followed it.
        part: place on that ramp, 0 .. 1 [1].
        contact: the contact, counted along the body; of a body that turns, the one that moved farthest.
        border: position of the border on the track [m]; None in a jump of a body that turns.
        distance: of a body that turns, how far the contact moved; else from the border to where the contact came to rest or to the next border, towards +x positive [m].
        loss: energy lost beside that lost to friction, >= 0 [J].
    """

    ramp: int
    part: float
    contact: int
    border: float | None
    distance: float
    loss: float
