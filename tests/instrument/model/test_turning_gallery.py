"""The gallery's bodies that turn: what each is known for, its energy, and what is left of it on isotropic friction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from crawler_model import Crawler, Scene, Trajectory, limit_cycle, load_scene, simulate
from tests.scenes import TURNING

GAINS = {
    "three_link_snake": (-0.5219, 0.0894, -0.3382),
    "ten_link_snake": (0.6545, 0.0258, 0.0),
    "steering_inchworm": (0.2970, -0.0061, -0.0337),
    "tripedal_star": (-0.0195, 0.1381, 0.2802),
    "scissors": (0.5 * (math.cos(0.46) - 1.0), 0.5 * math.sin(0.46), 0.46),  # about the hinge, 0.5 m behind the middle
}
"""dx, dy [m] and dyaw [rad] of the second period."""
SIDES = ("forward", "backward", "left", "right")
RIGID = [
    ((0.01, 0.01, 0.01, 0.01), (-0.0802105, -0.0007422, 0.0185047), 1e-4),
    ((0.1, 0.1, 0.5, 0.5), (-0.5223432, 0.0890908, -0.3378685), 5e-4),
    ((0.011, 0.014, 0.020, 0.020), (-0.1770053, -0.0043676, 0.0493400), 1e-4),
]
"""Friction [N]; dx, dy [m] and dyaw [rad] of a snake of three rigid links under it, by another program; tolerance."""


def document(name: str) -> dict[str, Any]:
    return load_scene(name).document()


def with_friction(scene: dict[str, Any], *values: Any) -> dict[str, Any]:
    """A scene with other friction forward, backward, left and right, but none at the points that had none."""
    given = scene["friction"]["forward"]
    bare = np.array(given) == 0.0
    spread = [np.where(bare, 0.0, value).tolist() for value in values]
    return scene | {"friction": dict(zip(SIDES, spread, strict=True))}


def with_actuation(scene: dict[str, Any], rows: list[list[float]]) -> dict[str, Any]:
    return scene | {"drive": scene["drive"] | {"actuation": rows}}


def run_periods(scene: dict[str, Any], periods: int = 2) -> Trajectory:
    return simulate(Scene.model_validate(scene), periods * scene["drive"]["period"])


@pytest.mark.parametrize("name", [n for n in TURNING if n != "snake_over_two_grounds"])
def test_every_scene_moves_as_its_comments_say_and_accounts_for_its_work(name):
    run = run_periods(document(name))
    assert run.per_period[1] == pytest.approx(GAINS[name], abs=1e-4)
    energy = run.energy
    assert energy.work == pytest.approx(energy.stored + energy.dissipation + energy.jump_loss, rel=1e-4)
    assert run.violation < 1e-6
    assert run.unique
    assert run.jumps == ()


@pytest.mark.parametrize(("friction", "gain", "tolerance"), RIGID, ids=["isotropic", "sideways", "bristles"])
def test_three_links_swim_as_rigid_ones_under_little_friction(friction, gain, tolerance):
    """What is left is the compliance of the joints, 1e4 N m/rad: it grows with friction."""
    run = run_periods(with_friction(document("three_link_snake"), *friction))
    assert run.per_period == pytest.approx(np.array([gain, gain]), abs=tolerance)


def test_the_inchworm_goes_straight_with_equal_strokes_and_turns_to_either_side_with_others():
    scene = document("steering_inchworm")
    rest = [0.0] * 8
    left, straight, right = (
        run_periods(with_actuation(scene, [rest, [*strokes, *rest[2:]], rest])).per_period[1]
        for strokes in ((0.1, 0.3), (0.2, 0.2), (0.3, 0.1))
    )
    assert straight == pytest.approx([0.2 - 2.0 * 0.1 / 400.0, 0.0, 0.0], abs=1e-6)
    assert left[2] == pytest.approx(-right[2], abs=1e-5)
    assert right[2] < -0.03


def test_the_star_turns_left_about_its_hub_whatever_the_order_of_its_legs():
    scene = document("tripedal_star")
    for rows in (scene["drive"]["actuation"], scene["drive"]["actuation"][::-1]):
        found = limit_cycle(Scene.model_validate(with_actuation(scene, rows)))
        assert found.settled
        assert 0.27 < found.gain[2] < 0.5
        assert found.screw.centre == pytest.approx((-0.5, 0.0), abs=2e-2)


def test_points_that_stop_do_not_make_long_ramps_slow():
    """At a tolerance of 1e-5, some ramps took 2 600 parts: estimates of a stop were shortened again and again."""
    scene = load_scene("tripedal_star")
    crawler = Crawler(scene)
    assert sum(crawler.follow(target[None]).events for target in scene.drive.targets[1:]) < 400


def test_little_is_left_on_isotropic_friction():
    scissors = run_periods(with_friction(document("scissors"), *[[2.0, 0.1, 0.1]] * 4))
    assert scissors.per_period[1] == pytest.approx(np.zeros(3), abs=1e-6)
    star = run_periods(with_friction(document("tripedal_star"), *[0.1] * 4))
    assert 0.0 < star.per_period[1, 2] < 0.02
    snake = run_periods(with_friction(document("ten_link_snake"), *[0.1] * 4))
    assert snake.per_period[1] == pytest.approx([-0.0136, -0.0029, 0.0], abs=1e-4)
