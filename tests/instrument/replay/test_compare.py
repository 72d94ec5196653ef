"""Two recordings side by side."""

from __future__ import annotations

import itertools
import json
import os
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from crawler_command.screen import Screen
from crawler_model import Scene, load_scene
from crawler_model.body.drive import NS
from crawler_ros.recording.bag import BagError
from crawler_ros.replay.show.compare import compare_recordings, print_comparison
from crawler_ros.replay.show.compare_page import draw_comparison
from crawler_ros.replay.show.report import _print_cycles
from crawler_ros.replay.show.walks import draw_walks, print_walks, tabulate_walks, walk_of_recording

from ...commands import crawler
from ...recordings import attachments, messages, play, record, write


def longer(name: str, length: float) -> Scene:
    document = load_scene(name).document()
    document["drive"]["length"] = length
    return Scene.model_validate(document)


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """Strategy B at k Lmax = 4 mu and at 6 mu: the same gain at another price."""
    folder = tmp_path_factory.mktemp("pair")
    return tuple(record(folder / f"b{length}", longer("two_anchor_b", length), 3) for length in (4, 6))


def test_a_run_is_like_itself(pair):
    found = compare_recordings(pair[0], pair[0])
    assert found.commands_differ is None
    assert found.motion_differs is None
    assert found.max_difference == 0.0
    assert all(v == 0.0 for v in found.energy.values())
    assert all(s["count"] == 0 and s["distance"] == 0.0 for s in found.slips)


def test_more_amplitude_costs_more_and_gains_nothing(pair):
    found = compare_recordings(*pair)
    assert [float(v) for v in found.translation] == pytest.approx([0.0] * 3, abs=1e-12)
    assert found.commands_differ == pytest.approx(0.31)
    assert found.energy["dissipation"] > 3.0
    assert all(s["distance"] > 1.0 for s in found.slips)


def test_two_rates_of_one_gait_command_the_same(tmp_path):
    a, b = (record(tmp_path / f"r{rate}", "two_anchor_a", 2, rate=rate) for rate in (100.0, 20.0))
    found = compare_recordings(a, b)
    assert found.commands_differ is None
    assert found.motion_differs is None
    assert found.max_difference < 1e-12


def test_runs_after_a_reset_are_compared_too(tmp_path):
    """What followed a reset was left out, and the commands were called the same."""
    scene, other = load_scene("two_anchor_b"), longer("two_anchor_b", 6)
    folders = []
    for name, second in (("a", scene), ("b", other)):
        runs = [messages(scene, play(one, 300_000_000, 300_000_000 + 2 * NS)) for one in (scene, second)]
        folders.append(write(tmp_path / name, itertools.chain(*runs), attachments(scene)))
    found = compare_recordings(*folders)
    assert found.commands_differ == pytest.approx(0.31)
    assert found.resets == (1, 1)
    assert found.max_difference > 0.0
    screen = Screen(record=True, width=120)
    print_comparison(found, screen)
    assert "commands: different from 0.31 s after reset 1 on" in screen.export_text(clear=False)
    print_walks([walk_of_recording(folder.name, found.first) for folder in folders], screen)
    assert "a: what follows its first reset is left out" in screen.export_text()
    draw_comparison(found, tmp_path / "x.png")


def test_different_bodies_are_refused(pair, tmp_path):
    other = record(tmp_path / "c", "three_contacts_one_way", 1)
    with pytest.raises(BagError, match="different bodies"):
        compare_recordings(pair[0], other)


def test_the_command_prints_json_text_and_a_figure(pair, tmp_path):
    done = crawler("compare", *pair, "--json", "--png", tmp_path / "x.png")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["commands"]["first_difference"] == pytest.approx(0.31)
    assert len(said["translation"]) == 3
    assert Image.open(tmp_path / "x.png").size[0] > 800
    text = crawler("compare", *pair).stdout
    assert "commands: different from 0.31 s on" in text
    assert len(text.splitlines()) < 30


def test_the_figure_is_drawn_of_bodies_in_the_plane(tmp_path):
    path = record(tmp_path / "p", "planar_rectilinear", 1)
    found = compare_recordings(path, path)
    draw_comparison(found, tmp_path / "x.png")
    assert (tmp_path / "x.png").stat().st_size > 20_000
    json.dumps(found.as_plain(), allow_nan=False)


