"""`crawler predict` as a user types it, and gaits for a body that is known up to a posterior."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml

from crawler_model import Scene, limit_cycle, load_scene

from ..commands import crawler
from ..lab.identify.posteriors import PERIODIC, posterior, printed, robot

LEFT = "friction.backward[0]"


@pytest.fixture
def folder(tmp_path) -> Path:
    """A scene without a drive, what is known about it, and a drive."""
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot(None).document()), encoding="utf-8")
    known = posterior(without=(LEFT,), bounds={LEFT: (0.25, None)})
    (tmp_path / "fit.json").write_text(json.dumps(printed(known)), encoding="utf-8")
    (tmp_path / "gait.yaml").write_text(yaml.safe_dump({"drive": PERIODIC}), encoding="utf-8")
    return tmp_path


def test_a_gait_is_predicted_with_bands_and_a_picture(folder):
    asked = ("predict", "robot.yaml", "--from", "fit.json", "--drive", "gait.yaml", "--periods", "2")
    done = crawler(*asked, "--png", "gait.png", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "gain a period" in done.stdout
    assert "gain in the first 2 periods" in done.stdout
    assert "contact 0 slides backwards under this drive; the record shows only that its friction is at" in done.stdout
    assert (folder / "gait.png").stat().st_size > 20_000
    again = crawler(*asked, "--png", "gait.png", cwd=folder)
    assert again.returncode == 1
    assert "gait.png exists already" in again.stderr
    found = json.loads(crawler(*asked, "--png", "gait.png", "--force", "--json", cwd=folder).stdout)
    assert found["gain"]["value"] == pytest.approx(limit_cycle(robot()).gain)
    assert found["gain"]["low"] < found["gain"]["value"] < found["gain"]["high"]
    assert found["depends_on_bounds"][0]["name"] == LEFT


def test_the_drive_of_a_scene_file_and_that_of_the_scene_itself_are_predicted_alike(folder):
    (folder / "whole.yaml").write_text(yaml.safe_dump(robot().document()), encoding="utf-8")
    outs = [
        crawler("predict", *asked, "--from", "fit.json", "--json", cwd=folder).stdout
        for asked in (("whole.yaml",), ("robot.yaml", "--drive", "whole.yaml"))
    ]
    assert json.loads(outs[0])["gain"] == json.loads(outs[1])["gain"]


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (("--from", "none.json"), "none.json: no such file"),
        (("--from", "gait.yaml", "--drive", "gait.yaml"), "gait.yaml: not JSON in line 1"),
        (("--from", "fit.json"), "predict: robot has no drive; without one nothing moves"),
        (("--from", "fit.json", "--drive", "fit.json"), "fit.json: no drive; it must have a part `drive:`"),
        (("--from", "unknown.json", "--drive", "gait.yaml"), f"depends on {LEFT}, which the record did not excite"),
        (("--from", "fit.json", "--drive", "gait.yaml", "--png", "gait.gif"), "--png: gait.gif must end in .png"),
    ],
)
def test_a_mistake_is_one_line(folder, asked, message):
    known = posterior(without=(LEFT,), unknown=(LEFT,))
    (folder / "unknown.json").write_text(json.dumps(printed(known)), encoding="utf-8")
    done = crawler("predict", "robot.yaml", *asked, cwd=folder)
    assert done.returncode == 1
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


SEARCH = ("optimise", "robot.yaml", "--for", "translation", "--stroke", "0:0.1", "--waypoints", "2")


def test_a_gait_is_sought_over_bodies_of_the_posterior(folder):
    pytest.importorskip("cma")
    both = {}
    for over in ("expected", "worst"):
        asked = (*SEARCH, "--robust-to", "fit.json", "--robust-of", over, "--seconds", "2", "--json")
        done = crawler(*asked, cwd=folder)
        assert done.returncode == 0, done.stderr
        both[over] = json.loads(done.stdout)
        robustness = both[over]["robust_to"]
        assert robustness["over"] == over
        assert robustness["worst"] < robustness["mean"]
        assert robustness["best_fit"] == pytest.approx(both[over]["gain"])
        assert 8 <= robustness["verified"] <= 64
        assert robustness["unknown"] == []
        played = Scene.model_validate(load_scene(folder / "robot.yaml").document() | {"drive": both[over]["drive"]})
        assert limit_cycle(played).gain == pytest.approx(both[over]["gain"], abs=1e-9)
    assert both["worst"]["best"]["value"] < both["expected"]["best"]["value"]
    text = crawler(*SEARCH, "--robust-to", "fit.json", "--seconds", "1", cwd=folder).stdout
    assert "the mean of 8 bodies drawn from the posterior" in text
    assert re.search(r"on \d+ other bodies: mean", text)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--robust-of", "worst"), "--robust-of worst: it needs --robust-to FIT.json"),
        (("--robust-to", "fit.json", "--robust", "friction.forward=0.8:1.2"), "cannot be combined with --robust;"),
        (("--robust-to", "fit.json", "--pareto"), "cannot be combined with --pareto;"),
        (("--robust-to", "fit.json", "--for", "cost-of-transport"), "the expected cost of transport has no bound"),
        (("--robust-to", "fit.json", "--free", "friction=0.1:0.2"), "the waypoints command friction"),
        (("--robust-to", "fit.json", "--free", "friction.forward=0.1:0.2"), "is free; it cannot be uncertain, too"),
        (("--robust-to", "fit.txt"), "fit.txt: no such file"),
    ],
)
def test_what_cannot_be_combined_is_refused_in_one_line(folder, options, message):
    pytest.importorskip("cma")
    done = crawler(*SEARCH, *options, cwd=folder)
    assert done.returncode == 1
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
