"""Plans over a receding horizon: Gauss-Newton steps within bounds along exact derivatives, from the best start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from crawler_model.errors import CommandError

from .robot import Start

_ITERATIONS = 4
_ENOUGH = 1e-3
"""Part of the cost by which a step has to lower it, or the plan has converged [1]."""
_DAMPING = 1e-4
"""Weight of the change of a plan in a step, relative to the largest curvature of its cost [1]."""
_PHASES = 8
_STROKES = (0.25, 0.5, 1.0)
"""Parts of the stroke of the gaits from which plans may start [1]."""


@dataclass(frozen=True, eq=False)
class Limits:
    """What commands may do, and what they cost.

    Attributes:
        low: least rest length of each link, shape (S,) [m].
        high: largest one; equal for links that do not move, shape (S,) [m].
        change: largest change of each in a step, shape (S,) [m].
        effort: error that costs as much as an equal change of one rest length in one step [1].
    """

    low: np.ndarray
    high: np.ndarray
    change: np.ndarray
    effort: float

    def keep(self, before: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Move a plan into the limits, step by step.

        Args:
            before: rest lengths at the start, shape (S,) [m].
            rows: rest lengths at the ends of H steps, shape (H, S) [m].

        Returns:
            The plan, shape (H, S) [m].
        """
        kept = np.empty(rows.shape)
        for k, row in enumerate(rows):
            low, high = np.maximum(self.low, before - self.change), np.minimum(self.high, before + self.change)
            before = kept[k] = np.maximum(np.minimum(row, high), np.minimum(low, high))
        return kept


