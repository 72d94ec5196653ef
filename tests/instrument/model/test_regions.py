"""Regions of the plane with other friction: borders are events, and less friction is a jump."""

from __future__ import annotations

import io
import itertools
import math

import numpy as np
import pytest
from rich.console import Console

from crawler_command.check import print_report
from crawler_model import CommandError, Crawler, Scene, SceneError, limit_cycle, load_scene, simulate
from crawler_model.motion.plane import motion
from crawler_model.motion.plane.borders import Crossing
from crawler_model.scene.parts import RegionPart

from .planar_ramps import polygon


def square(left, right, angle=0.0):
    """A rectangle across the way from one place on a line to another; the line has an angle."""
    along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    return [(a * along + b * across).tolist() for a, b in ((left, -2), (right, -2), (right, 2), (left, 2))]


def chain(seed, angle, corners):
    """The same random chain over the same grounds, on a line and along a line in the plane."""
    rng = np.random.default_rng(seed)
    n, ramps = int(rng.integers(2, 5)), 6
    at, k = np.cumsum(rng.uniform(0.05, 0.2, n)), rng.uniform(5.0, 40.0, n - 1)
    mu, slope = rng.uniform(0.1, 1.0, n), float(rng.uniform(-5.0, 5.0))
    edges = np.sort(rng.uniform(0.0, 1.0, 2 * int(rng.integers(1, 4)))).reshape(-1, 2)
    factors = rng.uniform(0.1, 2.0, len(edges))
    rows = np.vstack((np.zeros((1, n - 1)), rng.uniform(-0.3, 0.3, (ramps, n - 1))))
    times, along = list(range(ramps + 1)), np.array([math.cos(angle), math.sin(angle)])
    line = {
        "body": {"contacts": at.tolist(), "links": {"stiffness": k.tolist()}, "weights": 0.3},
        "friction": {"isotropic": mu.tolist()},
        "ground": {
            "slope": slope,
            "patches": [{"from": a, "to": b, "friction": c} for (a, b), c in zip(edges, factors, strict=True)],
        },
        "drive": {"times": times, "actuation": rows.tolist()},
    }
    friction = {"isotropic": mu.tolist()}
    if corners:
        directions = polygon(angle, corners)
        friction = {
            "directions": (np.arctan2(directions[:, 1], directions[:, 0]) % (2.0 * np.pi)).tolist(),
            "value": np.repeat(mu[:, None], corners, 1).tolist(),
        }
    regions = [{"polygon": square(a, b, angle), "friction": c} for (a, b), c in zip(edges, factors, strict=True)]
    plane = {
        "dimension": 2,
        "tolerance": 1e-7,
        "body": {"contacts": np.outer(at, along).tolist(), "links": {"stiffness": k.tolist()}, "weights": 0.3},
        "friction": friction,
        "ground": {"slope": slope, "direction": angle, "regions": regions},
        "drive": {"times": times, "actuation": (rows[..., None] * along).tolist()},
    }
    scenes = (Scene.model_validate(d | {"name": "chain"}) for d in (line, plane))
    return (*(simulate(scene, float(ramps)) for scene in scenes), along)


@pytest.mark.parametrize(("angle", "corners"), [(0.0, 0), (0.7, 0), (2.3, 4), (-1.5, 6)])
def test_along_a_line_they_are_patches(angle, corners):
    """The same path, the same energy lost in jumps, which a fall over several borders has several of on the line."""
    jumped = 0
    for seed in range(15):
        exact, found, along = chain(seed, angle, corners)
        assert np.abs(found.displacement[-1] @ along - exact.displacement[-1]).max() < 1e-8, seed
        lost = [sum(jump.loss for jump in run.jumps) for run in (exact, found)]
        assert lost[1] == pytest.approx(lost[0], abs=1e-7), seed
        assert len(found.jumps) <= len(exact.jumps)
        assert found.energy.dissipation == pytest.approx(exact.energy.dissipation, abs=1e-6), seed
        jumped += len(found.jumps)
    assert jumped > 30


