"""Whether residuals are noise: two tests for each channel, and the place where they are not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_LEVEL = 1e-3
"""Probability with which residuals that are noise are taken for a model that does not fit."""
_LAGS = 10
_WINDOW = 0.05


@dataclass(frozen=True)
class NoiseTest:
    """The result for all channels.

    Attributes:
        is_noise: whether no test found a pattern.
        p_value: least probability of any test under noise, times the number of tests [1].
        where: the recording, channel and time at which a pattern is largest; None if there is none.
    """

    is_noise: bool
    p_value: float
    where: str | None


def ljung_box(residuals: np.ndarray) -> float:
    """Test residuals for autocorrelation.

    Args:
        residuals: in order, shape (T,).

    Returns:
        The probability of such a correlation in noise [1].

    Source: G. M. Ljung, G. E. P. Box, Biometrika 65 (1978) 297.
    """
    from scipy.stats import chi2

    n = residuals.size
    lags = min(_LAGS, n // 5)
    centred = residuals - residuals.mean()
    power = float(centred @ centred)
    if lags == 0 or power == 0.0:
        return 1.0
    rho = np.array([centred[k:] @ centred[:-k] for k in range(1, lags + 1)]) / power
    statistic = n * (n + 2) * float((rho**2 / (n - np.arange(1, lags + 1))).sum())
    return float(chi2.sf(statistic, lags))


def runs_test(residuals: np.ndarray) -> float:
    """Test whether the signs of residuals change as often as those of noise.

    Args:
        residuals: in order, shape (T,).

    Returns:
        The probability of such a number of runs in noise, by its normal approximation [1].

    Source: A. Wald, J. Wolfowitz, Ann. Math. Statist. 11 (1940) 147.
    """
    from scipy.stats import norm

    signs = residuals[residuals != 0.0] > 0.0
    above, below = int(signs.sum()), int((~signs).sum())
    total = above + below
    if above < 5 or below < 5:
        return 1.0 if total < 20 else float(min(1.0, 2.0 ** (5.0 - total / 2.0)))
    runs = 1 + int((signs[1:] != signs[:-1]).sum())
    mean = 1.0 + 2.0 * above * below / total
    variance = (mean - 1.0) * (mean - 2.0) / (total - 1.0)
    return float(2.0 * norm.sf(abs(runs - mean) / np.sqrt(variance)))


def examine_residuals(
    names: Sequence[str],
    channels: Sequence[Sequence[str]],
    times: Sequence[np.ndarray],
    residuals: Sequence[np.ndarray],
    measured: Sequence[np.ndarray],
) -> NoiseTest:
    """Test the residuals of all channels of all recordings.

    Residuals below the resolution of the measurements (the smallest difference of two values) or below rounding are
    not tested.

    Args:
        names: names of the recordings.
        channels: their channels.
        times: of the rows, each of shape (T,) [s].
        residuals: each of shape (T, M) [m].
        measured: the measured values, likewise.

    Returns:
        The result.
    """
    worst, place, tests = 1.0, None, 0
    for i, name in enumerate(names):
        for m, channel in enumerate(channels[i]):
            error = residuals[i][:, m]
            rms = float(np.sqrt(np.mean(error**2)))
            if rms <= _resolution(measured[i][:, m]):
                continue
            for p in (ljung_box(error), runs_test(error)):
                tests += 1
                if place is None or p < worst:
                    worst, place = p, (name, channel, times[i], error)
    p_value = min(1.0, worst * max(tests, 1))
    if place is None or p_value >= _LEVEL:
        return NoiseTest(True, p_value, None)
    name, channel, time, error = place
    width = max(1, int(_WINDOW * time.size))
    smooth = np.convolve(error, np.ones(width) / width, mode="same")
    at = int(np.argmax(np.abs(smooth)))
    rms = float(np.sqrt(np.mean(error**2)))
    return NoiseTest(
        False,
        p_value,
        f"{name}: {channel}, largest around {time[at]:.4g} s, where the model is {abs(smooth[at]):.3g} m "
        f"{'ahead' if smooth[at] > 0 else 'behind'} (residuals {rms:.3g} m)",
    )


def _resolution(values: np.ndarray) -> float:
    """Compute the smallest difference of two values, or what rounding makes of them."""
    known = np.unique(values)
    rounding = 1e-10 * max(float(np.abs(values).max(initial=0.0)), float(np.ptp(values)), 1e-3)
    gaps = np.diff(known)
    gaps = gaps[gaps > rounding]
    # of a column of T values with noise the smallest gap is far below it; of rounded ones it is their last digit
    return max(rounding, float(gaps.min())) if gaps.size and gaps.size < values.size / 2 else rounding
