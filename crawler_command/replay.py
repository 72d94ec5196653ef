"""The verbs `crawler replay` and `crawler compare`, and the executable `replay`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crawler_model import CrawlerError

from .screen import check_picture, progress_bar, screen

if TYPE_CHECKING:
    from crawler_model import Scene
    from crawler_ros.replay.health import Survey
    from crawler_ros.replay.ramps import Sink

Recording = Annotated[
    Path, typer.Argument(help="A bag folder or an .mcap file, complete or not; for a folder of bags, the newest.")
]
SceneOption = Annotated[
    str | None,
    typer.Option(help="The scene that ran, a file or a gallery name, for a recording that does not hold it."),
]
NamespaceOption = Annotated[str | None, typer.Option(help="Namespace of the crawler, where several were recorded.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")]


def replay(
    recording: Recording,
    scene: SceneOption = None,
    as_json: JsonOption = False,
    rrd: Annotated[Path | None, typer.Option(help="Write the run to this file for rerun.")] = None,
    parquet: Annotated[Path | None, typer.Option(help="Write tables to this new folder.")] = None,
    png: Annotated[Path | None, typer.Option(help="Draw one page to this file.")] = None,
    recover: Annotated[
        bool, typer.Option("--recover", help="Write the readable part of a damaged recording to a new one beside it.")
    ] = False,
    namespace: NamespaceOption = None,
    show: Annotated[
        bool,
        typer.Option("--show", help="Print the scene, parameters and versions in the recording as YAML, and exit."),
    ] = False,
) -> None:
    """Analyse a recording: completeness, cycles, slips, energy; simulate it again and compare.

    The exit status is 0 when the recording is complete and, if its scene is known, identical to the bit when simulated
    again.
    """
    from crawler_model import load_scene
    from crawler_ros.recording.bag import newest
    from crawler_ros.replay import analyse

    check_picture(png)
    _check_outputs(rrd, parquet)
    recording = newest(recording)
    if show:
        _show(recording)
        return
    recovered = ""
    if recover:
        recording, recovered = _recover(recording)
    loaded = None if scene is None else load_scene(scene)
    outputs = _Outputs(parquet, png)
    with progress_bar("replaying") as progress:
        found = analyse(recording, loaded, namespace, outputs.open, progress)
    written = outputs.write(found)
    if rrd is not None:
        if found.scene is None:
            raise CrawlerError(f"--rrd: {recording} does not hold its scene; name it with --scene")
        from crawler_ros.viewer.visualizer import draw_recording

        draw_recording(recording, rrd, found.scene, found.robot, found.table.jumps)
        written.append(f"drawn: {rrd}")
    if as_json:
        print(json.dumps(found.as_plain(), allow_nan=False))
    else:
        from crawler_ros.replay.show.report import print_replay

        print_replay(found, screen)
        for line in (recovered, *written):
            if line:
                screen.print(line)
    if not found.healthy:
        more = f" (and {len(found.problems) - 1} more)" if len(found.problems) > 1 else ""
        raise CrawlerError(f"{recording}: {found.problems[0]}{more}")


def _check_outputs(rrd: Path | None, parquet: Path | None) -> None:
    if rrd is not None and rrd.suffix != ".rrd":
        raise CrawlerError(f"--rrd: {rrd} must end in .rrd")
    if rrd is not None and not rrd.absolute().parent.is_dir():
        raise CrawlerError(f"--rrd: the folder {rrd.absolute().parent} does not exist")
    if parquet is not None and parquet.exists() and (not parquet.is_dir() or any(parquet.iterdir())):
        raise CrawlerError(f"--parquet: {parquet} exists already; choose a new folder")


def _show(recording: Path) -> None:
    import yaml

    from crawler_ros.recording import bag

    head = bag.Bag({})
    for _ in bag.read_blocks(recording, head):
        pass
    if not head.attachments:
        raise CrawlerError(
            f"{recording}: the recording holds only messages; recordings of the simulator also hold their scene"
        )
    print(yaml.safe_dump(head.attachments, sort_keys=False, allow_unicode=True), end="")


def _recover(recording: Path) -> tuple[Path, str]:
    """Recover a recording; return the new one, and a line to print."""
    from crawler_ros.recording import bag

    if bag.examine(recording).complete:
        return recording, "nothing to recover: the recording is complete"
    source = recording if recording.is_dir() else recording.with_suffix("")
    folder = source.with_name(source.name + "_recovered")
    if folder.exists():
        raise CrawlerError(f"{folder} exists already: the recording was recovered before")
    return folder, f"recovered {bag.recover(recording, folder)} messages: {folder}"


class _Outputs:
    """The files written while a recording is read, and after."""

    def __init__(self, parquet: Path | None, png: Path | None) -> None:
        self._parquet, self._png = parquet, png
        self._tables: Any = None
        self._samples: Any = None

    def open(self, survey: Survey, scene: Scene | None) -> Sequence[Sink]:
        """Open the sinks of all ramps."""
        if scene is not None:
            from crawler_model import prepare

            prepare(scene)
        sinks: list[Sink] = []
        if self._parquet is not None:
            from crawler_ros.replay.show.tables import TableWriter

            self._tables = TableWriter(self._parquet, scene)
            sinks.append(self._tables)
        if self._png is not None:
            import matplotlib as _required_later  # noqa: F401

            from crawler_ros.replay.show.samples import Samples

            self._samples = Samples(survey)
            sinks.append(self._samples)
        return sinks

    def write(self, found: Any) -> list[str]:
        """Finish the files; return a line for each."""
        written = []
        if self._tables is not None:
            written.append(f"written: {', '.join(self._tables.finish(found))} in {self._parquet}")
        if self._samples is not None and self._png is not None:
            from crawler_ros.replay.show.page import draw_replay

            draw_replay(found, self._samples, self._png)
            written.append(f"drawn: {self._png}")
        return written


def compare(
    first: Annotated[Path, typer.Argument(help="The first recording; for a folder of bags, the newest.")],
    second: Annotated[Path, typer.Argument(help="The second recording, likewise.")],
    scene: SceneOption = None,
    as_json: JsonOption = False,
    png: Annotated[Path | None, typer.Option(help="Draw both runs to this file.")] = None,
    namespace: NamespaceOption = None,
) -> None:
    """Compare two recorded runs on simulated time: commands, translation per cycle, energy, slips."""
    from crawler_model import load_scene
    from crawler_ros.recording.bag import newest
    from crawler_ros.replay.show.compare import compare_recordings, draw_comparison, print_comparison

    check_picture(png)
    loaded = None if scene is None else load_scene(scene)
    with progress_bar("comparing") as progress:
        found = compare_recordings(newest(first), newest(second), loaded, namespace, progress)
    if png is not None:
        draw_comparison(found, png)
    if as_json:
        print(json.dumps(found.as_plain(), allow_nan=False))
        return
    print_comparison(found, screen)
    if png is not None:
        screen.print(f"drawn: {png}")
