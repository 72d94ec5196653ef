"""What the node costs: ticks a second, latency, late ticks, start-up, memory, and the price of each feature.

Real processes in a ROS domain of their own on loopback, started as a user starts them. Every variant of a comparison is
run once in each repetition, one after the other, so that the noise of the machine falls on all of them; a row holds the
median of the repetitions and their spread (largest less smallest).
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
import yaml

from .domain import TICK_HZ, Domain, drive
from .processes import PATIENCE_S, children, cpu_seconds, memory_mb, wait_until

Row = dict[str, Any]
Say = Callable[[str], None]
PARTS = ("throughput", "latency", "real_time", "start", "ledger")
QUICK: Row = {"contacts": (3, 10), "rates": (100.0, 1000.0), "seconds": 1.0, "repeats": 1, "trials": 50}
"""What a quick run measures."""
_OPTIONAL = ("contact_states", "pose", "odom", "applied_commands", "robot_description")
_NOTHING = {f"publish.{name}": False for name in _OPTIONAL}


def write_chain(folder: Path, contacts: int) -> Path:
    """Write the scene of a chain that waits for commands.

    Args:
        folder: where to.
        contacts: N.

    Returns:
        The file.
    """
    scene = {
        "name": f"chain_{contacts}",
        "body": {"contacts": [round(0.1 * i, 6) for i in range(contacts)], "links": {"stiffness": 10.0}},
        "friction": {"forward": 0.2, "backward": 0.5},
    }
    path = folder / f"chain_{contacts}.yaml"
    path.write_text(yaml.safe_dump(scene), encoding="utf-8")
    return path


def write_segment(folder: Path, accuracy: float) -> Path:
    """Write the gallery's continuous segment with another accuracy.

    Args:
        folder: where to.
        accuracy: of the scene's segment.

    Returns:
        The file.
    """
    from crawler_model import load_scene

    scene = load_scene("continuous_segment").document()
    scene["body"]["segments"][0]["accuracy"] = accuracy
    path = folder / f"segment_{accuracy:g}.yaml"
    path.write_text(yaml.safe_dump(scene), encoding="utf-8")
    return path


def _wave(domain: Domain, contacts: int) -> None:
    """Drive a chain by a travelling wave of a second's period, for as long as a measurement can take."""
    samples, periods = (64, 300) if contacts <= 100 else (16, 40)
    time_in_period = np.arange(samples * periods)[:, None] / samples
    rows = 0.05 * np.sin(2.0 * np.pi * (time_in_period - np.arange(contacts - 1) / 5.0))
    drive(domain, [f"link_{i}" for i in range(contacts - 1)], rows, 1.0 / samples)


def _strokes(domain: Domain) -> None:
    rows = np.tile([[0.0], [0.2]], (300, 1))
    drive(domain, ["trunk"], rows, 0.5)


def _summary(values: Sequence[float], name: str) -> Row:
    return {name: statistics.median(values), f"{name}_spread": max(values) - min(values)}


def measure_throughput(
    domain: Domain, contacts: Sequence[int], recording: Sequence[bool], seconds: float, repeats: int, say: Say
) -> list[Row]:
    """Measure ticks a second as fast as possible: held and driven, recorded or not, with and without a subscriber.

    Args:
        domain: where to.
        contacts: N of the chains.
        recording: off, on or both.
        seconds: of a measurement.
        repeats: repetitions.
        say: told what is measured.

    Returns:
        A row each.
    """
    variants = list(itertools.product(contacts, recording, (False, True), (False, True)))
    found: dict[Any, list[float]] = {variant: [] for variant in variants}
    for _, variant in itertools.product(range(repeats), variants):
        n, record, subscribed, driven = variant
        say(f"throughput N={n}" + " recorded" * record + " subscribed" * subscribed + " driven" * driven)
        with contextlib.ExitStack() as stack:
            if subscribed:
                stack.enter_context(domain.process("crawler_bench.node.companions", "listen"))
            stack.enter_context(domain.simulator(write_chain(domain.folder, n), record=record))
            if driven:
                _wave(domain, n)
            if subscribed:
                time.sleep(1.5)  # until it has found all topics
            found[variant].append(domain.rate(seconds))
    rows = []
    for (n, record, subscribed, driven), rates in found.items():
        row = {"case": "throughput", "n": n, "recording": record, "subscriber": subscribed, "driven": driven}
        row |= _summary(rates, "ticks_per_s") | _summary([1e6 / r for r in rates], "us_per_tick")
        rows.append(row | {"real_time": row["ticks_per_s"] / TICK_HZ})
    return rows


