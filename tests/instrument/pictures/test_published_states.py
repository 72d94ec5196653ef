"""Pictures of recordings of which only every n-th state was published, and of commands that the drive does not hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rerun")
pytest.importorskip("rosbags")
from PIL import Image

from crawler_command.app import main
from crawler_command.view import read_frames
from crawler_model import Scene, load_scene
from crawler_model.body.drive import NS
from crawler_ros.recording.bag import BagError
from crawler_ros.replay import analysis
from crawler_ros.replay.analysis import analyse
from crawler_ros.viewer.frames import FRAME_EVERY_NS, frames_of_recording, thin
from crawler_ros.viewer.visualizer import draw_recording

from ...recordings import STATES, attachments, messages, play, record, rewrite, write
from .test_films import read_page, unpack
from .test_ground_pictures import icy
from .test_pictures import column, entities

EVERY = 30


def publish_every(bag: Path, folder: Path, scene: Scene, states: int = EVERY) -> Path:
    """Write a recording as a node does that publishes the state of every n-th tick."""
    attached = attachments(scene)
    attached["parameters"]["publish.every"] = states

    def change(name: str, ns: int, data: bytes) -> list:
        return [] if name in STATES and ns % (states * NS // 100) else [(name, ns, data)]

    return rewrite(bag, folder, change, attached)


def run(*arguments: object) -> None:
    with pytest.raises(SystemExit) as end:
        main([str(argument) for argument in arguments])
    assert end.value.code == 0


@pytest.mark.parametrize(
    "name", ["two_contacts_anisotropic", "stalling_inchworm", "hybrid_body", "planar_three_points", "tripedal_star"]
)
def test_the_motion_between_published_states_is_drawn(name, tmp_path):
    scene = load_scene(name)
    bag = record(tmp_path / "all", scene, 1)
    assert not isinstance(read_frames(bag, None, None)[1], list)  # nothing is simulated
    _, recorded = frames_of_recording(bag)
    few = publish_every(bag, tmp_path / "few", scene)
    found, again = read_frames(few, None, None)
    assert found.name == name
    assert len(list(read_frames(few, name, "/")[1])) == len(again)
    for one, other in zip(again, recorded, strict=True):
        assert one.time_ns == other.time_ns
        for part in ("row", "yields", "state"):
            assert np.array_equal(getattr(one, part), getattr(other, part))
        for part in ("displacement", "tension", "forward", "backward"):
            assert getattr(one, part) == pytest.approx(getattr(other, part), abs=1e-9), part


def test_every_run_between_resets_is_drawn_with_its_jumps(tmp_path):
    scene, period = icy(), 2 * 10**9
    sent = [*messages(scene, play(scene, 0, period)), *messages(scene, play(scene, 0, period))]
    bag = write(tmp_path / "all", sent, attachments(scene))
    _, recorded = frames_of_recording(bag, jumps=analyse(bag).table.jumps)
    shown = list(thin(recorded))
    _, again = read_frames(publish_every(bag, tmp_path / "few", scene), None, None, FRAME_EVERY_NS)
    assert [f.time_ns for f in again] == [f.time_ns for f in shown]
    assert [len(f.jumps) for f in again] == [len(f.jumps) for f in shown]
    times = [[jump.time for f in frames for jump in f.jumps] for frames in (again, shown)]
    assert len(times[0]) == 4
    assert times[0] == pytest.approx(times[1], abs=1e-9)


@pytest.mark.parametrize("namespace", [None, "/left"])
def test_the_robot_that_recorded_is_simulated_again_for_its_jumps(namespace, tmp_path, monkeypatch):
    scene = icy()
    topics = {name: f"/left/{name}" for name in ("joint_states", "contact_states", "pose", "applied_commands")}
    noted = attachments(scene) | {"node": "/left/crawler", "topics": topics}
    bag = write(tmp_path / "bag", messages(scene, play(scene, 0, 10**9)), noted, "/left/")

    def stop(path: Path, scene: Scene, robot: str | None, sinks: list) -> None:
        raise RuntimeError(f"analysed: {robot}")

    monkeypatch.setattr(analysis, "analyse", stop)
    with pytest.raises(RuntimeError, match="analysed: /left"):
        read_frames(bag, None, namespace)


def test_films_views_and_rrd_files_show_every_tick(tmp_path, monkeypatch):
    scene = load_scene("two_contacts_anisotropic")
    bag = record(tmp_path / "all", scene, 3)
    few = publish_every(bag, tmp_path / "few", scene, 100)
    (tmp_path / "empty").mkdir()
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path / "empty"))
    monkeypatch.setenv("VK_ICD_FILENAMES", str(tmp_path / "empty"))
    for name, source in (("all", bag), ("few", few)):
        run("animate", source, "--out", tmp_path / f"{name}.html", "--from", "0.8", "--to", "0.9")
        run("view", source, "--png", tmp_path / f"{name}.png", "--at", "0.8")
        run("replay", source, "--rrd", tmp_path / f"{name}.rrd")
    pages = [read_page(tmp_path / f"{name}.html")[1] for name in ("all", "few")]
    assert unpack(pages[1]["place"]) == pytest.approx(unpack(pages[0]["place"]), abs=1e-6)
    pictures = [np.asarray(Image.open(tmp_path / f"{name}.png")).astype(int) for name in ("all", "few")]
    assert np.abs(pictures[1] - pictures[0]).mean() < 0.05
    for entity in ("/commands/rest_lengths", "/tension/link_0", "/contacts"):
        values = [np.array(column(tmp_path / f"{name}.rrd", entity, "scalars")) for name in ("all", "few")]
        assert values[1] == pytest.approx(values[0], abs=1e-9)


def test_where_nothing_can_be_simulated_again_a_line_says_what_is_drawn(tmp_path, capsys):
    scene = load_scene("two_anchor_a")
    few = publish_every(record(tmp_path / "all", scene, 1), tmp_path / "few", scene)
    states = rewrite(few, tmp_path / "states", lambda name, ns, data: [(name, ns, data)] * (name in STATES), None)
    with pytest.raises(BagError, match="does not hold its scene"):
        read_frames(states, None, None)
    attached = attachments(scene)
    attached["parameters"]["publish.every"] = EVERY
    states = rewrite(few, tmp_path / "again", lambda name, ns, data: [(name, ns, data)] * (name in STATES), attached)
    assert not isinstance(read_frames(states, None, None)[1], list)
    (line,) = capsys.readouterr().err.splitlines()
    assert "not simulated again: applied_commands, the ledger of the ticks, was not recorded; drawn from" in line
    assert f"the states of every {EVERY}th tick, with straight lines between them" in line


def test_commands_that_the_drive_does_not_change_are_drawn_where_they_were_recorded(tmp_path):
    """Friction was commanded over a topic: the drive holds it constant."""
    scene = load_scene("two_contacts_anisotropic")
    friction = scene.columns.names.index("contact_0/forward")

    def commanded():
        for start, offsets, rows in play(scene, 0, 2 * NS):
            changed = np.array(rows)
            if rows:
                changed[:, friction] = 0.2 + 0.1 * start / NS
            yield start, offsets, list(changed)

    draw_recording(record(tmp_path / "plain", scene, 2), tmp_path / "plain.rrd")
    assert "/commands/friction" not in entities(tmp_path / "plain.rrd")
    bag = write(tmp_path / "bag", messages(scene, commanded()), attachments(scene))
    draw_recording(bag, tmp_path / "x.rrd")
    drawn = np.array(column(tmp_path / "x.rrd", "/commands/friction", "scalars"))
    assert drawn.shape == (101, 4)
    assert drawn[50] == pytest.approx([0.2 + 0.1 * 0.99, 0.2, 0.5, 0.5])
    assert drawn[100] == pytest.approx([0.2 + 0.1 * 1.99, 0.2, 0.5, 0.5])
