"""Intervals by the likelihood: where the residuals have creases, derivatives would make them too narrow."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..fit.fit import Fit, compute_step
from ..fit.problem import Problem
from ..sensor.noise import find_quantile

_ENOUGH = 0.5
"""Part of the expected increase of the sum of squares at the end of an interval that confirms it."""
_WIDER, _MUCH_WIDER = 1.5, 4.0
_MOST, _FAR = 8, 24
"""Steps of each kind: just after a jump of the body a derivative may be so large that the residuals grow only millions
of its half widths away."""
_NULL = 1e-12


def find_intervals(
    problem: Problem, fit: Fit, free: list[int], covariance: np.ndarray, freedom: float, weak: set[int]
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Compute the ends of all 95 % intervals.

    Args:
        free: the parameters that move.
        weak: which of them are not determined.

    Returns:
        Lower and upper half widths for the coordinates of the parameters, each of shape (P,); inf where nothing shows
        an end; and whether Ctrl-C ended the search for ends. Half widths behind it, and of large recordings, follow
        only from the derivatives.
    """
    count = problem.space.origin.size
    unknown = [*free, *range(count, problem.count)]
    held = np.ones(problem.count, np.bool_)
    held[unknown] = False
    low, high = np.full(count, np.inf), np.full(count, np.inf)
    if not free:
        return low, high, False
    quantile = find_quantile(freedom)
    part = fit.mean_jacobian[:, unknown]
    size = np.linalg.norm(part, axis=0)
    size[size == 0.0] = 1.0
    plain = np.diag(np.linalg.pinv((part / size).T @ (part / size), rcond=_NULL, hermitian=True)) / size**2
    shown = [p for p in free if p not in weak]
    low[shown] = high[shown] = quantile * np.sqrt(np.diag(covariance)[shown])
    try:
        for k, p in ((k, p) for k, p in enumerate(free) if p not in weak):
            width = low[p]
            if 0.0 < width < np.inf and not problem.is_large:
                direction = covariance[:, p] / covariance[p, p]
                expected = quantile**2 * max(1.0, covariance[p, p] / plain[k])
                low[p] = _find_end(problem, fit, held, p, -direction, width, expected)
                high[p] = _find_end(problem, fit, held, p, direction, width, expected)
    except KeyboardInterrupt:
        return low, high, True
    return low, high, False


def find_interval_of_sum(
    problem: Problem, fit: Fit, fixed: set[int], covariance: np.ndarray, freedom: float, gradient: np.ndarray
) -> tuple[float, float]:
    """Compute the ends of the 95 % interval of a combination of parameters.

    Args:
        fixed: parameters that keep their values.
        gradient: of the combination with respect to the coordinates, shape (P,).

    Returns:
        Lower and upper half width; inf where nothing shows an end.
    """
    direction = covariance[:, : gradient.size] @ gradient
    variance = float(gradient @ direction[: gradient.size])
    quantile = find_quantile(freedom)
    width = quantile * float(np.sqrt(max(variance, 0.0)))
    if width == 0.0 or problem.is_large:
        return width, width
    held = np.isin(np.arange(problem.count), list(fixed))
    members = np.flatnonzero(gradient)
    along, expected = direction / variance, quantile**2 * max(1.0, fit.cost / freedom)
    low, high = (_find_end(problem, fit, held, members, side * along, width, expected) for side in (-1.0, 1.0))
    return low, high


def _find_end(
    problem: Problem, fit: Fit, held: np.ndarray, p: Any, direction: np.ndarray, width: float, expected: float
) -> float:
    """Find how far parameters can move until the residuals grow as expected, all others moving along; else inf."""
    low, high = problem.bounds
    for k in range(_MOST + _FAR):
        moved = np.clip(fit.unknowns + width * direction, low, high)
        cost = _relax(problem, moved, held, p)
        if k >= _MOST:  # so far away, the others may not move in proportion
            alone = fit.unknowns.copy()
            alone[p] = moved[p]
            cost = min(cost, _relax(problem, alone, held, p))
        if cost - fit.cost >= (_ENOUGH if k == 0 else 1.0) * expected:
            return width
        if np.any((moved[p] == low[p]) | (moved[p] == high[p])):
            break
        width *= _WIDER if k < _MOST else _MUCH_WIDER
    return np.inf


def _relax(problem: Problem, moved: np.ndarray, held: np.ndarray, p: Any) -> float:
    """Compute the sum of squares after one step of the unknowns other than given ones."""
    now = problem.compute(moved)
    if now is None:
        return np.inf
    others = held.copy()
    others[p] = True
    step = compute_step(now, moved, others, problem.bounds)
    then = problem.compute(np.clip(moved + step, *problem.bounds))
    return now.cost if then is None else min(now.cost, then.cost)
