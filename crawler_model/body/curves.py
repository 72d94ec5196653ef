"""Tensions of springs that are not linear: continuous, piecewise linear and non-decreasing.

A bent spring has two of them in parallel, one of its actuator over u = z - L and one of a passive spring over z.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

BEGIN, END, SLOPE, AT, VALUE, ENERGY = range(6)
"""Columns of the pieces of a curve: from where to where a piece reaches [m], its slope [N/m]; a point on it [m], the
tension [N] and the energy [J] there."""
_NEARER = 2.0**-0.5
"""A knot is nearer to 0 than another one if its distance is below this part: of two at the same distance, as in a
symmetric curve, the first one counts however their last digits change."""


@dataclass(frozen=True, eq=False)
class Curve:
    """A tension as a function of a length; beyond the first and the last knot, straight lines go on.

    Attributes:
        at: the knots, increasing, shape (K,), K > 0 [m].
        value: tensions at the knots, non-decreasing, shape (K,) [N].
        first: slope before the first knot, at least 0 [N/m].
        last: slope behind the last knot, at least 0 [N/m].
    """

    at: np.ndarray
    value: np.ndarray
    first: float
    last: float

    @property
    def slopes(self) -> np.ndarray:
        """Slopes before, between and behind the knots, shape (K + 1,) [N/m]."""
        return np.concatenate(([self.first], np.diff(self.value) / np.diff(self.at), [self.last]))

    def __call__(self, length: ArrayLike) -> np.ndarray:
        """Compute the tension.

        Args:
            length: any shape [m].

        Returns:
            Same shape [N].
        """
        given = np.asarray(length, dtype=np.float64)
        inner = np.interp(given, self.at, self.value)
        below, above = np.minimum(given - self.at[0], 0.0), np.maximum(given - self.at[-1], 0.0)
        return np.asarray(inner + self.first * below + self.last * above)

    def clamped(self, least: float, most: float) -> Curve:
        """Limit the tension.

        Args:
            least: least tension, may be -inf [N].
            most: largest tension, at least `least`, may be inf [N].

        Returns:
            The curve of min(max(T, least), most).
        """
        cuts = {at: tension for tension in (least, most) for at in self.reach(tension)}
        at = np.union1d(self.at, list(cuts))
        value = np.clip(self(at), least, most)
        value[np.searchsorted(at, list(cuts))] = list(cuts.values())  # exactly, or a slope of rounding would remain
        before, behind = self([at[0] - 1.0, at[-1] + 1.0])  # where no knots are left
        first = self.first if least <= before <= most else 0.0
        last = self.last if least <= behind <= most else 0.0
        return Curve(at, value, first, last).simplified()

    def reach(self, tension: float) -> list[float]:
        """Find where the curve passes a tension.

        Args:
            tension: the tension [N].

        Returns:
            The lengths, between knots where it rises [m]; none or one.
        """
        if not np.isfinite(tension):
            return []
        found = []
        for k, slope in enumerate(self.slopes):
            if slope > 0.0:
                knot = max(k - 1, 0)
                at = self.at[knot] + (tension - self.value[knot]) / slope
                begin = self.at[k - 1] if k > 0 else -np.inf
                end = self.at[k] if k < self.at.size else np.inf
                if begin < at < end:
                    found.append(float(at))
        return found

    def __add__(self, other: Curve) -> Curve:
        """Add the tension of a curve in parallel."""
        at = np.union1d(self.at, other.at)
        return Curve(at, self(at) + other(at), self.first + other.first, self.last + other.last).simplified()

    def stretched(self, length: float) -> Curve:
        """Convert a curve over strain to one over the elongation of an element.

        Args:
            length: of the element [m].

        Returns:
            The curve.
        """
        return Curve(self.at * length, self.value, self.first / length, self.last / length)

    def simplified(self) -> Curve:
        """Remove the knots at which the slope does not change, but for the one nearest to 0: it keeps tensions precise.

        Returns:
            The same function.
        """
        slopes = self.slopes
        kept = ~_equal(slopes[1:], slopes[:-1])
        distance = np.abs(self.at)
        nearest = int(np.argmax(_NEARER * distance <= distance.min()))
        kept[nearest] |= slopes[nearest] > 0.0 or not kept.any()
        return Curve(self.at[kept], self.value[kept], self.first, self.last)

    @functools.cached_property
    def pieces(self) -> np.ndarray:
        """Its straight pieces in order, columns as BEGIN .. ENERGY, shape (P, 6); the energy is 0 at length 0."""
        count = self.at.size + 1
        pieces = np.empty((count, 6))
        pieces[:, SLOPE] = self.slopes
        pieces[:, BEGIN], pieces[:, END] = np.append(-np.inf, self.at), np.append(self.at, np.inf)
        near = np.maximum(np.arange(count) - 1, 0)
        pieces[:, AT], pieces[:, VALUE] = self.at[near], self.value[near]
        gained = 0.5 * (self.value[1:] + self.value[:-1]) * np.diff(self.at)
        pieces[:, ENERGY] = np.append(0.0, np.cumsum(gained))[near]
        merged = pieces[:1]
        for piece in pieces[1:]:
            if not _equal(piece[SLOPE], merged[-1, SLOPE]):
                merged = np.vstack((merged, piece))
                continue
            if abs(piece[AT]) < _NEARER * abs(merged[-1, AT]):
                merged[-1, AT:] = piece[AT:]
            merged[-1, END] = piece[END]
        here = merged[np.searchsorted(merged[:, END], 0.0)]
        merged[:, ENERGY] -= _energy_on(here, 0.0)
        return merged


def _equal(slope: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Determine which slopes are equal within rounding."""
    return np.asarray(np.abs(slope - other) <= 1e-14 * np.maximum(slope, other))


