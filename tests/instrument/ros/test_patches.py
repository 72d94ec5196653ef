"""Patches of ground over topics: jumps counted, recorded and simulated again to the bit; cliffs that end no node."""

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
name: rink
body: {contacts: [0.0, 1.0, 2.0], links: {stiffness: [1.0, 2.0]}, weights: 0.2}
friction: {forward: 0.4, backward: 1.0}
ground:
  patches:
    - {from: 0.6, to: 0.8, friction: 2.0}
    - {from: 1.25, to: 1.6, friction: 0.5, slope: 5.0}
    - {from: 2.2, to: 2.5, forward: 0.25, backward: 2.0}
    - {from: 2.5, to: 9.0, slope: -4.0}
"""
SLACK = """
name: slack
body: {contacts: [0.0, 0.5], links: {stiffness: 2.0, tension: {least: 0.0}}}
friction: {isotropic: [1.0, 0.25]}
loads: 0.0
"""
PULLING = """
name: pulling
body: {contacts: [0.0, 0.5], links: {stiffness: 2.0, tension: {least: 0.5}}}
friction: {isotropic: 1.0}
"""
CLIFF = """
name: cliff
body: {contacts: [0.0, 1.0], links: {stiffness: 1.0}, weights: 3.0}
friction: {forward: 0.4, backward: 1.0}
ground: {slope: -80.0, patches: [{from: -9.0, to: 1.25, slope: 0.0}]}
"""
LENGTHS = "actuation_controller/commands"
JUMPS, REFUSED = "jumps", "ticks refused"


def write(tmp_path, text):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    return path


def start_in_lock_step(ros, tmp_path, text):
    """Start a simulator that records, and hear what it did in each tick."""
    scene = write(tmp_path, text)
    heard = ("joint_states", "applied_commands", "/diagnostics")
    return scene, ros.simulator(f"scene:={scene}", "lock_step:=true", f"record:={tmp_path / 'bags'}", hear=heard)


def test_a_run_with_jumps_is_simulated_again_to_the_bit(ros, tmp_path):
    """Commands of two points, as a tick is followed in one call and its ramps one by one."""
    scene = write(tmp_path, SCENE)
    simulator = ros.simulator(
        f"scene:={scene}", "lock_step:=true", f"record:={tmp_path / 'bags'}", hear=("joint_states", "/diagnostics")
    )
    rng = np.random.default_rng(11)
    alone = Crawler(load_scene(scene))
    jumps = []
    for k in range(40):
        first, last = rng.uniform(-1.0, 2.5, (2, 2))
        ros.publish("joint_trajectory", trajectory(["link_0", "link_1"], (0.0, [*first]), (0.0, [*last])))
        wait_until(lambda n=k: ticks(ros)[-1] > n, what=f"the state after command {k}")
        step = alone.follow(np.array([alone.target(first), alone.target(last)]))
        jumps += step.jumps
        assert ros.heard["joint_states"][-1].position[0] == pytest.approx(alone.displacement[0], abs=1e-12)
        assert list(ros.heard["joint_states"][-1].effort)[1:] == pytest.approx(alone.tension, abs=1e-12)
    assert len(jumps) > 5
    wait_until(lambda: value(ros, "simulation", JUMPS) == str(len(jumps)), what="the jumps in the diagnostics")
    assert simulator.end() == 0
    (path,) = (tmp_path / "bags").iterdir()
    found = analyse(path)
    assert found.problems == ()
    assert found.comparison.identical
    assert found.comparison.ticks >= 40
    again = found.plain_jumps()
    assert [jump["contact"] for jump in again] == [f"contact_{jump.contact}" for jump in jumps]
    assert [jump["border"] for jump in again] == [jump.border for jump in jumps]
    assert found.energy.jump_loss == pytest.approx(sum(jump.loss for jump in jumps), abs=1e-12)
    assert found.energy.jump_loss > 1e-3
    assert found.energy.residual < 1e-12


@pytest.mark.parametrize(
    ("text", "name", "commands", "loose", "place"),
    [
        pytest.param(SLACK, "contact_1/load", (0.125, -0.5, 0.5), 1, 0.125, id="a load behind a slack tendon"),
        pytest.param(PULLING, "contact_0/forward", (0.75, 0.25, 0.5), 0, 0.0, id="a tendon that always pulls"),
    ],
)
def test_what_nothing_holds_is_refused_and_counted(ros, tmp_path, text, name, commands, loose, place):
    _, simulator = start_in_lock_step(ros, tmp_path, text)
    for k, command in enumerate(commands, 1):
        ros.publish("joint_trajectory", trajectory([name], (0.0, [command])))
        wait_until(lambda n=k: len(ros.heard["applied_commands"]) == n, what=f"tick {k}")
    wait_until(lambda: ticks(ros)[-1] == 3, what="the last state")
    assert [len(message.points) for message in ros.heard["applied_commands"]] == [1, 0, 1]
    assert ros.heard["joint_states"][-1].position[1] == pytest.approx(place, abs=1e-15)
    wait_until(lambda: value(ros, "commands", REFUSED) == "1")
    assert simulator.end() == 0
    assert f"no link that is taut holds contact {loose}" in simulator.said
    (path,) = (tmp_path / "bags").iterdir()
    found = analyse(path)
    assert found.comparison.identical
    assert found.incidents.held == 1


def test_a_cliff_stops_the_body_before_it_and_the_node_goes_on(ros, tmp_path):
    scene, simulator = start_in_lock_step(ros, tmp_path, CLIFF)
    for k, length in enumerate((0.6, 0.7, 0.7, 0.6, 0.5), 1):
        ros.publish(LENGTHS, Float64MultiArray(data=[length]))
        wait_until(lambda n=k: len(ros.heard["applied_commands"]) == n, what=f"tick {k}")
    wait_until(lambda: ticks(ros)[-1] == 5, what="the last state")
    assert [len(message.points) for message in ros.heard["applied_commands"]] == [1, 0, 0, 0, 1]
    alone = Crawler(load_scene(scene))
    alone.advance([0.6])
    alone.advance([0.5])
    assert list(ros.heard["joint_states"][-1].position) == [alone.displacement[0], alone.shape[0]]
    assert "no equilibrium, the body would run away" in simulator.said
    wait_until(lambda: value(ros, "commands", REFUSED) == "2")
    assert value(ros, "simulation", JUMPS) == "0"
    assert simulator.end() == 0
    (path,) = (tmp_path / "bags").iterdir()
    assert analyse(path).comparison.identical


def test_the_live_view_shows_the_jumps(ros, tmp_path):
    """The simulator draws to a file; the log of jumps in it has as many lines as its diagnostics count."""
    pytest.importorskip("rerun")
    from ..pictures.test_pictures import entities

    rrd = tmp_path / "live.rrd"
    simulator = ros.simulator(
        f"scene:={write(tmp_path, SCENE)}", "lock_step:=true", f"view:={rrd}", hear=("joint_states", "/diagnostics")
    )
    alone, jumps = Crawler(load_scene(tmp_path / "scene.yaml")), 0
    for k in range(12):
        length = [1.5 * (k % 2), 1.5 * (k % 2)]
        ros.publish(LENGTHS, Float64MultiArray(data=length))
        wait_until(lambda n=k: ticks(ros)[-1] == n + 1, what=f"the state after command {k}")
        jumps += len(alone.advance(length).jumps)
    assert jumps > 1
    wait_until(lambda: value(ros, "simulation", JUMPS) == str(jumps), what="the jumps in the diagnostics")
    assert simulator.end() == 0
    assert entities(rrd)["/jumps"] >= jumps - 1  # a tick between two frames waits for the next of them
