"""Films: frames compared with pictures that were looked at, files read back, and the arrays from which they are
drawn."""

from __future__ import annotations

import base64
import json
import re
import runpy
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from PIL import Image, ImageSequence

from crawler_command.app import main
from crawler_command.screen import whole_file
from crawler_command.view import animate
from crawler_model import Scene, load_scene, simulate
from crawler_model.body.drive import NS
from crawler_model.theory.stasis import is_in_stasis
from crawler_pictures.colors import WALL, rgb
from crawler_pictures.film import encode
from crawler_pictures.film.camera import pan_camera
from crawler_pictures.film.encode import write_gif, write_mp4
from crawler_pictures.film.film import Film, film_of_run, frame_times
from crawler_pictures.film.moving_set import moving_set
from crawler_pictures.film.pixels import Clock
from crawler_pictures.film.player import write_html
from crawler_pictures.film.stage import TALK_SIZE, Stage

from ...golden_pictures import differences, read_figure
from ...lab.play.pages import browsing
from ...pages import ROOT
from ...recordings import hold, messages, play, record, write
from ...scenes import wave_scene

GOLDEN = Path(__file__).parent.parent.parent / "golden"
TOLERANCE = 8.0
"""Of 255, as for the pages of replays."""
INSTANTS = {
    "two_anchor_a": 2.4,
    "three_contacts_two_ways": 1.6,
    "ten_contact_wave": 2.4,
    "hybrid_body": 2.6,
    "planar_three_points": 2.4,
    "tendon_worm": 2.0,
    "stalling_inchworm": 1.0,
}


def film_of(name: str, seconds: float = 3.0, fps: float = 25.0) -> Film:
    scene = load_scene(name)
    return film_of_run(scene, simulate(scene, seconds, fps)).sample(frame_times(0.0, seconds, fps, 1.0))


def distance(drawn: np.ndarray, golden: Path) -> float:
    """Root mean square of the difference of both pictures, made small."""
    wanted = Image.open(golden).convert("RGB")
    made = Image.fromarray(drawn).resize(wanted.size, Image.Resampling.BOX)
    small = [np.asarray(picture.reduce(4), dtype=float) for picture in (made, wanted)]
    return float(np.sqrt(np.mean((small[0] - small[1]) ** 2)))


@pytest.fixture(scope="module")
def films():
    return {name: film_of(name) for name in INSTANTS}


@pytest.mark.parametrize("name", INSTANTS)
def test_a_frame_is_the_one_that_was_looked_at(films, name):
    stage, at = Stage(films[name]), INSTANTS[name]
    wanted = GOLDEN / f"film_{name}.png"
    stage.draw(0)  # nothing of an earlier frame remains
    assert distance(stage.draw(round(at * 25)), wanted) < TOLERANCE
    other = GOLDEN / f"film_{'ten_contact_wave' if name != 'ten_contact_wave' else 'two_anchor_a'}.png"
    assert distance(stage.draw(round(at * 25)), other) > 2.0 * TOLERANCE


def many_contacts() -> Film:
    scene = wave_scene(1_000, 20.0)
    return film_of_run(scene, simulate(scene, 0.4, 25.0))


@pytest.mark.parametrize("name", [*INSTANTS, "tripedal_star", "slope_climber", "many_contacts"])
def test_the_words_and_curves_of_a_frame_are_those_that_were_read(films, name):
    film = many_contacts() if name == "many_contacts" else films[name] if name in films else film_of(name, 1.0)
    stage = Stage(film)
    for k in (0, min(round(INSTANTS.get(name, 0.4) * 25), film.time.size - 1)):
        stage.draw(k)
    assert not differences(read_figure(stage._figure), GOLDEN / f"film_{name}.txt")


@pytest.mark.parametrize(("slope", "proportion"), [(-2.0, 1.0), (30.0, None)])
def test_the_body_stands_on_a_slope_in_true_proportion_while_there_is_room(slope, proportion):
    plain = load_scene("slope_climber").document()
    plain["ground"] = {"slope": slope}
    plain["friction"] = {"forward": 2.0, "backward": 8.0}
    scene = Scene.model_validate(plain)
    film = film_of_run(scene, simulate(scene, 0.4, 25.0))
    stage = Stage(film)
    stage.draw(5)
    (panel, *_) = stage._panels
    axes = panel._axes
    rear, front = (axes.transData.transform(point) for point in panel_points(panel))
    (across, up), height = front - rear, axes.get_window_extent().height
    if proportion is not None:
        assert up / across == pytest.approx(proportion * np.tan(np.radians(slope)))
    assert 0.0 < np.sign(slope) * up < 0.5 * height
    assert film.place[5, 0] < film.place[5, 1]


