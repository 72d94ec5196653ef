"""The node `policy`: against the simulator in lock-step it walks the path of the environment, to the bit."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium")

from crawler_lab.gym import CrawlerEnv
from crawler_lab.gym.policy import load_policy
from crawler_model import CrawlerError

POLICY = """
import numpy as np

calls = 0

def lively(observation, actions={actions}):
    global calls
    calls += 1
    phase = 0.7 * calls + np.arange(actions)
    return np.sin(phase + 50.0 * observation.sum()) * 0.8 + 0.2 * np.cos(phase)

def wrong(observation):
    return np.zeros(7)

number = 3
"""
STEPS = 60


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Write a policy of so many actions to a module that processes started from here find."""
    paths = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    monkeypatch.syspath_prepend(str(tmp_path))

    def write(actions: int) -> str:
        name = f"policy_of_{actions}_{abs(hash(tmp_path)) % 10**6}"
        (tmp_path / f"{name}.py").write_text(POLICY.format(actions=actions))
        return name

    return write


@pytest.mark.parametrize(
    ("scene", "actions", "settings"),
    [
        ("two_anchor_a", 3, "{task: speed, rate: 30.0}"),
        pytest.param("three_contacts_one_way", 2, "{}", marks=pytest.mark.slow),
        pytest.param("hybrid_body", 2, "{rate: 50.0}", marks=pytest.mark.slow),
        pytest.param("planar_three_points", 6, "{direction: 0.3}", marks=pytest.mark.slow),
    ],
)
def test_its_path_is_that_of_the_environment(tmp_path, module, scene, actions, settings):
    pytest.importorskip("rclpy")
    import yaml

    from ...instrument.ros.graph import graph, seconds
    from ...processes import wait_until

    given = yaml.safe_load(settings)
    task = given.pop("task", "translation")
    env = CrawlerEnv(scene, task, **given)
    assert env.action_space.shape == (actions,)
    rate = float(env.spec_of_crawler.rate)
    name = module(actions)
    with graph(tmp_path) as ros:
        ros.simulator("lock_step:=true", f"scene:={scene}", f"rate:={rate}")
        words = (f"policy:={name}:lively", f"scene:={scene}", f"task:={task}", f"steps:={STEPS}")
        others = yaml.safe_dump(given, default_flow_style=True).strip()
        node = ros.start("crawler_lab.gym.policy_node", *words, f'settings:="{others}"')
        wait_until(lambda: node.process.poll() is not None, what="the end of the policy")
        assert node.process.returncode == 0, node.said
        assert f"done after {STEPS} steps" in node.said
        wait_until(lambda: seconds(ros.heard["joint_states"][-1]) >= (STEPS - 0.5) / rate, what="the last state")
        heard = {
            round(seconds(s) * rate): np.array([s.position, s.velocity, s.effort]) for s in ros.heard["joint_states"]
        }
    assert set(heard) == set(range(STEPS + 1))
    policy = load_policy(f"{name}:lively")
    observation, _ = env.reset(seed=0)
    lived = env.lanes.log[0]
    for _ in range(STEPS):
        observation, *_ = env.step(policy(observation))
    columns, size = env.spec_of_crawler.scene.columns.count, heard[0].size
    for step in range(STEPS + 1):
        assert np.array_equal(lived[step, columns : columns + size].reshape(3, -1), heard[step])
    assert np.ptp([state[0, 0] for state in heard.values()]) > 0.0


def test_begun_late_it_goes_on_from_the_command_in_force(tmp_path, module):
    """A simulator in lock-step is silent until a command arrives; settings of training may randomise its scene."""
    pytest.importorskip("rclpy")
    from std_msgs.msg import Float64MultiArray

    from ...instrument.ros.graph import graph
    from ...processes import wait_until

    def lengths() -> list[float]:
        return [point.positions[0] for message in list(ros.heard["applied_commands"]) for point in message.points]

    with graph(tmp_path) as ros:
        ros.simulator("lock_step:=true", "rate:=20.0", hear=("joint_states", "applied_commands"))
        ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.1, 0.1]))
        wait_until(lambda: lengths()[-1:] == [0.1], what="the command")
        node = ros.start(
            "crawler_lab.gym.policy_node",
            f"policy:={module(2)}:lively",
            "steps:=3",
            'settings:="{randomise: {friction: [0.8, 1.2], delay: 2, noise: 0.1}}"',
        )
        wait_until(lambda: node.process.poll() is not None, what="the end of the policy")
        assert node.process.returncode == 0, node.said
        wait_until(lambda: len(lengths()) == 4, what="the commands of the policy")
    largest = CrawlerEnv().spec_of_crawler.actions.limits[0].max()
    assert 0.0 < np.abs(np.diff(lengths())).max() <= largest + 1e-12


def run_wrong(folder: Path, *words: str) -> tuple[int, str]:
    import subprocess

    from ...instrument.ros.graph import environment, node_command

    done = subprocess.run(
        node_command("crawler_lab.gym.policy_node", *words),
        env=environment(),
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
    )
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("policy: ")]
    return done.returncode, line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        pytest.param(
            ("policy:=nowhere:policy",),
            "policy: 'nowhere:policy'; there is no module 'nowhere' here",
            marks=pytest.mark.slow,
        ),
        (
            ("policy:=math:sin", 'settings:="{colour: red}"'),
            "settings: unknown setting 'colour'; the settings are direction",
        ),
        pytest.param(("policy:=math:sin", "task:=fly"), "task: unknown task 'fly'", marks=pytest.mark.slow),
    ],
)
def test_what_cannot_be_run_is_one_clear_line(tmp_path, words, said):
    pytest.importorskip("rclpy")
    status, line = run_wrong(tmp_path, *words)
    assert status == 1
    assert said in line


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("walk", "policy: 'walk'; it must be module:function, or the path of an .onnx file"),
        ("math:walk", "policy: 'math:walk'; math has no function 'walk'"),
        ("nowhere:walk", "there is no module 'nowhere' here"),
    ],
)
def test_a_policy_that_does_not_exist_is_one_clear_line(name, said):
    with pytest.raises(CrawlerError) as error:
        load_policy(name)
    assert said in str(error.value)


def test_a_number_is_no_policy(module):
    name = module(2)
    with pytest.raises(CrawlerError, match=f"{name} has no function 'number'"):
        load_policy(f"{name}:number")


def test_an_onnx_file_is_a_policy(tmp_path):
    pytest.importorskip("onnxruntime")
    onnx = pytest.importorskip("onnx")
    helper = onnx.helper
    node = helper.make_node("Gemm", ["seen", "weight", "bias"], ["action"])
    weight = np.arange(16.0, dtype=np.float32).reshape(8, 2) / 10.0
    entries = [
        onnx.numpy_helper.from_array(weight, "weight"),
        onnx.numpy_helper.from_array(np.float32([0.1, -0.2]), "bias"),
    ]
    kind = onnx.TensorProto.FLOAT
    seen, action = (helper.make_tensor_value_info(n, kind, s) for n, s in (("seen", [1, 8]), ("action", [1, 2])))
    onnx.save(helper.make_model(helper.make_graph([node], "policy", [seen], [action], entries)), tmp_path / "p.onnx")
    observation = np.linspace(-1.0, 1.0, 8)
    policy = load_policy(str(tmp_path / "p.onnx"))
    assert policy(observation) == pytest.approx(observation @ weight + [0.1, -0.2], abs=1e-6)
    with pytest.raises(CrawlerError, match=r"p\.onnx: .* Got: 11 Expected: 8"):  # trained in another scene
        policy(np.ones(11))
