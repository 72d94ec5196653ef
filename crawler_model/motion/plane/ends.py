"""Where a part of a ramp ends: just beyond an event, and the same for a body that stands elsewhere or is turned.

Rounding errors must not decide about the parts of a ramp: their errors, which are far larger, would depend on them.
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import lean
from ...rounding import EPS

_EDGE = 1e-6
"""A length that is a power of 2 but for rounding is not rounded down to the next one."""
_GRID = 0.25
"""Upper limit of the grid of ends, relative to what they may move by."""


@lean
def round_down(frame, length):
    """Round a length down to a power of 2 where a body turns.

    Args:
        length: of a part of a ramp, or a part of one.

    Returns:
        The length.
    """
    return length if frame.vector else 2.0 ** math.floor(math.log2(length) + _EDGE)


@lean
def snap(frame, place, length, scope):
    """Let a part end at a multiple of a power of 2 where a body turns.

    Args:
        place: where the part begins, 0 to 1.
        length: of the part; it may be infinite.
        scope: what the end may move by; it moves by an eighth of that at most.

    Returns:
        The length.
    """
    if frame.vector or length == np.inf or not scope > EPS:
        return length
    grid = round_down(frame, _GRID * scope)
    end = math.floor((place + length) / grid + 0.5) * grid
    return end - place if end > place else length


@lean
def find_end(frame, place, length, excess, later, guess, beyond):
    """Estimate the length of a part that ends just beyond an event.

    Args:
        place: where the part begins, 0 to 1.
        length: of a part that is too long.
        excess: by how much it goes beyond the event, in any unit.
        later: the length and the excess of a longer part, infinite if there is none.
        guess: estimate of the factor without a longer part, below 1.
        beyond: by how much the part shall go beyond the event.

    Returns:
        The length.
    """
    if excess < later[1] and later[0] < np.inf:
        speed = (later[1] - excess) / (later[0] - length)
        aim = min(max(length - (excess - beyond) / speed, 0.1 * length), 0.999 * length)
    else:
        speed = excess / ((1.0 - guess) * length)
        aim = max(guess, 0.3) * length
    return snap(frame, place, aim, beyond / speed)
