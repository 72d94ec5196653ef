"""Friction and loads follow from what a body did."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_lab.plan.estimate import Window, estimate
from crawler_lab.plan.robot import build_robot
from crawler_model import Crawler, Scene, load_scene


def see(scene: str, friction: float, load: float) -> tuple[Window, Window]:
    """Let a body with other friction and a load on its first contact move, and halve what is seen of it."""
    document = load_scene(scene).document()
    document["friction"] = {side: friction * value for side, value in document["friction"].items()}
    document["loads"] = [load, 0.0, 0.0]
    crawler = Crawler(Scene.model_validate(document))
    rows = np.array([[0.05, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1], [0.0, 0.05], [0.0, 0.0]] * 3)
    x = [crawler.displacement]
    for row in rows:
        crawler.advance(row)
        x.append(crawler.displacement)
    windows = (Window(np.array(x)[k : k + 10], rows[k - 1], rows[k : k + 9], np.arange(1, 10)) for k in (3, 9))
    return tuple(windows)


@pytest.mark.parametrize("friction", [0.7, 1.3])
def test_the_factor_of_friction_is_found(friction):
    robot = build_robot(load_scene("three_contacts_one_way"))
    first, second = see("three_contacts_one_way", friction, 0.0)
    found = estimate(robot, second, estimate(robot, first, robot.nominal))
    assert found[0] == pytest.approx(friction, rel=0.02)
    assert found[1] == pytest.approx(1.0, abs=0.3)  # no contact slid backwards: only bounded
    assert np.abs(found[2:]).max() < 0.005


def test_a_load_on_one_contact_is_found_beside_friction():
    """What is equal on all contacts is the same as other friction: only differences and bounds are determined."""
    robot = build_robot(load_scene("three_contacts_two_ways"))
    first, second = see("three_contacts_two_ways", 0.8, -0.03)
    found = estimate(robot, second, estimate(robot, first, robot.nominal))
    assert found[2] - found[3:] == pytest.approx([-0.03, -0.03], abs=0.002)
    true = robot.bounds_by_factors @ np.array([0.8, 0.8, -0.03, 0.0, 0.0])
    assert robot.bounds_by_factors @ found == pytest.approx(true, abs=0.002)


@pytest.mark.parametrize("scene", ["three_contacts_one_way", "steering_inchworm"])
def test_loads_that_round_to_zero_have_no_sign(scene):
    robot = build_robot(load_scene(scene))
    assert "-0.0" not in robot.describe(robot.nominal - 1e-9)


def test_nothing_seen_changes_nothing():
    robot = build_robot(load_scene("three_contacts_one_way"))
    still = Window(np.zeros((5, 3)), np.zeros(2), np.zeros((4, 2)), np.arange(1, 5))
    assert estimate(robot, still, robot.nominal) == pytest.approx(robot.nominal, abs=1e-12)
