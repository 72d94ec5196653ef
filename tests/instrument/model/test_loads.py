"""Loads along the ground, weights, coefficients of friction and slopes: shifted bounds, and their work."""

from __future__ import annotations

import math

import numpy as np
import pytest

from crawler_lab import simulate_many, vary
from crawler_model import CommandError, Crawler, Scene, SceneError, simulate
from crawler_model.theory.regularity import check_regularity

METHODS = ("exact", "catch_up")


def two(forward=1.0, backward=1.0, stroke=4.0, **more) -> Scene:
    return Scene.model_validate(
        {
            "name": "two",
            "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}, **more.pop("body", {})},
            "friction": more.pop("friction", {"forward": forward, "backward": backward}),
            "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [stroke], [0.0]]},
            **more,
        }
    )


@pytest.mark.parametrize("load", [0.0, 0.1, -0.1, 0.3, -0.3, 0.9, -0.9])
def test_a_load_on_isotropic_friction_carries_downhill(load):
    run = simulate(two(loads=load), 4.0)
    gain = max(0.0, 4.0 - 2.0 * (1.0 - abs(load)))
    expected = math.copysign(gain, load) if load else 0.0
    assert run.per_period[1:] == pytest.approx(expected, abs=1e-12)
    assert run.energy.relative_residual < 1e-15
    assert run.summary()["loads_work"] == run.energy.loads_work


@pytest.mark.parametrize("load", [0.0, -0.1, -0.3, -0.39])
def test_directional_friction_climbs_as_long_as_forward_is_easier(load):
    run = simulate(two(0.2, 1.0, loads=load), 4.0)
    assert run.per_period[1:] == pytest.approx(4.0 - 2.0 * (0.2 - load), abs=1e-12)


def test_a_climb_that_is_too_steep_slides_back():
    assert simulate(two(0.2, 1.0, loads=-0.5), 4.0).per_period[-1] < 0.0


@pytest.mark.parametrize("method", METHODS)
def test_a_load_is_the_friction_that_equals_it_to_the_bit(method):
    loaded, shifted = two(0.5, 1.0, loads=-0.125), two(0.625, 0.875)
    one, other = (simulate(scene, 5.0, method=method) for scene in (loaded, shifted))
    assert (one.displacement == other.displacement).all()
    assert (one.tension == other.tension).all()
    assert one.energy.dissipation != other.energy.dissipation


def test_the_work_of_constant_loads_is_force_times_displacement():
    rng = np.random.default_rng(5)
    loads = [0.1, -0.3, 0.05]
    crawler = Crawler(three(loads=loads))
    work = 0.0
    for _ in range(20):
        before = crawler.displacement
        step = crawler.advance(rng.uniform(-2.0, 2.0, 2))
        work += step.loads_work
        assert step.loads_work == pytest.approx(np.dot(loads, crawler.displacement - before), abs=1e-13)
        assert abs(step.certificate.energy_residual) < 1e-13
    assert work != 0.0


def three(between=None, **more) -> Scene:
    links = {"stiffness": [1.0, 2.0] if between is None else [1.0, 2.0, 0.5]}
    if between is not None:
        links["between"] = between
    body = {"contacts": [0.0, 1.0, 2.0], "links": links}
    friction = {"forward": [0.4, 0.6, 0.5], "backward": [1.0, 0.8, 0.9]}
    return Scene.model_validate({"name": "three", "body": body, "friction": friction, **more})


RING = [[0, 1], [1, 2], [0, 2]]


@pytest.mark.parametrize("between", [None, RING], ids=["chain", "graph"])
def test_a_ramp_of_loads_does_not_depend_on_how_it_is_cut(between):
    rng = np.random.default_rng(7)
    one, many = Crawler(three(between, loads=0.0)), Crawler(three(between, loads=0.0))
    links = 2 if between is None else 3
    length, load = np.zeros(links), np.zeros(3)
    total = np.zeros(2)
    for _ in range(6):
        goal, pull = rng.uniform(-3.0, 3.0, links), rng.uniform(-0.6, 0.4, 3)
        whole = one.advance(goal, loads=pull)
        parts = [
            many.advance(length + s * (goal - length), loads=load + s * (pull - load)) for s in (0.1, 0.37, 0.8, 1.0)
        ]
        total += [whole.loads_work, sum(p.loads_work for p in parts)]
        assert many.displacement == pytest.approx(one.displacement, abs=1e-13)
        assert sum(p.loads_work for p in parts) == pytest.approx(whole.loads_work, abs=1e-13)
        assert abs(whole.certificate.energy_residual) < 1e-13
        length, load = goal, pull
    assert total[0] != 0.0