def measure_latency(
    domain: Domain, contacts: int, rates: Sequence[float], trials: int, say: Callable[[str], None]
) -> list[Row]:
    """Measure from the sending of a command to the arrival of the state that shows it, between two processes.

    The simulator runs at real time; a command waits for the tick that follows it to end, half a period on average.

    Args:
        domain: where to.
        contacts: N.
        rates: of the ticks [Hz].
        trials: commands at each rate.
        say: told what is measured.

    Returns:
        A row each.
    """
    from std_msgs.msg import Float64MultiArray

    rows = []
    pauses = np.random.default_rng(0).uniform(0.002, 0.006, trials)
    for rate in rates:
        say(f"latency at {rate:g} Hz")
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


def measure_real_time(domain: Domain, contacts: Sequence[int], seconds: float, repeats: int, say: Say) -> list[Row]:
    """Measure late ticks and processor time at real time and 1 kHz, recorded, beside an empty loop at the same rate.

    Args:
        domain: where to.
        contacts: N of the chains.
        seconds: of a measurement.
        repeats: repetitions.
        say: told what is measured.

    Returns:
        A row each.
    """
    keys = ("late_ticks", "late_ticks_of_an_empty_loop", "core_simulator", "core_recorder")
    found: dict[int, dict[str, list[float]]] = {n: {key: [] for key in keys} for n in contacts}
    for _, n in itertools.product(range(repeats), contacts):
        say(f"real time N={n}")
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
    say: Say,
    features: Sequence[str] | None = None,
) -> list[Row]:
    """Measure what each feature costs when it alone is switched on: time a tick, memory, start-up.

    Args:
        domain: where to.
        contacts: N.
        seconds: of a measurement.
        repeats: repetitions.
        say: told what is measured.
        features: which of them, beside what they are compared with; None for all.

    Returns:
        A row each; `extra_us` is the time a tick beyond that of the row's `beside`.
    """
    chain, wave, strokes = (
        write_chain(domain.folder, contacts),
        lambda: _wave(domain, contacts),
        lambda: _strokes(domain),
    )
    base = "nothing optional"
    # name: beside what, scene, parameters, what drives it
    variants: dict[str, tuple[str, Path, dict[str, Any], Callable[[], None] | None]] = {
        base: (base, chain, dict(_NOTHING), None)
    }
    for name in _OPTIONAL:
        variants[name] = (base, chain, _NOTHING | {f"publish.{name}": True}, None)
    variants["/diagnostics off"] = (base, chain, _NOTHING | {"publish.diagnostics": False}, None)
    variants["/clock"] = (base, chain, _NOTHING | {"publish_clock": True}, None)
    variants["recording"] = (base, chain, _NOTHING | {"record": True}, None)
    variants["view to a file"] = (base, chain, _NOTHING | {"view": str(domain.folder / "view.rrd")}, None)
    variants["driven, exact"] = (base, chain, dict(_NOTHING), wave)
    variants["driven, catch_up"] = ("driven, exact", chain, _NOTHING | {"method": "catch_up"}, wave)
    coarse = "segment, accuracy 0.01"
    for accuracy in (1e-2, 1e-3, 1e-4, 1e-5):
        scene = write_segment(domain.folder, accuracy)
        variants[f"segment, accuracy {accuracy:g}"] = (coarse, scene, dict(_NOTHING), strokes)

    if features is not None:
        wanted = {*features, *(variants[name][0] for name in features)}
        variants = {name: variant for name, variant in variants.items() if name in wanted}
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in variants}
    for _, (name, (_, scene, parameters, driver)) in itertools.product(range(repeats), variants.items()):
        say(f"ledger: {name}")
        (domain.folder / "view.rrd").unlink(missing_ok=True)
        began = time.time()
        with domain.simulator(scene, **parameters) as (pid, log):
            ready = _said_at(log, "waiting for commands")
            if driver is not None:
                driver()
            silent = not parameters.get("publish.diagnostics", True)
            if silent:
                time.sleep(seconds + 1.5)
            else:
                rate = domain.rate(seconds)
            memory = sum(map(memory_mb, [pid, *children(pid)]))
        if silent:  # nothing tells how many ticks: the last words do
            counted = re.search(r"stopped after (\d+) ticks", log.read_text())
            rate = int(counted[1]) / (_said_at(log, "stopped after") - ready) if counted else float("nan")
        found[name].append((1e6 / rate, memory, ready - began))
    rows = []
    for name, (beside, *_) in variants.items():
        times, memories, starts = zip(*found[name], strict=True)
        extra = [t - other[0] for t, other in zip(times, found[beside], strict=True)]
        row = {"case": "ledger", "n": contacts, "feature": name, "beside": beside} | _summary(times, "us_per_tick")
        rows.append(row | _summary(extra, "extra_us") | _summary(memories, "memory_mb") | _summary(starts, "start_s"))
    return rows


