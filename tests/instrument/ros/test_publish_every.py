"""States at every n-th tick, and ticks that run ahead of their messages: same bits, fewer of them."""

from __future__ import annotations

import itertools
import random

import numpy as np
import pytest

pytest.importorskip("rclpy")
import rclpy
from mcap.reader import NonSeekingReader
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from crawler_ros.node.life.domains import reserved_domain
from crawler_ros.node.simulator import Simulator
from crawler_ros.recording import bag
from crawler_ros.replay import analyse
from crawler_ros.wire.definitions import find_ament_prefix

from ...processes import wait_until
from ...scenes import write_chain
from .graph import Graph, node_command, seconds
from .machine import recorded
from .test_patches import CLIFF

EVERY = 5
LINKS = ("link_0", "link_1")


def ticks(ros: Graph, name: str = "joint_states") -> list[int]:
    found = [round(100 * seconds(m)) for m in ros.heard[name]]
    return [tick for tick, _ in itertools.groupby(found)]  # state 0 may come twice


def trajectory(duration: float) -> JointTrajectory:
    message = JointTrajectory(joint_names=list(LINKS))
    for part, lengths in ((0.5, [0.2, 0.0]), (1.0, [0.1, 0.2])):
        point = JointTrajectoryPoint(positions=lengths)
        point.time_from_start.nanosec = round(part * duration * 1e9)
        message.points.append(point)
    return message


def test_states_come_at_every_nth_tick_and_where_commands_end_and_replay_is_identical(ros):
    bags = ros.folder / "bags"
    process = ros.simulator(
        *("scene:=three_contacts_one_way", "lock_step:=true", f"publish.every:={EVERY}", f"record:={bags}"),
        hear=("joint_states", "contact_states", "pose", "applied_commands"),
    )
    wait_until(lambda: ros.heard["contact_states"] and ros.heard["pose"], what="state 0 of each")
    ros.publish("joint_trajectory", trajectory(0.23))
    wait_until(lambda: ticks(ros)[-1] == 23)
    assert ticks(ros) == [0, 5, 10, 15, 20, 23]
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.3, 0.1]))
    wait_until(lambda: ticks(ros)[-1] == 24)
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[float("nan"), 0.1]))  # refused: no tick
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.3, 0.1]))  # changes nothing
    wait_until(lambda: ticks(ros)[-1] == 25)
    ros.publish("joint_trajectory", trajectory(0.04))
    wait_until(lambda: len(ticks(ros, "applied_commands")) == 29)  # published after the states
    assert ticks(ros) == ticks(ros, "contact_states") == ticks(ros, "pose") == [0, 5, 10, 15, 20, 23, 24, 25, 29]
    assert ticks(ros, "applied_commands") == list(range(29))
    assert ros.call("/crawler/reset", "std_srvs/srv/Trigger").success
    ros.publish("joint_trajectory", trajectory(0.07))
    wait_until(lambda: ticks(ros)[-1] == 7)
    assert ticks(ros)[9:] == [0, 5, 7]
    process.end()
    (recording,) = bags.iterdir()
    replay = analyse(recording)
    assert replay.healthy, replay.problems
    assert replay.comparison.identical
    assert (replay.comparison.ticks, replay.comparison.unmatched, replay.comparison.resets) == (12, 0, 1)
    assert replay.table.ends_tick.sum() == 29 + 1 + 7 + 1  # every tick is simulated again, with both starts
    late = bag.examine(recording).counts
    assert late["/joint_states"] == late["/pose"] == 12
    assert late["/applied_commands"] == 36


def test_a_missing_message_is_noticed(ros):
    """The check of gaps expects a state at every n-th tick and no other, and commands of every tick."""
    process = ros.simulator(
        *("scene:=three_contacts_one_way", "lock_step:=true", f"publish.every:={EVERY}"),
        *(f"record:={ros.folder / 'bags'}",),
    )
    ros.publish("joint_trajectory", trajectory(0.3))
    wait_until(lambda: ticks(ros)[-1] == 30)
    process.end()
    (recording,) = (ros.folder / "bags").iterdir()
    found = bag.Bag({})
    records = list(bag.read(recording, found))
    for topic, lost, after in (("pose", 3, 0.1), ("applied_commands", 12, 0.11)):
        torn = bag_without(records, found, recording.parent / topic, lambda r, k: (r.topic, k) != (f"/{topic}", lost))  # noqa: B023
        replay = analyse(torn)
        assert [p for p in replay.problems if "missing" in p] == [
            f"{topic}: 1 tick(s) missing, the first after {after} s"
        ]
        assert replay.comparison.identical


def bag_without(records, found, folder, keep):
    from crawler_ros.recording.bag_writer import BagWriter

    writer, channels, counts = BagWriter(folder, found.attachments), {}, {}
    for record in records:
        counts[record.topic] = counts.get(record.topic, -1) + 1
        if record.channel.id not in channels:
            channels[record.channel.id] = writer.add_channel(
                record.topic, record.type, record.schema.data, record.channel.metadata
            )
        if keep(record, counts[record.topic]):
            writer.write(channels[record.channel.id], record.log_ns, record.publish_ns, record.data)
    writer.close()
    return folder


