"""The ground on which a body on a line crawls in a film."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import Scene

from ..colors import GREY, WALL
from ..ground import list_sections, list_walls, trace_profile

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

DEPTH = 0.75
"""How far the ground is drawn below its surface, in units of the second axis."""
_HIGHEST = 1.2
_SAMPLES = 50


class Track:
    """The track with its patches, walls and slopes, which are in true proportion unless they are too high for it.

    Attributes:
        at: places between which it is straight, both ends included, shape (P,) [m].
        heights: its heights there, shape (P,), in units of the second axis.
        low: height of the lowest visible place in each frame, shape (F,), in units of the second axis.
        rise: by how much the visible track rises at most.
        unit: how many metres on the screen are as long as a unit of the second axis.
    """

    def __init__(self, scene: Scene, left: np.ndarray, right: np.ndarray, top: float, ratio: float) -> None:
        """Measure the heights.

        Args:
            scene: the scene.
            left: left end of the visible track in each frame, shape (F,) [m].
            right: its right end.
            top: height that the body takes above the ground, in units of the second axis.
            ratio: width of the panel over its height.
        """
        self._scene = scene
        self._ends = float(left.min()), float(right.max())
        self._width = float(right[0] - left[0])
        self.at, heights = trace_profile(scene, *self._ends)
        if not self.at.size:
            self.at, heights = np.array(self._ends), np.zeros(2)
        seen = np.interp(np.linspace(left, right, _SAMPLES), self.at, heights)
        highest = float(np.ptp(seen, axis=0).max())
        # a unit becomes shorter as more of the panel is needed for the slopes
        part = ratio / self._width * highest
        self.rise = min(part / (1.0 - part) * (top + DEPTH), _HIGHEST) if part < 1.0 else _HIGHEST
        scale = self.rise / highest if highest > 0.0 else 0.0
        self.heights, self.low = scale * heights, scale * seen.min(axis=0)
        self.unit = self._width / ratio / (top + self.rise + DEPTH)

    def height(self, x: np.ndarray) -> np.ndarray:
        """Compute the height of the ground.

        Args:
            x: places on the track, shape (K,) [m].

        Returns:
            Shape (K,), in units of the second axis.
        """
        return np.interp(x, self.at, self.heights)

    def draw(self, axes: Axes) -> list[Artist]:
        """Draw the ground, its patches and walls.

        Args:
            axes: axes of the panel.

        Returns:
            All of it.
        """
        style: Any = {"ha": "center", "va": "center", "fontsize": 9, "clip_on": True}
        drawn: list[Artist] = [*axes.plot(self.at, self.heights, color=GREY, linewidth=1.2, zorder=1)]
        for wall in list_walls(self._scene, *self._ends):
            behind = wall.at + (1.0 if wall.stops == "forward" else -1.0) * 0.012 * self._width
            drawn.append(self._fill(axes, wall.at, behind, 1.0, WALL))
        for section in list_sections(self._scene, *self._ends):
            drawn += [self._fill(axes, start, end, 0.0, color) for start, end, color in section.bands]
            below = float(self.height(np.array([section.middle]))[0]) - 0.5
            drawn.append(axes.text(section.middle, below, section.text, **style))
        return drawn

    def _fill(self, axes: Axes, start: float, end: float, above: float, color: str) -> Artist:
        """Fill a stretch of the track from below to a height above the ground."""
        first, last = min(start, end), max(start, end)
        x = np.concatenate(([first], self.at[(self.at > first) & (self.at < last)], [last]))
        y = self.height(x)
        return axes.fill_between(x, y.min() - DEPTH - _HIGHEST, y + above, color=color, linewidth=0.0, zorder=0.5)
