"""Many environments `Crawler-v0`, advanced in one compiled call."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from crawler_model import CommandError, CrawlerError, Scene

from .env import build_spaces, describe_bad, read_action
from .kernel.command import find_bad
from .kernel.layout import ALONG, GAINED, REWARD, SPENT, TERMINATED, TRUNCATED
from .lanes import Lanes
from .randomise import Ranges, read_ranges
from .spec import build_spec


class CrawlerVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Environments as `CrawlerEnv`, equal to it to the bit: the i-th of them has the seed of all plus i.

    Attributes:
        spec_of_crawler: the settings.
        action_names: the command that each action moves.
        drawn: the values drawn for the present episode of each environment.
        lanes: their states.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        scene: Scene | str | Path = "three_contacts_one_way",
        task: str = "translation",
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        threads: int | None = None,
        **settings: Any,
    ) -> None:
        """Build the environments; `reset` begins their first episodes.

        Args:
            num_envs: number of environments M.
            scene: a scene, a path or a gallery name.
            task: "translation", "speed", "reach" or "climb".
            autoreset_mode: when an environment whose episode has ended begins the next one: Gymnasium's modes.
            render_mode: "rgb_array" or None.
            threads: number of threads; None for one per core where that pays. Results do not depend on it.
            **settings: as for `build_spec`.

        Raises:
            CrawlerError: if a setting is invalid.
        """
        if isinstance(num_envs, bool) or not isinstance(num_envs, int) or num_envs < 1:
            raise CrawlerError(f"num_envs: {num_envs!r}; it must be a whole number >= 1")
        if threads is not None and (not isinstance(threads, int) or threads < 1):
            raise CrawlerError(f"threads: {threads!r}; it must be a whole number >= 1")
        if render_mode not in (None, "rgb_array"):
            raise CrawlerError(f"render_mode: {render_mode!r}; many environments offer rgb_array, or None")
        try:
            self._mode = AutoresetMode(autoreset_mode)
        except ValueError:
            known = ", ".join(mode.value for mode in AutoresetMode)
            raise CrawlerError(f"autoreset_mode: {autoreset_mode!r}; it must be one of {known}") from None
        self.num_envs, self.render_mode, self._threads = num_envs, render_mode, threads
        self.spec_of_crawler = build_spec(scene, task, **settings)
        fps = max(round(float(self.spec_of_crawler.rate)), 1)
        self.metadata = {**type(self).metadata, "autoreset_mode": self._mode, "render_fps": fps}
        self.single_observation_space, self.single_action_space = build_spaces(self.spec_of_crawler)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.action_names = self.spec_of_crawler.actions.names
        self._shape = (num_envs, len(self.action_names))
        self._randoms: list[np.random.Generator] = []
        self._seeds = np.full(num_envs, -1, dtype=object)
        self.drawn: list[dict[str, Any]] = [{} for _ in range(num_envs)]
        self._all = np.arange(num_envs)
        self.lanes = Lanes(self.spec_of_crawler, num_envs, threads=threads)
        self._begun = False
        self._over = np.zeros(num_envs, np.bool_)
        self._pictures: list[Any] = []

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_pictures": []}

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each environment."""
        return tuple(int(seed) for seed in self._seeds)

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generator of each environment."""
        self._seed([None] * self.num_envs)
        return tuple(self._randoms)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin episodes.

        Args:
            seed: seed of the first environment, one more for each that follows; or a seed for each; None to go on.
            options: how episodes differ from here on, see `read_ranges`; None or an empty mapping leaves that
                as it is. With a key `reset_mask`, bool, shape (M,), only these environments begin anew.

        Returns:
            The observations, shape (M, O), and `info` with the values drawn.

        Raises:
            CrawlerError: if seeds or options are invalid.
        """
        seeds = self._read_seeds(seed)
        which = self._all
        if options is not None and "reset_mask" in options:
            which = self._read_mask(options["reset_mask"])
            options = {key: value for key, value in options.items() if key != "reset_mask"}
        spec = self.spec_of_crawler
        if options:
            spec = spec.with_ranges(read_ranges(options))
            if which.size < self.num_envs:
                _check_partial(spec.ranges, self.spec_of_crawler.ranges)
        self._seed([seeds[m] if m in which else None for m in range(self.num_envs)] if seed is not None else seeds)
        before = self.lanes, self.spec_of_crawler
        if options and which.size == self.num_envs:
            self.lanes = Lanes(spec, self.num_envs, threads=self._threads)
        self.spec_of_crawler = self.lanes.spec = spec
        try:
            self._begin(which)
        except CrawlerError:  # an invalid scene: the episodes before go on
            before[0].spec = before[1]
            self.lanes, self.spec_of_crawler = before
            raise
        if before[0] is not self.lanes:
            before[0].close()
        self._begun = True
        return self.lanes.observations.copy(), self._info(which) | self._drawn_info(which)

    def _read_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        seeds = [int(seed) + m for m in range(self.num_envs)] if isinstance(seed, (int, np.integer)) else list(seed)
        if len(seeds) != self.num_envs:
            raise CrawlerError(f"seed: {len(seeds)} seeds for {self.num_envs} environments; give one, or one for each")
        for one in seeds:
            if one is not None and not (isinstance(one, (int, np.integer)) and one >= 0):
                raise CrawlerError(f"seed: {one!r}; it must be an integer from 0 on, or None to go on")
        return [one if one is None else int(one) for one in seeds]

    def _read_mask(self, mask: Any) -> np.ndarray:
        fits = isinstance(mask, np.ndarray) and mask.shape == (self.num_envs,) and mask.dtype == np.bool_
        if not fits or not mask.any():
            raise CrawlerError(
                f"options: reset_mask is {mask!r}; it must be an array of {self.num_envs} bool, at least one of them "
                "True"
            )
        if not self._begun:
            raise CrawlerError("options: reset_mask before any episode has begun; call reset without it first")
        return np.flatnonzero(mask)

    def _seed(self, seeds: list[int | None]) -> None:
        if not self._randoms:
            pairs = [seeding.np_random(seed) for seed in seeds]
            self._randoms = [generator for generator, _ in pairs]
            self._seeds[:] = [number for _, number in pairs]
            return
        for m, seed in enumerate(seeds):
            if seed is not None:
                self._randoms[m], self._seeds[m] = seeding.np_random(seed)

    def _begin(self, which: np.ndarray) -> None:
        spec = self.spec_of_crawler
        varies = spec.ranges.ranges or spec.scene.parts.sensors is not None
        drawn = [spec.draw(self._randoms[m]) for m in which] if varies else [{}] * which.size
        self.lanes.reset(which, drawn)
        for m, values in zip(which.tolist(), drawn, strict=True):
            self.drawn[m] = values
        self._over[which] = False

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Follow an action in each environment for one step.

        Args:
            actions: rates, shape (M, A), from -1 to 1.

        Returns:
            Observations (M, O), rewards (M,), terminated (M,), truncated (M,), and `info` as for a single environment,
            with an entry for each.

        Raises:
            CommandError: if the actions have the wrong shape, or are not finite; no state changes.
            CrawlerError: if no episode has begun, one has ended that is not begun anew, or `close` was called.
        """
        if not self._begun or self.closed:
            why = "the environments are closed" if self.closed else "no episode has begun; call reset first"
            raise CrawlerError(f"step: {why}")
        lanes = self.lanes
        lanes.actions[:] = read_action(actions, self._shape)
        if find_bad(lanes.actions) >= 0:
            raise CommandError(describe_bad(lanes.actions, self.action_names))
        over = np.flatnonzero(self._over)
        if over.size and self._mode is AutoresetMode.DISABLED:
            raise CrawlerError(f"step: the episode of environment {over[0]} has ended; reset it with reset_mask")
        if over.size:  # NEXT_STEP
            self._begin(over)
            lanes.skipped[over] = 1
        lanes.step()
        lanes.skipped[over] = 0
        results = lanes.results
        rewards = results[:, REWARD].copy()
        terminated, truncated = results[:, TERMINATED] == 1.0, results[:, TRUNCATED] == 1.0
        info = self._info(self._all) | self._drawn_info(over)
        self._over = terminated | truncated
        if self._mode is AutoresetMode.SAME_STEP and self._over.any():
            info = self._begin_again(info)
        return lanes.observations.copy(), rewards, terminated, truncated, info

    def _begin_again(self, info: dict[str, Any]) -> dict[str, Any]:
        """Begin the next episode of the environments whose episodes have just ended; the last info goes along."""
        which = np.flatnonzero(self._over)
        last = np.full(self.num_envs, None, dtype=object)
        for m in which.tolist():
            last[m] = self.lanes.observations[m].copy()
        mask = self._mask(which)
        final = self._info(which)
        self._begin(which)
        again = info | self._info(self._all) | self._drawn_info(which)
        return again | {"final_obs": last, "_final_obs": mask, "final_info": final, "_final_info": mask.copy()}

    def _mask(self, which: np.ndarray) -> np.ndarray:
        mask = np.zeros(self.num_envs, np.bool_)
        mask[which] = True
        return mask

    def _info(self, which: np.ndarray) -> dict[str, Any]:
        """Report the results of some environments, as Gymnasium's vector environments do."""
        results, mask, info = self.lanes.results, self._mask(which), {}
        for key, column in (("net_translation", ALONG), ("gained", GAINED), ("work", SPENT)):
            info[key], info[f"_{key}"] = np.where(mask, results[:, column], 0.0), mask.copy()
        return info

    def _drawn_info(self, which: np.ndarray) -> dict[str, Any]:
        """Report the values drawn for episodes that begin, as Gymnasium's vector environments do."""
        info: dict[str, Any] = {}
        for m in which.tolist():
            info = self._add_info(info, {"drawn": dict(self.drawn[m])}, m)
        return info

    def render(self) -> tuple[Any, ...] | None:
        """Draw the bodies.

        Returns:
            A picture of each, uint8, shape (height, width, 3); None without a render mode.
        """
        if self.render_mode is None:
            return None
        from .picture import Picture

        if not self._pictures:
            self._pictures = [Picture(self.spec_of_crawler, False)]
        return tuple(self._pictures[0].draw(self.lanes, m) for m in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads.

        Args:
            **kwargs: not used.
        """
        self.lanes.close()
        for picture in self._pictures:
            picture.close()
        self._pictures = []


def _check_partial(ranges: Ranges, before: Ranges) -> None:
    """Refuse options of a partial reset that need other memory than the environments that go on."""
    if (ranges.loads and not before.loads) or ranges.most_delay > before.most_delay:
        raise CrawlerError(
            "options: with reset_mask, loads, slopes and larger delays than before are not possible; reset all "
            "environments with them once"
        )
