"""Gaits of bodies that turn."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cma")

from crawler_model import CrawlerError, Scene, limit_cycle, load_scene, optimise, simulate

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


def test_a_number_of_the_scene_is_free():
    """The turn is largest where sliding to the left costs least."""
    free = {"body.joints.stiffness": (2.0, 10.0)}
    best = optimise(SCISSORS, "turn", free=free, seconds=1.0)
    assert best.values == pytest.approx([10.0])
    assert best.value == pytest.approx(0.5 - 2.0 * 0.1 / 10.0, abs=1e-5)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"objective": "travel"}, "must be one of translation, cost-of-transport, turn, screw"),
        ({"tension": 1.0}, "tension: not available for scissors, which turns; leave it out"),
        ({"free": {"friction": (0.0, 1.0)}}, "free: friction: scissors turns"),
        ({"objective": "screw"}, "target: None; the objective 'screw' needs dx, dy, dyaw"),
        ({"objective": "screw", "target": (0.0, 1.0)}, "it must be three finite numbers"),
        ({"objective": "screw", "target": (0.0, 1.0, np.nan)}, "it must be three finite numbers"),
    ],
)
def test_a_mistake_is_one_line(given, message):
    with pytest.raises(CrawlerError) as error:
        optimise(SCISSORS, **given)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
