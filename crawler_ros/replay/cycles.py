"""Cycles in the commands of a run.

The crawler is rate-independent: only the path of the commands matters, not pauses or speed. A cycle is a closed part of
that path that recurs: the drive of the recorded scene where it was played, else any repetition.
Commands are compared through two fixed combinations of all their numbers, so that memory does not grow with the body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crawler_model.body.drive import NS, Drive

ROUNDING = 1e-9
"""Commands, shapes and translations that differ by less than this fraction of their size count as equal."""
_INSTANT_NS = 2
_MOST_TRIES = 200
_MOST_STRETCHES = 50


def signature_weights(count: int) -> np.ndarray:
    """Return the fixed weights with which rows of numbers are compared.

    Args:
        count: numbers in a row.

    Returns:
        The weights, shape (count, 2).
    """
    return np.random.default_rng(20260101).uniform(0.5, 1.5, (count, 2)) * [1.0, -1.0]


@dataclass(frozen=True, eq=False)
class CommandPath:
    """The path of the commands in a run, from vertex to vertex.

    Attributes:
        time_ns: when each vertex was reached, shape (V,) [ns]; the first is the start.
        place: the command there, as two combinations of all its numbers, in SI units, shape (V, 2).
    """

    time_ns: np.ndarray
    place: np.ndarray

    @property
    def tolerance(self) -> float:
        """Largest difference that counts as rounding [the unit of `place`]."""
        return ROUNDING * float(np.abs(self.place).max(initial=0.0))

    def moved(self) -> np.ndarray:
        """Return between which vertices the command changed.

        Returns:
            A bool for each pair of consecutive vertices, shape (V - 1,).
        """
        return np.abs(np.diff(self.place, axis=0)).max(axis=1, initial=0.0) > self.tolerance


@dataclass(frozen=True)
class Stretch:
    """Consecutive cycles.

    Attributes:
        bounds: the vertices where they begin and end, one more than there are cycles.
        source: "drive" for periods of the recorded scene's drive, else "recurrence".
    """

    bounds: tuple[int, ...]
    source: str


def find_cycles(path: CommandPath, drive: Drive | None, weights: np.ndarray) -> list[Stretch]:
    """Find the cycles of a run.

    Args:
        path: the path of the commands.
        drive: the drive of the recorded scene, if it has one with a period.
        weights: the weights from which the path's places were computed, shape (C, 2).

    Returns:
        Stretches of cycles in order; none where nothing repeats.
    """
    if path.time_ns.size < 2:
        return []
    played = [] if drive is None or drive.period is None else _find_drive(path, drive, drive.rows @ weights)
    repeated = _find_recurrence(path)
    # a drive played with pauses, or at another speed, recurs on more of the path than it is found in its own time;
    # one that repeats within its period recurs at most on an unfinished period more
    way = np.append(0.0, np.linalg.norm(np.diff(path.place, axis=0), axis=1).cumsum())
    count = max(sum(len(s.bounds) - 1 for s in played), 1)
    return played if _measure(played, way) * (1.0 + 1.0 / count) > _measure(repeated, way) else repeated


def _measure(stretches: list[Stretch], way: np.ndarray) -> float:
    """Measure the way of the commands, shape (V,), within stretches [the unit of `place`]."""
    return float(sum(way[s.bounds[-1]] - way[s.bounds[0]] for s in stretches))


def _find_drive(path: CommandPath, drive: Drive, places: np.ndarray) -> list[Stretch]:
    """Find where a drive was played in its own time."""
    assert drive.period is not None
    time, place, moved = path.time_ns, path.place, path.moved()
    tolerance = max(path.tolerance, ROUNDING * float(np.abs(places).max(initial=0.0)))
    changes = np.flatnonzero(np.abs(np.diff(places, axis=0)).max(axis=1, initial=0.0) > tolerance)
    if changes.size == 0:
        return []
    flat_ns = round(float(drive.times[changes[0]]) * NS)
    times = np.append(drive.times, drive.period) if drive.times[-1] < drive.period else drive.times
    places = np.vstack((places, places[:1])) if drive.times[-1] < drive.period else places
    begins = np.flatnonzero(moved & np.append(True, ~moved[:-1]))
    begins = begins[np.abs(place[begins] - places[0]).max(axis=1) <= tolerance]
    found: list[Stretch] = []
    first = tries = 0
    for begin in begins.tolist():
        if begin < first or tries > _MOST_TRIES:
            continue
        start_ns = int(time[begin]) - flat_ns
        bounds = _follow_drive(path, moved, begin, start_ns, drive.period, times, places, tolerance, most=1)
        if len(bounds) > 1:
            bounds = _follow_drive(path, moved, begin, start_ns, drive.period, times, places, tolerance, most=None)
            found.append(Stretch(tuple(bounds), "drive"))
            first = bounds[-1]
        else:
            tries += 1
    return found


def _follow_drive(
    path: CommandPath,
    moved: np.ndarray,
    begin: int,
    start_ns: int,
    period: float,
    times: np.ndarray,
    places: np.ndarray,
    tolerance: float,
    most: int | None,
) -> list[int]:
    """Follow a drive that leaves its start at a vertex as long as the path agrees.

    Returns:
        The vertex where it starts, before its first pause if there is one, and those where its periods end.
    """
    span = period * NS
    last_ns = int(path.time_ns[-1])
    count = int((last_ns - start_ns + _INSTANT_NS) / span)
    count = count if most is None else min(count, most)
    if count < 1:
        return [begin]
    end = int(np.searchsorted(path.time_ns, start_ns + count * span + _INSTANT_NS, side="right"))
    time = path.time_ns[begin:end]
    phase = np.mod((time - start_ns) / NS, period)
    off = np.zeros(time.size)
    for k in range(2):
        expected = np.interp(phase, times, places[:, k])
        off = np.maximum(off, np.abs(path.place[begin:end, k] - expected))
    # a vertex may be an instant away from a waypoint: the drive's steepest change in that time is tolerated
    steep = float((np.abs(np.diff(places, axis=0)).max(axis=1) / np.diff(times)).max())
    wrong = np.flatnonzero(off > tolerance + steep * _INSTANT_NS / NS)
    good_ns = int(time[wrong[0]]) if wrong.size else last_ns + 1
    begins_ns, ends_ns = (start_ns + np.arange(first, first + count) * span for first in (0, 1))
    vertex = np.searchsorted(path.time_ns, ends_ns + _INSTANT_NS, side="right") - 1
    ends_there = np.abs(path.time_ns[vertex] - ends_ns) <= _INSTANT_NS
    held = (vertex < moved.size) & ~moved[np.minimum(vertex, moved.size - 1)]
    right = _pass_corners(path, moved, begins_ns, times, places, tolerance) & (ends_there | held)
    right &= path.time_ns[vertex] < good_ns
    start = int(np.searchsorted(path.time_ns, start_ns - _INSTANT_NS))
    if start < begin and abs(int(path.time_ns[start]) - start_ns) > _INSTANT_NS:
        start = begin
    return [min(start, begin), *vertex[: np.append(right, False).argmin()].tolist()]


def _pass_corners(
    path: CommandPath, moved: np.ndarray, begins_ns: np.ndarray, times: np.ndarray, places: np.ndarray, tolerance: float
) -> np.ndarray:
    """Determine whether every waypoint at which the drive turns is a vertex of the path, for each period, (K,)."""
    slope = np.diff(places, axis=0) / np.diff(times)[:, None]
    turns = np.flatnonzero(np.abs(np.diff(slope, axis=0)).max(axis=1, initial=0.0) > tolerance) + 1
    at = begins_ns[:, None] + times[turns] * NS
    near = np.clip(np.searchsorted(path.time_ns, at), 1, path.time_ns.size - 1)
    apart = np.minimum(np.abs(path.time_ns[near] - at), np.abs(path.time_ns[near - 1] - at))
    return np.asarray(((apart <= _INSTANT_NS) | ~moved[near - 1]).all(axis=1))


def _find_recurrence(path: CommandPath) -> list[Stretch]:
    """Find the repetitions in a path at any speed."""
    corners = _corners(path)
    marks = _marks(path.place[corners], path.tolerance)
    moved = path.moved()
    found: list[Stretch] = []
    waiting = [(0, corners.size)]
    while waiting and len(found) < _MOST_STRETCHES:
        first, last = waiting.pop()
        begin, period, count = _longest_repetition(marks[first:last])
        if count < 2:
            continue
        begin += first
        bounds = corners[begin : begin + period * count + 1 : period].tolist()
        while not moved[bounds[0]]:  # a cycle begins where the path leaves a vertex, after a pause
            bounds[0] += 1
        found.append(Stretch(tuple(bounds), "recurrence"))
        waiting += [(first, begin + 1), (begin + period * count, last)]
    return sorted(found, key=lambda s: s.bounds)


def _corners(path: CommandPath) -> np.ndarray:
    """List the vertices at which a path turns, and the first and the last, but none on straight lines."""
    at = np.append(0, np.flatnonzero(path.moved()) + 1)
    step = np.diff(path.place[at], axis=0)
    if step.shape[0] < 2:
        return at
    length = np.linalg.norm(step, axis=1)
    unit = step / length[:, None]
    before, after = unit[:-1], unit[1:]
    cross = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    blur = 4.0 * np.finfo(np.float64).eps * np.abs(path.place).max() / np.minimum(length[:-1], length[1:])
    turns = (cross > ROUNDING + blur) | ((before * after).sum(axis=1) < 0.0)
    return at[np.concatenate(([True], turns, [True]))]


def _marks(place: np.ndarray, tolerance: float) -> np.ndarray:
    """Number places so that equal ones have equal numbers."""
    marks = np.zeros(place.shape[0], np.int64)
    for k in range(place.shape[1]):
        order = np.argsort(place[:, k], kind="stable")
        group = np.cumsum(np.append(False, np.diff(place[order, k]) > tolerance))
        marks[order] = marks[order] * (place.shape[0] + 1) + group
        marks = np.unique(marks, return_inverse=True)[1]
    return marks


def _longest_repetition(marks: np.ndarray) -> tuple[int, int, int]:
    """Find begin, period and number of periods of the longest repetition, of equally long ones the shortest; else 0."""
    best, covered = (0, 0, 0), 0
    for period in _possible_periods(marks):
        same = np.concatenate(([False], marks[period:] == marks[:-period], [False]))
        edges = np.flatnonzero(np.diff(same.astype(np.int8)))
        begins, lengths = edges[::2], edges[1::2] - edges[::2]
        if begins.size == 0:
            continue
        longest = int(lengths.argmax())
        count = (int(lengths[longest]) + period - 1) // period
        if count >= 2 and lengths[longest] + period > covered:
            covered = int(lengths[longest]) + period
            best = int(begins[longest]), period, count
    return best


def _possible_periods(marks: np.ndarray, most: int = 40) -> list[int]:
    """List the most frequent distances between equal marks, the shortest first."""
    order = np.argsort(marks, kind="stable")
    counts: dict[int, int] = {}
    for ahead in range(1, 6):
        gap = order[ahead:] - order[:-ahead]
        gap = gap[marks[order[ahead:]] == marks[order[:-ahead]]]
        values, times = np.unique(gap, return_counts=True)
        for i in np.argsort(-times, kind="stable")[:most]:
            counts[int(values[i])] = max(counts.get(int(values[i]), 0), int(times[i]))
    often = sorted(counts, key=lambda p: (-counts[p], p))[:most]
    return sorted(often)
