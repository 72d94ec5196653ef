"""The frames of a film: figure and artists are made once, after that only what moves is drawn again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np

from ..numbers import shorten
from ..run.kymograph import MOST_LINES, MOST_NAMED, draw_positions, draw_states
from ..style import own_style
from .film import Film
from .moving_set import moving_set
from .panels import LinePanel, Rolling, SetPanel
from .pixels import Clock, RollingAxis
from .plane_panel import PlanePanel

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_WIDTH, _TALK_WIDTH = 12.8, 32.0 / 3.0
"""Width of the figure; the letters of a narrower one are larger [inches]."""
TALK_SIZE = (1920, 1080)
"""Size of the frames of a film for a talk, whose smallest letters are 20 pixels high [pixels]."""
_STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.titlesize": 10,
    "mathtext.fontset": "dejavusans",
    "axes.unicode_minus": True,
}
_MOST_ROWS = 48


class Panel(Protocol):
    """Axes whose content moves from frame to frame; `rolling` holds the axes that move along, and their limits."""

    moving: list[Artist]
    rolling: Rolling | None

    def move(self, k: int) -> None:
        """Move everything to frame `k`."""


class Stage:
    """Draws the frames of a film, each in a few milliseconds.

    Callers draw frames in `own_style`, which takes as long as a frame.
    """

    def __init__(self, film: Film, width: int = 1280, height: int = 720, talk: bool = False) -> None:
        """Draw all that does not move.

        Args:
            film: the run, sampled at the frames.
            width: width of the frames [pixels].
            height: height of the frames [pixels].
            talk: whether to draw the body and its moving set alone, with larger letters.
        """
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._film = film
        with own_style(_STYLE):
            inches = _TALK_WIDTH if talk else _WIDTH
            self._figure = Figure(figsize=(inches, inches * height / width), dpi=width / inches)
            self._canvas = cast(Any, FigureCanvasAgg(self._figure))  # typed in part
            self._panels: list[Panel] = []
            timed = self._build(talk)
            self._figure.text(
                0.015, 0.965, shorten(film.scene.name), va="center", fontsize=13, weight="bold", parse_math=False
            )
            for panel in self._panels:
                for artist in panel.moving:
                    artist.set_animated(True)
            self._canvas.draw()
            self._spans = [self._span(axes) for axes in timed]
            self._clock = Clock(self._figure, self._canvas)
            sides = [panel.rolling for panel in self._panels if panel.rolling is not None]
            self._axes = [RollingAxis(self._figure, self._canvas, *side) for side in sides]
            self._background = self._canvas.copy_from_bbox(self._figure.bbox)
        self._ahead = np.asarray(self._canvas.buffer_rgba())[..., :3] // 3 + 170

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the frames [pixels]."""
        return self._canvas.get_width_height()

    def draw(self, k: int) -> np.ndarray:
        """Draw a frame.

        Args:
            k: its number.

        Returns:
            Red, green and blue, uint8, shape (height, width, 3); valid until the next frame is drawn.
        """
        for axis in self._axes:
            axis.prepare(k)
        self._canvas.restore_region(self._background)
        for panel in self._panels:
            panel.move(k)
            for artist in panel.moving:
                self._figure.draw_artist(artist)
        picture = np.asarray(self._canvas.buffer_rgba())[..., :3]
        for axis in self._axes:
            axis.draw(picture, k)
        film = self._film
        part = k / max(film.time.size - 1, 1)
        for rows, left, right in self._spans:
            now = left + round(part * (right - left))
            picture[rows, now:right] = self._ahead[rows, now:right]
            picture[rows, now - 1 : now + 1] = 0
        self._clock.write(picture, f"t = {film.time[k]:.{_digits(film.step)}f} s")
        return picture

    def _span(self, axes: Axes) -> tuple[slice, int, int]:
        """Find the rows, the first and the last column of axes over time [pixels]."""
        box, height = axes.get_window_extent(), self.size[1]
        return slice(height - round(box.y1) + 1, height - round(box.y0) - 1), round(box.x0) + 1, round(box.x1) - 1

    def _build(self, talk: bool) -> list[Axes]:
        """Create the panels; return the axes over time."""
        film, add = self._film, self._figure.add_axes
        swept = None if film.planar else moving_set(film)
        named = max(map(len, film.names)) if len(film.names) <= MOST_NAMED else 0
        over_time: list[tuple[float, float, float, float]]
        if film.planar:
            self._panels.append(PlanePanel(add((0.07, 0.11, 0.91, 0.77) if talk else (0.06, 0.09, 0.52, 0.80)), film))
            over_time = [] if talk else [(0.66, 0.50, 0.32, 0.39), (0.66, 0.09, 0.32, 0.33)]
        else:
            self._panels.append(LinePanel(add((0.03, 0.69, 0.94, 0.20) if talk else (0.03, 0.655, 0.94, 0.25)), film))
            wide = 0.50 if swept is not None else 0.93 - 0.008 * named
            over_time = [(0.06, 0.31, wide, 0.235), (0.06, 0.075, wide, 0.17)]
            if talk:
                over_time = [] if swept is not None else [(0.08, 0.11, 0.90 - 0.012 * named, 0.44)]
        timed = [add(place) for place in over_time]
        if swept is not None:
            self._panels.append(
                SetPanel(add((0.08, 0.11, 0.90, 0.44) if talk else (0.645, 0.09, 0.335, 0.44)), film, swept)
            )
        for axes, draw in zip(timed, (self._draw_states, self._draw_net), strict=False):
            draw(axes)
            axes.set_xlim(film.time[0], film.time[-1])
            axes.tick_params(labelbottom=axes is timed[-1])
        if timed:
            timed[-1].set_xlabel("simulated time [s]", labelpad=1)
        return timed

    def _draw_states(self, axes: Axes) -> None:
        """Draw the kymograph: lines at their positions on the track, or an image of many contacts and in the plane."""
        film, n = self._film.path, len(self._film.names)
        if film.planar or n > min(MOST_LINES, _MOST_ROWS):
            joined = draw_states(axes, film.time, film.state, film.names, film.rest if not film.planar else None)
            title = "contacts over time" + (f"; {joined}" if joined else "")
        else:
            draw_positions(axes, film.time, film.place, film.state, film.names)
            axes.set_ylabel("contacts [m]")
            title = "contacts over time: a line that rises goes forward"
        axes.set_title(title, loc="left", fontsize=9)

    def _draw_net(self, axes: Axes) -> None:
        film = self._film.path
        for values, color, name in zip(
            film.net_translation.reshape(film.time.size, -1).T, ("black", "#888888"), "xy", strict=False
        ):
            axes.plot(film.time, values, color=color, linewidth=1.5, label=f"along {name}")
        axes.set_ylabel("net transl. [m]")
        if film.planar:
            axes.set_title("net translation: black along x, grey along y", loc="left", fontsize=9)
        axes.locator_params(axis="y", nbins=5)
        axes.grid(alpha=0.3)


def _digits(step: float) -> int:
    """Count the decimals that tell frames apart."""
    return int(np.clip(np.ceil(-np.log10(max(step, 1e-6))), 1, 6)) if step > 0.0 else 2