def test_coefficients_of_a_segment_act_on_its_weight_per_length():
    trunk = {"name": "trunk", "from": 0.0, "to": 0.5, "stiffness": 1.0, "elements": 4}
    trunk["friction"] = {"coefficient": {"forward": 0.2, "backward": 0.8}}
    body = {"segments": [trunk], "weights": 2.0}
    crawler = Crawler(Scene.model_validate({"name": "s", "body": body, "ground": {"slope": 10.0}}))
    weight = 2.0 * 0.5
    load = -weight * math.sin(math.radians(10.0))
    forward, backward = crawler.friction.reshape(2, 5).sum(axis=1)
    assert forward == pytest.approx(0.2 * weight * math.cos(math.radians(10.0)))
    assert backward == pytest.approx(0.8 * weight * math.cos(math.radians(10.0)))
    assert crawler.loads.sum() == pytest.approx(load)


def test_loads_along_a_segment_are_per_length():
    def scene(load):
        segment = {"name": "trunk", "from": 0.0, "to": 1.0, "stiffness": 1.0, "elements": 200}
        segment["friction"] = (
            {"forward": 0.1, "backward": 0.3} if load is not None else {"forward": 0.15, "backward": 0.25}
        )
        return Scene.model_validate(
            {
                "name": "s",
                "body": {"segments": [segment]},
                "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [0.3], [0.0]]},
                **({} if load is None else {"loads": load}),
            }
        )

    one, other = simulate(scene(-0.05), 3.0), simulate(scene(None), 3.0)
    assert one.displacement == pytest.approx(other.displacement, abs=1e-13)
    assert one.energy.relative_residual < 1e-13


@pytest.mark.parametrize("angle", [-12.0, 5.0, 20.0])
def test_a_slope_is_the_load_of_the_weights(angle):
    theta = math.radians(angle)
    sloping = two(body={"weights": [0.5, 1.0]}, ground={"slope": angle})
    loaded = two(loads=[-0.5 * math.sin(theta), -math.sin(theta)])
    assert simulate(sloping, 3.0).displacement == pytest.approx(simulate(loaded, 3.0).displacement, abs=1e-13)
    assert Crawler(sloping).loads == pytest.approx([-0.5 * math.sin(theta), -math.sin(theta)], abs=1e-15)


def test_coefficients_act_on_what_a_slope_leaves_of_the_weight():
    scene = two(
        friction={"coefficient": {"forward": 0.5, "backward": [1.5, 2.0]}},
        body={"weights": [2.0, 1.0]},
        ground={"slope": 30.0},
        stroke=1.0,
    )
    crawler = Crawler(scene)
    assert crawler.forward == pytest.approx([math.sqrt(0.75), 0.5 * math.sqrt(0.75)])
    assert crawler.backward == pytest.approx([3.0 * math.sqrt(0.75), 2.0 * math.sqrt(0.75)])


def test_a_commanded_load_holds_until_the_next_and_friction_stays():
    crawler = Crawler(two(0.2, 1.0, loads=0.0))
    crawler.advance([1.0], loads=[-0.1, 0.05])
    for _ in range(3):
        crawler.advance([2.0])
        crawler.advance([1.0])
    assert crawler.loads.tolist() == [-0.1, 0.05]
    assert crawler.forward == pytest.approx([0.2, 0.2], abs=1e-16)
    assert crawler.row.tolist() == pytest.approx([1.0, 0.2, 0.2, 1.0, 1.0, -0.1, 0.05])


def test_a_bound_of_one_contact_may_be_negative():
    scene = two([0.1, 2.0], [0.1, 2.0], loads=[-0.5, 0.0], start={"displacement": [0.0, 0.45]})
    run = simulate(scene, 3.0)
    assert run.violation < 1e-14
    assert run.energy.relative_residual < 1e-14


@pytest.mark.parametrize("between", [None, RING], ids=["chain", "graph"])
def test_a_relaxed_start_holds_a_load_that_its_contact_does_not(between):
    """Contact 0 carries 1.5 N down the slope and holds 1 N: springs of least energy carry the rest to the others."""
    start = Scene.model_validate(three(between).document() | {"loads": [-1.5, 0.0, 0.0], "start": "relaxed"})
    crawler = Crawler(start)
    assert crawler.margins.min() == pytest.approx(0.0, abs=1e-15)
    assert crawler.spring_force[0] == pytest.approx(0.5, abs=1e-15)
    ends = [[0, 1], [1, 2]] if between is None else RING
    k = np.array([1.0, 2.0, 0.5])[: len(ends)]
    g = np.zeros((3, len(ends)))
    for s, (a, b) in enumerate(ends):
        g[a, s], g[b, s] = 1.0, -1.0
    forward, backward = crawler.forward - crawler.loads, crawler.backward + crawler.loads
    tension = k * np.array([start.start_displacement[b] - start.start_displacement[a] for a, b in ends])
    energy = (tension**2 / k).sum()
    z = np.random.default_rng(2).normal(size=(2000, 2)) * 0.5 + start.start_displacement[1:]
    x = np.column_stack((np.zeros(2000), z))
    t = k * np.column_stack([x[:, b] - x[:, a] for a, b in ends])
    force = t @ g.T
    inside = ((force <= forward) & (force >= -backward)).all(axis=1)
    assert inside.any()
    assert ((t**2 / k).sum(axis=1)[inside] >= energy - 1e-12).all()
    assert simulate(start, 0.0).violation == 0.0


