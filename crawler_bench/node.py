"""What the node costs: ticks a second, latency, late ticks, start-up, memory, and the price of each feature.

Real processes in a ROS domain of their own on loopback, started as a user starts them. Every variant of a comparison is
run once in each repetition, one after the other, so that the noise of the machine falls on all of them; a row holds the
median of the repetitions and their spread (largest less smallest).
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import platform
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from crawler_ros import interface
from crawler_ros.stepper import Stepper

Row = dict[str, Any]
NS = 10**9
TICK_HZ = 1000.0
PARTS = ("throughput", "latency", "real_time", "start", "ledger")
_PATIENCE_S = 120.0  # the first run on a machine compiles the kernels
_domains = (1 + (os.getpid() + n) % 100 for n in itertools.count())  # above 101 their ports meet others'
_OPTIONAL = ("contact_states", "pose", "applied_commands")
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


class Domain:
    """A ROS domain with a node of this process that listens to the simulator's diagnostics and sends commands."""

    def __init__(self, folder: Path) -> None:
        """Join a domain that nobody else is in.

        Args:
            folder: for logs and recordings.
        """
        import rclpy
        from rclpy.experimental.events_executor import EventsExecutor

        self.folder = folder
        self.number = next(_domains)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        interface.find_ament_prefix()
        self._context = rclpy.Context()
        self._context.init(domain_id=self.number)
        self.node = rclpy.create_node("bench", context=self._context)
        self.reports: list[tuple[int, dict[str, str]]] = []
        self._listen("/diagnostics", self._on_report)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        self._publishers: dict[str, Any] = {}
        self._count = itertools.count()

    def _spin(self) -> None:
        while not self._ended.is_set():
            self._executor.spin_once(timeout_sec=0.05)

    def _listen(self, name: str, receive: Callable[[Any], None]) -> Any:
        topic = interface.topics()[name]
        return self.node.create_subscription(
            interface.message_class(topic.type), name, receive, interface.qos_profile(topic)
        )

    def _on_report(self, message: Any) -> None:
        stamp = message.header.stamp.sec * NS + message.header.stamp.nanosec
        self.reports.append((stamp, {v.key: v.value for s in message.status for v in s.values}))

    @contextlib.contextmanager
    def hearing(self, name: str, receive: Callable[[Any], None]) -> Iterator[None]:
        """Listen to a topic for a while."""
        subscription = self._listen(name, receive)
        try:
            yield
        finally:
            self.node.destroy_subscription(subscription)

    def publisher(self, name: str) -> Any:
        """Make a publisher of a command topic, and wait until the simulator listens to it."""
        if name not in self._publishers:
            topic = interface.topics()[name]
            kind = interface.message_class(topic.type)
            self._publishers[name] = self.node.create_publisher(kind, name, interface.qos_profile(topic))
        publisher = self._publishers[name]
        wait_until(lambda: publisher.get_subscription_count() > 0)
        return publisher

    @contextlib.contextmanager
    def process(self, module: str, *arguments: str) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
        """Run a module of this project in the domain; gives the process and the file of what it says."""
        log = self.folder / f"{module}_{next(self._count)}.log"
        environment = {k: v for k, v in os.environ.items() if k != "ROS_LOCALHOST_ONLY"}
        environment |= {"ROS_DOMAIN_ID": str(self.number), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        with log.open("wb") as stream:
            command = [sys.executable, "-m", module, *arguments]
            process = subprocess.Popen(
                command, env=environment, stdout=stream, stderr=subprocess.STDOUT, start_new_session=True
            )
        try:
            yield process, log
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(30.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    @contextlib.contextmanager
    def simulator(self, scene: Path | str, **parameters: Any) -> Iterator[tuple[int, Path]]:
        """Run a simulator, recording into this folder where `record` is true; gives its process id and its log.

        Args:
            scene: file or gallery name.
            **parameters: of the node, a dot in a name written as it is.

        Yields:
            Process id and log, as soon as its diagnostics are heard.
        """
        values = {"scene": str(scene), "rate": TICK_HZ, "real_time_factor": 0.0, "method": "auto", **parameters}
        recording = self.folder / "bags"
        if values.pop("record", False):
            values["record"] = str(recording)
        words = [w for key, value in values.items() for w in ("-p", f"{key}:={json.dumps(value).strip(chr(34))}")]
        self.reports.clear()
        try:
            with self.process("crawler_ros.simulator", "--ros-args", *words) as (process, log):
                said = log.read_text
                if values.get("publish.diagnostics", True):
                    wait_until(lambda: self.reports or process.poll() is not None)
                else:
                    wait_until(lambda: "waiting for commands" in said() or process.poll() is not None)
                if process.poll() is not None:
                    raise RuntimeError(f"the simulator ended: {said()}")
                yield process.pid, log
        finally:
            shutil.rmtree(recording, ignore_errors=True)

    def rate(self, seconds: float) -> float:
        """Measure ticks a second over a while, from the diagnostics' stamps and counts of ticks.

        Args:
            seconds: how long, after a second of warm-up.

        Returns:
            Ticks a second.
        """
        first = len(self.reports) + 1  # what comes next may still be of the start
        wait_until(lambda: len(self.reports) > first)
        began, before = self.reports[first]
        wait_until(lambda: self.reports[-1][0] - began >= (seconds - 0.2) * NS)
        ended, after = self.reports[-1]
        return (int(after["ticks"]) - int(before["ticks"])) / ((ended - began) / NS)

    def close(self) -> None:
        """Leave the domain."""
        self._ended.set()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


def wait_until(condition: Callable[[], Any], seconds: float = _PATIENCE_S) -> None:
    """Wait for a condition.

    Args:
        condition: asked a hundred times a second.
        seconds: at most.

    Raises:
        TimeoutError: when it does not come true.
    """
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"nothing happened within {seconds} s")
        time.sleep(0.01)


def drive(domain: Domain, names: Sequence[str], rows: np.ndarray, spacing: float) -> None:
    """Send a long trajectory.

    Args:
        domain: where a simulator listens.
        names: of joints.
        rows: shape (points, names).
        spacing: simulated time from point to point [s].
    """
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    message = JointTrajectory(joint_names=list(names))
    for k, row in enumerate(rows):
        point = JointTrajectoryPoint(positions=row.tolist())
        ns = round(k * spacing * NS)
        point.time_from_start.sec, point.time_from_start.nanosec = ns // NS, ns % NS
        message.points.append(point)
    domain.publisher("joint_trajectory").publish(message)


def _wave(domain: Domain, contacts: int) -> None:
    """Drive a chain by a travelling wave of a second's period, for as long as a measurement can take."""
    samples, periods = (64, 300) if contacts <= 100 else (16, 40)
    time_in_period = np.arange(samples * periods)[:, None] / samples
    rows = 0.05 * np.sin(2.0 * np.pi * (time_in_period - np.arange(contacts - 1) / 5.0))
    drive(domain, [f"link_{i}" for i in range(contacts - 1)], rows, 1.0 / samples)


def _strokes(domain: Domain) -> None:
    rows = np.tile([[0.0], [0.2]], (300, 1))
    drive(domain, ["trunk"], rows, 0.5)


def _cpu_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _children(pid: int) -> list[int]:
    return [int(p) for task in Path(f"/proc/{pid}/task").iterdir() for p in (task / "children").read_text().split()]


def _memory_mb(pid: int) -> float:
    found = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    return int(found[1]) / 1024.0 if found else 0.0


def _summary(values: Sequence[float], name: str) -> Row:
    return {name: statistics.median(values), f"{name}_spread": max(values) - min(values)}


def measure_throughput(
    domain: Domain, contacts: Sequence[int], recording: Sequence[bool], seconds: float, repeats: int, say: Callable
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
                stack.enter_context(domain.process("crawler_bench.node", "--listen"))
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


def measure_latency(domain: Domain, contacts: int, rates: Sequence[float], trials: int, say: Callable) -> list[Row]:
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
                deadline = time.monotonic() + 5.0
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
    domain: Domain, contacts: Sequence[int], seconds: float, repeats: int, say: Callable
) -> list[Row]:
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
            (recorder,) = _children(pid)
            domain.rate(0.5)
            with domain.process("crawler_bench.node", "--idle", str(TICK_HZ), str(seconds + 1.0)) as (idle, log):
                before = int(domain.reports[-1][1]["late ticks"])
                began, used = time.perf_counter(), [_cpu_seconds(p) for p in (pid, recorder)]
                time.sleep(seconds)
                took = time.perf_counter() - began
                used = [_cpu_seconds(p) - u for p, u in zip((pid, recorder), used, strict=True)]
                count = len(domain.reports)
                wait_until(lambda: len(domain.reports) > count)  # noqa: B023
                late = int(domain.reports[-1][1]["late ticks"]) - before
                idle.wait(_PATIENCE_S)
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
    say: Callable,
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
            memory = sum(map(_memory_mb, [pid, *_children(pid)]))
        if silent:  # nothing tells how many ticks: the last words do
            counted = re.search(r"stopped after (\d+) ticks", log.read_text())
            rate = int(counted[1]) / (_said_at(log, "stopped after") - ready) if counted else float("nan")
        found[name].append((1e6 / rate, memory, ready - began))
    rows = []
    for name, (beside, *_) in variants.items():
        times, memory, starts = zip(*found[name], strict=True)
        extra = [t - other[0] for t, other in zip(times, found[beside], strict=True)]
        row = {"case": "ledger", "n": contacts, "feature": name, "beside": beside} | _summary(times, "us_per_tick")
        rows.append(row | _summary(extra, "extra_us") | _summary(memory, "memory_mb") | _summary(starts, "start_s"))
    return rows


def _said_at(log: Path, words: str) -> float:
    """Find when a simulator said something [s, wall]."""
    line = next(line for line in log.read_text().splitlines() if words in line)
    found = re.search(r"\[(\d+\.\d+)\]", line)
    assert found is not None
    return float(found[1])


def measure_start(domain: Domain, contacts: int, repeats: int, say: Callable) -> list[Row]:
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
        with domain.hearing("joint_states", lambda _, first=first: first.append(time.time())):
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


def describe_machine() -> Row:
    """Say on what it was measured.

    Returns:
        Processor, cores, load, versions.
    """
    with contextlib.suppress(OSError):
        names = re.findall(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
    return {
        "processor": names[0] if names else platform.processor(),
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "python": platform.python_version(),
        "numpy": np.__version__,
        "publication_mode": os.environ.get("RMW_FASTRTPS_PUBLICATION_MODE", "default"),
    }


def print_rows(rows: Sequence[Row]) -> None:
    """Print a table for each kind of row.

    Args:
        rows: from `measure_node`.
    """
    from rich.console import Console
    from rich.table import Table

    console = Console()
    for case, group in itertools.groupby(rows, key=lambda row: row["case"]):
        held = list(group)
        keys = [key for key in held[0] if key != "case" and not key.endswith("_spread")]
        table = Table(title=case.replace("_", " "))
        for key in keys:
            table.add_column(key.replace("_", " "), justify="right" if key != "feature" else "left")
        for row in held:
            table.add_row(*(_cell(row[key], row.get(f"{key}_spread")) for key in keys))
        console.print(table)


def _cell(value: Any, spread: float | None) -> str:
    if isinstance(value, bool):
        return "yes" if value else ""
    if not isinstance(value, float):
        return str(value)
    digits = 0 if abs(value) >= 1000 else 1 if abs(value) >= 10 else 3
    return f"{value:.{digits}f}" + (f" ± {spread / 2:.{digits}f}" if spread else "")


def _listen() -> None:
    """Subscribe to every topic of the simulator until SIGINT."""
    import rclpy
    from rclpy.experimental.events_executor import EventsExecutor
    from rclpy.signals import SignalHandlerOptions

    interface.find_ament_prefix()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    ended = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: ended.set())
    node = rclpy.create_node("listener")
    for name, topic in interface.topics().items():
        if topic.direction == "out":
            kind, qos = interface.message_class(topic.type), interface.qos_profile(topic)
            node.create_subscription(kind, name, lambda _: None, qos, raw=True)
    executor = EventsExecutor()
    executor.add_node(node)
    while not ended.is_set():
        executor.spin_once(timeout_sec=0.1)
    rclpy.try_shutdown()


def _idle(rate: float, seconds: float) -> None:
    """Keep a rate with nothing to do, as the simulator keeps it; print how many ticks were late."""
    stepper = Stepper(Fraction(rate))
    while stepper.tick < seconds * rate:
        wait = stepper.wait_ns(time.monotonic_ns())
        assert wait is not None
        if wait > 0:
            time.sleep(wait / NS)
        else:
            stepper.begin(time.monotonic_ns())
            stepper.finish()
    print(stepper.late)


def main() -> int:
    """Measure and report.

    Returns:
        The exit status.
    """
    parser = argparse.ArgumentParser(prog="crawler_bench.node", description="What the node costs.")
    parser.add_argument("--quick", action="store_true", help="few cases, one repetition")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    parser.add_argument("--out", type=Path, help="write the JSON to a file as well")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS, help="measure only these")
    parser.add_argument("--contacts", nargs="+", type=int, help="N of the chains")
    parser.add_argument("--repeats", type=int, help="repetitions")
    parser.add_argument("--listen", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--idle", nargs=2, type=float, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.listen:
        _listen()
        return 0
    if given.idle:
        _idle(*given.idle)
        return 0
    options: dict[str, Any] = {"parts": given.parts}
    if given.quick:
        options |= {"contacts": (3, 10), "rates": (100.0, 1000.0), "seconds": 1.0, "repeats": 1, "trials": 50}
    if given.contacts:
        options["contacts"] = given.contacts
    if given.repeats:
        options["repeats"] = given.repeats
    if sys.stderr.isatty():
        options["progress"] = lambda text: print(f"\r\x1b[K{text}", end="", file=sys.stderr, flush=True)
    machine = describe_machine()
    rows = measure_node(**options)
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr)
    text = json.dumps({"schema": 1, "machine": machine, "rows": rows}, indent=1)
    if given.out is not None:
        given.out.write_text(text + "\n", encoding="utf-8")
    if given.json:
        print(text)
    else:
        print_rows(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
