"""Backlash: closed forms, the same body led by hand, state, account, messages."""

from __future__ import annotations

import json
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crawler_lab.sweep.many_runs import simulate_many
from crawler_lab.sweep.vary import vary
from crawler_model.body.backlash import build_backlash
from crawler_model.body.curves import Bend, line
from crawler_model.crawler.crawler import Crawler
from crawler_model.crawler.ticks import runs_in_one_call
from crawler_model.errors import SceneError
from crawler_model.run.cycle import limit_cycle
from crawler_model.run.limits import largest_tow
from crawler_model.run.simulate import simulate
from crawler_model.scene.file import parse_scene
from crawler_model.scene.scene import Scene

from .bodies import LOOSE, drawn

GAIT = [[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1], [0, 0]]


def scene_of(links: Any, rows: Any, forward: Any = 0.2, backward: Any = 9.0, **more: Any) -> Scene:
    """A chain with links, whose drive goes through rows of lengths, one a second, and repeats."""
    body = {"contacts": list(range(len(links) + 1)), "links": links} | more.pop("body", {})
    drive = {"times": list(range(len(rows))), "actuation": rows, "period": len(rows) - 1}
    friction = {"forward": forward, "backward": backward}
    return parse_scene(json.dumps({"name": "loose", "body": body, "friction": friction, "drive": drive, **more}))


def link(backlash: float, stiffness: float = 20.0, **more: Any) -> dict[str, Any]:
    return {"stiffness": stiffness, "backlash": backlash, **more}


@pytest.mark.parametrize("method", ["exact", "catch_up"])
@pytest.mark.parametrize("backlash", [0.0, 0.002, 0.03, 0.1])
def test_backlash_is_taken_from_the_stroke(backlash, method):
    """D - b - 2 mu/k, or nothing; a first stroke from the middle of the slack loses half of it."""
    run = simulate(scene_of([link(backlash)], [[0], [0.1], [0]]), 8.0, method=method)
    assert run.per_period[1:] == pytest.approx(max(0.1 - backlash - 2 * 0.2 / 20.0, 0.0), abs=1e-15)
    anchored = run.waypoint_displacement[0]
    assert anchored.tolist() == [0.0, 0.0]
    first = scene_of([link(backlash)], [[0], [0.1], [0]], forward=[9.0, 0.2])
    assert simulate(first, 1.0).displacement[-1, 1] == pytest.approx(max(0.1 - backlash / 2 - 0.01, 0.0), abs=1e-15)


def test_backlash_and_hysteresis_are_taken_together():
    element = {"stiffness": 1e6, "yield": 0.1}
    run = simulate(scene_of([link(0.03, hysteresis=[element])], [[0], [0.1], [0]]), 8.0)
    assert run.per_period[1:] == pytest.approx(0.1 - 0.03 - 2 * (0.2 + 0.1) / 20.0, abs=4 * 0.1 / 1e6)


@given(data=st.data(), kind=st.sampled_from(LOOSE))
def test_a_body_with_backlash_is_one_without_whose_commands_are_led(data, kind):
    """Friction that is commanded, too, changes along the ramp while the command crosses the slack."""
    body = data.draw(drawn(kind)).driven()
    loose = body.scene
    parts = body.data["body"]
    tight = {
        "links": [{key: value for key, value in part.items() if key != "backlash"} for part in parts["links"]],
        "segments": [part | {"backlash": 0.0} for part in parts["segments"]],
    }
    free = Scene.model_validate(body.data | {"body": parts | tight})
    assert free.body.backlash is None
    crawler, other = Crawler(loose), Crawler(free)
    lengths, before = np.zeros(loose.body.springs), loose.drive.targets[0]
    reach = np.zeros(loose.body.springs)
    for bend in loose.body.bends:
        reach[bend.spring] = bend.backlash / 2
    for target in loose.drive.targets[1:]:
        start, change = before[: reach.size], (target - before)[: reach.size]
        with np.errstate(all="ignore"):  # wherever a command is at an end of its slack, or would be
            places = np.concatenate([(lengths + side * reach - start) / change for side in (-1, 1)])
        for place in (*np.sort(places[(places > 1e-12) & (places < 1.0)]), 1.0):
            led = before + place * (target - before)
            lengths = np.clip(lengths, led[: reach.size] - reach, led[: reach.size] + reach)
            led[: reach.size] = lengths
            other.follow(led[None])
        crawler.follow(target[None].copy())
        assert crawler.actuation == pytest.approx(lengths, abs=1e-13)
        before = target
    assert crawler.displacement == pytest.approx(other.displacement, abs=1e-11 * body.extent)


