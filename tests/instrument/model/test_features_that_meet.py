"""Scenes in which bent springs, loads, patches and friction that changes meet, against places in rational numbers.

`places` has the displacements at the waypoints of two periods, from an event-driven solution in fractions, up to where
the translation is no longer unique.
"""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crawler_model import Crawler, Scene, simulate

CASES = json.loads(Path(__file__).with_name("features_that_meet.json").read_text())


@pytest.mark.parametrize("rate", [1.0, 2.0, 7.0, 100.0])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case["scene"]["name"])
def test_runs_agree_with_rational_numbers_at_every_rate(case: dict[str, Any], rate: float) -> None:
    scene = Scene.model_validate(case["scene"])
    periods = 1 if scene.drive.period is None else 2
    run = simulate(scene, float(periods * scene.drive.times[-1]), rate)
    places = np.array([[float(Fraction(x)) for x in row] for row in case["places"]])
    at = np.searchsorted(run.time, np.arange(places.shape[0]) - 1e-9)
    kept = np.abs(run.time[at] - np.arange(places.shape[0])) < 1e-9  # at the waypoints that are ticks
    assert np.abs(run.displacement[at] - places)[kept].max() < 1e-12
    assert kept.sum() >= places.shape[0] / periods
    assert run.energy.relative_residual < 1e-12
    assert run.unsolved == 0
    assert run.unique == case["unique"]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["scene"]["name"])
def test_a_copy_goes_on_to_the_bit(case: dict[str, Any]) -> None:
    """Also where a spring is at a knot: the ramp before has left the other piece in the memory of the crawler."""
    scene = Scene.model_validate(case["scene"])
    crawler = Crawler(scene)
    for target in scene.drive.targets[1:]:
        fork = crawler.copy()
        fork.follow(target[None])
        crawler.follow(target[None])
        assert fork == crawler
