"""The frames of friction of a body that turns, as strokes under its points."""

from __future__ import annotations

import numpy as np

from crawler_model.body.body import Body
from crawler_model.body.turning import forward_angles

WORDS = "strokes: friction, the long ones forward"
"""What the strokes are, for titles."""


def friction_strokes(body: Body, place: np.ndarray, reach: float) -> np.ndarray:
    """Compute two strokes for each point with friction: one forward, and a shorter one across.

    Args:
        body: the body.
        place: positions of all points, shape (N, 2) [m].
        reach: length of the strokes forward [m].

    Returns:
        Both ends of each stroke, shape (K, 2, 2) [m]; K = 0 for bodies that do not turn.
    """
    if body.turning is None:
        return np.zeros((0, 2, 2))
    chosen = body.share > 0.0
    angle, start = forward_angles(body.turning, place)[chosen], place[chosen]
    forward = reach * np.column_stack((np.cos(angle), np.sin(angle)))
    left = 0.5 * np.column_stack((-forward[:, 1], forward[:, 0]))
    ahead, across = np.stack((start, start + forward), axis=1), np.stack((start - left, start + left), axis=1)
    return np.concatenate((ahead, across))
