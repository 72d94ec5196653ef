"""One-sided bounds of parameters without effect on the motion: friction that held, limits that were not reached."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..fit.fit import Fit, fit_from
from ..fit.problem import Problem
from ..fit.starts import find_reached

_BEYOND = (1.0 - 1e-6, 0.99, 0.95, 0.85, 0.7, 0.5, 0.3)
"""Factors by which a parameter is moved beyond its bound to confirm it."""
_CHI_SQUARE = 3.84
"""95 % quantile of chi-square with one degree of freedom."""
_RELEASE = 0.25
"""Part of its value by which a limit is moved to see whether it is passed at all."""
_LUCKY = 12.0
"""Decrease of the sum of squares that a limit brings which noise seems to pass, at the best of some hundred places."""
_NEAR, _STEPS = 100.0, 10
"""Increase of the sum of squares up to which the others are fitted again where a limit is moved, and steps for that."""
_MUCH = np.log(10.0)


def find_bounds(
    problem: Problem, fit: Fit, unseen: set[int], weak: set[int]
) -> dict[int, dict[bool, tuple[float, str]]]:
    """Find least and largest values of parameters without effect on the motion, as friction held and springs moved.

    A bound counts only as far as the residuals grow by more than noise beyond it, whatever the other parameters
    without effect are, and which are not determined.

    Args:
        unseen: these parameters.
        weak: parameters that are not determined.

    Returns:
        For each parameter, by whether it is a lower bound, the bound [unit of the scene's key], and when what did not
        happen, for example "contact 2 did not slide at 3.2 s of run.csv", on the clock of the commands.
    """
    space = problem.space
    raised = _raise_others(problem, fit, unseen, weak)
    found: dict[int, dict[bool, tuple[float, str]]] = {}
    for (p, at_least), (replica, slack, limit) in find_reached(problem, fit.unknowns, unseen).items():
        if space.low[p] < limit.value < space.high[p] or not at_least:
            value = _confirm(problem, fit, raised, p, limit.value, at_least)
            if value is not None:
                event = f"{slack.events[limit.column]} at {slack.time[limit.row]:.4g} s of {replica.measured.name}"
                found.setdefault(p, {})[at_least] = value, event
    return found


def release(problem: Problem, coarse: Problem, fit: Fit) -> Fit:
    """Move frictions and limits that the fit has just reached to where they are not reached, if it fits as well.

    A fit that began with a limit within reach, or with a friction that does not hold, ends where it is just passed,
    although the measurements may show no more than that it is not passed.

    Args:
        coarse: the problem with the first rows only: a limit that is passed there is passed in all rows.

    Returns:
        The fit.
    """
    frictions = [p for p, name in enumerate(problem.space.names) if name.startswith("friction")]
    factors: dict[int, tuple[float, ...]] = dict.fromkeys(frictions, (1.0 + _RELEASE,))
    limits = [p for replica in problem.replicas for p in replica.limits]
    factors |= dict.fromkeys(limits, (1.0 + _RELEASE, 1.0 - _RELEASE))
    size = np.linalg.norm(fit.residuals.jacobian, axis=0)
    for p in sorted(p for p in factors if size[p] > 0.0):
        for factor in factors[p]:
            unknowns = fit.unknowns.copy()
            value = problem.space.to_values(unknowns[: problem.space.origin.size])
            value[p] = np.clip(value[p] * factor, problem.space.low[p], problem.space.high[p])
            unknowns[p] = problem.space.to_coordinates(value)[p]
            early = coarse.compute(unknowns)
            if early is None or early.jacobian[:, p].any():
                continue
            now = problem.compute(unknowns)
            if now is None or now.jacobian[:, p].any() or now.cost > fit.cost + _NEAR:
                continue
            # the others have made up for the little that it was passed
            held = np.arange(problem.count) == p
            moved = fit_from(problem, unknowns, held, tight=True, most=_STEPS)
            if moved is not None and moved.cost <= fit.cost + _LUCKY and not moved.residuals.jacobian[:, p].any():
                fit = replace(moved, spread=fit.spread)
                break
    return fit


def _raise_others(problem: Problem, fit: Fit, unseen: set[int], weak: set[int]) -> np.ndarray:
    """Multiply positive parameters as far as it fits as well, because others could hold in the place of one."""
    count = problem.space.origin.size
    unknowns = fit.unknowns.copy()
    high = problem.bounds[1][:count]
    for p in unseen:
        if problem.space.logarithmic[p]:
            unknowns[p] = min(unknowns[p] + _MUCH, high[p])
    origin = problem.space.to_coordinates(problem.space.origin)
    for p in sorted(p for p in weak if problem.space.logarithmic[p]):
        moved = unknowns.copy()
        moved[p] = min(max(moved[p], origin[p]) + _MUCH, high[p])
        now = problem.compute(moved)
        if now is not None and now.cost <= fit.cost + _CHI_SQUARE:
            unknowns = moved
    return unknowns


def _confirm(problem: Problem, fit: Fit, raised: np.ndarray, p: int, bound: float, at_least: bool) -> float | None:
    """Move a parameter beyond its bound until the residuals grow by more than noise; None if they never do."""
    if not problem.space.logarithmic[p]:
        return bound
    for factor in _BEYOND:
        unknowns = raised.copy()
        beyond = bound * factor if at_least else bound / factor
        unknowns[p] = np.log(beyond)
        now = problem.compute(unknowns)
        if now is None or now.cost > fit.cost + _CHI_SQUARE:
            return bound if factor == _BEYOND[0] else beyond
    return None