def tiles(rng, part=0.6):
    """Convex tiles that touch, some of them left out."""
    x, y = np.meshgrid(np.linspace(-0.5, 1.2, 5), np.linspace(-0.8, 0.8, 5), indexing="ij")
    at = np.stack((x, y), -1) + rng.uniform(-0.1, 0.1, (5, 5, 2))
    corners = (at[[i, i + 1, i + 1, i], [j, j, j + 1, j + 1]] for i, j in itertools.product(range(4), repeat=2))
    return [{"polygon": c.tolist(), "friction": float(rng.uniform(0.2, 2.0))} for c in corners if rng.random() < part]


def wanderer(seed, turns):
    """A random body that wanders over tiles; returns its scene for a tolerance and a number of parts of each ramp."""
    rng = np.random.default_rng(seed)
    n, ramps = int(rng.integers(3, 6)), 4
    at = np.column_stack((np.cumsum(rng.uniform(0.08, 0.15, n)), rng.uniform(-0.08, 0.08, n)))
    regions = tiles(rng)
    links = {"links": {"stiffness": rng.uniform(20.0, 60.0, n - 1).tolist()}}
    if turns:
        change = np.hstack((rng.uniform(-0.03, 0.03, (ramps, n - 1)), rng.uniform(-0.8, 0.8, (ramps, n - 2))))
        joints = {"joints": {"stiffness": rng.uniform(0.05, 0.2, n - 2).tolist()}}
        body = {"points": at.tolist(), "springs": "length"} | links | joints
        friction = {"forward": 0.1, "backward": 0.3, "left": 0.4, "right": 0.4}
    else:
        change = rng.uniform(-0.2, 0.2, (ramps, n - 1, 2))
        body = {"contacts": at.tolist()} | links
        friction = {"isotropic": rng.uniform(0.1, 0.6, n).tolist()}
    rows = np.concatenate((np.zeros_like(change[:1]), change))

    def build(tolerance, parts):
        times = np.linspace(0.0, ramps, parts * ramps + 1)
        given = [np.interp(times, range(ramps + 1), column) for column in rows.reshape(ramps + 1, -1).T]
        drive = {"times": times.tolist(), "actuation": np.transpose(given).reshape(-1, *rows.shape[1:]).tolist()}
        document = {"name": "wanderer", "dimension": 2, "tolerance": tolerance, "body": body, "friction": friction}
        return Scene.model_validate(document | {"start": "relaxed", "ground": {"regions": regions}, "drive": drive})

    return build, float(np.abs(change).max()), float(ramps)


@pytest.mark.parametrize("turns", [False, True])
@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(4, 30))])
def test_a_path_over_tiles_is_within_its_tolerance_of_one_in_a_hundred_times_smaller_steps(seed, turns):
    build, size, end = wanderer(seed, turns)
    run, fine = simulate(build(1e-4, 1), end), simulate(build(1e-6, 10), end)
    apart = np.abs(run.displacement[-1] - fine.displacement[-1]).max()
    assert apart < 1e-4 * size or not (run.unique or fine.unique)  # a jump may lead to either of two places
    assert abs(run.energy.residual) < 1e-4 * run.energy.work


def pair(regions, rows, friction=(0.3, 0.2), at=(0.0, 0.2), **more) -> Scene:
    body = {"contacts": [[at[0], 0.0], [at[1], 0.0]], "links": {"stiffness": 20.0}}
    drive = {"times": list(range(len(rows))), "actuation": [[row] for row in rows]}
    document = {"name": "pair", "dimension": 2, "tolerance": 1e-7, "body": body, "friction": {"isotropic": friction}}
    return Scene.model_validate(document | {"ground": {"regions": regions}, "drive": drive} | more)


def half(x, factor, ahead=True):
    """The half plane ahead of a place, or behind it."""
    line = [[x, 1.0], [x, -1.0]] if ahead else [[x, -1.0], [x, 1.0]]
    return {"left_of": line, "friction": factor}


