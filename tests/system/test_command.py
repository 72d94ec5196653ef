"""The `crawler` command as a user types it."""

from __future__ import annotations

import json
import os
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer

import crawler_model
from crawler_command import loads_report, view
from crawler_command.app import app, main
from crawler_command.loads_report import print_holding, print_limits
from crawler_command.screen import Screen
from crawler_model import Scene, gallery, load_scene
from crawler_model.kernel_cache import folder_of_kernels

from ..commands import crawler
from ..scenes import NOT_TURNING, TURNING

CRAWLER = str(Path(sys.executable).parent / "crawler")


def good(*arguments: str, **options) -> str:
    done = crawler(*arguments, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def bad(*arguments: str, **options) -> str:
    done = crawler(*arguments, **options)
    assert done.returncode != 0
    assert "Traceback" not in done.stderr
    return done.stderr


def test_help_teaches():
    text = good("--help")
    for verb in ("demo", "run", "simulate", "check", "sweep", "scenes", "view", "replay"):
        assert verb in text
        assert "Usage" in good(verb, "--help")


def test_scenes_are_a_line_each():
    lines = good("scenes").splitlines()
    assert [line.split()[0] for line in lines] == list(gallery())
    assert json.loads(good("scenes", "--json")) == gallery()


@pytest.mark.parametrize("method", ["exact", "catch_up"])
def test_simulate_prints_the_json_of_the_contract(method):
    run = json.loads(good("simulate", "two_anchor_a", "--duration", "3", "--rate", "50", "--method", method, "--json"))
    assert run["schema"] == 1
    assert run["method"] == method
    assert run["rate_hz"] == 50.0
    assert run["ticks"] == 150
    assert run["time"] == [0, 1, 2, 3]
    assert run["per_period"] == pytest.approx([2.0] * 3, abs=1e-12 if method == "exact" else 0.2)


def test_a_pipe_gets_json_and_nothing_else():
    done = subprocess.run([CRAWLER, "simulate", "two_anchor_a", "--json"], capture_output=True, text=True)
    assert done.stderr == "" or "compiling" in done.stderr
    assert len(done.stdout.splitlines()) == 1


def test_simulate_draws_the_page_of_a_run(tmp_path):
    png = tmp_path / "run.png"
    assert f"drawn: {png}" in good("simulate", "two_anchor_a", "--duration", "1", "--png", png)
    assert png.read_bytes().startswith(b"\x89PNG")


def test_simulate_for_people():
    text = good("simulate", "three_contacts_two_ways")
    assert "0.07" in text
    assert "residual" in text


@pytest.mark.parametrize("name", NOT_TURNING)
def test_check_every_scene_of_the_gallery(name, tmp_path):
    text = good("check", name, "--png", str(tmp_path / "d.png"))
    assert "valid" in text
    assert "uniqueness margin" in text
    assert (tmp_path / "d.png").stat().st_size > 5_000


def test_forces_that_are_rounding_are_zero(tmp_path):
    """The links of a relaxed start have the tension that rounding leaves of two equal lengths."""
    document = load_scene("three_contacts_one_way").document() | {"start": "relaxed"}
    document["drive"] = {"wave": {"amplitude": 0.05, "wavelength": 0.3, "period": 1.0}}
    (tmp_path / "x.yaml").write_text(json.dumps(document))
    rows = [line.split("│") for line in good("check", str(tmp_path / "x.yaml")).splitlines() if line.startswith("│")]
    assert [row[5].strip() for row in rows] == ["0", "0", "0"]


def test_a_tow_that_is_rounding_is_zero(tmp_path):
    """A spring of 3 N/m, 0.1 m long, pulls a contact by 0.30000000000000004 N, and it holds 0.3 N."""
    document = {
        "name": "at_its_bound",
        "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 3.0}},
        "friction": {"forward": 0.3, "backward": 0.5},
        "start": {"displacement": [0.0, 0.1]},
    }
    (tmp_path / "x.yaml").write_text(json.dumps(document))
    assert "a tow on contact 0 alone moves it first, from 0 N forward, 0.8 N backward" in " ".join(
        good("check", str(tmp_path / "x.yaml")).split()
    )


@pytest.mark.parametrize("friction", [{"forward": 1.0, "backward": 0.0}, {"forward": 0.5, "backward": 0.5}])
def test_check_prints_no_negative_zero(tmp_path, friction):
    """A bound that is 0, and contacts that meet but do not pass."""
    document = {
        "name": "x",
        "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}},
        "friction": friction,
        "start": "relaxed",
        "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [-1.5], [0.0]]},
    }
    (tmp_path / "x.yaml").write_text(json.dumps(document))
    assert not re.search(r"-0(?![\d.])", good("check", str(tmp_path / "x.yaml")))


def test_check_prints_json_for_programs():
    found = json.loads(good("check", "three_contacts_one_way", "--json"))
    assert (found["schema"], found["scene"], found["dimension"]) == (1, "three_contacts_one_way", 1)
    assert [contact["slides"] for contact in found["contacts"]] == [True, True, True]
    assert found["directions"] == ["forward"]
    text = good("check", "three_contacts_one_way")
    assert all(line in text for line in found["findings"])
    assert f"uniqueness margin: {found['uniqueness_margin']:.4g} " in text
    planar = json.loads(good("check", "planar_three_points", "--json"))
    assert planar["directions"] is None
    assert len(planar["contacts"][0]["position"]) == len(planar["per_period"][0]) == 2


def test_the_version_is_printed():
    assert good("--version") == f"crawler {crawler_model.__version__}\n"


def test_words_in_brackets_stay_in_the_help():
    text = re.sub(r"[\s│]+", " ", good("animate", "--help"))
    assert "pip install 'crawler-ros[animate]'" in text


def test_an_existing_file_is_replaced_only_with_force(tmp_path):
    """One rule for all verbs; verbs of recordings have the same option."""
    for words in (("check", "two_anchor_a", "--png", "x.png"), ("simulate", "two_anchor_a", "--png", "x.png")):
        (tmp_path / "x.png").write_text("mine")
        assert "--png: x.png exists already; choose another name, or use --force" in bad(*words, cwd=tmp_path)
        assert (tmp_path / "x.png").read_text() == "mine"
        good(*words, "--force", cwd=tmp_path)
        assert (tmp_path / "x.png").stat().st_size > 5_000


def test_an_option_means_the_same_for_every_verb():
    """`--rate` is a frequency, `--seconds` time on the wall, `--duration` simulated time; no letter has two meanings."""
    meanings = {"--rate": "Hz", "--seconds": "ime", "--duration": "imulated", "--force": "Replace existing files."}
    letters: dict[str, str] = {}
    for verb, command in typer.main.get_command(app).commands.items():
        for option in command.params:
            for name in option.opts:
                if name in meanings:
                    assert meanings[name] in option.help, (verb, name)
                if name == "--seconds":
                    assert "imulated" not in option.help, verb
                if len(name) == 2 and name.startswith("-"):
                    assert letters.setdefault(name, option.opts[-1]) == option.opts[-1]


@pytest.mark.parametrize("name", TURNING)
def test_check_every_scene_of_a_body_that_turns(name, tmp_path):
    text = good("check", name, "--png", str(tmp_path / "d.png"))
    assert (tmp_path / "d.png").stat().st_size > 5_000
    assert "valid" in text
    assert "it turned by" in text
    assert "stability margin" in text


def test_check_says_what_is_too_weak(tmp_path):
    scene = tmp_path / "weak.yaml"
    scene.write_text(
        "{name: weak, body: {contacts: [0, 1], links: {stiffness: 1}}, friction: {isotropic: 1},"
        " drive: {times: [0, 1], actuation: [0, 0.5]}}"
    )
    text = good("check", str(scene))
    assert "too weak" in text
    assert "critical" in text


def test_check_says_what_a_body_is_and_where_it_can_go():
    text = good("check", "three_springs")
    assert "3 contacts, 3 links, a graph; valid" in text
    assert "allows motion forward only" in text
    text = good("check", "friction_wave_segment")
    assert "segment foot (44 elements)" in text
    assert "changing by at most 0.9" in text
    assert "per second; regular" in text
    text = good("check", "planar_three_points")
    assert "in the plane" in text
    assert "net translation in the last period: 0.046" in text


@pytest.mark.parametrize("name", ["two_anchor_a", "slope_climber", "hill_top", "planar_three_points"])
def test_the_printed_energies_add_up(name):
    (line,) = [line for line in good("simulate", name).splitlines() if line.startswith("work ")]
    put_in, went = ([float(n) for n in re.findall(r"(-?[0-9.e-]+) J", side)] for side in line.split(" = "))
    assert sum(put_in) == pytest.approx(sum(went), rel=1e-5, abs=1e-6)
    assert ("work of the loads" in line) == (name in ("slope_climber", "hill_top"))
    assert ("lost in jumps" in line) == (name == "hill_top")
    assert "e-1" not in line.split(", residual")[0]  # what is only rounding is 0


def test_in_the_plane_only_digits_within_the_tolerance_are_printed(tmp_path):
    document = load_scene("planar_three_points").document()
    for tolerance, digits in ((1e-2, 4), (1e-4, 6)):
        scene = tmp_path / "plane.yaml"
        scene.write_text(json.dumps(document | {"tolerance": tolerance}))
        text = re.search(r"net translation in the last period: ([0-9.]+), ", good("check", str(scene)))
        assert 0 < len(text[1].removeprefix("0.")) <= digits


def test_check_asks_about_millimetres_and_milliseconds(tmp_path):
    document = load_scene("two_anchor_a").document()
    document["body"]["contacts"] = [0.0, 100.0]
    document["drive"]["period"] = 1000.0
    (tmp_path / "mm.yaml").write_text(json.dumps(document))
    text = good("check", "mm.yaml", cwd=tmp_path)
    assert "millimetres for metres? the body is 100 m long" in text
    assert "milliseconds for seconds? the drive's period is 1000 s" in text
    assert "?" not in good("check", "two_anchor_a")


def test_check_asks_about_a_slope_in_radians(tmp_path):
    document = load_scene("slope_climber").document()
    for slope, asked in ((0.087, True), (-0.087, True), (5.0, False)):
        document["ground"]["slope"] = slope
        (tmp_path / "slope.yaml").write_text(json.dumps(document))
        text = good("check", "slope.yaml", cwd=tmp_path)
        assert (f"radians for degrees? ground.slope is {slope:g} degrees; {slope:g} rad would be" in text) == asked
    document = load_scene("two_anchor_a").document()
    document["body"]["weights"] = 1.0
    document["start"] = "relaxed"
    for key, ground in (
        ("patches[0].slope", {"patches": [{"from": 0.0, "to": 1.0, "slope": 0.1}]}),
        ("profile.slope", {"profile": {"at": [0.0, 1.0], "slope": [0.0, 0.1]}}),
    ):
        (tmp_path / "slope.yaml").write_text(json.dumps(document | {"ground": ground}))
        assert f"radians for degrees? ground.{key} is 0.1 degrees" in good("check", "slope.yaml", cwd=tmp_path)


UNITS = {
    "strokes in millimetres": (
        "{contacts: [0, 0.2], links: {stiffness: 100}}, friction: {isotropic: 1}",
        "[[0], [60], [0]]",
        "millimetres for metres? the drive changes the length of link 0 by 60 m, but the body is 0.2 m long",
    ),
    "a strain in percent": (
        "{segments: [{name: trunk, from: 0, to: 0.5, stiffness: 9, friction: {isotropic: 1}, elements: 8}]}",
        "[[0], [20], [0]]",
        "millimetres for metres? the drive changes the length of segment trunk by 10 m, but the body is 0.5 m long",
    ),
    "stiffness in N/mm": (
        "{contacts: [0, 0.2], links: {stiffness: 0.1}}, friction: {isotropic: 1}",
        "[[0], [0.1], [0]]",
        "too soft or too rough: a spring must change by 10 m before contact 0 slides, but the body is 0.2 m long",
    ),
    "all in metres": (
        "{contacts: [0, 0.2], links: {stiffness: 100}}, friction: {isotropic: 1}",
        "[[0], [0.06], [0]]",
        "",
    ),
}


@pytest.mark.parametrize("name", list(UNITS))
def test_check_warns_of_lengths_far_beyond_the_body(name, tmp_path):
    body, rows, warning = UNITS[name]
    scene = tmp_path / "units.yaml"
    scene.write_text(f"{{name: units, body: {body}, drive: {{times: [0, 1, 2], period: 2, actuation: {rows}}}}}")
    text = " ".join(good("check", str(scene)).split())
    if warning:
        assert warning in text
    else:
        assert "millimetres for metres" not in text
        assert "too soft or too rough" not in text


def test_check_says_where_friction_vanishes(tmp_path):
    scene = tmp_path / "slippery.yaml"
    scene.write_text(
        "{name: slippery, body: {contacts: [0, 1], links: {stiffness: 1}}, friction: {forward: [1, 0], backward: 1}}"
    )
    assert "contact_1/forward falls to 0" in good("check", str(scene))


LOADED = """
name: loaded
body: {contacts: [0.0, 0.2], links: {stiffness: 20.0}, weights: [1.0, 2.0]}
friction: {coefficient: {forward: 0.2, backward: 0.8}}
ground: {slope: 10.0}
start: relaxed
drive: {times: [0.0, 0.5, 1.0], period: 1.0, actuation: [[0.0], [0.2], [0.0]]}
"""


CLIMB = "steepest slope at which a period still gains: "
TOW = "largest tow on contact 1 at which a period still gains: "
FRONT = {"from": 0.1, "to": 0.9, "friction": 0.5}
TENDON_BODY = {"contacts": [0.0, 1.0], "links": {"stiffness": 10.0, "tension": {"least": 0.0}}}
GRIP = {
    "forward": 0.2,
    "backward": 0.2,
    "with_elongation": [{"link": 0, "contacts": [0, 1], "elongation": [-0.2, 0.0, 0.2], "added": [1.0, 1.0, 0.0]}],
}
AT_THE_START = "the limits at rest are the sums of the friction at the start: contacts that slide before"
LIMITS = [
    (
        "slope_climber",
        {},
        CLIMB + "16.699244 degrees uphill, where it still gains 0.0521087 m, no steeper one of 33 slopes tried does",
    ),
    ("slope_climber", {}, TOW + "0.2435883 N backward, where it still gains 0.0507596 m, none beyond"),
    ("slope_climber", {"loads": 0.3}, "not searched for: the loads of the scene have no equilibrium on level ground"),
    ("slope_climber", {"drive": None}, "no drive: the crawler waits for commands"),
    ("slope_climber", {"drive": {"times": [0], "actuation": [[0.0]]}}, "a drive of one row: the crawler waits for"),
    ("two_contacts_anisotropic", {}, TOW + "0.3 N backward, where it still gains 0.065 m, none beyond"),
    ("two_contacts_anisotropic", {"friction": {"forward": 0.5, "backward": 0.2}}, TOW + "0.3 N forward, where"),
    ("two_contacts_critical", {}, TOW + "none, as the drive does not carry the body without it"),
    ("slope_climber", {}, "uphill: 38.6598 degrees; contact 0 gives way first, at 38.6598 degrees"),
    ("friction_step", {}, TOW + "0.05 N backward, where it still gains 0.0775 m, none beyond"),
    ("ice", {}, TOW + "none, as the drive does not carry the body without it"),
    ("hill_top", {}, TOW + "0.2435883 N backward, where"),
    ("hill_top", {}, "steepest slope that it holds at rest: not computed, as parts of the ground have slopes of"),
    ("hill_top", {}, "not searched for: the ground has slopes of its own"),
    (
        "two_contacts_anisotropic",
        {"body": TENDON_BODY},
        "these are limits of friction, as are the slopes: where a link",
    ),
    ("ice", {"ground": {"patches": [FRONT]}}, "at rest, on any contact: 0.3 N forward, 0.75 N backward"),
    ("ice", {}, AT_THE_START),
    ("slope_climber", {"friction": GRIP}, AT_THE_START),
    (
        "slope_climber",
        {"ground": {"patches": [FRONT]}},
        "uphill: 30.9638 degrees; contact 1 gives way first, at 21.8014",
    ),
]


def test_the_tow_that_check_searches_for_is_on_the_last_contact(monkeypatch):
    def search(scene: Scene, contact: int, *_: object) -> None:
        raise RuntimeError(f"contact {range(scene.body.contacts)[contact]}")

    monkeypatch.setattr(loads_report, "largest_tow", search)
    with pytest.raises(RuntimeError, match="contact 2"):
        print_limits(load_scene("three_contacts_one_way"), Screen(width=200))


def test_a_tow_on_a_point_of_a_segment_moves_it_at_once():
    """The friction of one element stood there, which depends on the mesh."""
    out = " ".join(good("check", "segment_climber").split())
    assert "a tow on segment trunk at 1 m alone moves it at once, however small" in out


def test_check_computes_no_limits_at_rest_of_bodies_that_turn(capsys):
    print_holding(SimpleNamespace(scene=load_scene("scissors")), Screen(width=200))
    said = "largest tow and steepest slope that it holds at rest: not computed for bodies that turn\n"
    assert capsys.readouterr().out == said


@pytest.mark.parametrize("variable", ["DISPLAY", "WAYLAND_DISPLAY"])
def test_one_display_is_enough_for_the_viewer(variable, tmp_path, monkeypatch):
    pytest.importorskip("rerun")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(variable, ":7")
    started: list[list[str]] = []
    monkeypatch.setattr(view.subprocess, "call", lambda command: started.append(command) or 3)
    (tmp_path / "x.rrd").write_bytes(b"RRF2")
    with pytest.raises(SystemExit) as left:
        main(["view", str(tmp_path / "x.rrd")])
    assert left.value.code == 3
    assert [command[1:] for command in started] == [["--bind", "127.0.0.1", str(tmp_path / "x.rrd")]]


@pytest.mark.parametrize(("name", "change", "said"), LIMITS)
def test_check_says_what_slope_and_tow_a_body_holds_and_climbs(name, change, said, tmp_path, capsys):
    (tmp_path / "s.json").write_text(json.dumps(load_scene(name).document() | change))
    with pytest.raises(SystemExit) as left:
        main(["check", str(tmp_path / "s.json")])
    assert not left.value.code
    out = " ".join(capsys.readouterr().out.split())
    assert said in out
    assert "a tow on contact 1 alone moves it first" in out


AT_A_WALL = {
    "name": "held",
    "body": {"contacts": [0.0, 0.2], "links": {"stiffness": 20.0}},
    "friction": {"forward": 0.2, "backward": 0.5},
    "ground": {"walls": [{"at": 0.2, "stops": "forward"}]},
    "drive": {"times": [0, 0.5, 1], "period": 1, "actuation": [[0], [0], [0]], "loads": [[0, 0], [0, 3], [0, 0]]},
    "loads": 0.0,
}


@pytest.mark.parametrize("contacts", [2, 3])
def test_loads_that_a_wall_holds_have_no_stasis_domain(contacts, tmp_path, capsys):
    """A set of forces that friction alone would have to hold is empty; every verb that draws it ended in a traceback."""
    document, drive = AT_A_WALL, AT_A_WALL["drive"]
    if contacts == 3:
        drive = drive | {"actuation": [[0, 0]] * 3, "loads": [[0, 0, 0], [0, 3, 0], [0, 0, 0]]}
        document = document | {"body": document["body"] | {"contacts": [0.0, 0.2, 0.4]}, "drive": drive}
        document["ground"] = {"walls": [{"at": 0.4, "stops": "forward"}]}
    (tmp_path / "s.json").write_text(json.dumps(document))
    for words in (["check"], ["check", "--json"], ["animate", "--out", str(tmp_path / "film.html")]):
        with pytest.raises(SystemExit) as left:
            main([words[0], str(tmp_path / "s.json"), *words[1:]])
        assert not left.value.code
        out = " ".join(capsys.readouterr().out.split())
        if words == ["check"]:
            assert "friction on even ground does not hold the loads: the directions of motion are not" in out
            assert f"at rest: not computed, as contact {contacts - 1} stands at wall 0, which holds any force" in out
            assert AT_THE_START not in out
    with pytest.raises(SystemExit) as left:
        main(["check", str(tmp_path / "s.json"), "--png", str(tmp_path / "s.png")])
    assert left.value.code
    assert "loads: friction on even ground does not hold them along the drive" in capsys.readouterr().err
    assert not (tmp_path / "s.png").exists()


@pytest.mark.parametrize("times", [[0, 1e-9, 2e-9, 1], [0, 3e-6, 6e-6, 1e-5]])
def test_check_sees_contacts_that_return_within_a_tick(times, tmp_path, capsys):
    """They were reported never to slide, and the drive to be too weak."""
    drive = {"times": times, "period": times[-1], "actuation": [[0], [0.1], [0], [0]]}
    document = {"name": "pulse", "body": {"contacts": [0, 0.2], "links": {"stiffness": 20.0}}, "drive": drive}
    (tmp_path / "s.json").write_text(json.dumps(document | {"friction": {"isotropic": [1.0, 0.1]}}))
    with pytest.raises(SystemExit):
        main(["check", str(tmp_path / "s.json")])
    out = " ".join(capsys.readouterr().out.split())
    assert "forward and back" in out
    assert "too weak" not in out
    assert "contacts that never slide: 0 " in out
    assert "at waypoints between ticks they may be larger" in out


@pytest.mark.parametrize(("pulse", "told"), [(0.665, False), (0.66671, True)])
def test_check_tells_where_waypoints_lie_between_ticks(pulse, told, tmp_path, capsys):
    """A short pulse reached a limit of tension, within which the link was reported to stay."""
    links = [{"stiffness": 20.0, "tension": 0.3}, {"stiffness": 20.0}]
    drive = {"times": [0, 0.6, pulse, 0.7, 2], "period": 2, "actuation": [[0, 0], [0, 0], [0.09, 0], [0, 0], [0, 0]]}
    body = {"contacts": [0.0, 0.2, 0.4], "links": links}
    document = {"name": "pulse", "body": body, "friction": {"forward": 0.2, "backward": 0.5}, "drive": drive}
    (tmp_path / "s.json").write_text(json.dumps(document))
    with pytest.raises(SystemExit):
        main(["check", str(tmp_path / "s.json")])
    assert ("at waypoints between ticks they may be larger" in " ".join(capsys.readouterr().out.split())) == told


@pytest.mark.parametrize(
    ("name", "where"),
    [
        ("ice", "stasis domain, directions and uniqueness margin hold outside the patches"),
        ("wall_pusher", "stasis domain, directions and uniqueness margin hold away from walls"),
        ("snake_over_two_grounds", "stasis domain and directions hold outside the regions"),
        ("worm_in_a_tube", "slope of the track hold, without the friction that elongations add"),
    ],
)
def test_check_tells_which_ground_a_stasis_domain_belongs_to(name, where, capsys):
    with pytest.raises(SystemExit):
        main(["check", name])
    assert where in " ".join(capsys.readouterr().out.split())


PLANAR = {
    "name": "planar",
    "dimension": 2,
    "body": {"contacts": [[0, 0], [1, 0]], "links": {"stiffness": 1.0}, "weights": [1.0, 3.0]},
    "friction": {"coefficient": {"isotropic": 0.5}},
    "ground": {"slope": 10.0, "direction": 0.5},
}
HOLDS = "steepest slope that it holds at rest: "
PLANAR_LIMITS = [
    ({}, HOLDS + "26.5651 degrees uphill in every direction"),
    ({}, "largest tow that it holds at rest, on any contact: 1.27502 N in every direction"),
    ({"loads": 0.0, "friction": {"isotropic": 1.0}}, HOLDS + "30 degrees uphill in every direction"),
    ({"loads": [[0.1, 0.0], [0.0, 0.0]]}, HOLDS + "not computed in the plane with other loads"),
    (
        {"friction": {"directions": [0.0, 2.0, 4.0], "value": 1.0}},
        "not computed in the plane for friction that depends on the direction",
    ),
]


@pytest.mark.parametrize(("change", "said"), PLANAR_LIMITS)
def test_check_says_what_a_body_in_the_plane_holds(change, said, tmp_path, capsys):
    (tmp_path / "p.json").write_text(json.dumps(PLANAR | change))
    with pytest.raises(SystemExit) as left:
        main(["check", str(tmp_path / "p.json")])
    assert not left.value.code
    assert said in " ".join(capsys.readouterr().out.split())


def test_check_says_that_a_search_was_cut_short(monkeypatch, capsys):
    monkeypatch.setattr("crawler_command.loads_report._BUDGET", 100)
    with pytest.raises(SystemExit):
        main(["check", "slope_climber"])
    out = " ".join(capsys.readouterr().out.split())
    assert "the search was cut short" in out
    monkeypatch.setattr("crawler_command.loads_report._BUDGET", 1)
    with pytest.raises(SystemExit):
        main(["check", "slope_climber"])
    assert "not searched for, because a period takes too long here" in " ".join(capsys.readouterr().out.split())


def test_check_of_a_scene_with_loads_shows_them_and_the_bounds_that_they_leave(tmp_path):
    (tmp_path / "loaded.yaml").write_text(LOADED)
    text = good("check", str(tmp_path / "loaded.yaml"), "--png", str(tmp_path / "d.png"))
    assert "forward - load [N]" in text
    assert "-0.347296" in text  # 2 sin 10
    assert "falls to 0" not in text
    assert (tmp_path / "d.png").stat().st_size > 5_000


MISTAKES = [
    (["simulate", "planar_rectilinear", "--method", "exact"], "in the plane they are curved: use catch_up"),
    (["simulate", "two_ancor_a"], "nearest is 'two_anchor_a'"),
    (["simulate", "none.yaml"], "none.yaml: no such file"),
    (["simulate", "two_anchor_a", "--png", "run.jpg"], "--png: run.jpg must end in .png"),
    (["simulate", "two_anchor_a", "--rate", "0"], "rate: 0 Hz"),
    (["simulate", "two_anchor_a", "--duration", "-1"], "duration: -1 s"),
    (["simulate", "two_anchor_a", "--method", "rk4"], "rk4"),
    (["simulate", "typo.yaml"], "body.links.stifness: unknown key; the nearest known key is 'stiffness'"),
    (["check", "typo.yaml"], "unknown key"),
    (["check", "code.yaml"], "not plain YAML"),
    (["simulate", "idle.yaml"], "the scene has no drive; set the simulated time with --duration"),
    (["simulate", "held.yaml"], "the scene has a drive of one row; set the simulated time with --duration"),
    (
        ["sweep", "held.yaml", "--vary", "friction.isotropic=1:2:3", "--out", "x.csv"],
        "held: the scene has a drive of one",
    ),
    (["animate", "held.yaml", "--out", "x.gif"], "held.yaml: the scene has a drive of one row, so nothing moves"),
    (["compare", "held.yaml", "two_anchor_a"], "held: the scene has a drive of one row; a comparison needs cycles"),
    (["view", "nothing"], "nothing: no such file or folder"),
    (["view", "."], "this machine has no display"),
    (["view", ".", "--at", "3"], "--at needs --png"),
    (["view", "text.mcap", "--png", "nodir/x.png"], "does not exist"),
    (["view", "fake.rrd", "--png", "x.png"], "fake.rrd: not a rerun recording"),
    (["check", "two_anchor_a", "--png", "x.foo"], "--png: x.foo must end in .png"),
    (
        ["simulate", "two_anchor_a", "--rate", "1e9", "--duration", "1e9"],
        "of 2 contacts do not fit in memory; at most 50000000:",
    ),
    (["simulate", "two_anchor_a", "--rate", "fast"], "Invalid value for '--rate'"),
    (["simulate"], "Missing argument"),
    (["replay", "parent"], "parent/one/one_0.mcap: not an MCAP file"),
    (["view", "text.mcap", "--png", "x.png"], "not an MCAP file"),
    (["replay", "text.mcap"], "not an MCAP file"),
    (["replay", "idle.yaml"], "idle.yaml: not an MCAP file; a scene is run by crawler simulate"),
    (["simulate", "two_anchor_a", "--duration", "2s"], "Invalid value for '--duration': it must be a number, without"),
    (["optimise", "two_anchor_a", "--waypoints", "2.5"], "Invalid value for '--waypoints': it must be a whole number"),
    (["replay", "nothing"], "nothing: no such file or folder"),
    (["nonsense"], "No such command 'nonsense'. The commands are animate, check, cite, compare, demo, "),
    (["bench", "--quick"], "No such command 'bench'. It is now: python -m benchmarks, in a checkout"),
    (["simulat"], "Did you mean 'simulate'?"),
    (["simulate", "two_anchor_a", "--two-columns"], "--two-columns needs --png: it arranges the panels of that page"),
    (["replay", "text.mcap", "--two-columns"], "--two-columns needs --png: it arranges the panels of that page"),
    (["view", "drawn.rrd", "--scene", "idle.yaml", "--png", "x.png"], "drawn.rrd is drawn already; name the recording"),
    (
        ["optimise", "two_anchor_a", "--for", "screw", "--target", "0.2;0"],
        "--target 0.2;0: write DX,DY,DYAW, for example 0.2,0,0.1",
    ),
    (
        ["sweep", "two_anchor_a", "--vary", "body.links.stiffness=1:2:3", "--scheduler", "here", "--out", "x.parquet"],
        "'here'; write tcp://host:",
    ),
    (
        ["identify", "text.mcap", "--scene", "two_anchor_a", "--fit", "friction", "--topic", "pose=x"],
        "--topic pose=x: write NAME=RECORDED with NAME one of",
    ),
    (["simulate", "nonsense"], "nonsense: no such file, nor a scene of the gallery; there are "),
]


@pytest.mark.parametrize(("arguments", "said"), MISTAKES)
def test_a_mistake_is_one_clear_line(arguments, said, tmp_path):
    (tmp_path / "typo.yaml").write_text(
        "{name: x, body: {contacts: [0, 1], links: {stifness: 1}}, friction: {isotropic: 1}}"
    )
    (tmp_path / "code.yaml").write_text("name: !!python/object/apply:os.system [echo]")
    idle = "name: held, body: {contacts: [0, 1], links: {stiffness: 1}}, friction: {isotropic: 1}"
    (tmp_path / "idle.yaml").write_text(f"{{{idle}}}")
    (tmp_path / "held.yaml").write_text(f"{{{idle}, drive: {{times: [0], actuation: [[0.1]]}}}}")
    (tmp_path / "text.mcap").write_text("hello")
    (tmp_path / "drawn.rrd").write_bytes(b"RRF2")
    (tmp_path / "fake.rrd").write_text("hello")
    (tmp_path / "parent" / "one").mkdir(parents=True)
    (tmp_path / "parent" / "one" / "one_0.mcap").write_text("hello")
    text = bad(*arguments, cwd=tmp_path)
    assert said in " ".join(text.split())
    assert text.startswith("crawler: ")
    assert len(text.splitlines()) == 1


def test_nothing_of_ros_is_needed_for_the_model():
    code = "import sys; sys.modules['rclpy'] = None; sys.argv = ['crawler', 'scenes']; from crawler_command.app import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0
    code = code.replace("'scenes'", "'demo'")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert "rclpy is not installed; install with: pip install 'crawler-ros[ros]'" in done.stderr


def test_a_limit_of_the_address_space_that_compiling_would_exceed_is_one_line(tmp_path):
    """The compiler itself would end the process: std::bad_alloc."""
    code = (
        "import resource, sys; import crawler_model.compiled; from crawler_command.app import main; "
        "pages = int(open('/proc/self/statm').read().split()[0]); "
        "resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + (300 << 20),) * 2); "
        "main(['simulate', 'two_anchor_a'])"
    )
    empty = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    empty.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=empty)
    assert done.returncode == 1
    assert done.stderr.startswith("crawler: the address space is limited and has ")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("flags", [(), ("--json",)])
