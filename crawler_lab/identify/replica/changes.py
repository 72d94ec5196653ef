"""Changes of a model beyond its parameters: the gain of its actuators, and what might explain a misfit."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model.scene.scene import Scene

from ...derivative.parameters import Derivatives


@dataclass(frozen=True)
class Change:
    """A direction in which the model may change: derivatives of its arrays with respect to one more number.

    Attributes:
        name: what changes.
        rows: of the rows of the drive, shape (K, C).
        stiffness: shape (S,) [N/m]; None if it does not change.
    """

    name: str
    rows: np.ndarray
    stiffness: np.ndarray | None = None


def apply_gain(scene: Scene, gain: float) -> Scene:
    """Multiply all commanded lengths by the gain of the actuators.

    Returns:
        The scene with this gain.
    """
    drive = scene.drive
    rows = drive.rows.copy()
    rows[:, : drive.columns.lengths] *= 1.0 + gain
    changed: Any = dataclasses.replace(scene, drive=dataclasses.replace(drive, rows=rows))  # type: ignore[type-var]
    return changed


def apply_changes(
    scene: Scene, derivatives: Derivatives, gain: float, with_gain: bool, changes: Sequence[Change]
) -> tuple[Scene, Derivatives]:
    """Apply the gain of the actuators, and add a column of derivatives for it and for each change.

    Args:
        changes: the changes.

    Returns:
        The scene with this gain, and the derivatives with these columns after the others.
    """
    columns, springs = scene.drive.columns, scene.body.springs
    if with_gain:
        moved = np.arange(columns.count) < columns.lengths
        changes = (Change("gain", np.where(moved, scene.drive.rows, 0.0)), *changes)
    if gain != 0.0:
        targets = derivatives.targets.copy()
        targets[:, :springs] *= 1.0 + gain
        scene, derivatives = apply_gain(scene, gain), dataclasses.replace(derivatives, targets=targets)
    if not changes:
        return scene, derivatives
    count = len(changes)
    parts = {
        name: np.zeros((*getattr(derivatives, name).shape[:-1], count))
        for name in ("stiffness", "pieces", "start", "times", "period")
    }
    for k, change in enumerate(changes):
        if change.stiffness is not None:
            parts["stiffness"][:, k] = change.stiffness
    parts["targets"] = np.stack([columns.spread(change.rows) for change in changes], axis=-1)
    wide = {name: np.concatenate((getattr(derivatives, name), part), axis=-1) for name, part in parts.items()}
    names = (*derivatives.names, *(change.name for change in changes))
    values = np.append(derivatives.values, np.zeros(count))
    return scene, dataclasses.replace(derivatives, names=names, values=values, **wide)
