"""Pictures of a run: one page by matplotlib, and screenshots of the rerun view without a display."""

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
from crawler_model.theory.stasis import stasis_bounds
from crawler_pictures.colors import BACK, FORWARD, STICK, TENSION
from crawler_pictures.domain import draw_domain as draw_domain
from crawler_pictures.ground import draw_jumps

from ..wire.states import station_names

if TYPE_CHECKING:
    from .frames import Frame

_MOST_LINKS, _MOST_NAMED = 4, 12
_TIMELINE = "sim_time"
_PATIENCE_S = 60.0
_AT_REST_S = 3.0  # at its start the viewer shows notices that cover a corner and vanish
_NO_DRIVER = ("No graphics adapter", "render context", "create render state", "Vulkan", "wgpu")
_INSTALL = "rendering without a display needs one (Debian, Ubuntu: apt install mesa-vulkan-drivers)"


class PictureError(CrawlerError):
    """A picture that cannot be drawn on this machine."""


def draw_page(scene: Scene, frames: Sequence[Frame], png: Path) -> None:
    """Draw positions and jumps, tensions in their bounds, stick and slip, and net translation over time, on one page.

    Args:
        scene: the scene that ran.
        frames: the frames, at least one.
        png: the file to write.

    Raises:
        PictureError: when there is no frame.
    """
    if not frames:
        raise PictureError(f"{png}: there is no state to draw")
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.colors import ListedColormap

    time_s = np.array([f.time_ns for f in frames]) / NS
    x = np.array([f.displacement for f in frames])
    tension = np.array([f.tension for f in frames])
    state = np.array([f.state for f in frames])
    friction = [np.array([getattr(f, side) for f in frames]) for side in ("forward", "backward")]
    mesh = scene.body
    bounded = has_stasis_bounds(mesh)
    least, most = stasis_bounds(tension, *friction) if bounded else (tension, tension)
    contacts, plots = state.shape[1], min(tension.shape[1], _MOST_LINKS)
    x = x.reshape(time_s.size, contacts, -1)[:, :, 0]  # in the plane, along x
    at = mesh.position[mesh.stations].reshape(contacts, -1)[:, 0]

    heights = [2.2] + [1.0] * plots + [0.35 + 0.12 * min(contacts, 12), 1.4]
    figure, axes = plt.subplots(
        len(heights), 1, sharex=True, figsize=(11, 1.5 * sum(heights)), height_ratios=heights, layout="constrained"
    )
    figure.suptitle(f"crawler: {scene.name}")
    place = at + x
    names = [name.removeprefix("contact_") for name in station_names(mesh)]
    axes[0].plot(time_s, place, color="#9a9a9a", linewidth=0.8)
    for sign, color in ((1, FORWARD), (-1, BACK)):
        axes[0].plot(time_s, np.where(state == sign, place, np.nan), color=color, linewidth=2.2)
    draw_jumps(axes[0], [jump for frame in frames for jump in frame.jumps])
    if axes[0].get_legend_handles_labels()[0]:
        axes[0].legend(fontsize=8, loc="upper left", frameon=False)
    axes[0].set_ylabel("contacts [m]")
    for i in range(contacts if contacts <= _MOST_NAMED else 0):
        axes[0].annotate(names[i], (time_s[0], place[0, i]), (4, 3), textcoords="offset points", fontsize=8)
    axes[0].set_title(
        "green: slips forward, red: slips back, grey: sticks; tensions (blue)"
        + (" between their bounds" if bounded else ""),
        fontsize=8,
    )
    for i in range(plots):
        axes[1 + i].fill_between(time_s, least[:, i], most[:, i], color="#f2dcda", linewidth=0, label="bounds")
        for bound in (least, most):
            axes[1 + i].plot(time_s, bound[:, i], color="#c83c3c", linewidth=0.6)
        axes[1 + i].plot(time_s, tension[:, i], color=TENSION, linewidth=1.4)
        axes[1 + i].set_ylabel(f"$T_{{{i}}}$ [N]")
    edges = np.append(time_s, time_s[-1] + (time_s[-1] - time_s[-2] if time_s.size > 1 else 1.0))
    colors = ListedColormap([BACK, STICK, FORWARD])
    axes[-2].pcolormesh(edges, np.arange(contacts + 1) - 0.5, state.T, cmap=colors, vmin=-1, vmax=1)
    shown = range(contacts) if contacts <= _MOST_NAMED else [0, contacts - 1]
    axes[-2].set_yticks(shown, [names[i] for i in shown])
    axes[-2].set_ylabel("contact")
    axes[-1].plot(time_s, x @ mesh.station_share, color="black")
    axes[-1].set_ylabel("net translation [m]" + (",\nfrom the ends of segments" if mesh.segments else ""))
    axes[-1].set_xlabel("simulated time [s]")
    for axis in axes:
        axis.margins(x=0)
    figure.savefig(png, dpi=110)
    plt.close(figure)


def screenshot(rrd: Path, png: Path, at_s: float | None = None) -> None:
    """Render the rerun view without a display; this needs a Vulkan driver (Debian: mesa-vulkan-drivers).

    Args:
        rrd: the recording to show.
        png: the file to write.
        at_s: simulated time to show [s]; None for the end.

    Raises:
        PictureError: when there is no driver, the recording has no such time, or the viewer does not show it.
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
                raise PictureError(f"{self.png}: {self._why_ended()}")
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

    def _why_ended(self) -> str:
        text = self._log.read_text(encoding="utf-8", errors="replace")
        if any(word in text for word in _NO_DRIVER):
            return f"this machine has no Vulkan driver; {_INSTALL}"
        panic = text[text.find("panicked at") :].splitlines()[:1] if "panicked at" in text else text.splitlines()[-1:]
        return f"the viewer ended: {' '.join(panic)[:200]}; if this machine has no Vulkan driver, {_INSTALL}"


def _shoot(viewer: _Viewer, folder: Path, at_s: float | None) -> None:
    """Move to a time, wait until it is shown, and save the picture once it no longer changes."""

    def range_ns() -> tuple[int, int] | None:
        recording = viewer.shown()
        for timeline in recording.timelines if recording else ():
            if timeline.name == _TIMELINE and timeline.start is not None and timeline.end is not None:
                return int(timeline.start), int(timeline.end)
        return None

    start, end = viewer.wait("the viewer shows no recording with simulated time", range_ns)
    ns = end if at_s is None else round(at_s * NS)
    if not start <= ns <= end:
        raise PictureError(f"--at: {at_s:g} s; the recording goes from {start / NS:g} to {end / NS:g} s")

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
    viewer.png.write_bytes(viewer.wait(f"the view does not come to rest at {ns / NS:g} s", same))


def viewer_binary() -> str:
    """Find the viewer binary, as killing its wrapper script would leave the viewer running."""
    import rerun_cli

    return str(Path(rerun_cli.__file__).parent / "rerun")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
