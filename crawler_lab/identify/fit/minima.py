"""Minima near the fit: where contacts just slide, the sum of squares has creases, and neighbouring minima.

The fit moves to the lowest minimum that is found from draws around it. The others count by their likelihoods in the
covariance, and derivatives are averaged over draws of the posterior.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .fit import Fit, fit_from
from .problem import Problem

_HOPS, _AVERAGED = (8, 0), (8, 3)
"""Draws of starts, and of derivatives; for large recordings fewer."""
_FAR = (1.0, 3.0)
"""Standard deviations of the draws, in units of the posterior's."""
_STEPS = 15
_LOWER = 1e-3
_NOTHING = 1e-10
_WELL = 1e-6
"""Eigenvalues of the normal matrix below this part of the largest one belong to directions that nothing determines."""
_WIDEST = 0.3
"""Largest step of a draw, of a logarithm or relative to the scale of the parameter."""


def explore_minima(problem: Problem, fit: Fit, rng: np.random.Generator) -> Fit:
    """Fit again from draws around a fit.

    Returns:
        The lowest minimum, with the spread of the others.
    """
    held = np.zeros(problem.count, np.bool_)
    minima = [(fit.unknowns, fit.cost)]
    best = fit
    for k in range(_HOPS[problem.is_large]):
        start = _draw(problem, best, held, _FAR[k % len(_FAR)], rng)
        found = fit_from(problem, start, held, tight=True, most=_STEPS)
        if found is None:
            continue
        minima.append((found.unknowns, found.cost))
        if found.cost < best.cost - _LOWER:
            best = found
    spread, total = np.zeros(fit.spread.shape), 0.0
    for unknowns, cost in minima:
        weight = float(np.exp(-0.5 * max(cost - best.cost, 0.0)))
        apart = unknowns - best.unknowns
        spread += weight * np.outer(apart, apart)
        total += weight
    return replace(best, spread=spread / total)


def _draw(problem: Problem, fit: Fit, held: np.ndarray, far: float, rng: np.random.Generator) -> np.ndarray:
    """Draw unknowns around a fit, shape (U,)."""
    jacobian = fit.mean_jacobian
    size = np.linalg.norm(jacobian, axis=0)
    free = np.flatnonzero(~held & (size > _NOTHING * size.max(initial=0.0)))
    if free.size == 0:  # the motion depends on none of them
        return fit.unknowns.copy()
    scaled = jacobian[:, free] / size[free]
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    half = vectors * np.where(values > _WELL * values[-1], 1.0 / np.sqrt(np.maximum(values, 1e-300)), 0.0)
    moved = fit.unknowns.copy()
    moved[free] += np.clip(far * (half @ rng.normal(size=values.size)) / size[free], -_WIDEST, _WIDEST)
    return np.clip(moved, *problem.bounds)


def average_derivatives(problem: Problem, fit: Fit, held: np.ndarray, rng: np.random.Generator) -> Fit:
    """Average the derivatives over draws of the posterior.

    Args:
        held: unknowns that keep their values, bool, shape (U,).

    Returns:
        The fit with these derivatives.
    """
    total, count = fit.residuals.jacobian.copy(), 1
    for _ in range(_AVERAGED[problem.is_large]):
        then = problem.compute(_draw(problem, fit, held, 1.0, rng))
        if then is not None:
            total += then.jacobian
            count += 1
    return replace(fit, mean_jacobian=total / count)
