"""One page of a replay: positions, tensions, sliding contacts, translation per cycle and energy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model.body.drive import NS
from crawler_pictures.colors import BACK, FORWARD, GREY, STICK, TENSION
from crawler_pictures.ground import draw_jumps

from ...viewer.page import PictureError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..analysis import Replay
    from .samples import Samples

_MOST_LINKS, _MOST_NAMED, _MOST_CYCLES_BARS = 4, 12, 60


def draw_replay(replay: Replay, samples: Samples, png: Path) -> None:
    """Draw the page.

    Args:
        replay: the analysed recording.
        samples: samples of the run.
        png: the file to write.

    Raises:
        PictureError: when there is no state to draw.
    """
    time = samples.get("end_ns") / NS
    if time.size == 0:
        raise PictureError(f"{png}: there is no state to draw")
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    tension, state = samples.get("tension"), samples.get("state")
    links = min(tension.shape[1], _MOST_LINKS)
    energy = replay.energy is not None
    heights = [2.6, *[1.1] * links, 0.5 + 0.16 * min(state.shape[1], 12), *([1.4] if energy else [])]
    figure = plt.figure(figsize=(11, 1.25 * sum(heights) + 2.9), layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=[1.25 * sum(heights), 2.5])
    axes = np.atleast_1d(parts[0].subplots(len(heights), 1, sharex=True, height_ratios=heights))
    name = "scene not known" if replay.scene is None else replay.scene.name
    verdict = "as recorded, not simulated" if replay.comparison is None else replay.explanation
    figure.suptitle(f"{name}, {replay.path.name}", fontsize=11)
    axes[0].set_title(_short(verdict), fontsize=8, color=GREY, loc="left")
    draw_jumps(axes[0], samples.jumps)
    _draw_positions(axes[0], time, samples.get("position"), state, replay.contacts)
    for i in range(links):
        _draw_tension(axes[1 + i], time, tension[:, i], samples.get("least")[:, i], samples.get("most")[:, i], i)
    _draw_timeline(axes[1 + links], time, state, replay.contacts)
    if energy:
        _draw_energy(axes[-1], time, samples)
    for axis in axes:
        axis.margins(x=0)
        if len(replay.cycles) <= _MOST_CYCLES_BARS:
            for cycle in replay.cycles:
                if cycle.run == 0:
                    axis.axvline(cycle.start, color="#c9c9c9", linewidth=0.5, zorder=0)
    axes[-1].set_xlabel("simulated time [s]" + (", runs between resets one after another" if _resets(replay) else ""))
    figure.align_ylabels(axes)
    _draw_cycles(parts[1].subplots(1, 2, width_ratios=[2, 1]), replay)
    figure.savefig(png, dpi=110)
    plt.close(figure)


def _resets(replay: Replay) -> bool:
    return bool(replay.table.run.size and replay.table.run[-1] > 0)


def _short(text: str, most: int = 150) -> str:
    return text if len(text) <= most else text[: most - 3] + "..."


def _draw_positions(axis: Axes, time: np.ndarray, place: np.ndarray, state: np.ndarray, names: tuple[str, ...]) -> None:
    """Draw the positions of contacts: grey while they stick, green while they slide forward, red back."""
    planar = place.ndim == 3
    place = place[..., 0] if planar else place
    axis.plot(time, place, color="#9a9a9a", linewidth=0.8)
    # the state of a contact in a tick belongs to the line that leads to the end of the tick
    for sign, color in ((1, FORWARD), (-1, BACK)):
        slides = state == sign
        shown = np.where(slides | np.vstack((slides[1:], slides[:1] & False)), place, np.nan)
        axis.plot(time, shown, color=color, linewidth=2.0, solid_capstyle="butt")
    axis.set_ylabel("x of contacts [m]" if planar else "contacts [m]")
    from matplotlib.lines import Line2D

    words = (("slides", FORWARD),) if planar else (("slips forward", FORWARD), ("slips back", BACK))
    handles = [
        Line2D([], [], color=color, linewidth=2.0, label=word) for word, color in (*words, ("sticks", "#9a9a9a"))
    ]
    axis.legend(
        handles=[*handles, *axis.get_legend_handles_labels()[0]], fontsize=8, loc="upper left", ncols=4, frameon=False
    )
    if len(names) <= _MOST_NAMED:
        for i, name in enumerate(names):
            text = name.removeprefix("contact_")
            axis.annotate(text, (time[-1], place[-1, i]), (4, 0), textcoords="offset points", fontsize=8, va="center")


def _draw_tension(
    axis: Axes, time: np.ndarray, tension: np.ndarray, least: np.ndarray, most: np.ndarray, link: int
) -> None:
    """Draw a tension between its bounds in the stasis domain."""
    if tension.ndim == 2:
        axis.plot(time, np.linalg.norm(tension, axis=1), color=TENSION, linewidth=1.3)
        axis.set_ylabel(f"$|T_{{{link}}}|$ [N]")
        return
    if np.isfinite(least).any():
        axis.fill_between(time, least, most, color="#f6e5e3", linewidth=0)
        for bound in (least, most):
            axis.plot(time, bound, color="#c83c3c", linewidth=0.7)
    axis.plot(time, tension, color=TENSION, linewidth=1.5)
    axis.set_ylabel(f"$T_{{{link}}}$ [N]")
    if link == 0 and np.isfinite(least).any():
        axis.set_title("tension (blue) within the stasis domain (red)", fontsize=8, color=GREY, loc="left")


def _draw_timeline(axis: Axes, time: np.ndarray, state: np.ndarray, names: tuple[str, ...]) -> None:
    from matplotlib.colors import ListedColormap

    before = time[0] - (time[1] - time[0]) if time.size > 1 else time[0] - 1.0
    edges = np.append(before, time)
    if state.shape[1] == 0:
        return
    colors: Any = ListedColormap([BACK, STICK, FORWARD])
    count = state.shape[1]
    axis.pcolormesh(edges, np.arange(count + 1) - 0.5, state.T, cmap=colors, vmin=-1, vmax=1, rasterized=True)
    for row in range(1, count if count <= _MOST_NAMED else 0):
        axis.axhline(row - 0.5, color="white", linewidth=2.0)
    shown = range(count) if count <= _MOST_NAMED else [0, count - 1]
    axis.set_yticks(list(shown), [names[i].removeprefix("contact_") for i in shown])
    axis.set_xlim(time[0], time[-1])
    axis.set_ylabel("contact")


def _draw_energy(axis: Axes, time: np.ndarray, samples: Samples) -> None:
    axis.plot(time, samples.get("work"), color="black", linewidth=1.3, label="work of the actuators")
    axis.plot(time, samples.get("dissipation"), color=BACK, linewidth=1.3, label="dissipation")
    axis.plot(time, samples.get("stored"), color=TENSION, linewidth=1.3, label="stored")
    axis.legend(fontsize=8, loc="upper left", frameon=False)
    axis.set_ylabel("energy [J]")


def _draw_cycles(axes: Any, replay: Replay) -> None:
    """Draw the translation of each cycle, and beside it the slips forward and back of which it is the sum."""
    gains, split = axes
    cycles = replay.cycles
    if not cycles:
        for axis in axes:
            axis.set_axis_off()
        gains.text(0.0, 0.5, "the commands do not repeat: there are no cycles", fontsize=9, color=GREY)
        return
    planar = isinstance(cycles[0].translation, tuple)
    gained = np.array([np.atleast_1d(c.translation)[0] for c in cycles])
    number = np.arange(1, len(cycles) + 1)
    gains.axhline(0.0, color="#9a9a9a", linewidth=0.8)
    if len(cycles) <= _MOST_CYCLES_BARS:
        colors = ["#b9c6d8" if c.transient else "#46688f" for c in cycles]
        bars = gains.bar(number, gained, color=colors, width=0.6)
        if len(cycles) <= 12:
            size = max(replay.table.shape_size, float(np.abs(gained).max()))
            texts = [f"{0.0 if abs(v) < 1e-12 * size else v:.4g}" for v in gained]
            gains.bar_label(bars, labels=texts, fontsize=8, padding=2)
            gains.margins(y=0.18)
            gains.set_xticks(number)
    else:
        gains.plot(number, gained, color="#46688f", linewidth=1.2)
    some = " (light: transient)" if any(c.transient for c in cycles) else ""
    gains.set_xlabel("cycle" + some)
    gains.set_ylabel(("x gained" if planar else "net translation") + "\nin the cycle [m]")
    last = cycles[-1]
    words = ["forward", "back", "translation"]
    values = [last.slip_forward, -last.slip_backward, float(gained[-1])]
    if replay.scene is not None:
        body = replay.scene.body
        words[2] = f"sum / {body.isolated.size + len(body.segments)}\n= translation"
    bars = split.bar(words, values, color=[FORWARD, BACK, "#46688f"], width=0.6)
    split.bar_label(bars, labels=[f"{v + 0.0:.4g}" for v in values], fontsize=8, padding=2)
    split.axhline(0.0, color="#9a9a9a", linewidth=0.8)
    split.margins(y=0.2)
    split.set_ylabel("slip of all contacts [m]" if replay.stations == replay.contacts else "slip of all parts [m]")
    split.set_title("in the last cycle", fontsize=8, color=GREY, loc="left")
