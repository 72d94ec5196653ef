"""Commands that were accepted: trajectories, and the vertices of a tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A checked trajectory: when it starts, and its waypoints.

    Attributes:
        start_ns: simulated time [ns]; None to start as soon as possible.
        columns: the numbers of a command row that it sets, one array of indices per name.
        times_ns: time_from_start of each point, shape (points,) [ns].
        positions: shape (points, names).
    """

    start_ns: int | None
    columns: list[np.ndarray]
    times_ns: np.ndarray
    positions: np.ndarray


@dataclass(frozen=True, eq=False)
class Vertex:
    """The end of a ramp within a tick: its simulated time [ns] and the row commanded there."""

    due_ns: int
    row: np.ndarray
