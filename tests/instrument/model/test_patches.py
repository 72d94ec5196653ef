"""Patches of ground: borders that hold a contact, jumps with their loss, hills, ties, and a slow reference."""

from __future__ import annotations

import math

import numpy as np
import pytest

from crawler_model import (
    CommandError,
    Crawler,
    Scene,
    SceneError,
    largest_tow,
    load_scene,
    simulate,
    steepest_climb,
)

from .bodies import Drawn
from .patches_reference import Reference

CHAIN, GRAPH = None, [[0, 1], [0, 1]]
BODIES = pytest.mark.parametrize("between", [CHAIN, GRAPH], ids=["chain", "graph"])


def two(patches, forward=0.4, backward=1.0, between=CHAIN, slope=None, **more) -> Scene:
    """Two contacts, 1 m apart, on a spring of 1 N/m, as one link or as two."""
    links = {"stiffness": 1.0} if between is None else {"stiffness": 0.5, "between": between}
    ground = {"patches": patches} | ({} if slope is None else {"slope": slope})
    body = {"contacts": [0.0, 1.0], "links": links, **more.pop("body", {})}
    friction = more.pop("friction", {"forward": forward, "backward": backward})
    return Scene.model_validate({"name": "two", "body": body, "friction": friction, "ground": ground, **more})


def go(crawler: Crawler, length: float, **more):
    return crawler.advance([length] * crawler.scene.columns.links, **more)


def ice(factor=0.5, start=1.25, stop=9.0, **more):
    return [{"from": start, "to": stop, "friction": factor, **more}]


@BODIES
@pytest.mark.parametrize("factor", [0.5, 0.25, 0.0])
def test_a_step_down_in_friction_makes_a_contact_jump(between, factor):
    """The front slides from L = 0.4 to the border at L = 0.65 and jumps by (mu - mu') / k, losing (mu - mu')^2 / 2 k."""
    crawler = Crawler(two(ice(factor), between=between))
    step = go(crawler, 2.0)
    drop = 0.4 * (1.0 - factor)
    (jump,) = step.jumps
    assert (jump.contact, jump.border) == (1, 1.25)
    assert jump.fraction == pytest.approx(0.325, abs=1e-13)
    assert jump.distance == pytest.approx(drop, abs=1e-13)
    assert jump.loss == step.jump_loss == pytest.approx(0.5 * drop**2, abs=1e-13)
    assert crawler.displacement == pytest.approx([0.0, 2.0 - 0.4 * factor], abs=1e-13)
    assert abs(step.certificate.energy_residual) < 1e-14
    assert crawler.places.tolist() == [0, 2]


@BODIES
def test_a_step_up_in_friction_holds_a_contact_until_the_force_has_grown(between):
    crawler = Crawler(two(ice(2.0), between=between))
    for length, x, place in ((0.65, 0.25, 1), (1.0, 0.25, 1), (1.05, 0.25, 1), (1.2, 0.4, 2)):
        step = go(crawler, length)
        assert crawler.displacement == pytest.approx([0.0, x], abs=1e-13)
        assert crawler.places[1] == place
        assert step.jumps == ()


@BODIES
def test_from_a_border_a_contact_goes_back_over_the_ground_behind(between):
    crawler = Crawler(two(ice(2.0), [9.0, 0.4], [9.0, 1.0], between=between))
    go(crawler, 0.9)
    go(crawler, -2.0)  # the force falls from 0.65 to -1, the bound of the ground behind, not to -2
    assert crawler.displacement == pytest.approx([0.0, -1.0], abs=1e-13)
    assert crawler.places.tolist() == [0, 0]


def test_a_jump_ends_at_a_border_that_holds_it():
    patches = [{"from": 1.25, "to": 1.3, "friction": 0.0}, {"from": 1.3, "to": 2.0, "friction": 0.9}]
    step = go(crawler := Crawler(two(patches)), 0.655)
    (jump,) = step.jumps
    assert jump.distance == pytest.approx(0.05, abs=1e-14)
    assert jump.loss == pytest.approx(0.05 * 0.4 - 0.5 * 0.05**2, abs=1e-14)
    assert crawler.places[1] == 3
    assert abs(step.certificate.energy_residual) < 1e-15


