"""The cost of the node: ticks per second, latency, late ticks and start-up.

Real processes run in a ROS domain of their own on loopback, started as a user starts them. Each repetition runs every
variant of a comparison once, so that the noise of the machine affects all of them; a row holds the median of the
repetitions and their spread (largest minus smallest).
"""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.processes import PATIENCE_S, children, cpu_seconds, wait_until
from tests.scenes import write_chain

from .domain import TICK_HZ, Domain
from .lock_step import measure_lock_step
from .rows import Row, summarise
from .steps import Steps
from .throughput import measure_throughput, throughput_variants

PARTS = ("throughput", "latency", "lock_step", "real_time", "start")
QUICK: Row = {
    "contacts": (10,),
    "rates": (1000.0,),
    "seconds": 1.0,
    "repeats": 1,
    "trials": 50,
    "quick": True,
}
"""The settings of a quick run."""


def measure_latency(domain: Domain, contacts: int, rates: Sequence[float], trials: int, steps: Steps) -> list[Row]:
    """Measure the time between sending a command and receiving the first state that shows it, between two processes.

    The simulator runs in real time; a command waits for the end of the next tick, half a period on average.

    Returns:
        The rows.
    """
    from std_msgs.msg import Float64MultiArray

    rows = []
    pauses = np.random.default_rng(0).uniform(0.002, 0.006, trials)
    with steps.keep():
        for rate in rates:
            steps(f"latency at {rate:g} Hz")
            arrived: dict[float, int] = {}

            def receive(message: Any, arrived: dict[float, int] = arrived) -> None:
                arrived.setdefault(message.effort[1], time.perf_counter_ns())

            with (
                domain.simulator(write_chain(domain.folder, contacts), rate=rate, real_time_factor=1.0),
                domain.hearing("joint_states", receive),
            ):
                publisher = domain.publisher("actuation_controller/commands")
                wait_until(lambda: arrived)  # noqa: B023
                latencies = []
                for k, pause in enumerate(pauses):
                    time.sleep(pause)
                    length = 1e-3 * (1.0 + k / trials)  # far too little to slide
                    tension = -10.0 * length
                    sent = time.perf_counter_ns()
                    publisher.publish(Float64MultiArray(data=[length] + [0.0] * (contacts - 2)))
                    deadline = time.monotonic() + PATIENCE_S
                    while not any(abs(t - tension) < 1e-9 for t in list(arrived)[-3:]) and time.monotonic() < deadline:
                        time.sleep(0.0002)
                    answers = [at for t, at in list(arrived.items())[-3:] if abs(t - tension) < 1e-9]
                    latencies += [(at - sent) / 1e6 for at in answers]
            rows.append(
                {
                    "case": "latency",
                    "n": contacts,
                    "rate_hz": rate,
                    "trials": len(latencies),
                    "median_ms": float(np.median(latencies)),
                    "p99_ms": float(np.quantile(latencies, 0.99)),
                    "half_a_period_ms": 500.0 / rate,
                }
            )
    return rows


def measure_real_time(domain: Domain, contacts: Sequence[int], seconds: float, repeats: int, steps: Steps) -> list[Row]:
    """Measure late ticks and processor time in real time at 1 kHz, recorded; an empty loop at that rate for comparison.

    Returns:
        The rows.
    """
    keys = ("late_ticks", "late_ticks_of_an_empty_loop", "core_simulator", "core_recorder")
    found: dict[int, dict[str, list[float]]] = {n: {key: [] for key in keys} for n in contacts}
    with steps.keep():
        for _, n in itertools.product(range(repeats), contacts):
            steps(f"real time N={n}")
            with domain.simulator(write_chain(domain.folder, n), real_time_factor=1.0, record=True) as (pid, _):
                (recorder,) = children(pid)
                domain.rate(0.5)
                with domain.process("benchmarks.node.companions", "idle", str(TICK_HZ), str(seconds + 1.0)) as (
                    idle,
                    log,
                ):
                    before = int(domain.reports[-1][1]["late ticks"])
                    began, used = time.perf_counter(), [cpu_seconds(p) for p in (pid, recorder)]
                    time.sleep(seconds)
                    took = time.perf_counter() - began
                    used = [cpu_seconds(p) - u for p, u in zip((pid, recorder), used, strict=True)]
                    count = len(domain.reports)
                    wait_until(lambda: len(domain.reports) > count)  # noqa: B023
                    late = int(domain.reports[-1][1]["late ticks"]) - before
                    idle.wait(PATIENCE_S)
                    empty = int(log.read_text().split()[-1])
            for key, value in zip(keys, (late, empty, used[0] / took, used[1] / took), strict=True):
                found[n][key].append(value)
    rows = []
    for n, values in found.items():
        if not values[keys[-1]]:
            continue
        row: Row = {"case": "real_time", "n": n, "rate_hz": TICK_HZ, "ticks": int(seconds * TICK_HZ)}
        for key in keys:
            row |= summarise(values[key], key)
        rows.append(row)
    return rows


