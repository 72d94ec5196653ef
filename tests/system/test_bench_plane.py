"""The cases in the plane stand beside a reference that shares nothing with our method."""

from __future__ import annotations

import math

import numpy as np
import pytest

from crawler_bench.cases import CASES, QUARTERS, Case
from crawler_bench.entrants import ours
from crawler_bench.figure import draw_case
from crawler_bench.report import EXACT
from crawler_bench.result import BenchResult
from crawler_bench.sliding import follow_sliding
from crawler_model import Crawler, Scene
from crawler_model.scene.parts import LEAST_TOLERANCE

PLANAR = ("planar", "planar_turning")


def errors_of_ours(case: Case, tolerances: tuple[float, ...]) -> list[float]:
    found = []
    for entrant in ours.build_planar(case, tolerances):
        run = entrant.start()
        x = []
        for number in range(QUARTERS):
            run.quarter(number, math.inf)
            x.append(np.array(run.displacement))
        found.append(case.reference.error(np.array(x)))
    return found


@pytest.mark.parametrize("name", PLANAR)
def test_the_reference_is_not_ours_and_keeps_its_account_to_rounding(name):
    reference = CASES[name]().reference
    assert reference.kind == "integrated"
    assert reference.certificate["energy_residual"] < 1e-12
    assert reference.certificate["violation"] < 1e-12
    assert reference.certificate.get("closed_form_difference", 0.0) < 1e-14


@pytest.mark.parametrize("name", PLANAR)
def test_our_error_is_a_number_and_no_greater_than_the_tolerance(name):
    tolerances = (1e-3, 1e-5)
    for error, tolerance in zip(errors_of_ours(CASES[name](), tolerances), tolerances, strict=True):
        assert 0.0 < error < tolerance


@pytest.mark.parametrize("seed", range(6))
def test_both_methods_follow_random_bodies_alike(seed):
    rng = np.random.default_rng(seed)
    n, rows = 3 + seed % 3, 5
    scene = Scene.model_validate(
        {
            "name": f"random_{seed}",
            "dimension": 2,
            "start": "relaxed",
            "body": {
                "contacts": rng.uniform(0.0, 1.0, (n, 2)).tolist(),
                "links": {"stiffness": rng.uniform(5.0, 20.0, n - 1).tolist()},
            },
            "friction": {"isotropic": rng.uniform(0.2, 1.0, n).tolist()},
            "tolerance": LEAST_TOLERANCE,
            "drive": {"times": list(range(rows)), "actuation": rng.uniform(-0.3, 0.3, (rows, n - 1, 2)).tolist()},
        }
    )
    targets = [row[None] for row in scene.drive.targets[1:]]
    x, account = follow_sliding(scene, targets)
    crawler = Crawler(scene)
    size = np.ptp(x, axis=0).max()
    for target, expected in zip(targets, x, strict=True):
        crawler.follow(target)
        assert np.abs(crawler.displacement - expected).max() < 1e-6 * size
    assert abs(account.energy_residual) < 1e-12 * account.work
    assert account.violation < 1e-11


def test_a_method_without_error_has_a_point_in_the_picture(tmp_path):
    from matplotlib.image import imread

    case = CASES["planar"]()
    (error,) = errors_of_ours(case, (1e-2,))
    assert error <= EXACT
    common = {"case": "planar", "n": 3, "ticks_per_period": 4.0, "us_per_tick": 10.0, "us_per_period": 40.0}
    common |= {"spread_us_per_tick": [9.0, 12.0], "solved": True, "detail": ""}
    rows = [
        common | {"method": "catch_up, refined", "error": error, "label": "tolerance 1e-2"},
        common | {"method": "Clarabel 1e-6", "error": 1e-3, "label": "4"},
    ]
    machine = {"cpu": "any", "cores": 1, "load_average": [0.0], "python": "3", "numba": "0"}
    references = {"planar": {"reference": case.reference.kind}}
    draw_case(BenchResult(machine, references, {"planar": case.title}, rows), "planar", tmp_path / "planar.png")
    picture = imread(tmp_path / "planar.png")[:, :, :3]
    axes = picture[:, : int(0.72 * picture.shape[1])]
    ours_drawn = np.abs(axes - np.array([0x1A, 0x9E, 0x55]) / 255.0).max(axis=2) < 0.02
    assert ours_drawn.sum() > 50
