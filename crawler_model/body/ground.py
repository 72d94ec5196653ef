"""The ground under a body: weights and masses of its contacts, the slope, patches, profiles, walls and regions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..rounding import EPS
from .couplings import Coupling, add_friction
from .directions import unit_directions
from .regions import Regions

GRAVITY = 9.81
"""Weight of a mass [N/kg]."""
_NEAR = 16.0 * EPS
"""A contact within this part of the positions that its place follows from stands on a border."""


@dataclass(frozen=True, eq=False)
class Walls:
    """The walls that stop each contact; the first row of each array is of walls ahead, the second of walls behind.

    Attributes:
        place: the nearest wall, infinite where there is none, shape (2, N) [m].
        index: its number in the scene, -1 where there is none, shape (2, N).
    """

    place: np.ndarray
    index: np.ndarray

    def find_rooms(self, position: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Compute how far contacts are from their walls; within rounding of a wall they are at it.

        Args:
            position: reference positions xi, shape (N,) [m].
            x: displacement, shape (..., N) [m].

        Returns:
            Distances ahead and behind, < 0 beyond a wall, shape (2, ..., N) [m].
        """
        at = position + x
        rooms = []
        for wall, sign in zip(self.place, (1.0, -1.0), strict=True):
            room = sign * (wall - at)
            near = _NEAR * (np.abs(position) + np.abs(x) + np.where(np.isfinite(wall), np.abs(wall), 0.0))
            rooms.append(np.where(np.abs(room) <= near, 0.0, room))
        return np.array(rooms)


