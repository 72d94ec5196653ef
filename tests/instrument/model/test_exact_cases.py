"""The rational solutions: every event followed, displacement at every waypoint."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from crawler_model import Scene, simulate

CASES = json.loads((Path(__file__).parent / "exact_cases.json").read_text())["cases"]


def test_there_are_chains_and_graphs_to_check():
    chains = [Scene.model_validate(case["scene"]).body.is_chain for case in CASES]
    assert (chains.count(True), chains.count(False)) == (18, 6)


@pytest.mark.parametrize("rate", [100.0, 7.0, 0.3, 1000.0])
@pytest.mark.parametrize("case", CASES, ids=lambda c: c["scene"]["name"])
def test_displacement_at_every_waypoint(case, rate):
    run = simulate(Scene.model_validate(case["scene"]), rate=rate)
    assert run.waypoint_time.tolist() == case["scene"]["drive"]["times"]
    assert np.abs(run.waypoint_displacement - np.array(case["displacement"])).max() < 1e-12
    assert run.unique
    assert run.energy.dissipation == pytest.approx(float(Fraction(case["dissipation"])), rel=1e-12)
    assert run.energy.relative_residual < 1e-13
    assert run.violation < 1e-13
    assert run.overspent == 0


@pytest.mark.parametrize("case", CASES[::3], ids=lambda c: c["scene"]["name"])
def test_catch_up_converges_to_first_order(case):
    scene = Scene.model_validate(case["scene"])
    exact = np.array(case["displacement"])
    errors = [
        np.abs(simulate(scene, rate=rate, method="catch_up").waypoint_displacement - exact).max()
        for rate in (16.0, 256.0, 4096.0)
    ]
    assert errors[2] < 10.0 / 4096.0
    assert errors[2] <= max(errors[0] / 20, 1e-12)
