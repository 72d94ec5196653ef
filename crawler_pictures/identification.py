"""Pictures of an identification: measurements, model and residuals over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from crawler_model import Identification

_MOST_NAMED = 6
"""More channels are not named: their lines lie in the order of the contacts."""
_ABOVE: Any = {
    "loc": "lower right",
    "bbox_to_anchor": (1.0, 1.0),
    "frameon": False,
    "fontsize": 8,
    "borderaxespad": 0.2,
}


def draw_identification(found: Identification, path: Path) -> None:
    """Draw the measured and the simulated values of each recording, and their differences.

    Args:
        found: the identification.
        path: the .png file.
    """
    count = len(found.recordings)
    figure = Figure(figsize=(9.0, 4.0 * count), layout="constrained")
    axes = figure.subplots(2 * count, 1, squeeze=False, height_ratios=[2, 1] * count)[:, 0]
    for i, (measured, residuals, rows) in enumerate(zip(found.recordings, found.residuals, found.fitted, strict=True)):
        above, below = axes[2 * i], axes[2 * i + 1]
        for m, channel in enumerate(measured.channels):
            (line,) = above.plot(measured.time, measured.values[:, m], ".", markersize=2.0)
            above.plot(measured.time, measured.values[:, m] + residuals[:, m], color=line.get_color(), label=channel)
            below.plot(measured.time, residuals[:, m], color=line.get_color(), linewidth=0.8)
        for axis in (above, below):
            for first, last in _stretches(~rows):
                axis.axvspan(measured.time[first], measured.time[last], color="0.92", zorder=0)
        above.set_title(f"{measured.name}: dots measured, lines simulated, grey held out", loc="left", fontsize=9)
        above.set_ylabel("position, m")
        shown = len(measured.channels) if len(measured.channels) <= _MOST_NAMED else 0
        above.legend(*(part[:shown] for part in above.get_legend_handles_labels()), **_ABOVE, ncols=max(shown, 1))
        below.set_ylabel("residual, m")
        below.set_xlabel("time, s")
    figure.savefig(path, format="png", dpi=120)


def _stretches(marked: object) -> list[tuple[int, int]]:
    """List the first and last index of each run of marked rows."""
    found: list[tuple[int, int]] = []
    for i, one in enumerate(list(marked)):  # type: ignore[call-overload]
        if one and found and found[-1][1] == i - 1:
            found[-1] = (found[-1][0], i)
        elif one:
            found.append((i, i))
    return found
