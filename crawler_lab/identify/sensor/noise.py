"""Noise of measurements: an Ornstein-Uhlenbeck process plus white noise, or the rounding of a camera's pixels.

No real record is white: trackers filter, and cameras round. OU plus white noise has the covariance of an ARMA(1, 1)
process: r_k - a_k r_(k-1) has a tridiagonal covariance, whose Cholesky factor whitens in O(T).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

FLOOR = 1e-6
"""Least standard deviation of any measurement: below, digits of commands and times count [m]."""
_FLOOR_PART = 1e-5
"""The same, as a part of the range of the motion."""
HUBER = 2.5
"""Standard deviations from which residuals count less."""
_GROSS = 6.0
"""Standard deviations of an outlier."""
_REFUSED = 1e4
"""Factor on the variance of outliers, which leaves nothing of them."""
_MOST_ROWS = 20_000
"""Rows from which the noise is estimated."""
_BLOCKS = 10
_MAD = 1.4826
_WORTH = 3.0
"""Gain in log likelihood from which noise is not white."""
_DITHERED = 1.0 / 3.0
"""Noise of this part of a pixel makes its rounding noise, too."""
_HARMONICS = 30
_LAGS = (1, 2, 3, 5, 8, 13, 21, 34)
_FEWEST_PAIRS = 10
_PERIODS = 12
"""Parts of a record, more than half of which show what noise is."""
_NO_CHANCE = 10
"""So many distances are all multiples of the least one by no chance."""
_EDGE = 2
"""Rows at the ends of a rest that may belong to a slide."""


class Noise(NamedTuple):
    """Noise of one channel."""

    white: float
    """Standard deviation of its white part [m]."""
    slow: float = 0.0
    """Standard deviation of its Ornstein-Uhlenbeck part [m]."""
    time: float = 1.0
    """Correlation time of this part [s]."""
    pixel: float = 0.0
    """Width of the pixels if the error is only their rounding, else 0 [m]."""

    @property
    def size(self) -> float:
        """Standard deviation [m]."""
        return float(np.hypot(self.white, self.slow))


@dataclass(frozen=True)
class Whitening:
    """A linear map that turns noise of some covariance into independent numbers of variance 1.

    Attributes:
        decay: correlation of the slow part with the slow part of the row before, shape (T,); None for white noise.
        factor: lower Cholesky factor of the covariance of the differences, banded, shape (2, T); for white noise the
            standard deviations, shape (T,).
    """

    decay: np.ndarray | None
    factor: np.ndarray

    def apply(self, rows: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Whiten rows of numbers over time.

        Args:
            rows: shape (C, T) [m].
            out: where the result is stored, shape (C, T); None for a new array.

        Returns:
            The result, shape (C, T) [1].
        """
        from scipy.linalg.lapack import dtbtrs

        if self.decay is None:
            return np.divide(rows, self.factor, out=out)
        if rows.size == 0:  # dtbtrs would write beyond its arrays
            return rows.copy()
        differences = rows.copy()
        differences[:, 1:] -= self.decay[1:] * rows[:, :-1]
        whitened = dtbtrs(self.factor, differences.T, uplo="L", overwrite_b=1)[0].T
        if out is None:
            return np.asarray(whitened)
        out[...] = whitened
        return out

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the covariance, of lengths in m [1]."""
        return 2.0 * float(np.log(self.factor if self.decay is None else self.factor[0]).sum())


def build_whitening(noise: Noise, time: np.ndarray, extra: np.ndarray) -> Whitening:
    """Factorise the covariance of the noise of some rows.

    Args:
        noise: the noise.
        extra: variance by which rows count less, shape (T,) [m^2].

    Returns:
        The map.
    """
    from scipy.linalg import cholesky_banded

    variance = noise.white**2 + extra
    if noise.slow == 0.0:
        return Whitening(None, np.sqrt(variance))
    decay = np.append(0.0, np.exp(-np.diff(time) / noise.time))
    band = np.zeros((2, time.size))
    band[0] = noise.slow**2 * (1.0 - decay**2) + variance
    band[0, 1:] += decay[1:] ** 2 * variance[:-1]
    band[1, :-1] = -decay[1:] * variance[:-1]
    return Whitening(decay, cholesky_banded(band, lower=True, check_finite=False))


def find_floor(values: np.ndarray) -> float:
    """Choose the least standard deviation of measurements.

    Args:
        values: shape (T, M) [m].

    Returns:
        One micrometre; less for motion of less than 0.1 m [m].
    """
    return min(FLOOR, max(_FLOOR_PART * float(np.nanmax(np.nanmax(values, axis=0) - np.nanmin(values, axis=0))), 1e-12))


def guess_noise(values: np.ndarray, pixel: float, floor: float) -> tuple[Noise, np.ndarray]:
    """Estimate the noise of a channel from how its values differ from their neighbours, before anything is fitted.

    Returns:
        White noise, and the variance by which rows that stand out count less, shape (T,) [m^2].
    """
    second = np.diff(values, 2)
    size = max(_MAD * float(np.median(np.abs(second))) / np.sqrt(6.0) if second.size else 0.0, floor)
    noise = Noise(max(size, pixel / np.sqrt(12.0)))
    apart = np.abs(_from_neighbours(values))
    return noise, np.where(apart > _GROSS * noise.white, _REFUSED * apart**2, 0.0)


def _from_neighbours(values: np.ndarray) -> np.ndarray:
    """Subtract the median of each value and its two neighbours on each side, shape (T,)."""
    from scipy.ndimage import median_filter

    return np.asarray(values - median_filter(values, 5, mode="mirror"))


def find_spikes(residuals: np.ndarray, floor: float) -> np.ndarray:
    """Find single residuals that stand out from their neighbours.

    Returns:
        Bool, shape (T,).
    """
    apart = np.abs(_from_neighbours(residuals))
    return np.asarray(apart > _GROSS * max(_MAD * float(np.median(apart)), float(np.mean(apart)), floor))


def find_pixel(values: np.ndarray) -> float:
    """Find the step whose multiples the values are.

    Returns:
        The step; 0 if there is none, or if it may be one by chance, where few values are equal [m].
    """
    known = np.unique(values)
    gaps = np.diff(known)
    rounding = 1e-9 * float(np.abs(known).max(initial=0.0))
    gaps = gaps[gaps > rounding]
    if gaps.size == 0 or (gaps.size > values.size / 2 and gaps.size < _NO_CHANCE):
        return 0.0
    pixel = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    steps = (known - known[0]) / pixel
    return pixel if np.abs(steps - np.rint(steps)).max() < 0.01 else 0.0


def estimate_noise(time: np.ndarray, residuals: np.ndarray, pixel: float, floor: float) -> tuple[Noise, np.ndarray]:
    """Estimate the noise of a channel by maximum likelihood, and by how much outliers count less.

    Returns:
        The noise, and the variance added to each row, shape (T,) [m^2].
    """
    floor = max(floor, pixel / np.sqrt(12.0))
    size = max(_MAD * float(np.median(np.abs(residuals))), floor)
    rms = float(np.sqrt(np.mean(np.clip(residuals, -HUBER * size, HUBER * size) ** 2)))
    if rms**2 - pixel**2 / 12.0 < (_DITHERED * pixel) ** 2:
        return Noise(max(rms, floor), pixel=pixel), _less(np.abs(residuals), max(size, pixel / 2.0))
    extra = _less(np.abs(residuals), size)
    noise = Noise(size)
    for _ in range(2):
        rows = _choose_rows(time.size)
        noise = _maximise_likelihood(time[rows], residuals[rows], extra[rows], floor)
        whitening = build_whitening(noise, time, extra)
        spread = whitening.factor if whitening.decay is None else whitening.factor[0]
        surprise = np.abs(whitening.apply(residuals[None])[0]) * spread
        extra = _less(surprise, np.sqrt(spread**2 - extra))
    return noise, extra


def _less(apart: np.ndarray, deviation: np.ndarray | float) -> np.ndarray:
    """Compute the variances that give residuals the weights of P. J. Huber's estimator, shape (T,)."""
    ratio = apart / (HUBER * deviation)
    gross = apart > _GROSS * deviation
    return np.asarray(np.where(ratio > 1.0, (ratio - 1.0) * np.where(gross, _REFUSED, 1.0), 0.0) * deviation**2)