def _said_at(log: Path, words: str) -> float:
    """Find when a simulator said something [s, wall]."""
    line = next(line for line in log.read_text().splitlines() if words in line)
    found = re.search(r"\[(\d+\.\d+)\]", line)
    assert found is not None
    return float(found[1])


def measure_start(domain: Domain, contacts: int, repeats: int, say: Say) -> list[Row]:
    """Measure from the start of the process to its readiness and to the first state that another process hears.

    Args:
        domain: where to.
        contacts: N.
        repeats: repetitions; one more warms the caches.
        say: told what is measured.

    Returns:
        One row; the second figure holds the discovery between the two processes.
    """
    ready, heard = [], []
    for _ in range(repeats + 1):
        say("start-up")
        first: list[float] = []

        def hear(_: Any, first: list[float] = first) -> None:
            first.append(time.time())

        with domain.hearing("joint_states", hear):
            began = time.time()
            with domain.simulator(write_chain(domain.folder, contacts), real_time_factor=1.0) as (_, log):
                wait_until(lambda: first)  # noqa: B023
                ready.append(_said_at(log, "waiting for commands") - began)
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
        contacts: N of the chains for throughput; the other parts take 10 (or the first) and the largest.
        rates: of the ticks for the latency [Hz].
        recording: off, on or both, for throughput.
        seconds: of one measurement.
        repeats: repetitions of everything but the latency.
        trials: commands for the latency at each rate.
        parts: of PARTS.
        features: of the ledger; None for all.
        progress: told what is measured.

    Returns:
        Rows of plain numbers and words.
    """
    say = progress or (lambda _: None)
    one = 10 if 10 in contacts else contacts[0]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory(prefix="crawler_bench_") as folder:
        domain = Domain(Path(folder))
        try:
            if "throughput" in parts:
                rows += measure_throughput(domain, contacts, recording, seconds, repeats, say)
            if "latency" in parts:
                rows += measure_latency(domain, one, rates, trials, say)
            if "real_time" in parts:
                rows += measure_real_time(domain, sorted({one, contacts[-1]}), 3.0 * seconds, repeats, say)
            if "start" in parts:
                rows += measure_start(domain, one, repeats, say)
            if "ledger" in parts:
                rows += measure_ledger(domain, one, seconds, repeats, say, features)
        finally:
            domain.close()
    return rows
