"""Ground that changes gradually: closed forms, jumps, verdicts, the limit of many patches, and what is refused."""

from __future__ import annotations

import itertools
import json
from typing import Any

import numpy as np
import pytest

from crawler_model import CommandError, Crawler, Scene, SceneError, load_scene, simulate

from .bodies import CHAIN, GRAPH, ON_GRADUAL_GROUND, Drawn

ONE, TWO = None, [[0, 1], [0, 1]]
BODIES = pytest.mark.parametrize("between", [ONE, TWO], ids=["chain", "graph"])


def two(profile: dict[str, Any], rows: list[float], between: Any = ONE, **more: Any) -> Scene:
    """Two contacts, 0.2 m apart, on 20 N/m, as one link or as two; friction is 1 N, and 50 N backward."""
    links = {"stiffness": 20.0} if between is None else {"stiffness": 10.0, "between": between}
    lengths = [[row] if between is None else [row, row] for row in rows]
    scene: dict[str, Any] = {
        "name": "two",
        "body": {"contacts": [0.0, 0.2], "links": links},
        "friction": {"forward": 1.0, "backward": 50.0},
        "ground": {"profile": profile},
        "drive": {"times": list(range(len(rows))), "actuation": lengths},
    }
    return Scene.model_validate(scene | more)


@BODIES
def test_each_stroke_on_ground_that_holds_more_and_more_ends_at_its_closed_form(between):
    k, mu, a, stroke, length = 20.0, 0.2, 0.5, 0.1, 0.2
    run = simulate(two({"at": [0.0, 10.0], "friction": [mu, mu + 10.0 * a]}, [0.0, *[stroke, 0.0] * 60], between))
    rear, front, q = 0.0, length, 1.0 / (1.0 + a / k)
    for row in range(1, 121, 2):
        front = max(front, q * (rear + length + stroke - mu / k))
        assert run.waypoint_displacement[row] == pytest.approx([rear, front - length], abs=1e-14)
        rear = max(rear, q * (front - length - mu / k))
        assert run.waypoint_displacement[row + 1] == pytest.approx([rear, front - length], abs=1e-14)
    stall = (q**2 * (length + stroke - mu / k) - q * (length + mu / k)) / (1.0 - q**2)
    assert 0.5 * stall < rear < stall
    assert run.unique
    assert not run.jumps


@BODIES
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_contact_jumps_where_the_ground_holds_less_faster_than_its_spring(between, mirrored):
    """Friction falls from f to f/5 within 1 mm; the jump is that over a border, and 0.08 mJ less is lost."""
    f, k, sign = 0.2, 20.0, -1.0 if mirrored else 1.0
    at = [0.22, 0.221] if not mirrored else [-0.021, -0.02]
    sides = {"forward": [f, f / 5], "backward": [1.0, 1.0]} if not mirrored else {"forward": [1.0, 1.0]}
    sides = sides if not mirrored else sides | {"backward": [f / 5, f]}
    friction = {"forward": 1.0, "backward": 1.0}
    run = simulate(two({"at": at, "friction": sides}, [0.0, 0.1], between, friction=friction))
    (jump,) = run.jumps
    assert jump.contact == (0 if mirrored else 1)
    assert jump.border == pytest.approx(-0.02 if mirrored else 0.22, abs=1e-15)
    assert jump.distance == pytest.approx(sign * 0.8 * f / k, abs=1e-15)
    assert jump.loss == pytest.approx(0.00056, abs=1e-15)
    assert jump.time == pytest.approx((0.02 + f / k) / 0.1, abs=1e-12)
    assert abs(run.displacement[-1]).max() == pytest.approx(0.1 - f / 5 / k, abs=1e-15)
    assert run.unique
    assert abs(run.energy.residual) < 1e-15


def test_a_jump_ends_at_a_wall():
    ground = {
        "profile": {"at": [0.22, 0.221], "friction": [0.2, 0.04]},
        "walls": [{"at": 0.224, "stops": "forward"}],
    }
    run = simulate(two({}, [0.0, 0.1], ground=ground))
    (jump,) = run.jumps
    assert jump.distance == pytest.approx(0.004, abs=1e-15)
    assert run.displacement[-1] == pytest.approx([0.0, 0.024], abs=1e-15)
    assert run.wall_push[-1].least == pytest.approx(20.0 * (0.1 - 0.024) - 0.04)


