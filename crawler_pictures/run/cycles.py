"""The net translation of each cycle, and the slips of the last one, as bars."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..colors import BACK, FORWARD
from ..numbers import ROUNDING, label_values
from ..style import page
from .arrays import Gains
from .kymograph import write_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_BARS = 60
_GAIN, _TRANSIENT = "#46688f", "#b9c6d8"


def draw_gains(part: Any, gains: Gains, size: float, planar: bool) -> None:
    """Draw the translation of each cycle, and the slips forward and back that add up to it, below on narrow pages.

    Args:
        part: the figure to draw on.
        gains: the cycles.
        size: size of the lengths from which they were computed; smaller numbers by twelve decades are drawn as 0 [m].
        planar: whether the body moves in the plane.
    """
    narrow = page().narrow
    if gains.slips is None:
        left, right = part.subplots(), None
    else:
        left, right = part.subplots(2, 1) if narrow else part.subplots(1, 2, width_ratios=[2, 1])
    gained = np.where(np.abs(gains.gained) > ROUNDING * size, gains.gained, 0.0)
    number = np.arange(1, gained.size + 1)
    left.axhline(0.0, color="#9a9a9a", linewidth=0.8)
    few = gained.size <= 12
    if gained.size <= MOST_BARS:
        colors = [_TRANSIENT if t else _GAIN for t in gains.transient]
        bars = left.bar(number, gained, color=colors, width=0.6)
    else:
        left.plot(number, gained, color=_GAIN, linewidth=1.2)
    left.margins(y=(0.3 if narrow else 0.18) if few else 0.05)
    left.set_xlabel("cycle" + (" (light: transient)" if gains.transient.any() else ""))
    scale = label_values(left, ("x gained" if planar else "net translation") + "\nin the cycle", "m", size)
    if few:
        if not narrow or gained.size <= 6:
            left.bar_label(bars, labels=[f"{v / scale:.4g}" for v in gained], fontsize=8, padding=2)
        left.set_xticks(number)
    if right is not None:
        _draw_slips(right, gains, float(gained[-1]), size)


def _draw_slips(axis: Axes, gains: Gains, gained: float, size: float) -> None:
    assert gains.slips is not None
    forward, back = gains.slips
    words = ["forward", "back", "translation" if gains.parts is None else f"sum / {gains.parts}\n= translation"]
    values = [v if abs(v) > ROUNDING * size else 0.0 for v in (forward, -back, gained)]
    bars = axis.bar(words, values, color=[FORWARD, BACK, _GAIN], width=0.6)
    axis.axhline(0.0, color="#9a9a9a", linewidth=0.8)
    axis.margins(y=0.3 if page().narrow else 0.2)
    scale = label_values(axis, "slip of all parts", "m", size)
    axis.bar_label(bars, labels=[f"{v / scale + 0.0:.4g}" for v in values], fontsize=8, padding=2)
    write_title(axis, "in the last cycle")
