"""Runs of many scenes: thousands of variations on all cores, with one row of results each.

A row equals the results of `simulate` for that scene. `exact` needs no ticks: it proceeds from waypoint to waypoint, as
`simulate` does if one tick covers the whole run. `catch_up` uses the ticks of the rate.
"""

from __future__ import annotations

import functools
import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..body.body import Body
from ..body.drive import NS, find_waypoints
from ..crawler.crawler import METHODS, Crawler, Method
from ..errors import CommandError, CrawlerError, SceneError
from ..run.account import Energy, Total, average_displacement, stored_energy
from ..run.simulate import default_duration, rational_rate, tick_end_ns
from ..run.transport import body_lengths, cost_of_transport
from ..scene.scene import Scene
from .workers import Chunk, available_cores, run_chunks

_BLOCK, _NUMBERS = 4096, 4_000_000
"""Upper limits of the ramps followed in one call, and of the numbers recorded for them."""
_NOT_RUN, _DONE, _INVALID = 0, 1, 2
_STATUS = np.array(["not run", "done", "invalid"])
_LENGTHS = ("net_translation", "gained", "per_period", "settling")
_FORCES = ("work", "dissipation", "stored", "residual", "violation", "visited_margin")
_COMPARED = ("period_work", "cost_of_transport", "body_lengths")
ROW = np.dtype(
    [("status", np.uint8), ("dimension", np.uint8), ("unique", np.bool_)]
    + [(name, np.float64, (2,)) for name in _LENGTHS]
    + [(name, np.float64) for name in (*_FORCES, *_COMPARED)]
    + [
        ("kernel_s", np.float64),
        ("events", np.int64),
        ("overspent", np.int64),
        ("unsolved", np.int64),
        ("periods", np.int64),
    ]
)
"""Results of a run; `kernel_s`, the time spent in its kernels [s], determines how runs are distributed."""


@dataclass(frozen=True, eq=False, repr=False)
class ManyRuns:
    """Results of many runs, one row each. Arrays are read-only; NaN, 0 and False for runs that are not done.

    Attributes:
        status: "done", "invalid", or "not run" after an interrupt, shape (M,).
        reason: reason why a run is invalid, "" for the others.
        net_translation: y at the end, shape (M,); (M, 2) if a scene is planar [m].
        gained: y at the end minus y at the start, likewise [m].
        per_period: y gained in the last whole period, likewise [m]; NaN without a whole period.
        settling: difference of the last two periods, likewise [m]; NaN with fewer than two.
        work: work of the actuators, shape (M,) [J].
        dissipation: energy lost to friction, shape (M,) [J].
        stored: change of the energy stored in the springs, shape (M,) [J].
        residual: stored + dissipation - work, relative to the largest of them and to the largest energy stored at a
            waypoint, shape (M,).
        violation: largest amount by which a spring force exceeds its bound, shape (M,) [N].
        visited_margin: how close all contacts came to sliding at once, shape (M,); for chains of more than 256
            contacts and with catch_up only at the ends of ramps.
        period_work: work of the actuators in the last whole period, shape (M,) [J]; NaN without one.
        cost_of_transport: work / (distance * force) of the last whole period, shape (M,): the distance is |per_period|,
            the force the sum of `body.weights`, or without weights the sum of (mu_plus + mu_minus) / 2, its mean over a
            period. NaN without a whole period, and for a body that does not travel.
        body_lengths: per_period in lengths of the body (in the plane, its distance), shape (M,).
        unique: False if the translation was not determined on some stretch, shape (M,).
        events: number of linear pieces, shape (M,).
        overspent: number of ramps whose budget of work was exceeded, shape (M,).
        unsolved: number of ramps in which the active set of a graph did not converge, shape (M,).
        periods: number of whole periods, shape (M,).
        interrupted: True if Ctrl-C stopped the runs; completed runs are included.
        wall_s: wall-clock time [s].
    """

    status: np.ndarray
    reason: tuple[str, ...]
    net_translation: np.ndarray
    gained: np.ndarray
    per_period: np.ndarray
    settling: np.ndarray
    work: np.ndarray
    dissipation: np.ndarray
    stored: np.ndarray
    residual: np.ndarray
    violation: np.ndarray
    visited_margin: np.ndarray
    period_work: np.ndarray
    cost_of_transport: np.ndarray
    body_lengths: np.ndarray
    unique: np.ndarray
    events: np.ndarray
    overspent: np.ndarray
    unsolved: np.ndarray
    periods: np.ndarray
    interrupted: bool
    wall_s: float

    def __len__(self) -> int:
        """Count the runs."""
        return len(self.reason)

    def __repr__(self) -> str:
        """Describe the results in one line."""
        counts = ", ".join(f"{(self.status == s).sum()} {s}" for s in _STATUS[1:])
        return f"ManyRuns({len(self)} runs: {counts}, {self.wall_s:.3g} s)"


