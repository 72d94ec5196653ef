"""What the paper's examples come to, theory and gallery alike."""

from __future__ import annotations

import math
from fractions import Fraction as F

import numpy as np
import pytest

from crawler_model import Crawler, Scene, load_scene, simulate

from .bent_bodies import line
from .chains import scene
from .rational_bends import RationalBentBody, RationalCurve, RationalLink

REACH = (0.5, 1.5, 2.5, 4.0, 6.0)
STRATEGIES = {"A": (0, 0, 0.5, 2, 4), "B": (0, 0.5, 1.5, 2, 2), "C": (0, 0, 0.5, 2, 4)}
START = {"A": 1.0, "B": 0.5, "C": 0.5}


def strategy(name, length, friction=1.0, stiffness=1.0, **more):
    drive = {"strategy": name, "length": length, "friction": friction, **more}
    start = [0, START[name] * friction / stiffness]
    return scene(2, stiffness, friction, friction, drive, start)


@pytest.mark.parametrize("rate", [100.0, 4.0, 1.0, 37.0])
@pytest.mark.parametrize(
    ("name", "reach", "gain"), [(s, r, g) for s in STRATEGIES for r, g in zip(REACH, STRATEGIES[s], strict=True)]
)
def test_strategies(name, reach, gain, rate):
    run = simulate(strategy(name, reach), rate=rate)
    assert run.per_period.size == 10
    assert run.per_period[1:] == pytest.approx(gain, abs=1e-12)
    assert run.unique


@pytest.mark.parametrize("name", STRATEGIES)
def test_strategies_in_other_units(name):
    k, mu = 250.0, 0.04
    run = simulate(strategy(name, 4.0 * mu / k, mu, k, period=3.0))
    assert run.per_period[1:] == pytest.approx(2.0 * mu / k, rel=1e-12)
    assert run.waypoint_time[-1] == 30.0


def test_strategy_a_below_threshold_steps_back_once_and_rests_for_ever():
    run = simulate(strategy("A", 0.5), duration=50.0)
    assert run.per_period[0] == pytest.approx(-1 / 8, abs=1e-15)
    assert run.per_period[1:] == pytest.approx(0.0, abs=1e-15)
    assert not run.contact_state[200:].any()


def rates(crawler, targets):
    """Shape rate per unit of time between successive times of a strategy, from states at the times given."""
    shapes = []
    for target in targets:
        crawler.follow(target[None])
        shapes.append(float(crawler.shape[0]))
    return np.diff(shapes)


def test_strategy_a_moves_from_t1_at_two_speeds():
    case = strategy("A", 4.0)
    times = np.array([0, 0.1, 0.2, 0.225, 0.25, 0.4, 0.5])
    crawler = Crawler(case)
    speed = rates(crawler, case.drive.sample(np.rint(times * 1e9).astype(np.int64))) / np.diff(times)
    assert speed == pytest.approx([0, 0, 10, 10, 6, 6], abs=1e-11)


def test_strategy_c_moves_back_from_t7():
    length = 6.0
    t7 = 0.5 + 3 / (2 * length + 4)
    case = strategy("C", length)
    times = np.array([0.0, 0.25, 0.5, t7, 0.75, 1.0])
    run = Crawler(case)
    rows = case.drive.targets
    middle = rows[2] + (t7 - 0.5) / 0.25 * (rows[3] - rows[2])
    targets = [rows[0], rows[1], rows[2], middle, rows[3], rows[4]]
    speed = rates(run, targets) / np.diff(times)
    assert speed[2:] == pytest.approx([0, -2 * (length + 2), -2 * length], abs=1e-11)


