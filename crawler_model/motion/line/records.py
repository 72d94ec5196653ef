"""The records of the engine: what is known of a contact, a spring, an end of a spring, a block and a ramp.

Each is a numpy structured array; kernels take it whole and read `contacts[i].force_rate`. Within a ramp, quantities
change linearly in the place s on the ramp, 0 .. 1: rates are per unit of s. What a field means is stated only here.
"""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np

_FLOAT, _BYTE, _INT, _LONG = np.float64, np.int8, np.int32, np.int64  # long are counters of events and blocks

FORWARD, BACKWARD = 1, 2
"""Bits of a contact's status: the spring force is at the forward bound, or at the backward bound; both if the interval
between them is a point."""
AHEAD, BEHIND, KNOT, WALL, CATCH, KINK = 4, 8, 16, 32, 64, 96
"""What a contact comes to at its next event, besides a bound: the border ahead or the border behind, a spring that
begins at it a knot, a wall, the bound of the ground that ends its jump, or a kink of the friction that an elongation
adds to it."""

CONTACT_STATE = [
    ("x", _FLOAT),  # displacement, where it was last advanced [m]
    ("residue", _FLOAT),  # what rounding left out of it [m]
    ("gained", _FLOAT),  # displacement gained since `follow` was called [m]
    ("forward", _FLOAT),  # largest spring force that holds the contact, at s = 0 [N]
    ("backward", _FLOAT),  # largest spring force in the other direction, at s = 0 [N]
    ("load", _FLOAT),  # force along the ground, at s = 0, contained in both bounds [N]
    ("v", _FLOAT),  # velocity; between ramps the last one's, whose sign begins the search for the next
    ("bounds_met", _BYTE),  # bounds that the spring force is at, as bits
]
"""Fields of a contact that last from ramp to ramp: they, and the fields of a spring, are the state of a body."""

CONTACT = np.dtype(
    [
        *CONTACT_STATE,
        ("side", _BYTE),  # bound that the force moves along until the next event: 1 forward, -1 backward, 0 none
        ("leaving", _BYTE),  # bounds that it leaves as soon as s has increased
        ("coming", _BYTE),  # bound or border that its next event reaches
        ("noted", _BYTE),  # its state as last noted where changes are asked for, see `motion.pieces`
        ("listed", _BYTE),  # whether it is among the contacts around which rates change
        ("fallen", _BYTE),  # bounds that the ground does not hold, as bits: they fall to the ground's in a jump
        ("lost", _FLOAT),  # energy lost in the present jump, not to friction [J]
        ("spare", _FLOAT),  # in a jump on gradual ground, by how much its bound exceeds the ground's, at s = 0 [N]
        ("d_under", _FLOAT),  # change of the ground's bound along the fall [N]
        ("d_forward", _FLOAT),  # change of the bounds and of the load along the ramp [N]
        ("d_backward", _FLOAT),
        ("d_load", _FLOAT),
        ("force", _FLOAT),  # of the springs, at s = since [N]
        ("force_rate", _FLOAT),
        ("since", _FLOAT),  # place on the ramp where x and force were last advanced; in a fall, on that, < 0
        ("pull", _FLOAT),  # rate of the force if no contact moves [N]
        ("share", _FLOAT),  # weight in the net translation
        ("next", _FLOAT),  # place of its next event on the ramp; infinite without one
        ("kept", _FLOAT),  # velocity in the last part of an implicit step that has been solved [m]
        ("winner", _INT),  # contact with the earliest event below node i of the tournament
        ("first", _INT),  # its ends of springs are first .. last - 1
        ("last", _INT),
        ("order", _INT),  # position in the order of elimination
        ("mark", _LONG),  # number of the last block that it was in
        ("row", _INT),  # its row in that block
    ],
    align=True,
)