@dataclass(frozen=True, eq=False)
class Track:
    """Ground that changes with place: M borders divide the track into M + 1 stretches, and walls end it.

    On a stretch factors and the sine of the slope are constant or, with a profile, linear.

    The *place* of a contact is 2 j on stretch j, and 2 j + 1 on the border between stretches j and j + 1. On a border
    the stretch ahead determines the forward bound, the stretch behind the backward bound.

    Attributes:
        borders: positions on the track, increasing, shape (M,) [m].
        grip: factor of each stretch on friction, forward and backward, shape (2, M + 1); with a profile where the
            stretch begins, as the rise.
        pressed: further factor of each stretch on friction that follows from the weight, shape (M + 1,).
        rise: sine of the slope of each stretch less the track's, shape (M + 1,).
        follows: whether the friction of each contact follows from its weight, shape (N,).
        weight: of each contact, shape (N,) [N].
        walls: the walls; None without any.
        profile: of each stretch the place where it begins [m], and by how much the factors forward and backward and the
            sine of the slope grow along it [1/m], shape (4, M + 1); None if all are constant on all stretches and no
            friction changes with elongations.
        couplings: friction that changes with elongations, sorted by contact and spring.
    """

    borders: np.ndarray
    grip: np.ndarray
    pressed: np.ndarray
    rise: np.ndarray
    follows: np.ndarray
    weight: np.ndarray
    walls: Walls | None = None
    profile: np.ndarray | None = None
    couplings: tuple[Coupling, ...] = ()

    @property
    def key(self) -> str:
        """The key of the scene file that makes friction, or the ground, differ from place to place."""
        if self.couplings:
            return "friction.with_elongation"
        if self.profile is not None:
            return "ground.profile"
        return "ground.patches" if self.borders.size else "ground.walls"

    @property
    def differs(self) -> str:
        """The key that makes the ground differ from place to place; empty where friction only changes with lengths."""
        if self.profile is not None and self.profile[1:].any():
            return "ground.profile"
        return "ground.patches" if self.borders.size else "ground.walls" if self.walls is not None else ""

    @property
    def leaps(self) -> str:
        """The key that makes bounds change at once from place to place; empty if there is none."""
        if self.profile is None:
            return "ground.patches" if self.borders.size else "ground.walls"
        rows = np.vstack((self.grip, self.rise))
        before, behind = rows[:, :-1] + self.profile[1:, :-1] * (self.borders - self.profile[0, :-1]), rows[:, 1:]
        behind = behind + self.profile[1:, 1:] * (self.borders - self.profile[0, 1:])
        same = np.allclose(before, behind, rtol=1e-12, atol=1e-15) and np.ptp(self.pressed) == 0.0
        return "ground.patches" if not same else "ground.walls" if self.walls is not None else ""

    @property
    def factor(self) -> np.ndarray:
        """Factor of each stretch on the friction of each contact, forward and backward, shape (2, M + 1, N).

        With a profile it is that where the stretch begins.
        """
        pressed = np.where(self.follows, self.pressed[:, None], 1.0)
        return np.asarray(self.grip[:, :, None] * pressed)

    @property
    def largest_factor(self) -> np.ndarray:
        """The largest factor of all stretches, shape (2, N)."""
        factor = self.factor
        if self.profile is not None and self.borders.size:
            length = np.append(self.borders[0] - self.profile[0, 0], np.diff(self.borders))
            ends = self.grip[:, :-1] + self.profile[1:3, :-1] * length
            factor = np.concatenate((factor, np.repeat(ends[:, :, None], self.weight.size, axis=2)), axis=1)
        return np.asarray(factor.max(axis=1))

    @property
    def largest_added(self) -> np.ndarray:
        """The largest friction that elongations add to each contact, shape (2, N) [N]."""
        added = np.zeros((2, self.weight.size))
        for coupling in self.couplings:
            added[:, coupling.contact] += coupling.added.max(axis=1)
        return added

    @property
    def tilt(self) -> np.ndarray:
        """Load that each stretch adds to the load of the track's slope, shape (M + 1, N) [N]."""
        return np.asarray(-self.weight * self.rise[:, None])

    def find_places(self, position: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Find the places of contacts; within rounding of a border they are on it.

        Args:
            position: reference positions xi, shape (N,) [m].
            x: displacement, shape (N,) [m].

        Returns:
            Shape (N,), int64.
        """
        at = position + x
        if not self.borders.size:
            return np.zeros(at.shape, np.int64)
        stretch = np.searchsorted(self.borders, at)
        behind, ahead = np.maximum(stretch - 1, 0), np.minimum(stretch, self.borders.size - 1)
        nearest = np.where(np.abs(at - self.borders[behind]) <= np.abs(at - self.borders[ahead]), behind, ahead)
        border = self.borders[nearest]
        near = _NEAR * (np.abs(position) + np.abs(x) + np.abs(border))
        return np.where(np.abs(at - border) <= near, 2 * nearest + 1, 2 * stretch)

    def local_bounds(
        self, targets: np.ndarray, position: np.ndarray, x: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compute the bounds of the spring forces where contacts are, as `bounds` does at given places.

        They contain the friction that elongations add.

        Args:
            targets: as for `bounds`.
            position: reference positions xi, shape (N,) [m].
            x: displacement, shape (..., N) [m].

        Returns:
            As `bounds`.
        """
        every = np.broadcast_to(position, x.shape)
        place = self.find_places(every.ravel(), x.ravel()).reshape(x.shape)
        forward, backward, load = self.bounds(targets, place, position + x)
        if self.couplings:
            more_forward, more_backward = add_friction(self.couplings, x)
            forward, backward = forward + more_forward, backward + more_backward
        return forward, backward, load

    def bounds(
        self, targets: np.ndarray, place: np.ndarray, at: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compute the bounds of the spring forces at given places.

            forward = c_plus mu_plus - f,  backward = c_minus mu_minus + f,  f = load + tilt

        Args:
            targets: for ground without patches: forward and backward bounds and, with loads, loads, shape (..., 2 N)
                or (..., 3 N) [N].
            place: of each contact, shape (..., N).
            at: its position on the track, shape (..., N); without a profile only the place counts [m].

        Returns:
            Forward bounds, backward bounds and loads (on a border the mean of both sides), shape (..., N) [N].
        """
        n = place.shape[-1]
        forward, backward = targets[..., :n], targets[..., n : 2 * n]
        load = targets[..., 2 * n :] if targets.shape[-1] > 2 * n else np.zeros(n)
        ahead, behind, contact = (place + 1) // 2, place // 2, np.arange(n)
        (forward_factor, backward_factor), tilt = self.factor, self.tilt
        ahead_factor, ahead_tilt = forward_factor[ahead, contact], tilt[ahead, contact]
        behind_factor, behind_tilt = backward_factor[behind, contact], tilt[behind, contact]
        if self.profile is not None:
            begin, grows_forward, grows_backward, rises = self.profile
            ahead_factor = ahead_factor + grows_forward[ahead] * (at - begin[ahead])
            behind_factor = behind_factor + grows_backward[behind] * (at - begin[behind])
            ahead_tilt = ahead_tilt - self.weight * rises[ahead] * (at - begin[ahead])
            behind_tilt = behind_tilt - self.weight * rises[behind] * (at - begin[behind])
        return (
            _bound_on(ahead_factor, ahead_tilt, forward, load),
            _bound_on(behind_factor, -behind_tilt, backward, -load),
            load + 0.5 * (ahead_tilt + behind_tilt),
        )


def _bound_on(factor: np.ndarray, tilt: np.ndarray, bound: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Compute the bound that friction, shifted by a load, has on ground with a factor and an additional load."""
    return np.where((factor == 1.0) & (tilt == 0.0), bound, factor * (bound + load) - (load + tilt))


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
        track: patches of other ground, a profile and walls; None if the ground is the same everywhere.
        mass: of each contact, shape (N,) [kg]; None if they are not given.
        regions: in the plane, regions of other ground; None if the ground is the same everywhere.
    """

    weight: np.ndarray
    by_coefficient: np.ndarray
    slope: float
    direction: float | None = None
    track: Track | None = None
    mass: np.ndarray | None = None
    regions: Regions | None = None

    @property
    def differs(self) -> str:
        """The key of the scene file that makes the ground differ from place to place; empty if it is the same."""
        if self.regions is not None:
            return "ground.regions"
        return "" if self.track is None else self.track.differs

    @property
    def even_part(self) -> str:
        """Where stasis domains hold, which follow from the scene's own friction and slope; empty if everywhere."""
        if self.regions is not None:
            return "outside the regions"
        track, parts = self.track, list[str]()
        if track is not None and track.profile is not None:
            parts.append("where a factor of 1 and the slope of the track hold")
        elif track is not None and track.borders.size:
            parts.append("outside the patches")
        if track is not None and track.walls is not None:
            parts.append("away from walls")
        if track is not None and track.couplings:
            parts.append("without the friction that elongations add")
        return ", ".join(parts)

    def scale_friction(self, friction: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Multiply friction by the factors of the regions of the plane that points stand on.

        Args:
            friction: of each point, one or more numbers, shape (..., N, m) [N].
            at: positions of the points, shape (..., N, 2) [m].

        Returns:
            The friction on the ground under each point, shaped alike; without regions the same.
        """
        if self.regions is None:
            return friction
        found, _ = self.regions.find(at.reshape(-1, 2))
        return friction * self.regions.factors[found].reshape(*at.shape[:-1], 1)

    @property
    def lets_go(self) -> bool:
        """Whether contacts may come to less friction, or have less as links change their length, and jump."""
        return self.regions is not None or self.track is not None

    @property
    def masses(self) -> np.ndarray | None:
        """Mass of each contact, as given or from its weight, shape (N,) [kg]; None without either."""
        if self.mass is not None:
            return self.mass
        return self.weight / GRAVITY if self.weight.any() else None

    @property
    def has_one_slope(self) -> bool:
        """Whether the slope is the same everywhere."""
        if self.track is None or not self.track.weight.any():
            return True
        return not self.track.rise.any() and (self.track.profile is None or not self.track.profile[3].any())

    @property
    def slope_load(self) -> np.ndarray:
        """Load of the slope on each contact: -w sin(theta), shape (N,), in the plane along uphill, shape (N, 2) [N].

        For variations shape (M, N).
        """
        along = -self.weight * np.sin(self.slope)
        return along if self.direction is None else along[:, None] * unit_directions([self.direction])
