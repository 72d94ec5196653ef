"""The gait player: it plays every scene that has a drive, and ends with one line where nothing can come of that."""

from __future__ import annotations

import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sensor_msgs.msg import JointState

from crawler_model import gallery, load_scene
from crawler_ros.node.gait_player import list_commands
from crawler_ros.node.intake.commands import CommandQueue

from .graph import Process, wait_until
from .test_patches import CLIFF

PLANE = """{name: plane, dimension: 2, body: {contacts: [[0, 0], [1, 0]], links: {stiffness: 1}}, friction: {FRICTION},
 drive: {times: [0, 0.5, 1], period: 1, actuation: [[[0, 0]], [[2, 0]], [[0, 0]]]}}"""
DIRECTIONS = "directions: [0, 1.5708, 3.1416, 4.7124], value: [1, 1, 2, 1]"


def plane(path: Path, friction: str) -> Path:
    path.write_text(PLANE.replace("FRICTION", friction))
    return path


def player(ros, *parameters: str) -> Process:
    return ros.start("crawler_ros.node.gait_player", *parameters)


def last_words(process: Process) -> str:
    """What it ended with, in one line."""
    assert process.process.wait(200) == 1, process.said
    assert "Traceback" not in process.said
    (line,) = [text for text in process.said.splitlines() if text.startswith("gait_player: ")]
    return line


@pytest.mark.parametrize("name", gallery())
def test_what_is_sent_can_be_commanded(name):
    scene = load_scene(name)
    names, rows = list_commands(scene.drive)
    assert names
    queue = CommandQueue(scene.columns, scene.drive.rows[0])
    queue.accept_trajectory(names, [0] * len(rows), rows, 0)
    taken = queue.take_vertices(np.array([0, 10**9]))
    if len(taken.rows):
        assert taken.rows[-1].tolist() == scene.drive.rows[-1].tolist()


@pytest.mark.parametrize("scene", ["planar_rectilinear", None], ids=["gallery", "own"])
def test_friction_by_directions_is_played(ros, scene, tmp_path):
    scene = scene or plane(tmp_path / "plane.yaml", DIRECTIONS)
    ros.start("crawler_ros.node.simulator", f"scene:={scene}", "lock_step:=true")
    playing = player(ros, f"scene:={scene}", "periods:=2", "patience:=0.0")
    assert playing.process.wait(200) == 0, playing.said
    assert "period 2 of 2" in playing.said


def test_states_that_are_sparse_in_simulated_time_alone_are_enough(ros):
    ros.start("crawler_ros.node.simulator", "publish.every:=50", "real_time_factor:=2.0")
    playing = player(ros, "periods:=1", "patience:=20.0")
    assert playing.process.wait(200) == 0, playing.said
    assert "period 1 of 1" in playing.said


def test_a_state_that_comes_before_the_simulator_listens_is_enough(ros):
    """In lock-step there is no other one, and DDS may find subscriptions in any order."""
    player(ros, "scene:=two_anchor_a", "periods:=1", "patience:=0.0")
    ros.publish("joint_states", JointState(name=["contact_0", "link_0"]))
    ros.taken_up("gait_player")
    ros.hear("joint_trajectory")
    wait_until(lambda: ros.heard["joint_trajectory"], what="a trajectory")


def test_no_tick_is_asked_for_while_the_first_state_of_a_simulator_that_starts_late_may_be_on_its_way(ros):
    playing = player(ros, "patience:=0.0")

    def reports(count: int) -> None:  # one each three seconds
        wait_until(lambda: playing.said.count("waiting for joint_states") >= count, what="the wait for a simulator")

    reports(2)
    ros.hear("joint_trajectory")
    reports(4)  # twelve seconds after the start
    assert ros.heard["joint_trajectory"] == []
    wait_until(lambda: ros.heard["joint_trajectory"], what="a tick that is asked for")
    assert [list(p.positions) for p in ros.heard["joint_trajectory"][0].points] == [[]]


def test_no_more_periods_are_counted_than_were_asked_for(ros):
    """As fast as it can, simulated time passes by whole periods between two states that the player reads."""
    ros.simulator("scene:=two_anchor_a", "real_time_factor:=0.0")
    playing = player(ros, "scene:=two_anchor_a", "periods:=2")
    assert playing.process.wait(200) == 0, playing.said
    assert re.findall(r"period (\d+) of 2", playing.said)[-1] == "2"