def _energy_on(piece: np.ndarray, length: ArrayLike) -> np.ndarray:
    """Compute the energy of a curve at a length [m] on one of its pieces, shape (..., 6) [J]."""
    way = np.asarray(length) - piece[..., AT]
    return np.asarray(piece[..., ENERGY] + (piece[..., VALUE] + 0.5 * piece[..., SLOPE] * way) * way)


def line(stiffness: float) -> Curve:
    """Build the curve of a linear spring.

    Args:
        stiffness: k, 0 for none [N/m].

    Returns:
        The curve.
    """
    return Curve(np.zeros(1), np.zeros(1), stiffness, stiffness)


def through(at: Sequence[float], value: Sequence[float]) -> Curve:
    """Build a curve from knots, with the slopes of both ends beyond them.

    Args:
        at: the knots, at least two, increasing, shape (K,) [m].
        value: tensions at the knots, non-decreasing, shape (K,) [N].

    Returns:
        The curve.
    """
    knots, tension = np.array(at, dtype=np.float64), np.array(value, dtype=np.float64)
    slopes = np.diff(tension) / np.diff(knots)
    return Curve(knots, tension, float(slopes[0]), float(slopes[-1])).simplified()


STIFFNESS, YIELD, START = range(3)
"""Numbers of a slider of a bent spring: stiffness [N/m], force at which it yields, and at the start [N]."""


