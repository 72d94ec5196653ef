"""Gaits of bodies that turn."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cma")

from crawler_lab import Posterior, optimise, pareto
from crawler_lab.optimise.bodies import _DRAWN, _SEED, spread_over
from crawler_lab.optimise.optimise import build_space
from crawler_lab.optimise.request import Request
from crawler_lab.optimise.search import _STALE_ROUNDS
from crawler_model import CrawlerError, Scene, limit_cycle, load_scene, simulate

SCISSORS = load_scene("scissors")
OPENED = "drive.actuation[1][2]"


def scissors(opened: float) -> Scene:
    """The gallery's, opened by another angle."""
    document = SCISSORS.document()
    document["drive"]["actuation"][1][2] = opened
    return Scene.model_validate(document)


def test_the_largest_turn_is_that_of_the_full_stroke():
    """Closed form: A - 2 r mu_min/c."""
    best = optimise(SCISSORS, "turn", free={OPENED: (0.0, 0.8)})
    assert best.value == pytest.approx(0.8 - 2.0 * 0.1 / 5.0, abs=1e-5)
    assert best.unit == "rad"
    assert best.values == pytest.approx([0.8])
    assert [(bound.name, bound.side) for bound in best.active_bounds] == [(OPENED, "upper")]
    assert best.motion == pytest.approx(simulate(best.scene, 3.0).per_period[-1].tolist(), abs=1e-5)
    assert best.complete


def test_waypoints_move_the_joints_of_the_drive_alone():
    best = optimise(SCISSORS, "turn", waypoints=2, seconds=1.0)
    assert best.names == ("drive.actuation[0][2]", OPENED)
    assert best.value == pytest.approx(0.46, abs=1e-5)
    rows = np.array(best.scene.document()["drive"]["actuation"])
    assert np.abs(rows[:, :2]).max() == 0.0
    assert np.ptp(rows[:, 2]) == pytest.approx(0.5)


def test_a_motion_is_reached():
    target = limit_cycle(scissors(0.3)).gain
    assert target[2] == pytest.approx(0.26, abs=1e-5)
    best = optimise(SCISSORS, "screw", free={OPENED: (0.0, 0.8)}, target=target)
    assert best.values == pytest.approx([0.3], abs=1e-3)
    assert best.value == pytest.approx(0.0, abs=1e-3)
    assert best.motion == pytest.approx(target.tolist(), abs=1e-3)


def test_a_body_without_a_drive_needs_strokes_by_name():
    document = SCISSORS.document()
    del document["drive"]
    still = Scene.model_validate(document)
    best = optimise(still, "turn", waypoints=2, stroke={"joint_0": (0.0, 0.5)}, seconds=1.0)
    assert best.value == pytest.approx(0.46, abs=1e-5)
    with pytest.raises(CrawlerError, match="stroke: missing"):
        optimise(still, "turn", waypoints=2)
    with pytest.raises(CrawlerError, match="stroke: 'joint_1'; the links and joints are link_0, link_1, joint_0"):
        optimise(still, "turn", stroke={"joint_1": (0.0, 0.5)})


@pytest.mark.parametrize("name", ["planar_rectilinear", "planar_three_points"])
def test_a_drive_in_the_plane_that_moves_nothing_is_no_stroke(name):
    document, links = load_scene(name).document(), load_scene(name).body.springs
    document["drive"] = {"times": [0.0, 1.0], "actuation": [[[0.01, 0.0]] * links] * 2}
    with pytest.raises(CrawlerError, match="stroke: missing, and the drive of the scene moves none of link_0/x, "):
        optimise(Scene.model_validate(document), towards=0.0, waypoints=2)


def test_a_number_of_the_scene_is_free():
    """The turn is largest where sliding to the left costs least."""
    free = {"body.joints.stiffness": (2.0, 10.0)}
    best = optimise(SCISSORS, "turn", free=free, seconds=1.0)
    assert best.values == pytest.approx([10.0])
    assert best.value == pytest.approx(0.5 - 2.0 * 0.1 / 10.0, abs=1e-5)


STIFFNESS = "body.joints.stiffness"


def test_the_worst_turn_is_that_of_the_softest_joint_and_a_softer_one_stops_it():
    best = optimise(SCISSORS, "turn", free={OPENED: (0.0, 0.8)}, robust={STIFFNESS: (0.8, 1.2)}, seconds=60.0)
    opened = best.values[0]
    assert best.value == pytest.approx(opened - 2.0 * 0.1 / (0.8 * 5.0), abs=1e-5)
    (weakness,) = best.weaknesses
    assert weakness.below == pytest.approx(2.0 * 0.1 / (5.0 * opened), rel=1e-3)
    assert weakness.above is None


def test_the_expected_turn_is_the_mean_over_the_drawn_bodies():
    known = Posterior((STIFFNESS,), np.array([5.0]), np.array([[0.25]]))
    unknowns, space = build_space(SCISSORS, Request("turn", free={OPENED: (0.0, 0.8)}))
    space = spread_over(space, unknowns, known, "expected")
    drawn = known.draw_bodies(np.random.default_rng(_SEED), _DRAWN)[STIFFNESS]
    assert np.ptp(drawn) > 0.1
    assert space.scores([np.ones(1)])[0] == pytest.approx(0.8 - 0.2 * np.mean(1.0 / drawn), abs=1e-5)


def test_the_nearest_motion_fails_where_standing_still_is_as_near():
    target = limit_cycle(scissors(0.3)).gain
    _, space = build_space(SCISSORS, Request("screw", free={OPENED: (0.0, 0.6)}, target=target))
    (reached,), (still,) = space.regimes(np.array([[0.5], [0.0]]))
    assert space.goal.progress(reached) == pytest.approx(np.hypot(np.hypot(*target[:2]), target[2]), abs=1e-4)
    assert space.goal.progress(still) == 0.0


def test_compromises_between_going_far_and_going_cheaply(monkeypatch):
    monkeypatch.setitem(pareto.__globals__, "_POINTS", 1)
    monkeypatch.setitem(_STALE_ROUNDS, 2, 1)
    found = pareto(SCISSORS, free={OPENED: (0.0, 0.8)}, towards=90, seconds=3600.0)  # far more than it takes
    assert found.complete
    assert len(found.points) >= 2
    for better, cheaper in zip(found.points, found.points[1:], strict=False):
        assert better.gain > cheaper.gain > 0.0
        assert better.cost_of_transport > cheaper.cost_of_transport
    gain = limit_cycle(found.points[0].scene).gain
    assert gain[1] == pytest.approx(found.points[0].gain, abs=1e-4)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"objective": "travel"}, "must be one of translation, cost-of-transport, turn, screw"),
        ({"tension": 1.0}, "tension: not available for scissors, which turns; leave it out"),
        ({"free": {"friction": (0.0, 1.0)}}, "free: friction: scissors turns"),
        ({"objective": "screw"}, "target: missing; the objective 'screw' needs dx, dy, dyaw"),
        ({"objective": "screw", "target": (0.0, 1.0)}, "it must be three finite numbers"),
        ({"objective": "screw", "target": (0.0, 1.0, np.nan)}, "it must be three finite numbers"),
    ],
)
def test_a_mistake_is_one_line(given, message):
    with pytest.raises(CrawlerError) as error:
        optimise(SCISSORS, **given)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
