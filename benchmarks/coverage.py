"""Coverage of `identify`: a 95 % interval should contain the truth 95 times in 100, whatever the sensor does.

A model that is wrong should be called doubtful, and its cause be the first explanation.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from tests.lab.identify import mistakes
from tests.lab.identify.laboratory import KINDS, WALKED, identify_robot

from .bench import THREADS

ROBOTS, QUICK_ROBOTS = 200, 2


def measure_coverage(robots: int, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Identify many robots under each kind of sensor, in as many processes as there are cores.

    Returns:
        A row for each kind: number of robots and of intervals called identified, how many of these contain the truth
        [%], the median half width relative to the value [%], the largest misfit in units of the noise, how many robots
        fit, and the median and 90 % quantile of the time [s].
    """
    kinds = (*KINDS, WALKED)
    tasks = [(seed, kind) for kind in kinds for seed in range(robots)]
    found: dict[str, list[dict[str, Any]]] = {kind: [] for kind in kinds}
    with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context("spawn"), _use_one_thread) as pool:
        for done, row in enumerate(pool.map(identify_robot, *zip(*tasks, strict=True)), 1):
            found[row["kind"]].append(row)
            progress(done / len(tasks))
    return [_summarise(kind, rows) for kind, rows in found.items()]


def measure_mistakes(robots: int, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Identify robots that are not what they are taken for, in as many processes as there are cores.

    Returns:
        A row for each kind of mistake: number of robots, how many are called doubtful [%], and of how many the cause is
        the first explanation [%], None if no explanation is known.
    """
    tasks = [(seed, kind) for kind in mistakes.KINDS for seed in range(robots)]
    found: dict[str, list[tuple[bool, bool | None]]] = {kind: [] for kind in mistakes.KINDS}
    with ProcessPoolExecutor(os.cpu_count(), multiprocessing.get_context("spawn"), _use_one_thread) as pool:
        for done, ((_, kind), row) in enumerate(
            zip(tasks, pool.map(_judge_mistake, *zip(*tasks, strict=True)), strict=True), 1
        ):
            found[kind].append(row)
            progress(done / len(tasks))
    return [
        {
            "case": "mistake",
            "mistake": kind,
            "robots": len(rows),
            "doubtful_percent": 100.0 * sum(doubtful for doubtful, _ in rows) / len(rows),
            "first_percent": None if rows[0][1] is None else 100.0 * sum(bool(first) for _, first in rows) / len(rows),
        }
        for kind, rows in found.items()
    ]


def _judge_mistake(seed: int, kind: str) -> tuple[bool, bool | None]:
    found, first = mistakes.identify_mistake(seed, kind)
    return not found.model_fits, first


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
