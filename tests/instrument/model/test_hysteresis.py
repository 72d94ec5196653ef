"""Springs that remember: rational numbers, loops of Masing's type, closed forms, state, account, messages."""

from __future__ import annotations

import json
import pickle
from fractions import Fraction as F
from typing import Any

import numpy as np
import pytest

from crawler_lab.sweep.many_runs import simulate_many
from crawler_lab.sweep.vary import vary
from crawler_model.crawler.crawler import Crawler
from crawler_model.errors import SceneError
from crawler_model.run.cycle import limit_cycle
from crawler_model.run.simulate import simulate
from crawler_model.scene.file import load_scene, parse_scene
from crawler_model.scene.scene import Scene

from .rational_hysteresis import HystereticChain, NotUniqueError

RUBBER = [{"stiffness": 4.0, "yield": 0.1}, {"stiffness": 2.0, "yield": 0.3}]


def scene_of(links: Any, rows: Any, forward: Any = 0.2, backward: Any = 9.0, period: bool = True, **more: Any) -> Scene:
    """A chain with links, whose drive goes through rows of lengths, one a second."""
    count = len(links) + 1 if isinstance(links, list) else 2
    drive = {"times": list(range(len(rows))), "actuation": rows} | ({"period": len(rows) - 1} if period else {})
    return parse_scene(
        json.dumps(
            {
                "name": "rubber",
                "body": {"contacts": list(range(count)), "links": links},
                "friction": {"forward": forward, "backward": backward},
                "drive": drive,
                **more,
            }
        )
    )


