"""The orientation of a shape in the plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def shape_orientation(position: ArrayLike, displacement: ArrayLike) -> np.ndarray:
    """Compute the angle by which a shape in the plane is turned with respect to the reference shape.

    It is the angle of the rotation R in the polar decomposition of sum_i (p_i - mean p) (xi_i - mean xi)^T, where
    p = xi + x are the positions: the rotation that fits the positions to the reference shape with the least squares.
    Springs are vectors, so nothing turns the body as a whole: the angle follows only from commands and sliding.

    Args:
        position: reference positions xi, shape (N, 2) [m].
        displacement: x, shape (..., N, 2) [m].

    Returns:
        Angles in (-pi, pi], anticlockwise, shape (...) [rad]; 0 where no rotation fits better than another.
    """
    rest = np.asarray(position, dtype=np.float64)
    place = rest + np.asarray(displacement, dtype=np.float64)
    rest = rest - rest.mean(axis=0)
    place = place - place.mean(axis=-2, keepdims=True)
    along = (rest * place).sum(axis=(-2, -1))
    across = (rest[:, 0] * place[..., 1] - rest[:, 1] * place[..., 0]).sum(axis=-1)
    return np.asarray(np.arctan2(across, along))
