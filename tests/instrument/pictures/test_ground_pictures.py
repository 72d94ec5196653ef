"""The ground in pictures: bands, texts, slopes and jumps in the rerun view and in the drawn body."""

from __future__ import annotations

import dataclasses
import importlib.util
import itertools
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rerun")
pytest.importorskip("matplotlib")
from matplotlib import pyplot as plt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from crawler_model import Crawler, Scene, load_scene, simulate
from crawler_model.run.trajectory import TimedJump
from crawler_pictures.body import draw_body, draw_length
from crawler_pictures.colors import JUMP, WALL, rgb
from crawler_pictures.ground import draw_areas, draw_walls, list_areas, list_sections, trace_profile
from crawler_pictures.run.run_page import draw_run
from crawler_ros.replay import analyse
from crawler_ros.viewer.arrays import run_of_frames
from crawler_ros.viewer.feed import ViewerFeed
from crawler_ros.viewer.frames import Frame, frame_of, frames_of_recording, in_sequence, read_frames, thin
from crawler_ros.viewer.render import screenshot
from crawler_ros.viewer.visualizer import Drawing, draw_recording, to_file

from ...golden_pictures import GOLDEN, differences, read_figure
from ...recordings import attachments, messages, play, record, write
from ..replay.test_replay_patches import icy
from .test_pictures import column, entities, needs_renderer

ICE, ROUGH, HILL = "#9fd0f0", "#d8b48a", "#d5dcc6"
PATCHES = [
    {"from": 1.25, "to": 1.75, "friction": 0.5},
    {"from": 1.75, "to": 2.2, "friction": 2.0, "slope": 10.0},
    {"from": 2.2, "to": 2.6, "slope": -12.0},
    {"from": 3.0, "to": 9.0, "forward": 2.0, "backward": 0.5},
]


def hilly(slope: float = 0.0, patches=PATCHES) -> Scene:
    plain = icy("hilly").document()
    plain["body"]["weights"] = 0.3
    plain["ground"] = {"slope": slope, "patches": patches}
    return Scene.model_validate(plain)


def over_two_grounds() -> Scene:
    document = load_scene("planar_three_points").document()
    triangle = {"polygon": [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]], "friction": 2.0}
    return Scene.model_validate(
        document | {"ground": {"regions": [triangle, {"left_of": [[0, 0], [0, 1]], "friction": 0.5}]}}
    )


def test_regions_of_the_plane_are_cut_at_the_edges_of_a_picture():
    rough, ice = list_areas(over_two_grounds(), np.array([-1.0, -1.0]), np.array([1.5, 1.5]))
    assert (rough.text, rough.color, ice.text, ice.color) == ("friction ×2", ROUGH, "friction ×0.5", ICE)
    assert {tuple(c) for c in ice.corners.tolist()} == {(-1.0, -1.0), (0.0, -1.0), (0.0, 1.5), (-1.0, 1.5)}
    assert {tuple(c) for c in rough.corners.round(12).tolist()} == {
        (0.0, 0.0),
        (1.5, 0.0),
        (1.5, 0.5),
        (0.5, 1.5),
        (0.0, 1.5),
    }
    assert len(list_areas(over_two_grounds(), np.array([1.2, 1.2]), np.array([1.5, 1.5]))) == 0


def test_regions_are_shaded_where_they_lie():
    figure = Figure(figsize=(4, 4))
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.set(xlim=(-1.0, 3.0), ylim=(-1.0, 3.0))
    draw_areas(axis, over_two_grounds())
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())

    def seen(x, y):
        row, place = round((3.0 - y) / 4.0 * (pixels.shape[0] - 1)), round((x + 1.0) / 4.0 * (pixels.shape[1] - 1))
        return pixels[row, place, :3] / 255.0

    for place, color in (((0.5, 0.3), ROUGH), ((-0.5, -0.7), ICE), ((2.5, 2.5), "#ffffff"), ((0.5, -0.5), "#ffffff")):
        assert seen(*place) == pytest.approx(0.45 + 0.55 * np.array(to_rgb(color)), abs=0.02)
    assert axis.get_xlim() == (-1.0, 3.0)


def test_sections_name_what_is_in_sight_once():
    found = list_sections(hilly(3.0), 1.5, 4.0)
    assert [(s.start, s.end, s.text) for s in found] == [
        (1.5, 1.75, "friction ×0.5"),
        (1.75, 2.2, "friction ×2, slope 10° ↗"),
        (2.2, 2.6, "slope -12° ↘"),
        (3.0, 4.0, "friction ×2 →, ×0.5 ←"),
        (2.6, 3.0, "slope 3° ↗"),
    ]
    assert [s.colors for s in found] == [(ICE,), (ROUGH,), (HILL,), ("#c7b5de",), ()]
    assert list_sections(hilly(3.0), 3.5, 4.0)[0].text == "friction ×2 →, ×0.5 ←"
    assert list_sections(hilly(), 9.0, 10.0) == []
    assert list_sections(load_scene("two_anchor_a"), -10.0, 10.0) == []


