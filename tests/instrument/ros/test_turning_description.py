"""The URDF of bodies that turn: its joints bend it as the model does, whatever tree, loop or hinge the body has."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")
from urdf_parser_py.urdf import URDF

from crawler_model import Crawler, Scene, load_scene
from crawler_model.crawler.readout import Readout
from crawler_ros.node.robot_description import describe_robot
from crawler_ros.wire.states import StationReader, joint_state_names

from ...scenes import TURNING

BODIES = {
    "chain": {
        "points": [[0.0, 0.0], [0.1, 0.02], [0.2, -0.03], [0.3, 0.0]],
        "joints": {"stiffness": 0.5},
    },
    "tree with a joint between two links that start at one point": {
        "points": [[0.0, 0.0], [0.1, 0.0], [0.15, 0.1], [0.15, -0.1], [-0.1, 0.05]],
        "links": {"stiffness": 50, "between": [[0, 1], [1, 2], [3, 1], [0, 4]]},
        "joints": {"stiffness": 0.5, "between": [[0, 1, 2], [2, 1, 3], [4, 0, 1]]},
    },
    "joints that run against the tree": {
        "points": [[0.0, 0.0], [0.1, 0.0], [0.2, 0.05], [0.3, 0.0]],
        "links": {"stiffness": 50, "between": [[1, 0], [2, 1], [2, 3]]},
        "joints": {"stiffness": 0.5, "between": [[2, 1, 0], [3, 2, 1]]},
    },
    "loop": {
        "points": [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]],
        "links": {"stiffness": 50, "between": [[0, 1], [1, 2], [2, 3], [3, 0]]},
        "joints": {"stiffness": 0.5, "between": [[0, 1, 2], [1, 2, 3]]},
    },
    "hinge without a joint": {
        "points": [[0.0, 0.0], [0.1, 0.0], [0.2, 0.05], [0.3, 0.0]],
        "links": {"stiffness": 50, "between": [[0, 1], [1, 2], [2, 3]]},
        "joints": {"stiffness": 0.5, "between": [[0, 1, 2]]},
    },
}


def build(name):
    if name in TURNING:
        return load_scene(name)
    body = {"springs": "length", "links": {"stiffness": 50}, **BODIES[name]}
    friction = {"forward": 0.1, "backward": 0.4, "left": 0.2, "right": 0.3}
    return Scene.model_validate({"name": "x", "dimension": 2, "body": body, "friction": friction})


def turned(angle):
    return np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])


def find_frames(robot: URDF, positions: dict[str, float]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Forward kinematics, as robot_state_publisher does it: the place and the axes of each frame."""
    found = {robot.get_root(): (np.zeros(3), np.eye(3))}
    while len(found) < len(robot.links):
        before = len(found)
        for joint in robot.joints:
            if joint.parent not in found or joint.child in found:
                continue
            place, axes = found[joint.parent]
            place, axes = place + axes @ np.array(joint.origin.xyz), axes @ turned(joint.origin.rpy[2])
            if joint.type == "prismatic":
                place = place + axes @ np.array(joint.axis) * positions[joint.name]
            else:
                assert joint.type in ("revolute", "continuous")
                axes = axes @ turned(joint.axis[2] * positions[joint.name])
            found[joint.child] = place, axes
        assert len(found) > before, "a frame has no parent"
    return found


@pytest.mark.parametrize("name", [*BODIES, *TURNING])
def test_the_description_bends_as_the_body_does(name):
    scene = build(name)
    body, rng = scene.body, np.random.default_rng(3)
    robot = URDF.from_xml_string(describe_robot(scene))
    names = joint_state_names(body)
    assert names[:3] == ["contact_0/x", "contact_0/y", "contact_0/yaw"]
    assert {joint.name for joint in robot.joints} <= set(names)
    revolute = [joint for joint in robot.joints if joint.type == "revolute"]
    assert all(joint.name.startswith("joint_") for joint in revolute)
    whole_turn = pytest.approx(2.0 * np.pi)  # as far as a joint may be commanded
    assert all(-joint.limit.lower == joint.limit.upper == whole_turn for joint in revolute)
    crawler, readout, reader = Crawler(scene), Readout(body, np.arange(body.contacts)), StationReader(body)
    states, contacts = np.empty((3, len(names))), np.empty((3, 2 * body.contacts))
    for _ in range(5):
        size = 0.1 * min(np.linalg.norm(body.position[b] - body.position[a]) for a, b in body.ends)
        change = rng.uniform(-1.0, 1.0, body.lengths) * np.repeat(
            [size, 0.8], [body.springs, body.lengths - body.springs]
        )
        crawler.advance(change)
        readout.read(crawler, 0.01, states, contacts)
        frames = find_frames(robot, dict(zip(names, states[0], strict=True)))
        place = body.position + crawler.displacement
        for i, expected in enumerate(place):
            np.testing.assert_allclose(frames[f"contact_{i}_frame"][0][:2], expected, atol=1e-8)
        np.testing.assert_allclose(reader.read(states[0]), crawler.displacement, atol=1e-13)
        for branch in (joint for joint in robot.joints if joint.type == "prismatic" and joint.name.startswith("link")):
            start, axes = frames[branch.parent]
            end = frames[branch.child][0]
            np.testing.assert_allclose(axes[:, 0], (end - start) / np.linalg.norm(end - start), atol=1e-9)
    assert any(link.visuals for link in robot.links)


def test_angles_that_no_joint_has_are_named_after_their_link():
    assert joint_state_names(build("hinge without a joint").body)[-1] == "link_2/yaw"
    assert joint_state_names(build("chain").body)[-1] == "joint_1"


def test_velocities_of_joint_states_are_differences_over_the_tick():
    scene = build("hinge without a joint")
    crawler, readout = Crawler(scene), Readout(scene.body, np.zeros(0, np.int64))
    before, after, nothing = np.empty((3, 8)), np.empty((3, 8)), np.empty((3, 0))
    crawler.advance([0.01, 0.0, 0.0, 0.3])
    readout.read(crawler, 0.1, before, nothing)
    crawler.advance([0.0, 0.02, 0.01, -0.4])
    readout.read(crawler, 0.1, after, nothing)
    np.testing.assert_allclose(after[1], (after[0] - before[0]) / 0.1, atol=1e-13)
    assert after[2, 2] == after[2, 7] == 0.0
