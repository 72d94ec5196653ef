"""Coverage of `identify`: a 95 % interval should contain the truth 95 times in 100, whatever the sensor does."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from typing import Any, TypeVar

import numpy as np

from tests.lab.identify.laboratory import KINDS, WALKED, identify_robot

from .bench import THREADS

ROBOTS, QUICK_ROBOTS = 200, 2
Row = TypeVar("Row")


def measure_coverage(robots: int, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Identify many robots under each kind of sensor, in as many processes as there are cores.

    Returns:
        A row for each kind: number of robots and of intervals called identified, how many of these contain the truth
        [%], the median half width relative to the value [%], the largest misfit in units of the noise, how many robots
        fit, and the median and 90 % quantile of the time [s].
    """
    found = measure_each((*KINDS, WALKED), robots, identify_robot, progress)
    return [_summarise(kind, rows) for kind, rows in found.items()]


def measure_each(
    kinds: Iterable[str], robots: int, measure: Callable[[int, str], Row], progress: Callable[[float], None]
) -> dict[str, list[Row]]:
    """Measure some robots of each kind, in as many processes as there are cores.

    Args:
        kinds: the kinds.
        robots: number of robots of each kind.
        measure: measures a robot of a seed and a kind.
        progress: called with the fraction done, in [0, 1].

    Returns:
        What was measured, by kind.
    """
    found: dict[str, list[Row]] = {kind: [] for kind in kinds}
    tasks = [(seed, kind) for kind in found for seed in range(robots)]
    with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context("spawn"), _use_one_thread) as pool:
        rows = pool.map(measure, *zip(*tasks, strict=True))
        for done, ((_, kind), row) in enumerate(zip(tasks, rows, strict=True), 1):
            found[kind].append(row)
            progress(done / len(tasks))
    return found


def _use_one_thread() -> None:
    """Leave the cores to the processes."""
    for name in THREADS:
        os.environ[name] = "1"


def _summarise(kind: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Write the row of a kind of sensor."""
    intervals, widths = sum(row["intervals"] for row in rows), [w for row in rows for w in row["half_widths"]]
    return {
        "case": "coverage",
        "measurement": kind,
        "robots": len(rows),
        "intervals": intervals,
        "covered_percent": 100.0 * sum(row["inside"] for row in rows) / intervals if intervals else None,
        "half_width_percent": 100.0 * float(np.median(widths)) if widths else None,
        "largest_misfit": max(row["ratio"] for row in rows),
        "fits": sum(row["fits"] for row in rows),
        "seconds": float(np.median([row["seconds"] for row in rows])),
        "seconds_90": float(np.quantile([row["seconds"] for row in rows], 0.9)),
    }
