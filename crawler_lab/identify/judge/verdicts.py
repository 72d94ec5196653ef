"""What measurements decide about each parameter, from the exact Jacobian."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from ..fit.fit import Fit
from ..fit.problem import Problem
from ..fit.space import Space
from ..sensor.noise import find_quantile, find_rounding
from .bounds import find_bounds

Verdict = Literal["identified", "ratio", "bound", "not excited"]
_ZERO = 1e-11
"""A column below this part of the largest one is zero."""
_NULL = 1e-8
"""A singular value below this part of the largest one is zero; columns have length 1."""
_MEMBER = 1e-5
_WEAK_MEMBER = 0.1
_SLOW = 0.2
"""Part of the noise from which its slow part counts."""
_WIDER, _WIDER_SLOW = 1.1, 1.25
"""Factors on intervals, because the derivatives are averages over creases; where noise has a slow part, its size and
correlation time are estimates, too. Both are calibrated by `python -m benchmarks identify`."""
_WIDEST = np.log(3.0)
"""Half of a 95 % interval of a logarithm; a parameter with a wider one is not identified."""


@dataclass(frozen=True)
class Parameter:
    """What is known about a parameter.

    Attributes:
        name: for example "friction.forward[2]".
        verdict: "identified"; "ratio": only together with others, on the scale that the scene's value of the first one
            sets; "bound": from one side; "not excited".
        value: the fitted value, or the bound, in the unit of the scene's key [any]; None if nothing determines it.
        interval: 95 % interval; None at an end that is not known.
        partners: names of the other parameters of a ratio.
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


@dataclass
class Structure:
    """Which parameters the measurements determine.

    Attributes:
        unseen: parameters without any effect.
        held: parameters that keep their value, because only a combination of them and others is determined.
        groups: sets of parameters with only ratios or differences determined, in the order of the parameters.
        weak: parameters that are not determined, with the half width of their interval, as a logarithm: infinite where
            only a combination is determined that is no ratio, for example a sum; else the noise hides them.
    """

    unseen: set[int] = field(default_factory=set)
    held: set[int] = field(default_factory=set)
    groups: list[set[int]] = field(default_factory=list)
    weak: dict[int, float] = field(default_factory=dict)

    @property
    def fixed(self) -> set[int]:
        """The parameters that do not move: what the others may be does not depend on them."""
        return self.unseen | self.held

    @property
    def kept(self) -> set[int]:
        """The parameters that keep the value of the scene, which fixes the scale of a group."""
        return self.held - set(self.weak)

    def join(self, members: set[int]) -> None:
        """Add a group, joined with all that share a parameter with it.

        Args:
            members: indices of its parameters.
        """
        apart = [g for g in self.groups if not g & members]
        for group in self.groups:
            if group & members:
                members = members | group
        self.groups = [*apart, members]


def find_structure(problem: Problem, fit: Fit, known: Structure | None = None) -> Structure:
    """Find null directions of the Jacobian, exact ones and ones that the noise hides.

    Args:
        known: what was found before; its groups remain.

    Returns:
        The structure.
    """
    from scipy.sparse.csgraph import connected_components

    count = problem.space.origin.size
    # a logarithm far below the scene's has little effect, though the value may have much
    values = problem.space.to_values(fit.unknowns[:count])
    with np.errstate(divide="ignore", invalid="ignore"):
        larger = np.where(problem.space.logarithmic, np.maximum(problem.space.origin / values, 1.0), 1.0)
    jacobian = _effective_jacobian(problem, fit.residuals.jacobian) * larger
    found = Structure()
    if known is not None:
        found.held, found.groups = known.kept, [set(g) for g in known.groups]
    size = np.linalg.norm(jacobian, axis=0)
    own = np.linalg.norm(fit.residuals.jacobian[:, :count], axis=0)
    spread = max(float(np.nanmax(np.abs(r.measured.values))) for r in problem.replicas)
    largest = max(float(size.max(initial=0.0)), _ZERO * spread / problem.floor)
    found.unseen = {p for p in range(count) if size[p] <= max(_ZERO * largest, _NULL * own[p])} - found.held
    triangle: Any = np.linalg.qr(jacobian, mode="r")  # with the same singular values
    nothing = max(_NULL, fit.residuals.derivative_error)
    scaled = np.where(problem.space.logarithmic, 1.0, fit.unknowns[:count]) / larger
    while True:
        free = [p for p in range(count) if p not in found.fixed]
        if not free:
            return found
        part = triangle[:, free] / size[free]
        _, values, right = np.linalg.svd(part, full_matrices=False)
        null = right[values <= nothing * values[0]]
        if null.shape[0]:
            shares = null.T @ null
            first = next(i for i in range(len(free)) if shares[i, i] > _MEMBER)
            _, label = connected_components(np.abs(shares) > _MEMBER * np.abs(shares).max(), directed=False)
            members = [free[i] for i in np.flatnonzero(label == label[first])]
            together = scaled if problem.space.logarithmic[members].any() else 1.0 / problem.space.scale
            effect = np.linalg.norm(triangle[:, members] @ together[members])
            if effect <= np.sqrt(nothing) * np.linalg.norm(size[members] * together[members]):
                found.join(set(members))
            else:
                found.weak |= dict.fromkeys(members, np.inf)
            found.held.add(free[first])
            continue
        hidden = _hidden(problem, fit, jacobian, scaled, free, found.weak)
        if hidden is None:
            return found
        members, width = hidden
        if len(members) > 1:
            found.join(set(members))
            found.held.add(members[0])
        else:
            found.weak[members[0]] = width


