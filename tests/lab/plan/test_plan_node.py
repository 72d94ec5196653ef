"""The node follows a path with a robot whose friction it does not know, and repeats to the bit in lock-step."""

from __future__ import annotations

import re

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy")

from crawler_lab.plan.tracker import read_path
from crawler_model import CommandError, load_scene

from ...instrument.ros.graph import graph, seconds
from ...processes import wait_until

NODE = "crawler_lab.plan.plan_node"
SPEED = 0.05
ESTIMATED = re.compile(r"friction forward (\S+), backward \S+ of the scene's")


def follow(folder, simulator: tuple[str, ...], controller: tuple[str, ...]) -> tuple[str, np.ndarray]:
    """Follow a path until the controller ends; return what it said, and time and net translation of all states."""
    folder.mkdir()
    with graph(folder) as ros:
        ros.simulator(*simulator, hear=("pose",))
        process = ros.start(NODE, *controller)
        wait_until(lambda: process.process.poll() is not None, what="the end of the controller")
        assert process.process.returncode == 0, process.said
        ros.ticked(round(100.0 * float(re.findall(r"done at (\S+) s", process.said)[-1])), "pose")
        states = {seconds(message): message.pose.position.x for message in ros.heard["pose"]}
        return process.said, np.array(sorted(states.items()))


@pytest.fixture
def slippery(tmp_path):
    """The scene three_contacts_one_way with less friction."""
    document = load_scene("three_contacts_one_way").document()
    document["friction"] = {side: 0.7 * value for side, value in document["friction"].items()}
    file = tmp_path / "slippery.yaml"
    file.write_text(yaml.safe_dump(document))
    return file


@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_it_follows_with_other_friction_and_repeats_to_the_bit(tmp_path, slippery, delay):
    of_simulator = (f"scene:={slippery}", "lock_step:=true", f"sensors.delay:={delay}")
    measured = ("measured:=true", f"delay:={delay}") if delay else ()
    of_controller = ("lock_step:=true", f"speed:={SPEED}", "duration:=3.0", *measured)
    (said, run), (_, again) = (follow(tmp_path / name, of_simulator, of_controller) for name in ("first", "again"))
    assert float(ESTIMATED.search(said)[1]) == pytest.approx(0.7, rel=0.02)
    late = run[(run[:, 0] > 1.0) & (np.round(run[:, 0] * 100) % 5 == 0)]
    assert np.sqrt(np.mean(np.square(late[:, 1] - SPEED * late[:, 0]))) < 0.001
    count = round(3.0 * 100)  # what is after its end depends on who hears it
    assert np.array_equal(run[:count], again[:count])


def test_it_follows_a_path_of_waypoints_in_real_time(tmp_path):
    path = ("path:=[0.0, 0.0, 1.0, 0.05, 2.0, 0.05]", "duration:=2.0")
    slowly = ("scene:=three_contacts_one_way", "real_time_factor:=0.25")  # a busy machine, too, plans in time
    _, run = follow(tmp_path / "run", slowly, path)
    assert run[-1, 1] == pytest.approx(0.05, abs=0.02)


@pytest.mark.parametrize(
    ("parameter", "text"),
    [
        (
            "scene:=planar_rectilinear",
            "plan: scene: planar_rectilinear is in the plane; plans are made for bodies that turn",
        ),
        ("path:=[0.0, 0.0, 2.0]", "plan: path: [0.0, 0.0, 2.0]; it must be times (s) and places (m) in turn"),
        ("rate:=0.0", "plan: "),
    ],
)
def test_a_mistake_is_one_line(tmp_path, parameter, text):
    with graph(tmp_path) as ros:
        process = ros.start(NODE, parameter)
        assert process.process.wait(200) == 1
        (line,) = [line for line in process.said.splitlines() if "compiling" not in line]
        assert line.startswith(text)


def test_times_of_a_path_increase():
    with pytest.raises(CommandError, match=re.escape("its times are [0.0, 0.0] s; they must increase from 0")):
        read_path(0.0, [0.0, 0.0, 0.0, 1.0])
    assert read_path(0.0, [0.0, 0.0, 2.0, 1.0])(np.array([1.0, 5.0])).tolist() == [[0.5], [1.0]]


def test_a_path_of_bodies_that_turn_has_poses():
    poses = read_path(0.0, [0.0, 0.0, 0.0, 0.0, 2.0, 1.0, 0.4, 0.2], turns=True)
    assert poses(np.array([1.0, 5.0])).tolist() == [[0.5, 0.2, 0.1], [1.0, 0.4, 0.2]]
    assert read_path(0.1, [0.0, 0.0], turns=True)(np.array([2.0])).tolist() == [[0.2, 0.0, 0.0]]
    with pytest.raises(
        CommandError, match=re.escape("path: [0.0, 0.0, 2.0, 1.0, 0.1]; it must be times (s) and x (m)")
    ):
        read_path(0.0, [0.0, 0.0, 2.0, 1.0, 0.1], turns=True)


def test_a_body_that_turns_follows_poses_in_lock_step_to_the_bit(tmp_path):
    path = "path:=[0.0, 0.0, 0.0, 0.0, 10.0, 1.0, 0.04, 0.08]"
    of_controller = ("scene:=steering_inchworm", path, "stroke:=0.3", "rate:=4.0", "horizon:=8", "duration:=3.0")
    runs = [
        follow(tmp_path / name, ("scene:=steering_inchworm", "lock_step:=true"), (*of_controller, "lock_step:=true"))
        for name in ("first", "again")
    ]
    (said, run), (_, again) = runs
    assert float(re.search(r"done at 3 s.* yaw (\S+) rad: error", said)[1]) == pytest.approx(0.024, abs=0.02)
    assert run[run[:, 0] == 3.0][0, 1] == pytest.approx(0.3, abs=0.01)
    assert np.array_equal(run[:300], again[:300])