def test_a_jump_may_meet_further_ice_and_a_border_where_it_would_end():
    patches = [
        {"from": 1.25, "to": 1.35, "friction": 0.5},
        {"from": 1.35, "to": 1.55, "friction": 0.25},
        {"from": 1.55, "to": 3.0, "friction": 0.125},
    ]
    crawler = Crawler(two(patches))
    step = go(crawler, 0.65)  # g is 0.4 at 1.25, 0.3 at 1.35, 0.1 at 1.55, which holds exactly; beyond it 0.05 does
    assert [jump.border for jump in step.jumps] == [1.25, 1.35, 1.55]
    assert sum(jump.distance for jump in step.jumps) == pytest.approx(0.35, abs=1e-13)
    assert step.jump_loss == pytest.approx(0.5 * (0.4**2 - 0.05**2) - 0.2 * 0.1 - 0.1 * 0.2 - 0.05 * 0.05, abs=1e-13)
    assert crawler.displacement[1] == pytest.approx(0.6, abs=1e-13)


def test_a_contact_on_a_border_at_the_start_stands_on_it():
    crawler = Crawler(two(ice(0.5, start=1.0)))
    assert crawler.places.tolist() == [0, 1]
    assert crawler.margins == pytest.approx([0.4, 0.2])  # forward the ice, backward the ground
    step = go(crawler, 1.0)
    assert crawler.displacement == pytest.approx([0.0, 0.8], abs=1e-14)
    assert step.jumps == ()
    there = Crawler(two([{"from": 0.3, "to": 2.0, "friction": 0.5}], body={"contacts": [-1.0, 0.1 + 0.2]}))
    assert there.places.tolist() == [0, 1]


def test_contacts_that_meet_borders_together_mirror_each_other():
    links = {"stiffness": 1.0}
    patches = [{"from": -3.0, "to": -1.25, "friction": 0.5}, {"from": 1.25, "to": 3.0, "friction": 0.5}]
    body = {"contacts": [-1.0, 0.0, 1.0], "links": links}
    friction = {"isotropic": [0.4, 9.0, 0.4]}
    scene = {"name": "three", "body": body, "friction": friction, "ground": {"patches": patches}}
    crawler = Crawler(Scene.model_validate(scene))
    step = crawler.advance([1.0, 1.0])
    assert crawler.displacement == pytest.approx([-0.8, 0.0, 0.8], abs=1e-13)
    assert [jump.contact for jump in step.jumps] == [0, 2]
    assert crawler.displacement[0] == -crawler.displacement[2]


@BODIES
def test_the_foot_of_a_hill_holds_and_its_top_lets_go(between):
    """Up a slope of 10 degrees w sin(theta) is added to the forward bound; behind the top it is taken away."""
    tilt = math.sin(math.radians(10.0))
    hill = [{"from": 1.25, "to": 1.5, "slope": 10.0}, {"from": 1.5, "to": 1.75, "slope": -10.0}]
    crawler = Crawler(two(hill, between=between, body={"weights": [0.0, 1.0]}))
    go(crawler, 0.6 + tilt)
    assert crawler.displacement[1] == pytest.approx(0.25, abs=1e-13)
    assert crawler.places[1] == 1
    go(crawler, 0.75 + tilt)
    assert crawler.displacement[1] == pytest.approx(0.35, abs=1e-13)
    step = go(crawler, 0.9 + tilt)
    (jump,) = step.jumps  # to the foot behind the top, 0.25 m on, where level ground holds g = 0.4 + tilt - 0.25
    assert jump.border == 1.5
    assert jump.distance == pytest.approx(0.25, abs=1e-13)
    assert crawler.places[1] == 5
    loss = 0.5 * (0.4 + tilt) ** 2 - 0.5 * (0.15 + tilt) ** 2 - 0.25 * (0.4 - tilt)
    assert step.jump_loss == pytest.approx(loss, abs=1e-13)
    assert abs(step.certificate.energy_residual) < 1e-14


def test_coefficients_follow_the_slope_of_a_patch():
    friction = {"coefficient": {"forward": 0.4, "backward": 1.0}}
    crawler = Crawler(two([{"from": 0.5, "to": 9.0, "slope": 30.0}], friction=friction, body={"weights": 1.0}))
    assert crawler.margins[1] == pytest.approx(math.sqrt(0.75) - 0.5)