SPRING = np.dtype(
    [
        ("length", _FLOAT),  # change of the rest length, L, at s = 0 [m]
        ("elongation", _FLOAT),  # z, at the last end of a ramp [m]
        ("tension", _FLOAT),  # T, at s = since [N]
        ("still_tension", _FLOAT),  # T and L when the elongation last changed: from them follows the tension of a
        ("still_length", _FLOAT),  # spring whose ends rest, so that rest is rest to the bit
        ("stiffness", _FLOAT),  # k [N/m]
        ("compliance", _FLOAT),  # 1 / k [m/N]
        ("a", _INT),  # its two contacts
        ("b", _INT),
        ("bend", _INT),  # -1 if it is linear
        ("d_length", _FLOAT),  # change of L along the ramp [m]
        ("rate", _FLOAT),  # of the tension [N]
        ("since", _FLOAT),  # place on the ramp where the tension was last advanced; in a fall, on that, < 0
        ("moved", _BYTE),  # whether the elongation has changed on this ramp
        ("element", _BYTE),  # whether it is an element of a segment
    ],
    align=True,
)

SPRING_STATE = ("length", "elongation", "tension", "still_tension", "still_length")
"""Fields of a spring that last from ramp to ramp."""

FOOT = np.dtype(
    [
        ("home", _FLOAT),  # reference position xi [m]
        ("weight", _FLOAT),  # [N]
        ("follows", _BYTE),  # whether friction follows from the weight
        ("place", _INT),  # as in `body.ground.Track`
        ("forward", _FLOAT),  # bounds and load commanded, as on ground without patches, at s = 0 [N]
        ("backward", _FLOAT),
        ("load", _FLOAT),
        ("d_forward", _FLOAT),  # their changes along the ramp [N]
        ("d_backward", _FLOAT),
        ("d_load", _FLOAT),
        ("jump", _INT),  # number of its present jump, counted from 1; 0 if it does not jump
        ("walled", _BYTE),  # sides on which it stands at a wall, FORWARD and BACKWARD as bits
        ("stretch", _INT),  # on which an implicit step ends, see `ground.steps`
        ("met", _BYTE),  # `bounds_met` of the contact where that begins
        # where friction changes with elongations, see `ground.couplings`
        ("more_forward", _FLOAT),  # what these add to the bounds, at s = 0 [N]
        ("more_backward", _FLOAT),
        ("d_more_forward", _FLOAT),  # its change along the ramp, or along the present fall [N]
        ("d_more_backward", _FLOAT),
        ("upper", _FLOAT),  # limits of the rate of the force in the present block without it, as of a BLOCK [N]
        ("lower", _FLOAT),
        ("grows_forward", _FLOAT),  # what the velocities in the present block add to the rates of the bounds [N]
        ("grows_backward", _FLOAT),
    ],
    align=True,
)
"""What is known of a contact besides CONTACT where there are patches of ground, walls or couplings."""

FOOT_STATE = ("place", "forward", "backward", "load", "walled")
"""Fields of a foot that last from ramp to ramp."""

COUPLING = np.dtype(
    [
        ("contact", _INT),
        ("spring", _INT),
        ("a", _INT),  # the two contacts that the spring joins
        ("b", _INT),
        ("first", _INT),  # its pieces are first .. last
        ("last", _INT),
        ("piece", _INT),  # the present one
        ("kinked", _BYTE),  # whether the spring is at the kink between the pieces `low` and `low` + 1
        ("low", _INT),
        ("z", _FLOAT),  # elongation of the spring where the present block is solved [m]
        ("rate", _FLOAT),  # its rate [m]
        ("next", _FLOAT),  # place on the ramp at which it comes to a kink; infinite if it comes to none
    ],
    align=True,
)
"""Friction that the elongation of a spring adds to the bounds of a contact."""

COUPLING_PIECE = np.dtype(
    [
        ("begin", _FLOAT),  # elongations from where to where it reaches [m]
        ("end", _FLOAT),
        ("at", _FLOAT),  # an elongation on it [m]
        ("forward", _FLOAT),  # friction there [N] and its slope [N/m]
        ("d_forward", _FLOAT),
        ("backward", _FLOAT),
        ("d_backward", _FLOAT),
    ],
    align=True,
)