def panel_points(panel) -> list[tuple[float, float]]:
    return sorted(point for dots in panel._dots.values() for point in zip(*dots.get_data(), strict=True))


def test_links_that_keep_their_length_are_drawn_as_rods():
    film = film_of("steering_inchworm", 1.0)
    stage = Stage(film)
    stage.draw(10)
    (panel, *_) = stage._panels
    rods = np.array(panel._rods.get_data()).T.reshape(2, -1, 2)  # of four links, two are actuators
    ends = np.stack((rods[:, 0], rods[:, 3]), axis=1)
    np.testing.assert_allclose(ends, film.place[10][[[0, 1], [2, 3]]])


@pytest.mark.parametrize("name", ["hill_top", "steering_inchworm"])
def test_the_gallery_has_the_pictures_that_its_program_draws(name, tmp_path):
    program = runpy.run_path(str(ROOT / "docs" / "bodies.py"))
    program["draw"](name, tmp_path / "x.png")
    drawn = np.asarray(Image.open(tmp_path / "x.png").convert("RGB"))
    assert distance(drawn, program["FOLDER"] / f"{name}.png") < TOLERANCE


@pytest.mark.parametrize(("fps", "shown"), [(2.0, "t = 0.5 s"), (25.0, "t = 0.04 s"), (400.0, "t = 0.003 s")])
def test_the_clock_has_as_many_decimals_as_tell_frames_apart(fps, shown, monkeypatch):
    written: list[str] = []
    monkeypatch.setattr(Clock, "write", lambda clock, picture, text: written.append(text))
    Stage(film_of("two_anchor_a", 2.0 / fps, fps)).draw(1)
    assert written == [shown]


def test_an_mp4_has_every_frame_in_order(films, tmp_path):
    av = pytest.importorskip("av")
    film = films["two_anchor_a"].sample(frame_times(0.0, 0.4, 25.0, 1.0))
    write_mp4(film, tmp_path / "x.mp4", 25.0, lambda part: None)
    with av.open(str(tmp_path / "x.mp4")) as container:
        (stream,) = container.streams
        assert (stream.codec_context.name, stream.average_rate, stream.width, stream.height) == ("h264", 25, 1280, 720)
        shown = [frame.to_ndarray(format="rgb24").astype(int) for frame in container.decode(stream)]
    assert len(shown) == film.time.size == 11
    stage = Stage(film)
    for k in (0, 5, 10):
        errors = [np.abs(picture - stage.draw(k)).mean() for picture in shown]
        assert int(np.argmin(errors)) == k


@pytest.mark.parametrize("name", ["three_contacts_two_ways", "ten_contact_wave", "planar_three_points"])
def test_a_film_for_a_talk_fills_a_screen_with_letters_of_twenty_pixels(films, name, tmp_path):
    from matplotlib.text import Text

    av = pytest.importorskip("av")
    film = films[name].sample(frame_times(1.0, 1.2, 10.0, 1.0))
    write_mp4(film, tmp_path / "x.mp4", 10.0, lambda part: None, talk=True)
    with av.open(str(tmp_path / "x.mp4")) as container:
        shown = [frame.to_ndarray(format="rgb24").shape for frame in container.decode(container.streams[0])]
    assert shown == [(1080, 1920, 3)] * 3
    stage = Stage(film, *TALK_SIZE, talk=True)
    stage.draw(1)
    figure = stage._figure
    texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
    assert min(text.get_fontsize() * figure.dpi / 72.0 for text in texts) >= 20.0 - 1e-9
    boxes = [text.get_window_extent() for axes in figure.axes for text in (axes.title, axes._left_title)]
    assert all(0.0 <= box.x0 <= box.x1 <= 1920.0 for box in boxes)
    assert len(stage._panels) + len(stage._spans) == (1 if film.planar else 2)  # the body, and its set or its contacts


