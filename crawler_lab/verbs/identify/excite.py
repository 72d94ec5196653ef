"""The verb `excite`: a short drive that makes parameters identifiable."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from crawler_command.screen import (
    ForceOption,
    SceneArgument,
    check_output,
    note_left_out,
    parse_bounds,
    parse_slower_than,
    progress_bar,
    screen,
    write_scene,
)

from .command import split_keys


def excite_command(
    scene: SceneArgument,
    fit: Annotated[
        list[str],
        typer.Option(metavar="KEY[,KEY...]", help="Numbers of the scene to identify, by their dotted keys."),
    ],
    stroke: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]A:B",
            help="Bounds of all rest lengths, m, or of each by its name; what is not named stays. By default the "
            "bounds of the drive.",
        ),
    ] = None,
    noise: Annotated[float, typer.Option(help="Standard deviation of measured positions, m.")] = 1e-3,
    duration: Annotated[float, typer.Option(help="Longest simulated time, s.")] = 20.0,
    every: Annotated[float, typer.Option(help="Time between waypoints, s.")] = 0.2,
    interval: Annotated[
        float,
        typer.Option(help="End when the half widths of all 95 % intervals, relative to the values, are below it."),
    ] = 0.1,
    rate: Annotated[float, typer.Option(help="Rate of the measurements, Hz.")] = 50.0,
    slower_than: Annotated[
        str | None, typer.Option(metavar="r=0.1", help="Largest inertia number: play the drive as slowly as it needs.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the random candidates.", min=0)] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
    out: Annotated[Path | None, typer.Option(help="Write the scene with the drive to this .yaml file.")] = None,
    force: ForceOption = False,
) -> None:
    """Find a short drive from which `crawler identify` can find numbers of a scene, and the intervals to expect.

    crawler excite two_contacts_anisotropic --fit friction.forward --stroke -0.1:0.1 --noise 0.0005 --out drive.yaml

    The numbers of the scene are a guess. Positions of all contacts are measured. Ctrl-C keeps the drive so far.
    """
    from crawler_model import load_scene

    from ...identify.excite import excite
    from .report import print_parameters

    check_output("--out", out, ".yaml", force)
    strokes = parse_bounds("--stroke", stroke or ())
    loaded = load_scene(scene)
    with progress_bar("searching a drive") as progress:
        found = excite(
            loaded,
            split_keys(fit),
            strokes.get("") if set(strokes) == {""} else strokes or None,
            noise,
            duration,
            every,
            interval,
            rate,
            seed,
            progress,
            None if slower_than is None else parse_slower_than(slower_than),
        )
    note_left_out(loaded, found.scene.document()["drive"])
    if out is not None:
        write_scene(found.scene, out)
    if as_json:
        print(json.dumps(found.summary(), allow_nan=False))
    else:
        title = (
            f"{found.scene.name}: {found.duration:g} s, measured at {found.rate:g} Hz with a standard deviation of "
            f"{found.noise:g} m"
        )
        print_parameters(found.parameters, title, screen)
        if found.inertia is not None:
            screen.print(found.inertia.describe(found.scene.body))
        if out is not None:
            screen.print(f"scene: {out}")
    if found.interrupted:
        raise typer.Exit(130)