JUMP = np.dtype(
    [
        ("ramp", _INT),  # as the attributes of `motion.jump.Jump`
        ("fraction", _FLOAT),
        ("contact", _INT),
        ("border", _FLOAT),
        ("distance", _FLOAT),
        ("loss", _FLOAT),
        ("x", _FLOAT),  # displacement at the border [m]
    ],
    align=True,
)

END = np.dtype(
    [
        ("other", _INT),  # contact at the other end
        ("spring", _INT),
        ("sign", _FLOAT),  # 1 if the tension pulls the contact forward, -1 backward
        ("flow", _FLOAT),  # rate of the force of the spring on the contact that `mesh` finds [N]
    ],
    align=True,
)

BLOCK = np.dtype(
    [
        ("contact", _INT),
        ("cluster", _INT),  # sleeping cluster whose last contact that is, see `clusters`; -1 if the row is one contact
        ("side", _BYTE),  # as of a contact, during the search
        ("upper", _FLOAT),  # largest rate of the force that keeps the contact within its bounds; infinite if free [N]
        ("lower", _FLOAT),  # least such rate [N]
        ("blur", _FLOAT),  # sum of the bounds whose change the limits are, the scale of their rounding [N]
        ("load", _FLOAT),  # rate of the force if no contact moves [N]
        ("v", _FLOAT),  # velocity that is found [m]
        ("force", _FLOAT),  # rate of the force that is found [N]
        ("scale", _FLOAT),  # scale of the rounding of that rate [N]
        # of the spring before the contact, where the block is a path; the row behind the last has the spring behind it
        ("spring", _INT),  # -1 if there is none
        ("sign", _FLOAT),  # 1 if the spring points along the path
        ("trial", _FLOAT),  # rate of its tension if no contact moves [N]
        ("compliance", _FLOAT),  # [m/N]
        ("flow", _FLOAT),  # rate of its tension that is found [N]
        ("zero", _FLOAT),  # where the function before the contact vanishes, see `project` [N]
        # where the block is a graph
        ("ground", _FLOAT),  # sum of the stiffnesses to contacts at rest, and to gradual ground [N/m]
        ("ahead", _FLOAT),  # stiffness of gradual ground, if the contact slides forward [N/m]
        ("behind", _FLOAT),  # likewise, backward [N/m]
        ("tried", _BYTE),  # side in the solution that a search of all sides found first
        ("joined", _FLOAT),  # stiffness of the spring to the next row, if both slide [N/m]
        ("part", _FLOAT),  # part of what the contact adds that the next one bears [1]
        ("pull", _FLOAT),  # force that the sliding contact adds [N]
        ("rough", _FLOAT),  # velocity before its correction [m]
        ("before", _FLOAT),  # velocity along the chord, see `ground.turns` [m]
        ("reach", _INT),  # number of the following rows that it shares springs with, as elimination proceeds
    ],
    align=True,
)
"""A row of the present block: one contact, or a sleeping cluster of contacts."""

DRAWN = np.dtype(
    [
        ("contact", _INT),
        ("held", _FLOAT),  # sum of its bounds before the fall [N]
    ],
    align=True,
)
"""A contact that takes part in the present fall."""

BREAK = np.dtype([("at", _FLOAT), ("slope", _FLOAT), ("jump", _FLOAT)], align=True)
"""A breakpoint of `project`: the slope on the side that is further from the zero, and the jump at it."""

