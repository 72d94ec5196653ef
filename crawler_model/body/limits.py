"""Lengths beyond which actuators are at a limit of their tension, where their commands have no effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..rounding import EPS
from .curves import Bend


@dataclass(frozen=True, eq=False)
class Limits:
    """The limits of B actuators.

    Attributes:
        index: their springs or joints, shape (B,).
        low: z - L below which the tension is the least one; -inf without a least one, shape (B,) [m].
        high: z - L above which it is the largest one; inf without a largest one, shape (B,) [m].
        below: state there: -1 slack, at a tension of 0; 1 stalled, at another one; int8, shape (B,).
        above: the state above `high`, int8, shape (B,).
    """

    index: np.ndarray
    low: np.ndarray
    high: np.ndarray
    below: np.ndarray
    above: np.ndarray

    def find_states(self, elongation: np.ndarray, actuation: np.ndarray) -> np.ndarray:
        """Determine which actuators are beyond a limit.

        Args:
            elongation: z of all springs or joints, shape (..., S) [m].
            actuation: L, of the same shape [m].

        Returns:
            -1 slack, 1 stalled, 0 neither; int8, shape (..., B).
        """
        z, length = elongation[..., self.index], actuation[..., self.index]
        u, near = z - length, 64.0 * EPS * (np.abs(z) + np.abs(length))
        return np.where(u < self.low - near, self.below, np.where(u > self.high + near, self.above, np.int8(0)))

    def find_all_states(self, elongation: np.ndarray, actuation: np.ndarray) -> np.ndarray:
        """Determine the states of all springs or joints, 0 for ones without limits.

        Args:
            elongation: z, shape (..., S) [m].
            actuation: L, of the same shape [m].

        Returns:
            As of `find_states`, shape (..., S); shape (..., 0) if none has a limit.
        """
        if not self.index.size:
            return np.zeros((*elongation.shape[:-1], 0), np.int8)
        states = np.zeros(elongation.shape, np.int8)
        states[..., self.index] = self.find_states(elongation, actuation)
        return states

    def can_be(self, state: int) -> np.ndarray:
        """Determine which actuators can come to be slack or stalled.

        Args:
            state: -1 slack, 1 stalled.

        Returns:
            Bool, shape (B,).
        """
        low, high = np.isfinite(self.low), np.isfinite(self.high)
        return np.asarray((low & (self.below == state)) | (high & (self.above == state)))


def build_limits(bends: Sequence[tuple[int, Sequence[Bend]]]) -> Limits:
    """Build the limits of springs, or of joints whose springs share their elongation and their command.

    Args:
        bends: each spring or joint and its bent springs, all with the same limits of tension.

    Returns:
        The limits of all that have any.
    """
    limited = []
    for index, springs in bends:
        least, most = springs[0].limits
        curves = [bend.actuator for bend in springs]
        if np.isfinite((least, most)).any() and all(curve.slopes.max() > 0.0 for curve in curves):
            low = sum(float(curve.at[0]) for curve in curves) if np.isfinite(least) else -np.inf
            high = sum(float(curve.at[-1]) for curve in curves) if np.isfinite(most) else np.inf
            limited.append((index, low, high, -1 if least == 0.0 else 1, -1 if most == 0.0 else 1))
    table = np.array(limited, dtype=np.float64).reshape(-1, 5)
    below, above = table[:, 3:].T.astype(np.int8)
    return Limits(table[:, 0].astype(np.int64), table[:, 1], table[:, 2], below, above)
