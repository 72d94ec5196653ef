"""Pictures of an identification: measurements and model, and residuals over time and over the phase of the commands."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from crawler_pictures.colors import LINES, TEXT
from crawler_pictures.numbers import shorten
from crawler_pictures.style import open_figure, own_style, page, write_figure

from ..identify.fit.misfit import Misfit, find_period
from ..identify.identification import Identification
from ..identify.measurements import Measurements
from ..identify.sensor.noise import find_spikes

_MOST_RECORDINGS, _MOST_ROWS = 6, 12
"""Of more recordings or channels, only the ones with the largest residuals in units of their noise are drawn."""
_BAND = 1.96
_BINS, _FEWEST = 24, 5
"""Parts of a period in which residuals are averaged, and the fewest residuals whose mean is drawn."""
_PERCENTILE, _LEAST = 99.5, 4.0
"""Residuals up to this percentile without outliers, and this many times the noise, lie within the axes."""
_GAP = 6.0
"""Steps of time longer than this many usual ones interrupt lines."""
_HELD_OUT, _HELD_OUT_DOTS = "0.92", "0.65"
_MM = 1e3


@dataclass(frozen=True, eq=False)
class _Row:
    """The residuals of a channel.

    Attributes:
        channel: its name.
        color: of all that belongs to it.
        values: measured, shape (T,) [m].
        errors: simulated minus measured, shape (T,) [m].
        band: half width of the range in which 95 % of them are expected, shape (T,) [m].
        noise: standard deviation of its measurements [m].
        misfit: size of its residuals; None if it has few fitted rows.
    """

    channel: str
    color: str
    values: np.ndarray
    errors: np.ndarray
    band: np.ndarray
    noise: float
    misfit: Misfit | None

    @property
    def size(self) -> float:
        """The residuals in units of the noise."""
        return float(np.sqrt(np.nanmean(self.errors**2))) / self.noise if self.misfit is None else self.misfit.ratio

    @property
    def reach(self) -> float:
        """How far its axes reach [m]."""
        seen = self.errors[np.isfinite(self.errors)]
        kept = seen[~find_spikes(seen, 0.0)]
        return max(float(np.percentile(np.abs(kept), _PERCENTILE)), _LEAST * self.noise)


@own_style()
def draw_identification(found: Identification, path: Path) -> None:
    """Draw each recording with the model over it, and what differs.

    Args:
        found: the identification.
        path: the .png file.
    """
    write_figure(plot_identification(found), path, 120)


@own_style()
def plot_identification(found: Identification) -> Figure:
    """Plot each recording with the model over it; below, a row for each channel with its residuals.

    Residuals are drawn over time and, to the right, over the phase of the commands, or over position where the commands
    do not repeat. A misfit that belongs to the motion shows there as a mean that leaves the band of the noise.

    Args:
        found: the identification.

    Returns:
        The figure.
    """
    recordings = [_collect_rows(found, i, misfits) for i, misfits in enumerate(_assign_misfits(found))]
    shown = _largest([max(row.size for row in rows) for rows in recordings], _MOST_RECORDINGS)
    kept = [[recordings[i][m] for m in _largest([row.size for row in recordings[i]], _MOST_ROWS)] for i in shown]
    heights = [3.1 + len(rows) * (1.1 if len(rows) <= 3 else 0.9 if len(rows) <= 6 else 0.75) for rows in kept]
    figure = open_figure(10.0, sum(heights), stacked=True)
    parts = figure.subfigures(len(shown), 1, squeeze=False, height_ratios=heights)[:, 0]
    for part, i, rows in zip(parts, shown, kept, strict=True):
        title = shorten(found.recordings[i].name)
        if i == shown[0] and len(shown) < len(recordings):
            title += f" (one of the {len(shown)} of {len(recordings)} recordings with the largest residuals)"
        if len(rows) < len(recordings[i]):
            title += f"; the {len(rows)} of {len(recordings[i])} channels with the largest residuals"
        part.suptitle(title, x=0.01, horizontalalignment="left", fontsize=10, parse_math=False)
        _plot_recording(part, found.recordings[i], found.fitted[i], rows)
    return figure


def _largest(sizes: list[float], most: int) -> list[int]:
    """Choose the indices of the largest sizes, in order."""
    return sorted(sorted(range(len(sizes)), key=lambda i: -sizes[i])[:most])


def _assign_misfits(found: Identification) -> list[dict[str, Misfit]]:
    """Assign misfits to recordings by channel; two recordings may have the same name."""
    left = list(found.misfits)
    assigned: list[dict[str, Misfit]] = []
    for measured in found.recordings:
        assigned.append({})
        for channel in measured.channels:
            if left and (left[0].recording, left[0].channel) == (measured.name, channel):
                assigned[-1][channel] = left.pop(0)
    return assigned


def _collect_rows(found: Identification, i: int, misfits: dict[str, Misfit]) -> list[_Row]:
    """Collect the residuals of all channels of a recording."""
    measured, fitted, noises = found.recordings[i], found.fitted[i], found.noises[i]
    errors = found.residuals[i] if found.score is None else found.score.errors[i]
    deviations = None if fitted.all() or found.score is None else found.score.deviations[i]
    rows = []
    for m, channel in enumerate(measured.channels):
        misfit = misfits.get(channel)
        # the noise of a recording without a fitted row is known from others
        others = [one.noise for one in found.misfits if one.channel == channel]
        noise = float(np.median(others or noises[m])) if misfit is None else misfit.noise
        expected = np.full(measured.time.size, noise)
        if deviations is not None and deviations.size:
            expected = np.where(fitted, noise, deviations[:, m])
        color = LINES[m % len(LINES)]
        rows.append(_Row(channel, color, measured.values[:, m], errors[:, m], _BAND * expected, noise, misfit))
    return rows


def _plot_recording(part: SubFigure, measured: Measurements, fitted: np.ndarray, rows: list[_Row]) -> None:
    """Plot the positions of a recording with a key, and below the residuals of each channel."""
    ratios = [2.6 if len(rows) <= 6 else 4.0, *(1.0 for _ in rows)]
    narrow = page().narrow
    sides = [1.4 if narrow else 2.4, 1.0]
    axes = part.subplots(1 + len(rows), 2, squeeze=False, height_ratios=ratios, width_ratios=sides)
    over_time, over_phase = axes[:, 0], axes[1:, 1]
    for axis in over_time:
        axis.sharex(over_time[-1])
        for first, last in _find_stretches(measured.time, ~fitted):
            axis.axvspan(first, last, color=_HELD_OUT, zorder=0, linewidth=0.0)
    _plot_positions(over_time[0], measured.time, fitted, rows)
    period = find_period(measured.command_time, measured.commands)
    limit = _MM * max(row.reach for row in rows)
    for row, left, right in zip(rows, over_time[1:], over_phase, strict=True):
        right.sharex(over_phase[-1])
        _plot_over_time(left, measured.time, row, limit)
        _plot_over_phase(right, measured.time, fitted, row, period, limit)
        for axis in (left, right):
            axis.set_ylim(-1.1 * limit, 1.1 * limit)
            axis.tick_params(labelsize=7)
            axis.label_outer(remove_inner_ticks=False)
            axis.axhline(0.0, color=TEXT, linewidth=0.5, zorder=1)
        right.tick_params(labelleft=False)
    over_time[0].tick_params(labelsize=7, labelbottom=False)
    over_time[1].set_title(
        "residuals, mm" if narrow else "residuals (simulated - measured) over time, mm", loc="left", fontsize=8
    )
    over_time[-1].set_xlabel("time, s", fontsize=8)
    if period:
        title, label = "over the phase of the commands, mm", f"phase of the period of {period:.4g} s"
    else:
        title, label = "over position, mm", "way from the first position, mm (the commands do not repeat)"
    over_phase[0].set_title("" if narrow else title, loc="left", fontsize=8)
    over_phase[-1].set_xlabel(("phase" if period else "way, mm") if narrow else label, fontsize=8)
    _plot_key(part, axes[0], not fitted.all(), any(row.misfit and row.misfit.since is not None for row in rows))


def _plot_positions(axis: Axes, time: np.ndarray, fitted: np.ndarray, rows: list[_Row]) -> None:
    for row in rows:
        axis.plot(time, row.values, ".", color=row.color, markersize=5.0, alpha=0.25, markeredgewidth=0.0)
        seen = np.isfinite(row.errors)
        at, model, band = time[seen], (row.values + row.errors)[seen], row.band[seen]
        axis.plot(*_interrupt(at, model), color=row.color, linewidth=0.9)
        axis.fill_between(
            at, model - band, model + band, where=~fitted[seen], color=row.color, alpha=0.3, linewidth=0.0
        )
    axis.set_ylabel("m", fontsize=8)
    axis.set_title("measured and simulated, m", loc="left", fontsize=8)


def _plot_over_time(axis: Axes, time: np.ndarray, row: _Row, limit: float) -> None:
    errors = _MM * row.errors
    axis.fill_between(time, -_MM * row.band, _MM * row.band, color=row.color, alpha=0.2, linewidth=0.0)
    axis.plot(time, errors, ".", color=row.color, markersize=2.0, markeredgewidth=0.0)
    _plot_beyond(axis, time, errors, row.color, limit)
    if row.misfit is not None and row.misfit.since is not None:
        axis.axvline(row.misfit.since, color=TEXT, linewidth=1.0, linestyle="--")
    if page().narrow:
        axis.annotate(row.channel, (0.02, 0.95), xycoords="axes fraction", va="top", color=row.color, zorder=5)
        return
    axis.set_ylabel(f"{row.channel}\n{row.size:.3g} x noise", color=row.color, rotation=0, fontsize=8)
    axis.yaxis.label.set(horizontalalignment="right", verticalalignment="center")


def _plot_over_phase(
    axis: Axes, time: np.ndarray, fitted: np.ndarray, row: _Row, period: float | None, limit: float
) -> None:
    """Plot residuals and their means over the phase of the commands, or over position without a period."""
    errors = _MM * row.errors
    seen = np.isfinite(errors)
    place = time % period / period if period else _MM * (row.values - row.values[seen][0])
    band = _MM * _BAND * row.noise
    axis.axhspan(-band, band, color=row.color, alpha=0.2, linewidth=0.0)
    averaged = seen & fitted if (seen & fitted).any() else seen
    for some, color in ((seen & ~averaged, _HELD_OUT_DOTS), (averaged, row.color)):
        axis.plot(place[some], errors[some], ".", color=color, markersize=2.4, markeredgewidth=0.0, alpha=0.7)
        _plot_beyond(axis, place[some], errors[some], color, limit)
    kept = averaged.copy()
    kept[averaged] = ~find_spikes(row.errors[averaged], 0.0)
    outline = [patheffects.withStroke(linewidth=3.0, foreground="white")]
    ends = (0.0, 1.0) if period else (float(place[seen].min()), float(place[seen].max()))
    axis.plot(*_average(place[kept], errors[kept], ends), color=row.color, linewidth=1.5, path_effects=outline)
    axis.set_xlim(ends)


def _average(place: np.ndarray, values: np.ndarray, ends: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Average values in equal parts of a range; parts with few values are NaN."""
    edges = np.linspace(*ends, _BINS + 1)
    part = (np.searchsorted(edges, place, side="right") - 1).clip(0, _BINS - 1)
    count = np.bincount(part, minlength=_BINS)
    mean = np.bincount(part, values, minlength=_BINS) / np.maximum(count, 1)
    return 0.5 * (edges[1:] + edges[:-1]), np.where(count >= _FEWEST, mean, np.nan)


