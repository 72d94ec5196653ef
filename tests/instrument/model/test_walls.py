"""Walls: exact rest whatever the force, the interval of the push, jumps that end there, and chains in fractions."""

from __future__ import annotations

import json

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
)

from .rational_ground import Motion, draw_chain

CHAIN, GRAPH = None, [[0, 1], [0, 1]]
BODIES = pytest.mark.parametrize("between", [CHAIN, GRAPH], ids=["chain", "graph"])


def two(walls, between=CHAIN, forward=0.2, backward=0.9, rows=None, **ground) -> Scene:
    """Two contacts, 1 m apart, on 20 N/m, as one link or as two."""
    links = {"stiffness": 20.0} if between is None else {"stiffness": 10.0, "between": between}
    scene = {
        "name": "two",
        "body": {"contacts": [0.0, 1.0], "links": links},
        "friction": {"forward": forward, "backward": backward},
        "ground": {"walls": walls, **ground},
    }
    if rows is not None:
        lengths = [[row] if between is None else [row, row] for row in rows]
        scene["drive"] = {"times": list(range(len(rows))), "actuation": lengths}
    return Scene.model_validate(scene)


@BODIES
@pytest.mark.parametrize("stroke", [0.05, 0.1, 0.3])
def test_the_push_is_an_interval_that_friction_leaves_open(between, stroke):
    """At the wall the spring pushes by k D, until the rear foot slides back; the front foot holds any part of that."""
    run = simulate(two([{"at": 1.0, "stops": "forward"}], between, rows=[0.0, stroke, stroke]), rate=3.0)
    force = min(20.0 * stroke, 0.9)
    assert [(push.time, push.contact, push.wall) for push in run.wall_push] == [(0.0, 1, 0), (1.0, 1, 0), (2.0, 1, 0)]
    for push in run.wall_push[1:]:
        assert push.least == pytest.approx(force - 0.2, abs=1e-13)
        assert push.most == pytest.approx(force + 0.9, abs=1e-13)
    assert (run.displacement[:, 1] == 0.0).all()
    assert run.displacement[-1, 0] == pytest.approx(-max(stroke - 0.9 / 20.0, 0.0), abs=1e-14)
    assert json.loads(json.dumps(run.summary()))["wall_push"][1].keys() == {"time", "contact", "wall", "least", "most"}


@BODIES
def test_a_contact_stands_at_a_wall_to_the_bit_and_leaves_it_backward(between):
    walls = [{"at": 1.1, "stops": "forward"}, {"at": -0.3, "stops": "backward", "contacts": [0]}]
    crawler = Crawler(two(walls, between))
    links = crawler.body.springs
    for length, x in ((0.2, 1.1 - 1.0), (0.1, 1.1 - 1.0), (0.13, 1.1 - 1.0)):
        step = crawler.advance([length] * links)
        assert crawler.displacement[1] == x
        assert abs(step.certificate.energy_residual) < 1e-15
        assert step.certificate.violation < 1e-15
    crawler.advance([-0.5] * links)  # the rear foot slides forward at 0.2 N before the front foot slides back at 0.9 N
    assert crawler.displacement == pytest.approx([0.59, 0.1], abs=1e-13)


@pytest.mark.parametrize("wall", [1.27, 1.25])
def test_a_jump_ends_at_a_wall(wall):
    """On the border at 1.25 m friction falls to a fifth; without the wall the jump would be 0.8 x 0.2/20 = 0.008 m."""
    patch = {"from": 1.25, "to": 9.0, "forward": 0.0}
    crawler = Crawler(
        two(
            [{"at": wall - 0.018, "stops": "forward"}] if wall > 1.25 else [{"at": wall, "stops": "forward"}],
            patches=[patch],
        )
    )
    step = crawler.advance([0.5])
    way = wall - 0.018 - 1.25 if wall > 1.25 else 0.0
    assert [jump.distance for jump in step.jumps] == ([pytest.approx(way, abs=1e-14)] if way else [])
    assert step.jump_loss == pytest.approx(0.2 * way - 10.0 * way**2 if way else 0.0, abs=1e-15)
    assert 1.0 + crawler.displacement[1] == pytest.approx(1.25 + way, abs=1e-15)
    assert abs(step.certificate.energy_residual) < 1e-14


@pytest.mark.parametrize("seed", range(64))
def test_chains_between_walls_are_those_in_fractions(seed):
    """Whatever the rate; pushes included."""
    chain = draw_chain(np.random.default_rng(seed))
    motion, exact, pushes = Motion(chain), [], []
    for row in chain.rows:
        motion.ramp(row)
        exact.append([float(x) for x in motion.x])
        pushes.append({i: tuple(map(float, push)) for (i, _), push in motion.pushes().items()})
    largest = np.abs(exact).max()
    for rate in (1.0, float(np.random.default_rng(seed).uniform(0.3, 9.0))):
        run = simulate(Scene.model_validate(chain.data), rate=rate)
        assert run.waypoint_displacement[1:] == pytest.approx(np.array(exact), abs=1e-12 * largest)
        assert run.unique
        assert run.jumps == ()
        assert run.violation < 1e-13
        assert run.energy.relative_residual < 1e-13
        for time, expected in enumerate(pushes, start=1):
            found = {push.contact: (push.least, push.most) for push in run.wall_push if push.time == time}
            assert found.keys() == expected.keys()
            for contact, push in expected.items():
                assert found[contact] == pytest.approx(push, abs=1e-12)


