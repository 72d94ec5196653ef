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


class Scratch(NamedTuple):
    """Memory that ramps reuse; it holds no data between ramps."""

    floats: np.ndarray
    bytes: np.ndarray
    tree: np.ndarray
    stacks: np.ndarray


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
    )
