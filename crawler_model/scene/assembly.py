"""The assembled arrays of a scene, ready for simulation."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import frozen
from ..body.body import Body
from ..body.columns import Columns
from ..body.directions import unit_directions
from ..body.drive import Drive
from ..body.ground import Ground
from .parts import SceneParts

AXES = {"stiffness": 1, "weight": 1, "slope_load": 1, "times": 1, "period": 0, "rows": 2, "start": 1}
"""The arrays that may vary, and the number of axes of each in a single scene."""


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
        """Whether paths have exact derivatives, see `inexact`."""
        return not self.inexact

    @property
    def can_be_differenced(self) -> bool:
        """Whether differences of runs stand for exact derivatives: on a line, and on regions in the plane."""
        return self.inexact != "" if self.dimension == 1 else self.ground.regions is not None

    @property
    def inexact(self) -> str:
        """Why paths have no exact derivatives, as a predicate; empty if they have."""
        if self.dimension == 2:
            return "is in the plane"
        if self.ground.track is not None:
            return f"has {self.ground.track.key}"
        return f"has {self.body.memory}" if self.body.memory else ""

    @property
    def angles(self) -> np.ndarray:
        """Angles of the friction directions in the plane, shape (m,) [rad]; m = 0 for isotropic friction."""
        return np.array(self.parts.angles, dtype=np.float64)

    @functools.cached_property
    def commanded(self) -> np.ndarray:
        """Which columns the drive commands, bool, shape (C,): all lengths, and friction and loads where it has them."""
        drive, columns = self.parts.drive, self.columns
        friction = drive is not None and drive.commands_friction
        loads = drive is not None and drive.loads is not None
        parts = (columns.lengths, True), (columns.frictions, friction), (columns.loads, loads)
        return frozen(np.concatenate([np.full(size, given) for size, given in parts]))

    def arrays(self) -> dict[str, Any]:
        """Collect the arrays that may vary.

        Returns:
            By the names in `AXES`, as far as the scene has them.
        """
        drive = self.drive
        arrays = {
            "stiffness": self.body.stiffness,
            "weight": self.ground.weight,
            "slope_load": self.columns.slope_load,
            "times": drive.times,
            "period": drive.period,
            "rows": drive.rows,
            "start": self.start_displacement,
        }
        return {name: array for name, array in arrays.items() if array is not None}

    def with_arrays(self, given: dict[str, Any]) -> Assembly:
        """Replace the arrays that may vary.

        Args:
            given: all of them, by the names of `arrays`.

        Returns:
            An assembly with read-only copies of these; the rest is the same.
        """
        arrays = {name: frozen(array) for name, array in given.items()}
        columns = self.columns
        if "slope_load" in arrays:
            columns = dataclasses.replace(columns, slope_load=arrays["slope_load"])
        period: Any = arrays.get("period")
        if period is not None and period.ndim < 2:  # of one variation
            period = float(period.item())
        return Assembly(
            self.parts,
            dataclasses.replace(self.body, stiffness=arrays["stiffness"]),
            dataclasses.replace(self.ground, weight=arrays["weight"]),
            columns,
            Drive(arrays["times"], period, arrays["rows"], columns),
            arrays["start"],
        )

    def variation(self, at: int) -> Assembly:
        """Select one of several variations that were assembled together.

        Args:
            at: its index.

        Returns:
            An assembly with its arrays; parts and slope are shared by all.
        """
        arrays = self.arrays().items()
        return self.with_arrays({name: array[at] if np.ndim(array) > AXES[name] else array for name, array in arrays})

    @functools.cached_property
    def directions(self) -> np.ndarray:
        """The same directions as unit vectors, shape (m, 2)."""
        return frozen(unit_directions(self.angles))
