"""Whether the robot depends on the rate: the same drive at two speeds, in one recording or in several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..fit.misfit import Misfit, find_period
from ..fit.problem import Problem, Residuals
from ..measurements import Measurements, interpolate_rows

_APART = 2.0
"""Ratio of the durations of a cycle from which on there are two speeds."""
_BINS = (6, 16)
"""Fewest and most parts of a cycle."""
_SAME = 0.05
"""Part of the range of a command by which two cycles of the same drive may differ."""
_FEWEST = 3
"""Cycles of a recording from which on the first one, which depends on the start, does not count."""
_LEAST = 0.5
"""Difference in units of the noise, and of the residuals, below which there is none: a misfit is not quite the same at
two speeds, because recordings begin and end elsewhere."""
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
        residual: root mean square of the residuals in a mean cycle, at the speed at which they are larger [m].
        chance: probability that mere noise shows as large a difference [1].
    """

    channel: str
    difference: float
    noise: float
    residual: float
    chance: float

    @property
    def ratio(self) -> float:
        """The difference in units of the noise [1]."""
        return self.difference / self.noise

    @property
    def counts(self) -> bool:
        """Whether it is larger than half of the noise and half of the residuals."""
        return self.difference > _LEAST * max(self.noise, self.residual)


@dataclass(frozen=True)
class RateEffect:
    """What recordings of one drive at two speeds tell about the dependence on the rate.

    Attributes:
        depends: whether a channel differs by more than chance, half of its noise and half of its residuals.
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
    cycles: list[_Cycle] = []
    for i in fitted:
        cycles += _cut(i, recordings[i], cycles[0].commands if cycles else None)
    slow, fast = _find_speeds(cycles)
    if not fast:
        return None
    channels = [recordings[c.recording].channels for c in (*slow, *fast)]
    paths = {i: _follow_path(recordings[i]) for i in {c.recording for c in (*slow, *fast)}}
    names = [name for name in channels[0] if all(name in one for one in channels)]
    rows = min(float(np.median(np.diff(recordings[c.recording].time))) for c in fast)
    bins = int(np.clip(min(c.duration for c in fast) / rows / 2.0, *_BINS))
    changes = []
    for name in names:
        known = [one for one in misfits if one.channel == name]
        errors = {i: residuals.all[i][:, recordings[i].channels.index(name)] for i in paths}
        tables = [_tabulate(paths, errors, group, bins) for group in (slow, fast)]
        pixel = max(problem.pixels[i][recordings[i].channels.index(name)] for i in paths)
        if known and all(tables):
            changes.append(_compare(name, known, pixel, *(np.array(table) for table in tables)))
    if not changes:
        return None
    chance = _CHANCE / len(changes)
    return RateEffect(
        any(one.chance < chance and one.counts for one in changes),
        (float(np.median([c.duration for c in slow])), float(np.median([c.duration for c in fast]))),
        (len(slow), len(fast)),
        tuple(changes),
    )


def _measure_path(measured: Measurements) -> np.ndarray:
    """Measure how far the commands have gone, in ranges of each, shape (K,) [1]."""
    span = np.ptp(measured.commands, axis=0)
    steps = np.diff(measured.commands, axis=0)[:, span > 0.0] / span[span > 0.0]
    return np.concatenate(([0.0], np.cumsum(np.linalg.norm(steps, axis=1))))


def _find_length(path: np.ndarray, commands: np.ndarray) -> float:
    """Find the shortest part of the path after which the commands repeat; all of it if they do not [1]."""
    rough = find_period(path, commands)
    if rough is None:
        return float(path[-1])
    span = np.ptp(commands, axis=0)
    even = np.linspace(0.0, path[-1], 512)

    def differ(length: float) -> float:
        places = even[even <= path[-1] - length]
        apart = np.abs(interpolate_rows(places + length, path, commands) - interpolate_rows(places, path, commands))
        return float((apart / np.where(span > 0.0, span, 1.0)).max(initial=0.0))

    for near in (rough / parts for parts in (4, 3, 2, 1)):
        tried = [*(near * np.linspace(0.95, 1.05, 101)), *path[np.abs(path / near - 1.0) < 0.05]]
        best = min(tried, key=differ)
        best = min([best, *(best + near * np.linspace(-1e-3, 1e-3, 21))], key=differ)
        if differ(best) <= _SAME:
            return float(best)
    return float(path[-1])


def _cut(recording: int, measured: Measurements, like: np.ndarray | None) -> list[_Cycle]:
    """Cut the path of the commands into cycles, which begin where the commands of another cycle do, if there is one."""
    if not measured.command_names or not np.ptp(measured.commands, axis=0).any():
        return []
    path = _measure_path(measured)
    last = np.append(np.diff(path) > 0.0, True)  # commands that are held belong to the cycle before
    path, commands, time = path[last], measured.commands[last], measured.command_time[last]
    length, begin, places = _find_length(path, commands), 0.0, np.linspace(0.0, 1.0, 33)
    if like is not None and like.shape[1] == commands.shape[1]:
        begins = np.concatenate((length * np.arange(64) / 64.0, path))
        begins = begins[(begins < length) & (begins + length <= path[-1] * (1.0 + 1e-9))]
        apart = [np.abs(interpolate_rows(one + length * places, path, commands) - like).max() for one in begins]
        begin = float(begins[int(np.argmin(apart))])
    found = []
    for k in range(int((path[-1] - begin) / length + 0.05)):
        along = begin + length * (k + places)
        duration = float(np.diff(np.interp(along[[0, -1]], path, time))[0])
        found.append(_Cycle(recording, duration, interpolate_rows(along, path, commands), float(along[0]), length))
    return found[1:] if len(found) >= _FEWEST else found


def _find_speeds(cycles: Sequence[_Cycle]) -> tuple[list[_Cycle], list[_Cycle]]:
    """Find the drive with the most different speeds, and its slow and fast cycles; none if there is one speed only."""
    best: tuple[list[_Cycle], list[_Cycle]] = [], []
    most, all_durations = _APART, [cycle.duration for cycle in cycles]
    if max(all_durations, default=0.0) < most * min(all_durations, default=0.0):
        return best
    for cycle in cycles:
        spans = _SAME * np.ptp(cycle.commands, axis=0)
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


def _follow_path(measured: Measurements) -> np.ndarray:
    """Find how far the commands have gone at each row of a recording, -1 before and after them, shape (T,) [1]."""
    return np.interp(measured.time, measured.command_time, _measure_path(measured), left=-1.0, right=-1.0)


def _tabulate(
    paths: Mapping[int, np.ndarray], errors: Mapping[int, np.ndarray], cycles: Sequence[_Cycle], bins: int
) -> list[np.ndarray]:
    """Average the residuals in equal parts of each cycle without gaps, less their mean, shape (bins,) each [m]."""
    found = []
    for cycle in cycles:
        error, path = errors[cycle.recording], paths[cycle.recording]
        place = np.floor((path - cycle.begin) / cycle.length * bins + 1e-6)  # a corner is the begin of its part
        counted = np.isfinite(error) & (path >= 0.0) & (place >= 0) & (place < bins)
        index = place[counted].astype(int)
        count = np.bincount(index, minlength=bins)
        if count.all():
            mean = np.bincount(index, error[counted], minlength=bins) / count
            found.append(mean - mean.mean())
    return found


def _compare(channel: str, known: Sequence[Misfit], pixel: float, slow: np.ndarray, fast: np.ndarray) -> Change:
    """Compare the mean cycles of two groups with how cycles of one group differ, shapes (cycles, bins) [m]."""
    from scipy.special import fdtrc

    noise = float(np.sqrt(np.mean([one.noise**2 for one in known])))
    bins, repeats = slow.shape[1], len(slow) + len(fast) - 2
    spread = sum(float(((group - group.mean(axis=0)) ** 2).sum()) for group in (slow, fast))
    # without repeated cycles nothing tells how much of the noise the means of bins contain: all of it, at most
    variance = spread / (repeats * (bins - 1)) if repeats >= 2 else noise**2
    expected = max(variance, (1e-3 * noise) ** 2) * (1.0 / len(slow) + 1.0 / len(fast))
    expected += pixel**2 / 6.0  # rounding repeats in every cycle
    square = float(np.sum((fast.mean(axis=0) - slow.mean(axis=0)) ** 2)) / (bins - 1)
    freedom = repeats if repeats >= 2 else 1e6
    chance = float(fdtrc((bins - 1) / _CORRELATED, freedom * (bins - 1) / _CORRELATED, square / expected))
    residual = max(float(np.sqrt(np.mean(group.mean(axis=0) ** 2))) for group in (slow, fast))
    return Change(channel, float(np.sqrt(max(square - expected, 0.0))), noise, residual, chance)
