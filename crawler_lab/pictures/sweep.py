"""The picture of a sweep: a line over one key, a map over two."""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import CrawlerError
from crawler_pictures.colors import ACTUATION, TENSION
from crawler_pictures.numbers import shorten
from crawler_pictures.style import draw_levels, open_figure, own_style, page, write_figure

from ..sweep.results import UNITS, ManyRuns
from ..sweep.vary import Variations

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INVALID = "#d8d8d8"
_ROUNDING, _GAP, _JUMP = 1e-9, 2.5, 0.1
_WORDS = {
    "per_period": "net translation in the last period [m]",
    "gained": "net translation over the run [m]",
    "dx": "forward motion in the last period [m]",
}


@own_style()
def draw_sweep(
    variations: Variations,
    units: Mapping[str, str],
    logarithmic: Collection[str],
    runs: ManyRuns,
    png: Path,
    column: str | None = None,
    over: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Draw a result over the keys that vary, one or two of them.

    Args:
        variations: the scenes that ran.
        units: unit of each key.
        logarithmic: keys with a logarithmic axis.
        runs: the results.
        png: the file to write.
        column: name of the result in `ManyRuns`; None for the net translation.
        over: what the axes show, each of shape (M,), as ratios of keys; None for the values of the keys.

    Raises:
        CrawlerError: when no variation has a value of the result.
    """
    over = over or variations.values
    keys = [key for key, n in zip(over, variations.shape, strict=True) if n > 1]
    name, gain = shown_gain(runs) if column is None else shown_column(runs, column)
    name, axis = _split_column(runs, name)
    figure = open_figure(8, 5.5 if len(keys) == 2 else 4.5)
    axes = figure.subplots()
    unit = UNITS.get(name, "1")
    label = _WORDS.get(name, name.replace("_", " ") + (f" [{unit}]" if unit != "1" else ""))
    if runs.gained.ndim == 2 and getattr(runs, name).ndim == 2:
        along = f"along {axis}"
        label = label.replace("translation", f"translation {along}") if name in _WORDS else f"{label}, {along}"
    label = textwrap.fill(label, 28) if page().narrow else label
    if len(keys) == 1:
        _draw_line(axes, over[keys[0]], gain, runs, keys[0] in logarithmic)
        axes.set_ylabel(label)
    else:
        axes_values = [over[key] for key in keys]
        _draw_map(figure, axes, axes_values, [key in logarithmic for key in keys], gain, runs, label)
    for key, axis in zip(keys, "xy", strict=False):
        getattr(axes, f"set_{axis}label")(f"{key} [{units[key]}]".replace(" [1]", ""))
        if key in logarithmic:
            getattr(axes, f"set_{axis}scale")("log")
    stopped = ", stopped early" if runs.interrupted else ""
    title = f"{shorten(variations.base.name)}: {len(runs)} variations{stopped}"
    if not page().paper:
        axes.set_title(title, fontsize=10, loc="left", parse_math=False)
    write_figure(figure, png, 110)


def _draw_line(axes: Axes, values: np.ndarray, gain: np.ndarray, runs: ManyRuns, logarithmic: bool) -> None:
    opened = (runs.status == "done") & ~runs.unique
    joined = gain if opened.all() else np.where(opened, np.nan, gain)  # one choice of many is on no line
    order = np.argsort(values, kind="stable")
    at, shown = values[order], joined[order]
    axes.axhline(0.0, color="#9a9a9a", linewidth=0.8)
    style: Any = {"color": TENSION, "linewidth": 1.4, "marker": "o" if values.size <= 60 else "", "ms": 3}
    draw_broken(axes, at, shown, find_gaps(np.log(at) if logarithmic else at) | find_jumps(shown), **style)
    if opened.any():
        axes.plot(values[opened], gain[opened], "o", color=ACTUATION, ms=4, label="translation not unique")
    for i, value in enumerate(values[runs.status == "invalid"]):
        axes.axvline(value, color=_INVALID, zorder=0, label="invalid" if i == 0 else None)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8)
    axes.grid(alpha=0.25)


def find_gaps(values: np.ndarray) -> np.ndarray:
    """Find gaps in a grid, for example between wavelengths of both signs.

    Args:
        values: increasing, shape (K,); equal values are allowed.

    Returns:
        Whether the distance to the next value is more than two and a half times the usual one, shape (K - 1,).
    """
    steps = np.diff(values)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    return np.asarray(steps > _GAP * usual)


def find_jumps(values: np.ndarray) -> np.ndarray:
    """Find large steps of a curve that neither neighbour continues: jumps, and what its samples do not resolve.

    Args:
        values: samples of the curve, shape (K,); NaN where there is none.

    Returns:
        Whether the step to the next value is more than a tenth of the range of all values, and more than twice both
        neighbouring steps in its direction, shape (K - 1,); never the first and the last one.
    """
    steps = np.diff(values)
    if steps.size == 0:
        return np.zeros(0, bool)
    before, after = np.append(steps[:1], steps[:-1]), np.append(steps[1:], steps[-1:])
    known = values[np.isfinite(values)]
    large = np.abs(steps) > _JUMP * (np.ptp(known) if known.size else 0.0)
    return np.asarray(large & (np.fmax(before * np.sign(steps), after * np.sign(steps)) < 0.5 * np.abs(steps)))


def draw_broken(axes: Axes, at: np.ndarray, values: np.ndarray, breaks: np.ndarray, **style: Any) -> None:
    """Draw a curve that is not joined across breaks; the samples next to them are dots.

    Args:
        axes: axes to draw on.
        at: shape (K,).
        values: shape (K,).
        breaks: whether the curve breaks before the next sample, shape (K - 1,).
        style: of the line, for matplotlib.
    """
    after = np.flatnonzero(breaks) + 1
    axes.plot(np.insert(at, after, np.nan), np.insert(values, after, np.nan), **style)
    beside = np.union1d(after, after - 1)
    axes.plot(at[beside], values[beside], "o", color=style["color"], ms=3)


def _cells(values: np.ndarray, logarithmic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Compute the edges of cells around increasing values, and the value of each cell, -1 for a gap."""
    at = np.log(values) if logarithmic else values
    steps = np.diff(at)
    usual = float(np.median(steps)) if steps.size else 1.0
    gap = find_gaps(at)
    edges, owner = [at[0] - 0.5 * (steps[0] if steps.size and not gap[0] else usual)], [0]
    for k in range(steps.size):
        edges += [at[k] + 0.5 * usual, at[k + 1] - 0.5 * usual] if gap[k] else [at[k] + 0.5 * steps[k]]
        owner += [-1, k + 1] if gap[k] else [k + 1]
    edges.append(at[-1] + 0.5 * (steps[-1] if steps.size and not gap[-1] else usual))
    return np.exp(edges) if logarithmic else np.array(edges), np.array(owner)


def _draw_map(
    figure: Figure,
    axes: Axes,
    columns: list[np.ndarray],
    logarithmic: list[bool],
    gain: np.ndarray,
    runs: ManyRuns,
    label: str,
) -> None:
    from matplotlib.patches import Patch

    (x, column), (y, row) = (np.unique(values, return_inverse=True) for values in columns)
    table = np.full((y.size, x.size), np.nan)
    table[row, column] = gain
    limit = float(np.nanmax(np.abs(gain), initial=0.0)) or 1.0
    least, most = np.nanmin(gain, initial=0.0) < -_ROUNDING * limit, np.nanmax(gain, initial=0.0) > _ROUNDING * limit
    # white is no motion, green forward, purple backward
    cmap = "PRGn" if least and most else "Purples_r" if least else "Greens"
    scale: Any = {"cmap": cmap, "vmin": -limit if least else 0.0, "vmax": limit if most or not least else 0.0}
    axes.set_facecolor(_INVALID)
    (across, x_of), (upwards, y_of) = (_cells(v, log) for v, log in zip((x, y), logarithmic, strict=True))
    cells = np.where((y_of >= 0)[:, None] & (x_of >= 0), table[np.maximum(y_of, 0)][:, np.maximum(x_of, 0)], np.nan)
    drawn = axes.pcolormesh(across, upwards, cells, rasterized=True, **scale)
    figure.colorbar(drawn, ax=axes, label=label)
    draw_levels(axes, x, y, table)
    handles = []
    opened = np.zeros(table.shape)
    opened[row, column] = (runs.status == "done") & ~runs.unique
    if opened.any() and not opened.all():
        at = np.nonzero(opened)
        axes.plot(x[at[1]], y[at[0]], ".", color=ACTUATION, ms=4)
        handles.append(Patch(color=ACTUATION, label="translation not unique"))
    if not np.isfinite(cells).all():
        done = runs.status[~np.isfinite(gain)] == "done"
        why = ["no value"] * bool(done.any()) + ["invalid or not run"] * (not done.size or not done.all())
        handles.append(Patch(color=_INVALID, label=", ".join(why)))
    if handles:
        where: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.2}
        axes.legend(handles=handles, fontsize=8, ncols=2, frameon=False, **where)


