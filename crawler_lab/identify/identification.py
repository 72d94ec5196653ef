"""The result of an identification."""

from __future__ import annotations

import functools
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from crawler_model.run.inertia import Inertia
from crawler_model.run.simulate import find_inertia
from crawler_model.scene.scene import Scene

from .fit.misfit import Misfit
from .forecast.posterior import GAIN, Posterior
from .judge.explain import Explanation
from .judge.held_out import HeldOut
from .judge.rate import RateEffect
from .judge.sensors import SensorNumber
from .judge.verdicts import Parameter
from .measurements import Measurements
from .replica.playback import measure_speeds, playback

_OF_SCORE = ("residual", "coverage", "size", "gain_error")
"""Numbers of a score that are printed."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Identification:
    """The result of an identification.

    Attributes:
        scene: the scene with the values found; parameters that are not determined keep their values.
        parameters: what is known about each parameter.
        sensors: what is known about the sensor of each recording.
        residual: root mean square of the fitted residuals [m].
        noise: estimated standard deviation of the measurements, of all together [m].
        held_out: root mean square of the residuals that were not fitted [m]; None if nothing was held out.
        score: how well the rows that were not fitted are predicted; None if nothing was held out.
        model_fits: whether all residuals are about as large as the noise, and held-out ones not larger than predicted.
        where: where the misfit is largest; None if there is none.
        misfits: the size of the residuals of each channel.
        explanations: changes of the model that would explain a misfit, the best one first.
        rate: whether the robot depends on the rate; None if the recordings have no drive at two speeds.
        warnings: one line each.
        recordings: the measurements.
        residuals: simulated minus measured, for each recording, shape (T, M) [m]; NaN where nothing is measured.
        fitted: the rows that were fitted, for each recording, bool, shape (T,).
        offsets: what was added to the model for each recording, shape (M,) [m].
        drifts: what their offsets change by over each recording, shape (M,) [m].
        noises: estimated standard deviation of each channel, for each recording, shape (M,) [m].
        starts: displacement at the start of each recording, shape (N,) [m]; None if the scene or a parameter tells it.
        posterior: the values of the parameters as a distribution, for predictions and gaits.
        interrupted: whether Ctrl-C ended the search of starts, of other minima or of explanations.
    """

    scene: Scene
    parameters: tuple[Parameter, ...]
    sensors: tuple[SensorNumber, ...]
    residual: float
    noise: float
    held_out: float | None
    score: HeldOut | None
    model_fits: bool
    where: str | None
    misfits: tuple[Misfit, ...]
    explanations: tuple[Explanation, ...]
    rate: RateEffect | None
    warnings: tuple[str, ...]
    recordings: tuple[Measurements, ...]
    residuals: tuple[np.ndarray, ...]
    fitted: tuple[np.ndarray, ...]
    offsets: tuple[np.ndarray, ...]
    drifts: tuple[np.ndarray, ...]
    noises: tuple[np.ndarray, ...]
    starts: tuple[np.ndarray | None, ...]
    posterior: Posterior
    interrupted: bool

    @functools.cached_property
    def inertia(self) -> Inertia | None:
        """The largest inertia number of the recorded drives; None for a scene without masses and weights."""
        found = [find_inertia(self.playback(i)) for i in range(len(self.recordings))]
        return max((one for one in found if one is not None), key=lambda one: one.number, default=None)

    @property
    def speeds(self) -> dict[str, float]:
        """The fastest commanded change of each length in the recordings [m/s, of segments 1/s]."""
        each = [measure_speeds(self.playback(i)) for i in range(len(self.recordings))]
        return {name: max(speeds[name] for speeds in each) for name in each[0]} if each else {}

    def playback(self, recording: int = 0) -> Scene:
        """Build the scene with the values found that plays a recording.

        Args:
            recording: its index.

        Returns:
            The scene; its drive is the recorded commands, straight between rows, with lengths as the actuators reach
            them if they have a gain.
        """
        gains = [one.value for one in self.sensors if one.name == GAIN]  # one of each recording
        return playback(self.scene, self.recordings[recording], gains[recording], self.starts[recording])

    def __repr__(self) -> str:
        """Describe the result in one line."""
        return f"Identification({', '.join(f'{p.name}: {p.verdict}' for p in self.parameters)})"

    def __getitem__(self, name: str) -> Parameter:
        """Return the parameter of a name."""
        return next(p for p in self.parameters if p.name == name)

    def summary(self) -> dict[str, Any]:
        """Convert to the values that `crawler identify --json` prints.

        Returns:
            Plain numbers, lists and text, schema 1.
        """
        return {
            "schema": 1,
            "scene": self.scene.name,
            "parameters": [p.as_plain() for p in self.parameters],
            "sensors": [asdict(s) | {"interval": list(s.interval), "prior": list(s.prior)} for s in self.sensors],
            "posterior": self.posterior.as_plain(any(p.verdict in ("sum", "doubtful") for p in self.parameters)),
            "residual": self.residual,
            "noise": self.noise,
            "held_out": self.held_out,
            "score": None if self.score is None else {name: getattr(self.score, name) for name in _OF_SCORE},
            "model_fits": self.model_fits,
            "where": self.where,
            "misfits": [m.as_plain() for m in self.misfits],
            "explanations": [asdict(e) for e in self.explanations],
            "rate": None if self.rate is None else self.rate.as_plain(),
            "warnings": list(self.warnings),
            "inertia": None if self.inertia is None else self.inertia.summary(),
            "speeds": self.speeds,
            "recordings": [
                {
                    "name": m.name,
                    "rows": int(m.time.size),
                    "fitted_rows": int(rows.sum()),
                    "offset": dict(zip(m.channels, added.tolist(), strict=True)),
                    "drift": dict(zip(m.channels, drift.tolist(), strict=True)),
                    "noise": dict(zip(m.channels, noise.tolist(), strict=True)),
                    "start": None if start is None else start.tolist(),
                }
                for m, rows, added, drift, noise, start in zip(
                    self.recordings, self.fitted, self.offsets, self.drifts, self.noises, self.starts, strict=True
                )
            ],
            "complete": not self.interrupted,
        }
