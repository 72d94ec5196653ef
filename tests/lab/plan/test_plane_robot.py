"""Bodies that turn: their shape is read, their derivatives are those of the path, and they follow poses."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from crawler_lab.derivative.parameters import Derivatives
from crawler_lab.derivative.plane_path import PlanePath
from crawler_lab.derivative.tangent_path import Vertices
from crawler_lab.plan.estimate import Window, estimate
from crawler_lab.plan.limits import Limits
from crawler_lab.plan.robot import build_robot
from crawler_lab.plan.tracker import Tracker, read_path
from crawler_model import Crawler, Scene, load_scene
from crawler_model.body.drive import NS
from crawler_model.crawler.readout import Readout

SCENE = "steering_inchworm"


def read(crawler: Crawler) -> np.ndarray:
    """The positions in joint_states."""
    readout = Readout(crawler.body, np.zeros(0, np.int64))
    found = np.empty((3, 3 + crawler.body.lengths + len(readout._tree.free) - 1))
    readout.read(crawler, np.inf, found, np.empty((3, 0)))
    return found[0]


def slippery(factor: float, load: float = 0.0) -> Scene:
    document = load_scene(SCENE).document()
    document["friction"] = {side: factor * value for side, value in document["friction"].items()}
    document["loads"] = [[load, 0.0]] * 4
    return Scene.model_validate(document)


def drive(length: float, right: float) -> np.ndarray:
    return np.array([length, right, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("scene", [SCENE, "tripedal_star", "scissors", "three_link_snake"])
def test_displacements_follow_from_joint_states(scene):
    robot, crawler = build_robot(load_scene(scene)), Crawler(load_scene(scene))
    for row in robot.scene.drive.sample_rows(np.array([NS // 3, NS])):
        crawler.follow(robot.scene.columns.target(row[None]))
    assert robot.read(read(crawler)) == pytest.approx(crawler.displacement, abs=1e-12)
    assert robot.locate(crawler.displacement) == pytest.approx([*crawler.net_translation, crawler.yaw], abs=1e-12)


def test_differences_are_the_exact_derivatives():
    robot = build_robot(load_scene(SCENE))
    body, n = robot.scene.body, robot.scene.body.contacts
    start = robot.begin(np.zeros((n, 2)), robot.before, robot.nominal)
    rows = np.array([drive(0.1, 0.05), drive(0.2, 0.25), drive(0.12, 0.2)])
    places, slope = start.differentiate_places(rows, np.array([0, 1]))
    targets = np.tile(start.held, (4, 1))
    targets[1:, :8] = rows
    by = np.zeros((4, targets.shape[1], 3, 2))
    by[np.arange(1, 4)[:, None], np.arange(2), np.arange(3)[:, None], np.arange(2)] = 1.0
    none = np.zeros(6)
    at = np.arange(1, 4)
    derivatives = Derivatives(
        *(("",) * 6, none, np.zeros((8, 6)), np.zeros((0, 6)), by.reshape(4, -1, 6), np.zeros((n, 2, 6))),
        *(np.zeros((4, 6)), none, np.zeros((n, 2, 6)), np.zeros((8, 6)), np.zeros((n, 6)), np.zeros(6, np.bool_)),
    )
    plan = SimpleNamespace(
        body=body,
        ground=robot.scene.ground,
        directions=robot.scene.directions,
        drive=SimpleNamespace(targets=targets),
        start_displacement=start.x,
        tolerance=robot.scene.tolerance,
    )
    vertices = Vertices(at * NS, at, at, np.zeros(3), np.zeros((3, 6)), np.zeros((3, 6)), targets[1:])
    exact = PlanePath(plan, derivatives).follow_vertices(vertices)
    assert places == pytest.approx(robot.locate(exact.x), abs=1e-4)
    assert slope[:, :2] == pytest.approx(np.einsum("n,vncp->vcp", body.share, exact.dx), abs=0.02)
    way, d_way = np.diff((body.position + exact.x)[:, [0, 2]], axis=1)[:, 0], exact.dx[:, 2] - exact.dx[:, 0]
    turned = (way[:, :1] * d_way[:, 1] - way[:, 1:] * d_way[:, 0]) / np.square(way).sum(axis=1, keepdims=True)
    assert slope[:, 2] == pytest.approx(turned, abs=0.003)
    assert np.abs(turned).max() > 0.05


def test_friction_and_a_load_are_found():
    robot, crawler = build_robot(load_scene(SCENE)), Crawler(slippery(0.8, -0.005))
    rows = np.array([drive(0.15, 0.1), drive(0.3, 0.25), drive(0.1, 0.1), drive(0.0, 0.0)] * 3)
    x = [crawler.displacement]
    for row in rows:
        crawler.advance(row)
        x.append(crawler.displacement)
    found = estimate(robot, Window(np.array(x), robot.before, rows, np.arange(1, 13)), robot.nominal)
    assert found == pytest.approx([0.8, -0.005, 0.0], abs=0.003)


def test_it_follows_poses_with_other_friction():
    """Each point of the path is 0.01 m and 0.0008 rad further; the gait of the scene turns by 0.034 rad in 0.2 m."""
    robot, crawler = build_robot(load_scene(SCENE)), Crawler(slippery(0.7))
    high = drive(0.3, 0.3)
    limits = Limits(np.zeros(8), high, np.full(8, 0.06), 0.15)
    poses = read_path(0.0, [0.0, 0.0, 0.0, 0.0, 10.0, 1.0, 0.04, 0.08], turns=True)
    tracker = Tracker(robot, limits, poses, NS // 4, 8, 1e-4)
    missed = []
    for k in range(25):
        tracker.see(k * NS // 4, read(crawler))
        missed.append(robot.miss(tracker.place, poses(np.array([0.25 * k]))[0]))
        crawler.advance(tracker.plan(k * NS // 4)[0])
    assert tracker.factors[0] == pytest.approx(0.7, rel=0.02)
    assert np.abs(missed[8:]).max(axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=0.015)
    assert "of the yaw" in tracker.describe()