@pytest.mark.parametrize("stroke", [0.1, 0.35, 0.4, 0.5, 2.0, 100.0])
@pytest.mark.parametrize(("forward", "backward"), [(0.2, 0.5), (0.5, 0.2)])
def test_two_contacts_with_constant_anisotropic_friction(stroke, forward, backward):
    drive = {"times": [0, 0.5, 1], "period": 1, "actuation": [0, stroke, 0]}
    run = simulate(scene(2, 1.0, forward, backward, drive))
    gain = max(0.0, stroke - 2 * min(forward, backward)) * (1 if forward < backward else -1)
    assert run.per_period[1:] == pytest.approx(gain, abs=1e-12)


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_one_way_chains_lengthening_together(n):
    """With mu_minus > (N - 1) mu_plus no contact ever goes back: (N - 1) (D - N mu_plus / k) a period."""
    stroke, mu, k = 3.0, 0.1, 2.0
    drive = {"times": [0, 0.5, 1], "period": 1, "actuation": [0, stroke, 0]}
    run = simulate(scene(n, k, mu, 1.01 * n * mu, drive))
    assert run.per_period[1:] == pytest.approx((n - 1) * (stroke - n * mu / k), abs=1e-12)


GALLERY = {
    "two_contacts_anisotropic": 0.08,
    "three_contacts_one_way": 0.14,
    "three_contacts_two_ways": 0.07,
    "two_anchor_a": 2.0,
    "two_anchor_b": 2.0,
    "two_anchor_c": 2.0,
    "slope_climber": 0.1 - 2.0 * (0.2 * math.cos(math.radians(10.0)) + math.sin(math.radians(10.0))) / 20.0,
    "payload_climber": 0.1 - 3.0 * (0.2 * math.cos(math.radians(5.0)) + math.sin(math.radians(5.0))) / 20.0,
    "tow_puller": 0.075,
    "tendon_worm": 0.5,
    "stalling_inchworm": 0.5 - 1.0 / 9.0,
}


@pytest.mark.parametrize("name", GALLERY)
def test_the_gallery_moves_as_its_comments_say(name):
    run = simulate(load_scene(name))
    assert run.per_period[1:] == pytest.approx(GALLERY[name], abs=1e-12)


SILICONE = RationalCurve(
    [F(v, 1000) for v in (-20, -10, -5, 0, 10, 20, 30)],
    [F(v, 10) for v in (-11, -3, -1, 0, 2, 6, 14)],
    F(80),
    F(80),
)


def elongation(curve: RationalCurve, tension: F) -> F:
    """The elongation at which a rising curve has a tension that it has between two of its knots."""
    k = next(k for k, value in enumerate(curve.value) if value >= tension)
    return curve.at[k] - (curve.value[k] - tension) / curve.slope(curve.at[k], -1)


def test_a_silicone_chain_loses_the_width_of_its_curve():
    """As it lengthens, link j holds -j mu against the contacts ahead of it, as it shortens (N - j) mu against those behind.

    The elongation of each link beyond its rest length swings between two values, one for each tension, which the stroke
    lacks.
    """
    mu, stroke = F(3, 10), F(5, 100)
    gain = sum(stroke - elongation(SILICONE, j * mu) + elongation(SILICONE, -j * mu) for j in (1, 2, 3))
    assert gain == F(525, 10_000)
    links = [RationalLink(j, j + 1, SILICONE, line(F(0))) for j in range(3)]
    body = RationalBentBody(4, links, [mu] * 4, [F(3, 2)] * 4)
    ends = []
    for length in (stroke, F(0), stroke, F(0), stroke, F(0)):
        body.follow([length] * 3, [mu] * 4, [F(3, 2)] * 4)
        ends.append(sum(body.x) / 4)
    assert ends[3] - ends[1] == ends[5] - ends[3] == gain
    assert body.jumps == 0
    run = simulate(load_scene("silicone_chain"))
    assert run.per_period[1:] == pytest.approx(float(gain), abs=1e-15)
    assert run.unique


