"""The verb `bench`: time against error of the methods, and the cost of the node and of replay."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crawler_model import CrawlerError

from .screen import READERS, progress_bar, require, screen

_IN_PROCESS = {
    "sweep": ("sweep", "measure_sweep", "VARIATIONS"),
    "gradients": ("gradients", "measure_gradients", "CONTACTS"),
    "growth": ("growth", "measure_growth", "SECONDS"),
    "springs": ("springs", "measure_springs", "CONTACTS"),
    "turning": ("turning", "measure_turning", "CONTACTS"),
    "search": ("search", "measure_search", "SECONDS"),
    "identify": ("identify", "measure_identification", "STEPS"),
    "gym": ("environments", "measure_environments", "STEPS"),
    "animate": ("films", "measure_films", "FRAMES"),
}
"""For each option the module, its function, and the full size; the quick one is QUICK."""


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
    springs: Annotated[
        bool, typer.Option("--springs", help="Measure instead what limits of tension, curves and stops cost a tick.")
    ] = False,
    turning: Annotated[
        bool, typer.Option("--turning", help="Measure bodies that turn instead, beside MuJoCo and kinematic-snake.")
    ] = False,
    search: Annotated[
        bool, typer.Option("--search", help="Measure the search for the best gait instead, beside general optimisers.")
    ] = False,
    identify: Annotated[
        bool,
        typer.Option(
            "--identify", help="Measure identification instead: beside MuJoCo's, and under imperfect cameras."
        ),
    ] = False,
    gym: Annotated[
        bool,
        typer.Option("--gym", help="Measure the Gymnasium environments instead: steps a second, beside MuJoCo's."),
    ] = False,
    animate: Annotated[
        bool, typer.Option("--animate", help="Measure films instead: frames per second, drawn and written.")
    ] = False,
) -> None:
    """Measure time against error of our methods and of their peers on this machine."""
    models = {"sweep": sweep, "gradients": gradients, "search": search, "identify": identify, "gym": gym}
    models |= {"animate": animate, "growth": growth, "springs": springs, "turning": turning}
    chosen = [name for name, is_chosen in ({"node": node, "replay": replay} | models).items() if is_chosen]
    if chosen:
        if case:
            raise CrawlerError(f"--case selects cases of the methods; it cannot be combined with --{chosen[0]}")
        if len(chosen) > 1:
            raise CrawlerError(f"--{chosen[0]} and --{chosen[1]} cannot be combined; run one after the other")
        measure = _bench_processes if chosen[0] in ("node", "replay") else _bench_model
        measure(chosen[0], quick, as_json, out)
        return
    _bench_methods(case or (), quick, as_json, out)


def _bench_methods(case: Sequence[str], quick: bool, as_json: bool, out: Path) -> None:
    """Measure time against error."""
    require("matplotlib")
    from crawler_bench.bench import choose_cases, missing_peers, run_bench
    from crawler_bench.figure import draw_case
    from crawler_bench.report import print_report

    names = choose_cases(case, quick)
    absent = missing_peers()
    _name_missing(dict.fromkeys(absent, "crawler-ros[bench]"))
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


def _name_missing(requirements: dict[str, str]) -> None:
    """Print which peers are left out, and by which requirement each is installed."""
    for requirement in dict.fromkeys(requirements.values()):
        names = ", ".join(name for name, needed in requirements.items() if needed == requirement)
        text = f"{names} not installed or not starting, and left out; install with: pip install '{requirement}'"
        print(f"crawler: {text}", file=sys.stderr)


def _bench_model(name: str, quick: bool, as_json: bool, out: Path) -> None:
    """Measure what runs many times in this process."""
    file, function, size = _IN_PROCESS[name]
    if name == "animate":
        require("matplotlib")
    module: Any = importlib.import_module(f"crawler_bench.features.{file}")
    if name in ("gym", "identify", "turning"):
        _name_missing(module.missing_peers())
    with progress_bar("measuring") as progress:
        rows = getattr(module, function)(module.QUICK if quick else getattr(module, size), progress)
    _write_rows(name, rows, quick, as_json, out)


def _bench_processes(name: str, quick: bool, as_json: bool, out: Path) -> None:
    """Measure the node or replays, which run in processes of their own."""
    require("rclpy", *READERS)
    from crawler_bench.node import node, replay

    if name == "node":
        with progress_bar("measuring") as show:
            rows, complete = node.measure_node(**(node.QUICK if quick else {}), progress=show)
        if rows:
            _write_rows(name, rows, quick, as_json, out)
        if not complete:
            raise KeyboardInterrupt
        return
    console = Console(stderr=True)
    with console.status("starting") if console.is_terminal else nullcontext() as status:
        rows = replay.measure_replay(**(replay.QUICK if quick else {}), progress=status.update if status else None)
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
