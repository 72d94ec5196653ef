"""Recordings of real runs, read back by others."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy")
import mcap.writer
import zstandard
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import Float64MultiArray

from crawler_model import Crawler, Scene, load_scene
from crawler_ros.recording import bag
from crawler_ros.recording.bag_writer import BagWriter
from crawler_ros.recording.mcap_writer import COMPRESSION, McapFile
from crawler_ros.recording.record_head import message_head
from crawler_ros.recording.recorder import Recorder
from crawler_ros.wire.definitions import type_hash
from crawler_ros.wire.topics import read_topics

from ...processes import children, wait_until
from .graph import environment, graph, only, seconds

DECODE = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr
OUT = {"/joint_states", "/contact_states", "/pose", "/applied_commands", "/diagnostics"}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A gait of three periods and a friction array, recorded, with the bytes that were heard meanwhile."""
    folder = tmp_path_factory.mktemp("run")
    with graph(folder) as ros:
        ros.hear("joint_states", raw=True)
        ros.hear("applied_commands", raw=True)
        simulator = ros.start(
            "crawler_ros.node.simulator", f"record:={folder / 'bags'}", "scene:=three_contacts_two_ways"
        )
        wait_until(lambda: ros.heard["joint_states"])
        player = ros.start("crawler_ros.node.gait_player", "scene:=three_contacts_two_ways", "periods:=3")
        assert player.wait() == 0
        ros.publish("friction_controller/commands", Float64MultiArray(data=[0.4]))
        ros.taken_up()
        assert simulator.end() == 0
        return only(folder / "bags"), {k: [bytes(b) for b in v] for k, v in ros.heard.items()}


def test_it_has_what_rosbag2_writes(run):
    path, _ = run
    metadata = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert metadata["version"] == 9
    assert metadata["storage_identifier"] == "mcap"
    assert metadata["relative_file_paths"] == [f"{path.name}_0.mcap"]
    counts = {t["topic_metadata"]["name"]: t["message_count"] for t in metadata["topics_with_message_count"]}
    assert OUT | {"/joint_trajectory", "/friction_controller/commands"} <= set(counts)
    assert not {"/odom", "/clock"} & set(counts)  # they are not published
    assert counts["/friction_controller/commands"] == 1
    assert counts["/joint_trajectory"] >= 3  # a player that waits long asks for a state
    assert sum(counts.values()) == metadata["message_count"] == metadata["files"][0]["message_count"]
    with (path / f"{path.name}_0.mcap").open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert {m.name for m in reader.iter_metadata()} == {"rosbag2"}
        assert len(list(reader.iter_metadata())) == 2
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        assert schema.encoding == "ros2msg"
        assert channel.message_encoding == "cdr"
        assert channel.metadata["topic_type_hash"] == type_hash(schema.name)
        assert yaml.safe_load(channel.metadata["offered_qos_profiles"])[0]["reliability"] == "reliable"


def test_rosbags_reads_every_message(run):
    path, _ = run
    with AnyReader([path]) as reader:
        messages = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()]
        assert len(messages) == reader.message_count > 1000


def test_mcap_ros2_reads_every_message(run):
    path, _ = run
    with bag.find_file(path).open("rb") as stream:
        decoded = make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        states = [m for _, channel, _, m in decoded if channel.topic == "/joint_states"]
    assert list(states[0].name) == ["contact_0", "link_0", "link_1"]
    assert len(states) > 300


def test_rerun_reads_it_natively(run, tmp_path):
    path, _ = run
    import rerun as rr

    stream = rr.RecordingStream("native")
    stream.save(str(tmp_path / "native.rrd"))
    stream.log_file_from_path(str(bag.find_file(path)))
    stream.flush()
    stream.disconnect()
    assert (tmp_path / "native.rrd").stat().st_size > 50_000


def test_the_bytes_published_are_the_bytes_recorded(run):
    path, heard = run
    recorded = {name: [r.data for r in bag.read(path) if r.topic == "/" + name] for name in heard}
    for name, messages in heard.items():
        assert len(messages) > 300
        rest = iter(recorded[name])
        assert all(message in rest for message in messages)  # in order, every one of them


