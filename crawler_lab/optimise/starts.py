"""Gaits from which a search starts: random ones, waves along the body, and gaits that are their own images."""

from __future__ import annotations

import itertools

import numpy as np

from .space import Space

_ALL_PATTERNS = {1: 8, 2: 0}
"""Waypoints up to which waves of all on-off patterns are tried, by the dimension of the body."""
_PATTERNS, _IMAGES = {1: 64, 2: 2}, {1: 256, 2: 4}
"""How many waves of drawn patterns, and gaits that are their own images, are tried."""


class Starts:
    """Draws points of a space from which a search starts.

    Attributes:
        space: the unknowns and their bounds.
        random: the generator, which the search shares.
        table: the shape of the drive's unknowns; None if the drive has none.
        dimension: 1 for a body on a line, 2 in the plane.
    """

    def __init__(self, space: Space, random: np.random.Generator) -> None:
        """Store the space and the generator.

        Args:
            space: the unknowns and their bounds.
            random: the generator, which the search shares.
        """
        self.space, self.random = space, random
        self.table, self.dimension = space.scenes[0].table, space.scenes[0].base.dimension

    def random_points(self) -> list[np.ndarray]:
        """Draw points, half of them at corners of the box.

        Returns:
            The points, each of shape (P,) [1].
        """
        size, count = self.space.size, 32 + 4 * self.space.size
        corners = self.random.integers(0, 2, (count // 2, size)).astype(np.float64)
        points = [*corners, *self.random.random((count // 2, size)), *self.repeated_points(count // 2)]
        if np.isfinite(self.space.goal.tension):  # gaits of full stroke often exceed it
            shrunk = 0.5 ** self.random.integers(1, 5, len(points))
            points += [0.5 + part * (point - 0.5) for part, point in zip(shrunk, points, strict=True)]
        return points

    def repeated_points(self, count: int) -> list[np.ndarray]:
        """Draw corners that repeat within the period: a short gait several times is often the best long one.

        Args:
            count: about how many.

        Returns:
            The points, each of shape (P,) [1].
        """
        table, first = self.table, len(self.space.scenes[0].keys)
        if table is None:
            return []
        parts = [d for d in range(2, table.waypoints) if table.waypoints % d == 0]
        found = []
        for part in parts:
            for _ in range(count // len(parts)):
                rows = self.random.integers(0, 2, (part, table.width)).astype(np.float64)
                rows = np.tile(rows, (table.waypoints // part, 1))
                found.append(np.concatenate((self.random.random(first), rows.ravel())))
        return found

    def waves(self) -> list[np.ndarray]:
        """Build travelling waves along the body, smooth ones, and others that jump between the bounds.

        Returns:
            The points, each of shape (P,) [1].
        """
        table, first = self.table, len(self.space.scenes[0].keys)
        if table is None:
            return []
        found = []
        time_part = np.arange(table.waypoints)[:, None] / table.waypoints
        place = np.arange(table.width)[None] / max(table.links, 1)
        place[:, table.links :] = (np.arange(table.width - table.links) - 0.5) / max(table.links, 1)
        for number in (0.5, 1.0, 2.0, 3.0):
            for sign in (1.0, -1.0):
                lag = self.random.random()
                angle = time_part - sign * number * place
                angle[:, table.links :] += lag
                wave = np.sin(2.0 * np.pi * (angle + 1e-3))
                for rows in (0.5 + 0.5 * wave, (wave > 0.0).astype(np.float64)):
                    keys = self.random.random(first)
                    found.append(np.concatenate((keys, rows.ravel())))
        return found

    def on_off_waves(self) -> list[np.ndarray]:
        """Build waves of every pattern of waypoints between the bounds, each link later than the one before.

        Returns:
            The points, each of shape (P,) [1].
        """
        table = self.table
        if table is None:
            return []
        count = table.waypoints
        if count > _ALL_PATTERNS[self.dimension]:
            return []
        delays = np.arange(count)[:, None] * np.arange(table.width)
        return [self.with_delays(pattern, row) for pattern in _patterns(count) for row in delays]

    def delayed_points(self) -> list[np.ndarray]:
        """Draw on-off patterns whose links mostly are later than the one before by one number of waypoints.

        Returns:
            The points, each of shape (P,) [1].
        """
        table = self.table
        if table is None:
            return []
        found = []
        for _ in range(_PATTERNS[self.dimension]):
            steps = np.full(table.width, self.random.integers(0, table.waypoints))
            other = self.random.random(table.width) < 0.3
            steps[other] = self.random.integers(0, table.waypoints, int(other.sum()))
            found.append(self.with_delays(self.random.integers(0, 2, table.waypoints), np.cumsum(steps)))
        return found

    def with_delays(self, pattern: np.ndarray, delays: np.ndarray) -> np.ndarray:
        """Build a point whose columns are one pattern, each later by its own number of waypoints; numbers are drawn.

        Args:
            pattern: on or off at each waypoint, shape (K,).
            delays: of each column, in waypoints, shape (W,).

        Returns:
            The point, shape (P,) [1].
        """
        rows = pattern[(np.arange(pattern.size)[:, None] - delays) % pattern.size].astype(np.float64)
        return np.concatenate((self.random.random(len(self.space.scenes[0].keys)), rows.ravel()))

    def mirrored_points(self) -> list[np.ndarray]:
        """Draw corners that are their own images, see `mirrored`: many of the best gaits are.

        Returns:
            The points, each of shape (P,) [1].
        """
        count = 0 if self.table is None else _IMAGES[self.dimension]
        corners = self.random.integers(0, 2, (count, self.space.size)).astype(np.float64)
        return [self.mirrored(corner) for corner in corners]

    def mirrored(self, point: np.ndarray) -> np.ndarray:
        """Make a gait its own image backwards in time and from the other end of the body, about any instant.

        Args:
            point: shape (P,) [1].

        Returns:
            The point, shape (P,) [1].
        """
        numbers, rows = self.space.scenes[0].split(point)
        table = self.table
        if table is None or rows is None:
            return point
        place = np.arange(rows.size).reshape(rows.shape)
        image = np.hstack((place[:, : table.links][:, ::-1], place[:, table.links :][:, ::-1]))
        image = np.roll(image[::-1], int(self.random.integers(0, len(rows))), axis=0)
        kept = np.minimum(place, image) if self.random.random() < 0.5 else np.maximum(place, image)
        return np.concatenate((numbers, rows.ravel()[kept.ravel()]))


def _patterns(count: int) -> list[np.ndarray]:
    """List all on-off patterns of a period but constant ones, each once, whatever the waypoint at which it begins."""
    bits = [np.array(pattern) for pattern in itertools.product((0, 1), repeat=count)][1:-1]
    return [row for row in bits if all(tuple(row) <= tuple(np.roll(row, k)) for k in range(1, count))]
