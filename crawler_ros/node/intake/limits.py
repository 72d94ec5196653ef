"""Limits of commands: a length many times the body's is a mistake, such as millimetres for metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crawler_model import Scene
from crawler_model.body.body import Body
from crawler_model.body.columns import Columns
from crawler_model.errors import LARGEST, CommandError

_BODY_LENGTHS = 10.0
"""Lengths of the body by which a link may change: more than twice what any scene of the gallery commands."""
_FRICTION_RATIO = 1000.0
"""The largest friction that is accepted, relative to the scene's."""


@dataclass(frozen=True, eq=False)
class Limits:
    """The largest size of each number of a command row.

    Attributes:
        largest: shape (C,) [m, 1, rad, N, N/m].
        lengths: number of columns that hold lengths, strains and angles.
        frictions: number of columns after them that hold friction; loads follow.
        angles: number of the last of the lengths that are angles instead.
    """

    largest: np.ndarray
    lengths: int
    frictions: int
    angles: int = 0

    @staticmethod
    def none(columns: Columns) -> Limits:
        """Build limits that accept all that doubles can hold, in all columns."""
        return Limits(np.full(columns.count, LARGEST), columns.lengths, columns.frictions)

    def hold(self, values: np.ndarray) -> bool:
        """Determine whether the first numbers of a row are within their limits; NaN is not.

        Args:
            values: shape (M,).

        Returns:
            True if `check` would accept them, and they are finite.
        """
        return np.count_nonzero(np.abs(values) <= self.largest[: values.size]) == values.size  # quicker than all()

    def check(self, what: str, names: Sequence[str], values: np.ndarray, columns: np.ndarray | int = 0) -> None:
        """Refuse numbers beyond their limits.

        Args:
            what: name of the message, for the error.
            names: the M names of the numbers.
            values: shape (M,).
            columns: the column of each, shape (M,), or the first of M consecutive ones.

        Raises:
            CommandError: naming the number, its limit and the parameter.
        """
        which = slice(columns, columns + values.size) if isinstance(columns, int) else columns
        largest = self.largest[which]
        excess = np.abs(values) > largest
        if not excess.any():
            return
        i = int(np.argmax(excess))
        if not np.isfinite(values[i]):
            raise CommandError(f"{what}: {names[i]} is {values[i]:g}; it must be finite")
        column = columns + i if isinstance(columns, int) else columns[i]
        parameter = "limit.length, in m," if column < self.lengths else "limit.friction, in N,"
        source = f"set the parameter {parameter} to accept more"
        if self.lengths - self.angles <= column < self.lengths:
            source = "a whole turn, or the largest angle of the drive"
        raise CommandError(f"{what}: {names[i]} is {values[i]:g}; at most {largest[i]:g} is accepted ({source})")


def body_length(body: Body) -> float:
    """Compute the extent of the body at rest along its longest axis [m]."""
    return float(np.ptp(np.atleast_2d(body.position.T), axis=1).max())


def _spans(body: Body) -> list[float]:
    return [float(body.position[s.last] - body.position[s.first]) for s in body.segments]


def lengths_of_columns(scene: Scene) -> np.ndarray:
    """Find by which length the number of a column changes a part of the body.

    Args:
        scene: the scene that is commanded.

    Returns:
        The length of a segment for its strain, 1 m of links, 1 of angles, shape (lengths,) [m].
    """
    columns = scene.columns
    parts = np.concatenate(([1.0] * columns.links, _spans(scene.body), [1.0] * (columns.joints or 0)))
    return np.repeat(parts, columns.actuation_sizes)


def command_limits(scene: Scene, length: float = 0.0, friction: float = 0.0) -> Limits:
    """Compute the limits of a scene's commands.

    A strain is limited so that its segment lengthens by no more than a link may, and a friction per length so that its
    segment has no more friction than a contact may. The angle of a joint may change by a whole turn, or by as much as
    in the scene's drive if that is more.

    Args:
        scene: the scene that is commanded.
        length: limit of a link's change of rest length [m]; 0 for ten lengths of the body, or the largest command of
            the scene's drive if that is more.
        friction: limit of a contact's friction [N]; 0 for a thousand times the largest in the scene, or the friction
            that holds the body stretched to a thousand times its length if that is more.

    Returns:
        The limits.
    """
    columns, body, rows = scene.columns, scene.body, np.abs(scene.drive.rows)
    extent = body_length(body)
    spans = _spans(body)
    angles = columns.joints or 0
    spread = lengths_of_columns(scene)[: columns.lengths - angles]
    longest = length or max(_BODY_LENGTHS * extent, (rows[:, : spread.size] * spread).max(initial=0.0))
    widest = max(2.0 * np.pi, rows[:, spread.size : columns.lengths].max(initial=0.0))
    ground = np.repeat(np.concatenate(([1.0] * columns.contacts, spans)), columns.friction_sizes)
    ground = np.tile(ground, columns.sides)
    strongest = friction or _FRICTION_RATIO * max(
        (rows[:, columns.lengths :][:, : columns.frictions] * ground).max(initial=0.0),
        body.stiffness.max(initial=0.0) * extent,
    )
    loads = np.repeat(np.concatenate(([1.0] * columns.contacts, spans)), columns.load_sizes)[: columns.loads]
    largest = np.concatenate((longest / spread, np.full(angles, widest), strongest / ground, strongest / loads))
    return Limits(np.minimum(largest, LARGEST), columns.lengths, columns.frictions, angles)
