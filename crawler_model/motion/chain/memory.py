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
LEAF, COARSE = 32, 256
"""Contacts of a leaf of the tree of bounds; contacts whose sums for displacements are also stored as one sum."""
MOST_TURNS = 32
"""If an event in a long block turns more contacts than this, the projection solves the block."""


class LongBlocks(NamedTuple):
    """Memory for long blocks; without rows for chains that are too short for them.

    Attributes:
        shortest: number of contacts from which a block is a long one.
        tables: sums over the links before each contact, rows as in `turning`, shape (5, N).
        nodes: tree of bounds of the velocities, columns as in `turning`, shape (2 M, 4).
        order: nodes visited in a search, shape (2 M, 3).
        sums: sums for displacements, as differences along the chain, columns as in `long_blocks`, shape (N, 6).
        coarse: the same for `COARSE` contacts at a time.
        forces: sum of the forces of the contacts of each leaf that slide in long blocks, shape (M,) [N].
        numbers: numbers of blocks and contacts, rows as in `long_blocks`, shape (3, N).
        ends: of a long block at its first and last contact: the other one; -1 elsewhere, shape (N,).
        slid: 1 or -1 for contacts that slid forward or backward in a long block, else 0, shape (N,).
        parts: parts of a block that are still to be solved, shape (MOST_TURNS + 2, 2).
        stopped: contacts that stopped at an event, shape (MOST_TURNS + 1,).
    """

    shortest: int
    tables: np.ndarray
    nodes: np.ndarray
    order: np.ndarray
    sums: np.ndarray
    coarse: np.ndarray
    forces: np.ndarray
    numbers: np.ndarray
    ends: np.ndarray
    slid: np.ndarray
    parts: np.ndarray
    stopped: np.ndarray


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
    return LongBlocks(
        SHORTEST_LONG,
        np.zeros((5, n)),
        np.zeros((2 * leaves, 4)),
        np.zeros((2 * leaves, 3), np.int64),
        np.zeros((n, 6)),
        np.zeros((n // COARSE + 1, 6)),
        np.zeros(leaves),
        np.zeros((3, n)),
        np.full(n, -1, np.int64),
        np.zeros(n, np.int8),
        np.zeros((2 * MOST_TURNS + 4, 2), np.int64),
        np.zeros(MOST_TURNS + 1, np.int64),
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
