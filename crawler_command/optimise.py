"""The verb `optimise`: the best periodic drive of a scene within bounds."""

from __future__ import annotations

import json
import sys
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from crawler_model import CrawlerError
from crawler_model.body.plan import refuse_turning

from .screen import (
    ForceOption,
    SceneArgument,
    check_output,
    parse_bounds,
    progress_bar,
    require,
    screen,
    whole_file,
    write_scene,
)

if TYPE_CHECKING:
    from crawler_model import Front, Optimum, Scene

_SHOWN_ROWS = 12
_NOTHING_BETTER = "; the search ended because several rounds in a row found nothing better"
_STOPPED_EARLY = "; stopped before the end, the result depends on the machine"
_HASTY = 4
"""Reversals of a link in a period: a stroke and its return are two."""
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
        help="What is best: the largest gain per period, cost of transport, or gain / travel; of bodies that turn the "
        "largest turn to the left per period, or the motion per period that is nearest to --target.",
    ),
]
_Target = Annotated[
    str | None,
    typer.Option(
        metavar="DX,DY,DYAW",
        help="Of `--for screw`: the motion per period, m and rad, in the frame of the body at its first waypoint.",
    ),
]
_Waypoints = Annotated[
    int | None, typer.Option(help="Number of evenly spaced waypoints, all unknown; 6 where it is needed.")
]
_Stroke = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[NAME=]A:B",
        help="Bounds of rest lengths (m), strains and joint angles (rad), for all or for each by name; by default the "
        "range of the scene's drive.",
    ),
]
_Free = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=A:B",
        help="A further unknown and its bounds: a number of the scene by its dotted key, or `friction`, that of "
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
_Period = Annotated[
    float | None, typer.Option(help="Period of the waypoints, s; by default that of the scene's drive, or 1.")
]
_Seconds = Annotated[float | None, typer.Option(help="Time limit, s; the result then depends on the machine.")]
_Seed = Annotated[int, typer.Option(help="Seed of the random numbers; the same seed has the same result.", min=0)]
_AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
_Out = Annotated[Path | None, typer.Option(help="The scene to write, which plays the gait; .yaml.")]
_Png = Annotated[
    Path | None, typer.Option(help="The picture to write: gait, motion, and the objective around the optimum.")
]


def optimise_command(
    scene: SceneArgument,
    objective: _Objective,
    target: _Target = None,
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
    seconds: _Seconds = None,
    seed: _Seed = 0,
    as_json: _AsJson = False,
    out: _Out = None,
    png: _Png = None,
    force: ForceOption = False,
) -> None:
    """Find the best gait of a scene within bounds: waypoints, friction, or numbers of its drive.

    crawler optimise two_contacts_anisotropic --for translation --stroke 0:0.1 --waypoints 2 --out best.yaml

    The objective is that of the periodic regime. The search ends when several rounds have found nothing better; after
    Ctrl-C or --seconds the best gait so far is the result.
    """
    require("cma", *(["matplotlib"] if png is not None else []))
    _check_outputs(out, png, force, compromises)
    _check_robust(robust, robust_to, robust_of, compromises)
    strokes = parse_bounds("--stroke", stroke or ())
    limits: dict[str, Any] = {
        "waypoints": waypoints,
        "stroke": strokes.get("") if set(strokes) == {""} else strokes or None,
        "free": parse_bounds("--free", free or ()),
        "rate": fastest,
        "tension": tension,
        "robust": parse_bounds("--robust", robust or ()),
        "period": period,
        "seconds": seconds,
        "seed": seed,
    }
    motion = None if target is None else parse_target(target)
    from crawler_model import Front, load_scene, optimise, pareto, prepare, read_posterior

    loaded = load_scene(scene)
    if png is not None:
        refuse_turning(loaded, "--png")
    if robust_to is not None:
        over = (robust_of or Over.expected).value
        limits |= {"robust_to": read_posterior(robust_to, loaded), "robust_of": over}
    _ask_about_units(strokes, loaded)
    prepare(loaded)
    with progress_bar("optimising") as progress:
        found: Front | Optimum
        if compromises:
            found = pareto(loaded, progress=progress, **limits)
        else:
            found = optimise(loaded, objective.value, progress=progress, target=motion, **limits)
    _write(found, out, png)
    if as_json:
        print(json.dumps(found.summary(), allow_nan=False))
    else:
        lines = describe_front(found) if isinstance(found, Front) else describe_optimum(found)
        lines += [f"{what}: {file}" for what, file in (("scene", out), ("picture", png)) if file is not None]
        screen.print("\n".join(lines), markup=False)