def test_a_slope_that_grows_stops_the_climb_where_it_holds_the_stroke():
    """The sine is linear: at 0.2 + u the front is pulled back by its weight times u, as by one more spring."""
    weight, k, mu = 4.0, 20.0, 0.2
    profile = {"at": [0.2, 0.7], "slope": [0.0, 30.0]}
    body = {"contacts": [0.0, 0.2], "links": {"stiffness": k}, "weights": [0.0, weight]}
    run = simulate(two(profile, [0.0, 0.1], friction={"forward": mu, "backward": 5.0}, body=body))
    assert run.displacement[-1] == pytest.approx([0.0, (k * 0.1 - mu) / (k + weight)], abs=1e-15)
    assert run.energy.loads_work == pytest.approx(-0.5 * weight * run.displacement[-1, 1] ** 2, abs=1e-15)
    assert abs(run.energy.residual) < 1e-15


BELOW = {"at": [0.0, 1.0], "friction": [1.0, 0.2]}


def test_of_two_contacts_at_their_bounds_either_may_slide_where_the_ground_holds_less_and_less():
    """Both are at their bounds from the start; if the front slides, its bound falls, and nothing moves the rear."""
    data = {
        "name": "either",
        "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}},
        "friction": {"forward": [9.0, 0.5], "backward": [0.5, 9.0]},
        "ground": {"profile": {"at": [1.0, 2.0], "friction": [1.0, 0.2]}},
        "drive": {"times": [0.0, 1.0], "actuation": [[0.5], [1.0]]},
    }
    run = simulate(Scene.model_validate(data))
    assert not run.unique
    assert run.displacement[-1] == pytest.approx([0.0, 0.5 / (1.0 - 0.4)], abs=1e-15)  # the first contact rests


def test_a_jump_that_more_than_one_contact_can_begin_is_not_unique():
    profile = {"at": [-2.625, 3.5, 3.625], "friction": [1.125, 1.5, 1.25]}
    rows = [[0.0, 0.0], [0.125, -0.875], [-1.375, -0.5], [0.75, 0.875]]
    data = {"name": "three", "body": {"contacts": [0.0, 1.0, 2.0], "links": {"stiffness": [3.0, 2.875]}}}
    data |= {"friction": {"forward": [0.625, 0.5, 0.75], "backward": [1.75, 1.0, 0.25]}}
    data |= {"ground": {"profile": profile}, "drive": {"times": [0, 1, 2, 3], "actuation": rows}}
    run = simulate(Scene.model_validate(data))
    assert [jump.contact for jump in run.jumps] == [2]
    assert not run.unique


