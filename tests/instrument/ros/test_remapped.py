"""Recordings of crawlers whose topics have other names than usual: remapped one by one, in namespaces, in others'."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
from std_msgs.msg import Float64MultiArray

from crawler_ros.recording import bag
from crawler_ros.recording.bag_writer import BagWriter
from crawler_ros.replay import analyse
from crawler_ros.replay.show.compare import compare_recordings
from crawler_ros.viewer.frames import frames_of_recording
from crawler_ros.viewer.visualizer import draw_recording
from crawler_ros.wire.topics import read_topics

from ...commands import crawler
from ...recordings import attachments, messages, play, write
from .graph import graph, wait_until

REMAPPED = {
    "plain": {},
    "one": {"joint_states": "js"},
    "ledger": {"applied_commands": "/log/ledger", "contact_states": "touch", "/diagnostics": "/health"},
    "namespace": {"__ns": "/left", "__node": "worm", "joint_states": "/right/joint_states", "pose": "where"},
    "commands": {"__ns": "/far", "actuation_controller/commands": "/go", "applied_commands": "joint_states_applied"},
}


def name_of(remaps: dict[str, str], topic: str) -> str:
    name = remaps.get(topic, topic)
    return name if name.startswith("/") else f"{remaps.get('__ns', '')}/{name}"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> dict[str, Path]:
    """One simulator for each case, all driven by the same commands in lock-step."""
    folder = tmp_path_factory.mktemp("remapped")
    with graph(folder) as ros:
        # no two of them may share a topic: what is not remapped stands in a namespace of its own
        cases = {case: {"__ns": f"/{case}"} | remaps for case, remaps in REMAPPED.items()}
        processes = {}
        for case, remaps in cases.items():
            ros.hear(name_of(remaps, "joint_states"), type_name="joint_states")
            words = [word for pair in remaps.items() for word in ("-r", ":=".join(pair))]
            given = ("scene:=three_contacts_two_ways", f"record:={folder / case}", "lock_step:=true")
            processes[case] = ros.start("crawler_ros.node.simulator", *given, arguments=tuple(words))
        for case, remaps in cases.items():
            heard = ros.heard[name_of(remaps, "joint_states")]
            wait_until(lambda h=heard: h, 60.0, f"the first state of {case}")
            for k in range(1, 41):
                command = Float64MultiArray(data=(0.4 * np.sin([0.3 * k, 0.2 * k])).tolist())
                name = name_of(remaps, "actuation_controller/commands")
                count = len(heard)
                ros.publish(name, command, table_name="actuation_controller/commands")
                wait_until(lambda h=heard, n=count: len(h) > n, what=f"the answer of {case}")
        for case, process in processes.items():
            listed = [name_of(cases[case], name) for name, topic in read_topics().items() if topic.direction == "in"]
            assert f"waiting for commands on {', '.join(listed)}; services " in process.said
            assert process.end() == 0, process.said
            assert "no command was received" not in process.said
    return {case: next((folder / case).iterdir()) for case in cases}


@pytest.mark.parametrize("case", REMAPPED)
def test_it_is_simulated_again_to_the_bit(recordings, case):
    found = analyse(recordings[case])
    assert found.problems == ()
    assert found.comparison.identical
    assert found.comparison.ticks == 41
    assert found.robot.namespace == REMAPPED[case].get("__ns", f"/{case}")
    assert found.slips.contact.size > 2
    for name, topic in found.robot.topics.items():
        if name in ("joint_states", "contact_states", "pose", "applied_commands"):
            assert found.topics[topic].rate == pytest.approx(100.0), name  # judged as the crawler's own


def test_the_command_replays_it(recordings, tmp_path):
    words = ("--json", "--png", tmp_path / "x.png", "--parquet", tmp_path / "t", "--rrd", tmp_path / "x.rrd")
    done = crawler("replay", str(recordings["namespace"]), *map(str, words))
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["namespace"] == "/left"
    assert said["resimulation"]["identical"]
    assert "/right/joint_states" in said["health"]
    done = crawler("replay", str(recordings["one"]), "--namespace", "one")
    assert done.returncode == 0, done.stderr
    done = crawler("replay", str(recordings["one"]), "--namespace", "other")
    assert "no crawler in the namespace /other; there are /one" in done.stderr


@pytest.mark.parametrize("case", [c for c in REMAPPED if c != "plain"])
def test_it_is_drawn_and_compared_as_any_other(recordings, case, tmp_path):
    plain, other = (list(frames_of_recording(recordings[c])[1]) for c in ("plain", case))
    assert [f.pack() for f in plain] == [f.pack() for f in other]
    assert len(plain) == 41
    assert any(f.forward.any() for f in plain)
    assert draw_recording(recordings[case], tmp_path / "x.rrd") > 5
    same = compare_recordings(recordings["plain"], recordings[case])
    assert same.commands_differ is None
    assert same.max_difference == 0.0


def test_a_torn_one_is_recovered_with_its_names(recordings, tmp_path):
    data = bag.find_file(recordings["namespace"]).read_bytes()
    (tmp_path / "torn.mcap").write_bytes(data[: int(len(data) * 0.6)])
    done = crawler("replay", str(tmp_path / "torn.mcap"), "--recover")
    assert done.returncode == 0, done.stderr
    assert analyse(tmp_path / "torn_recovered").comparison.identical


def test_two_crawlers_in_one_file_are_told_apart_though_one_notes_its_names(tmp_path):
    """As merged by another tool: the notes belong to one, the other is found by its namespace."""
    from crawler_model import load_scene
    from crawler_ros.wire.topics import read_topics

    scene = load_scene("two_anchor_a")
    noted = {"joint_states": "/js", "applied_commands": "/left/ledger", "pose": "/left/pose"}
    writer = BagWriter(tmp_path / "a", attachments(scene) | {"node": "/left/crawler", "topics": noted})
    channels: dict[str, int] = {}
    for k, (name, _, data) in enumerate(messages(scene, play(scene, 0, 10**9))):
        for topic in (noted.get(name), f"/right/{name}"):
            if topic is not None:
                if topic not in channels:
                    channels[topic] = writer.add_topic(read_topics()[name], topic)
                writer.write(channels[topic], 10**18 + k, 10**18 + k, data)
    writer.close()
    with pytest.raises(bag.BagError, match="2 robots; choose one with --namespace /left, /right"):
        analyse(tmp_path / "a")
    for namespace in ("left", "right"):
        assert analyse(tmp_path / "a", None, namespace).comparison.identical


@pytest.mark.parametrize(
    "notes", [{"topics": "none"}, {"topics": {"joint_states": 3}}, {"topics": {"joint_states": "/gone"}}]
)
def test_notes_that_do_not_fit_are_passed_over(tmp_path, notes):
    from crawler_model import load_scene

    scene = load_scene("two_anchor_a")
    path = write(tmp_path / "a", messages(scene, play(scene, 0, 10**9)), attachments(scene) | notes)
    assert analyse(path).comparison.identical
