"""`crawler identify` on tables and recordings, and its errors."""

from __future__ import annotations

import dataclasses
import io
import json
import os
import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest
import yaml

from crawler_command.app import main
from crawler_command.screen import Screen
from crawler_lab import Measurements, identify
from crawler_lab.identify.measurements import MeasurementError, channel_names, check_measurements
from crawler_lab.verbs.identify.options import parse_columns, parse_units
from crawler_lab.verbs.identify.report import print_identification
from crawler_lab.verbs.identify.tables import read_table
from crawler_model import Scene, load_scene, simulate

from .. import recordings
from ..lab.identify.synthetic import chain, measure, scaled, walk


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
        assert set(p) == {"name", "verdict", "value", "interval", "with", "why", "ended"}
        assert p["name"] == f"friction.forward[{i}]"
        assert p["verdict"] == "identified"
        assert p["value"] == pytest.approx(true, rel=0.02)
    assert load_scene(out).drive.forward[0] == pytest.approx([p["value"] for p in found["parameters"][:3]])
    played = simulate(load_scene(out), 6.0, 50.0)
    measured = rows[:, 1:4] - rows[0, 1:4]
    assert np.abs(played.displacement - measured).max() < 3e-3  # noise of 0.2 mm, twice, and friction found to 2 %
    status, _, error = run(capsys, "identify", csv, *options)
    assert status == 1
    assert f"--out: {out} exists already; choose another name, or use --force" in error
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


def infinite(header, rows):
    rows[17, 2] = np.inf
    return header, rows


def nearly_nothing(header, rows):
    rows[7:, 2] = np.nan
    return header, rows


def half_a_command(header, rows):
    rows[17, 5] = np.nan
    return header, rows


def no_command_at_all(header, rows):
    rows[:, 4:] = np.nan
    return header, rows


def twice(header, rows):
    return [*header[:2], header[1], *header[3:]], rows


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
        (infinite, "run.csv: column contact_1, row 19: inf; it must be at most 1e+100 in size"),
        (nearly_nothing, "contact_1 has 7 value(s) and is missing in all other rows; at least 8 are needed"),
        (half_a_command, "command/link_1 is missing in row 19 (time 0.34), other commands are not"),
        (no_command_at_all, "no row has a command; fill in command/link_0"),
        (twice, "column contact_0 is given twice"),
        (millimetres, "look like millimetres or pixels: divide millimetres by 1000, or use --units mm"),
        (command_in_millimetres, "look like millimetres or pixels: divide millimetres by 1000, or use --units mm"),
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
    words = ("--scene", guess, "--fit", "friction.forward", "--seconds", "0")
    status, _, error = run(capsys, "identify", csv, *words)
    assert status == 1
    assert "the model does not fit: run.csv: contact_" in error


def nanoseconds(header, rows):
    rows[:, 0] = 1.7e18 + 1e9 * rows[:, 0]
    return header, rows


def milliseconds_for_years(header, rows):
    rows[:, 0] *= 1e9
    return header, rows


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (nanoseconds, "time begins at 1.7e+18 s, which looks like Unix time in ns: use --units ns"),
        (
            milliseconds_for_years,
            "time lasts 190 years; it must be in seconds, or name its unit with --units ms, us, ns",
        ),
    ],
)
def test_a_record_of_years_is_no_record(robot, tmp_path, capsys, spoil, message):
    guess, header, rows = robot
    csv = write_csv(tmp_path / "run.csv", *spoil(header, rows.copy()))
    status, _, error = run(capsys, "identify", csv, "--scene", guess, "--fit", "friction.forward")
    assert (status, error.count("\n")) == (1, 1)
    assert message in error
    if spoil is nanoseconds:
        options = ("--scene", guess, "--fit", "friction.forward", "--units", "ns", "--json")
        status, text, _ = run(capsys, "identify", csv, *options)
        assert status == 0
        assert {p["verdict"] for p in json.loads(text)["parameters"]} == {"identified"}


@pytest.mark.parametrize("late", [1.7e9, -100.0])
def test_tables_of_different_clocks_are_refused_in_one_line(robot, tmp_path, capsys, late):
    guess, header, rows = robot
    csv = write_csv(tmp_path / "run.csv", header[:4], rows[:, :4])
    moved = rows[:, [0, 4, 5]] + [late, 0.0, 0.0]
    motors = write_csv(tmp_path / "motors.csv", ["time", *header[4:]], moved)
    options = ("--scene", guess, "--fit", "friction.forward", "--commands", motors)
    status, _, error = run(capsys, "identify", csv, *options)
    assert (status, error.count("\n")) == (1, 1)
    assert "both must have the same clock" in error


