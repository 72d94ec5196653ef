"""What is drawn: frames, the .rrd's content, the page, and the rendered view where a renderer is installed."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rerun")
from PIL import Image

from crawler_command.app import main
from crawler_model import Crawler, CrawlerError, load_scene, simulate
from crawler_pictures.colors import BACK, FORWARD, TENSION, rgb
from crawler_pictures.film.film import film_of_run
from crawler_pictures.run.run_page import draw_run
from crawler_pictures.run.trajectory import read_trajectory
from crawler_ros.viewer.arrays import run_of_frames
from crawler_ros.viewer.feed import LIVE_PORT, ViewerFeed, is_free
from crawler_ros.viewer.frames import Frame, frame_of, frames_of_recording, thin
from crawler_ros.viewer.render import DriverError, draw_instant, screenshot
from crawler_ros.viewer.style import STICK
from crawler_ros.viewer.visualizer import Drawing, to_file

from ...processes import wait_until
from ...recordings import record
from ...sockets import addresses

GREEN, RED, GREY = rgb(FORWARD), rgb(BACK), STICK
RENDERER = any(Path("/usr/share/vulkan/icd.d").glob("*.json")) if Path("/usr/share/vulkan/icd.d").is_dir() else False
ARCH = """
name: arch
dimension: 2
body: {points: [[0.0, 0.0], [1.0, 0.2], [2.0, 0.0]], springs: length, links: {stiffness: 20.0}}
friction: {isotropic: [0.1, 0.0, 0.2]}
drive: {times: [0.0, 1.0, 2.0], actuation: [[0.0, 0.0], [0.1, 0.1], [0.0, 0.1]]}
"""
needs_renderer = pytest.mark.skipif(not RENDERER, reason="no Vulkan driver here (Debian: mesa-vulkan-drivers)")


def frames(name: str | Path, seconds: float = 2.0) -> list[Frame]:
    scene = load_scene(name)
    crawler = Crawler(scene)
    made = []
    for ns in range(0, int(seconds * 1e9) + 1, 10_000_000):
        crawler.follow(scene.drive.sample(np.array([ns])))
        made.append(frame_of(crawler, ns, crawler.contact_state))
    return made


def draw(name: str | Path, path: Path, seconds: float = 2.0) -> Path:
    drawing = Drawing(load_scene(name), to_file(path))
    for frame in thin(frames(name, seconds)):
        drawing.draw(frame)
    drawing.close()
    return path


def test_links_of_a_body_that_turns_are_drawn_stretched_or_compressed():
    scene = load_scene("steering_inchworm")
    drawn = np.array([frame.tension for frame in frames(scene.name)])
    run = simulate(scene, 2.0)
    np.testing.assert_allclose(drawn, run.tension[:, : scene.body.springs], atol=1e-9)
    np.testing.assert_array_equal(film_of_run(scene, run).tension, run.tension[:, : scene.body.springs])
    assert drawn.min() < -0.1 < 0.1 < drawn.max()


def entities(rrd: Path) -> dict[str, int]:
    try:
        from rerun.chunk import RrdReader
    except ImportError:  # before rerun 0.41
        from rerun.experimental import RrdReader

    rows: dict[str, int] = {}
    for chunk in RrdReader(str(rrd)).stream():
        rows[str(chunk.entity_path)] = rows.get(str(chunk.entity_path), 0) + chunk.num_rows
    return rows


def column(rrd: Path, entity: str, part: str) -> list:
    """One component of an entity that changes, in the order of time."""
    try:
        from rerun.chunk import RrdReader
    except ImportError:  # before rerun 0.41
        from rerun.experimental import RrdReader

    rows: list[tuple[int, list]] = []
    for chunk in RrdReader(str(rrd)).stream():
        batch = chunk.to_record_batch()
        if str(chunk.entity_path) == entity and "sim_time" in batch.schema.names:
            (values,) = (c for f, c in zip(batch.schema, batch.columns, strict=True) if f.name.endswith(part))
            (times,) = (c for f, c in zip(batch.schema, batch.columns, strict=True) if f.name == "sim_time")
            rows += zip(times.cast("int64").to_pylist(), values.to_pylist(), strict=True)
    return [value for _, value in sorted(rows, key=lambda row: row[0])]


def test_frames_survive_the_pipe():
    for scene, yields in (("three_contacts_two_ways", []), ("stalling_inchworm", [1])):
        frame = frames(scene)[77]
        assert frame.yields.tolist() == yields
        same = Frame.unpack(frame.pack(), load_scene(scene))
        for name in ("time_ns", "displacement", "tension", "state", "forward", "backward", "row", "yields"):
            assert np.array_equal(getattr(frame, name), getattr(same, name))


@pytest.mark.parametrize("name", ["tendon_worm", "stalling_inchworm", "rubber_worm"])
def test_links_are_slack_stalled_or_yielding_in_a_recording_when_they_are_in_the_run(name, tmp_path):
    path = record(tmp_path / "bag", name, 2, wait=0.0)
    scene, recorded = frames_of_recording(path)
    marks = [f.yields.tolist() for f in recorded]
    assert marks == [f.yields.tolist() for f in frames(name, 2.0 * scene.drive.period)]
    assert {mark for row in marks for mark in row} == {0, {"t": -1, "s": 1, "r": 2}[name[0]]}
    assert scene == load_scene(name)


@pytest.mark.parametrize(("name", "points"), [("tendon_worm", {11, 13}), ("stalling_inchworm", {11})])
def test_the_rrd_shows_slack_links_as_ropes_and_stalled_ones_in_magenta(name, points, tmp_path):
    shown, states = list(thin(frames(name, 4.0))), []
    drawing = Drawing(load_scene(name), to_file(tmp_path / "x.rrd"))
    for frame in shown:
        drawing.draw(frame)
        states.append(int(frame.yields[0]))
    drawing.close()
    strips, colors = (column(tmp_path / "x.rrd", "/world/links", part) for part in ("strips", "colors"))
    assert {len(strip) for (strip,) in strips} == points
    ropes = [len(strip) == 13 for (strip,) in strips]
    magenta = [color == [0xE6007EFF] for color in colors]
    assert ropes == [state < 0 for state in states]
    assert magenta == [state > 0 for state in states]
    assert 0.1 < np.mean(np.array(states) != 0) < 0.8


def test_thinning_keeps_short_slips():
    every = frames("three_contacts_two_ways")
    kept = list(thin(every, 200_000_000))
    assert len(kept) == 11
    slips = {i for f in every for i in np.flatnonzero(f.state)}
    assert {i for f in kept for i in np.flatnonzero(f.state)} == slips


def test_points_that_do_not_touch_the_ground_do_not_count_in_what_is_drawn(tmp_path):
    (tmp_path / "arch.yaml").write_text(ARCH)
    scene = load_scene(tmp_path / "arch.yaml")
    run = simulate(scene, 2.0)
    place = scene.body.share @ scene.body.position
    for drawn in (run_of_frames(scene, frames(tmp_path / "arch.yaml")), read_trajectory(run)):
        assert drawn.net_translation == pytest.approx(run.net_translation, abs=1e-9)
        assert drawn.mean == pytest.approx(place + run.net_translation, abs=1e-9)
    rrd = draw(tmp_path / "arch.yaml", tmp_path / "x.rrd")
    ends = [
        column(rrd, entity, part)[-1]
        for entity, part in (("/net_translation", "scalars"), ("/world/mean", "positions"))
    ]
    assert ends[0] == pytest.approx(run.net_translation[-1], abs=1e-7)
    assert ends[1][0] == pytest.approx((place + run.net_translation[-1]) * (1.0, -1.0), abs=1e-6)
    assert np.abs(scene.body.position.mean(axis=0) - place).max() > 0.05


@pytest.mark.parametrize("name", ["two_anchor_a", "three_contacts_two_ways", "ten_contact_wave"])
def test_the_rrd_has_body_tensions_states_and_translation(name, tmp_path):
    rows = entities(draw(name, tmp_path / "x.rrd"))
    n = load_scene(name).body.contacts
    assert rows["/world/contacts"] == rows["/world/links"] == rows["/net_translation"] - 1 == 101
    each = [f"/tension/link_{i}" for i in range(n - 1)] if n <= 4 else ["/tensions"]
    assert all(rows[name] == 102 for name in (*each, "/contacts", "/commands/rest_lengths"))
    assert ("/stasis/domain" in rows) == (n == 3)


@needs_renderer
def test_the_view_shows_a_slipping_and_two_standing_contacts(tmp_path):
    rrd = draw("three_contacts_two_ways", tmp_path / "x.rrd")
    screenshot(rrd, tmp_path / "x.png", 1.2)
    picture = np.asarray(Image.open(tmp_path / "x.png").convert("RGB")).astype(int)
    assert picture.shape == (1044, 1920, 3)  # without the menu and the viewer's own warnings in it
    body, lanes, polygon = picture[30:212], picture[240:600, :1150], picture[630:1000, 1155:]

    def count(area, color):
        return int((np.abs(area - color).max(axis=2) < 24).sum())

    def greenish(area):
        return int(((area[..., 1] > area[..., 0] + 40) & (area[..., 1] > area[..., 2] + 20)).sum())

    assert count(body, GREEN) > 200  # the front contact steps
    assert count(body, GREY) > 400  # two hold
    assert count(body, RED) == 0
    assert greenish(lanes) > 1000
    assert count(lanes, RED) > 20
    assert count(polygon, RED) > 300
    assert count(polygon, GREEN) > 300


@needs_renderer
def test_a_body_of_micrometres_is_seen_as_one_of_decimetres_is(tmp_path):
    """The viewer draws nothing of that size, unless it is magnified."""
    document = load_scene("three_contacts_two_ways").document()
    for part, key in (("body", "contacts"), ("friction", "isotropic"), ("drive", "actuation")):
        document[part][key] = (1e-5 * np.array(document[part][key])).tolist()
    (tmp_path / "small.yaml").write_text(json.dumps(document))
    pictures = []
    for name in ("three_contacts_two_ways", str(tmp_path / "small.yaml")):
        rrd = draw(name, tmp_path / "x.rrd")
        assert ("/world" in entities(rrd), "/stasis" in entities(rrd)) == (len(pictures) == 1,) * 2
        screenshot(rrd, tmp_path / "x.png", 1.2)
        pictures.append(np.asarray(Image.open(tmp_path / "x.png").convert("RGB")).astype(int))
    for area in (np.s_[30:165], np.s_[640:970, 1430:]):  # above the numbers of the track, and the polygon
        large, small = (picture[area] for picture in pictures)
        drawn = np.abs(large - large[0, 0]).max(axis=2) > 40
        other = (np.abs(large - small).max(axis=2) > 40).sum()
        assert drawn.sum() > max(1000, 5 * other)


def body_of(picture: np.ndarray) -> tuple[int, int]:
    """Where the contacts of a rendered view begin and end, in pixels."""
    track = picture[95:124]
    near = [np.abs(track - color).max(axis=2) < 24 for color in (GREEN, RED, GREY)]
    columns = np.flatnonzero(np.logical_or.reduce(near).sum(axis=0) > 4)
    return int(columns[0]), int(columns[-1])


@needs_renderer
def test_the_instant_asked_for_is_the_one_that_is_rendered(tmp_path):
    """The first contact stands at 0 and the second at 1 + t: every instant looks different."""
    scene = load_scene("two_anchor_a")
    drawing = Drawing(scene, to_file(tmp_path / "x.rrd"))
    for frame in thin(frames("two_anchor_a", 2.0)):
        drawing.draw(replace(frame, displacement=np.array([0.0, frame.time_ns * 1e-9])))
    drawing.close()
    widths = []
    for k, at in enumerate((0.5, 1.5, 0.5)):
        screenshot(tmp_path / "x.rrd", tmp_path / f"{k}.png", at)
        left, right = body_of(np.asarray(Image.open(tmp_path / f"{k}.png").convert("RGB")).astype(int))
        widths.append(right - left)
    assert widths[0] == widths[2]
    line = np.flatnonzero(
        (np.abs(np.asarray(Image.open(tmp_path / "0.png").convert("RGB")).astype(int)[127] - 150) < 8).all(axis=1)
    )
    metre = (line[-1] - line[0]) / (4.0 * 5.0)  # the track is four times as long as the body at its longest
    assert widths[1] - widths[0] == pytest.approx(metre, abs=2.0)
    with pytest.raises(CrawlerError, match="the recording goes from 0 to 2 s"):
        screenshot(tmp_path / "x.rrd", tmp_path / "late.png", 2.1)
    assert not (tmp_path / "late.png").exists()


@pytest.mark.parametrize(
    "graphics",
    [
        ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"],
        ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "LIBGL_DRIVERS_PATH", "__EGL_VENDOR_LIBRARY_DIRS"],
    ],
    ids=["no Vulkan", "no GL"],
)
def test_without_a_driver_one_line_names_what_to_install(graphics, tmp_path, monkeypatch):
    rrd = draw("two_anchor_a", tmp_path / "x.rrd", 0.1)
    (tmp_path / "empty").mkdir()
    for name in graphics:
        monkeypatch.setenv(name, str(tmp_path / "empty"))
    with pytest.raises(
        DriverError, match=r"this machine has no Vulkan driver; .* apt install mesa-vulkan-drivers"
    ) as error:
        screenshot(rrd, tmp_path / "x.png")
    assert len(str(error.value).splitlines()) == 1
    assert not (tmp_path / "x.png").exists()


def test_without_a_driver_the_instant_is_drawn_all_the_same(tmp_path, monkeypatch, capsys):
    bag = record(tmp_path / "bag", load_scene("two_anchor_a"), 2, wait=0.0)
    (tmp_path / "empty").mkdir()
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "empty"))
    monkeypatch.setenv("VK_ICD_FILENAMES", str(tmp_path / "empty"))
    with pytest.raises(SystemExit) as end:
        main(["view", str(bag), "--png", str(tmp_path / "x.png"), "--at", "1.5"])
    assert end.value.code == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert "no Vulkan driver" in line
    assert "apt install mesa-vulkan-drivers); drawn by matplotlib instead" in line
    drawn = np.asarray(Image.open(tmp_path / "x.png").convert("RGB")).astype(int)
    scene, shown = frames_of_recording(bag)
    every = list(shown)
    for at, near in ((1.5, True), (0.7, False)):
        draw_instant(scene, every, tmp_path / "y.png", at)
        same = np.abs(np.asarray(Image.open(tmp_path / "y.png").convert("RGB")).astype(int) - drawn).max() == 0
        assert same == near


def test_the_page_shows_slips_in_their_colours(tmp_path):
    run = run_of_frames(load_scene("three_contacts_two_ways"), frames("three_contacts_two_ways"))
    draw_run(run, tmp_path / "p.png")
    picture = np.asarray(Image.open(tmp_path / "p.png").convert("RGB")).astype(int)
    assert picture.shape[1] > 1000
    for color in (rgb(FORWARD), rgb(TENSION)):
        assert (np.abs(picture - color).max(axis=2) < 30).sum() > 500


def test_a_name_with_dollars_is_no_formula(tmp_path):
    file = tmp_path / "dollars.yaml"
    file.write_text(json.dumps(load_scene("two_anchor_a").document() | {"name": "5$ or $x^$ {"}))
    for verb, out in (("simulate", "--png=run.png"), ("check", "--png=set.png"), ("animate", "--out=film.gif")):
        option, _, name = out.partition("=")
        with pytest.raises(SystemExit) as end:
            main([verb, str(file), option, str(tmp_path / name)])
        assert end.value.code == 0
        Image.open(tmp_path / name).verify()


def test_a_page_of_nothing_is_refused(tmp_path):
    with pytest.raises(CrawlerError, match="no state"):
        draw_instant(load_scene("two_anchor_a"), [], tmp_path / "p.png")


def show_many(feed: ViewerFeed, crawler: Crawler, count: int) -> None:
    for k in range(count):
        crawler.advance([0.1 * np.sin(0.3 * k), 0.0])
        feed.show(k * 20_000_000, crawler)


def test_the_feed_writes_a_file_and_drops_nothing(tmp_path):
    scene = load_scene("three_contacts_one_way")
    feed = ViewerFeed(scene, str(tmp_path / "deep" / "x.rrd"), lambda text: None)
    show_many(feed, Crawler(scene), 200)
    feed.close()
    assert feed.dropped == 0
    assert entities(tmp_path / "deep" / "x.rrd")["/world/contacts"] == 200


def test_a_stopped_viewer_costs_frames_and_never_a_wait(tmp_path):
    scene = load_scene("three_contacts_one_way")
    feed = ViewerFeed(scene, str(tmp_path / "x.rrd"), lambda text: None)
    feed._process.send_signal(signal.SIGSTOP)
    show_many(feed, Crawler(scene), 20_000)  # a wait would be for ever
    assert feed.dropped > 5_000
    feed._process.send_signal(signal.SIGKILL)
    show_many(feed, Crawler(scene), 10)
    feed.close()


def test_a_view_never_overwrites(tmp_path):
    (tmp_path / "x.rrd").write_text("mine")
    with pytest.raises(FileExistsError):
        ViewerFeed(load_scene("two_anchor_a"), str(tmp_path / "x.rrd"), lambda text: None)


def test_live_viewers_serve_on_loopback_only_and_each_on_a_port_of_its_own(monkeypatch):
    """Two at once, and a port between them that is a stranger's."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    scene, said, ports = load_scene("three_contacts_one_way"), [], []
    with socket.socket() as stranger, contextlib.ExitStack() as stack:
        for number in range(2):
            feed = ViewerFeed(scene, "live", said.append)
            stack.callback(feed.close)
            ports.append(int(said[-1].split("127.0.0.1:")[1].split("/")[0]))
            pid = feed._process.pid
            found = wait_until(lambda pid=pid: {a for a in addresses(pid) if a[0].startswith("tcp")}, what="its port")
            assert found == {("tcp", "127.0.0.1", ports[-1])}
            show_many(feed, Crawler(scene), 10)
            assert feed.alive
            if number == 0:
                taken = ports[0] + 1
                while not is_free(taken):
                    taken += 1
                stranger.bind(("127.0.0.1", taken))
                stranger.listen()
    assert ports[1] not in (ports[0], taken)
    assert f"; port {LIVE_PORT} is taken)" in said[1]