SYMMETRIC = {
    "a jump of either end": (
        (3, 1.2, [1.0, 1.0, 1.0]),
        {"at": [-1.2, -1.0, -0.8, 0.2, 1.8, 2.8, 3.0, 3.2], "friction": [0.6, 0.6, 1.6, 0.2, 0.2, 1.6, 0.6, 0.6]},
        [[0.6, 0.6], [-1.0, -1.0]],
    ),
    "a jump of either end, far from each other": (
        (3, 3.8, [1.2, 1.0, 1.2]),
        {
            "at": [-0.6, -0.4, 0.0, 0.2, 0.8, 1.2, 1.8, 2.0, 2.4, 2.6],
            "friction": {
                "forward": [0.2, 1.0, 1.4, 0.4, 2.0, 0.4, 0.4, 1.0, 1.6, 0.4],
                "backward": [0.4, 1.6, 1.0, 0.4, 0.4, 2.0, 0.4, 1.4, 1.0, 0.2],
            },
        },
        [[1.4, 1.4]],
    ),
    "either half slides": (
        (4, [2.6, 2.2, 2.6], [1.0, 0.8, 0.8, 1.0]),
        {
            "at": [-0.9, -0.7, -0.1, 0.1, 0.7, 1.1, 1.9, 2.3, 2.9, 3.1, 3.7, 3.9],
            "friction": [1.0, 0.6, 0.4, 0.8, 1.8, 0.8, 0.8, 1.8, 0.8, 0.4, 0.6, 1.0],
        },
        [[1.4, 2.0, 1.4]],
    ),
    "at their bounds as a ramp ends": (
        (3, 1.4, [1.4, 0.6, 1.4]),
        {"at": [-0.4, -0.2, 0.0, 0.6, 0.8, 1.2, 1.4, 2.0, 2.2, 2.4],
         "friction": [1.8, 0.5, 2.0, 1.0, 1.2, 1.2, 1.0, 2.0, 0.5, 1.8]},
        [[-2.0, -2.0], [1.2, 1.2]],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", SYMMETRIC.values(), ids=SYMMETRIC)
def test_rounding_does_not_choose_between_motions_that_begin_at_one_instant(case):
    """Body, ground and drive are their own mirror images, so that the ends come to their bounds or places together."""
    (contacts, stiffness, friction), profile, rows = case
    data = {
        "name": "symmetric",
        "body": {"contacts": list(range(contacts)), "links": {"stiffness": stiffness}},
        "friction": {"isotropic": friction},
        "ground": {"profile": profile},
        "drive": {"times": list(range(len(rows) + 1)), "actuation": [[0.0] * (contacts - 1), *rows]},
    }
    assert not simulate(Scene.model_validate(data), rate=1.0).unique


def test_a_contact_at_its_bound_but_for_rounding_is_held_by_a_gradient():
    """In the last ramp, friction ahead of the rear at 0.82 m is 2.75 N, like that behind the front, which slides."""
    rows = [0.0, 1.0, 1.5, -1.0, 1.5, 0.0]
    data = {"name": "held", "body": {"contacts": [0.0, 2.0], "links": {"stiffness": 3.0}, "weights": [0.25, 0.0]}}
    data |= {"friction": {"forward": [1.5, 0.5], "backward": [1.0, 2.75]}, "loads": [0.125, 0.0]}
    profile = {"at": [-0.5, 1.0, 1.5], "friction": [1.0, 2.0, 1.0], "slope": [0.0, np.degrees(np.arcsin(0.25)), 0.0]}
    data |= {"ground": {"profile": profile}, "drive": {"times": list(range(6)), "actuation": [[v] for v in rows]}}
    run = simulate(Scene.model_validate(data), rate=1.0)
    assert run.displacement[-1] == pytest.approx([0.82, 0.82 + 2.75 / 3.0], abs=1e-14)
    assert run.unique


@pytest.mark.parametrize("kind", [CHAIN, GRAPH])
def test_gradual_ground_is_the_limit_of_many_patches(kind):
    driven = Drawn(f"{kind} on gradual ground", 5).driven()
    profile = driven.data["ground"]["profile"]
    exact, wrong = driven.run("exact")[0], []
    for count in (40, 640):
        edges = np.linspace(profile["at"][0], profile["at"][-1], count + 1)
        ends = [profile["at"][0] - 100.0, *edges.tolist(), profile["at"][-1] + 100.0]
        patches = []
        for start, stop in itertools.pairwise(ends):
            middle = 0.5 * (start + stop)
            sides = {side: float(np.interp(middle, profile["at"], row)) for side, row in profile["friction"].items()}
            sine = np.interp(middle, profile["at"], np.sin(np.radians(profile["slope"])))
            patches.append({"from": start, "to": stop, "slope": float(np.degrees(np.arcsin(sine)))} | sides)
        data = driven.data | {"ground": {"patches": patches}}
        found = type(driven)(data, driven.rows).run("exact")[0]
        wrong.append(np.abs(found - exact).max())
    assert wrong[0] < 0.1
    assert wrong[1] < max(0.2 * wrong[0], 1e-12)


@pytest.mark.parametrize("kind", ON_GRADUAL_GROUND)
@pytest.mark.parametrize("seed", range(12))
def test_neither_the_view_nor_the_place_nor_the_parts_of_ramps_matter(kind, seed):
    body = Drawn(kind, seed, bool(seed & 1), bool(seed & 2), bool(seed & 4))
    driven = body.driven()
    here, steps = driven.run("exact")
    for step in steps:
        assert step.unsolved == step.overspent == 0
        assert step.certificate.violation < 1e-11
        assert abs(step.certificate.energy_residual) < 1e-11
    turned, others = body.driven(mirrored=True).run("exact")
    split, parts = driven.run("exact", 3)
    sure = all(step.unique for step in (*steps, *others, *parts))
    assert all(step.unique for step in steps) == all(step.unique for step in others) == sure
    if sure:
        for found in (-turned[:, ::-1], split, driven.moved(64.0).run("exact")[0]):
            assert found == pytest.approx(here, abs=1e-11 * driven.extent)


def trunk(rng: np.random.Generator, elements: int, softest: float, most: float, places: int) -> Scene:
    """A segment on a profile of factors up to `most`, whose strain goes up and down."""
    part = {
        "name": "trunk",
        "from": 0.0,
        "to": 1.0,
        "elements": elements,
        "stiffness": float(rng.uniform(softest, 3.0)),
    }
    part["friction"] = {"forward": float(rng.uniform(0.2, 1.0)), "backward": float(rng.uniform(0.3, 3.0))}
    at, factors = np.sort(rng.uniform(-0.2, 1.4, places)), rng.uniform(0.05, most, (2, places))
    friction = {"forward": factors[0].tolist(), "backward": factors[1].tolist()}
    data = {
        "name": "trunk",
        "body": {"segments": [part]},
        "ground": {"profile": {"at": at.tolist(), "friction": friction}},
        "drive": {"times": [0, 1, 2, 3, 4], "actuation": [[0.0], *rng.uniform(-0.8, 0.8, (4, 1)).tolist()]},
    }
    return Scene.model_validate(data)


def assert_parts_lead_where_ramps_lead(scene: Scene) -> int:
    """Compare a run of whole ramps with one of 20 parts; returns the number of jumps."""
    whole, parts = (simulate(scene, rate=rate) for rate in (1.0, 20.0))
    for run in (whole, parts):
        assert run.unsolved == 0
        assert abs(run.energy.residual) < 1e-13
    assert parts.waypoint_displacement == pytest.approx(whole.waypoint_displacement, abs=1e-12)
    return len(whole.jumps)


def test_segments_jump_where_too_many_sides_would_have_to_be_tried():
    rng = np.random.default_rng(1)
    sizes = rng.choice([12, 20, 40], 40).tolist()
    assert sum(assert_parts_lead_where_ramps_lead(trunk(rng, size, 0.5, 2.0, 6)) for size in sizes) > 5


@pytest.mark.parametrize("seed", [280, 462])
def test_of_many_contacts_one_begins_a_jump_whose_force_falls(seed):
    """On ground so steep that the force on some of them grows as they move, until others follow."""
    assert assert_parts_lead_where_ramps_lead(trunk(np.random.default_rng(seed), 60, 0.1, 4.0, 8)) > 0


@BODIES
def test_ground_with_a_factor_of_one_everywhere_is_plain_ground(between):
    rows = [0.0, 0.9, -0.4, 0.7]
    friction = {"forward": [0.3, 0.2], "backward": [0.4, 0.6]}
    plain = two({"at": [0.0, 0.3], "friction": [1.0, 1.0]}, rows, between, friction=friction)
    even = Scene.model_validate({key: value for key, value in plain.document().items() if key != "ground"})
    assert simulate(plain).displacement == pytest.approx(simulate(even).displacement, abs=1e-15)


def test_a_patch_multiplies_the_factors_of_the_profile():
    """On the patch the spring of the ground is half as stiff; at its end, where more holds, the contact stands a while."""
    profile = {"at": [0.0, 10.0], "friction": [0.2, 5.2]}
    ground = {"profile": profile, "patches": [{"from": 0.21, "to": 0.28, "friction": 0.5}]}
    run = simulate(two(profile, [0.0, 0.05, 0.1], ground=ground))
    (jump,) = run.jumps
    assert jump.border == 0.21
    assert jump.distance == pytest.approx(0.5 * (0.2 + 0.5 * 0.21) / (20.0 + 0.25), abs=1e-15)
    assert run.waypoint_displacement[1, 1] == pytest.approx((20.0 * 0.05 - 0.5 * (0.2 + 0.5 * 0.2)) / 20.25, abs=1e-15)
    assert run.waypoint_displacement[2, 1] == pytest.approx((20.0 * 0.1 - (0.2 + 0.5 * 0.2)) / 20.5, abs=1e-15)


def test_a_profile_of_slopes_lets_friction_be_commanded():
    body = {"contacts": [0.0, 0.2], "links": {"stiffness": 20.0}, "weights": 0.1}
    crawler = Crawler(two({"at": [0.0, 1.0], "slope": [0.0, 5.0]}, [0.0, 0.1], body=body))
    crawler.advance([0.1], forward=[0.5, 0.4], backward=[2.0, 2.0])
    assert crawler.friction.tolist() == [0.5, 0.4, 2.0, 2.0]


@BODIES
def test_friction_is_commanded_while_a_contact_slides_over_a_gradient(between):
    """Its bound is a product, and its path is curved; k (D s - x) = f(s) (mu + a p), whatever the parts of the ramp."""
    k, mu, a, stroke, f = 20.0, 0.2, 0.5, 0.1, 2.0
    friction = {"forward": [[1.0, 1.0], [1.0, f]], "backward": [[50.0, 50.0], [50.0, 50.0]]}
    drive = {"times": [0, 1], "actuation": np.outer([0.0, stroke], [1.0] if between is None else [1.0, 1.0]).tolist()}
    profile = {"at": [0.0, 10.0], "friction": [mu, mu + 10.0 * a]}
    run = simulate(two(profile, [0.0], between, drive=drive | {"friction": friction}))
    rest = mu + a * 0.2
    assert run.displacement[-1] == pytest.approx([0.0, (k * stroke - f * rest) / (k + f * a)], abs=1e-16)
    s = np.linspace(rest / (k * stroke - (f - 1.0) * rest), 1.0, 10**5 + 1)
    bound = 1.0 + s * (f - 1.0)
    x = (k * stroke * s - bound * rest) / (k + bound * a)
    force = bound * (rest + a * x)
    assert run.energy.dissipation == pytest.approx(0.5 * (force[1:] + force[:-1]) @ np.diff(x), rel=1e-5)
    assert abs(run.energy.residual) < 1e-16


@BODIES
def test_a_place_is_met_on_a_curved_path_however_ramps_are_split(between):
    """Beyond 0.23 m less and less holds."""
    profile = {"at": [0.0, 0.23, 10.0], "friction": [0.3, 0.415, 0.2]}
    friction = {"forward": [[1.0, 1.0], [1.0, 3.0]], "backward": [[50.0, 50.0], [50.0, 50.0]]}
    links = 1 if between is None else 2
    drive = {"times": [0, 1], "actuation": [[0.0] * links, [0.2] * links], "friction": friction}
    scene = two(profile, [0.0], between, drive=drive)
    fall = (0.2 - 0.415) / (10.0 - 0.23)
    way = (20.0 * 0.2 - 3.0 * (0.415 - fall * 0.03)) / (20.0 + 3.0 * fall)
    for rate in (1.0, 7.0, 1000.0):
        assert simulate(scene, rate=rate).displacement[-1] == pytest.approx([0.0, way], abs=1e-15)


def test_where_the_ground_holds_less_ticks_of_commanded_friction_lead_where_ramps_lead():
    jumps = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)

        def eighths(low: float, high: float, *shape: int, rng: Any = rng) -> Any:
            return (np.round(8.0 * rng.uniform(low, high, shape)) / 8.0).tolist()

        n = int(rng.integers(2, 5))
        friction = {side: eighths(0.25, 1.5, 6, n) for side in ("forward", "backward")}
        data = {"name": "steep", "body": {"contacts": [2.0 * i for i in range(n)]}}
        data["body"] |= {"links": {"stiffness": eighths(1.0, 2.0, n - 1)}}
        places = np.sort(rng.choice(16 * n, 4, replace=False) / 8.0).tolist()
        data |= {
            "friction": {"isotropic": 1.0},
            "ground": {"profile": {"at": places, "friction": eighths(0.1, 2.5, 4)}},
        }
        rows = [[0.0] * (n - 1), *eighths(-1.5, 1.5, 5, n - 1)]
        data["drive"] = {"times": list(range(6)), "actuation": rows, "friction": friction}
        whole, parts = (simulate(Scene.model_validate(data), rate=rate) for rate in (1.0, 40.0))
        assert whole.unsolved == parts.unsolved == whole.overspent == parts.overspent == 0
        assert abs(whole.energy.residual) < 1e-12
        if whole.unique and parts.unique:
            assert parts.waypoint_displacement == pytest.approx(whole.waypoint_displacement, abs=1e-12), seed
            jumps += len(whole.jumps)
    assert jumps > 5


def test_loads_are_commanded_on_gradual_ground():
    crawler = Crawler(two(BELOW, [0.0, 0.0], loads=0.0))
    step = crawler.advance([0.0], loads=[0.0, 1.0])  # at 0.2 m the ground holds 0.84 N, and 0.8 N/m less beyond
    assert crawler.displacement[1] == pytest.approx((1.0 - 0.84) / (20.0 - 0.8), abs=1e-15)
    assert abs(step.certificate.energy_residual) < 1e-15


@pytest.mark.parametrize(
    ("profile", "message"),
    [
        (
            {"at": [0.0, 0.0], "friction": [1, 1]},
            "ground.profile: at: 0 m follows 0 m; places must be strictly increasing",
        ),
        (
            {"at": [0.0, 1.0], "friction": [1, -0.5]},
            "ground.profile: friction: -0.5; a factor on friction must be >= 0",
        ),
        ({"at": [0.0, 1.0], "friction": [1.0]}, r"ground.profile: friction: 1 value\(s\) for 2 place\(s\) in `at`"),
        (
            {"at": [0.0, 1.0], "friction": {"forward": [1, 1], "backward": [1]}},
            r"ground.profile: friction.backward: 1 value\(s\) for 2 place\(s\)",
        ),
        ({"at": [0.0], "slope": [90]}, "ground.profile: slope: 90 degrees; it must be between -90 and 90"),
        ({"at": [0.0]}, "ground.profile: give `friction` or `slope`"),
        ({"at": [], "friction": []}, "ground.profile: at: no places"),
        ({"at": [0.0, "x"], "friction": [1, 1]}, "ground.profile.at.1: 'x' is not a number"),
        (
            {"at": [0.0, 1.0], "frction": [1, 1]},
            "ground.profile.frction: unknown key; the nearest known key is 'friction'",
        ),
        ({"at": [0.0, 1.0], "slope": [0, 5]}, "body.weights: missing; the slope of a profile acts on the weight"),
    ],
)
def test_mistakes_in_a_profile_are_named_in_one_line(profile, message):
    with pytest.raises(SceneError, match=message) as error:
        two(profile, [0.0, 0.1])
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"dimension": 2, "body": {"contacts": [[0, 0], [1, 0]], "links": {"stiffness": 1}}},
            "ground.profile: only on",
        ),
        (
            {"ground": {"profile": {"at": [0.0], "slope": [2.0]}, "slope": 1.0}},
            "slope: 1 degrees, but `profile.slope` is given",
        ),
        (
            {
                "body": {"contacts": [0.0, 0.2], "links": {"stiffness": 1.0}, "weights": 1.0},
                "friction": {"coefficient": {"isotropic": 0.5}},
                "ground": {"profile": {"at": [0.0], "slope": [2.0]}},
            },
            "ground.profile.slope: a coefficient of friction acts on the cosine",
        ),
    ],
)
def test_what_is_not_followed_exactly_is_refused(change, message):
    data = two(BELOW, [0.0, 0.1]).document() | change
    if data.get("dimension") == 2:
        data |= {"friction": {"isotropic": 1.0}, "drive": None}
    with pytest.raises(SceneError, match=message):
        Scene.model_validate(data)


