"""Least squares over the unknowns, from several starts, within bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from crawler_model.errors import CrawlerError

from .misfit import measure_misfit
from .problem import Problem, Residuals
from .starts import generate_starts, kick, reach_held

_NOTHING = 1e-10
"""A column below this part of the largest one is zero."""
_NULL = 1e-13
"""An eigenvalue of the normal matrix below this part of the largest one is zero."""
_SHORTEST = 1e-16
_DAMPING = 1e-4
_HARDER = 20.0
_MOST_DAMPING = 1e2
_SAME_MINIMUM = 2e-3
"""Part by which the sums of squares at the ends of two starts may differ if they ended at the same minimum."""
AGREE = 2
"""Unrelated starts that end at the best minimum until it is taken for the global one."""
_FITS, _NEARLY = 1.1, 1.5
"""Residuals of at most this many times the noise are noise; or nearly, if unrelated starts agree."""
_CLEAR = 100.0
"""Decrease of the sum of squares, in units of its mean, that neither noise nor the rounding of pixels explains."""
_REFITS = (3, 2)
_TRIES = 40
"""Evaluations for each start."""
_PATIENT = 200
"""Evaluations for the best of the starts."""
_SLOW = 1e-2
"""Relative decrease of the sum of squares below which a start leads nowhere."""
_EXACT = 0.05
"""Whitened residuals whose mean square is below this are rounding."""
_ROUGH = 1e-4
"""The same for a large recording before its noise is estimated."""
_SETTLED = (1e-2, 1e-1)
"""Decreases of the sum of squares, in units of the noise, that no interval shows; for large recordings the second."""


@dataclass(frozen=True)
class Fit:
    """The end of a fit.

    Attributes:
        unknowns: shape (U,).
        cost: sum of squares of the whitened residuals [1].
        residuals: there.
        mean_jacobian: derivatives averaged over the posterior, because the residuals have creases at its scale, shape
            (R, U).
        spread: covariance of other minima that fit nearly as well, shape (U, U).
        interrupted: whether Ctrl-C ended the search before all starts were tried.
        starts: number of starts tried.
        reached: how many of them ended at this minimum.
    """

    unknowns: np.ndarray
    cost: float
    residuals: Residuals
    mean_jacobian: np.ndarray
    spread: np.ndarray
    interrupted: bool = False
    starts: int = 1
    reached: int = 1


def fit_from(
    problem: Problem, start: np.ndarray, held: np.ndarray, tight: bool, most: int = 60, part: float = 0.0
) -> Fit | None:
    """Minimise the residuals from one start, by the method of Levenberg and Marquardt.

    Steps have no part in null directions of the Jacobian, so that what is not determined keeps its start value.

    Args:
        start: unknowns, shape (U,).
        held: unknowns that keep their start value, bool, shape (U,).
        tight: whether to converge to rounding.
        most: largest number of evaluations.
        part: relative decrease of the sum of squares that is not worth another evaluation [1].

    Returns:
        The fit; None if no motion exists at the start.
    """
    low, high = problem.bounds
    unknowns = np.clip(start, low, high)
    now = problem.compute(unknowns)
    if now is None:
        return None
    cost, damping, quiet, refused = now.cost, 0.0, 0, False
    patience = 3 if not tight else 1 if problem.is_large else 2
    for _ in range(most):
        step = compute_step(now, unknowns, held, problem.bounds, damping)
        exact = tight and cost < _EXACT * now.fitted.size
        enough = 1e-13 * cost if exact else _SETTLED[problem.is_large] if tight else _SLOW * cost
        enough = max(enough, part * cost)
        if patience == 1 and damping == 0.0 and -float(now.fitted @ (now.jacobian @ step)) <= enough:
            break
        moved = np.clip(unknowns + step, low, high)
        if np.abs(moved - unknowns).max(initial=0.0) <= _SHORTEST * (1.0 + np.abs(unknowns).max(initial=0.0)):
            break
        then = problem.compute(moved)
        later = np.inf if then is None else then.cost
        if then is None or not later < cost:
            damping, refused = max(_HARDER * damping, _DAMPING), True
            if damping > _MOST_DAMPING:
                break
            continue
        quiet = quiet + 1 if cost - later <= enough else 0
        unknowns, now, cost = moved, then, later
        if not refused:
            damping = damping / _HARDER if damping > _DAMPING else 0.0
        refused = False
        if quiet == patience:
            break
    return Fit(unknowns, cost, now, now.jacobian, np.zeros((unknowns.size, unknowns.size)))


def compute_step(
    now: Residuals,
    unknowns: np.ndarray,
    held: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    damping: float = 0.0,
) -> np.ndarray:
    """Compute a damped Gauss-Newton step of the unknowns that are neither held nor pushed out of their bounds.

    Args:
        now: residuals and their derivatives.
        unknowns: where they are, shape (U,).
        held: unknowns that keep their values, bool, shape (U,).
        bounds: lower and upper bounds of the unknowns, each of shape (U,).
        damping: relative to the largest eigenvalue of the normal matrix of scaled unknowns [1].

    Returns:
        Shape (U,).
    """
    residuals, jacobian = now.fitted, now.jacobian
    low, high = bounds
    gradient = jacobian.T @ residuals
    out = ((unknowns <= low) & (gradient > 0.0)) | ((unknowns >= high) & (gradient < 0.0))
    normal = jacobian.T @ jacobian
    size = np.sqrt(np.diag(normal))
    free = np.flatnonzero(~held & ~out & (size > _NOTHING * size.max(initial=0.0)))
    step = np.zeros(unknowns.size)
    if free.size:
        values, vectors = np.linalg.eigh(normal[np.ix_(free, free)] / np.outer(size[free], size[free]))
        seen = values > max(_NULL, now.derivative_error**2) * values[-1]
        share = np.where(seen, 1.0 / np.where(seen, values + damping * values[-1], 1.0), 0.0)
        step[free] = -(vectors @ (share * (vectors.T @ (gradient[free] / size[free])))) / size[free]
    return step


def find_fit(
    problem: Problem,
    coarse: Problem,
    starts: int,
    seconds: float,
    rng: np.random.Generator,
    progress: Callable[[float], None] | None,
) -> Fit:
    """Fit from the balance of forces, the scene's values and random ones, until residuals are noise or two ends agree.

    Args:
        problem: the problem; its noise is estimated.
        coarse: the same with fewer rows, on which the starts are compared.
        starts: number of starts, unless an earlier one leads to a fit.
        seconds: work after which no more are tried if none does [s]; 0 for only the first start.
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
    ends: list[tuple[float, str]] = []
    nearby: list[np.ndarray] = []
    left = np.inf
    begin = coarse.work.done
    # starts on few rows, until a fit leaves noise alone or two independent starts end alike
    try:
        for k, (family, start) in enumerate(generate_starts(coarse, rng)):
            spent = (coarse.work.done - begin) / seconds if seconds else np.inf
            if spent >= 1.0 and (k >= starts or (seconds == 0.0 and best is not None)):
                break
            # a kick starts near the best fit, first with contacts sliding that never do in it
            if family == "kick" and best is not None:
                if best.cost < left * (1.0 - _SAME_MINIMUM):
                    left, nearby = best.cost, reach_held(coarse, best.unknowns, best.residuals.jacobian)
                start = nearby.pop() if nearby else kick(coarse, best.unknowns, rng)
            found = None if start is None else fit_from(coarse, start, held, tight=False, most=_TRIES)
            if progress is not None:
                progress(0.6 * min((k + 1) / starts, max(spent, 0.01)))
            costs.append(np.inf if found is None else found.cost)
            if found is not None and (best is None or found.cost < best.cost):
                best = found
            if best is None:
                continue
            # is it good enough?
            ends += [] if family == "kick" else [(costs[-1], family)]  # it is related to the best
            same = {family for cost, family in ends if cost <= best.cost * (1.0 + _SAME_MINIMUM)}
            size = _find_size(coarse, best)
            # the end from the scene's values may be lower, although the end of the balance fits
            fits = size <= _FITS and (family != "balance" or seconds == 0.0 or _is_exact(best))
            if fits or (len(same) >= AGREE and size <= _NEARLY):
                break
        if seconds and best is not None and not _is_exact(best):
            best = _slide_held(coarse, best, costs)
    except KeyboardInterrupt:
        if best is None:
            raise
        interrupted = True
    if best is None:
        raise CrawlerError("identify: no motion exists at the values of the scene, nor at others within the bounds")
    # the best one on all rows, with the noise
    try:
        if coarse is not problem and not interrupted:  # to go on there costs less
            best = fit_from(coarse, best.unknowns, held, tight=True, most=_PATIENT) or best
    except KeyboardInterrupt:
        interrupted = True
    fit = _refit(problem, best.unknowns, progress, 0.0 if coarse is problem else _ROUGH)
    reached = sum(cost <= (1.0 + _SAME_MINIMUM) * best.cost for cost in costs)
    return replace(fit, interrupted=interrupted or fit.interrupted, starts=len(costs), reached=reached)


