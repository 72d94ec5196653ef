"""Jumps: contacts that slip at once, at fixed commands: onto ground that holds less, or because the body buckles."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Jump:
    """A contact that crossed a border onto ground that holds less, or a body that buckled, and where that led.

    A body that turns also jumps to the end of a ramp whose budget of work is spent.

    Attributes:
        ramp: number of the ramp, counted from 0 in the call that followed it.
        fraction: place on that ramp, 0 .. 1 [1].
        contact: the contact, counted along the body.
        border: position of the border on the track [m]; None for a body that turns.
        distance: from the border to where the contact came to rest or to the next border, towards +x positive; of a
            body that turns, how far the contact moved that moved farthest [m].
        loss: energy lost in addition to friction, >= 0 [J].
    """

    ramp: int
    fraction: float
    contact: int
    border: float | None
    distance: float
    loss: float
