"""The cost of lock-step: round trips with a controller in another process, and ticks of a long trajectory."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .domain import Domain
from .processes import PATIENCE_S

Row = dict[str, Any]
_WARM_UP = 0.2
"""Fraction of the round trips that is not counted: discovery, and caches that fill."""


def measure_lock_step(
    domain: Domain,
    scene: Path,
    contacts: int,
    trips: int,
    seconds: float,
    repeats: int,
    drive: Callable[[], None],
    report: Callable[[str], None],
) -> list[Row]:
    """Measure round trips a second with a controller, and ticks a second of a trajectory, in lock-step.

    Args:
        domain: domain of the processes.
        scene: a chain that waits for commands.
        contacts: number of its contacts N.
        trips: number of round trips.
        seconds: duration of the measurement of ticks [s].
        repeats: number of repetitions of both.
        drive: function that sends a trajectory that lasts long enough.
        report: function that reports the present measurement.

    Returns:
        A row for the controller and one for the trajectory, medians of the repetitions.
    """
    found: list[np.ndarray] = []
    rates: list[float] = []
    for _ in range(repeats):
        report("lock-step with a controller")
        with (
            domain.simulator(scene, lock_step=True),
            domain.process("crawler_bench.node.companions", "control", str(contacts - 1), str(trips)) as (process, log),
        ):
            if process.wait(PATIENCE_S) != 0:
                raise RuntimeError(f"the controller ended: {log.read_text()}")
            times = np.array(json.loads(log.read_text().splitlines()[-1]))
            found.append(times[int(_WARM_UP * times.size) :])
        report("lock-step with a trajectory")
        with domain.simulator(scene, lock_step=True):
            drive()
            rates.append(domain.rate(seconds))
    return [
        {
            "case": "round_trips",
            "n": contacts,
            "trips": trips,
            "trips_per_s": statistics.median(1e6 / float(times.mean()) for times in found),
            "median_ms": statistics.median(float(np.median(times)) for times in found) / 1e3,
            "p99_ms": statistics.median(float(np.quantile(times, 0.99)) for times in found) / 1e3,
        },
        {"case": "lock_step", "n": contacts, "ticks_per_s": statistics.median(rates)},
    ]