def shades(**ground) -> list[tuple[str, ...]]:
    document = load_scene("leaving_ice").document() | {"ground": ground}
    return [s.colors for s in list_sections(Scene.model_validate(document), -1.0, 2.0)]


def test_the_colour_changes_as_friction_does():
    before, between, beyond = shades(profile={"at": [0.0, 1.0], "friction": [0.25, 2.0]})
    assert before == (ICE,)  # the factor that is farthest from 1
    assert len(set(between)) > 20
    strength = [np.abs(np.subtract(rgb(color), rgb("#f4f3ee"))).sum() for color in between]
    lightest = int(np.argmin(strength))
    assert (np.diff(strength[:lightest]) <= 0).all()
    assert (np.diff(strength[lightest:]) >= 0).all()
    assert lightest / len(between) == pytest.approx(0.75 / 1.75, abs=0.03)  # where the factor is 1
    assert rgb(beyond[0])[0] > rgb(beyond[0])[2]  # brown, and lighter than a patch: 2 is less far from 1 than 0.25
    assert beyond[0] != ROUGH
    both = {"forward": [1.0, 2.0], "backward": [1.0, 0.5]}
    assert shades(profile={"at": [0.0, 1.0], "friction": both})[2] == ("#c7b5de",)


def test_a_patch_lies_on_the_profile():
    patches = [{"from": 0.2, "to": 0.4, "friction": 0.5}]
    ground = {"profile": {"at": [0.0, 1.0], "friction": [1.0, 2.0]}, "patches": patches}
    document = load_scene("leaving_ice").document() | {"ground": ground}
    figure, axis = plt.subplots()
    draw_body(axis, Scene.model_validate(document), [0.2, 0.2], [0.0])
    figure.canvas.draw()
    x, y = axis.transData.transform((0.35, -0.11)).astype(int)
    picture = np.asarray(figure.canvas.buffer_rgba())[::-1, :, :3].astype(int)
    around = picture[y - 3 : y + 4, x - 3 : x + 4].reshape(-1, 3)
    plt.close(figure)
    assert (np.abs(around - rgb(ICE)).max(axis=1) < 6).any()


def test_a_wall_stands_behind_the_contact_that_it_stops():
    document = load_scene("wall_pusher").document()
    document["ground"] = {"walls": [{"at": 0.5, "stops": "forward"}, {"at": 0.1, "stops": "backward"}]}
    document["body"]["contacts"] = [0.2, 0.4]
    figure, axis = plt.subplots()
    draw_body(axis, Scene.model_validate(document), [-0.1, 0.1], [0.0])
    bars = [patch.get_xy()[:, 0] for patch in axis.patches if patch.get_facecolor()[:3] == to_rgb(WALL)]
    plt.close(figure)
    ends = sorted((bar.min(), bar.max()) for bar in bars)
    assert ends == [pytest.approx((0.088, 0.1)), pytest.approx((0.5, 0.512))]


def test_the_view_draws_the_walls_of_a_page(tmp_path):
    drawing = Drawing(load_scene("wall_pusher"), to_file(tmp_path / "x.rrd"))
    drawing.draw(frames(load_scene("wall_pusher"), 0.0)[0])
    drawing.close()
    strips = np.array(column(tmp_path / "x.rrd", "/world/ground/walls", "strips")[0])
    assert strips.shape == (1, 2, 2)
    assert strips[0, 0, 0] == strips[0, 1, 0]


def test_walls_are_lines_where_they_stand():
    figure, axis = plt.subplots()
    draw_walls(axis, load_scene("wall_pusher"))
    (line,) = axis.lines
    assert set(line.get_ydata()) == {0.5}
    assert [text.get_text() for text in axis.texts] == ["wall ↑"]
    draw_walls(axis, load_scene("two_anchor_a"))
    assert len(axis.lines) == 1
    plt.close(figure)


def test_the_profile_has_the_heights_of_the_slopes():
    at, height = trace_profile(hilly(), 1.0, 3.0)
    assert at.tolist() == [1.0, 1.25, 1.75, 2.2, 2.6, 3.0]
    top, drop = 0.45 * np.tan(np.radians(10.0)), 0.4 * np.tan(np.radians(12.0))
    assert height == pytest.approx([0.0, 0.0, 0.0, top, top - drop, top - drop] - min(0.0, top - drop))
    assert trace_profile(icy(), 0.0, 5.0)[0].size == 0
    at, height = trace_profile(hilly(-45.0, []), 0.0, 2.0)
    assert height == pytest.approx([2.0, 0.0])


