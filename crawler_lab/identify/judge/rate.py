"""Whether the robot depends on the rate: the same drive at two speeds, in one recording or in several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..fit.misfit import Misfit, find_period
from ..fit.problem import Problem, Residuals
from ..measurements import Measurements

_APART = 2.0
"""Ratio of the durations of a cycle from which on there are two speeds."""
_BINS = (6, 16)
"""Fewest and most parts of a cycle."""
_SAME = 0.05
"""Part of the range of a command by which two cycles of the same drive may differ."""
_FEWEST = 3
"""Cycles of a recording from which on the first one, which depends on the start, does not count."""
_LEAST = 0.5
"""Difference in units of the noise below which there is none."""
_CHANCE = 0.01
_CORRELATED = 4.0
"""Neighbouring parts of a cycle that noise with a memory makes alike."""


@dataclass(frozen=True)
class Change:
    """What the speed changes in one channel.

    Attributes:
        channel: its name.
        difference: root mean square, over the drive, of the change from slow to fast cycles, without what noise
            contributes to it [m].
        noise: standard deviation of a measured value [m].
        chance: probability that mere noise shows as large a difference [1].
    """

    channel: str
    difference: float
    noise: float
    chance: float

    @property
    def ratio(self) -> float:
        """The difference in units of the noise [1]."""
        return self.difference / self.noise


@dataclass(frozen=True)
class RateEffect:
    """What recordings of one drive at two speeds tell about the dependence on the rate.

    Attributes:
        depends: whether a channel differs by more than noise and by more than half of its size.
        durations: of a slow and of a fast cycle [s].
        cycles: number of slow and of fast ones.
        changes: of each channel.
    """

    depends: bool
    durations: tuple[float, float]
    cycles: tuple[int, int]
    changes: tuple[Change, ...]

    def describe(self) -> str:
        """Describe the verdict.

        Returns:
            One line.
        """
        worst = max(self.changes, key=lambda one: one.ratio)
        slow, fast = self.durations
        change = f"{worst.difference:.2g} m at the same place of the drive, {worst.ratio:.2g} times the noise"
        return (
            f"rate: {'depends on the rate' if self.depends else 'rate independent within the noise'}: from cycles of "
            f"{slow:.3g} s to cycles of {fast:.3g} s {worst.channel} changes by {change}"
            + ("; the model has no speed, so fit each speed by itself" if self.depends else "")
        )

    def as_plain(self) -> dict[str, Any]:
        """Convert to the entry `rate` of `crawler identify --json`.

        Returns:
            Plain numbers, lists and text.
        """
        return {
            "verdict": "depends on the rate" if self.depends else "rate independent",
            "durations": list(self.durations),
            "cycles": list(self.cycles),
            "channels": [asdict(one) | {"ratio": one.ratio} for one in self.changes],
        }


@dataclass(frozen=True, eq=False)
class _Cycle:
    """A passage of a drive: its recording, its duration [s], its commands in equal steps, and its part of the path."""

    recording: int
    duration: float
    commands: np.ndarray
    begin: float
    length: float


def judge_rate(problem: Problem, residuals: Residuals, misfits: Sequence[Misfit]) -> RateEffect | None:
    """Compare the residuals of slow and of fast passages of the same drive.

    Time is scaled by measuring how far the commands have gone along their path. The model is the same at every speed,
    so the difference of its residuals is that of the robot, whatever the model misses at every speed; what the sensor
    does, its lag included, is not in them.

    Args:
        residuals: the residuals.
        misfits: of the channels, with their noise.

    Returns:
        The verdict; None if no drive was passed at two speeds, one at least twice the other.
    """
    recordings = [replica.measured for replica in problem.replicas]
    # the lag of a recording without a fitted row is not known
    fitted = [i for i, rows in enumerate(problem.rows) if rows.any()]
    slow, fast = _find_speeds([cycle for i in fitted for cycle in _cut(i, recordings[i])])
    if not fast:
        return None
    channels = [recordings[c.recording].channels for c in (*slow, *fast)]
    names = [name for name in channels[0] if all(name in one for one in channels)]
    rows = min(float(np.median(np.diff(recordings[c.recording].time))) for c in fast)
    bins = int(np.clip(min(c.duration for c in fast) / rows / 2.0, *_BINS))
    changes = []
    for name in names:
        known = [one for one in misfits if one.channel == name]
        tables = [_tabulate(recordings, residuals, group, name, bins) for group in (slow, fast)]
        if known and all(tables):
            changes.append(_compare(name, known, *(np.array(table) for table in tables)))
    if not changes:
        return None
    chance = _CHANCE / len(changes)
    return RateEffect(
        any(one.chance < chance and one.ratio > _LEAST for one in changes),
        (float(np.median([c.duration for c in slow])), float(np.median([c.duration for c in fast]))),
        (len(slow), len(fast)),
        tuple(changes),
    )


def _measure_path(measured: Measurements) -> np.ndarray:
    """Measure how far the commands have gone, in ranges of each, shape (K,) [1]."""
    span = np.ptp(measured.commands, axis=0)
    steps = np.diff(measured.commands, axis=0)[:, span > 0.0] / span[span > 0.0]
    return np.concatenate(([0.0], np.cumsum(np.linalg.norm(steps, axis=1))))


def _cut(recording: int, measured: Measurements) -> list[_Cycle]:
    """Cut the path of the commands into cycles; commands that do not repeat are one."""
    if not measured.command_names or not np.ptp(measured.commands, axis=0).any():
        return []
    path = _measure_path(measured)
    last = np.append(np.diff(path) > 0.0, True)  # commands that are held belong to the cycle before
    path, commands, time = path[last], measured.commands[last], measured.command_time[last]
    length = find_period(path, commands) or float(path[-1])
    found = []
    for k in range(round(path[-1] / length - 0.45)):
        places = length * (k + np.linspace(0.0, 1.0, 33))
        sampled = np.array([np.interp(places, path, column) for column in commands.T])
        duration = float(np.diff(np.interp(places[[0, -1]], path, time))[0])
        found.append(_Cycle(recording, duration, sampled, k * length, length))
    return found[1:] if len(found) >= _FEWEST else found


def _find_speeds(cycles: Sequence[_Cycle]) -> tuple[list[_Cycle], list[_Cycle]]:
    """Find the drive with the most different speeds, and its slow and fast cycles; none if there is one speed only."""
    best: tuple[list[_Cycle], list[_Cycle]] = [], []
    most, all_durations = _APART, [cycle.duration for cycle in cycles]
    if max(all_durations, default=0.0) < most * min(all_durations, default=0.0):
        return best
    for cycle in cycles:
        spans = _SAME * np.ptp(cycle.commands, axis=1, keepdims=True)
        alike = [
            one
            for one in cycles
            if one.commands.shape == cycle.commands.shape and (np.abs(one.commands - cycle.commands) <= spans).all()
        ]
        durations = np.array([one.duration for one in alike])
        if durations.max() >= most * durations.min():
            most = durations.max() / durations.min() * (1.0 + 1e-9)
            between = np.sqrt(durations.min() * durations.max())
            best = [c for c in alike if c.duration > between], [c for c in alike if c.duration <= between]
    return best


def _tabulate(
    recordings: Sequence[Measurements], residuals: Residuals, cycles: Sequence[_Cycle], channel: str, bins: int
) -> list[np.ndarray]:
    """Average the residuals in equal parts of each cycle without gaps, less their mean, shape (bins,) each [m]."""
    found = []
    for cycle in cycles:
        measured = recordings[cycle.recording]
        error = residuals.all[cycle.recording][:, measured.channels.index(channel)]
        path = np.interp(measured.time, measured.command_time, _measure_path(measured), left=-1.0, right=-1.0)
        place = np.floor((path - cycle.begin) / cycle.length * bins)
        counted = np.isfinite(error) & (path >= 0.0) & (place >= 0) & (place < bins)
        index = place[counted].astype(int)
        count = np.bincount(index, minlength=bins)
        if count.all():
            mean = np.bincount(index, error[counted], minlength=bins) / count
            found.append(mean - mean.mean())
    return found


def _compare(channel: str, known: Sequence[Misfit], slow: np.ndarray, fast: np.ndarray) -> Change:
    """Compare the mean cycles of two groups with how cycles of one group differ, shapes (cycles, bins) [m]."""
    from scipy.special import fdtrc

    noise = float(np.sqrt(np.mean([one.noise**2 for one in known])))
    bins, repeats = slow.shape[1], len(slow) + len(fast) - 2
    spread = sum(float(((group - group.mean(axis=0)) ** 2).sum()) for group in (slow, fast))
    # without repeated cycles nothing tells how much of the noise the means of bins contain: all of it, at most
    variance = spread / (repeats * (bins - 1)) if repeats >= 2 else noise**2
    expected = max(variance, (1e-3 * noise) ** 2) * (1.0 / len(slow) + 1.0 / len(fast))
    square = float(np.sum((fast.mean(axis=0) - slow.mean(axis=0)) ** 2)) / (bins - 1)
    freedom = repeats if repeats >= 2 else 1e6
    chance = float(fdtrc((bins - 1) / _CORRELATED, freedom * (bins - 1) / _CORRELATED, square / expected))
    return Change(channel, float(np.sqrt(max(square - expected, 0.0))), noise, chance)