def draw_chain(seed: int) -> tuple[Scene, HystereticChain, list[list[F]]]:
    """A random chain of dyadic numbers, of 2 to 4 contacts, with up to three elements a link."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))

    def eighths(low: int, high: int, count: int) -> list[F]:
        return [F(int(v), 8) for v in rng.integers(low, high, count)]

    stiffness = eighths(8, 33, n - 1)
    elements = [list(zip(eighths(4, 33, k), eighths(1, 7, k), strict=True)) for k in rng.integers(0, 4, n - 1)]
    elements[0] = elements[0] or [(F(2), F(1, 4))]
    forward, backward = eighths(2, 9, n), eighths(2, 17, n)
    rows = [[F(0)] * (n - 1), *(eighths(-12, 13, n - 1) for _ in range(6))]
    links = [
        {
            "stiffness": float(k),
            "hysteresis": [{"stiffness": float(s), "yield": float(y)} for s, y in each],
        }
        for k, each in zip(stiffness, elements, strict=True)
    ]
    given = [[float(v) for v in row] for row in rows]
    scene = scene_of(links, given, [float(v) for v in forward], [float(v) for v in backward], period=False)
    return scene, HystereticChain(stiffness, elements, forward, backward), rows[1:]


@pytest.mark.parametrize("first", range(0, 60, 10))
def test_random_chains_are_those_of_rational_numbers_at_any_rate(first):
    compared = 0
    for seed in range(first, first + 10):
        scene, chain, rows = draw_chain(seed)
        places = []
        try:
            for row in rows:
                chain.ramp(row)
                places.append([float(x) for x in chain.x])
        except NotUniqueError:
            continue
        compared += 1
        for rate in (0.5, 1.0, 7.0):
            run = simulate(scene, rate=rate)
            assert run.unique
            assert run.waypoint_displacement[1:] == pytest.approx(np.array(places), abs=1e-12)
            assert run.tension[-1] == pytest.approx(np.array([float(t) for t in chain.tension()]), abs=1e-12)
            assert run.energy.internal_dissipation == pytest.approx(float(chain.lost), abs=1e-12)
            assert abs(run.energy.residual) < 1e-12
    assert compared >= 5


@pytest.mark.parametrize("method", ["exact", "catch_up"])
@pytest.mark.parametrize("limit", [0.1, 0.3])
def test_a_stiff_element_takes_twice_its_yield_from_the_stroke(limit, method):
    """D - 2 (mu + f)/k, up to what the element stretches before it yields."""
    link = {"stiffness": 20.0, "hysteresis": [{"stiffness": 1e6, "yield": limit}]}
    run = simulate(scene_of([link], [[0], [0.1], [0]]), 8.0, method=method)
    assert run.per_period[1:] == pytest.approx(0.1 - 2 * (0.2 + limit) / 20.0, abs=4 * limit / 1e6)
    assert run.energy.internal_dissipation > 0.0


def test_loops_follow_masings_rule_from_every_reversal():
    """Behind a reversal each branch is the first one, twice as large, as far as loops inside of loops go."""
    spring, friction = 5.0, 0.25
    crawler = Crawler(scene_of([{"stiffness": spring, "hysteresis": RUBBER}], [[0], [1], [0]], friction))
    stroke, direction, start, scale = 0.6, 1.0, (0.0, 0.0), 1.0
    length = 0.0
    for _ in range(9):
        for part in np.linspace(0.0, 1.0, 12)[1:]:
            crawler.advance([length + direction * stroke * part])
            z, force = float(crawler.shape[0]), float(crawler.hysteresis.sum())
            way = abs(z - start[0])
            branch = sum(min(e["stiffness"] * way, scale * e["yield"]) for e in RUBBER)
            assert force == pytest.approx(start[1] + direction * branch, abs=1e-14)
            assert crawler.tension[0] == pytest.approx(spring * (z - crawler.actuation[0]) + force, abs=1e-14)
        length += direction * stroke
        start, direction, scale, stroke = (z, force), -direction, 2.0, 0.93 * stroke
        assert way > 0.0


def test_a_contact_at_rest_stays_at_rest_to_the_bit():
    crawler = Crawler(scene_of([{"stiffness": 5.0, "hysteresis": RUBBER}], [[0], [1], [0]]))
    crawler.advance([0.7])
    place, force = crawler.displacement.tobytes(), crawler.hysteresis.tobytes()
    for k in range(1000):
        crawler.advance([0.7 - 0.01 * (k % 3)])
    assert (crawler.displacement.tobytes(), crawler.hysteresis.tobytes()) == (place, force)


def test_what_springs_remember_is_state():
    scene = scene_of([{"stiffness": 5.0, "hysteresis": RUBBER}] * 2, [[0, 0], [0.7, 0], [0.2, 0.6], [0, 0]])
    crawler = Crawler(scene)
    crawler.advance([0.7, 0.3])
    fork, stored = crawler.copy(), pickle.loads(pickle.dumps(crawler))
    assert fork == stored == crawler
    crawler.advance([0.1, 0.1])
    assert fork == stored != crawler
    assert not np.array_equal(fork.hysteresis, crawler.hysteresis)
    for other in (fork, stored):
        other.advance([0.1, 0.1])
        assert other == crawler


def test_forces_at_the_start_are_given_or_zero():
    link = {"stiffness": 5.0, "hysteresis": RUBBER}
    rows = [[0], [0.4], [0]]
    assert Crawler(scene_of([link], rows)).hysteresis.tolist() == [0.0, 0.0]
    start = {"displacement": [0.0, 0.02], "hysteresis": [[-0.1, 0.05]]}
    crawler = Crawler(scene_of([link], rows, start=start))
    assert crawler.hysteresis == pytest.approx([-0.1, 0.05], abs=1e-15)
    assert crawler.tension[0] == pytest.approx(0.1 - 0.1 + 0.05, abs=1e-15)
    # the state that a run ends in, as the start of another one
    before = Crawler(scene_of([link], rows))
    before.advance([0.4])
    start = {"displacement": before.displacement.tolist(), "hysteresis": [before.hysteresis.tolist()]}
    after = Crawler(scene_of([link], [[0.4], [0.1], [0.4]], start=start))
    before.advance([0.1])
    after.advance([0.1])
    assert after.displacement == pytest.approx(before.displacement, abs=1e-14)
    assert after.hysteresis == pytest.approx(before.hysteresis, abs=1e-14)


def test_the_account_has_what_springs_lose():
    scene = scene_of([{"stiffness": 5.0, "hysteresis": RUBBER}], [[0], [0.7], [0]])
    run = simulate(scene, 6.0, rate=7.0)
    energy, ticks = run.energy, run.energies
    assert energy.internal_dissipation > 0.01
    assert energy.work == pytest.approx(energy.dissipation + energy.internal_dissipation + energy.stored, abs=1e-14)
    change = np.diff(ticks.stored)
    spent = (ticks.work - ticks.dissipation - ticks.internal_dissipation)[1:]
    assert change == pytest.approx(spent, abs=1e-14)
    assert run.summary()["internal_dissipation"] == energy.internal_dissipation
    assert run.summary()["internal_dissipation"] == energy.internal_dissipation


def test_a_limit_cycle_repeats_what_springs_remember():
    scene = scene_of([{"stiffness": 5.0, "hysteresis": RUBBER}] * 2, [[0, 0], [0.7, 0], [0.2, 0.6], [0, 0]])
    cycle = limit_cycle(scene)
    assert cycle.settled
    assert cycle.gain == pytest.approx(simulate(scene, 90.0).per_period[-1], abs=1e-13)


def test_every_element_of_a_segment_has_it():
    """A segment of equal elements is a chain of links with the modulus over their length."""
    friction = {"forward": 0.4, "backward": 2.0}
    hysteresis = [{"stiffness": 0.5, "yield": 0.05}]
    segment = {"name": "s", "from": 0.0, "to": 1.0, "stiffness": 1.0, "elements": 4, "hysteresis": hysteresis}
    drive = {"times": [0, 1, 2], "period": 2, "actuation": [[0], [0.5], [0]]}
    body = {"segments": [segment | {"friction": friction}]}
    whole = simulate(parse_scene(json.dumps({"name": "whole", "body": body, "drive": drive})), 6.0)
    link = {"stiffness": 4.0, "hysteresis": [{"stiffness": 2.0, "yield": 0.05}]}
    share = np.array([0.125, 0.25, 0.25, 0.25, 0.125])
    rows = [[0] * 4, [0.125] * 4, [0] * 4]
    chain = simulate(scene_of([link] * 4, rows, (0.4 * share).tolist(), (2.0 * share).tolist()), 6.0)
    assert whole.displacement == pytest.approx(chain.displacement, abs=1e-14)
    assert whole.energy.internal_dissipation == pytest.approx(chain.energy.internal_dissipation, abs=1e-14)


def test_sweeps_reach_its_numbers():
    scene = scene_of([{"stiffness": 5.0, "hysteresis": RUBBER}], [[0], [0.7], [0]])
    found = simulate_many(vary(scene, {"body.links[0].hysteresis[1].yield": [0.1, 0.3]}), duration=8.0)
    for value, gain in zip((0.1, 0.3), found.per_period, strict=True):
        rubber = [RUBBER[0], RUBBER[1] | {"yield": value}]
        alone = simulate(scene_of([{"stiffness": 5.0, "hysteresis": rubber}], [[0], [0.7], [0]]), 8.0)
        assert gain == pytest.approx(alone.per_period[-1], abs=1e-14)
    assert np.abs(found.residual).max() < 1e-12


def test_a_scene_survives_a_round_trip():
    scene = load_scene("rubber_worm")
    assert Scene.model_validate(scene.document()) == scene
    assert simulate(scene).energy.internal_dissipation > 0.0


@pytest.mark.parametrize(
    ("link", "start", "message"),
    [
        ({"hysteresis": [{"stiffness": 0.0, "yield": 1.0}]}, {}, r"hysteresis\.0: stiffness: 0; it must be > 0"),
        ({"hysteresis": [{"stiffness": 1.0, "yield": -1.0}]}, {}, r"hysteresis\.0: yield: -1; it must be > 0"),
        ({"hysteresis": [{"stiffness": 1.0}]}, {}, r"hysteresis\.0\.yield: missing"),
        ({"hysteresis": [{"stiffness": 1.0, "yields": 1.0}]}, {}, r"unknown key; the nearest known key is 'yield'"),
        ({"hysteresis": [{"stiffness": 1.0, "yield": 1.0}] * 101}, {}, r"hysteresis: 101 elements; at most 100"),
        ({"hysteresis": RUBBER, "tension": 1.0}, {}, r"hysteresis: where .*slack.*`passive` spring"),
        ({"hysteresis": RUBBER}, {"hysteresis": [[0.0]]}, r"start\.hysteresis\.0: 1 force\(s\); .* each of 2 element"),
        ({"hysteresis": RUBBER}, {"hysteresis": []}, r"start\.hysteresis: 0 list\(s\); give one for each of 1"),
        ({"hysteresis": RUBBER}, {"hysteresis": [[0.2, 0.0]]}, r"start\.hysteresis\.0\.0: 0\.2 N; .* -0\.1 to 0\.1 N"),
        ({"hysteresis": RUBBER}, {"hysteresis": [[0.1, 0.3]]}, r"start\.displacement: contact 0 is pulled by 0\.4 N"),
    ],
)
def test_mistakes_are_errors_of_one_line(link, start, message):
    given = {"start": {"displacement": [0.0, 0.0]} | start} if start else {}
    with pytest.raises(SceneError, match=message) as error:
        scene_of([{"stiffness": 5.0} | link], [[0], [0.7], [0]], **given)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("elements", [5, 9, 10])
def test_pulls_that_cancel_but_for_rounding_move_no_contact_on_gradual_ground(elements):
    """Where two segments meet, commands pull a contact at its bound equally from both sides."""
    segments = [
        {"name": "trunk", "from": 0.0, "to": 0.5, "hysteresis": [{"stiffness": 3.0, "yield": 0.05}]},
        {"name": "tail", "from": 0.5, "to": 1.0, "backlash": 0.01},
    ]
    of_both = {"stiffness": 2.0, "friction": {"forward": 0.1, "backward": 0.4}, "elements": elements}
    rows = [[0.0, 0.0, 0.0], [0.3, 0.1, 0.1], [0.3, 0.2, 0.1], [0.0, 0.0, 0.0]]
    scene = Scene.model_validate(
        {
            "name": "trunk_and_foot",
            "body": {
                "segments": [segment | of_both for segment in segments],
                "contacts": [1.5],
                "links": {"stiffness": 4.0, "between": [["tail.to", 0]]},
            },
            "friction": {"forward": 0.05, "backward": 0.2},
            "ground": {
                "profile": {"at": [0.0, 2.0], "friction": [1.0, 1.5]},
                "walls": [{"at": 1.9, "stops": "forward", "contacts": [0]}],
            },
            "drive": {"times": [0.0, 1.0, 2.0, 3.0], "period": 3.0, "actuation": rows},
        }
    )
    ticks, waypoints = (simulate(scene, duration=12.0, rate=rate) for rate in (100.0, 1.0))
    for run in (ticks, waypoints):
        assert run.unsolved == 0
        assert run.energy.relative_residual < 1e-12
        assert run.violation < 1e-13
    assert ticks.waypoint_displacement == pytest.approx(waypoints.waypoint_displacement, abs=1e-12)
