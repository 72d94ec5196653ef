"""An identification as a page."""

from __future__ import annotations

import base64
from html import escape
from pathlib import Path

from crawler_model import Identification
from crawler_model.identify.fit.misfit import FITS

from .report import (
    Listing,
    describe_misfit,
    list_explanations,
    list_misfits,
    list_parameters,
    list_score,
    list_sensors,
)

_STYLE = """:root { color-scheme: light dark; --text: #1f2a30; --ground: #fff; --line: #cfd8dc; --bad: #b02a0c }
@media (prefers-color-scheme: dark) {
  :root { --text: #dfe5e8; --ground: #14191c; --line: #3a454b; --bad: #ff9b7d }
}
body { font: 15px/1.5 sans-serif; max-width: 75rem; margin: 1.5rem auto; padding: 0 1rem;
  color: var(--text); background: var(--ground) }
h1 { font-size: 1.4rem; overflow-wrap: anywhere } h2 { font-size: 1.1rem; margin: 1.6rem 0 .4rem }
p { margin: .3rem 0; overflow-wrap: anywhere } .bad { color: var(--bad); font-weight: bold }
.scroll { overflow-x: auto }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
th, td { text-align: left; vertical-align: top; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid var(--line);
  white-space: nowrap }
td.words { white-space: normal; min-width: 16rem }
img { display: block; width: 100%; min-width: 45rem; background: #fff }"""
_PHASES = (
    "Residuals without outliers; the worst phase as a part of the period of the commands, or of the recording if they "
    f"do not repeat. Residuals of at most {FITS} times the noise are called noise."
)


def write_page(found: Identification, picture: Path, path: Path) -> None:
    """Write a page that loads nothing from elsewhere.

    Args:
        found: the identification.
        picture: its .png file.
        path: the .html file.
    """
    count = len(found.recordings)
    title = f"{found.scene.name}: identification from {count} recording{'s' if count > 1 else ''}"
    lines = "".join(
        f"<p{' class=bad' if line.startswith('the model does not fit') else ''}>{escape(line)}</p>\n"
        for line in [*describe_misfit(found), *found.warnings]
    )
    misfits = list_misfits(found.misfits)
    parts = (
        _write_table(list_parameters(found.parameters, "Parameters")),
        f"<h2>Fit</h2>\n{lines}",
        _write_table(list_explanations(found.explanations)),
        _write_table(list_score(found.score)),
        _write_table(list_sensors(found.sensors, "The measurement")),
        _write_table(misfits) + (f"<p>{_PHASES}</p>\n" if misfits.rows else ""),
    )
    image = base64.b64encode(picture.read_bytes()).decode()
    path.write_text(
        f"<!doctype html>\n<html lang=en><head><meta charset=utf-8>\n"
        f"<meta name=viewport content='width=device-width, initial-scale=1'>\n"
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style></head>\n<body><h1>{escape(title)}</h1>\n"
        f"{''.join(parts)}<h2>Measured, simulated, and the difference</h2>\n"
        f"<div class=scroll><img alt='measured and simulated positions, and residuals over time and phase' "
        f"src='data:image/png;base64,{image}'></div></body></html>\n",
        encoding="utf-8",
    )


def _write_table(listing: Listing) -> str:
    """Write a table with its title; nothing if it has no rows."""
    if not listing.rows:
        return ""
    head = "".join(f"<th scope=col>{escape(name)}</th>" for name in listing.heads)
    rows = "".join(
        "<tr>"
        + "".join(
            f"<td{' class=words' if words else ''}>{escape(cell)}</td>"
            for cell, words in zip(row, listing.words, strict=True)
        )
        + "</tr>\n"
        for row in listing.rows
    )
    return f"<h2>{escape(listing.title)}</h2>\n<div class=scroll><table><tr>{head}</tr>\n{rows}</table></div>\n"
