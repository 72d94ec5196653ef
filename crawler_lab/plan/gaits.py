"""Gaits from which plans may start, in several phases: of links one after another, or as the drive of a scene."""

from __future__ import annotations

import numpy as np

from .limits import Limits
from .robot import Start

_PHASES_OF_LINK, _MOST_PHASES = 4, 16
_STROKES = (0.25, 0.5, 1.0)
"""Parts of the stroke of gaits of links one after another [1]."""
_PHASES_OF_DRIVE = 2
_STROKES_OF_DRIVE = (0.4, 1.0)
"""Parts of the stroke of all actuators, and of one that is weaker than the others and so steers [1]."""


def list_gaits(start: Start, limits: Limits, count: int) -> list[np.ndarray]:
    """List phases of gaits.

    Args:
        start: where they start.
        limits: of the commands.
        count: number of steps H.

    Returns:
        Plans within the limits, shape (H, J) each [m, rad].
    """
    scene = start.robot.scene
    list_all = _list_drives if scene.body.turning is not None and scene.drive.times.size > 1 else _list_sequences
    return [limits.keep(start.before, rows) for rows in list_all(start, limits, count)]


def _list_sequences(_: Start, limits: Limits, count: int) -> list[np.ndarray]:
    """List gaits in which links lengthen one after another and shorten in the same order."""
    span = limits.high - limits.low
    moved = np.flatnonzero(span > 0.0)
    phases = min(_PHASES_OF_LINK * moved.size, _MOST_PHASES)
    found = []
    for part in _STROKES:
        steps = max(float((part * span[moved] / limits.change[moved]).max()), 0.5)  # for one stroke
        turn = np.arange(1, count + 1)[:, None] / steps - np.arange(moved.size)
        places = 2.0 * moved.size * np.arange(phases) / phases
        for order in (moved, moved[::-1]):
            for place in places:
                since = np.mod(place + turn, 2.0 * moved.size)
                rows = np.tile(limits.low, (count, 1))
                rows[:, order] += part * span[order] * np.clip(np.minimum(since, moved.size + 1.0 - since), 0.0, 1.0)
                found.append(rows)
    return found


def _list_drives(start: Start, limits: Limits, count: int) -> list[np.ndarray]:
    """List phases of the scene's drive, as fast as the limits allow, with all strokes or one of them less."""
    drive, size = start.robot.scene.drive, limits.low.size
    moved, rest = np.flatnonzero(limits.high > limits.low), start.robot.before
    rows = drive.rows[:, :size]
    span = np.ptp(rows, axis=0)
    span[span == 0.0] = np.inf
    phase = drive.times / drive.times[-1]
    shape = limits.low + (limits.high - limits.low) * (rows - rows.min(axis=0)) / span - rest
    found = []
    for weaker in (None, *moved.tolist()) if moved.size > 1 else (None,):
        for part in _STROKES_OF_DRIVE:
            scale = np.full(size, part)
            if weaker is not None:
                scale[weaker] *= _STROKES_OF_DRIVE[0]
            rates = np.abs(np.diff(scale * shape, axis=0))[:, moved] / np.diff(phase)[:, None]
            steps = max(float((rates / limits.change[moved]).max()), 2.0)  # for a period
            for begin in np.arange(_PHASES_OF_DRIVE) / _PHASES_OF_DRIVE:
                at = np.mod(begin + np.arange(1, count + 1) / steps, 1.0)
                found.append(rest + scale * np.column_stack([np.interp(at, phase, column) for column in shape.T]))
    return found
