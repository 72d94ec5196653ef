"""The layout of command rows: the columns, their names, and how they map to springs and contacts.

A command row holds, in this order, the rest length of each link (m), the strain of each segment, the friction against
sliding forward of each isolated contact (N) and of each segment (N/m), and the same for sliding backward. A segment
whose strain or friction varies along it has one column per element or contact instead of a single one. In the plane
each link has two columns (x, y), and each contact has one friction, or one per direction.

A target is the input of the kernels: one rest length per spring, then mu_plus and mu_minus of every contact.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .body import Body


@dataclass(frozen=True, eq=False)
class Columns:
    """The layout of a command row and its conversion to a target.

    Attributes:
        links: number of links.
        contacts: number of isolated contacts.
        segments: for each segment its name, number of strain columns and number of friction columns per side.
        planar: in the plane, the number of friction directions, 0 for isotropic friction; None on a line.
        index: for each entry of the target, the column from which it is read, shape (S + 2 N,).
        factor: factor by which that column is multiplied, shape (S + 2 N,).
    """

    links: int
    contacts: int
    segments: tuple[tuple[str, int, int], ...]
    planar: int | None
    index: np.ndarray
    factor: np.ndarray

    @functools.cached_property
    def actuation_sizes(self) -> np.ndarray:
        """Number of columns of each link, then of each segment's strain, shape (links + segments,)."""
        each = 1 if self.planar is None else 2
        return np.array([each] * self.links + [strain for _, strain, _ in self.segments], dtype=np.int64)

    @functools.cached_property
    def friction_sizes(self) -> np.ndarray:
        """Number of columns per side of each isolated contact, then of each segment, shape (contacts + segments,)."""
        each = max(self.planar or 0, 1)
        return np.array([each] * self.contacts + [friction for _, _, friction in self.segments], dtype=np.int64)

    @functools.cached_property
    def lengths(self) -> int:
        """Number of columns with rest lengths and strains; the other columns hold friction."""
        return int(self.actuation_sizes.sum())

    @functools.cached_property
    def count(self) -> int:
        """Number of columns C."""
        return self.lengths + self.sides * int(self.friction_sizes.sum())

    @property
    def sides(self) -> int:
        """2 on a line, forward and backward; 1 in the plane."""
        return 2 if self.planar is None else 1

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, shape (C,)."""
        if self.planar is not None:
            links = [f"link_{i}/{axis}" for i in range(self.links) for axis in "xy"]
            suffixes = [f"direction_{k}" for k in range(self.planar)] or ["friction"]
            return (*links, *(f"contact_{i}/{suffix}" for i in range(self.contacts) for suffix in suffixes))
        names = [f"link_{i}" for i in range(self.links)]
        for name, strain, _ in self.segments:
            names += [name] if strain == 1 else [f"{name}/element_{j}" for j in range(strain)]
        for side in ("forward", "backward"):
            names += [f"contact_{i}/{side}" for i in range(self.contacts)]
            for name, _, friction in self.segments:
                each = [f"{name}/contact_{j}/{side}" for j in range(friction)]
                names += [f"{name}/{side}"] if friction == 1 else each
        return tuple(names)

    @functools.cached_property
    def aliases(self) -> dict[str, np.ndarray]:
        """Columns set by each name: names of single columns, of whole segments, and of both sides together."""
        # direction-dependent friction cannot be commanded, as it has to stay convex
        aliases = {name: np.array([i]) for i, name in enumerate(self.names) if "/direction_" not in name}
        if self.planar is not None:
            return aliases
        first = self.links
        for name, strain, _ in self.segments:
            aliases[name] = np.arange(first, first + strain)
            first += strain
        parts = [f"contact_{i}" for i in range(self.contacts)] + [name for name, _, _ in self.segments]
        half = int(self.friction_sizes.sum())
        starts = self.lengths + np.concatenate(([0], np.cumsum(self.friction_sizes)[:-1]))
        for name, start, size in zip(parts, starts, self.friction_sizes, strict=True):
            forward = np.arange(start, start + size)
            aliases[f"{name}/forward"], aliases[f"{name}/backward"] = forward, forward + half
            aliases[f"{name}/friction"] = np.concatenate((forward, forward + half))
        return aliases

    def items(self, item: str) -> str:
        """Return the noun for what a command addresses.

        Args:
            item: "link" or "contact".

        Returns:
            The same noun, with "and segment" appended if there are segments.
        """
        return f"{item} and segment" if self.segments else item

    def target(self, rows: np.ndarray) -> np.ndarray:
        """Convert command rows to targets.

        Args:
            rows: shape (..., C).

        Returns:
            Shape (..., S + 2 N) [m, N]; `rows` itself if no conversion is needed.
        """
        return rows if self._is_plain else np.take(rows, self.index, axis=-1) * self.factor

    @functools.cached_property
    def _is_plain(self) -> bool:
        """Whether a row equals its target, as for bodies without segments."""
        same = self.count == self.index.size and (self.index == np.arange(self.count)).all()
        return bool(same and (self.factor == 1.0).all())


def build_columns(body: Body, fields: Sequence[tuple[bool, bool]]) -> Columns:
    """Build the command layout of a body on a line.

    Args:
        body: the body.
        fields: for each segment, whether its strain and whether its friction vary along it.

    Returns:
        The layout.
    """
    segments = tuple(
        (s.name, s.elements if strain else 1, s.elements + 1 if friction else 1)
        for s, (strain, friction) in zip(body.segments, fields, strict=True)
    )
    links, contacts = body.link_springs.size, body.isolated.size
    index = np.zeros(body.springs + 2 * body.contacts, dtype=np.int64)
    factor = np.ones(index.size)
    index[body.link_springs] = np.arange(links)
    column = links
    for segment, (_, size, _) in zip(body.segments, segments, strict=True):
        index[segment.springs] = column + np.arange(segment.elements) % size
        factor[segment.springs] = segment.element
        column += size
    for first in (body.springs, body.springs + body.contacts):
        index[first + body.isolated] = column + np.arange(contacts)
        column += contacts
        for segment, (_, _, size) in zip(body.segments, segments, strict=True):
            places = np.arange(segment.first, segment.last + 1)
            index[first + places] = column + np.arange(places.size) % size
            factor[first + places] = body.ground[places]
            column += size
    return Columns(links, contacts, segments, None, index, factor)


def build_planar_columns(body: Body, directions: int) -> Columns:
    """Build the command layout of a body in the plane.

    Args:
        body: the body.
        directions: number of friction directions; 0 for isotropic friction.

    Returns:
        The layout; a row equals its target.
    """
    size = 2 * body.springs + body.contacts * max(directions, 1)
    return Columns(body.springs, body.contacts, (), directions, np.arange(size), np.ones(size))
