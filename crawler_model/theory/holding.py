"""The limits of a body at rest: the steepest slope and the largest tow before it runs away.

A connected body has an equilibrium under loads f if and only if -sum mu_minus <= sum f <= sum mu_plus: springs carry
what one contact cannot hold to another one that can.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..body.body import Body
from ..body.ground import Ground


@dataclass(frozen=True)
class Holding:
    """The limits of rest.

    Attributes:
        tow_forward: largest force towards +x, at any contact, beside the loads that there are [N].
        tow_backward: largest force towards -x, likewise [N].
        uphill: steepest slope, uphill towards +x, on which the body does not slide back [rad]; None without weights.
        downhill: steepest slope, downhill towards +x, on which it does not slide forward, a positive angle [rad]; None
            without weights.
        first_forward: the contact that first reaches its bound when all contacts are pushed forward in proportion to
            their weights (without weights, alike).
        first_backward: the same backward.
    """

    tow_forward: float
    tow_backward: float
    uphill: float | None
    downhill: float | None
    first_forward: int
    first_backward: int


def compute_holding(
    body: Body,
    ground: Ground,
    tension: np.ndarray,
    forward: np.ndarray,
    backward: np.ndarray,
    load: np.ndarray,
) -> Holding:
    """Compute what a body at rest holds.

    Args:
        body: a body on a line.
        ground: its ground.
        tension: T, shape (S,) [N].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].
        load: f, the slope's share included, shape (N,) [N].

    Returns:
        The limits. Friction by coefficient: W sin(theta) - P = M cos(theta) with M the sum of coefficient times weight
        and P the sum of the other loads; friction as forces: W sin(theta) - P = sum mu.
    """
    total = float(load.sum())
    weight = float(ground.weight.sum())
    others = total + weight * math.sin(ground.slope)
    uphill = downhill = None
    if weight > 0.0:
        tilt = math.cos(ground.slope)
        uphill = _steepest(weight, others, float(backward.sum()), tilt if ground.by_coefficient else None)
        downhill = _steepest(weight, -others, float(forward.sum()), tilt if ground.by_coefficient else None)
    g = body.spring_force(tension) + load
    push = ground.weight if weight > 0.0 else np.ones(body.contacts)
    with np.errstate(divide="ignore"):
        first_forward = int(np.argmin((forward - g) / push))
        first_backward = int(np.argmin((backward + g) / push))
    return Holding(
        float(forward.sum()) - total, float(backward.sum()) + total, uphill, downhill, first_forward, first_backward
    )


def _steepest(weight: float, helping: float, friction: float, tilt: float | None) -> float:
    """Solve weight sin(theta) - helping = friction, which with a tilt is friction cos(theta) / tilt; at most pi / 2."""
    if tilt is None:
        sine = (helping + friction) / weight
        return math.copysign(math.pi / 2.0, sine) if abs(sine) >= 1.0 else math.asin(sine)
    held = friction / tilt
    reach = math.hypot(weight, held)
    if abs(helping) >= reach:
        return math.copysign(math.pi / 2.0, helping)
    return min(math.atan2(held, weight) + math.asin(helping / reach), math.pi / 2.0)
