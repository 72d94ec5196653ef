"""An identification as text."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from crawler_model import Identification


def print_identification(found: Identification, console: Console) -> None:
    """Print the verdicts and residuals.

    Args:
        found: the identification.
        console: the console.
    """
    table = Table(title=f"{found.scene.name}: {len(found.recordings)} recording(s)", title_justify="left")
    for name in ("parameter", "verdict", "value", "95 % interval", "why"):
        table.add_column(name)
    for p in found.parameters:
        low, high = (None if end is None else f"{end:.6g}" for end in p.interval)
        interval = "" if low is None and high is None else f"{low or ''} .. {high or ''}"
        value = "" if p.value is None else f"{p.value:.6g}"
        table.add_row(p.name.replace("[", r"\["), p.verdict, value, interval, p.why.replace("[", r"\["))
    console.print(table)
    out = "" if found.held_out is None else f", held out {found.held_out:.3g} m"
    console.print(f"residuals: fitted {found.residual:.3g} m{out}; noise of the measurements {found.noise:.3g} m")
    if found.model_fits:
        console.print("the model fits: its residuals are noise")
    else:
        console.print(f"[yellow]the model does not fit:[/] {found.where}".replace("[1", r"\[1"))
    for line in found.warnings:
        console.print(line.replace("[", r"\["))
