from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crawler_model import Crawler, Scene, load_scene, simulate
from crawler_model.theory.uniqueness import (
    Undecided,
    choose_translation,
    commanded_margin,
    translation_interval,
    uniqueness_margin,
)

from ..chains import scene


@given(st.integers(0, 2**32 - 1))
def test_the_margin_is_the_least_over_all_subsets(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    plus, minus = rng.uniform(0, 2, (2, n))
    gaps = [abs(sum(m if j else -p for p, m, j in zip(plus, minus, s, strict=True))) for s in product((0, 1), repeat=n)]
    assert uniqueness_margin(plus, minus) == pytest.approx(min(gaps) / (plus + minus).sum(), abs=1e-12)


@given(st.integers(0, 2**32 - 1))
def test_with_loads_the_margin_is_that_of_the_condition_with_their_sum(seed):
    """Condition (*) fails when, for some J, sum_J mu_minus + sum f = sum_{not J} mu_plus."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 7))
    plus, minus = rng.uniform(0, 2, (2, n))
    load = rng.normal(size=n)
    load += (rng.uniform(-minus.sum(), plus.sum()) - load.sum()) / n
    gaps = [
        abs(sum(m if j else -p for p, m, j in zip(plus, minus, s, strict=True)) + load.sum())
        for s in product((0, 1), repeat=n)
    ]
    expected = min(gaps) / (plus + minus).sum()
    assert uniqueness_margin(plus - load, minus + load) == pytest.approx(expected, abs=1e-12)


def loaded(load, forward=0.2, backward=0.5):
    """Two contacts, and half of the load on each."""
    drive = {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [4.0], [0.0]]}
    return Scene.model_validate(scene(2, 1.0, forward, backward, drive).document() | {"loads": load / 2.0})


@pytest.mark.parametrize("load", [-0.3, -0.3 + 4e-13, -0.3 - 4e-13])
def test_a_load_that_balances_directional_friction_is_critical(load):
    """Two contacts: J is one of them, 0.5 - 0.3 = 0.2."""
    run = simulate(loaded(load), 3.0)
    assert run.uniqueness_margin == 0.0
    assert not run.unique
    assert run.per_period[1:] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("beside", [1e-9, -1e-9, 0.1, -0.1])
def test_beside_that_load_the_body_climbs_or_slides_back(beside):
    run = simulate(loaded(-0.3 + beside), 3.0)
    assert run.uniqueness_margin == pytest.approx(abs(beside) / 1.4, rel=1e-5)
    assert run.unique
    assert np.sign(run.per_period[-1]) == np.sign(beside)


@pytest.mark.parametrize("load", [0.4, -1.0])
def test_a_body_about_to_run_away_is_critical(load):
    assert commanded_margin(loaded(load).body, loaded(load).drive) == 0.0


def test_the_interval_under_loads_holds_all_minimisers():
    """One bound is negative: contact 0 is pulled harder than its own friction and held by the others."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        velocity = rng.normal(size=4)
        plus, minus = rng.uniform(0.1, 1.0, (2, 4))
        load = np.array([-1.2, 0.1, 0.2, 0.1])
        if minus.sum() + load.sum() <= 0.01:
            continue
        least, most = translation_interval(velocity, plus - load, minus + load)
        c = np.linspace(-3.0, 3.0, 6001)
        v = velocity[:, None] + c
        cost = (plus @ np.maximum(v, 0.0)) + (minus @ np.maximum(-v, 0.0)) - load @ v
        best = c[cost <= cost.min() + 1e-12]
        assert least - 1e-3 <= best.min() <= best.max() <= most + 1e-3


def test_a_segment_on_a_slope_is_judged_by_its_bounds():
    def margin(load):
        friction = {"forward": 0.1, "backward": 0.3}
        trunk = {"name": "t", "from": 0.0, "to": 1.0, "stiffness": 1.0, "friction": friction, "elements": 8}
        document = {"name": "s", "body": {"segments": [trunk]}, "loads": load}
        loaded = Scene.model_validate(document)
        return commanded_margin(loaded.body, loaded.drive)

    assert margin(-0.1) == pytest.approx(0.2 / 0.4)
    assert margin(-0.3) == 0.0  # the whole segment slides backward for nothing
    assert margin(0.05) == pytest.approx(0.05 / 0.4)


@pytest.mark.parametrize(
    ("n", "forward", "backward", "margin"),
    [
        (2, 1.0, 1.0, 0.0),
        (3, 1.0, 1.0, 1 / 6),
        (4, 0.1, 0.3, 0.0),  # m mu_minus = (N - m) mu_plus for m = 1, although 3 * 0.1 != 0.3 in a computer
        (3, 0.1, 0.2, 0.0),
        (10, 0.1, 0.3, 1 / 20),
        (1_000_000, 1.0, 1.0, 0.0),
    ],
)
def test_equal_contacts(n, forward, backward, margin):
    assert uniqueness_margin(np.full(n, forward), np.full(n, backward)) == pytest.approx(margin, abs=1e-12)


def test_thirty_unequal_contacts_are_decided_and_more_are_not():
    rng = np.random.default_rng(0)
    plus, minus = rng.uniform(0, 1, (2, 30))
    assert uniqueness_margin(plus, minus) is not None
    assert uniqueness_margin(np.append(plus, 1), np.append(minus, 1)) is None


def test_no_friction_is_critical():
    assert uniqueness_margin([0, 0], [0, 0]) == 0.0


@given(st.integers(0, 2**32 - 1))
def test_the_interval_holds_all_minimisers(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 7))
    velocity = rng.normal(size=n)
    plus, minus = rng.integers(0, 4, (2, n)).astype(float)
    if not (plus.sum() and minus.sum()):
        return
    least, most = translation_interval(velocity, plus, minus)

    def dissipation(c):
        v = velocity + c
        return (plus * np.maximum(v, 0) - minus * np.minimum(v, 0)).sum()

    best = min(dissipation(-v) for v in velocity)
    assert dissipation(least) == pytest.approx(best)
    assert dissipation(most) == pytest.approx(best)
    assert dissipation(least - 1e-3) > best - 1e-12
    assert dissipation(most + 1e-3) > best - 1e-12
    if most == least:
        assert dissipation(least - 1e-3) > best
        assert dissipation(most + 1e-3) > best


