"""The settings of matplotlib for all pictures: its own, whatever a user's matplotlibrc has changed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OF_THE_SESSION = ("backend", "interactive", "toolbar", "figure.max_open_warning", "webagg", "tk.", "keymap.")
"""Beginnings of settings of windows, which change no picture and stay as the user chose."""


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
    with matplotlib.rc_context({**defaults, **(settings or {})}):
        yield


def write_figure(figure: Figure, file: Path, dpi: float) -> None:
    """Write a figure without the time at which it was written, so that equal figures have equal bytes.

    Args:
        figure: the figure.
        file: a file whose name ends in .png, .pdf or .svg; the last two hold lines and embedded fonts.
        dpi: pixels per inch of a .png, and of the parts of others that are pixels.
    """
    untimed = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}
    figure.savefig(file, dpi=dpi, metadata=untimed.get(file.suffix))
