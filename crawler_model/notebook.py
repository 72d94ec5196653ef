"""Results as small HTML tables, which notebooks show."""

from __future__ import annotations

import html
from collections.abc import Iterable
from typing import Any

import numpy as np

_LONGEST = 120
"""Characters of a value that are shown."""
_MOST_NUMBERS = 8
"""Longer arrays are abbreviated."""


def write_numbers(values: Any) -> str:
    """Write a number or an array in one line; long arrays are abbreviated.

    Args:
        values: any shape.

    Returns:
        The text, for example "[1. 2. ... 8. 9.]".
    """
    array = np.asarray(values)
    if array.ndim == 0:
        return f"{array.item():.6g}"
    with np.printoptions(threshold=_MOST_NUMBERS, edgeitems=2, precision=6):
        return " ".join(str(array).split())


def write_html(title: str, facts: Iterable[tuple[str, Any]]) -> str:
    """Write a table with a row for each fact, all text escaped.

    Args:
        title: caption of the table.
        facts: names and values; numbers are rounded to six digits, arrays and long text are abbreviated.

    Returns:
        HTML.
    """
    rows = "".join(
        f'<tr><th style="text-align: left">{html.escape(name)}</th>'
        f'<td style="text-align: left">{html.escape(_write(value))}</td></tr>'
        for name, value in facts
    )
    return f'<table><caption style="text-align: left">{html.escape(title)}</caption>{rows}</table>'


def _write(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = write_numbers(value) if isinstance(value, np.ndarray) else " ".join(str(value).split())
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} ..."
