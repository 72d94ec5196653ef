"""`crawler simulate --parquet --csv`: the tables, as other programs read them."""

from __future__ import annotations

import csv
import json
import os
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from crawler_command.app import main
from crawler_command.simulate import _check_certificate, write_tables
from crawler_model import CrawlerError, Scene, Trajectory, TrajectoryColumns, load_scene, simulate
from crawler_model.run import trajectory

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

BODIES = ("two_anchor_a", "hybrid_body", "planar_rectilinear", "tow_puller", "ice")
"""A chain, a segment, a body in the plane, loads, patches."""


@pytest.fixture
def status(tmp_path, monkeypatch):
    """Run the command in this process, which spares a second each."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> int:
        monkeypatch.setattr(sys, "argv", ["crawler", *arguments])
        with pytest.raises(SystemExit) as left:
            main()
        return int(left.value.code or 0)

    return run


def duration_of(name: str) -> float:
    return 1.5 * (load_scene(name).drive.period or 1.0)


@pytest.mark.parametrize("name", BODIES)
def test_every_reader_finds_the_numbers_of_the_run(name, status, tmp_path, capsys):
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    seconds = duration_of(name)
    rate = 30.0 / seconds
    options = ("--duration", repr(seconds), "--rate", repr(rate))
    assert status("simulate", name, *options, "--parquet", "a.parquet", "--csv", "a.csv", "--json") == 0
    assert json.loads(capsys.readouterr().out)["scene"] == name  # nothing else is printed
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.csv", "a.parquet"]
    expected = simulate(load_scene(name), seconds, rate).to_table()
    with open("a.csv", newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    written = np.array(rows, dtype=np.float64)
    readers = {
        "parquet, pyarrow": pq.read_table("a.parquet").to_pydict(),
        "parquet, pandas": pandas.read_parquet("a.parquet").to_dict("list"),
        "parquet, polars": polars.read_parquet("a.parquet").to_dict(as_series=False),
        "csv, csv": dict(zip(header, written.T.tolist(), strict=True)),
        "csv, pandas": pandas.read_csv("a.csv", dtype=str).astype(float).to_dict("list"),
        "csv, polars": polars.read_csv("a.csv", infer_schema_length=None).to_dict(as_series=False),
    }
    for reader, found in readers.items():
        assert list(found) == expected.column_names, reader
        for column in expected.column_names:
            np.testing.assert_array_equal(found[column], expected[column].to_numpy(), err_msg=f"{reader}: {column}")


def test_the_header_is_that_of_measurements(status):
    assert status("simulate", "three_contacts_one_way", "--csv", "a.csv", "--duration", "1") == 0
    with open("a.csv", encoding="utf-8") as file:
        first = file.readline()
    assert first.startswith("time,contact_0,contact_1,contact_2,command/link_0,command/link_1,contact_0/velocity,")
    assert '"' not in first


def test_units_scene_and_versions_travel_with_the_parquet_file(status, capsys):
    assert status("simulate", "hybrid_body", "--parquet", "a.parquet", "--duration", "0.5") == 0
    assert "table: a.parquet" in capsys.readouterr().out
    schema = pq.read_schema("a.parquet")
    scene = load_scene("hybrid_body")
    assert {field.name: field.metadata[b"unit"].decode() for field in schema} == TrajectoryColumns(scene).units
    about = json.loads(schema.metadata[b"crawler_trajectory"])
    assert about["document"] == scene.document()
    assert Scene.model_validate(about["document"]).body.contacts == scene.body.contacts
    assert (about["schema"], about["scene"], about["method"], about["rate_hz"]) == (1, "hybrid_body", "exact", 100.0)
    assert {"numpy", "numba", "python"} <= about["versions"].keys()


def test_the_parquet_file_is_written_in_row_groups(status, monkeypatch):
    monkeypatch.setattr(trajectory, "_NUMBERS", 1)
    monkeypatch.setattr(trajectory, "_FEWEST_ROWS", 40)
    assert status("simulate", "two_anchor_a", "--duration", "1", "--parquet", "a.parquet", "--csv", "a.csv") == 0
    described = pq.ParquetFile("a.parquet").metadata
    assert [described.row_group(i).num_rows for i in range(described.num_row_groups)] == [40, 40, 21]
    with open("a.csv", encoding="utf-8") as file:
        assert len(file.readlines()) == 102


def test_the_completed_part_of_a_table_grows_to_one(tmp_path, monkeypatch):
    monkeypatch.setattr(trajectory, "_NUMBERS", 1)
    monkeypatch.setattr(trajectory, "_FEWEST_ROWS", 40)
    parts: list[float] = []
    write_tables(simulate(load_scene("two_anchor_a"), 1.0), None, tmp_path / "a.csv", parts.append)
    assert parts == pytest.approx([40 / 101, 80 / 101, 1.0])


@pytest.mark.parametrize(("friction", "beyond"), [(0.0, 2e-6), (1e-3, 2e-9), (1e6, 2.0)])
def test_forces_beyond_their_bounds_are_judged_by_the_largest_friction(friction, beyond):
    document = load_scene("two_contacts_anisotropic").document() | {"start": "relaxed"}
    document["friction"] = {"forward": 0.0, "backward": friction}
    scene = Scene.model_validate(document)
    energy = SimpleNamespace(relative_residual=0.0)
    _check_certificate(SimpleNamespace(method="exact", scene=scene, energy=energy, violation=0.4 * beyond))
    with pytest.raises(CrawlerError, match=r"a spring force exceeds its bound by 2.0e-06 of the largest friction"):
        _check_certificate(SimpleNamespace(method="exact", scene=scene, energy=energy, violation=beyond))


def test_an_existing_table_is_replaced_only_on_request(status, tmp_path, capsys):
    (tmp_path / "a.csv").write_text("measured")
    assert status("simulate", "two_anchor_a", "--csv", "a.csv") == 1
    assert "--csv: a.csv exists already; choose another name, or use --force" in capsys.readouterr().err
    assert (tmp_path / "a.csv").read_text() == "measured"
    assert status("simulate", "two_anchor_a", "--csv", "a.csv", "--overwrite") == 0
    assert (tmp_path / "a.csv").read_text().startswith("time,")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--parquet", "a.csv"], "--parquet: a.csv must end in .parquet"),
        (["--csv", "a.parquet"], "--csv: a.parquet must end in .csv"),
        (["--csv", "a"], "--csv: a must end in .csv"),
        (["--csv", "nowhere/a.csv"], "nowhere does not exist"),
        (["--csv", "folder.csv"], "--csv: folder.csv is a folder; it must be a file"),
        (["--csv", "folder.csv", "--overwrite"], "--csv: folder.csv is a folder; it must be a file"),
        (["--csv", "/proc/a.csv"], "/proc"),
    ],
)
def test_a_table_that_cannot_be_written_is_one_clear_line(arguments, said, status, tmp_path, capsys):
    (tmp_path / "folder.csv").mkdir()
    assert status("simulate", "two_anchor_a", "--duration", "1", *arguments) == 1
    text = capsys.readouterr().err
    assert said in text
    assert text.startswith("crawler: ")
    assert len(text.splitlines()) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["folder.csv"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_is_not_writable_is_reported_before_the_run(status, tmp_path, capsys):
    (tmp_path / "closed").mkdir(mode=0o500)
    assert status("simulate", "two_anchor_a", "--csv", "closed/a.csv") == 1
    assert "closed is not writable" in capsys.readouterr().err


def test_without_pyarrow_nothing_runs(status, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert status("simulate", "two_anchor_a", "--csv", "a.csv") == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "crawler: pyarrow is not installed; install with: pip install 'crawler-ros[tables]'\n"


@pytest.mark.parametrize(
    ("error", "expected", "said"),
    [(KeyboardInterrupt(), 130, "stopped"), (OSError(28, "No space left on device"), 1, "No space left on device")],
)
def test_what_stops_in_the_middle_leaves_nothing_behind(error, expected, said, status, tmp_path, monkeypatch, capsys):
    (tmp_path / "a.csv").write_text("measured")
    build = Trajectory.build_batches

    def stopped(run: Trajectory):
        yield next(build(run))
        raise error

    monkeypatch.setattr(Trajectory, "build_batches", stopped)
    tables_of = ("--parquet", "a.parquet", "--csv", "a.csv", "--overwrite")
    assert status("simulate", "two_anchor_a", "--duration", "1", *tables_of) == expected
    assert said in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]
    assert (tmp_path / "a.csv").read_text() == "measured"
