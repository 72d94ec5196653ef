"""The records of a path with derivatives: what is known of a contact, a spring, a parameter, a piece of the path.

Kernels take them whole, like the records of `motion.line.records`. Derivatives with respect to P parameters are arrays
with a column for each.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

_FLOAT, _INT, _BYTE = np.float64, np.int64, np.int8

NO_END, CORNER, EVENT, TIE = range(4)
"""How the last piece ended: there was none; at a vertex of the commands; at an event; at events whose order depends on
the parameters."""
FREE = 2
"""No friction holds the contact, and none would if there were some: it follows the others."""

CONTACT = np.dtype(
    [
        ("share", _FLOAT),  # weight in the net translation
        ("v", _FLOAT),  # velocity on the piece [m per ramp]
        ("v_before", _FLOAT),  # velocity on the piece before
        ("sliding", _BYTE),  # direction on the piece: 1, -1; 0 if it is stuck, FREE without friction if it never slid
        ("state", _BYTE),  # as last noted by the engine, see `motion.pieces`; 0 where pieces are noted
        ("speed", _FLOAT),  # its velocity then [m per ramp]
        ("held", _BYTE),  # that state on the piece if it rests at a bound, else 0
        ("arriving", _BYTE),  # bounds that it reaches at the end of the piece, as bits FORWARD and BACKWARD
        ("arrived", _BYTE),  # 1 if it reached a bound there, 2 if that instant depends on the parameters
        ("force", _FLOAT),  # of the springs, at the end of the piece [N]
        ("force_rate", _FLOAT),
        ("size", _FLOAT),  # sum of the absolute tensions around it [N]
        ("rate_size", _FLOAT),
        ("ground", _FLOAT),  # stiffness of its springs to what is stuck, in the elimination [N/m]
        ("way", _FLOAT),  # how far it slid on the piece, or on all that are taken as one [m]
        ("loose", _BYTE),  # whether it slides and no spring joins it, or the contacts that it stands for, to others
    ],
    align=True,
)

SPRING = np.dtype(
    [
        ("a", _INT),  # its two contacts
        ("b", _INT),
        ("bend", _INT),  # -1 if it is linear
        ("row", _INT),  # its place in the band
        ("column", _INT),
        ("stiffness", _FLOAT),  # k, on the piece [N/m]
        ("scale", _FLOAT),  # a stiffness of it that never changes [N/m]
        ("command", _FLOAT),  # stiffness of only its actuator, on the piece [N/m]
        ("elongation", _FLOAT),  # z of a bent spring, at the start or the end of the piece [m]
        ("arrived", _BYTE),  # 1 if it is at a knot at the end of the piece, 2 if that instant depends on the parameters
        ("tension", _FLOAT),  # T, at the start or the end of the piece [N]
        ("rate", _FLOAT),  # of the tension along the ramp [N]
    ],
    align=True,
)

PARAMETER = np.dtype(
    [
        ("d_place", _FLOAT),  # derivative of the place of the last event on its ramp
        ("place_size", _FLOAT),  # size of the terms whose difference it is
        ("moves", np.bool_),  # whether an event there depends on it
        ("one_sided", np.bool_),  # output: whether the derivative is one-sided
        ("d_slack", _FLOAT),  # memory: derivative of the distance of a force from its bound [N]
        ("d_size", _FLOAT),  # size of the terms whose difference it is
        ("scale", _FLOAT),  # largest size met so far [N]
        ("d_work", _FLOAT),  # derivative of the work of the actuators in the ramp [J]
        ("d_offset", _FLOAT),  # derivative of the offset of a PIECE, at its start or its end
        ("d_begin", _FLOAT),  # that at its start
    ],
    align=True,
)

PIECE = np.dtype(
    [
        ("ramp", _INT),  # number of the ramp
        ("next", _INT),  # row of the next piece, or change
        ("begin", _FLOAT),  # the part of the ramp that the piece spans
        ("until", _FLOAT),
        ("first", _FLOAT),  # where the first piece begins that is taken as one with it
        ("riders", _INT),  # contacts at rest at their bounds next to sliding ones
        ("ended", _INT),  # how the last piece ended
        ("knots", _INT),  # knots at which springs are at its end at instants that depend on the parameters
        ("work", _FLOAT),  # work of the actuators in the ramp [J]
        ("steady", np.bool_),  # whether changes are noted, so that pieces may be taken as one
        ("standing", _INT),  # the only contact at rest, in a segment; -1 without one
        ("element", _INT),  # the element before it, or the one that has the point at rest inside; -1 without one
        ("element_after", _INT),  # the element after it; -1 without one
        ("lengthens", np.bool_),  # whether the segment lengthens there
        ("offset", _FLOAT),  # place of the contact, from the point at rest, at the start or the end, in elements
        ("drift", _FLOAT),  # velocity of the continuous body relative to the grid, at the start or the end [m per ramp]
        ("between", np.bool_),  # output: whether the point has ever been between two contacts that both slide
    ],
    align=True,
)


class Band(NamedTuple):
    """The springs as a band of conductances; a chain is a band of width 1 in its own order."""

    order: np.ndarray
    """The contact at each position of the band, shape (N,)."""
    stiffness: np.ndarray
    """Stiffness between the contacts at positions p and p + 1 + d, shape (N, width) [N/m]."""
    memory: np.ndarray
    """Shape (N, width)."""


class System(NamedTuple):
    """A body, what is known of its motion on the piece, and the parameters."""

    contacts: np.ndarray
    """CONTACT, shape (N,)."""
    springs: np.ndarray
    """SPRING, shape (S,)."""
    parameters: np.ndarray
    """PARAMETER, shape (P,)."""
    elements: np.ndarray
    """Both contacts of each element of a segment, shape (Q, 2)."""
    beside: np.ndarray
    """The elements before and after each contact, -1 without one, shape (N, 2)."""
    first: np.ndarray
    """Where the springs of each contact begin in `around`, and where the last contact's end, shape (N + 1,)."""
    around: np.ndarray
    """The springs of each contact, in order, shape (2 S,)."""
    band: Band
    """The springs in the order of elimination."""
    load: np.ndarray
    """Loads on the balances of ways and of velocities, memory, shape (N, 2) [N]."""
    motion: np.ndarray
    """Ways and velocities, memory, shape (N, 2) [m]."""
    kinks: np.ndarray
    """Output: ramp, place and contact, shape (rows, 3); the first row counts."""
    curves: Any
    """The `motion.line.records.Curves` of bent springs; None without any, where nothing of them is compiled."""


