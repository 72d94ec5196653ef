"""Starts of a fit: the balance of forces, the values of the scene, moves of the best fit so far, and random values."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from ..replica.knots import Reached, find_limits
from ..replica.replica import Replica, Slack
from .balance import estimate, see
from .problem import Problem

_DRAWS = 6
"""Random values that are compared for each start."""
_NEIGHBOURS = (0.03, -0.03, 0.1, -0.1)
"""Steps of the logarithms of neighbours of the first start."""
_APART = 0.01
"""Difference of the coordinates of starts that are not the same."""
_KICK = 0.2
"""Standard deviation of the steps from the best fit so far, for half of the coordinates."""
_INSIDE = 0.03
"""Part by which a parameter is moved beyond the place where it begins to have an effect."""


def generate_starts(problem: Problem, rng: np.random.Generator) -> Iterator[tuple[str, np.ndarray | None]]:
    """Generate starts without end, each with what it is related to.

    These are the balance of forces, the scene's values, neighbours of the balance, then in turn two moves of the best
    fit so far, and a draw, every second one improved by the balance.

    Yields:
        What the start is related to, and its unknowns, shape (U,); None for a move of the best fit, "kick", and where
        no draw leads to a motion.
    """
    seen = [see(r, rows) for r, rows in zip(problem.replicas, problem.rows, strict=True) if rows.any()]
    known = [one for one in seen if one is not None]
    complete = len(known) == len(seen)
    first = estimate(known, problem.space, problem.space.origin, problem.sensor, False) if complete else None
    if first is not None:
        yield "balance", _start_at(problem, *first)
    yield "scene", problem.unknowns(problem.space.origin)
    if first is not None:
        for step in _NEIGHBOURS:
            values = np.where(problem.space.logarithmic, first[0] * np.exp(step), first[0])
            yield "balance", _start_at(problem, np.clip(values, problem.space.low, problem.space.high), *first[1:])
    earlier = [] if first is None else [problem.space.to_coordinates(first[0])]
    for k in itertools.count():
        yield from (("kick", None), ("kick", None))
        values = problem.space.draw(rng)
        balanced = estimate(known, problem.space, values, problem.sensor, True) if complete and k % 2 == 0 else None
        if balanced is not None:
            place = problem.space.to_coordinates(balanced[0])
            if all(np.abs(place - one).max() > _APART for one in earlier):
                earlier.append(place)
                yield f"draw {k}", _start_at(problem, *balanced)
            complete = len(earlier) > k // 2  # as long as other minima of the balance are found
        else:
            yield f"draw {k}", _draw(problem, rng)


def _start_at(problem: Problem, values: np.ndarray, lag: float, starts: list[np.ndarray]) -> np.ndarray:
    """Build a start from values of the parameters, a lag, and the displacements at the starts of recordings, (U,)."""
    unknowns = problem.unknowns(values)
    fitted = [i for i, rows in enumerate(problem.rows) if rows.any()] if problem.starts else []
    for i, x in zip(fitted, starts, strict=False):
        stretch = problem.replicas[i].stretch(values, x)
        if stretch is not None:
            unknowns[problem.places(i)[-problem.starts :]] = stretch
    if "lag" in problem.names:
        unknowns[[problem.places(i)[problem.names.index("lag")] for i in range(len(problem.replicas))]] = lag
    return unknowns


def kick(problem: Problem, unknowns: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Move parameters at random, as far as a wrong minimum may be from the right one.

    Starts that the first row tells begin there again, as wrong parameters may have led them astray.

    Args:
        unknowns: of the best fit so far, shape (U,).

    Returns:
        Shape (U,).
    """
    count = problem.space.origin.size
    moved = unknowns.copy()
    moved[:count] += _KICK * rng.normal(size=count) * rng.integers(0, 2, count)
    for i, replica in enumerate(problem.replicas if problem.starts else ()):
        told = replica.guess_start(problem.offset)
        if replica.derivative_error or told.any():
            moved[problem.places(i)[-problem.starts :]] = told
    return np.clip(moved, *problem.bounds)


def reach_held(problem: Problem, unknowns: np.ndarray, jacobian: np.ndarray) -> list[np.ndarray]:
    """Move each parameter without effect to where it begins to have one, as no derivative leads back there.

    A fit may raise the friction of a contact until it never slides, and then explain its slides by other numbers.

    Args:
        unknowns: of the best fit so far, shape (U,).
        jacobian: derivatives of the residuals there, shape (R, U).

    Returns:
        The unknowns with one of them moved, each of shape (U,).
    """
    space, count = problem.space, problem.space.origin.size
    values = space.to_values(unknowns[:count])
    found = []
    for (p, at_least), (_, _, limit) in find_reached(
        problem, unknowns, set(np.flatnonzero(~jacobian[:, :count].any(axis=0)))
    ).items():
        inside = limit.value - _INSIDE * abs(limit.value) * (1.0 if at_least else -1.0)
        changed, moved = values.copy(), unknowns.copy()
        changed[p] = np.clip(inside, space.low[p], space.high[p])
        moved[p] = space.to_coordinates(changed)[p]
        found.append(moved)
    return found


def find_reached(
    problem: Problem, unknowns: np.ndarray, unseen: set[int]
) -> dict[tuple[int, bool], tuple[Replica, Slack, Reached]]:
    """Find where parameters without effect on the motion would begin to have one.

    Args:
        unknowns: of the fit, shape (U,).
        unseen: the parameters.

    Returns:
        By parameter and whether it is a lower limit, the nearest limit of all recordings, with its recording.
    """
    found: dict[tuple[int, bool], tuple[Replica, Slack, Reached]] = {}
    values = problem.space.to_values(unknowns[: problem.space.origin.size])
    for i, replica in enumerate(problem.replicas if unseen else ()):
        slack = replica.slack(values, problem.start(unknowns, i))
        if slack is None:
            continue
        for (p, at_least), limit in find_limits(values, slack.distance, slack.derivative).items():
            known = found.get((p, at_least))
            if p in unseen and (known is None or (limit.value > known[2].value) == at_least):
                found[p, at_least] = replica, slack, limit
    return found


def _draw(problem: Problem, rng: np.random.Generator) -> np.ndarray | None:
    """Draw several values; return the unknowns with the least residuals."""
    best, least = None, np.inf
    for _ in range(_DRAWS):
        unknowns = problem.unknowns(problem.space.draw(rng))
        found = problem.compute(unknowns)
        if found is not None and found.cost < least:
            best, least = unknowns, found.cost
    return best
