"""The arrays of the kernels: what all lanes share, and the parts of a lane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model import Scene
from crawler_model.crawler.readout import Readout
from crawler_model.motion.account import ACCOUNT_SIZE
from crawler_ros.wire.states import StationReader, shown_contacts

from .kernel import layout
from .spec import Spec


@dataclass(frozen=True, eq=False)
class Shared:
    """What all lanes of a scene share, see `kernel.layout.open_layout`.

    Attributes:
        floats: numbers.
        ints: whole numbers.
        lane_at: offsets of the parts of a lane.
    """

    floats: np.ndarray
    ints: np.ndarray
    lane_at: np.ndarray


def build_shared(spec: Spec) -> Shared:
    """Collect what all lanes of a scene share.

    Args:
        spec: the settings of the environments.

    Returns:
        The arrays.
    """
    scene, actions, task, spans, rate = spec.scene, spec.actions, spec.task, spec.spans, spec.rate
    body, columns, axes = scene.body, scene.columns, scene.dimension
    shown = shown_contacts(body)
    stations = Readout(body, shown).joints if axes == 1 else np.zeros((0, 3), np.int64)
    frictions = actions.free[actions.free >= columns.lengths]
    goal = [task.speed, task.tolerance, spec.price, *task.direction, *task.place]
    floats = [actions.limits, columns.factor, place_weights(scene), np.stack((spans.bound, spans.scale)), goal]
    ints = [actions.of, columns.index, stations, frictions]
    settings = [task.kind, axes, spec.steps, rate.numerator, rate.denominator]
    joints, feet = axes * (1 + body.joints.shape[0]), axes * shown.size
    loaded = columns.slope_load is not None and axes == 1 and has_kernel(scene)
    n, a = body.contacts, len(actions.names)
    sizes = {
        layout.DISPLACEMENT: axes * n,
        layout.SLOPE: n if loaded else 0,
        layout.ROW: columns.count,
        layout.HELD: columns.count if loaded else 0,
        layout.TARGET: columns.index.size,
        layout.ACCOUNT: ACCOUNT_SIZE,
        layout.JOINTS: 3 * joints,
        layout.FEET: 3 * feet,
        layout.MEMORY: axes + 3,
        layout.QUEUE: (spec.ranges.most_delay + 1) * a,
        layout.SIGMA: 1,
        layout.RESULT: 6,
        layout.OBSERVATION: spans.bound.size,
    }
    numbers, floats_at = _join(floats, np.float64)
    whole, ints_at = _join(ints, np.int64)
    lane_at = np.concatenate(([0], np.cumsum([sizes[k] for k in range(layout.PARTS)]))).astype(np.int64)
    head = np.concatenate((settings, lane_at, floats_at, ints_at + len(settings) + lane_at.size + 11))
    return Shared(numbers, np.concatenate((head, whole)).astype(np.int64), lane_at)


def has_kernel(scene: Scene) -> bool:
    """Determine whether the lanes of a scene advance in one compiled call.

    Args:
        scene: the scene.

    Returns:
        True for bodies on a line with linear springs, on ground that is the same everywhere.
    """
    return scene.dimension == 1 and scene.ground.track is None and not scene.body.bends


def place_weights(scene: Scene) -> np.ndarray:
    """Compute by which weights the net translation follows from the positions of joint_states.

    Args:
        scene: the scene.

    Returns:
        Weights of each axis in turn, shape (axes, W); for a segment its two ends count.
    """
    body, axes = scene.body, scene.dimension
    reader, width = StationReader(body), 1 + body.joints.shape[0]
    each = np.stack([reader.read(np.repeat(unit, axes)) for unit in np.eye(width)])
    weights = np.tensordot(each, body.station_share, axes=(1, 0))
    if axes == 1:
        return np.asarray(weights[None])
    spread = np.zeros((2, width, 2))
    for d in range(2):
        spread[d, :, d] = weights[:, d]
    return spread.reshape(2, 2 * width)


def _join(parts: list[Any], kind: type[np.generic]) -> tuple[np.ndarray, np.ndarray]:
    flat = [np.asarray(part, dtype=kind).ravel() for part in parts]
    return np.concatenate(flat), np.concatenate(([0], np.cumsum([part.size for part in flat]))).astype(np.int64)


def view(lanes: np.ndarray, shared: Shared, which: int) -> np.ndarray:
    """View a part of many lanes.

    Args:
        lanes: their memory, shape (M, B).
        shared: what they share.
        which: the part.

    Returns:
        Shape (M, size of the part).
    """
    return lanes[:, shared.lane_at[which] : shared.lane_at[which + 1]]


def fill_at_rest(lanes: np.ndarray, shared: Shared, assembly: Any) -> None:
    """Write the commands at the start of scenes on a line to their lanes.

    Args:
        lanes: memory, shape (M, B), changed in place.
        shared: what the lanes share.
        assembly: the assembly of M variations with a leading axis, or of one scene for all of them.
    """
    view(lanes, shared, layout.ROW)[:] = assembly.drive.rows[..., 0, :]
    view(lanes, shared, layout.TARGET)[:] = assembly.drive.targets[..., 0, :]
    if assembly.columns.slope_load is not None:
        view(lanes, shared, layout.SLOPE)[:] = assembly.columns.slope_load
