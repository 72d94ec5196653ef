"""Pictures of a prediction: positions over time with their bands."""

from __future__ import annotations

from pathlib import Path

from crawler_pictures.colors import LINES
from crawler_pictures.numbers import shorten
from crawler_pictures.style import open_figure, own_style, write_figure

from ..identify.forecast.predict import Forecast

_MOST_NAMED = 6
"""More contacts are not named: their lines lie in the order of the contacts."""


@own_style()
def draw_forecast(found: Forecast, path: Path) -> None:
    """Draw the predicted positions with their 95 % bands, and how wide the bands are.

    Args:
        found: the prediction.
        path: the .png file.
    """
    figure = open_figure(9.0, 5.5, stacked=True)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    for i, contact in enumerate(found.contacts):
        color = LINES[i % len(LINES)]
        low, value, high = found.low[:, i], found.position[:, i], found.high[:, i]
        above.fill_between(found.time, low, high, color=color, alpha=0.25, linewidth=0.0)
        above.plot(found.time, value, color=color, linewidth=1.0, label=contact)
        for end in (low, high):
            below.plot(found.time, end - value, color=color, linewidth=0.8)
    title = f"{shorten(found.scene.name, 45)}: gain {found.gain} m {found.per}; lines predicted, bands 95 %"
    above.set_title(title, loc="left", fontsize=9, parse_math=False)
    above.set_ylabel("position, m")
    if len(found.contacts) <= _MOST_NAMED:
        above.legend(loc="upper left", frameon=False, fontsize=8, ncols=len(found.contacts))
    below.set_ylabel("ends of the band, m")
    below.set_xlabel("time, s")
    if found.depends_on_bounds:
        named = ", ".join(one.name for one in found.depends_on_bounds)
        text = f"the bands cover all values that the record allows of {named}"
        below.set_title(text, loc="left", fontsize=8)
    write_figure(figure, path, 120)