def draw(scene: Scene, png: Path) -> np.ndarray:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(9, 3))
    draw_body(axis, scene, [0.0, 0.2], [0.2])
    figure.savefig(png, dpi=80)
    plt.close(figure)
    return np.asarray(Image.open(png).convert("RGB")).astype(int)


def count(picture: np.ndarray, color: str | tuple[int, int, int], near: int = 6) -> int:
    wanted = rgb(color) if isinstance(color, str) else color
    return int((np.abs(picture - wanted).max(axis=2) < near).sum())


def test_the_body_stands_on_its_patches(tmp_path):
    near = [{**p, "from": p["from"] - 0.8, "to": p["to"] - 0.8} for p in PATCHES]
    picture = draw(hilly(0.0, near), tmp_path / "hilly.png")
    for color in (ICE, ROUGH, HILL):
        assert count(picture, color) > 150
    plain = icy().document()
    del plain["ground"]
    bare = draw(Scene.model_validate(plain), tmp_path / "bare.png")
    assert count(bare, ICE) == count(bare, ROUGH) == count(bare, HILL) == 0
    level = draw(Scene.model_validate(plain | {"ground": {}}), tmp_path / "level.png")
    assert (bare == level).all()


def frames(scene: Scene, seconds: float = 2.0) -> list[Frame]:
    jumps, crawler, made = list(simulate(scene, seconds).jumps), Crawler(scene), []
    for ns in range(0, int(seconds * 1e9) + 1, 10_000_000):
        crawler.follow(scene.drive.sample(np.array([ns])))
        passed = [j for j in jumps if round(j.time * 1e9) <= ns]
        jumps = jumps[len(passed) :]
        made.append(frame_of(crawler, ns, crawler.contact_state, tuple(passed)))
    return made


@pytest.mark.parametrize("actuators", [(), (1,)])
def test_a_body_on_its_ground_is_the_one_that_was_read(actuators):
    document = load_scene("three_contacts_two_ways").document() | {"start": "relaxed"}
    document["body"]["weights"] = 0.3
    document["ground"] = {"slope": 2.0, "patches": [{"from": 0.3, "to": 0.5, "friction": 0.5, "slope": -4.0}]}
    figure = Figure()
    axis = figure.subplots()
    draw_body(axis, Scene.model_validate(document), [0.0, 0.02, -0.01], [0.02, -0.03], actuators)
    draw_length(axis, 0.1, 0.25, 1.5, "half")
    assert not differences(read_figure(figure), GOLDEN / f"body_{len(actuators)}_actuators.txt")


def test_jumps_survive_the_pipe_and_thinning(tmp_path):
    scene = icy()
    every = frames(scene)
    jumps = [jump for frame in every for jump in frame.jumps]
    assert [jump.contact for jump in jumps] == [1, 0]
    packed = tmp_path / "frames"
    packed.write_bytes(b"".join(f.pack() for f in every) + every[0].pack()[:-1])
    with packed.open("rb") as source:
        again = list(read_frames(source, scene))
    assert [f.time_ns for f in again] == [f.time_ns for f in every]
    assert [f.jumps for f in again] == [f.jumps for f in every]
    assert all((a.displacement == b.displacement).all() for a, b in zip(again, every, strict=True))
    assert [jump for frame in thin(every, 170_000_000) for jump in frame.jumps] == jumps
    twice = [jump.time for frame in in_sequence([*every, *every]) for jump in frame.jumps]
    assert twice == pytest.approx([j.time for j in jumps] + [j.time + 2.0 for j in jumps])


def test_bounds_in_frames_are_those_of_the_ground_below(tmp_path):
    live = frames(icy())
    assert (live[0].forward.tolist(), live[0].backward.tolist()) == ([0.4, 0.4], [1.0, 1.0])
    assert (live[-1].forward.tolist(), live[-1].backward.tolist()) == ([0.2, 0.2], [0.5, 0.5])
    assert live[100].forward.tolist() == [0.4, 0.2]  # the front has reached the ice
    _, found = frames_of_recording(record(tmp_path / "bag", icy(), 1, wait=0.0))
    recorded = {f.time_ns: f for f in found}
    for frame in live:
        assert recorded[frame.time_ns].forward.tolist() == frame.forward.tolist()


