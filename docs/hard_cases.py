"""Run the hard cases and write what came out as a table: docs/hard-cases.md."""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from tests.model.hard_cases import CASES  # noqa: E402

TABLE = ROOT / "docs" / "hard-cases.md"

HEAD = """# Hard cases

What breaks other simulators of dry friction, played on every body and by every method for which it makes sense. Each
case must give the exact answer within rounding, or say by name what is the matter; the tests hold it to that
(`tests/model/test_hard_cases.py`). `python docs/hard_cases.py` writes this page anew.

The chain has springs between neighbours, the graph any springs: here each spring of the chain twice, half as stiff,
unless the case names another graph. The plane is the same body on a line in the plane, with friction given by
directions. `unique: False` means that friction leaves the translation open and that this is said; the shape, and the
rule for the translation where the case names it, are then what is compared. Errors are in m on bodies of about 1 m and
1 N, or relative where it says so. Where it says "by the certificate" the error is a ratio, to what the certificate
admits: of a graph's distance from the chain, because over twelve decades of stiffness a graph adds up displacements
whose rounding its stiffest spring feels; and of a chain's distance from rational arithmetic, to the certificate's
`rounding` or 1e-11, whichever is larger. In the plane a scene asks for a tolerance; where it says "in tolerances" the
error of each ramp is divided by it, and must be at most 1; "in accuracies" likewise for a segment and the accuracy
that it asks for.

Times are those of a whole case, scene and all, on {machine}, with the kernels compiled. They are what was
measured last; no test depends on them.

| case | played on | verdict | worst error | against | time |
| --- | --- | --- | --- | --- | --- |
"""


def machine() -> str:
    """Return what the times were measured on."""
    return f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"


def duration(seconds: float) -> str:
    """Return a time with a unit, to two digits."""
    return f"{seconds:.2g} s" if seconds >= 1.0 else f"{1e3 * seconds:.2g} ms"


def rows() -> list[str]:
    """Play all cases, a row each; what has to be compiled is played twice."""
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
    """Name bodies, each with the methods it was played by."""
    methods: dict[str, list[str]] = {}
    for body, method in variants:
        methods.setdefault(body, []).append(method)
    return "; ".join(f"{body}: {', '.join(names)}" for body, names in methods.items())


if __name__ == "__main__":
    TABLE.write_text(HEAD.format(machine=machine()) + "\n".join(rows()) + "\n", encoding="utf-8")
    print(f"written: {TABLE.relative_to(ROOT)}")
