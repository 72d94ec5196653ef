"""Pictures of a run: one page by matplotlib, and screenshots of our rerun view without a screen."""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import CrawlerError, Scene
from crawler_model.drive import NS
from crawler_model.stasis import stasis_bounds

from .colors import BACK, FORWARD, STICK, TENSION
from .domain_picture import draw_domain as draw_domain
from .frames import has_stasis_bounds
from .states import station_names

if TYPE_CHECKING:
    from .frames import Frame

_MOST_LINKS, _MOST_NAMED = 4, 12


class PictureError(CrawlerError):
    """A picture that cannot be made on this machine."""


def draw_page(scene: Scene, frames: Sequence[Frame], png: Path) -> None:
    """Draw positions, tensions in their bounds, stick and slip, and net translation over time, on one page.

    Args:
        scene: what ran.
        frames: at least one.
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
    mesh = scene.mesh
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
    """Render our rerun view without a screen; needs a Vulkan driver (Debian: mesa-vulkan-drivers).

    Args:
        rrd: the recording to show.
        png: the file to write.
        at_s: simulated time to show [s]; None for the end.

    Raises:
        PictureError: when the viewer does not start or does not answer.
    """
    from rerun.experimental import ViewerClient

    port = _free_port()
    viewer = subprocess.Popen(
        [
            *(viewer_binary(), "--headless", "--bind", "127.0.0.1", "--port", str(port)),
            *("--hide-welcome-screen", "--window-size", "1920x1080", str(rrd)),
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        client = _connect(ViewerClient, port, viewer)
        time.sleep(2.0)  # the file is loaded and laid out
        if at_s is not None:
            client.set_time("sim_time", duration=at_s)
            time.sleep(1.0)
        client.save_screenshot(str(png))
    except Exception as error:
        raise PictureError(f"{png}: the viewer did not answer: {' '.join(str(error).split())[:200]}") from None
    finally:
        viewer.kill()
        viewer.communicate()


def viewer_binary() -> str:
    """Find the viewer itself: its wrapper script would leave it behind when killed."""
    import rerun_cli

    return str(Path(rerun_cli.__file__).parent / "rerun")


def _connect(client_type: Any, port: int, viewer: subprocess.Popen[str]) -> Any:
    deadline = time.monotonic() + 20.0
    while True:
        if viewer.poll() is not None:
            _, said = viewer.communicate()
            last = said.strip().splitlines()[-1] if said.strip() else "it ended at once"
            raise PictureError(f"the viewer does not start (is a Vulkan driver installed?): {last}")
        try:
            client = client_type(f"rerun+http://127.0.0.1:{port}/proxy")
            ask = getattr(client, "get_state", None) or client.viewer_state  # rerun 0.41, and before
            ask()
            return client
        except Exception:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.3)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