@dataclass(frozen=True)
class Settings:
    """Settings of all runs, as for `simulate`.

    Attributes:
        duration: duration of each run [s]; None for ten periods, or up to the last waypoint.
        rate: ticks per second [Hz].
        method: "exact", "catch_up", or None for the best one available.
    """

    duration: float | None = None
    rate: float = 100.0
    method: Method | None = None

    def check(self) -> None:
        """Check the settings.

        Raises:
            CommandError: if duration, rate or method is out of range.
        """
        rational_rate(self.rate)
        if self.duration is not None and not 0.0 <= self.duration < 9e9:
            raise CommandError(f"duration: {self.duration:g} s; it must be between 0 and 9e9")
        if self.method is not None and self.method not in METHODS:
            raise CommandError(f"method: {self.method!r}; it must be one of {', '.join(METHODS)}")


def _check_scenes(scenes: Any) -> None:
    """Raise an error unless this is a sequence of scenes; variations are not built yet."""
    expected = "a sequence of scenes, as [load_scene('two_anchor_a')] or vary(...)"
    if not isinstance(scenes, Sequence) or isinstance(scenes, (str, bytes)):
        raise SceneError(f"simulate_many: {type(scenes).__name__}; it must be {expected}")
    if isinstance(scenes, (list, tuple)):
        for i, scene in enumerate(scenes):
            if not isinstance(scene, Scene):
                raise SceneError(f"simulate_many: entry {i} is a {type(scene).__name__}; it must be {expected}")


