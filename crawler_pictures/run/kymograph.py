"""Kymographs: the contacts of a body over time, coloured by stick, slip forward and slip back.

Up to `MOST_LINES` contacts are lines at their positions; any number of them are rows of an image. A slip is drawn at
least one pixel long and one pixel high, however short it is and however many contacts there are: where slips in both
directions share a pixel, it has a colour of its own.
"""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..colors import BACK, BOTH, FORWARD, JUMP, STICK, TEXT, rgb
from ..numbers import shorten
from ..style import page
from .pixels import divide, join_states, thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_LINES, MOST_NAMED = 48, 12
WIDTH, HEIGHT = 1000, 400
"""The largest image: columns of time, rows of contacts [pixels]."""
_MOST_SAMPLES = 4000
_EMPTY = "#ffffff"
_NARROW, _NARROW_LEGEND = 58, 72
"""Letters of a title, or of a legend with 7 for the line of each entry, that fit above a panel of half a page."""
_HALF = 4.5
"""Width of half a page [inch]."""
PLATE: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.8}
"""The ground of text that may stand on a curve."""
_THINNEST = 0.02
"""Part of the body's length that an isolated contact takes next to a segment."""


def draw_positions(axis: Axes, time: ArrayLike, positions: ArrayLike, state: ArrayLike, names: Sequence[str]) -> None:
    """Draw the position of each contact over time, coloured by its state.

    Args:
        axis: axes to draw on: s over m.
        time: shape (T,) [s].
        positions: shape (T, N) [m].
        state: from the sample before to this one, 1 forward, -1 back, 0 stuck, 2 both, shape (T, N).
        names: names of the contacts; they are written at the right end if there is room.
    """
    at, place, moving = thin(np.asarray(time), np.asarray(positions), np.asarray(state), _MOST_SAMPLES)
    many = place.shape[1] > MOST_NAMED
    axis.plot(at, place, color="#a0a0a0", linewidth=0.5 if many else 0.8, zorder=1)
    for value, color in ((1, FORWARD), (-1, BACK), (2, BOTH)):
        slides = moving == value
        if slides.any():
            before = np.vstack((slides[1:], np.zeros_like(slides[:1])))  # the line to a sample starts at the one before
            shown = np.where(slides | before, place, np.nan)
            short = slides & ~np.vstack((slides[:1], slides[:-1])) & ~before
            width = 1.4 if many else 2.2
            axis.plot(at, shown, color=color, linewidth=width, solid_capstyle="butt", zorder=2)
            rows, contacts = np.nonzero(short)  # a slip of a single sample may be shorter than a pixel
            axis.plot(at[rows], place[rows, contacts], "s", color=color, markersize=width * 0.9, zorder=2)
    if len(names) <= MOST_NAMED:
        for i, name in enumerate(names):
            text = name.removeprefix("contact_")
            axis.annotate(text, (at[-1], place[-1, i]), (4, 0), textcoords="offset points", fontsize=8, va="center")


