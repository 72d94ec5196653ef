"""The ground under a body: the weights of its contacts and the slope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .directions import unit_directions


@dataclass(frozen=True, eq=False)
class Ground:
    """Weights and slope, from which the ground adds loads and, with coefficients, friction.

    Attributes:
        weight: of each contact, shape (N,) [N].
        by_coefficient: of each contact, whether its friction follows from its weight, and so changes with the slope,
            shape (N,); not while a drive commands friction.
        slope: theta, uphill towards +x positive [rad]; in the plane uphill towards `direction`.
        direction: in the plane, the angle of uphill from the x axis [rad]; None on a line.
    """

    weight: np.ndarray
    by_coefficient: np.ndarray
    slope: float
    direction: float | None = None

    @property
    def slope_load(self) -> np.ndarray:
        """Load of the slope on each contact: -w sin(theta), shape (N,), in the plane along uphill, shape (N, 2) [N]."""
        along = -self.weight * np.sin(self.slope)
        return along if self.direction is None else along[:, None] * unit_directions([self.direction])