def _plot_beyond(axis: Axes, place: np.ndarray, errors: np.ndarray, color: str, limit: float) -> None:
    """Mark values outside the axes at their edge."""
    for sign, marker in ((1.0, "^"), (-1.0, "v")):
        beyond = sign * errors > 1.1 * limit
        edge = np.full(int(beyond.sum()), sign * 1.03 * limit)
        axis.plot(place[beyond], edge, marker, color=color, markersize=3.0, markeredgewidth=0.0)


def _plot_key(part: SubFigure, top: np.ndarray, held_out: bool, since: bool) -> None:
    """Explain dots, lines and bands to the right of the positions, on narrow pages below all panels."""
    positions, axis = top
    dots: Any = {"marker": ".", "linestyle": "", "color": TEXT}
    band = "95 % of the noise" + ("; of the prediction" if held_out else "")
    handles = [
        Line2D([], [], **dots, markersize=5.0, label="measured; residual"),
        Line2D([], [], color=TEXT, linewidth=0.9, label="simulated, with offset and drift"),
        Line2D([], [], color=TEXT, linewidth=1.8, label="mean of the coloured dots"),
        Patch(color=TEXT, alpha=0.3, linewidth=0.0, label=band),
    ]
    handles += [Patch(color=_HELD_OUT, label="held out (right: grey dots)")] if held_out else []
    handles += [Line2D([], [], color=TEXT, linestyle="--", linewidth=1.0, label="misfit from here on")] if since else []
    if page().narrow:
        grid = axis.get_gridspec()
        axis.remove()
        positions.set_subplotspec(grid[0, :])
        part.legend(handles=handles, loc="outside lower left", frameon=False)
        return
    axis.set_axis_off()
    legend = axis.legend(handles=handles, loc="upper left", frameon=False, fontsize=8, borderaxespad=0.0)
    legend.set_in_layout(False)


def _find_stretches(time: np.ndarray, marked: np.ndarray) -> list[tuple[float, float]]:
    """List the first and last time of each run of marked rows."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False])).astype(int)))
    return [(float(time[first]), float(time[end - 1])) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def _interrupt(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Insert NaN where time has a gap."""
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > _GAP * np.median(steps)) + 1
    return np.insert(time, gaps, np.nan), np.insert(values, gaps, np.nan)
