"""`crawler replay` of many recordings: one data set, resumable, whole however it ends, and what it says of damage."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from crawler_command.jobs.cores import WorkerEndedError, run_on_cores
from crawler_command.recordings import data_set
from crawler_lab import vary
from crawler_model import CrawlerError, load_scene

from ...commands import crawler
from ...processes import PATIENCE_S, children, wait_until
from ...recordings import record, rewrite

polars = pytest.importorskip("polars")
duckdb = pytest.importorskip("duckdb")
parquet = pytest.importorskip("pyarrow.parquet")
dataset = pytest.importorskip("pyarrow.dataset")

TABLES = ("runs", "cycles", "slips", "account")


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Five recordings, two of one name, one in the plane, one whose states were changed; and two that are damaged."""
    folder = tmp_path_factory.mktemp("bags")
    record(folder / "b", "two_anchor_b", 2)
    record(folder / "later" / "b", "slope_climber", 2)
    record(folder / "later" / "2026", "planar_rectilinear", 1)
    (scene,) = vary(load_scene("two_anchor_b"), {"drive.length": [6.0]})
    record(folder / "long", scene, 2)
    from crawler_ros.recording import bag

    head = bag.Bag({})
    list(bag.read(folder / "long", head))
    last = [b""]

    def repeat(name: str, stamp: int, data: bytes) -> list[tuple[str, int, bytes]]:
        """Let the pose stand still from 1 s on."""
        if name == "pose" and stamp < 1_000_000_000:
            last[0] = data
        return [(name, stamp, data[:12] + last[0][12:] if name == "pose" else data)]

    rewrite(folder / "long", folder / "changed", repeat, head.attachments)
    whole = (folder / "b" / "b_0.mcap").read_bytes()
    (folder / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    (folder / "notes.mcap").write_text("bought milk")
    return folder


@pytest.fixture(scope="module")
def made(bags, tmp_path_factory):
    """The data set of all of them, made on two cores; and what the command printed."""
    out = tmp_path_factory.mktemp("made") / "set"
    return out, crawler("replay", bags, bags / "b", "--parquet", out, "--workers", "2", "--json")


def read(out: Path, table: str) -> Any:
    return polars.read_parquet(out / table).sort("run", maintain_order=True)


def files_of(out: Path) -> dict[str, bytes]:
    return {str(f.relative_to(out)): f.read_bytes() for f in sorted(out.rglob("*")) if f.is_file()}


def test_all_recordings_are_in_it_and_damaged_ones_are_named(bags, made):
    out, done = made
    assert done.returncode == 1
    lines = sorted(done.stderr.splitlines())
    assert len(lines) == 2
    assert lines[0].startswith(f"crawler: skipped {bags / 'cut.mcap'}: its end is missing; crawler replay --recover")
    assert lines[1] == f"crawler: skipped {bags / 'notes.mcap'}: not an MCAP file"
    report = json.loads(done.stdout)
    assert [report[name] for name in ("done", "unhealthy", "finished", "left")] == [5, 1, 0, 0]
    assert {skipped["recording"] for skipped in report["skipped"]} == {str(bags / "cut.mcap"), str(bags / "notes.mcap")}
    assert sorted(p.name for p in out.iterdir()) == sorted(TABLES)
    for table in TABLES:
        assert set(read(out, table)["run"]) == {"b", "b_2", "changed", "long", "run_2026"}


def test_every_reader_sees_one_table(made):
    """A body in the plane, and scenes with different numbers, have the same columns as all others."""
    out, _ = made
    for table in TABLES:
        rows = read(out, table)
        sql = duckdb.sql(f"SELECT * FROM '{out}/{table}/*/*.parquet' ORDER BY run").fetchall()
        arrow = dataset.dataset(out / table, partitioning="hive").to_table()
        assert len(sql) == rows.height == arrow.num_rows
        assert set(arrow.column_names) == set(rows.columns)
        own = [field for field in arrow.schema if field.name != "run"]
        assert all(b"unit" in field.metadata for field in own)
    question = (
        f"""SELECT run, "drive.length", "friction.coefficient.forward" FROM '{out}/runs/*/*.parquet' ORDER BY run"""
    )
    asked = duckdb.sql(question).fetchall()
    assert asked == [
        ("b", 4, None),
        ("b_2", None, 0.2),
        ("changed", 6, None),
        ("long", 6, None),
        ("run_2026", None, None),
    ]


@pytest.mark.parametrize(("name", "run"), [("b", "b"), ("later/2026", "run_2026")])
def test_rows_are_those_of_a_single_replay(name, run, bags, made, tmp_path):
    done = crawler("replay", bags / name, "--json", "--parquet", tmp_path / "t")
    found = json.loads(done.stdout)
    planar = run == "run_2026"
    for table in ("cycles", "slips"):
        single = polars.read_parquet(tmp_path / "t" / f"{table}.parquet").rename({"run": "reset"})
        if planar:
            single = single.rename({"translation_x": "translation"}, strict=False)
        rows = read(made[0], table).filter(run=run).drop("run")
        unknown = ["turned", *["translation_y"] * (not planar)] if table == "cycles" else []
        assert all(rows[name].null_count() == rows.height for name in unknown)
        rows = rows.drop(unknown)
        assert rows.height == len(found[table]) > 0
        assert rows.equals(single.with_columns(polars.col(polars.Categorical).cast(polars.String)))
    (account,) = read(made[0], "account").filter(run=run).to_dicts()
    assert {key: account[key] for key in found["energy"]} == found["energy"]
    (row,) = read(made[0], "runs").filter(run=run).to_dicts()
    assert Path(row["recording"]).parent == bags / name
    assert row["healthy"]
    assert row["scene"] == found["scene"]
    assert (row["duration"], row["method"]) == (found["simulated_s"], found["method"])
    assert (row["cycles"], row["slips"], row["jumps"]) == (len(found["cycles"]), len(found["slips"]), 0)
    assert (row["least_margin"], row["unique"]) == (found["margins"]["least"], found["margins"]["unique"])
    assert (row["identical"], row["compared"]) == (True, found["resimulation"]["ticks"])
    gained = found["cycles"][-1]["translation"]
    assert row["speed"] == pytest.approx(gained[0] if planar else gained)  # the period is 1 s
    expected = {"b": 3.5 / (1.5 * 2.0), "run_2026": 0.0}[run]
    assert planar or row["cost_of_transport"] == pytest.approx(expected)
    assert row["cost_of_transport"] == found["cycles"][-1]["cost_of_transport"]
    assert (row["slack"], row["stalled"]) == (0.0, 0.0)


def test_a_run_has_the_time_at_the_limits_of_its_links(tmp_path):
    for name in ("tendon_worm", "stalling_inchworm"):
        found = json.loads(crawler("replay", record(tmp_path / "bags" / name, name, 2), "--json").stdout)["at_limits"]
        crawler("replay", tmp_path / "bags", "--parquet", tmp_path / name, "--workers", "1")
        (row,) = read(tmp_path / name, "runs").filter(run=name).to_dicts()
        assert found["link_0"].items() <= row.items()
        assert row["slack"] + row["stalled"] > 0.0


def test_a_recording_that_is_not_identical_has_its_reason(made):
    runs = read(made[0], "runs")
    (changed,) = runs.filter(~polars.col("identical")).to_dicts()
    assert changed["run"] == "changed"
    assert not changed["healthy"]
    assert "not identical when simulated again" in changed["problems"]
    assert changed["first_difference"] == pytest.approx(1.0)
    (whole,) = runs.filter(run="long").to_dicts()
    assert changed["drive.length"] == whole["drive.length"] == 6.0
    assert changed["translation"] == whole["translation"]


def test_what_is_finished_is_not_done_again_but_what_changed_is(bags, made, tmp_path):
    """A mere new time is no change, nor is a new place; a new length is."""
    here, out = tmp_path / "bags", tmp_path / "set"
    shutil.copytree(bags, here)
    shutil.copytree(made[0], out)
    arguments = ("--parquet", out, "--resume", "--json", "--workers", "1")
    before = files_of(out)
    # elsewhere these are other recordings, as long as the first are there: all have names of their own
    os.utime(bags / "b" / "b_0.mcap")
    report = json.loads(crawler("replay", bags, *arguments).stdout)
    assert (report["done"], report["finished"]) == (0, 5)
    assert files_of(out) == before
    shutil.copy(bags / "long" / "long_0.mcap", here / "b" / "b_0.mcap")
    done = crawler("replay", here / "b", here / "notes.mcap", "--parquet", out, "--resume", "--workers", "1")
    assert "1 recording(s) added" in done.stdout
    assert read(out, "runs")["run"].to_list() == ["b", "b_2", "b_3", "changed", "long", "run_2026"]
    shutil.copy(bags / "b" / "b_0.mcap", here / "b" / "b_0.mcap")
    done = crawler("replay", here / "b", "--parquet", out, "--resume", "--workers", "1")
    assert done.returncode == 0
    runs = read(out, "runs")
    assert runs.height == 6
    assert runs.filter(run="b_3")["drive.length"].to_list() == [4.0]
    (here / "b" / "b_0.mcap").write_bytes((here / "cut.mcap").read_bytes())
    done = crawler("replay", here / "b", "--parquet", out, "--resume", "--workers", "1")
    assert "but metadata.yaml counts" in done.stderr  # its end is missing, and with it messages that were promised
    assert "b_3" not in read(out, "cycles")["run"]
    assert files_of(out) == before


def test_rows_of_a_recording_that_was_moved_follow_it(bags, tmp_path):
    """Of two equal ones each keeps its rows, and a change after that replaces them."""
    out = tmp_path / "set"
    for name in ("one", "two"):
        shutil.copytree(bags / "b", tmp_path / "here" / name)
    words = ("replay", tmp_path / "here", "--parquet", out, "--resume", "--workers", "1")
    assert crawler(*words).returncode == 0
    before = read(out, "runs")["run"].to_list()
    for name in ("one", "two"):
        (tmp_path / "here" / name).rename(tmp_path / "here" / f"{name}_moved")
    assert crawler(*words).returncode == 0
    runs = read(out, "runs")
    assert runs["run"].to_list() == before
    assert sorted(Path(path).parent.name for path in runs["recording"]) == ["one_moved", "two_moved"]
    shutil.copy(bags / "long" / "long_0.mcap", tmp_path / "here" / "one_moved" / "b_0.mcap")
    assert "1 recording(s) added" in crawler(*words).stdout
    assert sorted(read(out, "runs")["drive.length"].to_list()) == [4.0, 6.0]


@pytest.fixture(scope="module")
def many(bags, tmp_path_factory):
    """One short recording forty times."""
    folder = tmp_path_factory.mktemp("many")
    for k in range(40):
        shutil.copy(bags / "b" / "b_0.mcap", folder / f"copy_{k:02d}.mcap")
    return folder


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_stopped_in_the_middle_it_can_be_continued(how, many, tmp_path):
    """Neither leaves a process, nor a run that is not in all tables."""
    out = tmp_path / "set"
    words = [sys.executable, "-m", "crawler_command.app", "replay", str(many), "--parquet", str(out), "--workers", "2"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(words, **pipes, start_new_session=True)
    wait_until(lambda: any(out.glob("runs/*/part.parquet")) or process.poll() is not None)
    started = children(process.pid)
    assert len(started) >= 2
    os.killpg(process.pid, how) if how == signal.SIGINT else process.kill()
    said, errors = process.communicate(timeout=PATIENCE_S)
    wait_until(lambda: not any(is_running(pid) for pid in started))
    runs = {part.parent.name for part in out.glob("runs/*/part.parquet")}
    assert 0 < len(runs) < 40
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert f"{len(runs)} recording(s) added to {out}; stopped: {40 - len(runs)} left for --resume" in said
        assert "Traceback" not in errors
        for table in TABLES:
            assert {part.parent.name for part in out.glob(f"{table}/*/part.parquet")} == runs
        assert sorted(p.name for p in out.iterdir()) == sorted(TABLES)
    done = crawler("replay", many, "--parquet", out, "--resume", "--json", "--workers", "1")
    report = json.loads(done.stdout)
    assert (report["finished"], report["done"]) == (len(runs), 40 - len(runs))
    assert sorted(p.name for p in out.iterdir()) == sorted(TABLES)
    for table in TABLES:
        rows = read(out, table).drop("recording", "modified", strict=False)
        first, *others = split(rows)
        assert len(others) == 39
        assert all(first.equals(other) for other in others)


def test_halves_of_a_killed_process_are_removed_and_two_processes_do_not_mix(bags, made, tmp_path):
    out = tmp_path / "set"
    shutil.copytree(made[0], out)
    shutil.copytree(out / "slips" / "run=b", out / "slips" / "run=half")
    (out / ".unfinished").mkdir()
    handle = os.open(out, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    done = crawler("replay", bags / "b", "--parquet", out, "--resume")
    assert done.returncode == 1
    assert done.stderr == f"crawler: --parquet: another process is writing to {out}\n"
    os.close(handle)
    done = crawler("replay", bags / "b", "--parquet", out, "--resume")
    assert done.stdout == f"0 recording(s) added to {out}; 1 there already\n"
    assert files_of(out) == files_of(made[0])
    assert not (out / ".unfinished").exists()


def test_processes_pass_on_errors_and_name_the_jobs_that_were_not_finished(monkeypatch):
    with pytest.raises(ValueError, match="invalid literal for int"):
        list(run_on_cores(int, [("x",)], 2))
    with pytest.raises(WorkerEndedError) as ended:
        list(run_on_cores(os._exit, [(3,)], 2))
    assert ended.value.jobs == (0,)

    def end(*given: object) -> None:
        raise WorkerEndedError([2, 1])

    monkeypatch.setattr(data_set, "run_on_cores", end)
    names = {"a": "one", "b": "two", "c": "three"}
    batch = data_set.Batch(Path("out"), {}, names, 0, {}, None, None)
    with pytest.raises(
        CrawlerError, match="a process ended while it analysed one of two, three, perhaps out of memory"
    ):
        list(data_set._outcomes(batch, [], 2, None))


def split(rows: Any) -> list[Any]:
    """The rows of each run, without its name."""
    return [part.drop("run") for part in rows.partition_by("run")]


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_cluster_makes_the_same_data_set(bags, made, tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, host="127.0.0.1", dashboard_address="127.0.0.1:0", silence_logs=50
    ) as cluster:
        address = cluster.scheduler_address
        done = crawler("replay", bags, "--parquet", tmp_path / "set", "--scheduler", address, "--json")
    assert json.loads(done.stdout)["done"] == 5
    assert done.returncode == 1
    assert without_times(tmp_path / "set") == without_times(made[0])


def without_times(out: Path) -> list[Any]:
    return [read(out, table).drop("modified", strict=False).to_dicts() for table in TABLES]


MISTAKES = [
    (["b", "b", "--png", "x.png", "--parquet", "t"], "--png: a data set has none; replay one recording"),
    (["b", "--resume", "--recover", "--parquet", "t"], "--recover: a data set has none"),
    (["b", "b"], "--parquet: missing; several recordings make a data set"),
    (["b", "here", "--parquet", "t"], "here: no such file or folder"),
    (["b", "b", "--parquet", "full"], "full exists already; choose a new folder, or continue it with --resume"),
    (["b", "--resume", "--parquet", "full"], "full is not a data set of recordings: it holds mine"),
    (["b", "--resume", "--parquet", "no/t"], "no does not exist"),
    (["b", "--scheduler", "somewhere", "--parquet", "t"], "write tcp://host:port"),
]


@pytest.mark.parametrize(("arguments", "said"), MISTAKES)
def test_a_mistake_is_one_clear_line(arguments, said, bags, tmp_path, monkeypatch):
    (tmp_path / "b").symlink_to(bags / "b")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").touch()
    monkeypatch.chdir(tmp_path)
    done = crawler("replay", *arguments)
    assert done.returncode == 1
    assert said in done.stderr
    assert done.stderr.startswith("crawler: ")
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "t").exists()
