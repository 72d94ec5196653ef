"""The simulator as hardware of ros2_control, beside the messages of joint_state_topic_hardware_interface.

The hardware here does what the source of that plugin does: it reads its topics and joints from the description, begins
with the initial values, copies the states of joints that it has, by name, and in each cycle sends the positions of all
its joints, unless the sum of their distances from the states is within the threshold.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

pytest.importorskip("rclpy")
import yaml
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from crawler_model import Crawler, load_scene
from crawler_ros.node.robot_description import describe_robot
from crawler_ros.wire.states import joint_state_names

from ...processes import wait_until
from ...scenes import gallery
from .graph import Graph
from .launch_files import FOLDER

SCENE = "three_contacts_two_ways"


class Hardware:
    def __init__(self, ros: Graph, description: str) -> None:
        control = ET.fromstring(description).find("ros2_control")
        parameters = {p.get("name"): p.text for p in control.iterfind("hardware/param")}
        self.joints = [joint.get("name") for joint in control.iterfind("joint")]
        initial = control.iterfind("joint/command_interface[@name='position']/param[@name='initial_value']")
        self.commands = np.array([float(value.text) for value in initial])
        self.states = self.commands.copy()
        self._threshold = float(parameters["trigger_joint_command_threshold"])
        self._latest = JointState()
        self._publisher = ros.node.create_publisher(JointState, parameters["joint_commands_topic"], 1)
        topic = parameters["joint_states_topic"]
        ros.node.create_subscription(JointState, topic, self._receive, qos_profile_sensor_data)
        wait_until(lambda: self._publisher.get_subscription_count() == 1, what="a subscriber of the commands")
        wait_until(lambda: self._latest.name, what="a state")

    def _receive(self, message: JointState) -> None:
        self._latest = message

    def cycle(self) -> None:
        latest = self._latest
        for name, position in zip(latest.name, latest.position, strict=True):
            if name in self.joints:
                self.states[self.joints.index(name)] = position
        if np.abs(self.states - self.commands).sum() <= self._threshold:
            return
        self._publisher.publish(JointState(name=self.joints, position=self.commands.tolist()))


def describe(ros: Graph) -> str:
    heard: list[String] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
    ros.node.create_subscription(String, "robot_description", heard.append, latched)
    wait_until(lambda: heard, what="the description")
    return heard[0].data


def applied(ros: Graph) -> list[list[float]]:
    return [list(point.positions[:2]) for m in list(ros.heard["applied_commands"]) for point in m.points]


def test_a_trajectory_of_a_controller_moves_the_body_by_the_exact_amount(ros):
    """A hundred cycles along a straight line, as the trajectory controller interpolates, and further ones at its end."""
    ros.simulator(f"scene:={SCENE}", hear=("joint_states", "applied_commands", "contact_states"))
    hardware = Hardware(ros, describe(ros))
    goal = np.array([0.12, -0.05])
    first = hardware.commands.copy()
    for k in range(1, 101):
        hardware.commands = first + (goal - first) * k / 100
        hardware.cycle()
        wait_until(lambda: len(applied(ros)) >= k, what="the command")  # noqa: B023
    hardware.cycle()  # it sends again what is followed already
    expected = Crawler(load_scene(SCENE))
    expected.advance(goal)
    places = expected.displacement + load_scene(SCENE).body.position
    there = pytest.approx(places, abs=1e-12)
    wait_until(lambda: list(ros.heard["contact_states"][-1].position) == there, what="the end of the trajectory")
    assert len(applied(ros)) == 100
    assert hardware.states == pytest.approx(np.diff(expected.displacement), abs=0.02)
    assert not np.allclose(hardware.states, goal, atol=1e-6)  # friction holds: no controller may compare them


def test_joints_of_controllers_that_are_not_active_keep_their_commands(ros):
    """Their interfaces are NaN; and a message of another program may name its joints in any order."""
    ros.simulator(f"scene:={SCENE}", "lock_step:=true", hear=("joint_states", "applied_commands"))
    hardware = Hardware(ros, describe(ros))
    messages = [
        ([0.03, np.nan], None, [0.03, 0.0]),
        ([np.nan, 0.02], None, [0.03, 0.02]),
        ([0.01, -0.01], ["link_1", "link_0"], [-0.01, 0.01]),
        ([0.05], ["link_1"], [-0.01, 0.05]),
    ]
    for k, (positions, names, row) in enumerate(messages):
        hardware.joints = names or hardware.joints
        hardware._publisher.publish(JointState(name=hardware.joints, position=positions))
        wait_until(lambda: len(ros.heard["applied_commands"]) > k, what="the tick")  # noqa: B023
        assert applied(ros)[-1] == row
    hardware._publisher.publish(JointState(name=["link_0", "link_1"], position=[np.nan, np.nan]))
    wait_until(lambda: len(ros.heard["applied_commands"]) > len(messages), what="a tick that holds")
    assert not ros.heard["applied_commands"][-1].points


@pytest.mark.parametrize("name", gallery())
def test_the_hardware_has_joints_that_the_description_and_the_states_have(name):
    """The controller manager refuses others; and only joints with commands, as positions are sent for those alone."""
    scene = load_scene(name)
    robot = ET.fromstring(describe_robot(scene, topics=("/left/joint_commands", "/left/joint_states")))
    joints = [joint.get("name") for joint in robot.iterfind("ros2_control/joint")]
    assert set(joints) <= {joint.get("name") for joint in robot.iterfind("joint")}
    assert set(joints) <= set(joint_state_names(scene.body))
    assert joints
    assert all(len(j.findall("command_interface")) == 1 for j in robot.iterfind("ros2_control/joint"))
    topics = [p.text for p in robot.iterfind("ros2_control/hardware/param")]
    assert topics == ["/left/joint_commands", "/left/joint_states", "-1"]


def test_the_controllers_are_for_the_joints_of_the_scene_and_share_no_topic_with_the_simulator():
    table = yaml.safe_load((FOLDER / "ros2_controllers.yaml").read_text())
    root = ET.fromstring((FOLDER / "ros2_control.launch.xml").read_text())
    scene = load_scene(root.find("arg[@name='scene']").get("default"))
    robot = ET.fromstring(describe_robot(scene))
    joints = [joint.get("name") for joint in robot.iterfind("ros2_control/joint")]
    controllers = set(table["controller_manager"]["ros__parameters"]) - {"update_rate"}
    assert controllers == set(table) - {"controller_manager"}
    assert all(table[name]["ros__parameters"]["joints"] == joints for name in controllers)
    spawned = {node.get("args").split()[0] for node in root.iterfind("node[@exec='spawner']")}
    assert spawned == controllers
    assert not controllers & {"actuation_controller", "friction_controller", "load_controller"}