def test_the_file_alone_runs_again_bit_for_bit(run):
    path, _ = run
    head = bag.Bag({})
    records = list(bag.read(path, head))
    assert head.complete
    assert head.attachments.keys() == {"scene", "parameters", "versions", "start", "node", "topics"}
    assert head.attachments["node"] == "/crawler"
    assert head.attachments["topics"]["joint_states"] == "/joint_states"
    scene = Scene.model_validate(head.attachments["scene"])
    assert scene == load_scene("three_contacts_two_ways")
    assert head.attachments["parameters"]["rate"] == 100.0
    assert head.attachments["versions"]["numpy"] == np.__version__
    crawler = Crawler(scene, head.attachments["parameters"]["method"])
    assert crawler.displacement.tolist() == head.attachments["start"]["displacement"]
    compared = moved = 0
    for record in records:
        message = DECODE(record.data, record.type)
        if record.topic == "/applied_commands" and message.points:
            crawler.follow(np.array([p.positions for p in message.points]))
            moved += 1
        elif record.topic == "/joint_states":
            assert message.position[0] == crawler.displacement[0]
            assert message.position[1:].tolist() == crawler.shape.tolist()
            assert message.effort[1:].tolist() == crawler.tension.tolist()
            compared += 1
    assert moved > 100
    assert compared > 300


def test_a_killed_simulator_leaves_a_whole_recording(tmp_path):
    with graph(tmp_path) as ros:
        simulator = ros.simulator(f"record:={tmp_path / 'bags'}")
        heard = len(ros.heard["joint_states"])
        wait_until(lambda: len(ros.heard["joint_states"]) > heard + 50)
        simulator.process.send_signal(signal.SIGKILL)
        simulator.process.wait()
        last = seconds(ros.heard["joint_states"][-1])
        path = only(tmp_path / "bags")
        wait_until(lambda: (path / "metadata.yaml").exists())
        with AnyReader([path]) as reader:
            stamps = [
                seconds(reader.deserialize(raw, c.msgtype))
                for c, _, raw in reader.messages()
                if c.topic == "/joint_states"
            ]
        assert stamps[-1] >= last - 0.1  # what was not yet handed over, a tick or a few


def states_on_disk(path: Path) -> int:
    return bag.examine(path).counts.get("/joint_states", 0) if list(path.glob("*.mcap")) else 0


def test_with_its_recording_process_killed_too_what_was_on_disk_is_kept(tmp_path):
    """It is brought there again and again, twice a second where the machine has the time; commands even unpublished."""
    with graph(tmp_path) as ros:
        simulator = ros.simulator(f"record:={tmp_path / 'bags'}", "rate:=100.0", "publish.applied_commands:=false")
        ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.2, 0.0]))
        path = only(tmp_path / "bags")
        wait_until(lambda: states_on_disk(path) > 200, what="two seconds on disk")
        heard = len(ros.heard["joint_states"])
        wait_until(lambda: states_on_disk(path) > heard, what="all that was heard on disk")
        least = states_on_disk(path)
        for pid in (*children(simulator.process.pid), simulator.process.pid):
            os.kill(pid, signal.SIGKILL)
        simulator.process.wait()
        health = bag.examine(path)
        assert not health.complete
        assert health.counts["/applied_commands"] > 0
        assert bag.recover(path, tmp_path / "again") == sum(health.counts.values())
        with AnyReader([tmp_path / "again"]) as reader:
            stamps = [
                seconds(reader.deserialize(raw, c.msgtype))
                for c, _, raw in reader.messages()
                if c.topic == "/joint_states"
            ]
        assert len(stamps) >= least
        assert np.diff(stamps) == pytest.approx(0.01)
        head = bag.Bag({})
        list(bag.read(tmp_path / "again", head))
        assert head.complete
        assert head.attachments["scene"]["name"] == "three_contacts_one_way"


EARLY_S = 0.48
"""The second part of a recording is due on disk half a second after the first."""


