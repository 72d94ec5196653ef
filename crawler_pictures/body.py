"""Pictures of bodies on a line: feet on the ground, springs between them, actuators where a link is read as one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from crawler_model import CrawlerError
from crawler_model.body.plan import Plan

from .colors import ACTUATION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BODY, _GROUND = "#202020", "#8a8a8a"


def draw_body(
    axis: Axes, scene: Plan, displacement: ArrayLike, actuation: ArrayLike, actuators: Sequence[int] = ()
) -> None:
    """Draw a chain of contacts where it stands; above it there is room for `draw_length`.

    A link has two readings, which give the same tension. As a spring its rest length is the distance of its contacts in
    the reference shape plus L. As an actuator with a spring behind it, the spring keeps half of that distance as its
    rest length, and the actuator has the other half plus L.

    Args:
        axis: where to: along it in m, across it from the ground at 0 to the body at 1, and on to 2.6.
        scene: of isolated contacts on a line, each joined to the next.
        displacement: x, shape (N,) [m].
        actuation: L of each link, shape (N - 1,) [m].
        actuators: links drawn as an actuator with a spring behind it; the others are drawn as springs.

    Raises:
        CrawlerError: for segments, other graphs than chains, and the plane.
    """
    mesh = scene.body
    if mesh.dimension == 2 or mesh.segments or not mesh.is_chain:
        raise CrawlerError(f"{scene.name}: only chains of isolated contacts on a line are drawn")
    place = mesh.position + np.asarray(displacement, dtype=np.float64)
    length = np.diff(mesh.position) / 2.0 + np.asarray(actuation, dtype=np.float64)
    reach = float(np.ptp(mesh.position))
    for i in range(mesh.contacts):
        _draw_foot(axis, float(place[i]), reach)
        axis.annotate(str(i), (float(place[i]), 0.5), (-4, 0), textcoords="offset points", ha="right", va="center")
    for i in range(mesh.springs):
        start, end = float(place[i]), float(place[i + 1])
        if i in actuators:
            _draw_actuator(axis, start, start + float(length[i]))
            start += float(length[i])
        _draw_spring(axis, start, end, reach)
    axis.axhline(0.0, color=_GROUND, linewidth=1.0, zorder=1)
    axis.axhspan(-0.22, 0.0, facecolor="none", edgecolor=_GROUND, hatch="////", linewidth=0.0)
    axis.set(ylim=(-0.22, 2.6), yticks=[])
    axis.spines[["left", "right", "top"]].set_visible(False)


def draw_length(axis: Axes, start: float, end: float, height: float, text: str) -> None:
    """Draw a dimension line with its name above it.

    Args:
        axis: where to.
        start: [m].
        end: [m].
        height: above the ground, in heights of the body.
        text: what it is.
    """
    bar = {"arrowstyle": "|-|, widthA=0.25, widthB=0.25", "shrinkA": 0, "shrinkB": 0, "linewidth": 0.8}
    axis.annotate("", (end, height), (start, height), arrowprops=bar)
    middle = ((start + end) / 2.0, height)
    axis.annotate(text, middle, (0, 3), textcoords="offset points", ha="center", va="bottom", fontsize=8)


def _draw_foot(axis: Axes, place: float, reach: float) -> None:
    """Draw a leg and the wedge that it stands on."""
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
