"""Colours and ticks of the rerun view, which is dark as rerun's plots are."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from crawler_pictures.colors import BACK, FORWARD, STALLED, YIELDING, rgb
from crawler_pictures.film.camera import mark_ticks

BACKGROUND = [13, 16, 17]
"""The background of rerun's plots."""
STICK = (125, 125, 125)
STATES = {-1: rgb(BACK), 0: STICK, 1: rgb(FORWARD)}
"""Colours of the states of a contact."""
YIELDS = {-1: (150, 150, 150), 1: rgb(STALLED), 2: rgb(YIELDING)}
"""Colours of links that are slack and stalled."""
LINES = (
    *((86, 140, 250), (236, 150, 50), (190, 120, 240), (40, 185, 185)),
    *((240, 120, 160), (170, 170, 60), (150, 110, 80), (200, 200, 200)),
)
"""Colours of links and curves."""
LINE_NAMES = ("blue", "orange", "violet", "turquoise", "pink", "olive", "brown", "white")
BOUND, FAINT, TEXT = (150, 150, 150), (70, 74, 76), (225, 225, 225)
MOVING, BOTH = (235, 235, 235), (240, 205, 70)
_SMALLEST = 1e-3
"""Smaller views are magnified: the viewer draws nothing of 1e-5, and keeps radii of lines as half floats."""


def color_of(number: int) -> tuple[int, int, int]:
    """Return the colour of a link or a curve."""
    return LINES[number % len(LINES)]


def draw_grid(stream: Any, entity: str, low: np.ndarray, high: np.ndarray, step: float, unit: str) -> None:
    """Draw a grid with numbers along its lower and left side, in a view in which y points down.

    Args:
        stream: the recording to log to.
        entity: parent of what is logged.
        low: lower left corner, shape (2,).
        high: upper right corner, shape (2,).
        step: distance of the lines.
        unit: unit of the numbers.
    """
    across, upwards = (mark_ticks(low[i], high[i], step) for i in range(2))
    lines = [[[x, -low[1]], [x, -high[1]]] for x in across] + [[[low[0], -y], [high[0], -y]] for y in upwards]
    zero = [x == 0.0 for x in np.concatenate((np.abs(across) > 0.5 * step, np.abs(upwards) > 0.5 * step))]
    colors = [BOUND if z else FAINT for z in zero]
    grid = rr.LineStrips2D(lines, colors=colors, radii=rr.Radius.ui_points(0.5), draw_order=-30.0)
    stream.log(f"{entity}/grid", grid, static=True)
    across, upwards = (v[v > low[i] + 0.3 * step] for i, v in enumerate((across, upwards)))  # the corner stays free
    numbers = [*(f"{v + 0.0:.6g}" for v in across), *(f"{v + 0.0:.6g}" for v in upwards)]
    if numbers:
        numbers[across.size - 1] += f" {unit}" if across.size else ""
        numbers[-1] += f" {unit}"
    places = [(x, -low[1]) for x in across] + [(low[0], -y) for y in upwards]
    labels = rr.Points2D(places, labels=numbers, colors=[TEXT], radii=rr.Radius.ui_points(0.0), show_labels=True)
    stream.log(f"{entity}/numbers", labels, static=True)


def bounds_of_grid(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Choose the part of a view that shows a grid of `draw_grid` with its numbers.

    Args:
        low: lower left corner, shape (2,).
        high: upper right corner, shape (2,).

    Returns:
        Both ends of x and of y, which points down, shape (2, 2).
    """
    margin = 0.1 * float((high - low).max())
    return np.array([[low[0] - margin, high[0] + margin], [-high[1] - margin, -low[1] + margin]])


def line_radius(radius: float, length: float) -> float:
    """Return the radius of a line in the picture of a body.

    Args:
        radius: the radius [m].
        length: of the body, about a quarter of the view [m].

    Returns:
        The same; for a small body it is in points, which rerun takes negative.
    """
    return radius if 4.0 * length >= _SMALLEST else -400.0 * radius / length


def build_flat_view(stream: Any, entity: str, name: str, bounds: np.ndarray) -> Any:
    """Build a view from above, magnified where it is too small for the viewer.

    Args:
        stream: the recording to log to.
        entity: parent of what is shown.
        name: of the view.
        bounds: both ends of x and of y, shape (2, 2).

    Returns:
        The view.
    """
    size, origin, shown = float(np.ptp(bounds, axis=1).max()), entity, "$origin/**"
    if 0.0 < size < _SMALLEST:
        scale = 10.0 ** -np.floor(np.log10(size))
        stream.log(entity, rr.Transform3D(scale=scale), static=True)
        bounds, origin, shown = scale * bounds, "/", f"{entity}/**"
    part = rrb.VisualBounds2D(x_range=bounds[0].tolist(), y_range=bounds[1].tolist())
    return rrb.Spatial2DView(origin=origin, contents=shown, name=name, background=BACKGROUND, visual_bounds=part)
