"""Scenes and recordings side by side, by the cycles of their drives."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from crawler_model import Scene, load_scene
from crawler_ros.replay.show.walks import tabulate_walks, walk_of_scene

from ...commands import crawler
from ...recordings import record


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A scene and a slower one in files with people's names, and a recording of the first."""
    folder = tmp_path_factory.mktemp("compared")
    document = load_scene("two_anchor_b").document()
    (folder / "mine.yaml").write_text(json.dumps(document))
    document["drive"]["period"] = 4.0
    document["drive"]["length"] = 6.0
    (folder / "slow.yaml").write_text(json.dumps(document))
    record(folder / "monday", "two_anchor_b", 3)
    return folder


def test_scenes_and_recordings_share_a_table_and_a_picture(folder):
    done = crawler("compare", "mine.yaml", "slow.yaml", "monday", "--png", "x.png", "--force", cwd=folder)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines if line.startswith("│")]
    assert [row[0] for row in rows] == ["mine", "slow", "monday"]
    assert [row[1] for row in rows] == ["10", "10", "3"]
    assert [row[2] for row in rows] == ["1", "4", "1"]  # each cycle lasts what it lasts in simulated time
    assert [row[3] for row in rows] == ["2", "2", "2"]
    assert [row[4] for row in rows] == ["", "0", "0"]
    assert [float(row[5]) for row in rows] == [2.0, 0.5, 2.0]
    assert rows[0][6] == rows[2][6]  # the same work
    assert Image.open(folder / "x.png").size[0] > 800


def test_the_rest_before_the_first_command_is_left_out(folder):
    runs = json.loads(crawler("compare", "mine.yaml", "monday", "--json", cwd=folder).stdout)["runs"]
    assert [run["source"] for run in runs] == ["scene", "recording"]
    assert runs[1]["translation"] == pytest.approx(runs[0]["translation"][:3], abs=1e-12)
    assert np.diff(runs[1]["starts"]) == pytest.approx(1.0)
    text = crawler("compare", "mine.yaml", "monday", cwd=folder).stdout
    assert ("what is before its first cycle" in text) == (runs[1]["starts"][0] > 0.0)


def test_recordings_alone_are_compared_by_cycles_where_asked(folder):
    assert "commands: the same" in crawler("compare", "monday", "monday", cwd=folder).stdout
    done = crawler("compare", "monday", "./monday", "--by-phase", cwd=folder)
    assert "cycle 3, the last that all runs have" in done.stdout


def test_of_runs_of_other_lengths_cycles_of_the_same_number_are_compared():
    long, other = (walk_of_scene(name, load_scene("two_anchor_b")) for name in ("long", "short"))
    long = replace(long, gains=np.arange(10.0)[:, None])
    short = replace(other, starts=other.starts[:6], ends=other.ends[:6], gains=np.arange(6.0)[:, None])
    for pair in ([long, short], [short, long]):
        table = tabulate_walks(pair)
        assert table.title.startswith("cycle 6, ")
        columns = {column.header: list(column.cells) for column in table.columns}
        assert columns["translation [m]"] == ["5", "5"]
        assert columns["difference [m]"] == ["", "0"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["mine.yaml"], "mine.yaml: 1 run; a comparison needs two"),
        (["mine.yaml", "nothing"], "nothing: no such file, nor a scene of the gallery"),
        (["mine.yaml", "idle.yaml"], "idle: the scene has no drive; a comparison needs cycles"),
        (["mine.yaml", "monday", "--png", "x.gif"], "--png: x.gif must end in .png"),
    ],
)
def test_a_mistake_is_one_line(folder, words, said):
    idle = "{name: i, body: {contacts: [0, 1], links: {stiffness: 1}}, friction: {isotropic: 1}}"
    (folder / "idle.yaml").write_text(idle)
    done = crawler("compare", *words, cwd=folder)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert said in line


def test_bodies_of_other_dimensions_have_no_difference(folder):
    done = crawler("compare", "mine.yaml", "planar_three_points", cwd=folder)
    assert done.returncode == 0, done.stderr
    (row,) = [line for line in done.stdout.splitlines() if "planar_three_points" in line and line.startswith("│")]
    assert row.split("│")[5].strip() == ""


@pytest.mark.parametrize("period", [2.0 / 3.0, 2.0 * np.pi])
def test_periods_that_ticks_divide_but_for_rounding_are_compared(period):
    """Instants are whole nanoseconds: an instant more than the ticks of ten periods ended in a traceback."""
    document = load_scene("two_anchor_b").document()
    document["drive"]["period"] = period
    walk, other = walk_of_scene("b", Scene.model_validate(document)), walk_of_scene("a", load_scene("two_anchor_b"))
    assert walk.gains == pytest.approx(other.gains, abs=1e-7)
    assert walk.work == pytest.approx(other.work, rel=1e-7)
    assert walk.phase.size == walk.y.shape[0]


@pytest.mark.parametrize("period", [None, 1.0])
def test_the_gain_of_a_body_that_turns_is_in_its_own_frame(period):
    """Of a drive without a period it was in the fixed frame, whichever way the body lay."""
    document = load_scene("steering_inchworm").document()
    rows = np.zeros((3, 8))
    rows[1, :2] = 0.3, 0.1
    document["drive"] = {"times": [0.0, 0.5, 1.0], "actuation": rows.tolist()}
    if period is not None:
        document["drive"]["period"] = period
    ahead = walk_of_scene("ahead", Scene.model_validate(document))
    document["body"]["points"] = [[-y, x] for x, y in document["body"]["points"]]
    left = walk_of_scene("left", Scene.model_validate(document))
    assert ahead.gains[0, 0] > 0.2
    assert left.gains == pytest.approx(ahead.gains, abs=1e-6)
    assert left.turned == pytest.approx(ahead.turned, abs=1e-6)
