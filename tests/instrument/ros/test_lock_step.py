"""Lock-step: messages trigger the ticks, and nothing else does."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from crawler_model import Crawler, load_scene, simulate
from crawler_ros.replay import simulate_again

from ...processes import PATIENCE_S, cpu_seconds, wait_until
from .graph import Graph, graph, seconds

SCENE = "three_contacts_one_way"
LOCK_STEP = ("lock_step:=true", f"scene:={SCENE}")


class Loop:
    """A controller that sends a command, waits for its state, and decides on the next by what it saw."""

    def __init__(self, ros: Graph) -> None:
        self.states: list[JointState] = []
        self._arrived = threading.Condition()
        self._ros = ros
        ros.node.create_subscription(JointState, "joint_states", self._on_state, 100)

    def _on_state(self, message: JointState) -> None:
        with self._arrived:
            self.states.append(message)
            self._arrived.notify_all()

    def command(self, actuation: np.ndarray) -> JointState:
        before = seconds(self.states[-1])
        self._ros.publish("actuation_controller/commands", Float64MultiArray(data=actuation.tolist()))
        with self._arrived:
            assert self._arrived.wait_for(lambda: seconds(self.states[-1]) > before, PATIENCE_S)
            return self.states[-1]


def act(state: JointState) -> np.ndarray:
    """Do something that depends on every digit of what was seen."""
    z = np.array(state.position)[1:]
    return np.array([0.05, -0.03]) + 0.4 * np.sin(40.0 * z[::-1]) + 0.1 * np.sin(state.position[0])


def close_the_loop(ros: Graph, ticks: int = 60) -> np.ndarray:
    loop = Loop(ros)
    wait_until(lambda: loop.states, what="state 0")
    for _ in range(ticks):
        loop.command(act(loop.states[-1]))
    states = unrepeated(loop.states)
    np.testing.assert_allclose([seconds(s) for s in states], np.arange(ticks + 1) / 100.0, atol=1e-12)
    return np.array([s.position for s in states])


def unrepeated(states: list[JointState]) -> list[JointState]:
    """Leave out state 0 as it was repeated for whoever came."""
    first = max(i for i, s in enumerate(states) if seconds(s) == 0.0)
    return states[first:]


def ticks(ros: Graph) -> list[int]:
    return [round(100 * seconds(s)) for s in unrepeated(ros.heard["joint_states"])]


def write_loose(path: Path) -> Path:
    """Write a scene whose springs have hysteresis and whose actuators have backlash."""
    document = load_scene("rubber_worm").document()
    body = document["body"] | {"links": document["body"]["links"] | {"backlash": 0.02}}
    path.write_text(json.dumps(document | {"body": body}), encoding="utf-8")
    return path


def write_swelling(path: Path) -> Path:
    """Write a scene whose links add friction to their contacts as they shorten."""
    document = load_scene(SCENE).document()
    added = {"elongation": [-0.2, 0.0, 0.1], "added": [0.1, 0.0, 0.05]}
    links = [{"link": j, "contacts": [j, j + 1]} | added for j in (0, 1)]
    friction = document["friction"] | {"with_elongation": links}
    path.write_text(json.dumps(document | {"friction": friction}), encoding="utf-8")
    return path


SPECIAL = {"plain": lambda path: SCENE, "remembers": write_loose, "swells": write_swelling}


@pytest.mark.parametrize("body", SPECIAL)
def test_a_closed_loop_gives_the_same_bits_on_every_run_and_offline(body, tmp_path):
    """Also of a body that remembers or swells: its start and the commands are all that it takes."""
    scene = SPECIAL[body](tmp_path / "special.json")
    runs = []
    for i in range(2):
        folder = tmp_path / str(i)
        folder.mkdir()
        with graph(folder) as ros:
            ros.hear("joint_states")
            process = ros.start(
                "crawler_ros.node.simulator", "lock_step:=true", f"scene:={scene}", f"record:={folder / 'bags'}"
            )
            runs.append(close_the_loop(ros))
            process.end()
        (bag,) = (folder / "bags").iterdir()
        assert simulate_again(bag).identical
    assert np.array_equal(runs[0], runs[1])

    crawler = Crawler(load_scene(scene))
    for before, after in zip(runs[0][:-1], runs[0][1:], strict=True):
        seen = JointState(position=before.tolist())
        crawler.advance(act(seen))
        assert np.array_equal(np.concatenate((crawler.displacement[:1], crawler.joint_elongation)), after)


def test_one_message_is_one_tick_and_then_it_waits(ros):
    ros.simulator(*LOCK_STEP)
    for i in range(5):
        ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.1 * i, 0.0]))
    wait_until(lambda: ticks(ros)[-1] >= 5)
    assert ticks(ros) == [0, 1, 2, 3, 4, 5]
    answer = ros.call("/crawler/pause", "std_srvs/srv/SetBool", data=True)
    assert answer.success
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.0, 0.0]))
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.2, 0.0]))
    assert "0.060000000" in ros.call("/crawler/step", "std_srvs/srv/Trigger").message
    wait_until(lambda: ticks(ros)[-1] >= 6)
    assert ticks(ros)[-1] == 6
    ros.call("/crawler/pause", "std_srvs/srv/SetBool", data=False)
    wait_until(lambda: ticks(ros) == list(range(8)))


def test_commands_that_wait_for_the_simulator_do_not_overtake_its_start(ros):
    loop = Loop(ros)
    ros.start("crawler_ros.node.simulator", *LOCK_STEP)
    for _ in range(3):  # as soon as it can receive them
        ros.publish("joint_trajectory", JointTrajectory(points=[JointTrajectoryPoint()]))
    wait_until(lambda: loop.states and seconds(loop.states[-1]) >= 0.03)
    stamps = [seconds(state) for state in loop.states]
    assert stamps == sorted(stamps)


def test_friction_goes_with_the_next_actuation(ros):
    ros.simulator(*LOCK_STEP, hear=("joint_states", "applied_commands"))
    ros.publish("friction_controller/commands", Float64MultiArray(data=[0.7]))
    for turn in range(1, 200):  # the two topics have no order between them: the friction may come late
        ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.1 * turn, 0.1]))
        wait_until(lambda n=turn: len(ros.heard["applied_commands"]) == n and len(ticks(ros)) == n + 1)
        (point,) = ros.heard["applied_commands"][-1].points
        assert list(point.positions)[:2] == [0.1 * turn, 0.1]
        if list(point.positions)[2:] == [0.7] * 6:
            break
        assert list(point.positions)[2:] == [0.2, 0.2, 0.2, 0.5, 0.5, 0.5]
    else:
        pytest.fail("the friction was never applied")


def test_a_trajectory_runs_to_its_end_and_the_next_one_follows(ros):
    ros.simulator(*LOCK_STEP, hear=("joint_states",))
    for target in (0.4, 0.1):
        message = JointTrajectory(joint_names=["link_1"])
        point = JointTrajectoryPoint(positions=[target])
        point.time_from_start.nanosec = 50_000_000
        message.points.append(point)
        ros.publish("actuation_controller/joint_trajectory", message)
    wait_until(lambda: len(ticks(ros)) == 11)
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.0, 0.0]))
    wait_until(lambda: len(ticks(ros)) == 12)
    crawler = Crawler(load_scene(SCENE))
    ramps = [*np.linspace(0.0, 0.4, 6)[1:], *np.linspace(0.4, 0.1, 6)[1:], 0.0]
    for state, length in zip(unrepeated(ros.heard["joint_states"])[1:], ramps, strict=True):
        crawler.advance([0.0, length])
        np.testing.assert_allclose(state.position[0], crawler.displacement[0], atol=1e-14)
        np.testing.assert_allclose(state.position[1:], crawler.joint_elongation, atol=1e-14)


def test_the_gait_player_walks_it_exactly_and_faster_than_real_time(ros):
    ros.simulator(*LOCK_STEP, hear=("joint_states", "pose"))
    player = ros.start("crawler_ros.node.gait_player", f"scene:={SCENE}", "periods:=20")
    wait_until(lambda: player.process.poll() is not None, what="the end of the gait")
    offline = simulate(load_scene(SCENE), duration=20.0)
    wait_until(lambda: ros.heard["pose"][-1].pose.position.x == pytest.approx(offline.net_translation[-1], abs=1e-12))


def test_reset_goes_back_to_state_0_and_drops_what_waits(ros):
    ros.simulator(*LOCK_STEP)
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.3, 0.0]))
    wait_until(lambda: len(ticks(ros)) == 2)
    assert ros.call("/crawler/reset", "std_srvs/srv/Trigger").success
    wait_until(lambda: seconds(ros.heard["joint_states"][-1]) == 0.0)
    assert np.array_equal(ros.heard["joint_states"][-1].position, ros.heard["joint_states"][0].position)


def test_who_listens_before_the_start_hears_state_0_once_or_twice(ros):
    ros.hear("joint_states")
    process = ros.start("crawler_ros.node.simulator", *LOCK_STEP)
    wait_until(lambda: ros.heard["joint_states"], what="state 0")
    wait_until(lambda: "waiting for commands" in process.said)
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.3, 0.0]))
    wait_until(lambda: seconds(ros.heard["joint_states"][-1]) > 0.0)
    assert ticks(ros) == [0, 1]
    assert len(ros.heard["joint_states"]) <= 3  # twice if it was discovered while state 0 was published


def test_a_stamp_of_another_clock_is_refused(ros):
    process = ros.simulator(*LOCK_STEP)
    message = JointTrajectory(joint_names=["link_0"], points=[JointTrajectoryPoint(positions=[0.1])])
    message.header.stamp.sec = 1_700_000_000
    ros.publish("joint_trajectory", message)
    wait_until(lambda: "ahead of simulated time" in process.said)
    assert ticks(ros) == [0]


def test_waiting_and_paused_it_takes_no_processor_time(ros):
    process = ros.simulator(*LOCK_STEP)
    ros.call("/crawler/pause", "std_srvs/srv/SetBool", data=True)
    ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.1, 0.0]))

    ros.taken_up()
    before = cpu_seconds(process.process.pid)
    time.sleep(2.0)  # the time in which nothing is done; a busy machine makes it less, never more
    assert cpu_seconds(process.process.pid) - before < 1.0  # a loop that does not wait takes all of it


def test_services_answer_during_a_quick_exchange_and_after_it_no_processor_time_is_taken(ros):
    process = ros.simulator(*LOCK_STEP)
    loop, over = Loop(ros), threading.Event()
    wait_until(lambda: loop.states, what="state 0")

    def exchange() -> None:
        while not over.is_set():
            loop.command(act(loop.states[-1]))

    controller = threading.Thread(target=exchange)
    controller.start()
    try:
        wait_until(lambda: len(loop.states) > 200)
        for _ in range(3):
            ros.taken_up()
        seen = len(loop.states)
        wait_until(lambda: len(loop.states) > seen)
    finally:
        over.set()
        controller.join()
    ros.taken_up()
    before = cpu_seconds(process.process.pid)
    time.sleep(2.0)  # as above
    assert cpu_seconds(process.process.pid) - before < 1.0


def test_whoever_comes_before_the_first_command_hears_state_0(ros):
    process = ros.start("crawler_ros.node.simulator", *LOCK_STEP)
    wait_until(lambda: "waiting for commands" in process.said)
    for i in range(2):
        heard: list[JointState] = []
        ros.node.create_subscription(JointState, "joint_states", heard.append, 10)
        wait_until(lambda heard=heard: heard, what=f"state 0, by listener {i}")
        assert seconds(heard[0]) == 0.0