def test_a_gif_shows_every_frame_for_its_time(films, tmp_path):
    film = films["three_contacts_two_ways"].sample(frame_times(0.0, 1.0, 30.0, 1.0))
    write_gif(film, tmp_path / "x.gif", 30.0, lambda part: None)
    image = Image.open(tmp_path / "x.gif")
    assert image.size == (960, 540)
    assert image.info["loop"] == 0
    shown = [frame.convert("RGB") for frame in ImageSequence.Iterator(image)]
    assert len(shown) == film.time.size == 31
    durations = [frame.info["duration"] for frame in ImageSequence.Iterator(image)]
    assert sum(durations) == pytest.approx(1000 * 31 / 30, abs=6)
    stage = Stage(film, 960, 540)
    for k in (0, 15, 30):
        assert np.abs(np.asarray(shown[k]).astype(int) - stage.draw(k)).mean() < 1.0


def test_a_gif_has_the_colors_of_all_frames(tmp_path):
    """Its palette must not come from a single frame, as from the last one, where nothing is left to come and pale."""
    film = film_of("heterogeneous_segment")
    write_gif(film, tmp_path / "x.gif", 25.0, lambda part: None)
    shown = [np.array(frame.convert("RGB")) for frame in ImageSequence.Iterator(Image.open(tmp_path / "x.gif"))]
    stage = Stage(film, 960, 540)
    for k in range(0, len(shown), 10):
        far = (np.abs(shown[k].astype(int) - stage.draw(k)) > 24).any(axis=2)
        assert far.mean() < 1e-4


def read_page(file: Path) -> tuple[str, dict]:
    text = file.read_text(encoding="utf-8")
    (data,) = re.findall(r'<script id="data" type="application/json">(.*?)</script>', text, re.DOTALL)
    return text.replace(data, ""), json.loads(data)


def unpack(text: str, kind: str = "<f4") -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def test_numbers_along_the_axes_of_a_page_have_room(tmp_path):
    write_html(film_of("two_anchor_a", 0.2), tmp_path / "x.html", 25.0, lambda part: None)
    with browsing() as browser:
        page = browser.new_page()
        page.goto((tmp_path / "x.html").as_uri())
        small, usual = page.evaluate(
            "[ticks(-6e-6, 5e-6, 4), ticks(-0.006, 0.005, 4)].map(all => all.map(one => one[1]))"
        )
    assert small == ["-5e-6", "0", "5e-6"]
    assert usual == ["-0.005", "0.000", "0.005"]


@pytest.mark.parametrize("name", INSTANTS)
def test_a_page_holds_the_run_and_needs_no_network(films, name, tmp_path):
    film = films[name]
    write_html(film, tmp_path / "x.html", 25.0, lambda part: None)
    page, data = read_page(tmp_path / "x.html")
    assert not re.search(r"https?:|src=|@import|fetch\(", page)
    assert np.allclose(unpack(data["time"], "<f8"), film.time)
    assert np.allclose(unpack(data["place"]).reshape(film.place.shape), film.place, rtol=1e-6, atol=1e-7)
    assert np.array_equal(unpack(data["state"], "i1").reshape(film.state.shape), film.state)
    assert data["planar"] == film.planar
    bends, counts = film.scene.body.bends, len(film.names) in (2, 3)
    assert (data["set"] is not None) == (counts and not film.planar and not bends)
    assert (data["yields"] is not None) == (len(bends) > 0)
    if bends:
        assert np.array_equal(unpack(data["yields"], "i1").reshape(film.yields.shape), film.yields)
    if film.planar:
        left, low, right, high = data["window"]
        assert (right - left) / (high - low) == pytest.approx(1.2)
        assert len(unpack(data["kymograph"]["state"], "i1")) == data["kymograph"]["rows"] * data["kymograph"]["columns"]


