"""The cost of the node: ticks per second, latency, late ticks, start-up, memory, and the cost of each feature.

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

from .domain import TICK_HZ, Domain
from .drives import strokes, wave, write_chain, write_segment
from .lock_step import measure_lock_step
from .processes import PATIENCE_S, children, cpu_seconds, memory_mb, wait_until
from .rows import Row, summarise
from .steps import Steps
from .throughput import measure_throughput, throughput_variants
from .turning import measure_turning

Feature = tuple[str, Path, dict[str, Any], Callable[[], None] | None]
PARTS = ("throughput", "latency", "lock_step", "real_time", "turning", "start", "ledger")
QUICK: Row = {
    "contacts": (10,),
    "rates": (1000.0,),
    "seconds": 1.0,
    "repeats": 1,
    "trials": 50,
    "quick": True,
    "features": ("recording",),
}
"""The settings of a quick run."""
_OPTIONAL = ("contact_states", "pose", "odom", "applied_commands", "robot_description")
_MINIMAL = {f"publish.{name}": False for name in _OPTIONAL}


def measure_latency(domain: Domain, contacts: int, rates: Sequence[float], trials: int, steps: Steps) -> list[Row]:
    """Measure the time between sending a command and receiving the first state that shows it, between two processes.

    The simulator runs in real time; a command waits for the end of the next tick, half a period on average.

    Args:
        domain: domain of the processes.
        contacts: number of contacts N.
        rates: rates of the ticks [Hz].
        trials: number of commands at each rate.
        steps: the progress.

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
    """Measure late ticks and processor time in real time at 1 kHz, recorded, beside an empty loop at the same rate.

    Args:
        domain: domain of the processes.
        contacts: numbers of contacts N of the chains.
        seconds: duration of a measurement [s].
        repeats: number of repetitions.
        steps: the progress.

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
                with domain.process("crawler_bench.node.companions", "idle", str(TICK_HZ), str(seconds + 1.0)) as (
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


def choose_features(domain: Domain, contacts: int, features: Sequence[str] | None) -> dict[str, Feature]:
    """Write the scenes of the features and choose some of them, along with those that they are compared with.

    Args:
        domain: domain of the processes.
        contacts: number of contacts N.
        features: names of features; None for all.

    Returns:
        What each feature is compared with, its scene, its parameters, and what drives it, by name.
    """
    chain = write_chain(domain.folder, contacts)
    base = "nothing optional"
    # name: compared with, scene, parameters, driver
    variants: dict[str, Feature] = {base: (base, chain, dict(_MINIMAL), None)}
    for name in _OPTIONAL:
        variants[name] = (base, chain, _MINIMAL | {f"publish.{name}": True}, None)
    variants["/diagnostics off"] = (base, chain, _MINIMAL | {"publish.diagnostics": False}, None)
    variants["/clock"] = (base, chain, _MINIMAL | {"publish_clock": True}, None)
    variants["recording"] = (base, chain, _MINIMAL | {"record": True}, None)
    variants["view to a file"] = (base, chain, _MINIMAL | {"view": str(domain.folder / "view.rrd")}, None)
    variants["driven, exact"] = (base, chain, dict(_MINIMAL), lambda: wave(domain, contacts))
    variants["driven, catch_up"] = (
        "driven, exact",
        chain,
        _MINIMAL | {"method": "catch_up"},
        lambda: wave(domain, contacts),
    )
    coarse = "segment, accuracy 0.01"
    for accuracy in (1e-2, 1e-3, 1e-4, 1e-5):
        scene = write_segment(domain.folder, accuracy)
        variants[f"segment, accuracy {accuracy:g}"] = (coarse, scene, dict(_MINIMAL), lambda: strokes(domain))

    if features is None:
        return variants
    wanted = {*features, *(variants[name][0] for name in features)}
    return {name: variant for name, variant in variants.items() if name in wanted}


def measure_ledger(
    domain: Domain, contacts: int, variants: dict[str, Feature], seconds: float, repeats: int, steps: Steps
) -> list[Row]:
    """Measure the cost of each feature when only it is switched on: time per tick, memory, start-up.

    Args:
        domain: domain of the processes.
        contacts: number of contacts N.
        variants: from `choose_features`.
        seconds: duration of a measurement [s].
        repeats: number of repetitions.
        steps: the progress.

    Returns:
        The rows; `extra_us` is the time per tick beyond that of the row's `beside`.
    """
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in variants}
    with steps.keep():
        for _, (name, (_, scene, parameters, driver)) in itertools.product(range(repeats), variants.items()):
            steps(f"ledger: {name}")
            (domain.folder / "view.rrd").unlink(missing_ok=True)
            began = time.time()
            with domain.simulator(scene, **parameters) as (pid, log):
                ready = _logged_at(log, "waiting for commands")
                if driver is not None:
                    driver()
                silent = not parameters.get("publish.diagnostics", True)
                if silent:
                    time.sleep(seconds + 1.5)
                else:
                    rate = domain.rate(seconds, driven=driver is not None)
                memory = sum(map(memory_mb, [pid, *children(pid)]))
            if silent:  # without diagnostics, the last line of the log has the number of ticks
                counted = re.search(r"stopped after (\d+) ticks", log.read_text())
                rate = int(counted[1]) / (_logged_at(log, "stopped after") - ready) if counted else float("nan")
            found[name].append((1e6 / rate, memory, ready - began))
    rows = []
    for name, (beside, *_) in variants.items():
        if not (found[name] and found[beside]):
            continue
        times, memories, starts = zip(*found[name], strict=True)
        extra = [t - other[0] for t, other in zip(times, found[beside], strict=False)]
        row = {"case": "ledger", "n": contacts, "feature": name, "beside": beside} | summarise(times, "us_per_tick")
        rows.append(
            row | summarise(extra, "extra_us") | summarise(memories, "memory_mb") | summarise(starts, "start_s")
        )
    return rows


def _logged_at(log: Path, words: str) -> float:
    """Find when a simulator logged some words [s, wall]."""
    line = next(line for line in log.read_text().splitlines() if words in line)
    found = re.search(r"\[(\d+\.\d+)\]", line)
    assert found is not None
    return float(found[1])


def measure_start(domain: Domain, contacts: int, repeats: int, steps: Steps) -> list[Row]:
    """Measure the start of the node, to its readiness and to the first state in another process, and `crawler --help`.

    Args:
        domain: domain of the processes.
        contacts: number of contacts N.
        repeats: number of repetitions; one more warms the caches.
        steps: the progress.

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
    features: Sequence[str] | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> tuple[list[Row], bool]:
    """Measure the node on generated chains, in a ROS domain of its own on loopback; Ctrl-C ends it early.

    Args:
        contacts: numbers of contacts N of the chains for throughput; the other parts use 10 (or the first) and the
            largest.
        rates: rates of the ticks for the latency [Hz].
        seconds: duration of one measurement [s].
        repeats: number of repetitions of all measurements but the latency.
        trials: number of commands for the latency at each rate; in lock-step ten times as many.
        quick: whether to leave out the throughput while the crawler holds its shape.
        parts: the parts to measure, out of PARTS.
        features: features of the ledger; None for all.
        progress: function that shows the fraction done and the name of the present measurement.

    Returns:
        Rows of plain numbers and text, and whether they are complete: after Ctrl-C, they hold what was measured before.
    """
    one = 10 if 10 in contacts else contacts[0]
    rows: list[Row] = []
    variants, ends = throughput_variants(contacts, quick), sorted({one, contacts[-1]})
    with tempfile.TemporaryDirectory(prefix="crawler_bench_") as folder:
        domain = Domain(Path(folder))
        compared = choose_features(domain, one, features)
        sizes = {
            "throughput": len(variants) * repeats,
            "latency": len(rates),
            "lock_step": 3 * repeats,
            "real_time": len(ends) * repeats,
            "turning": repeats,
            "start": repeats + 1,
            "ledger": len(compared) * repeats,
        }
        steps = Steps(sum(sizes[part] for part in parts), progress or (lambda *_: None))
        measures: dict[str, Callable[[], list[Row]]] = {
            "throughput": lambda: measure_throughput(domain, variants, seconds, repeats, steps),
            "latency": lambda: measure_latency(domain, one, rates, trials, steps),
            "lock_step": lambda: measure_lock_step(domain, one, 10 * trials, seconds, repeats, steps),
            "real_time": lambda: measure_real_time(domain, ends, 3.0 * seconds, repeats, steps),
            "turning": lambda: measure_turning(domain, min(contacts[-1], 30), 3.0 * seconds, repeats, steps),
            "start": lambda: measure_start(domain, one, repeats, steps),
            "ledger": lambda: measure_ledger(domain, one, compared, seconds, repeats, steps),
        }
        try:
            with steps.keep():
                for part in PARTS:
                    if part in parts:
                        rows += measures[part]()
        finally:
            domain.close()
    return rows, not steps.interrupted
