"""The tables for people: every row, then the project's targets as ratios within this run."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from .bench import Bench
from .node.node import Row


def write_time(us: float | None) -> str:
    """Write a time in a unit that suits it.

    Args:
        us: [us].

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

    Args:
        error: relative.

    Returns:
        Two digits, with the word "exact" where it is rounding.
    """
    if error is None:
        return "-"
    return f"{error:.0e} exact" if error <= EXACT else f"{error:.1e}"


EXACT = 1e-13
"""Relative errors up to here are rounding."""


def print_report(bench: Bench, screen: Console) -> None:
    """Print a table for each case, what is left out, and the ratios.

    Args:
        bench: what was measured.
        screen: where to.
    """
    for name, title in bench.titles.items():
        rows = [row for row in bench.rows if row["case"] == name]
        table = Table(title=f"{name}: {title}", title_justify="left")
        table.add_column("method")
        for column in ("ticks a period", "a tick", "least .. most", "a period", "error"):
            table.add_column(column, justify="right")
        table.add_column("")
        for row in rows:
            low, high = row["spread_us_per_tick"] or (None, None)
            spread = f"{write_time(low)} .. {write_time(high)}" if low is not None else ""
            ticks = f"{row['ticks_per_period']:g}" if row["ticks_per_period"] else "-"
            failed = "" if row["solved"] else _trouble(row)
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
        table = Table(title="side by side in this run", title_justify="left")
        table.add_column("what")
        table.add_column("measured", justify="right")
        table.add_column("aim", justify="right")
        for ratio in ratios:
            table.add_row(ratio["what"], f"{ratio['value']:.3g}", ratio["aim"])
        screen.print(table)


def _trouble(row: dict[str, Any]) -> str:
    if row["error"] is None:
        return str(row["detail"].split(";")[0])
    return f"{100 * row['failed']:.2g} % of the ticks not solved"


def compute_ratios(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Compute the project's targets from rows of one run.

    Args:
        rows: of any cases; what they lack is left out.

    Returns:
        What, the value, and the aim in words.
    """

    def get(case: str, method: str, ticks: int, key: str = "us_per_tick") -> float | None:
        for row in rows:
            if (row["case"], row["method"], row["ticks_per_period"]) == (case, method, ticks):
                value = row[key]
                return None if value is None else float(value)
        return None

    found: list[dict[str, Any]] = []

    def ratio(what: str, above: float | None, below: float | None, aim: str) -> None:
        if above is not None and below:
            found.append({"what": what, "value": above / below, "aim": aim})

    waves = [("long_wave_100", ">= 50"), ("long_wave_1000", ">= 400"), ("wave_100", ">= 50"), ("wave_1000", "")]
    for case, aim in [*waves, ("wave_10000", ""), ("wave_100000", "")]:
        osqp, ours = get(case, "OSQP 1e-9", 64), get(case, "catch_up", 64)
        ratio(f"time of OSQP 1e-9 / time of catch_up, {case}", osqp, ours, aim)
        single = get(case, "catch_up, one call a tick", 64)
        ratio(f"the same, ours called from Python for each tick too, {case}", osqp, single, "")
        ratio(f"time of OSQP polished / time of catch_up, {case}", get(case, "OSQP polished", 64), ours, "")
        ratio(f"time of DAQP / time of catch_up, {case}", get(case, "DAQP", 64), ours, "")
    for case in ("strategy_a", "peristaltic", "wave_1000", "long_wave_1000", "wave_100000"):
        exact = get(case, "exact", 64)
        ratio(f"time of exact / time of catch_up, {case}", exact, get(case, "catch_up", 64), "<= 5")
    for n in (10_000, 100_000):
        per_contact = (get(f"wave_{m}", "catch_up", 64) for m in (n, 1_000))
        big, small = ((t / m if t else None) for t, m in zip(per_contact, (n, 1_000), strict=True))
        ratio(f"time of catch_up per contact, N = {n} / N = 1000", big, small, "about 1")
    ratio("time of exact / time of OSQP 1e-9, graph", get("graph", "exact", 64), get("graph", "OSQP 1e-9", 64), "<= 1")
    best = min(
        (row for row in rows if row["method"].startswith("MuJoCo") and row["error"] and row["us_per_period"]),
        key=lambda row: row["error"],
        default=None,
    )
    if best is not None and get("strategy_a", "exact", 4, "error") is not None:
        four = get("strategy_a", "exact", 4, "us_per_period")
        error = get("strategy_a", "exact", 4, "error")
        what = f"MuJoCo's best on strategy_a (error {best['error']:.1e}) / exact at 4 ticks (error {error:.0e})"
        ratio(f"time of a period: {what}", best["us_per_period"], four, "> 1")
    return found


def print_rows(rows: Sequence[Row], screen: Console) -> None:
    """Print a table for each kind of row.

    Args:
        rows: from `measure_node`.
        screen: where to.
    """
    for case, group in itertools.groupby(rows, key=lambda row: str(row["case"])):
        held = list(group)
        keys = [key for key in held[0] if key != "case" and not key.endswith("_spread")]
        table = Table(title=case.replace("_", " "), title_justify="left")
        for key in keys:
            table.add_column(key.replace("_", " "), justify="left" if isinstance(held[0][key], str) else "right")
        for row in held:
            table.add_row(*(_cell(row[key], row.get(f"{key}_spread")) for key in keys))
        screen.print(table)


def _cell(value: Any, spread: float | None) -> str:
    if isinstance(value, bool):
        return "yes" if value else ""
    if not isinstance(value, float):
        return str(value)
    digits = 0 if abs(value) >= 1000 else 1 if abs(value) >= 10 else 3
    return f"{value:.{digits}f}" + (f" ± {spread / 2:.{digits}f}" if spread else "")