def test_a_contact_at_the_border_of_rougher_ground_is_held_by_the_side_that_its_force_points_to():
    """It stands from 0.31 N on, does not go on at 0.59 N, and goes back at -0.21 N."""
    ahead = pair([half(0.25, 3.0)], [[0.0, 0.0], [0.06, 0.0], [0.08 - 1e-4, 0.0]], friction=(1.0, 0.2))
    crawler = Crawler(ahead)
    crawler.advance([[0.06, 0.0]])
    assert crawler.displacement[1, 0] == pytest.approx(0.05, abs=1e-9)
    crawler.advance([[0.05 + 0.59 / 20.0, 0.0]])
    assert crawler.displacement[1, 0] == pytest.approx(0.05, abs=1e-9)
    crawler.advance([[0.05 + 0.61 / 20.0, 0.0]])
    assert crawler.displacement[1, 0] == pytest.approx(0.05 + 0.01 / 20.0, abs=1e-7)  # on rough ground
    crawler = Crawler(ahead)
    crawler.advance([[0.06, 0.0]])
    crawler.advance([[0.05 - 0.21 / 20.0, 0.0]])
    assert crawler.displacement[1, 0] == pytest.approx(0.05 - 0.01 / 20.0, abs=1e-7)


def test_a_contact_that_starts_on_a_border_is_held_by_both_sides():
    for factor, forward in ((3.0, 0.6), (0.5, 0.1)):
        crawler = Crawler(pair([half(0.2, factor)], [[0.0, 0.0]], friction=(2.0, 0.2)))
        crawler.advance([[(forward - 1e-3) / 20.0, 0.0]])
        moved = crawler.displacement[1, 0]
        assert moved == 0.0 if factor > 1.0 else moved >= 0.0
        crawler = Crawler(pair([half(0.2, factor)], [[0.0, 0.0]], friction=(2.0, 0.2)))
        crawler.advance([[-(0.2 + 1e-2) / 20.0, 0.0]])
        assert crawler.displacement[1, 0] == pytest.approx(-1e-2 / 20.0, abs=1e-7)


def test_a_strip_that_is_crossed_in_one_part_is_noticed():
    """A millimetre of ice on a way of half a metre, followed in parts that are longer."""
    strip = {"polygon": [[0.40, -1.0], [0.401, -1.0], [0.401, 1.0], [0.40, 1.0]], "friction": 0.1}
    run = simulate(pair([strip], [[0.0, 0.0], [0.5, 0.0]], friction=(5.0, 0.2)), 1.0)
    (jump,) = run.jumps
    assert jump.contact == 1
    assert jump.distance == pytest.approx(1e-3, abs=1e-8)  # until it stands at the other border
    assert run.displacement[-1, 1, 0] == pytest.approx(0.5 - 0.2 / 20.0, abs=1e-8)


def test_mirrored_turned_and_moved_with_their_ground_bodies_go_the_same_way():
    build, _, end = wanderer(3, turns=False)
    document = build(1e-6, 1).document()
    run = simulate(Scene.model_validate(document), end)
    assert run.jumps
    for change in (np.diag([1.0, -1.0]), np.array([[0.0, -1.0], [1.0, 0.0]])):
        shift = np.array([0.25, -0.5])
        other = document | {
            "body": document["body"]
            | {"contacts": (np.array(document["body"]["contacts"]) @ change.T + shift).tolist()},
            "ground": {
                "regions": [
                    {"polygon": (np.array(r["polygon"]) @ change.T + shift).tolist(), "friction": r["friction"]}
                    for r in document["ground"]["regions"]
                ]
            },
            "drive": document["drive"] | {"actuation": (np.array(document["drive"]["actuation"]) @ change.T).tolist()},
        }
        found = simulate(Scene.model_validate(other), end)
        assert np.abs(found.displacement[-1] - run.displacement[-1] @ change.T).max() < 1e-6
        assert [j.contact for j in found.jumps] == [j.contact for j in run.jumps]


def test_friction_that_is_commanded_is_multiplied_too():
    """The second contact slides on ice from 0.25 m on, where it has half of what is commanded."""
    scene = pair([half(0.25, 0.5)], [[0.0, 0.0]], friction=(5.0, 0.2))
    crawler = Crawler(scene)
    crawler.advance([[0.2, 0.0]])
    assert crawler.displacement[1, 0] == pytest.approx(0.2 - 0.1 / 20.0, abs=1e-8)
    document = scene.document() | {
        "drive": {"times": [0.0], "actuation": [[[0.0, 0.0]]], "friction": {"isotropic": [[5.0, 0.2]]}}
    }
    crawler = Crawler(Scene.model_validate(document))
    crawler.follow(np.array([[0.2, 0.0, 5.0, 0.4]]))
    assert crawler.displacement[1, 0] == pytest.approx(0.2 - 0.2 / 20.0, abs=1e-8)
    assert crawler.friction.tolist() == [5.0, 0.4]


