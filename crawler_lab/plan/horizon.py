"""Plans over a receding horizon: Gauss-Newton steps within bounds along derivatives, from the best start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from crawler_model.errors import CommandError

from .gaits import list_gaits
from .limits import Limits
from .robot import Start

_ITERATIONS = 4
_ENOUGH = 1e-3
"""Part of the cost by which a step has to lower it, or the plan has converged [1]."""
_ROUNDING = 1e-10
"""Part of the largest bound by which sides may be exceeded [1]."""
_DAMPING = 1e-4
"""Weight of the change of a plan in a step, relative to the largest curvature of its cost [1]."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A path to follow from a state, over H steps.

    Attributes:
        start: the state.
        limits: of the commands.
        wanted: place wanted at the end of each step, shape (H, D) [m, rad].
    """

    start: Start
    limits: Limits
    wanted: np.ndarray

    @property
    def before(self) -> np.ndarray:
        """Rest lengths and angles at the start, shape (J,) [m, rad]."""
        return self.start.before

    def residuals(self, places: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Compute the residuals whose squares are the cost: errors, then efforts, shape (H D + H J,) [m]."""
        changes = np.diff(np.vstack((self.before, rows)), axis=0)
        robot = self.start.robot
        errors = robot.scale * robot.miss(places, self.wanted)
        return np.concatenate((errors.ravel(), self.limits.effort * changes.ravel()))

    def cost(self, rows: np.ndarray) -> float:
        """Compute the cost of a plan [m^2]; infinite if it cannot be followed."""
        try:
            places = self.start.robot.locate(self.start.follow(rows))
        except CommandError:
            return np.inf
        return float(np.square(self.residuals(places, rows)).sum())

    def rests(self, rows: np.ndarray) -> bool:
        """Return whether a plan moves no contact."""
        try:
            return bool((self.start.follow(rows) == self.start.x).all())
        except CommandError:
            return True

    def improve(self, rows: np.ndarray, damping: float) -> np.ndarray:
        """Take one Gauss-Newton step, exactly within the limits.

        Args:
            rows: a plan, shape (H, J) [m, rad].
            damping: weight of the change of the plan, see `_DAMPING` [1].

        Returns:
            The changed plan, shape (H, J) [m, rad].

        Raises:
            CommandError: if a ramp of the plan has no derivatives.
        """
        moved = np.flatnonzero(self.limits.high > self.limits.low)
        count, springs = rows.shape
        size = count * moved.size
        places, slope = self.start.differentiate_places(rows, moved)
        slope = (self.start.robot.scale[:, None] * slope).reshape(-1, size)
        changes = (np.eye(count) - np.eye(count, k=-1))[:, None, :, None] * np.eye(moved.size)[None, :, None, :]
        changes = changes.reshape(size, size)
        residuals, errors = self.residuals(places, rows), slope.shape[0]
        efforts = residuals[errors:].reshape(count, springs)[:, moved].ravel()
        matrix = np.vstack((slope, self.limits.effort * changes))
        matrix = np.vstack((matrix, np.sqrt(damping) * np.linalg.norm(matrix, 2) * np.eye(size)))
        right = -np.concatenate((residuals[:errors], efforts, np.zeros(size)))
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
    miss, chosen = np.zeros(free.size), np.zeros(left.size, np.bool_)
    rounding = _ROUNDING * np.abs(left).max()
    while (
        beyond := (turned @ miss < left - rounding) & ~chosen
    ).any():  # few sides matter, and `nnls` is slow with many
        chosen |= beyond
        system = np.vstack((turned[chosen].T, left[chosen]))
        weights, _ = nnls(system, np.append(np.zeros(free.size), 1.0), maxiter=10 * left.size)
        found = system @ weights
        miss = found[:-1] / (1.0 - found[-1])
    return np.linalg.solve(triangle, free + miss)


def find_plan(problem: Problem, last: np.ndarray, stop: Callable[[], bool] = lambda: False) -> np.ndarray:
    """Find a plan: from the last one or, where that is worse or rests, from the best phase of a gait.

    Args:
        problem: what to follow, from which state.
        last: the last plan, shifted by what has been done of it, shape (H, J) [m, rad].
        stop: whether no time is left, which is asked between steps; the best plan so far is the result.

    Returns:
        Rest lengths and angles at the ends of the steps, shape (H, J) [m, rad].
    """
    best = problem.limits.keep(problem.before, last)
    cost = problem.cost(best)
    gait, cost_of_gait = best, np.inf
    for start in list_gaits(problem.start, problem.limits, problem.wanted.shape[0]):
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
