"""Pictures of an instant without a display: screenshots of the rerun view, or drawn by matplotlib."""

from __future__ import annotations

import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import CrawlerError, Scene
from crawler_model.body.drive import NS
from crawler_pictures.domain import draw_domain as draw_domain
from crawler_pictures.style import own_style

from .arrays import film_of_frames

if TYPE_CHECKING:
    from .frames import Frame

_MOST_SAMPLES = 2000
_TIMELINE = "sim_time"
_MENU = 36  # rows of the menu, which holds the viewer's own warnings [pixels]
_PATIENCE_S = 60.0
_AT_REST_S = 3.0  # at its start the viewer shows notices that cover a corner and vanish
_NO_DRIVER = ("No graphics adapter", "render context", "create render state", "Vulkan", "wgpu")
INSTALL = "rendering without a display needs one (Debian, Ubuntu: apt install mesa-vulkan-drivers)"


class PictureError(CrawlerError):
    """A picture that cannot be drawn on this machine."""


class DriverError(PictureError):
    """The viewer needs a Vulkan driver."""


@own_style()
def draw_instant(scene: Scene, frames: Sequence[Frame], png: Path, at_s: float | None = None) -> None:
    """Draw the body at an instant, its contacts over time and its stasis domain by matplotlib, without a viewer.

    Args:
        scene: the scene that ran.
        frames: the frames in sequence.
        png: the file to write.
        at_s: simulated time to show [s]; None for the end.

    Raises:
        PictureError: when the recording has no such time.
        CrawlerError: when there is no frame.
    """
    from PIL import Image

    from crawler_pictures.film.stage import Stage

    film = film_of_frames(scene, frames)
    start, end = float(film.time[0]), float(film.time[-1])
    shown = end if at_s is None else at_s
    _check_instant(shown, start, end)
    times = np.unique(np.append(np.linspace(start, end, min(film.time.size, _MOST_SAMPLES)), shown))
    picture = Stage(film.sample(times), 1920, 1080).draw(int(np.searchsorted(times, shown)))
    Image.fromarray(picture).save(png)


def _check_instant(at_s: float, start: float, end: float) -> None:
    """Check that a time is in a recording, all in s."""
    if not start <= at_s <= end:
        raise PictureError(f"--at: {at_s:g} s; the recording goes from {start:g} to {end:g} s")


def screenshot(rrd: Path, png: Path, at_s: float | None = None) -> None:
    """Render the rerun view without a display; this needs a Vulkan driver (Debian: mesa-vulkan-drivers).

    Args:
        rrd: the recording to show.
        png: the file to write.
        at_s: simulated time to show [s]; None for the end.

    Raises:
        DriverError: when there is no driver.
        PictureError: when the recording has no such time, or the viewer does not show it.
    """
    from rerun.experimental import ViewerClient

    if at_s is not None and not np.isfinite(at_s):
        raise PictureError(f"--at: {at_s:g} s; it must be a time in the recording")
    port = _free_port()
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "viewer.log"
        with log.open("wb") as output:
            viewer = subprocess.Popen(
                [
                    *(viewer_binary(), "--headless", "--bind", "127.0.0.1", "--port", str(port)),
                    *("--hide-welcome-screen", "--window-size", "1920x1080", str(rrd.absolute())),
                ],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
            )
        try:
            url = f"rerun+http://127.0.0.1:{port}/proxy"
            _shoot(_Viewer(lambda: ViewerClient(url), viewer, log, png), Path(folder), at_s)
        finally:
            viewer.kill()
            viewer.wait()


class _Viewer:
    """A viewer in a process of its own, polled until it answers, fails or exceeds the time limit."""

    def __init__(self, connect: Callable[[], Any], process: subprocess.Popen[bytes], log: Path, png: Path) -> None:
        self.png = png
        self._process, self._log = process, log
        self.client = self.wait("the viewer cannot be reached", connect)
        self._state = getattr(self.client, "get_state", None) or self.client.viewer_state  # rerun 0.41, and before
        known = signature(self.client.set_time).parameters
        self._pause = {"play_state": "paused"} if "play_state" in known else {}  # before 0.41 it always pauses

    def wait(self, what: str, ask: Callable[[], Any]) -> Any:
        """Poll until the answer is not None; exceptions count as no answer."""
        deadline = time.monotonic() + _PATIENCE_S
        last = ""
        while time.monotonic() < deadline:
            try:
                found = ask()
            except PictureError:
                raise
            except Exception as error:  # rerun's errors have no common type; it may not be listening yet
                found, last = None, f": {' '.join(str(error).split())[:200]}"
            if found is not None:
                return found
            if self._process.poll() is not None:
                raise self._why_ended()
            time.sleep(0.1)
        raise PictureError(f"{self.png}: {what}{last}")

    def shown(self) -> Any:
        """Return the recording shown, with its cursor, once it is fully loaded; None before."""
        state = self._state()
        found = [r for r in state.recordings if r.store_id == state.active_recording]
        return found[0] if found and not state.loading and state.views else None

    def set_time(self, ns: int) -> None:
        """Move the cursor and pause it there."""
        self.client.set_time(_TIMELINE, duration=np.timedelta64(ns, "ns"), **self._pause)

    def _why_ended(self) -> PictureError:
        text = self._log.read_text(encoding="utf-8", errors="replace")
        if any(word in text for word in _NO_DRIVER):
            return DriverError(f"this machine has no Vulkan driver; {INSTALL}")
        panic = text[text.find("panicked at") :].splitlines()[:1] if "panicked at" in text else text.splitlines()[-1:]
        what = f"the viewer ended: {' '.join(panic)[:200]}"
        return DriverError(f"{what}; if this machine has no Vulkan driver, {INSTALL}")


def _shoot(viewer: _Viewer, folder: Path, at_s: float | None) -> None:
    """Move to a time, wait until it is shown, and save the picture without menu once it no longer changes."""
    import io

    from PIL import Image

    def range_ns() -> tuple[int, int] | None:
        recording = viewer.shown()
        for timeline in recording.timelines if recording else ():
            if timeline.name == _TIMELINE and timeline.start is not None and timeline.end is not None:
                return int(timeline.start), int(timeline.end)
        return None

    start, end = viewer.wait("the viewer shows no recording with simulated time", range_ns)
    ns = end if at_s is None else round(at_s * NS)
    if at_s is not None:
        _check_instant(at_s, start / NS, end / NS)

    def stands() -> bool | None:
        recording = viewer.shown()
        there = recording is not None and (recording.current_timeline, recording.current_time) == (_TIMELINE, ns)
        if not there:
            viewer.set_time(ns)
        return there or None

    before, since = b"", time.monotonic()

    def same() -> bytes | None:
        nonlocal before, since
        last, shot = before, folder / "shot.png"
        viewer.client.save_screenshot(str(shot))
        before = shot.read_bytes() if stands() else b""
        if not before or before != last:
            since = time.monotonic()
        return before if time.monotonic() - since > _AT_REST_S else None

    viewer.wait(f"the viewer does not go to {ns / NS:g} s", stands)
    picture = viewer.wait(f"the view does not come to rest at {ns / NS:g} s", same)
    whole = Image.open(io.BytesIO(picture))
    whole.crop((0, _MENU, *whole.size)).save(viewer.png)


def viewer_binary() -> str:
    """Find the viewer binary, as killing its wrapper script would leave the viewer running."""
    import rerun_cli

    return str(Path(rerun_cli.__file__).parent / "rerun")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
