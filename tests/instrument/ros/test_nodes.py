"""The nodes as processes, over real DDS on loopback."""

from __future__ import annotations

import math
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter, ParameterValue
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from crawler_model import CommandError, Crawler, load_scene, simulate
from crawler_model.theory.uniqueness import Undecided, commanded_margin
from crawler_ros.node.life.scheduling import check_priority
from crawler_ros.node.parameters import read_parameters
from crawler_ros.recording import bag
from crawler_ros.replay import simulate_again
from crawler_ros.viewer.frames import frames_of_recording

from ...processes import PATIENCE_S, wait_until
from .forked import finish
from .graph import environment, seconds
from .test_recording import DECODE


def trajectory(names, *points, stamp=0.0) -> JointTrajectory:
    message = JointTrajectory(joint_names=names)
    message.header.stamp.sec, message.header.stamp.nanosec = int(stamp), round(stamp % 1 * 1e9)
    for at, positions in points:
        point = JointTrajectoryPoint(positions=[float(p) for p in positions])
        point.time_from_start.sec, point.time_from_start.nanosec = int(at), round(at % 1 * 1e9)
        message.points.append(point)
    return message


def pause(ros, value=True, name="crawler"):
    return ros.call(f"/{name}/pause", "std_srvs/srv/SetBool", data=value)


def step(ros, name="crawler"):
    return ros.call(f"/{name}/step", "std_srvs/srv/Trigger")


def change(ros, name, value):
    """Set a parameter of the simulator, and return the result."""
    parameter = Parameter(name=name, value=ParameterValue(type=3, double_value=value))
    answer = ros.call("/crawler/set_parameters", "rcl_interfaces/srv/SetParameters", parameters=[parameter])
    return answer.results[0]


def diagnostics(ros) -> dict[str, str]:
    heard: list[DiagnosticArray] = wait_until(lambda: ros.heard["/diagnostics"], what="diagnostics")
    return {v.key: v.value for status in heard[-1].status for v in status.values}


def test_states_come_at_the_rate_with_exact_stamps(ros):
    ros.simulator("rate:=200.0", hear=("joint_states", "contact_states", "pose"))
    wait_until(lambda: len(ros.heard["joint_states"]) > 100)
    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in ros.heard["joint_states"]])
    assert (stamps % 5_000_000 == 0).all()
    assert (np.diff(stamps) > 0).all()
    assert np.median(np.diff(stamps)) == 5_000_000
    state = ros.heard["joint_states"][-1]
    assert list(state.name) == ["contact_0", "link_0", "link_1"]
    contact = ros.heard["contact_states"][-1]
    assert list(contact.name) == ["contact_0", "contact_1", "contact_2"]
    assert list(contact.position) == [0.0, 0.15, 0.3]
    assert contact.header.frame_id == "world"
    assert ros.heard["pose"][-1].pose.orientation.w == 1.0


def test_an_actuation_command_is_answered_exactly(ros):
    ros.simulator("scene:=three_contacts_one_way", hear=("joint_states", "contact_states", "pose", "applied_commands"))
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.1, -0.05]))
    moved = wait_until(lambda: [m for m in ros.heard["joint_states"] if m.effort[1] != 0.0])
    crawler = Crawler(load_scene("three_contacts_one_way"))
    answer = crawler.advance([0.1, -0.05])
    first = moved[0]
    assert first.position[0] == crawler.displacement[0]
    assert list(first.position)[1:] == crawler.shape.tolist()
    assert list(first.effort)[1:] == crawler.tension.tolist()
    assert np.array(first.velocity)[1:] == pytest.approx(np.diff(answer.velocity) * 100.0)
    at = seconds(first)
    contact = wait_until(lambda: [m for m in ros.heard["contact_states"] if seconds(m) == at])[0]
    assert list(contact.position) == (crawler.body.position + crawler.displacement).tolist()
    pose = wait_until(lambda: [m for m in ros.heard["pose"] if seconds(m) == at])[0]
    assert pose.pose.position.x == crawler.net_translation
    ledger = wait_until(lambda: [m for m in ros.heard["applied_commands"] if m.points])[0]
    assert list(ledger.points[0].positions)[:2] == [0.1, -0.05]
    assert seconds(ledger) == pytest.approx(at - 0.01)