@BODIES
@pytest.mark.parametrize("at", [[0.0, 10.0], [0.0, 0.22, 0.251, 0.28, 10.0]])
def test_an_implicit_step_is_exact_where_contacts_only_slide_or_rest(between, at):
    """Whatever places they pass, and if friction is commanded, too."""
    factors = np.interp(at, [0.0, 0.25, 10.0], [0.2, 0.3, 2.5]).tolist()
    scene = two({"at": at, "friction": factors}, [0.0, 0.1, 0.0, 0.05, 0.1], between)
    for friction in (None, {"forward": [[1.0, 1.0], [1.0, 2.0], [1.0, 0.5], [3.0, 1.0], [1.0, 1.0]]}):
        drive = scene.document()["drive"]
        if friction is not None:
            drive |= {"friction": friction | {"backward": [[50.0, 50.0]] * 5}}
        driven = Scene.model_validate(scene.document() | {"drive": drive})
        exact, found = (simulate(driven, rate=1.0, method=method) for method in ("exact", "catch_up"))
        assert found.waypoint_displacement == pytest.approx(exact.waypoint_displacement, abs=1e-15)
        assert found.events == 4
        assert found.unique
        assert found.violation < 1e-15


def test_where_a_contact_jumps_no_implicit_step_is_taken():
    sides = {"forward": [0.2, 0.04], "backward": [1.0, 1.0]}
    scene = two({"at": [0.22, 0.221], "friction": sides}, [0.0, 0.1], friction={"forward": 1.0, "backward": 1.0})
    exact, stepped = (simulate(scene, rate=2.0, method=method) for method in ("exact", "catch_up"))
    assert stepped.jumps == exact.jumps
    assert len(exact.jumps) == 1
    assert stepped.displacement[-1].tolist() == exact.displacement[-1].tolist()
    assert abs(stepped.energy.residual) < 0.01


