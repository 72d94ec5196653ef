"""Friction factors and loads under which the model repeats the motion of the last seconds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crawler_model.errors import CommandError

from .robot import Robot, Start

_STEPS = 3
_NOISE = 1e-4
"""Error of a measured displacement, at least [m]."""
_SPREAD = 0.3
"""Standard deviation of friction factors before anything was seen [1]."""
_ALIKE = 0.1
"""The same of the difference of both: what changes friction one way mostly changes it the other way, too [1]."""
_LOAD = 0.03
"""The same of the load on a contact, as a part of its mean friction [1]; small, so that friction explains what both
would."""
_LEAST, _MOST = 0.2, 5.0
"""Bounds of friction factors [1]."""
_PARTS = (1.0, 0.5, 0.1)
"""Parts of a step that are tried in turn [1]."""


@dataclass(frozen=True, eq=False)
class Window:
    """What was seen of a body: where it was, and the rest lengths in between.

    Attributes:
        x: displacements, shape (T, N) [m].
        before: rest lengths in force at the first of them, shape (S,) [m].
        rows: rest lengths that were reached one after another since, shape (V, S) [m].
        at: after how many of them each further displacement was measured, increasing, shape (T - 1,).
    """

    x: np.ndarray
    before: np.ndarray
    rows: np.ndarray
    at: np.ndarray


def estimate(robot: Robot, window: Window, factors: np.ndarray, noise: float = _NOISE) -> np.ndarray:
    """Improve friction factors and loads by Gauss-Newton steps along exact derivatives.

    Args:
        robot: the body.
        window: what was seen of it.
        factors: the factors so far, see `Robot.nominal`, shape (2 + N,).
        noise: error of a measured displacement [m].

    Returns:
        The factors, as far as possible as they are without load and with the friction of the scene, shape (2 + N,).
    """
    friction = float(np.abs(robot.bounds_by_factors[:, :2]).sum() / (2 * robot.contacts))
    spread = np.concatenate(([_SPREAD, _SPREAD], np.full(robot.contacts, _LOAD * friction)))
    alike = np.append([1.0, -1.0], np.zeros(robot.contacts)) / _ALIKE
    prior = np.vstack((np.diag(1.0 / spread), alike))

    def residuals(now: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.concatenate(((x[window.at - 1] - window.x[1:]).ravel() / noise, prior @ (now - robot.nominal)))

    def compute_cost(now: np.ndarray) -> float:
        try:
            x = robot.begin(window.x[0], window.before, now).follow(window.rows)
        except CommandError:
            return np.inf
        return float(np.square(residuals(now, x)).sum())

    cost = compute_cost(factors)
    for _ in range(_STEPS):
        start = robot.begin(window.x[0], window.before, factors)
        try:
            x, dx = start.differentiate(window.rows, _differentiate_targets(start, window.rows.shape[0]))
        except CommandError:
            break
        slope = np.vstack((dx[window.at - 1].reshape(-1, factors.size) / noise, prior))
        step = np.linalg.lstsq(slope, -residuals(factors, x))[0]
        for part in _PARTS:
            other = factors + part * step
            other[:2] = np.clip(other[:2], _LEAST, _MOST)
            if (cost_of_other := compute_cost(other)) < cost:
                factors, cost = other, cost_of_other
                break
        else:
            break
    return factors


def _differentiate_targets(start: Start, count: int) -> np.ndarray:
    """Differentiate the targets of a path with respect to the factors, shape (1 + V, S + 2 N, 2 + N)."""
    robot = start.robot
    by = np.zeros((count + 1, start.target.size, 2 + robot.contacts))
    by[:, robot.springs :] = robot.bounds_by_factors
    by[0, robot.springs :][start.target[robot.springs :] != start.held] = 0.0
    return by
