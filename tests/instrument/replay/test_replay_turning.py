"""Recordings of bodies that turn: gains in their own frame, stability, starts in mid-run, and only poses."""

from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest

from crawler_model import Scene, load_scene, simulate
from crawler_model.body.drive import NS
from crawler_ros.replay import analyse
from crawler_ros.wire.messages import lay_out_odometry

from ...commands import crawler
from ...recordings import attachments, messages, record, rewrite, write
from .test_replay import bare

PERIODS, RATE = 8, 10.0
"""After eight periods the scissors have turned by more than half a turn."""


@pytest.fixture(scope="module")
def run():
    return simulate(load_scene("scissors"), duration=PERIODS, rate=RATE)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return record(tmp_path_factory.mktemp("scissors") / "bag", "scissors", PERIODS, wait=0.0, rate=RATE)


def gains_of(found):
    return np.array([(*cycle.translation, cycle.turned) for cycle in found.cycles])


def test_gains_and_the_least_stability_margin_are_those_of_simulate(bag, run):
    done = crawler("replay", bag, "--json")
    found = json.loads(done.stdout)
    assert found["resimulation"]["identical"]
    gains = [(*cycle["translation"], cycle["turned"]) for cycle in found["cycles"]]
    assert np.array(gains) == pytest.approx(run.per_period, abs=1e-12)
    margins = found["margins"]
    assert (margins["stability_margin"], margins["stability_time"]) == (run.stability_margin, run.stability_time)
    line = f"stability margin: at least {run.stability_margin:.4g}, at {run.stability_time:g} s"
    assert line in crawler("replay", bag).stdout
    assert line in crawler("simulate", "scissors", "--duration", PERIODS, "--rate", RATE).stdout


def odometry(name, stamp, data):
    """The pose as odometry."""
    if name != "pose":
        return [(name, stamp, data)]
    x, y, _, _, _, z, w = np.frombuffer(data[-56:])
    return [("odom", stamp, lay_out_odometry("world", "base_link").encode(stamp, [x, y, z, w, 0.0, 0.0, 0.0]))]


def test_without_a_scene_the_yaw_is_that_of_the_pose_or_of_the_odometry(bag, run, tmp_path):
    alone = analyse(bare(bag, tmp_path / "pose"))
    assert alone.comparison is None
    gains = gains_of(alone)
    ticks = np.rint(RATE * np.array([(cycle.start, cycle.end) for cycle in alone.cycles])).astype(int)
    assert len(ticks) == PERIODS - 1
    assert gains[:, 2] == pytest.approx(np.diff(run.yaw[ticks])[:, 0], abs=1e-12)
    moved = np.diff(run.net_translation[ticks], axis=1)[:, 0]
    assert not any(cycle.transient for cycle in alone.cycles[1:])
    assert np.linalg.norm(gains[:, :2], axis=1) == pytest.approx(np.linalg.norm(moved, axis=1), abs=1e-12)
    assert gains[1:] == pytest.approx(np.tile(gains[-1], (PERIODS - 2, 1)), abs=1e-6)  # in its own frame all are equal
    assert gains_of(analyse(rewrite(bag, tmp_path / "odom", odometry, None))) == pytest.approx(gains, abs=1e-12)
    done = crawler("replay", tmp_path / "odom", "--parquet", tmp_path / "tables")
    assert "turned [rad]" in done.stdout
    parquet = pytest.importorskip("pyarrow.parquet")
    assert parquet.read_table(tmp_path / "tables" / "cycles.parquet")["turned"].to_pylist() == list(gains[:, 2])


def test_without_poses_nothing_is_known_of_the_yaw(bag, tmp_path):
    drop = lambda name, stamp, data: [(name, stamp, data)] * (name != "pose")  # noqa: E731
    found = analyse(bare(bag, tmp_path / "bare", drop))
    assert [cycle.turned for cycle in found.cycles] == [None] * (PERIODS - 1)
    assert "turned" not in found.as_plain()["cycles"][0]


def test_slips_of_joint_states_alone_are_those_of_the_first_contact(bag, tmp_path):
    start = lambda name, stamp, data: [(name, stamp, data)] * (name == "joint_states" and stamp == 0)  # noqa: E731
    said = crawler("replay", bare(bag, tmp_path / "bare", start)).stdout
    assert "slips: known only of the first contact, as contact_states was not recorded\nslips: none\n" in said
    assert "only of the first contact" not in crawler("replay", bag).stdout


