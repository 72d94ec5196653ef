"""What a robot's driver offers besides its joints: odometry, description, a trajectory controller's topic, QoS."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")
import itertools

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from urdf_parser_py.urdf import URDF

from crawler_model import Crawler, load_scene, simulate
from crawler_ros.node.parameters import read_parameters
from crawler_ros.node.robot_description import describe_robot
from crawler_ros.recording import bag
from crawler_ros.wire.messages import encode_string, lay_out_odometry, list_pose
from crawler_ros.wire.states import joint_state_names, station_names
from crawler_ros.wire.topics import message_class

from ...processes import wait_until
from ...scenes import NOT_TURNING
from .graph import seconds
from .test_nodes import trajectory
from .test_recording import DECODE


def where_frames_are(robot: URDF, joint_positions: dict[str, float]) -> dict[str, np.ndarray]:
    """Forward kinematics, as robot_state_publisher does it for prismatic joints without turns."""
    place = {robot.get_root(): np.zeros(3)}
    while len(place) < len(robot.links):
        for joint in robot.joints:
            if joint.parent in place:
                slide = np.array(joint.axis) * joint_positions[joint.name] if joint.type == "prismatic" else np.zeros(3)
                place[joint.child] = place[joint.parent] + np.array(joint.origin.xyz) + slide
    return place


@pytest.mark.parametrize("name", NOT_TURNING)
def test_the_description_puts_every_station_where_it_stands(name):
    scene = load_scene(name)
    mesh = scene.body
    robot = URDF.from_xml_string(describe_robot(scene))
    assert robot.name == name
    moving = [joint for joint in robot.joints if joint.type != "fixed"]  # as chambers are that touch
    assert all(joint.type == "prismatic" and joint.limit.upper > 0.0 for joint in moving)
    assert {joint.name for joint in moving} <= set(joint_state_names(mesh))
    crawler = Crawler(scene)
    for _ in range(3):
        half = scene.drive.waypoints_between(0, int(0.4e9))[1]
        crawler.follow(np.ascontiguousarray(scene.drive.targets[half]))
    x = crawler.displacement
    root = int(mesh.stations[0])
    values = np.concatenate((x[root : root + 1], crawler.joint_elongation)).ravel()
    place = where_frames_are(robot, dict(zip(joint_state_names(mesh), values, strict=True)))
    for station, contact in zip(station_names(mesh), mesh.stations, strict=True):
        expected = np.zeros(3)
        expected[: mesh.dimension] = mesh.position[contact] + x[contact]
        np.testing.assert_allclose(place[f"{station}_frame"], expected, atol=1e-9)
    assert all(link.visuals for link in robot.links if link.name.endswith("_frame"))


def test_the_description_waits_for_whoever_comes_and_is_recorded(ros, tmp_path):
    process = ros.simulator("scene:=hybrid_body", f"record:={tmp_path / 'bags'}")
    heard: list[String] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
    ros.node.create_subscription(String, "robot_description", heard.append, latched)
    wait_until(lambda: heard)
    assert heard[0].data == describe_robot(load_scene("hybrid_body"))
    process.end()
    (folder,) = (tmp_path / "bags").iterdir()
    records = [r for r in bag.read(folder) if r.topic == "/robot_description"]
    assert [r.data for r in records] == [encode_string(heard[0].data)]


def test_odometry_says_what_the_pose_says_and_how_fast(ros):
    ros.simulator("publish.odom:=true", "rate:=50.0", hear=("odom", "pose", "joint_states"))
    ros.start("crawler_ros.node.gait_player", "periods:=1")
    offline = simulate(load_scene("three_contacts_one_way"), duration=1.0)
    end = offline.net_translation[-1]
    wait_until(lambda: abs(ros.heard["odom"][-1].pose.pose.position.x - end) < 1e-12)
    odom, pose = ros.heard["odom"], {seconds(p): p for p in ros.heard["pose"]}
    assert odom[0].header.frame_id == "world"
    assert odom[0].child_frame_id == "base_link"
    for before, after in itertools.pairwise(odom):
        if seconds(after) in pose:
            assert after.pose.pose.position.x == pose[seconds(after)].pose.position.x
        if seconds(after) - seconds(before) == pytest.approx(0.02):
            moved = after.pose.pose.position.x - before.pose.pose.position.x
            assert after.twist.twist.linear.x == pytest.approx(moved / 0.02, abs=1e-12)
    assert any(o.twist.twist.linear.x != 0.0 for o in odom)


def test_an_odometry_message_is_what_others_decode():
    data = lay_out_odometry("world", "base_link").encode(1_500_000_002, [*list_pose(1.0, 2.0), 3.0, 4.0, 0.0])
    message = DECODE(data, "nav_msgs/msg/Odometry")
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_002)
    position, velocity = message.pose.pose.position, message.twist.twist.linear
    assert (position.x, position.y, velocity.x, velocity.y) == (1.0, 2.0, 3.0, 4.0)
    assert message.pose.pose.orientation.w == 1.0
    assert not np.any(message.pose.covariance)
    assert not np.any(message.twist.covariance)


def test_a_trajectory_controllers_topic_takes_lengths_alone(ros):
    process = ros.simulator("rate:=100.0", hear=("joint_states", "/diagnostics"))
    ros.publish("actuation_controller/joint_trajectory", trajectory(["contact_0/forward"], (0.1, [1.0])))
    wait_until(lambda: "this topic takes only links and segments" in process.said)
    message = trajectory(["link_1"], (0.2, [0.3]))
    message.points[0].velocities = [0.0]
    ros.publish("actuation_controller/joint_trajectory", message)
    exact = Crawler(load_scene("three_contacts_one_way"))
    exact.advance([0.0, 0.3])
    end = exact.joint_elongation[1]
    wait_until(lambda: abs(ros.heard["joint_states"][-1].position[2] - end) < 1e-12)
    assert "velocities, accelerations and efforts of a trajectory are not followed" in process.said


def test_qos_can_be_overridden_and_is_recorded_as_it_is(ros, tmp_path):
    import yaml
    from mcap.reader import make_reader

    process = ros.start(
        "crawler_ros.node.simulator",
        f"record:={tmp_path / 'bags'}",
        "qos_overrides./joint_states.publisher.reliability:=best_effort",
        "qos_overrides./joint_states.publisher.depth:=3",
    )
    wait_until(lambda: "waiting for commands" in process.said)
    (info,) = wait_until(lambda: ros.node.get_publishers_info_by_topic("/joint_states"))
    assert info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    heard = []
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    kind = message_class("sensor_msgs/msg/JointState")
    ros.node.create_subscription(kind, "joint_states", heard.append, best_effort)
    wait_until(lambda: heard)
    process.end()
    (path,) = (tmp_path / "bags").glob("*/*.mcap")
    with path.open("rb") as stream:
        channels = make_reader(stream).get_summary().channels.values()
    offered = {c.topic: yaml.safe_load(c.metadata["offered_qos_profiles"])[0] for c in channels}
    assert offered["/joint_states"]["reliability"] == "best_effort"
    assert offered["/joint_states"]["depth"] == 3
    assert offered["/pose"]["reliability"] == "reliable"


def test_parameters_tell_rqt_all_it_wants_to_know(ros):
    ros.simulator()
    names = list(read_parameters())
    answer = ros.call("/crawler/describe_parameters", "rcl_interfaces/srv/DescribeParameters", names=names)
    for name, described in zip(names, answer.descriptors, strict=True):
        row = read_parameters()[name]
        assert described.description == row.meaning
        assert described.read_only != row.runtime
        if row.range is not None:
            (bounds,) = [*described.floating_point_range, *described.integer_range]
            assert (bounds.from_value, bounds.to_value) == row.range
        for choice in row.choices:
            assert choice in described.additional_constraints