def parse_target(text: str) -> tuple[float, float, float]:
    """Parse the option `--target`.

    Args:
        text: DX,DY,DYAW.

    Returns:
        dx, dy [m] and dyaw [rad].

    Raises:
        CrawlerError: if it is not three numbers.
    """
    try:
        dx, dy, dyaw = (float(part) for part in text.split(","))
    except ValueError:
        raise CrawlerError(f"--target {text}: write DX,DY,DYAW, for example 0.2,0,0.1") from None
    return dx, dy, dyaw


def _ask_about_units(strokes: dict[str, tuple[float, float]], scene: Scene) -> None:
    """Warn about strokes far beyond the length of the body, most of which are in millimetres."""
    if scene.body.segments:  # strokes may be strains
        return
    length = float(np.linalg.norm(np.ptp(scene.body.position, axis=0)))
    for low, high in strokes.values():
        if max(abs(low), abs(high)) >= _TOO_LONG * length:
            text = f"--stroke {low:g}:{high:g} is in metres, but the body is {length:g} m long: millimetres?"
            print(f"crawler: {text}", file=sys.stderr)


def _check_outputs(out: Path | None, png: Path | None, force: bool, compromises: bool) -> None:
    if compromises and out is not None:
        raise CrawlerError("--out: with --pareto there are several gaits; --json prints the drives of all")
    check_output("--out", out, ".yaml", force)
    check_output("--png", png, ".png", force)


def _write(found: Front | Optimum, out: Path | None, png: Path | None) -> None:
    """Write the scene and the picture that were asked for."""
    from crawler_model import Front

    if not isinstance(found, Front) and out is not None:
        write_scene(found.scene, out)
    if png is not None:
        from crawler_pictures.optimum import draw_front, draw_optimum

        from .many.units import unit_of

        with whole_file(png) as part:
            if isinstance(found, Front):
                draw_front(found, part)
            else:
                draw_optimum(found, {name: unit_of(found.scene, name) for name in found.names}, part)


def _check_robust(robust: list[str] | None, fit: Path | None, over: Over | None, compromises: bool) -> None:
    if fit is None and over is not None:
        raise CrawlerError(f"--robust-of {over.value}: it needs --robust-to FIT.json")
    for option, given in (("--robust", robust), ("--pareto", compromises)):
        if fit is not None and given:
            raise CrawlerError(f"--robust-to: it cannot be combined with {option}; give one of them")