def test_the_gait_player_walks_it_exactly_through_every_waypoint(ros):
    bags = ros.folder / "bags"
    simulator = ros.simulator(
        "scene:=three_contacts_two_ways", "rate:=500.0", f"record:={bags}", hear=("joint_states", "pose")
    )
    player = ros.start("crawler_ros.node.gait_player", "scene:=three_contacts_two_ways", "periods:=4")
    assert player.wait() == 0
    offline = simulate(load_scene("three_contacts_two_ways"), duration=4.0)
    assert offline.per_period[1:] == pytest.approx(0.07, abs=1e-12)
    ros.walked(offline.net_translation[-1])
    assert simulator.end() == 0
    (path,) = bags.iterdir()
    y = [DECODE(r.data, r.type).pose.position.x for r in bag.read(path) if r.topic == "/pose"]
    assert y[-1] == pytest.approx(offline.net_translation[-1], abs=1e-12)
    assert "period 4 of 4" in player.said


def test_paused_it_steps_on_request_and_pairs_arrays_by_count(ros):
    """Strategy A with four ticks a period: 2 m a period, as if both arrays were one message."""
    ros.simulator("scene:=two_anchor_a", hear=("pose", "joint_states"))
    assert pause(ros).success
    rows = load_scene("two_anchor_a").drive
    y = []
    for tick in range(12):
        k = tick % 4 + 1
        ros.publish("actuation_controller/commands", Float64MultiArray(data=rows.actuation[k].tolist()))
        ros.publish("friction_controller/commands", Float64MultiArray(data=rows.forward[k].tolist()))
        ros.taken_up()
        heard = len(ros.heard["pose"])
        assert step(ros).success
        wait_until(lambda n=heard: len(ros.heard["pose"]) > n)
        if tick % 4 == 3:
            y.append(ros.heard["pose"][-1].pose.position.x)
    assert np.diff(y) == pytest.approx(2.0, abs=1e-12)


def test_pause_step_and_reset(ros):
    ros.simulator("rate:=1000.0", hear=("joint_states",))
    assert not step(ros).success  # it plays
    ros.publish("joint_trajectory", trajectory(["link_0"], (0.0, [0.2])))
    wait_until(lambda: ros.heard["joint_states"][-1].effort[1] != 0.0)
    assert pause(ros).success
    answers = [step(ros) for _ in range(20)]  # if it ticked, it would between them
    assert all(answer.success for answer in answers)
    times = [float(re.fullmatch(r"at simulated time (\S+) s", answer.message)[1]) for answer in answers]
    assert np.rint(np.diff(times) * 1000).tolist() == [1] * 19
    wait_until(
        lambda: round(1e9 * (seconds(ros.heard["joint_states"][-1]) - times[-1])) == 0, what="the last step's state"
    )
    heard = len(ros.heard["joint_states"])
    assert ros.call("/crawler/reset", "std_srvs/srv/Trigger").success
    first = wait_until(lambda: list(ros.heard["joint_states"][heard:]))[0]
    assert seconds(first) == 0.0
    assert not np.any(first.position)
    assert pause(ros, False).success
    wait_until(lambda: len(ros.heard["joint_states"]) > heard + 20)
    assert not np.any(ros.heard["joint_states"][-1].position)  # pending commands were dropped


BAD = [
    ("actuation_controller/commands", Float64MultiArray(data=[1.0]), "it needs 2, one per link"),
    ("actuation_controller/commands", Float64MultiArray(data=[math.nan, 0.0]), "entry 0 is nan"),
    ("friction_controller/commands", Float64MultiArray(data=[1.0, 1.0]), "it needs 1, 3"),
    ("friction_controller/commands", Float64MultiArray(data=[-1.0]), "friction must be >= 0"),
    ("friction_controller/commands", Float64MultiArray(data=[math.inf]), "entry 0 is inf"),
    ("joint_trajectory", trajectory(["link_7"], (0.0, [1.0])), "no joint is called 'link_7'"),
    ("joint_trajectory", trajectory(["link_0"], (0.0, [1.0, 2.0])), "2 position(s) for 1 name(s)"),
    ("joint_trajectory", trajectory(["link_0"], (1.0, [1.0]), (0.5, [1.0])), "times must not decrease"),
    ("joint_trajectory", trajectory(["contact_0/friction"], (0.0, [math.nan])), "entry 0 is nan"),
    ("joint_trajectory", trajectory(["x" * 10_000], (0.0, [1.0])), "no joint is called 'xxx"),
]


