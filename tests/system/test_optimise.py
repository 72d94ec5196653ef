"""`crawler optimise` as a user types it."""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from crawler_command.app import main
from crawler_command.screen import parse_bounds
from crawler_lab.optimise.regime import Regime
from crawler_lab.optimise.search import Found
from crawler_lab.optimise.space import Space
from crawler_model import CrawlerError, limit_cycle, load_scene

pytest.importorskip("cma")

BODY = """
name: mine
body:
  contacts: [0.0, 0.1]
  links: {stiffness: 10.0}
friction: {forward: 0.2, backward: 0.6}
"""


def run(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    out, err = capsys.readouterr()
    return int(end.value.code), out, err


@pytest.fixture
def scene(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(BODY, encoding="utf-8")
    return tmp_path


def test_the_gait_is_written_drawn_and_played(scene, capsys):
    arguments = ["optimise", "mine.yaml", "--for", "translation", "--stroke", "0:0.1", "--waypoints", "2"]
    status, out, _ = run(capsys, *arguments, "--out", "best.yaml", "--png", "best.png", "--json")
    about = json.loads(out)
    assert status == 0
    assert about["best"]["value"] == pytest.approx(0.06)
    assert limit_cycle(load_scene("best.yaml")).gain == pytest.approx(0.06)
    assert about["drive"] == load_scene("best.yaml").document()["drive"]
    assert (scene / "best.png").stat().st_size > 20_000
    status, _, err = run(capsys, *arguments, "--out", "best.yaml")
    assert status == 1
    assert "best.yaml exists already" in err


def test_ctrl_c_keeps_the_best_gait_so_far(scene, capsys, monkeypatch):
    @contextlib.contextmanager
    def interrupt(_: str) -> Iterator[Callable[[float], None]]:
        yield lambda part: signal.raise_signal(signal.SIGINT) if part > 0.0 else None

    monkeypatch.setattr("crawler_lab.verbs.optimise.progress_bar", interrupt)
    arguments = ["--for", "translation", "--stroke", "0:0.1", "--waypoints", "2", "--out", "best.yaml", "--json"]
    status, out, _ = run(capsys, "optimise", "mine.yaml", *arguments)
    assert status == 130
    assert json.loads(out)["complete"] is False
    assert load_scene("best.yaml").document()["drive"] == json.loads(out)["drive"]


def test_the_bar_tells_when_the_gait_is_examined(scene, capsys, monkeypatch):
    steps = []

    @contextlib.contextmanager
    def note(_: str) -> Iterator[Callable[..., None]]:
        yield lambda part, step="": steps.append((part, step))

    monkeypatch.setattr("crawler_lab.verbs.optimise.progress_bar", note)
    arguments = ["--for", "translation", "--stroke", "0:0.1", "--waypoints", "2", "--seconds", "0.1"]
    assert run(capsys, "optimise", "mine.yaml", *arguments)[0] == 0
    assert steps[-1] == (1.0, "examining the best gait")
    assert {step for part, step in steps if part < 1.0} <= {""}


@pytest.mark.parametrize("ending", ["ctrl_c", "seconds", "ctrl_c within the seconds"])
def test_gaits_of_the_first_round_are_kept_and_counted(scene, capsys, monkeypatch, ending):
    """In the plane each gait takes so long that the search often ends in the first round."""
    run_alone, scores, searched = Space.regimes, [], []
    verb = importlib.import_module("crawler_lab.optimise.optimise")
    check = verb.check_found

    def count(space: Space, points: np.ndarray) -> list[list[Regime | None]]:
        found = run_alone(space, points)
        scores.extend(space.score(regimes) for regimes in found)
        if ending != "seconds" and len(scores) == 5:
            os.kill(os.getpid(), signal.SIGINT)
        return found

    def check_found(space: Space, found: Found) -> None:
        searched.extend(scores)
        check(space, found)

    monkeypatch.setattr(importlib.import_module("crawler_lab.optimise.space"), "available_cores", lambda: 2)
    monkeypatch.setattr(Space, "regimes", count)
    monkeypatch.setattr(verb, "check_found", check_found)
    limit = {"ctrl_c": [], "seconds": ["--seconds", "0.5"]}.get(ending, ["--seconds", "100"])
    arguments = ["--for", "turn", "--out", "best.yaml", "--json", *limit]
    status, out, err = run(capsys, "optimise", "steering_inchworm", *arguments)
    assert status == (0 if ending == "seconds" else 130), err
    found = json.loads(out)
    assert found["complete"] is False
    best, evaluations = found["best"]["value"], found["evaluations"]
    if ending == "seconds":  # the examination may have found a better one in what was left of the time
        assert best >= max(searched)
        assert evaluations >= len(searched)
    else:
        assert best == max(searched)
        assert evaluations == len(searched)
    assert load_scene("best.yaml").document()["drive"] == found["drive"]


def test_commands_that_waypoints_replace_are_named(scene, capsys):
    mine = load_scene("mine.yaml").document()
    for name, more in (("friction", {"friction": {"isotropic": 0.5}}), ("loads", {"loads": [0.0] * 3})):
        drive = {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [0.1], [0.0]], **more}
        other = mine | {"name": "other", "drive": drive} | ({"loads": 0.0} if name == "loads" else {})
        Path("other.yaml").write_text(json.dumps(other))
        for verb in (
            ["optimise", "other.yaml", "--for", "translation", "--seconds", "0.1"],
            ["excite", "other.yaml", "--fit", "body.links.stiffness", "--duration", "1"],
        ):
            status, _, err = run(capsys, *verb)
            assert status == 0
            assert f"other: the drive was sought without drive.{name}, on the {name} of the scene itself" in err
    free = ["--free", "friction=0.2:0.5", "--waypoints", "2", "--seconds", "0.1"]
    status, _, err = run(capsys, "optimise", "two_anchor_a", "--for", "translation", *free)
    assert (status, "sought without" in err) == (0, False)
    free = ["--free", "drive.wave.wavelength=0.2:2", "--seconds", "0.1"]
    status, _, err = run(capsys, "optimise", "friction_wave_segment", "--for", "translation", *free)
    assert (status, "sought without" in err) == (0, False)


def test_text_names_the_change_that_stops_the_gait(scene, capsys):
    arguments = [
        "--for",
        "translation",
        "--stroke",
        "0:0.1",
        "--waypoints",
        "2",
        "--robust",
        "friction.forward=0.8:1.2",
    ]
    status, out, _ = run(capsys, "optimise", "mine.yaml", *arguments)
    assert status == 0
    assert "gain per period 0.052 m, the worst over the box" in out
    assert "no gait within these bounds" not in out
    assert "no longer moves forward when friction.forward changes by the factor 2.5" in out


def test_text_has_no_cost_of_transport_where_nothing_moves_forward(scene, capsys):
    status, out, _ = run(capsys, "optimise", "two_anchor_a", "--for", "cost-of-transport", "--seconds", "1")
    assert status == 0
    assert "two_anchor_a: cost of transport none\nno gait within these bounds was found that moves forward" in out
    assert "nan" not in out


def test_a_body_that_turns_reaches_a_motion(scene, capsys):
    target = limit_cycle(load_scene("scissors")).gain
    words = ",".join(map(str, target))
    arguments = ["optimise", "scissors", "--for", "screw", f"--target={words}", "--waypoints", "2", "--seconds", "1"]
    status, out, _ = run(capsys, *arguments, "--out", "best.yaml", "--json")
    assert status == 0
    about = json.loads(out)
    assert about["best"] == {"value": pytest.approx(0.0, abs=1e-6), "unit": "m"}
    assert about["motion"] == pytest.approx(target.tolist(), abs=1e-6)
    assert limit_cycle(load_scene("best.yaml")).gain == pytest.approx(target, abs=1e-6)
    status, out, _ = run(capsys, *arguments, "--png", "best.png")
    assert status == 0
    assert (scene / "best.png").stat().st_size > 20_000
    assert "scissors: distance from the target" in out
    assert "0.46 rad" in out
    assert "without derivatives" in out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["screw"], "target: missing; the objective 'screw' needs dx, dy, dyaw per period"),
        (["screw", "--target", "1,2"], "--target 1,2: write DX,DY,DYAW"),
        (["turn", "--target", "0,0,1"], "the objective 'screw' needs dx, dy, dyaw per period, others none"),
        (["travel"], "must be one of translation, cost-of-transport, turn, screw"),
        (["turn", "--pareto"], "--pareto: the curve shows translation against cost of transport"),
        (["translation", "--pareto", "--target", "0,0,1"], "--pareto: the curve shows translation"),
        (["turn", "--fastest", "1"], "rate: not available for scissors, which turns"),
    ],
)
def test_what_a_body_that_turns_cannot_have_is_one_line(scene, capsys, options, message):
    status, _, err = run(capsys, "optimise", "scissors", "--for", *options)
    assert status == 1
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--stroke", "0-1"], "--stroke 0-1: write A:B or NAME=A:B, with two numbers"),
        (["--free", "friction"], "--free friction: write KEY=A:B"),
        (["--stroke", "0:1", "--out", "best.txt"], "--out: best.txt must end in .yaml"),
        (["--stroke", "0:1", "--pareto", "--out", "best.yaml"], "with --pareto there are several gaits"),
        ([], "stroke: missing"),
    ],
)
def test_a_mistake_is_one_line(scene, capsys, options, message):
    status, _, err = run(capsys, "optimise", "mine.yaml", "--for", "translation", *options)
    assert status == 1
    assert message in err
    assert err.count("\n") == 1


