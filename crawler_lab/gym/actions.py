"""Actions: which columns of a command are free, within which bounds, and how fast they may change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model import CrawlerError, Scene

_PART = 0.25
"""Default stroke of a link without a drive: as far as this part of its length, in both directions."""
_STRAIN = 0.2
"""Default strain of a segment without a drive."""


@dataclass(frozen=True, eq=False)
class Actions:
    """The free columns of a command.

    Attributes:
        of: for each column the action that moves it, or -1, int64, shape (C,).
        limits: largest change in a step, least and largest value of each column, shape (3, C) [m, 1, N, N/m].
        names: name of each action.
    """

    of: np.ndarray
    limits: np.ndarray
    names: tuple[str, ...]

    @property
    def free(self) -> np.ndarray:
        """The free columns, int64."""
        return np.flatnonzero(self.of >= 0)


def build_actions(
    scene: Scene,
    stroke: Sequence[float] | None,
    friction: Sequence[float] | None,
    steps_per_stroke: float,
) -> Actions:
    """Find the free columns of a scene's commands.

    Rest lengths and strains are free. Friction is free where the drive of the scene changes it, or everywhere within
    given bounds; both directions of a contact are one action if the drive changes them alike.

    Args:
        scene: the scene.
        stroke: least and largest change of a rest length [m] (of segments: strain); None for the drive's, and without a
            drive for a quarter of the length of each link.
        friction: least and largest friction of each contact [N] (of segments: [N/m]); None for the drive's.
        steps_per_stroke: number of steps in which an action of size 1 goes from one bound to the other.

    Returns:
        The actions.

    Raises:
        CrawlerError: if bounds are not two numbers in order, or friction cannot be commanded.
    """
    columns, rows = scene.columns, scene.drive.rows
    low, high = rows.min(axis=0), rows.max(axis=0)
    lengths = columns.lengths
    if stroke is not None:
        low[:lengths], high[:lengths] = check_range("stroke", stroke)
    else:
        reach = _default_strokes(scene)
        still = np.flatnonzero(low[:lengths] == high[:lengths])
        low[still] -= reach[still]
        high[still] += reach[still]
    first, last = lengths, lengths + columns.frictions
    if friction is not None:
        if columns.planar:
            raise CrawlerError("friction: friction that depends on the direction cannot be commanded")
        low[first:last], high[first:last] = check_range("friction", friction)
        if low[first:last].min(initial=0.0) < 0.0:
            raise CrawlerError(f"friction: {friction!r}; friction must be >= 0")
    for name, some in (("stroke", slice(0, lengths)), ("friction", slice(first, last))):
        check_start(name, columns.names[some], rows[0, some], low[some], high[some])
    of = np.full(columns.count, -1, np.int64)
    of[:lengths] = np.arange(lengths)
    names = list(columns.names[:lengths])
    half = columns.frictions // columns.sides
    for c in range(first, first + half):
        both = [c] if columns.sides == 1 else [c, c + half]
        alike = friction is not None or (rows[:, both] == rows[:, [c]]).all()
        for group in [both] if alike else [[one] for one in both]:
            if high[group[0]] > low[group[0]]:
                of[group] = len(names)
                name = columns.names[group[0]]
                names.append(f"{name.rpartition('/')[0]}/friction" if len(group) > 1 else name)
    return Actions(of, np.stack(((high - low) / steps_per_stroke, low, high)), tuple(names))


def _default_strokes(scene: Scene) -> np.ndarray:
    """Compute the default stroke of each column with a length or a strain."""
    body, columns = scene.body, scene.columns
    spans = body.position[body.ends[body.link_springs, 1]] - body.position[body.ends[body.link_springs, 0]]
    if body.dimension == 2:
        spans = np.repeat(np.linalg.norm(spans, axis=1), 2)
    strains = np.full(columns.lengths - spans.size, _STRAIN)
    return np.concatenate((_PART * np.abs(spans), strains))


def check_start(name: str, columns: Sequence[str], start: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
    """Check that bounds of commands include the commands at the start.

    Args:
        name: name of the field.
        columns: name of each command, C in all.
        start: commands at the start, shape (C,).
        low: least values, shape (C,).
        high: largest values, shape (C,).

    Raises:
        CrawlerError: if one is outside.
    """
    for column, value, least, most in zip(columns, start, low, high, strict=True):
        if not least <= value <= most:
            raise CrawlerError(
                f"{name}: {column} is {value:g} at the start; the bounds {least:g} .. {most:g} must include it"
            )


def check_range(name: str, given: Any) -> tuple[float, float]:
    """Check two numbers in order.

    Args:
        name: name of the field.
        given: the numbers.

    Returns:
        The least and the largest.

    Raises:
        CrawlerError: if there are not two finite numbers in order.
    """
    try:
        low, high = (float(value) for value in given)
    except (TypeError, ValueError, OverflowError):
        low = high = math.nan
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise CrawlerError(f"{name}: {given!r}; it must be two finite numbers [least, largest], in order")
    return low, high
