"""Our bytes against two independent decoders."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_ros.wire.messages import (
    JointStateMessage,
    PoseMessage,
    TrajectoryMessage,
    encode_clock,
    encode_diagnostics,
)
from crawler_ros.wire.topics import message_class

pytest.importorskip("rclpy")
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
STAMP = 12_345_678_901


def joint_state(names=("contact_0", "link_0", "link_11"), frame=""):
    message = JointStateMessage(names, frame)
    for k, array in enumerate((message.position, message.velocity, message.effort)):
        array[:] = np.arange(len(names)) + 10 * k + 0.25
    return "sensor_msgs/msg/JointState", message.encode(STAMP)


def pose(frame="world"):
    return "geometry_msgs/msg/PoseStamped", PoseMessage(frame).encode(STAMP, -1.5)


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
    ("rosgraph_msgs/msg/Clock", encode_clock(STAMP)),
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
