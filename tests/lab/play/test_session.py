"""A crawler in the hands of a person: exact, and every instant can be returned to, saved and sent."""

from __future__ import annotations

import base64
import json
import zlib
from pathlib import Path

import numpy as np
import pytest

import crawler_lab.play
from crawler_lab.play.export import KEPT, write_scene
from crawler_lab.play.lessons import read_lessons
from crawler_lab.play.session import MOST_TICKS, Session
from crawler_lab.play.simulated import Simulated
from crawler_model import CommandError, Crawler, Scene, load_scene, simulate
from crawler_ros.replay import simulate_again

SCENES = (
    "two_anchor_a",
    "ten_contact_wave",
    "payload_climber",
    "ice",
    "hybrid_body",
    "stalling_inchworm",
    "planar_rectilinear",
    "steering_inchworm",
)


def play(name: str) -> Session:
    """The scene's drive, then a wave, then the hand on every control."""
    session = Session(load_scene(name))
    for _ in range(60):
        session.step()
    session.change({"mode": "wave", "wave": {"phase": 0.25}})
    for _ in range(7):
        session.step()
    session.change({"mode": "hand"})
    for k, control in enumerate(session.controls.controls.values()):
        value = session.controls.values(session.settings, session.tick.base)[k]
        session.change({"set": {control.name: 0.97 * value}})
    return session


def test_a_slider_moves_the_body_by_the_exact_amount():
    session = Session(load_scene("two_contacts_anisotropic"))
    crawler = Crawler(load_scene("two_contacts_anisotropic"))
    session.change({"mode": "hand"})
    for length in (0.03, 0.07, -0.02):
        session.change({"set": {"link_0": length}})
        crawler.advance([length])
        assert session.crawler.displacement.tobytes() == crawler.displacement.tobytes()
    # the front contact slides once k L > mu_plus: by L - mu_plus/k each time the link has grown to a new length
    assert crawler.displacement[1] == pytest.approx(0.07 - 0.2 / 20.0)


def test_the_drive_of_the_scene_moves_the_body_as_simulate_does():
    scene = load_scene("three_contacts_two_ways")
    session = Session(scene)
    for _ in range(250):
        session.step()
    assert session.crawler.displacement.tobytes() == simulate(scene, 2.5).displacement[-1].tobytes()


@pytest.mark.parametrize("name", SCENES)
def test_any_instant_can_be_returned_to(name):
    session = play(name)
    last, known = session.now, [session.crawler.copy()]
    states = {}
    for tick in (last - 3, 0, 61, last):
        session.seek(tick)
        states[tick] = session.crawler.copy()
    assert session.crawler == known[0]
    assert states[0] == Crawler(session.scene)
    session.seek(61)
    assert session.crawler == states[61]
    assert session.settings.mode == "wave"


def test_what_was_undone_is_forgotten_only_by_a_new_tick():
    session = Session(load_scene("two_anchor_a"))
    session.change({"mode": "hand"})
    session.change({"set": {"link_0": 1.0}})
    session.change({"set": {"link_0": 3.0}})
    session.undo()
    assert (session.now, session.settings.hand[0]) == (1, 1.0)
    session.seek(2)
    assert session.settings.hand[0] == 3.0
    session.undo()
    session.change({"set": {"link_0": 2.0}})
    assert len(session.ticks) == 3
    session.undo()
    session.undo()
    assert session.crawler == Crawler(session.scene)


@pytest.mark.parametrize("steps", [0, 1, 2, 3])
def test_a_change_is_undone_with_all_ticks_that_followed_it(steps):
    session = Session(load_scene("two_anchor_a"))
    session.change({"mode": "hand"})
    for length in (1.0, 3.0):
        session.change({"set": {"link_0": length}})
        for _ in range(steps):
            session.step()
    assert session.now == 2 * (1 + steps)
    session.undo()
    assert (session.now, session.settings.hand[0]) == (1 + steps, 1.0)
    session.undo()
    assert session.now == 0


