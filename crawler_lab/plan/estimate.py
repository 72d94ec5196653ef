"""Friction factors and loads under which the model repeats the motion of the last seconds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crawler_model.errors import CommandError

from .robot import Robot

_STEPS = 3
_NOISE = 1e-4
"""Error of a measured displacement, at least [m]."""
_LEAST, _MOST = 0.2, 5.0
"""Bounds of friction factors [1]."""
_ENOUGH = 0.01
"""A step this long, in standard deviations of what is expected, is none [1]."""
_PARTS = (1.0, 0.5, 0.1)
"""Parts of a step that are tried in turn [1]."""


@dataclass(frozen=True, eq=False)
class Window:
    """What was seen of a body: where it was, and the rest lengths and angles in between.

    Attributes:
        x: displacements, shape (T, N), in the plane (T, N, 2) [m].
        before: rest lengths and angles in force at the first of them, shape (J,) [m, rad].
        rows: rest lengths and angles that were reached one after another since, shape (V, J) [m, rad].
        at: after how many of them each further displacement was measured, increasing, shape (T - 1,).
    """

    x: np.ndarray
    before: np.ndarray
    rows: np.ndarray
    at: np.ndarray


def estimate(robot: Robot, window: Window, factors: np.ndarray, noise: float = _NOISE) -> np.ndarray:
    """Improve friction factors and loads by Gauss-Newton steps along derivatives.

    Args:
        robot: the body.
        window: what was seen of it.
        factors: the factors so far, see `Robot.nominal`, shape (P,).
        noise: error of a measured displacement [m].

    Returns:
        The factors, as far as possible as they are without load and with the friction of the scene, shape (P,).
    """

    def residuals(now: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.concatenate(((x[window.at - 1] - window.x[1:]).ravel() / noise, robot.prior @ (now - robot.nominal)))

    def compute_cost(now: np.ndarray) -> float:
        try:
            x = robot.begin(window.x[0], window.before, now).follow(window.rows)
        except CommandError:
            return np.inf
        return float(np.square(residuals(now, x)).sum())

    cost = compute_cost(factors)
    for _ in range(_STEPS):
        try:
            x, dx = robot.differentiate_factors(window.x[0], window.before, window.rows, factors)
        except CommandError:
            break
        slope = np.vstack((dx[window.at - 1].reshape(-1, factors.size) / noise, robot.prior))
        step = np.linalg.lstsq(slope, -residuals(factors, x))[0]
        if np.linalg.norm(robot.prior @ step) < _ENOUGH:
            break
        for part in _PARTS:
            other = factors + part * step
            other[: robot.frictions] = np.clip(other[: robot.frictions], _LEAST, _MOST)
            if (cost_of_other := compute_cost(other)) < cost:
                factors, cost = other, cost_of_other
                break
        else:
            break
    return factors