@given(
    st.lists(st.lists(st.integers(-8, 8), min_size=2, max_size=2), min_size=1, max_size=5),
    st.lists(st.integers(0, 8), min_size=2, max_size=2),
)
def test_ramps_are_divided_where_actuators_begin(rows, widths):
    """Whole numbers, so that actuators begin together, at the ends of ramps, and not at all."""
    bends = [Bend(k, line(1.0), line(0.0), (), float(width), 0.0) for k, width in enumerate(widths)]
    play = build_backlash(bends)
    if play is None:
        return
    targets = np.array(rows, dtype=np.float64)
    found, ramp, place = play.divide(np.zeros(play.springs.size), np.zeros(2), targets)
    ends = np.append(np.flatnonzero(np.diff(ramp)), ramp.size - 1)
    assert (place[ends] == 1.0).all()
    assert ramp[ends].tolist() == list(range(len(rows)))
    assert np.array_equal(found[ends], play.lead_along(np.zeros(play.springs.size), targets))
    commanded, lengths, begin = np.zeros(2), np.zeros(2), 0.0
    half = np.array(widths) / 2
    for row, k, end in zip(found, ramp, place, strict=True):
        before = targets[k - 1] if k else np.zeros(2)
        for part in (0.3, 0.8, 1.0):  # straight between the divisions
            at = begin + part * (end - begin)
            commanded = before + at * (targets[k] - before)
            straight = lengths + part * (row - lengths)
            assert straight == pytest.approx(np.clip(lengths, commanded - half, commanded + half), abs=1e-12)
        lengths, begin = row, end % 1.0


def test_where_actuators_stand_is_state():
    crawler = Crawler(scene_of([link(0.02), link(0.05)], GAIT))
    crawler.advance([0.1, 0.03])
    assert crawler.actuation == pytest.approx([0.09, 0.005], abs=1e-15)
    assert crawler.commanded.tolist() == [0.1, 0.03]
    fork, stored = crawler.copy(), pickle.loads(pickle.dumps(crawler))
    assert fork == stored == crawler
    crawler.advance([0.095, 0.03])  # within the slack: nothing moves, but the command is another one
    assert crawler.displacement.tobytes() == fork.displacement.tobytes()
    assert crawler.tension.tobytes() == fork.tension.tobytes()
    assert fork == stored != crawler
    for other in (fork, stored):
        other.advance([0.095, 0.03])
        assert other == crawler
    assert crawler.row[:2].tolist() == [0.095, 0.03]


def test_a_command_in_force_is_held_with_its_slack():
    """What a command leaves out stays as commanded, though the actuator stands elsewhere."""
    scene = scene_of([link(0.02)], [[0], [0.1], [0]], loads=[0.0, 0.0])
    crawler = Crawler(scene)
    crawler.advance([0.1])
    length = crawler.actuation.copy()
    crawler.follow(crawler.target(crawler.commanded, loads=[0.01, 0.0])[None])
    assert crawler.commanded.tolist() == [0.1]
    assert np.array_equal(crawler.actuation, length)


@pytest.mark.parametrize("ahead", [-0.015, 0.0, 0.015])
def test_the_place_in_the_slack_at_the_start_is_given_or_the_middle(ahead):
    start = {"displacement": [0.0, ahead], "backlash": [ahead]}
    crawler = Crawler(scene_of([link(0.03)], [[0], [0.1], [0]], forward=[9.0, 0.2], start=start))
    assert crawler.tension.tolist() == [0.0]
    assert crawler.actuation[0] - crawler.commanded[0] == ahead
    crawler.advance([0.1])
    assert crawler.displacement[1] == pytest.approx(0.1 - 0.015 - 0.01, abs=1e-15)
    relaxed = scene_of([link(0.03)], [[0.2], [0.1], [0.2]], start="relaxed")
    assert Crawler(relaxed).displacement == pytest.approx([0.0, 0.2], abs=1e-15)


def test_a_limit_cycle_repeats_the_place_in_the_slack():
    cycle = limit_cycle(scene_of([link(0.02), link(0.05)], GAIT))
    assert cycle.settled
    assert cycle.gain == pytest.approx(
        simulate(scene_of([link(0.02), link(0.05)], GAIT), 40.0).per_period[-1], abs=1e-15
    )
    # within the slack nothing moves, although at the end of the first period the actuator stands elsewhere
    idle = limit_cycle(scene_of([link(0.1)], [[0], [0.1], [0]]))
    assert (idle.gain, idle.periods) == (0.0, 2)


def test_segments_have_it_as_a_strain():
    """A segment of equal elements is a chain of links, each with the strain times its length."""
    friction = {"forward": 0.4, "backward": 2.0}
    segment = {"name": "s", "from": 0.0, "to": 1.0, "stiffness": 1.0, "elements": 4, "backlash": 0.1}
    drive = {"times": [0, 1, 2], "period": 2, "actuation": [[0], [0.5], [0]]}
    whole = simulate(
        parse_scene(
            json.dumps({"name": "w", "body": {"segments": [segment | {"friction": friction}]}, "drive": drive})
        ),
        6.0,
    )
    share = np.array([0.125, 0.25, 0.25, 0.25, 0.125])
    rows = [[0] * 4, [0.125] * 4, [0] * 4]
    chain = simulate(scene_of([link(0.025, 4.0)] * 4, rows, (0.4 * share).tolist(), (2.0 * share).tolist()), 6.0)
    assert whole.displacement == pytest.approx(chain.displacement, abs=1e-14)
    assert whole.energy.relative_residual < 1e-12


