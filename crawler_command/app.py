"""The `crawler` command: thin verbs over the model, the nodes and the recordings."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from crawler_model import CrawlerError, Scene, Trajectory, gallery, load_scene, prepare, simulate

from .executables import STOPPED, describe_missing
from .replay import compare, replay

app = typer.Typer(
    help="Exact soft crawlers in ROS 2. Start with `crawler demo`; `crawler scenes` lists what can be run.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_UsageError: Any = typer.BadParameter.__base__  # click's, or typer's own copy of it
screen = Console(highlight=False, soft_wrap=not sys.stdout.isatty(), width=None if sys.stdout.isatty() else 160)
SceneArgument = Annotated[str, typer.Argument(help="A scene file, or a name that `crawler scenes` lists.")]


_MISSED = 1e-6
"""An energy residual above this part of the work is no rounding."""


class MethodName(str, Enum):
    """How a tick is integrated."""

    auto = "auto"
    exact = "exact"
    catch_up = "catch_up"


DurationOption = Annotated[
    float | None, typer.Option(help="Seconds; by default ten periods, or up to the last waypoint.")
]
MethodOption = Annotated[
    MethodName, typer.Option(help="How a tick is integrated; auto is exact on a line, catch_up in the plane.")
]


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on a terminal and nothing in a pipe.

    Args:
        what: the bar's label.

    Yields:
        A function that takes the part done, in [0, 1].
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda part: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda part: bar.update(task, completed=part)


def _run(scene: Scene, duration: float | None, rate: float, method: str | None) -> Trajectory:
    prepare(scene)
    with progress_bar("simulating") as progress:
        return simulate(scene, duration, rate, method, progress)  # type: ignore[arg-type]


@app.command("simulate")
def simulate_command(
    scene: SceneArgument,
    duration: DurationOption = None,
    rate: Annotated[float, typer.Option(help="Ticks per second, Hz.")] = 100.0,
    method: MethodOption = MethodName.auto,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
) -> None:
    """Run a scene offline, without ROS, and print where it went.

    In the JSON, displacement is that of the isolated contacts, then of both ends of each segment; events counts linear
    pieces, ticks included; energy.residual is relative to the work.
    """
    loaded = load_scene(scene)
    if loaded.drive.holds and duration is None:
        raise CrawlerError(f"{scene}: the scene has no drive; say how long to run with --duration")
    run = _run(loaded, duration, rate, None if method is MethodName.auto else method.value)
    if as_json:
        print(json.dumps(run.summary(), allow_nan=False))
        return
    table = Table(title=f"{run.scene.name}: {run.method}, {run.ticks} ticks at {rate:g} Hz", title_justify="left")
    periods = run.per_period.size > 0
    table.add_column(r"time \[s]", justify="right")
    table.add_column(r"net translation \[m]", justify="right")
    table.add_column(r"gained in the period \[m]" if periods else r"gained \[m]", justify="right")
    from crawler_pictures.numbers import write_length

    y = run.waypoint_net_translation
    size = float(abs(run.displacement).max()) + float(abs(run.scene.drive.actuation).max())
    count = y.shape[0]
    rows = range(count) if count <= 24 else [*range(12), *range(count - 11, count)]
    last = -1
    for i in rows:
        if i != last + 1:
            table.add_row("...", "...", "...")
        last = i
        gained = "" if i == 0 else write_length(y[i] - y[i - 1], size)
        table.add_row(f"{run.waypoint_time[i]:g}", write_length(y[i], size), gained)
    if run.time[-1] > run.waypoint_time[-1]:
        table.add_row(f"{run.time[-1]:g}", write_length(run.net_translation[-1], size), "")
    screen.print(table)
    _print_account(run)


def _print_account(run: Trajectory) -> None:
    energy = run.energy
    screen.print(
        f"work {energy.work:.6g} J, dissipation {energy.dissipation:.6g} J, stored {energy.stored:.6g} J, "
        f"residual {energy.relative_residual:.1e} of the work"
    )
    screen.print(f"largest excess over a bound {run.violation:.1e} N; {run.events} linear pieces in {run.wall_s:.3g} s")
    if run.method == "catch_up" and run.scene.body.dimension == 1 and energy.relative_residual > _MISSED:
        screen.print(
            "[yellow]catch_up missed events:[/] the residual shows the size of its error; take exact, or a higher rate"
        )
    if not run.unique:
        screen.print(
            "[yellow]not unique:[/] on some stretch the translation was not determined; "
            "the one nearest to zero was taken"
        )
    if run.overspent:
        screen.print(f"[yellow]{run.overspent} ramp(s)[/] had too many events; a catch-up step did their rest")
    if run.unsolved:
        screen.print(
            f"[yellow]{run.unsolved} ramp(s)[/] not solved: the active set gave up; see the excess over a bound"
        )


@app.command()
def check(
    scene: SceneArgument,
    png: Annotated[Path | None, typer.Option(help="Draw the stasis domain into this file.")] = None,
) -> None:
    """Validate a scene; print its stasis domain, where it lets the body go, its margins and what does not move."""
    _check_picture(png)
    from .check import print_report

    loaded = load_scene(scene)
    run = _run(loaded, None if not loaded.drive.holds else 0.0, 100.0, None)
    print_report(run, screen)
    if png is not None:
        from crawler_pictures.domain import draw_domain

        draw_domain(run.scene, png)
        screen.print(f"drawn: {png}")


def _check_picture(png: Path | None) -> None:
    if png is not None and png.suffix != ".png":
        raise CrawlerError(f"--png: {png} must end in .png")
    if png is not None and not png.absolute().parent.is_dir():
        raise CrawlerError(f"--png: the folder {png.absolute().parent} does not exist")


@app.command()
def scenes(
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON object, name to description.")] = False,
) -> None:
    """List the gallery, a line each."""
    listed = gallery()
    if as_json:
        print(json.dumps(listed))
        return
    width = max(map(len, listed))
    for name, text in listed.items():
        print(f"{name:<{width}}  {text}")


@app.command()
def sweep(
    scene: SceneArgument,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="KEY=FROM:TO:N",
            help="A number of the scene by its dotted key, and what it takes: FROM:TO:N, log:FROM:TO:N or A,B,C. "
            "Given several times: every combination.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="The table to write, .parquet; it must not be there already.")],
    duration: DurationOption = None,
    rate: Annotated[float, typer.Option(help="Ticks per second, Hz; exact needs none.")] = 100.0,
    method: MethodOption = MethodName.auto,
    workers: Annotated[int | None, typer.Option(help="Runs at a time; by default one a core.", min=1)] = None,
    png: Annotated[
        Path | None, typer.Option(help="The picture, for one or two keys; by default beside the table.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Run on the workers of this Dask scheduler.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace table and picture that are there.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of lines.")] = False,
) -> None:
    """Run thousands of variations of a scene over all cores; write a table and a picture.

    crawler sweep ten_contact_wave --vary friction.forward=0.1:1:50 --vary body.links.stiffness=10,20 --out f.parquet

    A key is the way to a number in the scene file: friction.forward, drive.wave.amplitude, body.links.stiffness.0 (the
    first link). A row holds the numbers varied, the net translation in the last period, energies, and whether the
    answer is unique; invalid variations say why. Ctrl-C keeps what is done.
    """
    from crawler_model.sweep.many import Settings

    from . import sweep as sweeps

    settings = Settings(duration, rate, None if method is MethodName.auto else method.value)  # type: ignore[arg-type]
    plan = sweeps.plan_sweep(load_scene(scene), vary, settings, out, png, overwrite)
    with progress_bar("sweeping") as progress:
        runs = sweeps.run_sweep(plan, workers, scheduler, progress)
    print(json.dumps(sweeps.summarise(plan, runs)) if as_json else "\n".join(sweeps.describe_sweep(plan, runs)))
    if runs.interrupted:
        raise typer.Exit(130)


@app.command()
def view(
    recording: Annotated[
        Path, typer.Argument(help="A bag folder, .mcap or .rrd file; of a folder of bags the newest.")
    ],
    png: Annotated[Path | None, typer.Option(help="Render into this file instead of opening a window.")] = None,
    at: Annotated[
        float | None, typer.Option(help="With --png: the simulated time to show, s; by default the end.")
    ] = None,
) -> None:
    """Open rerun on a recording with our blueprint, or render that view without a screen.

    --png needs a Vulkan driver: on Debian and Ubuntu, apt install mesa-vulkan-drivers.
    """
    import os
    import subprocess
    import tempfile

    from crawler_ros.viewer.page import screenshot, viewer_binary

    if not recording.exists():
        raise CrawlerError(f"{recording}: no such file or folder")
    if recording.is_dir():
        from crawler_ros.recording.bag import newest

        recording = newest(recording)
    if recording.suffix == ".rrd" and recording.read_bytes()[:3] != b"RRF":
        raise CrawlerError(f"{recording}: not a rerun recording")
    if at is not None and png is None:
        raise CrawlerError("--at goes with --png: it is the time that is rendered")
    _check_picture(png)
    if png is None and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise CrawlerError(
            "there is no display here; render the view with --png FILE, or copy the .rrd to your desktop"
        )
    with tempfile.TemporaryDirectory() as folder:
        rrd = recording
        if recording.suffix != ".rrd":
            from crawler_ros.viewer.visualizer import draw_recording

            rrd = Path(folder) / "recording.rrd"
            draw_recording(recording, rrd)
        if png is not None:
            screenshot(rrd, png, at)
            screen.print(f"rendered: {png}")
            return
        raise typer.Exit(subprocess.call([viewer_binary(), "--bind", "127.0.0.1", str(rrd)]))


app.command("replay")(replay)
app.command("compare")(compare)


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder in which recording, .rrd and .png are left.")] = Path("demo"),
) -> None:
    """Watch a three-contact crawler walk: two ROS 2 processes, a recording, a picture, a summary."""
    from .demo import run_demo

    with progress_bar("walking") as progress:
        summary = run_demo(out, progress)
    print("\n".join(summary))


@app.command()
def bench(
    quick: Annotated[bool, typer.Option("--quick", help="Fewer ticks, rounds and sizes: under a minute.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for the JSON file and a picture of each case.")] = Path("bench"),
    case: Annotated[list[str] | None, typer.Option(help="Only this case; may be given several times.")] = None,
    node: Annotated[
        bool, typer.Option("--node", help="Instead: what the ROS 2 node costs; throughput, latency, each feature.")
    ] = False,
    replay: Annotated[
        bool, typer.Option("--replay", help="Instead: reading, analysing and exporting recordings, up to three hours.")
    ] = False,
) -> None:
    """Measure time against error of our methods and of their peers, side by side, on this machine."""
    if node or replay:
        if case:
            raise CrawlerError("--case goes with the methods; --node and --replay measure something else")
        if node and replay:
            raise CrawlerError("--node and --replay: one at a time")
        _bench_processes("node" if node else "replay", quick, as_json, out)
        return
    import matplotlib as _needed_at_the_end  # noqa: F401

    from crawler_bench.bench import choose_cases, missing_peers, run_bench
    from crawler_bench.figure import draw_case
    from crawler_bench.report import print_report

    names = choose_cases(case or (), quick)
    absent = missing_peers()
    if absent:
        text = f"{', '.join(absent)} not installed, left out; they come with: pip install 'crawler-ros[bench]'"
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


def _bench_processes(name: str, quick: bool, as_json: bool, out: Path) -> None:
    """Measure what runs in processes of its own: the node, or replays."""
    import rclpy as _needed  # noqa: F401

    from crawler_bench.bench import describe_machine
    from crawler_bench.node import node, replay
    from crawler_bench.report import print_rows

    out.mkdir(parents=True, exist_ok=True)
    console = Console(stderr=True)
    document = {"schema": 1, "machine": describe_machine(quick)}
    with console.status("starting") if console.is_terminal else nullcontext() as status:
        progress = status.update if status else None
        if name == "node":
            rows = node.measure_node(**(node.QUICK if quick else {}), progress=progress)
        else:
            rows = replay.measure_replay(**(replay.QUICK if quick else {}), progress=progress)
    text = json.dumps({**document, "rows": rows}, allow_nan=False, indent=1)
    file = out / f"{name}.json"
    file.write_text(text + "\n", encoding="utf-8")
    if as_json:
        print(text)
        return
    print_rows(rows, screen)
    screen.print(f"written: {file}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; every expected error is one line on standard error.

    Args:
        arguments: the verb and what follows; None for the process's own.
    """
    try:
        status = app(arguments, prog_name="crawler", standalone_mode=False)
    except typer.Exit as error:
        status = error.exit_code
    except _UsageError as error:
        verb = f" {error.ctx.info_name}" if error.ctx is not None and error.ctx.parent is not None else ""
        text = " ".join(error.format_message().split())
        if "No such command" in text and "Did you mean" not in text:
            text += f" There are {', '.join(sorted(error.ctx.command.list_commands(error.ctx)))}."
        print(f"crawler: {text} (see crawler{verb} --help)", file=sys.stderr)
        status = 2
    except (CrawlerError, OSError) as error:
        print(f"crawler: {' '.join(str(error).split())}", file=sys.stderr)
        status = 1
    except ModuleNotFoundError as error:
        print(f"crawler: {describe_missing(error)}", file=sys.stderr)
        status = 1
    except (KeyboardInterrupt, typer.Abort):
        status = STOPPED
    if status == STOPPED:  # typer's answer to Ctrl-C, too
        print("crawler: stopped", file=sys.stderr)
    sys.exit(status or 0)


if __name__ == "__main__":
    main()