def _is_exact(fit: Fit) -> bool:
    """Tell whether the residuals are rounding."""
    return fit.cost < _EXACT * fit.residuals.fitted.size


def _slide_held(problem: Problem, best: Fit, costs: list[float]) -> Fit:
    """Let each contact slide that never does in a fit, and choose the lowest minimum; append the sums of squares."""
    for start in reach_held(problem, best.unknowns, best.residuals.jacobian):
        found = fit_from(problem, start, np.zeros(problem.count, np.bool_), tight=False, most=_TRIES)
        costs.append(np.inf if found is None else found.cost)
        if found is not None and found.cost < best.cost * (1.0 - _CLEAR / best.residuals.fitted.size):
            best = found
    return best


def _find_size(problem: Problem, fit: Fit) -> float:
    """Compute the largest residual of a channel in units of the noise [1]."""
    return max((size.ratio for size in measure_misfit(problem, fit.residuals)), default=1.0)


def _refit(problem: Problem, unknowns: np.ndarray, progress: Callable[[float], None] | None, part: float) -> Fit:
    """Fit, from unknowns at which a motion exists, and estimate the noise of the problem in turn, until Ctrl-C.

    As long as the noise is not estimated, `part` holds as for `fit_from`.
    """
    held = np.zeros(problem.count, np.bool_)
    fit: Fit | None = None
    try:
        for k in range(_REFITS[problem.is_large]):
            if fit is not None:
                problem.estimate_noise(fit.residuals)
            at, rough = (unknowns, part) if fit is None else (fit.unknowns, 0.0)
            fit = fit_from(problem, at, held, tight=True, part=rough)
            assert fit is not None
            if progress is not None:
                progress(0.6 + 0.1 * (k + 1))
    except KeyboardInterrupt:
        fit = fit or fit_from(problem, unknowns, held, tight=True, most=0)
        assert fit is not None
        return replace(fit, interrupted=True)
    assert fit is not None
    return fit