@pytest.mark.parametrize("ticks", [2, 10, 20, 30, 43])
def test_both_processes_killed_early_lose_less_than_four_tenths_of_a_second(tmp_path, ticks):
    """What was heard of counts as published; a kill that a busy machine delays is repeated."""
    for attempt in range(20):
        folder = tmp_path / f"bags {attempt}"
        with graph(tmp_path) as ros:
            simulator = ros.simulator(f"record:={folder}", "rate:=100.0")
            ros.ticked(ticks)
            for pid in (*children(simulator.process.pid), simulator.process.pid):
                os.kill(pid, signal.SIGKILL)
            simulator.process.wait()
            last = max(seconds(message) for message in ros.heard["joint_states"])
        if last <= EARLY_S:
            break
    assert last <= EARLY_S
    kept = [DECODE(r.data, "sensor_msgs/msg/JointState") for r in bag.read(only(folder)) if r.topic == "/joint_states"]
    assert last - max((seconds(message) for message in kept), default=0.0) < 0.4


def test_what_is_recorded_reaches_the_disk_again_and_again(tmp_path):
    recorder = Recorder(tmp_path, "flushed", {})
    channel = recorder.add_topic(read_topics()["joint_states"], "/joint_states")
    recorder.start()
    for k in range(4):
        recorder.record(channel, k, k, bytes(100))
        recorder.push((k + 1) * 10**9)
        wait_until(lambda count=k + 1: states_on_disk(recorder.folder) == count, what=f"message {k} on disk")
    recorder.close()


@pytest.mark.parametrize("part", [0.02, 0.3, 0.6, 0.95, 0.999])
def test_a_torn_file_gives_what_it_has(run, tmp_path, part):
    path, _ = run
    data = bag.find_file(path).read_bytes()
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(data[: int(len(data) * part)])
    health = bag.examine(torn)
    assert not health.complete
    if part > 0.2:
        assert sum(health.counts.values()) > 0


def test_damaged_bytes_end_the_reading_and_are_not_taken_for_whole(run, tmp_path):
    path, _ = run
    data = bytearray(bag.find_file(path).read_bytes())
    whole = bag.examine(path).counts
    rng = np.random.default_rng(0)
    for _ in range(150):
        damaged = bytearray(data)
        for place in rng.integers(8, len(data), 3):
            damaged[place] ^= 1 << int(rng.integers(8))
        file = tmp_path / "damaged.mcap"
        file.write_bytes(damaged)
        health = bag.examine(file)
        assert health.counts == whole or not health.complete


def test_two_threads_record_without_tearing_each_other_s_messages(tmp_path):
    recorder = Recorder(tmp_path, "two", {})
    channels = [recorder.add_topic(read_topics()[name], f"/{name}") for name in ("pose", "joint_states")]
    recorder.start()
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:

        def work(channel, size):
            for _ in range(20_000):
                recorder.record(channel, 1, 1, bytes([channel]) * size)

        threads = [threading.Thread(target=work, args=pair) for pair in zip(channels, (40, 7), strict=True)]
        for thread in threads:
            thread.start()
        while any(thread.is_alive() for thread in threads):
            recorder.push(time.monotonic_ns())
        recorder.close()
    finally:
        sys.setswitchinterval(before)
    assert recorder.error is None
    assert recorder.messages == 40_000
    for record in bag.read(recorder.folder):
        channel = record.topic == "/joint_states"
        assert record.data == bytes([channel]) * (7 if channel else 40)
    assert bag.examine(recorder.folder).counts == {"/pose": 20_000, "/joint_states": 20_000}


def test_what_is_no_recording_is_named(tmp_path):
    (tmp_path / "text.mcap").write_text("hello")
    (tmp_path / "empty").mkdir()
    for name, said in (("text.mcap", "not an MCAP file"), ("empty", "no .mcap file"), ("none", "no such file")):
        with pytest.raises(bag.BagError, match=said):
            list(bag.read(tmp_path / name))


def test_a_recording_never_overwrites_another(tmp_path):
    BagWriter(tmp_path / "bag", {}).close()
    with pytest.raises(FileExistsError, match="not empty"):
        BagWriter(tmp_path / "bag", {})


