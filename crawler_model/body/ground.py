"""The ground under a body on a line: weights, the slope, and stretches of the track that differ from the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import frozen


@dataclass(frozen=True, eq=False)
class Ground:
    """What the ground adds to commanded friction and loads.

    Regions are the stretches between borders: region r lies between border r - 1 and border r.

    Attributes:
        weight: of each contact, shape (N,) [N].
        by_coefficient: whether friction follows from the weights, and so changes with the slope.
        slope: theta, of the track where no patch says otherwise, uphill towards +x positive [rad].
        border: where the ground changes, increasing, shape (B,) [m].
        forward: factor on mu_plus in each region, shape (B + 1,) [1].
        backward: factor on mu_minus in each region, shape (B + 1,) [1].
        pull: load of each region's slope per weight, less that of the track's, shape (B + 1,) [1].
    """

    weight: np.ndarray
    by_coefficient: bool
    slope: float
    border: np.ndarray
    forward: np.ndarray
    backward: np.ndarray
    pull: np.ndarray

    @property
    def slope_load(self) -> np.ndarray:
        """Load of the track's slope on each contact, -w sin(theta), shape (N,) [N]."""
        return -self.weight * np.sin(self.slope)

    @property
    def has_patches(self) -> bool:
        """Whether the ground changes along the track."""
        return self.border.size > 0


def build_flat_ground(contacts: int) -> Ground:
    """Build the ground of a scene that has nothing to say about it.

    Args:
        contacts: number of contacts N.

    Returns:
        The same ground everywhere, level, without weights.
    """
    one = frozen(np.ones(1))
    return Ground(frozen(np.zeros(contacts)), False, 0.0, frozen(np.zeros(0)), one, one, frozen(np.zeros(1)))
