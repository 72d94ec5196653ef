"""The settings of matplotlib for all pictures: its own, whatever a user's matplotlibrc has changed; and for a paper."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .colors import BACK, CONTACTS, FORWARD, LINES, rgb

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OF_THE_SESSION = ("backend", "interactive", "toolbar", "figure.max_open_warning", "webagg", "tk.", "keymap.")
"""Beginnings of settings of windows, which change no picture and stay as the user chose."""
INCH = 25.4
"""[mm]"""
COLUMN = 85.0
"""Width of a picture for a paper, if no other is asked for [mm]."""
LETTERS = 8.0
"""Size of all letters of a picture for a paper [points]."""
_NARROW = 9.0
"""Less does not hold two panels side by side [inch]."""
_SHORT = 20
"""Letters of the title of a panel, as of its time, that stay in a paper."""
_PAPER_DPI, _THIN = 600.0, 0.75
"""Pixels per inch in a paper, and how much thinner its lines are."""
_PAPER: dict[Any, Any] = {
    "font.family": "serif",
    "mathtext.fontset": "dejavuserif",
    "font.size": LETTERS,
    "axes.titlesize": LETTERS,
    "axes.linewidth": 0.6,
    "legend.handlelength": 2.4,
}
PRINTED = {FORWARD: "#00684a", BACK: "#ee7430", "#a0a0a0": "#c8c8c8"}
"""Colours of slips and of contacts that stick, which differ less in grey, and those of a paper."""
_FURTHER: tuple[Any, ...] = ((0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 3)))
_DASHES = {**dict(zip(LINES, ("-", "--", "-.", ":", *_FURTHER), strict=False)), CONTACTS[1]: "-."}
"""How lines of each colour are dashed in a paper."""


@dataclass(frozen=True)
class Page:
    """How pictures are set.

    Attributes:
        width: width of the picture [mm]; None for that of a screen, or of a column of a paper.
        dpi: pixels per inch; None for as many as suit the picture.
        paper: whether it is for a paper: serif letters of 8 points, no heading, no difference that is only one of hue.
    """

    width: float | None = None
    dpi: float | None = None
    paper: bool = False

    @property
    def inches(self) -> float | None:
        """The width of the picture [inch]; None for that of a screen."""
        width = COLUMN if self.width is None and self.paper else self.width
        return None if width is None else width / INCH

    @property
    def narrow(self) -> bool:
        """Whether two panels have no room side by side."""
        return self.inches is not None and self.inches < _NARROW


_SCREEN = Page()
_page: ContextVar[Page] = ContextVar("page", default=_SCREEN)


def page() -> Page:
    """Return the page on which pictures are set in this context."""
    return _page.get()


@contextmanager
def on_page(chosen: Page) -> Iterator[None]:
    """Set all pictures that are drawn in this context on a page.

    Args:
        chosen: the page.

    Yields:
        None.
    """
    token = _page.set(chosen)
    try:
        yield
    finally:
        _page.reset(token)


@contextmanager
def own_style(settings: dict[Any, Any] | None = None) -> Iterator[None]:
    """Set matplotlib's defaults while a picture is built, drawn and written; as a decorator, while a function runs.

    Args:
        settings: what differs from them.

    Yields:
        None.
    """
    import matplotlib

    defaults = {k: v for k, v in matplotlib.rcParamsDefault.items() if not k.startswith(_OF_THE_SESSION)}
    defaults |= {"pdf.fonttype": 42, "svg.hashsalt": ""}  # fonts that editors can use; equal pictures have equal bytes
    with matplotlib.rc_context({**defaults, **(settings or {}), **(_PAPER if page().paper else {})}):
        yield


def rim_of(k: int, count: int) -> float:
    """Compute by how much wider one of several lines is drawn than the last, so that each is seen where they are equal.

    Args:
        k: number of the line, from 0.
        count: number of lines.

    Returns:
        The additional width [pt].
    """
    return 1.5 * min(count - 1 - k, 3)


def open_figure(width: float, height: float, stacked: bool = False) -> Figure:
    """Open a figure as wide as the page.

    Args:
        width: its width on a screen [inch].
        height: its height there [inch].
        stacked: whether panels stand one below the other, which on a narrower page do not become as much lower.

    Returns:
        The figure.
    """
    from matplotlib.figure import Figure

    wide = page().inches or width
    power = 1.0 if not stacked else 0.4 if page().paper else 0.0
    return Figure(figsize=(wide, height * (wide / width) ** power), layout="constrained")


def write_figure(figure: Figure, file: Path, dpi: float) -> None:
    """Write a figure without the time at which it was written, so that equal figures have equal bytes.

    Args:
        figure: the figure.
        file: a file whose name ends in .png, .pdf or .svg; the last two hold lines and embedded fonts.
        dpi: pixels per inch of a .png, and of the parts of others that are pixels, where the page has no other.
    """
    untimed = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}
    if page().paper:
        _print(figure)
        dpi = _PAPER_DPI
    figure.savefig(file, dpi=page().dpi or dpi, metadata=untimed.get(file.suffix))


def draw_levels(axes: Axes, x: np.ndarray, y: np.ndarray, values: np.ndarray) -> None:
    """Draw on a map of both signs, in a paper, lines of equal values, which are dashed below 0.

    Args:
        axes: the axes of the map.
        x: increasing, shape (K,).
        y: increasing, shape (L,).
        values: NaN where there is none, shape (L, K).
    """
    signed = values.size > 0 and np.nanmin(values) < 0.0 < np.nanmax(values)
    if not page().paper or not signed or min(values.shape) < 2:
        return
    from matplotlib.ticker import MaxNLocator

    levels: Any = MaxNLocator(7).tick_values(np.nanmin(values), np.nanmax(values))
    axes.contour(x, y, values, levels=levels[levels != 0.0], colors="black", linewidths=0.6)


def _print(figure: Figure) -> None:
    """Make all letters equally large, remove the heading, dash lines and change colours so that greys differ."""
    from matplotlib.colors import to_hex
    from matplotlib.image import AxesImage
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.text import Text

    for part in (figure, *(figure.subfigs if len(figure.subfigs) == 1 else ())):
        if part.get_suptitle():
            part.suptitle("")
    for axes in figure.axes:
        for side in ("left", "center", "right"):
            if len(axes.get_title(side)) > _SHORT:  # a sentence, which is for the caption
                axes.set_title("", loc=side)
    for artist in figure.findobj():
        if isinstance(artist, Text):
            artist.set_fontsize(LETTERS)
            artist.set_color(PRINTED.get(to_hex(artist.get_color()), artist.get_color()))
            if (arrow := getattr(artist, "arrow_patch", None)) is not None:
                _print_patch(arrow)
        elif isinstance(artist, Line2D):
            color = to_hex(artist.get_color())
            if artist.get_linestyle() == "-":
                artist.set_linestyle(_DASHES.get(color, "-"))
            artist.set(color=PRINTED.get(color, color), linewidth=_THIN * artist.get_linewidth())
            artist.set_markersize(_THIN * artist.get_markersize())
        elif isinstance(artist, Patch):
            _print_patch(artist)
        elif isinstance(artist, AxesImage) and (pixels := np.array(artist.get_array())).ndim == 3:
            artist.set_data(_printed(pixels))


def _print_patch(patch: Any) -> None:
    patch.set_facecolor(_printed(np.array(patch.get_facecolor())))
    patch.set_edgecolor(_printed(np.array(patch.get_edgecolor())))


def _printed(colors: np.ndarray) -> np.ndarray:
    """Replace colours, shape (..., 3 or 4), 0 .. 255 or 0 .. 1."""
    unit = 1.0 if colors.dtype.kind == "f" else 255.0
    for old, new in PRINTED.items():
        same = np.abs(colors[..., :3] * (255.0 / unit) - rgb(old)).max(axis=-1) < 0.5
        colors[same, :3] = np.array(rgb(new)) * (unit / 255.0)
    return colors
