"""Pictures of bodies on a line: feet on the ground, and springs or actuators between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from crawler_model import CrawlerError, Scene

from .colors import ACTUATION, GREY, WALL
from .ground import list_sections, list_walls, trace_profile

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BODY, _GROUND = "#202020", "#8a8a8a"


def draw_body(
    axis: Axes, scene: Scene, displacement: ArrayLike, actuation: ArrayLike, actuators: Sequence[int] = ()
) -> None:
    """Draw a chain of contacts at its position; above it there is room for `draw_length`.

    A link has two interpretations with the same tension. As a spring its rest length is the distance of its contacts in
    the reference shape plus L. As an actuator with a spring behind it, the rest length of the spring is half of that
    distance, and the length of the actuator is the other half plus L.

    Patches of ground are coloured bands under the body, with their factor on friction and their slope, and along a
    profile the colour changes as friction does; where there are slopes, a line below shows the heights of the track.
    Walls are bars behind the place at which contacts stand.

    Args:
        axis: axes to draw on: x in m, y from the ground at 0 to the body at 1, and up to 2.6; below the ground there is
            more room where there are patches or slopes.
        scene: a scene of isolated contacts on a line, each joined to the next.
        displacement: x, shape (N,) [m].
        actuation: L of each link, shape (N - 1,) [m].
        actuators: links drawn as an actuator with a spring behind it; the others are drawn as springs.

    Raises:
        CrawlerError: for segments, other graphs than chains, and the plane.
    """
    body = scene.body
    if body.dimension == 2 or body.segments or not body.is_chain:
        raise CrawlerError(f"{scene.name}: only chains of isolated contacts on a line can be drawn")
    place = body.position + np.asarray(displacement, dtype=np.float64)
    length = np.diff(body.position) / 2.0 + np.asarray(actuation, dtype=np.float64)
    reach = float(np.ptp(body.position))
    for i in range(body.contacts):
        _draw_foot(axis, float(place[i]), reach)
        axis.annotate(str(i), (float(place[i]), 0.5), (-4, 0), textcoords="offset points", ha="right", va="center")
    for i in range(body.springs):
        start, end = float(place[i]), float(place[i + 1])
        if i in actuators:
            _draw_actuator(axis, start, start + float(length[i]))
            start += float(length[i])
        _draw_spring(axis, start, end, reach)
    axis.axhline(0.0, color=_GROUND, linewidth=1.0, zorder=1)
    axis.axhspan(-0.22, 0.0, facecolor="none", edgecolor=_GROUND, hatch="////", linewidth=0.0)
    axis.set(ylim=(-0.22, 2.6), yticks=[])
    if scene.parts.ground is not None:
        _draw_ground(axis, scene, float(place.min()) - 0.5 * reach, float(place.max()) + 0.5 * reach)
    axis.spines[["left", "right", "top"]].set_visible(False)


def draw_length(axis: Axes, start: float, end: float, height: float, text: str) -> None:
    """Draw a dimension line with its name above it.

    Args:
        axis: axes to draw on.
        start: start of the line [m].
        end: end of the line [m].
        height: height above the ground, in heights of the body.
        text: name of the length.
    """
    bar = {"arrowstyle": "|-|, widthA=0.25, widthB=0.25", "shrinkA": 0, "shrinkB": 0, "linewidth": 0.8}
    axis.annotate("", (end, height), (start, height), arrowprops=bar)
    middle = ((start + end) / 2.0, height)
    axis.annotate(text, middle, (0, 3), textcoords="offset points", ha="center", va="bottom", fontsize=8)


def _draw_ground(axis: Axes, scene: Scene, left: float, right: float) -> None:
    """Draw ground and walls between two places; texts that would cover their neighbour go one row down."""
    for wall in list_walls(scene, left, right):
        behind = wall.at + (0.02 if wall.stops == "forward" else -0.02) * (right - left)
        axis.fill([wall.at, behind, behind, wall.at], [-0.22, -0.22, 1.4, 1.4], color=WALL, linewidth=0.0, zorder=2.5)
    sections = list_sections(scene, left, right)
    for start, end, color in (band for section in sections for band in section.bands):
        axis.fill([start, end, end, start], [-0.22, -0.22, 0.0, 0.0], color=color, linewidth=0.0, zorder=0.5)
    letter, ends = 0.012 * (right - left), [-np.inf, -np.inf]
    for section in sorted(sections, key=lambda section: section.middle):
        half = 0.5 * letter * len(section.text)
        row = 0 if section.middle - half >= ends[0] else 1
        ends[row] = section.middle + half
        axis.text(section.middle, -0.36 - 0.26 * row, section.text, ha="center", va="center", fontsize=8)
    at, height = trace_profile(scene, left, right)
    if at.size:
        axis.plot(at, -1.3 + 0.45 * height / height.max(), color=GREY, linewidth=1.6)
        axis.plot([left, right], [-1.3, -1.3], color=GREY, linewidth=0.5)
    axis.set_ylim(-1.36 if at.size else -0.76 if sections else -0.22)


def _draw_foot(axis: Axes, place: float, reach: float) -> None:
    """Draw a leg and the wedge on which it stands."""
    axis.plot([place, place], [0.0, 1.0], color=_BODY, linewidth=1.6, zorder=3)
    axis.plot(place, 1.0, "o", color=_BODY, markersize=4, zorder=3)
    toe = 0.03 * reach
    axis.fill([place, place, place + toe, place], [0.0, 0.16, 0.16, 0.0], color=_BODY, zorder=3)


def _draw_spring(axis: Axes, start: float, end: float, reach: float, turns: int = 9) -> None:
    """Draw a coil between two places."""
    straight = min(0.03 * reach, abs(end - start) / 4.0) * np.sign(end - start)
    part = np.linspace(0.0, 1.0, 24 * turns + 1)
    along = start + straight + (end - start - 2.0 * straight) * part
    wound = 1.0 + 0.17 * np.sin(2.0 * np.pi * turns * part)
    axis.plot([start, *along, end], [1.0, *wound, 1.0], color=_BODY, linewidth=1.1, zorder=2)


def _draw_actuator(axis: Axes, start: float, end: float) -> None:
    """Draw a cylinder over the first half of an actuator and its rod over the whole."""
    middle = start + 0.55 * (end - start)
    axis.plot([start, end], [1.0, 1.0], color=ACTUATION, linewidth=1.6, zorder=2)
    axis.fill(
        [start, middle, middle, start], [0.86, 0.86, 1.14, 1.14], facecolor="white", edgecolor=ACTUATION, zorder=2
    )
    axis.plot([middle, end], [1.0, 1.0], color=ACTUATION, linewidth=1.6, zorder=2)