def test_bad_messages_are_refused_whole_logged_and_counted(ros):
    # in lock-step no stall of the machine makes a tick late, which would warn of its own
    simulator = ros.simulator("lock_step:=true", hear=("joint_states", "/diagnostics"))
    for count, (name, message, said) in enumerate(BAD, 1):
        ros.publish(name, message)
        wait_until(lambda s=said: s in simulator.said, what=said)
        wait_until(lambda c=count: diagnostics(ros).get("refused") == str(c), what=f"{count} refused")
    assert not np.any(ros.heard["joint_states"][-1].position)
    assert not np.any(ros.heard["joint_states"][-1].effort)
    assert simulator.process.poll() is None
    assert max(len(line) for line in simulator.said.splitlines()) < 500
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.1, 0.0]))
    wait_until(lambda: ros.heard["joint_states"][-1].effort[1] != 0.0)
    levels = {(s.name, s.level) for m in ros.heard["/diagnostics"] for s in m.status}
    assert ("crawler: commands", b"\x01") in levels
    assert {level for name, level in levels if name == "crawler: simulation"} == {b"\x00"}


@pytest.mark.parametrize("name", ["two_contacts_anisotropic", "planar_three_points"])
def test_why_a_uniqueness_margin_is_not_decided_is_a_diagnostic(ros, name):
    scene = load_scene(name)
    margin = commanded_margin(scene.body, scene.drive)
    ros.simulator(f"scene:={name}", hear=("joint_states", "/diagnostics"))
    told = {key: value for key, value in diagnostics(ros).items() if key.startswith("uniqueness margin")}
    if isinstance(margin, Undecided):
        assert told == {"uniqueness margin": "not decided", "uniqueness margin not decided because": margin.value}
    else:
        assert told == {"uniqueness margin": f"{margin:.3e}"}


def test_names_left_out_hold(ros):
    ros.simulator(hear=("applied_commands",))
    ros.publish("joint_trajectory", trajectory(["contact_1/friction"], (0.0, [0.9])))
    ledger = wait_until(lambda: [m for m in ros.heard["applied_commands"] if m.points])[0]
    row = dict(zip(ledger.joint_names, ledger.points[0].positions, strict=True))
    assert row["contact_1/forward"] == row["contact_1/backward"] == 0.9
    assert row["contact_0/forward"] == 0.2
    assert row["contact_0/backward"] == 0.5
    assert row["link_0"] == 0.0


def test_two_crawlers_in_namespaces(ros):
    for name in ("left", "right"):
        ros.hear(f"/{name}/joint_states", type_name="joint_states")
        ros.start("crawler_ros.node.simulator", arguments=("-r", f"__ns:=/{name}"))
    wait_until(lambda: ros.heard["/left/joint_states"] and ros.heard["/right/joint_states"])
    ros.publish(
        "/left/actuation_controller/commands", Float64MultiArray(data=[0.3, 0.3]), "actuation_controller/commands"
    )
    wait_until(lambda: np.any(ros.heard["/left/joint_states"][-1].position))
    ros.publish(
        "/right/actuation_controller/commands", Float64MultiArray(data=[0.0, 0.3]), "actuation_controller/commands"
    )
    moved = wait_until(lambda: [m for m in ros.heard["/right/joint_states"] if np.any(m.effort)])[0]
    alone = Crawler(load_scene("three_contacts_one_way"))
    alone.advance([0.0, 0.3])
    assert list(moved.effort)[1:] == alone.tension.tolist()


def test_parameters_are_declared_with_ranges_and_mostly_read_only(ros):
    ros.simulator("real_time_factor:=0.01", hear=("joint_states",))  # a tick takes a second
    names = list(read_parameters())
    described = ros.call("/crawler/describe_parameters", "rcl_interfaces/srv/DescribeParameters", names=names)
    by_name = {d.name: d for d in described.descriptors}
    assert set(by_name) == set(names)
    assert all(d.description for d in described.descriptors)
    assert by_name["rate"].read_only
    assert by_name["rate"].floating_point_range[0].to_value == 100000.0
    assert not by_name["real_time_factor"].read_only

    assert change(ros, "real_time_factor", 20.0).successful
    before = seconds(ros.heard["joint_states"][-1])
    wait_until(lambda: seconds(ros.heard["joint_states"][-1]) > before + 10.0)  # it took a quarter of an hour before
    assert not change(ros, "real_time_factor", 1000.0).successful
    refused = change(ros, "rate", 10.0)
    assert not refused.successful
    assert refused.reason


