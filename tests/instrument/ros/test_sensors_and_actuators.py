"""Measured topics and imperfect actuators of a running simulator, and what replay makes of their recording."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")
import yaml
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from std_msgs.msg import Float64MultiArray

from crawler_model import load_scene
from crawler_ros.replay.analysis import analyse

from ...processes import wait_until
from .graph import Graph, seconds

SCENE, LENGTHS = "three_contacts_two_ways", "actuation_controller/commands"
SENSORS = {
    "noise": 1e-4,
    "force_noise": 0.01,
    "drift": 1e-3,
    "pixel": 2e-4,
    "delay": 0.05,
    "rate": 30.0,
    "dropped": 0.1,
}


def walk(ros: Graph, ticks: int) -> None:
    """Command so many ticks in lock-step."""
    first = len(ros.heard["joint_states"])
    for k in range(ticks):
        ros.publish(LENGTHS, Float64MultiArray(data=[0.1 * np.sin(0.1 * k), 0.1 * np.sin(0.1 * k + 1.0)]))
        if k % 100 == 99 or k == ticks - 1:
            wait_until(lambda: len(ros.heard["joint_states"]) >= first + k + 1, what="the states")  # noqa: B023


def scene_with(tmp_path, **sensors) -> str:
    path = tmp_path / "sensing.yaml"
    path.write_text(yaml.safe_dump(load_scene(SCENE).document() | {"sensors": sensors}))
    return str(path)


def test_measured_states_are_recorded_and_replay_creates_them_again(ros, tmp_path):
    hear = ("joint_states", "measured/joint_states", "measured/pose", "pose")
    bags = tmp_path / "bags"
    scene = scene_with(tmp_path, **SENSORS)
    process = ros.simulator(f"scene:={scene}", "lock_step:=true", "sensors.seed:=5", f"record:={bags}", hear=hear)
    walk(ros, 150)
    assert ros.call("/crawler/reset", "std_srvs/srv/Trigger").success
    walk(ros, 150)
    ros.taken_up()
    process.end()
    # the start may have come twice
    measured, poses = (ros.heard[f"measured/{name}"][-2 * 151 :] for name in ("joint_states", "pose"))
    assert [seconds(m) for m in measured] == [seconds(m) for m in poses]
    true = {seconds(m): m for m in ros.heard["joint_states"]}
    apart = np.array([np.subtract(m.position, true[seconds(m)].position) for m in measured])
    assert 0.0 < np.abs(apart).max() < 0.01
    (folder,) = bags.iterdir()
    found = analyse(folder)
    assert found.topics["/measured/joint_states"].count == len(measured) == 2 * 151
    assert len({seconds(m) for m in measured}) == pytest.approx(0.9 * 45, abs=15)  # in both runs together
    assert found.comparison.identical
    other = scene_with(tmp_path, **SENSORS | {"noise": 2e-4})
    compared = analyse(folder, scene=load_scene(other)).comparison
    assert not compared.identical
    assert compared.first_where.startswith("measured/")


def test_in_lock_step_each_tick_is_answered_by_the_last_measurement(ros):
    """So that a controller can wait for it; parameters alone turn the sensors on."""
    hear = ("measured/joint_states", "measured/pose")
    ros.simulator(f"scene:={SCENE}", "lock_step:=true", "sensors.delay:=0.025", "sensors.rate:=20.0", hear=hear)
    measured = ros.heard["measured/joint_states"]
    wait_until(lambda: measured, what="the start, also for who comes late")
    for k in range(20):
        before = len(measured)
        ros.publish(LENGTHS, Float64MultiArray(data=[0.01 * k, 0.0]))
        wait_until(lambda: len(measured) > before, what="an answer")  # noqa: B023
    ticks = measured[-20:]
    assert [round(100.0 * seconds(m)) for m in ticks] == [0] * 7 + [5] * 5 + [10] * 5 + [15] * 3


def test_a_record_that_ends_before_the_first_measurement_arrives_is_simulated_again(ros, tmp_path):
    bags = tmp_path / "bags"
    parameters = "lock_step:=true", "sensors.delay:=1.0", f"record:={bags}"
    process = ros.simulator(f"scene:={SCENE}", *parameters, hear=("joint_states",))
    walk(ros, 3)
    ros.taken_up()
    process.end()
    (folder,) = bags.iterdir()
    compared = analyse(folder).comparison
    assert compared.identical
    assert compared.resets == 0


def test_a_negative_parameter_is_refused(ros):
    process = ros.start("crawler_ros.node.simulator", f"scene:={SCENE}", "sensors.delay:=-0.5")
    assert process.wait() == 1
    assert "parameter sensors.delay: -0.5; it must be at least 0" in process.said


def test_without_sensors_there_are_no_measured_topics(ros):
    ros.simulator(f"scene:={SCENE}")
    assert not [name for name, _ in ros.node.get_topic_names_and_types() if "measured" in name]


def test_limited_actuators_are_in_the_ledger_and_one_can_stick_at_run_time(ros, tmp_path):
    bags = tmp_path / "bags"
    hear = ("joint_states", "applied_commands")
    process = ros.simulator(f"scene:={SCENE}", "lock_step:=true", "actuators.rate:=1.0", f"record:={bags}", hear=hear)
    for _ in range(5):
        ros.publish(LENGTHS, Float64MultiArray(data=[0.03, 0.1]))
    wait_until(lambda: len(ros.heard["applied_commands"]) >= 5, what="five ticks")
    stuck = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="link_1")
    wrong = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="link_9")
    kind = "rcl_interfaces/srv/SetParameters"
    answer = ros.call("/crawler/set_parameters", kind, parameters=[Parameter(name="actuators.frozen", value=wrong)])
    assert not answer.results[0].successful
    assert "'link_9'; the actuators are link_0, link_1" in answer.results[0].reason
    answer = ros.call("/crawler/set_parameters", kind, parameters=[Parameter(name="actuators.frozen", value=stuck)])
    assert answer.results[0].successful
    for _ in range(5):
        ros.publish(LENGTHS, Float64MultiArray(data=[0.0, 0.1]))
    wait_until(lambda: len(ros.heard["applied_commands"]) >= 10, what="ten ticks")
    applied = np.array([list(m.points[-1].positions[:2]) for m in ros.heard["applied_commands"] if m.points])
    assert applied[:5] == pytest.approx(0.01 * np.array([[1, 1], [2, 2], [3, 3], [3, 4], [3, 5]]))
    assert applied[5:] == pytest.approx(0.01 * np.array([[2, 5], [1, 5], [0, 5]]))
    process.end()
    (folder,) = bags.iterdir()
    assert analyse(folder).comparison.identical


def test_an_unknown_actuator_ends_the_start_in_a_line(ros):
    process = ros.start("crawler_ros.node.simulator", f"scene:={SCENE}", "actuators.frozen:=link_5")
    assert process.wait() == 1
    assert "actuators.frozen: 'link_5'; the actuators are link_0, link_1" in process.said
