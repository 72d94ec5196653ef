"""`python -m benchmarks` in a checkout: speed against error, or the cost of one part of the project."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crawler_command.screen import READERS, progress_bar, require, screen
from crawler_model import CrawlerError

_IN_PROCESS = {
    "calls": ("measure_calls", "CALLS"),
    "growth": ("measure_growth", "SECONDS"),
    "identify": ("measure_identification", "STEPS"),
    "inertia": ("measure_inertia", "BODIES"),
    "many": ("measure_many", "VARIATIONS"),
    "mistakes": ("measure_mistakes", "ROBOTS"),
}
"""For each module the function, and the full size; the quick one is QUICK."""


class What(str, Enum):
    """What is measured."""

    methods = "methods"
    calls = "calls"
    growth = "growth"
    identify = "identify"
    inertia = "inertia"
    many = "many"
    mistakes = "mistakes"
    node = "node"
    plan = "plan"
    replay = "replay"


def bench(
    what: Annotated[
        What,
        typer.Argument(
            help="methods: speed against error; calls: what users call, beside peers; "
            "growth: of the time of a ramp with the body; identify: coverage; "
            "inertia: how far masses change the gain; many: variations and environments; "
            "mistakes: how often wrong models are explained; "
            "node: throughput, latency, cost of features; plan: controllers of disturbed robots; replay: of recordings."
        ),
    ] = What.methods,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer ticks, rounds and sizes: under a minute.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for the JSON file and a picture of each case.")] = Path("bench"),
    case: Annotated[list[str] | None, typer.Option(help="Measure only this case; the option may be repeated.")] = None,
) -> None:
    """Measure our methods and their peers on this machine."""
    if what is What.methods:
        _bench_methods(case or (), quick, as_json, out)
        return
    if case:
        raise CrawlerError(f"--case selects cases of the methods; it cannot be combined with {what.value}")
    measure = _bench_model if what.value in _IN_PROCESS else _bench_processes
    measure(what.value, quick, as_json, out)


def _bench_methods(case: Sequence[str], quick: bool, as_json: bool, out: Path) -> None:
    """Measure time against error."""
    require("matplotlib")
    from .bench import choose_cases, missing_peers, run_bench
    from .figure import draw_case
    from .report import print_report

    names = choose_cases(case, quick)
    _name_missing(dict.fromkeys(missing_peers(), "crawler-ros[bench]"))
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
    screen.print(f"written: {out / 'speed_against_error.json'} and a picture of each case next to it")


def _name_missing(requirements: dict[str, str]) -> None:
    """Print which peers are left out, and by which requirement each is installed."""
    for requirement in dict.fromkeys(requirements.values()):
        names = ", ".join(name for name, needed in requirements.items() if needed == requirement)
        text = f"{names} not installed or not starting, and left out; install with: pip install '{requirement}'"
        print(f"benchmarks: {text}", file=sys.stderr)


def _bench_model(name: str, quick: bool, as_json: bool, out: Path) -> None:
    """Measure what runs many times in this process."""
    function, size = _IN_PROCESS[name]
    module: Any = importlib.import_module(f"benchmarks.{name}")
    if name == "identify":
        _name_missing(module.missing_peers())
    with progress_bar("measuring") as progress:
        rows = getattr(module, function)(module.QUICK if quick else getattr(module, size), progress)
    _write_rows(name, rows, quick, as_json, out)
    if name == "inertia":
        require("matplotlib")
        module.draw_inertia(rows, out / f"{name}.png")


def _bench_processes(name: str, quick: bool, as_json: bool, out: Path) -> None:
    """Measure the node or replays, which run in processes of their own."""
    require("rclpy", *READERS)
    from .node import node, replay

    if name == "node":
        with progress_bar("measuring") as show:
            rows, complete = node.measure_node(**(node.QUICK if quick else {}), progress=show)
        if rows:
            _write_rows(name, rows, quick, as_json, out)
        if not complete:
            raise KeyboardInterrupt
        return
    from . import plan

    console = Console(stderr=True)
    measure, few = (plan.measure_plan, plan.QUICK) if name == "plan" else (replay.measure_replay, replay.QUICK)
    with console.status("starting") if console.is_terminal else nullcontext() as status:
        rows = measure(**(few if quick else {}), progress=status.update if status else None)
    _write_rows(name, rows, quick, as_json, out)


def _write_rows(name: str, rows: list[dict[str, Any]], quick: bool, as_json: bool, out: Path) -> None:
    from .bench import describe_machine
    from .report import print_rows

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


app = typer.Typer(pretty_exceptions_enable=False)
app.command()(bench)


def main() -> None:
    """Run the measurement; an expected error is one line."""
    try:
        app()
    except CrawlerError as error:
        sys.exit(f"benchmarks: {error}")
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
