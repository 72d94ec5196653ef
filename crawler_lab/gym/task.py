"""Tasks: the numbers that define a reward, and towards what an environment moves; `kernel.reward` computes it."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model import CrawlerError, Scene
from crawler_model.run.transport import length_of

from .kernel.layout import REACH, SPEED, TRAVEL
from .randomise import Ranges, vary_scene

TASKS = {"translation": TRAVEL, "speed": SPEED, "reach": REACH, "climb": TRAVEL}
"""Names of the tasks, and their kinds."""
_OF_TASK = {"speed": "speed", "place": "reach", "tolerance": "reach"}


@dataclass(frozen=True, eq=False)
class Task:
    """A task in a scene.

    Attributes:
        name: one of TASKS.
        direction: unit vector of the direction of travel, shape (1,), in the plane (2,).
        speed: speed to keep [m/s]; 0 for other tasks.
        place: net translation to reach, shape (1,), in the plane (2,) [m]; 0 for other tasks.
        tolerance: largest distance from the place at which it counts as reached [m]; 0 for other tasks.
    """

    name: str
    direction: np.ndarray
    speed: float
    place: np.ndarray
    tolerance: float

    @property
    def kind(self) -> int:
        """Kind of the task for the kernels."""
        return TASKS[self.name]

    @property
    def errors(self) -> int:
        """Number of entries of the observation that hold the error of the task."""
        return self.place.size if self.kind == REACH else 1


def build_task(
    scene: Scene,
    name: str,
    direction: float | None,
    speed: float | None,
    place: float | Sequence[float] | None,
    tolerance: float | None,
    stroke_speed: float,
    ranges: Ranges,
) -> Task:
    """Check a task against a scene, and complete it.

    Args:
        scene: the scene.
        name: name of the task.
        direction: direction of travel: 1 or -1 on a line, an angle in the plane [rad]; None for the default.
        speed: speed to keep [m/s]; None for the default.
        place: net translation to reach, in the plane two numbers [m]; None for the default.
        tolerance: largest distance from the place at which it counts as reached [m]; None for the default.
        stroke_speed: mean of the largest rates of the links, from which the default speed follows [m/s].
        ranges: how episodes differ.

    Returns:
        The task.

    Raises:
        CrawlerError: if the task is unknown, lacks a direction, or does not take one of the numbers.
    """
    if name not in TASKS:
        near = difflib.get_close_matches(str(name), TASKS, n=1, cutoff=0.0)[0]
        raise CrawlerError(f"task: unknown task {name!r}; the nearest is {near!r}, of {', '.join(TASKS)}")
    given = {"speed": speed, "place": place, "tolerance": tolerance}
    for key, value in given.items():
        if value is not None and name != _OF_TASK[key]:
            raise CrawlerError(f"{key}: {value!r}, but the task is {name}; only the task {_OF_TASK[key]} takes it")
    if name == "reach":
        if direction is not None:
            raise CrawlerError(f"direction: {direction!r}, but the task is reach, whose place sets the direction")
        length = length_of(scene.body)
        goal = _place(scene, place, length)
        unit = np.array([1.0, 0.0])[: scene.dimension]
        reach = 0.01 * length if tolerance is None else check_number("tolerance", tolerance, "m")
        return Task(name, unit, 0.0, goal, reach)
    unit = _direction(scene, name, direction, ranges)
    steady = 0.25 * stroke_speed if name == "speed" else 0.0
    if speed is not None:
        steady = check_number("speed", speed, "m/s")
    return Task(name, unit, steady, np.zeros(scene.dimension), 0.0)


def _direction(scene: Scene, name: str, direction: float | None, ranges: Ranges) -> np.ndarray:
    if direction is not None and (not isinstance(direction, (int, float)) or not math.isfinite(direction)):
        raise CrawlerError(f"direction: {direction!r}; it must be a number")
    if name == "climb" and direction is None:
        return _against_loads(scene, ranges)
    if scene.dimension == 2:
        if direction is None:
            raise CrawlerError(
                f"direction: missing; in the plane the task {name} needs the angle of travel from the x axis [rad]"
            )
        return np.array([math.cos(direction), math.sin(direction)])
    if direction not in (None, 1, -1):
        raise CrawlerError(f"direction: {direction!r}; on a line it must be 1 or -1")
    return np.array([1.0 if direction is None else float(direction)])


def _against_loads(scene: Scene, ranges: Ranges) -> np.ndarray:
    """Find the direction against the sum of the loads, of the mean of all episodes, else of the scene; or uphill."""
    axes = scene.dimension
    given = {key: ranges.ranges[key] for key in ranges.of_scene if key in ("loads", "slope")}
    means = {key: np.array([np.mean(ends)]) for key, ends in given.items()}
    for one in (vary_scene(scene, tuple(means), means)[0], scene) if means else (scene,):
        total = np.asarray(one.drive.loads[0]).reshape(-1, axes).sum(axis=0) if one.columns.loads else np.zeros(axes)
        if one.ground.track is not None:
            total = total + one.ground.track.tilt.mean(axis=0).sum()  # of patches that slope otherwise than the scene
        size = float(np.linalg.norm(total))
        if size > 0.0:
            return np.asarray(-total / size)
    if means and axes == 1:
        return np.ones(1)
    raise CrawlerError(
        f"task: climb, but nothing loads {scene.name}; give it `loads` or `ground.slope`, or randomise slope or loads"
    )


def _place(scene: Scene, place: float | Sequence[float] | None, length: float) -> np.ndarray:
    axes = scene.dimension
    if place is None:
        if axes == 2:
            raise CrawlerError("place: missing; in the plane the task reach needs the place [x, y] to reach [m]")
        return np.array([float(scene.body.share @ scene.start_displacement) + length])
    try:
        goal = np.atleast_1d(np.array(place, dtype=np.float64))
    except (TypeError, ValueError, OverflowError):
        goal = np.empty(0)
    if goal.shape != (axes,) or not np.isfinite(goal).all():
        raise CrawlerError(
            f"place: {place!r}; it must be {'a finite number' if axes == 1 else 'two finite numbers'} [m]"
        )
    return goal


def check_number(name: str, given: Any, unit: str, least: float = 1e-12) -> float:
    """Check a number among the settings.

    Args:
        name: what it is called.
        given: what was given.
        unit: its unit, for the error message.
        least: the least valid number.

    Returns:
        The number, in its unit.

    Raises:
        CrawlerError: if it is not a number, not finite, or too small.
    """
    number = isinstance(given, (int, float)) and not isinstance(given, bool)
    if not number or not math.isfinite(given) or given < least:
        kind = "a finite number" if least < 0.0 else "a number > 0" if least > 0.0 else "a number >= 0"
        raise CrawlerError(f"{name}: {given!r}; it must be {kind} [{unit}]")
    return float(given)
