"""The verb `simulate`: a scene run offline, without ROS."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Column, Table

from crawler_model import CrawlerError
from crawler_model.run.ticks import DEFAULT_RATE
from crawler_model.theory.uniqueness import UNDETERMINED
from crawler_pictures.numbers import error_of, write_length, write_size

from .pages import takes_page
from .screen import (
    PICTURES,
    DurationOption,
    ForceOption,
    MethodName,
    MethodOption,
    SceneArgument,
    TwoColumnsOption,
    check_output,
    named_errors,
    progress_bar,
    screen,
    whole_file,
)

if TYPE_CHECKING:
    from crawler_model import Energy, Scene, Trajectory

_MISSED = 1e-6
"""An energy residual above this fraction of the work is more than rounding."""


def run_scene(scene: Scene, duration: float | None, rate: float, method: str | None) -> Trajectory:
    """Run a scene with a progress bar.

    Args:
        scene: the scene.
        duration: simulated time [s]; None for ten periods, or up to the last waypoint.
        rate: ticks per second [Hz].
        method: "exact", "catch_up", or None for the best available.

    Returns:
        The run.
    """
    from crawler_model import prepare, simulate

    prepare(scene)
    with progress_bar("simulating") as progress:
        return simulate(scene, duration, rate, method, progress)  # type: ignore[arg-type]


def write_tables(run: Trajectory, parquet: Path | None, csv: Path | None, progress: Callable[[float], None]) -> None:
    """Write the table of a run, in one pass and completely or not at all.

    Args:
        run: the run.
        parquet: the Parquet file, a row group for each batch of rows; None for none.
        csv: the CSV file; None for none.
        progress: called with the completed part, in [0, 1].

    Raises:
        CrawlerError: if a segment has the name of a column.
    """
    from crawler_model import Scene
    from crawler_ros.recording.attachments import versions

    schema = run.build_schema()
    about = json.loads(schema.metadata[b"crawler_trajectory"]) | {"versions": versions()}
    if isinstance(run.scene, Scene):
        about["document"] = run.scene.document()
    with ExitStack() as files:
        writers: list[tuple[Path, Any]] = []
        if parquet is not None:
            from pyarrow.parquet import ParquetWriter

            described = schema.with_metadata({"crawler_trajectory": json.dumps(about, sort_keys=True)})
            part = files.enter_context(whole_file(parquet))
            writers.append((parquet, files.enter_context(ParquetWriter(part, described, compression="zstd"))))
        if csv is not None:
            from pyarrow.csv import CSVWriter, WriteOptions

            handle = files.enter_context(files.enter_context(whole_file(csv)).open("wb"))
            handle.write((",".join(schema.names) + "\n").encode())
            options = WriteOptions(include_header=False)
            writers.append((csv, files.enter_context(CSVWriter(handle, schema, write_options=options))))
        done = 0
        for batch in run.build_batches():
            for path, writer in writers:
                with named_errors(path):
                    writer.write_batch(batch)
            done += batch.num_rows
            progress(done / run.time.size)


@takes_page
def simulate_command(
    scene: SceneArgument,
    duration: DurationOption = None,
    rate: Annotated[float, typer.Option(help="Ticks per second, Hz.")] = DEFAULT_RATE,
    method: MethodOption = MethodName.auto,
    parquet: Annotated[
        Path | None, typer.Option(help="The .parquet table to write, with a row for the end of each tick.")
    ] = None,
    csv: Annotated[
        Path | None, typer.Option(help="The same table as .csv, with the names that measurements have.")
    ] = None,
    png: Annotated[Path | None, typer.Option(help="Draw one page to this file: .png, .pdf or .svg.")] = None,
    two_columns: TwoColumnsOption = False,
    force: ForceOption = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
) -> None:
    """Run a scene offline, without ROS, and print its net translation.

    In the JSON output, displacement lists the isolated contacts, then both ends of each segment; events counts linear
    pieces, including ticks; energy.residual is relative to the work.
    """
    from crawler_model import load_scene

    from .turning_report import print_turning

    loaded = load_scene(scene)
    if loaded.drive.holds and duration is None:
        wanted = "set the simulated time with --duration, or find a drive: crawler optimise"
        raise CrawlerError(f"{scene}: the scene has {loaded.unmoving_drive}; {wanted}")
    if two_columns and png is None:
        raise CrawlerError("--two-columns needs --png: it arranges the panels of that page")
    for option, file in (("--parquet", parquet), ("--csv", csv), ("--png", png)):
        check_output(option, file, PICTURES if file is png else option.replace("--", "."), force)
    run = run_scene(loaded, duration, rate, None if method is MethodName.auto else method.value)
    if parquet is not None or csv is not None:
        with progress_bar("writing") as progress:
            write_tables(run, parquet, csv, progress)
    if png is not None:
        from crawler_pictures.run.run_page import draw_run
        from crawler_pictures.run.trajectory import read_trajectory

        with whole_file(png) as part:
            draw_run(read_trajectory(run), part, two_columns)
    if as_json:
        print(json.dumps(run.summary(), allow_nan=False))
        _check_certificate(run)
        return
    _print_translation(run, rate)
    _print_account(run)
    print_turning(run, screen)
    for file in filter(None, (parquet, csv)):
        screen.print(f"table: {file}", markup=False)
    if png is not None:
        screen.print(f"drawn: {png}", markup=False)
    _check_certificate(run)


def _print_translation(run: Trajectory, rate: float) -> None:
    """Print the net translation at each waypoint, of long drives at the first and the last ones."""
    periods = run.per_period.size > 0
    names = ("time [s]", "net translation [m]", "gained in the period [m]" if periods else "gained [m]")
    title = f"{run.scene.name}: {run.method}, {run.ticks} ticks at {rate:g} Hz"
    table = Table(*(Column(name, justify="right") for name in names), title=title, title_justify="left")

    y, error = run.waypoint_net_translation, error_of(run.scene)
    size = float(abs(run.displacement).max()) + float(abs(run.scene.drive.actuation).max())
    count = y.shape[0]
    rows = range(count) if count <= 24 else [*range(12), *range(count - 11, count)]
    last = -1
    for i in rows:
        if i != last + 1:
            table.add_row("...", "...", "...")
        last = i
        gained = "" if i == 0 else write_length(y[i] - y[i - 1], size, error)
        table.add_row(f"{run.waypoint_time[i]:g}", write_length(y[i], size, error), gained)
    if run.time[-1] > run.waypoint_time[-1]:
        table.add_row(f"{run.time[-1]:g}", write_length(run.net_translation[-1], size, error), "")
    screen.print(table)
    if abs(y[0]).max() > max(error, _MISSED * size):
        screen.print("at 0 s: the net translation of the start relative to the reference shape")


def _check_certificate(run: Trajectory) -> None:
    """Refuse to end in success if an exact run is not exact; its numbers have been written by then."""
    if run.method != "exact":  # the residual of catch_up measures the error of its steps
        return
    springs = run.scene.body.springs
    friction = float(abs(run.scene.drive.targets[:, springs : springs + 2 * run.scene.body.contacts]).max())
    cause = (
        "forces or stiffnesses of the scene are too far apart for floating-point numbers: bring them closer together"
    )
    if not friction and run.scene.ground.track is None:
        cause = "no contact has friction, so that nothing determines where the body is: give friction to at least one"
    for what, value, of in (
        ("the energy balance is off by", run.energy.relative_residual, "of the energy turned over"),
        ("a spring force exceeds its bound by", run.violation / (friction or 1.0), "of the largest friction"),
    ):
        if not value <= _MISSED:
            raise CrawlerError(
                f"{run.scene.name}: the result is not exact: {what} {value:.1e} {of}, more than {_MISSED:g}; {cause}"
            )


def _describe_energy(energy: Energy) -> str:
    """Describe what was put in, where it went, and the residual in a line that adds up."""
    size = max(energy.peak, abs(energy.work), abs(energy.loads_work), energy.dissipation, abs(energy.stored))
    put_in = {"work": energy.work, "work of the loads": energy.loads_work}
    went = {"dissipation": energy.dissipation, "lost in springs": energy.internal_dissipation}
    went |= {"lost in jumps": energy.jump_loss, "stored": energy.stored}
    always = ("work", "dissipation", "stored")
    parts = [
        " + ".join(f"{name} {write_size(value, size)} J" for name, value in some.items() if value or name in always)
        for some in (put_in, went)
    ]
    return f"{' = '.join(parts)}, residual {energy.relative_residual:.1e} of the work"


def _print_account(run: Trajectory) -> None:
    screen.print(_describe_energy(run.energy))
    screen.print(f"largest excess over a bound {run.violation:.1e} N; {run.events} linear pieces in {run.wall_s:.3g} s")
    if run.method == "catch_up" and run.scene.body.dimension == 1 and run.energy.relative_residual > _MISSED:
        screen.print("[yellow]catch_up missed events:[/] the residual shows the error; use exact or a higher rate")
    if run.inertia is not None:
        screen.print(run.inertia.describe(run.scene.body))
    if not run.unique:
        screen.print(f"[yellow]not unique:[/] in some interval {UNDETERMINED}")
    if run.overspent:
        screen.print(f"[yellow]{run.overspent} ramp(s)[/] had too many events; catch-up steps completed them")
    if run.unsolved:
        screen.print(f"[yellow]{run.unsolved} ramp(s)[/] not solved: see the excess over a bound and the residual")