@pytest.mark.parametrize("name", SCENES)
def test_a_link_reproduces_the_state_to_the_bit(name):
    session = play(name)
    other = Session(load_scene(name))
    other.restore(session.encode())
    assert other.crawler == session.crawler
    assert other.settings == session.settings


def test_a_damaged_link_or_one_of_another_scene_is_refused():
    session, code = Session(load_scene("two_anchor_a")), Session(load_scene("two_anchor_b")).encode()
    with pytest.raises(CommandError, match="link: it belongs to another scene than two_anchor_a"):
        session.restore(code)
    huge = base64.urlsafe_b64encode(zlib.compress(b'{"ticks": 1e999, "changes": []}')).decode()
    for damaged in (code[:10], "", "%%", "e30", huge):
        with pytest.raises(CommandError, match="link: it is damaged"):
            session.restore(damaged)
    with pytest.raises(CommandError, match="link: 0 ticks at 100 Hz; this session runs at 50 Hz: use --rate 100"):
        Session(load_scene("two_anchor_b"), 50.0).restore(code)


@pytest.mark.parametrize(
    "change", [[3, "hand", [1.0], [], 0.0], [3, "hand", {"9": 1.0}, [], 0.0], [3, "fast", {}, [], 0.0], [3], None]
)
def test_a_link_that_is_refused_halfway_leaves_the_session_as_it_was(change):
    session = play("two_anchor_a")
    told = json.loads(zlib.decompress(base64.urlsafe_b64decode(session.encode() + "==")))
    link = base64.urlsafe_b64encode(zlib.compress(json.dumps(told | {"ticks": 5, "changes": [change]}).encode()))
    before = session.crawler.copy(), session.now, len(session.ticks), session.settings
    with pytest.raises(CommandError):
        session.restore(link.decode().rstrip("="))
    assert (session.crawler, session.now, len(session.ticks), session.settings) == before
    session.step()


@pytest.mark.parametrize("name", SCENES)
def test_a_saved_scene_simulates_to_the_same_displacement(name, tmp_path):
    session = play(name)
    KEPT["scene.yaml"](session, tmp_path / "found.yaml")
    run = simulate(load_scene(str(tmp_path / "found.yaml")))
    if session.scene.dimension == 1:
        assert run.displacement[-1].tobytes() == session.crawler.displacement.tobytes()
    assert run.displacement[-1] == pytest.approx(session.crawler.displacement, abs=1e-12)
    assert run.ticks == session.now


@pytest.mark.parametrize("name", ["three_link_snake", "tripedal_star", "planar_rectilinear"])
@pytest.mark.parametrize("ticks", [1, 30])
def test_a_saved_scene_of_small_strokes_is_as_accurate_as_the_session(name, ticks):
    """The tolerance of a scene is relative to the largest change of length that its drive commands."""
    session = Session(load_scene(name))
    for _ in range(ticks):
        session.step()
    run = simulate(write_scene(session))
    assert run.displacement[-1] == pytest.approx(session.crawler.displacement, abs=1e-12)
    session.seek(0)
    session.change({"mode": "hand"})
    slider = next(iter(session.controls.controls))
    session.change({"set": {slider: session.controls.values(session.settings, session.tick.base)[0] + 1e-5}})
    assert write_scene(session).tolerance <= 0.5


@pytest.mark.parametrize("name", SCENES)
def test_a_saved_recording_replays_to_the_bit(name, tmp_path):
    pytest.importorskip("mcap")
    session = play(name)
    KEPT["recording.mcap"](session, tmp_path / "found.mcap")
    replayed = simulate_again(tmp_path / "found.mcap")
    assert replayed.identical
    assert replayed.ticks == session.now + 1


def test_a_recording_of_ticks_of_uneven_nanoseconds_replays_to_the_bit(tmp_path):
    pytest.importorskip("mcap")
    session = Session(load_scene("two_anchor_a"), 30.0)
    for _ in range(40):
        session.step()
    KEPT["recording.mcap"](session, tmp_path / "found.mcap")
    assert simulate_again(tmp_path / "found.mcap").identical


