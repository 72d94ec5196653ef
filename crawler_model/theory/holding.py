"""The limits of a body at rest: the steepest slope and the largest tow before it runs away.

A connected body has an equilibrium under loads f if and only if -sum mu_minus <= sum f <= sum mu_plus: springs
transmit to other contacts what one contact cannot hold. (Springs whose tension is limited may transmit less: then the
limits of the whole body are upper bounds.) Below this limit single contacts give way, each as soon as its load and the
force of its springs together exceed its friction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..body.body import Body
from ..body.ground import Ground


@dataclass(frozen=True)
class Tilt:
    """The limits of a body at rest when the track is tilted, uphill or downhill.

    Attributes:
        steepest: slope beyond which no equilibrium exists and the body runs away, a positive angle [rad].
        contact: the contact that gives way first.
        gives_way: slope at which it does, at most `steepest` [rad].
    """

    steepest: float
    contact: int
    gives_way: float


@dataclass(frozen=True, eq=False)
class Holding:
    """The limits of rest.

    Attributes:
        tow_forward: largest force towards +x, on any contact, in addition to the loads of the scene [N].
        tow_backward: the same towards -x [N].
        slip_forward: least force towards +x that, applied to one contact, makes this contact slide, shape (N,) [N].
        slip_backward: the same towards -x, shape (N,) [N].
        uphill: tilted until it slides back, towards -x; None without weights, and where patches have slopes of their
            own.
        downhill: tilted until it slides forward; None where `uphill` is.
    """

    tow_forward: float
    tow_backward: float
    slip_forward: np.ndarray
    slip_backward: np.ndarray
    uphill: Tilt | None
    downhill: Tilt | None


def compute_holding(
    body: Body,
    ground: Ground,
    tension: np.ndarray,
    forward: np.ndarray,
    backward: np.ndarray,
    load: np.ndarray,
) -> Holding:
    """Compute the limits of a body at rest.

    Args:
        body: a body on a line.
        ground: its ground.
        tension: T, shape (S,) [N].
        forward: mu_plus, on patches of ground at the place, shape (N,) [N].
        backward: mu_minus, of the same kind, shape (N,) [N].
        load: f, the slope's share included, shape (N,) [N].

    Returns:
        The limits.
    """
    g = body.spring_force(tension)
    plus, minus = forward - load, backward + load
    others = load - ground.slope_load
    uphill = downhill = None
    if ground.weight.any() and ground.has_one_slope:
        uphill = _tilt(ground, backward, others, g)
        downhill = _tilt(ground, forward, -others, -g)
    return Holding(float(plus.sum()), float(minus.sum()), plus - g, minus + g, uphill, downhill)


def _tilt(ground: Ground, friction: np.ndarray, others: np.ndarray, force: np.ndarray) -> Tilt:
    """Find the slope at which the whole body runs away, and the least at which a contact gives way."""
    whole = steepest_held(ground, friction, others)
    alone = [
        float(_steepest(w, p, m))
        for w, p, m in zip(*_balance(ground, friction, others + force), strict=True)
        if w > 0.0
    ]
    heavy = np.flatnonzero(ground.weight > 0.0)
    first = int(np.argmin(alone))
    return Tilt(whole, int(heavy[first]), min(alone[first], whole))


def steepest_held(ground: Ground, friction: np.ndarray, others: np.ndarray) -> float:
    """Compute the slope beyond which friction cannot hold the weights.

    Friction of coefficients is M cos(theta), friction given as forces F; with the weights W and the other loads P it
    is the solution of W sin(theta) - P = F + M cos(theta).

    Args:
        ground: weights, present slope, and which contacts have coefficients.
        friction: at the present slope, against sliding downhill, shape (N,) [N].
        others: loads besides the slope's, uphill positive, shape (N,) [N].

    Returns:
        The slope, at most pi / 2, negative if it must lean the other way [rad].
    """
    weight, helping, sliding = (float(part.sum()) for part in _balance(ground, friction, others))
    return _steepest(weight, helping, sliding)


def _balance(ground: Ground, friction: np.ndarray, helping: np.ndarray) -> tuple[np.ndarray, ...]:
    """Compute the terms of the balance on a slope: weight, constant forces, friction proportional to cos(theta)."""
    follows = ground.by_coefficient
    sliding = np.where(follows, friction, 0.0) / math.cos(ground.slope)
    return ground.weight, helping + np.where(follows, 0.0, friction), sliding


def _steepest(weight: float, helping: float, sliding: float) -> float:
    """Solve weight sin(theta) - helping = sliding cos(theta); at most pi / 2."""
    reach = math.hypot(weight, sliding)
    if abs(helping) >= reach:
        return math.copysign(math.pi / 2.0, helping)
    return min(math.atan2(sliding, weight) + math.asin(helping / reach), math.pi / 2.0)
