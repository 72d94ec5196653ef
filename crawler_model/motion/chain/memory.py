"""The working memory for ramps of a chain, and the meaning of its rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import compiled
from . import projection

# Rows of the scratch floats.
(
    ROW_RATE,
    ROW_LINK_SINCE,
    ROW_V,
    ROW_SINCE,
    ROW_NEXT,
    ROW_D_ACTUATION,
    ROW_D_FORWARD,
    ROW_D_BACKWARD,
    ROW_TRIAL,
    ROW_BACKWARD,
    ROW_FORWARD,
    ROW_MAGNITUDE,
    ROW_ZEROS,  # never written
    ROW_V_BEFORE,  # velocity before the last event
    ROW_GAIN,
    ROW_TENSION,  # after an implicit step
    ROW_STEP,  # displacements in an implicit step
) = range(17)
_FLOAT_ROWS = 17
# Rows of the scratch bytes.
ROW_SIDE, ROW_LEAVING, ROW_COMING, ROW_MOVED, ROW_HIT = range(5)
_BYTE_ROWS = 5

_HEADER = 5
SHORTEST_LONG = 32
"""Number of contacts from which a sliding block can be a long one (`long.solve`)."""
VISITS_BEFORE = 0.5
"""Long blocks begin in a ramp when that many contacts, as a multiple of those of the chain, were solved in blocks long
enough: it takes about as long to prepare and to finish them."""
(
    P,
    P_LOW,
    Q,
    Q_LOW,
    ELONGATION,
    ELONGATION_LOW,
    SIZE,
    SINCE_X,
    SINCE_REST,
    SLIDE_FORCE,
    SLIDE_GROWTH,
    RATE_OF,
    SINCE_OF,
    LEAST_OF,
    MOST_OF,
) = range(15)
"""Rows of the lines. Fixed for the ramp: the sums P and Q of `long.tables`, and that of the elongations where long
blocks began, in two floats each; the sum of the absolute rates of the rest lengths; the displacement of each contact
where long blocks began, and its rounding rest. Of each contact in a long block, else 0: the force at its bound at the
start of the ramp, and the rate of that force. At the first contact of a block: the rate of the tension before it, the
place since which it holds, a lower bound of the velocities of its contacts that slide forward, and an upper bound of
the others."""
_LINES = 15
_COLUMNS = 10
LEAF = 32
"""Contacts of a leaf of the trees of long blocks."""
MOST_TURNS = 32
"""If an event in a long block turns more contacts than this, the projection solves the block."""


class Scratch(NamedTuple):
    """Memory that ramps reuse; it holds no data between ramps."""

    floats: np.ndarray
    bytes: np.ndarray
    tree: np.ndarray
    stacks: np.ndarray
    long_floats: np.ndarray
    long_ints: np.ndarray


@compiled
def carve(long_floats: np.ndarray, long_ints: np.ndarray) -> tuple[np.ndarray, ...]:
    """Divide the memory for long blocks; a kernel gets it in two arrays because each array adds to the time of a call.

    Args:
        long_floats: from `scratch`.
        long_ints: likewise; it begins with `SHORTEST_LONG`, the number of contacts N, 0 if the chain is too short, the
            number of their positions, N in a chain and 2 N in a ring, the number of leaves M, and the visits after
            which long blocks begin.

    Returns:
        Lines, rows P .. MOST_OF, with a column for each position.
        Nodes of the tree, columns as in `long.tables`, shape (2 M, 10).
        Order of the nodes visited in a search, shape (2 M, 3).
        Marks, rows ENDS and STALE as in `long.tables`, shape (2, N).
        Parts of a block that are still to be solved, and contacts that stopped, shape (P, 3).
    """
    n, positions, leaves = long_ints[1], long_ints[2], long_ints[3]
    rest = _LINES * positions
    lines = long_floats[:rest].reshape((_LINES, positions))
    nodes = long_floats[rest:].reshape((2 * leaves, _COLUMNS))
    order = long_ints[_HEADER : _HEADER + 6 * leaves].reshape((2 * leaves, 3))
    rest = _HEADER + 6 * leaves
    marks = long_ints[rest : rest + 2 * n].reshape((2, n))
    rest += 2 * n
    parts = long_ints[rest:].reshape(((long_ints.shape[0] - rest) // 3, 3))
    return lines, nodes, order, marks, parts


def _long_blocks(contacts: int, laps: int) -> tuple[np.ndarray, np.ndarray]:
    n = contacts if contacts >= SHORTEST_LONG else 0
    positions = laps * n
    leaves = 1 << max(-(-positions // LEAF) - 1, 0).bit_length()
    floats = np.zeros(_LINES * positions + 2 * _COLUMNS * leaves)
    ints = np.zeros(_HEADER + 6 * leaves + 2 * n + 3 * (2 * MOST_TURNS + 4), np.int64)
    ints[:_HEADER] = SHORTEST_LONG, n, positions, leaves, int(VISITS_BEFORE * n)
    return floats, ints


def scratch(contacts: int, laps: int = 1) -> Scratch:
    """Allocate the scratch memory for a chain or a ring.

    Args:
        contacts: number of contacts N.
        laps: 1 for a chain, 2 for a ring, in whose tables each contact has two positions.

    Returns:
        The arrays for `follow`.
    """
    leaves = 1 << max(contacts - 1, 1).bit_length()
    return Scratch(
        np.zeros((_FLOAT_ROWS, contacts)),
        np.zeros((_BYTE_ROWS, contacts), np.int8),
        np.zeros(4 * leaves + contacts),
        projection.workspace(contacts),
        *_long_blocks(contacts, laps),
    )
