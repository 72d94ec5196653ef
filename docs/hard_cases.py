"""Run the hard cases and write the results as a table: docs/hard-cases.md."""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from tests.instrument.model.hard_cases import CASES  # noqa: E402

TABLE = ROOT / "docs" / "hard-cases.md"

HEAD = """# Hard cases

Other simulators of dry friction fail in these cases. Each case is run on every body and with every method to which it
applies; the result must be exact within rounding, or the difficulty must be reported.
`tests/instrument/model/test_hard_cases.py` enforces this. `python docs/hard_cases.py` generates this page.

The chain has springs between neighbours. Unless the case names another graph, the graph has each spring of the chain
twice, with half the stiffness. The plane is the same body on a line in the plane, with friction given by directions.
`unique: False` means that friction leaves the translation undetermined and that this is reported; the comparison then
covers the shape and, where the case names it, the rule for the translation. Errors are in m on bodies of about 1 m and
1 N, or relative where marked. "By the certificate" marks an error that is divided by the error that the certificate
admits. For a graph, the error is its distance from the chain, because over twelve decades of stiffness a graph sums
displacements whose rounding affects its stiffest spring. For a chain, the error is its distance from rational
arithmetic, and it is divided by the certificate's `rounding` or 1e-11, whichever is larger. In the plane a scene has a
tolerance; "in tolerances" marks an error of each ramp divided by it, which must be at most 1; "in accuracies" does the
same for a segment and its accuracy.

The times cover a whole case, including the construction of the scene, on {machine}, with the kernels
compiled. They were measured once; no test depends on them.

| case | run on | verdict | worst error | against | time |
| --- | --- | --- | --- | --- | --- |
"""


def machine() -> str:
    """Return the machine on which the times were measured."""
    return f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"


def duration(seconds: float) -> str:
    """Return a time with a unit, to two digits."""
    return f"{seconds:.2g} s" if seconds >= 1.0 else f"{1e3 * seconds:.2g} ms"


def rows() -> list[str]:
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
        table.append(f"| {case.name} | {played_on(case.variants)} | {verdict} | {error} | {case.against} | {took} |")
    return table


def played_on(variants: Iterable[tuple[str, str]]) -> str:
    """List the bodies, each with the methods that it was run by."""
    methods: dict[str, list[str]] = {}
    for body, method in variants:
        methods.setdefault(body, []).append(method)
    return "; ".join(f"{body}: {', '.join(names)}" for body, names in methods.items())


if __name__ == "__main__":
    TABLE.write_text(HEAD.format(machine=machine()) + "\n".join(rows()) + "\n", encoding="utf-8")
    print(f"written: {TABLE.relative_to(ROOT)}")
