"""The task `steer` of the environment `Crawler-v0`: a body that turns goes to waypoints, or turns to a heading."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from crawler_model import CommandError, Crawler, CrawlerError, Scene
from crawler_model.body.names import name_joints
from crawler_model.run.screw import largest_distance, to_frame
from crawler_model.run.ticks import rational_rate
from crawler_model.run.transport import supporting_force
from crawler_model.scene.file import coerce_scene

from ..optimise.request import find_strokes
from .actions import check_start
from .env import CrawlerEnv, describe_bad, read_action
from .task import check_number

_MANY = 1000.0
"""Observations are cut off at so many times the size of the body, or the friction of all points."""


class SteerEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A body that turns, whose rest lengths and rest angles are moved by actions.

    An action is a rate from -1 to 1 for each link and joint that moves. An observation holds, in the frame of the body,
    the changes of all lengths [m] and angles [rad], their tensions [N] and torques [N m], the mean velocities of the
    points along and across the heading [m/s], the rate of the yaw [rad/s], and the error: the vector to the waypoint
    [m], or the angle to the heading [rad]. The reward is by how much the way that is left became shorter [m], for a
    heading the angle times the largest distance of two points, less the price of the actuators' work.

    Attributes:
        scene: the scene.
        action_names: the link or joint that each action moves.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        scene: Scene | str | Path = "steering_inchworm",
        *,
        waypoints: Sequence[Sequence[float]] | None = None,
        heading: float | None = None,
        tolerance: float | None = None,
        rate: float = 20.0,
        steps: int = 2000,
        stroke: Sequence[float] | Mapping[str, Sequence[float]] | None = None,
        stroke_time: float = 0.25,
        price: float = 0.1,
        render_mode: str | None = None,
    ) -> None:
        """Build the environment; `reset` begins the first episode.

        Args:
            scene: the scene of a body that turns, a path or a gallery name; its drive is not played.
            waypoints: places to reach one after another, from the middle of the heading at the start, along and across
                the heading at the start, shape (W, 2) [m]; by default one, twice the largest distance of two
                points ahead and once to the left.
            heading: instead, the angle to turn to from the heading at the start, counterclockwise [rad].
            tolerance: distance [m] or angle [rad] at which a target is reached; by default a tenth of the largest
                distance of two points, or 0.05 rad.
            rate: steps per second [Hz].
            steps: steps of an episode, after which it is truncated; 0 for no limit.
            stroke: bounds of the links that move [m] and joints [rad] by name; by default the range of the drive.
            stroke_time: time in which an action of size 1 goes from the least to the largest value [s].
            price: price of work relative to the force that supports the body [1].
            render_mode: only None; the task draws no pictures.

        Raises:
            CrawlerError: if a setting is invalid; the message names it.
        """
        self.scene = coerce_scene(scene, "Crawler-v0")
        body = self.scene.body
        if body.turning is None:
            raise CrawlerError(f"task: steer, but {self.scene.name} does not turn; it has no `springs: length`")
        if render_mode is not None:
            raise CrawlerError(f"render_mode: {render_mode!r}; the task steer draws no pictures")
        if waypoints is not None and heading is not None:
            raise CrawlerError("heading: given together with waypoints; the task steer takes one of the two")
        self._length = largest_distance(body)
        self._heading = None if heading is None else check_number("heading", heading, "rad", least=-math.inf)
        self._waypoints = _read_waypoints(waypoints, self._length)
        default = 0.1 * self._length if heading is None else 0.05
        self._tolerance = default if tolerance is None else check_number("tolerance", tolerance, "m or rad")
        self._rate = float(rational_rate(rate))
        if isinstance(steps, bool) or not isinstance(steps, int) or steps < 0:
            raise CrawlerError(f"steps: {steps!r}; it must be a whole number >= 0; 0 for no limit")
        self._steps = steps
        moves, bounds = find_strokes(self.scene, stroke)  # type: ignore[arg-type]
        self._moved = np.flatnonzero(moves)
        self._low, self._high = np.array(bounds).T
        self.action_names = tuple(np.array(name_joints(body))[self._moved].tolist())
        check_start("stroke", self.action_names, self.scene.drive.rows[0, self._moved], self._low, self._high)
        self._size = (self._high - self._low) / max(check_number("stroke_time", stroke_time, "s") * self._rate, 1.0)
        force = float(supporting_force(self.scene))
        self._per_joule = check_number("price", price, "1", least=0.0) / force
        self._bound = self._find_bounds(force)
        self.observation_space = spaces.Box(-self._bound, self._bound, dtype=np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (self._moved.size,), np.float64)
        self._crawler: Crawler | None = None

    def _find_bounds(self, force: float) -> np.ndarray:
        """Compute the bounds of observations, which cut off what is far beyond them."""
        body, length = self.scene.body, _MANY * self._length
        links, joints = body.springs, body.lengths - body.springs
        force = _MANY * (force + float(body.stiffness.max()) * self._length)
        torque = force * self._length + _MANY * float(body.stiffnesses[links:].max(initial=0.0))
        sizes = [np.full(links, length), np.full(joints, 2.0 * np.pi), np.full(links, force), np.full(joints, torque)]
        sizes += [np.full(2 * body.contacts, length * self._rate), np.full(1, 2.0 * np.pi * self._rate)]
        sizes += [
            np.full(1, np.pi) if self._heading is not None else np.full(2, length + np.abs(self._waypoints).max())
        ]
        return np.concatenate(sizes)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: seed of the environment; nothing is drawn in this task.
            options: none are known.

        Returns:
            The first observation, and `info` as for `step`.

        Raises:
            CrawlerError: if there are options.
        """
        if options:
            raise CrawlerError(f"options: {next(iter(options))!r}; the task steer takes none")
        super().reset(seed=seed)
        crawler = self._crawler = Crawler(self.scene)
        self._row = np.array(self.scene.drive.rows[0])
        self._count = self._waypoint = 0
        self._start, self._yaw = self._middle(crawler), crawler.yaw
        self._left = self._way_left(crawler)
        return self._observe(crawler, crawler.yaw, math.inf), self._info(crawler, 0.0, 0.0)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Follow an action for one step.

        Args:
            action: rates, shape (A,), from -1 to 1.

        Returns:
            Observation, reward, terminated, truncated, and `info`: x and y along and across the heading at the start
            [m], yaw from it [rad], the number of waypoints reached, the way gained [m], and the work [J].

        Raises:
            CommandError: if the action has the wrong shape, or is not finite; the state does not change.
            CrawlerError: if no episode has begun.
        """
        if self._crawler is None:
            raise CrawlerError("step: no episode has begun; call reset first")
        action = read_action(action, (self._moved.size,))
        if not np.isfinite(action).all():
            raise CommandError(describe_bad(action, self.action_names))
        crawler, yaw, columns = self._crawler, self._crawler.yaw, self.scene.columns
        row = self._row.copy()
        moved = row[self._moved] + self._size * np.clip(action, -1.0, 1.0)
        row[self._moved] = np.clip(moved, self._low, self._high)
        try:
            work = crawler.follow(np.array(columns.target(row))[None]).work
            self._row = row
        except CommandError:  # the body would have to jump and must not: the command in force stays
            work = crawler.follow(np.empty((0, columns.index.size))).work
        self._count += 1
        reached = self._advance(crawler)
        left = self._way_left(crawler)
        gained, self._left = self._left - left, left
        truncated = 0 < self._steps <= self._count
        observation = self._observe(crawler, yaw, 1.0 / self._rate)
        return observation, gained - self._per_joule * work, reached, truncated, self._info(crawler, gained, work)

    def _middle(self, crawler: Crawler) -> np.ndarray:
        """Find the middle of the heading, shape (2,) [m]."""
        turning = crawler.body.turning
        assert turning is not None
        return np.asarray((crawler.body.position + crawler.displacement)[turning.heading].mean(axis=0))

    def _place(self, crawler: Crawler) -> np.ndarray:
        """Find how far the middle of the heading has moved, along and across the first heading, shape (2,) [m]."""
        return _turn(self._middle(crawler) - self._start, -self._yaw)

    def _error(self, crawler: Crawler) -> np.ndarray:
        """Compute the vector to the waypoint in the frame of the body [m], or the angle to the heading [rad]."""
        turned = crawler.yaw - self._yaw
        if self._heading is not None:
            return np.array([math.remainder(self._heading - turned, 2.0 * math.pi)])
        waypoint = self._waypoints[min(self._waypoint, len(self._waypoints) - 1)]
        return _turn(waypoint - self._place(crawler), -turned)

    def _advance(self, crawler: Crawler) -> bool:
        """Go on to the next waypoint where one is reached; True if the last target is."""
        targets = 1 if self._heading is not None else len(self._waypoints)
        while self._waypoint < targets and np.linalg.norm(self._error(crawler)) <= self._tolerance:
            self._waypoint += 1
        return self._waypoint >= targets

    def _way_left(self, crawler: Crawler) -> float:
        """Compute the way that is left [m]."""
        size = float(np.linalg.norm(self._error(crawler)))
        if self._heading is not None:
            return self._length * size
        later = np.diff(self._waypoints[min(self._waypoint, len(self._waypoints) - 1) :], axis=0)
        return size + float(np.linalg.norm(later, axis=1).sum())

    def _observe(self, crawler: Crawler, before: float, seconds: float) -> np.ndarray:
        velocity = to_frame(crawler.body, crawler.displacement, crawler.gained / seconds)
        parts = [crawler.joint_elongation, crawler.joint_tension, velocity.ravel()]
        observation = np.concatenate([*parts, [(crawler.yaw - before) / seconds], self._error(crawler)])
        return np.clip(observation, -self._bound, self._bound)

    def _info(self, crawler: Crawler, gained: float, work: float) -> dict[str, Any]:
        x, y = self._place(crawler).tolist()
        yaw = crawler.yaw - self._yaw
        return {"x": x, "y": y, "yaw": yaw, "reached": self._waypoint, "gained": gained, "work": work}


def _turn(vector: np.ndarray, angle: float) -> np.ndarray:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])


def _read_waypoints(given: Sequence[Sequence[float]] | None, length: float) -> np.ndarray:
    if given is None:
        return np.array([[2.0 * length, length]])
    try:
        waypoints = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        waypoints = np.empty(0)
    if waypoints.ndim != 2 or waypoints.shape[1] != 2 or not waypoints.size or not np.isfinite(waypoints).all():
        raise CrawlerError(f"waypoints: {given!r}; they must be a list of places [x, y] [m], all finite")
    return waypoints


def make_env(scene: Scene | str | Path | None = None, task: str = "translation", **settings: Any) -> gymnasium.Env:
    """Build the environment of a task, as `gymnasium.make("crawler_lab/Crawler-v0")` does.

    Args:
        scene: a scene, a path or a gallery name; None for the default of the task.
        task: "steer" for a body that turns, or a task of `CrawlerEnv`.
        **settings: as for `SteerEnv` or `CrawlerEnv`.

    Returns:
        The environment.

    Raises:
        CrawlerError: if a setting is invalid.
    """
    given: dict[str, Any] = settings if scene is None else settings | {"scene": scene}
    if task != "steer":
        return CrawlerEnv(task=task, **given)
    known = list(inspect.signature(SteerEnv).parameters)
    for name in settings:
        if name not in known:
            raise CrawlerError(f"{name}: unknown setting of the task steer; the settings are {', '.join(known)}")
    return SteerEnv(**given)


make_env.metadata = CrawlerEnv.metadata  # type: ignore[attr-defined]
