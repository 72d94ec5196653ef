"""The environment `Crawler-v0`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from crawler_model import CommandError, CrawlerError, Scene

from .kernel.command import find_bad
from .kernel.layout import ALONG
from .lanes import Lanes
from .randomise import read_ranges
from .spec import Spec, build_spec


class CrawlerEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A crawler whose rest lengths, and friction where it is free, are moved by actions.

    An action is a rate from -1 to 1 for each free column of a command; beyond these it is clipped. A step moves the
    command in a straight line, as a tick of the simulator does. An observation holds the elongations of the joints [m],
    their tensions [N], the mean velocities of the contacts during the step [m/s], the commanded friction where it is
    free, and the error of the task [m]: how far the body has slid back from its furthest place (translation, climb),
    how far it is behind (speed), or the way that is left (reach). The reward is what the task gained [m] less the price
    of the actuators' work.

    Attributes:
        spec_of_crawler: the settings.
        action_names: the command that each action moves.
        drawn: the values drawn for the present episode; as options of `reset` they repeat it.
        lanes: the state, as if this were one of many environments.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 20}  # noqa: RUF012

    def __init__(
        self,
        scene: Scene | str | Path = "three_contacts_one_way",
        task: str = "translation",
        *,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        """Build the environment; `reset` begins the first episode.

        Args:
            scene: a scene, a path or a gallery name.
            task: "translation", "speed", "reach" or "climb".
            render_mode: "rgb_array", "human", or None.
            **settings: as for `build_spec`.

        Raises:
            CrawlerError: if a setting is invalid.
        """
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise CrawlerError(f"render_mode: {render_mode!r}; it must be one of human, rgb_array, or None")
        self.spec_of_crawler = build_spec(scene, task, **settings)
        self.render_mode = render_mode
        self.metadata = {**type(self).metadata, "render_fps": max(round(float(self.spec_of_crawler.rate)), 1)}
        self.observation_space, self.action_space = build_spaces(self.spec_of_crawler)
        self.action_names = self.spec_of_crawler.actions.names
        self.drawn: dict[str, Any] = {}
        self._shape = self.action_space.shape
        self._picture: Any = None
        self._build()

    def _build(self) -> None:
        self._attach(Lanes(self.spec_of_crawler, 1, logs=True, threads=1))
        self._begun = False

    @property
    def displacement(self) -> np.ndarray:
        """Displacement of the contacts, shape (N,), in the plane (N, 2) [m]."""
        return self.lanes.displacement(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: seed of all that is drawn; None to go on with the last one.
            options: how episodes differ from here on, see `read_ranges`; None or an empty mapping
                leaves that as it is.

        Returns:
            The first observation, and `info` with the values drawn.

        Raises:
            CrawlerError: if options are invalid; the episode before then goes on.
        """
        if options:
            spec = self.spec_of_crawler.with_ranges(read_ranges(options))
        super().reset(seed=seed)
        if options:
            before = self.spec_of_crawler, self.lanes, self._begun
            self.spec_of_crawler = spec
            try:
                self._build()
                self._begin()
            except CrawlerError:
                self.spec_of_crawler, lanes, self._begun = before
                self._attach(lanes)
                raise
        else:
            self._begin()
        if self.render_mode == "human":
            self.render()
        info = {"net_translation": self._result.item(ALONG), "gained": 0.0, "work": 0.0, "drawn": dict(self.drawn)}
        return self._observation.copy(), info

    def _attach(self, lanes: Lanes) -> None:
        self.lanes = lanes
        self._action, self._observation = lanes.actions, lanes.observations[0]
        self._result = lanes.results[0]

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_picture": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._attach(self.lanes)

    def _begin(self) -> None:
        drawn = self.spec_of_crawler.draw(self.np_random)
        self.lanes.reset(np.zeros(1, np.int64), [drawn])
        self.drawn, self._begun = drawn, True

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Follow an action for one step.

        Args:
            action: rates, shape (A,), from -1 to 1.

        Returns:
            Observation, reward, terminated, truncated, and `info` with the net translation along the direction of the
            task [m], what the task gained [m], and the work of the actuators [J].

        Raises:
            CommandError: if the action has the wrong shape, or is not finite; the state does not change.
            CrawlerError: if no episode has begun.
        """
        if not self._begun:
            raise CrawlerError("step: no episode has begun; call reset first")
        if type(action) is not np.ndarray or action.shape != self._shape or action.dtype != np.float64:
            action = read_action(action, self._shape)
        self._action[0] = action
        if find_bad(self._action) >= 0:
            raise CommandError(describe_bad(action, self.action_names))
        self.lanes.step()
        if self.render_mode == "human":
            self.render()
        reward, gained, work, along, terminated, truncated = self._result.tolist()
        info = {"net_translation": along, "gained": gained, "work": work}
        return self._observation.copy(), reward, terminated == 1.0, truncated == 1.0, info

    def render(self) -> Any:
        """Draw the body.

        Returns:
            For "rgb_array" the picture, uint8, shape (height, width, 3); otherwise None.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("render: no render_mode was given to make; give 'rgb_array' or 'human'")
            return None
        from .picture import Picture

        if self._picture is None:
            self._picture = Picture(self.spec_of_crawler, self.render_mode == "human")
        return self._picture.draw(self.lanes)

    def save(self, folder: str | Path) -> Path:
        """Record the present episode as MCAP, as the simulator records a run.

        Args:
            folder: a folder that does not exist yet, or an empty one.

        Returns:
            The folder, for `crawler replay`.

        Raises:
            CrawlerError: if the episode is longer than what is remembered.
        """
        from .episode import write_episode

        if not self._begun:
            raise CrawlerError("save: no episode has begun; call reset first")
        return write_episode(Path(folder), self.lanes, self.drawn)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._picture is not None:
            self._picture.close()
            self._picture = None


def build_spaces(spec: Spec) -> tuple[spaces.Box, spaces.Box]:
    """Build the spaces of an environment.

    Args:
        spec: its settings.

    Returns:
        The spaces of observations and of actions.
    """
    bound, actions = spec.spans.bound, len(spec.actions.names)
    return spaces.Box(-bound, bound, dtype=np.float64), spaces.Box(-1.0, 1.0, (actions,), np.float64)


def read_action(action: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Convert an action to an array.

    Args:
        action: numbers.
        shape: the shape that it must have.

    Returns:
        The array.

    Raises:
        CommandError: if it has another shape, or does not hold numbers.
    """
    try:
        array = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise CommandError(f"action: {action!r}; it must be {shape} numbers") from None
    if array.shape != shape:
        raise CommandError(f"action: shape {array.shape}; it must be {shape}")
    return array


def describe_bad(actions: np.ndarray, names: tuple[str, ...]) -> str:
    """Describe the first action that is not finite.

    Args:
        actions: shape (A,) or (M, A).
        names: names of the A actions.

    Returns:
        One line.
    """
    place = np.argwhere(~np.isfinite(actions))[0]
    where = f" of environment {place[0]}" if place.size > 1 else ""
    return f"action: {names[place[-1]]}{where} is {actions[tuple(place)]}; it must be finite"