def test_the_inertia_number_sees_where_actuators_begin():
    """The actuator starts in the middle of a ramp, with the speed of the command: with and without slack alike."""
    numbers = []
    for backlash in (0.0, 0.02):
        scene = scene_of([link(backlash)], [[0], [0.1], [0]], body={"masses": 0.05})
        numbers.append(simulate(scene, 6.0).inertia)
    assert numbers[1].number == pytest.approx(numbers[0].number, rel=1e-9)
    # the front contact moves once the slack and its own friction are crossed, a tenth and another tenth of the ramp
    assert (numbers[0].time, numbers[1].time) == pytest.approx((0.1, 0.2), abs=1e-9)


def test_jumps_and_tows_know_it():
    patches = [{"from": 1.03, "to": 1.2, "friction": 0.25}]
    scene = scene_of([link(0.02)], [[0], [0.1], [0]], ground={"patches": patches})
    one, other = (simulate(scene, 2.0, rate=rate) for rate in (1.0, 50.0))
    # the border is reached at a length of 0.03 + mu/k = 0.04, 0.05 of 0.1 along the command
    assert one.jumps[0].time == pytest.approx(0.5, abs=1e-12)
    assert [jump.time for jump in other.jumps] == pytest.approx([jump.time for jump in one.jumps], abs=1e-12)
    assert other.displacement[-1] == pytest.approx(one.displacement[-1], abs=1e-14)
    tow = largest_tow(scene_of([link(0.02)], [[0], [0.1], [0]], backward=0.5))
    free = largest_tow(scene_of([link(0.0)], [[0], [0.08], [0]], backward=0.5))
    assert tow.value == pytest.approx(free.value, rel=1e-6)


def test_sweeps_reach_it():
    scene = scene_of([link(0.02)], [[0], [0.1], [0]])
    found = simulate_many(vary(scene, {"body.links[0].backlash": [0.0, 0.01, 0.03]}), duration=8.0)
    assert found.per_period == pytest.approx(0.08 - np.array([0.0, 0.01, 0.03]), abs=1e-15)
    assert np.abs(found.residual).max() < 1e-12


def test_scenes_without_it_have_no_play():
    scene = scene_of([link(0.0)], [[0], [0.1], [0]])
    assert not scene.body.bends
    assert runs_in_one_call(Crawler(scene))
    assert not runs_in_one_call(Crawler(scene_of([link(0.02)], [[0], [0.1], [0]])))
    loose = scene_of([link(0.02)], [[0], [0.1], [0]])
    assert Scene.model_validate(loose.document()) == loose


@pytest.mark.parametrize(
    ("given", "start", "message"),
    [
        ({"backlash": -0.001}, {}, r"body\.links\.0: backlash: -0\.001; it must be >= 0"),
        ({"backlash": "wide"}, {}, r"body\.links\.0\.backlash: 'wide' is not a number"),
        ({"backlash": float("inf")}, {}, r"body\.links\.0\.backlash: inf is not finite"),
        ({"backlash": 0.1, "tension": {"least": 0.0}}, {}, r"body\.links\.0\.backlash: with limits of `tension`"),
        ({"stiffness": None, "passive": {"stiffness": 1.0}, "backlash": 0.1}, {}, r"backlash: .* slack of an actuator"),
        ({"backlash": 0.02}, {"backlash": [0.02]}, r"start\.backlash\.0: 0\.02; it must be from -0\.01 to 0\.01"),
        ({"backlash": 0.02}, {"backlash": []}, r"start\.backlash: 0 number\(s\); give one for each of 1 links"),
        ({"backlash": 0.8}, {"backlash": [0.4]}, r"start\.displacement: contact 1 is pulled by 8 N"),
    ],
)
def test_mistakes_are_errors_of_one_line(given, start, message):
    more = {"start": {"displacement": [0.0, 0.0]} | start} if start else {}
    with pytest.raises(SceneError, match=message) as error:
        scene_of([{"stiffness": 20.0} | given], [[0], [0.7], [0]], **more)
    assert "\n" not in str(error.value)


def test_bodies_in_the_plane_refuse_it():
    data = {
        "name": "plane",
        "dimension": 2,
        "body": {"contacts": [[0, 0], [1, 0]], "links": [{"stiffness": 1.0, "backlash": 0.1}]},
        "friction": {"isotropic": 1.0},
    }
    for springs in ({}, {"springs": "length"}):
        with pytest.raises(SceneError, match=r"`backlash` are for bodies on a line"):
            Scene.model_validate(data | {"body": data["body"] | springs})