def _logged_at(log: Path, words: str) -> float:
    """Find when a simulator logged some words [s, wall]."""
    line = next(line for line in log.read_text().splitlines() if words in line)
    found = re.search(r"\[(\d+\.\d+)\]", line)
    assert found is not None
    return float(found[1])


def measure_start(domain: Domain, contacts: int, repeats: int, steps: Steps) -> list[Row]:
    """Measure the start of the node, to its readiness and to the first state in another process, and `crawler --help`.

    Returns:
        One row; the time of the first state includes the discovery between the two processes.
    """
    found: dict[str, list[float]] = {}
    with steps.keep():
        for repetition in range(repeats + 1):
            steps("start-up")
            first: list[float] = []

            def hear(_: Any, first: list[float] = first) -> None:
                first.append(time.time())

            with domain.hearing("joint_states", hear):
                began = time.time()
                with domain.simulator(write_chain(domain.folder, contacts), real_time_factor=1.0) as (pid, log):
                    wait_until(lambda: first)  # noqa: B023
                    measured = {"ready_cpu_s": cpu_seconds(pid), "first_state_s": first[0] - began}
                    measured["ready_s"] = _logged_at(log, "waiting for commands") - began
            measured["help_s"], measured["help_cpu_s"] = _run_help()
            for name, value in measured.items() if repetition else ():
                found.setdefault(name, []).append(value)
    row: Row = {"case": "start", "n": contacts}
    for name, values in found.items():
        row |= summarise(values, name)
    return [row] if found else []


def _run_help() -> tuple[float, float]:
    """Run `crawler --help`; return its duration and processor time [s]."""
    code = "from crawler_command.executables import crawler; raise SystemExit(crawler())"
    began = time.perf_counter()
    process = subprocess.Popen([sys.executable, "-c", code, "--help"], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise RuntimeError(f"crawler --help: exit status {process.returncode}")
    return time.perf_counter() - began, used.ru_utime + used.ru_stime


def measure_node(
    contacts: Sequence[int] = (10, 1000),
    rates: Sequence[float] = (100.0, 500.0, 1000.0, 2000.0),
    seconds: float = 2.0,
    repeats: int = 2,
    trials: int = 300,
    quick: bool = False,
    parts: Sequence[str] = PARTS,
    progress: Callable[[float, str], None] | None = None,
) -> tuple[list[Row], bool]:
    """Measure the node on generated chains, in a ROS domain of its own on loopback; Ctrl-C ends it early.

    Returns:
        Rows of plain numbers and text, and whether they are complete: after Ctrl-C, they hold what was measured before.
    """
    one = 10 if 10 in contacts else contacts[0]
    rows: list[Row] = []
    variants, ends = throughput_variants(contacts, quick), sorted({one, contacts[-1]})
    with tempfile.TemporaryDirectory(prefix="benchmarks_") as folder:
        domain = Domain(Path(folder))
        sizes = {
            "throughput": len(variants) * repeats,
            "latency": len(rates),
            "lock_step": 3 * repeats,
            "real_time": len(ends) * repeats,
            "start": repeats + 1,
        }
        steps = Steps(sum(sizes[part] for part in parts), progress or (lambda *_: None))
        measures: dict[str, Callable[[], list[Row]]] = {
            "throughput": lambda: measure_throughput(domain, variants, seconds, repeats, steps),
            "latency": lambda: measure_latency(domain, one, rates, trials, steps),
            "lock_step": lambda: measure_lock_step(domain, one, 10 * trials, seconds, repeats, steps),
            "real_time": lambda: measure_real_time(domain, ends, 3.0 * seconds, repeats, steps),
            "start": lambda: measure_start(domain, one, repeats, steps),
        }
        try:
            with steps.keep():
                for part in PARTS:
                    if part in parts:
                        rows += measures[part]()
        finally:
            domain.close()
    return rows, not steps.interrupted
