"""Run the hard cases and write the results: docs/hard-cases.csv, from which docs/generate.py writes their page."""

from __future__ import annotations

import csv
import os
import platform
import sys
import time
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from tests.instrument.model.hard_cases import CASES  # noqa: E402

TABLE = ROOT / "docs" / "hard-cases.csv"
COLUMNS = ("case", "run on", "verdict", "worst error", "against")


def machine() -> str:
    """Return the machine on which the times were measured."""
    return f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"


def duration(seconds: float) -> str:
    """Return a time with a unit, to two digits."""
    return f"{seconds:.2g} s" if seconds >= 1.0 else f"{1e3 * seconds:.2g} ms"


def rows() -> list[tuple[str, ...]]:
    """Run all cases, a row each; a variant whose kernels must be compiled runs twice."""
    table = []
    warm = set()
    for case in CASES:
        errors, times, verdicts = [], [], set()
        for body, method in case.variants:
            if (body, method) not in warm:
                case.play(body, method)
                warm.add((body, method))
            began = time.perf_counter()
            found = case.play(body, method)
            times.append(time.perf_counter() - began)
            errors.append(found.error)
            good = found.said == case.said and found.error <= case.within
            verdicts.add((", ".join(sorted(found.said)) or case.verdict) if good else f"FAILED on {body}, {method}")
        error = "0" if max(errors) == 0.0 else f"{max(errors):.0e}"
        took = duration(max(times)) if len(times) == 1 else f"{duration(min(times))} .. {duration(max(times))}"
        verdict = "; ".join(sorted(verdicts))
        table.append((case.name, played_on(case.variants), verdict, error, case.against, took))
    return table


def played_on(variants: Iterable[tuple[str, str]]) -> str:
    """List the bodies, each with the methods that it was run by."""
    methods: dict[str, list[str]] = {}
    for body, method in variants:
        methods.setdefault(body, []).append(method)
    return "; ".join(f"{body}: {', '.join(names)}" for body, names in methods.items())


if __name__ == "__main__":
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow((*COLUMNS, f"time on {machine()}"))
        writer.writerows(rows())
    print(f"written: {TABLE.relative_to(ROOT)}")
