"""The robot description: a URDF of a scene's body, so that robot_state_publisher, RViz and Foxglove show it.

Contacts are boxes on the ground. The joint `contact_0` moves the root along the ground, and the joint of a link or
segment moves every other station; all joints are named as in joint_states, and prismatic unless the body turns. A URDF
is a tree: a link that closes a loop of the body has no joint in it, and its elongation follows from the other joints.

Each link of a body that turns has a frame at its start, whose x axis is the link: a revolute joint turns it from the
frame of the link before it, and a prismatic joint moves the point at its end along it.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np

from crawler_model import CrawlerError, Scene, load_scene
from crawler_model.body.body import Body
from crawler_model.body.names import name_joints
from crawler_model.body.turning_tree import TurningTree

from ..wire.states import first_stations, free_angle_names, station_names, tree_of_joints

_CONTACT_COLOUR = "0.16 0.47 0.71 1"
_BODY_COLOUR = "0.55 0.55 0.58 1"
_REACH = 1e3
"""Limits of the prismatic joints in body lengths; URDF requires limits, and nothing enforces them."""
_TURN = 2.0 * np.pi
"""Limits of the revolute joints, and so of commanded angles [rad]."""
_EFFORT = 1e9
"""Limit of the force of joints without limits of tension [N]."""
_HARDWARE = "joint_state_topic_hardware_interface/JointStateTopicSystem"


def describe_robot(
    scene: Scene, world: str = "world", topics: tuple[str, str] = ("/joint_commands", "/joint_states")
) -> str:
    """Build the URDF of a scene's body, with a `ros2_control` tag for hardware that is based on topics.

    Args:
        scene: the scene.
        world: name of the fixed frame, the root of the tree.
        topics: on which the hardware sends its commands and receives the states.

    Returns:
        The XML text.
    """
    body = scene.body
    planar = body.dimension == 2
    place = np.zeros((body.stations.size, 3))
    place[:, : body.dimension] = body.position[body.stations].reshape(body.stations.size, -1)
    stations, joints = station_names(body), name_joints(body)
    span = float(np.abs(place - place[0]).max()) or 1.0
    size = 0.3 * _least_distance(place, body.joints)
    robot = ET.Element("robot", name=scene.name)
    for name, colour in (("contact", _CONTACT_COLOUR), ("body", _BODY_COLOUR)):
        ET.SubElement(ET.SubElement(robot, "material", name=name), "color", rgba=colour)
    ET.SubElement(robot, "link", name=world)
    frames = [f"{station}_frame" for station in stations]
    links = [ET.SubElement(robot, "link", name=frame) for frame in frames]
    for link in links:
        _add_box(link, (size, size, size), (0.0, 0.0, 0.5 * size), "contact")
    _add_joints(robot, stations[0], world, frames[0], place[0], 1.0, (_REACH * span, _EFFORT), planar)
    if body.turning is not None:
        _add_turning(robot, TurningTree(body), joints, frames, (_REACH * span, size))
        return _write(robot, scene, topics)
    efforts = _largest_efforts(body)
    for known, new, joint, sign in tree_of_joints(body):
        offset, limits = place[new] - place[known], (_REACH * span, efforts.get(joint, _EFFORT))
        _add_joints(robot, joints[joint], frames[known], frames[new], offset, sign, limits, planar)
        _add_rod(links[known], offset, size)
    for new, known in enumerate(first_stations(body).tolist()):
        if known != new:
            names = (f"{stations[new]}_fixed", "fixed"), (frames[known], frames[new])
            _add_joint(robot, *names, (np.zeros(3), 0.0), (1.0, 0.0, 0.0))
    return _write(robot, scene, topics)


def _write(robot: ET.Element, scene: Scene, topics: tuple[str, str]) -> str:
    """Add what controls the joints, and write the text."""
    control = ET.SubElement(robot, "ros2_control", name=scene.name, type="system")
    hardware = ET.SubElement(control, "hardware")
    ET.SubElement(hardware, "plugin").text = _HARDWARE
    parameters = {
        "joint_commands_topic": topics[0],
        "joint_states_topic": topics[1],
        # commands near the positions would not be sent; but where friction holds, these are not the lengths commanded
        "trigger_joint_command_threshold": "-1",
    }
    for name, value in parameters.items():
        ET.SubElement(hardware, "param", name=name).text = value
    columns, row = scene.columns, scene.drive.rows[0]
    commanded = {name: row[places[0]] for name, places in columns.aliases.items() if places[0] < columns.lengths}
    # only joints with commands: positions and names of its messages would not match otherwise
    for name in [joint.get("name", "") for joint in robot.iterfind("joint")]:
        if name in commanded:
            joint = ET.SubElement(control, "joint", name=name)
            command = ET.SubElement(joint, "command_interface", name="position")
            ET.SubElement(command, "param", name="initial_value").text = repr(float(commanded[name]))
            for interface in ("position", "velocity", "effort"):
                ET.SubElement(joint, "state_interface", name=interface)
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _add_turning(
    robot: ET.Element, tree: TurningTree, names: list[str], frames: list[str], sizes: tuple[float, float]
) -> None:
    """Add the links of a body that turns.

    Args:
        robot: the robot, with the frames of the points.
        tree: the tree of the body.
        names: of links, then of joints.
        frames: of the points.
        sizes: reach of prismatic joints and size of a contact [m].
    """
    springs, free = len(names) - tree.joints, iter(free_angle_names(tree))
    for branch in tree.branches:
        start, name = f"{names[branch.link]}_frame", names[branch.link]
        rod = ET.SubElement(robot, "link", name=start)
        _add_rod(rod, np.array([branch.length, 0.0, 0.0]), sizes[1])
        parent = frames[branch.start]
        if branch.before >= 0 and tree.branches[branch.before].start == branch.start:  # its end has another frame
            parent = f"{names[tree.branches[branch.before].link]}_frame"
        if branch.joint < 0:
            kind, limits = (next(free), "continuous"), dict[str, str]()
        else:
            kind, limits = (names[springs + branch.joint], "revolute"), {"lower": _text(-_TURN), "upper": _text(_TURN)}
        turn = np.zeros(3), branch.heading
        joint = _add_joint(robot, kind, (parent, start), turn, (0.0, 0.0, branch.sign))
        ET.SubElement(joint, "limit", {**limits, "effort": _text(_EFFORT), "velocity": "1e9"})
        along = (branch.length, 0.0, 0.0), 0.0
        joint = _add_joint(robot, (name, "prismatic"), (start, frames[branch.end]), along, (1.0, 0.0, 0.0))
        _add_limits(joint, sizes[0], _EFFORT)


def _add_joint(
    robot: ET.Element,
    kind: tuple[str, str],
    frames: tuple[str, str],
    origin: tuple[Iterable[float], float],
    axis: tuple[float, float, float],
) -> ET.Element:
    """Add a joint of a name and a type between a parent and a child, at a place and an angle about z in the parent."""
    joint = ET.SubElement(robot, "joint", name=kind[0], type=kind[1])
    ET.SubElement(joint, "parent", link=frames[0])
    ET.SubElement(joint, "child", link=frames[1])
    ET.SubElement(joint, "origin", xyz=_text(*origin[0]), rpy=_text(0.0, 0.0, origin[1]))
    ET.SubElement(joint, "axis", xyz=_text(*axis))
    return joint


def _add_limits(joint: ET.Element, reach: float, effort: float) -> None:
    ET.SubElement(joint, "limit", lower=_text(-reach), upper=_text(reach), effort=_text(effort), velocity="1e9")


def _largest_efforts(body: Body) -> dict[int, float]:
    """Find the largest forces of the actuators that have limits of tension.

    A URDF has one limit for both directions: the larger of both limits, or the only one; a tendon that is slack below
    0 N and has no largest tension has none.

    Args:
        body: the body.

    Returns:
        The force by joint [N].
    """
    bends = {bend.spring: bend for bend in body.bends}
    springs = [*body.link_springs.tolist(), *(segment.first_spring for segment in body.segments)]
    sizes = {k: np.abs(bends[springs[k]].limits) for k in body.joint_limits.index.tolist()}
    efforts = {k: float(size[np.isfinite(size)].max()) for k, size in sizes.items()}
    return {k: effort for k, effort in efforts.items() if effort > 0.0}


def _least_distance(place: np.ndarray, joints: np.ndarray) -> float:
    """Return the shortest reference length of a joint [m]; 1 when there are no joints."""
    lengths = np.linalg.norm(place[joints[:, 1]] - place[joints[:, 0]], axis=1)
    return float(lengths.min(initial=np.inf)) if lengths.size else 1.0


def _text(*numbers: float) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)


def _add_box(
    link: ET.Element,
    size: tuple[float, ...],
    centre: tuple[float, ...],
    material: str,
    turn: tuple[float, ...] = (0.0, 0.0, 0.0),
) -> None:
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=_text(*centre), rpy=_text(*turn))
    ET.SubElement(ET.SubElement(visual, "geometry"), "box", size=_text(*size))
    ET.SubElement(visual, "material", name=material)


def _add_rod(link: ET.Element, offset: np.ndarray, size: float) -> None:
    """Draw the body between two stations at its reference length, as a rod that starts at the first."""
    length = float(np.linalg.norm(offset))
    x, y, _ = 0.5 * offset
    heading = float(np.arctan2(offset[1], offset[0]))
    _add_box(link, (length, 0.4 * size, 0.4 * size), (x, y, 0.5 * size), "body", (0.0, 0.0, heading))


def _add_joints(
    robot: ET.Element,
    name: str,
    parent: str,
    child: str,
    offset: np.ndarray,
    sign: float,
    limits: tuple[float, float],
    planar: bool,
) -> None:
    """Join two frames by one prismatic joint, in the plane by one along x and one along y; limits [m], [N]."""
    axes = (
        [(name, (sign, 0.0, 0.0))] if not planar else [(f"{name}/x", (sign, 0.0, 0.0)), (f"{name}/y", (0.0, sign, 0.0))]
    )
    for i, (joint_name, axis) in enumerate(axes):
        last = i == len(axes) - 1
        to = child if last else f"{child}_x"
        if not last:
            ET.SubElement(robot, "link", name=to)
        place = offset if i == 0 else np.zeros(3)
        joint = _add_joint(robot, (joint_name, "prismatic"), (parent, to), (place, 0.0), axis)
        _add_limits(joint, *limits)
        parent = to


if __name__ == "__main__":  # for launch files: python3 -m crawler_ros.node.robot_description SCENE
    try:
        print(describe_robot(load_scene(sys.argv[1])))
    except CrawlerError as error:
        sys.exit(f"robot_description: {error}")
