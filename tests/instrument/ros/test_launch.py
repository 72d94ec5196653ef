"""The launch files: what they name is there, and what they start runs."""

from __future__ import annotations

import ast
import inspect
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy")
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from crawler_ros.node.parameters import read_parameters
from crawler_ros.recording import bag
from crawler_ros.wire.definitions import find_ament_prefix
from crawler_ros.wire.topics import read_topics

from ...processes import wait_until
from .graph import Graph, seconds
from .launch_files import FOLDER, PACKAGE, ROOT, Started, read, start

FILES = sorted(FOLDER.glob("*.launch.xml"))
NAMES = [file.name for file in FILES]
MODULES = {
    "simulator": "crawler_ros.node.simulator",
    "gait_player": "crawler_ros.node.gait_player",
    "speed_control": "crawler_ros.examples.speed_control",
    "phase_control": "crawler_ros.examples.phase_control",
    "path_control": "crawler_ros.examples.path_control",
}
FOREIGN = {
    "rviz.launch.xml": {"robot_state_publisher", "rviz2"},
    "ros2_control.launch.xml": {"controller_manager"},
}
EXAMPLES = [
    {},
    {"controller": "phase_control", "scene": "two_anchor_a"},
    {"controller": "path_control", "scene": "steering_inchworm"},
]


def declared(executable: str) -> dict[str, object]:
    """Read a node's parameters and their defaults out of its table or its source."""
    if executable == "simulator":
        return {name: row.default for name, row in read_parameters().items()}
    module = __import__(MODULES[executable], fromlist=["main"])
    found = {}
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "declare_parameter":
            default = node.args[1]
            value = getattr(module, default.id) if isinstance(default, ast.Name) else ast.literal_eval(default)
            found[ast.literal_eval(node.args[0])] = value
    return found


def every_start() -> list[tuple[str, Started]]:
    return [
        (file.name, process)
        for file in FILES
        for values in (EXAMPLES if file.name == "controller.launch.xml" else [{}])
        for process in start(file, dict(values))
    ]


def test_the_launch_files_are_these():
    assert NAMES == [
        "controller.launch.xml",
        "ros2_control.launch.xml",
        "rviz.launch.xml",
        "simulator.launch.xml",
        "three_crawlers.launch.xml",
        "walk.launch.xml",
    ]


@pytest.mark.parametrize("file", FILES, ids=NAMES)
def test_every_variable_is_a_declared_argument_with_a_description(file):
    root = read(file)
    arguments = {a.get("name"): a for a in root.findall("arg")}
    assert all(a.get("description") and a.get("default") is not None for a in arguments.values())
    used = set(re.findall(r"\$\(var (\w+)\)", file.read_text()))
    assert used == set(arguments)


@pytest.mark.parametrize("file", FILES, ids=NAMES)
def test_every_include_exists_and_declares_what_it_is_given(file):
    includes = list(read(file).iter("include"))
    for include in includes:
        other = Path(include.get("file").replace("$(dirname)", str(file.parent)))
        assert other.parent == FOLDER
        assert {a.get("name") for a in include} <= {a.get("name") for a in read(other).findall("arg")}
    if len(includes) > 1:  # or the arguments of one would pass to the next
        assert all(group.find("include") is not None for group in read(file).findall("group"))
        assert not read(file).findall("include")


def test_every_node_parameter_is_known_and_text_alone_has_a_type():
    """A value that is none of its type would end launch with a traceback, and leave what it had started running."""
    for file, process in every_start():
        if process.package != PACKAGE:
            assert process.package in FOREIGN.get(file, set())
            continue
        known = declared(process.executable)
        assert set(process.parameters) <= set(known), process
        for name, kind in process.types.items():
            assert kind == ("str" if isinstance(known[name], str) else None), name


def test_defaults_are_the_nodes_own():
    """Starting a file without arguments gives the nodes what they would have had, unless that is its purpose."""
    purpose = {
        ("controller.launch.xml", "lock_step"),
        ("rviz.launch.xml", "publish_clock"),
        ("rviz.launch.xml", "publish.odom"),
        ("rviz.launch.xml", "publish.robot_description"),
        ("three_crawlers.launch.xml", "scene"),
    }
    for file, process in every_start():
        if process.package != PACKAGE or process.parameters.get("scene") in ("two_anchor_a", "steering_inchworm"):
            continue
        known = declared(process.executable)
        for name, text in process.parameters.items():
            if (file, name) not in purpose:
                value = text if process.types[name] == "str" else yaml.safe_load(text)
                assert value == known[name], (file, name)