def test_values_that_are_none_are_named_and_left_out(robot, tmp_path, capsys):
    guess, header, rows = robot
    options = ("--scene", guess, "--fit", "friction.forward", "--json")
    rows[[40, 90], 2] = -9999.0
    status, text, _ = run(capsys, "identify", write_csv(tmp_path / "run.csv", header, rows), *options)
    found = json.loads(text)
    assert status == 0
    (line,) = found["warnings"]
    assert "run.csv: contact_1: 2 of 301 values are left out" in line
    assert "-9999 at 0.8 s, -9999 at 1.8 s" in line
    for p, true in zip(found["parameters"], (0.2, 0.23, 0.26), strict=True):
        assert p["interval"][0] < true < p["interval"][1]


def test_a_model_that_does_not_fit_identifies_nothing_and_predictions_tell(robot, tmp_path, capsys):
    guess, header, rows = robot
    rows[150:, 1:4] += 0.01
    csv = write_csv(tmp_path / "run.csv", header, rows)
    options = ("--scene", guess, "--fit", "friction.forward", "--seconds", "0")
    status, text, _ = run(capsys, "identify", csv, *options, "--json")
    found = json.loads(text)
    assert (status, found["model_fits"]) == (1, False)
    for p in found["parameters"]:
        assert p["verdict"] == "doubtful"
        assert p["value"] > 0.0
        assert p["interval"] == [None, None]
        assert p["why"].startswith("the model does not fit")
    assert not any(one["verdict"] == "identified" for one in found["sensors"])
    (tmp_path / "fit.json").write_text(text, encoding="utf-8")
    (tmp_path / "drive.yaml").write_text(
        yaml.safe_dump({"drive": {"times": [0.0, 0.5], "period": 1.0, "actuation": [[0.0, 0.0], [0.05, 0.05]]}}),
        encoding="utf-8",
    )
    words = ("--from", tmp_path / "fit.json", "--drive", tmp_path / "drive.yaml")
    status, text, _ = run(capsys, "predict", guess, *words)
    assert status == 0
    assert "the model does not fit its record, or nothing tells how that began: values are doubtful" in " ".join(
        text.split()
    )
    _, text, _ = run(capsys, "identify", csv, *options)
    assert "a model that does not fit predicts neither" in " ".join(text.split())