def shown_gain(runs: ManyRuns) -> tuple[str, np.ndarray]:
    """Choose the net translation to show: per period if there are periods; in the plane along x, or along the heading.

    Args:
        runs: the results.

    Returns:
        Its name in `ManyRuns`, and its values, shape (M,) [m].
    """
    if np.isfinite(runs.dx).any():
        return "dx", runs.dx
    name = "per_period" if np.isfinite(runs.per_period).any() else "gained"
    column = getattr(runs, name)
    return name, column if column.ndim == 1 else column[:, 0]


def _split_column(runs: ManyRuns, column: str) -> tuple[str, str]:
    """Split a name in the table into the name in `ManyRuns` and the axis, x or y, which counts for vectors."""
    name, _, axis = column.rpartition("_")
    return (name, axis) if axis in ("x", "y") and hasattr(runs, name) else (column, "x")


def shown_column(runs: ManyRuns, column: str) -> tuple[str, np.ndarray]:
    """Read a column to show.

    Args:
        runs: the results.
        column: its name in the table, or of a vector in `ManyRuns` for the component along x.

    Returns:
        The name, and the values, NaN where a variation is not done, shape (M,).

    Raises:
        CrawlerError: when no variation has a value.
    """
    name, axis = _split_column(runs, column)
    values = np.asarray(getattr(runs, name), dtype=np.float64)
    values = np.where(runs.status == "done", values if values.ndim == 1 else values[:, "xy".index(axis)], np.nan)
    if not np.isfinite(values).any():
        raise CrawlerError(f"--plot: no variation has a value of {column}")
    return column, values
