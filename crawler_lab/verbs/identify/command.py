"""The verb `identify`: parameters of a scene from recordings and tables of measurements."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from crawler_command.pages import takes_page
from crawler_command.screen import (
    PICTURES,
    READERS,
    ForceOption,
    check_output,
    parse_bounds,
    progress_bar,
    require,
    screen,
    whole_file,
    write_scene,
)
from crawler_model import CrawlerError

from .options import SI, parse_columns, parse_sensor, parse_units

if TYPE_CHECKING:
    from crawler_model import Scene

    from ...identify.identification import Identification
    from ...identify.measurements import Measurements

_TABLES = (".csv", ".tsv", ".txt", ".parquet")
_TOPICS = ("joint_states", "contact_states", "applied_commands")

TopicOption = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME=RECORDED", help="Recorded name of a topic, for example joint_states=/robot/js."),
]
ColumnsOption = Annotated[
    list[str] | None,
    typer.Option(metavar="OURS=THEIRS[,...]", help="Names of columns of tables, for example contact_0=HeadX,time=t."),
]
UnitsOption = Annotated[
    str | None,
    typer.Option(metavar="LENGTH,TIME", help="Units of tables: m, cm, mm or um; s, ms, us or ns. By default m,s."),
]
SensorOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE[,...]",
        help="Uncertainty of lag (50ms), scale (0.5%), drift (2mm), gain (0%) and, without an offset of each channel, "
        "place of markers (1mm) before the fit, for example "
        "lag=20ms,scale=0.2%,drift=1mm; fix: holds a number (lag=fix:43ms), `perfect` all of them at 0.",
    ),
]
CommandsOption = Annotated[
    Path | None, typer.Option(help="A table of the commands at their own times, instead of commands in other tables.")
]


@takes_page
def identify_command(
    recordings: Annotated[
        list[Path],
        typer.Argument(
            help="Bag folders, .mcap files, tables of measurements (.csv, .tsv, .txt or .parquet); "
            "of a folder of bags, the newest."
        ),
    ],
    scene: Annotated[str, typer.Option(help="The scene that was measured, a file or a gallery name: the first guess.")],
    fit: Annotated[
        list[str],
        typer.Option(metavar="KEY[,KEY...]", help="Numbers of the scene to find, by their dotted keys."),
    ],
    bounds: Annotated[
        list[str] | None, typer.Option(metavar="KEY=A:B", help="Lower and upper bound of a fitted key.")
    ] = None,
    hold_out: Annotated[
        float, typer.Option(help="Fraction of the measurements that is predicted instead of fitted.", min=0.0, max=0.8)
    ] = 0.2,
    topic: TopicOption = None,
    columns: ColumnsOption = None,
    units: UnitsOption = None,
    commands: CommandsOption = None,
    sensor: SensorOption = None,
    offset: Annotated[
        str | None,
        typer.Option(
            help="Unknown offsets of positions: none, frame (one per recording) or each (per channel).  "
            "\\[default: each; frame if the start is fitted]"
        ),
    ] = None,
    starts: Annotated[int, typer.Option(help="Number of starts, unless an earlier one fits.", min=1)] = 8,
    seconds: Annotated[
        float,
        typer.Option(help="Time for more starts while none fits, s of a usual processor; 0 for one.", min=0.0),
    ] = 10.0,
    seed: Annotated[int, typer.Option(help="Seed of the random starts.", min=0)] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Write a scene with the values found, which plays the first recording.")
    ] = None,
    png: Annotated[
        Path | None, typer.Option(help="Draw measurements, model and residuals to this file: .png, .pdf or .svg.")
    ] = None,
    html: Annotated[Path | None, typer.Option(help="Write everything to this page, which needs no other file.")] = None,
    force: ForceOption = False,
) -> None:
    """Find the numbers of a scene from measured motion, and what the motion tells about each of them.

    A parameter is identified (with a 95 % interval), determined only as a ratio to others, bounded from one side, or
    not excited by the recorded motion. Lag, scale, offsets and drifts of the camera are found with them. The misfit is
    a size: residuals in units of the noise, where they are largest, and which change of the model would explain them.
    The exit status is 1 if they are larger than noise. Ctrl-C ends the search for other starts and keeps the best so
    far.
    """
    from crawler_model import load_scene

    from ...identify.identify import identify

    _check_files(recordings, out, png, html, force)
    chosen, known, loaded = _parse_offset(offset), parse_sensor(sensor or ()), load_scene(scene)
    keys = split_keys(fit)
    limits = parse_bounds("--bounds", bounds or ())
    described = _describe_tables(recordings, columns, units, commands)
    topics = _parse_topics(topic or ())
    measured = [one for path in recordings for one in _read(path, loaded, topics, described)]
    with progress_bar("identifying") as progress:
        found = identify(loaded, measured, keys, limits, hold_out, chosen, known, starts, seed, progress, seconds)
    _print(found, _write(found, out, png, html), as_json)
    if found.interrupted:
        raise typer.Exit(130)
    if not found.model_fits:
        raise CrawlerError(f"the model does not fit: {found.where}")


def _parse_offset(offset: str | None) -> Literal["none", "frame", "each"] | None:
    if offset not in (None, "none", "frame", "each"):
        raise CrawlerError(f"--offset: {offset}; it must be none, frame or each")
    return offset  # type: ignore[return-value]


def _check_files(
    recordings: Sequence[Path], out: Path | None, png: Path | None, html: Path | None, force: bool
) -> None:
    """Refuse files that cannot be read or written before anything is computed."""
    for path in recordings:
        require(*(("pyarrow",) if _is_table(path) else READERS))
    for option, file, suffixes in (("--out", out, ".yaml"), ("--png", png, PICTURES), ("--html", html, ".html")):
        check_output(option, file, suffixes, force)
    if html is not None:
        require("matplotlib")


def _print(found: Identification, written: list[str], as_json: bool) -> None:
    """Print the result, and a line about each file that was written."""
    if as_json:
        print(json.dumps(found.summary(), allow_nan=False))
        return
    from .report import print_identification

    print_identification(found, screen)
    for line in written:
        screen.print(line)


def split_keys(texts: Sequence[str]) -> list[str]:
    """Split the `--fit` options.

    Args:
        texts: each one or several keys, with commas between them.

    Returns:
        The keys.
    """
    return [key.strip() for text in texts for key in text.split(",") if key.strip()]


def _parse_topics(texts: Sequence[str]) -> dict[str, str]:
    """Parse the `--topic` options, each NAME=RECORDED, into the recorded names by name."""
    found: dict[str, str] = {}
    for text in texts:
        name, _, recorded = text.partition("=")
        if name not in _TOPICS or not recorded:
            raise CrawlerError(f"--topic {text}: write NAME=RECORDED with NAME one of {', '.join(_TOPICS)}")
        found[name] = recorded
    return found


def _describe_tables(
    recordings: Sequence[Path], columns: Sequence[str] | None, units: str | None, commands: Path | None
) -> dict[str, Any]:
    """Parse the options that apply only to tables into arguments of `read_table`."""
    for option, given in (("--columns", columns), ("--units", units), ("--commands", commands)):
        other = next((path for path in recordings if not _is_table(path)), None)
        if given and other is not None:
            if not other.exists():
                raise CrawlerError(f"{other}: no such file")
            names = ", ".join(_TABLES)
            raise CrawlerError(f"{option}: {other} is a recording; the option applies only to tables: {names}")
    if commands is not None and not _is_table(commands):
        raise CrawlerError(f"--commands: {commands} is not a table; its name must end in one of {', '.join(_TABLES)}")
    return {
        "columns": parse_columns(columns or ()),
        "units": SI if units is None else parse_units(units),
        "commands": commands,
    }


def _is_table(path: Path) -> bool:
    return path.suffix.lower() in _TABLES


def _read(path: Path, scene: Scene, topics: Mapping[str, str], described: Mapping[str, Any]) -> list[Measurements]:
    if _is_table(path):
        from .tables import read_table

        return [read_table(path, scene, **described)]
    from ...identify.recorded import read_bag

    return read_bag(path, scene, topics)


def _note_bounds(found: Identification) -> list[str]:
    """Mark the numbers that the measurements only bound."""
    bounded = [f"  {p.name}: {p.why}" for p in found.parameters if p.verdict == "bound" and not p.ended]
    return ["Values clear of their bounds, as the measurements only bound these numbers:", *bounded] if bounded else []


def _write(found: Identification, out: Path | None, png: Path | None, html: Path | None) -> list[str]:
    """Write the files that were asked for; return a line about each."""
    import tempfile

    if out is None and png is None and html is None:
        return []
    if out is not None:
        write_scene(found.playback(), out, _note_bounds(found))
    if png is not None or html is not None:
        from ...pictures.identification import draw_identification
        from .report import write_page

        with tempfile.TemporaryDirectory() as folder:
            picture = Path(folder) / "picture.png"
            draw_identification(found, picture)
            if html is not None:
                with whole_file(html) as part:
                    write_page(found, picture, part)
            if png is not None:
                with whole_file(png) as part:
                    part.write_bytes(picture.read_bytes())
    named = {"scene": out, "picture": png, "page": html}
    return [f"{what}: {path}" for what, path in named.items() if path is not None]
