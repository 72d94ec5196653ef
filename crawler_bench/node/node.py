"""The cost of the node: ticks per second, latency, late ticks, start-up, memory, and the cost of each feature.

Real processes run in a ROS domain of their own on loopback, started as a user starts them. Each repetition runs every
variant of a comparison once, so that the noise of the machine affects all of them; a row holds the median of the
repetitions and their spread (largest minus smallest).
"""

from __future__ import annotations

import contextlib
import itertools
import re
import statistics
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

Row = dict[str, Any]
Report = Callable[[str], None]
PARTS = ("throughput", "latency", "lock_step", "real_time", "start", "ledger")
QUICK: Row = {"contacts": (3, 10), "rates": (100.0, 1000.0), "seconds": 1.0, "repeats": 1, "trials": 50}
"""The settings of a quick run."""
_OPTIONAL = ("contact_states", "pose", "odom", "applied_commands", "robot_description")
_EVERY = 10
"""The ticks between states in the rows with fewer states."""
_MINIMAL = {f"publish.{name}": False for name in _OPTIONAL}


def _summary(values: Sequence[float], name: str) -> Row:
    return {name: statistics.median(values), f"{name}_spread": max(values) - min(values)}


def measure_throughput(
    domain: Domain, contacts: Sequence[int], recording: Sequence[bool], seconds: float, repeats: int, report: Report
) -> list[Row]:
    """Measure the largest number of ticks per second: held and driven, recorded or not, with and without a subscriber.

    Without a subscriber and driven it is also measured with states at every tenth tick.

    Args:
        domain: domain of the processes.
        contacts: numbers of contacts N of the chains.
        recording: off, on or both.
        seconds: duration of a measurement [s].
        repeats: number of repetitions.
        report: function that reports the present measurement.

    Returns:
        The rows.
    """
    variants = list(itertools.product(contacts, recording, (False, True), (False, True), (1,)))
    variants += [(n, record, False, True, _EVERY) for n, record in itertools.product(contacts, recording)]
    found: dict[Any, list[float]] = {variant: [] for variant in variants}
    for _, variant in itertools.product(range(repeats), variants):
        n, record, subscribed, driven, every = variant
        what = " recorded" * record + " subscribed" * subscribed + " driven" * driven
        report(f"throughput N={n}{what}, states at every {every}. tick")
        with contextlib.ExitStack() as stack:
            if subscribed:
                stack.enter_context(domain.process("crawler_bench.node.companions", "listen"))
            stack.enter_context(
                domain.simulator(write_chain(domain.folder, n), record=record, **{"publish.every": every})
            )
            if driven:
                wave(domain, n)
            if subscribed:
                time.sleep(1.5)  # until it has discovered all topics
            found[variant].append(domain.rate(seconds))
    rows = []
    for (n, record, subscribed, driven, every), rates in found.items():
        row = {"case": "throughput", "n": n, "recording": record, "subscriber": subscribed, "driven": driven}
        row["every"] = every
        row |= _summary(rates, "ticks_per_s") | _summary([1e6 / r for r in rates], "us_per_tick")
        rows.append(row | {"real_time": row["ticks_per_s"] / TICK_HZ})
    return rows


def measure_latency(domain: Domain, contacts: int, rates: Sequence[float], trials: int, report: Report) -> list[Row]:
    """Measure the time between sending a command and receiving the first state that shows it, between two processes.

    The simulator runs in real time; a command waits for the end of the next tick, half a period on average.

    Args:
        domain: domain of the processes.
        contacts: number of contacts N.
        rates: rates of the ticks [Hz].
        trials: number of commands at each rate.
        report: function that reports the present measurement.

    Returns:
        The rows.
    """
    from std_msgs.msg import Float64MultiArray

    rows = []
    pauses = np.random.default_rng(0).uniform(0.002, 0.006, trials)
    for rate in rates:
        report(f"latency at {rate:g} Hz")
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


def measure_real_time(
    domain: Domain, contacts: Sequence[int], seconds: float, repeats: int, report: Report
) -> list[Row]:
    """Measure late ticks and processor time in real time at 1 kHz, recorded, beside an empty loop at the same rate.

    Args:
        domain: domain of the processes.
        contacts: numbers of contacts N of the chains.
        seconds: duration of a measurement [s].
        repeats: number of repetitions.
        report: function that reports the present measurement.

    Returns:
        The rows.
    """
    keys = ("late_ticks", "late_ticks_of_an_empty_loop", "core_simulator", "core_recorder")
    found: dict[int, dict[str, list[float]]] = {n: {key: [] for key in keys} for n in contacts}
    for _, n in itertools.product(range(repeats), contacts):
        report(f"real time N={n}")
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
        row: Row = {"case": "real_time", "n": n, "rate_hz": TICK_HZ, "ticks": int(seconds * TICK_HZ)}
        for key in keys:
            row |= _summary(values[key], key)
        rows.append(row)
    return rows


