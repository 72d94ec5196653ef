"""The cost of reading, analysing and exporting a recording, compared with libraries that only read it."""

from __future__ import annotations

import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from crawler_model import load_scene
from tests.processes import peak_memory_mb

from .domain import Domain

Row = dict[str, Any]
QUICK: dict[str, Any] = {"periods": (60,), "repeats": 1}
SCENE = "three_contacts_one_way"
_PEERS_UP_TO = 2_000_000
"""Number of messages beyond which only our jobs are measured: the time of the others is proportional."""
_REPLAY = "-m crawler_command.app replay {bag}"
JOBS = {
    "replay": _REPLAY,
    "replay, JSON, Parquet and page": _REPLAY + " --json --parquet {out}/tables --png {out}/page.png",
    "mcap reads": "-m benchmarks.node.readers mcap {bag}",
    "rosbags reads and deserialises": "-m benchmarks.node.readers rosbags {bag}",
}
"""The jobs, each run as a process; `replay` simulates everything again, the readers count messages."""


def measure_replay(
    periods: Sequence[int] = (250, 2_700, 10_800),
    repeats: int = 3,
    progress: Callable[[str], None] | None = None,
) -> list[Row]:
    """Record runs with the real nodes and replay them.

    Returns:
        A row for each recording and job: medians of the time [s] and rate [1/s], peak memory [MiB].
    """
    report = progress or (lambda _: None)
    rows: list[Row] = []
    load_scene(SCENE)
    with tempfile.TemporaryDirectory(prefix="benchmarks_") as folder:
        domain = Domain(Path(folder))
        try:
            bags = []
            for count in periods:
                report(f"recording {count} periods")
                bags.append(record_run(domain, count))
        finally:
            domain.close()
        for bag, count in zip(bags, periods, strict=True):
            rows += _measure_bag(bag, count, repeats, report)
    return rows


def record_run(domain: Domain, periods: int) -> Path:
    """Record a run in lock-step.

    Returns:
        The bag folder.
    """
    parent = domain.folder / f"run_{periods}"
    words = ["--ros-args", "-p", f"scene:={SCENE}"]
    simulator = ("crawler_ros.node.simulator", *words, "-p", "lock_step:=true", "-p", f"record:={parent}")
    player = ("crawler_ros.node.gait_player", *words, "-p", f"periods:={periods}")
    with domain.process(*simulator), domain.process(*player) as (process, log):
        if process.wait() != 0:
            raise RuntimeError(f"the gait player ended: {log.read_text()}")
    (bag,) = parent.iterdir()
    return bag


def _measure_bag(bag: Path, periods: int, repeats: int, report: Callable[[str], None]) -> list[Row]:
    messages = _count(bag)
    names = [name for name in JOBS if messages <= _PEERS_UP_TO or "replay" in name]
    seconds: dict[str, list[float]] = {name: [] for name in names}
    memory: dict[str, float] = dict.fromkeys(names, 0.0)
    for _ in range(repeats if messages < 1_000_000 else 1):
        for name in random.sample(names, len(names)):
            report(f"{messages} messages: {name}")
            took, peak = run_job(JOBS[name], bag)
            seconds[name].append(took)
            memory[name] = max(memory[name], peak)
    return [
        {
            "case": "replay",
            "messages": messages,
            "simulated_s": float(periods),
            "what": name,
            "seconds": statistics.median(seconds[name]),
            "seconds_spread": max(seconds[name]) - min(seconds[name]),
            "messages_per_s": messages / statistics.median(seconds[name]),
            "memory_mb": memory[name],
        }
        for name in names
    ]


def _count(bag: Path) -> int:
    from mcap.reader import make_reader

    with next(bag.glob("*.mcap")).open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    return summary.statistics.message_count


def run_job(words: str, bag: Path) -> tuple[float, float]:
    """Run a job as a process of its own.

    Returns:
        Its duration [s] and peak memory [MiB].
    """
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, *(word.format(bag=bag, out=out) for word in words.split())]
        began, peak = time.perf_counter(), 0.0
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        while process.poll() is None:  # polled: the usage reported at its end includes this process before the exec
            peak = max(peak, peak_memory_mb(process.pid))
            time.sleep(0.01)
        took = time.perf_counter() - began
        if process.returncode != 0:
            raise RuntimeError(f"{words}: exit status {process.returncode}")
    return took, peak