def numbers(text: str) -> set[str]:
    return set(re.findall(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?", text))


@pytest.mark.parametrize("wrong", [False, True])
def test_the_page_has_every_number_of_the_screen_and_loads_nothing(robot, tmp_path, capsys, wrong):
    guess, header, rows = robot
    if wrong:
        rows[150:, 1:4] += 0.01
    csv, html = write_csv(tmp_path / "run.csv", header, rows), tmp_path / "found.html"
    options = ("--scene", guess, "--fit", "friction.forward,friction.backward", "--html", html)
    status, shown, _ = run(capsys, "identify", csv, *options)
    page = unescape(html.read_text(encoding="utf-8"))
    text = re.sub(r"<style>.*?</style>|<[^>]*>", " ", page, flags=re.DOTALL)
    assert not numbers(shown.replace(str(html), "")) - numbers(text)
    assert status == int("the model does not fit" in text)
    assert status == 1 or not wrong
    for channel in ("contact_0", "contact_1", "contact_2"):
        assert f"<td>run.csv</td><td>{channel}</td>" in page
    assert set(re.findall(r"(?:src|href|url)\W+(\w+)", page)) == {"data"}
    assert "@import" not in page


@pytest.mark.parametrize("width", [60, 80, 140])
def test_no_number_is_cut_on_a_narrow_screen(robot, tmp_path, capsys, width):
    guess, header, rows = robot
    scene = load_scene(str(guess))
    measured = read_table(write_csv(tmp_path / "run.csv", header, rows), scene)
    found = identify(scene, [measured], ["friction.forward"])
    console = Screen(width=width, file=io.StringIO())
    print_identification(found, console)
    text = console.file.getvalue()
    for p in found.parameters:
        assert f" {p.value:.6g} " in text
        assert f"{p.interval[0]:.6g} .. {p.interval[1]:.6g} " in text
    assert "\u2026" not in text
    assert width < 80 or max(map(len, text.splitlines())) <= width


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


def test_joints_of_a_recording_are_found_by_name_in_every_message(tmp_path, capsys):
    """Their order changes, some messages hold some of them, and one joint is not of this body."""
    pytest.importorskip("mcap")
    rosbags = pytest.importorskip("rosbags.typesys")
    store = rosbags.get_typestore(rosbags.Stores.ROS2_JAZZY)
    scene = load_scene("two_contacts_anisotropic")
    bag = recordings.record(tmp_path / "bag", scene, 3.0)
    sent, states = [], 0
    for record in recordings.read(bag):
        name = record.topic.removeprefix("/")
        if name == "joint_states":
            message = store.deserialize_cdr(record.data, "sensor_msgs/msg/JointState")
            order = [[0, 1, 2], [2, 1, 0], [1, 2], [0, 2]][states % 4] if states else [2, 0, 1]
            states += 1
            for key in ("name", "position", "velocity", "effort"):
                given = [*getattr(message, key), "gripper" if key == "name" else 7.0 + states]
                some = [given[i] for i in order]
                setattr(message, key, some if key == "name" else np.array(some))
            data = bytes(store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
            sent.append((name, 0, data))
        elif name == "applied_commands":
            sent.append((name, 0, record.data))
    bag = recordings.write(tmp_path / "robot", sent, {}, "/robot/")
    document = scene.document()
    document["friction"]["forward"] = 1.2 * (true := float(scene.drive.forward[0, 0]))
    (tmp_path / "guess.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    words = ("identify", bag, "--scene", tmp_path / "guess.yaml", "--fit", "friction.forward", "--json")
    topics = [f"--topic={name}=/robot/{name}" for name in ("joint_states", "applied_commands")]
    status, text, error = run(capsys, *words, *topics)
    assert status == 0, error
    assert error.count("crawler: robot: joints not used, which two_contacts_anisotropic does not have: gripper\n") == 1
    (found,) = json.loads(text)["parameters"]
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
    """The measurements of the drive are computed with other friction than the guess."""
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


# -- tables as laboratories write them --------------------------------------------------------------------------------


def read(path: Path, guess: Path | Scene, *options: object, **named: object) -> Measurements:
    scene = guess if isinstance(guess, Scene) else load_scene(str(guess))
    return check_measurements(scene, read_table(path, scene, *options, **named))  # type: ignore[arg-type]


def assert_same(found: Measurements, expected: Measurements, rtol: float = 0.0) -> None:
    assert (found.channels, found.command_names) == (expected.channels, expected.command_names)
    for field in ("time", "values", "command_time", "commands"):
        np.testing.assert_allclose(getattr(found, field), getattr(expected, field), rtol, 0.0, err_msg=field)


def text(header: list[str], rows: np.ndarray, delimiter: str = ",", decimal: str = ".", end: str = "\n") -> str:
    lines = [delimiter.join("" if np.isnan(v) else repr(float(v)).replace(".", decimal) for v in row) for row in rows]
    return end.join((delimiter.join(header), *lines)) + end


def commented(header: list[str], rows: np.ndarray) -> bytes:
    first, *lines = text(header, rows).splitlines()
    lines[20:20] = ["# the camera was moved, see page 7, 8", '"# in quotes, because of a comma"', "  #"]
    return "\n".join(("# run 7; a\tb", "", first, "# s,m,m,m,m,m", *lines, "# end")).encode()


def of_a_spreadsheet(header: list[str], rows: np.ndarray) -> bytes:
    """With a byte-order mark, quoted names, a text column with points and commas, and rows without contents."""
    written = text(header, rows, ";", ",", "\r\n").splitlines()
    names = ";".join(f'"{name}"' for name in header)
    lines = [f"{names};remarks", *(f"{line};v. 1.2, good" for line in written[1:]), *[";" * len(header)] * 3]
    return b"\xef\xbb\xbf" + "\r\n".join(lines).encode()


def padded(header: list[str], rows: np.ndarray) -> bytes:
    return text(header, rows).replace(",", " ,  ").encode()


FORMS = {
    "plain": lambda header, rows: text(header, rows).encode(),
    "semicolon": lambda header, rows: text(header, rows, ";").encode(),
    "tab": lambda header, rows: text(header, rows, "\t").encode(),
    "semicolon and decimal comma": lambda header, rows: text(header, rows, ";", ",").encode(),
    "tab and decimal comma": lambda header, rows: text(header, rows, "\t", ",", "\r\n").encode(),
    "commented": commented,
    "spreadsheet": of_a_spreadsheet,
    "padded": padded,
}


@pytest.mark.parametrize("form", FORMS)
def test_each_form_of_a_table_is_read_as_the_same_measurements_to_the_bit(robot, tmp_path, form):
    guess, header, rows = robot
    expected = Measurements("run", rows[:, 0], tuple(header[1:4]), rows[:, 1:4], ("link_0", "link_1"), rows[:, 4:])
    file = tmp_path / "run.csv"
    file.write_bytes(FORMS[form](header, rows))
    assert_same(read(file, guess), check_measurements(load_scene(str(guess)), expected))


@pytest.mark.parametrize("marker", ["", "nan", "NaN", "NAN", "NA", "n/a", "-", "none", "None", "null", "  - "])
@pytest.mark.parametrize("delimiter", [",", ";"])
def test_markers_of_missing_values_are_gaps(robot, tmp_path, marker, delimiter):
    guess, header, rows = robot
    cells = [line.split(delimiter) for line in text(header, rows, delimiter).splitlines()]
    for row, column in ((0, 1), (17, 2), (18, 2), (299, 3)):
        cells[1 + row][column] = marker
        rows[row, column] = np.nan
    (tmp_path / "run.csv").write_text("\n".join(delimiter.join(line) for line in cells), encoding="utf-8")
    found = read(tmp_path / "run.csv", guess)
    np.testing.assert_array_equal(found.values, rows[:, 1:4])
    assert int(np.isnan(found.values).sum()) == 4
    assert not found.values.flags.writeable


def test_rows_in_which_nothing_was_seen_are_dropped_and_the_clock_remains(robot, tmp_path):
    guess, header, rows = robot
    blind = [0, 1, 2, 50, 51]
    rows[blind, 1:4] = np.nan
    kept = np.delete(np.arange(len(rows)), blind)
    found = read(write_csv(tmp_path / "run.csv", header, rows), guess)
    np.testing.assert_array_equal(found.time, rows[kept, 0])
    np.testing.assert_array_equal(found.values, rows[kept, 1:4])
    np.testing.assert_array_equal(found.command_time, rows[:, 0])
    scene = load_scene("two_contacts_anisotropic")  # its own drive begins at the first row, seen or not
    found = read(write_csv(tmp_path / "own.csv", header[:3], rows[:, :3] + [[3.0, 0.0, 0.0]]), scene)
    np.testing.assert_allclose(found.time, rows[kept, 0], rtol=0.0, atol=1e-14)


def test_gaps_do_not_hide_millimetres(robot, tmp_path):
    guess, header, rows = robot
    rows[:, 1:4] *= 1000.0
    rows[: len(rows) // 2, 1] = np.nan
    file = write_csv(tmp_path / "run.csv", header, rows)
    with pytest.raises(MeasurementError, match=r"look like millimetres or pixels: .* use --units mm"):
        read(file, guess)
    rows[len(rows) // 2 :, 3] = np.nan  # the ends are never seen together
    read(write_csv(tmp_path / "run.csv", header, rows), guess)
    rows[:, 1:4] = np.nan
    rows[::2, 1] = 100.0
    elongation = [header[0], "link_0", *header[2:]]
    with pytest.raises(MeasurementError, match=r"reach 100, .* use --units mm"):
        read(
            write_csv(tmp_path / "run.csv", [n for n in elongation if "contact" not in n], rows[:, [0, 1, 4, 5]]), guess
        )


def test_columns_of_other_names_are_mapped(robot, tmp_path):
    guess, header, rows = robot
    expected = read(write_csv(tmp_path / "run.csv", header, rows), guess)
    names = ["t", "HeadX", "contact_0", "Tail, x", "Motor1", "Motor2"]
    given = ["contact_0=HeadX, contact_1=contact_0", '"contact_2=Tail, x",time=t', "command/link_0=Motor1"]
    columns = parse_columns([*given, "command/link_1=Motor2"])
    (tmp_path / "lab.csv").write_text(text(names, rows, ";"), encoding="utf-8")
    assert_same(read(tmp_path / "lab.csv", guess, columns), expected)
    names = ["time", "contact_0", "old", "contact_2", "command/link_0", "command/link_1", "new"]
    moved = np.column_stack((rows, rows[:, 2]))
    moved[:, 2] = 7.0
    found = read(
        write_csv(tmp_path / "lab.csv", [n.replace("old", "contact_1") for n in names], moved),
        guess,
        {"contact_1": "new"},
    )
    assert found.channels == ("contact_0", "contact_2", "contact_1")
    np.testing.assert_array_equal(found.values, rows[:, [1, 3, 2]])


@pytest.mark.parametrize(
    ("units", "length", "time"),
    [
        ("m,s", 1.0, 1.0),
        ("mm", 1e3, 1.0),
        ("ms", 1.0, 1e3),
        ("mm,ms", 1e3, 1e3),
        ("us, cm", 1e2, 1e6),
        ("um", 1e6, 1.0),
    ],
)
def test_units_are_those_of_lengths_and_times_and_of_nothing_else(tmp_path, units, length, time):
    """A segment is commanded by its strain, contacts by their friction: neither is a length."""
    scene = load_scene("hybrid_body")
    names = scene.columns.names
    links = [name for name in names[: scene.columns.lengths] if name.startswith("link_")]
    channels = channel_names(scene)
    rng = np.random.default_rng(3)
    clock, values, commands = (
        np.arange(20) / 8.0,
        rng.normal(size=(20, len(channels))),
        rng.normal(size=(20, len(names))),
    )
    expected = Measurements("lab", clock, channels, values, names, commands)
    scale = np.array([length if name in links else 1.0 for name in names])
    header = ["time", *channels, *(f"command/{name}" for name in names)]
    file = write_csv(tmp_path / "lab.csv", header, np.column_stack((clock * time, values * length, commands * scale)))
    assert_same(read_table(file, scene, units=parse_units(units)), expected_with_clock(expected), rtol=5e-16)


def expected_with_clock(measured: Measurements) -> Measurements:
    return dataclasses.replace(measured, command_time=measured.time)


def test_commands_at_another_rate_stand_in_the_same_table_or_in_another_one(robot, tmp_path):
    """The frames of the camera lie between the commands, so that no row has both; the last commands come later."""
    guess, header, rows = robot
    times = np.arange(40) * 0.1953125 + 3.0
    sent = np.random.default_rng(5).uniform(-0.1, 0.1, (40, 2))
    expected = Measurements(
        "run", rows[:, 0] + 3.0078125, tuple(header[1:4]), rows[:, 1:4], ("link_0", "link_1"), sent, times
    )
    expected = check_measurements(load_scene(str(guess)), expected)
    assert not set(expected.time.tolist()) & set(expected.command_time.tolist())
    frames = rows[:, :4] + [[3.0078125, 0.0, 0.0, 0.0]]
    both = np.full((len(frames) + len(sent), 6), np.nan)
    both[: len(frames), :4] = frames
    both[len(frames) :, [0, 4, 5]] = np.column_stack((times, sent))
    merged = write_csv(tmp_path / "merged.csv", header, both[np.argsort(both[:, 0])])
    assert_same(read(merged, guess), expected)
    camera = write_csv(tmp_path / "camera.csv", header[:4], frames)
    motors = tmp_path / "motors.txt"
    motors.write_text(text(["t", "Motor2", "command/link_0"], np.column_stack((times, sent[:, ::-1])), "\t", ","))
    named = {"time": "t", "command/link_1": "Motor2"}
    found = read(camera, guess, named, commands=motors)
    assert found.command_names == ("link_1", "link_0")
    assert_same(
        dataclasses.replace(found, command_names=("link_0", "link_1"), commands=found.commands[:, ::-1]), expected
    )
    older = write_csv(tmp_path / "older.csv", header, np.column_stack((frames, frames[:, 2:4])))
    assert_same(read(older, guess, named, commands=motors), found)


def test_numbers_and_gaps_that_begin_late_in_a_long_table_are_read(robot, tmp_path):
    """More than the first block of pyarrow, one MB, contains nothing but whole numbers and gaps."""
    guess, header, _ = robot
    count = 60_000
    rows = np.zeros((count, 6))
    rows[:, 0] = np.arange(count) / 64.0
    rows[:, 3] = 0.2
    rows[:-20, 2] = np.nan
    rows[-10:, 4] = 0.0123
    lines = [f"{t!r},0,{'' if np.isnan(x) else x},{y!r},{c:g},0" for t, _, x, y, c, _ in rows.tolist()]
    (tmp_path / "run.csv").write_text("\n".join((",".join(header), *lines)), encoding="utf-8")
    assert (tmp_path / "run.csv").stat().st_size > 2**20
    found = read(tmp_path / "run.csv", guess)
    np.testing.assert_array_equal(found.commands, rows[:, 4:])
    np.testing.assert_array_equal(found.values, rows[:, 1:4])


def test_a_parquet_table_has_gaps_whole_numbers_and_text(robot, tmp_path):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    guess, header, rows = robot
    rows[3, 1], rows[4, 2] = np.nan, np.nan
    rows[:, 0] = np.arange(len(rows))
    expected = read(write_csv(tmp_path / "run.csv", header, rows), guess)
    columns = dict(zip(header, map(pa.array, rows.T), strict=True))
    columns["time"] = pa.array(np.arange(len(rows)))
    columns["contact_0"] = pa.array(rows[:, 1], from_pandas=True)
    columns["contact_1"] = pa.array(["NA" if np.isnan(v) else f" {v!r}" for v in rows[:, 2].tolist()])
    parquet.write_table(pa.table(columns), tmp_path / "run.PARQUET")
    assert_same(read(tmp_path / "run.PARQUET", guess), expected)


def test_a_table_of_a_laboratory_is_identified_as_the_plain_one_is(robot, tmp_path, capsys):
    guess, header, rows = robot
    plain = write_csv(tmp_path / "run.csv", header, rows)
    scaled_rows = rows * [1e3, 1e3, 1e3, 1e3, 1e3, 1e3]
    (tmp_path / "lab.TSV").write_text(text(["t", "head", "mid", "tail"], scaled_rows[:, :4], "\t", ","))
    motors = write_csv(tmp_path / "motors.csv", ["t", "m1", "m2"], scaled_rows[:, [0, 4, 5]])
    columns = ("--columns", "time=t,contact_0=head,contact_1=mid", "--columns", "contact_2=tail")
    columns += ("--columns", "command/link_0=m1,command/link_1=m2", "--units", "mm,ms", "--commands", str(motors))
    found = []
    for arguments in ((plain,), (tmp_path / "lab.TSV", *columns)):
        status, out, error = run(
            capsys, "identify", *arguments, "--scene", guess, "--fit", "friction.forward", "--json"
        )
        assert status == 0, error
        found.append([p["value"] for p in json.loads(out)["parameters"]])
    assert found[1] == pytest.approx(found[0], rel=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--units", "inch"), "--units inch: 'inch' is not known; write a unit of length (m, cm, mm, um) or a unit of"),
        (("--units", "mm,"), "--units mm,: '' is not known"),
        (("--units", "mm,cm"), "--units mm,cm: mm and cm are both units of length; write one of them"),
        (("--columns", "contact_0"), "--columns contact_0: write OURS=THEIRS"),
        (("--columns", "contact_0=a,contact_0=b"), "--columns: contact_0 is mapped twice, to a and to b"),
        (("--columns", "contact_0=a", "--columns", "contact_1=a"), "--columns: a is mapped twice, to contact_0 and to"),
        (("--columns", "contact_0=HeadX"), "run.csv has no column HeadX; its header is time,contact_0,contact_1,"),
        (("--columns", "contact_9=time"), "--columns contact_9=time: contact_9 does not belong to measured, which has"),
        (("--columns", "time=contact_0"), "does not come after"),
        (("--commands", "{}/bag"), "/bag is not a table; its name must end in one of .csv, .tsv, .txt, .parquet"),
        (("--commands", "{}/none.csv"), "/none.csv: no such file"),
        (("--commands", "{}/camera.csv"), "camera.csv: no column `command/...`; the header is time,contact_0"),
        (("--commands", "{}/half.csv"), "half.csv: command/link_1 is missing in row 6 (time 0.08), other commands are"),
        (
            ("--commands", "{}/half.csv", "--columns", "command/link_0=m"),
            "half.csv has no column m; its header is time,",
        ),
        (("--commands", "{}/late.csv"), "must have the same clock"),
    ],
)
def test_mistakes_in_the_description_of_a_table_are_named_in_one_line(robot, tmp_path, capsys, options, message):
    guess, header, rows = robot
    csv = write_csv(tmp_path / "run.csv", header, rows)
    write_csv(tmp_path / "camera.csv", header[:4], rows[:, :4])
    (tmp_path / "bag").mkdir()
    write_csv(tmp_path / "late.csv", [header[0], *header[4:]], rows[:, [0, 4, 5]] - [[1e3, 0.0, 0.0]])
    rows[4, 5] = np.nan
    write_csv(tmp_path / "half.csv", [header[0], *header[4:]], rows[:, [0, 4, 5]])
    given = [str(option).format(tmp_path) for option in options]
    status, out, error = run(capsys, "identify", csv, "--scene", guess, "--fit", "friction.forward", *given)
    assert (status, out, error.count("\n")) == (1, "", 1)
    assert message in error


def test_columns_that_are_not_used_are_listed(robot, tmp_path, capsys):
    guess, header, rows = robot
    csv = write_csv(tmp_path / "run.csv", [*header, "contcat_1", "note"], np.hstack((rows, rows[:, 1:3])))
    status, _, error = run(capsys, "identify", csv, "--scene", guess, "--fit", "friction.forward")
    assert (status, error) == (0, "crawler: run.csv: columns not used: contcat_1, note\n")


@pytest.mark.parametrize("option", [("--columns", "time=t"), ("--units", "mm"), ("--commands", "run.csv")])
def test_options_of_tables_are_refused_with_a_recording(robot, tmp_path, capsys, option):
    guess, header, rows = robot
    csv, bag = write_csv(tmp_path / "run.csv", header, rows), tmp_path / "bag"
    words = ("identify", csv, bag, "--scene", guess, "--fit", "friction.forward", *option)
    assert run(capsys, *words) == (1, "", f"crawler: {bag}: no such file\n")
    bag.mkdir()
    status, out, error = run(capsys, *words)
    assert (status, out, error.count("\n")) == (1, "", 1)
    assert f"{option[0]}: {bag} is a recording; the option applies only to tables" in error


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            b"0,02;",
            b"0.02;",
            "column time, row 3: '0.02' is not a number with a decimal comma, as most in this table",
        ),
        (b"0.02;", b"0,02;", "column time, row 3: '0,02' is not a number"),
        (b"0,02;", b"1.000,02;", "column time, row 3: '1.000,02' is not a number with a decimal comma"),
        (b"0,02;", b"0:02;", "column time, row 3: '0:02' is not a number"),
        (b"0,02;", b"2024-01-01 00:00:00;", "column time, row 3: '2024-01-01 00:00:00' is not a number"),
        (b"0,02;", b"0,02;7;", "run.csv: row 3 has 7 cells, the header has 6"),
        (
            b"0,02;",
            b'0,02;7;"\n";',
            "run.csv: row 3 has 8 cells, the header has 6",
        ),
        (b"\n0,02;", b"\n;", "time is missing in row 3; every row needs it"),
        (b"time;", b"Zeit;", "no column `time`; the header is Zeit,contact_0,contact_1,"),
        (b"time;", b"time,", "run.csv: row 2 has 6 cells, the header has 5"),
    ],
)
def test_a_cell_that_is_no_number_is_named(robot, tmp_path, old, new, message):
    guess, header, rows = robot
    data = FORMS["semicolon" if b"." in old else "semicolon and decimal comma"](header, rows)
    assert data.count(old) >= 1
    (tmp_path / "run.csv").write_bytes(data.replace(old, new, 1))
    with pytest.raises(MeasurementError) as refused:
        read(tmp_path / "run.csv", guess)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("data", [b"", b"\n\n", b"# time,contact_0\n", b"time,contact_0,contact_1\n", b"\xef\xbb\xbf"])
def test_an_empty_table_is_refused(robot, tmp_path, data):
    (tmp_path / "run.csv").write_bytes(data)
    with pytest.raises(MeasurementError, match=r"no column `time`|0 rows are too few"):
        read(tmp_path / "run.csv", load_scene("two_contacts_anisotropic"))


@pytest.mark.parametrize(
    ("encoding", "message"),
    [
        ("utf-16", "its encoding is UTF-16; save it as UTF-8"),
        (
            "cp1252",
            "byte 0xb5 in line 2 is not UTF-8; in the encoding cp1252 (Windows) it is 'µ': save the file as UTF-8",
        ),
    ],
)
def test_the_encoding_of_a_table_is_named(robot, tmp_path, encoding, message):
    guess, header, rows = robot
    text = write_csv(tmp_path / "run.csv", header, rows).read_text()
    (tmp_path / "run.csv").write_bytes(f"# of camera 2\n# in µm\n{text}".encode(encoding))
    with pytest.raises(MeasurementError) as refused:
        read(tmp_path / "run.csv", guess)
    assert message in str(refused.value)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_rows_are_counted_as_in_the_file(robot, tmp_path, end):
    """Comments and empty lines count, too."""
    guess, header, rows = robot
    header_line, first, second, *rest = write_csv(tmp_path / "run.csv", header, rows).read_text().splitlines()
    spoilt = ",".join(["soon", *second.split(",")[1:]])
    lines = ["# of camera 2", "", header_line, first, "", "# moved by hand", spoilt, *rest]
    (tmp_path / "run.csv").write_bytes(end.join(lines).encode())
    with pytest.raises(MeasurementError, match="column time, row 7: 'soon' is not a number"):
        read(tmp_path / "run.csv", guess)


# -- damaged tables ---------------------------------------------------------------------------------------------------


def test_a_number_beyond_all_use_and_a_header_that_is_no_text_are_named(robot, tmp_path, capsys):
    guess, header, rows = robot
    options = ("--scene", guess, "--fit", "friction.forward")
    rows = rows.copy()
    rows[5, 1] = 1e300
    status, _, err = run(capsys, "identify", write_csv(tmp_path / "large.csv", header, rows), *options)
    assert (status, err.count("\n")) == (1, 1)
    assert f"large.csv: column {header[1]}, row 7: 1e+300; it must be at most 1e+100 in size" in err
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
    data = bytearray(list(FORMS.values())[seed % len(FORMS)](header, rows[:40]))
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


LINE = {
    "body": {"contacts": [0.0, 0.2], "links": {"stiffness": 20.0}},
    "friction": {"forward": 0.3, "backward": 0.9},
    "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [0.1], [0.0]]},
}
PLANE = {
    "dimension": 2,
    "body": {"contacts": [[0.0, 0.0], [0.2, 0.0]], "links": {"stiffness": 20.0}},
    "friction": {"isotropic": 0.3},
    "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[[0, 0]], [[0.1, 0.05]], [[0, 0]]]},
}
TURNING = {
    "dimension": 2,
    "body": {"points": [[0.0, 0.0], [0.2, 0.0]], "springs": "length", "links": {"stiffness": 20.0}},
    "friction": {"isotropic": 0.3},
    "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [0.1], [0.0]]},
}


@pytest.mark.parametrize("form", ["table", "recording"])
@pytest.mark.parametrize(
    ("document", "commanded"),
    [
        (LINE, {"friction": {"forward": [[0.1, 0.1]] * 3, "backward": 0.9}}),
        (LINE, {"friction": {"forward": [[0.1, 0.1], [0.2, 0.1], [0.1, 0.1]], "backward": 0.9}}),
        (LINE | {"loads": 0.0}, {"loads": [-0.1] * 3}),
        (LINE, {"loads": [[-0.1, -0.1], [-0.05, -0.1], [-0.1, -0.1]]}),
        (PLANE, {"friction": {"isotropic": [[0.1, 0.1], [0.1, 0.2], [0.1, 0.1]]}}),
        (PLANE, {"loads": [[0.0, 0.05]] * 3}),
        (TURNING, {"friction": {"isotropic": [[0.1, 0.1], [0.1, 0.2], [0.1, 0.1]]}}),
    ],
    ids=["constant", "of_a_contact", "loads", "loads_of_the_drive", "plane", "plane_loads", "turning"],
)
def test_commanded_friction_and_loads_are_those_of_the_run(tmp_path, capsys, form, document, commanded):
    """They differ from the scene's; with the scene's the stiffness would be wrong, and fit as well on a line."""
    scene = Scene.model_validate(document | {"name": "driven", "drive": document["drive"] | commanded})
    (tmp_path / "driven.yaml").write_text(yaml.safe_dump(scene.document()))
    if form == "recording":
        path = recordings.record(tmp_path / "bag", scene, 4.0)
    else:
        path = tmp_path / "driven.csv"
        assert run(capsys, "simulate", tmp_path / "driven.yaml", "--duration", 4, "--csv", path)[0] == 0
    options = ("--fit", "body.links.stiffness", "--sensor", "perfect", "--json")
    status, out, err = run(capsys, "identify", path, "--scene", tmp_path / "driven.yaml", *options)
    assert status == 0, err
    (found,) = json.loads(out)["parameters"]
    assert found["value"] == pytest.approx(20.0, rel=1e-4)


SEGMENT = {
    "body": {
        "segments": [
            {
                "name": "trunk",
                "elements": 8,
                "from": 0.0,
                "to": 1.0,
                "stiffness": 2.0,
                "friction": {"forward": 0.3, "backward": 0.9},
            }
        ]
    },
    "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [0.3], [0.0]]},
}


@pytest.mark.parametrize(
    ("document", "commanded", "key"),
    [
        (LINE, {"friction": {"forward": 0.1, "backward": 0.9}}, "friction.forward"),
        (LINE, {"loads": [-0.1] * 3}, "loads"),
        (PLANE, {"friction": {"isotropic": 0.1}}, "friction.isotropic"),
        (PLANE, {"loads": [[0.0, 0.05]] * 3}, "loads"),
        (SEGMENT, {"friction": {"forward": 0.1, "backward": 0.9}}, "body.segments[0].friction.forward"),
    ],
    ids=["friction", "loads", "plane", "plane_loads", "segment"],
)
def test_what_was_commanded_is_not_fitted(tmp_path, capsys, document, commanded, key):
    (tmp_path / "driven.yaml").write_text(
        yaml.safe_dump(document | {"name": "driven", "drive": document["drive"] | commanded})
    )
    path = tmp_path / "driven.csv"
    assert run(capsys, "simulate", tmp_path / "driven.yaml", "--duration", 2, "--csv", path)[0] == 0
    status, _, err = run(capsys, "identify", path, "--scene", tmp_path / "driven.yaml", "--fit", key)
    assert status == 1
    assert "no effect, as driven.csv has commands of all that it changes" in err


def test_a_number_on_which_the_run_does_not_depend_is_told(tmp_path, capsys):
    """With coefficients, weights press contacts to the ground, but this friction was commanded."""
    body = LINE["body"] | {"weights": 1.0}
    drive = LINE["drive"] | {"friction": {"forward": 0.1, "backward": 0.9}}
    document = LINE | {"name": "driven", "body": body, "friction": {"coefficient": {"forward": 0.3, "backward": 0.9}}}
    (tmp_path / "driven.yaml").write_text(yaml.safe_dump(document | {"drive": drive}))
    path = tmp_path / "driven.csv"
    assert run(capsys, "simulate", tmp_path / "driven.yaml", "--duration", 2, "--csv", path)[0] == 0
    options = ("--fit", "body.weights", "--json")
    status, out, err = run(capsys, "identify", path, "--scene", tmp_path / "driven.yaml", *options)
    assert status == 0, err
    (found,) = (one for one in json.loads(out)["parameters"] if one["name"] == "body.weights")
    assert found["verdict"] == "not excited"