@pytest.mark.parametrize("method", ["exact", "catch_up"])
@pytest.mark.parametrize("joined", [False, True], ids=["chain", "graph"])
@pytest.mark.parametrize("elements", [1, 4, 10, 100])
def test_the_net_translation_is_what_is_nearest_to_zero(elements, joined, method):
    """A trunk and a foot of equal friction breathe on the spot, however fine the trunk is cut."""
    trunk = {"name": "trunk", "from": 0, "to": 1, "stiffness": 10.0, "elements": elements}
    links = {"stiffness": [10.0, 1e-3][: 1 + joined], "between": [["trunk.to", 0], ["trunk.from", 0]][: 1 + joined]}
    crawler = Crawler(
        Scene.model_validate(
            {
                "name": "t",
                "body": {
                    "contacts": [2],
                    "segments": [trunk | {"friction": {"forward": 1, "backward": 1}}],
                    "links": links,
                },
                "friction": {"isotropic": 1.0},
            }
        ),
        method,
    )
    rest = [0.0] * joined
    crawler.advance([1.0, *rest, 0.0])
    start = crawler.net_translation
    for length in (0.0, 1.0, 0.0, 1.0):
        step = crawler.advance([length, *rest, 0.0])
        assert not step.unique
        low, high = step.translation_interval
        assert low < 0.0 < high
    assert crawler.net_translation == pytest.approx(start, abs=1e-14)


RING = {"stiffness": 1.0, "between": [[0, 1], [1, 2], [2, 3], [0, 3]]}


@pytest.mark.parametrize("method", ["exact", "catch_up"])
@pytest.mark.parametrize("exponent", range(1, 9))
def test_the_visited_margin_of_a_stiff_graph_is_that_of_its_friction(exponent, method):
    for mu, margin in (([1.0] * 4, 0.0), ([1.0, 1.0, 1.0, 1.0 + 1e-9], 1.25e-10)):
        body = {"contacts": [0, 1, 2, 3], "links": RING | {"stiffness": 10.0**exponent}}
        crawler = Crawler(Scene.model_validate({"name": "r", "body": body, "friction": {"isotropic": mu}}), method)
        crawler.advance([0.3, -0.2, 0.7, 0.1])
        step = crawler.advance([0.9, 0.4, -0.3, 0.2])
        assert step.unique == (margin > 0.0)
        assert step.visited_margin == pytest.approx(margin, rel=1e-5, abs=1e-15)


@pytest.mark.parametrize("method", ["exact", "catch_up"])
def test_the_visited_margin_at_rest_is_the_sum_of_the_distances_from_the_nearest_bounds(method):
    """A tension of 0.3 N leaves 0.5 - 0.3 N to the forward bound of one contact, 0.7 - 0.3 N to the backward one."""
    crawler = Crawler(scene(2, 1.0, 0.5, 0.7), method)
    step = crawler.advance([-0.3])
    assert crawler.tension == pytest.approx([0.3], abs=1e-15)
    assert step.visited_margin == pytest.approx((0.2 + 0.4) / 2.4, abs=1e-14)


