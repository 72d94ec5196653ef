"""The stasis domain: the set of forces for which the body is at rest.

The force that the springs transmit through the section between contacts i and i + 1 is Q_i = sum_{j<=i} g_j. In a chain
it is the tension T_i of link i; in a general graph of springs it is the sum over all springs that span the section.
For any springs, the body is at rest strictly inside

    C_sh = { Q : -mu_minus_i <= Q_i - Q_{i-1} <= mu_plus_i },   Q_{-1} = Q_{N-1} = 0

and motion starts at its boundary ([G] Remark on stasis domains). The facet that is reached determines which contact
slides and hence the direction of motion ([G] Remark on stasis domains and direction of motion). [G] draws these sets
in -Q.

Loads f shift the bounds: with them, mu_plus and mu_minus stand for mu_plus - f and mu_minus + f throughout this file,
as in `Drive.forward` and `Drive.backward`. One of the two may be negative where others hold a contact. The functions
take one state and its friction; `StasisDomain` is the set itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ..body.drive import Drive
from ..notebook import write_html, write_numbers
from ..rounding import CRITICAL, EPS

_ROUNDING = 16.0 * EPS


@dataclass(frozen=True)
class Facet:
    """A facet of a stasis domain: one contact at one of its bounds, while all others can be strictly inside theirs.

    Attributes:
        contact: the contact that slides there while all others are at rest.
        side: the bound that it reaches: "forward" (g = mu_plus) or "backward" (g = -mu_minus).
        contacts: number of contacts N of the domain.
    """

    contact: int
    side: Literal["forward", "backward"]
    contacts: int

    @property
    def direction(self) -> int:
        """Sign of the net translation v_m while only its contact slides: 1 forward, -1 backward."""
        return 1 if self.side == "forward" else -1

    @property
    def normal(self) -> np.ndarray:
        """Outer normal, +-(e_i - e_{i-1}) in the space of section forces, not normalised, shape (N - 1,)."""
        padded = np.zeros(self.contacts + 1)
        padded[self.contact + 1], padded[self.contact] = self.direction, -self.direction
        return padded[1:-1]


@dataclass(frozen=True, eq=False, repr=False)
class StasisDomain:
    """The section forces at which no contact has to slide: a convex polytope of dimension at most N - 1.

    Attributes:
        forward: mu_plus, with loads mu_plus - f, shape (N,) [N].
        backward: mu_minus, with loads mu_minus + f, shape (N,) [N]. The sum of both is >= 0 for each contact, and the
            sum of each over all contacts: otherwise the set is empty.
    """

    forward: np.ndarray
    backward: np.ndarray

    def __post_init__(self) -> None:
        for name in ("forward", "backward"):
            values = np.array(getattr(self, name), dtype=np.float64)
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        if self.forward.ndim != 1 or self.forward.size < 2 or self.forward.shape != self.backward.shape:
            raise ValueError(
                f"forward, backward: shapes {self.forward.shape} and {self.backward.shape}; "
                "a stasis domain needs both values for at least two contacts"
            )
        for name, values in (("forward", self.forward), ("backward", self.backward)):
            for i in np.flatnonzero(~np.isfinite(values)):
                raise ValueError(f"{name}: contact {i} has {values[i]:g} N; a bound must be finite")
        width = self.forward + self.backward
        near = CRITICAL * float(np.abs(self.forward).sum() + np.abs(self.backward).sum())
        for i in np.flatnonzero(width < -near):
            raise ValueError(
                f"forward, backward: contact {i} has {self.forward[i]:g} and {self.backward[i]:g} N; "
                "their sum, the friction of both directions, must be >= 0"
            )
        for name, values in (("forward", self.forward), ("backward", self.backward)):
            if values.sum() < -near:
                raise ValueError(
                    f"{name}: the bounds sum to {values.sum():g} N; the sum must be >= 0, as no equilibrium holds the "
                    "loads otherwise"
                )

    def __repr__(self) -> str:
        """Describe the domain in one line."""
        return f"StasisDomain(forward={write_numbers(self.forward)}, backward={write_numbers(self.backward)})"

    def _repr_html_(self) -> str:
        """Show the bounds in a notebook."""
        return write_html("StasisDomain", [(f"{name} [N]", getattr(self, name)) for name in ("forward", "backward")])

    @property
    def contacts(self) -> int:
        """Number of contacts N."""
        return int(self.forward.size)

    def contains(self, section: ArrayLike) -> bool:
        """Check whether section forces belong to the (closed) domain.

        Args:
            section: Q, shape (N - 1,) [N].

        Returns:
            True inside and on the boundary; exact, without a tolerance.
        """
        return is_in_stasis(section, self.forward, self.backward)

    def margins(self, section: ArrayLike) -> np.ndarray:
        """Compute the distance of each contact from its nearest bound.

        Args:
            section: Q, shape (..., N - 1) [N].

        Returns:
            min(mu_plus - g, g + mu_minus), shape (..., N) [N]: positive inside, minus the excess outside.
        """
        return stasis_margins(section, self.forward, self.backward)

    def ranges(self) -> tuple[np.ndarray, np.ndarray]:
        """Compute the projection onto each section.

        Returns:
            The smallest and the largest force of each section, each of shape (N - 1,) [N].
        """
        return tension_ranges(self.forward, self.backward)

    def vertices(self) -> np.ndarray:
        """Compute the vertices of a domain that is an interval or a polygon.

        Returns:
            For two contacts the two ends, shape (2, 1); for three the distinct vertices (Q_0, Q_1), anticlockwise,
            shape (V, 2) [N]; V = 1 or 2 if friction vanishes, else 3 .. 6.

        Raises:
            ValueError: for four or more contacts.
        """
        least, most = self.ranges()
        if self.contacts == 2:
            return np.array([least, most])
        if self.contacts > 3:
            raise ValueError(
                f"{self.contacts} contacts: the domain has dimension {self.contacts - 1}; vertices are available for "
                "two and three contacts, projection(first, second) is a polygon for any number"
            )
        # With every bound as tight as the others imply, neighbouring sides of the hexagon always meet in the domain.
        up = min(self.forward[1], self.backward[0] + self.backward[2])
        down = min(self.backward[1], self.forward[0] + self.forward[2])
        (left, low), (right, high) = least, most
        corners = np.array(
            [
                *([right, right - down], [right, high], [high - up, high]),
                *([left, left + up], [left, low], [low + down, low]),
            ]
        )
        gaps = np.abs(np.roll(corners, -1, axis=0) - corners).max(axis=1)
        distinct = gaps > _ROUNDING * float(self.forward.sum() + self.backward.sum())
        return corners[distinct] if distinct.any() else corners[:1]

    def projection(self, first: int, second: int) -> np.ndarray:
        """Compute the projection onto two sections: the domain of the three groups of contacts that they separate.

        Args:
            first: a section, 0 .. N - 3.
            second: a section beyond it, at most N - 2.

        Returns:
            The vertices (Q_first, Q_second), as in `vertices`, shape (V, 2) [N].

        Raises:
            ValueError: if there are no such sections.
        """
        return self.merged(first, second).vertices()

    def merged(self, first: int, second: int) -> StasisDomain:
        """Merge the contacts before, between and behind two sections into one contact each, with their total friction.

        Args:
            first: a section, 0 .. N - 3.
            second: a section beyond it, at most N - 2.

        Returns:
            A domain of three contacts.

        Raises:
            ValueError: if there are no such sections.
        """
        if not 0 <= first < second <= self.contacts - 2:
            raise ValueError(
                f"sections {first} and {second}: they must be increasing and between 0 and {self.contacts - 2}"
            )
        starts = [0, first + 1, second + 1]
        return StasisDomain(np.add.reduceat(self.forward, starts), np.add.reduceat(self.backward, starts))

    def facets(self) -> tuple[Facet, ...]:
        """Find the facets: with g_i at a bound, all other contacts can be strictly inside their bounds.

        At mu_plus_i the others must carry -mu_plus_i > -sum_{j != i} mu_minus_j, hence the facet exists when
        mu_plus_i + mu_minus_i < sum_j mu_minus_j; at -mu_minus_i when it is less than sum_j mu_plus_j. Loads change
        these sums, but not the left sides: the steeper the slope, the fewer facets lead uphill. If a contact
        has no friction, the other contacts have no facets: the domain itself is the facet of that contact, on both
        sides. Bounds that balance within 1e-12 of the total friction, as in `uniqueness_margin`, make no facet.

        Returns:
            The facets, sorted by contact, forward before backward.
        """
        width = self.forward + self.backward
        plus, minus = float(self.forward.sum()), float(self.backward.sum())
        near = CRITICAL * (plus + minus)
        if plus <= near or minus <= near:
            return ()
        empty = width <= _ROUNDING * (np.abs(self.forward) + np.abs(self.backward))
        balanced = width + near
        others_open = np.count_nonzero(empty) == empty.astype(np.int64)
        n = self.contacts
        found: list[Facet] = []
        for i in np.flatnonzero(others_open & (balanced < max(plus, minus))).tolist():
            if balanced[i] < minus:
                found.append(Facet(i, "forward", n))
            if balanced[i] < plus:
                found.append(Facet(i, "backward", n))
        return tuple(found)

    @property
    def one_way(self) -> bool:
        """Whether all facets (at least one) have the same direction, so that the body cannot move in the other one.

        Three equal contacts can move in one direction only if one friction is at least twice the other.
        """
        return len(directions_of([self])) == 1


def directions_of(domains: Iterable[StasisDomain]) -> set[int]:
    """Collect the directions of the facets of some domains.

    Args:
        domains: the domains.

    Returns:
        A subset of {1, -1}.
    """
    return {facet.direction for domain in domains for facet in domain.facets()}


def holds_loads(forward: ArrayLike, backward: ArrayLike) -> bool:
    """Determine whether friction holds the loads, so that stasis domains are not empty.

    Walls, and ground that holds more than even ground, may hold a body where its friction does not.

    Args:
        forward: mu_plus - f, shape (..., N) [N].
        backward: mu_minus + f, same shape [N].

    Returns:
        Whether it does in all rows.
    """
    plus, minus = np.asarray(forward, dtype=np.float64), np.asarray(backward, dtype=np.float64)
    near = CRITICAL * (np.abs(plus) + np.abs(minus)).sum(axis=-1)
    least = np.minimum(np.minimum(plus.sum(axis=-1), minus.sum(axis=-1)), (plus + minus).min(axis=-1))
    return bool((least >= -near).all())


def domain_evolution(drive: Drive) -> tuple[np.ndarray, tuple[StasisDomain, ...]]:
    """Compute the stasis domain at each waypoint of a drive; between waypoints friction is linear.

    Args:
        drive: a drive, or any object with `times` (W,) [s], `forward` and `backward` (W, N) [N].

    Returns:
        The times of the waypoints, shape (W,) [s], and their domains.
    """
    domains = tuple(StasisDomain(plus, minus) for plus, minus in zip(drive.forward, drive.backward, strict=True))
    return np.array(drive.times, dtype=np.float64), domains


def section_forces(force: ArrayLike) -> np.ndarray:
    """Compute the force transmitted through each section, Q_i = sum_{j<=i} g_j; `spring_force` is its inverse.

    Args:
        force: g on each contact, summing to zero, shape (..., N) [N].

    Returns:
        Q, shape (..., N - 1) [N].
    """
    return np.cumsum(np.asarray(force, dtype=np.float64), axis=-1)[..., :-1]


def spring_force(tension: ArrayLike) -> np.ndarray:
    """Compute the force of the springs on each contact, g_i = T_i - T_{i-1}.

    Args:
        tension: T, shape (..., N - 1) [N].

    Returns:
        g, shape (..., N) [N].
    """
    t = np.asarray(tension, dtype=np.float64)
    ends = np.zeros((*t.shape[:-1], 1))
    return np.diff(np.concatenate((ends, t, ends), axis=-1), axis=-1)


def stasis_margins(tension: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> np.ndarray:
    """Compute the distance of each contact from its nearest bound.

    Args:
        tension: T, shape (..., N - 1) [N].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        min(mu_plus - g, g + mu_minus), shape (..., N) [N]: positive inside, minus the excess outside.
    """
    return bound_distances(spring_force(tension), forward, backward)


def bound_distances(force: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> np.ndarray:
    """Compute the distance of each spring force from its nearest bound.

    Args:
        force: g, shape (..., N) [N].
        forward: mu_plus, shape (N,) or (..., N) [N].
        backward: mu_minus, of the same shape [N].

    Returns:
        min(mu_plus - g, g + mu_minus), shape (..., N) [N]: positive inside, minus the excess outside.
    """
    g = np.asarray(force)
    return np.minimum(np.asarray(forward) - g, g + np.asarray(backward))


def is_in_stasis(tension: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> bool:
    """Check whether the tensions belong to the (closed) stasis domain.

    Args:
        tension: T, shape (N - 1,) [N].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        True inside and on the boundary.
    """
    return bool((stasis_margins(tension, forward, backward) >= 0.0).all())


def stasis_bounds(tension: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Compute the admissible range of each tension while the other tensions are fixed.

    Args:
        tension: T, shape (..., N - 1) [N].
        forward: mu_plus, shape (..., N) [N].
        backward: mu_minus, shape (..., N) [N].

    Returns:
        The smallest and the largest tension of each link, each of shape (..., N - 1) [N].
    """
    t = np.asarray(tension, dtype=np.float64)
    plus, minus = np.asarray(forward), np.asarray(backward)
    ends = np.zeros((*t.shape[:-1], 1))
    before = np.concatenate((ends, t[..., :-1]), axis=-1)
    after = np.concatenate((t[..., 1:], ends), axis=-1)
    least = np.maximum(before - minus[..., :-1], after - plus[..., 1:])
    most = np.minimum(before + plus[..., :-1], after + minus[..., 1:])
    return least, most


def tension_ranges(forward: ArrayLike, backward: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Compute the projection of the stasis domain onto each link's tension.

    Link i can be held from either side: -min(sum_{j<=i} mu_minus_j, sum_{j>i} mu_plus_j) <= T_i <=
    min(sum_{j<=i} mu_plus_j, sum_{j>i} mu_minus_j).

    Args:
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        The smallest and the largest tension of each link, each of shape (N - 1,) [N].
    """
    plus, minus = np.asarray(forward, dtype=np.float64), np.asarray(backward, dtype=np.float64)
    behind_plus, behind_minus = np.cumsum(plus)[:-1], np.cumsum(minus)[:-1]
    ahead_plus, ahead_minus = np.cumsum(plus[::-1])[::-1][1:], np.cumsum(minus[::-1])[::-1][1:]
    return -np.minimum(behind_minus, ahead_plus), np.minimum(behind_plus, ahead_minus)
