"""The memory of an environment, and what all environments share: parts, found by offsets.

A lane is one row of an array of doubles. It holds everything that differs between environments, so that a compiled
call has few arguments, and a lane is copied or reset as one piece.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crawler_model.compiled import lean

(
    DISPLACEMENT,  # of the contacts
    SLOPE,  # what the slope adds to the load of each contact; nothing without loads
    ROW,  # the command in force
    HELD,  # the one before, which loads may need again; nothing without loads
    TARGET,  # the same for the kernels
    ACCOUNT,  # account of the last ramp
    JOINTS,  # readings of the root and the joints: positions, velocities, efforts
    FEET,  # readings of the contacts: positions, velocities, efforts
    MEMORY,  # what the task remembers: place, then the three entries below
    QUEUE,  # the last actions, as many as the largest delay needs
    SIGMA,  # standard deviation of the noise of the sensors, relative to their scales
    RESULT,  # results of a step, see below
    OBSERVATION,  # the observation
) = range(13)
"""Parts of a lane."""
PARTS = 13
FURTHEST, DISTANCE, BEGAN = range(3)
"""Entries of the memory behind the place: furthest place along the direction [m], size of the last error [m], place
along the direction at the start [m]."""
REWARD, GAINED, SPENT, ALONG, TERMINATED, TRUNCATED = range(6)
"""Results of a step: reward [m], what the task gained [m], work of the actuators [J], place along the direction [m],
and 1 where the episode has ended."""

STEP, DELAY, RANDOM, SKIPPED = range(4)
"""Whole numbers of a lane: steps done, delay of the actions in steps, state of the generator of noise, and whether the
next step leaves the lane as it is."""

SIZE, LOW, HIGH = range(3)
"""Rows of the limits of a command's columns: largest change in a step, least and largest value."""
BOUND, SCALE = range(2)
"""Rows of the spans of an observation: largest size, and the size by which noise is multiplied."""

TARGET_SPEED, TOLERANCE, PRICE, DIRECTION = range(4)
"""Entries of a task: speed to keep [m/s], tolerance [m], price of work [m/J]; then the direction, and the place to
reach [m]."""

KIND, AXES, LIMIT, RATE, RATE_BELOW = range(5)
"""Settings: kind of task, dimensions, steps of an episode (0 for no limit), steps per second as a ratio."""
SETTINGS = 5
NS = 1_000_000_000
"""Nanoseconds per second."""
TRAVEL, SPEED, REACH = range(3)
"""Kinds of task."""


class Layout(NamedTuple):
    """What all lanes share.

    Attributes:
        settings: KIND .. RATE_BELOW.
        at: offsets of the parts of a lane, shape (PARTS + 1,).
        limits: rows SIZE .. HIGH of the columns of a command, shape (3, C).
        factor: of each entry of a target, shape (F,).
        weights: of the positions of the joints in the net translation, shape (axes, W).
        spans: rows BOUND and SCALE of the observation, shape (2, O).
        task: TARGET_SPEED .. PRICE, the direction, and the place to reach.
        of: action of each column, or -1, shape (C,).
        column: of each entry of a target, shape (F,).
        stations: contacts and springs of the joints, see `read_records`, shape (W, 3).
        observed: the columns of a command that are observed.
    """

    settings: np.ndarray
    at: np.ndarray
    limits: np.ndarray
    factor: np.ndarray
    weights: np.ndarray
    spans: np.ndarray
    task: np.ndarray
    of: np.ndarray
    column: np.ndarray
    stations: np.ndarray
    observed: np.ndarray


FLOATS = ("limits", "factor", "weights", "spans", "task")
INTS = ("of", "column", "stations", "observed")
"""The parts of the numbers, and of the whole numbers, that all lanes share, in their order. Before the latter stand the
settings, the offsets of the parts of a lane, and the offsets of both."""


@lean
def open_layout(floats, ints):
    """Find the parts of what all lanes share.

    Args:
        floats: FLOATS, one after another.
        ints: settings, offsets, and INTS, one after another.

    Returns:
        The layout.
    """
    first = SETTINGS + PARTS + 1
    f, i = ints[first : first + 6], ints[first + 6 : first + 11]
    axes, columns = ints[AXES], i[1] - i[0]
    return Layout(
        ints[:SETTINGS],
        ints[SETTINGS:first],
        floats[f[0] : f[1]].reshape((3, columns)),
        floats[f[1] : f[2]],
        floats[f[2] : f[3]].reshape((axes, (f[3] - f[2]) // axes)),
        floats[f[3] : f[4]].reshape((2, (f[4] - f[3]) // 2)),
        floats[f[4] : f[5]],
        ints[i[0] : i[1]],
        ints[i[1] : i[2]],
        ints[i[2] : i[3]].reshape(((i[3] - i[2]) // 3, 3)),
        ints[i[3] : i[4]],
    )