@BODIES
def test_ground_that_holds_nothing_is_refused_when_it_is_reached_and_changes_nothing(between):
    ledge = [{"from": -1.0, "to": 1.25, "slope": 0.0}]
    crawler = Crawler(two(ledge, 0.4, 1.0, between=between, slope=-80.0, body={"weights": 3.0}))
    go(crawler, 0.6)
    before = crawler.copy()
    with pytest.raises(CommandError) as refused:
        go(crawler, 0.7)
    assert str(refused.value) == (
        "ground.patches: on the ground that the contacts reach, the loads sum to 5.90885 N forward, and friction "
        "against sliding forward to no more than 0.8 N: no equilibrium, the body would run away"
    )
    assert crawler == before
    go(crawler, 0.6)


@BODIES
def test_a_body_that_nothing_holds_slides_to_the_foot_of_the_hill(between):
    """The front drags the rear along at L = 0.65, until the front stands at the foot."""
    cliff = [{"from": 1.25, "to": 2.25, "slope": -80.0}]
    crawler = Crawler(two(cliff, 0.4, 1.0, between=between, body={"weights": 3.0}))
    step = go(crawler, 0.7)
    (jump,) = step.jumps
    assert crawler.places.tolist() == [0, 3]
    assert jump.distance == pytest.approx(1.0, abs=1e-12)
    tension = crawler.displacement[1] - crawler.displacement[0] - 0.7
    assert tension == pytest.approx(0.4 - 0.05, abs=1e-12)
    assert abs(step.certificate.energy_residual) < 1e-12
    loads = 3.0 * math.sin(math.radians(80.0)) * 1.0
    friction = 0.4 * crawler.displacement.sum()
    stored = 0.5 * tension**2
    assert step.loads_work == pytest.approx(loads, abs=1e-12)
    assert step.dissipation == pytest.approx(friction, abs=1e-12)
    assert step.jump_loss == pytest.approx(step.work + loads - friction - stored, abs=1e-12)


@BODIES
def test_friction_commanded_below_what_a_slope_needs_lets_the_body_slide_to_its_foot(between):
    """Both forward bounds are 0 on the way, when friction equals the load of 0.5 N; the front then stands at 3 m."""
    hill = [{"from": -5.0, "to": 3.0, "slope": -30.0}]
    crawler = Crawler(two(hill, 1.0, 1.0, between=between, body={"weights": 1.0}))
    step = go(crawler, 0.0, forward=[0.4, 0.4], backward=[0.4, 0.4])
    assert crawler.displacement == pytest.approx([2.1, 2.0], abs=1e-12)
    (jump,) = step.jumps
    assert (jump.contact, jump.border, jump.loss) == (1, 3.0, 0.0)
    assert jump.distance == pytest.approx(2.0, abs=1e-12)
    assert abs(step.certificate.energy_residual) < 1e-12


def test_commanded_friction_and_that_of_the_place_multiply():
    crawler = Crawler(two(ice(0.5, start=0.5)))
    go(crawler, 0.0, forward=[0.4, 0.8], backward=[1.0, 1.0])
    assert crawler.forward.tolist() == [0.4, 0.8]
    go(crawler, 1.0)
    assert crawler.displacement == pytest.approx([0.0, 0.6], abs=1e-14)


def test_a_run_lists_its_jumps_at_their_times():
    drive = {"times": [0.0, 2.0, 4.0], "period": 4.0, "actuation": [[0.0], [2.0], [0.0]]}
    run = simulate(two(ice(), drive=drive), duration=4.0, rate=3.0)
    summary = run.summary()
    jump, of_rear = summary["jumps"]
    assert (jump["contact"], of_rear["contact"]) == (1, 0)
    assert list(jump) == ["time", "contact", "border", "distance", "loss"]
    assert jump["time"] == pytest.approx(0.65, abs=1e-12)
    assert summary["jump_loss"] == run.energy.jump_loss == pytest.approx(0.04, abs=1e-13)
    assert run.energy.relative_residual < 1e-14
    assert simulate(two([{"from": 50.0, "to": 51.0, "friction": 2.0}], drive=drive), 4.0).summary()["jumps"] == []


@pytest.mark.parametrize("name", ["two_anchor_a", "ten_contact_wave", "three_springs", "hybrid_body"])
def test_a_patch_far_away_changes_nothing(name):
    scene = load_scene(name)
    document = scene.document() | {"ground": {"patches": [{"from": 1e3, "to": 2e3, "friction": 0.5}]}}
    one, other = simulate(scene, rate=7.0), simulate(Scene.model_validate(document), rate=7.0)
    assert one.displacement == pytest.approx(other.displacement, abs=1e-13)
    assert one.tension == pytest.approx(other.tension, abs=1e-13)
    assert one.unique == other.unique


