"""Scenes and recordings side by side, aligned by the cycles of their drives: one table, one picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.console import Console
from rich.table import Column, Table

from crawler_model import CrawlerError, Scene, simulate
from crawler_model.body.drive import NS
from crawler_model.run.screw import gain_in_frame
from crawler_pictures.colors import LINES
from crawler_pictures.numbers import ROUNDING, error_of, label_values, write_angle, write_length, write_size
from crawler_pictures.run.kymograph import write_title
from crawler_pictures.style import open_figure, own_style, page, rim_of, write_figure

from ..analysis import Replay

_PERIODS, _SAMPLES = 10, 100
_MOST_POINTS = 5000


@dataclass(frozen=True, eq=False)
class Walk:
    """A run by cycles of its commands. It begins with the first cycle; the rest before it is left out.

    Attributes:
        name: the name that people gave to it.
        source: "scene" or "recording".
        starts: when each cycle begins, shape (C,) [s].
        ends: when it ends, shape (C,) [s].
        gains: net translation gained in each cycle, shape (C, D) [m], D = 1 on a line; for a body that turns in its own
            frame.
        work: work of the actuators in each cycle, shape (C,); NaN where it is not known [J].
        dissipation: energy lost to friction in each cycle, shape (C,) [J].
        phase: cycles since the first one, at all samples, shape (T,).
        y: net translation since then, shape (T, D) [m].
        size: size of the numbers from which lengths were computed [m].
        error: error of lengths in the plane [m]; 0 on a line.
        turned: angle by which the body turned in each cycle, shape (C,) [rad]; None if it does not or is not known.
        resets: number of resets of a recording; what follows the first one is left out.
    """

    name: str
    source: str
    starts: np.ndarray
    ends: np.ndarray
    gains: np.ndarray
    work: np.ndarray
    dissipation: np.ndarray
    phase: np.ndarray
    y: np.ndarray
    size: float
    error: float
    turned: np.ndarray | None = None
    resets: int = 0

    def as_plain(self) -> dict[str, Any]:
        """Convert to the values that `crawler compare --json` prints.

        Returns:
            Plain numbers, lists and text; lengths in m, times in s, energies in J.
        """
        return {
            "name": self.name,
            "source": self.source,
            "starts": self.starts.tolist(),
            "ends": self.ends.tolist(),
            "translation": (self.gains[:, 0] if self.gains.shape[1] == 1 else self.gains).tolist(),
            **({} if self.turned is None else {"turned": self.turned.tolist()}),
            "work": [None if np.isnan(v) else v for v in self.work.tolist()],
            "dissipation": [None if np.isnan(v) else v for v in self.dissipation.tolist()],
        }


def walk_of_scene(name: str, scene: Scene) -> Walk:
    """Simulate ten periods of a scene, or its drive once if it has no period.

    Args:
        name: the name that people gave to it.
        scene: the scene.

    Returns:
        Its cycles.

    Raises:
        CrawlerError: when it has no drive.
    """
    drive = scene.drive
    if drive.holds:
        raise CrawlerError(f"{name}: the scene has {scene.unmoving_drive}; a comparison needs cycles")
    period, count = (float(drive.times[-1]), 1) if drive.period is None else (drive.period, _PERIODS)
    run = simulate(scene, count * period, _SAMPLES / period)
    shown = slice(count * _SAMPLES + 1)  # rounding of the period may add one more instant
    y = run.net_translation.reshape(run.time.size, -1)[shown]
    gains, turned = np.diff(y[::_SAMPLES], axis=0), None
    if scene.body.turning is not None:
        x, turned = run.displacement[shown][::_SAMPLES], np.diff(run.yaw[shown][::_SAMPLES])
        gains = gain_in_frame(scene.body, x[:-1], np.diff(x, axis=0), turned)[:, :2]
    work, lost = (
        part[shown][1:].reshape(count, _SAMPLES).sum(axis=1) for part in (run.energies.work, run.energies.dissipation)
    )
    edges = period * np.arange(count + 1)
    size = float(np.abs(run.displacement).max()) + float(np.abs(drive.actuation).max())
    phase, error = run.time[shown] / period, error_of(scene)
    return Walk(name, "scene", edges[:-1], edges[1:], gains, work, lost, phase, y - y[0], size, error, turned)


def walk_of_recording(name: str, found: Replay) -> Walk:
    """Read the cycles of an analysed recording.

    Args:
        name: the name that people gave to it.
        found: the analysis.

    Returns:
        The cycles of its first run, between resets.

    Raises:
        CrawlerError: when its commands do not repeat.
    """
    cycles = [cycle for cycle in found.cycles if cycle.run == 0]
    if not cycles:
        raise CrawlerError(f"{name}: the commands of the recording do not repeat; a comparison needs cycles")
    starts, ends = (np.array([getattr(cycle, which) for cycle in cycles]) for which in ("start", "end"))
    time, y = found.table.end_ns / NS, found.table.net_translation
    shown = (found.table.run == 0) & (time >= starts[0]) & (time <= ends[-1])
    start = [np.interp(starts[0], time, part) for part in y.T]
    time, y = np.append(starts[0], time[shown]), np.vstack((start, y[shown]))
    work, lost = (
        np.array([np.nan if cycle.energy is None else getattr(cycle.energy, part) for cycle in cycles])
        for part in ("work", "dissipation")
    )
    return Walk(
        name,
        "recording",
        starts,
        ends,
        np.array([np.atleast_1d(cycle.translation) for cycle in cycles]),
        work,
        lost,
        phase=np.interp(time, np.append(starts, ends[-1]), np.arange(len(cycles) + 1)),
        y=y - y[0],
        size=found.table.size,
        error=0.0 if found.scene is None else error_of(found.scene),
        turned=None if cycles[0].turned is None else np.array([cycle.turned for cycle in cycles]),
        resets=found.table.resets,
    )


def name_walks(sources: Sequence[str]) -> list[str]:
    """Name runs by what people called them.

    Args:
        sources: paths and gallery names.

    Returns:
        The last part of each path, without the end of a file; whole paths where these are equal.
    """
    files = (".yaml", ".yml", ".mcap")
    names = [path.stem if path.suffix in files else path.name or source for source in sources if (path := Path(source))]
    return [name if names.count(name) == 1 else source for name, source in zip(names, sources, strict=True)]


def tabulate_walks(walks: Sequence[Walk]) -> Table:
    """Build the table: the last cycle that all runs have, and its difference from that of the first run.

    Cycles of the same number are compared, because the first ones of a run may be transient.

    Args:
        walks: the runs; the others are compared with the first.

    Returns:
        A row for each run.
    """
    first = walks[0]
    last = min(walk.starts.size for walk in walks) - 1
    title = f"cycle {last + 1}, the last that all runs have; difference from {first.name}"
    turns = any(walk.turned is not None for walk in walks)
    columns = ["cycles", "cycle [s]", "translation [m]", *["turned [rad]"] * turns, "difference [m]", "speed [m/s]"]
    columns += ["work [J]", "dissipation [J]"]
    table = Table("run", *(Column(name, justify="right") for name in columns), title=title, title_justify="left")
    size = max(walk.size for walk in walks)
    for walk in walks:
        gain, cycle = walk.gains[last], float(walk.ends[last] - walk.starts[last])
        alike = walk is not first and gain.size == first.gains.shape[1]
        energies = [
            "" if np.isnan(part[last]) else write_size(float(part[last]), abs(float(walk.work[last])))
            for part in (walk.work, walk.dissipation)
        ]
        turned = [] if not turns else ["" if walk.turned is None else write_angle(walk.turned[last])]
        table.add_row(
            walk.name,
            str(walk.starts.size),
            f"{cycle:.6g}",
            write_length(gain, size, walk.error),
            *turned,
            write_length(gain - first.gains[last], size) if alike else "",
            ", ".join(f"{v:.6g}" for v in np.where(np.abs(gain) > ROUNDING * size, gain, 0.0) / cycle),
            *energies,
        )
    return table


def print_walks(walks: Sequence[Walk], screen: Console) -> None:
    """Print the table, and what it leaves out.

    Args:
        walks: the runs.
        screen: the console to print to.
    """
    screen.print(tabulate_walks(walks))
    for walk in walks:
        if walk.starts[0] > 0.0:
            screen.print(
                f"{walk.name}: what is before its first cycle, at {walk.starts[0]:g} s, is left out", markup=False
            )
        if walk.resets:
            screen.print(f"{walk.name}: what follows its first reset is left out", markup=False)


@own_style()
def draw_walks(walks: Sequence[Walk], png: Path) -> None:
    """Draw the net translation of all runs over the cycles since their first one, and what each cycle gains.

    Args:
        walks: the runs.
        png: the file to write.
    """
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MaxNLocator

    figure = open_figure(11, 9 if page().narrow else 4.5, stacked=True)
    left, right = figure.subplots(2, 1) if page().narrow else figure.subplots(1, 2, width_ratios=[3, 2])
    size = max(walk.size for walk in walks)
    handles = []
    for k, walk in enumerate(walks):
        color = LINES[k % len(LINES)]
        style: Literal["-", "--"] = "-" if k < len(LINES) else "--"
        rim, some = rim_of(k, len(walks)), slice(None, None, max(walk.phase.size // _MOST_POINTS, 1))
        number = np.arange(walk.starts.size) + 1
        for y, gained, width, marker in zip(walk.y.T, walk.gains.T, (1.6, 0.8), "oD", strict=False):
            left.plot(walk.phase[some], y[some], color=color, linestyle=style, linewidth=width + rim)
            right.plot(number, gained, color=color, linestyle=style, linewidth=width + rim, marker=marker, ms=3 + rim)
        handles.append(Line2D([], [], color=color, linestyle=style, linewidth=1.6, label=walk.name))
    thin = "; thick: x, thin: y" if any(walk.gains.shape[1] == 2 for walk in walks) else ""
    thin_gain = "; thick: ahead, thin: to the left" if any(walk.turned is not None for walk in walks) else thin
    for axis, what, title in (
        (left, "net translation", f"net translation since the first cycle{thin}"),
        (right, "gained", f"translation of each cycle{thin_gain}"),
    ):
        label_values(axis, what, "m", size)
        axis.set_xlabel("cycles of the drive")
        write_title(axis, title)
    left.legend(handles=handles, loc="best", frameon=False, fontsize=8)
    right.xaxis.set_major_locator(MaxNLocator(integer=True))
    write_figure(figure, png, 110)
