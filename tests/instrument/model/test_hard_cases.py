"""Where others break down: each case must give the exact answer, or say what is the matter."""

from __future__ import annotations

from typing import Any

import numpy as np
import osqp
import pytest
import scipy.sparse as sp

from crawler_model import CommandError, Crawler, Scene, SceneError, simulate
from crawler_model.theory.stasis import stasis_margins

from .chains import scene
from .hard_cases import BOTH, CASES, NETS, Case, complete, net

TRIANGLE = {"times": [0, 0.5, 1], "period": 1}


def relative_violation(crawler: Crawler) -> float:
    margins = stasis_margins(crawler.tension, crawler.forward, crawler.backward)
    return -margins.min() / (np.abs(crawler.tension).max() + 1e-300)


SLOW = ("1000000 contacts stretched", "1e6 periods of two contacts")
VARIANTS = [
    pytest.param(
        *(case, body, method), id=f"{case.name}-{body}-{method}", marks=[pytest.mark.slow] if case.name in SLOW else []
    )
    for case in CASES
    for body, method in case.variants
]


@pytest.mark.parametrize(("case", "body", "method"), VARIANTS)
def test_the_exact_answer_or_a_named_diagnosis(case: Case, body: str, method: str):
    found = case.play(body, method)
    assert found.said == case.said
    assert found.error <= case.within


@pytest.mark.parametrize("method", ["exact", "catch_up"])
def test_a_jump_larger_than_the_domain(method):
    crawler = Crawler(scene(5, 1.0, 0.1, 0.3), method)
    step = crawler.advance([1e6, -1e6, 1e6, -1e6])
    assert step.certificate.violation < 1e-9
    assert crawler.shape == pytest.approx([1e6, -1e6, 1e6, -1e6], rel=1e-5)


@pytest.mark.parametrize("n", [2, 3, 10, 100, 1000])
def test_ties_many_contacts_arrive_at_once(n):
    """Links pull in pairs on equal contacts: all bounds are met in the same instant."""
    crawler = Crawler(scene(n, 1.0, 1.0, 1.5))
    for length in (5.0, -3.0, 0.0):
        step = crawler.advance(length * (-1.0) ** np.arange(n - 1))
        assert step.overspent == 0
        assert relative_violation(crawler) < 1e-12
        assert abs(step.certificate.energy_residual) < 1e-11 * (abs(step.work) + 1.0)


@pytest.mark.parametrize("which", ["one", "all"])
def test_friction_goes_to_zero_and_comes_back(which):
    n = 5
    crawler = Crawler(scene(n, 1.0, 1.0, 1.4))
    gone = np.zeros(n) if which == "all" else np.array([1.0, 1.0, 0.0, 1.0, 1.0])
    crawler.advance([1.0, -2.0, 0.5, 1.0])
    step = crawler.advance([1.0, -2.0, 0.5, 1.0], gone, 1.4 * gone)
    assert step.certificate.violation < 1e-13
    if which == "all":
        assert crawler.tension == pytest.approx(np.zeros(n - 1), abs=1e-15)
    else:
        assert crawler.tension[1] == pytest.approx(crawler.tension[2], abs=1e-14)
    for target in ([2.0, 0.0, 1.0, -1.0], [0.0] * 4):
        step = crawler.advance(target)
        assert step.certificate.violation < 1e-13
    step = crawler.advance([1.0] * 4, np.ones(n), np.full(n, 1.4))
    assert abs(step.certificate.energy_residual) < 1e-13
    assert step.certificate.violation < 1e-13


def test_exactly_no_friction_in_one_direction():
    drive = {**TRIANGLE, "actuation": [0, 1, 0]}
    run = simulate(scene(2, 1.0, 0.0, 1.0, drive))
    assert run.per_period == pytest.approx(1.0, abs=1e-13)  # nothing is lost to elasticity


def test_friction_that_grows_from_nothing_decides_who_holds():
    one, many = Crawler(scene(2, 1.0, 0.0, 0.0)), Crawler(scene(2, 1.0, 0.0, 0.0))
    step = one.advance([1.0], [0.0, 0.0], [1.0, 1.0])
    assert abs(step.certificate.energy_residual) < 1e-15
    assert step.certificate.complementarity < 1e-15
    for part in np.arange(1, 1001) / 1000:
        many.advance([part], [0.0, 0.0], [part, part])
    assert one.displacement == pytest.approx([0.0, 1.0], abs=1e-14)
    assert many.displacement == pytest.approx([0.0, 1.0], abs=1e-11)