def random_body(seed: int) -> tuple[Scene, Reference, np.random.Generator]:
    rng = np.random.default_rng(seed)
    n, graph = int(rng.integers(2, 5)), bool(seed % 2)
    position = np.arange(n) + rng.uniform(-0.2, 0.2, n)
    ends = np.array([[i, i + 1] for i in range(n - 1)] + ([[0, n - 1]] if graph else []))
    stiffness = np.exp(rng.uniform(-1, 1, len(ends)))
    forward, backward = np.exp(rng.uniform(-2, 0, (2, n)))
    cuts, factor = np.sort(rng.uniform(-1, n, 4)), np.exp(rng.uniform(-1.5, 1.0, (2, 2)))
    slope = np.degrees(rng.uniform(-0.1, 0.1, 2)) * (seed % 3 == 0)
    sides, tilt = np.ones((2, 5, 1)), np.zeros((5, 1))
    sides[:, [1, 3], 0], tilt[[1, 3], 0] = factor, -np.sin(np.radians(slope))
    keys = ("from", "to", "forward", "backward", "slope")
    patches = [
        dict(zip(keys, map(float, (cuts[2 * j], cuts[2 * j + 1], *factor[:, j], slope[j])), strict=True))
        for j in range(2)
    ]
    links = {"stiffness": stiffness.tolist(), "between": ends.tolist()}
    scene = Scene.model_validate(
        {
            "name": "random",
            "body": {"contacts": position.tolist(), "weights": 1.0, "links": links},
            "friction": {"forward": forward.tolist(), "backward": backward.tolist()},
            "ground": {"patches": patches},
        }
    )
    bounds = sides[0] * forward - tilt, sides[1] * backward + tilt
    return scene, Reference(position, ends, stiffness, cuts, *bounds, np.zeros(n)), rng


@pytest.mark.parametrize("seed", range(6))
def test_random_bodies_against_the_reference(seed):
    scene, reference, rng = random_body(seed)
    crawler, loss = Crawler(scene), 0.0
    for _ in range(2):
        length = rng.uniform(-2.0, 2.0, scene.columns.links)
        loss += crawler.advance(length).jump_loss
        reference.ramp(length)
        assert crawler.displacement == pytest.approx(reference.x, abs=1e-11)
    assert loss == pytest.approx(sum(reference.losses), abs=1e-11)


REFUSED = [
    ({"from": 1.0, "to": 1.0, "friction": 2.0}, "to: 1 m; it must be greater than `from`, 1 m"),
    ({"from": 1.0, "to": 2.0}, "give `friction`, `forward`, `backward` or `slope`"),
    ({"from": 1.0, "to": 2.0, "friction": -1.0}, "friction: -1; a factor on friction must be >= 0"),
    ({"from": 1.0, "to": 2.0, "friction": 1.0, "forward": 1.0}, "not both"),
    ({"from": 1.0, "to": 2.0, "slope": 90.0}, "slope: 90 degrees; it must be between -90 and 90"),
    ({"from": 1.0, "to": 2.0, "slope": 9.0}, "body.weights: missing; the slope of a patch acts on the weight"),
    ({"from": 1.0, "to": 2.0, "fricton": 2.0}, "ground.patches.0.fricton: unknown key; the nearest known key is"),
    ({"from": 1.0, "friction": 2.0}, "ground.patches.0.to: missing"),
]


@pytest.mark.parametrize(("patch", "text"), REFUSED)
def test_what_does_not_fit_is_one_clear_line(patch, text):
    with pytest.raises(SceneError) as refused:
        two([patch])
    assert text in str(refused.value)
    assert "\n" not in str(refused.value)


def test_patches_are_given_in_order_without_overlap():
    with pytest.raises(SceneError, match=r"ground: patches: patch 1 starts at 1.5 m, before patch 0 ends at 2 m"):
        two([{"from": 1.0, "to": 2.0, "friction": 2.0}, {"from": 1.5, "to": 3.0, "friction": 2.0}])


def test_a_sharp_top_is_no_place_to_start_on():
    tops = [{"from": 0.0, "to": 1.0, "slope": 60.0}, {"from": 1.0, "to": 2.0, "slope": -60.0}]
    with pytest.raises(SceneError, match="contact 1 stands on the border at 1 m between two slopes, a top"):
        two(tops, 0.4, 0.4, body={"weights": [0.0, 1.0]})