@pytest.mark.parametrize("name", ["two_anchor_b", "two_anchor_c", "tow"])
def test_what_the_drive_commands_is_kept_though_it_stayed_as_it_began(name):
    """The hand moves only the link, from friction or loads that the drive commands, unlike the scene's."""
    drive = {"times": [0, 1, 2], "period": 2, "actuation": [[0], [0.1], [0]], "loads": [[0.15, 0], [0, 0], [0.15, 0]]}
    body = {"contacts": [0.0, 0.2], "links": {"stiffness": 20.0}}
    tow = {"name": "tow", "body": body, "friction": {"forward": 0.2, "backward": 0.8}, "drive": drive}
    session = Session(Scene.model_validate(tow) if name == "tow" else load_scene(name))
    session.change({"mode": "hand"})
    session.change({"set": {"link_0": 0.4}})
    session.step()
    found = write_scene(session)
    assert found.drive.rows[-1].tolist() == session.ticks[-1].rows[-1].tolist()
    assert found.drive.rows[-1][1:].tolist() == session.scene.drive.rows[0][1:].tolist()


def test_a_long_drive_is_kept_as_a_file_that_is_read(tmp_path):
    session = Session(load_scene("ten_contact_wave"))
    session.change({"mode": "wave"})
    for _ in range(6_000):
        session.step()
    KEPT["scene.yaml"](session, tmp_path / "long.yaml")
    found = load_scene(str(tmp_path / "long.yaml"))
    assert found.drive.times.size > 5_000
    assert json.loads((tmp_path / "long.yaml").read_text())["name"] == "ten_contact_wave_by_hand"


def test_what_cannot_be_kept_is_refused_with_the_reason(tmp_path):
    session = Session(load_scene("peristaltic_segment"))
    with pytest.raises(CommandError, match="save: nothing has happened yet"):
        write_scene(session)
    session.step()
    with pytest.raises(CommandError, match="save: the commands vary along a segment"):
        write_scene(session)
    session = Session(load_scene("two_anchor_a"))
    session.step()
    with pytest.raises(CommandError, match=r"save: 0\.01 s are too short for a film; play 0\.04 s or more"):
        KEPT["film.html"](session, tmp_path / "film.html")


def test_a_wave_moves_each_link_by_the_formula_of_scenes():
    scene = load_scene("ten_contact_wave")
    session = Session(scene)
    session.change({"mode": "wave", "wave": {"amplitude": 0.02, "mean": 0.01, "period": 2.0}})
    for _ in range(50):
        session.step()
    middle = (scene.body.position[1:] + scene.body.position[:-1]) / 2
    wavelength = session.settings.wave.wavelength
    expected = 0.01 + 0.02 * np.sin(2.0 * np.pi * (0.25 - middle / wavelength))
    np.testing.assert_allclose(session.crawler.actuation, expected, rtol=1e-12)


@pytest.mark.parametrize("name", ["steering_inchworm", "three_link_snake", "scissors", "tripedal_star"])
def test_the_first_wave_moves_bodies_that_turn(name):
    """Joints of a box whose links lead, and of a hub, all alike, moved nothing."""
    session = Session(load_scene(name))
    session.change({"mode": "wave"})
    for _ in range(50):
        session.step()
    assert np.abs(session.crawler.displacement).max() > 0.1


