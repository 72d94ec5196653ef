"""The targets of the project as ratios of times from one run."""

from __future__ import annotations

from typing import Any


def compute_ratios(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Compute the project's targets from rows of one run.

    Returns:
        Description, value and target of each ratio.
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
