"""Sensors: the part of a scene that describes them, and what they measure.

They measure with noise and drift, in pixels, late, at a rate of their own, and not always.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BeforeValidator, WithJsonSchema, model_validator

from ..body.drive import NS
from .friction_parts import Number, Part, key


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != int(value):
        raise ValueError(f"{value!r} is not a whole number")
    return int(value)


class SensorsPart(Part):
    """How sensors measure lengths, angles and forces: as a camera or a marker system does, and load cells.

    The simulator publishes what they measure beside the true states, and observations of the Gymnasium environment
    consist of it; the motion does not depend on it.
    """

    noise: Number = key("Standard deviation of the noise of lengths.", "m", default=0.0, minimum=0)
    angle_noise: Number = key("Standard deviation of the noise of angles.", "rad", default=0.0, minimum=0)
    force_noise: Number = key("Standard deviation of the noise of forces and torques.", "N", default=0.0, minimum=0)
    drift: Number = key("Standard deviation of the slow drift of lengths.", "m", default=0.0, minimum=0)
    drift_time: Number = key("Time in which the drift changes.", "s", default=10.0, exclusiveMinimum=0)
    pixel: Number = key("Step to whose multiples lengths are rounded; 0 for none.", "m", default=0.0, minimum=0)
    delay: Number = key("Time from a measurement to its message.", "s", default=0.0, minimum=0, maximum=1e3)
    rate: Number = key("Measurements per second; 0 for one at each tick.", "Hz", default=0.0, minimum=0)
    dropped: Number = key("Fraction of the measurements that are lost.", "1", default=0.0, minimum=0, maximum=1)
    seed: Annotated[int, BeforeValidator(_whole), WithJsonSchema({"type": "integer"})] = key(
        "Seed of the noise, of the drift and of the losses.", default=0, minimum=0
    )

    @model_validator(mode="after")
    def _within_bounds(self) -> SensorsPart:
        for name, field in type(self).model_fields.items():
            value, bounds = getattr(self, name), field.json_schema_extra
            assert isinstance(bounds, dict)
            for bound, holds, words in (
                ("minimum", float.__ge__, "at least"),
                ("exclusiveMinimum", float.__gt__, "above"),
                ("maximum", float.__le__, "at most"),
            ):
                if bound in bounds and not holds(float(value), float(bounds[bound])):  # type: ignore[arg-type]
                    raise ValueError(f"{name}: {value:g}; it must be {words} {bounds[bound]:g}")
        return self


class Measurement(NamedTuple):
    """Readings at one instant.

    Attributes:
        ns: simulated time at which it was made [ns].
        values: shape (M,).
        rates: mean rate of each length and angle since the measurement before, 0 of forces, shape (M,) [m/s, rad/s].
    """

    ns: int
    values: np.ndarray
    rates: np.ndarray


class Sensors:
    """Sensors of M readings. Equal seeds measure equal readings alike, to the bit.

    The drift of a length is an Ornstein-Uhlenbeck process, d(t + h) = a d(t) + sqrt(1 - a^2) sigma n with
    a = exp(-h / drift_time) and n normal, in which sigma is `drift`; it begins in its steady state. What is measured is
    rounded to pixels after noise and drift are added.
    """

    def __init__(self, part: SensorsPart, units: Sequence[str], rate: float = 0.0) -> None:
        """Prepare sensors.

        Args:
            part: how they measure.
            units: "m", "rad", "N", or "m/s" for the difference of two lengths, of each reading; "" where it is known
                exactly, shape (M,).
            rate: calls of `measure` per second, needed for "m/s" [Hz].
        """
        self._part = part
        noise = {"m": part.noise, "rad": part.angle_noise, "N": part.force_noise, "": 0.0}
        noise["m/s"] = math.sqrt(2.0) * part.noise * (min(part.rate, rate) if part.rate else rate)
        self._noise = np.array([noise[unit] for unit in units])
        self._is_length, self._is_angle = (np.array([unit == which for unit in units]) for which in ("m", "rad"))
        self.restart()

    def restart(self, run: int | None = None) -> None:
        """Return to the start.

        Args:
            run: number of the run, in which other noise follows from the same seed; None for what the seed alone leads
                to.
        """
        self._random = np.random.default_rng(self._part.seed if run is None else [self._part.seed, run])
        self._drift = self._part.drift * self._random.standard_normal(self._noise.size)
        self._number, self._drifted_ns = -1, 0
        self._waiting: deque[Measurement] = deque()
        self._before: Measurement | None = None
        self.latest: Measurement | None = None
        """The last measurement that has arrived, or the one of the start; None before it."""

    def measure(self, ns: int, readings: np.ndarray) -> list[Measurement]:
        """Measure if it is time, and list the measurements that arrive now.

        Args:
            ns: simulated time, not before the time of the last call [ns].
            readings: the true values then, shape (M,) [m, rad, N].

        Returns:
            The measurements that arrive by then, in order. The first one, of the start, is never lost.
        """
        part = self._part
        number = math.floor(ns / NS * part.rate + 1e-9) if part.rate else self._number + 1
        if number > self._number:
            self._number = number
            values = self._sense(ns, readings)
            if self._random.random() >= part.dropped or self._before is None:
                self._waiting.append(self._follow(ns, values))
                self.latest = self.latest or self._before
        arrived, sent = [], ns - round(part.delay * NS)
        while self._waiting and self._waiting[0].ns <= sent:
            self.latest = self._waiting.popleft()
            arrived.append(self.latest)
        return arrived

    def _sense(self, ns: int, readings: np.ndarray) -> np.ndarray:
        part, random = self._part, self._random
        decay = math.exp(-(ns - self._drifted_ns) / NS / part.drift_time)
        spread = part.drift * math.sqrt(1.0 - decay * decay)
        self._drift = decay * self._drift + spread * random.standard_normal(readings.size)
        self._drifted_ns = ns
        values = readings + self._noise * random.standard_normal(readings.size)
        values[self._is_length] += self._drift[self._is_length]
        if part.pixel:
            values[self._is_length] = part.pixel * np.rint(values[self._is_length] / part.pixel)
        return values

    def _follow(self, ns: int, values: np.ndarray) -> Measurement:
        """Find the rates since the measurement before, and keep this one for the next."""
        rates = np.zeros(values.size)
        before = self._before
        if before is not None and ns > before.ns:
            change = values - before.values
            change[self._is_angle] = np.remainder(change[self._is_angle] + np.pi, 2.0 * np.pi) - np.pi
            moving = self._is_length | self._is_angle
            rates[moving] = change[moving] / ((ns - before.ns) / NS)
        self._before = Measurement(ns, values, rates)
        return self._before