CLUSTER = np.dtype(
    [
        ("first", _INT),  # its contacts are first .. last, each with the spring before it
        ("last", _INT),
        ("spring", _INT),  # the spring before the first of them
        ("parent", _INT),  # cluster that it is part of, -1 if there is none
        ("child", _INT),  # first of the clusters that it consists of, -1 for a leaf
        ("whole", _BYTE),  # whether it has as many parts as others, and a spring before it
        (
            "sleeps",
            _BYTE,
        ),  # whether its contacts are followed as one; contacts of a part of a sleeping cluster sleep, too
        ("mark", _LONG),  # number of the block that it was last in
        ("compliance", _FLOAT),  # of all its springs together [m/N]
        ("stretch", _FLOAT),  # velocity that its springs add if the rate of the tension before it is zero [m]
        ("rise", _FLOAT),  # sum of the rates of the forces on its contacts [N]
        ("since", _FLOAT),  # place on the ramp to which it was integrated
        ("v", _FLOAT),  # velocity of the contact before it [m]
        ("rate", _FLOAT),  # of the tension of its first spring [N]
        # integrals since it fell asleep
        ("time", _FLOAT),  # of 1
        ("way", _FLOAT),  # of v
        ("pull", _FLOAT),  # of the rate
        ("time_moment", _FLOAT),  # of s
        ("way_moment", _FLOAT),  # of s v
        ("pull_moment", _FLOAT),  # of s times the rate
        # when its contacts were last looked at
        ("seen_v", _FLOAT),
        ("seen_rate", _FLOAT),
        ("least", _FLOAT),  # no contact that slides forward was slower [m]
        ("most", _FLOAT),  # no contact that slides backward was slower, < 0 [m]
    ],
    align=True,
)
"""A cluster of contacts of a long path."""