def test_a_relaxed_start_holds_a_load_without_elements_of_hysteresis():
    """They exert no force at the start: the spring alone carries what exceeds the friction of contact 0."""
    links = [{"stiffness": 20.0, "hysteresis": [{"stiffness": 30.0, "yield": 5.0}]}]
    body = {"contacts": [0.0, 1.0], "links": links}
    scene = two([0.2, 1.0], [0.2, 1.0], loads=[-0.5, 0.0], start="relaxed", body=body)
    assert scene.start_displacement[1] - scene.start_displacement[0] == pytest.approx(0.3 / 20.0, abs=1e-15)
    assert simulate(scene, 1.0).violation < 1e-14


def test_a_relaxed_start_where_elongations_take_friction_away_is_one_clear_line():
    entry = {"link": 0, "contacts": [1], "elongation": [0.0, 0.01], "added": [1.0, 0.0]}
    friction = {"isotropic": 0.2, "with_elongation": [entry]}
    with pytest.raises(SceneError, match=r"contact 1 .* meet other bounds there: write `start.displacement`"):
        two([], [], friction=friction, loads=[-0.5, 0.0], start="relaxed")


def test_a_relaxed_start_that_the_loads_allow_has_no_tension():
    start = Scene.model_validate(three().document() | {"loads": [-0.5, 0.3, 0.1], "start": "relaxed"})
    assert not Crawler(start).tension.any()


@pytest.mark.parametrize(
    "ground",
    [
        {"slope": 20.0},
        {"slope": 20.0, "patches": [{"from": 50.0, "to": 51.0, "friction": 0.5}]},
        {"patches": [{"from": -1.0, "to": 0.5, "slope": 20.0}]},
    ],
    ids=["no patch", "a patch far away", "one contact on a steep patch"],
)
def test_a_relaxed_start_holds_the_load_of_the_ground_under_a_contact(ground):
    """The spring carries what exceeds the friction of contact 0."""
    scene = two([0.1, 3.0], [0.1, 3.0], ground=ground, start="relaxed", body={"weights": [1.0, 0.0]})
    assert Crawler(scene).tension[0] == pytest.approx(np.sin(np.radians(20.0)) - 0.1, abs=1e-14)
    assert simulate(scene, 1.0).violation < 1e-14


def test_a_relaxed_start_of_a_mesh_with_a_tendon_may_be_on_patches():
    links = [{"stiffness": 8.0, "between": [0, 1]}, {"stiffness": 5.0, "between": [1, 2]}]
    links.append({"stiffness": 2.0, "between": [0, 2], "tension": {"least": 0.0}})
    start = Scene.model_validate(
        {
            "name": "mesh",
            "body": {"contacts": [0.0, 1.0, 2.0], "links": links},
            "friction": {"forward": 0.5, "backward": 2.0},
            "ground": {"patches": [{"from": 2.2, "to": 3.0, "friction": 0.5}]},
            "start": "relaxed",
            "drive": {"times": [0, 1], "actuation": [[0.2, 0.1, 0.4], [0.0, 0.0, 0.0]]},
        }
    )
    assert start.start_displacement == pytest.approx([0.0, 0.2, 0.3])  # the tendon is slack


def test_a_relaxed_start_is_the_same_beside_a_variation_that_is_not_valid():
    body, values = {"weights": [1.0, 0.0]}, np.linspace(0.05, 0.15, 64)
    scene = two([0.1, 3.0], [0.1, 3.0], ground={"slope": 20.0}, start="relaxed", body=body)
    values[30] = -0.5
    runs = simulate_many(vary(scene, {"friction.backward[0]": values}), 1.0)
    for i in (0, 29, 31):
        alone = two([0.1, 3.0], [values[i], 3.0], ground={"slope": 20.0}, start="relaxed", body=body)
        assert runs.work[i] == pytest.approx(simulate(alone, 1.0).energy.work, rel=1e-12)


def test_a_relaxed_start_that_leads_onto_other_ground_is_one_clear_line():
    ground = {"patches": [{"from": -0.01, "to": 0.5, "slope": 20.0}, {"from": -1.0, "to": -0.01, "slope": 60.0}][::-1]}
    with pytest.raises(SceneError, match=r"contact 0 .* meet other bounds there: write `start.displacement`"):
        two([0.1, 3.0], [0.1, 3.0], ground=ground, start="relaxed", body={"weights": [1.0, 0.0]})


