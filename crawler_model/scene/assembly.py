"""What the parts of a scene are assembled to: the arrays that are simulated."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from ..arrays import frozen
from ..body.body import Body
from ..body.columns import Columns
from ..body.directions import unit_directions
from ..body.drive import Drive
from ..body.ground import Ground
from .parts import SceneParts


@dataclass(frozen=True, eq=False)
class Assembly:
    """The parts of a scene and the arrays built from them; a `Plan`.

    Attributes:
        parts: what the scene file holds.
        body: contacts and springs, segments cut into elements.
        ground: weights, slope and patches.
        columns: the layout of commands.
        drive: the drive, or for a scene without one L = 0 and the scene's friction for ever.
        start_displacement: x at the start, shape (N,), in the plane (N, 2) [m].
    """

    parts: SceneParts
    body: Body
    ground: Ground
    columns: Columns
    drive: Drive
    start_displacement: np.ndarray

    @property
    def name(self) -> str:
        """What tables and recordings call it."""
        return self.parts.name

    @property
    def dimension(self) -> int:
        """1 on a line, 2 in the plane."""
        return self.parts.dimension

    @property
    def tolerance(self) -> float | None:
        """In the plane, the largest error of a ramp relative to the largest change commanded [1]; None: the default."""
        return self.parts.tolerance

    @property
    def angles(self) -> np.ndarray:
        """In the plane, the directions in which friction is given, shape (m,) [rad]; m = 0 where it is isotropic."""
        friction = self.parts.friction
        return np.array((friction.directions if friction is not None else None) or (), dtype=np.float64)

    @functools.cached_property
    def directions(self) -> np.ndarray:
        """The same as unit vectors, shape (m, 2)."""
        return frozen(unit_directions(self.angles))
