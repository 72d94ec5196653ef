"""Misfit as a size: residuals in units of the noise that the rests show, and where and when they are largest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..measurements import interpolate_rows
from ..sensor.noise import find_noise_at_rest, find_noise_of_cycles, find_spikes, guess_noise
from .problem import Problem, Residuals

FITS = 1.3
"""Residuals of at most this many times the noise are called noise."""
_REPEATED = 1.2
"""Noise at rest of at most this many times the noise of the cycles is noise."""
_SLOWEST = 10.0
"""The same for the noise of neighbouring values, which slow noise changes little."""
_PHASES = 8
_PARTS = 24
_PERIODIC = 0.9
"""Correlation of commands with themselves a period later."""
_FEWEST = 8
"""Rows of a channel, or of a phase, from which a size is computed."""


@dataclass(frozen=True)
class Misfit:
    """How far the model is from what one channel shows.

    Attributes:
        recording: name of the recording.
        channel: name of the channel.
        residual: root mean square without outliers [m].
        noise: standard deviation, from the rests of the contact and from the differences between cycles [m].
        motion: range of the measured values [m].
        phases: root mean square in each eighth of the period of the commands, or of the recording, shape (8,) [m].
        worst: number of the phase in which it is largest relative to its noise.
        since: time from which residuals are beyond noise, on the clock of the commands; None if they never are [s].
    """

    recording: str
    channel: str
    residual: float
    noise: float
    motion: float
    phases: tuple[float, ...]
    worst: int
    since: float | None

    @property
    def ratio(self) -> float:
        """The residual in units of the noise [1]."""
        return self.residual / self.noise

    def as_plain(self) -> dict[str, object]:
        """Convert to the values that `crawler identify --json` prints.

        Returns:
            Plain numbers, lists and text.
        """
        return {
            "recording": self.recording,
            "channel": self.channel,
            "residual": self.residual,
            "noise": self.noise,
            "ratio": self.ratio,
            "part_of_motion": self.residual / self.motion if self.motion else None,
            "phases": list(self.phases),
            "worst_phase": self.worst,
            "since": self.since,
        }


def measure_misfit(problem: Problem, residuals: Residuals) -> list[Misfit]:
    """Measure the misfit of every channel with enough fitted rows.

    Args:
        residuals: the residuals.

    Returns:
        One for each channel of each recording.
    """
    found = []
    for i, replica in enumerate(problem.replicas):
        measured = replica.measured
        period = find_period(measured.command_time, measured.commands)
        for m, channel in enumerate(measured.channels):
            rows, noise = problem.channels[i][m].rows, problem.channels[i][m].noise
            if rows.size < _FEWEST:
                continue
            time, error, values = measured.time[rows], residuals.all[i][rows, m], measured.values[rows, m]
            outlier = find_spikes(error, problem.floor)
            kept = error[~outlier]
            rest = find_noise_at_rest(error, residuals.resting[i][rows, m] & ~outlier)
            cycles = find_noise_of_cycles(time[~outlier], kept, period) if period else None
            if rest is not None:
                # where the model rests and the contact slides, errors repeat in every cycle, which noise does not, and
                # are far larger than what neighbouring values show
                near = guess_noise(values, problem.pixels[i][m], problem.floor)[0].white
                rest = min(rest, _SLOWEST * near if cycles is None else _REPEATED * cycles)
            shown = [one for one in (rest, cycles) if one is not None]
            # no misfit is white: what is white in the residuals is noise
            size = max(*shown, noise.white, problem.pixels[i][m] / np.sqrt(12.0), problem.floor)
            phases = _measure_phases(time[~outlier], kept, period)
            rms = float(np.sqrt(np.mean(kept**2)))
            found.append(
                Misfit(
                    measured.name,
                    channel,
                    rms,
                    size,
                    float(np.ptp(values)),
                    tuple(phases.tolist()),
                    int(phases.argmax()),
                    _find_onset(time[~outlier], kept, size) if rms > FITS * size else None,
                )
            )
    return found


def find_where(misfits: Sequence[Misfit]) -> str | None:
    """Describe where the misfit is largest.

    Args:
        misfits: of all channels.

    Returns:
        One line; None if no residual is beyond noise.
    """
    worst = max(misfits, key=lambda one: one.ratio, default=None)
    if worst is None or worst.ratio <= FITS:
        return None
    since = "" if worst.since is None else f", from {worst.since:.4g} s on"
    part = f", {100.0 * worst.residual / worst.motion:.2g} % of its motion" if worst.motion > 0.0 else ""
    return (
        f"{worst.recording}: {worst.channel}{since}: residuals of {worst.residual:.3g} m{part}, "
        f"{worst.ratio:.3g} times the noise of {worst.noise:.2g} m"
    )


def find_period(time: np.ndarray, commands: np.ndarray) -> float | None:
    """Find the period of commands.

    Args:
        time: shape (K,) [s].
        commands: shape (K, C).

    Returns:
        The least time after which they repeat, at least twice; None if they do not [s].
    """
    if time.size < 8 or commands.shape[1] == 0 or not np.ptp(commands, axis=0).any():
        return None
    even = np.linspace(time[0], time[-1], min(4 * time.size, 4096))
    columns = interpolate_rows(even, time, commands)
    columns = columns - columns.mean(axis=0)
    spectrum = np.fft.rfft(columns, 2 * even.size, axis=0)
    power = np.fft.irfft(np.abs(spectrum) ** 2, axis=0).sum(axis=1)[: even.size]
    overlap = 1.0 - np.arange(even.size) / even.size
    half = even.size // 2
    correlation = power[:half] / (power[0] * overlap[:half])
    below = np.flatnonzero(correlation < 0.5)
    if below.size == 0 or below[0] + 1 >= half:
        return None
    after = correlation[below[0] :]
    if after.max() < _PERIODIC:
        return None
    first = below[0] + int(np.flatnonzero(after > after.max() - 0.02)[0])
    lag = _find_peak(correlation, first, max(3, first // 20))
    # the peak at the longest multiple divides the error of the grid
    for multiple in (2**k for k in range(1, int(np.log2(max(half / lag, 1.0))) + 1)):
        if multiple * lag < half - 2:
            lag = _find_peak(correlation, round(multiple * lag), max(2, int(0.2 * lag))) / multiple
    return float(lag * (even[1] - even[0]))


def _find_peak(values: np.ndarray, near: int, width: int) -> float:
    """Find a maximum near an index, between indices by a parabola."""
    first = max(near - width, 1)
    k = first + int(np.argmax(values[first : near + width + 1]))
    if k + 1 >= values.size:
        return float(k)
    bend = values[k - 1] - 2.0 * values[k] + values[k + 1]
    return float(k) if bend >= 0.0 else k + 0.5 * float((values[k - 1] - values[k + 1]) / bend)


def _measure_phases(time: np.ndarray, residuals: np.ndarray, period: float | None) -> np.ndarray:
    """Compute the rms of residuals in each eighth of the period, or of the recording, shape (8,)."""
    duration = period or (float(time[-1] - time[0]) or 1.0) * (1.0 + 1e-12)
    place = (((time - (0.0 if period else time[0])) % duration) / duration * _PHASES).astype(int).clip(0, _PHASES - 1)
    count = np.bincount(place, minlength=_PHASES)
    square = np.bincount(place, residuals**2, minlength=_PHASES)
    return np.sqrt(np.where(count >= _FEWEST, square / np.maximum(count, 1), 0.0))


def _find_onset(time: np.ndarray, residuals: np.ndarray, noise: float) -> float | None:
    """Find from when on residuals are beyond noise, whatever offset the fit has chosen for all of them."""
    part = np.arange(time.size) * _PARTS // time.size
    count = np.bincount(part, minlength=_PARTS)
    centred = residuals - np.median(residuals[part < _PARTS // 4])
    rms = np.sqrt(np.bincount(part, centred**2, minlength=_PARTS) / np.maximum(count, 1))
    beyond = np.flatnonzero(rms > max(2.0 * FITS * noise, 0.25 * float(rms.max())))
    return float(time[np.searchsorted(part, beyond[0])]) if beyond.size else None