@pytest.mark.parametrize("method", ["exact", "catch_up"])
def test_two_equal_isotropic_contacts_are_not_unique_and_stay_centred(method):
    crawler = Crawler(scene(2), method)
    step = crawler.advance([5.0])
    assert not step.unique
    assert crawler.net_translation == pytest.approx(0.0, abs=1e-15)
    assert crawler.shape == pytest.approx([4.0])
    # all of the 4 m of lengthening may go to one contact or the other
    assert step.translation_interval == pytest.approx((-2.0, 2.0))


def test_a_balance_that_holds_but_for_rounding_is_found():
    drive = {"times": [0, 0.5, 1], "period": 1, "actuation": [0, 3, 0]}
    run = simulate(scene(4, 1.0, 0.1, 0.3, drive))
    assert run.uniqueness_margin == 0.0
    assert not run.unique


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-9, 1e-11])
@pytest.mark.parametrize("sign", [-1, 1])
def test_beside_the_balance_the_answer_is_unique(distance, sign):
    mu = 1.0 + sign * distance
    run = simulate(scene(2, 1.0, [1.0, mu], [1.0, mu], {"times": [0, 0.5, 1], "period": 1, "actuation": [0, 4, 0]}))
    assert run.unique
    assert run.uniqueness_margin > 0
    # the lighter contact does all the sliding, so the body goes nowhere on average
    heavier = 1 if sign > 0 else 0
    assert run.displacement[:, heavier] == pytest.approx(0.0, abs=1e-15)


def test_an_isolated_instant_does_not_count():
    strategy = {"strategy": "A", "length": 4.0, "friction": 1.0}
    run = simulate(scene(2, drive=strategy, start=[0, 1]))
    assert run.visited_margin == 0.0
    assert run.unique


def test_nothing_resists_and_nothing_is_chosen_but_rest():
    crawler = Crawler(scene(3, 1.0, 0.0, 0.0))
    step = crawler.advance([1.0, -2.0])
    assert not step.unique
    assert step.translation_interval == (-np.inf, np.inf)
    assert crawler.net_translation == pytest.approx(0.0, abs=1e-15)
    assert crawler.tension == pytest.approx([0.0, 0.0], abs=0)


def test_too_many_different_frictions_are_not_decided():
    rows = np.linspace(1.0, 2.0, 65)[:, None] * np.linspace(1.0, 1.5, 17)
    drive = {"times": list(range(65)), "actuation": [[0] * 16] * 65, "friction": {"isotropic": rows.tolist()}}
    assert margin(scene(17, drive=drive)) is Undecided.MANY_COMMANDS
    few = {"times": [0, 1], "actuation": [[0] * 16] * 2, "friction": {"isotropic": rows[:2].tolist()}}
    assert margin(scene(17, drive=few)) == pytest.approx(uniqueness_margin(rows[0], rows[0]), abs=1e-12)


def test_what_leaves_a_margin_undecided_is_named():
    bare = {"name": "t", "from": 0.0, "to": 1.0, "stiffness": 1.0, "elements": 4}
    bare["friction"] = {"isotropic": {"at": [0.0, 0.5, 1.0], "value": [0.0, 0.0, 1.0]}}
    segment = Scene.model_validate({"name": "s", "body": {"segments": [bare]}})
    assert margin(segment) is Undecided.BARE_SEGMENT
    assert simulate(segment, duration=0.1).uniqueness_margin is None
    assert margin(scene(31, forward=np.linspace(1.0, 2.0, 31).tolist())) is Undecided.UNEQUAL_CONTACTS
    tendon = {"stiffness": 1.0, "tension": {"least": 0.0}}
    slack = {"name": "s", "body": {"contacts": [0.0, 1.0], "links": [tendon]}, "friction": {"isotropic": 1.0}}
    assert margin(Scene.model_validate(slack)) is Undecided.FLAT_SPRINGS
    assert margin(load_scene("planar_three_points")) is Undecided.PLANE


def test_the_interval_wants_one_number_for_each_contact():
    with pytest.raises(ValueError, match=r"shapes \(2,\), \(3,\), \(2,\); one per contact"):
        translation_interval([0, 1], [1, 1, 1], [1, 1])


def margin(scene):
    return commanded_margin(scene.body, scene.drive)


@pytest.mark.parametrize("joined", [True, False])
def test_an_element_that_slides_both_ways_has_a_point_at_rest_in_its_middle(joined):
    """Bounds of 1 N balance for every translation from -3 to -1; two contacts by themselves take the one nearest to
    0."""
    velocity, bound = np.array([1.0, 3.0]), np.ones(2)
    elements = np.array([[0, 1]]) if joined else np.empty((0, 2), int)
    share = np.array([0.9, 0.1])
    below, above = choose_translation(velocity, bound, bound, elements, share)
    assert velocity.tolist() == pytest.approx([-1.0, 1.0] if joined else [-0.2, 1.8])
    assert (below, above) == pytest.approx((0.0, 0.0) if joined else (-1.8, 0.2))