def _hidden(
    problem: Problem, fit: Fit, jacobian: np.ndarray, scaled: np.ndarray, free: list[int], weak: Mapping[int, float]
) -> tuple[list[int], float] | None:
    """Find the ratio or the parameter that the noise hides most, if it hides any.

    The parameters of a ratio move together along `scaled`, shape (P,). Weak ones may have any value.
    """
    covariance, freedom = find_covariance(problem, replace(fit, spread=np.zeros_like(fit.spread)), jacobian, free)
    quantile = find_quantile(freedom)
    logs = [i for i, p in enumerate(free) if problem.space.logarithmic[p] and p not in weak]
    if not logs:
        return None
    widths = quantile * np.sqrt(np.diag(covariance)[logs])
    worst = int(np.argmax(widths))
    if widths[worst] <= _WIDEST:
        return None
    _, vectors = np.linalg.eigh(covariance[np.ix_(logs, logs)])
    direction = np.abs(vectors[:, -1])
    members = [free[logs[i]] for i in np.flatnonzero(direction > _WEAK_MEMBER * direction.max())]
    others = jacobian[:, [p for p in free if p in weak]]
    effect = jacobian[:, members] @ scaled[members]
    effect = effect - others @ np.linalg.lstsq(others, effect)[0]
    alone, together = (quantile / max(float(np.linalg.norm(v)), 1e-300) for v in (jacobian[:, members[0]], effect))
    if len(members) > 1 and alone <= _WIDEST < together:
        return members, float(widths[worst])
    return [free[logs[worst]]], float(widths[worst])


def _effective_jacobian(problem: Problem, jacobian: np.ndarray) -> np.ndarray:
    """Remove from the derivatives what the unknown numbers of the sensors can imitate, as far as their priors allow.

    Of the derivatives of whitened residuals and priors, shape (R, U), those with respect to the coordinates of the
    parameters are left, shape (R, P).
    """
    count = problem.space.origin.size
    jacobian, others = jacobian[:, :count], jacobian[:, count:]
    others = others[:, np.abs(others).max(axis=0, initial=0.0) > 0.0]
    if others.shape[1] == 0:
        return jacobian
    basis, values, _ = np.linalg.svd(others / np.linalg.norm(others, axis=0), full_matrices=False)
    basis = basis[:, values > _NULL * values[0]]
    return np.asarray(jacobian - basis @ (basis.T @ jacobian))


