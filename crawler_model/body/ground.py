"""The ground under a body on a line: the weights of its contacts and the slope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Ground:
    """Weights and slope, from which the ground adds loads and, with coefficients, friction.

    Attributes:
        weight: of each contact, shape (N,) [N].
        by_coefficient: of each contact, whether its friction follows from its weight, and so changes with the slope,
            shape (N,); not while a drive commands friction.
        slope: theta, uphill towards +x positive [rad].
    """

    weight: np.ndarray
    by_coefficient: np.ndarray
    slope: float

    @property
    def slope_load(self) -> np.ndarray:
        """Load of the slope on each contact, -w sin(theta), shape (N,) [N]."""
        return -self.weight * np.sin(self.slope)
