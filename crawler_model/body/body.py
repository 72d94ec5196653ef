"""The body: contacts on the ground, joined by springs whose rest lengths are commanded.

A body is built of isolated contacts, of segments (intervals that touch the ground all along, cut into elements) and of
links between them. What is left after building is one graph of springs between contacts; a body whose springs join
each contact to the next is a chain.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Segment:
    """Where a segment lies in the arrays of a body.

    Attributes:
        name: as in the scene.
        first: its first contact.
        elements: how many elements it is cut into; its contacts are first .. first + elements.
        first_spring: the spring of its first element; those of the others follow.
        length: [m].
        shown: how many of its contacts are listed where all would be too many; None for all.
    """

    name: str
    first: int
    elements: int
    first_spring: int
    length: float
    shown: int | None = None

    @property
    def element(self) -> float:
        """Length of an element [m]."""
        return self.length / self.elements

    @property
    def last(self) -> int:
        """Its last contact."""
        return self.first + self.elements

    @property
    def contacts(self) -> slice:
        """Its contacts."""
        return slice(self.first, self.last + 1)

    @property
    def springs(self) -> slice:
        """Its springs."""
        return slice(self.first_spring, self.first_spring + self.elements)


@dataclass(frozen=True, eq=False)
class Body:
    """A graph of springs between contacts.

    Attributes:
        position: reference positions xi, shape (N,), increasing; shape (N, 2) in the plane [m].
        ends: the two contacts of each spring, shape (S, 2); on a line the first lies before the second.
        stiffness: k, shape (S,) [N/m].
        share: weight of each contact in the net translation, shape (N,); their sum is 1. Every isolated contact
            and every segment counts once, a segment with the mean over its length.
        ground: length of ground that each contact stands for, 1 for an isolated one, shape (N,) [m].
        isolated: the isolated contacts, in the scene's order, shape (I,).
        link_springs: the spring of each link, in the scene's order, shape (links,).
        segments: where the segments are.
    """

    position: np.ndarray
    ends: np.ndarray
    stiffness: np.ndarray
    share: np.ndarray
    ground: np.ndarray
    isolated: np.ndarray
    link_springs: np.ndarray
    segments: tuple[Segment, ...]

    @property
    def contacts(self) -> int:
        """Number of contacts N, those of segments included."""
        return int(self.position.shape[0])

    @property
    def springs(self) -> int:
        """Number of springs S, those of segments included."""
        return int(self.stiffness.size)

    @property
    def dimension(self) -> int:
        """1 on a line, 2 in the plane."""
        return self.position.ndim

    @functools.cached_property
    def is_chain(self) -> bool:
        """Whether the springs join each contact to the next, in order, on a line."""
        n = self.contacts
        if self.dimension != 1 or self.springs != n - 1:
            return False
        return bool((self.ends[:, 0] == np.arange(n - 1)).all() and (self.ends[:, 1] == np.arange(1, n)).all())

    @functools.cached_property
    def elasticity(self) -> np.ndarray:
        """Stiffness k [N/m] and compliance 1 / k [m/N] of each spring, shape (2, S)."""
        return np.stack((self.stiffness, 1.0 / self.stiffness))

    @functools.cached_property
    def stations(self) -> np.ndarray:
        """The contacts that stand for the body: the isolated ones, then both ends of each segment."""
        ends = [i for s in self.segments for i in (s.first, s.last)]
        return np.concatenate((self.isolated, np.array(ends, dtype=np.int64))).astype(np.int64)

    @functools.cached_property
    def element_ends(self) -> np.ndarray:
        """Both contacts of each element of a segment, shape (P, 2)."""
        first = [np.arange(s.first, s.last) for s in self.segments]
        left = np.concatenate([np.zeros(0, np.int64), *first])
        return np.column_stack((left, left + 1))

    @property
    def station_share(self) -> np.ndarray:
        """Weight of each station when the net translation is estimated from stations alone; exact without segments."""
        parts = self.isolated.size + len(self.segments)
        return np.array([1.0] * self.isolated.size + [0.5] * 2 * len(self.segments)) / parts

    def elongation(self, x: np.ndarray) -> np.ndarray:
        """Compute how much longer each spring is than in the reference shape.

        Args:
            x: displacement, shape (..., N), in the plane (..., N, 2) [m].

        Returns:
            z, shape (..., S), in the plane (..., S, 2) [m].
        """
        axis = -1 if self.dimension == 1 else -2
        return np.take(x, self.ends[:, 1], axis=axis) - np.take(x, self.ends[:, 0], axis=axis)

    def spring_force(self, tension: ArrayLike) -> np.ndarray:
        """Compute the force of the springs on each contact.

        Args:
            tension: T, shape (..., S), in the plane (S, 2) [N].

        Returns:
            g, shape (..., N), in the plane (N, 2) [N].
        """
        t = np.asarray(tension, dtype=np.float64)
        if self.dimension == 2:
            force = np.zeros((self.contacts, 2))
            np.add.at(force, self.ends[:, 0], t)
            np.subtract.at(force, self.ends[:, 1], t)
            return force
        if self.is_chain:
            force = np.zeros((*t.shape[:-1], self.contacts))
            force[..., :-1] = t
            force[..., 1:] -= t
            return force
        if t.ndim == 1:
            n = self.contacts
            return np.bincount(self.ends[:, 0], t, n) - np.bincount(self.ends[:, 1], t, n)
        rows = t.reshape(-1, self.springs).T
        force = np.zeros((self.contacts, rows.shape[1]))
        np.add.at(force, self.ends[:, 0], rows)
        np.subtract.at(force, self.ends[:, 1], rows)
        return force.T.reshape(*t.shape[:-1], self.contacts)

    def describe(self) -> str:
        """Say in a few words what the body consists of.

        Returns:
            As in "2 contacts, 1 segment (120 elements), 2 links, a chain".
        """

        def count(number: int, what: str) -> str:
            return f"{number} {what}{'' if number == 1 else 's'}"

        parts = [count(int(self.isolated.size), "contact")] if self.isolated.size else []
        parts += [f"segment {s.name} ({count(s.elements, 'element')})" for s in self.segments]
        parts.append(count(int(self.link_springs.size), "link"))
        return ", ".join(parts) + (" in the plane" if self.dimension == 2 else "" if self.is_chain else ", a graph")

    @functools.cached_property
    def joints(self) -> np.ndarray:
        """The stations between which each link, then each segment, lies: places in `stations`, shape (J, 2)."""
        place = {int(contact): i for i, contact in enumerate(self.stations)}
        pairs = [tuple(self.ends[spring]) for spring in self.link_springs]
        pairs += [(s.first, s.last) for s in self.segments]
        return np.array([[place[int(a)], place[int(b)]] for a, b in pairs], dtype=np.int64).reshape(-1, 2)

    def joint_sum(self, values: np.ndarray) -> np.ndarray:
        """Sum values of springs over each joint: of a link its own, of a segment those of all its elements.

        Args:
            values: one per spring, shape (S, ...).

        Returns:
            Shape (J, ...).
        """
        links = values[self.link_springs]
        if not self.segments:
            return links
        return np.concatenate((links, [values[s.springs].sum(axis=0) for s in self.segments]))

    def joint_mean(self, values: np.ndarray) -> np.ndarray:
        """Average values of springs over each joint.

        Args:
            values: one per spring, shape (S, ...).

        Returns:
            Shape (J, ...).
        """
        if not self.segments:
            return self.joint_sum(values)
        counts = self.joint_sum(np.ones(self.springs))
        return self.joint_sum(values) / counts.reshape(-1, *(1,) * (values.ndim - 1))

    def force_size(self, tension: np.ndarray) -> np.ndarray:
        """Compute the sum of the sizes of the tensions that meet at each contact, for what rounding can do.

        Args:
            tension: T, shape (S,) [N].

        Returns:
            Shape (N,) [N].
        """
        size = np.zeros(self.contacts)
        np.add.at(size, self.ends[:, 0], np.abs(tension))
        np.add.at(size, self.ends[:, 1], np.abs(tension))
        return size

    def name_of(self, contact: int) -> str:
        """Name a contact as a person would.

        Args:
            contact: its number in the arrays.

        Returns:
            "contact 2", or "segment trunk at 0.4 m".
        """
        for segment in self.segments:
            if segment.first <= contact <= segment.last:
                return f"segment {segment.name} at {self.position[contact]:.4g} m"
        return f"contact {int(np.flatnonzero(self.isolated == contact)[0])}"

    def relaxed(self, actuation: np.ndarray) -> np.ndarray:
        """Compute displacements at which the springs pull no contact, the first contact in place.

        Args:
            actuation: L, shape (S,), in the plane (2 S,), x and y of each in turn [m].

        Returns:
            x, shape (N,), in the plane (N, 2) [m].
        """
        if self.is_chain:
            return np.concatenate(([0.0], np.cumsum(actuation)))
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import spsolve

        n, s = self.contacts, np.arange(self.springs)
        root = np.sqrt(self.stiffness)
        rows, columns = np.concatenate((s, s)), np.concatenate((self.ends[:, 0], self.ends[:, 1]))
        incidence = csc_matrix((np.concatenate((-root, root)), (rows, columns)), shape=(self.springs, n))
        inner = incidence[:, 1:]
        load = inner.T @ (root[:, None] * actuation.reshape(self.springs, -1))
        moved = spsolve((inner.T @ inner).tocsc(), load).reshape(n - 1, -1)
        return np.vstack((np.zeros((1, moved.shape[1])), moved)).reshape(self.position.shape)
