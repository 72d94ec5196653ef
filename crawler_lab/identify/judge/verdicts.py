"""What measurements decide about each parameter, from the exact Jacobian."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..fit.fit import Fit
from ..fit.problem import Problem
from ..fit.space import Space
from .bounds import find_bounds
from .structure import WIDEST, Structure
from .sums import Sum, find_bounds_of_any_start, find_sums

Verdict = Literal["identified", "ratio", "sum", "bound", "doubtful", "not excited"]


@dataclass(frozen=True)
class Parameter:
    """What is known about a parameter.

    Attributes:
        name: for example "friction.forward[2]".
        verdict: "identified"; "ratio": only together with others, on the scale that the scene's value of the first one
            sets; "sum": only the sum with another one, whose value and interval follow; "bound": from one side;
            "doubtful": the model does not fit, or nothing tells how the record began; "not excited".
        value: the fitted value, or the bound, in the unit of the scene's key [any]; None if nothing determines it.
        interval: 95 % interval; None at an end that is not known.
        partners: names of the other parameters of a ratio or a sum.
        why: the reason, in words.
        ended: whether the fit ended at a bound that was given to it.
    """

    name: str
    verdict: Verdict
    value: float | None
    interval: tuple[float | None, float | None]
    partners: tuple[str, ...]
    why: str
    ended: bool = False

    def as_plain(self) -> dict[str, object]:
        """Convert to the values that `crawler identify --json` prints.

        Returns:
            Plain numbers, lists and text.
        """
        return {
            "name": self.name,
            "verdict": self.verdict,
            "value": self.value,
            "interval": list(self.interval),
            "with": list(self.partners),
            "why": self.why,
            "ended": self.ended,
        }


def judge(
    problem: Problem,
    fit: Fit,
    structure: Structure,
    below: np.ndarray,
    above: np.ndarray,
    covariance: np.ndarray,
    freedom: float,
) -> tuple[tuple[Parameter, ...], list[Mapping[str, object]]]:
    """Write the verdict on each parameter.

    The first of these that holds: the motion does not depend on it; noise hides it; only a combination with others is
    determined, of which it is held or not; the fit ended at its bound; its interval has one end; it is identified.

    Args:
        fit: its end, with the held parameters at the scene's values.
        below: lower half widths of the 95 % intervals of the coordinates, shape (P,); inf where there is no end.
        above: the upper ones, shape (P,).

    Returns:
        One for each parameter, in order; and as plain numbers what predictions start from: where only sums are
        determined, one choice of their parts.
    """
    space = problem.space
    count = space.origin.size
    coordinates = fit.unknowns[:count]
    values = space.to_values(coordinates)
    chosen = find_bounds(problem, fit, structure.unseen, set(structure.weak))
    bounds = find_bounds_of_any_start(problem, fit, structure, chosen)
    loose = {p: sides for p, sides in chosen.items() if p not in bounds}
    sums = find_sums(problem, fit, structure, covariance, freedom, loose)
    low, high = (v[:count] for v in problem.bounds)
    parameters = []
    for p, name in enumerate(space.names):
        group = next((g for g in structure.groups if p in g), set()) - (structure.weak.keys() - {p})
        partners = tuple(space.names[q] for q in sorted(group - {p}))
        interval = _interval(problem, coordinates[p], below[p], above[p], p)
        relation = f"{'ratio to' if space.logarithmic[p] else 'difference from'} {', '.join(partners)}"
        if p in sums:
            scale = _condition(space, values, structure.kept)
            parameters.append(_judge_sum(name, sums[p], space.names[sums[p].partner], scale))
        elif p in structure.unseen:
            forces = {q for q in structure.kept if space.logarithmic[p] and space.logarithmic[q]}
            condition = _condition(space, values, forces)
            parameters.append(_judge_unseen(problem, fit, p, bounds.get(p, {}), condition, p in loose))
        elif p in structure.weak or (p in structure.held and not partners):
            width = structure.weak.get(p, np.inf)
            why = "only a combination of it with others is determined, which is no ratio"
            if np.isfinite(width):
                why = _explain_width(2.0 * width)
            parameters.append(_not_excited(name, why))
        elif p in structure.held:
            why = f"only its {relation} is determined; it is kept at {values[p]:.6g}"
            parameters.append(Parameter(name, "ratio", float(values[p]), (None, None), partners, why))
        elif group:
            why = f"only its {relation} is determined{_condition(space, values, group & structure.held)}"
            parameters.append(Parameter(name, "ratio", float(values[p]), interval, partners, why))
        elif coordinates[p] - low[p] < 1e-6 or high[p] - coordinates[p] < 1e-6:
            at_most = coordinates[p] - low[p] < 1e-6
            ends = (None, float(values[p])) if at_most else (float(values[p]), None)
            side = f"{'at most' if at_most else 'at least'} {values[p]:.6g}"
            why = f"{side}: the fit ended at this bound"
            parameters.append(Parameter(name, "bound", float(values[p]), ends, (), why, ended=True))
        elif None in interval:
            end = interval[0] if interval[0] is not None else interval[1]
            if end is None:
                parameters.append(_not_excited(name, "the noise hides it"))
            else:
                why = f"{'at least' if interval[1] is None else 'at most'} {end:.6g}: values beyond fit as well"
                parameters.append(Parameter(name, "bound", end, interval, (), why))
        elif space.logarithmic[p] and max(below[p], above[p]) > WIDEST:  # other minima fit nearly as well
            parameters.append(_not_excited(name, _explain_width(below[p] + above[p])))
        else:
            why = "the motion determines it"
            parameters.append(Parameter(name, "identified", float(values[p]), interval, (), why))
    return tuple(parameters), [_choose(one, values[p], sums, chosen, p) for p, one in enumerate(parameters)]


def _not_excited(name: str, why: str) -> Parameter:
    return Parameter(name, "not excited", None, (None, None), (), why)


def _explain_width(width: float) -> str:
    """Explain that the interval of a logarithm is too wide."""
    return f"the noise hides it: its 95 % interval would span a factor of {np.exp(min(width, 700.0)):.3g}"


def _judge_sum(name: str, found: Sum, partner: str, condition: str) -> Parameter:
    """Write the verdict on a parameter of which only the sum with another one is determined, or bounded."""
    interval = (found.low, found.high)
    size = f"at least {found.value:.6g}" if found.high is None else f"{found.value:.6g}"
    why = f"only its sum with {partner} is determined, {size}: forces at the start are unknown{condition}"
    return Parameter(name, "sum", found.value, interval, (partner,), why)


def _choose(
    parameter: Parameter,
    value: float,
    sums: Mapping[int, Sum],
    chosen: Mapping[int, Mapping[bool, tuple[float, str]]],
    p: int,
) -> Mapping[str, object]:
    """Convert a verdict to plain numbers; of a sum to the part that the fit has chosen."""
    plain = parameter.as_plain()
    if p not in sums:
        return plain
    if p not in chosen:
        return plain | {"value": float(value)}
    return plain | {"verdict": "bound", "interval": [chosen[p][True][0], None]}


def doubt(parameter: Parameter, reason: str) -> Parameter:
    """Withdraw what a model tells that does not fit, or whose start nothing tells.

    Args:
        parameter: its verdict if there were no doubt.
        reason: why there is.

    Returns:
        The value without an interval; as it is where nothing was told.
    """
    if parameter.verdict == "not excited":
        return parameter
    reason += "" if parameter.verdict == "identified" else f"; {parameter.why}"
    return replace(parameter, verdict="doubtful", interval=(None, None), why=reason)


def _interval(
    problem: Problem, coordinate: float, below: float, above: float, p: int
) -> tuple[float | None, float | None]:
    """Convert the interval of a coordinate to one of the value."""
    ends = np.array([coordinate - below, coordinate + above])
    with np.errstate(over="ignore"):
        values = np.exp(ends) if problem.space.logarithmic[p] else ends * problem.space.scale[p]
    low, high = (float(v) if np.isfinite(e) else None for v, e in zip(values, ends, strict=True))
    return low, high


def _condition(space: Space, values: np.ndarray, held: set[int]) -> str:
    """Name the values that fix the scale of others; nothing if there are none."""
    kept = ", ".join(f"{space.names[q]} = {values[q]:.6g}" for q in sorted(held))
    return f"; the value holds for {kept}" if kept else ""


def _judge_unseen(
    problem: Problem, fit: Fit, p: int, bounds: Mapping[bool, tuple[float, str]], condition: str, loose: bool
) -> Parameter:
    """Write the verdict on a parameter without effect on the fitted rows, whose bounds hold under a condition."""
    name = problem.space.names[p]
    if not bounds:
        why = "the measured motion does not depend on it"
        if loose:
            why = "what it held is not determined, because forces of the springs at the start are unknown"
        if np.abs(fit.residuals.jacobian[:, p]).max(initial=0.0) > 0.0:
            why = "an unknown offset, lag, scale or start has the same effect"
        return _not_excited(name, why)
    ends = {at_least: value for at_least, (value, _) in bounds.items()}
    sides = {True: "at least", False: "at most"}
    why = "; ".join(f"{sides[at_least]} {value:.6g}: {event}" for at_least, (value, event) in bounds.items())
    return Parameter(name, "bound", next(iter(ends.values())), (ends.get(True), ends.get(False)), (), why + condition)