def test_a_run_that_is_not_exact_is_an_error_behind_its_numbers(tmp_path, flags):
    """A force of 1e16 N/m in a body whose springs hold 0.4 N leaves no digits."""
    scene = tmp_path / "strong.yaml"
    trunk = "{name: trunk, from: 0, to: 1, stiffness: 1, friction: {forward: 0.1, backward: 1.0e+16}, elements: 20}"
    drive = "{times: [0, 0.5, 1], period: 1, actuation: [[0], [0.4], [0]]}"
    scene.write_text(f"name: strong\nbody: {{segments: [{trunk}]}}\ndrive: {drive}\n")
    done = crawler("simulate", scene, "--duration", "2", *flags)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "strong: the result is not exact: the energy balance is off by" in done.stderr
    assert "forces or stiffnesses of the scene are too far apart" in done.stderr
    assert done.stdout


def test_without_any_friction_the_error_is_that_nothing_holds_the_body(tmp_path):
    scene = tmp_path / "frictionless.yaml"
    drive = "{times: [0, 1, 2], period: 2, actuation: [[0, 0], [0.05, 0], [0, 0]]}"
    body = "{contacts: [0.0, 0.1, 0.2], links: {stiffness: 20.0}}"
    scene.write_text(f"name: frictionless\nbody: {body}\nfriction: {{forward: 0, backward: 0}}\ndrive: {drive}\n")
    message = bad("simulate", scene)
    assert "no contact has friction, so that nothing determines where the body is" in message
    assert "too far apart" not in message


