"""What measurements decide about the sensors: lag, scale, gain and drifts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..fit.fit import Fit
from ..fit.problem import Problem
from ..sensor.noise import find_quantile
from ..sensor.sensor import Prior

_LEARNT = 0.5
"""Part of the standard deviation of a prior below which the measurements have told more."""


@dataclass(frozen=True)
class SensorNumber:
    """What is known about a number of a sensor.

    Attributes:
        name: "lag", "scale", "gain", or "drift of contact_0".
        recording: name of the recording.
        verdict: "identified"; "prior" if the measurements add little to what was known before; "held".
        value: of a lag [s], a drift [m], else [1].
        interval: 95 % interval.
        prior: mean and standard deviation before the fit.
    """

    name: str
    recording: str
    verdict: Literal["identified", "prior", "held"]
    value: float
    interval: tuple[float, float]
    prior: Prior


def judge_sensors(problem: Problem, fit: Fit, covariance: np.ndarray, freedom: float) -> tuple[SensorNumber, ...]:
    """Write the verdict on each number of each sensor.

    Returns:
        Lag, scale, gain and drifts of each recording.
    """
    found, quantile = [], find_quantile(freedom)
    for i, replica in enumerate(problem.replicas):
        name = replica.measured.name
        sensed = problem.sensed(fit.unknowns, i)
        places = dict(zip(problem.names, problem.places(i), strict=True))
        for key in ("lag", "scale", "gain"):
            deviation = float(np.sqrt(covariance[places[key], places[key]])) if key in places else 0.0
            found.append(_judge_number(key, name, sensed[key], deviation, getattr(problem.sensor, key), quantile))
        prior = problem.sensor.drift
        first = problem.offsets[i]
        widths = np.sqrt(np.diag(_find_covariance_of_offsets(problem, fit, i, covariance))[first:])
        grounded = [c for c, on in zip(replica.measured.channels, replica.measured.on_ground, strict=True) if on]
        for channel, value, width in zip(grounded, fit.residuals.linear[i][first:], widths, strict=False):
            found.append(_judge_number(f"drift of {channel}", name, float(value), float(width), prior, quantile))
    return tuple(found)


def _find_covariance_of_offsets(problem: Problem, fit: Fit, i: int, covariance: np.ndarray) -> np.ndarray:
    """Compute the covariance of the offsets and drifts of a recording, shape (Q, Q)."""
    names = [*range(problem.space.origin.size), *problem.places(i)]
    moved = fit.residuals.d_linear[i]
    return np.asarray(np.linalg.pinv(problem.grams[i]) + moved @ covariance[np.ix_(names, names)] @ moved.T)


def _judge_number(
    key: str, recording: str, value: float, deviation: float, prior: Prior, quantile: float
) -> SensorNumber:
    half = quantile * deviation
    known = "held" if prior.deviation == 0.0 else "identified" if deviation < _LEARNT * prior.deviation else "prior"
    return SensorNumber(key, recording, known, value, (value - half, value + half), prior)  # type: ignore[arg-type]