def measure_ledger(
    domain: Domain,
    contacts: int,
    seconds: float,
    repeats: int,
    report: Report,
    features: Sequence[str] | None = None,
) -> list[Row]:
    """Measure the cost of each feature when only it is switched on: time per tick, memory, start-up.

    Args:
        domain: domain of the processes.
        contacts: number of contacts N.
        seconds: duration of a measurement [s].
        repeats: number of repetitions.
        report: function that reports the present measurement.
        features: the features to measure, along with those they are compared with; None for all.

    Returns:
        The rows; `extra_us` is the time per tick beyond that of the row's `beside`.
    """
    chain = write_chain(domain.folder, contacts)
    base = "nothing optional"
    # name: compared with, scene, parameters, driver
    variants: dict[str, tuple[str, Path, dict[str, Any], Callable[[], None] | None]] = {
        base: (base, chain, dict(_MINIMAL), None)
    }
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

    if features is not None:
        wanted = {*features, *(variants[name][0] for name in features)}
        variants = {name: variant for name, variant in variants.items() if name in wanted}
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in variants}
    for _, (name, (_, scene, parameters, driver)) in itertools.product(range(repeats), variants.items()):
        report(f"ledger: {name}")
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
                rate = domain.rate(seconds)
            memory = sum(map(memory_mb, [pid, *children(pid)]))
        if silent:  # without diagnostics, the last line of the log has the number of ticks
            counted = re.search(r"stopped after (\d+) ticks", log.read_text())
            rate = int(counted[1]) / (_logged_at(log, "stopped after") - ready) if counted else float("nan")
        found[name].append((1e6 / rate, memory, ready - began))
    rows = []
    for name, (beside, *_) in variants.items():
        times, memories, starts = zip(*found[name], strict=True)
        extra = [t - other[0] for t, other in zip(times, found[beside], strict=True)]
        row = {"case": "ledger", "n": contacts, "feature": name, "beside": beside} | _summary(times, "us_per_tick")
        rows.append(row | _summary(extra, "extra_us") | _summary(memories, "memory_mb") | _summary(starts, "start_s"))
    return rows


def _logged_at(log: Path, words: str) -> float:
    """Find when a simulator logged some words [s, wall]."""
    line = next(line for line in log.read_text().splitlines() if words in line)
    found = re.search(r"\[(\d+\.\d+)\]", line)
    assert found is not None
    return float(found[1])


def measure_start(domain: Domain, contacts: int, repeats: int, report: Report) -> list[Row]:
    """Measure the time from the start of the process to its readiness and to the first state in another process.

    Args:
        domain: domain of the processes.
        contacts: number of contacts N.
        repeats: number of repetitions; one more warms the caches.
        report: function that reports the present measurement.

    Returns:
        One row; the second time includes the discovery between the two processes.
    """
    ready, heard = [], []
    for _ in range(repeats + 1):
        report("start-up")
        first: list[float] = []

        def hear(_: Any, first: list[float] = first) -> None:
            first.append(time.time())

        with domain.hearing("joint_states", hear):
            began = time.time()
            with domain.simulator(write_chain(domain.folder, contacts), real_time_factor=1.0) as (_, log):
                wait_until(lambda: first)  # noqa: B023
                ready.append(_logged_at(log, "waiting for commands") - began)
                heard.append(first[0] - began)
    return [{"case": "start", "n": contacts} | _summary(ready[1:], "ready_s") | _summary(heard[1:], "first_state_s")]


def measure_node(
    contacts: Sequence[int] = (3, 10, 100, 1000),
    rates: Sequence[float] = (100.0, 500.0, 1000.0, 2000.0),
    recording: Sequence[bool] = (False, True),
    seconds: float = 3.0,
    repeats: int = 3,
    trials: int = 300,
    parts: Sequence[str] = PARTS,
    features: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> list[Row]:
    """Measure the node on generated chains, in a ROS domain of its own on loopback.

    Args:
        contacts: numbers of contacts N of the chains for throughput; the other parts use 10 (or the first) and the
            largest.
        rates: rates of the ticks for the latency [Hz].
        recording: off, on or both, for throughput.
        seconds: duration of one measurement [s].
        repeats: number of repetitions of all measurements but the latency.
        trials: number of commands for the latency at each rate; in lock-step ten times as many.
        parts: the parts to measure, out of PARTS.
        features: features of the ledger; None for all.
        progress: function that reports the present measurement.

    Returns:
        Rows of plain numbers and text.
    """
    report = progress or (lambda _: None)
    one = 10 if 10 in contacts else contacts[0]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory(prefix="crawler_bench_") as folder:
        domain = Domain(Path(folder))
        try:
            if "throughput" in parts:
                rows += measure_throughput(domain, contacts, recording, seconds, repeats, report)
            if "latency" in parts:
                rows += measure_latency(domain, one, rates, trials, report)
            if "lock_step" in parts:
                scene, trips = write_chain(domain.folder, one), 10 * trials
                rows += measure_lock_step(
                    domain, scene, one, trips, seconds, repeats, lambda: wave(domain, one), report
                )
            if "real_time" in parts:
                rows += measure_real_time(domain, sorted({one, contacts[-1]}), 3.0 * seconds, repeats, report)
            if "start" in parts:
                rows += measure_start(domain, one, repeats, report)
            if "ledger" in parts:
                rows += measure_ledger(domain, one, seconds, repeats, report, features)
        finally:
            domain.close()
    return rows