def test_a_viewer_whose_port_is_taken_says_so_and_ends():
    header = json.dumps(load_scene("two_anchor_a").document()).encode()
    with socket.socket() as stranger:
        stranger.bind(("127.0.0.1", 0))
        stranger.listen()
        port = stranger.getsockname()[1]
        done = subprocess.run(
            [sys.executable, "-m", "crawler_ros.viewer.visualizer", f"rerun+http://127.0.0.1:{port}/proxy"],
            input=struct.pack("<I", len(header)) + header,
            capture_output=True,
            timeout=60,
        )
    assert done.returncode == 1
    assert done.stderr.decode().splitlines() == [f"viewer: port {port} of 127.0.0.1 is taken"]


def test_in_the_plane_y_points_up_for_all_that_rerun_shows(tmp_path):
    """Its own axis points down: contacts, paths and the mean are mirrored alike, here where all lie off the x axis."""
    (tmp_path / "arch.yaml").write_text(
        ARCH.replace("[[0.0, 0.0], [1.0, 0.2], [2.0, 0.0]]", "[[0, 1], [1, 1.2], [2, 1]]")
    )
    scene = load_scene(tmp_path / "arch.yaml")
    place = scene.body.position + simulate(scene, 2.0).displacement[-1]
    up = np.vstack((place, scene.body.share @ place))
    rrd = draw(tmp_path / "arch.yaml", tmp_path / "x.rrd")
    contacts, mean = (column(rrd, f"/world/{name}", "positions")[-1] for name in ("contacts", "mean"))
    assert np.array([*contacts, *mean]) * (1.0, -1.0) == pytest.approx(up, abs=1e-6)
    ends = np.array([path[-1] for path in column(rrd, "/world/paths", "strips")[-1]])
    assert ends * (1.0, -1.0) == pytest.approx(up, abs=0.02)
    assert up[:, 1].min() > 0.9
