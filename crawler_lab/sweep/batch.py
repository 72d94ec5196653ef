"""Runs of stacks: the variations of a stack follow their drives exactly, many in one compiled call."""

from __future__ import annotations

import functools
import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from crawler_model.body.drive import NS, Drive
from crawler_model.crawler.budget import default_budget
from crawler_model.motion.account import empty_account
from crawler_model.motion.follow import build_motion
from crawler_model.motion.margin import visited_margins
from crawler_model.run.simulate import default_duration

from .course import exact_course, most_ramps
from .rows import INVALID, ROW, Ledger, find_legs
from .stack import Stack

_STEPS = 100_000
"""Ramps times contacts followed in one compiled call, which nothing can interrupt; they take about 0.1 s."""


def run_stack(whole: Stack, duration: float | None, stop: Callable[[], bool] | None = None) -> np.ndarray:
    """Run the variations of a stack exactly, from waypoint to waypoint.

    Args:
        whole: the stack.
        duration: duration of each run [s]; None for ten periods, or up to the last waypoint.
        stop: called before each compiled call; True stops the remaining runs.

    Returns:
        Rows of results, shape (M,), dtype ROW.
    """
    rows = np.zeros(len(whole), ROW)
    rows["status"][list(whole.reasons)] = INVALID
    for lanes, targets, course in _groups(whole, duration):
        blocks = list(itertools.islice(course(), 2))
        ramps = sum(block[0].size for block in blocks)
        size = max(_STEPS // max(ramps * whole.body.contacts, 1), 1) if len(blocks) < 2 else 1
        for first in range(0, lanes.size, size):
            some = lanes[first : first + size]
            done = _run(whole.select(some), targets[first : first + size], course(), stop)
            if done is None:
                return rows
            rows[some] = done
    return rows


Course = Callable[[], Iterator[tuple[np.ndarray, np.ndarray]]]


def _groups(whole: Stack, duration: float | None) -> Iterator[tuple[np.ndarray, np.ndarray, Course]]:
    """Group valid variations whose ramps meet the same waypoints: indices, targets (K, W or W + 1, F), and course."""
    valid = np.setdiff1d(np.arange(len(whole)), list(whole.reasons))
    period = whole.period
    timing = whole.times if period is None else np.column_stack((whole.times, period))
    groups: dict[tuple[bytes, ...], list[tuple[np.ndarray, np.ndarray, Course]]] = {}
    for lanes in _equal_rows(timing, valid):
        times, repeat = whole.times[lanes[0]], None if period is None else float(period[lanes[0]])
        part = whole if lanes.size == len(whole) else whole.select(lanes)
        drive = Drive(times, repeat, part.assembly.drive.rows, part.assembly.columns)
        end_ns = round((default_duration(drive) if duration is None else duration) * NS)
        course = functools.partial(exact_course, drive, end_ns, most_ramps(whole.body))
        blocks = list(itertools.islice(course(), 2))
        targets = np.concatenate((drive.targets, drive.sample(np.array([end_ns]))), axis=1)
        parts = blocks[0] if len(blocks) == 1 else (timing[lanes[0]],)
        groups.setdefault(tuple(array.tobytes() for array in parts), []).append((lanes, targets, course))
    for each in groups.values():
        lanes, targets = (np.concatenate([group[k] for group in each]) for k in (0, 1))  # type: ignore[misc]
        yield lanes, targets, each[0][2]


def _equal_rows(timing: np.ndarray, valid: np.ndarray) -> Iterator[np.ndarray]:
    """Group indices by equal rows."""
    if not valid.size:
        return
    if (timing[valid] == timing[valid[0]]).all():
        yield valid
        return
    _, group = np.unique(timing[valid], axis=0, return_inverse=True)
    order = np.argsort(group.ravel(), kind="stable")
    yield from np.split(valid[order], np.flatnonzero(np.diff(group.ravel()[order])) + 1)


def _run(
    stack: Stack,
    targets: np.ndarray,
    course: Iterator[tuple[np.ndarray, np.ndarray]],
    stop: Callable[[], bool] | None,
) -> np.ndarray | None:
    """Run all variations of a stack along the same course; None if they were stopped."""
    body, count = stack.body, len(stack)
    motion: Any = build_motion(stack.assembly)
    state, scratch = motion.start(stack.start, targets[:, 0]), motion.scratch()
    tension = np.array(state.tension)
    forward, backward, _ = np.split(targets[:, 0], body.springs + body.contacts * np.arange(3), axis=1)[1:]
    visited = visited_margins(body.spring_force(tension), forward, backward)
    ledger, kernel_s = Ledger(body, stack.start, tension, visited), 0.0
    for rows, ends in course:
        if stop is not None and stop():
            return None
        legs = find_legs(ends, rows.size)
        accounts = empty_account(count)
        spent = np.empty((count, legs.size - 1, 2))
        records = np.empty((count, rows.size, 2 * body.contacts + body.springs))
        began = time.perf_counter()
        motion.follow_many(state, scratch, targets, rows, legs, default_budget(body), accounts, spent, records)
        kernel_s += time.perf_counter() - began
        ledger.add_ramps(accounts, spent, records, ends)
    return ledger.rows(stack.assembly, stack.length, kernel_s / count)