@pytest.mark.parametrize(("name", "state", "share"), [("tendon_worm", -1, 0.26), ("stalling_inchworm", 1, 0.64)])
def test_a_slack_tendon_and_a_stalled_link_are_drawn_as_such(films, name, state, share):
    film = films[name]
    assert set(np.unique(film.yields)) == {0, state}
    stage = Stage(film)
    height, width = stage.size[::-1]
    stalled = [np.array([0xE6, 0x00, 0x7E]), np.array([0x20, 0x20, 0x20])]
    found = []
    for k in (0, int(np.flatnonzero(film.yields[:, 0] == state)[0])):
        body = stage.draw(k)[int(0.1 * height) : int(0.3 * height), : int(0.95 * width)].astype(int)
        found.append([int((np.abs(body - color).max(axis=2) < 40).sum()) for color in stalled])
    (magenta_before, dark_before), (magenta, dark) = found
    assert magenta_before == 0
    assert (magenta > 300) == (state > 0)
    assert dark < 0.6 * dark_before  # no dark coil is left, only the outlines of contacts
    late = film_of(name, 6.0)  # the second and third period
    assert (late.yields[50:] == state).mean() == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize(("name", "count"), [("tripedal_star", 3), ("planar_three_points", 0)])
def test_a_page_draws_the_frames_of_friction_of_bodies_that_turn(name, count, tmp_path):
    """A hub without friction has no frame; each foot has a stroke forward and one half as long to each side."""
    film = film_of(name, 1.0)
    write_html(film, tmp_path / "x.html", 25.0, lambda part: None)
    page, data = read_page(tmp_path / "x.html")
    if count == 0:
        assert data["strokes"] is None
        return
    ends = unpack(data["strokes"]["ends"]).reshape(film.time.size, 2, count, 2, 2)
    forward, across = np.linalg.norm(ends[..., 1, :] - ends[..., 0, :], axis=-1).transpose(1, 0, 2)
    assert forward == pytest.approx(forward[0, 0], rel=1e-4)
    assert across == pytest.approx(forward, rel=1e-4)
    feet = film.place[:, film.scene.body.share > 0.0]
    assert ends[:, 0, :, 0] == pytest.approx(feet, abs=1e-6)
    assert ends[:, 1].mean(axis=2) == pytest.approx(feet, abs=1e-6)
    assert page.count("film.strokes.words") == 1


def test_films_show_ground_that_changes_and_walls(tmp_path):
    pushing, leaving = film_of("wall_pusher", 4.0), film_of("leaving_ice", 6.0)
    picture = Stage(pushing).draw(90).astype(int)
    assert int((np.abs(picture - rgb(WALL)).max(axis=2) < 6).sum()) > 1000
    picture = Stage(leaving).draw(100)
    row = picture[int(0.33 * picture.shape[0])]  # in the ground
    assert len(np.unique(row, axis=0)) > 20
    write_html(pushing, tmp_path / "w.html", 25.0, lambda part: None)
    assert read_page(tmp_path / "w.html")[1]["walls"] == [[0.5, True]]
    write_html(leaving, tmp_path / "l.html", 25.0, lambda part: None)
    ground = read_page(tmp_path / "l.html")[1]["ground"]
    assert [len(section["colors"]) for section in ground] == [1, 48, 1]


