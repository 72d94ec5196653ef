"""The verb `optimise`: the best periodic drive of a scene within bounds."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from crawler_command.pages import takes_page
from crawler_command.screen import (
    PICTURES,
    ForceOption,
    SceneArgument,
    ShowProgress,
    check_output,
    note_left_out,
    parse_bounds,
    parse_slower_than,
    progress_bar,
    require,
    screen,
    whole_file,
    write_scene,
)
from crawler_model import CrawlerError

from .optimum_report import describe_front, describe_optimum

if TYPE_CHECKING:
    from crawler_model import Scene

    from ..optimise.optimum import Optimum
    from ..optimise.pareto import Front

_SEARCHED = 0.85  # part of the time that is left to search and examination where a picture follows
_TOO_LONG = 10.0  # lengths of the body


class Objective(str, Enum):
    """The objective of an optimisation."""

    translation = "translation"
    cost_of_transport = "cost-of-transport"
    travel = "travel"
    turn = "turn"
    screw = "screw"


class Over(str, Enum):
    """What counts of several bodies."""

    expected = "expected"
    worst = "worst"


_Objective = Annotated[
    Objective,
    typer.Option(
        "--for",
        help="What is best: the largest gain per period, cost of transport, or gain / travel; for bodies that turn "
        "also the largest turn to the left per period, or the motion per period that is nearest to --target.",
    ),
]
_Target = Annotated[
    str | None,
    typer.Option(
        metavar="DX,DY,DYAW",
        help="Of `--for screw`: the motion per period, m and rad, in the frame of the body at its first waypoint.",
    ),
]
_Towards = Annotated[
    float | None,
    typer.Option(
        metavar="DEGREES",
        help="In the plane: the direction in which a gain counts, from +x or from the heading of a body that turns; 0.",
    ),
]
_Periods = Annotated[
    int | None,
    typer.Option(help="Where the ground differs from place to place: number of first periods whose mean counts; 10."),
]
_Waypoints = Annotated[
    int | None, typer.Option(help="Number of evenly spaced waypoints, all unknown; 6 where it is needed.")
]
_Stroke = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[NAME=]A:B",
        help="Bounds of rest lengths (m), strains and joint angles (rad), for all or for each by name; what is not "
        "named stays as it is. By default the range of the scene's drive. In the plane link_0/x and link_0/y are the "
        "components of a link.",
    ),
]
_Free = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=A:B",
        help="A further unknown and its bounds: a number of the scene by its dotted key, or `friction`, of "
        "each contact at each waypoint. Repeat the option for several.",
    ),
]
_Fastest = Annotated[float | None, typer.Option(help="Fastest change of a rest length, m/s, or of a strain, 1/s.")]
_Tension = Annotated[float | None, typer.Option(help="Largest tension of a spring, N.")]
_Robust = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=A:B",
        help="A number of the scene that is uncertain, and the factors between which it lies, as you state them; the "
        "gait is best where it is worst. Repeat the option for several. For what a record tells, see --robust-to.",
    ),
]
_RobustTo = Annotated[
    Path | None,
    typer.Option(
        metavar="FIT.json",
        help="What `crawler identify --json` printed: the gait is best over bodies drawn from what the record tells "
        "about the numbers of the scene. For ranges that you state, see --robust.",
    ),
]
_RobustOf = Annotated[
    Over | None,
    typer.Option(help="What --robust-to maximises: the mean over the drawn bodies (expected), or the worst of them."),
]
_Compromises = Annotated[
    bool, typer.Option("--pareto", help="Print the curve of gain against cost of transport instead of one gait.")
]
_SlowerThan = Annotated[
    str | None,
    typer.Option(
        metavar="r=0.1",
        help="Largest inertia number: the period becomes as long as masses or weights need. It changes no gain.",
    ),
]
_Period = Annotated[
    float | None, typer.Option(help="Period of the waypoints, s; by default the period of the scene's drive, or 1.")
]
_Seconds = Annotated[
    float | None,
    typer.Option(
        help="Time limit, s, compiling aside; it covers the examination and the picture. A search that it ends depends "
        "on the machine."
    ),
]
_Seed = Annotated[int, typer.Option(help="Seed of the random numbers; the same seed gives the same result.", min=0)]
_AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
_Out = Annotated[Path | None, typer.Option(help="The scene to write, which plays the gait; .yaml.")]
_Table = Annotated[Path | None, typer.Option(help="The gait as a table to write, .csv or .md.")]
_Png = Annotated[
    Path | None, typer.Option(help="The picture to write: gait, motion, and the objective around the optimum.")
]


@takes_page
def optimise_command(
    scene: SceneArgument,
    objective: _Objective,
    target: _Target = None,
    towards: _Towards = None,
    periods: _Periods = None,
    waypoints: _Waypoints = None,
    stroke: _Stroke = None,
    free: _Free = None,
    fastest: _Fastest = None,
    tension: _Tension = None,
    robust: _Robust = None,
    robust_to: _RobustTo = None,
    robust_of: _RobustOf = None,
    compromises: _Compromises = False,
    period: _Period = None,
    slower_than: _SlowerThan = None,
    seconds: _Seconds = None,
    seed: _Seed = 0,
    as_json: _AsJson = False,
    out: _Out = None,
    table: _Table = None,
    png: _Png = None,
    force: ForceOption = False,
) -> None:
    """Find the best gait of a scene within bounds: waypoints, friction, or numbers of its drive.

    crawler optimise two_contacts_anisotropic --for translation --stroke 0:0.1 --waypoints 2 --out best.yaml

    The objective belongs to the periodic regime; where the ground differs from place to place, so that no two periods
    are the same, it is the mean of the first ones. The search ends when several rounds have found nothing better; after
    --seconds, or Ctrl-C (then with exit status 130), the best gait so far is the result.
    """
    require("cma", *(["matplotlib"] if png is not None else []))
    _check_outputs(out, table, png, force, compromises)
    _check_combinations(robust, robust_to, robust_of, compromises, objective, target)
    strokes = parse_bounds("--stroke", stroke or ())
    limits: dict[str, Any] = {
        "waypoints": waypoints,
        "stroke": strokes.get("") if set(strokes) == {""} else strokes or None,
        "free": parse_bounds("--free", free or ()),
        "rate": fastest,
        "tension": tension,
        "robust": parse_bounds("--robust", robust or ()),
        "period": period,
        "seconds": seconds if seconds is None or png is None else _SEARCHED * seconds,
        "seed": seed,
        "towards": towards,
        "periods": periods,
    }
    if slower_than is not None:
        if compromises:
            raise CrawlerError("--slower-than: the points of --pareto are gains per period, which no period changes")
        limits["slower_than"] = parse_slower_than(slower_than)
    motion = None if target is None else _parse_target(target)
    from crawler_model import load_scene, prepare

    from ..identify.forecast.posterior import read_posterior
    from ..optimise.optimise import optimise
    from ..optimise.pareto import Front, pareto

    loaded = load_scene(scene)
    if robust_to is not None:
        over = (robust_of or Over.expected).value
        limits |= {"robust_to": read_posterior(robust_to, loaded), "robust_of": over}
    _ask_about_units(strokes, loaded)
    prepare(loaded)
    found: Front | Optimum
    with progress_bar("optimising") as progress:
        if compromises:
            found = pareto(loaded, progress=progress, **limits)
        else:
            limits["mapped"] = png is not None
            found = optimise(loaded, objective.value, progress=_tell(progress), target=motion, **limits)
    drive = found.points[0].scene.document()["drive"] if isinstance(found, Front) else found.scene.document()["drive"]
    note_left_out(loaded, drive)
    _write(found, out, table, png)
    _print(found, as_json, {"scene": out, "table": table, "picture": png})
    if found.interrupted:
        raise typer.Exit(130)


def _tell(progress: ShowProgress) -> Callable[[float], None]:
    """Show how far a search is, and after its end that its gait is examined."""
    return lambda part: progress(part, "examining the best gait") if part >= 1.0 else progress(part)


def _parse_target(text: str) -> tuple[float, float, float]:
    """Parse the option `--target`, DX,DY,DYAW: dx, dy [m] and dyaw [rad]."""
    try:
        dx, dy, dyaw = (float(part) for part in text.split(","))
    except ValueError:
        raise CrawlerError(f"--target {text}: write DX,DY,DYAW, for example 0.2,0,0.1") from None
    return dx, dy, dyaw


def _ask_about_units(strokes: dict[str, tuple[float, float]], scene: Scene) -> None:
    """Warn about strokes far beyond the length of the body: most are in millimetres."""
    if scene.body.segments:  # strokes may be strains
        return
    length = float(np.linalg.norm(np.ptp(scene.body.position, axis=0)))
    for low, high in strokes.values():
        if max(abs(low), abs(high)) >= _TOO_LONG * length:
            text = f"--stroke {low:g}:{high:g} is in metres, but the body is {length:g} m long: millimetres?"
            print(f"crawler: {text}", file=sys.stderr)


def _check_outputs(out: Path | None, table: Path | None, png: Path | None, force: bool, compromises: bool) -> None:
    for option, file, suffixes in (("--out", out, (".yaml",)), ("--table", table, (".csv", ".md"))):
        if compromises and file is not None:
            raise CrawlerError(f"{option}: with --pareto there are several gaits; --json prints the drives of all")
        check_output(option, file, suffixes, force)
    check_output("--png", png, PICTURES, force)


def _print(found: Front | Optimum, as_json: bool, written: dict[str, Path | None]) -> None:
    """Print the result, and a line about each file that was written."""
    from ..optimise.pareto import Front

    if as_json:
        print(json.dumps(found.summary(), allow_nan=False))
        return
    lines = describe_front(found) if isinstance(found, Front) else describe_optimum(found)
    lines += [f"{what}: {file}" for what, file in written.items() if file is not None]
    screen.print("\n".join(lines), markup=False)


def _write(found: Front | Optimum, out: Path | None, table: Path | None, png: Path | None) -> None:
    """Write the scene, the table and the picture that were asked for."""
    from ..optimise.gait_table import format_gait
    from ..optimise.pareto import Front

    if not isinstance(found, Front) and out is not None:
        write_scene(found.scene, out)
    if not isinstance(found, Front) and table is not None:
        with whole_file(table) as part:
            part.write_text(format_gait(found.scene, table.suffix), encoding="utf-8")
    if png is not None:
        from crawler_command.units import unit_of

        from ..pictures.optimum import draw_front, draw_optimum

        with whole_file(png) as part:
            if isinstance(found, Front):
                draw_front(found, part)
            else:
                draw_optimum(found, {name: unit_of(found.scene, name) for name in found.names}, part)


def _check_combinations(
    robust: list[str] | None,
    fit: Path | None,
    over: Over | None,
    compromises: bool,
    objective: Objective,
    target: str | None,
) -> None:
    if compromises and (target is not None or objective not in (Objective.translation, Objective.cost_of_transport)):
        raise CrawlerError("--pareto: the curve shows translation against cost of transport; use --for translation")
    if fit is None and over is not None:
        raise CrawlerError(f"--robust-of {over.value}: it needs --robust-to FIT.json")
    for option, given in (("--robust", robust), ("--pareto", compromises)):
        if fit is not None and given:
            raise CrawlerError(f"--robust-to: it cannot be combined with {option}; give one of them")
