"""The verb `sweep`: many variations of a scene, as a table and a picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from crawler_command.pages import takes_page
from crawler_command.screen import (
    DurationOption,
    ForceOption,
    MethodName,
    MethodOption,
    SceneArgument,
    progress_bar,
    require,
)
from crawler_model.run.ticks import DEFAULT_RATE


@takes_page
def sweep(
    scene: SceneArgument,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="KEY=FROM:TO:N",
            help="A number of the scene by its dotted key, and its values: FROM:TO:N, log:FROM:TO:N or A,B,C. "
            "Repeat the option for every combination of several keys. KEY/OTHER=... varies a ratio: the number KEY "
            "follows OTHER.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="The table to write, .parquet or .csv; it must not exist.")],
    duration: DurationOption = None,
    rate: Annotated[
        float, typer.Option(help="Ticks per second, Hz; the result of exact does not depend on it.")
    ] = DEFAULT_RATE,
    method: MethodOption = MethodName.auto,
    workers: Annotated[
        int | None, typer.Option(help="Number of parallel runs; by default one per core.", min=1)
    ] = None,
    png: Annotated[
        Path | None, typer.Option(help="The picture to write, for one or two keys; by default next to the table.")
    ] = None,
    plot: Annotated[
        str | None,
        typer.Option(metavar="COLUMN", help="The result that the picture shows; by default the net translation."),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Run on the workers of this Dask scheduler.")
    ] = None,
    force: ForceOption = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
) -> None:
    """Run thousands of variations of a scene on all cores; write a table and a picture.

    crawler sweep ten_contact_wave --vary friction.forward=0.1:1:50 --vary body.links.stiffness=10,20 --out f.parquet

    A key is the path to a number in the scene file: friction.forward, drive.wave.amplitude, body.links.stiffness.0 (the
    first link). A row holds the values varied, the net translation in the last period, energies, and whether the
    translation is unique; an invalid variation is reported with its reason. After Ctrl-C the table holds the finished
    runs.
    """
    from crawler_model import load_scene

    from ..sweep.many_runs import Settings

    drawn = png is not None or len(vary) <= 2
    require("pyarrow", *(["matplotlib"] if drawn else []), *(["distributed"] if scheduler is not None else []))
    from . import sweep_plan as sweeps

    settings = Settings(duration, rate, None if method is MethodName.auto else method.value)  # type: ignore[arg-type]
    plan = sweeps.plan_sweep(load_scene(scene), vary, settings, out, png, force, plot)
    with progress_bar("sweeping") as progress:
        runs = sweeps.run_sweep(plan, workers, scheduler, progress)
    print(json.dumps(sweeps.summarise(plan, runs)) if as_json else "\n".join(sweeps.describe_sweep(plan, runs)))
    if runs.interrupted:
        raise typer.Exit(130)