@dataclass(frozen=True, eq=False)
class Problem:
    """A path to follow from a state, over H steps.

    Attributes:
        start: the state.
        limits: of the commands.
        wanted: net translation wanted at the end of each step, shape (H,) [m].
    """

    start: Start
    limits: Limits
    wanted: np.ndarray

    @property
    def before(self) -> np.ndarray:
        """Rest lengths at the start, shape (S,) [m]."""
        return self.start.target[: self.start.robot.springs]

    def residuals(self, x: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Compute the residuals whose squares are the cost: errors, then efforts, shape (H + H S,) [m]."""
        changes = np.diff(np.vstack((self.before, rows)), axis=0)
        return np.concatenate(
            (x @ self.start.robot.scene.body.share - self.wanted, self.limits.effort * changes.ravel())
        )

    def cost(self, rows: np.ndarray) -> float:
        """Compute the cost of a plan [m^2]; infinite if it cannot be followed."""
        try:
            return float(np.square(self.residuals(self.start.follow(rows), rows)).sum())
        except CommandError:
            return np.inf

    def rests(self, rows: np.ndarray) -> bool:
        """Return whether a plan moves no contact."""
        try:
            return bool((self.start.follow(rows) == self.start.x).all())
        except CommandError:
            return True

    def improve(self, rows: np.ndarray, damping: float) -> np.ndarray:
        """Take one Gauss-Newton step, exactly within the limits.

        Args:
            rows: a plan, shape (H, S) [m].
            damping: weight of the change of the plan, see `_DAMPING` [1].

        Returns:
            The changed plan, shape (H, S) [m].

        Raises:
            CommandError: if a ramp of the plan has no derivatives.
        """
        moved = np.flatnonzero(self.limits.high > self.limits.low)
        count, springs = rows.shape
        size = count * moved.size
        by = np.zeros((count + 1, self.start.target.size, count, moved.size))
        by[np.arange(1, count + 1)[:, None], moved, np.arange(count)[:, None], np.arange(moved.size)] = 1.0
        x, dx = self.start.differentiate(rows, by.reshape(count + 1, -1, size))
        changes = (np.eye(count) - np.eye(count, k=-1))[:, None, :, None] * np.eye(moved.size)[None, :, None, :]
        changes = changes.reshape(size, size)
        residuals = self.residuals(x, rows)
        efforts = residuals[count:].reshape(count, springs)[:, moved].ravel()
        slope = np.einsum("n,knp->kp", self.start.robot.scene.body.share, dx)
        matrix = np.vstack((slope, self.limits.effort * changes))
        matrix = np.vstack((matrix, np.sqrt(damping) * np.linalg.norm(matrix, 2) * np.eye(size)))
        right = -np.concatenate((residuals[:count], efforts, np.zeros(size)))
        now = rows[:, moved].ravel()
        begin = np.concatenate((self.before[moved], np.zeros(size - moved.size)))
        low, high = (np.tile(bound[moved], count) for bound in (self.limits.low, self.limits.high))
        step, most = changes @ now - begin, np.tile(self.limits.change[moved], count)
        sides = np.vstack((np.eye(size), -np.eye(size), changes, -changes))
        least = np.concatenate((low - now, now - high, -most - step, step - most))
        found = rows.copy()
        found[:, moved] += solve_within(matrix, right, sides, least).reshape(count, -1)
        return self.limits.keep(self.before, found)


def solve_within(matrix: np.ndarray, right: np.ndarray, sides: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Solve a least-squares problem with inequalities as one of least distance, by non-negative least squares.

    Args:
        matrix: of full column rank, shape (R, P).
        right: shape (R,).
        sides: shape (I, P).
        least: lower bounds of sides @ d, shape (I,).

    Returns:
        The d with the least |matrix @ d - right|, shape (P,).

    Source: Lawson and Hanson, Solving Least Squares Problems, chapter 23.
    """
    orthogonal, triangle = np.linalg.qr(matrix)
    free = orthogonal.T @ right
    turned = np.linalg.solve(triangle.T, sides.T).T
    left = least - turned @ free
    if (left <= 0.0).all():
        return np.linalg.solve(triangle, free)
    system = np.vstack((turned.T, left))
    weights, _ = nnls(system, np.append(np.zeros(free.size), 1.0), maxiter=10 * left.size)
    miss = system @ weights
    miss[-1] -= 1.0
    return np.linalg.solve(triangle, free - miss[:-1] / miss[-1])


def find_plan(problem: Problem, last: np.ndarray, stop: Callable[[], bool] = lambda: False) -> np.ndarray:
    """Find a plan: from the last one or, where that is worse or rests, from the best phase of a gait.

    Args:
        problem: what to follow, from which state.
        last: the last plan, shifted by what has been done of it, shape (H, S) [m].
        stop: whether no time is left, which is asked between steps; the best plan so far is the result.

    Returns:
        Rest lengths at the ends of the steps, shape (H, S) [m].
    """
    best = problem.limits.keep(problem.before, last)
    cost = problem.cost(best)
    gait, cost_of_gait = best, np.inf
    for start in list_gaits(problem):
        if stop():
            return best
        if (other := problem.cost(start)) < cost_of_gait:
            gait, cost_of_gait = start, other
    if cost_of_gait < cost or problem.rests(best):
        start, cost_of_gait = _improve_often(problem, gait, cost_of_gait, stop)
        return start if cost_of_gait < cost else best
    return _improve_often(problem, best, cost, stop)[0]


def _improve_often(
    problem: Problem, rows: np.ndarray, cost: float, stop: Callable[[], bool]
) -> tuple[np.ndarray, float]:
    """Take steps until they help no more; return the plan and its cost."""
    damping = _DAMPING
    for _ in range(_ITERATIONS):
        if stop():
            break
        try:
            changed = problem.improve(rows, damping)
        except (CommandError, RuntimeError):  # too many events; or too many steps of `nnls`
            break
        other = problem.cost(changed)
        if other < cost:
            done = cost - other < _ENOUGH * cost
            rows, cost, damping = changed, other, 0.1 * damping
            if done:
                break
        else:
            damping *= 100.0
    return rows, cost


def list_gaits(problem: Problem) -> list[np.ndarray]:
    """List phases of gaits in which links lengthen one after another and shorten in the same order.

    Args:
        problem: what to follow.

    Returns:
        Plans within the limits, shape (H, S) each [m].
    """
    limits, count = problem.limits, problem.wanted.size
    span = limits.high - limits.low
    moved = np.flatnonzero(span > 0.0)
    found = []
    for part in _STROKES:
        steps = max(float((part * span[moved] / limits.change[moved]).max()), 0.5)  # for one stroke
        places = np.arange(2 * moved.size * _PHASES // 4) * (4.0 / _PHASES)
        for order in (moved, moved[::-1]):
            for place in places:
                turn = np.mod(place + np.arange(1, count + 1) / steps, 2.0 * moved.size)
                rows = np.tile(limits.low, (count, 1))
                for j, link in enumerate(order):
                    since = np.mod(turn - j, 2.0 * moved.size)
                    rows[:, link] += part * span[link] * np.clip(np.minimum(since, moved.size + 1.0 - since), 0.0, 1.0)
                found.append(limits.keep(problem.before, rows))
    return found