def name_scene(file: Path, name: str) -> str:
    file.write_text(json.dumps(load_scene("two_anchor_a").document() | {"name": name}))
    return str(file)


@pytest.mark.parametrize("name", ["worm [a]", "worm [/b]", "[yellow]worm"])
def test_names_with_brackets_are_printed_as_they_are(tmp_path, name):
    file = name_scene(tmp_path / "[w].json", name)
    for verb in ("check", "simulate"):
        assert name.removeprefix("[yellow]") in good(verb, file)
    assert "control characters" in bad("check", name_scene(tmp_path / "other.json", "a\nb"))


def test_the_end_of_a_file_is_not_taken_for_ctrl_c(monkeypatch):
    """typer ends in the same way after both."""

    def read_an_empty_file():
        pickle.loads(b"")

    monkeypatch.setattr("crawler_model.gallery", read_an_empty_file)
    done = crawler("scenes")
    assert done.returncode == 1
    assert done.stderr.split("\n") == ["", "crawler: a file or a stream has ended unexpectedly: Ran out of input", ""]


def test_a_command_outlives_a_damaged_cache_and_heals_it(tmp_path):
    words = ["simulate", "two_anchor_a", "--duration", "0.1"]
    assert crawler(*words).returncode == 0  # its kernels are there
    folder = folder_of_kernels()
    shutil.copytree(folder, tmp_path / "crawler" / "kernels" / folder.name)
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    environment.pop("NUMBA_CACHE_DIR", None)
    damaged = [*tmp_path.rglob("path.*.nbi"), *tmp_path.rglob("follow.*.nbc")]
    assert len(damaged) > 2
    for k, file in enumerate(damaged):
        file.write_bytes(file.read_bytes()[: -k % 3 * 100])
    said = []
    for _ in range(2):
        command = [sys.executable, "-m", "crawler_command.app", *words]
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
        assert done.returncode == 0, done.stderr
        said.append(done.stderr)
    assert [text.count("compiling the kernels") for text in said] == [1, 0]


def test_warm_refuses_a_folder_that_keeps_nothing(tmp_path):
    (tmp_path / "crawler").write_text("")
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "NUMBA_OPT": "0"}
    environment.pop("NUMBA_CACHE_DIR", None)
    words = [sys.executable, "-m", "crawler_command.app", "warm"]
    done = subprocess.run(words, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stdout) == (1, "")
    *_, last = done.stderr.splitlines()
    assert last.startswith(f"crawler: compiled kernels cannot be kept in {tmp_path}/crawler/kernels/")
    assert done.stderr.count("\n") == 2  # the other one announces what is compiled