def test_one_at_most_publishes_the_clock():
    for values in ({}, {"publish_clock": "true"}):
        processes = start(FOLDER / "three_crawlers.launch.xml", dict(values))
        clocks = [p.namespace for p in processes if p.parameters.get("publish_clock") == "true"]
        assert clocks == (["one_way"] if values else [])
        assert len({p.namespace for p in processes}) == 3


def test_every_executable_is_installed_in_each_way():
    tomllib = pytest.importorskip("tomllib")  # since Python 3.11

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    shared = project["tool"]["hatch"]["build"]["targets"]["wheel"]["shared-data"]
    assert shared["launch"] == "share/crawler_ros/launch"
    setup = (ROOT / "setup.py").read_text()
    assert '("share/crawler_ros/launch", sorted(glob("launch/*")))' in setup
    assert 'find_packages(include=["crawler_*", "msgs_config"])' in setup
    for name in {p.executable for _, p in every_start() if p.package == PACKAGE}:
        shim = ROOT / "resource" / "lib" / name
        assert os.access(shim, os.X_OK)
        script = "crawler-" + name.replace("_", "-")
        assert f"bin/{script}" in shim.read_text()
        where = project["project"]["scripts"][script]
        assert where.endswith(f".executables:{name}")
        assert f'"{name} = {where}"' in setup


def test_every_executable_and_launch_file_is_found_through_the_ament_index():
    from ament_index_python.packages import get_package_prefix, get_package_share_directory

    find_ament_prefix()
    prefix = Path(get_package_prefix(PACKAGE))
    for name in MODULES:
        assert os.access(prefix / "lib" / PACKAGE / name, os.X_OK), f"{name}: install the package anew"
    installed = Path(get_package_share_directory(PACKAGE)) / "launch"
    for file in FOLDER.iterdir():
        assert (installed / file.name).is_file(), f"{file.name}: install the package anew"


def test_only_rviz_needs_more_than_this_package():
    for file in FILES:
        foreign = {n.get("pkg") for n in read(file).iter("node")} - {PACKAGE}
        assert foreign == FOREIGN.get(file.name, set())


def test_rviz_shows_topics_that_there_are():
    processes = {p.executable: p for p in start(FOLDER / "rviz.launch.xml")}
    switch, path = processes["rviz2"].arguments
    assert switch == "-d"
    config = yaml.safe_load(Path(path).read_text())
    displays = config["Visualization Manager"]["Displays"]
    topics = [d[key] for d in displays for key in ("Topic", "Description Topic") if key in d]
    assert {t["Value"] for t in topics} == {"robot_description", "pose", "odom"}
    for shown in topics:
        qos = read_topics()[shown["Value"]].qos
        assert shown["Reliability Policy"].lower() == qos["reliability"]
        assert shown["Durability Policy"].lower().replace(" ", "_") == qos["durability"]
    assert config["Visualization Manager"]["Global Options"]["Fixed Frame"] == read_parameters()["frame_id"].default
    assert processes["simulator"].parameters["publish.odom"] == "true"


@pytest.mark.parametrize("path", ["three_contacts_one_way", "with a space.yaml"])
def test_the_description_for_robot_state_publisher_is_a_urdf(path, tmp_path):
    scene = path
    if path.endswith(".yaml"):
        scene = str(tmp_path / "my scenes" / path)
        Path(scene).parent.mkdir()
        shutil.copy(ROOT / "msgs_config" / "scenes" / "three_contacts_one_way.yaml", scene)
    first, *_ = start(FOLDER / "rviz.launch.xml", {"scene": scene})
    (command,) = re.findall(r"^\$\(command '(.*)' 'warn'\)$", first.parameters["robot_description"])
    python, *words = shlex.split(command)
    assert python == "python3"
    text = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    robot = ET.fromstring(text.removeprefix('<?xml version="1.0"?>'))
    assert robot.get("name") == "three_contacts_one_way"
    assert {j.get("name") for j in robot.iter("joint")} == {"contact_0", "link_0", "link_1"}


def test_what_may_not_be_there_is_started_first():
    """Where a package, an executable or a scene is missing, launch ends, and leaves what it had started running."""
    names = [p.executable for p in start(FOLDER / "rviz.launch.xml")]
    assert names == ["robot_state_publisher", "rviz2", "simulator", "gait_player"]
    names = [p.executable for p in start(FOLDER / "controller.launch.xml", {"controller": "mine"})]
    assert names == ["mine", "simulator"]


