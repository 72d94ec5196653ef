"""How the time of a ramp grows with the number of contacts, on the drives that are hardest for the solver."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene

from .growth_drives import DRIVES, GrowthDrive

SECONDS, QUICK = 60.0, 2.5
"""Time of a drive, after which no larger body is begun."""
_RAMPS, _FIRST = 16, 2
"""Ramps that are followed, and the first of them that counts: the first ones start from rest."""
_PART = 0.15
"""Part of the time of a drive after which no further ramp of one body is begun."""


def measure_growth(
    seconds: float, progress: Callable[[float], None], drives: Mapping[str, GrowthDrive] = DRIVES
) -> list[dict[str, Any]]:
    """Measure ramps of `exact` and `catch_up` on bodies of growing size.

    A body is left out if the drive's time is not expected to suffice, and after one on which the budget of a ramp was
    spent; a row names the reason.

    Returns:
        For each drive, method and number of contacts N: median processor time of a ramp [ms], median number of its
        linear pieces, ramps whose budget was spent, time relative to `catch_up` at this N, and the exponent of the
        growth of the time, fitted over all N up to this one; None where there is none. Then a row for each drive and
        method with the exponent over all N.
    """
    rows: list[dict[str, Any]] = []
    for done, (name, drive) in enumerate(drives.items(), 1):
        rows += _measure_drive(name, drive, seconds)
        progress(done / len(drives))
    return rows + _summarise(rows)


def _measure_drive(name: str, drive: GrowthDrive, seconds: float) -> list[dict[str, Any]]:
    """Measure one drive on bodies of growing size, by each method until it is stopped."""
    rows: list[dict[str, Any]] = []
    for n in drive.sizes[:3]:  # loads the kernels; the smallest bodies may use others
        scene, targets = drive.build(n)
        for method in drive.methods:
            Crawler(scene, method).follow(targets[:1])
    began = time.perf_counter()
    going = {method: _Growth() for method in drive.methods}
    building = _Growth()
    for n in drive.sizes:
        built: tuple[Scene, np.ndarray] | None = None
        first: float | None = None
        for method, growth in list(going.items()):
            row = dict.fromkeys(("ms", "pieces", "overspent", "to_catch_up", "exponent"))
            rows.append({"case": name, "method": method, "n": n, **row, "note": ""})
            spent = time.perf_counter() - began
            expected = (0.0 if built else building.expect(n)) + (_FIRST + 1) * growth.expect(n)
            if spent + expected > seconds:
                rows[-1]["note"] = f"left out after {spent:.0f} s, because it was expected to take {expected:.0f} s"
                del going[method]
                continue
            if built is None:
                begin = time.perf_counter()
                built = drive.build(n)
                building.add_body(n, time.perf_counter() - begin)
            found = _follow(Crawler(built[0], method), built[1], _PART * seconds)
            first = found["ms"] if method == "catch_up" else first
            rows[-1] |= found | {"to_catch_up": found["ms"] / first if first else None}
            if found["overspent"]:
                spent = time.perf_counter() - began
                rows[-1]["note"] = f"no larger body follows: the budget of a ramp was spent after {spent:.0f} s"
                del going[method]
                continue
            growth.add_body(n, 1e-3 * found["ms"])
            rows[-1]["exponent"] = growth.exponent
    return rows


class _Growth:
    """Times of bodies of growing size."""

    def __init__(self) -> None:
        self._sizes: list[int] = []
        self._times: list[float] = []

    def add_body(self, n: int, seconds: float) -> None:
        """Add the time of a body of n contacts."""
        self._sizes.append(n)
        self._times.append(seconds)

    @property
    def exponent(self) -> float | None:
        """Exponent of the growth, fitted by least squares to all logarithms; None for fewer than two bodies."""
        return fit_exponent(self._sizes, self._times)

    def expect(self, n: int) -> float:
        """Extrapolate the time to n contacts, with the growth of the last two bodies, linear to cubic [s].

        Times of milliseconds scatter too much for more.
        """
        if not self._times:
            return 0.0
        latest = fit_exponent(self._sizes[-2:], self._times[-2:])
        return self._times[-1] * math.exp(min(max(latest or 0.0, 1.0), 3.0) * math.log(n / self._sizes[-1]))


def fit_exponent(sizes: Iterable[int], times: Iterable[float]) -> float | None:
    """Fit the exponent p of times that grow with the power p of sizes, by least squares of the logarithms.

    Returns:
        The exponent; None for fewer than two bodies.
    """
    x, y = np.log(list(sizes)), np.log(list(times))
    return float(np.polyfit(x, y, 1)[0]) if x.size > 1 else None


def _follow(crawler: Crawler, targets: np.ndarray, longest: float) -> dict[str, Any]:
    """Follow ramps in turn, as many as fit into the time; return the medians."""
    times, pieces, overspent = [], [], 0
    began = time.perf_counter()
    for k in range(_RAMPS):
        start = time.thread_time()
        step = crawler.follow(targets[k % len(targets)][None])
        times.append(time.thread_time() - start)
        pieces.append(step.events)
        overspent += step.overspent
        if k >= _FIRST and time.perf_counter() - began > longest:
            break
    counted = statistics.median(times[_FIRST:]), statistics.median(pieces[_FIRST:])
    return {"ms": 1e3 * counted[0], "pieces": counted[1], "overspent": overspent}


def _summarise(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Collect the exponent of each drive and method, and where and why it was stopped."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for row in rows:
        empty = {"case": "growth exponents", "drive": row["case"], "method": row["method"]}
        last = found.setdefault((row["case"], row["method"]), empty | {"from": row["n"], "to": None, "exponent": None})
        if row["exponent"] is not None:
            last |= {"to": row["n"], "exponent": row["exponent"]}
        last |= {"to_catch_up": row["to_catch_up"] or last.get("to_catch_up")}
        last["note"] = row["note"] and f"N = {row['n']}: {row['note']}"
    return list(found.values())