def test_a_key_is_named_once():
    assert parse_bounds("--free", ["a.b=0:1", "c=-1:2e3"]) == {"a.b": (0.0, 1.0), "c": (-1.0, 2000.0)}
    with pytest.raises(CrawlerError, match="is repeated"):
        parse_bounds("--free", ["a=0:1", "a=0:2"])


def test_a_gait_that_reverses_often_has_its_gain_per_reversal_beside_it(scene, capsys):
    short = ("optimise", "mine.yaml", "--for", "translation", "--stroke", "0:0.1")
    _, out, _ = run(capsys, *short, "--waypoints", "6")
    assert "0.06 m per reversal" in out or "0.03 m per reversal" in out
    assert "a link reverses up to 6 times a second; --fastest limits the speed" in out
    assert "the search ended because several rounds in a row found nothing better" in out
    _, out, err = run(capsys, *short, "--waypoints", "2", "--period", "2")
    assert "gain 0.03 m/s" in out
    assert "a link reverses up to 1 times a second\n" in out
    assert err == ""


def test_a_segment_counts_as_one_actuator(scene, capsys):
    _, out, _ = run(
        capsys, "optimise", "continuous_segment", "--for", "translation", "--waypoints", "2", "--seconds", "1"
    )
    gain = float(out.split("gain per period ")[1].split()[0])
    assert f"{gain / 2.0:.4g} m per reversal" in out


@pytest.mark.parametrize(("name", "free", "moving"), [("hybrid_body", "link_0=0:0.3", 1), ("rubber_worm", "0:0.08", 2)])
def test_links_that_move_are_counted_whatever_is_beside_them(scene, capsys, name, free, moving):
    """A link beside a segment at rest, and links that remember, whose gaits are followed."""
    arguments = ("--for", "translation", "--stroke", free, "--waypoints", "2", "--seconds", "2", "--out", "best.yaml")
    status, out, err = run(capsys, "optimise", name, *arguments)
    assert (status, err) == (0, "")
    actuation = np.array(load_scene("best.yaml").document()["drive"]["actuation"])
    assert (np.ptp(actuation, axis=0) > 0.0).sum() == moving
    gain = float(out.split("gain per period ")[1].split()[0])
    assert f"{gain / (2 * moving):.4g} m per reversal" in out


def test_strokes_in_millimetres_are_asked_about(scene, capsys):
    _, _, err = run(capsys, "optimise", "mine.yaml", "--for", "translation", "--stroke", "0:60", "--waypoints", "2")
    assert "--stroke 0:60 is in metres, but the body is 0.1 m long: millimetres?" in err