SEVERAL = 2
"""Value of `shifted` in a RAMP where several translations are admissible."""
SEARCH = np.dtype(
    [
        ("hurries", _BYTE),  # whether the search for its solution ends as soon as it makes no progress
        ("block", _LONG),  # number of the present block, increasing
        ("rows", _INT),  # number of its rows
        ("anchored", _BYTE),  # whether contacts at rest next to the present block hold it
        ("loose", _INT),  # 1 + a contact of a block that nothing holds; < 0 if that slides backward, 0 if there is none
        ("chain", _BYTE),  # whether blocks on gradual ground are paths of a chain, except in an implicit step
        ("path", _INT),  # number of contacts of the present block if it is a path, else 0
        ("before", _INT),  # contacts at rest next to the path, -1 where it ends
        ("behind", _INT),
        ("reach", _INT),  # neighbouring contacts at rest that it may contain at an end
        ("guards", _BYTE),  # ends of the path that neighbours at rest continue: BACKWARD, FORWARD
        ("woken", _BYTE),  # whether clusters of the block woke, so that it must be found anew
        ("asleep", _BYTE),  # whether clusters may be asleep
        ("leaf_size", _INT),  # number of contacts of a leaf, and of the parts of other clusters
        ("shortest", _INT),  # number of contacts of a block in which they fall asleep
        ("projects_after", _INT),  # rounds after which it goes on from a projection
        ("patience", _INT),  # rounds without progress before it exchanges contacts one by one
        ("undetermined", _BYTE),  # whether the whole body slides and nothing determines its translation
        ("left", _INT),  # breakpoints of `project`: the first of them for v < 0, the last of them for v > 0
        ("right", _INT),
        ("low", _FLOAT),  # what both parts are shifted by [N]
        ("high", _FLOAT),
        ("compliance", _FLOAT),  # what the springs so far add to all slopes [m/N]
    ],
    align=True,
)
"""The search for the rates of the present block, and what it may cost."""
FALL = np.dtype(
    [
        ("due", _INT),  # 1 + a contact that falls at s; 0 if none is known
        ("falling", _BYTE),  # whether commands rest and bounds fall
        ("rests", _FLOAT),  # place on the ramp at which commands rest in a fall
        ("drawn", _INT),  # number of contacts that take part in the present fall
        ("runaway", _BYTE),  # direction in which nothing holds the body, 1 or -1; else 0
        ("jumps", _INT),  # number of jumps of the present call
        ("lost", _FLOAT),  # energy lost in jumps [J]
    ],
    align=True,
)
"""A fall on ground that holds less, see `ground.falls`, and its jumps."""
ACCOUNT = np.dtype(
    [
        ("work", _FLOAT),  # of the actuators [J]
        ("dissipation", _FLOAT),  # by the bounds, which contain the loads [J]
        ("internal", _FLOAT),  # by sliders [J]
        ("loads_work", _FLOAT),  # of the loads [J]
        ("residual", _FLOAT),  # of the balance of energy [J]
        ("violation", _FLOAT),  # largest force beyond a bound [N]
        ("complementarity", _FLOAT),  # largest product of a velocity and a distance of the force from its bound [J]
        ("rounding", _FLOAT),  # estimated rounding of displacements [m]
        ("corrected", _FLOAT),  # what the corrections of tensions, where a part of the ramp ends, change in them [m]
        ("visited", _FLOAT),  # least margin
        ("events", _FLOAT),  # number of pieces of the path
        ("ambiguous", _FLOAT),  # 1 if a translation was chosen
        ("gain_least", _FLOAT),  # what other translations would change the gain by [m]
        ("gain_most", _FLOAT),
        ("overspent", _FLOAT),  # 1 if the budget was spent
        ("unsolved", _FLOAT),  # 1 if no rates were found, or if the certificate shows more than rounding
    ],
    align=True,
)
"""The account of a ramp, as in `motion.account`."""
RAMP = np.dtype(
    [
        ("s", _FLOAT),  # place on the ramp, 0 .. 1; in a fall, place on it, -1 .. 0
        ("end", _FLOAT),  # where that ends: 1, in a fall a hair before 0
        ("stepping", _BYTE),  # whether the ramp is one implicit step
        ("fraction", _FLOAT),  # of the change of its commands for which that is solved, 0 .. 1
        ("begun", _BYTE),  # whether the first stretch has begun, and the tournament holds all events
        ("shifted", _BYTE),  # 1 if a translation is chosen anew at s, SEVERAL if it could be another one
        ("effort", _LONG),  # contacts solved so far, counted in every round
        ("budget", _LONG),  # effort beyond which the ramp is completed by one implicit step
        ("exact", _BYTE),  # whether ramps are followed from event to event, or each by one implicit step
        ("parted", _BYTE),  # whether the parts of the body are known
        ("slides", _INT),  # how often contacts that nothing holds slid to knots
        ("passed", _INT),  # knots passed at s
        ("few", _INT),  # contacts up to which the margin is computed and all parts are looked at at every event
        ("together", _INT),  # knots passed at one place before they are passed one after another
        ("turns", _INT),  # solutions of an implicit step before pieces of curves are changed one by one
        ("first", _INT),  # present part of the body: its places in the list of parts are first .. last - 1
        ("last", _INT),
        ("present", _INT),  # its number
        ("parts", _INT),  # number of the last part that was listed by itself, < 0
        ("slower", _FLOAT),  # change of the net velocity by other translations of the present stretch [m]
        ("faster", _FLOAT),
        ("strays", _BYTE),  # whether contacts of a body with bent springs could be elsewhere, see `critical.interval`
        ("until", _FLOAT),  # place on the ramp where the present stretch ends, while its translation is chosen
        ("witness", _INT),  # contact at which the search for forces away from their bounds begins
        ("friction", _FLOAT),  # sum of all bounds at s = 0 [N]
        ("d_friction", _FLOAT),  # its change along the ramp [N]
        ("stored", _FLOAT),  # elastic energy at the start of the ramp [J]
        ("number", _INT),  # of the ramp in the present call
        ("done", _FLOAT),  # part of the ramp that was followed before; s is a place on the rest of it
        ("span", _FLOAT),  # a length that rounds like all positions [m]
        ("chord", _FLOAT),  # place on the ramp to which the present chord leads, see `ground.chords`
        ("chords", _FLOAT),  # least number of chords of the ramp; 0 where no bound is curved
        ("stride", _FLOAT),  # longest chord that is tried next
        ("cut", _BYTE),  # whether the chord has been shortened, so that all rates are to be found anew
        ("search", SEARCH),
        ("fall", FALL),
        ("account", ACCOUNT),
    ],
    align=True,
)