def test_a_page_of_many_contacts_names_how_many_it_draws(tmp_path):
    scene = wave_scene(1_000, 20.0)
    film = film_of_run(scene, simulate(scene, 0.2, 25.0))
    write_html(film, tmp_path / "x.html", 25.0, lambda part: None)
    _, data = read_page(tmp_path / "x.html")
    assert (data["contacts"], len(data["names"])) == (1000, 400)
    assert data["kymograph"]["rows"] == 400
    image = unpack(data["kymograph"]["state"], "i1").reshape(400, -1)
    assert image.any(axis=1).sum() == np.maximum.reduceat(film.state[1:].any(axis=0), np.arange(400) * 5 // 2).sum()


def test_a_sampled_run_keeps_positions_and_the_slips_of_its_instants():
    scene = load_scene("three_contacts_two_ways")
    run = simulate(scene, 2.0, 100.0)
    film = film_of_run(scene, run).sample(np.array([0.0, 0.5, 1.0, 1.005, 2.0]))
    assert np.array_equal(film.displacement[[0, 1, 2, 4]], run.displacement[[0, 50, 100, 200]])
    middle = 0.5 * (run.displacement[100] + run.displacement[101])
    assert film.displacement[3] == pytest.approx(middle, abs=1e-15)
    assert np.array_equal(film.state, run.contact_state[[0, 50, 100, 101, 200]])
    assert np.array_equal(film.path.state, run.contact_state)


def test_arrows_in_the_plane_are_motions_of_the_tick_of_a_frame():
    run = simulate(load_scene("planar_three_points"), 2.0, 100.0)
    film = film_of_run(load_scene("planar_three_points"), run).sample(np.array([0.0, 0.5, 1.005, 2.0]))
    steps = np.diff(run.displacement, axis=0, prepend=run.displacement[:1])
    assert np.array_equal(film.moved, steps[[0, 50, 101, 200]])


def test_a_fast_film_shows_at_an_instant_what_a_slow_one_shows(tmp_path, monkeypatch):
    """And its panels over time have every slide, however few frames there are."""
    shot, fine = {}, simulate(load_scene("two_anchor_b"), 8.0, 1000.0)

    def find_slides(states: np.ndarray) -> list[list[int]]:
        return [column[np.flatnonzero(np.diff(column, prepend=0))].tolist() for column in states.T]

    monkeypatch.setattr(encode, "write_gif", lambda film, *_, talk: shot.update({round(1.0 / film.step): film}))
    for speed in ("1", "5"):
        animate("two_anchor_b", tmp_path / f"{speed}.gif", fps=20.0, speed=float(speed), end=8.0)
    slow, fast = shot[20], shot[4]
    assert np.array_equal(fast.state, slow.state[::5])
    assert np.allclose(fast.displacement, slow.displacement[::5], rtol=0.0, atol=1e-12)
    slides = [find_slides(states) for states in (slow.path.state, fast.path.state, fine.contact_state)]
    assert slides[0] == slides[1] == slides[2]


@pytest.mark.parametrize("fps", [25, 30])
def test_a_frame_at_the_end_of_a_tick_shows_that_tick(fps):
    """Instants of frames, k / fps, differ from the ends of ticks, in whole nanoseconds, by rounding."""
    scene = load_scene("three_contacts_two_ways")
    times = frame_times(0.0, 8.0, fps, 1.0)
    run = simulate(scene, float(times[-1]), fps)
    assert np.array_equal(film_of_run(scene, run).sample(times).state, run.contact_state)


@pytest.mark.parametrize("name", ["two_anchor_a", "slope_climber", "three_contacts_two_ways"])
def test_the_point_stays_in_the_set_that_moves_with_the_actuation(name):
    film = film_of(name)
    swept = moving_set(film)
    assert swept is not None
    size = float(np.abs(film.tension).max())
    slack = 1e-9 * size
    for k in range(film.time.size):
        assert is_in_stasis(film.tension[k], film.forward[k] + slack, film.backward[k] + slack)
    lengths = np.column_stack(
        [np.interp(film.time, film.scene.drive.times, c, period=1.0) for c in film.scene.drive.actuation.T]
    )
    moved = swept.point[:, -lengths.shape[1] :] - film.tension
    assert moved == pytest.approx(film.scene.body.stiffness * lengths, abs=1e-9 * size)
    # corners surround the point, which is on a side while a contact slides
    low, high = swept.outline.min(axis=1), swept.outline.max(axis=1)
    assert (swept.point >= low - slack).all()
    assert (swept.point <= high + slack).all()


def test_the_camera_keeps_the_body_in_sight_and_moves_steadily():
    walk = 0.1 * np.arange(200.0)
    left, right = pan_camera(walk, walk + 1.0, 4.0, 25)
    assert (left <= walk).all()
    assert (right >= walk + 1.0).all()
    assert np.diff(left) == pytest.approx(0.1, abs=1e-9)
    assert np.ptp(right - left) == pytest.approx(0.0, abs=1e-9)
    still, end = pan_camera(walk[:20], walk[:20] + 1.0, 4.0, 25)
    assert (still == 0.0).all()
    assert (end == walk[19] + 1.0).all()


def test_a_recording_becomes_a_film_of_the_times_asked_for(tmp_path, capsys):
    bag = record(tmp_path / "bag", load_scene("two_anchor_a"), 3, wait=0.0)
    with pytest.raises(SystemExit) as end:
        main(["animate", str(bag), "--out", str(tmp_path / "x.html"), "--from", "0.5", "--to", "2", "--speed", "0.5"])
    assert end.value.code == 0
    assert "x.html: 76 frames, 0.5 to 2 s of two_anchor_a" in capsys.readouterr().out
    _, data = read_page(tmp_path / "x.html")
    run = simulate(load_scene("two_anchor_a"), 2.0, 100.0)
    shown = unpack(data["place"]).reshape(76, 2)
    assert shown[[0, 75]] == pytest.approx(run.displacement[[50, 200]] + [0.0, 1.0], abs=1e-6)


def test_the_scene_and_the_namespace_of_a_film_can_be_named(tmp_path, capsys):
    """Recorders other than the simulator note neither, and may record several crawlers."""
    scene = load_scene("two_anchor_a")
    one = [(f"left/{name}", ns, data) for name, ns, data in messages(scene, play(scene, 0, NS))]
    other = [(f"right/{name}", ns, data) for name, ns, data in messages(scene, hold(0, 100))]
    bag = write(tmp_path / "bag", [message for pair in zip(one, other, strict=False) for message in pair], {})

    def animate(*more: str) -> str:
        with pytest.raises(SystemExit):
            main(["animate", str(bag), "--out", str(tmp_path / "x.html"), *more])
        return "".join(capsys.readouterr())

    assert "the recording does not hold its scene; name one with --scene" in animate()
    both = "several crawlers were recorded, with /left/joint_states and /right/joint_states; name one with --namespace"
    assert both in animate("--scene", scene.name)
    assert "/up; there are /left, /right" in animate("--scene", scene.name, "--namespace", "up")
    assert "26 frames, 0 to 1 s" in animate("--scene", scene.name, "--namespace", "left")
    shown = unpack(read_page(tmp_path / "x.html")[1]["place"]).reshape(26, 2)
    assert shown[-1] == pytest.approx(simulate(scene, 1.0).displacement[-1] + [0.0, 1.0], abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--out", "x.avi"], "--out: x.avi must end in .mp4, .gif or .html"),
        (["--out", "x.html", "--talk"], "--talk: x.html fits the window that shows it; name an .mp4 or a .gif"),
        (["--out", "no/x.gif"], "no does not exist"),
        (["--out", "x.gif", "--fps", "60"], "--fps: 60; a .gif has at most 50 frames per second"),
        (["--out", "x.gif", "--speed", "0"], "--speed: 0; it must be > 0"),
        (["--out", "x.gif", "--from", "2", "--to", "1"], "--to: 1 s; it must be after the start of the film, 2 s"),
        (["--out", "x.gif", "--to", "1", "--duration", "1"], "--duration and --to cannot be combined"),
        (["--out", "x.html", "--speed", "1e-6"], "the film would have 1e+08 frames; it must have 2 .. 20000"),
    ],
)
def test_a_film_that_cannot_be_made_is_refused_in_one_line(arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        main(["animate", "two_anchor_a", *arguments])
    assert end.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not list(tmp_path.iterdir())


def test_a_job_that_a_scheduler_ends_leaves_nothing_behind(tmp_path):
    film = subprocess.Popen(
        [
            Path(sys.executable).with_name("crawler"),
            "animate",
            "two_anchor_a",
            "--out",
            str(tmp_path / "x.gif"),
            "--duration",
            "60",
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    deadline = time.monotonic() + 120.0
    while not any(part.stat().st_size > 10_000 for part in tmp_path.iterdir()):  # it is being written
        assert film.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    film.send_signal(signal.SIGTERM)
    _, said = film.communicate(timeout=60)
    assert film.returncode == 130, said.decode()
    assert said.decode().splitlines()[-1] == "crawler: stopped"
    assert not list(tmp_path.iterdir())


def test_an_interrupt_that_a_library_disguises_is_one(tmp_path):
    """Compiled code of matplotlib makes a ValueError of it, once in some hundred times."""
    before = signal.getsignal(signal.SIGINT)

    def draw() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ValueError("Invalid affine transformation matrix") from None

    with pytest.raises(KeyboardInterrupt), whole_file(tmp_path / "x.png"):
        draw()
    with pytest.raises(ValueError, match="another"), whole_file(tmp_path / "x.png"):
        raise ValueError("another")
    assert signal.getsignal(signal.SIGINT) is before
    assert not list(tmp_path.iterdir())
