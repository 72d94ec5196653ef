"""The settings of matplotlib for all pictures: its own, whatever a user's matplotlibrc has changed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

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
    with matplotlib.rc_context({**defaults, **(settings or {})}):
        yield