def test_when_recording_fails_the_crawler_goes_on_and_says_so(tmp_path):
    """The recording process dies, as it does of a full disk."""
    with graph(tmp_path) as ros:
        simulator = ros.simulator(f"record:={tmp_path / 'bags'}", hear=("joint_states", "/diagnostics"))
        (recording,) = wait_until(lambda: children(simulator.process.pid), what="a recording process")
        os.kill(recording, signal.SIGKILL)
        level = wait_until(
            lambda: [
                s
                for m in ros.heard["/diagnostics"]
                for s in m.status
                if s.name.endswith("recording") and s.level == b"\x02"
            ]
        )
        assert "recording stopped" in level[0].message
        heard = len(ros.heard["joint_states"])
        wait_until(lambda: len(ros.heard["joint_states"]) > heard + 20)
        assert simulator.end() == 1
        assert simulator.said.splitlines()[-1].startswith("simulator: recording stopped: ")


@pytest.mark.parametrize("repeating", [False, True])
@pytest.mark.parametrize("messages", [0, 1, 500])
def test_the_file_is_that_of_the_mcap_library(tmp_path, monkeypatch, messages, repeating):
    """The same records through our writer, torn into odd pieces, and through mcap's, byte for byte."""
    rng = np.random.default_rng(messages)
    ours, theirs = tmp_path / "ours.mcap", tmp_path / "theirs.mcap"
    compress = zstandard.ZstdCompressor(compression_params=COMPRESSION).compress  # theirs takes the default
    monkeypatch.setattr(mcap.writer.zstandard, "compress", compress)
    sent = [
        (1 + int(rng.integers(2)), 10**18 + int(rng.integers(10**9)), rng.bytes(int(rng.integers(400))))
        for _ in range(messages)
    ]
    if repeating:  # as ticks do, now and then with another message between them
        sizes = [(1, 40), (2, 30), (1, 50), (2, 30)]
        for k in range(messages):
            channel, size = sizes[k % 4] if rng.integers(40) else (2, 17)
            sent[k] = channel, sent[k][1], rng.bytes(size)
    with ours.open("wb") as stream, theirs.open("wb") as other:
        mine = McapFile(stream, "ros2", "crawler", 20_000)
        library = mcap.writer.Writer(other, chunk_size=20_000)
        library.start("ros2", "crawler")
        for writer in (mine, library):
            writer.add_metadata("rosbag2", {"ROS_DISTRO": "jazzy"})
        mine.add_attachment(7, "scene", "application/json", b"{}")
        library.add_attachment(7, 7, "scene", "application/json", b"{}")
        assert mine.add_schema("a/msg/A", "ros2msg", b"text") == library.register_schema("a/msg/A", "ros2msg", b"text")
        for name in ("/a", "/b"):
            number = library.register_channel(name, "cdr", 1, {"k": "v"})
            assert mine.add_channel(name, "cdr", 1, {"k": "v"}) == number
        waiting = b""
        for k, (channel, log_ns, data) in enumerate(sent):
            library.add_message(channel, log_ns, data, log_ns - 5, k)
            waiting += message_head(channel, k, log_ns, log_ns - 5, len(data)) + data
            if k % 7 == 0:
                cut = len(waiting) - int(rng.integers(60))
                waiting = waiting[mine.add_messages(waiting[: max(cut, 0)]) :]
            if k % 100 == 50:
                assert mine.add_messages(waiting) == len(waiting)
                waiting = b""
                mine.flush()
                library.flush()
        mine.add_messages(waiting)
        mine.finish()
        library.finish()
    assert ours.read_bytes() == theirs.read_bytes()


