"""The rounding errors of kernels, measured by the same kernels in numbers of 80 bits, where fractions take too long."""

from __future__ import annotations

import numpy as np
import pytest

from .bodies import BENT, ON_A_LINE, ON_PATCHES
from .extended import follow, follow_extended

CASES = [
    *((kind, seed, 1.0, 2, "exact") for kind in ("chain", "graph", *BENT[:2], *ON_PATCHES[:2]) for seed in range(2)),
    *((kind, 1, 1.0, 1, "exact") for kind in (*ON_A_LINE[2:], *ON_PATCHES[2:4])),
    *((kind, 2, 1e6, 20, "exact") for kind in ("chain", "graph")),
    *((kind, 3, 1e6, 20, "catch_up") for kind in ("chain", "graph")),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: "-".join(map(str, case)))
def test_errors_are_a_few_roundings_of_the_displacement(case):
    found, exact = follow(*case), follow_extended(*case)
    assert (found["digits"], exact["digits"]) == (15, 18)
    assert found["ambiguous"] == exact["ambiguous"] == 0
    error = np.abs(np.subtract(found["x"], exact["x"])).max()
    print("ERR", case, error / (np.finfo(float).eps * exact["largest"]))
    assert error <= 16.0 * np.finfo(float).eps * exact["largest"]
