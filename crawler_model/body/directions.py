"""Directions of anisotropic friction in the plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SceneError
from ..rounding import EPS


def unit_directions(angles: ArrayLike) -> np.ndarray:
    """Compute the unit vectors of directions given by angles.

    Args:
        angles: shape (m,) [rad].

    Returns:
        Shape (m, 2); directions along an axis are exact.
    """
    angle = np.asarray(angles, dtype=np.float64)
    directions = np.column_stack((np.cos(angle), np.sin(angle)))
    directions[np.abs(directions) < 4e-16] = 0.0
    return directions


def check_directions(angles: ArrayLike, values: ArrayLike, unit: str = "N") -> None:
    """Check that direction-dependent friction is a convex dissipation function.

    Args:
        angles: angles of the directions, shape (m,) [rad], strictly increasing within one turn.
        values: mu in each direction, shape (m,) or one row per contact (n, m) [`unit`].
        unit: unit of the values, for error messages.

    Raises:
        SceneError: if a direction is out of order, too far from the next one, negative or not convex.
    """
    angle = np.asarray(angles, dtype=np.float64)
    mu = np.atleast_2d(np.asarray(values, dtype=np.float64))
    m = angle.size
    if m < 3:
        raise SceneError(f"friction.directions: {m} direction(s); at least 3 are needed to span the plane")
    gaps = np.diff(np.append(angle, angle[0] + 2.0 * np.pi))
    for k in np.flatnonzero(gaps <= 0.0):
        raise SceneError(
            f"friction.directions: direction {(k + 1) % m} at {angle[(k + 1) % m]:g} rad follows {angle[k]:g} rad; "
            "angles must increase strictly, within one turn" + (" (they are in rad)" if angle.max() > 7.0 else "")
        )
    for k in np.flatnonzero(gaps >= np.pi * (1.0 - 4.0 * EPS)):
        raise SceneError(
            f"friction.directions: {gaps[k]:g} rad from direction {k} to the next; it must be less than half a turn"
        )
    for i, k in np.argwhere(~(mu >= 0.0)):
        raise SceneError(f"friction.directions: contact {i} has {mu[i, k]:g} {unit} in direction {k}; it must be >= 0")
    before, after = np.roll(gaps, 1), gaps
    # d_k is a combination of its neighbours; R is convex if mu_k never exceeds the same combination of their mu
    most = np.roll(mu, 1, axis=1) * np.sin(after) + np.roll(mu, -1, axis=1) * np.sin(before)
    bend = most - mu * np.sin(before + after)
    for i, k in np.argwhere(bend < -16.0 * EPS * np.maximum(mu.max(axis=1, keepdims=True), 0.0)):
        raise SceneError(
            f"friction.directions: not convex: contact {i} has {mu[i, k]:g} {unit} in direction {k} at "
            f"{angle[k]:g} rad; "
            f"its neighbours allow at most {most[i, k] / np.sin(before[k] + after[k]):g} {unit}"
        )