def find_covariance(problem: Problem, fit: Fit, jacobian: np.ndarray, free: list[int]) -> tuple[np.ndarray, float]:
    """Compute the covariance of some unknowns, the others held.

    It is a sandwich: the noise of a channel is not exactly what it was taken for. Where it has a slow part, its
    estimate is uncertain, which a factor on the intervals covers; the rounding of pixels is a function of position.

    Args:
        jacobian: shape (R, P).
        free: the unknowns.

    Returns:
        The covariance of their coordinates, shape (F, F), and the degrees of freedom of the noise.
    """
    freedom = max(fit.residuals.fitted.size - problem.count, 1)
    part = jacobian[:, free]
    size = np.maximum(np.linalg.norm(part, axis=0), 1e-300)
    part = part / size
    middle = part.T @ part
    values, vectors = np.linalg.eigh(middle)
    bread = vectors @ (vectors.T / np.maximum(values, 1e-300)[:, None])
    blocks = np.split(part, np.cumsum(problem.sizes))  # the last one belongs to the priors of sensors
    for i, channels in enumerate(problem.channels):
        for m, channel in enumerate(channels):
            own, noise, rows = blocks[i][channel.place], channel.noise, channel.rows
            if noise.pixel > 0.0:
                shown = problem.replicas[i].measured.values[rows, m] + fit.residuals.all[i][rows, m]
                middle += find_rounding(noise, shown / noise.pixel, own) - own.T @ own
            else:
                factor = _WIDER_SLOW if noise.slow > _SLOW * noise.size else _WIDER
                middle += (factor**2 - 1.0) * (own.T @ own)
    scale = max(1.0, fit.cost / freedom)
    covariance = scale * (bread @ middle @ bread) / np.outer(size, size) + fit.spread[np.ix_(free, free)]
    return covariance, float(freedom)


def judge(
    problem: Problem, fit: Fit, structure: Structure, below: np.ndarray, above: np.ndarray
) -> tuple[Parameter, ...]:
    """Write the verdict on each parameter.

    The first of these that holds: the motion does not depend on it; noise hides it; only a combination with others is
    determined, of which it is held or not; the fit ended at its bound; its interval has one end; it is identified.

    Args:
        fit: its end, with the held parameters at the scene's values.
        structure: from `find_structure`.
        below: lower half widths of the 95 % intervals of the coordinates, shape (P,); inf where there is no end.
        above: the upper ones, shape (P,).

    Returns:
        One for each parameter, in order.
    """
    space = problem.space
    count = space.origin.size
    coordinates = fit.unknowns[:count]
    values = space.to_values(coordinates)
    bounds = find_bounds(problem, fit, structure.unseen, set(structure.weak))
    low, high = (v[:count] for v in problem.bounds)
    parameters = []
    for p, name in enumerate(space.names):
        group = next((g for g in structure.groups if p in g), set()) - (structure.weak.keys() - {p})
        partners = tuple(space.names[q] for q in sorted(group - {p}))
        interval = _interval(problem, coordinates[p], below[p], above[p], p)
        relation = f"{'ratio to' if space.logarithmic[p] else 'difference from'} {', '.join(partners)}"
        if p in structure.unseen:
            forces = {q for q in structure.kept if space.logarithmic[p] and space.logarithmic[q]}
            condition = _condition(space, values, forces)
            parameters.append(_judge_unseen(problem, fit, p, bounds.get(p, {}), condition))
        elif p in structure.weak or (p in structure.held and not partners):
            width = structure.weak.get(p, np.inf)
            why = "only a combination of it with others is determined, which is no ratio"
            if np.isfinite(width):
                factor = np.exp(min(2.0 * width, 700.0))
                why = f"the noise hides it: its 95 % interval would span a factor of {factor:.3g}"
            parameters.append(Parameter(name, "not excited", None, (None, None), (), why))
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
                why = "the noise hides it"
                parameters.append(Parameter(name, "not excited", None, (None, None), (), why))
            else:
                why = f"{'at least' if interval[1] is None else 'at most'} {end:.6g}: values beyond fit as well"
                parameters.append(Parameter(name, "bound", end, interval, (), why))
        else:
            why = "the motion determines it"
            parameters.append(Parameter(name, "identified", float(values[p]), interval, (), why))
    return tuple(parameters)


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
    problem: Problem, fit: Fit, p: int, bounds: Mapping[bool, tuple[float, str]], condition: str
) -> Parameter:
    """Write the verdict on a parameter without effect on the fitted rows, whose bounds hold under a condition."""
    name = problem.space.names[p]
    if not bounds:
        why = "the measured motion does not depend on it"
        if np.abs(fit.residuals.jacobian[:, p]).max(initial=0.0) > 0.0:
            why = "an unknown offset, lag or scale has the same effect"
        return Parameter(name, "not excited", None, (None, None), (), why)
    ends = {at_least: value for at_least, (value, _) in bounds.items()}
    sides = {True: "at least", False: "at most"}
    why = "; ".join(f"{sides[at_least]} {value:.6g}: {event}" for at_least, (value, event) in bounds.items())
    return Parameter(name, "bound", next(iter(ends.values())), (ends.get(True), ends.get(False)), (), why + condition)
