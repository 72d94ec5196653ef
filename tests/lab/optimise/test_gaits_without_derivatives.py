"""Gaits in the plane, and on ground that differs from place to place."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

pytest.importorskip("cma")

from crawler_lab import optimise, pareto
from crawler_lab.optimise import search
from crawler_lab.optimise.space import Evaluator
from crawler_model import CrawlerError, Scene, SceneError, load_scene, simulate

STROKE = {"drive.actuation[1][0][0]": (0.0, 0.2)}


def rotated() -> Scene:
    """The scene `planar_rectilinear`, along y."""
    document = load_scene("planar_rectilinear").document()
    document["body"]["contacts"] = [[0.0, 0.0], [0.0, 0.2]]
    document["friction"] = {"directions": [0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi], "value": [0.4, 0.2, 0.4, 0.5]}
    document["drive"]["actuation"] = [[[0.0, 0.0]], [[0.0, 0.1]], [[0.0, 0.0]]]
    return Scene.model_validate(document)


def test_the_longest_stroke_in_the_plane_gains_most():
    """Closed form: D - 2 mu_plus / k."""
    best = optimise("planar_rectilinear", free=STROKE)
    assert best.values == pytest.approx([0.2])
    assert best.value == pytest.approx(0.2 - 2.0 * 0.2 / 20.0, abs=1e-4)
    assert best.motion == pytest.approx((best.value, 0.0), abs=1e-4)
    assert best.complete


def test_an_unknown_changes_something_if_a_step_beyond_the_tolerance_does():
    """Of a narrow range, the step that shows it for exact scores changes less than the tolerance."""
    best = optimise("planar_rectilinear", free={"drive.actuation[1][0][0]": (0.096, 0.1)})
    assert best.value == pytest.approx(0.1 - 2.0 * 0.2 / 20.0, abs=1e-4)
    assert best.flat == ()
    assert best.unique


def test_without_a_cost_of_transport_nothing_is_compared_with_it():
    still = optimise("planar_rectilinear", "cost-of-transport", free={"drive.actuation[1][0][0]": (0.0, 0.001)})
    assert math.isnan(still.value)
    assert still.flat == ()
    assert not still.unique


def test_of_a_slow_body_the_rest_of_the_transient_is_told_and_does_not_hide_the_cost(monkeypatch):
    """Its tensions change for more than a hundred periods: the periods of the search end before."""
    rows = np.zeros((3, 7, 2))
    rows[1, 0], rows[1, 6], rows[2, 3] = (0.02, 0.0), (0.02, 0.01), (0.02, 0.01)
    places = [[0.1 * i, 0.02 * (i > 0 and i % 2 == 0)] for i in range(8)]
    document = {
        "name": "slow",
        "dimension": 2,
        "body": {"contacts": places, "links": {"stiffness": 5.0}},
        "friction": {"directions": [0.0, 1.5708, 3.1416, 4.7124], "value": [0.02, 0.05, 0.06, 0.05]},
        "start": "relaxed",
        "drive": {"times": [0.0, 0.33, 0.66], "period": 1.0, "actuation": rows.tolist()},
    }
    scene = Scene.model_validate(document)
    monkeypatch.setattr(search, "MOST_EVALUATIONS", 20)
    found = optimise(scene, free={"drive.actuation[1][0][0]": (0.0199, 0.0201)})
    run = simulate(found.scene, 200.0, 1.0)
    apart = np.linalg.norm(run.per_period[-1] - np.array(found.motion))
    assert apart <= found.transient_left + 1e-8 < 1e-5
    assert found.cost_of_transport == pytest.approx(4.0 / 9.0, rel=1e-3)


def test_waypoints_in_the_plane_are_components_of_links():
    best = optimise("planar_rectilinear", waypoints=2, stroke={"link_0/x": (0.0, 0.1)}, seconds=0.5)
    assert best.names == ("drive.actuation[0][0][0]", "drive.actuation[1][0][0]")
    assert simulate(best.scene, 3.0).per_period[-1] == pytest.approx([best.value, 0.0], abs=1e-4)
    both = optimise("planar_rectilinear", waypoints=2, stroke={"link_0": (0.0, 0.1)}, seconds=0.2)
    assert len(both.names) == 4


def test_the_time_limit_leaves_out_the_rest_of_a_batch(monkeypatch):
    """In the plane a batch takes long: a limit that waited for its end would be exceeded many times over."""
    best = optimise("planar_rectilinear", free=STROKE, seconds=0.2)
    asked = []

    def over() -> bool:
        asked.append(True)
        return len(asked) > 2

    monkeypatch.setattr(sys.modules[Evaluator.__module__], "available_cores", lambda: 1)
    evaluator = Evaluator(best.space, over)
    scores = evaluator.scores([np.full(1, part) for part in (0.25, 0.5, 0.75, 1.0)])
    assert scores[:2] == pytest.approx([0.05 - 0.02, 0.1 - 0.02], abs=1e-4)  # D - 2 mu_plus / k
    assert np.isneginf(scores[2:]).all()
    assert np.isfinite(Evaluator(best.space, lambda: True).scores([best.point])).all()


def test_a_direction_is_chosen():
    free = {"drive.actuation[1][0][1]": (0.0, 0.1)}
    assert optimise(rotated(), free=free, towards=90.0).value == pytest.approx(0.08, abs=1e-4)
    assert optimise(rotated(), free=free, towards=60.0).value == pytest.approx(0.08 * math.sin(math.pi / 3), abs=1e-4)
    assert optimise(rotated(), free=free).value == pytest.approx(0.0, abs=1e-4)
    across = optimise(load_scene("planar_rectilinear"), waypoints=2, seconds=1.0, towards=90.0)
    assert across.value == across.gain == 0.0  # the cosine of 90 degrees is not
    assert across.motion is not None
    assert across.motion[0] > 0.0


def test_on_patches_the_first_periods_count():
    """Closed form on the rough ground: D - 1.5 mu_plus / k in the first period, then D - 2 mu_plus / k."""
    step = load_scene("friction_step")
    best = optimise(step, free={"drive.actuation[1][0]": (0.0, 0.1)}, periods=2)
    assert best.value == pytest.approx(0.1 - 1.75 * 0.2 / 20.0)
    assert best.periods == 2
    farther = optimise(step, free={"drive.actuation[1][0]": (0.0, 0.1)})
    assert farther.periods == 10
    assert farther.value == pytest.approx(simulate(step, 10.0).per_period.mean())


def test_on_ground_that_changes_gradually_and_before_a_wall_the_first_periods_count():
    """The closed form of the first stroke on friction mu + a x; at the wall the rear ends where the spring rests."""
    mu, a, k, stroke, length, q = 0.2, 0.5, 20.0, 0.1, 0.2, 1.0 / (1.0 + 0.5 / 20.0)
    document = load_scene("wall_pusher").document()
    document |= {"friction": {"forward": 1.0, "backward": 50.0}}
    factors = {"forward": [mu, mu + 10.0 * a], "backward": [1.0, 1.0]}
    walls, profile = document.pop("ground"), {"profile": {"at": [0.0, 10.0], "friction": factors}}
    free = {"drive.actuation[1][0]": (0.0, stroke)}
    best = optimise(Scene.model_validate(document | {"ground": profile}), free=free, periods=1)
    front = q * (length + stroke - mu / k)
    assert best.values == pytest.approx([stroke])
    assert best.value == pytest.approx(0.5 * (front - length + q * (front - length - mu / k)))
    document |= {"friction": {"forward": mu, "backward": 0.5}, "ground": walls}
    pushing = optimise(Scene.model_validate(document), free=free, periods=7)
    assert pushing.value == pytest.approx((0.5 - length - 0.5 * mu / k) / 7.0)


@pytest.mark.parametrize("name", ["hill_top", "ice"])
def test_the_gait_on_patches_is_that_of_its_scene(name):
    best = optimise(name, waypoints=3, seconds=5.0)  # in which the gait is examined, too
    run = simulate(best.scene)
    assert run.per_period.mean() == pytest.approx(best.value, abs=1e-12)
    assert best.value > 0.9 * simulate(load_scene(name)).per_period.mean()
    assert best.peak_tension == pytest.approx(np.abs(run.tension).max(), rel=0.02)


def test_the_cost_of_transport_is_that_of_the_run():
    best = optimise("planar_rectilinear", "cost-of-transport", free=STROKE)
    last = simulate(best.scene, 3.0)
    work = simulate(best.scene, 3.0).energy.work - simulate(best.scene, 2.0).energy.work
    force = 2 * (0.2 + 0.4 + 0.5 + 0.4) / 4
    assert best.cost_of_transport == pytest.approx(work / (last.per_period[-1][0] * force), rel=1e-3)


def test_compromises_exist_on_patches_too():
    front = pareto("friction_step", free={"drive.actuation[1][0]": (0.01, 0.1)}, periods=2, seconds=2.0)
    assert front.points[0].gain == pytest.approx(0.0825)


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        (
            "planar_rectilinear",
            {"tension": 1.0},
            "tension: not available for planar_rectilinear, which is in the plane",
        ),
        ("ice", {"tension": 1.0}, "tension: not available for ice, which has ground.patches; limit stroke or rate"),
        ("planar_rectilinear", {"periods": 3}, "periods: planar_rectilinear has one ground everywhere"),
        ("ice", {"periods": 0}, "periods: 0; it must be a whole number between 1 and"),
        ("ice", {"towards": 90.0}, "towards: ice is on a line, where the gain towards +x counts"),
        ("planar_rectilinear", {"towards": math.nan}, "towards: nan; it must be an angle in degrees"),
        ("planar_rectilinear", {"stroke": {"link_1": (0, 1)}}, "the links and joints are link_0/x, link_0/y"),
        ("planar_rectilinear", {"objective": "turn"}, "'turn'; planar_rectilinear does not turn"),
        ("planar_rectilinear", {"free": {"friction": (0, 1)}}, "free: friction: planar_rectilinear is in the plane"),
    ],
)
def test_a_mistake_is_one_line(name, given, message):
    with pytest.raises(CrawlerError) as error:
        optimise(name, **given)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_start_elsewhere_is_refused_on_patches():
    document = load_scene("ice").document() | {"start": {"displacement": 0.1}}
    with pytest.raises(CrawlerError, match=r"start\.displacement: ice has ground\.patches, where gaits"):
        optimise(Scene.model_validate(document))


def test_a_gait_over_regions_of_the_plane_counts_its_first_periods():
    """Its value is the mean gain of three periods along the x axis, as a run of it shows; on ice it is another one."""
    document = load_scene("planar_rectilinear").document()
    found = []
    for factor in (1.0, 0.5):
        ground = {"regions": [{"left_of": [[0.35, 1.0], [0.35, -1.0]], "friction": factor}]}
        scene = Scene.model_validate(document | {"ground": ground, "start": "relaxed"})
        best = optimise(scene, waypoints=2, stroke={"link_0/x": (0.0, 0.1)}, periods=3, seconds=0.2)
        run = simulate(best.scene, 3.0 * best.scene.drive.period)
        assert best.value == pytest.approx((run.net_translation[-1, 0] - run.net_translation[0, 0]) / 3.0, abs=1e-6)
        found.append(best.value)
    assert found[0] != pytest.approx(found[1], rel=1e-3)


def test_gaits_of_bodies_that_turn_are_not_sought_over_regions():
    with pytest.raises(SceneError, match=r"snake_over_two_grounds has ground.regions, over which gaits of bodies that"):
        optimise("snake_over_two_grounds", "translation", waypoints=3, seconds=0.1)
