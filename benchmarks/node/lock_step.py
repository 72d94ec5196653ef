"""The cost of lock-step: round trips with a controller in another process, and ticks of a long trajectory."""

from __future__ import annotations

import json
import statistics

import numpy as np

from tests.processes import PATIENCE_S
from tests.scenes import write_chain

from .domain import Domain
from .drives import wave
from .rows import Row, summarise
from .steps import Steps

_COMPANIONS = "benchmarks.node.companions"
_WARM_UP = 0.2
"""Fraction of the round trips that is not counted: discovery, and caches that fill."""


def measure_lock_step(
    domain: Domain, contacts: int, trips: int, seconds: float, repeats: int, steps: Steps
) -> list[Row]:
    """Measure round trips a second with a controller, and ticks a second of a trajectory, in lock-step.

    Returns:
        Medians of the repetitions: a row for an echo, which bounds the round trips, one for the controller, and one for
        the trajectory.
    """
    scene = write_chain(domain.folder, contacts)
    times: dict[str, list[np.ndarray]] = {"echo": [], "round_trips": []}
    rates: list[float] = []
    with steps.keep():
        for _ in range(repeats):
            steps("an echo between two processes")
            with domain.process(_COMPANIONS, "echo", str(contacts - 1)):
                times["echo"].append(_control(domain, contacts, trips))
            steps("lock-step with a controller")
            with domain.simulator(scene, lock_step=True):
                times["round_trips"].append(_control(domain, contacts, trips))
            steps("lock-step with a trajectory")
            with domain.simulator(scene, lock_step=True):
                wave(domain, contacts)
                rates.append(domain.rate(seconds, driven=True))
    rows: list[Row] = [
        {
            "case": case,
            "n": contacts,
            "trips": trips,
            "trips_per_s": statistics.median(1e6 / float(us.mean()) for us in found),
            "median_ms": statistics.median(float(np.median(us)) for us in found) / 1e3,
            "p99_ms": statistics.median(float(np.quantile(us, 0.99)) for us in found) / 1e3,
        }
        for case, found in times.items()
        if found
    ]
    if rates:
        rows.append({"case": "lock_step", "n": contacts} | summarise(rates, "ticks_per_s"))
    return rows


def _control(domain: Domain, contacts: int, trips: int) -> np.ndarray:
    """Run the controller; return the times of its round trips without the first ones [us]."""
    with domain.process(_COMPANIONS, "control", str(contacts - 1), str(trips)) as (process, log):
        if process.wait(PATIENCE_S) != 0:
            raise RuntimeError(f"the controller ended: {log.read_text()}")
    times = np.array(json.loads(log.read_text().splitlines()[-1]))
    return times[int(_WARM_UP * times.size) :]
