"""docs/laboratory.md, followed as a student follows it, and its record: what the commands found against the truth."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from crawler_model import Scene, load_scene, simulate

from ..pages import ROOT, Page
from ..processes import PATIENCE_S

FOLDER = ROOT / "examples" / "laboratory"
NAME = "docs/laboratory.md"
TEXT = (ROOT / NAME).read_text(encoding="utf-8")
TABLES = ("camera.csv", "motors.csv")


def load(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


RECORD = load(FOLDER / "make_record.py")


@pytest.fixture(scope="module")
def walk(tmp_path_factory) -> Path:
    """The folder after all blocks of the page were run, and printed what it shows."""
    for module in ("cma", "matplotlib", "pyarrow"):
        pytest.importorskip(module)
    folder = tmp_path_factory.mktemp("laboratory")
    Page(NAME, TEXT, folder).run()
    return folder


def found(walk: Path, name: str) -> dict:
    return json.loads((walk / name).read_text(encoding="utf-8"))


def true_value(name: str) -> float:
    scene = load_scene(FOLDER / "truth.yaml").document()
    side, index = re.fullmatch(r"(?:friction|body\.links)\.(\w+)\[(\d)\]", name).groups()
    return (scene["body"]["links"] if side == "stiffness" else scene["friction"])[side][int(index)]


def true_gain(drive: dict) -> float:
    scene = Scene.model_validate(load_scene(FOLDER / "truth.yaml").document() | {"drive": drive})
    return simulate(scene, 20 * drive["period"]).per_period[-1]


def test_the_script_makes_the_committed_tables_to_the_byte(tmp_path):
    command = [sys.executable, str(FOLDER / "make_record.py"), str(tmp_path)]
    place = {"env": os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}, "cwd": tmp_path}
    subprocess.run(command, check=True, timeout=PATIENCE_S, **place)
    assert sorted(path.name for path in tmp_path.iterdir()) == list(TABLES)
    for name in TABLES:
        assert (tmp_path / name).read_bytes() == (FOLDER / name).read_bytes(), name
    assert sum((FOLDER / name).stat().st_size for name in TABLES) < 150_000


def test_the_tables_the_script_and_the_page_say_that_the_record_is_made_up():
    for name in TABLES:
        assert "made up" in (FOLDER / name).read_text(encoding="utf-8").splitlines()[0]
    assert "Nothing here was measured" in RECORD.__doc__
    assert "**The record is made up.**" in TEXT
    assert "made-up record" in (ROOT / "examples" / "README.md").read_text(encoding="utf-8")


def test_the_first_guess_is_up_to_thirty_percent_off():
    guess, truth = (load_scene(FOLDER / name).document()["friction"] for name in ("robot.yaml", "truth.yaml"))
    off = [np.abs(np.divide(guess[side], truth[side]) - 1.0).max() for side in ("forward", "backward")]
    assert min(off) > 0.2
    assert max(off) < 0.31


def test_the_motor_that_stopped_is_named_with_its_time(walk):
    whole = found(walk, "all.json")
    assert not whole["model_fits"]
    best, *others = whole["explanations"]
    assert best["what"] == f"link_0 does not move from {RECORD.STUCK:g} s on"
    assert best["explained"] > 0.99
    assert all(one["explained"] < best["explained"] for one in others)


def test_the_springs_of_the_maker_are_found_out(walk):
    friction = found(walk, "friction.json")
    assert not friction["model_fits"]
    amounts = {one["what"].split(":")[0]: one["amount"] for one in friction["explanations"]}
    assert 0.0 < amounts["stiffness of link_1"] < 0.1  # 4.5 % in truth
    assert -0.1 < amounts["stiffness of link_2"] < 0.0  # -3.5 %


def test_the_model_fits_and_as_many_intervals_as_the_page_says_contain_the_truth(walk):
    fit = found(walk, "fit.json")
    assert fit["model_fits"]
    assert max(one["ratio"] for one in fit["misfits"]) < 1.3
    truth = [true_value(p["name"]) for p in fit["parameters"]] + [RECORD.LAG, RECORD.SCALE]
    ends = [one["interval"] for one in fit["parameters"] + fit["sensors"][:2]]
    covered = sum(low <= true <= (high or np.inf) for true, (low, high) in zip(truth, ends, strict=True))
    said, of = map(int, re.search(r"^(\d+) of (\d+) intervals contain the truth$", TEXT, re.M).groups())
    assert (covered, len(ends)) == (said, of)
    assert covered >= of - 1


def test_the_intervals_are_narrow_enough_to_mean_something(walk):
    fit = found(walk, "fit.json")
    identified = [p for p in fit["parameters"] if p["verdict"] == "identified"]
    assert len(identified) == 9
    for p in identified:
        assert p["interval"][1] - p["interval"][0] < 0.15 * p["value"], p["name"]
    lag, scale = fit["sensors"][:2]
    assert lag["value"] == pytest.approx(RECORD.LAG, abs=2e-3)
    assert scale["value"] == pytest.approx(RECORD.SCALE, abs=6e-3)


@pytest.mark.parametrize("name", ["other", "best"])
def test_the_true_gain_lies_within_the_predicted_band(walk, name):
    band = found(walk, f"{name}.json")["gain"]
    gain = true_gain(load_drive(walk / f"{name}.yaml"))
    assert band["low"] <= gain <= band["high"]
    assert band["high"] - band["low"] < 0.03 * gain


def test_the_gait_found_is_faster_on_the_true_robot_within_the_same_limits(walk):
    times, told = RECORD.command()
    period = RECORD.WAYPOINTS + 1
    recorded = {"times": times[:period].tolist(), "period": RECORD.PERIOD, "actuation": told[:period].tolist()}
    best = load_drive(walk / "best.yaml")
    assert true_gain(best) / best["period"] > 1.6 * true_gain(recorded) / RECORD.PERIOD
    rows, duration = np.array(best["actuation"]), np.array(best["times"])
    fastest = np.abs(np.diff(told, axis=0)).max() / np.diff(times).min()
    assert np.abs(np.diff(rows, axis=0) / np.diff(duration)[:, None]).max() < 1.01 * fastest
    assert (rows >= told.min(axis=0) - 1e-9).all()
    assert (rows <= told.max(axis=0) + 1e-9).all()


def test_the_lines_of_the_picture_follow_the_camera_until_the_motor_stops(walk, monkeypatch):
    monkeypatch.chdir(walk)
    camera = np.genfromtxt("camera.csv", delimiter=",", skip_header=2)
    time, error = (
        camera[:, 0],
        camera[:, 1:] - load(ROOT / "docs" / "laboratory.py").see(found(walk, "fit.json"), camera[:, 0]),
    )
    assert np.sqrt(np.nanmean(error[time < RECORD.STUCK] ** 2)) < 0.3  # mm
    assert np.nanmax(np.abs(error[time > RECORD.STUCK + 2.0])) > 10.0


def load_drive(path: Path) -> dict:
    import yaml

    return yaml.safe_load(path.read_text(encoding="utf-8"))["drive"]
