"""A short drive that makes parameters identifiable.

The drive grows by a few waypoints at a time. Each time many candidates are followed with the derivatives of all
measured positions. The one is kept that leaves the least variance of the parameters (A-optimality; F. Pukelsheim,
Optimal Design of Experiments, ch. 6), averaged over the scene and others near it, because its numbers are only a guess.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model.body.names import name_each, name_joints
from crawler_model.errors import CrawlerError
from crawler_model.run.inertia import Inertia
from crawler_model.run.simulate import find_inertia, simulate
from crawler_model.scene.file import coerce_scene
from crawler_model.scene.scene import Scene

from ..optimise.request import Bounds, find_strokes, held_lengths
from ..optimise.slow import check_slower_than, slow_down
from ..sweep.keys import expand_keys
from .fit.space import build_space
from .identify import identify
from .judge.verdicts import Parameter
from .measurements import Measurements, channel_names, observation
from .replica.playback import playback, replay_scene
from .replica.replica import Replica
from .replica.sampled import SampledReplica
from .replica.start import begin_recordings
from .sensor.sensor import Sensor, build_drift

_PRIOR = math.log(3.0) ** 2
"""Variance of a parameter before anything is measured."""
_QUANTILE = 1.96
_VAGUE = 1.0
"""Information about the numbers of an unknown start before anything is measured [1/m^2]."""
_AT_ONCE = 4
"""Waypoints by which the drive grows."""
_CANDIDATES = 24
_NEAR = 0.25
"""Range of the logarithms of the other scenes around the given one."""
_SCENES = 3
_PATIENCE = 3
"""Steps after which a parameter that no candidate excites is given up."""


@dataclass(frozen=True, eq=False, repr=False)
class Excitation:
    """A drive that makes parameters identifiable.

    Attributes:
        scene: the scene with this drive.
        parameters: what an identification finds out about each parameter from this drive and this noise.
        duration: of the drive [s].
        noise: standard deviation of the measured positions [m].
        rate: of the measurements [Hz].
        interval: the half width of intervals, relative to the values, at which the drive ends [1].
        interrupted: whether Ctrl-C ended the search.
        inertia: the inertia number of the drive; None for a scene without masses and weights.
    """

    scene: Scene
    parameters: tuple[Parameter, ...]
    duration: float
    noise: float
    rate: float
    interval: float
    interrupted: bool
    inertia: Inertia | None = None

    def __repr__(self) -> str:
        """Describe the result in one line."""
        verdicts = ", ".join(f"{p.name}: {p.verdict}" for p in self.parameters)
        return f"Excitation({self.duration:g} s, {verdicts})"

    def __getitem__(self, name: str) -> Parameter:
        """Return the parameter of a name."""
        return next(p for p in self.parameters if p.name == name)

    def summary(self) -> dict[str, Any]:
        """Convert to the values that `crawler excite --json` prints.

        Returns:
            Plain numbers, lists and text, schema 1.
        """
        return {
            "schema": 1,
            "scene": self.scene.name,
            "drive": self.scene.document()["drive"],
            "duration_s": self.duration,
            "noise_m": self.noise,
            "rate_hz": self.rate,
            "parameters": [p.as_plain() for p in self.parameters],
            "inertia": None if self.inertia is None else self.inertia.summary(),
            "complete": not self.interrupted,
        }


def excite(
    scene: Scene | str | Path,
    keys: Sequence[str],
    stroke: Bounds | Mapping[str, Bounds] | None = None,
    noise: float = 1e-3,
    duration: float = 20.0,
    every: float = 0.2,
    interval: float = 0.1,
    rate: float = 50.0,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    slower_than: float | None = None,
) -> Excitation:
    """Find a short drive within given strokes from which parameters can be identified.

    Args:
        scene: a scene on a line, a path or a gallery name; its numbers are the first guess. Its drive is replaced, with
            all that it commands.
        keys: dotted keys of the parameters, as for `identify`.
        stroke: bounds of all links [m] and segments (strain), or of each by name; None for the scene's drive.
            What is not named, or what the drive does not move, stays as it is.
        noise: standard deviation of the measured positions of the contacts [m].
        duration: longest duration [s].
        every: time between waypoints [s].
        interval: the drive ends when the half widths of all 95 % intervals, relative to the values, are below it [1].
        rate: of the measurements [Hz].
        seed: of the random candidates.
        progress: called with the fraction done, in [0, 1].
        slower_than: largest inertia number [1]; the drive that was found is played as slowly as it needs to be, which
            may take longer than `duration`.

    Returns:
        The drive, and what to expect of it; after Ctrl-C the drive so far.

    Raises:
        SceneError: if a key is unknown or has no effect, the scene has no derivatives, or the strokes do not fit it.
        CrawlerError: if an option is out of range.
    """
    scene = coerce_scene(scene, "excite")
    check_slower_than(scene, slower_than)
    numbers = {"noise": noise, "duration": duration, "every": every, "interval": interval, "rate": rate}
    for name, number in numbers.items():
        if not (math.isfinite(number) and number > 0.0):
            raise CrawlerError(f"excite: {name}: {number:g}; it must be > 0")
    if scene.dimension == 2:
        raise CrawlerError(
            f"excite: {scene.name} is in the plane, where paths have no exact derivatives; record any drive in which "
            "all contacts slide, and identify fits it"
        )
    if duration < _AT_ONCE * every or duration * rate > 1e6:
        raise CrawlerError(
            f"excite: duration: {duration:g} s; it must be at least {_AT_ONCE} times `every`, {_AT_ONCE * every:g} s, "
            f"and at most {1e6 / rate:g} s"
        )
    names = name_joints(scene.body)
    moves, bounds = find_strokes(scene, stroke)
    low, high = held_lengths(scene), held_lengths(scene)  # what has no stroke stays as the scene has it
    low[moves], high[moves] = np.array(bounds).T
    search = _Search(scene, keys, names, (low, high), noise, every, rate, seed)
    interrupted = False
    try:
        search.grow(round(duration / every), interval, progress)
    except KeyboardInterrupt:
        if search.rows.shape[0] == 1:
            raise
        interrupted = True
    driven = search.scene_with_drive()
    if slower_than is not None:
        search.every *= slow_down(driven, slower_than)[1]
        driven = search.scene_with_drive()
    found = identify(driven, [search.measure(driven)], keys, hold_out=0.0, starts=1, seed=seed, seconds=0.0)
    if progress is not None:
        progress(1.0)
    length = search.every * (search.rows.shape[0] - 1)
    return Excitation(driven, found.parameters, length, noise, rate, interval, interrupted, find_inertia(driven))


class _Search:
    """A drive that grows, and the information about the parameters that its measurement would contain."""

    def __init__(
        self,
        scene: Scene,
        keys: Sequence[str],
        links: Sequence[str],
        bounds: tuple[np.ndarray, np.ndarray],
        noise: float,
        every: float,
        rate: float,
        seed: int,
    ) -> None:
        self.scene, self.links, self.bounds = scene, tuple(links), bounds
        self.noise, self.every, self.rate = noise, every, rate
        self.random = np.random.default_rng(seed)
        self.rows = held_lengths(scene)[None]
        moved = set(name_each("link", scene.body.link_springs.size))
        self.channels = tuple(name for name in channel_names(scene) if name not in moved)
        first = self._recording(self.rows[[0, 0]])
        self.begun, self.unknown_start = begin_recordings(scene, keys, [first])
        base = replay_scene(self.begun, first)
        names = expand_keys(base, keys, "excite")
        self.seeks_start = any(key.startswith("start") for key in keys)
        self.names = names
        self.replica = self._build_replica(first)
        self.space = build_space(names, self.replica.start_values, None)
        near = [self._near() for _ in range(_SCENES - 1)]
        self.guesses = [self.space.origin, *(values for values in near if self._information(values) is not None)]

    def _build_replica(self, recording: Measurements) -> Replica:
        kind = Replica if self.scene.has_exact_derivatives else SampledReplica
        return kind(self.begun, recording, self.names, "excite", self.unknown_start)

    def grow(self, most: int, interval: float, progress: Callable[[float], None] | None) -> None:
        """Append waypoints up to `most`, until the half widths of all intervals are below `interval` [1]."""
        stale, excited = 0, -1
        while self.rows.shape[0] - 1 < most:
            count = min(_AT_ONCE, most - self.rows.shape[0] + 1)
            longer = [np.vstack((self.rows, self._draw(count))) for _ in range(_CANDIDATES)]
            costs = [self._cost(rows) for rows in longer]
            self.rows = longer[int(np.argmin([cost for cost, _ in costs]))]
            variances, directions = np.linalg.eigh(min(costs, key=lambda pair: pair[0])[1])
            known = variances < 0.5 * _PRIOR  # combinations of parameters; only their ratios may be knowable
            stale = stale + 1 if int(known.sum()) == excited else 0
            excited = int(known.sum())
            small = directions[:, known] ** 2 @ variances[known] <= (interval / _QUANTILE) ** 2
            if progress is not None:
                progress(0.95 * (self.rows.shape[0] - 1) / most)
            if small.all() and (known.all() or stale >= _PATIENCE):
                return

    def scene_with_drive(self) -> Scene:
        """Build the scene with the drive so far."""
        return playback(self.scene, self._recording(self.rows))

    def measure(self, driven: Scene) -> Measurements:
        """Simulate a measurement of the drive so far, with noise."""
        recording = self._recording(self.rows)
        run = simulate(driven, float(recording.time[-1]), self.rate)
        matrix, added = observation(driven.body, self.channels)
        values = run.displacement @ matrix.T + added
        values = values + self.noise * self.random.normal(size=values.shape)
        return dataclasses.replace(recording, name="simulated measurement", time=run.time, values=values)

    def _recording(self, rows: np.ndarray) -> Measurements:
        """Describe the commands, and the instants of a measurement, whose values are all zero."""
        times = self.every * np.arange(rows.shape[0])
        count = round(times[-1] * self.rate)
        time = np.arange(count + 1) / self.rate
        values = np.zeros((time.size, len(self.channels)))
        return Measurements("design", time, self.channels, values, self.links, rows, times)

    def _draw(self, count: int) -> np.ndarray:
        """Draw waypoints: each rest length at an end of its stroke, between the ends, or where it was, shape (K, L)."""
        low, high = self.bounds
        rows = self.random.uniform(low, high, (count, low.size))
        kind = self.random.integers(0, 4, rows.shape)
        rows = np.where(kind == 0, low, np.where(kind == 1, high, rows))
        for k in range(count):
            before = rows[k - 1] if k else self.rows[-1]
            rows[k] = np.where(kind[k] == 2, np.clip(before, low, high), rows[k])
        return rows

    def _near(self) -> np.ndarray:
        """Draw values of the parameters near the scene's, shape (P,)."""
        factor = np.exp(self.random.uniform(-_NEAR, _NEAR, self.space.origin.size))
        return np.where(self.space.logarithmic, self.space.origin * factor, self.space.origin)

    def _cost(self, rows: np.ndarray) -> tuple[float, np.ndarray]:
        """Compute the mean variance of the parameters over the guesses, and their covariance for the scene's values."""
        if self.scene.has_exact_derivatives:
            self.replica.measured = self._recording(rows)
        else:  # its scene plays the commands
            self.replica = self._build_replica(self._recording(rows))
        total = 0.0
        first: np.ndarray = _PRIOR * np.eye(self.space.origin.size)
        for i, values in enumerate(self.guesses):
            information = self._information(values)
            if information is None:
                return math.inf, first
            covariance = np.linalg.inv(information + np.eye(values.size) / _PRIOR)
            total += float(np.trace(covariance)) / values.size
            first = covariance if i == 0 else first
        return total, first

    def _information(self, values: np.ndarray) -> np.ndarray | None:
        """Compute the Fisher information about the coordinates, shape (P, P), as `identify` knows a sensor by default.

        Lag, scale, drifts and offsets of the channels (if the start is sought, one offset of the frame and places of
        markers) are unknown, too, with the priors of a `Sensor`; and so is the start if nothing tells it.
        """
        measured, sensor, starts = self.replica.measured, Sensor(), self.replica.starts
        predicted = self.replica.predict(values, start=np.zeros(starts) if starts else None)
        if predicted is None:
            return None
        count, slope = values.size, self.space.slope(values)[:, None]
        total = np.zeros((count + 3 + starts, count + 3 + starts))
        shared = sensor.lag.deviation**-2, sensor.scale.deviation**-2, 0.0 if self.seeks_start else 1.0
        total[count:, count:] = np.diag((*shared, *[_VAGUE] * starts))
        added = np.stack((np.ones(measured.time.size), build_drift(measured.time)))
        prior = np.diag([sensor.place.deviation**-2 if self.seeks_start else 0.0, sensor.drift.deviation**-2])
        for m, grounded in enumerate(measured.on_ground):
            own = slice(int(self.seeks_start and not grounded), 1 + int(grounded))
            frame = added[0] * (grounded and self.seeks_start)
            rows = (
                predicted.jacobian[m, :count] * slope,
                -predicted.velocity[:, m],
                predicted.values[:, m] * grounded,
                frame,
                predicted.jacobian[m, count:],
            )
            moved, apart = np.vstack(rows) / self.noise, added[own] / self.noise
            crossed = moved @ apart.T
            total += moved @ moved.T - crossed @ np.linalg.solve(apart @ apart.T + prior[own, own], crossed.T)
        known = np.linalg.solve(total[count:, count:], total[count:, :count])
        return np.asarray(total[:count, :count] - total[:count, count:] @ known)
