"""The rounding errors of kernels, measured by the same kernels in numbers of 80 bits, where fractions take too long."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from .bodies import BENT, ON_A_LINE, ON_PATCHES
from .extended import follow, follow_extended

KINDS = ("chain", "graph", *BENT[:2], *ON_PATCHES[:2])


def cases(random: int, stiff: int) -> list[tuple[str, int, float, int, str]]:
    """The cases with these seeds of the bodies, and of bodies whose stiffnesses differ by a factor of 1e6."""
    chains = [("chain", stiff, 1e6, 20, method) for method in ("exact", "catch_up")]
    return [*((kind, random, 1.0, 2, "exact") for kind in KINDS), *chains]


def again(cases: list[tuple]) -> list[Any]:
    """Cases for `make test-all`: an interpreted kernel takes seconds."""
    return [pytest.param(case, marks=pytest.mark.slow) for case in cases]


CASES = [*cases(0, 2), *((kind, 1, 1.0, 1, "exact") for kind in (*ON_A_LINE[2:], *ON_PATCHES[2:4]))]
STIFF_GRAPHS = [("graph", seed, 1e6, 20, "exact") for seed in (2, 3)]


def error_in_roundings(case: tuple[str, int, float, int, str]) -> float:
    found, exact = follow(*case), follow_extended(*case)
    assert (found["digits"], exact["digits"]) == (15, 18)
    assert found["ambiguous"] == exact["ambiguous"] == 0
    error = np.abs(np.subtract(found["x"], exact["x"])).max()
    return float(error / (np.finfo(float).eps * exact["largest"]))


@pytest.mark.parametrize("case", [*CASES, *again(cases(1, 3))], ids=lambda case: "-".join(map(str, case)))
def test_errors_are_a_few_roundings_of_the_displacement(case):
    assert error_in_roundings(case) <= 16.0


@pytest.mark.parametrize(
    "case", [*STIFF_GRAPHS[:1], *again(STIFF_GRAPHS[1:])], ids=lambda case: "-".join(map(str, case))
)
def test_the_errors_of_graphs_do_not_grow_like_ratios_of_stiffness(case):
    assert error_in_roundings(case) <= 1e3
