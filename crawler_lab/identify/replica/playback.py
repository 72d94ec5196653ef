"""Scenes that play a recording: with its first command, and with all of them as the drive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from crawler_model.body.turning import SIDES
from crawler_model.errors import SceneError
from crawler_model.scene.scene import Scene

from ..measurements import Measurements

_STRAIGHT = 1e-12
"""A row this near to the line between its neighbours, relative to the range of its column, is left out."""


def relax(scene: Scene) -> Scene:
    """Let the springs of a scene carry no force at the start.

    Returns:
        The scene with this start.
    """
    return Scene.model_validate(scene.document() | {"start": "relaxed"})


def replay_scene(scene: Scene, measured: Measurements, start: np.ndarray | None = None) -> Scene:
    """Build the scene whose drive is replaced by the first recorded command.

    Args:
        start: displacement at the start, shape (N,) [m]; None for the scene's.

    Returns:
        The scene itself if no commands were recorded.

    Raises:
        SceneError: if its start is not admissible under this command.
    """
    begun = {} if start is None else {"start": {"displacement": start.tolist()}}
    if not measured.command_names:
        return Scene.model_validate(scene.document() | begun) if begun else scene
    place = {name: c for c, name in enumerate(measured.command_names)}
    document = scene.document() | begun
    if scene.columns.loads and "loads" not in document:  # only its drive commands them
        document["loads"] = 0.0 if scene.dimension == 1 else [0.0, 0.0]
    parts = len(document["body"].get("segments", ()))
    links = scene.columns.names[: scene.columns.lengths]
    if scene.dimension == 1 and scene.columns.lengths != scene.columns.links + parts:
        raise SceneError(f"{scene.name}: the strain of a segment varies along it; commands must be constant")
    row = _as_actuation(scene, measured.commands[:1, [place[name] for name in links]])
    document["drive"] = {"times": [0.0, 1.0], "actuation": row * 2}
    return Scene.model_validate(document)


def scale_drive(drive: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """Multiply all lengths, strains and angles that a drive commands.

    Args:
        drive: the part `drive` of a scene.
        factor: of the lengths [1].

    Returns:
        The part.
    """
    scaled = dict(drive)
    if "actuation" in drive:
        scaled["actuation"] = (factor * np.array(drive["actuation"])).tolist()
    if "length" in drive:
        scaled["length"] = factor * drive["length"]
    if "wave" in drive:
        scaled["wave"] = dict(drive["wave"])
        for name in {"amplitude", "mean"} & set(drive["wave"]):
            scaled["wave"][name] = factor * drive["wave"][name]
    return scaled


def measure_speeds(scene: Scene) -> dict[str, float]:
    """Measure the fastest change of each length that a drive commands.

    Args:
        scene: the scene with the drive.

    Returns:
        By the name of its column [m/s, of segments 1/s, of joints rad/s].
    """
    drive, columns = scene.drive, scene.columns
    times, rows = drive.times, drive.rows[:, : columns.lengths]
    if drive.period is not None and drive.period > times[-1]:
        times, rows = np.append(times, drive.period), np.vstack((rows, rows[:1]))
    seconds = np.diff(times)
    change = np.abs(np.diff(rows, axis=0))[seconds > 0.0] / seconds[seconds > 0.0, None]
    return dict(zip(columns.names[: columns.lengths], change.max(axis=0, initial=0.0).tolist(), strict=True))


def playback(scene: Scene, measured: Measurements, gain: float = 0.0, start: np.ndarray | None = None) -> Scene:
    """Build the scene whose drive is the recorded commands.

    Args:
        scene: the scene, with the values found.
        measured: a recording of it, checked.
        gain: error of the gain of the actuators, which multiply all lengths by 1 + gain [1].
        start: displacement at the start that was found, shape (N,) [m]; None for the scene's. Springs are relaxed
            instead if numbers that were not determined do not allow it.

    Returns:
        The scene; where no commands were recorded, its own drive was played.
    """
    try:
        base = replay_scene(scene, measured, start)
    except SceneError:
        if start is None:
            raise
        base = replay_scene(relax(scene), measured)
    if not measured.command_names:
        scene = base
        if gain == 0.0 or scene.parts.drive is None:
            return scene
        document = scene.document()
        return Scene.model_validate(document | {"drive": scale_drive(document["drive"], 1.0 + gain)})
    columns, names = base.columns, base.columns.names
    rows = np.tile(base.drive.rows[0], (measured.command_time.size, 1))
    rows[:, [names.index(name) for name in measured.command_names]] = measured.commands
    kept = _corners(measured.command_time, rows)
    rows = rows[kept]
    rows[:, : columns.lengths] *= 1.0 + gain
    drive: dict[str, Any] = {"times": measured.command_time[kept].tolist()}
    drive["actuation"] = _as_actuation(scene, rows[:, : columns.lengths])
    loads = columns.lengths + columns.frictions
    if not set(names[columns.lengths : loads]).isdisjoint(measured.command_names):
        drive["friction"] = _as_friction(scene, rows[:, columns.lengths : loads])
    if not set(names[loads:]).isdisjoint(measured.command_names):
        drive["loads"] = _as_pairs(rows[:, loads:]) if scene.dimension == 2 else rows[:, loads:].tolist()
    return Scene.model_validate(base.document() | {"drive": drive})


def _as_actuation(scene: Scene, rows: np.ndarray) -> list[Any]:
    """Convert commanded lengths to rows of a drive, in which links without a length have pairs of components."""
    return _as_pairs(rows) if scene.dimension == 2 and scene.body.turning is None else rows.tolist()


def _as_pairs(rows: np.ndarray) -> list[Any]:
    return rows.reshape(rows.shape[0], -1, 2).tolist()


def _as_friction(scene: Scene, rows: np.ndarray) -> dict[str, Any]:
    """Convert commanded frictions to frictions of a drive."""
    if scene.dimension == 2 and scene.body.turning is None:
        return {"isotropic": rows.tolist()}
    if scene.dimension == 2:
        return {side: rows[:, k :: len(SIDES)].tolist() for k, side in enumerate(SIDES)}
    return dict(zip(("forward", "backward"), (half.tolist() for half in np.split(rows, 2, axis=1)), strict=True))


def _corners(time: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """List the first row, the last one, and all that are not on the line between their neighbours."""
    size = _STRAIGHT * (np.abs(rows).max(axis=0) + np.ptp(rows, axis=0))
    part = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
    off = np.abs(rows[:-2] + part * (rows[2:] - rows[:-2]) - rows[1:-1]) > size
    return np.array([0, *(1 + np.flatnonzero(off.any(axis=1))), time.size - 1])
