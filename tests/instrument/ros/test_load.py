"""More than a controller ever sends, and messages that nobody should send."""

from __future__ import annotations

import math
import struct
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")
from rclpy.serialization import serialize_message

from crawler_model import load_scene, simulate
from crawler_ros.recording import bag
from crawler_ros.replay import simulate_again
from crawler_ros.wire.messages import TrajectoryMessage

from ...processes import memory_mb, wait_until
from .machine import SOAK, Sender, assert_every_tick, assert_whole, encode_array, recorded, value
from .test_nodes import trajectory

LARGEST = 1e100
ACTUATION, FRICTION = "actuation_controller/commands", "friction_controller/commands"
TRAJECTORY, LENGTHS = "joint_trajectory", "actuation_controller/joint_trajectory"


def wait_for_diagnostics(ros):
    """Wait for the second that come from here on, which were written after all that came before."""
    heard = len(ros.heard["/diagnostics"])
    wait_until(lambda: len(ros.heard["/diagnostics"]) > heard + 1, what="diagnostics")


def test_of_five_thousand_commands_a_second_none_is_lost(ros):
    """Five commands to a tick: each is a vertex of its tick, in order, at its equal share of it."""
    count = 300_000 if SOAK else 15_000
    bags = ros.folder / "bags"
    depth = f"qos_overrides./{ACTUATION}.subscription.depth:=20000"  # two thirds of a second to a stall of the machine
    process = ros.simulator("rate:=1000.0", f"record:={bags}", depth, hear=("/diagnostics",))
    rows = 0.2 * np.sin(np.arange(1, count + 1)[:, None] * [0.01, 0.0173])
    messages = [encode_array(row) for row in rows.tolist()]
    sender = Sender(ros, ACTUATION, depth=20_000)
    before = memory_mb(process.process.pid)
    begin = time.monotonic()
    for k, message in enumerate(messages):
        if k % 5 == 0:
            time.sleep(max(begin + k / 5000.0 - time.monotonic(), 0.0))
        sender.send(ACTUATION, message)
        if k % 5_000 == 4_999:  # never more under way than the queue of a machine that stalls can hold
            sender.wait()
    sender.wait()
    arrived = f"received on {ACTUATION}"
    wait_until(lambda: value(ros, "commands", arrived) == str(count), what="the last command out of the queue")
    wait_for_diagnostics(ros)
    assert value(ros, "commands", "refused") == "0"
    wait_until(lambda: int(value(ros, "recording", "bytes waiting")) < 1 << 20, what="a recording that keeps up")
    assert memory_mb(process.process.pid) - before < 100
    assert process.end() == 0
    (path,) = bags.iterdir()
    assert bag.examine(path).counts[f"/{ACTUATION}"] == count
    ledger = [m for m in recorded(path, "/applied_commands") if m.points]
    followed = np.array([p.positions[:2] for m in ledger for p in m.points])
    assert followed.shape == rows.shape
    assert np.array_equal(followed, rows)
    for message in ledger:
        n = len(message.points)
        due = [p.time_from_start.sec * 10**9 + p.time_from_start.nanosec for p in message.points]
        assert due == [1_000_000 * (k + 1) // n for k in range(n)]
    assert max(len(m.points) for m in ledger) >= 5
    assert_whole(path, rate=1000)


# -- messages that nobody should send ---------------------------------------------------------------------------------

SPECIAL = [math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -5e-324, 1.0000001e100, -0.0, 0.0, -1e-300, -1.0, 2.5]
FRICTIONS = {f"contact_{i}/{side}": {f"{i}{s}" for s in sides} for i in range(3) for side, sides in (("forward", "f"), ("backward", "b"), ("friction", "fb"))}  # fmt: skip
NAMES = {"link_0": {"l0"}, "link_1": {"l1"}} | FRICTIONS
"""What each name of three_contacts_one_way commands."""
STRANGE = ["", "link_2", "link_-1", "contact_3/friction", "LINK_0", "link_0 ", "a/../../b", "\N{SNOWMAN}", "x" * 3000]


def is_good_actuation(values: list[float]) -> bool:
    return len(values) == 2 and all(abs(v) <= LARGEST for v in values)


def is_good_friction(values: list[float]) -> bool:
    return len(values) in (1, 3, 6) and all(0.0 <= v <= LARGEST for v in values)


def is_good_trajectory(
    names: list[str], times: list[int], rows: list[list[float]], stamp: int, only_lengths: bool
) -> bool:
    parts: list[str] = [part for name in names for part in NAMES.get(name, ())]
    return (
        all(name in NAMES for name in names)
        and len(parts) == len(set(parts))
        and not (only_lengths and any(name in FRICTIONS for name in names))
        and stamp >= 0
        and len(rows) > 0
        and all(b >= a for a, b in zip([0, *times], times, strict=False))
        and all(len(row) == len(names) for row in rows)
        and all(abs(v) <= LARGEST and (n not in FRICTIONS or v >= 0.0) for r in rows for n, v in zip(names, r, strict=True))
    )  # fmt: skip


class Fuzz:
    """Messages at random, each with whether it is good, by other rules than the simulator's."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def _numbers(self, count: int) -> list[float]:
        plain = self.rng.normal(size=count)
        special = self.rng.random(count) < self.rng.choice([0.0, 0.1, 0.7])
        return np.where(special, self.rng.choice(SPECIAL, count), plain).tolist()

    def _count(self) -> int:
        return int(self.rng.choice([0, 1, 2, 2, 2, 3, 3, 4, 5, 6, 6, 7, 8, 64, 300]))

    def _trajectory(self, only_lengths: bool) -> tuple[bytes, bool]:
        rng = self.rng
        pool = list(NAMES) if rng.random() < 0.7 else list(NAMES) + STRANGE
        names = [str(n) for n in rng.choice(pool, rng.integers(0, 5))]
        points = int(rng.integers(0, 5))
        times = np.cumsum(rng.integers(0 if rng.random() < 0.5 else -(10**8), 10**8, points)).tolist()
        wrong = rng.random() < 0.3
        rows = [self._numbers(len(names) + (int(rng.integers(-1, 3)) if wrong and names else 0)) for _ in range(points)]
        stamp = int(rng.choice([0, 0, 0, 10**9, -(10**9), -1]))
        message = trajectory(names)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.points = [trajectory([], (0.0, row)).points[0] for row in rows]
        for point, at in zip(message.points, times, strict=True):
            point.time_from_start.sec, point.time_from_start.nanosec = divmod(at, 10**9)
        return serialize_message(message), is_good_trajectory(names, times, rows, stamp, only_lengths)

    def _torn(self, name: str) -> bytes:
        """Bytes that hold less than they promise."""
        rng = self.rng
        kind = int(rng.integers(4))
        if name in (TRAJECTORY, LENGTHS):
            # not rclpy's bytes: it leaves garbage behind a message's end, and cut there the message is whole
            rows = [np.array([0.1, 0.2])] * 2
            whole = bytes(TrajectoryMessage(["link_0", "link_1"]).encode(0, [0, 500_000_000], rows))
            place = 16  # of the number of names: behind an empty frame_id, which is five bytes and a gap
        else:
            whole, place = encode_array(rng.normal(size=6)), 12
        if kind == 0:
            return whole[: int(rng.integers(5, len(whole) - 3))]  # DDS fills up to four bytes
        if kind == 1:
            return bytes(rng.bytes(int(rng.integers(1, 12))))
        if kind == 2 and name in (ACTUATION, FRICTION):
            huge = struct.pack("<I", int(rng.choice([7, 1000, 2**20, 2**29, 2**31 - 1, 2**31, 2**32 - 1])))
            return whole[:place] + huge + whole[place + 4 :]
        if name in (TRAJECTORY, LENGTHS):  # a name that is no UTF-8
            return whole.replace(b"link_1", b"\xff\xfenk_1")
        return whole[:8]

    def draw(self) -> tuple[str, bytes, bool]:
        rng = self.rng
        name = str(rng.choice([ACTUATION, FRICTION, TRAJECTORY, LENGTHS]))
        if rng.random() < 0.2:
            return name, self._torn(name), False
        if name in (TRAJECTORY, LENGTHS):
            return name, *self._trajectory(name == LENGTHS)
        values = self._numbers(self._count())
        good = is_good_actuation if name == ACTUATION else is_good_friction
        return name, encode_array(values), good(values)


@pytest.mark.parametrize("count", [10_000, pytest.param(1_000_000 if SOAK else 100_000, marks=pytest.mark.slow)])
def test_thousands_of_bad_messages_change_nothing(ros, count):
    """Every one is refused and counted, the state keeps its bits, the log and the memory stay small."""
    batch = 500
    bags = ros.folder / "bags"
    process = ros.simulator("scene:=three_contacts_one_way", f"record:={bags}", hear=("/diagnostics",))
    ros.hear("joint_states", raw=True)
    sender = Sender(ros, ACTUATION, FRICTION, TRAJECTORY, LENGTHS)
    states = ros.heard["joint_states"]
    first = wait_until(lambda: [bytes(data)[12:] for data in states[:1]], what="a state")[0]
    sender.send(ACTUATION, encode_array([0.13, -0.07]))  # a state whose bits say something
    wait_until(
        lambda: len(states) > 1 and first != bytes(states[-2])[12:] == bytes(states[-1])[12:], what="rest after a move"
    )
    before = bytes(states[-1])[12:]
    heard = len(ros.heard["joint_states"])
    fuzz, good, sent = Fuzz(1), [], 0
    begin, small = time.monotonic(), 0
    while sent < count:
        name, data, is_good = fuzz.draw()
        if is_good:
            good.append((name, data))
            continue
        sender.send(name, data)
        sent += 1
        if sent % batch == 0:
            sender.wait()
        if sent == count // 10:
            small = memory_mb(process.process.pid)
    sender.wait()
    took = time.monotonic() - begin
    wait_until(lambda: int(value(ros, "commands", "refused")) >= count, what=f"{count} refused")
    assert value(ros, "commands", "refused") == str(count)
    assert all(bytes(data)[12:] == before for data in ros.heard["joint_states"][heard:])
    wait_until(lambda: len(ros.heard["joint_states"]) > heard + 50, what="more states")
    assert process.said.count("refused a message") <= 10 * (took + 2.0)
    assert len(process.said) < 2_000_000
    assert memory_mb(process.process.pid) - small < 64
    last = next(
        s for m in ros.heard["/diagnostics"] for s in m.status if s.message.startswith(f"{count} message(s) refused")
    )
    assert last.level == b"\x01"

    assert len(good) > count // 100
    for name, data in good[:500]:
        sender.send(name, data)
    sender.wait()
    wait_for_diagnostics(ros)
    assert value(ros, "commands", "refused") == str(count)
    assert process.end() == 0
    (path,) = bags.iterdir()
    assert bag.examine(path).complete
    assert_every_tick(path)


# -- many crawlers ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_many_crawlers_walk_at_once(ros):
    """In namespaces of their own, recording into one folder; one of them is everybody's clock."""
    count = 10 if SOAK else 5
    names, bags, scene = [f"crawler_{k}" for k in range(count)], ros.folder / "bags", "scene:=three_contacts_two_ways"
    ros.hear("/clock")
    started = []
    for name in names:
        ros.hear(f"/{name}/pose", type_name="pose")
        clock = ("publish_clock:=true",) if name == names[3] else ()
        given = (scene, f"record:={bags}", *clock)
        started.append(ros.start("crawler_ros.node.simulator", *given, arguments=("-r", f"__ns:=/{name}")))
    wait_until(lambda: all(ros.heard[f"/{name}/pose"] for name in names), what="all crawlers")
    players = [
        ros.start("crawler_ros.node.gait_player", scene, "periods:=3", arguments=("-r", f"__ns:=/{name}"))
        for name in names
    ]
    assert [p.wait() for p in players] == [0] * count
    offline = simulate(load_scene("three_contacts_two_ways"), duration=3.0)
    for name in names:
        ros.walked(offline.net_translation[-1], pose=f"/{name}/pose")
    assert ros.node.count_publishers("/clock") == 1
    clock = [m.clock.sec * 10**9 + m.clock.nanosec for m in ros.heard["/clock"]]
    assert (np.diff(clock) > 0).all()
    assert [p.end() for p in started] == [0] * count
    found = set()
    for path in bags.iterdir():
        (topic,) = [t for t in bag.examine(path).counts if t.endswith("/pose")]
        name = topic.split("/")[1]
        found.add(name)
        assert_whole(path, f"/{name}/joint_states")
        poses = recorded(path, topic)
        assert poses[-1].pose.position.x == pytest.approx(offline.net_translation[-1], abs=1e-12)
        assert simulate_again(path).ticks == len(poses)
    assert found == set(names)