def on_one_ground(factor, *, everywhere):
    """A pair on a slope, whose friction the ground under all of it multiplies, or the scene itself."""
    given = [0.3, 0.2] if everywhere else [0.3 * factor, 0.2 * factor]
    ground = {"slope": 5.0} | ({"regions": [half(-9.0, factor)]} if everywhere else {})
    body = {"contacts": [[0.0, 0.0], [0.2, 0.0]], "links": {"stiffness": 20.0}, "weights": 0.5}
    drive = {"times": [0, 1, 2], "period": 2, "actuation": [[[0.0, 0.0]], [[0.1, 0.02]], [[0.0, 0.0]]]}
    document = {"name": "pair", "dimension": 2, "tolerance": 1e-7, "body": body, "friction": {"isotropic": given}}
    return Scene.model_validate(document | {"ground": ground, "drive": drive})


@pytest.mark.parametrize("factor", [0.25, 3.0])
def test_a_region_under_all_of_a_body_is_another_friction(factor):
    """In its path, its margins, its inertia number, and what it holds at rest."""
    one, other = (on_one_ground(factor, everywhere=everywhere) for everywhere in (True, False))
    run, plain = (simulate(scene, 4.0) for scene in (one, other))
    assert run.displacement == pytest.approx(plain.displacement, abs=1e-9)
    assert run.visited_margin == pytest.approx(plain.visited_margin, abs=1e-6)
    assert run.inertia.number == pytest.approx(plain.inertia.number, rel=1e-3)
    said = []
    for found in (run, plain):
        written = io.StringIO()
        print_report(found, Console(width=200, file=written))
        said.append([line for line in written.getvalue().splitlines() if "that it holds at rest" in line])
    assert said[0] == said[1] != []


@pytest.mark.parametrize("turns", [False, True])
def test_what_holds_a_body_at_its_start_is_the_friction_of_its_ground(turns):
    """A link that pulls with 1 N holds on rough ground alone."""
    body = {"contacts": [[0.0, 0.0], [0.2, 0.0]], "links": {"stiffness": 20.0}}
    friction = {"isotropic": 0.5}
    if turns:
        body = {"points": body["contacts"], "springs": "length", "links": {"stiffness": 20.0}}
        friction = {"forward": 0.5, "backward": 0.5, "left": 0.5, "right": 0.5}
    document = {"name": "pulled", "dimension": 2, "body": body, "friction": friction}
    document["start"] = {"displacement": [[0.0, 0.0], [0.05, 0.0]]}
    with pytest.raises(SceneError, match=r"is pulled by \[1, 0\] N, 0.5 N more than its friction"):
        Scene.model_validate(document)
    assert Scene.model_validate(document | {"ground": {"regions": [half(-9.0, 3.0)]}})
    with pytest.raises(SceneError, match=r"0.875 N more than its friction"):
        Scene.model_validate(document | {"ground": {"regions": [half(-9.0, 0.25)]}})


@pytest.mark.parametrize("body", ["discs", "polygons", "turns"])
def test_where_ice_does_not_hold_a_load_the_error_says_that_the_body_would_run_away(body):
    """A tow of 0.3 N draws two contacts from ground that holds 0.6 N onto ice that holds 0.12 N."""
    turns = body == "turns"
    polygons = {"directions": [0.0, 1.5708, 3.1416, 4.7124], "value": [0.3] * 4}
    stroke = np.array([0.1] if turns else [[0.1, 0.0]])
    document = {
        "name": "towed",
        "dimension": 2,
        "body": {"contacts": [[0.0, 0.0], [0.2, 0.0]], "links": {"stiffness": 20.0}},
        "friction": polygons if body == "polygons" else {"isotropic": 0.3},
        "loads": [0.15, 0.0],
        "ground": {"regions": [{"polygon": square(0.25, 9.0), "friction": 0.2}]},
        "drive": {"times": [0, 1, 2], "period": 2, "actuation": [(part * stroke).tolist() for part in (0, 1, 0)]},
    }
    document["body"]["springs"] = "length" if turns else "vector"
    said = r"the loads sum to \[0.3, 0\] N, 0.3 N at 0 degrees, but friction .* with 0.12 N: .* would run away"
    with pytest.raises(CommandError, match=said):
        simulate(Scene.model_validate(document), 8.0, rate=5.0)


