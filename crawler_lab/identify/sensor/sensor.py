"""What a sensor does to positions: lag, scale, offset and drift, each with a prior; and the gain of the actuators.

    y_i(t) = (1 + scale) x_i(t - lag) + offset_i + drift_i (t - t_middle) / duration + noise

Where the offset is that of a frame, each marker has a place of its own on its contact, as a hand glued it. Elongations
have a lag and an offset only. The gain g of the actuators multiplies all commanded lengths. It is exactly confounded
with the scale, because x(g L, g mu) = g x(L, mu): whatever is assumed of it passes to friction one to one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from crawler_model.errors import CrawlerError


class Prior(NamedTuple):
    """What is known about a number before anything is measured."""

    mean: float
    deviation: float
    """Standard deviation; 0 for a number that is held."""


_WIDE_LAG, _WIDE_SCALE, _WIDE_DRIFT, _HELD = Prior(0.0, 0.05), Prior(0.0, 0.005), Prior(0.0, 2e-3), Prior(0.0, 0.0)
_BY_HAND = Prior(0.0, 1e-3)


@dataclass(frozen=True)
class Sensor:
    """Priors of what the sensor of each recording does.

    Attributes:
        lag: of the measured values behind the commands [s].
        scale: error of the scale of positions [1].
        drift: of the offset of each contact over the recording [m].
        gain: error of the gain of the actuators [1].
        place: of each marker against its contact, unless each channel has an offset that is unknown anyway [m].
    """

    lag: Prior = _WIDE_LAG
    scale: Prior = _WIDE_SCALE
    drift: Prior = _WIDE_DRIFT
    gain: Prior = _HELD
    place: Prior = _BY_HAND

    def __post_init__(self) -> None:
        """Check the numbers."""
        for field in fields(self):
            prior = getattr(self, field.name)
            if not math.isfinite(prior.mean) or not 0.0 <= prior.deviation < math.inf:
                raise CrawlerError(
                    f"sensor: {field.name}: {prior.mean:g} +- {prior.deviation:g}; the mean must be finite and the "
                    "uncertainty 0 or more"
                )
        for name in ("drift", "place"):
            if getattr(self, name).mean != 0.0:
                raise CrawlerError(f"sensor: {name}: {getattr(self, name).mean:g} m; it may be unknown or 0")
        for name in ("scale", "gain"):
            mean, deviation = getattr(self, name)
            if abs(mean) + deviation > 0.5:
                raise CrawlerError(f"sensor: {name}: {mean:g} +- {deviation:g}; it must be at most 0.5, which is 50 %")

    @property
    def unknown(self) -> tuple[str, ...]:
        """The numbers that a fit finds for each recording, apart from drifts and places."""
        return tuple(name for name in ("lag", "scale", "gain") if getattr(self, name).deviation > 0.0)


PERFECT = Sensor(_HELD, _HELD, _HELD, _HELD, _HELD)
"""A sensor without lag, scale error and drift, and exact places of markers; offsets are another matter."""


def build_drift(time: np.ndarray) -> np.ndarray:
    """Build the shape of a drift over a recording.

    Returns:
        From -1/2 to 1/2, shape (T,) [1].
    """
    return np.asarray((time - 0.5 * (time[0] + time[-1])) / (time[-1] - time[0]))
