"""Every kind of body through the same node: driven over the topics, recorded, run again, drawn."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("rclpy")
from std_msgs.msg import Float64MultiArray

from crawler_model import Crawler, Scene, load_scene, simulate
from crawler_model.crawler.readout import Readout
from crawler_model.theory.uniqueness import UNDETERMINED
from crawler_pictures.run.run_page import draw_run
from crawler_ros.recording import bag
from crawler_ros.replay import simulate_again
from crawler_ros.replay.analysis import analyse
from crawler_ros.viewer.arrays import run_of_frames
from crawler_ros.viewer.frames import frames_of_recording
from crawler_ros.viewer.visualizer import draw_recording
from crawler_ros.wire.states import StationReader, contact_names, joint_state_names, shown_contacts

from ...processes import wait_until
from .graph import graph
from .test_recording import DECODE

BODIES = ["three_springs", "hybrid_body", "friction_wave_segment", "planar_three_points"]
FIRST_NAMES = {
    "three_springs": ["contact_0", "link_0", "link_1", "link_2"],
    "hybrid_body": ["contact_0", "link_0", "trunk"],
    "friction_wave_segment": ["foot.from", "foot"],
    "planar_three_points": ["contact_0/x", "contact_0/y", "link_0/x", "link_0/y"],
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n == "friction_wave_segment" else n for n in BODIES]
)
def test_the_gait_player_drives_it_and_the_recording_runs_again(name, tmp_path):
    scene = load_scene(name)
    offline = simulate(scene, duration=3.0)
    with graph(tmp_path) as ros:
        hear = ("joint_states", "contact_states", "pose")
        simulator = ros.simulator(f"scene:={name}", f"record:={tmp_path / 'bags'}", hear=hear)
        player = ros.start("crawler_ros.node.gait_player", f"scene:={name}", "periods:=3")
        assert player.wait() == 0, player.said
        ros.walked(offline.net_translation[-1], within=1e-12 if scene.dimension == 1 else 3e-5)
        assert simulator.end() == 0
        states = wait_until(lambda: ros.heard["contact_states"])
        assert list(ros.heard["joint_states"][0].name)[: len(FIRST_NAMES[name])] == FIRST_NAMES[name]
        assert list(states[0].name) == contact_names(scene.body)
        first = (scene.body.position + scene.start_displacement)[shown_contacts(scene.body)]
        assert list(states[0].position) == first.ravel().tolist()
    (path,) = (tmp_path / "bags").iterdir()
    poses = [DECODE(r.data, r.type).pose.position for r in bag.read(path) if r.topic == "/pose"]
    end = [poses[-1].x, poses[-1].y][: scene.dimension]
    assert np.max(np.abs(end - offline.net_translation[-1])) <= (1e-12 if scene.dimension == 1 else 3e-5)
    assert scene.dimension == 2 or not any(p.y for p in poses)
    again = simulate_again(path)
    assert again.identical
    assert again.ticks > 300
    assert draw_recording(path, tmp_path / "x.rrd") > 100
    found, frames = frames_of_recording(path)
    draw_run(run_of_frames(found, list(frames)), tmp_path / "x.png")
    assert (tmp_path / "x.png").stat().st_size > 20_000


ON_A_LINE = {
    "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}},
    "friction": {"forward": 0.1, "backward": 0.3},
    "ground": {"patches": [{"from": 1.35, "to": 1.5, "friction": 0.5}, {"from": 1.6, "to": 2.0, "friction": 2}]},
    "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [0.5], [0.0]]},
}
IN_THE_PLANE = {
    "dimension": 2,
    "body": {"contacts": [[0.0, 0.0], [1.0, 0.0]], "links": {"stiffness": 1.0}},
    "friction": {"isotropic": [0.2, 0.1]},
    "ground": {
        "regions": [
            {"polygon": [[1.1, -0.5], [1.2, -0.5], [1.2, 0.5], [1.15, 0.5]], "friction": 0.5},
            {"left_of": [[1.3, 0.5], [1.25, -0.5]], "friction": 2.0},
        ]
    },
    "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[[0.0, 0.0]], [[0.5, 0.1]], [[0.0, 0.0]]]},
}


@pytest.mark.parametrize(("document", "within"), [(ON_A_LINE, 1e-12), (IN_THE_PLANE, 3e-5)], ids=["line", "plane"])
def test_a_recording_on_other_ground_runs_again(document, within, tmp_path):
    scene = Scene.model_validate(document | {"name": "ice"})
    file = tmp_path / "ice.yaml"
    file.write_text(json.dumps(scene.document()), encoding="utf-8")
    offline = simulate(scene, duration=3.0)
    assert offline.jumps
    with graph(tmp_path) as ros:
        hear = ("joint_states", "contact_states", "pose")
        simulator = ros.simulator(f"scene:={file}", f"record:={tmp_path / 'bags'}", hear=hear)
        player = ros.start("crawler_ros.node.gait_player", f"scene:={file}", "periods:=3")
        assert player.wait() == 0, player.said
        ros.walked(offline.net_translation[-1], within=within)
        assert simulator.end() == 0
    (path,) = (tmp_path / "bags").iterdir()
    again = simulate_again(path)
    assert again.identical
    assert again.ticks > 300
    jumps = analyse(path).plain_jumps()
    assert [jump["contact"] for jump in jumps] == [f"contact_{jump.contact}" for jump in offline.jumps]


@pytest.mark.parametrize("name", [*BODIES, "three_contacts_one_way", "continuous_segment"])
def test_stations_are_found_again_from_the_joints(name):
    scene = load_scene(name)
    mesh = scene.body
    crawler = Crawler(scene)
    step = crawler.follow(scene.drive.targets[1:3].copy())
    joints, contacts = np.zeros((3, len(joint_state_names(mesh)))), np.zeros((3, len(contact_names(scene.body))))
    Readout(mesh, shown_contacts(scene.body)).read(crawler, 0.5, joints, contacts)
    position, speed, effort = joints
    assert StationReader(mesh).read(position) == pytest.approx(crawler.displacement[mesh.stations], abs=1e-14)
    assert StationReader(mesh).read(speed) == pytest.approx(2.0 * step.velocity[mesh.stations], abs=1e-13)
    each = mesh.dimension
    assert position[each:].tolist() == crawler.joint_elongation.ravel().tolist()
    assert effort[each:].tolist() == crawler.joint_tension.ravel().tolist()
    shown = shown_contacts(scene.body)
    assert contacts[0].tolist() == (mesh.position + crawler.displacement)[shown].ravel().tolist()
    assert contacts[1].tolist() == (step.velocity / 0.5)[shown].ravel().tolist()
    assert contacts[2].tolist() == (-crawler.spring_force[shown]).ravel().tolist()
    assert effort[:each].tolist() == (-crawler.spring_force[mesh.stations[0]]).ravel().tolist()


def test_a_segment_is_commanded_by_one_strain(tmp_path):
    with graph(tmp_path) as ros:
        ros.simulator("scene:=hybrid_body", hear=("joint_states", "/diagnostics"))
        ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.3, 0.25]))
        moved = wait_until(lambda: [m for m in ros.heard["joint_states"] if m.effort[1] != 0.0])
        crawler = Crawler(load_scene("hybrid_body"))
        crawler.advance([0.3, 0.25])
        assert list(moved[0].position)[1:] == crawler.joint_elongation.tolist()
        ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.3]))

        def refused():
            said = [s.message for m in ros.heard["/diagnostics"] for s in m.status]
            return any("1 value(s); it needs 2, one per link and segment" in text for text in said)

        wait_until(refused)


def test_a_translation_that_is_not_determined_warns_while_it_lasts(tmp_path):
    with graph(tmp_path) as ros:
        ros.simulator("scene:=two_contacts_critical", hear=("joint_states", "/diagnostics"))

        def said():
            return [UNDETERMINED in m.status[0].message for m in ros.heard["/diagnostics"]]

        ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.5]))
        wait_until(lambda: any(said()))
        wait_until(lambda: not said()[-1])
        values = {v.key: v.value for v in ros.heard["/diagnostics"][-1].status[0].values}
        assert values["ticks without a determined translation"] == "1"


def test_the_orientation_of_a_shape_in_the_plane_is_a_diagnostic_and_the_pose_keeps_none(tmp_path):
    with graph(tmp_path) as ros:
        ros.simulator("scene:=planar_three_points", hear=("joint_states", "pose", "/diagnostics"))
        start = load_scene("planar_three_points")
        turned = 0.2 * np.array([[0.0, -1.0], [1.0, 0.0]])  # R - 1 of a small turn, but for the stretch
        links = np.diff(start.body.position[start.body.ends], axis=1)[:, 0] @ turned.T
        ros.publish("actuation_controller/commands", Float64MultiArray(data=links.ravel().tolist()))

        def angles():
            statuses = [s for m in ros.heard["/diagnostics"] for s in m.status if s.name.endswith("simulation")]
            return [float(v.value) for s in statuses for v in s.values if v.key == "orientation of the shape [rad]"]

        wait_until(lambda: angles() and angles()[-1] > 0.02)
        assert angles()[-1] < 0.2
        assert {(p.pose.orientation.z, p.pose.orientation.w) for p in ros.heard["pose"]} == {(0.0, 1.0)}
