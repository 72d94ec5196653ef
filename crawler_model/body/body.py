"""The body: contacts on the ground, joined by springs whose rest lengths are commanded.

A body consists of isolated contacts, segments (intervals that touch the ground along their whole length, divided into
elements) and links between them. All of these become one graph of springs between contacts; a body whose springs join
each contact to the next one is a chain. Segments that touch share a contact, as does an isolated contact at an end of
one.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import join
from .backlash import Backlash, build_backlash
from .curves import Bend
from .limits import Limits, build_limits
from .segment import Segment
from .turning import Turning, find_forces, measure_shape, relax_shape, wrap


@dataclass(frozen=True, eq=False)
class Body:
    """A graph of springs between contacts.

    Attributes:
        position: reference positions xi, shape (N,), increasing; shape (N, 2) in the plane [m].
        ends: the two contacts of each spring, shape (S, 2); on a line the first lies before the second.
        stiffness: k, shape (S,) [N/m]; (M, S) for M variations of a body. For a bent spring, its largest stiffness.
        share: weight of each contact in the net translation, shape (N,), summing to 1. Every isolated contact and
            every segment has the same weight; a segment contributes the mean over its length.
        ground: length of ground that each contact represents, 1 for an isolated contact; for one that several parts
            share the sum over these, shape (N,) [m].
        isolated: indices of the isolated contacts, in the order of the scene, shape (I,).
        link_springs: index of the spring of each link, in the order of the scene, shape (links,).
        segments: positions of the segments in these arrays.
        bends: the springs that are not linear, or have backlash, in the order of their indices.
        turning: joints, frames and heading of a body in the plane whose springs have lengths, see `Turning`; None where
            they are vectors, and on a line.

    Bodies that turn differ from the other bodies in the plane below: they have an elongation and a tension for each
    link, followed by an angle [rad] and a torque [N m] for each joint, together shape (S + J,).
    """

    position: np.ndarray
    ends: np.ndarray
    stiffness: np.ndarray
    share: np.ndarray
    ground: np.ndarray
    isolated: np.ndarray
    link_springs: np.ndarray
    segments: tuple[Segment, ...]
    bends: tuple[Bend, ...] = ()
    turning: Turning | None = None

    @property
    def contacts(self) -> int:
        """Number of contacts N, segments included."""
        return int(self.position.shape[0])

    @property
    def springs(self) -> int:
        """Number of springs S, segments included."""
        return int(self.stiffness.shape[-1])

    @property
    def dimension(self) -> int:
        """1 on a line, 2 in the plane."""
        return self.position.ndim

    @property
    def lengths(self) -> int:
        """Number of entries of a target that hold rest lengths, or rest angles, which come first."""
        return self.springs * self.dimension if self.turning is None else int(self.stiffnesses.size)

    @property
    def stiffnesses(self) -> np.ndarray:
        """Stiffness of each spring, for a body that turns also of each joint [N/m, N m/rad]."""
        return self.stiffness if self.turning is None else join((self.stiffness, self.turning.joint_stiffness))

    @functools.cached_property
    def is_chain(self) -> bool:
        """Whether the springs join each contact to the next, in order, on a line."""
        n = self.contacts
        if self.dimension != 1 or self.springs != n - 1:
            return False
        return bool((self.ends[:, 0] == np.arange(n - 1)).all() and (self.ends[:, 1] == np.arange(1, n)).all())

    @functools.cached_property
    def shares_contacts(self) -> bool:
        """Whether some contact belongs to more than one isolated contact or segment."""
        return np.unique(self.stations).size < self.stations.size

    @functools.cached_property
    def has_flat_springs(self) -> bool:
        """Whether a spring can change its length at constant tension, so that it holds nothing."""
        return any(bend.is_flat_somewhere for bend in self.bends)

    @functools.cached_property
    def backlash(self) -> Backlash | None:
        """The slacks between commands and actuators; None where there are none."""
        return build_backlash(self.bends)

    @functools.cached_property
    def memory(self) -> str:
        """What of the body remembers its path, as springs with hysteresis do; empty if nothing."""
        if any(bend.sliders for bend in self.bends):
            return "springs with hysteresis"
        return "" if self.backlash is None else "actuators with backlash"

    def start_lengths(self, commanded: np.ndarray) -> np.ndarray:
        """Compute the rest lengths at the start of a scene.

        Args:
            commanded: those commanded there, shape (..., S), in the plane (..., 2 S) [m].

        Returns:
            L, same shape [m].
        """
        if self.backlash is None:
            return commanded
        lengths = np.array(commanded)
        lengths[..., self.backlash.springs] += self.backlash.ahead
        return lengths

    @functools.cached_property
    def stations(self) -> np.ndarray:
        """Indices of the isolated contacts, then of both ends of each segment."""
        ends = [i for s in self.segments for i in (s.first, s.last)]
        return np.concatenate((self.isolated, np.array(ends, dtype=np.int64))).astype(np.int64)

    @functools.cached_property
    def element_ends(self) -> np.ndarray:
        """Indices of the two contacts of each element of all segments, shape (P, 2)."""
        left = np.concatenate([np.zeros(0, np.int64), *(np.arange(s.first, s.last) for s in self.segments)])
        return np.column_stack((left, left + 1))

    @property
    def station_share(self) -> np.ndarray:
        """Weight of each station in an estimate of the net translation from only stations; exact without segments."""
        if self.turning is not None:  # not all of its points touch the ground
            return self.share
        parts = self.isolated.size + len(self.segments)
        return np.array([1.0] * self.isolated.size + [0.5] * 2 * len(self.segments)) / parts

    def elongation(self, x: np.ndarray) -> np.ndarray:
        """Compute the elongation of each spring relative to the reference shape.

        Args:
            x: displacement, shape (..., N), in the plane (..., N, 2) [m].

        Returns:
            z, shape (..., S), in the plane (..., S, 2) [m].
        """
        if self.turning is not None:
            rest = measure_shape(self.position, self.ends, self.turning.joints)
            change = measure_shape(self.position + x, self.ends, self.turning.joints) - rest
            change[..., self.springs :] = wrap(change[..., self.springs :])
            return change
        axis = -1 if self.dimension == 1 else -2
        return np.take(x, self.ends[:, 1], axis=axis) - np.take(x, self.ends[:, 0], axis=axis)

    def tension(self, elongation: np.ndarray, actuation: np.ndarray) -> np.ndarray:
        """Compute the tension of each spring.

        Args:
            elongation: z, shape (..., S), in the plane (..., S, 2) [m].
            actuation: L, of the same shape [m].

        Returns:
            T, same shape [N].
        """
        if self.turning is not None:
            change = elongation - actuation
            change[..., self.springs :] = wrap(change[..., self.springs :])
            return np.asarray(self.stiffnesses * change)
        stiffness = self.stiffness if self.dimension == 1 else self.stiffness[:, None]
        tension = np.asarray(stiffness * (elongation - actuation))
        for bend in self.bends:
            j = bend.spring
            tension[..., j] = bend.tension(elongation[..., j], actuation[..., j])
        return tension

    def energy(self, tension: np.ndarray, x: np.ndarray, actuation: np.ndarray | None) -> np.ndarray:
        """Compute the energy of all springs; for a linear one it follows from its tension, which is more precise.

        Args:
            tension: T, shape (..., S); for M variations (M, T, S), in the plane (..., S, 2) [N].
            x: displacement, shape (..., N), in the plane (..., N, 2) [m].
            actuation: L, shape (..., S); None if no spring is bent [m].

        Returns:
            Shape (...) [J].
        """
        if self.turning is not None:
            return np.asarray((0.5 * tension**2 / self.stiffnesses).sum(axis=-1))
        if self.dimension == 2:
            energy = 0.5 * tension**2 / self.stiffness[:, None]
            return np.asarray(energy.reshape(*energy.shape[:-2], -1).sum(axis=-1))
        stiffness = self.stiffness[:, None, :] if self.stiffness.ndim == 2 else self.stiffness
        energy = 0.5 * tension**2 / stiffness
        if self.bends:
            assert actuation is not None
            elongation = self.elongation(x)
            for bend in self.bends:
                j = bend.spring
                energy[..., j] = bend.energy(elongation[..., j], actuation[..., j])
        return np.asarray(energy.sum(axis=-1))

    def spring_force(self, tension: ArrayLike) -> np.ndarray:
        """Compute the force of the springs on each contact.

        Args:
            tension: T, shape (..., S), in the plane (..., S, 2) [N].

        Returns:
            g, shape (..., N), in the plane (..., N, 2) [N].
        """
        t = np.asarray(tension, dtype=np.float64)
        if self.dimension == 2 and t.ndim > 2:
            each = np.moveaxis(t, -1, -2)
            force = self._sum_at(self.ends[:, 0], each) - self._sum_at(self.ends[:, 1], each)
            return np.moveaxis(force, -2, -1)
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
        return self._sum_at(self.ends[:, 0], t) - self._sum_at(self.ends[:, 1], t)

    def force_at(self, x: np.ndarray, tension: np.ndarray) -> np.ndarray:
        """Compute the force of the springs on each contact of a body, which may depend on where its contacts are.

        Args:
            x: displacement, shape (..., N), in the plane (..., N, 2) [m].
            tension: T, shape (..., S), in the plane (..., S, 2) [N].

        Returns:
            g, shape (..., N), in the plane (..., N, 2) [N].
        """
        if self.turning is None:
            return self.spring_force(tension)
        return find_forces(self.position + x, self.ends, self.turning.joints, tension)

    def _sum_at(self, contact: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Sum values, shape (..., K), at a contact of each, shape (K,); returns shape (..., N)."""
        if values.ndim == 1:
            return np.bincount(contact, values, self.contacts)
        rows = values.reshape(-1, contact.size).T
        total = np.zeros((self.contacts, rows.shape[1]))
        np.add.at(total, contact, rows)
        return np.ascontiguousarray(total.T).reshape(*values.shape[:-1], self.contacts)

    def describe(self) -> str:
        """Describe the components of the body in a few words.

        Returns:
            For example "2 contacts, segment trunk (120 elements), 2 links".
        """

        def count(number: int, noun: str) -> str:
            return f"{number} {noun}{'' if number == 1 else 's'}"

        parts = [count(int(self.isolated.size), "contact")] if self.isolated.size else []
        parts += [f"segment {s.name} ({count(s.elements, 'element')})" for s in self.segments]
        parts.append(count(int(self.link_springs.size), "link"))
        if self.turning is not None:
            parts[0] = count(self.contacts, "point")
            parts.append(count(self.turning.joints.shape[0], "joint"))
        return ", ".join(parts) + (" in the plane" if self.dimension == 2 else "" if self.is_chain else ", a graph")

    @functools.cached_property
    def joints(self) -> np.ndarray:
        """End stations of each link, then of each segment: indices into `stations`, shape (J, 2).

        Of several stations at a contact that parts share, it is the first.
        """
        place = {int(self.stations[i]): i for i in range(self.stations.size - 1, -1, -1)}
        pairs = [tuple(self.ends[spring]) for spring in self.link_springs]
        pairs += [(s.first, s.last) for s in self.segments]
        return np.array([[place[int(a)], place[int(b)]] for a, b in pairs], dtype=np.int64).reshape(-1, 2)

    @functools.cached_property
    def limits(self) -> Limits:
        """The limits of tension of the springs."""
        return build_limits([(bend.spring, [bend]) for bend in self.bends])

    @functools.cached_property
    def joint_limits(self) -> Limits:
        """The limits of tension of the joints; a segment is at one where its elements are on average."""
        bends = {bend.spring: bend for bend in self.bends}
        springs = [[int(spring)] for spring in self.link_springs]
        springs += [list(range(s.springs.start, s.springs.stop)) for s in self.segments]
        bent = [(joint, [bends[k] for k in part if k in bends]) for joint, part in enumerate(springs)]
        return build_limits([(joint, part) for joint, part in bent if part])

    def joint_sum(self, values: np.ndarray) -> np.ndarray:
        """Sum values of springs over each joint; a link has one spring, a segment one per element.

        Args:
            values: one per spring, shape (S, ...).

        Returns:
            Shape (J, ...).
        """
        if self.turning is not None:
            return values
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
        """Compute the sum of the absolute tensions at each contact, which bounds the rounding error of its force.

        Args:
            tension: T, shape (..., S) [N].

        Returns:
            Shape (..., N) [N].
        """
        size = np.abs(tension)
        return self._sum_at(self.ends.T.ravel(), np.concatenate((size, size), axis=-1))

    def name_of(self, contact: int) -> str:
        """Return a readable name of a contact.

        Args:
            contact: its index in the arrays.

        Returns:
            "contact 2", or "segment trunk at 0.4 m".
        """
        alone = np.flatnonzero(self.isolated == contact)
        if alone.size:
            return f"contact {int(alone[0])}"
        segment = next(s for s in self.segments if s.first <= contact <= s.last)
        return f"segment {segment.name} at {self.position[contact]:.4g} m"

    def relaxed(self, actuation: np.ndarray) -> np.ndarray:
        """Compute displacements at which no spring exerts a force; the first contact is not displaced.

        A bent spring may always exert one; then it is the least. In a graph with bent springs it is an estimate.

        Args:
            actuation: L, shape (..., S), in the plane (2 S,), x and y of each in turn [m].

        Returns:
            x, shape (..., N), in the plane (N, 2) [m].
        """
        if self.turning is not None:
            return relax_shape(self.position, self.ends, self.turning, self.stiffnesses, actuation)
        if self.bends:
            actuation = np.array(actuation, dtype=np.float64)
            for bend in self.bends:
                actuation[bend.spring] = bend.relaxed_elongation(float(actuation[bend.spring]))
        if self.is_chain:
            return join((0.0, np.cumsum(actuation, axis=-1)))
        if self.stiffness.ndim == 2 or (self.dimension == 1 and actuation.ndim == 2):
            lengths, stiffness = np.broadcast_arrays(actuation, self.stiffness)
            x = np.full((lengths.shape[0], self.contacts), np.nan)
            for at in np.flatnonzero((stiffness > 0.0).all(axis=1) & np.isfinite(lengths).all(axis=1)):
                x[at] = dataclasses.replace(self, stiffness=stiffness[at]).relaxed(lengths[at])
            return x
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