def simulate_many(
    scenes: Sequence[Scene],
    duration: float | None = None,
    rate: float = 100.0,
    method: Method | None = None,
    workers: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> ManyRuns:
    """Run many scenes in parallel.

    An invalid scene, which `vary` detects only when it builds it, does not stop the others. Positions are bitwise equal
    to those of `simulate`: with `exact` at a rate of one tick for the whole run (at any other rate within rounding),
    with `catch_up` at the same rate. They do not depend on the number of workers.

    Args:
        scenes: the scenes to run, for example from `vary`.
        duration: duration [s]; None for ten periods of each scene, or up to its last waypoint.
        rate: ticks per second [Hz]; not used by `exact`.
        method: "exact" or "catch_up"; None for the best one available: exact on a line.
        workers: number of simultaneous runs; None for one per core.
        progress: called with the completed part, in [0, 1].

    Returns:
        A row of results for each scene. After Ctrl-C the completed runs, with `interrupted` set.

    Raises:
        CommandError: if duration, rate, method or workers is out of range.
        SceneError: if `scenes` is not a sequence of scenes.
    """
    began = time.perf_counter()
    _check_scenes(scenes)
    settings = Settings(duration, rate, method)
    settings.check()
    if workers is not None and workers < 1:
        raise CommandError(f"workers: {workers}; it must be at least 1")
    rows = np.zeros(len(scenes), ROW)
    reasons: dict[int, str] = {}

    def store(first: int, chunk: Chunk) -> None:
        results, invalid = chunk
        rows[first : first + results.size] = results
        reasons.update({first + i: text for i, text in invalid.items()})

    interrupted = run_chunks(
        scenes, functools.partial(run_chunk, settings=settings), store, workers or available_cores(), progress
    )
    return gather(rows, reasons, interrupted, time.perf_counter() - began)


def run_chunk(scenes: Sequence[Scene], settings: Settings, stop: Callable[[], bool] | None = None) -> Chunk:
    """Run a few scenes one after another.

    Args:
        scenes: the scenes to run.
        settings: duration, rate and method.
        stop: called before and during each run; True stops the remaining runs.

    Returns:
        Rows of results, shape (M,), and reasons for invalid rows by index.
    """
    rows = np.zeros(len(scenes), ROW)
    reasons = {}
    for i in range(len(scenes)):
        if stop is not None and stop():
            break
        try:
            row = _run(scenes[i], settings, stop)
            if row is not None:
                rows[i] = row
        except CrawlerError as error:
            rows[i]["status"] = _INVALID
            reasons[i] = str(error)
    return rows, reasons


def gather(rows: np.ndarray, reasons: dict[int, str], interrupted: bool, wall_s: float) -> ManyRuns:
    """Build the results from rows.

    Args:
        rows: rows of dtype ROW, shape (M,).
        reasons: reasons for invalid rows by index.
        interrupted: whether the runs were stopped.
        wall_s: wall-clock time [s].

    Returns:
        The results.
    """
    done = rows["status"] == _DONE
    planar = bool((rows["dimension"] == 2).any())
    columns = {}
    for name in (*_LENGTHS, *_FORCES, *_COMPARED):
        column = rows[name].copy()
        column[~done] = np.nan
        columns[name] = column if planar or column.ndim == 1 else column[:, 0].copy()
    for name in ("unique", "events", "overspent", "unsolved", "periods"):
        columns[name] = rows[name].copy()
    columns["status"] = _STATUS[rows["status"]]
    for column in columns.values():
        column.flags.writeable = False
    reason = tuple(reasons.get(i, "") for i in range(rows.size))
    return ManyRuns(reason=reason, interrupted=interrupted, wall_s=wall_s, **columns)


def _run(scene: Scene, settings: Settings, stop: Callable[[], bool] | None) -> tuple[object, ...] | None:
    """Run one scene and return its row, or None if it was stopped."""
    crawler = Crawler(scene, settings.method)
    x, tension = crawler.displacement, crawler.tension
    width, kernel_s = x.size, 0.0
    marks = np.zeros((1, 2 * width))  # displacement and its rest at the start and at the last period ends
    marks[0, :width] = x.ravel()
    last = marks[0]
    start = stored = peak = float(stored_energy(scene.body, tension[None])[0])
    total, periods, works = Total(crawler.visited_margin), 0, [0.0]
    for targets, ends in _ramps(crawler, settings):
        if stop is not None and stop():
            return None
        records = np.empty((targets.shape[0], 2 * width + tension.size))
        began = time.perf_counter()
        step = None
        for first, until in itertools.pairwise(sorted({0, *(ends[-2:] + 1), targets.shape[0]})):
            step = crawler.follow(targets[first:until], records[first:until], step)
            if until - 1 in ends[-2:]:
                works.append(total.work + step.work)
        assert step is not None
        kernel_s += time.perf_counter() - began
        total.add(step)
        energy = stored_energy(scene.body, records[:, 2 * width :].reshape(-1, *tension.shape))
        stored, peak = float(energy[-1]), max(peak, float(energy.max()))
        last = records[-1, : 2 * width]
        periods += ends.size
        if ends.size:
            marks = np.concatenate((marks, records[ends[-3:], : 2 * width]))[-3:]
    stored -= start
    account = Energy(total.work, total.dissipation, stored, total.residual, peak, total.loads_work, total.jump_loss)
    lengths = _lengths(scene.body, marks.reshape(-1, 2, *x.shape), last[:width].reshape(x.shape), x)
    period = lengths[2] if scene.dimension == 2 else lengths[2][0]
    compared = (np.nan,) * 3
    if periods:
        spent, size = works[-1] - works[-2], float(np.abs(marks[:, :width]).max())
        compared = (spent, cost_of_transport(scene, spent, period, size), body_lengths(scene, period))
    forces = (account.work, account.dissipation, account.stored, account.relative_residual)
    margins = (total.violation, total.visited)
    counts = (kernel_s, total.events, total.overspent, total.unsolved, periods)
    return (_DONE, scene.dimension, total.unique, *lengths, *forces, *margins, *compared, *counts)


def _lengths(body: Body, marks: np.ndarray, last: np.ndarray, start: np.ndarray) -> tuple[Any, ...]:
    """Compute the lengths of a run: net_translation, gained, per_period and settling."""
    end, begin = average_displacement(body, np.array((last, start)))
    moved = marks[1:] - marks[:-1]
    gains = average_displacement(body, moved[:, 0] + moved[:, 1])
    none = np.full(begin.shape, np.nan)
    period = gains[-1] if gains.shape[0] else none
    settling = gains[-1] - gains[-2] if gains.shape[0] > 1 else none
    lengths = (end, end - begin, period, settling)
    return lengths if body.dimension == 2 else tuple((value, 0.0) for value in lengths)


def _ramps(crawler: Crawler, settings: Settings) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Generate the ramps of a run in blocks.

    Yields:
        Targets, shape (V, S + 2 N), and indices of those that end a period.
    """
    drive = crawler.scene.drive
    seconds = default_duration(drive) if settings.duration is None else settings.duration
    for after_ns, tick_ns in _blocks(crawler, round(seconds * NS), settings.rate):
        until = int(tick_ns[-1])
        way_ns, way_rows = _waypoints(drive.times.tobytes(), drive.period, after_ns, until)
        period_ends = way_rows == 0 if drive.period is not None else np.zeros(way_rows.size, np.bool_)
        if tick_ns.size == 1 and way_ns.size and way_ns[-1] == until:
            yield np.ascontiguousarray(drive.targets[way_rows]), np.flatnonzero(period_ends)
            continue
        vertex_ns = np.union1d(tick_ns, way_ns)
        targets = drive.sample(vertex_ns)
        at = np.searchsorted(vertex_ns, way_ns)
        targets[at] = drive.targets[way_rows]
        yield np.ascontiguousarray(targets), at[period_ends]


@functools.lru_cache(maxsize=64)
def _waypoints(times: bytes, period: float | None, after_ns: int, until_ns: int) -> tuple[np.ndarray, np.ndarray]:
    """Find waypoints, cached because most variations have the same times."""
    return find_waypoints(np.frombuffer(times), period, after_ns, until_ns)


def _blocks(crawler: Crawler, end_ns: int, rate: float) -> Iterator[tuple[int, np.ndarray]]:
    """Divide a run into blocks that fit in memory.

    Yields:
        The start of a block [ns], and the ends of its ticks [ns].
    """
    drive, body = crawler.scene.drive, crawler.body
    most = min(_BLOCK, max(_NUMBERS // (body.dimension * (2 * body.contacts + body.springs)), 1))
    first = 0
    if crawler.method == "exact":  # ramps from waypoint to waypoint: a block is one tick
        periods = max(most // drive.times.size, 1)
        while first < end_ns:
            after, end = first, end_ns
            if drive.period is not None:
                count = round(after / NS / drive.period) + periods
                end = min(int(np.rint(drive.period * count * NS)), end_ns)
            yield after, np.array([end])
            first = end
        return
    ratio = rational_rate(rate)
    ticks = -(-end_ns * ratio.numerator // (NS * ratio.denominator))
    for first in range(0, ticks, most):
        last = range(first + 1, min(first + most, ticks) + 1)
        tick_ns = np.array([min(tick_end_ns(k, ratio), end_ns) for k in last], dtype=np.int64)
        yield min(tick_end_ns(first, ratio), end_ns), tick_ns
