"""Pictures of a fitted loop: measured and modelled force, and what is left."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from crawler_pictures.colors import GREY, LINES
from crawler_pictures.numbers import shorten
from crawler_pictures.style import open_figure, own_style, page, write_figure

from ..springs.springs import Springs

_MM = 1e3


@own_style()
def draw_springs(found: Springs, path: Path) -> None:
    """Draw force over elongation and over time with the model, and the residuals below.

    Args:
        found: the fitted spring.
        path: the .png file.
    """
    figure = open_figure(10.0, 9.0 if page().narrow else 5.0, stacked=True)
    if page().narrow:
        axes = figure.subplot_mosaic([["loop"], ["force"], ["left"]], height_ratios=[2, 2, 1])
    else:
        axes = figure.subplot_mosaic([["loop", "force"], ["loop", "left"]], width_ratios=[1.1, 1], height_ratios=[2, 1])
    loop, force, left = axes["loop"], axes["force"], axes["left"]
    measured, model = LINES[0], LINES[1]
    for axis, along in ((loop, _MM * found.elongation), (force, found.time)):
        axis.plot(along, found.force, ".", color=measured, markersize=2.0, label="measured", rasterized=True)
        axis.plot(along, found.fitted, color=model, linewidth=1.4, label="model")
        axis.set_ylabel("force, N")
    loop.set_xlabel("elongation, mm")
    loop.locator_params(axis="x", nbins=5)
    loop.legend(loc="upper left", frameon=False, markerscale=4.0)
    kind = f"curve of {len(found.stiffnesses)} pieces" if found.knots else f"{found.stiffnesses[0].value:.4g} N/m"
    count = len(found.elements)
    title = f"{shorten(found.name, 40)}: {kind}, {count} element{'' if count == 1 else 's'} of hysteresis"
    loop.set_title(title, loc="left", fontsize=9, parse_math=False)
    force.sharex(left)
    force.tick_params(labelbottom=False)
    left.axhspan(-1.96 * found.noise, 1.96 * found.noise, color=GREY, alpha=0.3, linewidth=0.0)
    left.plot(found.time, found.force - found.fitted, color=measured, linewidth=0.7)
    reach = 1.1 * max(float(np.percentile(np.abs(found.force - found.fitted), 99.9)), 4.0 * found.noise)
    left.set_ylim(-reach, reach)
    left.set_ylabel("residual, N")
    left.set_xlabel("row" if found.rate is None else "time, s")
    left.set_title("grey: 95 % of the noise between neighbouring rows", loc="left", fontsize=8)
    write_figure(figure, path, 120)
