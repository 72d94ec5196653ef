"""The ground under a body: the weights of its contacts, the slope, and, on a line, patches of other ground."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from ..rounding import EPS
from .directions import unit_directions

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
        return self._limits(position.tobytes(), place.tobytes())

    @functools.lru_cache(maxsize=8)  # noqa: B019
    def _limits(self, positions: bytes, places: bytes) -> np.ndarray:
        position, place = np.frombuffer(positions), np.frombuffer(places, np.int64)
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
        whole = isinstance(contacts, slice) and contacts == slice(None)
        number = np.arange(n)[contacts]
        ahead, behind, mean = (self._whole if whole else self._sides)(place.tobytes(), number.tobytes())
        if whole:
            forward, backward, load = targets[..., :n], targets[..., n : 2 * n], targets[..., 2 * n :]
        else:
            forward, backward = targets[..., number], targets[..., n + number]
            load = targets[..., 2 * n + number] if targets.shape[-1] > 2 * n else targets[..., 2 * n :]
        if load.shape[-1] == 0:
            load = np.zeros(forward.shape)
        one = np.where(ahead[0], forward, ahead[1] * (forward + load) - (load + ahead[2]))
        other = np.where(behind[0], backward, behind[1] * (backward - load) + (load + behind[2]))
        return one, other, load + mean

    def _sides(
        self, places: bytes, numbers: bytes
    ) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...], np.ndarray]:
        """Find whether the ground ahead and behind is that of the track, its factors and tilts, and the mean tilt."""
        place, number = np.frombuffer(places, np.int64), np.frombuffer(numbers, np.int64)
        sides = []
        for side, stretch in enumerate(((place + 1) // 2, place // 2)):
            factor, tilt = self.factor[side, stretch, number], self.tilt[stretch, number]
            sides.append(((factor == 1.0) & (tilt == 0.0), factor, tilt))
        return sides[0], sides[1], 0.5 * (sides[0][2] + sides[1][2])

    @functools.lru_cache(maxsize=8)  # noqa: B019
    def _whole(
        self, places: bytes, numbers: bytes
    ) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...], np.ndarray]:
        return self._sides(places, numbers)


@dataclass(frozen=True, eq=False)
class Ground:
    """Weights and slope, from which the ground adds loads and, with coefficients, friction.

    Attributes:
        weight: of each contact, shape (N,) [N].
        by_coefficient: of each contact, whether its friction follows from its weight, and so changes with the slope,
            shape (N,); not while a drive commands friction.
        slope: theta, uphill towards +x positive [rad]; in the plane uphill towards `direction`.
        direction: in the plane, the angle of uphill from the x axis [rad]; None on a line.
        track: patches of other ground; None if the ground is the same everywhere.
    """

    weight: np.ndarray
    by_coefficient: np.ndarray
    slope: float
    direction: float | None = None
    track: Track | None = None

    @property
    def slope_load(self) -> np.ndarray:
        """Load of the slope on each contact: -w sin(theta), shape (N,), in the plane along uphill, shape (N, 2) [N]."""
        along = -self.weight * np.sin(self.slope)
        return along if self.direction is None else along[:, None] * unit_directions([self.direction])
