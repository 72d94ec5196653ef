"""An identification as text."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

from rich.console import Console
from rich.table import Table

from crawler_model import Identification
from crawler_model.identify.verdicts import Parameter


def tabulate(parameters: Sequence[Parameter], title: str) -> Table:
    """Build the table of verdicts.

    Args:
        parameters: what is known about each parameter.
        title: above the table.

    Returns:
        A row for each parameter.
    """
    table = Table(title=title, title_justify="left")
    for name in ("parameter", "verdict", "value", "95 % interval", "why"):
        table.add_column(name)
    for p in parameters:
        low, high = (None if end is None else f"{end:.6g}" for end in p.interval)
        interval = "" if low is None and high is None else f"{low or ''} .. {high or ''}"
        value = "" if p.value is None else f"{p.value:.6g}"
        table.add_row(p.name.replace("[", r"\["), p.verdict, value, interval, p.why.replace("[", r"\["))
    return table


def print_identification(found: Identification, console: Console) -> None:
    """Print the verdicts and residuals.

    Args:
        found: the identification.
        console: the console.
    """
    console.print(tabulate(found.parameters, f"{found.scene.name}: {len(found.recordings)} recording(s)"))
    out = "" if found.held_out is None else f", held out {found.held_out:.3g} m"
    console.print(f"residuals: fitted {found.residual:.3g} m{out}; noise of the measurements {found.noise:.3g} m")
    if found.model_fits:
        console.print("the model fits: its residuals are noise")
    else:
        console.print(f"[yellow]the model does not fit:[/] {found.where}".replace("[1", r"\[1"))
    for line in found.warnings:
        console.print(line.replace("[", r"\["))


_STYLE = """body { font: 15px/1.5 sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #1f2a30 }
table { border-collapse: collapse } th, td { text-align: left; padding: .3rem .8rem; border-bottom: 1px solid #cfd8dc }
img { max-width: 100% }"""


def write_page(found: Identification, picture: Path, path: Path) -> None:
    """Write a page that loads nothing from elsewhere.

    Args:
        found: the identification.
        picture: its .png file.
        path: the .html file.
    """
    rows = []
    for p in found.parameters:
        ends = ["" if end is None else f"{end:.6g}" for end in p.interval]
        value = "" if p.value is None else f"{p.value:.6g}"
        cells = (p.name, p.verdict, value, " .. ".join(ends) if any(ends) else "", ", ".join(p.partners), p.why)
        rows.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    heads = ("parameter", "verdict", "value", "95 % interval", "with", "why")
    head = "".join(f"<th>{name}</th>" for name in heads)
    out = "" if found.held_out is None else f", held out {found.held_out:.3g} m"
    fits = "The model fits: its residuals are noise." if found.model_fits else f"The model does not fit: {found.where}"
    notes = "".join(f"<p>{escape(line)}</p>" for line in found.warnings)
    image = base64.b64encode(picture.read_bytes()).decode()
    title = f"{found.scene.name}: identification from {len(found.recordings)} recording(s)"
    path.write_text(
        f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{escape(title)}</title><style>{_STYLE}</style>"
        f"<h1>{escape(title)}</h1><p>{escape(fits)}</p><table><tr>{head}</tr>{''.join(rows)}</table>{notes}"
        f"<p>Residuals: fitted {found.residual:.3g} m{out}; noise of the measurements {found.noise:.3g} m.</p>"
        f"<img alt='measured and simulated positions, and residuals' src='data:image/png;base64,{image}'></html>\n",
        encoding="utf-8",
    )
