"""The ground under a body: the weights of its contacts, the slope, and, on a line, patches of other ground."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from ..rounding import EPS
from .directions import unit_directions
from .places import put_all_on_ground, put_on_ground

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

    def find_ground(self, position: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Collect what the ground at given places does to a body.

        Args:
            position: reference positions xi, shape (N,) [m].
            place: of each contact, shape (N,).

        Returns:
            Rows AHEAD_FACTOR .. ROUNDING_OF_PLACE, shape (8, N).
        """
        return self._ground(position.tobytes(), place.tobytes())

    @functools.lru_cache(maxsize=8)  # noqa: B019
    def _ground(self, positions: bytes, places: bytes) -> np.ndarray:
        position, place = np.frombuffer(positions), np.frombuffer(places, np.int64)
        ends = np.concatenate(([-np.inf], self.borders, [np.inf]))
        ahead, behind = ends[place // 2 + 1], ends[(place + 1) // 2]
        sizes = [np.where(np.isfinite(end), np.abs(end), 0.0) for end in (ahead, behind)]
        rounding = 0.5 * _NEAR * (np.maximum(*sizes) + np.abs(position))
        return np.vstack((self._sides(places), ahead - position, behind - position, rounding))

    @functools.lru_cache(maxsize=8)  # noqa: B019
    def _sides(self, places: bytes) -> np.ndarray:
        """Find the factors and additional loads of the ground ahead and behind, rows AHEAD_FACTOR .. MEAN_TILT."""
        place = np.frombuffer(places, np.int64)
        return self._sides_of(np.arange(place.size), place)

    def _sides_of(self, contacts: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Find the rows AHEAD_FACTOR .. MEAN_TILT of some contacts at their places."""
        ahead, behind = (places + 1) // 2, places // 2
        tilts = self.tilt[ahead, contacts], self.tilt[behind, contacts]
        factors = self.factor[0, ahead, contacts], self.factor[1, behind, contacts]
        return np.stack((factors[0], tilts[0], factors[1], tilts[1], 0.5 * (tilts[0] + tilts[1])))

    def bounds(self, targets: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compute the bounds of the spring forces at given places, see `places.put_on_ground`.

        Args:
            targets: for ground without patches: forward and backward bounds and, with loads, loads, shape (..., 2 N)
                or (..., 3 N) [N].
            place: of each contact, shape (N,).

        Returns:
            Forward bounds, backward bounds and loads (on a border the mean of both sides), shape (..., N) [N].
        """
        rows = np.array(targets, dtype=np.float64).reshape(-1, targets.shape[-1])
        out = np.empty((rows.shape[0], 3 * place.size))
        put_all_on_ground(rows, self._sides(place.tobytes()), out)
        forward, backward, load = np.moveaxis(out.reshape(*targets.shape[:-1], 3, place.size), -2, 0)
        return forward, backward, load

    def bounds_at(self, contact: int, target: np.ndarray, place: int) -> tuple[float, float, float]:
        """Compute the bounds of the spring force of one contact at a place, see `places.put_on_ground`.

        Args:
            contact: its number.
            target: for ground without patches: forward and backward bounds and, with loads, loads of all contacts,
                shape (2 N,) or (3 N,) [N].
            place: its place.

        Returns:
            Forward bound, backward bound and load [N].
        """
        side = self._sides_of(np.array([contact]), np.array([place]))
        out = np.empty(3)
        put_on_ground(target[contact :: self.tilt.shape[1]].copy(), 0, side, out)
        return float(out[0]), float(out[1]), float(out[2])

    def bounds_along(self, targets: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Compute the bounds of the spring forces along a path.

        Args:
            targets: for ground without patches, as for `bounds`, shape (R, 2 N) or (R, 3 N) [N].
            places: of each contact, shape (R, N).

        Returns:
            Forward bounds, backward bounds and loads, shape (3, R, N) [N].
        """
        local = np.empty((3, *places.shape))
        different, which = np.unique(places, axis=0, return_inverse=True)
        for k, place in enumerate(different):  # far fewer than rows: a contact seldom passes a border
            rows = np.flatnonzero(which.ravel() == k)
            local[:, rows] = self.bounds(targets[rows], np.ascontiguousarray(place))
        return local


@dataclass(frozen=True, eq=False)
class Ground:
    """Weights and slope, from which the ground adds loads and, with coefficients, friction.

    Attributes:
        weight: of each contact, shape (N,) [N]; (M, N) for variations.
        by_coefficient: of each contact, whether its friction follows from its weight, and so changes with the slope,
            shape (N,); False while a drive commands friction.
        slope: theta, uphill towards +x positive [rad]; in the plane uphill towards `direction`; shape (M, 1) for
            variations.
        direction: in the plane, the angle of uphill from the x axis [rad]; None on a line.
        track: patches of other ground; None if the ground is the same everywhere.
    """

    weight: np.ndarray
    by_coefficient: np.ndarray
    slope: float
    direction: float | None = None
    track: Track | None = None

    @property
    def has_one_slope(self) -> bool:
        """Whether the slope is the same everywhere."""
        return self.track is None or not self.track.tilt.any()

    @property
    def slope_load(self) -> np.ndarray:
        """Load of the slope on each contact: -w sin(theta), shape (N,), in the plane along uphill, shape (N, 2) [N].

        For variations shape (M, N).
        """
        along = -self.weight * np.sin(self.slope)
        return along if self.direction is None else along[:, None] * unit_directions([self.direction])
