"""Cycles in what was commanded. Pure: arrays in, places out.

The crawler is rate-independent: only the path of the commands matters, so pauses and speed do not. A cycle is a closed
stretch of that path that comes back: the drive of the recorded scene where it was played, else whatever repeats.
Commands are compared through two fixed combinations of all their numbers, so that memory does not grow with the body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crawler_model.body.drive import NS, Drive

ROUNDING = 1e-9
"""Commands, shapes and translations that differ by less than this part of their size are the same."""
_INSTANT_NS = 2
_MOST_TRIES = 200
_MOST_STRETCHES = 50


def signature_weights(count: int) -> np.ndarray:
    """Choose the weights with which rows of numbers are compared.

    Args:
        count: numbers in a row.

    Returns:
        Always the same ones, shape (count, 2).
    """
    return np.random.default_rng(20260101).uniform(0.5, 1.5, (count, 2)) * [1.0, -1.0]


@dataclass(frozen=True, eq=False)
class CommandPath:
    """The path that the commands took in a run, from vertex to vertex.

    Attributes:
        time_ns: when each vertex was reached, shape (V,) [ns]; the first is the start.
        place: what was commanded there, as two combinations of all numbers, in SI units, shape (V, 2).
    """

    time_ns: np.ndarray
    place: np.ndarray

    @property
    def tolerance(self) -> float:
        """What counts as rounding [the unit of `place`]."""
        return ROUNDING * float(np.abs(self.place).max(initial=0.0))

    def moved(self) -> np.ndarray:
        """Tell on the way to which vertices the command changed.

        Returns:
            A bool for each stretch between two vertices, shape (V - 1,).
        """
        return np.abs(np.diff(self.place, axis=0)).max(axis=1, initial=0.0) > self.tolerance


@dataclass(frozen=True)
class Stretch:
    """Cycles that follow one another.

    Attributes:
        bounds: vertices where they begin and end, one more than cycles.
        source: "drive" when they are the recorded scene's, else "recurrence".
    """

    bounds: tuple[int, ...]
    source: str


def find_cycles(path: CommandPath, drive: Drive | None, weights: np.ndarray) -> list[Stretch]:
    """Find the cycles of a run.

    Args:
        path: what was commanded.
        drive: the recorded scene's, if it has one with a period.
        weights: with which the path's places were made, shape (C, 2).

    Returns:
        Stretches of cycles in order; none where nothing repeats.
    """
    if path.time_ns.size < 2:
        return []
    played = [] if drive is None or drive.period is None else _find_drive(path, drive, drive.rows @ weights)
    repeated = _find_recurrence(path)
    # a drive that was played with pauses, or at another speed, repeats more often than it keeps its time
    return played if _count(played) >= _count(repeated) else repeated


def _count(stretches: list[Stretch]) -> int:
    return sum(len(s.bounds) - 1 for s in stretches)


def _find_drive(path: CommandPath, drive: Drive, way: np.ndarray) -> list[Stretch]:
    """Find where a drive was played in its own time."""
    assert drive.period is not None
    time, place, moved = path.time_ns, path.place, path.moved()
    tolerance = max(path.tolerance, ROUNDING * float(np.abs(way).max(initial=0.0)))
    changes = np.flatnonzero(np.abs(np.diff(way, axis=0)).max(axis=1, initial=0.0) > tolerance)
    if changes.size == 0:
        return []
    flat_ns = round(float(drive.times[changes[0]]) * NS)
    times = np.append(drive.times, drive.period) if drive.times[-1] < drive.period else drive.times
    way = np.vstack((way, way[:1])) if drive.times[-1] < drive.period else way
    begins = np.flatnonzero(moved & np.append(True, ~moved[:-1]))
    begins = begins[np.abs(place[begins] - way[0]).max(axis=1) <= tolerance]
    found: list[Stretch] = []
    first = tries = 0
    for begin in begins.tolist():
        if begin < first or tries > _MOST_TRIES:
            continue
        start_ns = int(time[begin]) - flat_ns
        bounds = _follow_drive(path, moved, begin, start_ns, drive.period, times, way, tolerance, most=1)
        if len(bounds) > 1:
            bounds = _follow_drive(path, moved, begin, start_ns, drive.period, times, way, tolerance, most=None)
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
    way: np.ndarray,
    tolerance: float,
    most: int | None,
) -> list[int]:
    """Tell how long a path keeps to a drive that starts at a vertex: the vertices where its periods end."""
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
        expected = np.interp(phase, times, way[:, k])
        off = np.maximum(off, np.abs(path.place[begin:end, k] - expected))
    # a vertex at most an instant from a waypoint: the drive's steepest change in that time is no difference
    steep = float((np.abs(np.diff(way, axis=0)).max(axis=1) / np.diff(times)).max())
    wrong = np.flatnonzero(off > tolerance + steep * _INSTANT_NS / NS)
    good_ns = int(time[wrong[0]]) if wrong.size else last_ns + 1
    bounds = [begin]
    for k in range(count):
        if not _corners_kept(path, moved, start_ns + k * span, times, way, tolerance):
            break
        at = start_ns + (k + 1) * span
        vertex = int(np.searchsorted(path.time_ns, at + _INSTANT_NS, side="right")) - 1
        ends_there = abs(path.time_ns[vertex] - at) <= _INSTANT_NS
        held = vertex < moved.size and not moved[vertex]
        if path.time_ns[vertex] >= good_ns or not (ends_there or held):
            break
        bounds.append(vertex)
    return bounds


def _corners_kept(
    path: CommandPath, moved: np.ndarray, start_ns: float, times: np.ndarray, way: np.ndarray, tolerance: float
) -> bool:
    """Tell whether every waypoint of a period at which the drive turns is a vertex of the path."""
    slope = np.diff(way, axis=0) / np.diff(times)[:, None]
    turns = np.flatnonzero(np.abs(np.diff(slope, axis=0)).max(axis=1, initial=0.0) > tolerance) + 1
    at = start_ns + times[turns] * NS
    near = np.clip(np.searchsorted(path.time_ns, at), 1, path.time_ns.size - 1)
    apart = np.minimum(np.abs(path.time_ns[near] - at), np.abs(path.time_ns[near - 1] - at))
    return bool(((apart <= _INSTANT_NS) | ~moved[near - 1]).all())


def _find_recurrence(path: CommandPath) -> list[Stretch]:
    """Find what repeats in a path, whatever its speed."""
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
        while not moved[bounds[0]]:  # a cycle begins where the path leaves, behind a pause
            bounds[0] += 1
        found.append(Stretch(tuple(bounds), "recurrence"))
        waiting += [(first, begin + 1), (begin + period * count, last)]
    return sorted(found, key=lambda s: s.bounds)


def _corners(path: CommandPath) -> np.ndarray:
    """List the vertices at which a path turns, the first and the last: what lies on a straight line says nothing."""
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
    """Number places, equal ones alike."""
    marks = np.zeros(place.shape[0], np.int64)
    for k in range(place.shape[1]):
        order = np.argsort(place[:, k], kind="stable")
        group = np.cumsum(np.append(False, np.diff(place[order, k]) > tolerance))
        marks[order] = marks[order] * (place.shape[0] + 1) + group
        marks = np.unique(marks, return_inverse=True)[1]
    return marks


def _longest_repetition(marks: np.ndarray) -> tuple[int, int, int]:
    """Find the longest stretch that repeats, of those the one with the shortest period.

    Returns:
        Where it begins, its period, and how many whole periods it has; all 0 when nothing repeats.
    """
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
    """List how far apart equal marks most often are, the shortest first."""
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
