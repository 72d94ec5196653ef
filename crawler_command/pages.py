"""The options that every verb with `--png` has: resolution, width and style of its picture."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from enum import Enum
from typing import Annotated, Any

import typer

from crawler_model import CrawlerError
from crawler_pictures.style import Page, on_page


class Style(str, Enum):
    """For what a picture is."""

    screen = "screen"
    paper = "paper"


_OPTIONS = {
    "dpi": Annotated[
        float | None, typer.Option(min=20.0, max=2400.0, help="Of --png: pixels per inch; 600 in the style of a paper.")
    ],
    "width": Annotated[
        float | None, typer.Option(min=60.0, max=1000.0, help="Of --png: its width, mm; 85 in the style of a paper.")
    ],
    "style": Annotated[
        Style,
        typer.Option(help="Of --png; paper: serif letters of 8 points, no heading, and differences that stay in grey."),
    ],
}


def takes_page(verb: Callable[..., None]) -> Callable[..., None]:
    """Give a verb the options that tell how its picture is set.

    Args:
        verb: the verb, which draws with `--png`; a sweep also without.

    Returns:
        The verb with three more options behind `--png`.
    """

    @functools.wraps(verb)
    def with_page(*args: Any, dpi: float | None, width: float | None, style: Style, **given: Any) -> None:
        page = Page(width, dpi, style is Style.paper)
        if page != Page() and given.get("png") is None and "plot" not in given:
            raise CrawlerError("--dpi, --width and --style need --png: they tell how that picture is set")
        with on_page(page):
            verb(*args, **given)

    kept = list(inspect.signature(verb, eval_str=True).parameters.values())
    at = 1 + [p.name for p in kept].index("png")
    defaults = {"dpi": None, "width": None, "style": Style.screen}
    more = [inspect.Parameter(n, kept[0].kind, default=defaults[n], annotation=hint) for n, hint in _OPTIONS.items()]
    with_page.__signature__ = inspect.Signature([*kept[:at], *more, *kept[at:]])  # type: ignore[attr-defined]
    with_page.__annotations__ = verb.__annotations__ | _OPTIONS
    return with_page