def test_what_waits_for_a_slow_recording_is_bounded_and_nothing_is_lost(tmp_path):
    recorder = Recorder(tmp_path, "slow", {})
    channel = recorder.add_topic(read_topics()["pose"], "/pose")
    recorder.start()
    data, limit = bytes(100_000), 1 << 26
    pid = recorder._process.pid
    os.kill(pid, signal.SIGSTOP)
    later = threading.Thread(
        target=lambda: (wait_until(lambda: recorder.waiting > limit), os.kill(pid, signal.SIGCONT))
    )
    later.start()
    most = now = 0
    for _ in range(2000):  # 200 MB
        recorder.record(channel, 1, 1, data)
        recorder.push(now := now + 10**9)
        most = max(most, recorder.waiting)
    recorder.close()
    assert recorder.error is None
    assert limit - 10**6 < most <= limit
    assert bag.examine(recorder.folder).counts == {"/pose": 2000}


def test_messages_larger_than_the_shared_memory_and_empty_ones_are_recorded(tmp_path):
    recorder = Recorder(tmp_path, "large", {})
    channel = recorder.add_topic(read_topics()["pose"], "/pose")
    recorder.start()
    sizes = [100_000, 0, (1 << 26) + 12_345, 0, 7, (1 << 26) - 31, 100_000]
    for k, size in enumerate(sizes):
        recorder.record(channel, k, k, bytes([k]) * size)
    recorder.push(10**9)
    assert recorder.waiting <= 1 << 26
    recorder.close()
    assert recorder.error is None
    read = [record.data for record in bag.read(recorder.folder)]
    assert read == [bytes([k]) * size for k, size in enumerate(sizes)]


KILLED = """
import os, signal, sys
from pathlib import Path
from crawler_ros.recording.recorder import Recorder
from crawler_ros.wire.topics import read_topics

recorder = Recorder(Path(sys.argv[1]), "killed", {})
channel = recorder.add_topic(read_topics()["pose"], "/pose")
recorder.start()
os.kill(recorder._process.pid, signal.SIGSTOP)
for k in range(300):
    recorder.record(channel, k, k, bytes(100_000))
recorder.push(10**9)
print(recorder._process.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_simulator_handed_over_to_a_slow_recording_is_kept(tmp_path):
    words = [sys.executable, "-c", KILLED, str(tmp_path)]
    done = subprocess.run(words, env=environment(), stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, timeout=120)
    assert done.returncode == -signal.SIGKILL
    os.kill(int(done.stdout), signal.SIGCONT)
    path = only(tmp_path)
    wait_until(lambda: (path / "metadata.yaml").exists())
    assert bag.examine(path).counts == {"/pose": 300}  # 30 MB, many times what a pipe holds


def test_nothing_piles_up_behind_a_recording_that_failed(tmp_path):
    recorder = Recorder(tmp_path, "dead", {})
    channel = recorder.add_topic(read_topics()["pose"], "/pose")
    recorder.start()
    os.kill(recorder._process.pid, signal.SIGKILL)
    recorder._process.wait()
    for k in range(100):
        recorder.record(channel, 1, 1, bytes(100))
        recorder.push(k * 10**9)
    assert "recording stopped" in recorder.error
    assert recorder.messages == 1
    assert recorder.waiting == 0
    recorder.close()


def test_an_empty_recording_is_whole(tmp_path):
    writer = BagWriter(tmp_path / "bag", {"scene": {"a": 1}})
    writer.add_topic(read_topics()["pose"], "/pose")
    writer.close()
    health = bag.examine(tmp_path / "bag")
    assert health.complete
    assert not health.counts
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == 0


def test_others_nodes_messages_are_recorded_as_strict_readers_want_them(tmp_path):
    """rclpy leaves garbage in alignment gaps and pads empty sequences; a recording must still be readable."""
    from .test_nodes import trajectory

    with graph(tmp_path) as ros:
        simulator = ros.simulator(f"record:={tmp_path / 'bags'}")
        for k in range(5):
            ros.publish("joint_trajectory", trajectory(["link_0"], (0.0, [0.01 * k]), (0.1, [0.02])))
        ros.publish("joint_trajectory", trajectory([]))
        ros.taken_up()
        assert simulator.end() == 0
    with AnyReader([only(tmp_path / "bags")]) as reader:
        seen = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages() if c.topic == "/joint_trajectory"]
    assert len(seen) == 6
    assert [len(m.points) for m in seen] == [2] * 5 + [0]
