"""Measurement of errors, then of times in interleaved rounds, so that a slow moment affects all methods alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .cases import QUARTERS, Case
from .entrants.entrant import Entrant, OutOfTime, Run
from .entrants.ours import catch_up_displacement


@dataclass(frozen=True)
class Effort:
    """The limits of the measurements.

    Attributes:
        rounds: largest number of rounds of timing; the median counts.
        seconds: time for each entrant in a case, errors and rounds together [s].
    """

    rounds: int
    seconds: float


@dataclass(eq=False)
class _Entry:
    """An entrant and its measurements so far."""

    entrant: Entrant
    run: Run | None = None
    deadline: float = 0.0
    used: float = 0.0
    quarters: int = 0
    error: float | None = None
    own_error: float | None = None
    times: list[float] = field(default_factory=list)
    first: float = 0.0
    problem: str = ""


def measure(case: Case, entrants: list[Entrant], effort: Effort, progress: Callable[[], None]) -> list[dict[str, Any]]:
    """Measure all entrants of a case.

    Returns:
        A row for each entrant, plain numbers and text.
    """
    steps: dict[int, np.ndarray] = {}
    entries = []
    for entrant in entrants:
        entry = _Entry(entrant)
        _run_for_error(case, entry, effort, steps)
        entries.append(entry)
        progress()
    for _ in range(effort.rounds):
        for entry in entries:
            _time(entry, effort)
            progress()
    return [_row(case, entry) for entry in entries]


def _run_for_error(case: Case, entry: _Entry, effort: Effort, steps: dict[int, np.ndarray]) -> None:
    entrant = entry.entrant
    if case.contacts > entrant.largest:
        entry.problem = f"too large: it is run for at most {entrant.largest} contacts"
        return
    began = time.perf_counter()
    found: list[np.ndarray] = []
    try:
        entry.run = entrant.start()
        began = time.perf_counter()  # the set-up, including compilation, does not count
        for number in range(QUARTERS):
            entry.first += entry.run.quarter(number, began + effort.seconds)
            found.append(np.array(entry.run.displacement))
    except OutOfTime:
        entry.problem = f"not finished within {effort.seconds:g} s"
    except (ArithmeticError, ValueError, RuntimeError) as failure:
        entry.problem = f"{type(failure).__name__}: {failure}"
    entry.used = time.perf_counter() - began
    entry.quarters = len(found)
    if entry.problem:
        return
    x = np.array(found)
    error = case.reference.error(x)
    if not np.isfinite(error):
        entry.problem = "diverged"
        return
    entry.error = error
    if entrant.implicit:
        if entrant.ticks not in steps:
            steps[entrant.ticks] = catch_up_displacement(case, entrant.ticks, QUARTERS)
        entry.own_error = float(np.abs(x - steps[entrant.ticks]).max() / case.reference.size)


def _time(entry: _Entry, effort: Effort) -> None:
    if entry.problem or entry.run is None:
        return
    if entry.times and entry.used + max(entry.first / 2, 1e-6) > effort.seconds:
        return
    began = time.perf_counter()
    try:
        spent, periods = entry.run.lap(entry.quarters, began + 2.0 * effort.seconds)
    except OutOfTime:  # the first run, which finished in time, counts
        if not entry.times:
            entry.times.append(entry.first / 2)
        entry.used = np.inf
        return
    entry.used += time.perf_counter() - began
    entry.quarters += 4 * periods
    entry.times.append(spent / periods)


def _row(case: Case, entry: _Entry) -> dict[str, Any]:
    entrant, run = entry.entrant, entry.run
    ticks = float(entrant.ticks)
    if entrant.ticks == 0 and run is not None and entry.quarters:
        ticks = run.steps / (entry.quarters / 4)
    row: dict[str, Any] = {
        "case": case.name,
        "n": case.contacts,
        "method": entrant.method,
        "us_per_tick": None,
        "error": entry.error,
        "solved": not entry.problem and run is not None and run.failures == 0,
        "ticks_per_period": round(ticks, 1) if ticks else None,
        "us_per_period": None,
        "label": entrant.label or (f"{entrant.ticks:,}" if entrant.ticks else ""),
        "spread_us_per_tick": None,
        "rounds": len(entry.times),
        "solver_error": entry.own_error,
        "reference": case.reference.kind,
        "failed": run.failures / run.solves if run is not None and run.solves else (1.0 if entry.problem else 0.0),
        "detail": "; ".join(text for text in (entry.problem, entrant.detail) if text),
    }
    if entry.times and ticks:
        row["us_per_period"] = 1e6 * statistics.median(entry.times)
        row["us_per_tick"] = row["us_per_period"] / ticks
        row["spread_us_per_tick"] = [1e6 * min(entry.times) / ticks, 1e6 * max(entry.times) / ticks]
    elif run is not None and run.solves and entry.problem.startswith("not done"):
        row["us_per_tick"] = 1e6 * entry.used / run.solves
        row["detail"] += f"; the time is the mean of the {run.solves} finished ticks"
    return row
