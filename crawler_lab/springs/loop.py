"""The force of a spring with Maxwell-slip elements along measured elongations, and its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True, eq=False)
class LoopPath:
    """Elongations as monotone runs between turns, between which a stop is a line that is cut at both ends.

    Attributes:
        elongation: of the rows, shape (R,) [m].
        turns: elongations at which it turns round, from the first row on, shape (M,) [m].
        run: the turn at which the run of a row begins, shape (R,).
    """

    elongation: np.ndarray
    turns: np.ndarray
    run: np.ndarray

    def choose_rows(self, rows: np.ndarray) -> LoopPath:
        """Choose rows, at which the elements have the same forces as before.

        Args:
            rows: their numbers, or whether they are chosen.

        Returns:
            The path.
        """
        return LoopPath(self.elongation[rows], self.turns, self.run[rows])


class Shape(NamedTuple):
    """The numbers of pieces and of elements, and the order of the parameters.

    These are the force at elongation 0 [N], the stiffness of each piece [N/m], the knots between them [m], and for each
    element its yield f [N], the elongation r at which it yields [m], and its first force as a part of f [1].
    """

    knots: int
    elements: int

    @property
    def first_element(self) -> int:
        """Index of the parameters of the first element."""
        return 2 + 2 * self.knots

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.first_element + 3 * self.elements


def build_path(elongation: np.ndarray) -> LoopPath:
    """Find the turns of an elongation.

    Args:
        elongation: shape (R,) [m].

    Returns:
        The path.
    """
    change = np.diff(elongation)
    moving = np.flatnonzero(change)
    turning = moving[1:][change[moving[1:]] * change[moving[:-1]] < 0.0]
    starts = np.append(0, turning)
    run = np.searchsorted(starts, np.arange(elongation.size), side="right") - 1
    return LoopPath(elongation, elongation[starts], run)


def find_reversals(elongation: np.ndarray, least: float) -> np.ndarray:
    """Find where an elongation turns round by more than some length.

    Args:
        elongation: shape (R,) [m].
        least: that length [m].

    Returns:
        Numbers of rows: the first, the reversals, and the end of the last run.
    """
    path = build_path(elongation)
    starts = np.searchsorted(path.run, np.arange(path.turns.size))
    kept = [0]
    last = 0
    way = 0
    for row in (*starts[1:].tolist(), elongation.size - 1):
        change = elongation[row] - elongation[last]
        if way != 0 and way * change > 0.0:
            last = row
        elif abs(change) > least:
            if way != 0:
                kept.append(last)
            last, way = row, 1 if change > 0.0 else -1
    return np.array([*kept, last])


def follow_stop(path: LoopPath, reach: float, part: float) -> tuple[np.ndarray, np.ndarray]:
    """Follow the stretch of an element.

    Args:
        reach: elongation at which it yields [m].
        part: its first stretch as a part of that [1].

    Returns:
        The stretches, shape (R,) [m], and in which direction it yielded last, 0 before it yields, shape (R,).
    """
    stretch, way = part * reach, 0
    found = [(stretch, way)]
    for step in np.diff(path.turns).tolist():
        stretch += step
        if stretch >= reach:
            stretch, way = reach, 1
        elif stretch <= -reach:
            stretch, way = -reach, -1
        found.append((stretch, way))
    first = np.array(found)
    raw = first[path.run, 0] + path.elongation - path.turns[path.run]
    ways = np.where(raw >= reach, 1.0, np.where(raw <= -reach, -1.0, first[path.run, 1]))
    return np.clip(raw, -reach, reach), ways


def compute_spring(path: LoopPath, shape: Shape, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the force of only the spring, and its derivatives with respect to its own parameters.

    Returns:
        The force, shape (R,) [N], and the derivatives, shape (2 + 2 knots, R).
    """
    slopes, knots = x[1 : 2 + shape.knots], x[2 + shape.knots : shape.first_element]
    ends = np.concatenate(([-np.inf], knots, [np.inf]))
    z = path.elongation
    pieces = [np.clip(z, low, high) - np.clip(0.0, low, high) for low, high in pairwise(ends)]
    moved = [
        (before - after) * ((z > knot).astype(float) - (knot < 0.0))
        for before, after, knot in zip(slopes[:-1], slopes[1:], knots, strict=True)
    ]
    return x[0] + slopes @ np.array(pieces), np.array([np.ones(z.size), *pieces, *moved])


def compute_force(path: LoopPath, shape: Shape, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the force of the spring and of all elements, and its derivatives.

    Returns:
        The force, shape (R,) [N], and the derivatives, shape (P, R).
    """
    force, own = compute_spring(path, shape, x)
    rows = [*own]
    for j in range(shape.elements):
        limit, reach, part = x[shape.first_element + 3 * j :][:3]
        stretch, way = follow_stop(path, reach, part)
        elastic = way == 0.0
        force = force + limit * stretch / reach
        grown = np.where(elastic, part, way)  # derivative of the stretch for the reach
        rows += [stretch / reach, limit / reach * (grown - stretch / reach), np.where(elastic, limit, 0.0)]
    return force, np.array(rows)