@dataclass(frozen=True, eq=False)
class Bend:
    """A spring of a body that is not linear, or has backlash.

    Attributes:
        spring: its index.
        actuator: tension over u = z - L.
        passive: tension over z.
        sliders: Maxwell-slip elements in parallel with both: rows of stiffness [N/m], force at which it yields [N], and
            force at the start [N]. Tensions and energies here are without them.
        backlash: slack between the command and the actuator, in all [m].
        ahead: how far the actuator is ahead of its command at the start [m].
    """

    spring: int
    actuator: Curve
    passive: Curve
    sliders: tuple[tuple[float, float, float], ...] = ()
    backlash: float = 0.0
    ahead: float = 0.0

    @property
    def stiffness(self) -> float:
        """Largest stiffness of both together, for scales [N/m]."""
        total = self.actuator.slopes.max() + self.passive.slopes.max()
        return float(total) + sum(slider[STIFFNESS] for slider in self.sliders)

    @property
    def is_flat_somewhere(self) -> bool:
        """Whether the tension can be constant while the spring changes its length."""
        return bool(self.actuator.slopes.min() + self.passive.slopes.min() == 0.0)

    @property
    def is_limited(self) -> bool:
        """Whether the tension of both together has a least or a largest value."""
        return 0.0 in (self.actuator.first + self.passive.first, self.actuator.last + self.passive.last)

    @property
    def pulls_on(self) -> bool:
        """Whether the spring pulls however short it is, or pushes however long: nothing but friction then ends it."""
        one, other = self.actuator, self.passive
        pulls = one.first + other.first == 0.0 and one.value[0] + other.value[0] > 0.0
        return bool(pulls or (one.last + other.last == 0.0 and one.value[-1] + other.value[-1] < 0.0))

    @property
    def limits(self) -> tuple[float, float]:
        """Least and largest tension that the actuator reaches; infinite without a limit [N]."""
        curve = self.actuator
        least = -np.inf if curve.first > 0.0 else float(curve.value[0])
        return least, np.inf if curve.last > 0.0 else float(curve.value[-1])

    def over_elongation(self, actuation: float) -> Curve:
        """Build the tension of both together over the elongation.

        Args:
            actuation: L [m].

        Returns:
            The curve.
        """
        actuator = self.actuator
        return Curve(actuator.at + actuation, actuator.value, actuator.first, actuator.last) + self.passive

    def relaxed_elongation(self, actuation: float) -> float:
        """Find the elongation of the least tension or pressure; of several, the one nearest to 0.

        Args:
            actuation: L [m].

        Returns:
            z [m].
        """
        curve = self.over_elongation(actuation)
        relaxed = curve.reach(0.0)
        places = np.array([0.0, *curve.at, *relaxed])
        size = np.concatenate((np.abs(curve(places[: 1 + curve.at.size])), np.zeros(len(relaxed))))
        least = places[size <= size.min()]
        return float(least[np.argmin(np.abs(least))])

    def tension(self, elongation: np.ndarray, actuation: np.ndarray) -> np.ndarray:
        """Compute the tension of both together.

        Args:
            elongation: z, any shape [m].
            actuation: L, of the same shape [m].

        Returns:
            Same shape [N].
        """
        return self.actuator(elongation - actuation) + self.passive(elongation)

    def energy(self, elongation: np.ndarray, actuation: np.ndarray) -> np.ndarray:
        """Compute the energy of both together, 0 if z and L are.

        Args:
            elongation: z, any shape [m].
            actuation: L, of the same shape [m].

        Returns:
            Same shape [J].
        """
        return _energy(self.actuator, elongation - actuation) + _energy(self.passive, elongation)


def list_sliders(bends: Sequence[Bend]) -> np.ndarray:
    """List the elements of hysteresis of bent springs, spring by spring.

    Args:
        bends: the springs.

    Returns:
        Index of the spring, stiffness [N/m], force at which it yields [N], and force at the start [N]; shape (H, 4).
    """
    return np.array([(bend.spring, *slider) for bend in bends for slider in bend.sliders]).reshape(-1, 4)


def energy_of_sliders(bends: Sequence[Bend], force: np.ndarray) -> float:
    """Compute the energy stored in the elements of hysteresis of bent springs.

    Args:
        bends: the springs.
        force: of each element, shape (H,) [N].

    Returns:
        The energy [J].
    """
    return float((0.5 * force**2 / list_sliders(bends)[:, 1 + STIFFNESS]).sum())


def add_start(bends: Sequence[Bend], tension: np.ndarray) -> np.ndarray:
    """Add what elements of hysteresis have at the start of a scene to tensions without them.

    Args:
        bends: the bent springs.
        tension: T of each spring, shape (..., S), changed in place [N].

    Returns:
        The sum, the same array [N].
    """
    for bend in bends:
        for slider in bend.sliders:
            tension[..., bend.spring] += slider[START]
    return tension


def _energy(curve: Curve, length: np.ndarray) -> np.ndarray:
    pieces = curve.pieces
    return _energy_on(pieces[np.searchsorted(pieces[:-1, END], length)], length)