def test_refused_commands_end_it(ros, tmp_path):
    """The joints are the same, but the simulator's friction cannot be commanded."""
    simulated, played = plane(tmp_path / "a.yaml", DIRECTIONS), plane(tmp_path / "b.yaml", "isotropic: 1")
    ros.start("crawler_ros.node.simulator", f"scene:={simulated}")
    said = last_words(player(ros, f"scene:={played}", "patience:=0.0"))
    assert "the simulator refuses the commands" in said
    assert "no joint is called 'contact_0/friction'" in said


@pytest.mark.parametrize("pace", ["lock_step:=true", "real_time_factor:=1.0"])
@pytest.mark.parametrize("times", ["[0, 0.1, 0.5], period: 0.5", "[0, 0.5, 0.55]"], ids=["periods", "once"])
def test_a_tick_that_is_refused_ends_it(ros, tmp_path, pace, times):
    """The messages are accepted: only the motion shows that the ground beyond the cliff holds nothing."""
    scene = tmp_path / "cliff.yaml"
    scene.write_text(f"{CLIFF}drive: {{times: {times}, actuation: [[0.0], [0.7], [0.0]]}}")
    ros.start("crawler_ros.node.simulator", f"scene:={scene}", pace)
    said = last_words(player(ros, f"scene:={scene}", "periods:=1", "patience:=0.0"))
    assert "the simulator refuses the commands: the commands of " in said


def test_without_diagnostics_it_ends_well_and_soon(ros):
    """Nothing tells whether the last commands were followed; in lock-step simulated time stands still meanwhile."""
    ros.start("crawler_ros.node.simulator", "lock_step:=true", "publish.diagnostics:=false")
    playing = player(ros, "periods:=1", "patience:=1.0")
    assert playing.process.wait(200) == 0, playing.said
    assert "stands still" not in playing.said


def test_without_a_simulator_it_ends(ros):
    assert "no simulator was found: start crawler-simulator" in last_words(player(ros, "patience:=1.0"))


def test_a_paused_simulator_ends_it(ros):
    ros.start("crawler_ros.node.simulator")
    playing = player(ros, "patience:=10.0")
    wait_until(lambda: "playing from" in playing.said, 200.0, "playing")
    assert ros.call("/crawler/pause", "std_srvs/srv/SetBool", data=True).success
    said = last_words(playing)
    assert "simulated time stands still at" in said
    assert "/crawler/pause" in said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_dead_simulator_ends_it(ros, number):
    simulator = ros.start("crawler_ros.node.simulator")
    playing = player(ros, "patience:=60.0")
    wait_until(lambda: "playing from" in playing.said, 200.0, "playing")
    simulator.end(number)
    assert "the simulator disappeared at simulated time" in last_words(playing)


CONTROLLERS = {
    "phase": ("crawler_ros.examples.phase_control",),
    "speed": ("crawler_ros.examples.speed_control",),
    "path": ("crawler_ros.examples.path_control", "right:=link_0"),
    "policy": ("crawler_lab.gym.policy_node", "scene:=two_anchor_a", "policy:=resting:rest"),
    "plan": ("crawler_lab.plan.plan_node", "scene:=two_anchor_a"),
}
PLAYER = ("crawler_ros.node.gait_player", "scene:=two_anchor_a", "patience:=0.0")


@pytest.fixture
def resting(tmp_path, monkeypatch):
    """A policy that can be imported."""
    (tmp_path / "resting.py").write_text("rest = lambda observation: [0.0, 0.0, 0.0]")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]))


@pytest.mark.parametrize("name", ["phase", "plan"])
def test_a_dead_simulator_ends_a_controller(ros, resting, name):
    simulator = ros.simulator("scene:=two_anchor_a", "rate:=50.0", hear=("pose", "joint_trajectory"))
    controller = ros.start(*CONTROLLERS[name])
    wait_until(lambda: ros.heard["joint_trajectory"], what="a command")
    simulator.end()
    assert controller.process.wait(200) == 1, controller.said
    assert f"{name}: the simulator disappeared at simulated time" in controller.said.replace("_control", "")


@pytest.mark.parametrize("command", [PLAYER, *CONTROLLERS.values()], ids=["player", *CONTROLLERS])
def test_a_second_simulator_ends_a_controller(ros, resting, command):
    """Their states would mix: distances jump, and each state seems to be a reset."""
    for _ in range(2):
        ros.start("crawler_ros.node.simulator", "scene:=two_anchor_a", "rate:=50.0")
    controller = ros.start(*command)
    assert controller.process.wait(200) == 1, controller.said
    assert "Traceback" not in controller.said
    name = command[0].rpartition(".")[2].removesuffix("_node")
    (line,) = [text for text in controller.said.splitlines() if text.startswith(f"{name}: ")]
    assert "simulators publish" in line
    assert "ROS_DOMAIN_ID" in line
    assert len(controller.said.splitlines()) < 20
