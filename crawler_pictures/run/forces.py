"""Tensions within their stasis bounds, and commands, over time: curves while they are few, else an image."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .. import marks as marked
from ..colors import ACTUATION, BAND, BOUND, GREY, LINES, STALLED, TENSION, YIELDING
from ..numbers import choose_prefix, label_values
from .arrays import Commands
from .kymograph import HEIGHT, MOST_NAMED, WIDTH, place_legend, write_title
from .pixels import divide, join_extremes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_BANDS = 3
"""Links whose tension has a panel with its bounds."""
_CLOSED = "#cfcabb"
_MARKED = {
    marked.SLACK: (GREY, "slack"),
    marked.STALLED: (STALLED, "stalled"),
    marked.YIELDING: (YIELDING, "hysteresis yields"),
}
"""How the times of marked links are drawn: colour and text."""
_SIGNED, _UNSIGNED = (TENSION, "#ffffff", ACTUATION), ("#ffffff", "#a9bce6", TENSION, "#14224d")


def draw_tension(
    axis: Axes,
    time: ArrayLike,
    tension: ArrayLike,
    least: ArrayLike,
    most: ArrayLike,
    name: str,
    marks: np.ndarray | None = None,
    own: np.ndarray | None = None,
) -> None:
    """Draw the tension of one link within its bounds.

    Args:
        axis: axes to draw on: s over N.
        time: shape (T,) [s].
        tension: shape (T,), in the plane (T, 2), where its size is drawn [N].
        least: least tension in the stasis domain, shape (T,) [N]; NaN where it is not known.
        most: the greatest, shape (T,) [N].
        name: label of the axis, as "tension 0".
        marks: of the link, as in `crawler_pictures.marks`, shape (T,); None without any.
        own: of its actuator, shape (T,) [N]; None where it has no passive spring.
    """
    value, low, high = np.asarray(tension), np.asarray(least), np.asarray(most)
    if value.ndim == 2:
        value, name = np.linalg.norm(value, axis=1), f"|{name}|"
    if np.isfinite(low).any():
        axis.fill_between(np.asarray(time), low, high, color=BAND, linewidth=0.0, zorder=0)
        for bound in (low, high):
            axis.plot(np.asarray(time), bound, color=BOUND, linewidth=0.9, zorder=1)
    for mark, (color, _) in _MARKED.items() if marks is not None else ():
        where: Any = {"transform": axis.get_xaxis_transform(), "color": color, "linewidth": 0.0, "zorder": 0.5}
        axis.fill_between(np.asarray(time), 0.0, 1.0, where=marks == mark, alpha=0.3, **where)
    axis.plot(np.asarray(time), value, color="white", linewidth=3.0, zorder=2)  # the bound does not shine through
    axis.plot(np.asarray(time), value, color=TENSION, linewidth=1.6, zorder=3)
    if own is not None:
        axis.plot(np.asarray(time), own, color=ACTUATION, linewidth=1.2, linestyle="--", zorder=3)
    label_values(axis, name, "N", float(np.nanmax(np.abs(value), initial=0.0)))


def explain_tension(axis: Axes, bounded: bool, marks: np.ndarray, has_own: bool) -> None:
    """Draw the legend of tensions above axes.

    Args:
        axis: the axes.
        bounded: whether the bounds are drawn.
        marks: of all links, any shape.
        has_own: whether tensions of actuators are drawn.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Line2D([], [], color=TENSION, linewidth=1.6, label="tension")]
    handles += [Line2D([], [], color=ACTUATION, linewidth=1.2, linestyle="--", label="of the actuator alone")] * has_own
    handles += [Patch(facecolor=BAND, edgecolor=BOUND, label="between its bounds no contact slips")] * bounded
    handles += [Patch(color=color, alpha=0.3, label=text) for mark, (color, text) in _MARKED.items() if mark in marks]
    place_legend(axis, handles)


