"""What a record tells that begins in the middle of life: of each contact the sum of both frictions.

Forces d of the springs at the start turn the frictions f into f - d and b into b + d, and the motion does not change.
The fit chooses one of these, for which some frictions keep their values; every other one has the same sums.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..fit.fit import Fit
from ..fit.problem import Problem
from .intervals import find_interval_of_sum
from .structure import Structure, find_loose_contacts, find_null

Bounds = Mapping[int, Mapping[bool, tuple[float, str]]]
_SAME = 1e-5
"""Part of a sum that may change along a direction that nothing determines."""


@dataclass(frozen=True)
class Sum:
    """A sum of two parameters.

    Attributes:
        partner: index of the other one.
        value: of the sum; where it is only bounded, its bound [N].
        low: lower end of its 95 % interval [N].
        high: the upper end; None where the sum is only bounded, from below [N].
    """

    partner: int
    value: float
    low: float
    high: float | None


def find_bounds_of_any_start(problem: Problem, fit: Fit, structure: Structure, bounds: Bounds) -> Bounds:
    """Select the bounds that hold whatever the forces of the springs at the start are, if these are unknown.

    Args:
        bounds: from `find_bounds`, at the start of the fit.

    Returns:
        Those of contacts on which this force is determined.
    """
    if not problem.starts or not bounds:
        return bounds
    free = [p for p in range(problem.space.origin.size) if p not in structure.kept | structure.unseen]
    loose = find_loose_contacts(problem, fit, free)
    contacts = [re.search(r"\[(\d+)\]$", name) for name in problem.space.names]
    own = [loose if found is None else loose & {int(found[1])} for found in contacts]
    return {p: sides for p, sides in bounds.items() if not own[p]}


def find_sums(
    problem: Problem,
    fit: Fit,
    structure: Structure,
    covariance: np.ndarray,
    freedom: float,
    bounds: Bounds,
) -> dict[int, Sum]:
    """Find the parameters of which only the sum with another one is determined, or bounded.

    Args:
        bounds: bounds that hold only at the start of the fit.

    Returns:
        By index.
    """
    if not problem.starts:
        return {}
    space = problem.space
    count = space.origin.size
    values = space.to_values(fit.unknowns[:count])
    slope = space.slope(values)
    weak = {p for p, width in structure.weak.items() if np.isinf(width)}
    free = [p for p in range(count) if p not in structure.kept | structure.unseen]
    any_start, known_start = (find_null(problem, fit, free, known) for known in (False, True))
    found: dict[int, Sum] = {}
    for p, q in _pair(space.names):
        if {p, q} <= weak:
            gradient = np.zeros(count)
            gradient[[p, q]] = slope[[p, q]]
            size = np.abs(any_start * gradient[free]).sum(axis=1).max(initial=0.0)
            if np.abs(any_start @ gradient[free]).max(initial=0.0) <= _SAME * size:
                low, high = find_interval_of_sum(problem, fit, structure.fixed, covariance, freedom, gradient)
                value = float(values[p] + values[q])
                if np.isfinite((low, high)).all():
                    found[p], found[q] = (Sum(other, value, value - low, value + high) for other in (q, p))
        for seen, held in ((p, q), (q, p)):
            bound = bounds.get(held, {}).get(True)
            if seen not in weak or bound is None:
                continue
            if np.abs(known_start[:, free.index(seen)]).max(initial=0.0) <= _SAME:
                least = float(values[seen] + bound[0])
                found[seen], found[held] = (Sum(other, least, least, None) for other in (held, seen))
    return found


def _pair(names: Sequence[str]) -> list[tuple[int, int]]:
    """List the forward frictions with the backward ones of the same contact."""
    place = {name: p for p, name in enumerate(names)}
    pairs = ((p, place.get(name.replace("forward", "backward"))) for name, p in place.items() if "forward" in name)
    return [(p, q) for p, q in pairs if q is not None]
