"""Changes of a model beyond its parameters: the gain of its actuators, and what might explain a misfit."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...derivative.parameters import Derivatives
from ...scene.scene import Scene


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


def apply_gain(scene: Scene, derivatives: Derivatives, gain: float) -> tuple[Scene, Derivatives]:
    """Multiply all commanded lengths by the gain of the actuators.

    Args:
        scene: the scene.
        derivatives: of its arrays.
        gain: its error [1].

    Returns:
        The scene and the derivatives with this gain.
    """
    if gain == 0.0:
        return scene, derivatives
    drive, lengths = scene.drive, scene.drive.columns.lengths
    rows = drive.rows.copy()
    rows[:, :lengths] *= 1.0 + gain
    targets = derivatives.targets.copy()
    targets[:, : scene.body.springs] *= 1.0 + gain
    changed: Any = dataclasses.replace(scene, drive=dataclasses.replace(drive, rows=rows))
    return changed, dataclasses.replace(derivatives, targets=targets)


def differentiate_gain(scene: Scene) -> Change:
    """Build the derivatives with respect to the gain of the actuators.

    Args:
        scene: a scene without an error of the gain.

    Returns:
        The change by a gain error of 1.
    """
    rows = np.zeros(scene.drive.rows.shape)
    lengths = scene.drive.columns.lengths
    rows[:, :lengths] = scene.drive.rows[:, :lengths]
    return Change("gain", rows)


def add_changes(scene: Scene, derivatives: Derivatives, changes: Sequence[Change]) -> Derivatives:
    """Add a column for each change.

    Args:
        scene: the scene.
        derivatives: of its arrays.
        changes: the changes.

    Returns:
        The derivatives with these columns, after the others.
    """
    if not changes:
        return derivatives
    columns, count = scene.drive.columns, len(changes)
    parts = {
        name: np.zeros((*getattr(derivatives, name).shape[:-1], count))
        for name in ("stiffness", "pieces", "start", "times", "period")
    }
    for k, change in enumerate(changes):
        if change.stiffness is not None:
            parts["stiffness"][:, k] = change.stiffness
    parts["targets"] = np.stack([change.rows[:, columns.index] * columns.factor for change in changes], axis=-1)
    wide = {name: np.concatenate((getattr(derivatives, name), part), axis=-1) for name, part in parts.items()}
    names = (*derivatives.names, *(change.name for change in changes))
    return dataclasses.replace(derivatives, names=names, values=np.append(derivatives.values, np.zeros(count)), **wide)