def draw_tensions(
    axis: Axes,
    time: ArrayLike,
    tension: ArrayLike,
    least: ArrayLike,
    most: ArrayLike,
    names: Sequence[str],
    why: str = "",
) -> None:
    """Draw many tensions as an image: 1 and -1 at the bounds, where something slips, 0 in the middle between them.

    A link has no room between its bounds while both of its contacts are at their limits in the same direction.
    Without bounds, the unit is the largest tension of the run.

    Args:
        axis: axes to draw on.
        time: shape (T,) [s].
        tension: shape (T, J), in the plane (T, J, 2), where its size is drawn [N].
        least: least tension in the stasis domain, shape (T, J) [N]; NaN where it is not known.
        most: the greatest, shape (T, J) [N].
        names: "link_0", the name of a segment, or "trunk/element_7" for a spring of the segment trunk, shape (J,).
        why: why there are no bounds, for the title.
    """
    value, low, high = np.asarray(tension), np.asarray(least), np.asarray(most)
    inside = any("/" in name for name in names)
    what = f"tension of {len(names)} {'springs' if inside else 'links'}"
    if value.ndim == 2 and np.isfinite(low).all():
        half = 0.5 * (high - low)
        open_range = half > 1e-9 * np.abs(value).max(initial=0.0)
        part = np.where(open_range, (value - 0.5 * (low + high)) / np.where(open_range, half, 1.0), np.nan)
        words = (f"lower bound, {_range(low)}", "middle", f"upper bound, {_range(high)}", "no room: its bounds meet")
        _draw_image(axis, time, np.clip(part, -1.0, 1.0), 1.0, words)
        _name_springs(axis, names)
        write_title(axis, f"{what}; at its bounds a contact slips")
        return
    value = np.linalg.norm(value, axis=2) if value.ndim == 3 else value
    size = float(np.nanmax(np.abs(value), initial=0.0))
    scale, unit = choose_prefix(size, "N")
    largest = f"{size / scale:.3g} {unit}"
    signed = bool((value < 0.0).any())
    _draw_image(axis, time, value, size, (f"\u2212{largest}", "0", largest) if signed else ("0", "", largest))
    _name_springs(axis, names)
    write_title(axis, f"{what}{why}")


def _range(values: np.ndarray) -> str:
    """Write the least and the greatest of forces [N]."""
    low, high = float(np.nanmin(values)) + 0.0, float(np.nanmax(values)) + 0.0
    scale, unit = choose_prefix(max(abs(low), abs(high)), "N")
    return f"{low / scale:.3g} .. {high / scale:.3g} {unit}".replace("-", "\u2212")


def _name_springs(axis: Axes, names: Sequence[str]) -> None:
    """Label the rows of an image by link; with segments, each link by its name and the rows of a segment by its."""
    if all(name == f"link_{i}" for i, name in enumerate(names)):
        axis.set_ylabel("link")
        return
    groups = [(part, len(list(of))) for part, of in itertools.groupby(name.partition("/")[0] for name in names)]
    if len(groups) == 1:
        axis.set_ylabel(f"element\nof {groups[0][0]}")
        return
    last = np.cumsum([size for _, size in groups]) - 1
    middle = [end - 0.5 * (size - 1) for end, (_, size) in zip(last, groups, strict=True)]
    shown = np.unique(np.linspace(0, len(groups) - 1, MOST_NAMED).round().astype(int))
    axis.set_yticks([middle[k] for k in shown], [groups[k][0].replace("_", " ") for k in shown])
    for end in last[:-1] if len(groups) <= MOST_NAMED else ():
        axis.axhline(end + 0.5, color="#606060", linewidth=0.7)


def _draw_image(axis: Axes, time: ArrayLike, values: ArrayLike, size: float, words: Sequence[str]) -> None:
    """Draw values (T, K) as an image, one row each; a pixel shows the value of greatest size in it.

    The legend names the lowest, middle and highest value, at `size`, with the first three words; a fourth names NaN.
    """
    from matplotlib.colors import LinearSegmentedColormap, Normalize
    from matplotlib.patches import Patch
    from matplotlib.ticker import MaxNLocator

    at, rows = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if at.size < 2:
        return
    count = rows.shape[1]
    image = join_extremes(rows[1:], *divide(at, WIDTH)).T
    edges = np.arange(count + 1) - 0.5
    if count > HEIGHT:
        image = join_extremes(image, *divide(edges, HEIGHT))
    signed = words[0] != "0"
    colors = LinearSegmentedColormap.from_list("values", _SIGNED if signed else _UNSIGNED).with_extremes(bad=_CLOSED)
    limits = Normalize(-size if signed else 0.0, size or 1.0)
    extent: Any = (at[0], at[-1], edges[0], edges[-1])
    axis.imshow(image, extent=extent, origin="lower", aspect="auto", interpolation="nearest", cmap=colors, norm=limits)
    axis.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    shown = zip((*colors([0.0, 0.5, 1.0]), _CLOSED), words, strict=False)
    place_legend(axis, [Patch(facecolor=c, edgecolor=BOUND, linewidth=0.5, label=w) for c, w in shown if w])


