"""The records of bent springs, in addition to the records of all springs in `motion.line.records`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_FLOAT, _BYTE, _INT = np.float64, np.int8, np.int32

PIECE = np.dtype(
    [
        ("begin", _FLOAT),  # from where to where it reaches [m]
        ("end", _FLOAT),
        ("slope", _FLOAT),  # [N/m]
        ("at", _FLOAT),  # a point on it [m]
        ("value", _FLOAT),  # tension there [N]
        ("energy", _FLOAT),  # and energy [J]
    ],
    align=True,
)
"""A piece of the curve of a bent spring; the pieces of a curve follow each other."""

BEND = np.dtype(
    [
        ("actuator", _INT),  # present piece of the curve of the actuator, over u = z - L
        ("passive", _INT),  # present piece of the curve of the passive spring, over z
        ("command", _FLOAT),  # change of L along the ramp [m]
        ("share", _FLOAT),  # on these pieces, the tension of only the actuator is share T + back L + offset [1]
        ("back", _FLOAT),  # [N/m]
        ("offset", _FLOAT),  # [N]
        ("next", _FLOAT),  # place on the ramp of its next knot
        (
            "coming",
            _BYTE,
        ),  # which one: 1 the end, -1 the beginning of the piece of the actuator, 2 and -2 of the other;
        # 3 and above a slider that begins or ceases to yield, see `springs.sliders`
        ("yields", _BYTE),  # whether the spring rests there, and would be flat behind it
        ("yielded", _FLOAT),  # place on the ramp where it last passed such a knot; infinite if nowhere
        ("begun", _FLOAT),  # place on the ramp from which it has been on its pieces
        ("slid", _BYTE),  # whether a slide that ends where the ramp goes on has led it over a knot
        ("excess", _FLOAT),  # in an implicit step: tension at its start on the lines of these pieces, less T [N]
        ("kept_actuator", _INT),  # pieces in the last part of that which has been solved
        ("kept_passive", _INT),
        ("first", _INT),  # its sliders are first .. last - 1
        ("last", _INT),
        ("slipped", _BYTE),  # whether one of them has slipped on this ramp
    ],
    align=True,
)
"""What is known of a bent spring besides SPRING."""

SLIDER = np.dtype(
    [
        ("slip", _FLOAT),  # elongation at which its force is 0; while it yields, that where the ramp or this began [m]
        ("mode", _BYTE),  # 1 if it yields while its spring grows, -1 while that shrinks; 0 if it is elastic
        ("kept", _BYTE),  # `mode` in the last part of an implicit step that has been solved
        ("stiffness", _FLOAT),  # [N/m]
        ("limit", _FLOAT),  # largest force, at which it yields [N]
        ("spring", _INT),
        ("reach", _FLOAT),  # elongation from `slip` to there, limit / stiffness [m]
    ],
    align=True,
)
"""A spring and a slider in series, parallel to a bent spring, see `sliders`; one spring's follow each other."""

SLIDER_STATE = ("slip", "mode")
"""Fields of a slider that last from ramp to ramp."""

STRAY = np.dtype(
    [
        ("slower", _FLOAT),  # change of its velocity by other translations of the present stretch, < 0 [m]
        ("faster", _FLOAT),  # the same, > 0 [m]
        ("least", _FLOAT),  # what other motions of this call may add to its displacement, from where [m]
        ("most", _FLOAT),  # to where [m]
        ("kept_least", _FLOAT),  # what of `least` lasted from `begun` to `since` in any case [m]
        ("kept_most", _FLOAT),  # what of `most` did [m]
        ("since", _FLOAT),  # place on the ramp up to which these are known
        ("begun", _FLOAT),  # place before that from which the contact has gone on straight
        ("part", _INT),  # number of its part of the body: in the list of all parts the place of its first contact
        ("behind", _INT),  # the next one in a queue of contacts; itself at the end, -1 outside
        ("chosen", _BYTE),  # whether the translation of its part is a chosen one, on ground without patches
    ],
    align=True,
)
"""What is known of a contact besides CONTACT where springs are bent, see `critical.interval`."""


class Curves(NamedTuple):
    """The bent springs of a body."""

    bends: np.ndarray
    """BEND, shape (B,)."""
    pieces: np.ndarray
    """PIECE, of all curves, shape (P,)."""
    strays: np.ndarray
    """STRAY, memory, shape (N,)."""
    members: np.ndarray
    """The contacts, part by part, see `parts`, memory, shape (N,)."""
    sliders: np.ndarray
    """SLIDER, shape (H,)."""