def _choose_rows(count: int) -> np.ndarray:
    """Choose evenly spaced blocks of rows of a long record."""
    if count <= _MOST_ROWS:
        return np.arange(count)
    width = _MOST_ROWS // _BLOCKS
    return np.concatenate([int(first) + np.arange(width) for first in np.linspace(0, count - width, _BLOCKS)])


def _maximise_likelihood(time: np.ndarray, residuals: np.ndarray, extra: np.ndarray, floor: float) -> Noise:
    """Find the noise of greatest likelihood, white unless a slow part explains more."""
    from scipy.optimize import minimize

    step, duration = float(np.median(np.diff(time))), float(time[-1] - time[0])
    rms = max(float(np.sqrt(np.mean(residuals[extra == 0.0] ** 2))), floor)
    if rms <= floor:
        return Noise(floor)

    def noise_at(unknowns: Any, size: float = 1.0) -> Noise:
        share = 1.0 / (1.0 + float(np.exp(-np.clip(unknowns[0], -12.0, 12.0))))
        memory = float(np.exp(np.clip(unknowns[1], np.log(0.3 * step), np.log(max(duration, step)))))
        return Noise(size * float(np.sqrt(1.0 - share)), size * float(np.sqrt(share)), memory)

    def examine(noise: Noise) -> tuple[float, float]:
        """Compute the loss, and the size at which it is least."""
        whitening = build_whitening(noise, time, extra / rms**2)
        size = float(np.sqrt(np.mean(whitening.apply(residuals[None]) ** 2)))
        return time.size * float(np.log(size)) + 0.5 * whitening.log_determinant, size

    memories = (3.0 * step, 15.0 * step, 0.05 * duration, 0.3 * duration)
    starts = [(share, np.log(memory)) for memory in memories for share in (0.0, 2.0)]
    first = min(starts, key=lambda start: examine(noise_at(start))[0])
    found: Any = minimize(
        lambda u: examine(noise_at(u))[0], first, method="Nelder-Mead", options={"xatol": 0.05, "fatol": 0.05}
    )
    white, size = examine(Noise(1.0))
    if found.fun > white - _WORTH:
        return Noise(max(size, floor))
    noise = noise_at(found.x, examine(noise_at(found.x))[1])
    return noise._replace(white=max(noise.white, floor))


