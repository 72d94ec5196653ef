"""Identification of records of many rows, each of whose evaluations takes seconds."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_lab import identify
from crawler_lab.identify.fit.problem import Problem

from .synthetic import chain, measure, scaled, walk

_ROWS = 21_000


def test_a_large_record_is_evaluated_a_few_times(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = chain()
    measured = measure(truth, *walk(2, 210.0, 5), noise=2e-4, rate=100.0)
    assert measured.time.size >= _ROWS
    sizes: list[int] = []
    compute = Problem._compute

    def counted(problem: Problem, unknowns: np.ndarray) -> object:
        sizes.append(sum(replica.measured.time.size for replica in problem.replicas))
        return compute(problem, unknowns)

    monkeypatch.setattr(Problem, "_compute", counted)
    guess = scaled(truth, {"friction.forward": 1.2, "friction.backward": 0.85})
    found = identify(guess, [measured], ["friction.forward", "friction.backward"], hold_out=0.0)
    assert sum(size >= _ROWS for size in sizes) <= 12
    assert found.model_fits
    for side, values in truth["friction"].items():
        for i, true in enumerate(values):
            parameter = found[f"friction.{side}[{i}]"]
            low, high = parameter.interval
            assert parameter.verdict == ("identified" if side == "forward" else "bound")
            assert low is not None
            assert low < true < (np.inf if high is None else high)
