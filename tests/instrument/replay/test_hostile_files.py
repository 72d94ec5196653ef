"""Recordings that are damaged, made to harm, split into files, or belong to another scene: one line, and what can be read."""

from __future__ import annotations

import errno
import json
import os
import shutil
import struct
import tracemalloc

import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Channel, Chunk, Footer, Header, Message, Schema

from crawler_ros.recording import bag, mcap_reader
from crawler_ros.recording.bag_writer import BagWriter
from crawler_ros.recording.mcap_writer import McapFile
from crawler_ros.replay.health import survey_recording
from crawler_ros.wire.topics import read_topics

from ...commands import crawler
from ...recordings import attachments, messages, play, record, write

MUTANTS = 500 if os.environ.get("CRAWLER_SOAK") else 50
NS = 1_000_000_000


def encoded(*records) -> bytes:
    builder = RecordBuilder()
    for entry in records:
        entry.write(builder)
    return bytes(builder.end())


def mcap(*records) -> bytes:
    """A file without an end."""
    return b"\x89MCAP0\r\n" + encoded(Header("ros2", "test"), *records)


def chunk(inside: bytes, size: int | None = None) -> Chunk:
    data = zstandard.ZstdCompressor().compress(inside)
    size = len(inside) if size is None else size
    return Chunk("zstd", data, 0, 0, 0, size)


def described(topic: str = "/a"):
    schema = Schema(id=1, data=b"", encoding="ros2msg", name="std_msgs/msg/String")
    return schema, Channel(id=1, message_encoding="cdr", metadata={}, schema_id=1, topic=topic)


def message(log_ns: int, sequence: int = 0, data: bytes = b"x") -> Message:
    return Message(channel_id=1, data=data, log_time=log_ns, publish_time=log_ns, sequence=sequence)


# -- chunks that expand -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stated", ["truly", "less"])
@pytest.mark.parametrize("flags", [(), ("--recover",), ("--show",)])
def test_a_chunk_of_a_few_kilobytes_that_fills_the_memory_is_refused(tmp_path, stated, flags):
    inside = bytes(4 * mcap_reader.LARGEST_CHUNK)
    bomb = chunk(inside, len(inside) if stated == "truly" else mcap_reader.LARGEST_CHUNK - 1)
    file = tmp_path / "bomb.mcap"
    file.write_bytes(mcap(bomb))
    assert file.stat().st_size < 20_000
    tracemalloc.start()
    if stated == "truly":
        with pytest.raises(bag.BagError, match="no recording does: the file is damaged or made to fill the memory"):
            bag.examine(file)
    else:  # a chunk that is larger than it states is damaged
        assert bag.examine(file).counts == {}
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 4 * mcap_reader.LARGEST_CHUNK
    done = crawler("replay", file, *flags)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1


def test_many_chunks_that_fill_the_memory_together_are_refused(tmp_path):
    file = tmp_path / "bombs.mcap"
    file.write_bytes(mcap(*[chunk(bytes(mcap_reader.LARGEST_CHUNK))] * 6))
    with pytest.raises(bag.BagError, match=rf"bytes expand to more than .* or {mcap_reader.ALWAYS_EXPANDED} in all"):
        bag.examine(file)


def test_millions_of_empty_records_are_passed_over_and_messages_behind_them_are_read(tmp_path):
    empty = struct.pack("<BQ", 0x90, 0)
    inside = encoded(*described()) + empty * 5_000_000 + encoded(message(1))
    file = tmp_path / "empty.mcap"
    file.write_bytes(mcap(chunk(inside)))
    assert bag.examine(file).counts == {"/a": 1}


# -- records that are not valid ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("inside_chunk", [False, True])
def test_times_beyond_all_clocks_and_names_that_are_no_text_cost_only_themselves(tmp_path, inside_chunk):
    schema, channel = described()
    other = encoded(Channel(id=2, message_encoding="cdr", metadata={}, schema_id=1, topic="/bbb"))
    other = other.replace(b"/bbb", b"/\xff\xfeb")
    parts = encoded(schema, channel) + other + encoded(message(5), message(2**63), message(7))
    file = tmp_path / "odd.mcap"
    if inside_chunk:
        file.write_bytes(mcap(chunk(parts)))
        assert bag.examine(file).counts == {"/a": 2}
    else:
        file.write_bytes(mcap() + parts)
        bag.examine(file)  # what is damaged outside a chunk ends the reading
    assert crawler("replay", file).stderr.count("\n") == 1


