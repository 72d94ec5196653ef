"""The verb `springs`: a spring and its elements of hysteresis from a measured loop."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.table import Table

from crawler_command.pages import takes_page
from crawler_command.screen import PICTURES, ForceOption, check_output, require, screen, whole_file
from crawler_model import CrawlerError

from .identify.options import SI, Units, parse_columns, parse_units

if TYPE_CHECKING:
    from ..springs.rate import Rate
    from ..springs.springs import Estimate, Springs

_NAMES = ("elongation", "force", "time")


@takes_page
def springs_command(
    table: Annotated[
        Path, typer.Argument(help="A table of elongation, force and, if measured, time (.csv, .tsv, .txt or .parquet).")
    ],
    columns: Annotated[
        list[str] | None,
        typer.Option(metavar="OURS=THEIRS[,...]", help="Names of columns, for example elongation=travel,force=load."),
    ] = None,
    units: Annotated[
        str | None,
        typer.Option(metavar="LENGTH,TIME", help="Units: m, cm, mm or um; s, ms or us. By default m,s; forces in N."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
    png: Annotated[
        Path | None, typer.Option(help="Draw loop, model and residuals to this file: .png, .pdf or .svg.")
    ] = None,
    force: ForceOption = False,
) -> None:
    """Find the spring and the least number of elements of hysteresis that explain a measured loop.

    The table comes from a load frame: elongations that turn round at several amplitudes, and the force, in the order in
    which they were measured. Without a header its columns are elongation, force and time. The result is a stiffness, or
    a curve of few pieces, and Maxwell-slip elements, each with 95 % intervals, and the lines for the scene file.

    Where the record has runs at two speeds, one twice the other, their difference decides whether the loop is rate
    independent, as the model is. The exit status is 1 if the residuals are larger than noise and than 3 % of the width
    of the loop.
    """
    from ..springs.springs import fit_springs

    require("pyarrow")
    check_output("--png", png, PICTURES, force)
    found = fit_springs(
        table.name, *_read_loop(table, parse_columns(columns or ()), SI if units is None else parse_units(units))
    )
    if png is not None:
        from ..pictures.springs import draw_springs

        with whole_file(png) as part:
            draw_springs(found, part)
    if as_json:
        print(json.dumps(found.as_plain(), allow_nan=False))
    else:
        _print(found, png)
    if not found.explained:
        raise CrawlerError(
            f"{found.name}: the model does not explain the loop: residuals of {found.residual:.3g} N, "
            f"{found.residual / found.noise:.3g} times the noise and {_percent(found.residual, found.width)}"
        )


def _read_loop(
    path: Path, columns: Mapping[str, str], units: Units
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Read elongation [m], force [N] and, if there is such a column, time [s] of the rows that have both."""
    from ..identify.measurements import check_times
    from .identify.cells import open_table, read_numbers
    from .identify.tables import list_unread, rename_columns

    table = open_table(path, _NAMES)
    for ours, theirs in columns.items():
        if ours not in _NAMES:
            raise CrawlerError(f"--columns {ours}={theirs}: a loop has the columns {', '.join(_NAMES)}")
        if theirs not in table.names:
            raise CrawlerError(f"--columns {ours}={theirs}: {path.name} has no column {theirs}; it has {table.header}")
    table = rename_columns(table, columns)
    missing = next((name for name in _NAMES[:2] if name not in table.names), None)
    if missing is not None:
        raise CrawlerError(
            f"{path}: no column `{missing}`; the header is {table.header}, it must be like elongation,force,time, or "
            f"name the column with --columns {missing}=..."
        )
    names = [name for name in _NAMES if name in table.names]
    numbers = read_numbers(table, names)
    given = np.isfinite(numbers[:, :2]).all(axis=1)
    list_unread(table, names)
    numbers = numbers[given]
    if len(names) == 3:
        check_times(path.name, "time", numbers[:, 2], table.rows[given])
    time = numbers[:, 2] / units.per_second if len(names) == 3 else None
    return numbers[:, 0] / units.per_metre, numbers[:, 1], time


def _print(found: Springs, png: Path | None) -> None:
    """Print the numbers, what they leave, the verdict about the rate, and the lines for the scene file."""
    table = Table(title=f"{found.name}: {found.force.size} rows", title_justify="left")
    for name in ("", "value", "95 % interval", "unit"):
        table.add_column(name)

    def add_estimate(name: str, one: Estimate, unit: str) -> None:
        ends = ["" if end is None else f"{end:.5g}" for end in (one.low, one.high)]
        table.add_row(name, f"{one.value:.5g}", " .. ".join(ends) if any(ends) else "not determined", unit)

    add_estimate("force at elongation 0", found.force_at_zero, "N")
    for i, one in enumerate(found.stiffnesses):
        add_estimate(f"stiffness of piece {i}" if found.knots else "stiffness", one, "N/m")
    for i, one in enumerate(found.knots):
        add_estimate(f"knot {i}", one, "m")
    for i, element in enumerate(found.elements):
        add_estimate(f"hysteresis[{i}].stiffness", element.stiffness, "N/m")
        add_estimate(f"hysteresis[{i}].yield", element.limit, "N")
    screen.print(table)
    verdict = "explains the loop" if found.explained else "[yellow]does not explain the loop[/]"
    screen.print(
        f"The model {verdict}: residuals of {found.residual:.3g} N, {found.residual / found.noise:.3g} times the noise "
        f"and {_percent(found.residual, found.width)}"
    )
    screen.print(_describe_rate(found.rate))
    for note in found.notes:
        screen.print(note)
    if png is not None:
        screen.print(f"picture: {png}")
    screen.print("\nFor the scene file:\n")
    screen.print(found.scene_lines())


def _percent(force: float, width: float) -> str:
    return (
        f"{100.0 * force / width:.2g} % of the width of the loop, {width:.3g} N" if width > 0.0 else "no loop is open"
    )


def _describe_rate(rate: Rate | None) -> str:
    """Describe what the record decides about the rate."""
    if rate is None:
        return "rate: not known, the table has no column `time`"
    speeds = f"{1e3 * rate.speeds[0]:.3g} to {1e3 * rate.speeds[1]:.3g} mm/s"
    if rate.difference is None:
        return f"rate: {rate.verdict}, {speeds}; loops at two, one twice the other, would decide whether it matters"
    part = "" if rate.part is None else f", {100.0 * rate.part:.2g} % of the width of the loop"
    return (
        f"rate: {rate.verdict}: from {speeds} the force changes by {rate.difference:.2g} N{part} "
        f"(mere noise would do so with a probability of {rate.chance:.1g})"
    )
