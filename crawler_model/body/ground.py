"""The ground under a body on a line: the weights of its contacts, the slope, and patches of other ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..rounding import EPS

_NEAR = 16.0 * EPS


@dataclass(frozen=True, eq=False)
class Track:
    """Ground that changes with place: M borders divide the track into M + 1 stretches.

    The *place* of a contact is 2 j on stretch j, and 2 j + 1 on the border between stretches j and j + 1. On a border
    the forward bound is that of the stretch ahead, the backward bound that of the stretch behind.

    Attributes:
        borders: positions on the track, increasing, shape (M,) [m].
        factor: by which each stretch multiplies the friction of each contact, forward and backward, shape
            (2, M + 1, N).
        tilt: load that each stretch adds to that of the track's slope, shape (M + 1, N) [N].
    """

    borders: np.ndarray
    factor: np.ndarray
    tilt: np.ndarray

    def find_places(self, position: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Find the places of contacts; within rounding of a border they are on it.

        Args:
            position: reference positions xi, shape (N,) [m].
            x: displacement, shape (N,) [m].

        Returns:
            Shape (N,), int64.
        """
        at = position + x
        nearest = np.abs(at[:, None] - self.borders).argmin(axis=1)
        border = self.borders[nearest]
        near = _NEAR * (np.abs(position) + np.abs(x) + np.abs(border))
        return np.where(np.abs(at - border) <= near, 2 * nearest + 1, 2 * np.searchsorted(self.borders, at))

    def find_limits(self, position: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Find how far each contact can slide before it reaches a border.

        Args:
            position: reference positions xi, shape (N,) [m].
            place: of each contact, shape (N,).

        Returns:
            Displacements at the next border forward and backward, and their rounding error, shape (3, N) [m].
        """
        ends = np.concatenate(([-np.inf], self.borders, [np.inf]))
        ahead, behind = ends[place // 2 + 1], ends[(place + 1) // 2]
        sizes = [np.where(np.isfinite(end), np.abs(end), 0.0) for end in (ahead, behind)]
        return np.stack((ahead - position, behind - position, 0.5 * _NEAR * (np.maximum(*sizes) + np.abs(position))))

    def bounds(
        self, targets: np.ndarray, place: np.ndarray, contacts: np.ndarray | slice = slice(None)
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compute the bounds of the spring forces at given places.

            forward = c_plus mu_plus - f,  backward = c_minus mu_minus + f,  f = load + tilt

        Args:
            targets: for ground without patches: forward and backward bounds and, with loads, loads, shape (..., 2 N)
                or (..., 3 N) [N].
            place: of each of these contacts, shape (K,).
            contacts: some of the contacts, by number; all by default.

        Returns:
            Forward bounds, backward bounds and loads (on a border the mean of both sides), shape (..., K) [N].
        """
        n = self.tilt.shape[1]
        number = np.arange(n)[contacts]
        ahead, behind = (place + 1) // 2, place // 2
        forward, backward = targets[..., number], targets[..., n + number]
        load = targets[..., 2 * n + number] if targets.shape[-1] > 2 * n else np.zeros(forward.shape)
        one = self._side(forward + load, forward, -load, self.factor[0, ahead, number], -self.tilt[ahead, number])
        other = self._side(backward - load, backward, load, self.factor[1, behind, number], self.tilt[behind, number])
        return one, other, load + 0.5 * (self.tilt[ahead, number] + self.tilt[behind, number])

    @staticmethod
    def _side(
        friction: np.ndarray, bound: np.ndarray, load: np.ndarray, factor: np.ndarray, tilt: np.ndarray
    ) -> np.ndarray:
        """Compute a bound; where the ground is that of the track, `bound` to the bit."""
        return np.where((factor == 1.0) & (tilt == 0.0), bound, factor * friction + (load + tilt))


@dataclass(frozen=True, eq=False)
class Ground:
    """Weights and slope, from which the ground adds loads and, with coefficients, friction.

    Attributes:
        weight: of each contact, shape (N,) [N].
        by_coefficient: whether friction follows from the weights, and so changes with the slope.
        slope: theta, uphill towards +x positive [rad].
        track: patches of other ground; None if the ground is the same everywhere.
    """

    weight: np.ndarray
    by_coefficient: bool
    slope: float
    track: Track | None = None

    @property
    def slope_load(self) -> np.ndarray:
        """Load of the slope on each contact, -w sin(theta), shape (N,) [N]."""
        return -self.weight * np.sin(self.slope)
