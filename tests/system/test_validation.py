"""docs/validation.md: its rows are what its script computes, and the script has the closed forms of the model."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from PIL import Image

DOCS = Path(__file__).parent.parent.parent / "docs"
PAGE = (DOCS / "validation.md").read_text(encoding="utf-8")


def load(name):
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def validation():
    return load("validation")


def test_the_page_has_the_rows_of_the_script_in_order(validation):
    lines = PAGE.splitlines()
    places = [lines.index(row) if row in lines else row for row in validation.tables()]
    assert [place for place in places if isinstance(place, str)] == []
    assert places == sorted(places)


def test_every_source_that_is_cited_is_listed():
    text, _, sources = PAGE.partition("## Sources")
    listed = {int(number) for number in re.findall(r"^(\d+)\. ", sources, re.M)}
    ranges = re.findall(r"\[(\d+)\](?: to \[(\d+)\])?", text)
    cited = {number for first, last in ranges for number in range(int(first), int(last or first) + 1)}
    assert cited == listed
    for line in sources.splitlines():
        if re.match(r"\d+\. ", line):
            assert "<https://" in line or "arXiv:" in line, line


def test_simulated_steps_are_those_of_the_formula_that_is_fitted(validation):
    names = tuple(validation.MATERIALS)
    fitted = validation.fit(validation.FITTED)
    pressure, friction, _ = validation.measured(names)
    ours = validation.simulated_steps(fitted, names)
    np.testing.assert_allclose(ours, validation.step_of(fitted, pressure, friction), atol=1e-9)


@pytest.mark.parametrize("load", [0.0, -0.05, 0.05])
def test_two_anchors_lose_what_the_sliding_one_takes(validation, load):
    there = validation.gain(validation.anchored((0.5, 0.1), (0.1, 0.5), load))
    back = validation.gain(validation.anchored((0.1, 0.5), (0.5, 0.1), load))
    assert there == pytest.approx(0.1 - 2 * (0.1 - load) / 20, abs=1e-12)
    assert back == pytest.approx(-(0.1 - 2 * (0.1 + load) / 20), abs=1e-12)


def test_contacts_of_commanded_speeds_move_a_body_with_their_median(validation):
    speeds = np.random.default_rng(3).uniform(-1.0, 1.0, 7)
    speed, lag, unique = validation.roll(tuple(speeds))
    assert speed == pytest.approx(np.median(speeds), abs=1e-12)
    assert abs(lag) <= 0.2 / validation.STIFFNESS
    assert unique


def test_pressures_become_the_angles_of_their_calibration():
    data = load("validation_data")
    line = [2.0**-7, 0.0]  # pressure over angle
    calibration = data.find_constant(f"clb = {dict.fromkeys(range(6), line)}", "clb")
    angles = data.find_angles([1.0, 0.5, 0.0, 0.25, 0.0, 0.75], calibration)
    np.testing.assert_allclose(angles, [128.0, 64.0, -32.0, 1e-3, 96.0], rtol=1e-6)


def test_the_gecko_walks_straight_if_its_steps_mirror_each_other():
    data = load("validation_data")
    right, left = np.array([85.0, 5.0, -80.0, 85.0, 5.0]), np.array([5.0, 85.0, 80.0, 5.0, 85.0])
    turn, ahead, aside = data.travel(data.build_gecko(right, left, 0.02))
    assert abs(turn) < 0.1
    assert 11.0 < ahead < 13.0  # cm, of a torso of 10.3 cm
    assert abs(aside) < 0.1


def test_half_the_stroke_or_twice_the_friction_lose_twice_as_much(validation):
    stiffness = 2 * 0.2 / (0.1 * (1 - validation.EFFICIENCY))
    for friction, stroke in ((0.4, 0.1), (0.2, 0.05)):
        scene = validation.two_contacts(stiffness, stroke, {"forward": friction, "backward": 0.8})
        assert validation.gain(scene) / stroke == pytest.approx(0.928, abs=1e-12)


def test_it_draws(validation, tmp_path, capsys):
    validation.main(tmp_path / "validation.png")
    assert capsys.readouterr().out.splitlines()[:-1] == validation.tables()
    assert Image.open(tmp_path / "validation.png").size == Image.open(DOCS / "pictures" / "validation.png").size
