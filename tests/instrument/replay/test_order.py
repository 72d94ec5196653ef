"""The verdict on a recording depends on what was recorded, not on how a file stores it."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
import zstandard

from crawler_model import load_scene
from crawler_ros.recording import bag, bag_files, log_order, mcap_reader
from crawler_ros.replay import analyse
from crawler_ros.replay.health import survey_recording

from ...commands import crawler
from ...recordings import attachments, messages, play, record, write
from .mcap_files import VARIANTS, Held, Variant, change_effort, hold, shuffled, write_variant

NS = 1_000_000_000


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Held:
    """Two runs with a reset between them, of a scene that is in the recording."""
    scene = load_scene("three_contacts_one_way")
    runs = [list(messages(scene, play(scene, 100_000_000, seconds * NS))) for seconds in (2, 3)]
    held = hold(write(tmp_path_factory.mktemp("whole") / "a", [*runs[0], *runs[1]], attachments(scene)))
    apart = tuple(r._replace(log_ns=10**18 + 1000 * k) for k, r in enumerate(held.records))
    return Held(apart, held.attached)


def plain(path: Path) -> dict:
    """What `crawler replay --json` prints, but for the name of the recording."""
    found = analyse(path).as_plain()
    json.dumps(found, allow_nan=False)
    return {key: value for key, value in found.items() if key != "recording"}


@pytest.fixture(scope="module", params=["as_recorded", "tampered"])
def expected(request, recorded, tmp_path_factory) -> tuple[Held, dict]:
    held = recorded
    if request.param == "tampered":
        held = change_effort(recorded, "/joint_states", 2_500_000_000, 1)
    return held, plain(write_variant(held, tmp_path_factory.mktemp("b") / "b", VARIANTS["as_recorded"]))


@pytest.mark.parametrize("name", VARIANTS)
def test_the_same_messages_have_the_same_verdict(tmp_path, expected, recorded, name):
    held, wanted = expected
    again = wanted["resimulation"]
    assert (again["ticks"], again["compared"], again["left_out"], again["resets"]) == (502, 3 * 502, 0, 1)
    assert again["identical"] == wanted["healthy"] == (held is recorded)
    assert wanted["complete"]
    if held is recorded:
        assert again["explanation"] == "identical to the bit (all 502 recorded states compared)"
    else:
        assert again["first_difference"] == 2.5
    assert plain(write_variant(held, tmp_path / "b", VARIANTS[name])) == wanted


@pytest.mark.parametrize("waiting", [0, 100_000])
def test_what_does_not_fit_in_memory_is_sorted_on_disk(tmp_path, recorded, monkeypatch, waiting):
    monkeypatch.setattr(mcap_reader, "_BLOCK_BYTES", 10_000)
    for name, bound in (("_MOST_WAITING", waiting), ("_SORTED_AT_ONCE", 60_000), ("_SORTED_PIECE", 5_000)):
        monkeypatch.setattr(log_order, name, bound)
    sorted_to_disk = []
    store = log_order._store
    monkeypatch.setattr(log_order, "_store", lambda *given: sorted_to_disk.append(0) or store(*given))
    path = write_variant(recorded, tmp_path / "b", Variant(shuffled, options={"chunk_size": 5_000}))
    found = list(bag.read(path))
    assert [(r.topic, r.log_ns, r.data) for r in found] == [(r.topic, r.log_ns, r.data) for r in recorded.records]
    assert sorted_to_disk


def test_a_state_that_no_tick_leads_to_is_not_passed_over(tmp_path, recorded):
    """The ledger ends, or has a gap, while the crawler rests and its states go on."""
    from crawler_ros.wire.messages import read_stamp

    held = recorded
    for first, last in ((0, 5_000_000), (50_000_000, 60_000_000), (2_500_000_000, 9 * NS)):
        kept = tuple(
            r for r in held.records if r.topic != "/applied_commands" or not first <= read_stamp(r.data) < last
        )
        found = analyse(write_variant(Held(kept, held.attached), tmp_path / str(first), VARIANTS["as_recorded"]))
        assert not found.comparison.identical
        assert not found.healthy
        assert found.comparison.left_out > 0 or found.comparison.first_difference is not None


@pytest.mark.parametrize("where", ["view", "walk", "measurements", "data set"])
def test_all_readers_read_in_the_order_of_reception(tmp_path, recorded, where):
    one, other = (write_variant(recorded, tmp_path / name / "b", VARIANTS[name]) for name in ("in_parts", "shuffled"))
    found = []
    for path in (one, other):
        if where == "view":
            from crawler_command.view import read_frames

            found.append([frame.pack() for frame in read_frames(path, None, None)[1]])
        elif where == "walk":
            from crawler_ros.replay.show.compare import compare_recordings

            both = compare_recordings(one, path, None, None, lambda part: None)
            found.append(json.dumps(both.as_plain()).replace(str(path), "").replace(str(one), ""))
        elif where == "measurements":
            from crawler_lab.identify.recorded import read_bag

            runs = read_bag(path, load_scene("three_contacts_one_way"), {})
            found.append([(m.time.tolist(), m.values.tolist(), m.commands.tolist()) for m in runs])
        else:
            from crawler_command.recordings.rows import tabulate

            made = tabulate(str(path), None, None)
            found.append((made.reason, made.healthy, made.tables["cycles"], made.tables["account"]))
    assert found[0] == found[1]


# -- what metadata.yaml promises --------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", [0, 1, 3])
@pytest.mark.parametrize("compressed", ["", "file"])
def test_a_missing_file_is_named_with_the_time_it_held(tmp_path, recorded, part, compressed):
    folder = write_variant(recorded, tmp_path / "b", Variant(parts=4, compressed=compressed))
    (lost,) = folder.glob(f"b_{part}.*")
    lost.unlink()
    survey = survey_recording(folder)
    assert not survey.complete
    (line,) = survey.missing
    size = len(recorded.records)
    first, last = (1e-6 * (k * size // 4) for k in (part, part + 1))
    assert line.startswith(f"{lost.name} is missing with its {(part + 1) * size // 4 - part * size // 4} message(s)")
    assert line.endswith(f"it held {first:.6g} s to {last - 1e-6:.6g} s after the start of the recording")


def test_a_missing_file_fails_every_verb_that_judges(tmp_path, recorded):
    folder = write_variant(recorded, tmp_path / "b", Variant(parts=3))
    (folder / "b_2.mcap").unlink()
    done = crawler("replay", folder, "--json")
    assert done.returncode == 1
    assert "b_2.mcap is missing" in done.stderr
    assert json.loads(done.stdout)["complete"] is False
    out = tmp_path / "set"
    done = crawler("replay", folder, "--parquet", out, "--workers", "1")
    assert done.returncode == 1
    assert "b_2.mcap is missing" in done.stderr


def test_times_of_the_whole_recording_beside_each_file_are_narrowed_by_its_neighbours():
    """Some writers state the same times for all files."""
    promises = [bag_files.Promise(f"a_{k}.mcap", 5, 0, 9 * NS) for k in range(3)]
    held = [bag_files.Held(Path(f"a_{k}.mcap"), 5, 3 * k * NS, 3 * (k + 1) * NS) for k in range(3)]
    lines = [bag_files.compare_with_promises(promises, held[:k] + held[k + 1 :])[0] for k in range(3)]
    assert [line.partition("it held ")[2].partition(" after")[0] for line in lines] == [
        "0 s to 3 s",
        "3 s to 6 s",
        "6 s to 9 s",
    ]


def test_a_file_with_fewer_messages_than_promised_is_named(tmp_path, recorded):
    short = Held(recorded.records[:-9], recorded.attached)
    folder = write_variant(recorded, tmp_path / "b", Variant())
    cut = write_variant(short, tmp_path / "c" / "b", Variant())
    (cut / "b_0.mcap").replace(folder / "b_0.mcap")
    survey = survey_recording(folder)
    count = len(recorded.records)
    assert survey.missing == (f"b_0.mcap has {count - 9} message(s), but metadata.yaml counts {count} in it",)
    assert not survey.complete


@pytest.mark.parametrize("text", ["", "[", "a: b", "rosbag2_bagfile_information: {files: [1, {path: [x]}]}", "\x00"])
def test_metadata_that_nobody_can_read_promises_nothing(tmp_path, recorded, text):
    folder = write_variant(recorded, tmp_path / "b", Variant())
    (folder / "metadata.yaml").write_text(text)
    assert survey_recording(folder).complete


# -- damage where nothing is counted ----------------------------------------------------------------------------------


def chunks_of(data: bytes) -> list[tuple[int, int]]:
    """Where the chunks of a file begin and end."""
    place, found = 8, []
    while place + 9 <= len(data) - 8:
        end = place + 9 + int.from_bytes(data[place + 1 : place + 9], "little")
        if data[place] == 6:
            found.append((place, end))
        place = end
    return found


@pytest.mark.parametrize("how", ["a chunk is damaged", "a chunk is cut out", "the end is cut off", "a record is torn"])
@pytest.mark.parametrize("crcs", [True, False])
def test_without_optional_records_damage_is_damage(tmp_path, recorded, how, crcs):
    options = {"use_statistics": False, "chunk_size": 50_000, "enable_crcs": crcs}
    file = write_variant(recorded, tmp_path / "b", Variant(options=options)) / "b_0.mcap"
    data = bytearray(file.read_bytes())
    first, last = chunks_of(data)[2]
    if how == "a chunk is cut out":
        del data[first:last]
    elif how == "the end is cut off":
        del data[-20:]
    else:
        inside = first + 9 + 8 + 8 + 8 + 4 + 4 + 8  # times, size, checksum, no compression, size
        place = inside + 1 if how == "a record is torn" else first + 9 + 16
        data[place : place + 4] = b"\xff\xff\xff\x7f"  # the size of the first record, or of the chunk
    file.write_bytes(data)
    assert survey_recording(file).complete is False
    assert analyse(file).problems
    out = tmp_path / "recovered"
    found = bag.recover(file, out)
    assert found == len(recorded.records) if how == "the end is cut off" else 0 < found < len(recorded.records)
    assert survey_recording(out).complete


# -- formats of rosbag2 -----------------------------------------------------------------------------------------------


def bomb(size: int) -> bytes:
    return zstandard.ZstdCompressor().compress(bytes(size))


def test_compressed_files_and_messages_that_fill_memory_or_disk_are_refused(tmp_path, monkeypatch, recorded):
    monkeypatch.setattr(mcap_reader, "ALWAYS_EXPANDED", 1 << 24)
    monkeypatch.setattr(mcap_reader, "LARGEST_CHUNK", 1 << 22)
    (tmp_path / "a.mcap.zstd").write_bytes(bomb(1 << 26))
    with pytest.raises(bag.BagError, match="the file is damaged or made to fill the disk"):
        bag.examine(tmp_path / "a.mcap.zstd")
    filled = Held(tuple(r._replace(data=bytes(1 << 23)) for r in recorded.records[:3]), ())
    path = write_variant(filled, tmp_path / "b", Variant(compressed="message"))
    with pytest.raises(bag.BagError, match="made to fill the memory"):
        bag.examine(path)


def test_a_compressed_file_is_read_up_to_its_damage(tmp_path, recorded):
    folder = write_variant(recorded, tmp_path / "b", Variant(compressed="file", options={"chunk_size": 10_000}))
    (file,) = folder.glob("*.zstd")
    file.write_bytes(file.read_bytes()[:-300])
    (folder / "metadata.yaml").unlink()
    assert not survey_recording(folder).complete
    assert 0 < bag.recover(folder, tmp_path / "out") < len(recorded.records)


def test_of_many_compressed_files_all_are_read_and_no_copy_is_left(tmp_path, monkeypatch, recorded):
    """A copy without a name is gone with the process, however that ends."""
    copies = tmp_path / "copies"
    copies.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(copies))
    folder = write_variant(recorded, tmp_path / "b", Variant(parts=20, compressed="file"))
    assert bag.recover(folder, tmp_path / "out") == len(recorded.records)
    assert survey_recording(folder).complete
    assert not list(copies.iterdir())


def test_damaged_compressed_messages_are_lost_and_counted(tmp_path, recorded):
    folder = write_variant(recorded, tmp_path / "b", Variant(compressed="message", options={"use_chunking": False}))
    (file,) = folder.glob("*.mcap")
    data = file.read_bytes().replace(b"\x28\xb5\x2f\xfd", b"\x28\xb5\x2f\xfd\xff\xff", 0)
    place = data.index(b"\x28\xb5\x2f\xfd", len(data) // 2)
    file.write_bytes(data[: place + 4] + bytes(b ^ 255 for b in data[place + 4 : place + 12]) + data[place + 12 :])
    survey = survey_recording(folder)
    assert (survey.damaged, survey.lost, survey.complete) == (1, 1, False)


@pytest.mark.parametrize("name", ["bag", "bag/bag_0.db3", "zstd"])
def test_an_sqlite_bag_is_refused_with_the_command_that_converts_it(tmp_path, name):
    for folder, file in (("bag", "bag_0.db3"), ("zstd", "zstd_0.db3.zstd")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / file).write_bytes(b"SQLite format 3\0" + bytes(100))
    done = crawler("replay", tmp_path / name)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "storage_id: mcap, all: true}]' > convert.yaml && ros2 bag convert -i " in done.stderr


def test_an_sqlite_bag_is_read_after_the_conversion_that_needs_no_ros(tmp_path):
    original = record(tmp_path / "original", "two_anchor_a", 1)
    tool = str(Path(sys.executable).with_name("rosbags-convert"))
    subprocess.run([tool, "--src", original, "--dst", tmp_path / "bag", "--dst-storage", "sqlite3"], check=True)
    refused = crawler("replay", "bag", cwd=tmp_path)
    program, *words = shlex.split(refused.stderr.rpartition("pip install rosbags && ")[2])
    assert program == "rosbags-convert"
    subprocess.run([tool, *words], cwd=tmp_path, check=True)
    found = analyse(tmp_path / "bag_mcap", load_scene("two_anchor_a"))
    assert found.comparison is not None
    assert found.comparison.identical


def test_bytes_that_are_no_message_are_named_with_their_file(tmp_path, recorded):
    records = tuple(r._replace(data=r.data[:30]) if r.topic == "/joint_states" else r for r in recorded.records)
    path = write_variant(Held(records, recorded.attached), tmp_path / "b", Variant())
    with pytest.raises(bag.BagError) as error:
        analyse(path)
    assert str(error.value).startswith(
        f"{path}: /joint_states: a message of 30 bytes is not a sensor_msgs/msg/JointState"
    )


def test_parts_are_in_the_order_in_which_they_are_listed_else_in_that_of_their_numbers(tmp_path):
    names = [f"run_{k}.mcap" for k in (0, 1, 2, 10)]
    for name in names:
        (tmp_path / name).touch()
    assert [file.name for file in bag_files.find_files(tmp_path)] == names
    listed = {"relative_file_paths": names[::-1], "files": [{"path": name, "message_count": 0} for name in names[::-1]]}
    (tmp_path / "metadata.yaml").write_text(json.dumps({"rosbag2_bagfile_information": {"version": 9} | listed}))
    assert [file.name for file in bag_files.find_files(tmp_path)] == names[::-1]
