"""The working memory for ramps of a chain, and the meaning of its rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import projection

# Rows of the scratch floats.
(
    ROW_RATE,
    ROW_LINK_SINCE,
    ROW_V,
    ROW_SINCE,
    ROW_NEXT,
    ROW_ENTERED,  # the event entered in the tournament
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
) = range(16)
_FLOAT_ROWS = 16
# Rows of the scratch bytes.
ROW_SIDE, ROW_LEAVING, ROW_COMING, ROW_MOVED = range(4)
_BYTE_ROWS = 4

SHORTEST_LONG = 128
"""Number of contacts from which a sliding block is a long one (`long_blocks`)."""
LEAF, SPAN = 32, 64
"""Contacts of a leaf of the tree of bounds; contacts whose sums for displacements are also stored as one sum."""
MOST_TURNS = 32
"""If an event in a long block turns more contacts than this, the projection solves the block."""


class LongBlocks(NamedTuple):
    """Memory for long blocks; without columns for chains that are too short for them.

    Attributes:
        shortest: number of contacts from which a block is a long one.
        lines: rows as in `turning`, then numbers of blocks as in `long_blocks` and `slides`, shape (8, N).
        sums: sums for displacements, columns as in `slides`, shape (R, 6).
        nodes: tree of bounds of the velocities, columns as in `turning`, shape (2 M, 5).
        order: nodes visited in a search, shape (2 M, 3).
        marks: rows ENDS and SLID as in `slides`, shape (2, N).
        parts: parts of a block that are still to be solved, and contacts that stopped, shape (P, 3).
    """

    shortest: int
    lines: np.ndarray
    sums: np.ndarray
    nodes: np.ndarray
    order: np.ndarray
    marks: np.ndarray
    parts: np.ndarray


class Scratch(NamedTuple):
    """Memory that ramps reuse; it holds no data between ramps."""

    floats: np.ndarray
    bytes: np.ndarray
    tree: np.ndarray
    stacks: np.ndarray
    long: LongBlocks


def _long_blocks(contacts: int) -> LongBlocks:
    n = contacts if contacts >= SHORTEST_LONG else 0
    leaves = 1 << max(-(-n // LEAF) - 1, 0).bit_length()
    fine = n // SPAN + 1
    return LongBlocks(
        SHORTEST_LONG,
        np.zeros((8, n)),
        np.zeros((n + fine + fine // SPAN + 1, 6)),
        np.zeros((2 * leaves, 5)),
        np.zeros((2 * leaves, 3), np.int64),
        np.full((2, n), -1, np.int64),
        np.zeros((2 * MOST_TURNS + 4, 3), np.int64),
    )


def scratch(contacts: int) -> Scratch:
    """Allocate the scratch memory for a chain.

    Args:
        contacts: number of contacts N.

    Returns:
        The arrays for `follow`.
    """
    leaves = 1 << max(contacts - 1, 1).bit_length()
    return Scratch(
        np.zeros((_FLOAT_ROWS, contacts)),
        np.zeros((_BYTE_ROWS, contacts), np.int8),
        np.full(2 * leaves + contacts, -1, np.int64),
        projection.workspace(contacts),
        _long_blocks(contacts),
    )
