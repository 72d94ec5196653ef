"""What a gait is judged by: a number that is larger for better gaits, with its derivatives."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .regime import Regime, RegimeDerivatives

SCREW = "screw"
OBJECTIVES = {"translation": "m", "cost-of-transport": "1", "travel": "1", "turn": "rad", SCREW: "m"}
"""Objectives and their units: gain per period, work / (distance * force), gain / travel of the actuators; for bodies
that turn also the turn per period, and the distance of the motion per period from a target."""
TURNING_OBJECTIVES = ("translation", "cost-of-transport", "turn", SCREW)
DEFAULT_PERIODS = 10
"""Periods that count on patches of ground, as many as `simulate` runs."""
WORST = 1e6
"""A score below minus this belongs to a gait beyond the limits, or to none."""
LEAST_GAIN = 1e-7
"""Least gain of a body that moves, relative to the travel of its actuators; tensions repeat to less than that."""


@dataclass(frozen=True)
class Goal:
    """An objective and the limits of a gait.

    Attributes:
        objective: a key of `OBJECTIVES`.
        tension: largest tension allowed [N], or infinite.
        rate: fastest change of a rest length allowed [m/s], or infinite.
        weights: for a compromise, an origin and a factor for the score for translation, and both for the cost of
            transport: the smaller of (score - origin) * factor counts. None for a single objective.
        target: for "screw", dx, dy [m], dyaw [rad], and the length by which an angle becomes a distance [m].
        resolution: of the score, the tolerance of a body in the plane [unit of the score]; 0 for exact scores.
        towards: in the plane, the direction in which a gain counts, from +x or the heading of a body that turns [rad].
        periods: on patches of ground, number of periods from the start whose mean counts.
    """

    objective: str
    tension: float = math.inf
    rate: float = math.inf
    weights: tuple[tuple[float, float], tuple[float, float]] | None = None
    target: tuple[float, float, float, float] | None = None
    resolution: float = 0.0
    towards: float = 0.0
    periods: int = DEFAULT_PERIODS

    def scores(self, regime: Regime | None) -> list[float]:
        """Compute the scores of a candidate, the larger the better; the least of them counts.

        Args:
            regime: its periodic regime; None if it cannot be followed.

        Returns:
            One score, two for a compromise. A candidate outside of the limits scores below all others.
        """
        count = 1 if self.weights is None else 2
        if regime is None:
            return [-1e6 * WORST] * count
        excess = self.excess(regime)
        if excess > 0.0:
            return [-WORST * (1.0 + excess)] * count
        if self.weights is None:
            value = -self.distance(regime) if self.target is not None else score(self.objective, regime)
            return [self.resolution * round(value / self.resolution) if self.resolution else value]
        pair = score("translation", regime), score("cost-of-transport", regime)
        return [(value - origin) * factor for (origin, factor), value in zip(self.weights, pair, strict=True)]

    def distance(self, regime: Regime) -> float:
        """Compute how far the motion of a period is from the target.

        Args:
            regime: a regime of a body that turns.

        Returns:
            |(dx, dy, length * dyaw) - target| [m].
        """
        assert self.target is not None
        assert regime.motion is not None
        dx, dy, dyaw = (reached - wanted for reached, wanted in zip(regime.motion, self.target[:3], strict=True))
        return math.hypot(dx, dy, self.target[3] * dyaw)

    def progress(self, regime: Regime) -> float:
        """Compute how far a gait moves as it should; a gait that does not has failed.

        Returns:
            The gain [m], the turn to the left [rad], or by how much the motion is nearer to the target than none [m].
        """
        if self.target is not None:
            dx, dy, dyaw, length = self.target
            return math.hypot(dx, dy, length * dyaw) - self.distance(regime)
        return score("turn" if self.objective == "turn" else "translation", regime)

    def measure(self, regime: Regime) -> float:
        """Compute what the objective is named after.

        Returns:
            As `measure`; for "screw" the distance from the target [m].
        """
        return self.distance(regime) if self.target is not None else measure(self.objective, regime)

    def excess(self, regime: Regime) -> float:
        """Compute how far a candidate is outside of the limits.

        Returns:
            The larger of both excesses, relative to its limit [1]; 0 within rounding of them.
        """
        peak = regime.peak / self.tension - 1.0 if math.isfinite(self.tension) else 0.0
        speed = regime.speed / self.rate - 1.0 if math.isfinite(self.rate) else 0.0
        return max(peak, speed) if max(peak, speed) > 1e-9 else 0.0

    def derivatives(self, found: RegimeDerivatives) -> list[tuple[float, np.ndarray]]:
        """Differentiate the scores.

        Args:
            found: a regime with derivatives.

        Returns:
            Each score and its derivatives, shape (P,).
        """
        if self.weights is None:
            return [_derivative(self.objective, found)]
        pair = _derivative("translation", found), _derivative("cost-of-transport", found)
        return [
            ((value - origin) * factor, factor * slope)
            for (origin, factor), (value, slope) in zip(self.weights, pair, strict=True)
        ]


def score(objective: str, regime: Regime) -> float:
    """Compute the score of a regime for one objective.

    Returns:
        The gain [m]; the turn [rad]; gain / travel [1]; or for the cost of transport the angle between 0 and pi of
        which it is the cotangent, which is continuous where the gain or the work passes through zero; negative for
        negative gains.
    """
    if objective == "translation":
        return regime.gain
    if objective == "turn":
        assert regime.motion is not None
        return regime.motion[2]
    if objective == "travel":
        return regime.gain / regime.travel if regime.travel > 0.0 else 0.0
    return math.atan2(regime.gain * regime.force, regime.work) if _moves(regime) else 0.0


def _moves(regime: Regime) -> bool:
    """Determine whether a gain is more than what a transient leaves: a body at rest has no cost of transport."""
    return regime.settled and abs(regime.gain) > LEAST_GAIN * max(regime.travel, 1e-300)


def _derivative(objective: str, found: RegimeDerivatives) -> tuple[float, np.ndarray]:
    regime = found.regime
    value = score(objective, regime)
    if objective == "translation":
        return value, found.gain
    if objective == "travel":
        if regime.travel == 0.0:
            return value, np.zeros(found.gain.size)
        return value, (found.gain - value * found.travel) / regime.travel
    useful = regime.gain * regime.force
    size = useful**2 + regime.work**2
    if not _moves(regime) or size == 0.0:
        return value, np.zeros(found.gain.size)
    slope = regime.work * (found.gain * regime.force + regime.gain * found.force) - useful * found.work
    return value, slope / size


def measure(objective: str, regime: Regime) -> float:
    """Compute what an objective is named after.

    Returns:
        Gain [m], turn [rad], cost of transport [1] or gain / travel [1]; NaN for the cost of a body that does not
        travel.
    """
    if objective != "cost-of-transport":
        return score(objective, regime)
    useful = abs(regime.gain) * regime.force
    return regime.work / useful if _moves(regime) and useful > 0.0 else math.nan


def best_first(values: ArrayLike) -> np.ndarray:
    """Sort scores; equal ones keep their order.

    Args:
        values: the scores.

    Returns:
        Indices, best first.
    """
    return np.argsort(-np.asarray(values), kind="stable")
