"""Commands from their parts: checked, and written to a row."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import FLOAT, check_numbers
from ..body.columns import Columns
from ..body.directions import check_directions
from ..body.plan import Plan
from ..body.turning import check_sides
from ..errors import LARGEST, CommandError, SceneError


def write_command(
    scene: Plan,
    before: np.ndarray | None,
    actuation: ArrayLike,
    forward: ArrayLike | None,
    backward: ArrayLike | None,
    loads: ArrayLike | None,
) -> np.ndarray:
    """Check a command, given as for `Crawler.advance`, and write it to a row.

    Args:
        scene: the scene.
        before: the row in force, shape (C,); None if only its target is known.
        actuation: of links and segments or joints [m, 1, rad].
        forward: friction; None leaves it unchanged [N, N/m].
        backward: the same.
        loads: of contacts and segments; None leaves them unchanged [N, N/m].

    Returns:
        The row, shape (C,), with NaN for what the command leaves out where no row is in force.

    Raises:
        CommandError: if a value is invalid; the message names the first one.
    """
    columns = scene.columns
    if before is not None and forward is None and backward is None and loads is None:
        lengths = _read_lengths(columns, actuation)
        if lengths is not None:
            row = before.copy()
            row[: lengths.size] = lengths
            return row
    planar = columns.planar is not None
    row = np.full(columns.count, np.nan) if before is None else before.copy()
    half = columns.lengths + int(columns.friction_sizes.sum())
    if planar and backward is not None:
        raise CommandError("backward: in the plane `forward` holds the friction of each contact; omit `backward`")
    if loads is not None and not columns.loads:
        raise CommandError("loads: the scene has no loads; add `loads: 0` to the scene to command loads")
    given = (
        ("actuation", actuation, columns.actuation_sizes, 0),
        ("forward", forward, columns.friction_sizes, columns.lengths),
        ("backward", backward, columns.friction_sizes, half),
        ("loads", loads, columns.load_sizes, columns.count - columns.loads),
    )
    for name, values, sizes, first in given:
        if values is None and name != "actuation":
            continue
        each = int(sizes[0]) if planar and sizes.size else 1
        array = check_numbers(name, values, (sizes.size,) if each == 1 else (sizes.size, each)).ravel()
        if name in ("forward", "backward") and not (array >= 0.0).all():
            i = int(np.flatnonzero(array < 0.0)[0])
            raise CommandError(f"{name}: {columns.names[first + i]} is {array[i]:g}; friction must be >= 0")
        if columns.planar and name == "forward":
            _check_by_direction(scene, array.reshape(sizes.size, each))
        row[first : first + int(sizes.sum())] = array if each > 1 else np.repeat(array, sizes)
    return row


def _read_lengths(columns: Columns, actuation: ArrayLike) -> np.ndarray | None:
    """Read what most commands hold, one finite number a column, in a few calls; None if it needs a closer look."""
    try:
        array = np.asarray(actuation)
    except ValueError:
        return None
    if array.shape != columns.plain_lengths or array.dtype is not FLOAT:
        return None
    flat = array.ravel()
    return flat if np.vdot(flat, flat) <= LARGEST**2 else None  # without a warning where the square overflows


def _check_by_direction(scene: Plan, friction: np.ndarray) -> None:
    """Check friction that depends on the direction, shape (N, m), for a body that turns (N, 4)."""
    if scene.body.turning is not None:
        check_sides(friction, "forward", CommandError)
        return
    try:
        check_directions(scene.angles, friction)
    except SceneError as error:
        raise CommandError(f"forward: {error}") from None
