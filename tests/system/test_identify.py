"""`crawler identify` on tables and recordings, and its errors."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from crawler_command.app import main
from crawler_command.identify.tables import read_table
from crawler_model import Measurements, Scene, load_scene, simulate
from crawler_model.identify.measurements import MeasurementError, check_measurements

from .. import recordings
from ..model.identify.synthetic import chain, measure, scaled, walk


def run(capsys, *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return int(stopped.value.code or 0), out, err


def table(measured: Measurements, times: list[float], rows: np.ndarray) -> tuple[list[str], np.ndarray]:
    commands = [np.interp(measured.time, times, column) for column in rows.T]
    header = ["time", *measured.channels, *(f"command/{name}" for name in measured.command_names)]
    return header, np.column_stack((measured.time, measured.values, *commands))


def write_csv(path: Path, header: list[str], rows: np.ndarray) -> Path:
    lines = [",".join("" if np.isnan(v) else repr(float(v)) for v in row) for row in rows]
    path.write_text("\n".join((",".join(header), *lines)) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def robot(tmp_path):
    """A first guess in a file, and the header and rows of a table of measurements."""
    document = chain(3)
    times, rows = walk(2, 6.0, 1)
    guess = tmp_path / "guess.yaml"
    guess.write_text(yaml.safe_dump(scaled(document, {"friction.forward": 1.3}).document()), encoding="utf-8")
    return guess, *table(measure(document, times, rows, noise=2e-4), times, rows)


def test_a_table_is_fitted_and_the_scene_written(robot, tmp_path, capsys):
    guess, header, rows = robot
    csv = write_csv(tmp_path / "run.csv", header, rows)
    out, png, html = (tmp_path / f"found.{kind}" for kind in ("yaml", "png", "html"))
    files = ("--out", out, "--png", png, "--html", html)
    options = ("--scene", guess, "--fit", "friction.forward,friction.backward", *files, "--json")
    status, text, _ = run(capsys, "identify", csv, *options)
    assert status == 0
    found = json.loads(text)
    assert {"parameters", "residual", "held_out", "model_fits"} <= set(found)
    assert found["model_fits"] is True
    for i, true in enumerate((0.2, 0.23, 0.26)):
        p = found["parameters"][i]
        assert set(p) == {"name", "verdict", "value", "interval", "with", "why"}
        assert p["name"] == f"friction.forward[{i}]"
        assert p["verdict"] == "identified"
        assert p["value"] == pytest.approx(true, rel=0.02)
    assert load_scene(out).drive.forward[0] == pytest.approx([p["value"] for p in found["parameters"][:3]])
    played = simulate(load_scene(out), 6.0, 50.0)
    measured = rows[:, 1:4] - rows[0, 1:4]
    assert np.abs(played.displacement - measured).max() < 3e-3  # noise of 0.2 mm, twice, and friction found to 2 %
    status, _, error = run(capsys, "identify", csv, *options)
    assert status == 1
    assert f"--out: {out} exists already; choose another name, or use --overwrite" in error
    assert png.read_bytes().startswith(b"\x89PNG")
    page = html.read_text(encoding="utf-8")
    assert "friction.forward[2]</td><td>identified" in page
    assert "http" not in page


def test_parquet_is_read_as_csv_is(robot, tmp_path, capsys):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    guess, header, rows = robot
    parquet.write_table(pa.table(dict(zip(header, rows.T, strict=True))), tmp_path / "run.parquet")
    write_csv(tmp_path / "run.csv", header, rows)
    found = []
    for kind in ("csv", "parquet"):
        options = ("--scene", guess, "--fit", "friction.forward", "--json")
        status, text, _ = run(capsys, "identify", tmp_path / f"run.{kind}", *options)
        assert status == 0
        found.append(json.loads(text)["parameters"])
    assert found[0] == found[1]


def without_time(header, rows):
    return header[1:], rows[:, 1:]


def nearly_nothing(header, rows):
    rows[7:, 2] = np.nan
    return header, rows


def millimetres(header, rows):
    rows[:, 1:] *= 1000.0
    return header, rows


def command_in_millimetres(header, rows):
    rows[:, 4:] *= 1000.0
    return header, rows


def other_body(header, rows):
    return [name.replace("contact_2", "contact_7") for name in header], rows


def too_few(header, rows):
    return header, rows[:5]


def backwards(header, rows):
    rows[9, 0] = rows[3, 0]
    return header, rows


def no_commands(header, rows):
    return header[:4], rows[:, :4]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (without_time, "no column `time`"),
        (nearly_nothing, "contact_1 has 7 value(s) and is missing in all other rows; at least 8 are needed"),
        (millimetres, "look like millimetres: divide them by 1000, or use --units mm"),
        (command_in_millimetres, "look like millimetres: divide them by 1000, or use --units mm"),
        (other_body, "contact_7 does not belong to measured"),
        (too_few, "5 rows are too few; at least 8 are needed"),
        (backwards, "does not come after"),
        (no_commands, "add the columns command/link_0, command/link_1"),
    ],
)
def test_a_bad_table_is_refused_in_one_line_and_nothing_is_written(robot, tmp_path, capsys, spoil, message):
    guess, header, rows = robot
    csv = write_csv(tmp_path / "run.csv", *spoil(header, rows))
    out = tmp_path / "found.yaml"
    status, text, error = run(capsys, "identify", csv, "--scene", guess, "--fit", "friction.forward", "--out", out)
    assert status == 1
    assert text == ""
    assert message in error
    assert error.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--fit", "friction.forwards"), "unknown key"),
        (("--fit", "friction.forward", "--bounds", "friction.forward=1"), "write KEY=A:B"),
        (("--fit", "friction.forward", "--bounds", "friction.backward=1:2"), "it is not fitted"),
        (("--fit", "friction.forward", "--bounds", "friction.forward=5:9"), "do not contain its value in the scene"),
        (("--fit", "friction.forward", "--offset", "some"), "none, frame or each"),
        (("--fit", "friction.forward", "--out", "x.txt"), "must end in .yaml"),
        (("--fit", "friction.forward", "--topic", "joints=/a"), "write NAME=RECORDED"),
        (("--fit", "drive.period"), "the commands of run.csv replace the drive"),
    ],
)
def test_bad_options_are_refused_in_one_line(robot, tmp_path, capsys, options, message):
    guess, header, rows = robot
    csv = write_csv(tmp_path / "run.csv", header, rows)
    status, _, error = run(capsys, "identify", csv, "--scene", guess, *options)
    assert status == 1
    assert message in error
    assert error.count("\n") == 1


def test_a_wrong_model_ends_with_status_1_and_says_where(robot, tmp_path, capsys):
    guess, header, rows = robot
    rows[150:, 1:4] += 0.01
    csv = write_csv(tmp_path / "run.csv", header, rows)
    status, _, error = run(capsys, "identify", csv, "--scene", guess, "--fit", "friction.forward")
    assert status == 1
    assert "the model does not fit: run.csv: contact_" in error


@pytest.mark.parametrize("kind", ["ours", "remapped", "joint_states"])
def test_recordings_are_read(tmp_path, capsys, kind):
    pytest.importorskip("mcap")
    scene = load_scene("two_contacts_anisotropic")
    bag = recordings.record(tmp_path / "bag", scene, 3.0)
    topics = []
    if kind != "ours":
        kept = (
            ("joint_states", "applied_commands") if kind == "joint_states" else ("contact_states", "applied_commands")
        )
        topics = [f"--topic={name}=/robot/{name}" for name in kept]

        def keep(name: str, stamp: int, data: bytes):
            return [(name, stamp, data)] if name in kept else []

        sent = [m for r in recordings.read(bag) for m in keep(r.topic.removeprefix("/"), 0, r.data)]
        bag = recordings.write(tmp_path / "robot", sent, {}, "/robot/")
    document = scene.document()
    key = "friction.forward"
    true = float(scene.drive.forward[0, 0])
    document["friction"]["forward"] = 1.2 * true
    guess = tmp_path / "guess.yaml"
    guess.write_text(yaml.safe_dump(document), encoding="utf-8")
    status, text, error = run(capsys, "identify", bag, "--scene", guess, "--fit", key, "--json", *topics)
    assert status == 0, error
    (found,) = json.loads(text)["parameters"]
    assert found["verdict"] == "identified"
    assert found["value"] == pytest.approx(true, rel=1e-9)


def test_every_run_of_a_recording_is_fitted(tmp_path, capsys):
    """The simulator was reset once; a third run is too short to tell anything."""
    pytest.importorskip("mcap")
    scene = load_scene("two_contacts_anisotropic")
    last = round(3.0 * scene.drive.period * 1e9)
    runs = [list(recordings.messages(scene, recordings.play(scene, first, last))) for first in (10**8, 3 * 10**8)]
    short = list(recordings.messages(scene, recordings.hold(0, 2)))
    bag = recordings.write(tmp_path / "bag", [*runs[0], *runs[1], *short], recordings.attachments(scene))
    options = ("--scene", "two_contacts_anisotropic", "--fit", "friction.forward", "--json")
    status, text, error = run(capsys, "identify", bag, *options)
    assert status == 0, error
    found = json.loads(text)
    assert [one["name"] for one in found["recordings"]] == ["bag run 0", "bag run 1"]
    assert found["parameters"][0]["value"] == pytest.approx(float(scene.drive.forward[0, 0]), rel=1e-9)


def test_excite_writes_a_drive_that_identifies_what_was_asked(tmp_path, capsys):
    """The measurements of the drive are computed with other friction than that of the guess."""
    out = tmp_path / "drive.yaml"
    fit = ("--fit", "friction.forward")
    asked = ("two_contacts_anisotropic", *fit, "--stroke=-0.1:0.1", "--noise", "5e-4", "--out", out, "--json")
    status, text, error = run(capsys, "excite", *asked)
    assert status == 0, error
    found = json.loads(text)
    (expected,) = found["parameters"]
    assert expected["verdict"] == "identified"
    assert found["duration_s"] <= 20.0
    document = load_scene(out).document()
    assert document["drive"] == found["drive"]
    document["friction"]["forward"] = true = 0.23
    run_of = simulate(Scene.model_validate(document), found["duration_s"], 50.0)
    position = run_of.displacement + np.array(document["body"]["contacts"])
    position = position + 5e-4 * np.random.default_rng(1).normal(size=position.shape)
    header = ["time", "contact_0", "contact_1", "command/link_0"]
    command = np.interp(run_of.time, found["drive"]["times"], np.ravel(found["drive"]["actuation"]))
    csv = write_csv(tmp_path / "run.csv", header, np.column_stack((run_of.time, position, command)))
    status, text, error = run(capsys, "identify", csv, "--scene", "two_contacts_anisotropic", *fit, "--json")
    assert status == 0, error
    (p,) = json.loads(text)["parameters"]
    low, high = p["interval"]
    assert low - 0.001 < true < high + 0.001
    assert high - low == pytest.approx(expected["interval"][1] - expected["interval"][0], rel=0.5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--fit", "friction.forwards"), "excite: friction.forwards: unknown key; the nearest known key is"),
        (("--fit", "friction.forward", "--noise", "0"), "excite: noise: 0; it must be > 0"),
        (("--fit", "friction.forward", "--stroke", "0.1:0"), "stroke: 0.1 to 0; the lower bound must be less"),
        (("--fit", "friction.forward", "--stroke", "link_7=0:1"), "stroke: 'link_7'; the links and segments are"),
        (("--fit", "drive.actuation"), "no effect"),
        (("--fit", "friction.forward", "--duration", "0.1"), "excite: duration: 0.1 s; it must be at least 4 times"),
    ],
)
def test_excite_refuses_bad_options_in_one_line(capsys, options, message):
    status, text, error = run(capsys, "excite", "two_contacts_anisotropic", *options)
    assert status == 1
    assert text == ""
    assert message in error
    assert len(error.strip().splitlines()) == 1


def test_a_recording_without_the_named_topic_is_refused(tmp_path, capsys):
    pytest.importorskip("mcap")
    bag = recordings.record(tmp_path / "bag", "two_contacts_anisotropic", 1.0)
    options = ("--scene", "two_contacts_anisotropic", "--fit", "friction.forward", "--topic", "joint_states=/robot/js")
    status, _, error = run(capsys, "identify", bag, *options)
    assert status == 1
    assert "no topic /robot/js for joint_states; recorded are /applied_commands" in error


# -- damaged tables ---------------------------------------------------------------------------------------------------


def test_a_number_beyond_all_use_and_a_header_that_is_no_text_are_named(robot, tmp_path, capsys):
    guess, header, rows = robot
    options = ("--scene", guess, "--fit", "friction.forward")
    rows = rows.copy()
    rows[5, 1] = 1e300
    status, _, err = run(capsys, "identify", write_csv(tmp_path / "large.csv", header, rows), *options)
    assert (status, err.count("\n")) == (1, 1)
    assert f"large.csv: column {header[1]}, row 5: 1e+300; it must be at most 1e+100 in size" in err
    other = tmp_path / "other.csv"
    other.write_bytes(b"time,\xff\xfe,contact_0\n" + b"0,1,2\n" * 30)
    status, _, err = run(capsys, "identify", other, *options)
    assert (status, err.count("\n")) == (1, 1)
    assert "other.csv: not a CSV table with a header" in err


SOAK = bool(os.environ.get("CRAWLER_SOAK"))


@pytest.mark.parametrize("seed", range(300 if SOAK else 50))
def test_mutants_of_a_table_end_in_one_line_or_are_measurements(robot, tmp_path, capsys, seed):
    guess, header, rows = robot
    rng = np.random.default_rng(seed)
    data = bytearray(write_csv(tmp_path / "run.csv", header, rows[:40]).read_bytes())
    kind = seed % 4
    place = int(rng.integers(len(data)))
    if kind == 0:
        for _ in range(int(rng.integers(1, 10))):
            data[int(rng.integers(len(data)))] = int(rng.integers(256))
    elif kind == 1:
        data[place:place] = rng.choice([b"1e300", b"nan", b"-inf", b"\x00", b'"', b"\r\n\r\n", b",,,", b"\xff"])
    elif kind == 2:
        del data[place : place + int(rng.integers(1, 400))]
    else:
        data[place:place] = data[: int(rng.integers(1, 400))]
    mutant = tmp_path / "mutant.csv"
    mutant.write_bytes(data)
    if SOAK:
        status, _, err = run(capsys, "identify", mutant, "--scene", guess, "--fit", "friction.forward")
        assert status in (0, 1)
        assert "Traceback" not in err
        return
    scene = load_scene(str(guess))
    message = ""
    try:
        check_measurements(scene, read_table(mutant, scene))
    except MeasurementError as error:
        message = str(error)
    assert "\n" not in message