@pytest.mark.parametrize("factor", [0.0, 1.0])
def test_the_last_state_of_a_duration_is_published(ros, factor):
    bags = ros.folder / "bags"
    more = (f"record:={bags}", f"real_time_factor:={factor}", "duration:=0.33")
    process = ros.start("crawler_ros.node.simulator", f"publish.every:={EVERY}", *more)
    assert process.wait() == 0, process.said
    (recording,) = bags.iterdir()
    replay = analyse(recording)
    assert replay.healthy, replay.problems
    stamps = [seconds(m) for m in recorded(recording, "/joint_states")]
    assert np.round(100 * np.array(stamps)).tolist() == [0, 5, 10, 15, 20, 25, 30, 33]


def test_a_tick_whose_commands_the_ground_refuses_shows_its_state(ros):
    path = ros.folder / "cliff.yaml"
    path.write_text(CLIFF)
    process = ros.simulator(f"scene:={path}", "lock_step:=true", f"publish.every:={EVERY}")
    message = JointTrajectory(joint_names=["link_0"], points=[JointTrajectoryPoint(positions=[1.0])])
    message.points[0].time_from_start.nanosec = 200_000_000
    ros.publish("joint_trajectory", message)  # in twenty ticks, but beyond 0.6 m nothing would hold the body
    wait_until(lambda: ticks(ros)[-1] > 10)
    assert ticks(ros) in ([0, 5, 10, 13], [0, 5, 10, 14])
    process.end()
    assert "the commands of a tick are refused" in process.said


def test_it_must_be_a_whole_number_from_one_on(ros):
    for value, reason in (("0", "publish.every"), ("2.5", "a whole number")):
        process = ros.run(node_command("crawler_ros.node.simulator", f"publish.every:={value}"))
        assert process.wait() == 1
        assert reason in process.said.splitlines()[-1]


@pytest.mark.parametrize("lock_step", [False, True])
@pytest.mark.parametrize(
    ("scene", "every", "more"),
    [
        (2, 1, ()),
        (3, 7, ("odom",)),
        (10, 1, ("odom", "clock")),
        ("tendon_worm", 3, ()),
        ("leaving_ice", 1, ()),
        ("planar_three_points", 3, ("odom",)),
        ("steering_inchworm", 1, ("odom", "clock")),
    ],
)
def test_ticks_at_once_are_those_one_after_another_to_the_bit(tmp_path, lock_step, scene, every, more):
    """Messages, their order in the file, the state and the account of random trajectories and arrays, recorded by real nodes."""
    runs = [record(tmp_path / str(k), k == 1, lock_step, scene, every, more) for k in range(2)]
    assert runs[0] == runs[1]
    (recording,) = (tmp_path / "1").glob("*/")
    replay = analyse(recording)
    assert replay.healthy, replay.problems
    assert replay.comparison.identical


def record(folder, at_once, lock_step, scene, every, more):
    folder.mkdir()
    values = {
        "scene": write_chain(folder.parent, scene) if isinstance(scene, int) else scene,
        "rate": 1000.0,
        "real_time_factor": 0.0,
        "lock_step": str(lock_step).lower(),
        "record": folder,
        "publish.every": every,
        "publish.odom": str("odom" in more).lower(),
        "publish_clock": str("clock" in more).lower(),
    }
    find_ament_prefix()
    context = rclpy.Context()
    words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    with reserved_domain() as domain:
        context.init(args=["--ros-args", *words], domain_id=domain)
        try:
            node = Simulator(context=context)
            drive(node, at_once)
            state = (
                node.ticks.crawler._state.bits(),
                node.ticks.crawler.row.tobytes(),
                node.ticks.certificates.judge(),
                node.ticks.counts,
                node.tick_clock.tick,
            )
            node.close()
        finally:
            context.try_shutdown()
    (recording,) = folder.iterdir()
    with next(recording.glob("*.mcap")).open("rb") as stream:
        written = NonSeekingReader(stream).iter_messages(log_time_order=False)
        kept = [(channel.topic, message.data) for _, channel, message in written]
    return state, [one for one in kept if one[0] != "/diagnostics"]  # it holds the wall clock


def drive(node, at_once):
    rng = random.Random(7)
    names = node.columns.names[: node.columns.lengths]
    node.ticks.send_start()
    for _ in range(3):
        times = sorted(rng.randint(0, 150) * 10**6 + rng.choice([0, 0, 500]) for _ in range(rng.randint(1, 12)))
        rest = node.ticks.start.row
        rows = [[rest[k] + 0.2 * rng.random() for k in range(len(names))] for _ in times]
        node.commands.accept_trajectory(names, times, rows, 0)
        if rng.random() < 0.5:
            node.commands.accept_actuation([rest[k] + 0.1 * rng.random() for k in range(len(names))])
        end, most = node.tick_clock.tick + rng.randint(100, 200), rng.randint(1, 64)
        while node.tick_clock.tick < end and not (node.lock_step and node.commands.is_idle):
            node.ticks.run(min(most, end - node.tick_clock.tick) if at_once else 1)
        node._push_recording(node.tick_clock.tick * 10**9)
    assert np.isfinite(node.ticks.crawler.displacement).all()
