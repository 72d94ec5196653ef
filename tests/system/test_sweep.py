"""`crawler sweep` as a user types it, here and on a Dask cluster."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from crawler_command.app import main
from crawler_command.units import unit_of
from crawler_model import Scene, load_scene

from ..processes import PATIENCE_S, wait_until
from .test_command import CRAWLER, good

pq = pytest.importorskip("pyarrow.parquet")
distributed = pytest.importorskip("distributed")

LENGTHS = ["--vary", "drive.length=0:6:13"]


def table_of(path: Path):
    return pq.read_table(path)


def test_a_line_over_one_key(tmp_path):
    text = good("sweep", "two_anchor_b", *LENGTHS, "--out", "b.parquet", cwd=tmp_path)
    assert "13 variations of drive.length; 13 done" in text
    assert "largest net translation in the last period: 2 m" in text
    table = table_of(tmp_path / "b.parquet")
    done = np.array(table["status"].to_pylist()) == "done"
    length = np.array(table["drive.length"])
    gained = np.array(table["per_period"].to_pylist(), dtype=float)
    assert length.tolist() == np.linspace(0, 6, 13).tolist()
    assert gained[done] == pytest.approx(np.clip(length - 1, 0, 2)[done], abs=1e-12)
    assert (tmp_path / "b.png").stat().st_size > 5_000
    assert table.schema.field("per_period").metadata == {b"unit": b"m"}
    assert table.schema.field("drive.length").metadata == {b"unit": b"m"}


def test_a_body_that_turns(tmp_path):
    keys = ["--vary", "body.joints.stiffness=4,5,8", "--vary", "friction.left[1]=0.05,0.1"]
    options = ["--duration", "3", "--rate", "20", "--plot", "dyaw", "--out", "turn.parquet"]
    text = good("sweep", "scissors", *keys, *options, cwd=tmp_path)
    assert "3 x 2 variations of body.joints.stiffness, friction.left[1]; 6 done" in text
    assert "largest forward motion in the last period" in text
    table = table_of(tmp_path / "turn.parquet")
    turned = np.array(table["dyaw"].to_pylist()).reshape(3, 2)[:, 1]
    assert turned == pytest.approx(0.5 - 2.0 * 0.1 / np.array([4, 5, 8]), abs=1e-5)
    assert table.schema.field("body.joints.stiffness").metadata == {b"unit": b"N m/rad"}
    assert table.schema.field("dyaw").metadata == {b"unit": b"rad"}
    assert (tmp_path / "turn.png").stat().st_size > 5_000


def test_a_map_over_two_keys_in_the_grids_order(tmp_path):
    keys = ["--vary", "friction.forward=log:0.05:0.2:4", "--vary", "body.links.stiffness=20,60,-1"]
    out = ["--out", "w.parquet", "--png", "map.png", "--duration", "3", "--workers", "2", "--json"]
    about = json.loads(good("sweep", "ten_contact_wave", *keys, *out, cwd=tmp_path))
    assert about["schema"] == 1
    assert about["shape"] == [4, 3]
    assert (about["done"], about["invalid"], about["not_run"]) == (8, 4, 0)
    assert about["picture"] == "map.png"
    assert about["best"]["at"].keys() == {"friction.forward", "body.links.stiffness"}
    assert (tmp_path / "map.png").stat().st_size > 5_000
    table = table_of(tmp_path / "w.parquet")
    assert table["friction.forward"].to_pylist() == np.repeat(np.geomspace(0.05, 0.2, 4), 3).tolist()
    assert table["body.links.stiffness"].to_pylist() == [20, 60, -1] * 4
    assert table["status"].to_pylist() == ["done", "done", "invalid"] * 4
    assert "stiffness" in table["reason"][2].as_py()
    assert table["work"][2].as_py() is None
    assert table["unique"][2].as_py() is None
    assert table["efficiency"][0].as_py() == table["gained"][0].as_py() / table["dissipation"][0].as_py()
    sweep = json.loads(table.schema.metadata[b"crawler_sweep"])
    assert sweep["scene"]["name"] == "ten_contact_wave"
    assert sweep["vary"] == {"friction.forward": "log:0.05:0.2:4", "body.links.stiffness": "20,60,-1"}
    assert sweep["duration_s"] == 3.0
    assert sweep["complete"] is True
    assert {"crawler-ros", "numpy", "numba", "python"} <= sweep["versions"].keys()


def test_an_axis_may_be_a_ratio_to_a_number_that_varies_or_is_the_scenes(tmp_path):
    ratio, forward, backward = "friction.forward/friction.backward", "friction.forward", "friction.backward"
    keys = ["--vary", f"{ratio}=0.25:0.75:3", "--vary", f"{backward}=1,2"]
    out = ["--out", "r.csv", "--png", "r.svg", "--json"]
    about = json.loads(good("sweep", "two_contacts_anisotropic", *keys, *out, cwd=tmp_path))
    assert (about["shape"], about["done"]) == ([3, 2], 6)
    with (tmp_path / "r.csv").open(newline="") as stream:
        rows = [(float(row[forward]), float(row[backward])) for row in csv.DictReader(stream)]
    assert rows == [(r * b, b) for r in (0.25, 0.5, 0.75) for b in (1.0, 2.0)]
    assert f"<!-- {ratio} -->" in (tmp_path / "r.svg").read_text(encoding="utf-8")
    good("sweep", "two_contacts_anisotropic", *keys[:2], "--out", "one.parquet", cwd=tmp_path)
    own = load_scene("two_contacts_anisotropic").document()["friction"]["backward"]
    assert table_of(tmp_path / "one.parquet")[forward].to_pylist() == [r * own for r in (0.25, 0.5, 0.75)]


def test_a_csv_table_has_the_same_numbers(tmp_path):
    keys = ["--vary", "ground.slope=0:20:3", "--vary", "loads[0]=-0.1:0:2"]
    for file in ("s.parquet", "s.csv"):
        good("sweep", "slope_climber", *keys, "--out", file, "--force", cwd=tmp_path)
    with (tmp_path / "s.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    table = table_of(tmp_path / "s.parquet")
    assert list(rows[0]) == table.column_names
    for name in ("ground.slope", "loads[0]", "per_period", "cost_of_transport"):
        assert [float(row[name]) for row in rows] == table[name].to_pylist()


def test_curves_over_slope_and_tow_have_units_costs_and_body_lengths(tmp_path):
    keys = ["--vary", "ground.slope=0:20:5", "--vary", "loads[0]=-0.1:0:3"]
    about = json.loads(good("sweep", "slope_climber", *keys, "--out", "s.parquet", "--json", cwd=tmp_path))
    assert about["shape"] == [5, 3]
    assert about["done"] == 15
    table = table_of(tmp_path / "s.parquet")
    units = {name: table.schema.field(name).metadata[b"unit"].decode() for name in ("ground.slope", "loads[0]")}
    assert units == {"ground.slope": "degrees", "loads[0]": "N"}
    slope, load = np.radians(np.array(table["ground.slope"])), np.array(table["loads[0]"])
    a, b = 2.0 * (0.2 * np.cos(slope) + np.sin(slope)) - load, 2.0 * (0.8 * np.cos(slope) - np.sin(slope)) + load
    expected = np.where(a < b, 0.1 - a / 20.0, -(0.1 - b / 20.0))
    assert np.array(table["per_period"]) == pytest.approx(expected, abs=1e-12)
    assert np.array(table["body_lengths"]) == pytest.approx(expected / 0.2, abs=1e-12)
    assert np.array(table["cost_of_transport"]) == pytest.approx(np.where(a < b, a, b) / 2.0, abs=1e-11)
    assert np.array(table["period_work"]) == pytest.approx(np.where(a < b, a, b) * np.abs(expected), abs=1e-12)


@pytest.mark.parametrize(
    ("scene", "key", "unit"),
    [
        ("friction_step", "ground.patches[0].friction", "1"),
        ("friction_step", "ground.patches[0].from", "m"),
        ("scissors", "body.points[0][0]", "m"),
        ("silicone_chain", "body.links.curve.elongation[1]", "m"),
        ("peristaltic_stops", "body.links.passive.stops.longest", "m"),
        ("hybrid_body", "body.segments.trunk.passive.stops.longest", "1"),
        ("heterogeneous_segment", "body.segments.trunk.stiffness.at[0]", "m"),
        ("heterogeneous_segment", "body.segments.trunk.friction.forward.at[1]", "m"),
        ("continuous_segment", "loads", "N/m"),
        ("hybrid_body", "drive.friction.forward[1]", "N, N/m"),
        ("hybrid_body", "drive.friction.forward[1][0]", "N"),
        ("planar_rectilinear", "ground.direction", "rad"),
        ("hybrid_body", "loads", "N, N/m"),
        ("hybrid_body", "loads[0]", "N"),
        ("hybrid_body", "loads.1", "N/m"),
        ("hybrid_body", "body.weights[1]", "N/m"),
        ("hybrid_body", "ground.slope", "degrees"),
        ("hybrid_body", "friction.coefficient.forward[0]", "1"),
        ("hybrid_body", "friction.forward[0]", "N"),
    ],
)
def test_every_number_has_its_unit(scene, key, unit):
    assert unit_of(load_scene(scene), key) == unit


def test_three_keys_make_a_table_alone_and_the_plane_two_columns(tmp_path):
    keys = [
        "--vary",
        "friction.value.0=0.2,0.25",
        "--vary",
        "friction.value.2=0.5,0.6",
        "--vary",
        "tolerance=1e-3,1e-2",
    ]
    text = good(
        "sweep", "planar_rectilinear", *keys, "--out", "p.parquet", "--duration", "2", "--rate", "4", cwd=tmp_path
    )
    assert "2 x 2 x 2" in text
    assert not (tmp_path / "p.png").exists()
    names = table_of(tmp_path / "p.parquet").column_names
    assert {"per_period_x", "per_period_y", "efficiency_x"} <= set(names)


def test_nothing_is_overwritten_unasked(tmp_path, monkeypatch, capsys):
    def sweep(*more: str) -> int:
        return command_status(["sweep", "two_anchor_b", *LENGTHS, "--out", "b.parquet", *more], tmp_path, monkeypatch)

    assert sweep() == 0
    before = (tmp_path / "b.parquet").read_bytes()
    assert sweep() == 1
    assert "b.parquet exists already" in capsys.readouterr().err
    assert sweep("--overwrite") == 0
    assert (tmp_path / "b.parquet").read_bytes() == before
    (tmp_path / "b.parquet").unlink()
    assert sweep() == 1
    assert "b.png exists already" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["b.png"]


def test_a_table_that_cannot_be_written_leaves_nothing(tmp_path, monkeypatch, capsys):
    def fail(table, path, **options):
        Path(path).write_bytes(b"PAR1")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pyarrow.parquet.write_table", fail)
    assert command_status(["sweep", "two_anchor_b", *LENGTHS, "--out", "b.parquet"], tmp_path, monkeypatch) == 1
    assert "No space left on device" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_ctrl_c_writes_what_is_done(tmp_path):
    keys = ["--vary", "drive.length=0:6:200", "--vary", "drive.period=1:2:50", "--duration", "100"]
    command = [CRAWLER, "sweep", "two_anchor_b", *keys, "--out", "b.parquet"]
    screen, stderr = os.openpty()  # a terminal, on which it shows how far it is
    process = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=stderr, text=True, env=os.environ | {"TERM": "xterm"}
    )
    os.close(stderr)
    shown: list[str] = []
    reader = threading.Thread(target=read_screen, args=(screen, shown))
    reader.start()
    wait_for(lambda: re.search(r"[1-9]\d* %", "".join(shown)), process)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=PATIENCE_S)
    reader.join()
    os.close(screen)
    assert process.returncode == 130, shown
    assert "Traceback" not in "".join(shown)
    assert "not run" in out
    assert "stopped: the table holds the finished runs" in out
    table = table_of(tmp_path / "b.parquet")
    assert 0 < table.num_rows < 10_000
    assert "not run" not in table["status"].to_pylist()
    assert json.loads(table.schema.metadata[b"crawler_sweep"])["complete"] is False
    assert sorted(p.name for p in tmp_path.iterdir()) == ["b.parquet", "b.png"]


def read_screen(screen: int, shown: list[str]) -> None:
    with contextlib.suppress(OSError):  # the other end is closed
        while data := os.read(screen, 1 << 16):
            shown.append(data.decode(errors="replace"))


MISTAKES = [
    ([*LENGTHS, "--vary", "drive.length=1:2:3"], "drive.length: the key is repeated"),
    (["--vary", "drive.lenth=0:6:3"], "drive.lenth: unknown key; the nearest known key is 'drive.length'"),
    (["--vary", "drive.length/drive.lenth=1,2"], "drive.lenth: unknown key"),
    ([*LENGTHS, "--vary", "drive.length/drive.friction=1,2"], "no other --vary may change how they follow"),
    (["--vary", "drive.strategy=0:6:3"], "'B' is not a number"),
    (["--vary", "drive.length"], "write KEY=FROM:TO:N"),
    (["--vary", "drive.length=0:6"], "write KEY=FROM:TO:N"),
    (["--vary", "drive.length=0:six:3"], "'six' is not a number"),
    (["--vary", "drive.length=1,inf"], "'inf' is not finite"),
    (["--vary", "drive.length=0:6:0"], "N is 0; it must be between 1"),
    (["--vary", "drive.length=0:6:2.5"], "N is '2.5'; it must be a whole number"),
    (["--vary", "drive.length=log:0:6:5"], "with `log:` both ends must be > 0"),
    (["--vary", "drive.length=0:6:9999", "--vary", "drive.friction=1:2:9999"], "at most 10000000"),
    (["--vary", "drive.friction=-2,-1"], "no variation is valid; the reason of the first: drive: friction: -2 N"),
    ([*LENGTHS, "--out", "x.xlsx"], "must end in .parquet or .csv"),
    ([*LENGTHS, "--out", "nodir/x.parquet"], "the folder"),
    ([*LENGTHS, "--png", "x.jpg"], "must end in .png"),
    (
        [*LENGTHS, "--plot", "cost"],
        "--plot: 'cost' is not a column of results; the columns are net_translation, gained",
    ),
    (["--vary", "drive.length=2", "--plot", "work"], "--plot: a picture needs one or two keys that vary"),
    (["--vary", "drive.length=2", "--png", "x.png"], "one or two keys that vary"),
    ([*LENGTHS, "--duration", "-1"], "duration: -1 s"),
    ([*LENGTHS, "--workers", "0"], "'--workers'"),
    ([*LENGTHS, "--scheduler", "somewhere"], "write tcp://host:port"),
    ([*LENGTHS, "--scheduler", "tcp://127.0.0.1:9"], "no Dask scheduler answers at tcp://127.0.0.1:9"),
    ([], "Missing option '--vary'"),
]


@pytest.mark.parametrize(("arguments", "said"), MISTAKES)
def test_a_mistake_is_one_clear_line(arguments, said, tmp_path, monkeypatch, capsys):
    out = [] if "--out" in arguments else ["--out", "x.parquet"]
    assert command_status(["sweep", "two_anchor_b", *arguments, *out], tmp_path, monkeypatch) != 0
    text = capsys.readouterr().err
    assert said in " ".join(text.split())
    assert text.startswith("crawler: ")
    assert len(text.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def command_status(arguments: list[str], folder: Path, monkeypatch, patience: float = 1.0) -> int:
    """Run the command in this process, which spares a second each."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", ["crawler", *arguments])
    monkeypatch.setattr("crawler_command.jobs.cluster.PATIENCE_S", patience)
    with pytest.raises(SystemExit) as left:
        main()
    return int(left.value.code or 0)