def may_have_priority() -> bool:
    values = {"thread_priority": 10, "lock_step": False, "real_time_factor": 1.0}
    try:
        check_priority(values)
    except CommandError:
        return False
    return True


@pytest.mark.skipif(not may_have_priority(), reason="this user has no permission for real-time priorities")
def test_all_threads_have_the_priority_that_is_asked_for(ros):
    simulator = ros.simulator("thread_priority:=10", hear=("joint_states",))
    assert change(ros, "real_time_factor", 2.0).successful
    threads = [int(name) for name in os.listdir(f"/proc/{simulator.process.pid}/task")]
    assert {os.sched_getscheduler(t) for t in threads} == {os.SCHED_FIFO}
    assert {os.sched_getparam(t).sched_priority for t in threads} == {10}
    assert "thread_priority: 10 with real_time_factor 0" in change(ros, "real_time_factor", 0.0).reason


@pytest.mark.skipif(
    not may_have_priority() or not shutil.which("setpriv"), reason="nothing to take away, or no setpriv"
)
def test_a_priority_without_permission_is_one_line():
    command = ["setpriv", "--bounding-set=-sys_nice", "--inh-caps=-sys_nice", sys.executable, "-m"]
    command += ["crawler_ros.node.simulator", "--ros-args", "-p", "thread_priority:=10"]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 1
    assert "simulator: thread_priority: 10: this user has no permission for real-time priorities" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_clock_is_simulated_time(ros):
    ros.simulator("publish_clock:=true", "real_time_factor:=10.0", hear=("joint_states", "/clock"))
    wait_until(lambda: len(ros.heard["/clock"]) > 50)
    times = [m.clock.sec + m.clock.nanosec * 1e-9 for m in ros.heard["/clock"]]
    assert np.median(np.diff(times)) == pytest.approx(0.01)
    assert np.array(times) * 100 == pytest.approx(np.rint(np.array(times) * 100))


def test_as_fast_as_possible_still_listens(ros):
    ros.simulator("real_time_factor:=0.0", "rate:=1000.0", "publish.every:=1000", hear=("joint_states",))
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.1, 0.0]))
    wait_until(lambda: ros.heard["joint_states"][-1].effort[1] != 0.0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_cleanly(ros, number):
    simulator = ros.simulator("rate:=1000.0", "real_time_factor:=0.0")
    assert simulator.end(number) == 0
    assert "stopped after" in simulator.said
    assert "Traceback" not in simulator.said


WRONG = [
    (["scene:=nowhere"], "nowhere: no such file, nor a scene of the gallery"),
    (["rate:=-1.0"], "rate"),
    (["rate:=fast"], "parameter rate takes a number"),
    (["method:=euler"], "it must be one of auto, exact, catch_up"),
    (["frame_id:=''"], "parameter frame_id: ''; it must be the name of a frame"),
    (["view:=window"], "it must be off, live, or a path that ends in .rrd"),
    (["thread_priority:=10", "lock_step:=true"], "thread_priority: 10 with lock_step: the node would run as fast"),
    (["record:=/proc/nowhere"], "record: /proc/nowhere: the folder cannot be created: No such file or directory"),
    (["record:=file"], "record: file: the folder cannot be created: file is not a folder"),
    (["record:=file/deep/er"], "record: file/deep/er: the folder cannot be created: file is not a folder"),
    (["record:=~nobody-at-all/bags"], "there is no user 'nobody-at-all'"),
]


@pytest.mark.parametrize(("parameters", "said"), WRONG)
def test_a_wrong_start_is_one_line(tmp_path, parameters, said):
    (tmp_path / "file").write_text("mine")
    words = [w for p in parameters for w in ("-p", p)]
    status, text = finish(tmp_path, "crawler_ros.node.simulator", "--ros-args", *words, environment=environment())
    assert status == 1
    assert said in text
    assert len([line for line in text.splitlines() if line.startswith("simulator: ")]) == 1
    assert "Traceback" not in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["two_anchor_a"], "unknown argument 'two_anchor_a'"),
        (["--ros-args", "scene:=two_anchor_a"], "pass parameters as in --ros-args -p scene:=FILE"),
        (["--ros-args", "-p"], "pass parameters as in"),
        (["--ros-args", "-r", "joint_states:=/zustände"], "a name has letters of English, digits, _ and /"),
        (["--ros-args", "-r", "__ns:=/a b"], "a name has letters of English, digits, _ and /"),
        (["--ros-args", "-p", "scene=two_anchor_a"], "pass parameters as in"),
    ],
)
def test_a_wrong_command_line_is_one_line(tmp_path, words, said):
    status, text = finish(tmp_path, "crawler_ros.node.simulator", *words, environment=environment())
    assert status == 1
    assert said in text
    assert "Traceback" not in text


