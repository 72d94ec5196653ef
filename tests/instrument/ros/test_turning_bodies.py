"""Bodies that turn over topics: pose and odometry turn, links and joints are commanded by name, replay is exact."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

pytest.importorskip("rclpy")
from std_msgs.msg import Float64MultiArray

from crawler_model import Crawler, load_scene
from crawler_ros.replay import analyse

from ...processes import wait_until
from .graph import seconds
from .machine import value
from .test_nodes import trajectory

SCENE = """
name: fish
dimension: 2
body:
  points: [[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [0.3, 0.0]]
  springs: length
  links: {stiffness: 50}
  joints: {stiffness: 2.0}
friction: {forward: 0.1, backward: 1.0, left: 0.5, right: 0.5}
"""
ARCH = """
name: arch
dimension: 2
body: {points: [[0.0, 0.0], [1.0, 0.2], [2.0, 0.0]], springs: length, links: {stiffness: 20.0}}
friction: {isotropic: [50.0, 0.0, 50.0]}
loads: 0
"""
NAMES = ["link_0", "link_1", "link_2", "joint_0", "joint_1"]
GAIT = ((0.2, [0.0, 0.01, 0.0, 0.4, 0.0]), (0.4, [0.01, 0.0, 0.0, 0.4, 0.5]), (0.6, [0.0, 0.0, 0.01, -0.3, 0.5]))


def write(tmp_path, text):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    return path


def yaw_of(pose):
    assert pose.orientation.x == pose.orientation.y == 0.0
    return 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)


def test_pose_and_odometry_turn_with_the_body(ros, tmp_path):
    scene = write(tmp_path, SCENE)
    ros.simulator(f"scene:={scene}", "publish.odom:=true", "rate:=50.0", hear=("odom", "pose", "applied_commands"))
    ros.publish("joint_trajectory", trajectory(NAMES, *GAIT))
    wait_until(
        lambda: any(list(p.positions)[:5] == GAIT[-1][1] for m in ros.heard["applied_commands"] for p in m.points)
    )
    ends = seconds(ros.heard["applied_commands"][-1])
    wait_until(lambda: seconds(ros.heard["odom"][-1]) > ends and seconds(ros.heard["pose"][-1]) > ends)
    odom, pose = ros.heard["odom"], {seconds(p): p for p in ros.heard["pose"]}
    assert max(abs(yaw_of(o.pose.pose)) for o in odom) > 0.01
    for before, after in itertools.pairwise(odom):
        place, yaw, rate = after.pose.pose.position, yaw_of(after.pose.pose), after.twist.twist
        assert after.pose.pose == pose[seconds(after)].pose if seconds(after) in pose else True
        if seconds(after) - seconds(before) == pytest.approx(0.02):
            assert rate.angular.z == pytest.approx((yaw - yaw_of(before.pose.pose)) / 0.02, abs=1e-9)
            was = before.pose.pose.position
            moved = np.array([place.x - was.x, place.y - was.y]) / 0.02
            along, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
            assert [rate.linear.x, rate.linear.y] == pytest.approx([along @ moved, left @ moved], abs=1e-9)
    assert any(o.twist.twist.angular.z != 0.0 for o in odom)


def test_commands_by_name_move_links_and_joints_and_replay_finds_the_same_bits(ros, tmp_path):
    """In lock-step, so that the model by itself follows the same ramps."""
    scene = write(tmp_path, SCENE)
    hear = ("joint_states", "contact_states", "pose", "/diagnostics")
    simulator = ros.simulator(
        f"scene:={scene}", "lock_step:=true", "rate:=10.0", f"record:={tmp_path / 'bags'}", hear=hear
    )
    alone = Crawler(load_scene(scene))
    row = alone.row
    commands = [
        ("joint_trajectory", NAMES, [0.0, 0.01, 0.0, 0.4, 0.0]),
        ("actuation_controller/joint_trajectory", ["joint_1", "link_0"], [0.5, 0.02]),
        ("joint_trajectory", ["contact_3/forward", "contact_0/friction", "joint_0"], [0.3, 0.7, -0.2]),
        ("actuation_controller/commands", NAMES, [0.0, 0.0, 0.03, 0.1, -0.6]),
    ]
    names = list(alone.scene.columns.aliases)
    for k, (topic, given, numbers) in enumerate(commands, 1):
        message = Float64MultiArray(data=numbers) if topic.endswith("/commands") else trajectory(given, (0.0, numbers))
        ros.publish(topic, message)
        ros.ticked(k, rate=10.0)
        for name, number in zip(given, numbers, strict=True):
            assert name in names
            row[alone.scene.columns.aliases[name]] = number
        alone.follow(alone.scene.columns.target(row[None]).copy())
        state = ros.heard["joint_states"][-1]
        assert state.name == ["contact_0/x", "contact_0/y", "contact_0/yaw", *NAMES]
        assert list(state.position)[3:] == list(alone.shape)
        assert list(state.effort)[3:] == list(alone.tension)
        assert list(state.position)[:2] == list(alone.displacement[0])
        ros.ticked(k, "pose", 10.0)
        assert yaw_of(ros.heard["pose"][-1].pose) == pytest.approx(alone.yaw, abs=1e-15)
        ros.ticked(k, "contact_states", 10.0)
        contacts = ros.heard["contact_states"][-1]
        assert list(contacts.position) == list((alone.body.position + alone.displacement).ravel())
    wait_until(lambda: value(ros, "simulation", "yaw [rad]") == f"{alone.yaw:.6g}")
    assert float(value(ros, "simulation", "stability margin")) == pytest.approx(alone.stability_margin, rel=1e-5)
    assert value(ros, "simulation", "jumps") == "0"
    assert simulator.end() == 0
    (path,) = (tmp_path / "bags").iterdir()
    found = analyse(path)
    assert found.problems == ()
    assert found.comparison.identical
    assert found.comparison.ticks == 5
    assert found.energy.residual < 1e-3


def test_friction_arrays_have_four_numbers_a_point_and_others_are_refused_in_one_line(ros, tmp_path):
    scene = write(tmp_path, SCENE)
    simulator = ros.simulator(f"scene:={scene}", hear=("joint_states", "applied_commands"))
    friction = [0.1, 0.2, 0.3, 0.4] * 3 + [1.0, 1.0, 2.0, 2.0]
    ros.publish("friction_controller/commands", Float64MultiArray(data=friction))

    def in_force():
        points = [p for message in ros.heard["applied_commands"] for p in message.points]
        return list(points[-1].positions)[5:] if points else []

    wait_until(lambda: in_force() == friction)
    ros.publish("friction_controller/commands", Float64MultiArray(data=[0.5]))
    wait_until(lambda: in_force() == [0.5] * 16)
    for numbers, refusal in (
        ([1.0] * 8, "friction command has 8 value(s); it needs 1, 4 (one per point) or 16 (forward, backward, left"),
        ([0.0, 1.0, 1.0, 1.0] * 4, "friction command: point 0 has forward 0, backward 1"),
    ):
        ros.publish("friction_controller/commands", Float64MultiArray(data=numbers))
        wait_until(lambda text=refusal: text in simulator.said, what=refusal)
    for names, numbers, refusal in (
        (["contact_1/left"], [0.0], "all four must be > 0, or all four 0"),
        (["joint_1"], [7.0], "joint_1 is 7; at most 6.28319 is accepted (a whole turn"),
        (["joint_7"], [0.1], "no joint is called 'joint_7'; there are joint_"),
    ):
        ros.publish("joint_trajectory", trajectory(names, (0.0, numbers)))
        wait_until(lambda text=refusal: text in simulator.said, what=refusal)
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.0] * 3))
    wait_until(lambda: "it needs 5, one per link, then per joint" in simulator.said)
    ros.publish("actuation_controller/joint_trajectory", trajectory(["contact_0/left"], (0.0, [1.0])))
    wait_until(lambda: "this topic takes only links and joints" in simulator.said)


def press(ros, count):
    """Load the arch with some more in each tick, in lock-step; yields the load on its middle [N]."""
    for k, load in enumerate(np.linspace(-0.02, -0.2, count), 1):
        ros.publish("joint_trajectory", trajectory(["contact_1/load_y"], (0.0, [load])))
        ros.ticked(k)
        yield load


def test_a_jump_is_counted_and_found_again(ros, tmp_path):
    scene = write(tmp_path, ARCH)
    simulator = ros.simulator(
        f"scene:={scene}", "lock_step:=true", f"record:={tmp_path / 'bags'}", hear=("joint_states", "/diagnostics")
    )
    alone = Crawler(load_scene(scene))
    jumps = []
    for load in press(ros, 10):
        jumps += alone.advance([0.0, 0.0], loads=[[0.0, 0.0], [0.0, load], [0.0, 0.0]]).jumps
        assert list(ros.heard["joint_states"][-1].position)[3:5] == list(alone.shape)
    (jump,) = jumps
    wait_until(lambda: value(ros, "simulation", "jumps") == "1")
    assert float(value(ros, "simulation", "energy lost in jumps [J]")) == pytest.approx(jump.loss, rel=1e-3)
    assert any("jump(s) where stability was lost" in s.message for m in ros.heard["/diagnostics"] for s in m.status)
    assert simulator.end() == 0
    (path,) = (tmp_path / "bags").iterdir()
    found = analyse(path)
    assert found.comparison.identical
    (again,) = found.plain_jumps()
    assert (again["contact"], again["border"]) == ("contact_1", None)
    assert found.energy.jump_loss == pytest.approx(jump.loss, rel=1e-9)
    assert [jump.contact for _, jump in found.table.jumps] == [1]


def test_a_body_that_must_not_jump_rests_and_the_node_goes_on(ros, tmp_path):
    scene = write(tmp_path, f"{ARCH}on_instability: refuse\n")
    simulator = ros.simulator(f"scene:={scene}", "lock_step:=true", hear=("joint_states", "/diagnostics"))
    for _ in press(ros, 10):
        pass
    wait_until(lambda: value(ros, "commands", "ticks refused") not in ("", "0"), what="the refused ticks")
    assert "the commands of a tick are refused: command: at" in simulator.said
    assert value(ros, "simulation", "jumps") == "0"
    assert ros.heard["joint_states"][-1].position == ros.heard["joint_states"][-2].position
