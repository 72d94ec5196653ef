"""The services of simulation_interfaces, whose messages are generated here, called by a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("rosidl_cli")

from ...processes import wait_until
from .graph import environment, graph, node_command, seconds
from .interfaces import build

PACKAGE, SCENE = "simulation_interfaces", "three_contacts_two_ways"
RESULTS = ("FEATURE_UNSUPPORTED", "OK", "NOT_FOUND", "INCORRECT_STATE", "OPERATION_FAILED")
STATES = ("STOPPED", "PLAYING", "PAUSED", "QUITTING")
FEATURES = {
    "SIMULATION_RESET": 20,
    "SIMULATION_STATE_GETTING": 24,
    "SIMULATION_STATE_SETTING": 25,
    "SIMULATION_STATE_PAUSE": 26,
    "STEP_SIMULATION_SINGLE": 31,
    "STEP_SIMULATION_MULTIPLE": 32,
}


def constants(kind: str, values: dict[str, int]) -> str:
    return "".join(f"{kind} {name} = {value}\n" for name, value in values.items())


def numbered(prefix: str, names: tuple[str, ...]) -> dict[str, int]:
    return {f"{prefix}_{name}": k for k, name in enumerate(names)}


INTERFACES = {
    "msg/Result.msg": constants("uint8", numbered("RESULT", RESULTS)) + "uint8 result\nstring error_message\n",
    "msg/SimulationState.msg": constants("uint8", numbered("STATE", STATES)) + "uint8 state\n",
    "msg/SimulatorFeatures.msg": constants("uint8", FEATURES)
    + "uint16[] features\nstring[] spawn_formats\nstring custom_info\n",
    "srv/GetSimulatorFeatures.srv": "---\nSimulatorFeatures features\n",
    "srv/GetSimulationState.srv": "---\nSimulationState state\nResult result\n",
    "srv/SetSimulationState.srv": "SimulationState state\n---\nuint8 ALREADY_IN_TARGET_STATE = 101\nResult result\n",
    "srv/ResetSimulation.srv": constants(
        "uint8", {"SCOPE_DEFAULT": 0, "SCOPE_TIME": 1, "SCOPE_STATE": 2, "SCOPE_SPAWNED": 4, "SCOPE_ALL": 255}
    )
    + "uint8 scope\n---\nResult result\n",
    "srv/StepSimulation.srv": "uint64 steps 1\n---\nResult result\n",
}

CLIENT = """
import json, sys
import rclpy
from simulation_interfaces import srv
from simulation_interfaces.msg import SimulationState
rclpy.init()
node = rclpy.create_node("client")
def call(name, service, **fields):
    kind = getattr(srv, service)
    client = node.create_client(kind, name)
    assert client.wait_for_service(120.0)
    future = client.call_async(kind.Request(**fields))
    rclpy.spin_until_future_complete(node, future)
    return future.result()
def set_state(state):
    return call("set_simulation_state", "SetSimulationState", state=SimulationState(state=state)).result.result
def reset(scope):
    return call("reset_simulation", "ResetSimulation", scope=scope).result.result
def step(count):
    return call("step_simulation", "StepSimulation", steps=count).result.result
def state():
    return call("get_simulation_state", "GetSimulationState").state.state
features = call("get_simulator_features", "GetSimulatorFeatures").features
found = {"features": list(features.features), "formats": list(features.spawn_formats)}
found["playing"] = [state(), step(1), set_state(1)]
found["paused"] = [set_state(2), state()]
found["reset"] = [reset(0), reset(1), reset(4), reset(3), reset(255)]
found["stepped"] = [step(7), state()]
print(json.dumps(found), flush=True)
input()
print(json.dumps([set_state(0), state(), set_state(0), set_state(9), set_state(1), state(), set_state(3)]), flush=True)
"""


@pytest.fixture(scope="module")
def interfaces(tmp_path_factory):
    return build(PACKAGE, INTERFACES, tmp_path_factory.mktemp("interfaces"))


def test_a_client_of_simulation_interfaces_resets_pauses_steps_and_ends_the_simulator(tmp_path, interfaces):
    with graph(tmp_path) as ros:
        ros.hear("joint_states")
        simulator = ros.run(node_command("crawler_ros.node.simulator", f"scene:={SCENE}"), **interfaces)
        wait_until(lambda: ros.heard["joint_states"], what="a state")
        client = subprocess.Popen(
            [sys.executable, "-c", CLIENT],
            env=environment(ros.domain) | interfaces,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        found = json.loads(client.stdout.readline())
        assert found == {
            "features": list(FEATURES.values()),
            "formats": [],
            "playing": [1, 3, 101],  # playing; not paused; it plays already
            "paused": [1, 2],
            "reset": [1, 0, 0, 1, 1],  # time and state only together, and nothing was spawned
            "stepped": [1, 2],
        }
        wait_until(lambda: seconds(ros.heard["joint_states"][-1]) == 0.07, what="seven ticks after the reset")
        answers, _ = client.communicate("\n")
        assert json.loads(answers) == [1, 0, 101, 2, 1, 1, 1]
        assert simulator.wait() == 0
