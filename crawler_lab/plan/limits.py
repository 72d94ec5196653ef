"""What commands may do, and what they cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Limits:
    """What commands may do, and what they cost.

    Attributes:
        low: least rest length of each link, and angle of each joint, shape (J,) [m, rad].
        high: largest one; equal for those that do not move, shape (J,) [m, rad].
        change: largest change of each in a step, shape (J,) [m, rad].
        effort: error that costs as much as an equal change of one rest length in one step [1].
    """

    low: np.ndarray
    high: np.ndarray
    change: np.ndarray
    effort: float

    def keep(self, before: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Move a plan into the limits, step by step.

        Args:
            before: rest lengths and angles at the start, shape (J,) [m, rad].
            rows: those at the ends of H steps, shape (H, J) [m, rad].

        Returns:
            The plan, shape (H, J) [m, rad].
        """
        kept = np.empty(rows.shape)
        for k, row in enumerate(rows):
            low, high = np.maximum(self.low, before - self.change), np.minimum(self.high, before + self.change)
            before = kept[k] = np.maximum(np.minimum(row, high), np.minimum(low, high))
        return kept
