"""The residuals of a fit as functions of its unknowns: parameters, and what the sensor of each recording does.

Offsets, drifts and places of markers enter linearly. They are eliminated from the whitened residuals (variable
projection; G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413), so that only parameters, lags, errors of scale
and starts are unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..replica.replica import Replica
from ..sensor.noise import Noise, Whitening, build_whitening, estimate_noise, find_floor, find_pixel, guess_noise
from ..sensor.sensor import Sensor, build_drift
from .space import Space

Offset = Literal["none", "frame", "each"]
_FEWEST = 8
"""Fitted rows of a channel from which its noise is estimated."""
_NOT_ROUNDED = 1e-3
"""Residuals below this part of the pixels, in all channels, which no camera leaves: values computed on a grid."""
_LONGEST_LAG = 0.1
"""As a part of the recording."""
_LARGE = 60_000
"""Fitted values of large recordings, weighted by the time that an evaluation takes."""
_WIDEST = 6.0
"""Standard deviations of a prior within which its number is searched."""


@dataclass(frozen=True)
class Residuals:
    """Residuals of all recordings at some unknowns.

    Attributes:
        all: simulated minus measured with the offsets and drifts that fit best, per recording, shape (T, M) [m]; NaN
            where nothing is measured.
        resting: whether each contact rests, elongations whether they do not change, per recording, bool, shape (T, M).
        fitted: the fitted rows, whitened, channel by channel, then the priors, shape (R,) [1].
        jacobian: the derivatives of `fitted` with respect to the unknowns, shape (R, U).
        linear: offsets, then drifts and places that fit best, per recording, shape (Q,) [m].
        d_linear: their derivatives with respect to the parameters and the sensor's numbers, shape (Q, P + names).
        derivative_error: part by which derivatives may be wrong, below which a combination of them counts as zero [1].
    """

    all: tuple[np.ndarray, ...]
    resting: tuple[np.ndarray, ...]
    fitted: np.ndarray
    jacobian: np.ndarray
    linear: tuple[np.ndarray, ...]
    d_linear: tuple[np.ndarray, ...]
    derivative_error: float

    @property
    def cost(self) -> float:
        """Sum of squares of `fitted` [1]."""
        return float(self.fitted @ self.fitted)


@dataclass(frozen=True)
class Channel:
    """The fitted rows of a channel.

    Attributes:
        rows: their indices, shape (R,).
        place: of their residuals among the whitened ones of the recording.
        noise: of their values.
        extra: variance by which they count less, shape (R,) [m^2].
        whitening: of both.
        own: the offsets and drifts that they have, shape (K,).
        linear: whitened derivatives with respect to these, shape (K, R).
    """

    rows: np.ndarray
    place: slice
    noise: Noise
    extra: np.ndarray
    whitening: Whitening
    own: np.ndarray
    linear: np.ndarray


@dataclass
class Work:
    """What evaluations have cost, counted by their numbers, as a clock would let results depend on the machine.

    Attributes:
        done: their time on an ordinary processor [s].
    """

    done: float = 0.0


class Problem:
    """Recordings, the rows that are fitted, their noise, and the unknowns.

    Attributes:
        work: of all evaluations of this problem, and of others that share it.
    """

    def __init__(
        self,
        replicas: Sequence[Replica],
        rows: Sequence[np.ndarray],
        space: Space,
        offset: Offset,
        sensor: Sensor,
    ) -> None:
        """Count the unknowns, and guess the noise.

        Args:
            replicas: the recordings.
            rows: which of their rows are fitted, bool, each of shape (T,).
            offset: "none", "frame" (one constant per recording and axis) or "each" (one per channel).
            sensor: priors of what the sensors do.
        """
        self.replicas, self.rows, self.space = tuple(replicas), tuple(rows), space
        self.offset, self.sensor, self.work = offset, sensor, Work()
        self.starts = replicas[0].starts
        self.names = (*sensor.unknown, *(f"start {j}" for j in range(self.starts)))
        self.count = space.origin.size + len(self.names) * len(self.replicas)
        self.designs = [_build_design(r, offset, sensor) for r in replicas]
        self.widths = [_list_widths(r, offset, sensor) for r in replicas]
        self.offsets = [_count_offsets(r, offset) for r in replicas]
        self.floor = max(find_floor(r.measured.values) for r in replicas)
        self.present = [np.isfinite(r.measured.values) & rows[:, None] for r, rows in zip(replicas, rows, strict=True)]
        self.pixels = [_find_pixels(r, p) for r, p in zip(self.replicas, self.present, strict=True)]
        guesses = []
        for replica, present, pixels in zip(self.replicas, self.present, self.pixels, strict=True):
            columns = [v[p] for v, p in zip(replica.measured.values.T, present.T, strict=True)]
            found = [
                guess_noise(v, float(q), self.floor) if v.size else (Noise(self.floor), v)
                for v, q in zip(columns, pixels, strict=True)
            ]
            guesses.append(found)
        self.set_noise(guesses)

    def set_noise(self, noises: Sequence[Sequence[tuple[Noise, np.ndarray]]]) -> None:
        """Set the noise of all channels.

        Args:
            noises: for each recording, one for each channel, with the variance by which its fitted rows count less,
                shape (R,) [m^2].
        """
        self.channels = [self._whiten(i, one) for i, one in enumerate(noises)]
        self.sizes = [own[-1].place.stop + widths.size for own, widths in zip(self.channels, self.widths, strict=True)]
        self.grams = [self._gram(i) for i in range(len(self.replicas))]
        self._last: tuple[bytes, Residuals | None] | None = None

    def _whiten(self, i: int, noises: Sequence[tuple[Noise, np.ndarray]]) -> list[Channel]:
        """Build the channels of a recording from their noise and the variance by which rows count less."""
        found, time, first = [], self.replicas[i].measured.time, 0
        for m, (noise, extra) in enumerate(noises):
            design = self.designs[i][:, m]
            rows, own = np.flatnonzero(self.present[i][:, m]), np.flatnonzero(design.any(axis=0))
            whitening, place = build_whitening(noise, time[rows], extra), slice(first, first + rows.size)
            found.append(Channel(rows, place, noise, extra, whitening, own, whitening.apply(design[rows][:, own].T)))
            first = place.stop
        return found

    def estimate_noise(self, residuals: Residuals) -> None:
        """Estimate the noise of all channels from residuals.

        Args:
            residuals: of a fit.
        """
        noises, known = [], {}
        for i, replica in enumerate(self.replicas):
            time, found = replica.measured.time, []
            if self.pixels[i].any() and np.all(
                _measure_rms(residuals.all[i], self.present[i]) <= _NOT_ROUNDED * self.pixels[i]
            ):
                self.pixels[i] = np.zeros(self.pixels[i].size)
            for m, (name, channel) in enumerate(zip(replica.measured.channels, self.channels[i], strict=True)):
                rows, estimate = channel.rows, (channel.noise, np.zeros(channel.rows.size))
                if rows.size >= _FEWEST:
                    estimate = estimate_noise(time[rows], residuals.all[i][rows, m], self.pixels[i][m], self.floor)
                if rows.size:
                    known[name] = estimate[0]
                found.append(estimate)
            noises.append(found)
        for replica, found in zip(self.replicas, noises, strict=True):  # channels without fitted rows borrow it
            names = replica.measured.channels
            found[:] = [(n if e.size else known.get(c, n), e) for c, (n, e) in zip(names, found, strict=True)]
        self.set_noise(noises)

    @property
    def is_large(self) -> bool:
        """Whether an evaluation takes long, so that there should be few of them."""
        return sum(r.weight * max(int(p.sum()), 1) for r, p in zip(self.replicas, self.present, strict=True)) > _LARGE

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of all unknowns, each of shape (U,)."""
        low, high = np.empty(self.count), np.empty(self.count)
        count = self.space.origin.size
        low[:count], high[:count] = (self.space.to_coordinates(v) for v in (self.space.low, self.space.high))
        for i in range(len(self.replicas)):
            longest = self.longest_lag(i)
            low[self.places(i)], high[self.places(i)] = -np.inf, np.inf
            for name, at in zip(self.sensor.unknown, self.places(i), strict=False):
                mean, deviation = getattr(self.sensor, name)
                most = max(abs(mean), longest) if name == "lag" else 0.9
                low[at], high[at] = max(mean - _WIDEST * deviation, -most), min(mean + _WIDEST * deviation, most)
        return low, high

    def longest_lag(self, recording: int) -> float:
        """Compute the longest lag that is searched if its prior allows more.

        Returns:
            A tenth of the recording [s].
        """
        return _LONGEST_LAG * float(np.ptp(self.replicas[recording].measured.time))

    def places(self, recording: int) -> range:
        """List the indices of the unknowns of a recording: of its sensor, then of its start.

        Returns:
            In the order of `names`.
        """
        first = self.space.origin.size + len(self.names) * recording
        return range(first, first + len(self.names))

    def unknowns(self, values: np.ndarray) -> np.ndarray:
        """Build a start from values of the parameters, the means of the priors, and guesses of the starts.

        Returns:
            Shape (U,).
        """
        sensor = [getattr(self.sensor, name).mean for name in self.sensor.unknown]
        parts = [part for one in self.replicas for part in (sensor, one.guess_start(self.offset))]
        return np.concatenate([self.space.to_coordinates(values), *parts])

    def sensed(self, unknowns: np.ndarray, recording: int) -> dict[str, float]:
        """Read what the sensor of a recording does.

        Returns:
            `lag` [s], `scale` [1] and `gain` [1], unknown or held.
        """
        found = {name: float(getattr(self.sensor, name).mean) for name in ("lag", "scale", "gain")}
        return found | {name: float(unknowns[at]) for name, at in zip(self.names, self.places(recording), strict=True)}

    def start(self, unknowns: np.ndarray, recording: int) -> np.ndarray | None:
        """Read the numbers of the start of a recording.

        Returns:
            Shape (S,) [m]; None if it is known.
        """
        return unknowns[list(self.places(recording))[len(self.sensor.unknown) :]] if self.starts else None

    def compute(self, unknowns: np.ndarray) -> Residuals | None:
        """Compute residuals and their derivatives.

        Returns:
            None if no motion exists at these values.
        """
        key = unknowns.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = (key, self._compute(unknowns))
        return self._last[1]

    def _compute(self, unknowns: np.ndarray) -> Residuals | None:
        self.work.done += sum(replica.work for replica in self.replicas)
        found, resting, linears, parts = [], [], [], []
        for i in range(len(self.replicas)):
            observed = self._observe(unknowns, i)
            if observed is None:
                return None
            raw, rest = observed
            whitened, own = self.project(i, raw)
            found.append(raw[:, 0].T - np.einsum("tmq,q->tm", self.designs[i], own[:, 0]))
            resting.append(rest)
            linears.append(-own)
            parts.append(whitened)
        fitted, jacobian = self._join(unknowns, parts)
        linear, d_linear = tuple(one[:, 0] for one in linears), tuple(one[:, 1:] for one in linears)
        error = max(replica.derivative_error for replica in self.replicas)
        return Residuals(tuple(found), tuple(resting), fitted, jacobian.T, linear, d_linear, error)

    def _join(self, unknowns: np.ndarray, parts: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Join the residuals of all recordings and priors, shape (R,), and their derivatives, shape (U, R)."""
        count = self.space.origin.size
        size = sum(part.shape[1] for part in parts) + len(self.sensor.unknown) * len(parts)
        fitted, jacobian = np.empty(size), np.zeros((self.count, size))
        place = 0
        for i, part in enumerate(parts):
            rows = slice(place, place + part.shape[1])
            fitted[rows] = part[0]
            jacobian[:count, rows] = part[1 : 1 + count]
            jacobian[self.places(i), rows] = part[1 + count :]
            place = rows.stop
        for k, name in enumerate(self.sensor.unknown):
            mean, deviation = getattr(self.sensor, name)
            for i in range(len(parts)):
                at = self.places(i)[k]
                fitted[place], jacobian[at, place] = (unknowns[at] - mean) / deviation, 1.0 / deviation
                place += 1
        return fitted, jacobian

    def _observe(self, unknowns: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Compute what the sensor of a recording would show, less what it showed, and its derivatives.

        Returns:
            Residuals and derivatives with respect to parameters and sensor, shape (M, 1 + P + names, T); and which
            channels rest, shape (T, M). None if there is no motion.
        """
        replica, count = self.replicas[i], self.space.origin.size
        values = self.space.to_values(unknowns[:count])
        sensor = self.sensed(unknowns, i)
        start, with_gain = self.start(unknowns, i), "gain" in self.names
        predicted = replica.predict(values, sensor["lag"], sensor["gain"], with_gain, (), start)
        if predicted is None:
            return None
        ground = replica.measured.on_ground
        scale = 1.0 + sensor["scale"] * ground
        parts = {
            "lag": (-predicted.velocity * scale).T,
            "scale": (predicted.values * ground).T,
        }
        if with_gain:
            parts["gain"] = predicted.jacobian[:, count] * scale[:, None]
        own = predicted.jacobian[:, count + with_gain :] * scale[:, None, None]
        parts |= {f"start {j}": own[:, j] for j in range(self.starts)}
        raw = np.empty((ground.size, 1 + count + len(self.names), predicted.values.shape[0]))
        raw[:, 0] = (predicted.values * scale - replica.measured.values).T
        slopes = (self.space.slope(values) * scale[:, None])[:, :, None]
        np.multiply(predicted.jacobian[:, :count], slopes, out=raw[:, 1 : 1 + count])
        for k, name in enumerate(self.names):
            raw[:, 1 + count + k] = parts[name]
        return raw, predicted.velocity == 0.0

    def project(self, recording: int, raw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whiten columns, and remove what offsets and drifts explain of them.

        Args:
            raw: shape (M, C, T) [m].

        Returns:
            The fitted rows, channel by channel, then the rows of the priors of drifts, shape (C, R); and the offsets
            and drifts that explain most, shape (Q, C).
        """
        channels, gram = self.channels[recording], self.grams[recording]
        whitened = np.empty((raw.shape[1], self.sizes[recording]))
        moment = np.zeros((gram.shape[0], raw.shape[1]))
        for channel, part in zip(channels, raw, strict=True):
            shown = part if channel.rows.size == part.shape[1] else part[:, channel.rows]
            channel.whitening.apply(shown, whitened[:, channel.place])
            moment[channel.own] += channel.linear @ whitened[:, channel.place].T
        seen = np.diag(gram) > 0.0
        own = np.zeros(moment.shape)
        own[seen] = np.linalg.solve(gram[np.ix_(seen, seen)], moment[seen])
        for channel in channels:
            whitened[:, channel.place] -= own[channel.own].T @ channel.linear
        whitened[:, channels[-1].place.stop :] = -own[self.offsets[recording] :].T / self.widths[recording]
        return whitened, own

    def _gram(self, recording: int) -> np.ndarray:
        """Compute the information on the offsets, drifts and places of a recording, with their priors, shape (Q, Q)."""
        count = self.designs[recording].shape[-1]
        found = np.zeros((count, count))
        for channel in self.channels[recording]:
            found[np.ix_(channel.own, channel.own)] += channel.linear @ channel.linear.T
        known = range(self.offsets[recording], count)
        found[known, known] += self.widths[recording] ** -2
        return found

    def differentiate(self, unknowns: np.ndarray, recording: int) -> np.ndarray:
        """Compute the derivatives of what a sensor shows with respect to the parameters and its own numbers.

        Args:
            unknowns: shape (U,), at which a motion exists.

        Returns:
            Shape (M, P + names, T) [m].
        """
        observed = self._observe(unknowns, recording)
        assert observed is not None
        return observed[0][:, 1:]


def _find_pixels(replica: Replica, present: np.ndarray) -> np.ndarray:
    """Find the step whose multiples the values of each channel are, 0 if there is none, shape (M,) [m]."""
    measured = replica.measured
    found = np.array([find_pixel(v[p]) for v, p in zip(measured.values.T, present.T, strict=True)])
    # a contact that hardly moves shows no step of its own, but has the camera of the others
    ground = measured.on_ground & (found > 0.0)
    return np.where(
        measured.on_ground & (found == 0.0) & ground.any(), np.median(found[ground] if ground.any() else [0.0]), found
    )


def _measure_rms(residuals: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Compute the rms of the fitted residuals of each channel, 0 where none is fitted, shape (M,) [m]."""
    squares = np.sum(np.where(present, residuals, 0.0) ** 2, axis=0)
    return np.asarray(np.sqrt(squares / np.maximum(present.sum(axis=0), 1)))


def _count_offsets(replica: Replica, offset: Offset) -> int:
    ground = replica.measured.on_ground
    return ground.size if offset == "each" else replica.measured.axes.shape[1] * (offset == "frame")


def _has_places(offset: Offset, sensor: Sensor) -> bool:
    return offset != "each" and sensor.place.deviation > 0.0


def _list_widths(replica: Replica, offset: Offset, sensor: Sensor) -> np.ndarray:
    """List the standard deviations of the priors of drifts and places, in the order of the design [m]."""
    drift = [sensor.drift.deviation] if sensor.drift.deviation > 0.0 else []
    place = [sensor.place.deviation] if _has_places(offset, sensor) else []
    return np.repeat([*drift, *place], int(replica.measured.on_ground.sum()))


def _build_design(replica: Replica, offset: Offset, sensor: Sensor) -> np.ndarray:
    """Build the derivatives of the channels with respect to offsets, drifts and places, shape (T, M, Q)."""
    measured = replica.measured
    ground = measured.on_ground
    offsets = np.eye(ground.size) if offset == "each" else measured.axes
    offsets = offsets[:, : _count_offsets(replica, offset)]
    parts = [np.broadcast_to(offsets, (measured.time.size, *offsets.shape))]
    if sensor.drift.deviation > 0.0:
        parts.append(build_drift(measured.time)[:, None, None] * np.eye(ground.size)[:, ground])
    if _has_places(offset, sensor):
        parts.append(np.broadcast_to(np.eye(ground.size)[:, ground], (measured.time.size, ground.size, ground.sum())))
    return np.concatenate(parts, axis=-1)