def test_only_exact_follows_patches_and_says_why():
    with pytest.raises(CommandError, match=r"method: catch_up steps over the borders of ground.patches"):
        Crawler(two(ice()), method="catch_up")


def test_patches_in_the_plane_are_refused_with_the_reason():
    body = {"contacts": [[0.0, 0.0], [1.0, 0.0]], "links": {"stiffness": 1.0}}
    scene = {"name": "planar", "dimension": 2, "friction": {"isotropic": 1.0}, "body": body}
    with pytest.raises(SceneError, match=r"ground.patches: only on a line; in the plane give ground.regions"):
        Scene.model_validate(scene | {"ground": {"patches": ice()}})


def test_a_scene_with_patches_survives_a_round_trip():
    scene = two(ice(slope=5.0), slope=2.0, body={"weights": 0.1})
    assert Scene.model_validate(scene.document()) == scene


@pytest.mark.parametrize("parts", [2, 3, 4, 5, 7])
def test_a_contact_stays_on_its_border_if_another_one_stops_as_it_would_leave(parts):
    """In the fourth ramp contact 3 stops at the border at which contact 4 reaches its backward bound, within rounding."""
    driven = Drawn("chain on patches", 1127, ties=True, bare=True).driven()
    whole, _ = driven.run("exact")
    cut, steps = driven.run("exact", parts)
    assert cut == pytest.approx(whole, abs=1e-13)
    assert all(step.unique for step in steps)


def test_held_friction_is_kept_to_the_bit_while_loads_change():
    crawler = Crawler(two(ice(), friction={"forward": [0.4, 0.1 + 0.2], "backward": 0.7}, loads=0.1))
    row = crawler.row
    for load in (0.1 / 3.0, 0.17, 0.3 / 7.0, 0.1):
        go(crawler, 0.3, loads=[load, load])
    assert crawler.row[1:].tolist() == row[1:].tolist()
    assert crawler.target([0.3]).tolist() == crawler.scene.columns.target(crawler.row).tolist()


def far_from(name: str, **more) -> Scene:
    return Scene.model_validate(load_scene(name).document() | more)


def test_the_largest_tow_is_that_of_the_worst_place_on_the_way():
    """On the border the front holds 0.25 - F, and the rear takes 0.2 N; on level ground 0.3 N would be too much."""
    limit = largest_tow(load_scene("friction_step"))
    assert (limit.cause, limit.direction) == ("gain", 1)
    assert limit.value <= 0.05 <= limit.beyond <= limit.value + 1e-8
    assert largest_tow(load_scene("ice")).cause == "no travel"


def test_patches_of_friction_tilt_with_the_track():
    """At the border c_minus / 2 cos - sin = c_plus cos + sin: tan(theta) = (0.4 - 0.2) / 2."""
    patches = [{"from": 0.5, "to": 0.9, "friction": 0.5}]
    limit = steepest_climb(far_from("slope_climber", ground={"patches": patches, "slope": 3.0}))
    assert limit.value <= math.atan(0.1) <= limit.beyond <= limit.value + 1e-8
    with pytest.raises(CommandError, match="the ground has slopes of its own"):
        steepest_climb(load_scene("hill_top"))


def test_a_tow_that_pulls_the_body_onto_ground_that_does_not_hold_it_is_too_large():
    """Two contacts gain up to 0.3 N on level ground; behind them lies ice, which holds 0.1 N in all."""
    ice_behind = [{"from": -5.0, "to": -0.05, "friction": 0.1}]
    limit = largest_tow(far_from("friction_step", ground={"patches": ice_behind}))
    assert limit.value <= 0.3 <= limit.beyond <= limit.value + 1e-8


@BODIES
def test_a_step_that_completes_a_ramp_finds_the_ground_that_it_leads_to(between):
    """Without a budget each ramp is one step over the border; ramps that follow start on the ground behind it."""
    scene = two(ice(), between=between)
    lengths = (0.2, 2.0, 2.5, 1.5)
    one, other = Crawler(scene, budget=0), Crawler(scene, budget=0)
    step = one.follow(np.array([one.target([length] * scene.columns.links) for length in lengths]))
    for length in lengths:
        go(other, length)
    assert step.overspent > 0
    assert one.places.tolist() == other.places.tolist() == [0, 2]
    exact = Crawler(scene)
    for length in lengths:
        go(exact, length)
    assert one.displacement == pytest.approx(exact.displacement, abs=1e-12)
    assert other.displacement == pytest.approx(exact.displacement, abs=1e-12)