def test_help_of_a_node_names_its_parameters():
    command = [sys.executable, "-m", "crawler_ros.node.simulator", "--help"]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0
    assert "real_time_factor" in done.stdout


@pytest.mark.parametrize(
    ("node", "given", "said"),
    [
        ("crawler_ros.node.simulator", "lockstep:=true", "unknown parameter 'lockstep'; the nearest is 'lock_step'"),
        ("crawler_ros.node.simulator", "zzz:=1", "unknown parameter 'zzz'; the parameters are scene, "),
        ("crawler_ros.node.gait_player", "period:=3", "unknown parameter 'period'; the nearest is 'periods'"),
        ("crawler_lab.plan.plan_node", "lockstep:=true", "unknown parameter 'lockstep'; the nearest is 'lock_step'"),
    ],
)
def test_a_parameter_that_a_node_does_not_have_ends_it_in_a_line(tmp_path, node, given, said):
    status, text = finish(tmp_path, node, "--ros-args", "-p", given, environment=environment())
    assert status == 1
    assert said in text.splitlines()[-1]
    assert "Traceback" not in text


def test_what_is_meant_is_taken_and_an_unknown_quality_of_service_is_named(ros):
    qos = ("qos_overrides./joint_state.publisher.depth:=3", "qos_overrides./pose.publisher.depth:=3")
    simulator = ros.simulator("rate:=50", "view:=off", "use_sim_time:=false", *qos, hear=("joint_states",))
    wait_until(lambda: len(ros.heard["joint_states"]) > 5)
    assert seconds(ros.heard["joint_states"][5]) - seconds(ros.heard["joint_states"][4]) == pytest.approx(0.02)
    assert f"unknown parameter {qos[0][:-3]!r}; the nearest is 'qos_overrides./joint_states." in simulator.said
    assert simulator.said.count("unknown parameter") == 1
    assert "3 contacts, 2 links, exact at 50 Hz; waiting for commands" in simulator.said


def test_short_periods_lose_nothing(ros, tmp_path):
    """Two thousand periods of a millisecond: more than the command topic's depth."""
    scene = tmp_path / "fast.yaml"
    text = "{name: fast, body: {contacts: [0, 1], links: {stiffness: 1}}, friction: {isotropic: 1},"
    text += " start: {displacement: [0, 1]}, drive: {strategy: A, length: 4, friction: 1, period: 0.001}}"
    scene.write_text(text)
    ros.simulator(f"scene:={scene}", hear=("pose",))
    player = ros.start("crawler_ros.node.gait_player", f"scene:={scene}", "periods:=2000")
    assert player.wait() == 0
    ros.walked(4000.5, within=1e-9)


def test_a_reset_starts_a_run_of_its_own_in_the_recording(ros, tmp_path):
    simulator = ros.simulator(f"record:={tmp_path / 'bags'}", hear=("joint_states",))
    for length in (0.2, 0.1):
        ros.publish("actuation_controller/commands", Float64MultiArray(data=[length, 0.0]))
        wait_until(lambda: ros.heard["joint_states"][-1].effort[1] != 0.0)
        assert ros.call("/crawler/reset", "std_srvs/srv/Trigger").success
        wait_until(lambda: ros.heard["joint_states"][-1].effort[1] == 0.0)
    assert simulator.end() == 0
    (path,) = (tmp_path / "bags").iterdir()
    again = simulate_again(path)
    assert again.identical
    assert again.resets == 2
    _, frames = frames_of_recording(path)
    assert (np.diff([f.time_ns for f in frames]) >= 0).all()


def test_a_player_without_a_drive_says_so(tmp_path):
    scene = Path(tmp_path) / "idle.yaml"
    scene.write_text("{name: idle, body: {contacts: [0, 1], links: {stiffness: 1}}, friction: {isotropic: 1}}")
    words = ("--ros-args", "-p", f"scene:={scene}")
    status, text = finish(tmp_path, "crawler_ros.node.gait_player", *words, environment=environment())
    assert status == 1
    assert "idle has no drive, and no gait to play" in text