def test_what_needs_the_same_ground_everywhere_is_refused():
    scene = load_scene("snake_over_two_grounds")
    with pytest.raises(
        CommandError, match=r"limit_cycle: snake_over_two_grounds has ground.regions, and after 2 periods"
    ):
        limit_cycle(scene, most_periods=2)


def test_a_snake_turns_at_the_border_of_ice():
    run = simulate(load_scene("snake_over_two_grounds"), 16.0)
    assert math.degrees(run.yaw[-1]) == pytest.approx(-32.4, abs=0.1)
    assert run.jumps
    assert max(jump.distance for jump in run.jumps) < 1e-3
    assert not run.unique


SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]


def test_where_a_force_turns_towards_the_ice_is_found_in_few_trials(monkeypatch):
    """Points at the border of ice whose forces exceed its friction already slip when these point across the border."""
    trials = []

    class Counted(Crossing):
        def __post_init__(self):
            super().__post_init__()
            follow = self.follow
            self.follow = lambda goal, *all_of_it: trials.append(not all_of_it) or follow(goal, *all_of_it)

    monkeypatch.setattr(motion, "Crossing", Counted)
    simulate(load_scene("snake_over_two_grounds"), duration=1.0)
    assert 0 < sum(trials) < 5 * trials.count(False)


@pytest.mark.parametrize(
    ("regions", "said"),
    [
        ([{"polygon": SQUARE}], "friction"),
        ([{"friction": 0.5}], "give `polygon` or `left_of`, one of them"),
        ([{"polygon": SQUARE, "friction": -1.0}], "friction: -1; a factor on friction must be >= 0"),
        ([{"polygon": SQUARE[:2], "friction": 0.5}], "polygon: 2 corner(s); give at least 3"),
        ([{"left_of": [[0, 1], [0, 1]], "friction": 0.5}], "left_of: both points are the same"),
        ([{"polygon": [*SQUARE, SQUARE[0]], "friction": 0.5}], "polygon: [0, 0] twice in a row; leave out one of them"),
        ([{"polygon": [[0, 0], [1, 0], [0.2, 0.2], [0, 1]], "friction": 0.5}], "at the edge that begins at [1, 0]"),
        ([{"polygon": [[0, 0], [1, 0], [0, 1], [1, 1]], "friction": 0.5}], "it is not convex"),
        ([{"polygon": [[0, 0], [0.5, 0], [1, 0], [0, 1]], "friction": 0.5}], "leave out corners on straight edges"),
        ([{"polygon": SQUARE, "friction": 0.5}, half(0.9, 2.0)], "regions 0 and 1 overlap"),
        ([half(0.9, 0.5), half(0.8, 2.0)], "regions 0 and 1 overlap"),
    ],
)
def test_regions_that_make_no_sense_are_refused_by_name(regions, said):
    with pytest.raises(SceneError) as error:
        pair(regions, [[0.0, 0.0]])
    assert "ground.regions" in str(error.value)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_regions_may_touch():
    assert len(pair([half(0.9, 0.5), half(0.9, 2.0, ahead=False)], [[0.0, 0.0]]).parts.ground.regions) == 2
    right = [[x + 1.0, y] for x, y in SQUARE]
    assert pair([{"polygon": SQUARE, "friction": 0.5}, {"polygon": right, "friction": 2.0}], [[0.0, 0.0]])


def test_on_a_line_they_are_patches():
    line = {"name": "line", "body": {"contacts": [0, 1], "links": {"stiffness": 1}}, "friction": {"isotropic": 1}}
    with pytest.raises(SceneError, match=r"ground.regions: only in the plane; on a line give ground.patches"):
        Scene.model_validate(line | {"ground": {"regions": [half(0.9, 0.5)]}})


def test_corners_may_be_given_clockwise():
    ways = [RegionPart.model_validate({"polygon": corners, "friction": 1.0}) for corners in (SQUARE, SQUARE[::-1])]
    for part in ways:
        normals, offsets = part.half_planes
        assert (normals @ [0.5, 0.5] - offsets > 0.0).all()