def draw_states(
    axis: Axes, time: ArrayLike, state: ArrayLike, names: Sequence[str] = (), place: ArrayLike | None = None
) -> str:
    """Draw the state of each contact over time as an image, one row per contact.

    Rows are contacts in their order; where there are segments, rows are places along the body at rest instead.

    Args:
        axis: axes to draw on.
        time: shape (T,) [s].
        state: from the sample before to this one, 1 forward, -1 back, 0 stuck, 2 both, shape (T, N).
        names: names of the contacts, shape (N,); "trunk/contact_7" is inside the segment trunk.
        place: reference positions, shape (N,) [m]; they are needed only where there are segments.

    Returns:
        What a pixel of the image joins; empty where each state has a pixel of its own.
    """
    at, moving = np.asarray(time, dtype=np.float64), np.asarray(state)
    count = moving.shape[1]
    if at.size < 2 or count == 0:
        return ""
    first, last = divide(at, WIDTH)
    columns = join_states(moving[1:], first, last)
    inside = place is not None and any("/" in name for name in names)
    if inside:
        order, edges, group = _arrange(np.asarray(place, dtype=np.float64), names)
        filled = np.where(group >= 0, columns[:, order[np.maximum(group, 0)]], 0)
        rows_first, rows_last = divide(edges, HEIGHT)
        image = join_states(filled.T, rows_first, rows_last)
        empty = np.maximum.reduceat(np.append(group, -1), np.column_stack((rows_first, rows_last)).ravel())[::2] < 0
    else:
        edges = np.arange(count + 1) - 0.5
        image, empty = columns.T, np.zeros(count, bool)
        if count > HEIGHT:
            image, empty = join_states(image, *divide(edges, HEIGHT)), np.zeros(HEIGHT, bool)
    palette = np.array([rgb(color) for color in (BACK, STICK, FORWARD, BOTH)], np.uint8)
    picture = palette[image + 1]
    picture[empty] = rgb(_EMPTY)
    extent: Any = (at[0], at[-1], edges[0], edges[-1])
    axis.imshow(picture, extent=extent, origin="lower", aspect="auto", interpolation="nearest")
    _name_rows(axis, count, names, inside)
    return _resolution(float(np.ptp(at)) / WIDTH, float(np.diff(at).max()), 1 if inside else -(-count // HEIGHT))


def _resolution(pixel: float, sample: float, contacts: int) -> str:
    """Write what a pixel joins."""
    parts = [f"{pixel:.2g} s"] * (pixel > sample) + [f"{contacts} contacts"] * (contacts > 1)
    return f"a pixel joins {' and '.join(parts)} and shows every slip in it" if parts else ""


def _arrange(place: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arrange contacts along the body: their order, the edges of rows, and which contact a row is, -1 for none."""
    order = np.argsort(place, kind="stable")
    parts = [names[i].partition("/")[0] if "/" in names[i] else f"/{i}" for i in order]
    at, length = place[order], float(np.ptp(place)) or 1.0
    joined = np.array([a == b for a, b in itertools.pairwise(parts)], bool)
    middle, half = 0.5 * (at[1:] + at[:-1]), 0.5 * np.diff(at)
    thin_half = np.minimum(0.5 * _THINNEST * length, 0.45 * 2.0 * half)
    alone = ~(np.append(False, joined) | np.append(joined, False))
    low, high = at.copy(), at.copy()
    low[1:] = np.where(joined, middle, at[1:] - np.where(alone[1:], thin_half, 0.0))
    high[:-1] = np.where(joined, middle, at[:-1] + np.where(alone[:-1], thin_half, 0.0))
    low[0] -= 0.5 * _THINNEST * length * alone[0]
    high[-1] += 0.5 * _THINNEST * length * alone[-1]
    edges, group = [low[0]], []
    for k in range(at.size):
        if low[k] > edges[-1]:
            edges.append(low[k])
            group.append(-1)
        edges.append(high[k])
        group.append(k)
    return order, np.array(edges), np.array(group)


def _name_rows(axis: Axes, count: int, names: Sequence[str], inside: bool) -> None:
    from matplotlib.ticker import MaxNLocator

    if inside:
        axis.set_ylabel("place along\nthe body [m]")
        return
    axis.set_ylabel("contact")
    if count <= MOST_NAMED:
        labels = [name.removeprefix("contact_") for name in names] or [str(i) for i in range(count)]
        axis.set_yticks(range(count), labels)
        for row in range(1, count):
            axis.axhline(row - 0.5, color="white", linewidth=2.0)
    else:
        axis.yaxis.set_major_locator(MaxNLocator(5, integer=True))


def explain_states(axis: Axes, planar: bool, joined: bool, jumps: bool = False) -> None:
    """Draw the legend of the states above the right end of axes.

    Args:
        axis: the axes.
        planar: whether the body moves in the plane, where a slip is not forward or back.
        joined: whether a pixel may show slips in both directions.
        jumps: whether there are jumps over a border of patches.
    """
    from matplotlib.lines import Line2D

    words = [("slides", FORWARD)] if planar else [("slips forward", FORWARD), ("slips back", BACK)]
    words += [("both in one pixel", BOTH)] * (joined and not planar) + [("sticks", "#a0a0a0")]
    handles = [Line2D([], [], color=color, linewidth=4.0, label=word) for word, color in words]
    if jumps:
        handles.append(
            Line2D([], [], color=JUMP, marker="D", markersize=4.5, linestyle=":", label="jumps over a border")
        )
    place_legend(axis, handles)


def place_legend(axis: Axes, handles: Sequence[Any], lines: int = 1) -> None:
    """Draw a legend above the right end of axes, where it covers no curve.

    Args:
        axis: the axes.
        handles: its entries.
        lines: number of lines among which they are divided.
    """
    for handle in handles:
        handle.set_label(shorten(handle.get_label(), _NARROW))
    axis.legend(
        handles=handles,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=-(-len(handles) // lines),
        fontsize=8,
        frameon=False,
        borderaxespad=0.1,
        handlelength=2.4 if page().paper else 1.2,
        columnspacing=1.2,
    )


def write_title(axis: Axes, text: str, pad: float = 4.0) -> None:
    """Write what a panel shows above its left end.

    Args:
        axis: the axes.
        text: the text.
        pad: its distance from the axes [points].
    """
    if not page().paper:  # where the caption says it
        axis.set_title(text, fontsize=8, color=TEXT, loc="left", pad=pad, parse_math=False)


def _count_lines(widths: list[int]) -> int:
    """Count the lines among which the entries of a legend, which fill it column by column, are narrow enough."""
    count, room = len(widths), _NARROW_LEGEND * _room()
    for lines in range(1, count):
        columns = np.array_split(widths, -(-count // lines))
        if sum(int(column.max()) for column in columns) <= room:
            return lines
    return count


def _room() -> float:
    """Return the part of the width for half a page that a narrow page has."""
    return min((page().inches or _HALF) / _HALF, 1.0)


def make_room(axis: Axes) -> None:
    """Write the title of a panel half as wide as a page above its legend, both in as many lines as they need.

    Args:
        axis: the axes, with their title and legend.
    """
    legend, lines = axis.get_legend(), 0
    if legend is not None:
        handles: Any = legend.legend_handles
        words = [text.get_text() for text in legend.get_texts()]
        for handle, word in zip(handles, words, strict=True):
            handle.set_label(word)
        lines = _count_lines([len(word) + 7 for word in words])
        place_legend(axis, handles, lines)
    title = axis.get_title("left")
    if title:
        write_title(axis, textwrap.fill(title, int(_NARROW * _room())), 4.0 + 13.0 * lines)