def test_a_wave_that_reaches_the_stops_of_all_links():
    """Contact i slides until T_i - T_(i - 1) = mu, with T = k (z - L) + K (z -+ p) beyond the stops +-p, at L = +-e.

    So a link that is long is longer by B = (2 k e + 2 K p - mu)/(k + K) than the link ahead of it, which is short again; a
    link shortens by the gain G. From front to rear (N - 1) (B - G) = mu/(k + K).
    """
    k, stop, p, e, mu, n = F(100), F(900), F(1, 100), F(3, 100), F(1, 5), 5
    longer = (2 * k * e + 2 * stop * p - mu) / (k + stop)
    gain = longer - mu / ((n - 1) * (k + stop))
    assert gain == F(2375, 100_000)
    stops = RationalCurve([-p, p], [F(0), F(0)], stop, stop)
    forward, backward = [mu] * n, [F(2)] * n
    body = RationalBentBody(n, [RationalLink(j, j + 1, line(k), stops) for j in range(n - 1)], forward, backward)
    short = (mu - k * e - stop * p) / (k + stop)  # of the last link, at a tension of mu
    for j in range(n - 1):
        body.x[j + 1] = body.x[j] + short - j * (longer - gain)
    body.length = [-e] * (n - 1)
    before = list(body.x)
    for long in (3, 2, 1, 0, None):
        body.follow([e if j == long else -e for j in range(n - 1)], forward, backward)
    assert [after - x for after, x in zip(body.x, before, strict=True)] == [gain] * n
    run = simulate(load_scene("peristaltic_stops"), duration=500.0)
    assert run.per_period[-1] == pytest.approx(float(gain), abs=1e-15)
    assert run.unique


UP, DOWN = (0.1 - (0.2 * math.cos(t) + math.sin(t)) / 10.0 for t in (math.radians(10.0), math.radians(-10.0)))
ON_PATCHES = {
    "ice": ({0.08, 0.0}, 0.0, 1),
    "friction_step": ({0.08, 0.09}, 0.09, 2),
    "hill_top": ({UP, DOWN, 0.08}, 0.08, 2),
}
"""Gains per period while both contacts are on the same ground, the last gain, and the number of jumps."""


@pytest.mark.parametrize("name", ON_PATCHES)
def test_the_gallery_crosses_patches_as_its_comments_say(name):
    gains, last, jumps = ON_PATCHES[name]
    run = simulate(load_scene(name), 16.0)
    assert all(np.abs(run.per_period - gain).min() < 1e-12 for gain in gains)
    assert run.per_period[-1] == pytest.approx(last, abs=1e-12)
    assert len(run.jumps) == jumps
    assert run.unique
    assert run.energy.relative_residual < 1e-13


@pytest.mark.parametrize(("degrees", "accuracy"), [(0.0, 4e-3), (6.0, 4e-3), (6.0, 4e-4), (10.0, 4e-3)])
def test_a_segment_climbs_by_the_bounds_of_its_friction(degrees, accuracy):
    """l (Deps - a l/k) (b - a)/(b + a), accurate relative to the stroke of 0.4 m."""
    document = load_scene("segment_climber").document()
    trunk = document["body"]["segments"][0]
    del trunk["elements"]
    trunk["accuracy"] = accuracy / 0.4
    run = simulate(Scene.model_validate(document | {"ground": {"slope": degrees}}), 4.0)
    theta = math.radians(degrees)
    a, b = 0.5 * (0.2 * math.cos(theta) + math.sin(theta)), 0.5 * (0.6 * math.cos(theta) - math.sin(theta))
    assert run.per_period[1:] == pytest.approx((0.4 - a) * (b - a) / (b + a), abs=accuracy)
    assert run.per_period[-1] > 0.0


def test_two_ways_played_backwards_walks_back():
    there = load_scene("three_contacts_two_ways")
    data = there.document()
    data["drive"]["actuation"] = data["drive"]["actuation"][::-1]
    data["drive"]["times"] = [0.0, 0.25, 0.75, 1.0]
    back = simulate(type(there).model_validate(data))
    assert back.per_period[1:] == pytest.approx(-0.07, abs=1e-12)


def test_the_ten_contact_wave_carries_the_body_forwards():
    run = simulate(load_scene("ten_contact_wave"))
    assert run.per_period.min() > 0.03
    assert run.unique
    assert {-1, 0, 1} == set(run.contact_state.ravel().tolist())


def test_many_periods_do_not_drift():
    run = simulate(strategy("A", 4.0), duration=100_000.0, rate=1.0)
    assert run.per_period.size == 100_000
    assert np.abs(run.per_period - 2.0).max() < 1e-12
    assert run.waypoint_net_translation[-1] == pytest.approx(200_000.5, rel=1e-13)
