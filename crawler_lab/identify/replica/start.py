"""The start of a recording that begins in the middle of life: friction holds unknown forces of the springs.

A body that walked before its recording began starts with forces d between the friction bounds, -b <= d <= f. It is
followed from a relaxed start: rest lengths u away from the first command, along one ramp to this command, on which
contacts slide where friction does not hold. Every start that friction allows is the end of such a ramp, and no u leads
to another one. For linear springs (f - d, b + d) have the same motion for all d: only sums f + b are determined.

On ground that differs from place to place both frictions are determined, and a number more tells where the body stands.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from crawler_model.body.drive import NS, Drive
from crawler_model.errors import SceneError
from crawler_model.scene.scene import Scene

from ...derivative.parameters import Derivatives
from ..measurements import Measurements
from .follow import begin_path
from .playback import relax, replay_scene

_LINEAR = 1e-9


def is_start_told(scene: Scene, keys: Sequence[str]) -> bool:
    """Determine whether a scene or the keys that are fitted tell where a recording starts.

    Args:
        keys: of the parameters.

    Returns:
        Whether `start` occurs in either.
    """
    return scene.parts.start is not None or any(key.startswith("start") for key in keys)


def begin_recordings(scene: Scene, keys: Sequence[str], recordings: Sequence[Measurements]) -> tuple[Scene, bool]:
    """Choose the start of a scene: if nothing tells it, relaxed springs where it is found, or no other is admissible.

    Args:
        keys: of the parameters.
        recordings: of the scene, checked.

    Returns:
        The scene, and whether its start is only a guess of what is found with the parameters.

    Raises:
        SceneError: if no start is admissible.
    """
    if is_start_told(scene, keys):
        return scene, False
    relaxed = relax(scene)
    fits = scene.dimension == 1 and not scene.body.memory
    if fits and find_moves(replay_scene(relaxed, recordings[0])) is not None:
        return relaxed, True
    try:
        for measured in recordings:
            replay_scene(scene, measured)
    except SceneError:
        return relaxed, False
    return scene, False


def find_moves(scene: Scene) -> np.ndarray | None:
    """Compute how a body moves that stays relaxed while its rest lengths change.

    Args:
        scene: the scene that plays a recording, relaxed at the start.

    Returns:
        Displacement by rest length, shape (N, S) [1]; None if they are not commanded one by one, or a spring beside an
        actuator has forces of its own.
    """
    body, columns = scene.body, scene.columns
    if columns.lengths != body.springs or columns.links != body.springs:
        return None
    first = scene.drive.targets[0, : body.springs]
    steps = 0.01 * np.eye(body.springs) * max(float(np.ptp(body.position)), 1e-12)
    middle = body.relaxed(first)
    ahead, behind = (np.array([body.relaxed(first + side * step) for step in steps]) - middle for side in (1.0, -1.0))
    moves = (ahead / steps.diagonal()[:, None]).T
    elongated = np.array([body.elongation(move) for move in moves.T])
    size = np.abs(ahead).max()
    straight = np.abs(ahead + behind).max() <= _LINEAR * size
    return moves if straight and np.abs(elongated - np.eye(body.springs)).max() <= _LINEAR else None


def walk_in(
    scene: Scene, derivatives: Derivatives, stretch: np.ndarray, moves: np.ndarray
) -> tuple[Scene, Derivatives] | None:
    """Let the springs of a relaxed body pull before its recording begins.

    Args:
        scene: the scene that plays the recording, relaxed at the start.
        derivatives: of its arrays, shape (..., P).
        stretch: u, shape (S,) [m].
        moves: from `find_moves`.

    Returns:
        The scene with this start, and the derivatives with a column more for each u; None if the motion has too many
        events.
    """
    drive, springs = scene.drive, scene.body.springs
    rows = np.tile(drive.rows[:1], (2, 1))
    rows[0, :springs] += stretch
    own = np.zeros((2, drive.columns.count, springs))
    own[0, :springs] = np.eye(springs)
    added = np.stack([drive.columns.spread(own[..., j]) for j in range(springs)], axis=-1)
    targets = np.broadcast_to(derivatives.targets[:1], (2, *derivatives.targets.shape[1:]))
    before = _widen(derivatives, springs, np.concatenate((targets, added), axis=-1), moves)
    before = dataclasses.replace(before, times=np.zeros((2, before.values.size)))
    start = scene.start_displacement + moves @ stretch
    walked: Any = dataclasses.replace(
        scene, drive=Drive(np.array([0.0, 1.0]), None, rows, drive.columns), start_displacement=start
    )
    path, vertices = begin_path(walked, before, np.array([NS], np.int64), recorded=True)
    end = path.follow_vertices(vertices)
    none = np.zeros((*derivatives.targets.shape[:-1], springs))
    if derivatives.targets.strides[0] == 0:  # the same for all rows, and not copied
        wide = np.concatenate((derivatives.targets[:1], none[:1]), axis=-1)
        targets = np.broadcast_to(wide[0], (*derivatives.targets.shape[:-1], wide.shape[-1]))
    else:
        targets = np.concatenate((derivatives.targets, none), axis=-1)
    after = _widen(derivatives, springs, targets, moves)
    changed: Any = dataclasses.replace(scene, start_displacement=end.x[-1] + end.rest[-1])
    return changed, dataclasses.replace(after, start=end.dx[-1])


def _widen(derivatives: Derivatives, count: int, targets: np.ndarray, moves: np.ndarray) -> Derivatives:
    """Add columns for the numbers of the start."""
    parts = {}
    for name in ("stiffness", "pieces", "start", "times", "period"):
        array = getattr(derivatives, name)
        parts[name] = np.concatenate((array, np.zeros((*array.shape[:-1], count))), axis=-1)
    parts["start"][:, -count:] = moves
    names = (*derivatives.names, *(f"start {j}" for j in range(count)))
    values = np.append(derivatives.values, np.zeros(count))
    return dataclasses.replace(derivatives, names=names, values=values, targets=targets, **parts)