@pytest.mark.parametrize("ratio", [1e6, 1e9, 1e12])
def test_a_weak_contact_beside_a_strong_one_still_holds(ratio):
    crawler = Crawler(scene(3, 1.0, [1.0, 1.3, ratio], [1.0, 1.3, ratio]))
    crawler.advance([0.5, 0.0])
    assert not crawler.displacement.any()
    assert crawler.tension.tolist() == [-0.5, 0.0]


def test_friction_that_shrinks_faster_than_the_load():
    crawler = Crawler(scene(2, 1.0, 1.0, 1.0, start=[0, 1]))
    crawler.advance([0.25], [1.5, 0.5], [1.5, 0.5])
    assert crawler.displacement == pytest.approx([0.0, 0.75], abs=1e-15)


@pytest.mark.parametrize("seed", range(20))
def test_ratios_of_a_million_million_in_one_body(seed):
    rng = np.random.default_rng(seed)
    n = 8
    stiffness = 10.0 ** rng.uniform(-6, 6, n - 1)
    mu = 10.0 ** rng.uniform(-6, 6, n)
    crawler = Crawler(scene(n, stiffness.tolist(), mu.tolist(), (1.7 * mu).tolist()))
    for _ in range(20):
        step = crawler.advance(rng.uniform(-1, 1, n - 1) * mu.max() / stiffness)
        assert step.overspent == 0
        assert step.certificate.violation < 1e-13 * mu.max() * n
        assert abs(step.certificate.energy_residual) < 1e-12 * (abs(step.work) + step.dissipation + 1e-300) * n
        elongation = crawler.tension / stiffness + crawler.actuation
        assert np.diff(crawler.displacement) == pytest.approx(elongation, abs=1e-10 * np.abs(elongation).max())


@pytest.mark.parametrize("n", [1_000, 100_000])
@pytest.mark.parametrize("method", ["exact", "catch_up"])
def test_long_chains(n, method):
    crawler = Crawler(scene(n, 1.0, 0.1, 0.3), method)
    i = np.arange(n - 1)
    for load in (0.5 * np.sin(i / 8.0), 0.5 * np.sin(i / 8.0 - 0.3), 1e-3 * (-1.0) ** i * np.minimum(i, 1000)):
        step = crawler.advance(load)
        assert step.certificate.violation < 1e-12
        if method == "exact":
            assert step.overspent == 0
            stored = (0.5 * crawler.tension**2).sum()
            assert abs(step.certificate.energy_residual) < 1e-11 * (stored + step.dissipation)


def test_a_spent_budget_is_said_and_the_tick_still_ends():
    crawler = Crawler(scene(50, 1.0, 0.1, 0.3), budget=60)
    step = crawler.advance(np.sin(np.arange(49.0)))
    assert step.overspent == 1
    assert crawler.actuation == pytest.approx(np.sin(np.arange(49.0)))
    assert step.certificate.violation < 1e-13


@pytest.mark.parametrize("budget", ["all", -1, 1.5])
def test_a_budget_is_a_whole_number(budget):
    with pytest.raises(CommandError, match=r"^budget: .*; it must be a whole number, 0 or more"):
        Crawler(scene(2, 1.0, 0.1, 0.3), budget=budget)


@pytest.mark.parametrize("distance", 10.0 ** np.arange(-15, -2.0))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_near_critical_friction_is_exact_or_said_to_be_critical(distance, sign):
    drive = {**TRIANGLE, "actuation": [0, 4, 0]}
    run = simulate(scene(4, 1.0, 0.1, 0.3 * (1.0 + sign * distance), drive), duration=3.0)
    assert run.violation < 1e-14
    assert run.energy.relative_residual < 1e-12
    # what decides is 0.3 (1 +- distance) against 3 * 0.1, relative to all friction, 1.6 N
    assert run.unique == (run.uniqueness_margin > 0.0)
    assert run.unique == (distance > 5e-12) or 1e-12 < distance < 1e-11


def test_at_rest_for_a_million_ticks_nothing_creeps():
    crawler = Crawler(scene(3, 7.0, 1.0, 1.3))
    wave = 0.05 * np.sin(2 * np.pi * np.arange(1000) / 1000.0)
    targets = np.column_stack((wave, -0.7 * wave, np.full((1000, 3), 1.0), np.full((1000, 3), 1.3)))
    crawler.follow(targets)
    first = crawler.tension
    for _ in range(1000):
        crawler.follow(targets)
    assert (crawler.tension == first).all()
    assert not crawler.displacement.any()


@pytest.mark.parametrize("rate", [1e-3, 0.37, 1.0, 1e3])
def test_the_length_of_ticks_changes_nothing(rate):
    drive = {**TRIANGLE, "actuation": [[0, 0], [3, -1], [0, 0]]}
    of = scene(3, 1.0, [0.2, 0.3, 0.4], [0.5, 0.1, 0.35], drive)
    one, other = simulate(of, 20.0, rate=1.0), simulate(of, 20.0, rate=rate)
    assert other.per_period == pytest.approx(one.per_period, abs=1e-13)


