"""Tendons that go slack and motors that stall, over topics: tensions, times, the description, and recordings."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy")
import rclpy
from urdf_parser_py.urdf import URDF

from crawler_model import Crawler, load_scene, simulate
from crawler_model.crawler.yields import YieldTimes
from crawler_ros.node.life.domains import reserved_domain
from crawler_ros.node.robot_description import describe_robot
from crawler_ros.node.simulator import Simulator
from crawler_ros.replay import analyse
from crawler_ros.wire.definitions import find_ament_prefix

from ...processes import wait_until
from .graph import seconds
from .machine import status, value
from .test_nodes import trajectory

SCENES = {"tendon_worm": ("slack", [-1.0, 0.0]), "stalling_inchworm": ("stalled", [2.0, 0.0])}
SEGMENT = """
name: strip
body:
  contacts: [0.0]
  segments:
    - name: trunk
      from: 0.5
      to: 1.5
      stiffness: 4.0
      tension: {most: 0.3}
      elements: 4
      friction: {forward: 0.5, backward: 2.0}
  links:
    - {stiffness: 8.0, tension: {least: -0.7, most: 0.4}, between: [0, trunk.from]}
friction: {forward: 0.5, backward: 2.0}
drive: {times: [0, 1, 2], period: 2, actuation: [[0, 0], [-1, -1], [0, 0]]}
"""
CHAIN = """
name: chain
body:
  contacts: [0.0, 1.0, 2.0, 3.0]
  links:
    - {stiffness: 8.0}
    - {stiffness: 8.0, tension: {least: 0.0, most: 0.6}, passive: {stiffness: 2.0}}
    - {stiffness: 6.0, tension: {least: -0.4, most: 0.7}, passive: {stiffness: 1.0}}
