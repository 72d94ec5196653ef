"""The ground under a body: the weights of its contacts, the slope, and, on a line, patches of other ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .directions import unit_directions
from .places import NEAR, Stretches, find_bounds, put_all_on_ground, survey, survey_all


@dataclass(frozen=True, eq=False)
class Track:
    """Ground that changes with place: M borders divide the track into M + 1 stretches.

    The *place* of a contact is 2 j on stretch j, and 2 j + 1 on the border between stretches j and j + 1. On a border
    the forward bound is that of the stretch ahead, the backward bound that of the stretch behind.

    Attributes:
        stretches: what each stretch does to friction and loads.
    """

    stretches: Stretches

    @property
    def borders(self) -> np.ndarray:
        """Positions on the track, increasing, shape (M,) [m]."""
        return self.stretches.borders

    @property
    def factor(self) -> np.ndarray:
        """Factor of each stretch on the friction of each contact, forward and backward, shape (2, M + 1, N)."""
        stretches = self.stretches
        pressed = np.where(stretches.follows, stretches.pressed[:, None], 1.0)
        return np.asarray(stretches.grip[:, :, None] * pressed)

    @property
    def tilt(self) -> np.ndarray:
        """Load that each stretch adds to that of the track's slope, shape (M + 1, N) [N]."""
        return np.asarray(-self.stretches.weight * self.stretches.rise[:, None])

    def find_places(self, position: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Find the places of contacts; within rounding of a border they are on it.

        Args:
            position: reference positions xi, shape (N,) [m].
            x: displacement, shape (N,) [m].

        Returns:
            Shape (N,), int64.
        """
        at = position + x
        stretch = np.searchsorted(self.borders, at)
        behind, ahead = np.maximum(stretch - 1, 0), np.minimum(stretch, self.borders.size - 1)
        nearest = np.where(np.abs(at - self.borders[behind]) <= np.abs(at - self.borders[ahead]), behind, ahead)
        border = self.borders[nearest]
        near = NEAR * (np.abs(position) + np.abs(x) + np.abs(border))
        return np.where(np.abs(at - border) <= near, 2 * nearest + 1, 2 * stretch)

    def find_ground(self, position: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Collect what the ground at given places does to a body.

        Args:
            position: reference positions xi, shape (N,) [m].
            place: of each contact, shape (N,).

        Returns:
            Rows AHEAD_FACTOR .. ROUNDING_OF_PLACE, shape (8, N).
        """
        ground = np.empty((8, place.size))
        survey_all(self.stretches, position, place, ground)
        return ground

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
        put_all_on_ground(rows, self.find_ground(np.zeros(place.size), place), out)
        forward, backward, load = np.moveaxis(out.reshape(*targets.shape[:-1], 3, place.size), -2, 0)
        return forward, backward, load

    def bounds_at(self, contact: int, target: np.ndarray, place: int) -> tuple[float, float, float]:
        """Compute the bounds of the spring force of one contact at a place, see `places.find_bounds`.

        Args:
            contact: its number.
            target: for ground without patches: forward and backward bounds and, with loads, loads of all contacts,
                shape (2 N,) or (3 N,) [N].
            place: its place.

        Returns:
            Forward bound, backward bound and load [N].
        """
        ground = np.empty((8, 1))
        survey(self.stretches, 0.0, place, contact, ground, 0)
        forward, backward, load = find_bounds(target, 0, self.stretches.weight.size, contact, ground, 0)
        return forward, backward, load

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
        return self.track is None or not (self.track.stretches.weight.any() and self.track.stretches.rise.any())

    @property
    def slope_load(self) -> np.ndarray:
        """Load of the slope on each contact: -w sin(theta), shape (N,), in the plane along uphill, shape (N, 2) [N].

        For variations shape (M, N).
        """
        along = -self.weight * np.sin(self.slope)
        return along if self.direction is None else along[:, None] * unit_directions([self.direction])