@pytest.mark.parametrize("start", [1, 8, 9, 2**63 - 1, 2**63, 2**64 - 1])
def test_a_summary_that_begins_nowhere_costs_nothing(tmp_path, start):
    file = tmp_path / "odd.mcap"
    end = Footer(summary_start=start, summary_offset_start=0, summary_crc=0)
    file.write_bytes(mcap(*described(), message(1), message(2), end) + b"\x89MCAP0\r\n")
    assert bag.examine(file).counts == {"/a": 2}


def test_an_attachment_nested_beyond_all_use_is_left_out(tmp_path):
    deep = b"[" * 200_000 + b"]" * 200_000
    data = [
        Attachment(create_time=0, log_time=0, name=name, media_type="application/json", data=text)
        for name, text in (("deep", deep), ("note", b'{"a": 1}'))
    ]
    file = tmp_path / "deep.mcap"
    file.write_bytes(mcap(*data, *described(), message(1)))
    found = bag.Bag({})
    assert len(list(bag.read(file, found))) == 1
    assert found.attachments == {"note": {"a": 1}}


def test_states_that_do_not_fit_the_scene_are_named(tmp_path):
    source = record(tmp_path / "a", "three_contacts_one_way", 2)
    kept = [
        (name, 0, r.data)
        for r in bag.read(source)
        if (name := r.topic.removeprefix("/")) in ("joint_states", "applied_commands")
    ]
    late = write(tmp_path / "late", kept[len(kept) // 2 :], {})  # it begins in mid-run, without its scene
    done = crawler("replay", late, "--scene", "ten_contact_wave")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "name the scene with which it was recorded" in done.stderr


def test_a_view_leaves_out_damaged_messages_and_counts_them(tmp_path, capsys):
    from crawler_model import load_scene
    from crawler_ros.viewer.frames import frames_of_recording

    scene = load_scene("three_contacts_one_way")
    sent = list(messages(scene, play(scene, 0, NS)))
    hurt = [(name, ns, data[:-7] if k % 5 == 0 else data) for k, (name, ns, data) in enumerate(sent)]
    damaged = sum(k % 5 == 0 and m[0] in ("joint_states", "applied_commands") for k, m in enumerate(sent))
    _, frames = frames_of_recording(write(tmp_path / "a", hurt, attachments(scene)))
    states = sum(name == "joint_states" for name, _, _ in sent)
    hurt_states = sum(k % 5 == 0 and m[0] == "joint_states" for k, m in enumerate(sent))
    assert len(list(frames)) == states - hurt_states > 0
    assert f"left out {damaged} messages that are damaged or do not fit the scene" in capsys.readouterr().err


# -- split recordings, and recovery -----------------------------------------------------------------------------------


def split(source, folder, parts):
    """Write a recording in several files, as rosbag2 does with a largest size."""
    records = list(bag.read(source))
    head = bag.Bag({})
    list(bag.read(source, head))
    folder.mkdir()
    for part in range(parts):
        here = records[part * len(records) // parts : (part + 1) * len(records) // parts]
        writer = BagWriter(folder / "made", head.attachments if part == 0 else {})
        channels = {}
        for r in sorted(here, key=lambda r: r.topic) if part else here:  # other channel numbers in each file
            channels.setdefault(r.topic, None)
        for topic in channels:
            channels[topic] = writer.add_topic(read_topics()[topic.removeprefix("/")], topic)
        for r in here:
            writer.write(channels[r.topic], r.log_ns, r.publish_ns, r.data)
        writer.close()
        (folder / "made" / "made_0.mcap").rename(folder / f"{folder.name}_{part}.mcap")
        shutil.rmtree(folder / "made")
    return folder


@pytest.mark.parametrize("size", [0, 5, 8, 20])
def test_a_file_that_has_just_begun_is_an_incomplete_recording(tmp_path, size):
    """A recorder may have created it a moment ago."""
    BagWriter(tmp_path / "run", {}).close()
    (file,) = (tmp_path / "run").glob("*.mcap")
    file.write_bytes(file.read_bytes()[:size])
    health = bag.examine(tmp_path / "run")
    assert not health.complete
    assert health.counts == {}


def test_a_folder_of_split_files_is_one_recording(tmp_path):
    whole = record(tmp_path / "whole", "three_contacts_one_way", 6)
    parts = split(whole, tmp_path / "parts", 12)
    assert [f.name for f in bag.find_files(parts)] == [f"parts_{k}.mcap" for k in range(12)]
    assert [(r.topic, r.data) for r in bag.read(parts)] == [(r.topic, r.data) for r in bag.read(whole)]
    one, other = (json.loads(crawler("replay", path, "--json").stdout) for path in (whole, parts))
    assert other["complete"] is True
    assert other["resimulation"] == one["resimulation"]
    assert other["cycles"] == one["cycles"]
    last = bag.find_files(parts)[-1]
    last.write_bytes(last.read_bytes()[:-20])
    assert not survey_recording(parts).complete


def test_files_of_several_recordings_in_a_folder_are_refused(tmp_path):
    for name in ("a_0", "b_1"):
        (tmp_path / f"{name}.mcap").write_bytes(mcap())
    with pytest.raises(bag.BagError, match=r"2 \.mcap files in this folder; name one of them"):
        bag.find_files(tmp_path)


def test_a_recovery_that_fails_leaves_nothing_behind(tmp_path, monkeypatch):
    file = tmp_path / "torn.mcap"
    file.write_bytes(mcap(*described(), *[message(k) for k in range(5)]))

    def fill_the_disk(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(BagWriter, "write", fill_the_disk)
        with pytest.raises(OSError, match="No space left"):
            bag.recover(file, tmp_path / "again")
    assert not (tmp_path / "again").exists()
    assert bag.recover(file, tmp_path / "again") == 5
    with monkeypatch.context() as patch:
        patch.setattr(McapFile, "add_metadata", fill_the_disk)
        with pytest.raises(OSError, match="No space left"):
            bag.recover(file, tmp_path / "third")
    assert not (tmp_path / "third").exists()
    with pytest.raises(FileExistsError):
        bag.recover(file, tmp_path / "again")
    assert (tmp_path / "again").exists()
    (tmp_path / "bare.mcap").write_bytes(mcap(*described()))
    with pytest.raises(bag.BagError, match="no message can be read"):
        bag.recover(tmp_path / "bare.mcap", tmp_path / "bare")
    assert not (tmp_path / "bare").exists()


def test_recovery_keeps_sequence_numbers_and_all_attachments(tmp_path):
    attached = [
        Attachment(create_time=1, log_time=2, name=name, media_type=media, data=data)
        for name, media, data in (
            ("photo", "image/png", b"\x89PNG"),
            ("scene", "application/json", b'{"a":  1}'),
            ("log", "text/plain", b"behind the messages"),
        )
    ]
    file = tmp_path / "torn.mcap"
    sent = [message(k, sequence=7 + 3 * k, data=bytes([k])) for k in range(5)]
    file.write_bytes(mcap(*attached[:2], *described(), *sent, attached[2]))
    assert bag.recover(file, tmp_path / "again") == 5
    found = bag.Bag({})
    read = list(bag.read_blocks(tmp_path / "again", found))
    assert found.complete
    assert np.concatenate([b.sequence for b in read]).tolist() == [7, 10, 13, 16, 19]
    kept = {a.name: (a.media_type, a.data) for a in found.attached}
    assert kept.pop("recovered")[0] == "application/json"
    assert kept == {a.name: (a.media_type, a.data) for a in attached}


# -- anything ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return bag.find_file(record(tmp_path_factory.mktemp("whole") / "a", "three_contacts_one_way", 2)).read_bytes()


@pytest.mark.parametrize("seed", range(MUTANTS))
def test_mutants_of_a_recording_end_in_one_line_or_in_a_result(tmp_path, whole, seed):
    rng = np.random.default_rng(seed)
    data = bytearray(whole)
    kind = seed % 4
    if kind == 0:
        for place in rng.integers(8, len(data), rng.integers(1, 20)):
            data[place] ^= 1 << int(rng.integers(8))
    elif kind == 1:
        place = int(rng.integers(8, len(data) - 64))
        data[place : place + 8] = rng.choice([b"\xff" * 8, b"\x00" * 8, bytes(rng.integers(0, 256, 8).tolist())])
    elif kind == 2:
        first, last = np.sort(rng.integers(8, len(data), 2))
        del data[first:last]
    else:
        first, last = np.sort(rng.integers(8, len(data), 2))
        data[first:first] = data[first:last]
    file = tmp_path / "mutant.mcap"
    file.write_bytes(data)
    flags = [(), ("--recover",), ("--show",), ("--json",)][seed // 4 % 4]
    done = crawler("replay", file, *flags)
    assert "Traceback" not in done.stderr
    assert done.returncode in (0, 1)
    assert done.returncode == 0 or done.stderr.strip()