class Derivative(NamedTuple):
    """Derivatives of the state."""

    stiffness: np.ndarray
    """Of the stiffness of linear springs, shape (S, P)."""
    pieces: np.ndarray
    """Of the pieces of the curves, columns as in `body.curves`, shape (R, 6, P)."""
    dx: np.ndarray
    """Of the displacements, shape (N, P)."""
    earlier: np.ndarray
    """Of the displacements at the start of the piece, memory, shape (N, P)."""
    load: np.ndarray
    """Of the loads on the balance, memory, shape (N, P)."""
    tension: np.ndarray
    """Of the tensions, shape (S, P)."""
    own: np.ndarray
    """The part of these derivatives at fixed displacements and commands, shape (S, P)."""
    pull: np.ndarray
    """Of the tensions of the actuators; without bent springs the same array as `tension`, shape (S, P)."""


class Commands(NamedTuple):
    """Commands on the ramp, as rows of actuation, forward and backward bounds."""

    start: np.ndarray
    """In force at its start, shape (F,)."""
    change: np.ndarray
    """Their change along it, shape (F,)."""
    target: np.ndarray
    """At the place that is looked at, shape (F,)."""
    d_start: np.ndarray
    """Derivatives of the commands at its start, shape (F, P)."""
    d_end: np.ndarray
    """Derivatives of the commands at its end, shape (F, P)."""
    d_target: np.ndarray
    """Derivatives of the commands at the place that is looked at, shape (F, P)."""


class Course(NamedTuple):
    """Ramps to be followed, whose pieces are known."""

    rows: np.ndarray
    """Targets of the drive's waypoints, shape (W, F)."""
    d_rows: np.ndarray
    """Their derivatives, shape (W, F, P)."""
    before: np.ndarray
    """The waypoint before each ramp's end, shape (V,)."""
    after: np.ndarray
    """The waypoint after it, shape (V,)."""
    part: np.ndarray
    """Place of the ramp's end between them, shape (V,)."""
    d_part: np.ndarray
    """Its derivatives, shape (V, P)."""
    targets: np.ndarray
    """At the end of each ramp, shape (V, F)."""
    tensions: np.ndarray
    """At the start of each ramp, shape (V, S) [N]."""
    elongations: np.ndarray
    """Of the bent springs at the start of each ramp, shape (V, B) [m]."""
    pieces: np.ndarray
    """Pieces or changes from `motion.pieces.follow_pieces`, shape (K, 3 + 2 N) or (K, 6)."""
