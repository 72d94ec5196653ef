"""The memory in which ramps of a chain are followed: what its rows hold."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import projection as chain_kernel

# Rows of the scratch floats.
(
    ROW_RATE,
    ROW_LINK_SINCE,
    ROW_V,
    ROW_SINCE,
    ROW_NEXT,
    ROW_ENTERED,  # the event that stands in the tournament
    ROW_D_ACTUATION,
    ROW_D_FORWARD,
    ROW_D_BACKWARD,
    ROW_TRIAL,
    ROW_BACKWARD,
    ROW_FORWARD,
    ROW_GRAIN,
    ROW_ZEROS,  # stay so
    ROW_V_BEFORE,  # the last event
) = range(15)
_FLOAT_ROWS = 15
# Rows of the scratch bytes.
ROW_SIDE, ROW_LEAVING, ROW_COMING, ROW_MOVED = range(4)
_BYTE_ROWS = 4


class Scratch(NamedTuple):
    """Memory that ramps reuse; it holds nothing between them."""

    floats: np.ndarray
    bytes: np.ndarray
    tree: np.ndarray
    stacks: np.ndarray


def scratch(contacts: int) -> Scratch:
    """Make the scratch memory for a chain.

    Args:
        contacts: number of contacts N.

    Returns:
        The arrays that `follow` takes.
    """
    leaves = 1 << max(contacts - 1, 1).bit_length()
    return Scratch(
        np.zeros((_FLOAT_ROWS, contacts)),
        np.zeros((_BYTE_ROWS, contacts), np.int8),
        np.full(2 * leaves + contacts, -1, np.int64),
        chain_kernel.workspace(contacts),
    )