def test_a_simulator_that_ends_ends_all():
    for _, process in every_start():
        assert process.ends_all or process.executable != "simulator"


def run(ros: Graph, file: str, **values: str) -> list[Started]:
    """Start what a launch file starts, each as a process, and wait for the first state of every simulator."""
    started = sorted(start(FOLDER / file, dict(values)), key=lambda p: p.executable != "simulator")
    for process in started:
        words = [f"{name}:={text if text else repr(text)}" for name, text in process.parameters.items()]
        namespace = ("-r", f"__ns:=/{process.namespace}") if process.namespace else ()
        if process.executable == "simulator":
            names = [topic(process, name) for name in ("joint_states", "pose")]
            for name in names:
                ros.hear(name, type_name=name.split("/")[-1])
        ros.start(MODULES[process.executable], *words, arguments=namespace)
        if process.executable == "simulator":  # a controller in lock-step may be done before this listener has joined
            hear_first(ros, process, names)
    return started


def hear_first(ros: Graph, process: Started, names: list[str]) -> None:
    """Wait for the first state; in lock-step ask for it: state 0 may go out before DDS knows of this listener."""
    asked = time.monotonic()

    def heard() -> bool:
        nonlocal asked
        if process.parameters["lock_step"] == "true" and time.monotonic() > asked + 1.0:
            asked = time.monotonic()
            nothing = JointTrajectory(points=[JointTrajectoryPoint()])
            ros.publish(topic(process, "joint_trajectory"), nothing, table_name="joint_trajectory")
        return all(ros.heard[name] for name in names)

    wait_until(heard, what=f"the first of {names}")


def topic(process: Started, name: str) -> str:
    return f"/{process.namespace}/{name}" if process.namespace else f"/{name}"


def test_simulator_runs(ros):
    run(ros, "simulator.launch.xml", namespace="left", scene="two_anchor_a", rate="200")
    states = ros.heard["/left/joint_states"]
    wait_until(lambda: len(states) > 10, what="more states")
    assert list(states[0].name) == ["contact_0", "link_0"]
    assert np.median(np.diff([seconds(s) for s in states])) == pytest.approx(0.005)


def test_walk_walks(ros):
    run(ros, "walk.launch.xml", periods="2", real_time_factor="10", rate="20")
    wait_until(lambda: ros.heard["/pose"][-1].pose.position.x > 0.2, what="two periods")


def end_as_launch_does(ros: Graph, started: list[Started]) -> None:
    """Wait for the end of a process that ends all, and interrupt the others."""
    required = [p for p, s in zip(ros.processes, started, strict=True) if s.ends_all]
    assert required
    wait_until(lambda: any(p.process.poll() is not None for p in required), 120.0, "the end of what ends all")
    for process in ros.processes:
        assert process.end() == 0, process.said


def test_a_walk_of_some_periods_ends_as_a_whole(ros):
    bags = ros.folder / "bags"
    started = run(ros, "walk.launch.xml", periods="2", real_time_factor="10", record=str(bags))
    assert [s.executable for s in started if s.ends_all] == ["simulator", "gait_player"]
    end_as_launch_does(ros, started)
    (path,) = bags.iterdir()
    assert bag.examine(path).complete
    assert bag.examine(path).counts["/joint_trajectory"] == 2


def test_a_controller_that_is_done_ends_all(ros):
    started = run(ros, "controller.launch.xml", **EXAMPLES[1])
    assert [s.executable for s in started if s.ends_all] == ["simulator", "phase_control"]
    end_as_launch_does(ros, started)


@pytest.mark.parametrize("values", EXAMPLES, ids=["speed_control", "phase_control", "path_control"])
def test_controllers_control(ros, values):
    run(ros, "controller.launch.xml", **values)
    wait_until(lambda: ros.heard["/pose"][-1].pose.position.x > 0.5, what="half a metre")
    assert all(p.process.poll() in (None, 0) for p in ros.processes)


def test_three_crawlers_walk_apart(ros):
    ros.hear("/clock")
    run(ros, "three_crawlers.launch.xml", publish_clock="true", real_time_factor="5", rate="20")
    for namespace in ("one_way", "two_ways", "anchors"):
        heard = ros.heard[f"/{namespace}/pose"]
        wait_until(lambda h=heard: h[-1].pose.position.x > 0.05, what=f"a walk in {namespace}")
    assert ros.node.count_publishers("/clock") == 1
    wait_until(lambda: ros.heard["/clock"], what="the clock")