@pytest.mark.parametrize(
    ("name", "periods", "cut", "left_out"),
    [("scissors", 9, 7.0, ()), ("scissors", 9, 7.0, ("contact_states",)), ("three_link_snake", 2, 0.5, ())],
)
def test_a_recording_that_begins_in_mid_run_is_compared(name, periods, cut, left_out, tmp_path):
    """The scissors have turned round by then; the steps of the snake end elsewhere, within its tolerance."""
    late = lambda topic, stamp, data: [(topic, stamp, data)] * (stamp >= cut * NS and topic not in left_out)  # noqa: E731
    source = record(tmp_path / "bag", name, periods, wait=0.0, rate=RATE)
    whole = analyse(source)
    found = analyse(bare(source, tmp_path / "bare", late), load_scene(name))
    assert found.fitted_ns == pytest.approx((cut + 1.0 / RATE) * NS)
    assert found.problems == ()
    assert found.comparison.max_difference < 1e-6
    assert found.table.net_translation[-1] == pytest.approx(whole.table.net_translation[-1], abs=1e-6)
    assert math.remainder(found.table.yaw[-1] - whole.table.yaw[-1], math.tau) == pytest.approx(0.0, abs=1e-6)


def test_a_data_set_has_the_turn_of_bodies_that_turn(bag, run, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    from crawler_command.recordings.rows import tabulate

    def rows_of(folder):
        made = tabulate(str(folder / f"{folder.name}_0.mcap"), None, None)
        return {name: parquet.read_table(io.BytesIO(table)).to_pylist() for name, table in made.tables.items()}

    turns, line = rows_of(bag), rows_of(record(tmp_path / "line", "two_anchor_b", 1, rate=RATE))
    cycles = [[row[name] for name in ("translation", "translation_y", "turned")] for row in turns["cycles"]]
    assert np.array(cycles) == pytest.approx(run.per_period, abs=1e-12)
    (account,), (row,) = turns["account"], turns["runs"]
    assert account["turned"] == row["turned"] == pytest.approx(run.yaw[-1] - run.yaw[0])
    assert (row["stability_margin"], row["stability_time"]) == (run.stability_margin, run.stability_time)
    assert [line["runs"][0][name] for name in ("turned", "stability_margin", "stability_time")] == [None] * 3
    for name in ("cycles", "account"):
        assert list(line[name][0]) == list(turns[name][0])
        assert line[name][0]["turned"] is None


def test_points_that_do_not_touch_the_ground_neither_slip_nor_have_a_margin(tmp_path):
    """The hub of the star moves within a stroke that its feet hold."""
    scene = load_scene("tripedal_star")
    start, stroke = scene.drive.rows[0], 1e-4 * np.eye(scene.columns.count)[3]
    little = [(tick * 10**8, [10**8], [start + tick * stroke]) for tick in range(15)]
    pieces = []
    found = analyse(
        write(tmp_path / "star", messages(scene, little, 10.0), attachments(scene, 10.0)), sinks=[pieces.append]
    )
    assert found.slips.contact.size == 0
    gained = np.concatenate([piece.gained for piece in pieces])
    assert np.abs(gained[:, 0]).max() > 1e-7  # it moves all the same
    assert np.abs(np.sum(gained, axis=0) - (pieces[-1].position[-1] - scene.body.position)).max() < 1e-12
    assert found.margins.least > 0.01
    (rest,) = found.rests
    assert rest.commanded


def test_jumps_are_marked_on_the_page_and_move_a_body_without_slips(tmp_path, monkeypatch):
    """An arch on two feet that snaps through and back; its middle does not touch the ground."""
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    document = {
        "name": "arch",
        "dimension": 2,
        "body": {
            "points": [[0.0, 0.0], [1.0, 0.2], [2.0, 0.0]],
            "springs": "length",
            "links": {"stiffness": 20.0},
            "joints": {"stiffness": 0.1},
        },
        "friction": {"isotropic": [50.0, 0.0, 50.0]},
        "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0, 0, 0], [0, 0, 2.0], [0, 0, 0]]},
    }
    path = record(tmp_path / "bag", Scene.model_validate(document), 1, wait=0.0, rate=RATE)
    kept: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: kept.append(figure))
    said = crawler("replay", path, "--png", tmp_path / "page.png").stdout
    assert "slips: none\n" in said
    assert "2 jump(s) where stability was lost" in said
    words = [text.get_text() for text in kept[0].findobj(Text)]
    assert "2 jumps where stability was lost" in words
    assert "from above; 1 slip, too short for arrows" in words
