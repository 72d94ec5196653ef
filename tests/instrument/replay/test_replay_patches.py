"""Recordings on patches of ground: jumps in the results, in the account of energy, in tables, report and page."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("pyarrow")
pytest.importorskip("matplotlib")
from PIL import Image
from pyarrow import parquet

from crawler_command.screen import Screen
from crawler_model import Scene, load_scene, simulate
from crawler_pictures.colors import JUMP, rgb
from crawler_ros.replay import analyse
from crawler_ros.replay.show.replay_page import draw_replay, read_replay
from crawler_ros.replay.show.report import print_replay
from crawler_ros.replay.show.samples import Samples
from crawler_ros.replay.show.tables import TableWriter

from ...recordings import attachments, messages, play, record, write

WAIT = 0.3


def icy(name: str = "icy", factor: float = 0.5) -> Scene:
    """Two contacts on a spring; each jumps onto ice at 1.25 m and loses 0.02 J, the front one when L = 0.65, at 0.325 s."""
    return Scene.model_validate(
        {
            "name": name,
            "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}},
            "friction": {"forward": 0.4, "backward": 1.0},
            "ground": {"patches": [{"from": 1.25, "to": 9.0, "friction": factor}]},
            "drive": {"times": [0.0, 1.0, 2.0], "period": 2.0, "actuation": [[0.0], [2.0], [0.0]]},
        }
    )


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return record(tmp_path_factory.mktemp("icy") / "bag", icy(), 1)


@pytest.fixture(scope="module")
def found(bag):
    kept: list = []

    def open_sinks(survey, scene):
        kept.append(Samples(survey))
        return kept

    replay = analyse(bag, sinks=open_sinks)
    return replay, kept[0]


def test_the_jumps_are_those_of_the_model_at_their_times(found):
    replay, _ = found
    assert replay.problems == ()
    assert replay.comparison.identical
    plain = json.loads(json.dumps(replay.as_plain(), allow_nan=False))
    jumps, alone = plain["jumps"], simulate(icy(), 2.0).jumps
    assert len(jumps) == len(alone) > 0
    assert list(jumps[0]) == ["run", "time", "contact", "border", "distance", "loss"]
    assert (jumps[0]["run"], jumps[0]["contact"], jumps[0]["border"]) == (0, "contact_1", 1.25)
    assert jumps[0]["time"] == pytest.approx(WAIT + 0.325, abs=1e-9)
    for jump, own in zip(jumps, alone, strict=True):
        assert jump["time"] == pytest.approx(WAIT + own.time, abs=1e-9)
        assert jump["distance"] == pytest.approx(own.distance, abs=1e-13)
        assert jump["loss"] == pytest.approx(own.loss, abs=1e-13)


def test_the_account_of_energy_closes_with_the_loss(found):
    replay, _ = found
    energy = replay.as_plain()["energy"]
    assert energy["jump_loss"] == pytest.approx(sum(jump["loss"] for jump in replay.plain_jumps()), abs=1e-15)
    assert energy["jump_loss"] == pytest.approx(0.04, abs=1e-13)
    rest = energy["stored"] + energy["dissipation"] + energy["jump_loss"] - energy["work"] - energy["loads_work"]
    assert abs(rest) < 1e-13
    assert energy["residual"] < 1e-13
    assert sum(cycle.energy.jump_loss for cycle in replay.cycles) == pytest.approx(energy["jump_loss"], abs=1e-15)
    assert all(cycle.energy.residual < 1e-13 for cycle in replay.cycles)


def test_the_curves_of_energy_balance_with_the_loss(found):
    energy = read_replay(*found).energy
    assert list(energy) == ["work of the actuators", "dissipation", "stored", "lost in jumps"]
    work, dissipation, stored, lost = energy.values()
    assert lost[-1] == pytest.approx(0.04, abs=1e-13)
    assert stored + dissipation + lost == pytest.approx(work, abs=1e-13)


def test_margins_and_bounds_are_those_of_the_ground_under_each_contact(bag):
    """On ice the front is held by 0.2 N: its tension is 0.2 N while it slides, at its bound."""
    pieces = []
    replay = analyse(bag, sinks=[pieces.append])
    assert abs(replay.margins.least) < 1e-12
    least, tension = (np.concatenate([getattr(p, name) for p in pieces])[:, 0] for name in ("least", "tension"))
    most, position = (np.concatenate([getattr(p, name) for p in pieces]) for name in ("most", "position"))
    gained = np.concatenate([p.gained for p in pieces])[:, 1]
    slides = (position[:, 1] > 1.3) & (gained > 0.0)
    assert slides.sum() > 10
    assert -tension[slides] == pytest.approx(np.full(slides.sum(), 0.2), abs=1e-12)
    assert (tension >= least - 1e-12).all()
    assert (tension <= most[:, 0] + 1e-12).all()
    assert np.minimum(tension - least, most[:, 0] - tension)[slides] == pytest.approx(0.0, abs=1e-12)


def test_a_slope_of_a_patch_adds_to_the_force_of_the_ground(tmp_path):
    plain = icy("hill").document()
    plain["body"]["weights"] = 0.5
    plain["ground"] = {"patches": [{"from": 0.5, "to": 9.0, "slope": 10.0}]}
    pieces = []
    replay = analyse(record(tmp_path / "bag", Scene.model_validate(plain), 1), sinks=[pieces.append])
    assert replay.comparison.identical
    ground, position = (np.concatenate([getattr(p, name) for p in pieces]) for name in ("ground", "position"))
    border = np.abs(position - 0.5) < 1e-12
    up = np.where(border, 0.5, position > 0.5)
    assert 1.0 <= up.sum(axis=1).min() < up.sum(axis=1).max() == 2.0
    assert ground.sum(axis=1) == pytest.approx(0.5 * np.sin(np.radians(10.0)) * up.sum(axis=1), abs=1e-12)
    assert replay.energy.loads_work != 0.0
    assert replay.energy.residual < 1e-13
    assert replay.plain_jumps() == []


def test_jumps_count_in_every_run_between_resets(tmp_path):
    scene, period = icy(), 2 * 10**9
    sent = [*messages(scene, play(scene, 0, period)), *messages(scene, play(scene, 0, period))]
    kept: list = []

    def open_sinks(survey, loaded):
        kept.append(Samples(survey))
        return kept

    replay = analyse(write(tmp_path / "bag", sent, attachments(scene)), sinks=open_sinks)
    assert [(jump["run"], round(jump["time"], 9)) for jump in replay.plain_jumps()] == [
        (run, when) for run in (0, 1) for when in (0.325, 1.925)
    ]
    assert [round(jump.time, 9) for jump in kept[0].jumps] == [0.325, 1.925, 2.325, 3.925]
    assert replay.energy.residual < 1e-13


def test_the_tables_hold_jumps_only_on_patches(bag, tmp_path):
    def tables(path, folder, scene):
        writer = TableWriter(folder, scene)
        return analyse(path, sinks=[writer]), writer

    replay, writer = tables(bag, tmp_path / "icy", icy())
    assert "jumps.parquet" in writer.finish(replay)
    jumps = parquet.read_table(tmp_path / "icy" / "jumps.parquet")
    assert jumps.column_names == ["run", "time", "contact", "border", "distance", "loss"]
    assert jumps.schema.field("loss").metadata == {b"unit": b"J"}
    assert jumps.to_pylist() == replay.plain_jumps()
    ticks, cycles = (parquet.read_table(tmp_path / "icy" / f"{name}.parquet") for name in ("ticks", "cycles"))
    for table in (ticks, cycles):
        assert sum(table["jump_loss"].to_pylist()) == pytest.approx(replay.energy.jump_loss, abs=1e-15)

    plain = record(tmp_path / "plain", "two_anchor_a", 1)
    replay, writer = tables(plain, tmp_path / "two", load_scene("two_anchor_a"))
    assert "jumps.parquet" not in writer.finish(replay)
    assert replay.as_plain()["jumps"] == []
    assert replay.as_plain()["energy"]["jump_loss"] == 0.0


def printed(replay) -> str:
    screen = Screen(width=300)
    with screen.capture() as output:
        print_replay(replay, screen)
    return output.get()


def test_the_report_has_a_line_where_there_are_jumps(found, tmp_path):
    text = printed(found[0])
    assert (
        "2 jump(s) onto ground that holds less, 0.04 J lost; the longest: contact_1 at 0.625 s, 0.2 m from the border "
        "at 1.25 m"
    ) in text
    assert "lost in jumps 0.04 J, " in text
    assert "jump" not in printed(analyse(record(tmp_path / "plain", "two_anchor_a", 1)))


def count_marks(replay, samples, png) -> int:
    draw_replay(replay, samples, png)
    picture = np.asarray(Image.open(png).convert("RGB")).astype(int)
    return int((np.abs(picture - rgb(JUMP)).max(axis=2) < 40).sum())


def test_the_page_marks_jumps(found, tmp_path):
    replay, samples = found
    marked = count_marks(replay, samples, tmp_path / "icy.png")
    assert marked > 100
    kept, samples.jumps = samples.jumps, []
    assert count_marks(replay, samples, tmp_path / "none.png") == 0
    samples.jumps = kept


@pytest.mark.parametrize("name", ["slope_climber", "hill_top"])
def test_a_drive_on_slopes_is_recorded_as_it_is_simulated(name, tmp_path):
    periods = 3
    replay = analyse(record(tmp_path / "bag", name, periods, wait=0.0))
    assert replay.comparison.identical
    scene = load_scene(name)
    run = simulate(scene, periods * scene.drive.period)
    assert [cycle.translation for cycle in replay.cycles] == pytest.approx(run.per_period.tolist(), abs=1e-12)


def test_a_recording_of_a_walk_to_a_wall_is_simulated_again_to_the_bit(tmp_path):
    """Margins know that the wall holds any force, so that none is negative."""
    replay = analyse(record(tmp_path / "bag", load_scene("wall_pusher"), 6))
    assert replay.problems == ()
    assert replay.comparison.identical
    assert replay.margins.least >= -1e-12
    assert replay.margins.visited > 0.0


def test_a_recording_on_gradual_ground_is_repeated_to_the_bit(tmp_path):
    """Each foot jumps where the ground begins to hold less; its margins are those of the ground below it."""
    ground = {"profile": {"at": [0.5, 1.25, 1.3, 9.0], "friction": [1.0, 1.5, 0.5, 0.6]}}
    scene = Scene.model_validate(icy().document() | {"name": "gradual", "ground": ground})
    replay = analyse(record(tmp_path / "bag", scene, 1))
    assert replay.problems == ()
    assert replay.comparison.identical
    jumps, alone = replay.plain_jumps(), simulate(scene, 2.0).jumps
    assert [jump["contact"] for jump in jumps] == [f"contact_{jump.contact}" for jump in alone]
    assert len(jumps) > 0
