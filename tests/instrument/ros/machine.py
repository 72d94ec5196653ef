"""What the tests of load, faults and security ask of processes, and how they disturb them."""

from __future__ import annotations

import os
import signal
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from crawler_ros.recording import bag
from crawler_ros.replay import simulate_again
from crawler_ros.wire.topics import message_class, qos_profile, read_topics

from ...processes import wait_until
from .graph import Graph, node_command

DECODE = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr
SOAK = os.environ.get("CRAWLER_SOAK") == "1"


def simulator(*parameters: str) -> list[str]:
    return node_command("crawler_ros.node.simulator", *parameters)


def runs(pid: int) -> bool:
    """Whether a process has not been stopped."""
    return "T" not in Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]


def stop(pid: int) -> None:
    os.kill(pid, signal.SIGSTOP)
    wait_until(lambda: not runs(pid), what=f"the stop of {pid}")


def status(ros: Graph, part: str) -> Any:
    """The last thing that /diagnostics said of a part."""
    found = [s for m in ros.heard["/diagnostics"] for s in m.status if s.name.endswith(part)]
    return found[-1] if found else None


def value(ros: Graph, part: str, key: str) -> str:
    said = status(ros, part)
    return "" if said is None else {v.key: v.value for v in said.values}[key]


def stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def recorded(path: Path, topic: str) -> list[Any]:
    return [DECODE(r.data, r.type) for r in bag.read(path) if r.topic == topic]


def assert_whole(path: Path, topic: str = "/joint_states", rate: int = 100) -> int:
    """Assert that a recording has its end and every tick, and that its ticks give the same bits again.

    Returns the stamp of the last state [ns].
    """
    assert bag.examine(path).complete, path
    return assert_every_tick(path, topic, rate)


def assert_every_tick(path: Path, topic: str = "/joint_states", rate: int = 100) -> int:
    stamps = np.array([stamp_ns(m) for m in recorded(path, topic)])
    assert stamps.size, path
    assert stamps.tolist() == [k * 10**9 // rate for k in range(stamps.size)], path
    again = simulate_again(path)
    assert again.identical, again
    assert again.ticks == stamps.size
    return int(stamps[-1])


def encode_array(values: Iterable[float]) -> bytes:
    """CDR of a Float64MultiArray without a layout."""
    data = struct.pack(f"<{len(list(values))}d", *values)
    head = b"\0\1\0\0" + struct.pack("<III", 0, 0, len(data) // 8)
    return head + (b"\0" * 4 + data if data else b"")


class Sender:
    """Publishes ready bytes, and waits until the simulator has taken up what it was sent."""

    def __init__(self, ros: Graph, *topics: str, depth: int = 1000) -> None:
        self._publishers = {}
        for name in topics:
            topic = read_topics()[name]
            qos = qos_profile(topic)
            qos.depth = depth
            self._publishers[name] = ros.node.create_publisher(message_class(topic.type), name, qos)
        self.wait = ros.taken_up
        for name, publisher in self._publishers.items():
            wait_until(lambda p=publisher: p.get_subscription_count() > 0, what=f"a subscriber of {name}")

    def send(self, name: str, data: bytes) -> None:
        self._publishers[name].publish(data)
