"""What may wait, how large a message and a command may be, what is lost on the way: bounded, counted and told."""

from __future__ import annotations

import signal
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from crawler_model import CommandError, Scene, load_scene
from crawler_ros.node.intake import commands as commands_module
from crawler_ros.node.intake.commands import CommandQueue
from crawler_ros.node.intake.decode import read_array, read_trajectory
from crawler_ros.node.intake.limits import command_limits
from crawler_ros.node.intake.peers import Arrivals, SecondSimulator

from ...processes import memory_mb, wait_until
from .machine import Sender, encode_array, status, stop, value

ACTUATION, FRICTION, TRAJECTORY = "actuation_controller/commands", "friction_controller/commands", "joint_trajectory"
SECOND = 10**9


def trajectory(names, rows, times_ns, stamp_ns=0):
    message = JointTrajectory(joint_names=names)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, SECOND)
    for row, ns in zip(rows, times_ns, strict=True):
        point = JointTrajectoryPoint(positions=[float(v) for v in row])
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(int(ns), SECOND)
        message.points.append(point)
    return message


# -- from bytes to arrays ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("points", [0, 1, 2, 3, 7, 40, 1000])
@pytest.mark.parametrize("names", [1, 2, 3])
@pytest.mark.parametrize("more", ["none", "all", "some", "one"])
def test_trajectories_are_read_as_rclpy_wrote_them(points, names, more):
    rng = np.random.default_rng(points)
    rows, times = rng.normal(size=(points, names)), np.sort(rng.integers(0, 10**12, points))
    words = [f"joint_{'x' * k}" for k in range(names)]
    message = trajectory(words, rows, times, 123 * SECOND + 7)
    message.header.frame_id = "a frame"
    for k, point in enumerate(message.points):
        if more == "all" or (more == "some" and k % 3 == 1) or (more == "one" and k == 2 * points // 3):
            point.velocities = [1.0] * names
            point.effort = [2.0] * (k % 2)
    read = read_trajectory(serialize_message(message))
    assert read.names == tuple(words)
    assert read.stamp_ns == 123 * SECOND + 7
    np.testing.assert_array_equal(read.positions, rows)
    assert read.times_ns.tolist() == times.tolist()
    assert read.has_more == any(p.velocities or p.effort for p in message.points)


@pytest.mark.parametrize("values", [[], [1.5], [1.0, -2.0, float("inf")]])
def test_arrays_are_read_as_rclpy_wrote_them(values):
    message = Float64MultiArray(data=values)
    assert read_array(serialize_message(message)).tolist() == values
    from std_msgs.msg import MultiArrayDimension

    message.layout.dim = [MultiArrayDimension(label="a", size=3, stride=3), MultiArrayDimension(label="bcdef")]
    assert read_array(serialize_message(message)).tolist() == values


def test_no_prefix_of_a_message_is_read_beyond_its_end():
    whole = serialize_message(trajectory(["a", "bc"], np.ones((40, 2)), range(40)))
    end = len(whole)
    while end and isinstance(_read(whole[:end]), int):
        end -= 1  # what rclpy leaves behind the end
    for size in range(end):
        with pytest.raises(CommandError):
            read_trajectory(whole[:size])


@pytest.mark.parametrize("points", [1, 2, 40])
def test_bytes_behind_a_message_are_refused(points):
    for read, message in (
        (read_trajectory, trajectory(["a", "bc"], np.ones((points, 2)), range(points))),
        (read_array, Float64MultiArray(data=[1.0] * points)),
    ):
        whole = bytes(serialize_message(message))
        read(whole)
        with pytest.raises(CommandError, match=r"not a message of this type: \d+ more bytes follow its end at byte"):
            read(whole + bytes(16 * points + 8))


@pytest.mark.parametrize("place", [None, 0, 1, 39])
def test_a_time_of_a_second_in_nanoseconds_is_refused(place):
    message = trajectory(["a"], np.ones((40, 1)), np.arange(40) * SECOND)
    time = message.header.stamp if place is None else message.points[place].time_from_start
    time.nanosec = SECOND
    with pytest.raises(CommandError, match="a time has 1000000000 in its field nanosec; it must be below 1000000000"):
        read_trajectory(serialize_message(message))


def _read(data):
    try:
        return read_trajectory(data).times_ns.size
    except CommandError as error:
        return str(error)


# -- what may wait ----------------------------------------------------------------------------------------------------


def queue(lock_step=False, **limits):
    scene = load_scene("three_contacts_one_way")
    return CommandQueue(scene.columns, scene.drive.rows[0], lock_step, command_limits(scene, **limits))


@pytest.mark.parametrize("lock_step", [False, True])
@pytest.mark.parametrize("kind", ["actuation", "friction", "trajectory"])
def test_what_waits_is_bounded_and_what_is_refused_is_counted(monkeypatch, lock_step, kind):
    monkeypatch.setattr(commands_module, "MOST_ROWS", 100)
    commands = queue(lock_step)
    send = {
        "actuation": lambda: commands.accept_actuation([0.1, 0.2]),
        "friction": lambda: commands.accept_friction([0.3]),
        "trajectory": lambda: commands.accept_trajectory(["link_0"], [0, 1], [[0.1], [0.2]], 0),
    }[kind]
    refusals = []
    for _ in range(150):
        try:
            send()
        except CommandError as error:
            refusals.append(str(error))
    assert commands.full == len(refusals) >= 50
    assert all("at most 100 may wait" in text for text in refusals)
    assert commands.waiting <= 100
    for tick in range(200):  # ticks make room again
        commands.take_vertices(SECOND * np.arange(tick, tick + 2))
    if kind == "friction" and lock_step:
        assert commands.waiting == 100  # no tick without an actuation
    else:
        assert commands.waiting == 0
        send()


def test_a_path_that_still_runs_counts():
    commands = queue()
    most = commands.most_waiting
    commands.accept_trajectory(["link_0"], np.arange(most - 10) * SECOND // 10, np.zeros((most - 10, 1)), 0)
    commands.take_vertices(SECOND * np.arange(2))
    with pytest.raises(CommandError, match="may wait"):
        commands.accept_trajectory(["link_0"], np.arange(100), np.zeros((100, 1)), 30 * SECOND)


def test_a_paused_simulator_takes_so_many_and_says_so(ros):
    process = ros.simulator(hear=("joint_states", "/diagnostics"))
    assert ros.call("/crawler/pause", "std_srvs/srv/SetBool", data=True).success
    sender = Sender(ros, TRAJECTORY)
    rows = serialize_message(trajectory(["link_0"], np.zeros((10_000, 1)), np.arange(10_000)))
    before = memory_mb(process.process.pid)
    for _ in range(15):
        sender.send(TRAJECTORY, rows)
        sender.wait()
    full = "refused because the queue was full"
    wait_until(lambda: status(ros, "commands") and int(value(ros, "commands", full)) > 4, what="a full queue")
    assert any(s.level == b"\x01" and "may wait" in s.message for m in ros.heard["/diagnostics"] for s in m.status)
    assert memory_mb(process.process.pid) - before < 256
    assert ros.call("/crawler/reset", "std_srvs/srv/Trigger").success
    assert ros.call("/crawler/pause", "std_srvs/srv/SetBool", data=False).success
    ros.publish(ACTUATION, Float64MultiArray(data=[0.1, 0.0]))
    wait_until(lambda: ros.heard["joint_states"][-1].effort[1] != 0.0, what="a walk again")


def test_messages_larger_than_any_command_are_refused_unread(ros):
    """And their memory is given back: each of a reader's thousand places would keep it otherwise."""
    process = ros.simulator(hear=("joint_states", "/diagnostics"))
    sender = Sender(ros, ACTUATION, depth=2)
    wait_until(lambda: len(ros.heard["/diagnostics"]) > 1, what="diagnostics")
    before = memory_mb(process.process.pid)
    count, huge = 4, encode_array(np.zeros(5_000_000))  # malloc keeps what is smaller than 32 MiB
    for k in range(1, count + 1):
        sender.send(ACTUATION, huge)
        wait_until(lambda k=k: value(ros, "commands", "refused") == str(k), what=f"{k} refused")
    assert "a command of this scene has at most" in process.said
    wait_until(lambda: memory_mb(process.process.pid) - before < 64, what="memory given back")
    ros.publish(ACTUATION, Float64MultiArray(data=[0.1, 0.0]))
    wait_until(lambda: ros.heard["joint_states"][-1].effort[1] != 0.0, what="a walk")


# -- what is lost -----------------------------------------------------------------------------------------------------


def test_lost_messages_are_counted(ros):
    """A stopped simulator's reader keeps the last thousand."""
    process = ros.simulator(hear=("/diagnostics",))
    sender = Sender(ros, ACTUATION)
    sender.send(ACTUATION, encode_array([0.1, 0.0]))
    sender.wait()
    arrived = f"received on {ACTUATION}"
    wait_until(lambda: status(ros, "commands") and value(ros, "commands", arrived) == "1", what="the first")
    seen = len(ros.heard["/diagnostics"])
    wait_until(lambda: len(ros.heard["/diagnostics"]) > seen + 2, what="diagnostics")  # it knows its publishers
    stop(process.process.pid)
    for k in range(5000):
        sender.send(ACTUATION, encode_array([0.0001 * (k % 100), 0.0]))
    process.process.send_signal(signal.SIGCONT)
    sender.send(ACTUATION, encode_array([0.2, 0.0]))
    wait_until(lambda: int(value(ros, "commands", "lost")) > 0, what="word of what was lost")
    wait_until(
        lambda: int(value(ros, "commands", "lost")) + int(value(ros, "commands", arrived)) == 5002, what="all counted"
    )
    assert any(s.level == b"\x01" and "lost" in s.message for m in ros.heard["/diagnostics"] for s in m.status)
    wait_until(lambda: "message(s) on actuation_controller/commands" in process.said, what="a line in the log")


def test_gaps_are_told_apart_by_publisher():
    arrivals = Arrivals()
    assert arrivals.count_losses([b"a", b"b"]) == 0
    for number in [1, 2, 3, 1, 4, 2, 5, 3]:
        arrivals.count_message(number)
    assert arrivals.count_losses([b"a", b"b"]) == 0
    for number in [9, 4, 10]:
        arrivals.count_message(number)
    assert arrivals.count_losses([b"a", b"b"]) == 3
    arrivals.count_message(700)  # somebody has come: who sent it cannot be told
    assert arrivals.count_losses([b"a", b"b", b"c"]) == 0
    assert (arrivals.received, arrivals.lost) == (12, 3)


def test_whoever_joins_in_mid_stream_has_lost_nothing():
    arrivals = Arrivals()
    arrivals.count_losses([b"a"])
    arrivals.count_message(500)
    arrivals.count_message(501)
    assert arrivals.count_losses([b"a"]) == 0
    arrivals.count_message(503)
    assert arrivals.count_losses([b"a"]) == 1
    arrivals.count_message(None)
    assert arrivals.received == 4


def test_a_node_that_is_not_discovered_has_no_name_yet():
    ends = [
        SimpleNamespace(endpoint_gid=[1], node_namespace="/", node_name="crawler"),
        SimpleNamespace(endpoint_gid=[2], node_namespace="_NODE_NAMESPACE_UNKNOWN_", node_name="_NODE_NAME_UNKNOWN_"),
    ]
    node = SimpleNamespace(resolve_topic_name=str, get_publishers_info_by_topic=lambda _: ends)
    second = SecondSimulator(node, "joint_states")
    assert [second.find(0) for _ in range(2)] == ["", ""]
    said = "2 simulators publish joint_states here (/crawler, a node that is not named yet): end all but one"
    assert second.find(0).startswith(said)


# -- commands that make no sense --------------------------------------------------------------------------------------


@pytest.mark.parametrize("lock_step", ["true", "false"])
def test_times_of_another_clock_are_refused(ros, lock_step):
    process = ros.simulator(f"lock_step:={lock_step}", hear=("joint_states", "/diagnostics"))
    cases = [([[0.1]], [0], 1_800_000_000 * SECOND, "ahead of simulated time")]
    cases += [([[0.0], [0.1]], [0, 2_000_000_000 * SECOND], 0, "time_from_start of the last point is 2e+09 s")]
    for count, (rows, times, stamp, said) in enumerate(cases, 1):
        ros.publish(TRAJECTORY, trajectory(["link_0"], rows, times, stamp))
        wait_until(lambda c=count: status(ros, "commands") and value(ros, "commands", "refused") == str(c))
        wait_until(lambda s=said: s in process.said, what=said)
    ros.publish(TRAJECTORY, trajectory(["link_0"], [[0.1]], [0]))
    wait_until(lambda: ros.heard["joint_states"][-1].effort[1] != 0.0, what="a walk")


def test_commands_beyond_ten_bodies_are_refused_with_the_parameter_that_accepts_them(ros):
    """Forty millimetres given as metres are more than a hundred lengths of the body."""
    process = ros.simulator(hear=("joint_states", "/diagnostics"))
    cases = [
        (
            ACTUATION,
            Float64MultiArray(data=[-40.0, 0.0]),
            "link_0 is -40; at most 3 is accepted (set the parameter limit.length, in m, to accept more)",
        ),
        (FRICTION, Float64MultiArray(data=[1e9]), "(set the parameter limit.friction, in N, to accept more)"),
        (TRAJECTORY, trajectory(["link_1"], [[0.0], [-3.1]], [0, 1]), "link_1 is -3.1; at most 3 is accepted"),
    ]
    for name, message, said in cases:
        ros.publish(name, message)
        wait_until(lambda s=said: s in process.said, what=said)
    assert not np.any(ros.heard["joint_states"][-1].position)


def test_who_wants_nonsense_reads_what_it_cost(ros):
    """A state of 1e20 m has no digits left for the next millimetre."""
    ros.simulator("limit.length:=1.0e+30", hear=("joint_states", "/diagnostics"))
    ros.publish(ACTUATION, Float64MultiArray(data=[1e20, 0.0]))
    wait_until(lambda: max(map(abs, ros.heard["joint_states"][-1].position)) > 1e10, what="a crawler far away")
    k = 0

    def accused():
        nonlocal k
        k += 1
        ros.publish(ACTUATION, Float64MultiArray(data=[1e20 * (k % 7), 0.1]))
        simulation = status(ros, "simulation")
        return simulation and simulation.level == b"\x01" and "states are inaccurate" in simulation.message

    wait_until(accused, what="a warning")


BODIES = {
    "chain": {"contacts": [0.0, 0.5, 2.0], "links": {"stiffness": 3.0}},
    "segment": {"segments": [{"name": "trunk", "from": 0.0, "to": 4.0, "stiffness": 1.0, "elements": 8,
                              "friction": {"isotropic": 0.5}}]},
    "plane": {"contacts": [[0, 0], [3, 0], [0, 2]], "links": {"stiffness": 1.0, "between": [[0, 1], [1, 2]]}},
}  # fmt: skip


@pytest.mark.parametrize("name", list(BODIES))
def test_limits_are_ten_bodies_and_as_told(name):
    document = {"name": name, "body": BODIES[name]}
    if name != "segment":
        document["friction"] = {"isotropic": 2.0}
    if name == "plane":
        document["dimension"] = 2
    scene = Scene.model_validate(document)
    extent = {"chain": 2.0, "segment": 4.0, "plane": 3.0}[name]
    span = 4.0 if name == "segment" else 1.0
    default = command_limits(scene)
    lengths = scene.columns.lengths
    assert default.largest[:lengths] == pytest.approx(10.0 * extent / span)
    told = command_limits(scene, 8.0, 80.0)
    assert told.largest[:lengths] == pytest.approx(8.0 / span)
    assert told.largest[lengths:] == pytest.approx(80.0 / span)
    assert (default.largest[lengths:] >= 1000.0 * 0.5).all()


@pytest.mark.parametrize("name", ["two_anchor_a", "three_contacts_two_ways"])
def test_no_scene_of_the_gallery_is_beyond_its_own_limits(name):
    scene = load_scene(name)
    assert (np.abs(scene.drive.rows) <= command_limits(scene).largest).all()
