"""Refused commands and late ticks of a real node, counted by reason and time in its recording and found there by replay."""

from __future__ import annotations

import json

import pytest

pytest.importorskip("rclpy")
from builtin_interfaces.msg import Duration
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from crawler_command.screen import Screen
from crawler_ros.replay import analyse
from crawler_ros.replay.show.report import print_replay

from ...processes import wait_until
from .graph import only
from .machine import status, value

FRICTION, LENGTHS = "friction_controller/commands", "actuation_controller/commands"


def test_refused_commands_are_recorded_by_reason_and_time_up_to_the_end(ros, capsys):
    bags = ros.folder / "bags"
    simulator = ros.simulator("lock_step:=true", f"record:={bags}", hear=("joint_states", "/diagnostics"))
    ros.publish(FRICTION, Float64MultiArray(data=[-1.0]))
    ros.publish(FRICTION, Float64MultiArray(data=[0.5, -2.5, 1.0]))
    wait_until(lambda: value(ros, "commands", "refused") == "2", what="2 refused")
    for k in range(5):  # simulated time goes on to 0.05 s
        ros.publish(LENGTHS, Float64MultiArray(data=[0.01 * k, 0.0]))
    ros.ticked(5)
    ros.publish(LENGTHS, Float64MultiArray(data=[1.0]))
    wait_until(lambda: "actuation command has 1 value(s)" in simulator.said, what="the third")
    assert simulator.end() == 0  # at once: the last report is written on the way out
    found = analyse(only(bags))
    assert found.healthy
    assert found.incidents is not None
    assert (found.incidents.refused, found.incidents.late, found.incidents.lost) == (3, 0, 0)
    negative, short = found.incidents.refusals
    assert (negative.topic, negative.count, negative.first, negative.last) == (FRICTION, 2, 0.0, 0.0)
    assert negative.why == "friction command: entry 0 is -1 N; friction must be >= 0"
    assert (short.topic, short.count, short.first) == (LENGTHS, 1, 0.05)
    assert "it needs 2" in short.why
    assert json.loads(json.dumps(found.as_plain()))["incidents"]["refusals"][1]["first"] == 0.05
    print_replay(found, Screen(width=200))
    said = capsys.readouterr().out
    assert f"2 message(s) refused on {FRICTION}, the first at 0 s, the last at 0 s: friction command" in said
    assert f"1 message(s) refused on {LENGTHS}, the first at 0.05 s: actuation command has 1 value(s)" in said


def test_trajectories_wholly_in_the_past_are_told_counted_and_recorded(ros):
    bags = ros.folder / "bags"
    simulator = ros.simulator(f"record:={bags}", hear=("joint_states", "/diagnostics"))
    ros.ticked(50)
    point = JointTrajectoryPoint(positions=[0.05], time_from_start=Duration(nanosec=100_000_000))
    message = JointTrajectory(joint_names=["link_0"], points=[point])
    message.header.stamp.nanosec = 300_000_000
    ros.publish("joint_trajectory", message)
    wait_until(lambda: value(ros, "commands", "trajectories wholly in the past") == "1", what="a count")
    assert status(ros, "commands").level == b"\x01"
    assert simulator.said.count("1 trajectory message(s) wholly in the past at simulated time ") == 1
    assert simulator.end() == 0
    found = analyse(only(bags)).incidents
    assert found is not None
    assert found.overdue == 1
    assert found.explain()[0].startswith("1 trajectory message(s) wholly in the past")


def test_late_ticks_are_recorded_with_the_first_and_the_worst(ros):
    """A million ticks a second are more than any machine keeps up with: ticks are late from the start on."""
    bags = ros.folder / "bags"
    hear = ("joint_states", "/diagnostics")
    fast = ("rate:=10000.0", "real_time_factor:=100.0", "publish.every:=100")
    simulator = ros.simulator(*fast, f"record:={bags}", hear=hear)
    wait_until(lambda: value(ros, "simulation", "late ticks") not in ("", "0"), what="late ticks")
    assert simulator.end() == 0
    found = analyse(only(bags)).incidents
    assert found is not None
    assert found.refused == 0
    assert found.late > 0
    assert found.first_late is not None
    assert found.worst_late is not None
    assert found.worst_delay is not None
    assert found.worst_late >= found.first_late
    assert found.worst_delay > 1e-6
    (line,) = found.explain()
    assert line.startswith(f"{found.late} late tick(s), the first at {found.first_late:g} s, the worst by ")
