"""Runs of bodies in the plane whose springs have lengths: yaw, gain in their own frame, periods, tables."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from crawler_model import CommandError, Crawler, Scene, SceneError, Trajectory, limit_cycle, simulate
from crawler_model.body.turning import forward_angles, load_of_friction
from tests.commands import crawler

SNAKE: dict[str, Any] = {
    "name": "snake",
    "dimension": 2,
    "body": {
        "points": [[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [0.3, 0.0]],
        "springs": "length",
        "links": {"stiffness": 50.0},
        "joints": {"stiffness": 2.0},
    },
    "friction": {"forward": 0.1, "backward": 1.0, "left": 0.5, "right": 0.5},
    "drive": {
        "times": [0.0, 0.5, 1.0, 1.5, 2.0],
        "period": 2.0,
        "actuation": [[0, 0, 0, 0, 0], [0, 0, 0, 0.4, 0], [0, 0, 0, 0.4, 0.4], [0, 0, 0, 0, 0.4], [0, 0, 0, 0, 0]],
    },
}

_SCATTER = 5e-4
"""Differences between runs with other steps [m, rad]: all points slide at once now and then, and then little holds it."""


def turned(scene: dict[str, Any], angle: float) -> dict[str, Any]:
    cos, sin = math.cos(angle), math.sin(angle)
    points = [[cos * x - sin * y, sin * x + cos * y] for x, y in scene["body"]["points"]]
    return scene | {"body": scene["body"] | {"points": points}}


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return simulate(Scene.model_validate(SNAKE), 140.0, 20.0)


def origin_and_yaw(run: Trajectory, x: np.ndarray) -> tuple[complex, float]:
    place = run.scene.body.position + x
    heading = place[3] - place[0]
    origin = 0.5 * (place[0] + place[3])
    return complex(*origin), math.atan2(heading[1], heading[0])


def test_whole_turns_of_the_yaw_are_counted(run):
    assert abs(run.yaw[-1] - run.yaw[0]) > 2.0 * math.pi
    assert np.abs(np.diff(run.yaw)).max() < 0.5
    for k in (0, 700, -1):
        _, angle = origin_and_yaw(run, run.displacement[k])
        assert math.remainder(run.yaw[k] - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)
    assert run.waypoint_yaw[-1] == run.yaw[-1]


def test_the_gains_of_the_periods_lead_from_the_start_to_the_end(run):
    assert run.per_period.shape == (70, 3)
    place, yaw = origin_and_yaw(run, run.displacement[0])
    for dx, dy, dyaw in run.per_period:
        place += complex(dx, dy) * complex(math.cos(yaw), math.sin(yaw))
        yaw += dyaw
    end, _ = origin_and_yaw(run, run.displacement[-1])
    assert place == pytest.approx(end, abs=1e-12)
    assert yaw == pytest.approx(run.yaw[-1], abs=1e-12)


def test_a_body_that_repeats_its_period_walks_on_the_circle_of_its_screw(run):
    screw = run.screws[-1]
    before, after = (origin_and_yaw(run, run.waypoint_displacement[k]) for k in (-2, -1))
    places = [place + complex(*screw.centre) * complex(math.cos(yaw), math.sin(yaw)) for place, yaw in (before, after)]
    assert abs(places[1] - places[0]) < 1e-5 * screw.radius
    assert screw.radius == pytest.approx(abs(complex(*screw.centre)))


def test_the_gain_does_not_depend_on_the_direction_of_the_body(run):
    other = simulate(Scene.model_validate(turned(SNAKE, 0.7)), 4.0, 20.0)
    assert other.yaw[0] == pytest.approx(0.7)
    assert np.abs(other.per_period - run.per_period[:2]).max() < _SCATTER


def test_a_limit_cycle_repeats_up_to_a_rigid_motion(run):
    found = limit_cycle(Scene.model_validate(SNAKE), most_periods=50)
    assert found.settled
    assert found.periods < 20
    assert found.gains.shape == (found.periods, 3)
    assert np.abs(found.gain - run.per_period[-1]).max() < _SCATTER
    assert found.screw.radius == pytest.approx(run.screws[-1].radius, rel=1e-2)
    assert "m, m, rad a period" in repr(found)


def test_a_straight_body_gains_what_it_gains_on_the_line():
    """The friction of a link that becomes longer and shorter by D: it gains D - 2 mu_min / k in a period."""
    stroke, mu, k = 0.05, 0.1, 20.0
    scene = {
        "name": "inchworm",
        "dimension": 2,
        "body": {"points": [[0.0, 0.0], [0.2, 0.0]], "springs": "length", "links": {"stiffness": k}},
        "friction": {"forward": mu, "backward": 1.0, "left": 0.5, "right": 0.5},
        "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [stroke], [0.0]]},
    }
    for angle in (0.0, 0.7):
        run = simulate(Scene.model_validate(turned(scene, angle)), 3.0)
        assert run.per_period[-1] == pytest.approx([stroke - 2.0 * mu / k, 0.0, 0.0], abs=1e-9)
        assert run.screws[-1].radius is None
        assert run.yaw == pytest.approx(np.full(run.time.size, angle))
    found = limit_cycle(Scene.model_validate(scene))
    assert found.settled
    assert found.screw.centre is None


ARCH: dict[str, Any] = {
    "name": "arch",
    "dimension": 2,
    "body": {"points": [[0.0, 0.0], [1.0, 0.2], [2.0, 0.0]], "springs": "length", "links": {"stiffness": 20.0}},
    "friction": {"isotropic": [50.0, 0.0, 50.0]},
    "loads": 0,
    "drive": {
        "times": [0.0, 1.0],
        "actuation": [[0, 0], [0, 0]],
        "loads": [[[0, 0], [0, 0], [0, 0]], [[0, 0], [0, -0.2], [0, 0]]],
    },
}


def test_an_arch_snaps_through_where_its_load_is_the_largest():
    """Of height h it carries 2 k h (l / sqrt(1 + h^2) - 1), the most where 1 + h^2 = l^(2/3)."""
    run = simulate(Scene.model_validate(ARCH))
    rest = math.hypot(1.0, 0.2)
    height = math.sqrt(rest ** (2.0 / 3.0) - 1.0)
    largest = 40.0 * height * (rest / math.hypot(1.0, height) - 1.0)
    (jump,) = run.jumps
    assert jump.time == pytest.approx(largest / 0.2, abs=1e-4)
    assert (jump.contact, jump.border) == (1, None)
    assert jump.distance > 0.3
    assert jump.loss > 0.0
    assert run.energies.jump_loss.sum() == run.energy.jump_loss == jump.loss
    assert 0.0 <= run.stability_margin < 1e-3
    assert run.stability_time == pytest.approx(jump.time, abs=0.01)
    assert run.position[-1, 1, 1] < -0.2
    assert json.loads(json.dumps(run.summary()))["jumps"][0]["border"] is None


def test_a_body_that_must_not_jump_is_refused_at_that_time():
    with pytest.raises(CommandError, match=r"on_instability: refuse; .* \(the ramp ends at 0.31 s\)"):
        simulate(Scene.model_validate(ARCH | {"on_instability": "refuse"}))


def test_points_without_friction_do_not_count_in_the_net_translation():
    bare = SNAKE | {"friction": {"isotropic": [0.2, 0.0, 0.0, 0.3]}}
    run = simulate(Scene.model_validate(bare), 2.0)
    assert np.allclose(run.net_translation, run.displacement[:, [0, 3]].mean(axis=1), atol=1e-15)


def test_a_command_may_change_the_friction_of_points():
    crawler = Crawler(Scene.model_validate(SNAKE))
    crawler.advance([0, 0, 0, 0.1, 0], forward=[[0.2, 0.3, 0.4, 0.5]] * 4)
    assert crawler.friction.reshape(4, 4)[2].tolist() == [0.2, 0.3, 0.4, 0.5]
    assert crawler.row[:5].tolist() == [0.0, 0.0, 0.0, 0.1, 0.0]
    with pytest.raises(CommandError, match=r"forward: point 0 has .* all four must be > 0"):
        crawler.advance([0, 0, 0, 0.1, 0], forward=[[0.2, 0.3, 0.0, 0.5]] * 4)
    with pytest.raises(CommandError, match=r"actuation: shape \(3,\); it must be \(5,\)"):
        crawler.advance([0, 0, 0])
    with pytest.raises(SceneError, match="friction in four directions"):
        _ = crawler.forward


def test_the_forces_of_a_crawler_follow_from_its_tensions():
    crawler = Crawler(Scene.model_validate(SNAKE))
    crawler.advance([0.01, 0.0, 0.0, 0.5, -0.2])
    body = crawler.body
    assert crawler.spring_force == pytest.approx(body.force_at(crawler.displacement, crawler.tension), abs=1e-12)
    assert crawler.shape == pytest.approx(body.elongation(crawler.displacement), abs=1e-15)
    place = body.position + crawler.displacement
    part = load_of_friction(crawler.spring_force, forward_angles(body.turning, place), crawler.friction.reshape(4, 4))
    assert part.max() < 1.0 + 1e-9


def test_the_table_holds_ground_forces_torques_and_the_yaw(run):
    pytest.importorskip("pyarrow")
    table = run.to_table()
    assert np.array_equal(table["yaw"], run.yaw)
    assert np.array_equal(table["joint_1/torque"], run.tension[:, 4])
    ground = np.array([[table[f"contact_{i}/ground_force_{axis}"] for axis in "xy"] for i in range(4)])
    assert np.abs(ground.sum(axis=0)).max() < 1e-12


def test_energies_are_balanced(run):
    assert run.energy.relative_residual < 1e-5
    spent = run.energies.dissipation[1:] + np.diff(run.energies.stored) + run.energies.jump_loss[1:]
    assert np.abs(spent - run.energies.work[1:]).max() < 1e-6


def test_the_summary_has_what_only_these_bodies_have(run, tmp_path):
    file = tmp_path / "snake.yaml"
    file.write_text(json.dumps(SNAKE))
    done = crawler("simulate", file, "--duration", "4", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert np.array(found["displacement"]).shape == (3, 4, 2)
    assert np.array(found["per_period"]).shape == (2, 3)
    assert len(found["yaw"]) == len(found["time"]) == 3
    assert found["screws"][-1].keys() == {"centre", "radius"}
    assert {"stability_margin", "stability_time"} <= found.keys()
    assert found["jumps"] == []


def test_check_describes_the_body(tmp_path):
    file = tmp_path / "snake.yaml"
    file.write_text(json.dumps(SNAKE))
    done = crawler("check", file)
    assert done.returncode == 0, done.stderr
    text = " ".join(done.stdout.split())
    assert "snake: 4 points, 3 links, 2 joints in the plane; valid" in text
    assert "in the last period, along and across its heading:" in text
    assert "on a circle of radius" in text
    assert "largest torque:" in text
