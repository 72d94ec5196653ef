"""What measurements decide about the sensors: lag, scale, gain, drifts and places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..fit.fit import Fit
from ..fit.problem import Problem
from ..sensor.noise import find_quantile
from ..sensor.sensor import Prior

_FAR, _LIMIT = 3.0, 5.99
"""Standard deviations of a prior beyond which a number is doubtful, and at which it is not searched any farther."""
_LEARNT = 0.5
"""Part of the standard deviation of a prior below which the measurements have told more."""


@dataclass(frozen=True)
class SensorNumber:
    """What is known about a number of a sensor.

    Attributes:
        name: "lag", "scale", "gain", "drift of contact_0" or "place of contact_0".
        recording: name of the recording.
        verdict: "identified"; "prior" if the measurements add little to what was known before; "held"; "doubtful" if it
            is far from what was known before, or the model does not fit.
        value: of a lag [s], a drift [m], else [1].
        interval: 95 % interval.
        prior: mean and standard deviation before the fit.
    """

    name: str
    recording: str
    verdict: Literal["identified", "prior", "held", "doubtful"]
    value: float
    interval: tuple[float, float]
    prior: Prior

    @property
    def surprise(self) -> float:
        """How far it is from what was known before, in standard deviations [1]."""
        return abs(self.value - self.prior.mean) / self.prior.deviation if self.prior.deviation > 0.0 else 0.0

    def write(self, value: float) -> str:
        """Write such a number in a unit that suits it.

        Args:
            value: the number [s, m or 1].

        Returns:
            The number with its unit.
        """
        factor, unit = (1e3, " ms") if self.name == "lag" else (1e2, " %")
        if " of " in self.name:
            factor, unit = 1e3, " mm"
        return f"{factor * value + 0.0:.3g}{unit}"


def judge_sensors(problem: Problem, fit: Fit, covariance: np.ndarray, freedom: float) -> tuple[SensorNumber, ...]:
    """Write the verdict on each number of each sensor.

    Returns:
        Lag, scale, gain, drifts and places of each recording.
    """
    found, quantile = [], find_quantile(freedom)
    for i, replica in enumerate(problem.replicas):
        name = replica.measured.name
        sensed = problem.sensed(fit.unknowns, i)
        places = dict(zip(problem.names, problem.places(i), strict=True))
        for key in ("lag", "scale", "gain"):
            deviation = float(np.sqrt(covariance[places[key], places[key]])) if key in places else 0.0
            found.append(_judge_number(key, name, sensed[key], deviation, getattr(problem.sensor, key), quantile))
        first = problem.offsets[i]
        widths = np.sqrt(np.diag(_find_covariance_of_offsets(problem, fit, i, covariance))[first:])
        grounded = [c for c, on in zip(replica.measured.channels, replica.measured.on_ground, strict=True) if on]
        kinds = [kind for kind in ("drift", "place") if getattr(problem.sensor, kind).deviation > 0.0]
        named = [(kind, channel) for kind in kinds for channel in grounded]
        for (kind, channel), value, width in zip(named, fit.residuals.linear[i][first:], widths, strict=False):
            prior = getattr(problem.sensor, kind)
            found.append(_judge_number(f"{kind} of {channel}", name, float(value), float(width), prior, quantile))
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
    one = SensorNumber(key, recording, known, value, (value - half, value + half), prior)  # type: ignore[arg-type]
    return doubt_sensor(one) if one.surprise > _FAR else one


def doubt_sensor(one: SensorNumber) -> SensorNumber:
    """Withdraw the verdict on a number of a sensor that is not held.

    Args:
        one: the number.

    Returns:
        The number with the verdict `doubtful`.
    """
    return one if one.verdict == "held" else replace(one, verdict="doubtful")


def warn_of_sensors(problem: Problem, sensors: Sequence[SensorNumber]) -> list[str]:
    """Write which numbers of sensors are far from what was known of them before.

    Args:
        sensors: from `judge_sensors`.

    Returns:
        One line for each kind of number of each recording, about the farthest.
    """
    found: dict[tuple[str, str], SensorNumber] = {}
    for one in sensors:
        place = one.recording, one.name.split(" ")[0]
        if one.surprise > _FAR and one.surprise > getattr(found.get(place), "surprise", 0.0):
            found[place] = one
    lines = []
    for (recording, kind), one in found.items():
        limit = ", the limit of the search" if one.surprise > _LIMIT and " of " not in one.name else ""
        lines.append(
            f"{recording}: {one.name} of {one.write(one.value)} is {one.surprise:.2g} deviations from what was known, "
            f"{one.write(one.prior.mean)} +- {one.write(one.prior.deviation)}{limit}: state what it may be with "
            f"--sensor {kind}=..., or find what else it stands for, as another clock"
        )
    longest = {r.measured.name: problem.longest_lag(i) for i, r in enumerate(problem.replicas)}
    for one in sensors:
        if one.name == "lag" and one.verdict != "held" and abs(one.value) > 0.999 * longest[one.recording]:
            lines.append(
                f"{one.recording}: lag of {one.write(one.value)}: the search ended at a tenth of the recording; both "
                "tables may have different clocks"
            )
    return lines