def describe_optimum(found: Optimum) -> list[str]:
    """Describe an optimum in a few lines.

    Args:
        found: the optimum.

    Returns:
        The lines.
    """
    words = {
        "translation": "gain per period",
        "cost-of-transport": "cost of transport",
        "travel": "gain / travel",
        "turn": "turn per period",
        "screw": "distance from the target",
    }
    unit = "" if found.unit == "1" else f" {found.unit}"
    worst = ", the worst over the box" if found.weaknesses else ""
    if found.robustness is not None:
        kind = "the mean" if found.robustness.over == "expected" else "the worst"
        worst = f", {kind} of {found.robustness.drawn} bodies drawn from the posterior"
    lines = [f"{found.scene.name}: {words[found.objective]} {found.value:.6g}{unit}{worst}"]
    if found.motion is not None:
        dx, dy, dyaw = found.motion
        lines.append(f"motion per period {dx:.6g} m forward, {dy:.6g} m to the left, {dyaw:.6g} rad")
    elif found.gain <= 0.0:
        lines.append("no gait within these bounds was found that moves forward")
    lines.append(
        f"gain {found.gain:.6g} m a period, cost of transport {found.cost_of_transport:.4g}, "
        f"travel {found.travel:.4g} m, largest tension {found.peak_tension:.4g} N; "
        f"transient left {found.transient_left:.1e} m"
    )
    lines.append(describe_pace(found))
    shown = list(zip(found.names, found.values, strict=True))
    lines += [f"  {name} = {value:.6g}" for name, value in shown[:_SHOWN_ROWS]]
    if len(shown) > _SHOWN_ROWS:
        lines.append(f"  ... and {len(shown) - _SHOWN_ROWS} more unknowns")
    slope = "one-sided derivatives" if not found.differentiable else "differentiable"
    slope = f"{slope}, projected gradient {found.gradient_norm:.1e}" if found.motion is None else "without derivatives"
    lines.append(
        f"{slope}; {len(found.active_bounds)} active bounds; "
        f"{'unique' if found.unique else 'not unique'} as far as the search has seen"
    )
    if found.flat:
        more = " ..." if len(found.flat) > 4 else ""
        lines.append(f"{len(found.flat)} unknowns change nothing near it: {', '.join(found.flat[:4])}{more}")
    if found.alternatives:
        lines.append("other local optima: " + ", ".join(f"{one.value:.6g}{unit}" for one in found.alternatives))
    for weakness in found.weaknesses:
        lines.append(f"robust: {describe_weakness(weakness.key, weakness.below, weakness.above)}")
    if found.robustness is not None:
        one = found.robustness
        lines.append(
            f"on {one.verified} other bodies: mean {one.mean:.6g}{unit}, worst {one.worst:.6g}{unit}; with the "
            f"best-fit values {one.best_fit:.6g}{unit}"
        )
        lines += [
            f"it depends on {name}, which the record did not excite: it keeps its value in the scene"
            for name in one.unknown
        ]
    ending = _NOTHING_BETTER if found.complete else _STOPPED_EARLY
    lines.append(
        f"found after {found.found_after_s:.3g} s, {found.evaluations} evaluations in {found.wall_s:.3g} s, "
        f"seed {found.seed}{ending}"
    )
    return lines


def describe_pace(found: Optimum) -> str:
    """Describe a gait by what motors feel: the gain per second, per length of stroke and per reversal.

    Args:
        found: the optimum.

    Returns:
        One line; a gait that reverses often without a limit of its rates has a remark.
    """
    drive = found.scene.drive
    rows = drive.actuation.reshape(drive.times.size, -1)
    reversals = [count_reversals(column) for column in rows.T]
    period, most = drive.period or float(drive.times[-1]), max(reversals, default=0)
    per_stroke = f", {found.gain / found.travel:.4g} m per m of stroke" if found.travel > 0.0 else ""
    per_reversal = f", {found.gain / sum(reversals):.4g} m per reversal" if most else ""
    hint = "; --fastest limits the speed, --waypoints the number of reversals" if most > _HASTY else ""
    return (
        f"gain {found.gain / period:.4g} m/s{per_stroke}{per_reversal}; a link reverses up to {most / period:.3g} "
        f"times a second{hint}"
    )


def count_reversals(values: np.ndarray) -> int:
    """Count how often a periodic quantity changes its direction in a period.

    Args:
        values: at its waypoints, the last one equal to the first, shape (T,).

    Returns:
        The number of reversals.
    """
    steps = np.diff(values)
    signs = np.sign(steps[np.abs(steps) > 1e-9 * np.ptp(values)])
    return int((signs != np.roll(signs, 1)).sum())


def describe_weakness(key: str, below: float | None, above: float | None) -> str:
    """Describe at which change of a number a gait fails.

    Args:
        key: the number.
        below: the factor below which it does, or None.
        above: the factor above which it does, or None.

    Returns:
        A clause.
    """
    edges = [f"{factor:.4g}" for factor in (below, above) if factor is not None]
    if not edges:
        return f"no change of {key} by a factor of up to 100 stops the gait"
    return f"the gait no longer moves forward when {key} changes by the factor {' or '.join(edges)}"


def describe_front(found: Front) -> list[str]:
    """Describe the curve of gain against cost of transport.

    Args:
        found: the curve.

    Returns:
        The lines.
    """
    lines = [f"{found.points[0].scene.name}: gain per period [m], cost of transport [1]"]
    lines += [f"  {point.gain:.6g}  {point.cost_of_transport:.6g}" for point in found.points]
    ending = _NOTHING_BETTER if found.complete else _STOPPED_EARLY
    lines.append(f"{found.evaluations} evaluations in {found.wall_s:.3g} s, seed {found.seed}{ending}")
    return lines