def test_a_recording_is_drawn_with_the_jumps_of_each_run(tmp_path):
    scene, period = icy(), 2 * 10**9
    sent = [*messages(scene, play(scene, 0, period)), *messages(scene, play(scene, 0, period))]
    bag = write(tmp_path / "bag", sent, attachments(scene))
    jumps = analyse(bag).table.jumps
    assert [(run, jump.contact) for run, jump in jumps] == [(0, 1), (0, 0), (1, 1), (1, 0)]
    _, found = frames_of_recording(bag, jumps=jumps)
    at = [(f.time_ns, round(jump.time, 9)) for f in found for jump in f.jumps]
    assert at == [(330_000_000, 0.325), (1_930_000_000, 1.925), (2_330_000_000, 2.325), (3_930_000_000, 3.925)]
    draw_recording(bag, tmp_path / "x.rrd", jumps=jumps)
    rows = entities(tmp_path / "x.rrd")
    assert rows["/jumps"] == 4
    assert rows["/world/ground"] == rows["/world/ground/text"] == rows["/world/track"]
    assert rows["/world/jumps/text"] >= 4


def test_texts_in_the_figure_of_the_documents_are_not_over_curves():
    spec = importlib.util.spec_from_file_location(
        "loads", Path(__file__).parent.parent.parent.parent / "docs" / "loads.py"
    )
    loads = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loads)
    for name in loads.CROSSED:
        figure, axis = plt.subplots(figsize=(4.3, 4.2), layout="constrained")
        loads.draw_crossing(axis, name)
        figure.canvas.draw()
        assert axis.texts
        for text in axis.texts:
            box = text.get_window_extent()
            for line in (line for line in axis.lines if line.get_label().startswith("contact")):
                points = axis.transData.transform(line.get_xydata())
                dense = np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(points)])
                assert not ((dense > box.min).all(axis=1) & (dense < box.max).all(axis=1)).any(), (name, text)
        plt.close(figure)


def test_a_scene_without_ground_is_drawn_as_before(tmp_path):
    bag = record(tmp_path / "bag", "two_anchor_a", 1)
    assert analyse(bag).table.jumps == []
    draw_recording(bag, tmp_path / "x.rrd", jumps=analyse(bag).table.jumps)
    assert not [name for name in entities(tmp_path / "x.rrd") if "ground" in name or "jump" in name]


def test_the_feed_keeps_jumps_for_the_frame_that_is_sent(tmp_path):
    scene = icy()
    feed = ViewerFeed(scene, str(tmp_path / "x.rrd"), lambda text: None)
    crawler = Crawler(scene)
    for k in range(40):  # every second tick is a frame
        jumps = (TimedJump(k * 0.01, 1, 1.25, 0.2, 0.02),) if k in (3, 4, 5) else ()
        feed.show(k * 10_000_000, crawler, jumps)
    feed.close()
    assert entities(tmp_path / "x.rrd")["/jumps"] == 3


@pytest.mark.slow
@needs_renderer
def test_the_view_shows_bands_and_the_contact_that_jumps(tmp_path):
    bag = record(tmp_path / "bag", hilly(), 1)
    found = analyse(bag)
    draw_recording(bag, tmp_path / "x.rrd", found.scene, found.robot, found.table.jumps)
    when = found.plain_jumps()[0]["time"]
    pictures = []
    for k, at in enumerate((when - 0.05, when + 0.05, when + 0.5)):
        screenshot(tmp_path / "x.rrd", tmp_path / f"{k}.png", at)
        pictures.append(np.asarray(Image.open(tmp_path / f"{k}.png").convert("RGB")).astype(int)[60:345, :1560])
    for color in (ICE, ROUGH, HILL):
        assert count(pictures[0], color, 24) > 1000
    marks = [count(picture, JUMP, 24) for picture in pictures]
    assert marks[1] > 500
    assert marks[0] == marks[2] == 0


def test_the_page_of_the_viewer_marks_jumps(tmp_path):
    scene = icy()
    every = frames(scene)
    for name, shown in (("jumps", every), ("none", [dataclasses.replace(f, jumps=()) for f in every])):
        draw_run(run_of_frames(scene, shown), tmp_path / f"{name}.png")
    with_jumps, without = (
        np.asarray(Image.open(tmp_path / f"{name}.png").convert("RGB")).astype(int) for name in ("jumps", "none")
    )
    assert count(with_jumps, JUMP) > 50
    assert count(without, JUMP) == 0


def test_the_lines_of_a_band_fill_it_and_nothing_else(tmp_path):
    scene = icy()
    drawing = Drawing(scene, to_file(tmp_path / "x.rrd"))
    drawing.draw(frames(scene, 0.0)[0])
    drawing.close()
    strips, radii = (np.array(column(tmp_path / "x.rrd", "/world/ground", part)[0]) for part in ("strips", "radii"))
    apart = strips[1, 0, 1] - strips[0, 0, 1]
    assert strips[:, 0, 1] == pytest.approx((np.arange(12) + 0.5) * apart)
    assert radii == pytest.approx(0.6 * apart)  # they overlap
    (band,) = list_sections(scene, -10.0, 10.0)
    assert strips[:, 0, 0] == pytest.approx(band.start + 0.5 * apart)
