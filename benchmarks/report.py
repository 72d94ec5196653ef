"""Printed tables: every row, then the project's targets as ratios within the run."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Column, Table

from .node.rows import Row
from .ratios import compute_ratios
from .result import BenchResult


def write_time(us: float | None) -> str:
    """Write a time in a suitable unit.

    Returns:
        Three digits and the unit; a dash for None.
    """
    if us is None:
        return "-"
    for size, unit in ((1.0, "us"), (1e3, "ms"), (1e6, "s")):
        if us < 999.5 * size or unit == "s":
            return f"{us / size:.3g} {unit}"
    return "-"


def write_error(error: float | None) -> str:
    """Write an error; below rounding it is called exact.

    Returns:
        Two digits, with the word "exact" when it is rounding.
    """
    if error is None:
        return "-"
    return f"{error:.0e} exact" if error <= EXACT else f"{error:.1e}"


EXACT = 1e-13
"""Relative errors up to here are rounding."""


def print_report(bench: BenchResult, screen: Console) -> None:
    """Print a table for each case, the methods left out, and the ratios."""
    for name, title in bench.titles.items():
        rows = [row for row in bench.rows if row["case"] == name]
        names = ("ticks per period", "time per tick", "range", "time per period", "error")
        numbers = (Column(header, justify="right") for header in names)
        table = Table("method", *numbers, "", title=f"{name}: {title}", title_justify="left")
        for row in rows:
            low, high = row["spread_us_per_tick"] or (None, None)
            spread = f"{write_time(low)} .. {write_time(high)}" if low is not None else ""
            ticks = f"{row['ticks_per_period']:g}" if row["ticks_per_period"] else "-"
            failed = "" if row["solved"] else _problem(row)
            times = write_time(row["us_per_tick"]), spread, write_time(row["us_per_period"])
            table.add_row(row["method"], ticks, *times, write_error(row["error"]), failed)
        screen.print(table)
    reasons: dict[str, dict[str, list[str]]] = {}
    for item in bench.left_out:
        reasons.setdefault(item["reason"], {}).setdefault(item["method"], []).append(item["case"])
    for reason, left in reasons.items():
        cases = ", ".join(dict.fromkeys(case for found in left.values() for case in found))
        screen.print(f"left out: {', '.join(left)} on {cases}: {reason}")
    ratios = compute_ratios(bench.rows)
    if ratios:
        numbers = (Column(header, justify="right") for header in ("measured", "aim"))
        table = Table("what", *numbers, title="ratios within this run", title_justify="left")
        for ratio in ratios:
            table.add_row(ratio["what"], f"{ratio['value']:.3g}", ratio["aim"])
        screen.print(table)


def _problem(row: dict[str, Any]) -> str:
    if row["error"] is None:
        return str(row["detail"].split(";")[0])
    return f"{100 * row['failed']:.2g} % of the ticks not solved"


def print_rows(rows: Sequence[Row], screen: Console) -> None:
    """Print a table for each kind of row."""
    for case, group in itertools.groupby(rows, key=lambda row: str(row["case"])):
        listed = list(group)
        keys = [key for key in listed[0] if key != "case" and not key.endswith("_spread")]
        table = Table(title=case.replace("_", " "), title_justify="left")
        for key in keys:
            table.add_column(key.replace("_", " "), justify="left" if isinstance(listed[0][key], str) else "right")
        for row in listed:
            table.add_row(*(_cell(row[key], row.get(f"{key}_spread")) for key in keys))
        screen.print(table)


def _cell(value: Any, spread: float | None) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else ""
    if isinstance(value, float) and 0.0 < abs(value) < 1e-3 and not spread:
        return f"{value:.1e}"
    if not isinstance(value, float):
        return str(value)
    digits = 0 if abs(value) >= 1000 else 1 if abs(value) >= 10 else 3
    return f"{value:.{digits}f}" + (f" ± {spread / 2:.{digits}f}" if spread else "")