def test_a_body_between_two_walls_pushes_both():
    """A wedge: nothing can slide, and the spring pushes both walls with all that friction does not hold."""
    walls = [{"at": 0.0, "stops": "backward"}, {"at": 1.0, "stops": "forward"}]
    run = simulate(two(walls, rows=[0.0, 0.5, 0.0]), rate=2.0)
    assert not run.displacement.any()
    last = [push for push in run.wall_push if push.time == 1.0]
    assert [(p.contact, p.wall) for p in last] == [(0, 0), (1, 1)]
    assert [(p.least, p.most) for p in last] == [pytest.approx((9.1, 10.2)), pytest.approx((9.8, 10.9))]
    assert run.visited_margin <= 1.0


def test_walls_stop_the_contacts_of_segments():
    data = {
        "name": "worm",
        "body": {
            "segments": [
                {
                    "name": "trunk",
                    "from": 0.0,
                    "to": 1.0,
                    "stiffness": 1.0,
                    "elements": 20,
                    "friction": {"forward": 0.1, "backward": 0.3},
                }
            ]
        },
        "ground": {"walls": [{"at": 1.02, "stops": "forward"}]},
        "drive": {"times": [0, 1], "actuation": [[0.0], [0.5]]},
    }
    run = simulate(Scene.model_validate(data))
    assert run.position[-1, -1] == 1.02
    assert run.position.max() == 1.02
    (push,) = run.wall_push
    assert push.contact == 20
    assert run.energy.relative_residual < 1e-12


def test_loads_that_friction_does_not_hold_push_a_body_to_a_wall():
    """Behind the border friction vanishes forward, so that the body slides off to the wall."""
    data = {
        "name": "slide",
        "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 20.0}},
        "friction": {"forward": 0.3, "backward": 0.9},
        "loads": [0.1, 0.1],
        "ground": {"patches": [{"from": 1.05, "to": 9.0, "forward": 0.0}], "walls": [{"at": 4.0, "stops": "forward"}]},
        "drive": {"times": [0, 1, 2, 3], "actuation": [[0.0], [0.2], [-0.2], [0.2]]},
    }
    run = simulate(Scene.model_validate(data))
    assert run.position.max() <= 4.0
    assert run.energy.relative_residual < 1e-12


WRONG = [
    (
        {"walls": [{"at": 0.9, "stops": "forward"}]},
        r"ground.walls: wall 0 stops forward at 0.9 m, but contact 1 starts 0.1 m beyond it, at 1 m",
    ),
    (
        {"walls": [{"at": 1.5, "stops": "forward"}, {"at": 2.0, "stops": "backward", "contacts": [1]}]},
        r"ground.walls: wall 1, which stops backward at 2 m, is ahead of wall 0, which stops forward at 1.5 m; they leave "
        "no place for contact 1",
    ),
    (
        {"walls": [{"at": 2.0, "stops": "forward", "contacts": [2]}]},
        r"ground.walls: wall 0: contacts: 2; the isolated ",
    ),
    ({"walls": [{"at": 2.0, "stops": "up"}]}, r"ground.walls.0.stops: .*forward.*backward"),
    ({"walls": [{"at": 2.0}]}, r"ground.walls.0.stops"),
]


@pytest.mark.parametrize(("ground", "message"), WRONG)
def test_walls_that_cannot_be_are_refused_in_a_line(ground, message):
    with pytest.raises(SceneError, match=message) as error:
        two(**ground)
    assert "\n" not in str(error.value)


def test_the_gallery_pushes_a_wall_as_its_comments_say():
    run = simulate(load_scene("wall_pusher"))
    assert run.per_period[1:4] == pytest.approx([0.08, 0.08, 0.05], abs=1e-12)
    assert np.abs(run.per_period[4:]).max() < 1e-15
    assert (run.displacement[run.time > 4.0][:, 1] == 0.5 - 0.2).all()
    hardest = [push for push in run.wall_push if push.time % 1.0 == 0.5]
    assert [(push.least, push.most) for push in hardest] == [pytest.approx((0.3, 1.0))] * 7
    assert run.unique


def test_what_is_not_available_between_walls_is_refused_with_the_reason():
    scene = load_scene("wall_pusher")
    with pytest.raises(CommandError, match=r"method: catch_up steps through ground.walls instead of stopping at them"):
        Crawler(scene, "catch_up")
    with pytest.raises(
        CommandError, match=r"largest_tow: wall_pusher has ground.walls, so what a period gains depends on the place"
    ):
        largest_tow(scene)
    plane = {"name": "plane", "dimension": 2, "body": {"contacts": [[0, 0], [1, 0]], "links": {"stiffness": 1.0}}}
    plane |= {"friction": {"isotropic": 1.0}, "ground": {"walls": [{"at": 2.0, "stops": "forward"}]}}
    with pytest.raises(SceneError, match=r"ground.walls: only on a line; in the plane paths are followed in steps"):
        Scene.model_validate(plane)