def test_a_load_without_springs_to_hold_it_is_one_clear_line():
    with pytest.raises(
        SceneError, match=r"contact 0 .* that its load of -1.5 N leaves of its backward friction; write"
    ):
        three(loads=[-1.5, 0.0, 0.0])


def test_loads_are_no_friction_that_could_vanish():
    rows = [[0.0, 0.0], [0.2, -0.4], [0.0, 0.0]]
    drive = {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [3.0], [0.0]], "loads": rows}
    regular = check_regularity(Scene.model_validate(two(loads=0.0).document() | {"drive": drive}).drive)
    assert regular.is_regular
    assert (regular.least, regular.greatest, regular.rate) == (1.0, 1.0, 0.0)
    assert regular.load_rate == pytest.approx(0.8)


REFUSED = [
    ({"loads": [1, 2, 3]}, "loads: 3 value"),
    ({"loads": 2.0}, "the loads sum to 4 N forward, but friction against sliding forward to 2 N: no equilibrium"),
    ({"loads": -2.0}, "the loads sum to 4 N backward"),
    ({"loads": math.nan}, "loads: nan is not finite"),
    ({"ground": {"slope": 10.0}}, "body.weights: missing; a slope acts on the weight"),
    ({"ground": {"slope": 95.0}}, "slope: 95 degrees"),
    ({"friction": {"coefficient": {"isotropic": 0.5}}}, "body.weights: missing; a coefficient of friction acts"),
    ({"friction": {"coefficient": {"isotropic": 0.5}, "isotropic": 1}}, "give `coefficient`, or forces, not both"),
    ({"body": {"weights": [1.0, -1.0]}}, "body.weights: entry 1 is -1"),
    (
        {"drive": {"times": [0, 1], "period": 1, "actuation": [[0], [0]], "loads": [[0, 0], [0, 0.1]]}},
        "drive.loads: the last row, at the period's end, has 0.1 for contact_1/load and the first 0",
    ),
]


@pytest.mark.parametrize(("change", "text"), REFUSED)
def test_what_does_not_fit_is_one_clear_line(change, text):
    with pytest.raises(SceneError) as refused:
        two(**change)
    assert text in str(refused.value)
    assert "\n" not in str(refused.value)


def test_commands_that_no_equilibrium_holds_change_nothing():
    crawler = Crawler(two(loads=0.0))
    before = crawler.copy()
    with pytest.raises(CommandError, match="the loads sum to 3 N forward"):
        crawler.advance([0.0], loads=[3.0, 0.0])
    assert crawler == before
    with pytest.raises(CommandError, match="the scene has no loads; add `loads: 0`"):
        Crawler(two()).advance([0.0], loads=[0.0, 0.0])


def test_driven_loads_replace_those_of_the_scene():
    drive = {"times": [0.0, 1.0], "actuation": [[0.0], [3.0]], "loads": [[0.0, 0.0], [0.2, -0.4]]}
    scene = Scene.model_validate(two(loads=0.0).document() | {"drive": drive})
    run = simulate(scene, 1.0)
    crawler = Crawler(two(loads=0.0))
    crawler.advance([3.0], loads=[0.2, -0.4])
    assert run.displacement[-1] == pytest.approx(crawler.displacement, abs=1e-13)


@pytest.mark.parametrize("ground", [{}, {"slope": 10.0}], ids=["flat", "slope"])
@pytest.mark.parametrize("left_out", ["loads", "friction", "forward", "backward", "all"])
def test_what_a_command_leaves_out_stays_in_force_after_targets(left_out, ground):
    """Only bounds and loads are known of a crawler that followed targets: of the bounds, the load is a part."""
    scene = two(0.3, 0.9, loads=0.05, **({"body": {"weights": 0.5}, "ground": ground} if ground else {}))
    new = {"forward": [0.2, 0.4], "backward": [0.7, 0.8], "loads": [-0.1, 0.15]}
    given = {
        k: v
        for k, v in new.items()
        if k != left_out and left_out != "all" and (left_out, k[-4:]) != ("friction", "ward")
    }
    commanded, followed = Crawler(scene), Crawler(scene)
    commanded.advance([0.5], loads=[0.1, -0.05])
    followed.follow(followed.target([0.5], loads=[0.1, -0.05])[None])
    for crawler in (commanded, followed):
        crawler.advance([0.25], **given)
        expected = {"forward": [0.3, 0.3], "backward": [0.9, 0.9], "loads": [0.1, -0.05]} | given
        assert crawler.row == pytest.approx(np.concatenate(([0.25], *expected.values())), abs=1e-15)
    assert followed.friction == pytest.approx(commanded.friction, abs=1e-15)
    assert followed.displacement == pytest.approx(commanded.displacement, abs=1e-14)
