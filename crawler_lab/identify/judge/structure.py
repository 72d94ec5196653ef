"""Which parameters the measurements determine, from the exact Jacobian, and their covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..fit.fit import Fit
from ..fit.problem import Problem
from ..sensor.noise import find_quantile, find_rounding

_ZERO = 1e-11
"""A column below this part of the largest one is zero."""
_NULL = 1e-8
"""A singular value below this part of the largest one is zero; columns have length 1."""
_ROUNDING = 1e-15
"""An eigenvalue of a normal matrix below this part of the largest one is rounding; columns have length 1."""
_MOVED, _PART = 1e-5, 1e-3
"""Step along a direction that nothing determines, and the part of the largest change of a force that is none."""
_MEMBER = 1e-5
_WEAK_MEMBER = 0.1
_SLOW = 0.2
"""Part of the noise from which its slow part counts."""
_WIDER, _WIDER_SLOW = 1.1, 1.25
"""Factors on intervals, because the derivatives are averages over creases; where noise has a slow part, its size and
correlation time are estimates, too. Both are calibrated by `python -m benchmarks identify`."""
WIDEST = np.log(3.0)
"""Half of a 95 % interval of a logarithm; a parameter with a wider one is not identified."""


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
    if widths[worst] <= WIDEST:
        return None
    _, vectors = np.linalg.eigh(covariance[np.ix_(logs, logs)])
    direction = np.abs(vectors[:, -1])
    members = [free[logs[i]] for i in np.flatnonzero(direction > _WEAK_MEMBER * direction.max())]
    others = jacobian[:, [p for p in free if p in weak]]
    effect = jacobian[:, members] @ scaled[members]
    effect = effect - others @ np.linalg.lstsq(others, effect)[0]
    alone, together = (quantile / max(float(np.linalg.norm(v)), 1e-300) for v in (jacobian[:, members[0]], effect))
    if len(members) > 1 and alone <= WIDEST < together:
        return members, float(widths[worst])
    return [free[logs[worst]]], float(widths[worst])


def find_null(problem: Problem, fit: Fit, free: list[int], start_known: bool) -> np.ndarray:
    """Find the directions of some parameters along which the motion does not change.

    Args:
        free: the parameters.
        start_known: whether the start is held.

    Returns:
        Directions of the coordinates, each of length 1, shape (K, F).
    """
    jacobian = _effective_jacobian(problem, fit.residuals.jacobian, start_known)
    return _find_null_space(jacobian[:, free], fit.residuals.derivative_error)


def find_loose_contacts(problem: Problem, fit: Fit, free: list[int]) -> set[int]:
    """Find the contacts on which the force of the springs at the start is not determined.

    Args:
        free: parameters that are not held, and have an effect.

    Returns:
        Their indices.
    """
    count, found = problem.space.origin.size, set()
    jacobian = fit.residuals.jacobian
    for i, replica in enumerate(problem.replicas if problem.starts else ()):
        starts = [at for k in range(len(problem.replicas)) for at in problem.places(k)[len(problem.sensor.unknown) :]]
        columns = [at for at in (*free, *starts) if jacobian[:, at].any()]
        for direction in _find_null_space(jacobian[:, columns], fit.residuals.derivative_error):
            ends = []
            for side in (1.0, -1.0):
                moved = fit.unknowns.copy()
                moved[columns] += side * _MOVED * direction
                start = problem.start(moved, i)
                assert start is not None
                ends.append(replica.force_at_start(problem.space.to_values(moved[:count]), start))
            if ends[0] is not None and ends[1] is not None:
                change = np.abs(ends[0] - ends[1])
                found |= set(np.flatnonzero(change > _PART * change.max(initial=1e-300)).tolist())
    return found


def _find_null_space(jacobian: np.ndarray, error: float) -> np.ndarray:
    """Find the directions in which a Jacobian is zero, each of length 1, shape (K, F)."""
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    triangle: Any = np.linalg.qr(jacobian / size, mode="r")
    _, values, right = np.linalg.svd(triangle, full_matrices=True)
    values = np.append(values, np.zeros(right.shape[0] - values.size))
    null = right[values <= max(_NULL, error) * values.max(initial=0.0)] / size
    return np.asarray(null / np.linalg.norm(null, axis=1, keepdims=True))


def _effective_jacobian(problem: Problem, jacobian: np.ndarray, start_known: bool = False) -> np.ndarray:
    """Remove from (R, U) what unknown numbers of sensors and starts imitate; return the parameters' part, (R, P)."""
    count = problem.space.origin.size
    known = len(problem.sensor.unknown) if start_known else len(problem.names)
    places = [at for i in range(len(problem.replicas)) for at in problem.places(i)[:known]]
    jacobian, others = jacobian[:, :count], jacobian[:, places]
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
    size = np.linalg.norm(part, axis=0)
    size[size == 0.0] = 1.0
    part = part / size
    middle = part.T @ part
    values, vectors = np.linalg.eigh(middle)
    known = values > _ROUNDING * values[-1]  # nothing may be known of numbers of a start, if others say the same
    bread = vectors @ (vectors.T * np.where(known, 1.0 / np.where(known, values, 1.0), 0.0)[:, None])
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