def draw_commands(axis: Axes, time: ArrayLike, commands: Commands) -> None:
    """Draw commands of one kind: up to eight different curves, else an image of all.

    Args:
        axis: axes to draw on.
        time: shape (T,) [s].
        commands: the commands.
    """
    from matplotlib.lines import Line2D

    curves: dict[bytes, tuple[np.ndarray, list[str]]] = {}
    values = np.asarray(commands.values)
    for name, column in zip(commands.names, values.T, strict=True):
        curves.setdefault(column.tobytes(), (column, []))[1].append(name)
    size = float(np.abs(values).max(initial=0.0))
    if len(curves) <= len(LINES):
        handles = []
        for (curve, names), color in zip(curves.values(), LINES, strict=False):
            axis.plot(np.asarray(time), curve, color=color, linewidth=1.4)
            text = "all" if len(names) == len(commands.names) > 1 else join_names(names)
            handles.append(Line2D([], [], color=color, linewidth=1.6, label=text))
        place_legend(axis, handles)
        label_values(axis, commands.what.removeprefix("change of ").replace(" along", "\nalong"), commands.unit, size)
        write_title(axis, f"command: {commands.what}")
        return
    scale, unit = choose_prefix(size, commands.unit)
    largest = f"{size / scale:.3g} {unit}".strip()
    signed = bool((values < 0.0).any())
    _draw_image(axis, time, values, size, (f"\u2212{largest}", "0", largest) if signed else ("0", "", largest))
    low, high = (name.replace("_", " ").replace("/", " ") for name in (commands.names[0], commands.names[-1]))
    rows = {"length": "link", "angle": "joint"}
    known = next((row for word, row in rows.items() if f"rest {word}" in commands.what), "contact")
    axis.set_ylabel("element" if "element" in low else known)
    write_title(axis, f"command: {commands.what}, {low} (below) to {high} (above)")


def describe_constant(commands: Commands) -> str:
    """Write commands that never change.

    Args:
        commands: the commands.

    Returns:
        A clause such as "friction 1 N forward, 2 N backward, constant".
    """
    row = commands.values[0]
    forward = [v for name, v in zip(commands.names, row, strict=True) if name.endswith("/forward")]
    backward = [v for name, v in zip(commands.names, row, strict=True) if name.endswith("/backward")]
    unit = "" if commands.unit == "1" else f" {commands.unit}"
    if forward and len(forward) + len(backward) == row.size:
        return f"{commands.what} {_span(forward)}{unit} forward, {_span(backward)}{unit} backward, constant"
    return f"{commands.what} {_span(row.tolist())}{unit}, constant"


def _span(values: list[float]) -> str:
    low, high = min(values) + 0.0, max(values) + 0.0
    return f"{low:.4g}" if low == high else f"{low:.4g} .. {high:.4g}"


def join_names(names: Sequence[str]) -> str:
    """Join the names of equal curves.

    Args:
        names: such as "contact_0/forward".

    Returns:
        A text such as "contact 0, 1 forward".
    """
    groups: dict[tuple[str, str], list[str]] = {}
    for name in names:
        found = re.fullmatch(r"(contact|link|joint)_(\d+)(.*)", name)
        if found:
            groups.setdefault((f"{found[1]} ", found[3].replace("/", " ")), []).append(found[2])
        else:
            groups.setdefault((name.replace("/", " "), ""), []).append("")
    texts = []
    for (item, rest), numbers in groups.items():
        inner = ", ".join(numbers)
        if len(numbers) > 4:
            whole = int(numbers[-1]) - int(numbers[0]) == len(numbers) - 1
            others = f" .. {numbers[-1]}" if whole else f" and {len(numbers) - 2} more"
            inner = f"{numbers[0]}, {numbers[1]}{others}"
        texts.append(f"{item}{inner}{rest}")
    return "; ".join(texts) if len(texts) <= 2 else f"{texts[0]} and {len(texts) - 1} more"
