"""The figure of a comparison of two runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model.body.drive import NS
from crawler_pictures.colors import BACK, FORWARD, GREY
from crawler_pictures.numbers import ROUNDING, label_values
from crawler_pictures.run.kymograph import write_title
from crawler_pictures.style import open_figure, own_style, page, rim_of, write_figure

from ..analysis import Replay
from .compare import RunComparison

_COLORS = ("#46688f", "#d07a1e")
_MOST_POINTS, _MOST_BARS = 5000, 60


@own_style()
def draw_comparison(found: RunComparison, png: Path) -> None:
    """Draw both runs: net translation over time, translation of each cycle, slips, energy.

    Args:
        found: the comparison.
        png: the file to write.
    """
    figure = open_figure(11, 14 if page().narrow else 7, stacked=True)
    if page().narrow:
        axes = figure.subplots(4, 1).reshape(2, 2)
    else:
        axes = figure.subplots(2, 2, width_ratios=[2, 1])
    runs = (found.first, found.second)
    labels = [f"{letter}: {run.path.name}" for letter, run in zip("AB", runs, strict=True)]
    _draw_translations(axes[0, 0], runs, labels)
    axes[0, 0].legend(loc="best", frameon=False, fontsize=8)  # below the title: names of recordings are long
    energy = 0.0
    for run, color in zip(runs, _COLORS, strict=True):
        if run.energy is not None:
            every = run.table.run == 0
            lost = np.cumsum(run.table.dissipation[every])
            energy = max(energy, float(lost.max(initial=0.0)))
            axes[1, 0].plot(run.table.end_ns[every] / NS, lost, color=color, linewidth=1.6)
    differences = found.commands_differ, found.motion_differs
    for when, resets, axis in zip(differences, found.resets, (axes[1, 0], axes[0, 0]), strict=True):
        if when is not None and resets == 0:
            axis.axvline(when, color=GREY, linewidth=0.8, linestyle="--")
    write_title(axes[0, 0], f"net translation{_explain(runs)}; dashed: first difference")
    label_values(axes[1, 0], "dissipation", "J", energy)
    write_title(axes[1, 0], "dissipated energy; dashed: first difference of the commands")
    axes[1, 0].set_xlabel("simulated time [s]")
    _draw_cycles(axes[:, 1], runs)
    write_figure(figure, png, 110)


def _draw_cycles(axes: Any, runs: Sequence[Replay]) -> None:
    """Draw the translation of the cycles of two runs at their times, before any reset, and the sums of all slips."""
    size = max(run.table.size for run in runs)
    for k, (run, color) in enumerate(zip(runs, _COLORS, strict=True)):
        cycles = [c for c in run.cycles if c.run == 0]
        each = np.array([np.atleast_1d(c.translation) for c in cycles]).reshape(len(cycles), -1)
        gained, *across = np.where(np.abs(each) > ROUNDING * size, each, 0.0).T if cycles else [np.zeros(0)]
        middle = np.array([0.5 * (c.start + c.end) for c in cycles])
        length = np.array([c.end - c.start for c in cycles])
        if gained.size <= _MOST_BARS:
            axes[0].bar(middle, gained, width=(0.84, 0.42)[k] * length, color=color)
        else:
            axes[0].plot(middle, gained, color=color, linewidth=1.2)
        for y in across:
            axes[0].plot(middle, y, "kD", markerfacecolor=color, markersize=(6, 4)[k])
        slips = [sum(getattr(c, f"slip_{way}") for c in run.cycles) for way in ("forward", "backward")]
        forward, back = (v if v > ROUNDING * size else 0.0 for v in slips)
        axes[1].bar([k - 0.2, k + 0.2], [forward, -back], width=0.36, color=[FORWARD, BACK])
    for axis in axes:
        axis.axhline(0.0, color="#9a9a9a", linewidth=0.8)
    label_values(axes[0], "gained", "m", size)
    way = ", at its time"
    if _explain(runs):
        way = ": bars ahead, diamonds to the left" if runs[0].turns else ": bars x, diamonds y"
    write_title(axes[0], f"translation of each cycle{way}")
    axes[0].set_xlabel("simulated time [s]")
    axes[1].set_xticks([0, 1], ["A", "B"])
    label_values(axes[1], "slip", "m", size)
    write_title(axes[1], "slips forward and back in all cycles")


def _draw_translations(axis: Any, runs: Sequence[Replay], labels: Sequence[str]) -> None:
    """Draw the net translation of the first run of each recording between resets, from its start; y is thin."""
    for k, (run, label, color) in enumerate(zip(runs, labels, _COLORS, strict=True)):
        rim = rim_of(k, len(runs))
        rows = np.flatnonzero(run.table.run == 0)
        rows = rows[:: max(rows.size // _MOST_POINTS, 1)]
        time, (x, *across) = run.table.end_ns[rows] / NS, run.table.net_translation[rows].T
        axis.plot(time, x - x[0], color=color, linewidth=1.6 + rim, label=label)
        for y in across:
            axis.plot(time, y - y[0], color=color, linewidth=0.8 + rim)
    label_values(axis, "net translation", "m", max(run.table.size for run in runs))


def _explain(runs: Sequence[Replay]) -> str:
    """Explain the lines of runs in the plane."""
    return " (thick: x, thin: y)" if any(run.table.net_translation.shape[1] == 2 for run in runs) else ""
