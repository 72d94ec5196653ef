"""The page of a run: kymograph, net translation, tensions, commands and energy over one time axis, and cycles."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import CrawlerError, Scene
from crawler_model.run.orientation import shape_orientation

from ..colors import ACTUATION, BACK, FORWARD, JUMP, TENSION, TEXT
from ..ground import draw_areas, draw_jumps, draw_walls, list_sections
from ..numbers import label_values, shorten
from ..style import open_figure, own_style, page, write_figure
from .arrays import Commands, RunArrays
from .cycles import MOST_BARS, draw_gains
from .forces import (
    MOST_BANDS,
    describe_constant,
    draw_commands,
    draw_tension,
    draw_tensions,
    explain_tension,
)
from .kymograph import (
    MOST_LINES,
    MOST_NAMED,
    PLATE,
    draw_positions,
    draw_states,
    explain_states,
    make_room,
    place_legend,
    write_title,
)
from .pixels import BOTH
from .plane import draw_friction, draw_plane

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDTH, _DPI = 11.0, 110
_PRINT_WIDTH, _PRINT_DPI = 9.0, 200
MOST_CYCLES = 150
"""More cycles are too narrow for their curves to be told apart."""
Panel = tuple[float, Callable[["Axes"], None]]
"""Height of a panel [inch], and the function that draws it."""


@own_style()
def draw_run(run: RunArrays, png: Path, two_columns: bool = False) -> None:
    """Draw the page of a run.

    Args:
        run: the run.
        png: the file to write.
        two_columns: whether the panels over time stand in two columns, for print: narrower and with more pixels.

    Raises:
        CrawlerError: when there is no state to draw.
    """
    if run.time.size == 0:
        raise CrawlerError(f"{png}: there is no state to draw")
    notes = [*run.notes, *_constants(run)]
    heights = [] if page().paper else [0.3 + 0.15 * len(notes)]
    narrow = two_columns or page().narrow
    columns = _halve(_panels(run)) if two_columns else [_panels(run)]
    if run.planar:
        heights.append(9.0 if page().narrow else 5.2)
    title = 0.45 if two_columns else 0.28
    heights.append(max(sum(height + title for height, _ in column) for column in columns) + 0.4)
    if run.gains is not None:
        heights.append(4.8 if page().narrow and run.gains.slips is not None else 2.4)
    width, dpi = (_PRINT_WIDTH, _PRINT_DPI) if two_columns else (_WIDTH, _DPI)
    figure = open_figure(width, sum(heights), stacked=True)
    parts: list[Any] = list(np.atleast_1d(figure.subfigures(len(heights), 1, height_ratios=heights)))  # type: ignore[arg-type]
    if not page().paper:
        _write_head(parts.pop(0), run.title, notes)
    if run.planar:
        _draw_above(parts.pop(0), run, narrow)
    body = parts.pop(0)
    for part, column in zip(np.atleast_1d(body.subfigures(1, len(columns))), columns, strict=True):
        _draw_column(part, column, run, narrow)
    if run.gains is not None:
        draw_gains(parts.pop(0), run.gains, _size(run), run.planar)
    if not page().paper:  # which changes the letters
        layout: Any = figure.get_layout_engine()
        layout.execute(figure)
        figure.set_layout_engine("none")  # once is enough: saving would lay out a second time
    write_figure(figure, png, dpi)


def _halve(panels: list[Panel]) -> list[list[Panel]]:
    """Split panels into two columns so that the higher one is as low as possible."""

    def height(first: int) -> float:
        return max(sum(h for h, _ in panels[:first]), sum(h for h, _ in panels[first:]))

    first = min(range(1, len(panels)), key=height, default=1)
    return [column for column in (panels[:first], panels[first:]) if column]


def _draw_column(part: Any, panels: list[Panel], run: RunArrays, narrow: bool) -> None:
    """Draw panels over one time axis, one below the other."""
    axes = np.atleast_1d(part.subplots(len(panels), 1, sharex=True, height_ratios=[height for height, _ in panels]))
    for axis, (_, draw) in zip(axes, panels, strict=True):
        draw(axis)
        axis.margins(x=0)
        if narrow:
            make_room(axis)
        if run.cycles.size <= MOST_BARS:
            for start in run.cycles:
                axis.axvline(start, color="#c9c9c9", linewidth=0.5, zorder=-1)
    if run.time.size > 1:
        axes[-1].set_xlim(run.time[0], run.time[-1])
    axes[-1].set_xlabel("simulated time [s]")
    part.align_ylabels(axes)


def _size(run: RunArrays) -> float:
    """Compute the size of the lengths of a run [m]."""
    return float(max(np.ptp(run.positions), np.abs(run.net_translation).max(initial=0.0)))


def _write_head(part: Any, title: str, notes: list[str]) -> None:
    axis = part.subplots()
    axis.set_axis_off()
    head: Any = {"fontsize": 12, "fontweight": "bold", "va": "top", "transform": axis.transAxes, "parse_math": False}
    axis.text(0.0, 1.0, shorten(title), **head)
    text = "\n".join(shorten(note, 170) for note in notes)
    axis.text(0.0, 0.0, text, fontsize=8, color=TEXT, va="bottom", linespacing=1.4, transform=axis.transAxes)


def _constants(run: RunArrays) -> list[str]:
    """Write the commands that never change, and the ground."""
    clauses = [describe_constant(c) for c in run.commands if not c.changes and (c.values.any() or "friction" in c.what)]
    ground = run.scene.parts.ground if isinstance(run.scene, Scene) else None
    if ground is not None and ground.slope != 0.0:
        clauses.append(f"slope {ground.slope:g}\u00b0")
    if isinstance(run.scene, Scene) and run.scene.parts.couplings:
        clauses.append("more friction with elongations")
    found = ["; ".join(clauses)] if clauses else []
    if run.planar:
        angle = np.degrees(shape_orientation(run.place, run.positions - run.place))
        shown = np.round((angle[0], angle[-1], angle.min(), angle.max()), 3) + 0.0
        first, last, low, high = (f"{v:g}\u00b0" for v in shown)
        found.append(f"orientation of the shape: {first} at the start, {last} at the end, between {low} and {high}")
    if run.cycles.size > MOST_CYCLES:
        text = f"{run.cycles.size} cycles: of curves only the range in a cycle can be seen; colours show every slip"
        found.append(text)
    return found


def _draw_above(part: Any, run: RunArrays, narrow: bool) -> None:
    if run.force is None:
        left, right = part.subplots(), None
    else:
        left, right = part.subplots(2, 1) if page().narrow else part.subplots(1, 2, width_ratios=[2.6, 1])
    draw_plane(left, run.positions, run.state, run.mean, run.ends, list(run.contacts))
    if narrow:
        make_room(left)
    if run.scene is not None:
        draw_areas(left, run.scene)
    if right is not None:
        draw_friction(right, run.scene, run.force)  # type: ignore[arg-type]


def _panels(run: RunArrays) -> list[Panel]:
    """List the panels over time."""
    count, links = run.positions.shape[1], run.tension.shape[1]
    lines = not run.planar and count <= MOST_LINES
    panels: list[Panel] = []
    if lines:
        panels.append((3.0 if count <= MOST_NAMED else 4.0, lambda axis: _positions(axis, run)))
    if count:
        height = 0.2 + 0.15 * count if count <= MOST_NAMED else 2.2 if lines else 3.8
        panels.append((height, lambda axis: _states(axis, run, not lines)))
    panels.append((1.0, lambda axis: _translation(axis, run)))
    if 0 < links <= MOST_BANDS:
        panels += [(1.0, partial(_tension, run=run, link=i)) for i in range(links)]
    elif links:
        panels.append((1.8, lambda axis: _tensions(axis, run)))
    panels += [_command(run, commands) for commands in run.commands if commands.changes]
    if run.energy:
        panels.append((1.1, lambda axis: _energy(axis, run)))
    return panels


def _command(run: RunArrays, commands: Commands) -> Panel:
    many = len({column.tobytes() for column in commands.values.T}) > MOST_NAMED
    return 1.5 if many else 1.0, lambda axis: draw_commands(axis, run.time, commands)


def _positions(axis: Axes, run: RunArrays) -> None:
    draw_positions(axis, run.time, run.positions, run.state, run.contacts)
    scale = float(np.ptp(run.positions))
    label_values(axis, "position", "m", scale)
    axis.margins(y=0.04)
    limits = axis.get_ylim()
    if isinstance(run.scene, Scene):
        for section in list_sections(run.scene, *limits):
            for start, end, color in section.bands:
                axis.axhspan(start, end, color=color, alpha=0.45, linewidth=0.0, zorder=-1, antialiased=False)
            if section.colors:
                where: Any = {"textcoords": "offset points", "va": "center", "zorder": 5, "bbox": PLATE}
                axis.annotate(section.text, (run.time[0], section.middle), (5, 0), fontsize=8, **where)
        draw_walls(axis, run.scene)
    draw_jumps(axis, run.jumps)
    axis.set_ylim(limits)
    cycles = "; vertical lines: cycles" if 0 < run.cycles.size <= MOST_BARS else ""
    write_title(axis, f"contacts over time, up is forward{cycles}")
    explain_states(axis, False, bool((run.state == BOTH).any()), any(jump.border is not None for jump in run.jumps))


def _states(axis: Axes, run: RunArrays, explain: bool) -> None:
    note = draw_states(axis, run.time, run.state, run.contacts, None if run.planar else run.place)
    count = run.positions.shape[1]
    write_title(axis, f"stick and slip of {count} contacts" + (f"; {note}" if note else ""))
    if explain:
        explain_states(axis, run.planar, bool(note) or bool((run.state == BOTH).any()))


def _translation(axis: Axes, run: RunArrays) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    y = run.net_translation.reshape(run.time.size, -1)
    handles: list[Any] = []
    for k, (color, name) in enumerate(zip(("black", TENSION), "xy", strict=True)):
        if k < y.shape[1]:
            axis.plot(run.time, y[:, k], color=color, linewidth=1.4)
            handles += [Line2D([], [], color=color, linewidth=1.4, label=name)] * (y.shape[1] == 2)
    for start, end in run.rests:
        axis.axvspan(start, end, color="#e8e4d8", linewidth=0.0, zorder=0)
    handles += [Patch(facecolor="#e8e4d8", label="at rest")] * bool(len(run.rests))
    times = [jump.time for jump in run.jumps if run.planar]
    if times:
        marks: Any = {"color": JUMP, "marker": "D", "markersize": 4.5, "linestyle": "none"}
        axis.plot(times, np.zeros(len(times)), transform=axis.get_xaxis_transform(), clip_on=False, zorder=4, **marks)
        count = "1 jump" if len(times) == 1 else f"{len(times)} jumps"
        why = "onto other ground" if run.scene is not None and run.scene.ground.lets_go else "where stability was lost"
        handles.append(Line2D([], [], label=f"{count} {why}", **marks))
    label_values(axis, "translation" if y.shape[1] == 1 else "x, y", "m", _size(run))
    write_title(axis, "net translation, from the reference shape")
    if handles:
        place_legend(axis, handles)


def _tension(axis: Axes, run: RunArrays, link: int) -> None:
    draw_tension(
        axis,
        run.time,
        run.tension[:, link],
        run.least[:, link],
        run.most[:, link],
        f"T {run.links[link].removeprefix('link_')}",
        run.marks[:, link] if run.marks.size else None,
        run.own[:, link] if run.own.size and np.isfinite(run.own[:, link]).any() else None,
    )
    if link == 0:
        write_title(axis, f"tension{_explain_bounds(run)}")
        explain_tension(axis, bool(np.isfinite(run.least).any()), run.marks, run.own.size > 0)


def _tensions(axis: Axes, run: RunArrays) -> None:
    draw_tensions(axis, run.time, run.tension, run.least, run.most, run.links, _explain_bounds(run))


def _explain_bounds(run: RunArrays) -> str:
    """Write why tensions have no bounds; nothing where they have."""
    if np.isfinite(run.least).any():
        return ""
    segments = any(not name.startswith("link_") for name in run.links)
    where = "for the mean tension of a segment" if segments else "for a graph of springs"
    if run.planar:
        where = "in the plane"
    elif run.scene is not None and run.scene.ground.lets_go:
        where = "where the ground differs" if run.scene.ground.differs else "where friction changes with elongations"
    return f"; without bounds, which are not computed {where}"


def _energy(axis: Axes, run: RunArrays) -> None:
    from matplotlib.lines import Line2D

    styles: Any = ("black", "-"), (BACK, "--"), (TENSION, "-"), (ACTUATION, "-."), (FORWARD, ":")
    handles = []
    for (name, values), (color, dash) in zip(run.energy.items(), styles, strict=False):
        axis.plot(run.time, values, color=color, linewidth=1.4, linestyle=dash)
        handles.append(Line2D([], [], color=color, linewidth=1.4, linestyle=dash, label=name))
    size = max(float(np.nanmax(np.abs(v), initial=0.0)) for v in run.energy.values())
    label_values(axis, "energy", "J", size)
    write_title(axis, "energy since the start")
    place_legend(axis, handles)
