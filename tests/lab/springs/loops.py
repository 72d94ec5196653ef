"""Loops of springs whose elements are known, measured with noise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

STROKE = 0.1
WAYS = (0.0, 1.0, 0.0, 0.7, 0.2, 1.0, 0.0)
"""Reversals at several amplitudes, as parts of the stroke."""
STEP_S = 0.02


def walk(rows: int, ways=WAYS, stroke: float = STROKE) -> np.ndarray:
    """Elongations between reversals at one speed, as many rows for a whole stroke, shape (R,)."""
    parts = [np.linspace(a, b, round(rows * abs(b - a)) + 1)[1:] for a, b in pairwise(ways)]
    return stroke * np.concatenate(([ways[0]], *parts))


def stop(z: np.ndarray, stiffness: float, limit: float, start: float) -> np.ndarray:
    """The force of an element, row by row."""
    force = [start]
    for change in np.diff(z).tolist():
        force.append(min(max(force[-1] + stiffness * change, -limit), limit))
    return np.array(force)


def noise(rng: np.random.Generator, rows: int, white: float, slow: float = 0.0, memory: float = 0.3) -> np.ndarray:
    """White noise, and an Ornstein-Uhlenbeck process."""
    decay = np.exp(-STEP_S / memory)
    values = [slow * rng.normal()]
    for shock in rng.normal(size=rows - 1).tolist():
        values.append(decay * values[-1] + slow * np.sqrt(1.0 - decay**2) * shock)
    return white * rng.normal(size=rows) + np.array(values)
