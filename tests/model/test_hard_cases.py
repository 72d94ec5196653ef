"""Where others break down: each case must give the exact answer, or say what is the matter."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Crawler, simulate
from crawler_model.stasis import stasis_margins

from .chains import scene

TRIANGLE = {"times": [0, 0.5, 1], "period": 1}


def relative_violation(crawler: Crawler) -> float:
    margins = stasis_margins(crawler.tension, crawler.forward, crawler.backward)
    return -margins.min() / (np.abs(crawler.tension).max() + 1e-300)


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
    crawler = Crawler(scene(50, 1.0, 0.1, 0.3), budget=5)
    step = crawler.advance(np.sin(np.arange(49.0)))
    assert step.overspent == 1
    assert crawler.actuation == pytest.approx(np.sin(np.arange(49.0)))
    assert step.certificate.violation < 1e-13


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
