"""Bounds of observations, from the friction, the stiffness and the strokes of a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crawler_model import Scene
from crawler_model.body.body import Body
from crawler_model.body.curves import YIELD, Curve

from .actions import Actions
from .kernel.layout import REACH
from .randomise import Ranges
from .task import Task


@dataclass(frozen=True, eq=False)
class Spans:
    """How large the entries of an observation become.

    Attributes:
        bound: largest size of each entry, shape (O,).
        scale: size of each entry by which the noise of its sensor is multiplied, shape (O,).
    """

    bound: np.ndarray
    scale: np.ndarray


def find_spans(scene: Scene, actions: Actions, task: Task, ranges: Ranges, rate: float, steps: int, feet: int) -> Spans:
    """Compute the bounds of an observation.

    A tension is bounded by the friction that can hold it, in loops and between walls also by the energy of the commands
    where all contacts stand, an elongation by the stroke and the tension, the way of a contact in a step by what all
    springs together gain, and the error of a task by the way of an episode. What a limit of tension leaves free to move
    has no bound.

    Args:
        scene: the scene.
        actions: the free columns.
        task: the task.
        ranges: how episodes differ.
        rate: steps per second [Hz].
        steps: steps of an episode; 0 for no limit.
        feet: number of contacts that are observed.

    Returns:
        The spans, in the order of the observation.
    """
    body, axes = scene.body, scene.dimension
    tension, most = _tensions(scene, actions, ranges)
    give = _gives(body, tension / ranges.ranges.get("stiffness", (1.0, 1.0))[0], most)
    size, low, high = actions.limits
    stroke, change = _largest(scene, high - low), _largest(scene, size)
    elongation = body.joint_sum(most + give)
    way = 2.0 * float((change + 2.0 * give).sum())
    frictions = actions.free[actions.free >= scene.columns.lengths]
    length = max(float(np.ptp(body.position, axis=0).max()), 1e-12)
    start = np.abs(np.asarray(body.share @ scene.start_displacement) - task.place).max()
    error = (way + task.speed / rate) * (steps or 1_000_000) + (start if task.kind == REACH else 0.0)
    typical = float(stroke.max(initial=0.0)) or length
    bound = [np.repeat(elongation, axes), _of_joints(scene, tension), np.full(feet * axes, way * rate)]
    bound += [actions.limits[2, frictions], np.full(task.errors, error)]
    step = float(change.max(initial=0.0)) or typical
    usual, _ = _tensions(scene, actions, Ranges())  # noise does not depend on what else is randomised
    scale = [np.repeat(body.joint_sum(stroke), axes), _of_joints(scene, usual)]
    scale += [np.full(feet * axes, step * rate), actions.limits[2, frictions], np.full(task.errors, typical)]
    room = 1.0 + 6.0 * ranges.ranges.get("noise", (0.0, 0.0))[1]
    return Spans(room * np.concatenate(bound) * (1.0 + 1e-9) + 1e-12, np.concatenate(scale))


def _largest(scene: Scene, row: np.ndarray) -> np.ndarray:
    """Convert sizes of columns to sizes of springs; in the plane both components together, shape (S,) [m]."""
    springs, axes = scene.body.springs, scene.dimension
    lengths = (np.take(row, scene.columns.index) * scene.columns.factor)[: springs * axes]
    return np.asarray(np.linalg.norm(lengths.reshape(springs, axes), axis=1))


def _gives(body: Body, tension: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Compute by how much the largest elongation of each spring exceeds the largest command, shape (S,) [m].

    Args:
        body: the body.
        tension: the largest one of each spring, at its stiffness, shape (S,) [N].
        most: the largest change of its rest length, shape (S,) [m].
    """
    give = tension / body.stiffness
    for bend in body.bends:
        j = bend.spring
        held = float(tension[j]) + sum(slider[YIELD] for slider in bend.sliders)
        ahead = float(most[j]) + bend.backlash + abs(bend.ahead)
        ends = [_farthest(bend.over_elongation(side * ahead), side, held) for side in (1.0, -1.0)]
        give[j] = max(*ends, 0.0) - most[j]
    return np.maximum(give, 0.0)


def _farthest(curve: Curve, side: float, tension: float) -> float:
    """Find how far a curve stays within a tension towards a side; infinite if it never exceeds it [m]."""
    at, value, last = (
        (curve.at, curve.value, curve.last) if side > 0.0 else (-curve.at[::-1], -curve.value[::-1], curve.first)
    )
    beyond = int(np.searchsorted(value, tension, side="right"))
    if beyond == at.size:
        return float(at[-1] + (tension - value[-1]) / last) if last > 0.0 else np.inf
    return float(at[beyond] if beyond == 0 else np.interp(tension, value[beyond - 1 :], at[beyond - 1 :]))


def _tensions(scene: Scene, actions: Actions, ranges: Ranges) -> tuple[np.ndarray, np.ndarray]:
    """Compute the largest tension and the largest change of rest length of each spring, each of shape (S,)."""
    body, columns = scene.body, scene.columns
    most = _largest(scene, np.abs(actions.limits[1:]).max(axis=0))
    target = columns.target(np.where(actions.of >= 0, actions.limits[2], scene.drive.rows[0]))
    sides, n = target[body.springs * scene.dimension :], body.contacts
    load = np.zeros(n)
    if scene.dimension == 2:
        friction = sides[: columns.frictions].reshape(n, -1).max(axis=1)
        if sides.size > columns.frictions:
            load = np.linalg.norm(sides[columns.frictions :].reshape(n, 2), axis=1)
    elif sides.size > 2 * n:  # the bounds contain the loads
        load = np.abs(sides[2 * n :])
        friction = np.maximum(sides[:n] + sides[2 * n :], sides[n : 2 * n] - sides[2 * n :])
    else:
        friction = np.maximum(sides[:n], sides[n:])
    friction = friction * max(ranges.ranges.get("friction", (1.0, 1.0))[1], 1.0)
    if "slope" in ranges.ranges:
        friction = friction / np.cos(scene.ground.slope)  # coefficients hold most on level ground
    low, high = ranges.ranges.get("loads", (0.0, 0.0))
    weight = scene.ground.weight
    track = scene.ground.track
    if track is not None:
        friction = friction * track.largest_factor.max() + track.largest_added.max(axis=0)
    if scene.ground.regions is not None:
        friction = friction * scene.ground.regions.factors.max()
    friction = friction + load + max(abs(low), abs(high)) * body.ground + weight
    if body.is_chain and (track is None or track.walls is None):
        up = np.cumsum(friction)
        return np.minimum(up[:-1], up[-1] - up[:-1]), most
    total = float(friction.sum())
    stiffness = body.stiffness * max(ranges.ranges.get("stiffness", (1.0, 1.0))[1], 1.0)
    return total + np.sqrt(stiffness * float((stiffness * most**2).sum())), most


def _of_joints(scene: Scene, tension: np.ndarray) -> np.ndarray:
    """List the largest tension of each joint, in the plane for both components."""
    body = scene.body
    joints = [*tension[body.link_springs], *(tension[s.springs].max() for s in body.segments)]
    return np.repeat(joints, scene.dimension)
