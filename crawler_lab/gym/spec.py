"""The settings of an environment, checked against its scene."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import CrawlerError, Scene
from crawler_model.run.ticks import rational_rate
from crawler_model.run.transport import supporting_force
from crawler_model.scene.file import coerce_scene
from crawler_ros.wire.states import shown_contacts

from ..sweep.keys import with_loads
from .actions import Actions, build_actions
from .bounds import Spans, find_spans
from .randomise import MOST_SEED, Ranges, read_ranges
from .task import Task, build_task, check_number

MOST_STEPS = 10_000_000


@dataclass(frozen=True, eq=False)
class Spec:
    """The settings of an environment.

    Attributes:
        scene: the scene; with loads, where episodes have them.
        task: the task.
        actions: the free columns of its commands.
        spans: bounds of the observations.
        ranges: how episodes differ.
        rate: steps per second [Hz].
        steps: steps of an episode; 0 for no limit.
        price: price of work [m/J].
        stroke: bounds of the rest lengths, as given.
        friction: bounds of the friction, as given.
        steps_per_stroke: number of steps in which an action of size 1 goes from one bound to the other.
    """

    scene: Scene
    task: Task
    actions: Actions
    spans: Spans
    ranges: Ranges
    rate: Fraction
    steps: int
    price: float
    stroke: Sequence[float] | None
    friction: Sequence[float] | None
    steps_per_stroke: float

    def draw(self, random: np.random.Generator) -> dict[str, Any]:
        """Draw the values of an episode, see `Ranges.draw`; with sensors, the seed of their noise is one of them."""
        drawn = self.ranges.draw(random)
        if self.scene.parts.sensors is not None and "noise_seed" not in drawn:
            drawn["noise_seed"] = int(random.integers(MOST_SEED))
        return drawn

    def with_ranges(self, ranges: Ranges) -> Spec:
        """Replace the ranges; the spaces stay as they are.

        Args:
            ranges: the ranges.

        Returns:
            The settings.
        """
        scene = _with_loads(self.scene, ranges)
        actions = self.actions
        if scene is not self.scene:
            actions = build_actions(scene, self.stroke, self.friction, self.steps_per_stroke)
        _check_ground_and_friction(actions, scene, ranges)
        return dataclasses.replace(self, scene=scene, actions=actions, ranges=ranges)


def list_units(spec: Spec) -> list[str]:
    """List the units of an observation, as `Sensors` names them: friction is commanded, and known exactly.

    Args:
        spec: the settings.

    Returns:
        One for each entry.
    """
    body, axes = spec.scene.body, spec.scene.dimension
    joints, feet = body.joints.shape[0] * axes, shown_contacts(body).size * axes
    frictions = int((spec.actions.free >= spec.scene.columns.lengths).sum())
    return ["m"] * joints + ["N"] * joints + ["m/s"] * feet + [""] * frictions + ["m"] * spec.task.errors


def build_spec(
    scene: Scene | str | Path = "three_contacts_one_way",
    task: str = "translation",
    *,
    direction: float | None = None,
    speed: float | None = None,
    place: float | Sequence[float] | None = None,
    tolerance: float | None = None,
    rate: float = 20.0,
    steps: int = 200,
    stroke: Sequence[float] | None = None,
    stroke_time: float = 0.25,
    friction: Sequence[float] | None = None,
    price: float = 0.1,
    randomise: Mapping[str, Any] | None = None,
    **unknown: Any,
) -> Spec:
    """Check the settings of an environment and complete them.

    Args:
        scene: a scene, a path or a gallery name. Its drive is not played: its first row is the command at the start,
            and its range the default of the bounds of the commands.
        task: "translation" (travel as far as possible), "speed" (keep a speed), "reach" (go to a place) or "climb"
            (travel against the loads).
        direction: direction of travel: 1 or -1 on a line, 1 by default; in the plane an angle, required for translation
            and speed [rad]. A climb goes against the mean loads of its episodes by default.
        speed: for the task speed [m/s]; by default a quarter of the mean of the largest rates of the links.
        place: for the task reach, the net translation to reach [m]; by default a body length ahead, required in the
            plane.
        tolerance: for the task reach, the distance at which the place counts as reached [m]; by default a hundredth
            of the length of the body.
        rate: steps per second [Hz].
        steps: steps of an episode, after which it is truncated; 0 for no limit.
        stroke: least and largest rest-length change of each link [m] and strain of each segment; by default as in the
            scene's drive; without a drive a quarter of the link's length either way, and a strain of 0.2.
        stroke_time: time in which an action of size 1 goes from the least to the largest value [s].
        friction: least and largest friction of each contact [N] (segments [N/m]), which frees it; by default it is
            free where the drive of the scene changes it.
        price: price of work relative to the force that supports the body (as in the cost of transport) [1].
        randomise: how episodes differ, unless `reset` is given other options; see `read_ranges`.
        **unknown: others, which are refused.

    Returns:
        The settings.

    Raises:
        CrawlerError: if one is invalid; the message names it.
    """
    given = coerce_scene(scene, "Crawler-v0")
    if task == "steer":
        raise CrawlerError("task: steer; many at a time and as a ROS node it is not available, see SteerEnv")
    if given.body.turning is not None:
        raise CrawlerError(f"task: {task}, but {given.name} turns; the task of bodies that turn is steer")
    for name in unknown:
        raise CrawlerError(f"{name}: unknown setting; the settings are {', '.join(list_settings())}")
    ranges = read_ranges(randomise or {})
    ratio = rational_rate(rate)
    if isinstance(steps, bool) or not isinstance(steps, int) or not 0 <= steps <= MOST_STEPS:
        raise CrawlerError(f"steps: {steps!r}; it must be a whole number, 0 .. {MOST_STEPS}; 0 for no limit")
    check_number("stroke_time", stroke_time, "s")
    check_number("price", price, "1", least=0.0)
    loaded = _with_loads(given, ranges)
    if loaded.body.shares_contacts:
        raise CrawlerError(
            f"{loaded.name}: parts of its body touch, and environments have one command for each contact; leave a gap "
            "between them, with a link"
        )
    per_stroke = max(float(stroke_time * ratio), 1.0)
    actions = build_actions(loaded, stroke, friction, per_stroke)
    _check_ground_and_friction(actions, loaded, ranges)
    lengths = loaded.columns.lengths
    mean = float(np.mean(actions.limits[0, :lengths])) * float(ratio) if lengths else 0.0
    checked = build_task(loaded, task, direction, speed, place, tolerance, mean, ranges)
    feet = shown_contacts(loaded.body).size
    spans = find_spans(loaded, actions, checked, ranges, float(ratio), steps, feet)
    force = float(supporting_force(loaded))
    per_joule = price / force if force > 0.0 else 0.0
    return Spec(
        scene=loaded,
        task=checked,
        actions=actions,
        spans=spans,
        ranges=ranges,
        rate=ratio,
        steps=steps,
        price=per_joule,
        stroke=stroke,
        friction=friction,
        steps_per_stroke=per_stroke,
    )


def list_settings() -> list[str]:
    """List the names of the settings besides the scene and the task."""
    return [name for name in build_spec.__annotations__ if name not in ("scene", "task", "unknown", "return")]


def _with_loads(scene: Scene, ranges: Ranges) -> Scene:
    """Give a scene without loads of its own a load of 0 where episodes have loads or slopes, one of which may be 0."""
    loaded = with_loads(scene, ["loads"] if ranges.loads else [])
    if loaded is not scene and scene.dimension == 2 and not scene.columns.loads:
        raise CrawlerError("options: slope and loads: the scene in the plane has no loads; add `loads: 0` to it")
    return loaded


def _check_ground_and_friction(actions: Actions, scene: Scene, ranges: Ranges) -> None:
    free, track = bool((actions.free >= scene.columns.lengths).any()), scene.ground.track
    if "slope" in ranges.ranges and track is not None and track.profile is not None and track.profile[3].any():
        raise CrawlerError(f"options: slope: the ground.profile of {scene.name} sets all slopes; leave it out")
    if "friction" in ranges.ranges and free:
        raise CrawlerError(
            "options: friction cannot be randomised where it is free to be commanded; leave one of the two out"
        )
