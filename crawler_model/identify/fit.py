"""Least squares over the unknowns, from several starts, within bounds."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import CrawlerError
from .balance import estimate, see
from .noise import NoiseTest, examine_residuals
from .unknowns import Problem, Residuals

_DRAWS = 6
"""Random values that are compared for each start."""
_NOTHING = 1e-10
"""A column or singular value below this part of the largest one is zero."""
_SHORTEST = 1e-16
_DAMPING = 1e-4
_MOST_DAMPING = 1e7
_MAD = 1.4826
_SAME_MINIMUM = 1e-3
"""Part by which the sums of squares at the ends of two starts may differ if they ended at the same minimum."""
_SOFT = 2.0
"""Residuals above this many standard deviations count less in a robust fit."""


@dataclass(frozen=True)
class Fit:
    """The end of a fit.

    Attributes:
        unknowns: shape (U,).
        cost: sum of squares, or of the robust loss [m^2].
        residuals: there.
        soft: size from which residuals count less [m]; None for plain least squares.
        interrupted: whether Ctrl-C ended the search before all starts were tried.
        starts: number of starts tried.
        reached: how many of them ended at this minimum.
    """

    unknowns: np.ndarray
    cost: float
    residuals: Residuals
    soft: float | None
    interrupted: bool = False
    starts: int = 1
    reached: int = 1


def fit_from(
    problem: Problem, start: np.ndarray, held: np.ndarray, soft: float | None, tight: bool, most: int = 60
) -> Fit | None:
    """Minimise the residuals from one start, by the method of Levenberg and Marquardt.

    Steps have no part in null directions of the Jacobian, so that what is not determined keeps its start value.

    Args:
        problem: the problem.
        start: unknowns, shape (U,).
        held: unknowns that keep their start value, bool, shape (U,).
        soft: size from which residuals count less [m]; None for plain least squares.
        tight: whether to converge to rounding.
        most: largest number of evaluations.

    Returns:
        The fit; None if no motion exists at the start.
    """
    low, high = problem.bounds
    unknowns = np.clip(start, low, high)
    now = problem.compute(unknowns)
    if now is None:
        return None
    cost, damping, quiet = cost_of(now.fitted, soft), 0.0, 0
    enough = 1e-13 if tight else 1e-5
    for _ in range(most):
        step = _step(now, unknowns, held, low, high, soft, damping)
        moved = np.clip(unknowns + step, low, high)
        if np.abs(moved - unknowns).max(initial=0.0) <= _SHORTEST * (1.0 + np.abs(unknowns).max(initial=0.0)):
            break
        then = problem.compute(moved)
        later = np.inf if then is None else cost_of(then.fitted, soft)
        if then is None or not later < cost:
            damping = max(10.0 * damping, _DAMPING)
            if damping > _MOST_DAMPING:
                break
            continue
        quiet = quiet + 1 if cost - later <= enough * cost else 0
        unknowns, now, cost = moved, then, later
        damping = 0.1 * damping if damping > 1e-3 * _DAMPING else 0.0
        if quiet == 2:
            break
    return Fit(unknowns, cost, now, soft)


def _step(
    now: Residuals,
    unknowns: np.ndarray,
    held: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    soft: float | None,
    damping: float,
) -> np.ndarray:
    """Compute a damped step of the unknowns that are neither held nor pushed out of their bounds, shape (U,)."""
    weight = np.ones(now.fitted.size) if soft is None else (1.0 + (now.fitted / soft) ** 2) ** -0.25
    residuals, jacobian = weight * now.fitted, weight[:, None] * now.jacobian
    gradient = jacobian.T @ residuals
    out = ((unknowns <= low) & (gradient > 0.0)) | ((unknowns >= high) & (gradient < 0.0))
    size = np.linalg.norm(jacobian, axis=0)
    free = np.flatnonzero(~held & ~out & (size > _NOTHING * size.max(initial=0.0)))
    step = np.zeros(unknowns.size)
    if free.size:
        # the triangle of a QR decomposition is small, so that its singular values cost little
        whole = np.column_stack((jacobian[:, free] / size[free], residuals))
        triangle: Any = np.linalg.qr(whole, mode="r")
        count = min(free.size, triangle.shape[0])
        left, values, right = np.linalg.svd(triangle[:count, :-1], full_matrices=False)
        share = np.where(values > _NOTHING * values[0], values / (values**2 + damping), 0.0)
        step[free] = -(right.T @ (share * (left.T @ triangle[:count, -1]))) / size[free]
    return step


def cost_of(residuals: np.ndarray, soft: float | None) -> float:
    """Compute the sum of squares, or of the robust loss.

    Args:
        residuals: shape (R,) [m].
        soft: size from which they count less [m], or None.

    Returns:
        The sum [m^2].
    """
    if soft is None:
        return float(residuals @ residuals)
    return float(2.0 * soft**2 * (np.sqrt(1.0 + (residuals / soft) ** 2) - 1.0).sum())


def find_fit(
    problem: Problem,
    coarse: Problem,
    starts: int,
    seconds: float,
    robust: bool,
    rng: np.random.Generator,
    progress: Callable[[float], None] | None,
) -> Fit:
    """Fit from the scene's values and from random ones, improved by the balance of forces, until residuals are noise.

    Args:
        problem: the problem.
        coarse: the same with fewer rows, on which the starts are compared.
        starts: number of starts, unless an earlier one leads to a fit.
        seconds: time in which more are tried as long as none does [s].
        robust: whether outliers count less.
        rng: source of random numbers.
        progress: called with the fraction done, in [0, 1].

    Returns:
        The best fit.

    Raises:
        CrawlerError: if no motion exists at any start.
    """
    held = np.zeros(problem.count, np.bool_)
    best: Fit | None = None
    interrupted = False
    costs: list[float] = []
    begin = time.monotonic()
    spread = max(float(np.ptp(r.measured.values)) for r in problem.replicas)
    try:
        for k, start in enumerate(_starts(coarse, rng)):
            spent = (time.monotonic() - begin) / seconds if seconds else np.inf
            if k >= starts and spent >= 1.0:
                break
            found = None if start is None else fit_from(coarse, start, held, None, tight=False)
            if progress is not None:
                progress(0.8 * min((k + 1) / starts, max(spent, 0.01)))
            costs.append(np.inf if found is None else found.cost)
            if found is not None and (best is None or found.cost < best.cost):
                best = found
            rms = np.inf if best is None else np.sqrt(best.cost / best.residuals.fitted.size)
            if best is found and best is not None and (rms <= 1e-9 * spread or residuals_of(coarse, best).is_noise):
                break
    except KeyboardInterrupt:
        if best is None:
            raise
        interrupted = True
    if best is None:
        raise CrawlerError("identify: no motion exists at the values of the scene, nor at others within the bounds")
    soft = None
    unknowns = best.unknowns
    reached = sum(cost <= (1.0 + _SAME_MINIMUM) * best.cost for cost in costs)
    for _ in range(3 if robust else 0):
        soft = robust_size(problem, unknowns)
        softer = fit_from(problem, unknowns, held, soft, tight=False)
        assert softer is not None
        unknowns = softer.unknowns
    last = fit_from(problem, unknowns, held, soft, tight=True, most=40)
    assert last is not None
    return replace(last, interrupted=interrupted, starts=len(costs), reached=reached)


def robust_size(problem: Problem, unknowns: np.ndarray) -> float:
    """Estimate from which size residuals count less in a robust fit.

    Args:
        problem: the problem.
        unknowns: shape (U,), at which a motion exists.

    Returns:
        Twice the standard deviation by the median of the absolute residuals [m].
    """
    now = problem.compute(unknowns)
    assert now is not None
    spread = max(float(np.ptp(r.measured.values)) for r in problem.replicas)
    return max(_SOFT * _MAD * float(np.median(np.abs(now.fitted))), 1e-12 * spread)


def _starts(problem: Problem, rng: np.random.Generator) -> Iterator[np.ndarray | None]:
    """Generate starts without end: the balance of forces, the scene's values, then draws of both kinds in turn."""
    seen = [see(r, rows) for r, rows in zip(problem.replicas, problem.rows, strict=True) if rows.any()]
    known = [one for one in seen if one is not None]
    for k in itertools.count():
        if k == 1 or (k == 0 and len(known) < len(seen)):
            yield problem.unknowns(problem.space.origin)
            continue
        values = problem.space.origin if k == 0 else problem.space.draw(rng)
        balanced = estimate(known, problem.space, values, k > 0) if len(known) == len(seen) and k % 2 == 0 else None
        yield _draw(problem, rng) if balanced is None else problem.unknowns(balanced)


def residuals_of(problem: Problem, fit: Fit) -> NoiseTest:
    """Test whether the fitted residuals are noise.

    Args:
        problem: the problem.
        fit: its end.

    Returns:
        The result.
    """
    kept = [i for i, rows in enumerate(problem.rows) if rows.any()]
    measured = [problem.replicas[i].measured for i in kept]
    return examine_residuals(
        [m.name for m in measured],
        [m.channels for m in measured],
        [m.time[problem.rows[i]] for i, m in zip(kept, measured, strict=True)],
        [fit.residuals.all[i][problem.rows[i]] for i in kept],
        [m.values for m in measured],
    )


def _draw(problem: Problem, rng: np.random.Generator) -> np.ndarray | None:
    """Draw several values; return the unknowns with the least residuals."""
    best, least = None, np.inf
    for _ in range(_DRAWS):
        unknowns = problem.unknowns(problem.space.draw(rng))
        found = problem.compute(unknowns)
        if found is not None and cost_of(found.fitted, None) < least:
            best, least = unknowns, cost_of(found.fitted, None)
    return best