def find_noise_at_rest(residuals: np.ndarray, rest: np.ndarray) -> float | None:
    """Estimate noise from how residuals differ within the rests of a contact, whatever the model makes of its slides.

    Args:
        rest: whether the contact rests and its value counts, bool, shape (T,).

    Returns:
        The standard deviation; None if too few rows rest [m].
    """
    inner = rest.copy()
    for k in range(1, _EDGE + 1):
        inner[k:] &= rest[:-k]
        inner[:-k] &= rest[k:]
    moved = np.append(0, np.cumsum(~inner))
    part = np.arange(residuals.size) * _PERIODS // residuals.size
    found = []
    for lag in (k for k in _LAGS if k < residuals.size):
        within = moved[lag + 1 :] == moved[: -lag - 1]
        square = (residuals[lag:] - residuals[:-lag]) ** 2
        sizes = [
            float(square[mine].mean())
            for mine in (within & (part[:-lag] == p) for p in range(_PERIODS))
            if mine.sum() >= _FEWEST_PAIRS
        ]
        if len(sizes) >= 3:
            found.append(0.5 * float(np.median(sizes)))
    return float(np.sqrt(max(found))) if found else None


def find_noise_of_cycles(time: np.ndarray, residuals: np.ndarray, period: float) -> float | None:
    """Estimate noise from how residuals differ from one cycle of the commands to the next.

    Args:
        period: of the commands [s].

    Returns:
        The standard deviation; None if there are fewer than four cycles [m].
    """
    later = np.searchsorted(time, time + (1.0 - 1e-9) * period)
    inside = later < time.size
    near = np.abs(time[later[inside]] - time[inside] - period) < 0.02 * period
    change = (residuals[later[inside]] - residuals[inside])[near]
    cycle = ((time[inside][near] - time[0]) / period).astype(int)
    # a wrong gain changes residuals by the same in every cycle, which is no noise
    sizes = [float(change[cycle == c].var(ddof=1)) for c in np.unique(cycle) if (cycle == c).sum() >= _FEWEST_PAIRS]
    return float(np.sqrt(0.5 * np.median(sizes))) if len(sizes) >= 3 else None


def find_rounding(noise: Noise, phase: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Compute the covariance of a gradient where the error is the rounding of pixels, a sawtooth of the position.

    Args:
        noise: its white part is the rms of the residuals.
        phase: position in pixels, shape (T,) [1].
        jacobian: of the whitened residuals, shape (T, U).

    Returns:
        Shape (U, U).
    """
    pixel = noise.pixel
    blur = max(noise.white**2 - pixel**2 / 12.0, 0.0)
    k = np.arange(1, _HARMONICS + 1)
    share = pixel**2 / (2.0 * np.pi**2 * k**2) * np.exp(-4.0 * np.pi**2 * k**2 * blur / pixel**2)
    # what is left of the rounding beyond these harmonics has no memory
    result = max(1.0 - float(share.sum()) / noise.white**2, 0.0) * (jacobian.T @ jacobian)
    for order, part in zip(k, share / noise.white**2, strict=True):
        angle = 2.0 * np.pi * order * phase
        waves = np.stack((np.cos(angle), np.sin(angle))) @ jacobian
        result += part * (waves.T @ waves)
    return np.asarray(result)


def find_quantile(freedom: float) -> float:
    """Compute the half width of a 95 % interval in standard deviations, if their size is an estimate.

    Args:
        freedom: degrees of freedom of the estimate; infinite if the size is known [1].

    Returns:
        The quantile of Student's t [1].
    """
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.975))