def test_what_a_body_gains_to_the_left_and_turns_is_shown(tmp_path, monkeypatch, capsys):
    path = record(tmp_path / "star", "tripedal_star", 2, rate=10.0)
    found, kept = compare_recordings(path, path), []
    table, cycles = found.first.table, found.first.cycles
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: kept.append(figure))
    draw_comparison(found, tmp_path / "x.png")
    translation = kept[0].axes[0]
    drawn = [line.get_ydata() for line in translation.lines[:2]]
    assert np.array_equal(np.array(drawn).T, table.net_translation - table.net_translation[0])
    assert "(thick: x, thin: y)" in translation.get_title("left")
    left = [cycle.translation[1] for cycle in cycles]
    assert any(list(line.get_ydata()) == left for line in kept[0].axes[1].lines)
    print_comparison(found, Screen(width=200))
    text = capsys.readouterr().out
    (row,) = (line for line in text.splitlines() if "turned in cycle 2, rad" in line)
    assert float(row.split("│")[2]) == pytest.approx(cycles[1].turned, abs=1e-6)
    assert cycles[1].turned > 0.2
    assert text.count(f"{table.yaw[-1] - table.yaw[0]:.6f}".rstrip("0")) == 2
    walk = walk_of_recording("star", found.first)
    draw_walks([walk, walk], tmp_path / "x.png")
    assert [len(axis.lines) for axis in kept[1].axes] == [4, 4]
    other = replace(walk, gains=walk.gains + np.array([0.5, -0.25]))
    (difference,) = (column for column in tabulate_walks([walk, other]).columns if column.header == "difference [m]")
    assert list(difference.cells) == ["", "0.5, -0.25"]
    assert walk.as_plain()["turned"] == found.as_plain()["runs"][1]["turned"] == [cycle.turned for cycle in cycles]
    print_walks([walk, walk], Screen(width=200))
    assert "turned [rad]" in capsys.readouterr().out


@pytest.mark.parametrize("count", [6, 7, 30])
def test_of_many_cycles_the_first_and_the_last_are_printed(count, pair, capsys):
    found = compare_recordings(*pair).first
    cycles = [replace(found.cycles[0], start=float(k)) for k in range(count)]
    _print_cycles(replace(found, cycles=cycles), Screen(width=200))
    rows = [line.split("│")[1].split()[0] for line in capsys.readouterr().out.splitlines() if line.startswith("│")]
    assert rows == [str(k) for k in range(6)] if count == 6 else ["0", "1", "2", "3", f"({count - 5}", str(count - 1)]


def test_cycles_after_a_reset_are_not_drawn_over_those_before_it(pair, tmp_path, monkeypatch):
    found, kept = compare_recordings(*pair), []
    again = [replace(cycle, run=1) for cycle in found.first.cycles]
    found = replace(found, first=replace(found.first, cycles=[*found.first.cycles, *again]))
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: kept.append(figure))
    draw_comparison(found, tmp_path / "x.png")
    assert len(kept[0].axes[1].patches) == 3 + 3


def test_what_was_set_up_differently_is_told(pair, capsys):
    print_comparison(compare_recordings(*pair), Screen())
    said = capsys.readouterr().out
    assert "scenes (A / B): drive.length" in said
    assert "versions" not in said  # they are the same


def test_of_a_folder_of_recordings_the_newest_is_compared(tmp_path):
    old, new = (
        record(tmp_path / "bags" / name, longer("two_anchor_b", length), 3) for name, length in (("a", 4), ("b", 6))
    )
    os.utime(next(old.glob("*.mcap")), (1.0, 1.0))
    told = crawler("compare", str(tmp_path / "bags"), str(new), "--json")
    assert told.returncode == 0, told.stderr
    assert json.loads(told.stdout) == json.loads(crawler("compare", str(new), str(new), "--json").stdout)


def test_cycles_are_paired_by_time_and_not_by_number(pair, tmp_path):
    """A run that waits two periods longer: its first cycle takes place during the third of the other."""
    later = record(tmp_path / "later", longer("two_anchor_b", 4), 3, wait=2.3)
    found = compare_recordings(pair[0], later)
    assert found.pairs == ((2, 0),)
    assert found.unpaired == "cycles: 2 of A and 2 of B without a partner at the same time"
    assert len(found.translation) == 1
    assert found.as_plain()["cycles"]["pairs"] == [[2, 0]]


def test_cycles_at_other_times_are_not_compared_and_it_says_why(pair, tmp_path, capsys):
    later = record(tmp_path / "later", longer("two_anchor_b", 4), 2, wait=0.8)
    found = compare_recordings(pair[0], later)
    assert found.pairs == found.translation == ()
    print_comparison(found, Screen(width=200))
    wanted = "not at the same times: cycles of A last 1 s from 0.3 s on, cycles of B last 1 s from 0.8 s on"
    assert wanted in capsys.readouterr().out
    draw_comparison(found, tmp_path / "x.png")
    assert Image.open(tmp_path / "x.png").size[0] > 800


def test_a_folder_of_recordings_is_compared_with_its_first(tmp_path):
    for name, length in (("c", 6), ("a", 4), ("b", 4)):
        record(tmp_path / "bags" / name, longer("two_anchor_b", length), 2)
    done = crawler("compare", tmp_path / "bags", "--json", "--png", tmp_path / "x.png")
    assert done.returncode == 0, done.stderr
    runs = json.loads(done.stdout)["runs"]
    assert [run["name"] for run in runs] == ["a", "b", "c"]
    assert runs[0]["work"] == runs[1]["work"] != runs[2]["work"]
    assert Image.open(tmp_path / "x.png").size[0] > 800
    text = crawler("compare", *(tmp_path / "bags" / name for name in "bac")).stdout
    assert "difference from b" in text


def test_a_single_recording_has_nothing_to_be_compared_with(pair):
    done = crawler("compare", pair[0])
    assert done.returncode == 1
    assert "a comparison needs two, or a folder of at least two bags" in done.stderr
