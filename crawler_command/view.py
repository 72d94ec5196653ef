"""The verbs `view` and `animate`: a recording in rerun or as a picture; a scene or a recording as a film."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from crawler_model import CrawlerError

from .screen import (
    READERS,
    ForceOption,
    NamespaceOption,
    SceneOption,
    check_output,
    is_recording,
    progress_bar,
    require,
    screen,
    whole_file,
)

if TYPE_CHECKING:
    from crawler_model import Scene
    from crawler_pictures.film.film import Film
    from crawler_ros.viewer.frames import Frame

_SUFFIXES = (".mp4", ".gif", ".html")
_PERIODS = 4
_FASTEST_GIF = 50.0
_TICKS_A_FRAME = 16
"""Ticks from one frame to the next: what slides is shown with an error of a part of a frame."""
_MOST_NUMBERS = 40_000_000
"""Largest number of ticks times contacts; beyond it there are fewer ticks in a frame."""


def view(
    recording: Annotated[
        Path, typer.Argument(help="A bag folder, .mcap or .rrd file; for a folder of bags, the newest.")
    ],
    png: Annotated[Path | None, typer.Option(help="Render to this file instead of opening a window.")] = None,
    at: Annotated[
        float | None, typer.Option(help="With --png: the simulated time to show, s; by default the end.")
    ] = None,
    scene: SceneOption = None,
    namespace: NamespaceOption = None,
    force: ForceOption = False,
) -> None:
    """Open a recording in rerun with our blueprint, or render that view without a display.

    --png renders exactly the instant --at. It needs a Vulkan driver: on Debian and Ubuntu, apt install
    mesa-vulkan-drivers. Without one, a line on standard error reports this and matplotlib draws the body at that
    instant, its contacts over time and its stasis domain; an .rrd file is then refused.
    """
    require("rerun", *([] if recording.suffix == ".rrd" else READERS))
    from crawler_ros.viewer.render import viewer_binary

    if not recording.exists():
        raise CrawlerError(f"{recording}: no such file or folder")
    if recording.is_dir():
        from crawler_ros.recording.bag import newest

        recording = newest(recording)
    if recording.suffix == ".rrd" and recording.read_bytes()[:3] != b"RRF":
        raise CrawlerError(f"{recording}: not a rerun recording")
    if recording.suffix == ".rrd" and (scene is not None or namespace is not None):
        raise CrawlerError(f"--scene, --namespace: {recording} is drawn already; name the recording instead")
    if at is not None and png is None:
        raise CrawlerError("--at needs --png: it is the time to render")
    if at is not None and not math.isfinite(at):
        raise CrawlerError(f"--at: {at:g} s; it must be a time in the recording")
    check_output("--png", png, ".png", force)
    if png is None and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise CrawlerError(
            "this machine has no display; render the view with --png FILE, or copy the .rrd file to your desktop"
        )
    with tempfile.TemporaryDirectory() as folder:
        rrd = recording
        if recording.suffix != ".rrd":
            from crawler_ros.viewer.frames import FRAME_EVERY_NS
            from crawler_ros.viewer.visualizer import draw_frames

            rrd = Path(folder) / "recording.rrd"
            draw_frames(*read_frames(recording, scene, namespace, FRAME_EVERY_NS), rrd)
        if png is not None:
            with progress_bar(f"rendering {png.name}"):
                _render(recording, rrd, png, at, (scene, namespace))
            screen.print(f"rendered: {png}", markup=False)
            return
        raise typer.Exit(subprocess.call([viewer_binary(), "--bind", "127.0.0.1", str(rrd)]))


def _render(recording: Path, rrd: Path, png: Path, at: float | None, given: tuple[str | None, str | None]) -> None:
    """Render an instant by the viewer, or by matplotlib where the viewer finds no driver."""
    from crawler_ros.viewer.render import DriverError, draw_instant, screenshot

    with whole_file(png) as part:
        try:
            screenshot(rrd, part, at)
        except DriverError as error:
            if rrd == recording:
                raise CrawlerError(f"{error}; without it, name the recording instead of its .rrd file") from error
            print(f"crawler: {error}; drawn by matplotlib instead", file=sys.stderr)
            scene, frames = read_frames(recording, *given)
            draw_instant(scene, list(frames), part, at)


def read_frames(
    recording: Path, scene: str | None, namespace: str | None, every_ns: int = 0, jumps: bool = True
) -> tuple[Scene, Iterable[Frame]]:
    """Read the frames of a recording; where only every n-th state was published, simulate it again to draw the others.

    Where it cannot be simulated again, a line on standard error states why, and the recorded frames are drawn.

    Args:
        recording: a bag folder or an .mcap file.
        scene: the scene that ran, for a recording that does not hold it.
        namespace: namespace of the crawler, where several were recorded.
        every_ns: least time between simulated frames [ns].
        jumps: whether to find the jumps on patches of ground or of a body that turns, by a simulation.

    Returns:
        The scene and its frames.

    Raises:
        BagError: when it cannot be read, holds no scene and none is named, or holds several crawlers.
        SceneError: when the named scene is invalid.
    """
    from crawler_model import load_scene
    from crawler_ros.recording.bag import examine, recorded_scene
    from crawler_ros.recording.recorded_robot import noted_robot
    from crawler_ros.replay.analysis import analyse
    from crawler_ros.replay.health import choose_robot, published_every, survey_recording
    from crawler_ros.replay.show.tick_frames import TickFrames
    from crawler_ros.viewer.frames import frames_of_recording

    loaded = None if scene is None else load_scene(scene)
    robot = None if namespace is None else choose_robot(survey_recording(recording), namespace)
    attached = examine(recording).attachments
    ran = loaded or recorded_scene(recording, attached)
    every = published_every(attached) or 1
    jumps = jumps and ran is not None and (ran.ground.lets_go or ran.body.turning is not None)
    if ran is None or (every == 1 and not jumps):
        return frames_of_recording(recording, loaded, robot)
    ticks = TickFrames(ran, every_ns)
    drawn = robot or noted_robot(attached)
    found = analyse(recording, ran, None if drawn is None else drawn.namespace, [ticks] if every > 1 else [])
    if every == 1:
        return frames_of_recording(recording, loaded, robot, found.table.jumps)
    if not ticks.frames:
        shown = f"drawn from the states of every {every}th tick, with straight lines between them"
        print(f"crawler: {recording}: {found.explanation}; {shown}", file=sys.stderr)
        return frames_of_recording(recording, loaded, robot)
    if found.comparison is None or not found.comparison.equal or found.comparison.stopped:
        print(f"crawler: {recording}: drawn as simulated again: {found.explanation}", file=sys.stderr)
    return ran, ticks.frames


def animate(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SCENE|BAG",
            help="A scene file or gallery name, or a recording: a bag folder or an .mcap file; "
            "of a folder of bags, the newest.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="The film to write: .mp4, .gif, or .html with a time slider.")],
    fps: Annotated[float, typer.Option(help="Frames per second of the film.", min=1.0, max=240.0)] = 25.0,
    speed: Annotated[float, typer.Option(help="Simulated seconds per second of the film.")] = 1.0,
    start: Annotated[float, typer.Option("--from", help="Simulated time at which the film begins, s.")] = 0.0,
    end: Annotated[float | None, typer.Option("--to", help="Simulated time at which it ends, s.")] = None,
    duration: Annotated[float | None, typer.Option(help="Simulated time that it shows, s; instead of --to.")] = None,
    talk: Annotated[
        bool, typer.Option("--talk", help="For a large room: 1920 x 1080, large letters, the body and its moving set.")
    ] = False,
    scene: SceneOption = None,
    namespace: NamespaceOption = None,
    force: ForceOption = False,
) -> None:
    """Make a film of a scene or a recording: the crawling body, its contacts over time, and the sweeping process.

    crawler animate two_anchor_a --out film.html --speed 0.5

    For two contacts the film shows the sweeping process, a moving set and the point that it pushes; for three, the
    point in the moving polygon; for more, the contacts over time. By default it shows four periods of a scene, or the
    whole recording. mp4 needs PyAV: pip install 'crawler-ros[animate]'; gif and html need no codec.
    """
    if duration is not None and end is not None:
        raise CrawlerError("--duration and --to cannot be combined: both set the end of the film")
    for option, value in (("--speed", speed), ("--duration", duration)):
        if value is not None and not 0.0 < value < float("inf"):
            raise CrawlerError(f"{option}: {value:g}; it must be > 0")
    if not 0.0 <= start < float("inf"):
        raise CrawlerError(f"--from: {start:g} s; it must be >= 0")
    end = start + duration if duration is not None else end
    if end is not None and not start < end < float("inf"):
        raise CrawlerError(f"--to: {end:g} s; it must be after the start of the film, {start:g} s")
    write = _choose_writer(out, fps, talk, force)
    if is_recording(source):
        require(*READERS)
    elif scene is not None or namespace is not None:
        raise CrawlerError(f"--scene, --namespace: {source} is a scene and no recording")
    with progress_bar("reading" if is_recording(source) else "simulating") as progress:
        if is_recording(source):
            film = _cut(Path(source), (scene, namespace), (start, end), fps, speed)
        else:
            film = _shoot(source, start, end, fps, speed, progress)
    with progress_bar("drawing") as progress, whole_file(out) as part:
        write(film, part, fps, progress)
    screen.print(
        f"written: {out}: {film.time.size} frames, {film.time[0]:g} to {film.time[-1]:g} s of {film.scene.name}"
    )


def _choose_writer(
    out: Path, fps: float, talk: bool, force: bool
) -> Callable[[Film, Path, float, Callable[[float], None]], None]:
    """Check the output before anything runs; return the function that writes it."""
    if out.suffix not in _SUFFIXES:
        raise CrawlerError(f"--out: {out} must end in {', '.join(_SUFFIXES[:-1])} or {_SUFFIXES[-1]}")
    check_output("--out", out, out.suffix, force)
    if out.suffix == ".html":
        if talk:
            raise CrawlerError(f"--talk: {out} fits the window that shows it; name an .mp4 or a .gif")
        from crawler_pictures.film.player import write_html

        return write_html
    require("matplotlib", *(["av"] if out.suffix == ".mp4" else []))
    from crawler_pictures.film import encode

    if out.suffix == ".gif":
        if fps > _FASTEST_GIF:
            raise CrawlerError(f"--fps: {fps:g}; a .gif has at most {_FASTEST_GIF:g} frames per second")
        return partial(encode.write_gif, talk=talk)
    return partial(encode.write_mp4, talk=talk)


def _cut(
    source: Path, given: tuple[str | None, str | None], span: tuple[float, float | None], fps: float, speed: float
) -> Film:
    """Read a recording, and sample it at the frames of the film."""
    from crawler_pictures.film.film import frame_times
    from crawler_ros.recording.bag import newest
    from crawler_ros.viewer.arrays import film_of_frames

    scene, frames = read_frames(newest(source), *given, jumps=False)
    film = film_of_frames(scene, list(frames))
    first, last = float(film.time[0]), float(film.time[-1])
    begin, stop = max(span[0], first), last if span[1] is None else span[1]
    if not first - 1e-9 <= begin < stop <= last + 1e-9:
        raise CrawlerError(f"--from, --to: {span[0]:g} to {stop:g} s; the recording goes from {first:g} to {last:g} s")
    return film.sample(frame_times(begin, stop, fps, speed))


def _shoot(
    source: str, start: float, end: float | None, fps: float, speed: float, progress: Callable[[float], None]
) -> Film:
    """Run a scene, and sample it at the frames of the film."""
    import numpy as np

    from crawler_model import load_scene, prepare, simulate
    from crawler_pictures.film.film import film_of_run, frame_times

    scene = load_scene(source)
    if scene.drive.holds:
        raise CrawlerError(
            f"{source}: the scene has {scene.unmoving_drive}, so nothing moves; record a run, or add a drive"
        )
    period = scene.drive.period
    if end is None:
        end = float(scene.drive.times[-1]) if period is None else start + _PERIODS * period
    times = frame_times(start, end, fps, speed)
    prepare(scene)
    frames = float(times[-1]) * fps / speed
    ticks = int(np.clip(_MOST_NUMBERS / (frames * scene.body.contacts), 1, _TICKS_A_FRAME))
    run = simulate(scene, float(times[-1]), ticks * fps / speed, progress=progress)
    return film_of_run(scene, run).sample(times)
