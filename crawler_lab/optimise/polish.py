"""Local search: flips to bounds, and trust-region steps along exact derivatives, or without them a compass search."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .goal import best_first
from .space import Evaluator, Space

_GAIN = 1e-9
"""Improvements below this part of the score are rounding."""
_LARGEST_STEP, _SMALLEST_STEP = 0.5, 1e-7
_SMALLEST_MOVE = 5e-4
"""The same without derivatives, where scores have the tolerance of the scene."""
_BUNDLE = 6
"""Planes that are collected at a kink before the steps become smaller."""
Stop = Callable[[], bool]


def improves(new: float, old: float) -> bool:
    """Determine whether a score is better by more than rounding.

    Args:
        new: a score [m or 1].
        old: the score to compare with [m or 1].

    Returns:
        True if it is.
    """
    return new > old + _GAIN * max(abs(old), 1e-3)


def improve(
    evaluator: Evaluator, point: np.ndarray, score: float, stop: Stop, smallest: float = _SMALLEST_STEP
) -> tuple[np.ndarray, float]:
    """Search locally, by flips and climbs in turns, for as long as that is better.

    Args:
        evaluator: computes scores and derivatives.
        point: where to begin, shape (P,).
        score: its score [m, rad or 1].
        smallest: steps at which climbs end, in the unit box [1].

    Returns:
        The best point, and its score.
    """
    while not stop():
        before = score
        point, score = flip(evaluator, point, score, stop)
        point, score = climb(evaluator, point, score, stop, smallest)
        if not improves(score, before):
            break
    return point, score


def flip(evaluator: Evaluator, point: np.ndarray, score: float, stop: Stop) -> tuple[np.ndarray, float]:
    """Move single unknowns to their bounds, and waypoints as a whole, for as long as that is better.

    All moves are scored together; then the best ones of single unknowns are also tried together.

    Args:
        evaluator: computes the scores.
        point: where to begin, shape (P,).
        score: its score [m or 1].

    Returns:
        The best point, and its score.
    """
    space = evaluator.space
    while not stop():
        point, score = _flip_single(evaluator, point, score, stop)
        moved = [space.repair(other) for other in _block_moves(space, point)]
        if not moved:
            break
        scores = evaluator.scores(moved)
        best = int(best_first(scores)[0])
        if not improves(float(scores[best]), score):
            break
        point, score = moved[best], float(scores[best])
    return point, score


def _block_moves(space: Space, point: np.ndarray) -> list[np.ndarray]:
    """Change several waypoints at once: one link earlier or later, or a waypoint like another one or opposite to it."""
    numbers, rows = space.scenes[0].split(point)
    if rows is None:
        return []
    found = []
    for j in range(rows.shape[1]):
        for by in (-1, 1):
            changed = rows.copy()
            changed[:, j] = np.roll(rows[:, j], by)
            found.append(changed)
    for k in range(rows.shape[0]):
        for other in (1.0 - rows[k], np.roll(rows, 1, axis=0)[k], np.roll(rows, 2, axis=0)[k]):
            changed = rows.copy()
            changed[k] = other
            found.append(changed)
    return [np.concatenate((numbers, changed.ravel())) for changed in found]


def _flip_single(evaluator: Evaluator, point: np.ndarray, score: float, stop: Stop) -> tuple[np.ndarray, float]:
    space = evaluator.space
    while not stop():
        moves = [(i, bound) for i in range(space.size) for bound in (0.0, 1.0) if point[i] != bound]
        scores = evaluator.scores([_moved(space, point, [move]) for move in moves])
        order = [k for k in best_first(scores) if improves(scores[k], score)]
        if not order:
            break
        counts = [1]
        while counts[-1] < len(order):
            counts.append(min(2 * counts[-1], len(order)))
        groups = [_moved(space, point, [moves[k] for k in order[:count]]) for count in counts]
        together = np.append(scores[order[0]], evaluator.scores(groups[1:]))
        best = int(best_first(together)[0])
        point, score = groups[best], float(together[best])
    return point, score


def _moved(space: Space, point: np.ndarray, moves: list[tuple[int, float]]) -> np.ndarray:
    moved = point.copy()
    for i, bound in moves:
        moved[i] = bound
    return space.repair(moved)


def climb(
    evaluator: Evaluator, point: np.ndarray, score: float, stop: Stop, smallest: float = _SMALLEST_STEP
) -> tuple[np.ndarray, float]:
    """Follow the exact derivatives within trust regions.

    The score is piecewise smooth. A step maximises the least of several planes: of all scores and, where neither this
    step nor a part of it is better, of points on the other side of the kink, too. Without derivatives, see
    `_search_around`.

    Args:
        evaluator: computes scores and derivatives.
        point: where to begin, shape (P,).
        score: its score [m, rad or 1].
        smallest: step at which it ends, in the unit box [1].

    Returns:
        The best point, and its score.
    """
    space = evaluator.space
    radius = _LARGEST_STEP
    planes: list[tuple[np.ndarray, float, np.ndarray]] = []
    while radius > smallest and not stop():
        if not planes:
            planes = [(point, value, slope) for value, slope in evaluator.slopes(point)]
            if not planes:
                return _search_around(evaluator, point, score, stop, max(smallest, _SMALLEST_MOVE))
            corner = len(planes)
        sizes = radius * 0.25 ** np.arange(4)
        whole = best_step(space, point, planes, radius) - point
        steps = [space.repair(point + part * whole) for part in sizes / radius]
        scores = evaluator.scores(steps)
        best = int(best_first(scores)[0])
        if improves(float(scores[best]), score):
            point, score = steps[best], float(scores[best])
            radius, planes = min(_LARGEST_STEP, 2.0 * sizes[best]), []
        elif len(planes) < corner + _BUNDLE:
            beyond = [(steps[best], value, slope) for value, slope in evaluator.slopes(steps[best])]
            if not beyond or not np.any(steps[best] != point):
                radius *= 0.25**4
                planes = planes[:corner]
            planes += beyond
        else:
            radius, planes = radius * 0.25**3, planes[:corner]
    return point, score


def _search_around(
    evaluator: Evaluator, point: np.ndarray, score: float, stop: Stop, smallest: float
) -> tuple[np.ndarray, float]:
    """Search without derivatives (compass search): move single unknowns by steps, halved where none is better."""
    radius = 0.5 * _LARGEST_STEP
    while radius > smallest and not stop():
        steps = radius * np.vstack((np.eye(point.size), -np.eye(point.size)))
        moved = [evaluator.space.repair(point + step) for step in steps]
        scores = evaluator.scores(moved)
        best = int(best_first(scores)[0])
        if improves(float(scores[best]), score):
            point, score = moved[best], float(scores[best])
        else:
            radius *= 0.5
    return point, score


def best_step(
    space: Space, point: np.ndarray, planes: list[tuple[np.ndarray, float, np.ndarray]], size: float
) -> np.ndarray:
    """Maximise the least of several planes within a trust region, the box and the rates.

    Args:
        point: the middle of the trust region, shape (P,).
        planes: the point at which each was found, its score there, and its derivatives.
        size: largest change of an unknown, in the unit box [1].

    Returns:
        The maximum, shape (P,).
    """
    matrix, bound = space.limits()
    low, high = np.maximum(-size, -point), np.minimum(size, 1.0 - point)
    if len(planes) == 1 and not bound.size:
        slope = planes[0][2]
        return np.asarray(point + np.where(slope > 0.0, high, np.where(slope < 0.0, low, 0.0)))
    from scipy.optimize import linprog  # takes a while to load, and few searches need it

    rows = [np.append(-slope, 1.0) for _, _, slope in planes]
    most = [value + slope @ (point - place) for place, value, slope in planes]
    if bound.size:
        rows += list(np.hstack((matrix, np.zeros((bound.size, 1)))))
        most += list(bound - matrix @ point)
    worst = np.array(most).min() - 1e3 * (1.0 + max(np.abs(slope).sum() for _, _, slope in planes))
    bounds = [*zip(low, high, strict=True), (worst, None)]
    found = linprog(np.append(np.zeros(point.size), -1.0), np.array(rows), most, bounds=bounds, method="highs")
    if found.x is None:
        return point
    return np.asarray(point + np.clip(found.x[:-1], low, high))
