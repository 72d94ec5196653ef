"""The picture of a sweep: a line over one key, a map over two."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import ManyRuns, Variations

from .colors import ACTUATION, TENSION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INVALID = "#d8d8d8"
_ROUNDING = 1e-9
_WORDS = {"per_period": "net translation in the last period [m]", "gained": "net translation over the run [m]"}


def draw_sweep(
    variations: Variations, units: Mapping[str, str], logarithmic: Collection[str], runs: ManyRuns, png: Path
) -> None:
    """Draw the net translation over the keys that vary, one or two of them.

    Args:
        variations: the scenes that ran.
        units: unit of each key.
        logarithmic: keys with a logarithmic axis.
        runs: the results.
        png: the file to write.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    keys = [key for key, n in zip(variations.values, variations.shape, strict=True) if n > 1]
    name, gain = shown_gain(runs)
    figure, axes = plt.subplots(figsize=(8, 5.5 if len(keys) == 2 else 4.5), layout="constrained")
    label = _WORDS[name].replace("translation", "translation along x" if runs.gained.ndim == 2 else "translation")
    if len(keys) == 1:
        _draw_line(axes, variations.values[keys[0]], gain, runs)
        axes.set_ylabel(label)
    else:
        _draw_map(figure, axes, [variations.values[key] for key in keys], gain, runs, label)
    for key, axis in zip(keys, "xy", strict=False):
        getattr(axes, f"set_{axis}label")(f"{key} [{units[key]}]".replace(" [1]", ""))
        if key in logarithmic:
            getattr(axes, f"set_{axis}scale")("log")
    stopped = ", stopped early" if runs.interrupted else ""
    axes.set_title(f"{variations.base.name}: {len(runs)} variations{stopped}", fontsize=10)
    figure.savefig(png, dpi=110)
    plt.close(figure)


def _draw_line(axes: Axes, values: np.ndarray, gain: np.ndarray, runs: ManyRuns) -> None:
    order = np.argsort(values, kind="stable")
    axes.axhline(0.0, color="#9a9a9a", linewidth=0.8)
    axes.plot(values[order], gain[order], color=TENSION, linewidth=1.4, marker="o" if values.size <= 60 else "", ms=3)
    opened = (runs.status == "done") & ~runs.unique
    if opened.any():
        axes.plot(values[opened], gain[opened], "o", color=ACTUATION, ms=4, label="translation not unique")
    for i, value in enumerate(values[runs.status == "invalid"]):
        axes.axvline(value, color=_INVALID, zorder=0, label="invalid" if i == 0 else None)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8)
    axes.grid(alpha=0.25)


def _draw_map(
    figure: Figure, axes: Axes, columns: list[np.ndarray], gain: np.ndarray, runs: ManyRuns, label: str
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
    drawn = axes.pcolormesh(x, y, table, shading="nearest", rasterized=True, **scale)
    figure.colorbar(drawn, ax=axes, label=label)
    handles = []
    opened = np.zeros(table.shape)
    opened[row, column] = (runs.status == "done") & ~runs.unique
    if opened.any() and not opened.all():
        at = np.nonzero(opened)
        axes.plot(x[at[1]], y[at[0]], ".", color=ACTUATION, ms=2)
        handles.append(Patch(color=ACTUATION, label="translation not unique"))
    if not np.isfinite(table).all():
        handles.append(Patch(color=_INVALID, label="invalid or not run"))
    if handles:
        axes.legend(handles=handles, fontsize=8, loc="upper left")


def shown_gain(runs: ManyRuns) -> tuple[str, np.ndarray]:
    """Choose the net translation to show: per period if there are periods; in the plane along x.

    Args:
        runs: the results.

    Returns:
        Its name in `ManyRuns`, and its values, shape (M,) [m].
    """
    name = "per_period" if np.isfinite(runs.per_period).any() else "gained"
    column = getattr(runs, name)
    return name, column if column.ndim == 1 else column[:, 0]