def test_ticks_of_a_thousand_periods():
    drive = {"times": [0, 0.5, 1], "period": 1, "actuation": [0, 4, 0]}
    run = simulate(scene(2, 1.0, 1.0, 2.0, drive), 3000.0, rate=1e-3)
    assert run.ticks == 3
    assert run.per_period[1:] == pytest.approx(np.full(2999, 2.0), abs=1e-13)


@pytest.mark.parametrize("name", NETS)
def test_one_step_of_a_large_graph_agrees_with_osqp(name):
    """The dual of the step: the tensions, nearest to the trial ones in the metric of the compliances."""
    n, between = NETS[name]
    rng = np.random.default_rng(1)
    stiffness, load = rng.uniform(0.5, 2.0, len(between)), rng.uniform(-3, 3, len(between))
    forward, backward = np.exp(rng.uniform(-2, 1, (2, n)))
    crawler = net(n, between, "catch_up", (forward, backward), stiffness.tolist())
    step = crawler.advance(load)
    a, b = np.array(between).T
    s = np.arange(len(between))
    gather = sp.csc_matrix((np.r_[np.ones(s.size), -np.ones(s.size)], (np.r_[a, b], np.r_[s, s])), shape=(n, s.size))
    solver = osqp.OSQP()
    solver.setup(
        *(sp.diags(1 / stiffness).tocsc(), load, gather, -backward, forward),
        **{"verbose": False, "eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 100_000},
    )
    assert crawler.tension == pytest.approx(solver.solve().x, abs=1e-6)
    assert step.unique
    assert step.certificate.violation < 1e-12
    assert step.certificate.complementarity < 1e-12


@pytest.mark.parametrize("load", [[2.0, 3.0, 3.0], [3.0, 3.0, 1.0]])
def test_what_becomes_undetermined_while_all_friction_vanishes_is_said(load):
    """Found by fuzzing: at the ramp's end all friction is gone, and with it the sight of what was critical before."""
    one, many = (net(3, complete(3), "exact", (np.ones(3), np.full(3, 2.0))) for _ in range(2))
    step = one.advance(load, np.zeros(3), np.zeros(3))
    parts = [many.advance(np.array(load) * p, np.full(3, 1 - p), np.full(3, 2 - 2 * p)) for p in (0.5, 0.95, 1.0)]
    assert not step.unique
    assert not all(part.unique for part in parts)
    assert one.displacement == pytest.approx(many.displacement, abs=1e-12)


@pytest.mark.parametrize("method", BOTH)
@pytest.mark.parametrize("load", [[0, 0, -3, 3, 0, -2, 0, -1, 0, -1], [1, 0, 0, 0, 0, 0, 0, 0, 0, 2]])
def test_a_body_without_friction_is_never_determined(method, load):
    crawler = net(5, complete(5), method, 0.0)
    for target in (load, np.zeros(10), load[::-1]):
        assert not crawler.advance(target).unique
        assert crawler.displacement.mean() == pytest.approx(0.0, abs=1e-14)


def test_a_tie_far_down_the_chain_holds_the_right_contact():
    """Found by fuzzing: the trial tension misses the sum of all bounds by rounding, which counts at each of them."""
    body = {"segments": [], "contacts": list(range(6)), "links": {"stiffness": [4.0, 4.0, 1.0, 1.0, 1.0]}}
    friction = {"forward": [0.0] * 6, "backward": [0.03125, 0.0625, 0.03125, 0.125, 0.25, 0.125]}
    crawler = Crawler(
        Scene.model_validate({"name": "t", "body": body, "friction": friction, "start": "relaxed"}), "catch_up"
    )
    crawler.advance([0.125, 0.125, 0.5, 1.0, 1.0])
    start, forward = crawler.actuation, np.array([0.09375, 0.1875, 0.09375, 0.375, 0.75, 0.375])
    change = np.array([-0.25, -0.25, 0.0, -1.5, -1.5])
    for part in np.arange(1, 101) / 1000:
        step = crawler.advance(start + part * change, part * forward, crawler.backward)
        assert step.certificate.complementarity < 1e-15
        assert np.diff(crawler.displacement) == pytest.approx(crawler.shape, abs=1e-13)


def test_a_link_from_the_near_end_of_a_segment_stays_a_link():
    """Found by mirroring: it lay between the springs of the segment, whose strain went to it."""
    friction = {"forward": 0.1, "backward": 0.3}
    parts = [
        {"name": n, "from": a, "to": a + 1, "stiffness": 1.0, "friction": friction, "elements": 5}
        for n, a in (("near", 0.0), ("far", 2.0))
    ]
    links = {"stiffness": 1.0, "between": [["near.from", "far.to"], ["near.to", "far.from"]]}
    mesh = Scene.model_validate({"name": "t", "body": {"segments": parts, "links": links}}).body
    for segment in mesh.segments:
        first = np.arange(segment.first, segment.last)
        assert mesh.ends[segment.springs].tolist() == np.column_stack((first, first + 1)).tolist()
    assert mesh.ends[mesh.link_springs].tolist() == [[0, 11], [5, 6]]


def mistaken(**parts: Any) -> dict[str, Any]:
    data = {
        "name": "t",
        "body": {"contacts": [0, 1, 2], "links": {"stiffness": 1.0, "between": [[0, 1], [1, 2], [0, 2]]}},
        "friction": {"forward": 1.0, "backward": 2.0},
    }
    return data | parts


LINKS = {"stiffness": 1.0}
MISTAKES = {
    "nan": (mistaken(friction={"forward": [1.0, float("nan"), 1.0], "backward": 1.0}), "nan is not finite"),
    "infinite": (mistaken(body={"contacts": [0, 1, float("inf")], "links": LINKS}), "inf is not finite"),
    "negative friction": (mistaken(friction={"forward": [1, 1, -3], "backward": 1}), "contact 2 has -3 N"),
    "no stiffness": (mistaken(body={"contacts": [0, 1, 2], "links": {"stiffness": [1, 0]}}), "link 1 has 0 N/m"),
    "empty": (mistaken(body={"contacts": [], "links": LINKS}), r"0 contact\(s\)"),
    "disconnected": (
        mistaken(body={"contacts": [0, 1, 2], "links": LINKS | {"between": [[0, 1]]}}),
        "contact 2",
    ),
    "self-link": (
        mistaken(body={"contacts": [0, 1, 2], "links": LINKS | {"between": [[0, 1], [2, 2]]}}),
        "link 1 joins contact 2 to itself",
    ),
    "nobody there": (
        mistaken(body={"contacts": [0, 1, 2], "links": LINKS | {"between": [[0, 1], [1, 7]]}}),
        "link 1 joins contact 7",
    ),
    "inadmissible start": (mistaken(start={"displacement": [0, 0, 9]}), "contact 2 is pulled by 18 N"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_scene_that_makes_no_sense_is_refused_by_name(mistake):
    data, text = MISTAKES[mistake]
    with pytest.raises((SceneError, ValueError), match=text):
        Scene.model_validate(data)


@pytest.mark.parametrize("links", [[[0, 1], [1, 2]], [[0, 1], [1, 2], [0, 2]]])
@pytest.mark.parametrize("method", BOTH)
def test_a_command_that_makes_no_sense_changes_nothing(links, method):
    crawler = net(3, links, method)
    good = [2.0] * len(links)
    crawler.advance(good)
    before = crawler.copy()
    for command, text in (
        (([float("nan"), *good[1:]],), "actuation: entry 0 is nan"),
        (([*good[1:], float("inf")],), f"actuation: entry {len(links) - 1} is inf"),
        ((good, [1, -1, 1], [1, 1, 1]), "contact_1/forward is -1; friction must be >= 0"),
        ((good, [1, 1, 1], [1, 1, float("nan")]), "backward: entry 2 is nan"),
        (([*good, 1.0],), "actuation: shape"),
        (([1e200, *good[1:]],), "at most"),
    ):
        with pytest.raises(CommandError, match=text):
            crawler.advance(*command)
        assert crawler == before


@pytest.mark.parametrize("between", ["chain", "ring"])
def test_the_work_of_a_ramp_is_bounded_by_the_budget(between):
    """Half the budget that suffices is overspent, and so is every smaller one; what suffices changes no bit."""
    n = 60
    links = [(i, i + 1) for i in range(n - 1)] + ([(0, n - 1)] if between == "ring" else [])
    i = np.arange(len(links))
    load = (-1.0) ** i * i**1.5
    whole = net(n, links, "exact", 1.0)
    step = whole.advance(load)
    assert step.overspent == 0
    followed = []
    for budget in (n // 2, 10 * n, 100 * n, 10_000 * n):
        crawler = net(n, links, "exact", 1.0)
        crawler.budget = budget
        part = crawler.advance(load)
        followed.append((part.overspent, part.events))
        assert crawler.actuation == pytest.approx(load)
        assert part.certificate.violation < 1e-9
    assert followed[0][0] == followed[1][0] == 1
    assert followed[-1] == (0, step.events)
    assert [events for _, events in followed] == sorted(events for _, events in followed)
    assert crawler.displacement.tolist() == whole.displacement.tolist()
