"""Our bytes against two independent decoders."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import load_scene
from crawler_ros.node.encoder import LEDGER, STATES, TickEncoder
from crawler_ros.node.intake.commanded_path import Vertices
from crawler_ros.recording.record_head import message_head
from crawler_ros.wire.messages import (
    CLOCK,
    TrajectoryMessage,
    encode_diagnostics,
    lay_out_joint_state,
    lay_out_odometry,
    lay_out_pose,
    list_pose,
)
from crawler_ros.wire.states import contact_names, joint_state_names
from crawler_ros.wire.topics import message_class

pytest.importorskip("rclpy")
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
STAMP = 12_345_678_901


def joint_state(names=("contact_0", "link_0", "link_11"), frame=""):
    numbers = np.concatenate([np.arange(len(names)) + 10 * k + 0.25 for k in range(3)])
    return "sensor_msgs/msg/JointState", lay_out_joint_state(names, frame).encode(STAMP, numbers)


def pose(frame="world"):
    return "geometry_msgs/msg/PoseStamped", lay_out_pose(frame).encode(STAMP, list_pose(-1.5))


def trajectory(points=2, contacts=3):
    names = [f"joint_{i}" for i in range(3 * contacts - 1)]
    rows = [np.arange(len(names)) * 0.5 + i for i in range(points)]
    times = [7 * i * 10**8 for i in range(points)]
    return "trajectory_msgs/msg/JointTrajectory", TrajectoryMessage(names).encode(STAMP, times, rows)


def diagnostics():
    statuses = [(1, "crawler: a", "odd", "h", [("k", "v"), ("kk", "")]), (0, "b", "", "hw", [])]
    return "diagnostic_msgs/msg/DiagnosticArray", encode_diagnostics(STAMP, statuses)


EVERY = [
    *[joint_state([f"link_{'x' * i}" for i in range(n)], frame) for n in range(6) for frame in ("", "w", "map")],
    *[pose(frame) for frame in ("", "w", "ab", "abc", "world")],
    *[trajectory(points, contacts) for points in (0, 1, 2, 9) for contacts in (2, 3, 4)],
    diagnostics(),
    ("rosgraph_msgs/msg/Clock", CLOCK.encode(STAMP)),
]


@pytest.mark.parametrize(("kind", "data"), EVERY, ids=range(len(EVERY)))
def test_the_bytes_are_those_of_rosbags(kind, data):
    message = STORE.deserialize_cdr(data, kind)
    assert bytes(STORE.serialize_cdr(message, kind)) == data


@pytest.mark.parametrize(("kind", "data"), EVERY, ids=range(len(EVERY)))
def test_ros_reads_what_rosbags_reads(kind, data):
    ours = STORE.deserialize_cdr(data, kind)
    theirs = deserialize_message(data, message_class(kind))
    assert_same(ours, theirs)


@pytest.mark.parametrize("recorded", [False, True])
@pytest.mark.parametrize("name", ["three_contacts_two_ways", "steering_inchworm"])
def test_ticks_together_have_the_bytes_of_single_messages(name, recorded):
    """Ledgers of none, one and three points, the states of two of three ticks, and the heads of their records."""
    scene, random = load_scene(name), np.random.default_rng(3)
    topics = (LEDGER, *STATES)
    encoder = TickEncoder(scene, "world", {topic: k if recorded else -1 for k, topic in enumerate(topics)})
    for table in (encoder.joints, encoder.contacts, encoder.poses):
        table[:] = random.normal(size=table.shape)
    times, due = 100_000_001 * np.array([12, 13, 14, 15]), 100_000_001 * np.array([11, 14, 15, 15])
    rows, first = random.normal(size=(4, scene.columns.count)), [0, 1, 1, 4]
    numbers, sent = 7 * np.arange(6), np.array([True, False, True])
    data, places = encoder.encode(
        Vertices(times, due, rows, np.array(first), 2), True, np.array([True, True, True]), sent, (10**18, 300, numbers)
    )
    joints = lay_out_joint_state(joint_state_names(scene.body))
    contacts = lay_out_joint_state(contact_names(scene.body), "world")
    ledger, expected = TrajectoryMessage(list(scene.columns.names)), b""
    for tick, end in enumerate(times[1:].tolist()):
        which = slice(first[tick], first[tick + 1])
        begin, pose = int(times[tick]), encoder.poses[tick].tolist()
        messages = [
            ledger.encode(begin, [max(d - begin, 0) for d in due[which].tolist()], rows[which]),
            joints.encode(end, encoder.joints[tick].ravel()),
            contacts.encode(end, encoder.contacts[tick].ravel()),
            lay_out_pose("world").encode(end, pose[:4]),
            lay_out_odometry("world", "base_link").encode(end, pose),
            CLOCK.encode(end),
        ]
        assert places[tick][0] == len(expected)
        for channel, message in enumerate(messages if sent[tick] else messages[:1]):
            number = 7 * channel + (tick if channel == 0 else tick // 2)
            ns = 10**18 - 300 + 100 * (tick + 1) - (channel == 0)  # the ledger is read first
            expected += message_head(channel + 1, number, ns, ns, len(message)) * recorded + message
    assert bytes(data) == expected
    assert numbers.tolist() == ([3, 9, 16, 23, 30, 37] if recorded else [0, 7, 14, 21, 28, 35])


def assert_same(one, other):
    if hasattr(one, "__msgtype__"):
        for name in one.__dataclass_fields__:
            if name != "__msgtype__":
                assert_same(getattr(one, name), getattr(other, name))
    elif isinstance(one, np.ndarray):
        assert one.tolist() == list(other)
    elif isinstance(one, list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_same(a, b)
    elif isinstance(other, bytes):
        assert one == other[0]
    else:
        assert one == other


def test_values_arrive():
    kind, data = joint_state()
    message = STORE.deserialize_cdr(data, kind)
    assert message.header.stamp.sec == 12
    assert message.header.stamp.nanosec == 345_678_901
    assert message.name == ["contact_0", "link_0", "link_11"]
    assert message.effort.tolist() == [20.25, 21.25, 22.25]
    kind, data = trajectory()
    message = STORE.deserialize_cdr(data, kind)
    assert message.points[1].time_from_start.nanosec == 700_000_000
    assert message.points[1].positions.tolist() == (np.arange(8) * 0.5 + 1).tolist()
    kind, data = pose()
    assert STORE.deserialize_cdr(data, kind).pose.position.x == -1.5