# On a cluster


def test_a_mesh_too_coarse_for_the_accuracy_of_a_variation_is_named(tmp_path):
    """Segments keep the elements of the base scene, and the error of a stiff one was twice its accuracy without a word."""
    key = "body.segments[0].stiffness"
    arguments = ["sweep", "peristaltic_segment", "--out", "a.csv", "--force", "--vary"]
    (note,) = json.loads(good(*arguments, f"{key}=1,20", "--json", cwd=tmp_path))["notes"]
    assert note.startswith(f"segment trunk has 47 elements; at {key} = 20 its accuracy takes ")
    document = load_scene("peristaltic_segment").document()
    del document["body"]["segments"][0]["elements"]
    document["body"]["segments"][0]["stiffness"] = 20.0
    assert note.endswith(f"write `elements: {Scene.model_validate(document).body.segments[0].elements}` for it")
    assert "elements" not in good(*arguments, f"{key}=0.9,1", cwd=tmp_path)


OPTIONS = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "silence_logs": 50}


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, **OPTIONS) as made:
        yield made


def test_a_cluster_gives_the_same_table_to_the_bit_though_a_worker_is_killed(cluster, tmp_path):
    keys = ["--vary", "drive.length=0:6:50", "--vary", "drive.friction=0.5:1.5:40"]
    arguments = ["sweep", "two_anchor_b", *keys, "--duration", "20"]
    good(*arguments, "--out", "local.parquet", cwd=tmp_path)
    command = [CRAWLER, *arguments, "--out", "dask.parquet", "--scheduler", cluster.scheduler_address]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, cwd=tmp_path, **pipes)
    wait_for(lambda: any(t.state == "processing" for t in list(cluster.scheduler.tasks.values())), process)
    os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err
    assert err == "" or "compiling" in err
    assert "50 x 40 variations" in out
    assert (tmp_path / "dask.parquet").read_bytes() == (tmp_path / "local.parquet").read_bytes()
    assert table_of(tmp_path / "dask.parquet").equals(table_of(tmp_path / "local.parquet"))


def wait_for(what, process) -> None:
    wait_until(lambda: what() or process.poll() is not None)
    assert process.poll() is None, process.communicate()


def test_a_scheduler_without_workers_is_one_clear_line(tmp_path, monkeypatch, capsys):
    with distributed.LocalCluster(n_workers=0, threads_per_worker=1, processes=True, **OPTIONS) as empty:
        arguments = ["sweep", "two_anchor_b", *LENGTHS, "--out", "x.parquet", "--scheduler", empty.scheduler_address]
        assert command_status(arguments, tmp_path, monkeypatch, patience=20.0) == 1
    text = capsys.readouterr().err
    assert "has no workers; start one: dask worker tcp://" in text
    assert len(text.splitlines()) == 1
