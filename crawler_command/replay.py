"""The verb `replay`, and the executable of the same name."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crawler_model import CrawlerError
from crawler_ros.node.life.exit import STOPPED

from .pages import takes_page
from .screen import (
    PICTURES,
    READERS,
    ForceOption,
    NamespaceOption,
    SceneOption,
    TwoColumnsOption,
    check_output,
    named_errors,
    progress_bar,
    require,
    screen,
    whole_file,
)

if TYPE_CHECKING:
    from crawler_model import Scene
    from crawler_ros.replay.analysis import Replay
    from crawler_ros.replay.health import Survey
    from crawler_ros.replay.ramps import Sink
    from crawler_ros.replay.show.tick_frames import TickFrames

Recordings = Annotated[
    list[Path],
    typer.Argument(
        help="A bag folder or an .mcap file, complete or not; for a folder of bags, the newest. Several: a data set."
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")]


@takes_page
def replay(
    recordings: Recordings,
    scene: SceneOption = None,
    as_json: JsonOption = False,
    rrd: Annotated[Path | None, typer.Option(help="Write the run to this file for rerun.")] = None,
    parquet: Annotated[Path | None, typer.Option(help="Write tables, or a data set, to this new folder.")] = None,
    png: Annotated[Path | None, typer.Option(help="Draw one page to this file: .png, .pdf or .svg.")] = None,
    two_columns: TwoColumnsOption = False,
    recover: Annotated[
        bool, typer.Option("--recover", help="Write the readable part of a damaged recording to a new one next to it.")
    ] = False,
    namespace: NamespaceOption = None,
    show: Annotated[
        bool,
        typer.Option("--show", help="Print the scene, parameters and versions in the recording as YAML, and exit."),
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue a data set: leave out finished recordings that are unchanged.")
    ] = False,
    workers: Annotated[
        int | None, typer.Option(help="Number of processes for a data set; by default one per core.", min=1)
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="tcp://HOST:PORT", help="Make a data set on the workers of this Dask scheduler."),
    ] = None,
    force: ForceOption = False,
) -> None:
    """Analyse a recording: completeness, cycles, slips, energy; simulate it again and compare.

    The exit status is 0 when the recording is complete and, if its scene is known, identical to the bit when simulated
    again, or equal up to rounding if other versions made it.

    Several recordings, or --resume, --workers or --scheduler, make a data set: --parquet is then a folder of the tables
    runs, cycles, slips and account, partitioned by run, and a folder of bags stands for all of them, at any depth.
    Damaged recordings are skipped and named on standard error; the exit status is 0 when there are none. After Ctrl-C
    the data set holds the finished recordings.
    """
    require(*READERS, *(["pyarrow"] if parquet is not None else []))
    from crawler_model import load_scene
    from crawler_ros.recording.bag import newest
    from crawler_ros.replay import analyse

    if len(recordings) > 1 or resume or workers is not None or scheduler is not None:
        single = {"--rrd": rrd is not None, "--png": png is not None, "--recover": recover, "--show": show}
        _replay_many(recordings, scene, namespace, parquet, resume, workers, scheduler, as_json, single)
        return
    _check_outputs(rrd, parquet, png, two_columns, force)
    recording = newest(recordings[0])
    if show:
        _show(recording)
        return
    recording, recovered = _recover(recording) if recover else (recording, "")
    loaded = None if scene is None else load_scene(scene)
    outputs = _Outputs(parquet, png, two_columns, rrd, namespace)
    with progress_bar("replaying") as progress:
        found = analyse(recording, loaded, namespace, outputs.open, progress)
    written = outputs.write(found)
    if as_json:
        print(json.dumps(found.as_plain(), allow_nan=False))
    else:
        from crawler_ros.replay.show.report import print_replay

        print_replay(found, screen)
        for line in filter(None, (recovered, *written)):
            screen.print(line)
    _check_healthy(recording, found)


def _draw_rrd(recording: Path, rrd: Path, found: Replay, ticks: TickFrames | None) -> None:
    if found.scene is None:
        raise CrawlerError(f"--rrd: {recording} does not hold its scene; name it with --scene")
    from crawler_ros.viewer.visualizer import draw_frames, draw_recording

    if ticks is not None and ticks.frames:
        draw_frames(found.scene, ticks.frames, rrd)
    else:
        draw_recording(recording, rrd, found.scene, found.robot, found.table.jumps)


def _check_healthy(recording: Path, found: Replay) -> None:
    if not found.healthy:
        more = f" (and {len(found.problems) - 1} more)" if len(found.problems) > 1 else ""
        raise CrawlerError(f"{recording}: {found.problems[0]}{more}")


def _replay_many(
    recordings: Sequence[Path],
    scene: str | None,
    namespace: str | None,
    folder: Path | None,
    resume: bool,
    workers: int | None,
    scheduler: str | None,
    as_json: bool,
    single: Mapping[str, bool],
) -> None:
    """Add recordings to a data set; `single` holds the options that cannot be used here, and whether they are."""
    for option, used in single.items():
        if used:
            raise CrawlerError(f"{option}: a data set has none; replay one recording")
    if folder is None:
        raise CrawlerError("--parquet: missing; several recordings make a data set, in a folder to be named")
    from crawler_model import load_scene

    from .recordings.data_set import plan_batch, print_skipped, run_batch

    loaded = None if scene is None else load_scene(scene)
    batch = plan_batch(recordings, folder, resume, loaded, namespace)
    with progress_bar("replaying") as progress:
        report = run_batch(batch, workers, scheduler, progress)
    print_skipped(report)
    print(json.dumps(report.as_plain(folder)) if as_json else report.describe(folder))
    if report.left:
        raise typer.Exit(STOPPED)
    if report.skipped:
        raise typer.Exit(1)


def _check_outputs(rrd: Path | None, parquet: Path | None, png: Path | None, two_columns: bool, force: bool) -> None:
    if two_columns and png is None:
        raise CrawlerError("--two-columns needs --png: it arranges the panels of that page")
    check_output("--png", png, PICTURES, force)
    check_output("--rrd", rrd, ".rrd", force)
    if parquet is not None and parquet.exists() and (not parquet.is_dir() or any(parquet.iterdir())):
        raise CrawlerError(f"--parquet: {parquet} exists already; choose a new folder")


def _show(recording: Path) -> None:
    import yaml

    from crawler_ros.recording.bag import examine

    attachments = examine(recording).attachments
    if not attachments:
        raise CrawlerError(
            f"{recording}: the recording holds only messages; recordings of the simulator also hold their scene"
        )
    print(yaml.safe_dump(attachments, sort_keys=False, allow_unicode=True), end="")


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

    def __init__(
        self, parquet: Path | None, png: Path | None, two_columns: bool, rrd: Path | None, namespace: str | None
    ) -> None:
        self._parquet, self._png, self._two_columns, self._rrd = parquet, png, two_columns, rrd
        self._namespace = namespace
        self._ticks: TickFrames | None = None
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
            sinks.append(named_errors(self._parquet)(self._tables))
        if self._png is not None:
            from crawler_ros.replay.show.samples import Samples

            self._samples = Samples(survey)
            sinks.append(self._samples)
        if self._rrd is not None and scene is not None:
            from crawler_ros.replay.health import choose_robot, find_rate, states_every
            from crawler_ros.replay.show.tick_frames import TickFrames
            from crawler_ros.viewer.frames import FRAME_EVERY_NS

            robot = choose_robot(survey, self._namespace)
            if states_every(survey, robot, find_rate(survey, robot)) > 1:
                self._ticks = TickFrames(scene, FRAME_EVERY_NS)
                sinks.append(self._ticks)
        return sinks

    def write(self, found: Any) -> list[str]:
        """Finish the files; return a line for each."""
        written = []
        if self._tables is not None and self._parquet is not None:
            with named_errors(self._parquet):
                names = self._tables.finish(found)
            written.append(f"written: {', '.join(names)} in {self._parquet}")
        if self._samples is not None and self._png is not None:
            from crawler_ros.replay.show.replay_page import draw_replay

            with whole_file(self._png) as part:
                draw_replay(found, self._samples, part, self._two_columns)
            written.append(f"drawn: {self._png}")
        if self._rrd is not None:
            with whole_file(self._rrd) as part:
                _draw_rrd(found.path, part, found, self._ticks)
            written.append(f"drawn: {self._rrd}")
        return written