def test_implicit_steps_that_would_pass_over_borders_or_through_walls_are_refused():
    patches = {"profile": BELOW, "patches": [{"from": 0.3, "to": 0.4, "friction": 0.5}]}
    walls = {"profile": BELOW, "walls": [{"at": 1.2, "stops": "forward"}]}
    for ground, message in (
        (patches, r"steps over the borders of ground\.patches"),
        (walls, r"steps through ground\.walls"),
    ):
        with pytest.raises(CommandError, match=message):
            simulate(two(BELOW, [0.0, 0.1, 0.0], ground=ground), method="catch_up")


def test_a_scene_with_a_profile_survives_a_round_trip():
    scene = two({"at": [0.0, 1.0], "friction": {"forward": [1.0, 0.5], "backward": [1.0, 1.0]}}, [0.0, 0.1])
    assert Scene.model_validate(json.loads(json.dumps(scene.document()))) == scene


def test_the_gallery_leaves_the_ice_as_its_comments_say():
    run = simulate(load_scene("leaving_ice"), duration=20.0)
    k, stroke, length, mu, a = 20.0, 0.1, 0.2, -0.05, 0.5
    q, between = 1.0 / (1.0 + a / k), 0
    for period, (before, after) in enumerate(itertools.pairwise(run.displacement[::100])):
        front = run.displacement[100 * period + 50, 1] + length
        if before[0] >= 0.3 and front <= 0.9:
            assert front == pytest.approx(q * (before[0] + length + stroke - mu / k), abs=1e-14)
            assert after[0] == pytest.approx(q * (front - length - mu / k), abs=1e-14)
            between += 1
    assert between == 4
    assert run.per_period[0] == pytest.approx(0.0925, abs=1e-12)  # its front holds still until it has left its start
    assert run.per_period[-1] == pytest.approx(stroke - 2 * 0.4 / k, abs=1e-12)
    assert run.unique
    assert not run.jumps