def test_a_slope_by_hand_acts_as_that_of_a_scene():
    document = load_scene("payload_climber").document()
    document["loads"] = 0.0
    session = Session(Scene.model_validate(document))
    session.change({"mode": "hand"})
    session.change({"set": {"slope": 8.0}})
    steeper = Crawler(Scene.model_validate({**document, "ground": {"slope": 8.0}}))
    np.testing.assert_allclose(session.crawler.loads, steeper.loads, rtol=1e-12)
    np.testing.assert_allclose(session.crawler.friction, steeper.friction, rtol=1e-12)


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        ({"set": {"link_7": 1.0}}, "link_7: no such control; the controls are link_0"),
        ({"set": {"link_0": "far"}}, "link_0: 'far'; it must be a finite number"),
        ({"set": {"link_0": float("nan")}}, "link_0: nan; it must be a finite number"),
        ({"set": {"link_0": 1e200}}, r"link_0: 1e\+200; it must be at most 1e\+100 in size"),
        ({"set": {"link_0": -1e200}}, r"link_0: -1e\+200; it must be at most 1e\+100 in size"),
        ({"set": {"contact_0/forward": -1.0}}, "contact_0/forward: -1 N; friction must be >= 0"),
        ({"set": {"slope": 80.0}}, "slope: 80 degrees; it must be between -60 and 60"),
        ({"set": {"slope": 60.0}}, "command: the loads sum to .* N backward, but friction"),
        ({"mode": "foot"}, "mode: 'foot'; it must be one of hand, scene, wave"),
        ({"wave": {"period": 0.0}}, "wave period: 0; it must be > 0"),
        ({"wave": {"length": 1.0}}, "wave: length; a wave has amplitude"),
        ({"set": 3}, "set: 3; it must be a mapping of numbers by name"),
    ],
)
def test_bad_settings_are_refused_in_one_line_and_change_nothing(message, complaint):
    session = Session(load_scene("payload_climber"))
    session.change({"mode": "hand"})
    session.change({"set": {"link_0": 0.05}})
    before, settings = session.crawler.copy(), session.settings
    with pytest.raises(CommandError, match=complaint):
        session.change(message)
    assert session.crawler == before
    assert session.settings == settings


def test_a_crawler_that_cannot_go_on_pauses_and_tells_why():
    session = Session(load_scene("payload_climber"))
    session.change({"mode": "hand"})
    session.playing = True
    session.change({"set": {"slope": 60.0}})
    while session.playing:
        session.run(0.1)
    assert "no equilibrium" in session.error
    assert session.settings.slope == pytest.approx(5.0)


@pytest.mark.parametrize("lesson", read_lessons().values(), ids=read_lessons())
def test_lessons_open_at_their_instant(lesson):
    session = Session(load_scene(lesson.scene))
    session.restore(lesson.state)
    assert session.now > 0
    assert len(lesson.steps) >= 4
    assert all(text.endswith((".", ":")) and not set(text) & set("`[]") for text in (lesson.text, *lesson.steps))


def test_there_are_six_lessons_and_none_is_forgotten():
    pages = (Path(crawler_lab.play.__file__).parent / "lessons").iterdir()
    assert {name.partition(":")[0] for name in read_lessons()} == {page.stem for page in pages}
    assert len({lesson.text for lesson in read_lessons().values()}) == 6


def test_a_session_ends_where_its_memory_ends(monkeypatch):
    monkeypatch.setattr("crawler_lab.play.session.MOST_TICKS", 3)
    session = Session(load_scene("two_anchor_a"))
    for _ in range(3):
        session.step()
    with pytest.raises(CommandError, match="3 ticks are remembered at most"):
        session.step()
    assert MOST_TICKS == 360_000


@pytest.mark.parametrize(
    "name", ["three_contacts_two_ways", "continuous_segment", "planar_rectilinear", "steering_inchworm"]
)
def test_what_is_dragged_grows_by_the_way_of_the_pointer(name):
    robot = Simulated(load_scene(name))
    for names, reach in robot.controls.grips():
        if names:
            before = np.array(robot.frame()["lengths"])
            robot.receive({"mode": "hand", "set": {names[0]: 0.0625 / reach}})
            assert sum(robot.frame()["lengths"]) - before.sum() == pytest.approx(0.0625, rel=1e-12)
            robot.receive({"set": {names[0]: 0.0}})
    rods = [not names for names, _ in robot.controls.grips()]
    assert rods == ([False, False, True, True] if name == "steering_inchworm" else [False] * len(rods))