friction: {forward: 0.5, backward: 2.0}
drive: {times: [0, 1, 2], period: 2, actuation: [[0, 0, 0], [-1, -1, -1], [0, 0, 0]]}
"""


def command_period(ros, begin: float, lengths: list[float]) -> None:
    """Command a period in lock-step, half a second to each length."""
    ros.publish("joint_trajectory", trajectory(["link_0"], *((0.5 * (k + 1), [v]) for k, v in enumerate(lengths))))
    wait_until(lambda: abs(seconds(ros.heard["joint_states"][-1]) - begin - 1.0) < 1e-9, what="the end of a period")


@pytest.mark.parametrize("name", SCENES)
def test_effort_is_the_tension_and_diagnostics_count_the_time(ros, tmp_path, name):
    word, lengths = SCENES[name]
    simulator = ros.simulator(
        *(f"scene:={name}", "lock_step:=true", f"record:={tmp_path / 'bags'}"), hear=("joint_states", "/diagnostics")
    )
    for period in range(2):
        command_period(ros, float(period), lengths)
    body, alone = load_scene(name).body, Crawler(load_scene(name))
    (bend,) = body.bends
    beyond = first = 0
    for k, message in enumerate([m for m in ros.heard["joint_states"] if seconds(m) > 0.0]):
        part = (k % 100 + 1) / 50.0
        length = lengths[0] * part if part <= 1.0 else lengths[0] + (lengths[1] - lengths[0]) * (part - 1.0)
        alone.advance([length])
        z, effort = message.position[1], message.effort[1]
        assert (z, effort) == pytest.approx((alone.shape[0], alone.tension[0]), abs=1e-12)
        assert effort == pytest.approx(float(bend.actuator(z - length) + bend.passive(z)), abs=1e-12)
        beyond += int(body.limits.find_states(alone.shape, alone.actuation)[0] != 0)
        first = beyond if k < 100 else first
    assert 20 < beyond < 180
    told = f"{beyond / 100:.9f}"
    wait_until(lambda: value(ros, "actuators", f"link_0 {word} [s]") == told, what=f"{told} s {word}")
    (entry,) = status(ros, "actuators").values  # nothing of what cannot be
    assert entry.key == f"link_0 {word} [s]"
    assert any(
        s.message == f"{word}: link_0" for m in ros.heard["/diagnostics"] for s in m.status if "actuators" in s.name
    )
    assert ros.call("/crawler/reset", "std_srvs/srv/Trigger").success
    wait_until(lambda: value(ros, "actuators", f"link_0 {word} [s]") == "0.000000000", what="the count after a reset")
    command_period(ros, 0.0, lengths)
    once = f"{first / 100:.9f}"
    wait_until(lambda: value(ros, "actuators", f"link_0 {word} [s]") == once, what="the count of a period")
    assert simulator.end() == 0
    (path,) = (tmp_path / "bags").iterdir()
    found = analyse(path)
    assert found.problems == ()
    assert found.comparison.identical
    assert (found.comparison.ticks, found.comparison.resets) == (302, 1)
    assert found.at_limits == {"link_0": {word: pytest.approx((beyond + first) / 100)}}
    assert found.energy.residual < 1e-12


def test_other_scenes_have_no_status_of_actuators(ros):
    ros.simulator("scene:=three_contacts_one_way", hear=("joint_states", "/diagnostics"))
    wait_until(lambda: ros.heard["/diagnostics"], what="a report")
    assert status(ros, "simulation") is not None
    assert status(ros, "actuators") is None


@pytest.mark.parametrize("name", SCENES)
def test_a_played_gait_gains_what_the_model_says_and_is_simulated_again(ros, tmp_path, name):
    simulator = ros.simulator(f"scene:={name}", f"record:={tmp_path / 'bags'}", "lock_step:=true")
    player = ros.start("crawler_ros.node.gait_player", f"scene:={name}", "periods:=3", "patience:=0.0")
    assert player.wait() == 0, player.said
    assert simulator.end() == 0
    (path,) = (tmp_path / "bags").iterdir()
    found = analyse(path)
    assert found.problems == ()
    assert found.comparison.identical
    offline = simulate(load_scene(name), duration=6.0)
    assert [c.translation for c in found.cycles] == pytest.approx(offline.per_period.tolist(), abs=1e-12)


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("name", [*SCENES, "chain"])
def test_ticks_at_once_count_the_times_of_single_ones(tmp_path, name, every):
    """Of a node of this process, whose ticks are called one after another or many in one call."""
    scene = name
    if name == "chain":
        scene = tmp_path / "chain.yaml"
        scene.write_text(CHAIN)
    find_ament_prefix()
    reports = []
    for at_once in (False, True):
        context = rclpy.Context()
        given = {"scene": scene, "rate": 1000.0, "real_time_factor": 0.0, "publish.every": every}
        words = [word for key, v in given.items() for word in ("-p", f"{key}:={v}")]
        with reserved_domain() as domain:
            context.init(args=["--ros-args", *words], domain_id=domain)
            try:
                node = Simulator(context=context)
                names = node.columns.names[: node.columns.lengths]
                low = node.scene.drive.actuation.min() - node.scene.drive.actuation.max()
                rows = [[sign * low] * len(names) for sign in (1.0, 0.0, -1.0, 0.0)]
                node.commands.accept_trajectory(names, [10**8, 3 * 10**8, 4 * 10**8, 6 * 10**8], rows, 0)
                while node.tick_clock.tick < 1000:
                    node.ticks.run(min(64, 1000 - node.tick_clock.tick) if at_once else 1)
                reports.append((node.ticks.yields.report(), node.ticks.crawler._state.bits()))
                assert node.ticks.yields.report()[0] == "within the limits of tension"
                node.close()
            finally:
                context.try_shutdown()
    assert reports[0] == reports[1]
    (message, entries), _ = reports[0]
    words = {key.split()[1] for key, times in entries if float(times) > 0.0}
    assert words == {word for word in ("slack", "stalled") if word in message}
    assert words


def test_the_elements_of_a_segment_count_on_average(tmp_path):
    path = tmp_path / "strip.yaml"
    path.write_text(SEGMENT)
    crawler = Crawler(load_scene(path))
    times, stalled, (trunk,) = YieldTimes(crawler.body), {"link_0": 0, "trunk": 0}, crawler.body.segments
    for k in range(100):
        crawler.advance([0.0, -0.5 * np.sin(0.1 * k)])
        lengths = crawler.body.joint_sum(crawler.actuation)
        times.add_ticks(crawler.joint_elongation[None], lengths[None], np.array([10_000_000]))
        u = crawler.shape - crawler.actuation
        stalled["trunk"] += int(u[trunk.springs].mean() > 0.3 * 0.25 / 4.0)
        stalled["link_0"] += int(u[crawler.body.link_springs[0]] > 0.4 / 8.0)
    assert 10 < stalled["trunk"] < 90
    message, entries = times.report()
    assert message.startswith("stalled: ")
    assert entries == [(f"{name} stalled [s]", f"{ticks / 100:.9f}") for name, ticks in stalled.items()]


def test_a_description_has_the_limits_of_actuators(tmp_path):
    path = tmp_path / "strip.yaml"
    path.write_text(SEGMENT)
    joints = {}
    for scene in (load_scene(path), *map(load_scene, (*SCENES, "three_contacts_one_way"))):
        robot = URDF.from_xml_string(describe_robot(scene))
        joints |= {(scene.name, joint.name): joint.limit.effort for joint in robot.joints}
    assert joints["strip", "link_0"] == 0.7
    assert joints["strip", "trunk"] == 0.3
    assert joints["stalling_inchworm", "link_0"] == 1.5
    free = {("strip", "contact_0"), ("tendon_worm", "link_0"), ("three_contacts_one_way", "link_1")}
    assert all(joints[key] == 1e9 for key in free)  # a tendon pulls as hard as it is asked to
    assert np.isfinite(list(joints.values())).all()
