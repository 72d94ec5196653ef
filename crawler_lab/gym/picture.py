"""Pictures of the environments, drawn with matplotlib."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from crawler_model import CrawlerError, Scene
from crawler_pictures.body import draw_body
from crawler_pictures.style import own_style

from .kernel.layout import ALONG
from .lanes import Lanes
from .spec import Spec

_INCHES, _DPI = (6.4, 2.4), 80


class Picture:
    """A figure that shows one environment at a time."""

    @own_style()
    def __init__(self, spec: Spec, window: bool) -> None:
        """Open the figure.

        Args:
            spec: the settings of the environments.
            window: whether to show it in a window.
        """
        self._spec, self._window = spec, window
        if window:
            from matplotlib import pyplot

            self._figure: Any = pyplot.figure(figsize=_INCHES, dpi=_DPI)
            if pyplot.get_backend().lower() == "agg":
                gymnasium.logger.warn("render: matplotlib has no display here; nothing is shown")
            else:
                pyplot.show(block=False)
        else:
            from matplotlib.backends.backend_agg import FigureCanvasAgg
            from matplotlib.figure import Figure

            self._figure = Figure(figsize=_INCHES, dpi=_DPI)
            FigureCanvasAgg(self._figure)
        self._axis = self._figure.add_axes((0.04, 0.2, 0.92, 0.68))

    @own_style()
    def draw(self, lanes: Lanes, m: int = 0) -> np.ndarray | None:
        """Draw an environment.

        Args:
            lanes: the environments.
            m: which of them.

        Returns:
            The picture, uint8, shape (height, width, 3); None for a window.
        """
        scene, axis = self._spec.scene, self._axis
        axis.clear()
        x = lanes.displacement(m)
        try:
            draw_body(axis, scene, x, lanes.row(m)[: scene.columns.links])
        except CrawlerError:
            _draw_plainly(axis, scene, x)
        place = scene.body.position + x
        middle = float(np.mean(place if place.ndim == 1 else place[:, 0]))
        reach = float(np.ptp(scene.body.position, axis=0).max())
        axis.set_xlim(middle - 1.5 * reach, middle + 1.5 * reach, auto=x.ndim == 2)
        along = float(lanes.results[m, ALONG])
        if self._spec.task.name == "reach" and x.ndim == 1:
            away = float(self._spec.task.place[0]) - along
            axis.axvline(middle + away, color="#2a7f3b", linewidth=1.0, linestyle="--")
        axis.set_title(f"{self._spec.task.name}: step {lanes.steps_done(m)}, {along:.4g} m", fontsize=9)
        self._figure.canvas.draw()
        if self._window:
            self._figure.canvas.flush_events()
            return None
        return np.asarray(self._figure.canvas.buffer_rgba())[:, :, :3].copy()

    def close(self) -> None:
        """Close the window."""
        if self._window:
            from matplotlib import pyplot

            pyplot.close(self._figure)


def _draw_plainly(axis: Any, scene: Scene, x: np.ndarray) -> None:
    """Draw contacts and springs as dots and lines: bodies in the plane, with segments, and other graphs than chains."""
    place = scene.body.position + x
    if place.ndim == 1:
        place = np.column_stack((place, np.zeros(place.size)))
    axis.plot(*place[scene.body.ends].transpose(2, 1, 0), color="#202020", linewidth=1.1)
    axis.plot(*place.T, "o", color="#202020", markersize=3)
    if scene.dimension == 2:
        axis.set_aspect("equal", adjustable="datalim")
    else:
        axis.set(ylim=(-1.0, 1.0), yticks=[])
