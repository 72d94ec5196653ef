"""The verb `bench`: time against error of the methods, and the cost of the node and of replay."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crawler_model import CrawlerError

from .screen import progress_bar, screen


def bench(
    quick: Annotated[bool, typer.Option("--quick", help="Fewer ticks, rounds and sizes: under a minute.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for the JSON file and a picture of each case.")] = Path("bench"),
    case: Annotated[list[str] | None, typer.Option(help="Measure only this case; the option may be repeated.")] = None,
    node: Annotated[
        bool, typer.Option("--node", help="Measure the ROS 2 node instead: throughput, latency, cost of each feature.")
    ] = False,
    replay: Annotated[
        bool,
        typer.Option(
            "--replay", help="Measure reading, analysing and exporting recordings of up to three hours instead."
        ),
    ] = False,
    sweep: Annotated[
        bool, typer.Option("--sweep", help="Measure runs of many variations instead: rate, part of time in kernels.")
    ] = False,
    gradients: Annotated[
        bool, typer.Option("--gradients", help="Measure exact derivatives instead: cost and error beside differences.")
    ] = False,
    growth: Annotated[
        bool, typer.Option("--growth", help="Measure instead how the time of a ramp grows with the body.")
    ] = False,
    search: Annotated[
        bool, typer.Option("--search", help="Measure the search for the best gait instead, beside general optimisers.")
    ] = False,
) -> None:
    """Measure time against error of our methods and of their peers on this machine."""
    instead = {"node": node, "replay": replay, "sweep": sweep, "gradients": gradients, "growth": growth}
    instead["search"] = search
    chosen = [name for name, is_chosen in instead.items() if is_chosen]
    if chosen:
        if case:
            raise CrawlerError(f"--case selects cases of the methods; it cannot be combined with --{chosen[0]}")
        if len(chosen) > 1:
            raise CrawlerError(f"--{chosen[0]} and --{chosen[1]} cannot be combined; run one after the other")
        if chosen[0] in ("node", "replay"):
            _bench_processes(chosen[0], quick, as_json, out)
        else:
            _bench_model(chosen[0], quick, as_json, out)
        return
    import matplotlib as _required_later  # noqa: F401

    from crawler_bench.bench import choose_cases, missing_peers, run_bench
    from crawler_bench.figure import draw_case
    from crawler_bench.report import print_report

    names = choose_cases(case or (), quick)
    absent = missing_peers()
    if absent:
        text = f"{', '.join(absent)} not installed and left out; install with: pip install 'crawler-ros[bench]'"
        print(f"crawler: {text}", file=sys.stderr)
    out.mkdir(parents=True, exist_ok=True)
    with progress_bar("measuring") as progress:
        measured = run_bench(names, quick, progress)
    text = json.dumps(measured.document(), allow_nan=False)
    (out / "speed_against_error.json").write_text(text.replace('}, {"case"', '},\n{"case"') + "\n", encoding="utf-8")
    for name in names:
        draw_case(measured, name, out / f"{name}.png")
    if as_json:
        print(text)
        return
    print_report(measured, screen)
    screen.print(f"written: {out / 'speed_against_error.json'} and a picture of each case beside it")


def _bench_model(name: str, quick: bool, as_json: bool, out: Path) -> None:
    """Measure what runs many times in this process: variations, derivatives, long chains, or the search for a gait."""
    measure: Callable[[Any, Callable[[float], None]], list[dict[str, Any]]]
    size: Any
    if name == "sweep":
        from crawler_bench import sweep

        measure, size = sweep.measure_sweep, sweep.QUICK if quick else sweep.VARIATIONS
    elif name == "gradients":
        from crawler_bench import gradients

        measure, size = gradients.measure_gradients, gradients.QUICK if quick else gradients.CONTACTS
    elif name == "growth":
        from crawler_bench import growth

        measure, size = growth.measure_growth, growth.QUICK if quick else growth.CONTACTS
    else:
        from crawler_bench import search

        measure, size = search.measure_search, search.QUICK if quick else search.SECONDS
    with progress_bar("measuring") as progress:
        rows = measure(size, progress)
    _write_rows(name, rows, quick, as_json, out)


def _bench_processes(name: str, quick: bool, as_json: bool, out: Path) -> None:
    """Measure the node or replays, which run in processes of their own."""
    import rclpy as _needed  # noqa: F401

    from crawler_bench.node import node, replay

    console = Console(stderr=True)
    with console.status("starting") if console.is_terminal else nullcontext() as status:
        progress = status.update if status else None
        if name == "node":
            rows = node.measure_node(**(node.QUICK if quick else {}), progress=progress)
        else:
            rows = replay.measure_replay(**(replay.QUICK if quick else {}), progress=progress)
    _write_rows(name, rows, quick, as_json, out)


def _write_rows(name: str, rows: list[dict[str, Any]], quick: bool, as_json: bool, out: Path) -> None:
    from crawler_bench.bench import describe_machine
    from crawler_bench.report import print_rows

    out.mkdir(parents=True, exist_ok=True)
    document = {"schema": 1, "machine": describe_machine(quick)}
    text = json.dumps({**document, "rows": rows}, allow_nan=False, indent=1)
    file = out / f"{name}.json"
    file.write_text(text + "\n", encoding="utf-8")
    if as_json:
        print(text)
        return
    print_rows(rows, screen)
    screen.print(f"written: {file}")