INTERPRETED = os.environ.get("NUMBA_DISABLE_JIT", "0") != "0"
"""Whether kernels are interpreted, which then check what else would only cost time."""


def zeros(shape: int | tuple[int, ...], dtype: np.dtype[np.void]) -> np.ndarray:
    """Allocate records of zeros.

    Args:
        shape: of the array.
        dtype: of a record.

    Returns:
        The array; where kernels are interpreted, one whose fields are attributes, too (slow to pass to compiled ones).
    """
    found = np.zeros(shape, dtype)
    return found.view(np.recarray) if INTERPRETED else found


def copy_records(records: np.ndarray) -> np.ndarray:
    """Copy records as bytes: numpy copies them field by field, which takes as long as several short ramps.

    Args:
        records: the records, contiguous along their last axis.

    Returns:
        An independent array with the same bytes.
    """
    found = np.empty_like(records)
    found.view(np.uint8)[:] = records.view(np.uint8)
    return found


DONE, SPENT, UNSOLVED = 0, 1, 2
"""Outcomes of a ramp: its end was reached; the budget was spent; no rates were found."""


class Couplings(NamedTuple):
    """Friction that changes with elongations."""

    each: np.ndarray
    """COUPLING, sorted by contact and spring, shape (C,)."""
    pieces: np.ndarray
    """COUPLING_PIECE, shape (P,)."""
    rows: np.ndarray
    """Order of the rows of the matrix after its decomposition, memory, shape (N,)."""
    gentle: np.ndarray
    """Whether springs add friction to the contacts at their own ends only, by slopes below their stiffness, (1,)."""
    feet: np.ndarray
    """FOOT, shape (N,)."""


class Terrain(NamedTuple):
    """Patches of ground under a body and walls, the stretches of ground as in `body.ground.Track`."""

    feet: np.ndarray
    """FOOT, shape (N,)."""
    jumps: np.ndarray
    """JUMP, output, shape (J,); further ones are counted only."""
    drawn: np.ndarray
    """DRAWN, the contacts that take part in the present fall, memory, shape (N,)."""
    nodes: np.ndarray
    """Nodes of the tournament that are still to be descended to, memory, shape (N + 1,)."""
    walls: np.ndarray
    """Places of the nearest wall ahead and behind of each contact, infinite without one, shape (2, N) [m]; (2, 0) if
    there are no walls at all."""
    borders: np.ndarray
    grip: np.ndarray
    pressed: np.ndarray
    rise: np.ndarray
    profile: Any
    """As in `body.ground.Track`; None if the ground changes at borders alone, where nothing of it is
    compiled."""
    couplings: Any
    """The `Couplings`; None if no friction changes with elongations, likewise."""


class Model(NamedTuple):
    """What kernels need besides contacts, springs and the ramp; Python passes it as a plain tuple, which is faster."""

    ends: np.ndarray
    """END, two of each spring, contact by contact, shape (2 S,)."""
    block: np.ndarray
    """BLOCK, memory, shape (N + 1,)."""
    listed: np.ndarray
    """The contacts around which rates change, memory, shape (N,)."""
    matrix: Any
    """Conductances between sliding contacts, memory, a row for each, shape (N, width); with couplings (N, N). None for
    chains of linear springs on ground that is the same everywhere, all of whose blocks are paths: nothing of other
    blocks is compiled, and for graphs of such springs on such ground no guards of blocks."""
    breaks: np.ndarray
    """BREAK, memory, shape (2 N,)."""
    pieces: np.ndarray
    """Rows for the pieces of the path, output, see `motion.pieces`; none unless asked for."""
    ground: Any
    """The `Terrain`; None without patches, where nothing of it is compiled."""
    clusters: Any
    """CLUSTER, leaves first, shape (R,); None for bodies without long paths, where nothing of it is compiled."""
    curves: Any
    """The `Curves`; None if all springs are linear, where nothing of it is compiled."""
