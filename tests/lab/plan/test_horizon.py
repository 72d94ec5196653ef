"""Plans keep their limits, reach what a closed form says can be reached, and follow a path better than a gait."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from crawler_lab.plan.horizon import Problem, find_plan, solve_within
from crawler_lab.plan.limits import Limits
from crawler_lab.plan.robot import build_robot
from crawler_model import Crawler, Scene, SceneError, load_scene, simulate

STEP_S = 0.05


def limits(springs: int, high: float = 0.1, change: float = 0.02, effort: float = 0.01) -> Limits:
    return Limits(np.zeros(springs), np.full(springs, high), np.full(springs, change), effort)


@pytest.mark.parametrize("wanted", [0.003, 0.01, 0.02])
def test_one_step_is_the_command_of_the_closed_form(wanted):
    """The front contact slides by L - mu_plus / k; where nothing slides yet, the cost has no slope."""
    robot = build_robot(load_scene("two_contacts_anisotropic"))
    (stiffness,), mu_plus = robot.scene.body.stiffness, robot.base[1]
    start = robot.begin(np.zeros(2), np.zeros(1), robot.nominal)
    problem = Problem(start, limits(1, change=0.1, effort=1e-6), np.array([[wanted]]))
    rows = find_plan(problem, np.zeros((1, 1)))
    assert rows[0, 0] == pytest.approx(2.0 * wanted + mu_plus / stiffness, abs=1e-9)
    assert start.follow(rows)[0] @ robot.scene.body.share == pytest.approx(wanted, abs=1e-9)


def test_it_follows_a_path_better_than_the_gait_of_the_same_speed():
    """The gait gains 2 (D - 3 mu_plus / k) in a period of 1 s: 0.1 m with D = 0.08 m."""
    speed = 0.1
    robot = build_robot(load_scene("three_contacts_one_way"))
    crawler, rows = Crawler(robot.scene), np.zeros((12, 2))
    errors = []
    for k in range(60):
        start = robot.begin(crawler.displacement, crawler.actuation, robot.nominal)
        wanted = speed * STEP_S * (k + np.arange(1, 13))[:, None]
        rows = find_plan(Problem(start, limits(2), wanted), np.vstack((rows[1:], rows[-1:])))
        crawler.advance(rows[0])
        errors.append(crawler.net_translation - wanted[0, 0])
        assert (np.abs(np.diff(np.vstack((crawler.commanded, rows[1:])), axis=0)) <= 0.02 + 1e-12).all()
        assert (rows >= 0.0).all()
        assert (rows <= 0.1).all()
    document = robot.scene.document()
    document["drive"]["actuation"] = (0.8 * np.array(document["drive"]["actuation"])).tolist()
    run = simulate(Scene.model_validate(document), 3.0, rate=1.0 / STEP_S)
    assert run.per_period[-1] == pytest.approx(speed, abs=1e-12)
    of_gait = run.net_translation[20:] - speed * run.time[20:]
    assert np.std(errors[20:]) < 0.5 * np.std(of_gait)
    assert np.sqrt(np.mean(np.square(errors[20:]))) < 0.002


def test_a_plan_that_rests_is_left_where_every_gait_goes_too_far():
    """The body of 1 m goes 0.5 m in a stroke; 1 mm is reached by the closed form of the first slip."""
    robot = build_robot(load_scene("tendon_worm"))
    wanted = np.linspace(0.0005, 0.005, 10)[:, None]
    pulled = Limits(np.full(1, -1.0), np.zeros(1), np.full(1, 0.2), 0.001)
    problem = Problem(robot.begin(np.zeros(2), np.zeros(1), robot.nominal), pulled, wanted)
    rows = find_plan(problem, np.zeros((10, 1)))
    assert problem.rests(np.zeros((10, 1)))
    assert problem.start.follow(rows)[-1] @ robot.scene.body.share == pytest.approx(wanted[-1, 0], abs=1e-3)


def test_without_time_the_last_plan_goes_on():
    robot = build_robot(load_scene("three_contacts_one_way"))
    start = robot.begin(np.zeros(3), np.zeros(2), robot.nominal)
    last = np.linspace(0.0, 0.06, 8).reshape(4, 2)
    assert np.array_equal(find_plan(Problem(start, limits(2), np.full((4, 1), 0.1)), last, lambda: True), last)


@pytest.mark.parametrize("scene", ["three_contacts_one_way", "three_contacts_two_ways"])
def test_derivatives_are_those_of_the_path(scene):
    robot = build_robot(load_scene(scene))
    start = robot.begin(np.zeros(3), np.zeros(2), robot.nominal)
    rows = np.array([[0.05, 0.01], [0.07, 0.09], [0.01, 0.04]])
    by = np.zeros((4, start.target.size, 6))
    by[1:, :2] = np.eye(6).reshape(3, 2, 6)
    x, dx = start.differentiate(rows, by)
    assert x == pytest.approx(start.follow(rows), abs=1e-15)
    assert np.abs(dx).max() > 0.5
    for p in range(6):
        change = 1e-6 * np.eye(6)[p].reshape(3, 2)
        slope = (start.follow(rows + change) - start.follow(rows - change)) / 2e-6
        assert dx[..., p] == pytest.approx(slope, abs=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_least_squares_within_bounds_agree_with_scipy(seed):
    rng = np.random.default_rng(seed)
    matrix, right = rng.normal(size=(12, 5)), rng.normal(size=12)
    low, high = -0.1 * rng.random(5), 0.1 * rng.random(5)
    found = solve_within(matrix, right, np.vstack((np.eye(5), -np.eye(5))), np.concatenate((low, -high)))
    assert found == pytest.approx(lsq_linear(matrix, right, (low, high), tol=1e-14).x, abs=1e-7)
    free = solve_within(matrix, right, np.vstack((np.eye(5), -np.eye(5))), np.full(10, -10.0))
    assert free == pytest.approx(np.linalg.lstsq(matrix, right)[0], abs=1e-12)


@pytest.mark.parametrize(
    ("scene", "reason"),
    [("planar_rectilinear", "is in the plane"), ("ice", "has ground.patches"), ("peristaltic_segment", "has segments")],
)
def test_bodies_without_exact_derivatives_are_refused(scene, reason):
    with pytest.raises(SceneError, match=reason):
        build_robot(load_scene(scene))
