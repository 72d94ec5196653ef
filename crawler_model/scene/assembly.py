"""The assembled arrays of a scene, ready for simulation."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass

import numpy as np

from ..arrays import frozen
from ..body.body import Body
from ..body.columns import Columns
from ..body.directions import unit_directions
from ..body.drive import Drive
from ..body.ground import Ground
from .parts import SceneParts, angles_of


@dataclass(frozen=True, eq=False)
class Assembly:
    """The parts of a scene and the arrays built from them; a `Plan`.

    Attributes:
        parts: the content of the scene file.
        body: contacts and springs, with segments divided into elements.
        ground: weights of the contacts, and the slope.
        columns: layout of the commands.
        drive: the drive; without one, L = 0 and the constant friction of the scene.
        start_displacement: x at the start, shape (N,), in the plane (N, 2) [m].

    The assembly of variations on a line has a leading axis in what varies.
    """

    parts: SceneParts
    body: Body
    ground: Ground
    columns: Columns
    drive: Drive
    start_displacement: np.ndarray

    @property
    def name(self) -> str:
        """Name of the scene in tables and recordings."""
        return self.parts.name

    @property
    def dimension(self) -> int:
        """1 on a line, 2 in the plane."""
        return self.parts.dimension

    @property
    def tolerance(self) -> float | None:
        """Largest error of a planar ramp, relative to the largest commanded change [1]; None for the default."""
        return self.parts.tolerance

    @property
    def has_exact_derivatives(self) -> bool:
        """Whether paths have exact derivatives: on a line, on ground that is the same everywhere."""
        return self.dimension == 1 and self.ground.track is None

    @property
    def angles(self) -> np.ndarray:
        """Angles of the friction directions in the plane, shape (m,) [rad]; m = 0 for isotropic friction."""
        return np.array(angles_of(self.parts), dtype=np.float64)

    @functools.cached_property
    def commanded(self) -> np.ndarray:
        """Which columns the drive commands, bool, shape (C,): all lengths, and friction and loads where it has them."""
        drive, columns = self.parts.drive, self.columns
        friction = drive is not None and drive.commands_friction
        loads = drive is not None and drive.loads is not None
        parts = (columns.lengths, True), (columns.frictions, friction), (columns.loads, loads)
        return frozen(np.concatenate([np.full(size, given) for size, given in parts]))

    def variation(self, at: int) -> Assembly:
        """Select one of several variations that were assembled together.

        Args:
            at: its index.

        Returns:
            Its assembly; the parts are those of all.
        """

        def one(array: np.ndarray, axes: int) -> np.ndarray:
            return frozen(array[at]) if array.ndim > axes else array

        slope_load, drive, slope, period = self.columns.slope_load, self.drive, self.ground.slope, self.drive.period
        columns = dataclasses.replace(self.columns, slope_load=None if slope_load is None else one(slope_load, 1))
        return dataclasses.replace(
            self,
            body=dataclasses.replace(self.body, stiffness=one(self.body.stiffness, 1)),
            ground=dataclasses.replace(
                self.ground,
                weight=one(self.ground.weight, 1),
                slope=float(slope[at, 0]) if isinstance(slope, np.ndarray) else slope,
            ),
            columns=columns,
            drive=Drive(
                one(drive.times, 1),
                float(period[at, 0]) if isinstance(period, np.ndarray) else period,
                one(drive.rows, 2),
                columns,
            ),
            start_displacement=one(self.start_displacement, 1),
        )

    @functools.cached_property
    def directions(self) -> np.ndarray:
        """The same directions as unit vectors, shape (m, 2)."""
        return frozen(unit_directions(self.angles))
