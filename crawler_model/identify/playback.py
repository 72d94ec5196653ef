"""The scene that plays a recording: its commands as the drive, with the values found."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..scene.scene import Scene
from .measurements import Measurements
from .replica import replay_scene

_STRAIGHT = 1e-12
"""A row this near to the line between its neighbours, relative to the range of its column, is left out."""


def playback(scene: Scene, measured: Measurements) -> Scene:
    """Build the scene whose drive is the recorded commands.

    Args:
        scene: the scene, with the values found.
        measured: a recording of it, checked.

    Returns:
        The scene; the given one if no commands were recorded, because its own drive was played then.
    """
    if not measured.command_names:
        return scene
    base = replay_scene(scene, measured)
    columns, names = base.columns, base.columns.names
    rows = np.tile(base.drive.rows[0], (measured.command_time.size, 1))
    rows[:, [names.index(name) for name in measured.command_names]] = measured.commands
    kept = _corners(measured.command_time, rows)
    rows = rows[kept]
    drive: dict[str, Any] = {"times": measured.command_time[kept].tolist()}
    drive["actuation"] = rows[:, : columns.lengths].tolist()
    commanded = {name.rpartition("/")[2] for name in measured.command_names}
    if commanded & {"forward", "backward"}:
        forward, backward = np.split(rows[:, columns.lengths : columns.lengths + columns.frictions], 2, axis=1)
        drive["friction"] = {"forward": forward.tolist(), "backward": backward.tolist()}
    if "load" in commanded:
        drive["loads"] = rows[:, columns.count - columns.loads :].tolist()
    return Scene.model_validate(base.document() | {"drive": drive})


def _corners(time: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """List the first row, the last one, and all that are not on the line between their neighbours."""
    size = _STRAIGHT * (np.abs(rows).max(axis=0) + np.ptp(rows, axis=0))
    part = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
    off = np.abs(rows[:-2] + part * (rows[2:] - rows[:-2]) - rows[1:-1]) > size
    return np.array([0, *(1 + np.flatnonzero(off.any(axis=1))), time.size - 1])
