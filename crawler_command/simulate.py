"""The verb `simulate`: a scene run offline, without ROS."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from crawler_model import CrawlerError

from .screen import DurationOption, MethodName, MethodOption, SceneArgument, progress_bar, screen

if TYPE_CHECKING:
    from crawler_model import Scene, Trajectory

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


def simulate_command(
    scene: SceneArgument,
    duration: DurationOption = None,
    rate: Annotated[float, typer.Option(help="Ticks per second, Hz.")] = 100.0,
    method: MethodOption = MethodName.auto,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
) -> None:
    """Run a scene offline, without ROS, and print its net translation.

    In the JSON output, displacement is that of the isolated contacts, then of both ends of each segment; events counts
    linear pieces, including ticks; energy.residual is relative to the work.
    """
    from crawler_model import load_scene
    from crawler_pictures.numbers import write_length

    loaded = load_scene(scene)
    if loaded.drive.holds and duration is None:
        raise CrawlerError(f"{scene}: the scene has no drive; set the simulated time with --duration")
    run = run_scene(loaded, duration, rate, None if method is MethodName.auto else method.value)
    if as_json:
        print(json.dumps(run.summary(), allow_nan=False))
        return
    table = Table(title=f"{run.scene.name}: {run.method}, {run.ticks} ticks at {rate:g} Hz", title_justify="left")
    periods = run.per_period.size > 0
    table.add_column(r"time \[s]", justify="right")
    table.add_column(r"net translation \[m]", justify="right")
    table.add_column(r"gained in the period \[m]" if periods else r"gained \[m]", justify="right")

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
        screen.print("[yellow]catch_up missed events:[/] the residual shows the error; use exact or a higher rate")
    if not run.unique:
        screen.print(
            "[yellow]not unique:[/] in some interval the translation was not determined; "
            "the one nearest to zero was taken"
        )
    if run.overspent:
        screen.print(f"[yellow]{run.overspent} ramp(s)[/] had too many events; catch-up steps completed them")
    if run.unsolved:
        screen.print(
            f"[yellow]{run.unsolved} ramp(s)[/] not solved: the active set failed; see the excess over a bound"
        )
