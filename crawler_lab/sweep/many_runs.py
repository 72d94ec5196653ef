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

from crawler_model.body.curves import energy_of_sliders
from crawler_model.body.drive import NS
from crawler_model.crawler.crawler import Crawler
from crawler_model.crawler.method import METHODS, Method
from crawler_model.errors import CommandError, CrawlerError, SceneError
from crawler_model.run.simulate import default_duration
from crawler_model.run.ticks import DEFAULT_RATE, check_duration, count_ticks, rational_rate, tick_end_ns, tick_ends
from crawler_model.run.transport import length_of
from crawler_model.scene.scene import Scene

from .batch import run_stack
from .course import exact_course, most_ramps
from .results import ManyRuns, gather
from .rows import INVALID, ROW, Ledger, PeriodScrew, find_legs
from .stack import can_be_stacked, fingerprint, shares_mesh, stack, stack_scenes
from .vary import Variations
from .workers import Chunk, available_cores, run_chunks

_NUMBERS = 4_000_000
"""Upper limit of the numbers of targets in a stack."""


@dataclass(frozen=True)
class Settings:
    """Settings of all runs, as for `simulate`.

    Attributes:
        duration: duration of each run [s]; None for ten periods, or up to the last waypoint.
        rate: ticks per second [Hz].
        method: "exact", "catch_up", or None for the best one available.
    """

    duration: float | None = None
    rate: float = DEFAULT_RATE
    method: Method | None = None

    def check(self) -> None:
        """Check the settings.

        Raises:
            CommandError: if duration, rate or method is out of range.
        """
        rational_rate(self.rate)
        if self.duration is not None:
            check_duration(self.duration)
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
    rate: float = DEFAULT_RATE,
    method: Method | None = None,
    workers: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> ManyRuns:
    """Run many scenes in parallel.

    An invalid scene, which `vary` detects only when it builds it, does not stop the others. Positions are bitwise equal
    to `simulate`'s: with `exact` at a rate of one tick for the whole run (at any other rate within rounding), with
    `catch_up` at the same rate. They do not depend on the number of workers.

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
    return gather(scenes, rows, reasons, interrupted, time.perf_counter() - began)


def run_chunk(scenes: Sequence[Scene], settings: Settings, stop: Callable[[], bool] | None = None) -> Chunk:
    """Run a few scenes in this thread.

    Args:
        scenes: the scenes to run.
        settings: duration, rate and method.
        stop: called now and then; True stops the remaining runs.

    Returns:
        Rows of results, shape (M,), and reasons for invalid rows by index.
    """
    rows = np.zeros(len(scenes), ROW)
    reasons: dict[int, str] = {}
    if settings.method == "catch_up" or not (isinstance(scenes, Variations) and shares_mesh(scenes.base, scenes.paths)):
        _run_each(scenes, settings, stop, rows, reasons)
        return rows, reasons
    size = max(_NUMBERS // scenes.pinned.drive.targets.size, 1)
    for first in range(0, len(scenes), size):
        if stop is not None and stop():
            break
        whole = stack(scenes[first : first + size])
        rows[first : first + size] = run_stack(whole, settings.duration, stop)
        reasons.update({first + i: text for i, text in whole.reasons.items()})
    return rows, reasons


def _run_each(
    scenes: Sequence[Scene],
    settings: Settings,
    stop: Callable[[], bool] | None,
    rows: np.ndarray,
    reasons: dict[int, str],
) -> None:
    """Build and run scenes one after another; successive ones that can be stacked run together."""
    together: list[Scene] = []
    first, common = 0, None

    def run_together() -> None:
        if together:
            rows[first : first + len(together)] = run_stack(stack_scenes(together), settings.duration, stop)
            together.clear()

    for i in range(len(scenes)):
        if stop is not None and stop():
            return
        try:
            scene = scenes[i]
            exact = settings.method != "catch_up" and can_be_stacked(scene)
            if not exact or fingerprint(scene) != common:
                run_together()
            if not exact:
                row = _run(scene, settings, stop)
                if row is not None:
                    rows[i] = row
                continue
        except CrawlerError as error:
            run_together()
            rows[i]["status"] = INVALID
            reasons[i] = str(error)
            continue
        if not together:
            first, common = i, fingerprint(scene)
        together.append(scene)
        if len(together) * scene.drive.targets.size > _NUMBERS:
            run_together()
    run_together()


def _run(scene: Scene, settings: Settings, stop: Callable[[], bool] | None) -> np.ndarray | None:
    """Run one scene and return its row, or None if it was stopped."""
    crawler = Crawler(scene, settings.method)
    x, tension = crawler.displacement, crawler.tension
    margin, lengths = np.array([crawler.visited_margin]), crawler.actuation[None]
    ledger = Ledger(scene.body, x[None], tension[None], margin, lengths)
    kernel_s, screw, bends = 0.0, PeriodScrew(crawler), scene.body.bends
    remembered = energy_of_sliders(bends, crawler.hysteresis)
    for targets, ends in _ramps(crawler, settings):
        if stop is not None and stop():
            return None
        records = np.empty((targets.shape[0], 2 * x.size + tension.size))
        lengths, began = crawler.lengths_at(targets)[None], time.perf_counter()
        step, spent, jump_loss = None, [], 0.0
        for first, until in itertools.pairwise(find_legs(ends, targets.shape[0]).tolist()):
            step = crawler.follow(targets[first:until], records[first:until], step)
            spent.append((step.work, step.dissipation))
            jump_loss += step.jump_loss
            if until - 1 in ends:
                screw.mark()
        assert step is not None
        kernel_s += time.perf_counter() - began
        gained = energy_of_sliders(bends, crawler.hysteresis) - remembered
        ledger.add_ramps(step.account[None], np.array([spent]), records[None], ends, jump_loss, lengths, gained)
    row: np.ndarray = ledger.rows(scene, np.array([length_of(scene.body)]), kernel_s, screw.gain())[0]
    return row


def _ramps(crawler: Crawler, settings: Settings) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Generate the ramps of a run in blocks that fit in memory: from waypoint to waypoint if exact, else with ticks.

    Yields:
        Targets, shape (V, S + 2 N), and indices of targets that end a period.
    """
    drive, most = crawler.scene.drive, most_ramps(crawler.body)
    end_ns = round((default_duration(drive) if settings.duration is None else settings.duration) * NS)
    if crawler.method == "exact":
        targets = np.concatenate((drive.targets, drive.sample(np.array([end_ns]))))
        for rows, ends in exact_course(drive, end_ns, most):
            yield targets[rows], ends
        return
    ratio = rational_rate(settings.rate)
    ticks = count_ticks(end_ns, ratio)
    for first in range(0, ticks, most):
        tick_ns = tick_ends(first + 1, min(first + most, ticks), ratio, end_ns)
        _, targets, at, rows = drive.ramps_between(min(tick_end_ns(first, ratio), end_ns), tick_ns)
        ends = at[rows == 0] if drive.period is not None else at[:0]
        yield targets, ends
