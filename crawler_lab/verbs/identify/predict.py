"""The verb `predict`: what another drive does with an identified body."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from crawler_command.pages import takes_page
from crawler_command.screen import PICTURES, ForceOption, SceneArgument, check_output, screen, whole_file

if TYPE_CHECKING:
    from ...identify.forecast.predict import Forecast


@takes_page
def predict_command(
    scene: SceneArgument,
    fit: Annotated[Path, typer.Option("--from", metavar="FIT.json", help="What `crawler identify --json` printed.")],
    drive: Annotated[
        str | None,
        typer.Option(help="A scene, or a file with a part `drive`: the drive to predict; by default the scene's own."),
    ] = None,
    periods: Annotated[
        int | None, typer.Option(help="Number of periods of the run, ten by default; for a drive with a period.", min=1)
    ] = None,
    rate: Annotated[
        float | None, typer.Option(help="Rate of the predicted positions, Hz; by default 400 samples in all.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
    png: Annotated[
        Path | None, typer.Option(help="Draw the positions with their bands to this file: .png, .pdf or .svg.")
    ] = None,
    force: ForceOption = False,
) -> None:
    """Predict gain, energy and positions of an identified body under another drive, each with a 95 % band.

    `crawler identify` finds the body: `crawler predict robot.yaml --from fit.json --drive gait.yaml`.

    Of a drive with a period, the gain and the energy belong to a period of the limit cycle. Where the motion depends
    on a parameter that is only bounded, the band covers all values that the bound allows, and a line names it. Where it
    depends on one that the record did not excite, there is no prediction.
    """
    from crawler_model import load_scene

    from ...identify.forecast.predict import predict

    check_output("--png", png, PICTURES, force)
    found = predict(load_scene(scene), fit, drive, periods, rate)
    if png is not None:
        from ...pictures.forecast import draw_forecast

        with whole_file(png) as part:
            draw_forecast(found, part)
    if as_json:
        print(json.dumps(found.summary(), allow_nan=False))
        return
    screen.print(_tabulate_forecast(found))
    for line in (*(one.why for one in found.depends_on_bounds), *found.notes):
        screen.print(line)
    if found.inertia is not None:
        screen.print(found.inertia.describe(found.scene.body))
    if png is not None:
        screen.print(f"picture: {png}")


def _tabulate_forecast(found: Forecast) -> Table:
    """Build the table of predicted numbers, with a row for each."""
    table = Table(title=f"{found.scene.name}: prediction", title_justify="left")
    for name in ("", "value", "95 % band", "unit"):
        table.add_column(name)
    rows = [(f"gain {found.per}", found.gain, "m"), (f"energy {found.per}", found.energy, "J")]
    if found.periods is not None:
        run = f"in the first {found.periods} periods" if found.periods > 1 else "in the first period"
        rows += [(f"gain {run}", found.run_gain, "m"), (f"energy {run}", found.run_energy, "J")]
    for name, band, unit in rows:
        table.add_row(name, f"{band.value:.6g}", f"{band.low:.6g} .. {band.high:.6g}", unit)
    return table
