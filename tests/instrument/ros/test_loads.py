"""Loads over topics: commanded, recorded, simulated again to the bit, accounted for, and refused when nothing holds them."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")
from std_msgs.msg import Float64MultiArray

from crawler_model import Crawler, load_scene
from crawler_ros.replay import analyse

from ...processes import wait_until
from .machine import value
from .test_lock_step import ticks
from .test_nodes import trajectory

SCENE = """
name: tow
body: {contacts: [0.0, 1.0, 2.0], links: {stiffness: [1.0, 2.0]}, weights: [0.5, 0.3, 0.2]}
friction: {coefficient: {forward: 0.4, backward: 1.5}}
ground: {slope: 6.0}
loads: 0.0
"""
LOADS, LENGTHS = "load_controller/commands", "actuation_controller/commands"


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "tow.yaml"
    path.write_text(SCENE)
    return path


def test_commanded_loads_are_recorded_and_simulated_again_to_the_bit(ros, scene, tmp_path):
    simulator = ros.simulator(
        f"scene:={scene}", "lock_step:=true", f"record:={tmp_path / 'bags'}", hear=("joint_states", "applied_commands")
    )
    rng = np.random.default_rng(14)
    alone = Crawler(load_scene(scene))
    work = 0.0
    for k in range(20):
        length, load = rng.uniform(-2.0, 2.0, 2), rng.uniform(-0.1, 0.05, 3)
        names = ["link_0", "link_1", "contact_0/load", "contact_1/load", "contact_2/load"]
        ros.publish("joint_trajectory", trajectory(names, (0.0, [*length, *load])))
        ros.ticked(k + 1)
        work += alone.advance(length, loads=load).loads_work
        assert list(ros.heard["joint_states"][-1].effort)[1:] == pytest.approx(alone.tension, abs=1e-14)
    assert simulator.end() == 0
    (path,) = (tmp_path / "bags").iterdir()
    found = analyse(path)
    assert found.problems == ()
    assert found.comparison.identical
    assert found.comparison.ticks >= 20
    assert ros.heard["applied_commands"][-1].joint_names[-3:] == ["contact_0/load", "contact_1/load", "contact_2/load"]
    assert abs(work) > 1e-3
    assert found.energy.loads_work == pytest.approx(work, abs=1e-12)
    assert found.energy.residual < 1e-12


def test_loads_of_an_array_go_with_the_next_actuation(ros, scene):
    ros.simulator(f"scene:={scene}", "lock_step:=true", hear=("joint_states", "applied_commands"))
    ros.publish(LOADS, Float64MultiArray(data=[-0.05]))
    for turn in range(1, 200):  # the two topics have no order between them: the loads may come late
        ros.publish(LENGTHS, Float64MultiArray(data=[0.1 * turn, 0.1]))
        wait_until(lambda n=turn: len(ros.heard["applied_commands"]) == n, what=f"ledger {turn}")
        (point,) = ros.heard["applied_commands"][-1].points
        if list(point.positions)[-3:] == [-0.05] * 3:
            break
        assert list(point.positions)[-3:] == [0.0] * 3
    else:
        pytest.fail("the loads were never applied")
    wait_until(lambda: ticks(ros)[-1] == turn, what="the last state")
    alone = Crawler(load_scene(scene))
    for k in range(1, turn):
        alone.advance([0.1 * k, 0.1])
    alone.advance([0.1 * turn, 0.1], loads=[-0.05] * 3)
    assert list(ros.heard["joint_states"][-1].effort)[1:] == pytest.approx(alone.tension, abs=1e-14)


REFUSED = [
    (LOADS, Float64MultiArray(data=[0.0, 0.0]), "load command has 2 value(s)"),
    (LOADS, Float64MultiArray(data=[float("nan")]), "load command: entry 0 is nan"),
    (LOADS, Float64MultiArray(data=[5.0]), "the loads sum to 14.8955 N forward"),
    ("joint_trajectory", trajectory(["contact_1/load"], (0.0, [-9.0])), "no equilibrium"),
    ("actuation_controller/joint_trajectory", trajectory(["contact_1/load"], (0.0, [0.0])), "is a load"),
]


def test_loads_that_nothing_holds_are_refused_whole(ros, scene):
    simulator = ros.simulator(f"scene:={scene}", "lock_step:=true", hear=("joint_states", "/diagnostics"))
    for count, (name, message, text) in enumerate(REFUSED, 1):
        ros.publish(name, message)
        wait_until(lambda t=text: t in simulator.said, what=text)
        wait_until(lambda c=count: value(ros, "commands", "refused") == str(c), what=f"{count} refused")
    assert ticks(ros) == [0]
    assert not np.any(ros.heard["joint_states"][-1].position)


def test_a_scene_without_loads_says_how_to_have_them(ros):
    simulator = ros.simulator("lock_step:=true", hear=("joint_states",))
    ros.publish(LOADS, Float64MultiArray(data=[0.1]))
    wait_until(lambda: "the scene has no loads; add `loads: 0` to the scene to command loads" in simulator.said)
