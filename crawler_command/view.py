"""The verb `view`: a recording in rerun, or rendered to a picture."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from crawler_model import CrawlerError

from .screen import check_picture, screen, whole_file


def view(
    recording: Annotated[
        Path, typer.Argument(help="A bag folder, .mcap or .rrd file; for a folder of bags, the newest.")
    ],
    png: Annotated[Path | None, typer.Option(help="Render to this file instead of opening a window.")] = None,
    at: Annotated[
        float | None, typer.Option(help="With --png: the simulated time to show, s; by default the end.")
    ] = None,
) -> None:
    """Open a recording in rerun with our blueprint, or render that view without a display.

    --png renders exactly the instant --at. It needs a Vulkan driver: on Debian and Ubuntu, apt install
    mesa-vulkan-drivers. Without one, a line on standard error reports this and matplotlib draws the body at that
    instant, its contacts over time and its stasis domain; an .rrd file is then refused.
    """
    from crawler_ros.viewer.page import viewer_binary

    if not recording.exists():
        raise CrawlerError(f"{recording}: no such file or folder")
    if recording.is_dir():
        from crawler_ros.recording.bag import newest

        recording = newest(recording)
    if recording.suffix == ".rrd" and recording.read_bytes()[:3] != b"RRF":
        raise CrawlerError(f"{recording}: not a rerun recording")
    if at is not None and png is None:
        raise CrawlerError("--at needs --png: it is the time to render")
    if at is not None and not math.isfinite(at):
        raise CrawlerError(f"--at: {at:g} s; it must be a time in the recording")
    check_picture(png)
    if png is None and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise CrawlerError(
            "this machine has no display; render the view with --png FILE, or copy the .rrd file to your desktop"
        )
    with tempfile.TemporaryDirectory() as folder:
        rrd = recording
        if recording.suffix != ".rrd":
            from crawler_ros.replay.analysis import find_jumps
            from crawler_ros.viewer.visualizer import draw_recording

            rrd = Path(folder) / "recording.rrd"
            draw_recording(recording, rrd, jumps=find_jumps(recording))
        if png is not None:
            _render(recording, rrd, png, at)
            screen.print(f"rendered: {png}")
            return
        raise typer.Exit(subprocess.call([viewer_binary(), "--bind", "127.0.0.1", str(rrd)]))


def _render(recording: Path, rrd: Path, png: Path, at: float | None) -> None:
    """Render an instant by the viewer, or by matplotlib where the viewer finds no driver."""
    from crawler_ros.viewer.page import DriverError, draw_instant, screenshot

    with whole_file(png) as part:
        try:
            screenshot(rrd, part, at)
        except DriverError as error:
            if rrd == recording:
                raise CrawlerError(f"{error}; without it, name the recording instead of its .rrd file") from error
            from crawler_ros.viewer.frames import frames_of_recording

            print(f"crawler: {error}; drawn by matplotlib instead", file=sys.stderr)
            scene, frames = frames_of_recording(recording)
            draw_instant(scene, list(frames), part, at)
