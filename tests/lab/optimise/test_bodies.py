"""Gaits over bodies drawn from a posterior: objective, derivatives, and the gait that results."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from crawler_lab import Posterior, optimise
from crawler_lab.optimise.bodies import _SEED, spread_over
from crawler_lab.optimise.optimise import build_space
from crawler_lab.optimise.request import Request
from crawler_model import CrawlerError, Scene, limit_cycle

from ..identify.posteriors import NAMES, posterior, robot

LEFT = "friction.backward[0]"


def spread(over, known: Posterior):
    unknowns, space = build_space(robot(None), Request("translation", waypoints=4, stroke=(0.0, 0.1)))
    return unknowns, spread_over(space, unknowns, known, over)


def test_the_expected_gain_is_the_mean_and_the_worst_the_least_of_the_bodies():
    point = np.random.default_rng(0).random(8)
    _, expected = spread("expected", posterior(0.1))
    worst = dataclasses.replace(expected, mean=False)
    values = expected.values(point)
    gains = [limit_cycle(Scene.model_validate(one.document(values))).gain for one in expected.scenes]
    assert len(gains) == 8
    assert np.ptp(gains) > 1e-3
    assert expected.scores([point])[0] == pytest.approx(np.mean(gains), abs=1e-9)
    assert worst.scores([point])[0] == pytest.approx(np.min(gains), abs=1e-9)
    regimes = expected.regimes(point[None])[0]
    assert expected.value(regimes) == pytest.approx(np.mean(gains), abs=1e-9)
    assert worst.value(regimes) == pytest.approx(np.min(gains), abs=1e-9)


def test_the_derivatives_of_the_expected_gain_are_those_of_its_differences():
    _, space = spread("expected", posterior(0.05))
    point = np.random.default_rng(5).random(8)
    ((value, slope),) = space.slopes(point)
    assert value == pytest.approx(space.scores([point])[0], abs=1e-12)
    step = 1e-6
    moved = np.repeat(point[None], 16, axis=0)
    moved[np.arange(8), np.arange(8)] += step
    moved[8 + np.arange(8), np.arange(8)] -= step
    scores = np.array(space.scores(list(moved)))
    np.testing.assert_allclose(slope, (scores[:8] - scores[8:]) / (2.0 * step), atol=1e-7)


def test_the_same_bodies_are_drawn_each_time():
    one, other = (spread("worst", posterior(0.05))[1] for _ in range(2))
    for a, b in zip(one.scenes, other.scenes, strict=True):
        assert a.base == b.base


def test_a_bounded_friction_is_drawn_beyond_its_bound():
    known = posterior(without=(LEFT,), bounds={LEFT: (0.5, None)})
    _, space = spread("worst", known)
    drawn = [one.base.drive.backward[0, 0] for one in space.scenes]
    assert min(drawn) >= 0.5
    assert max(drawn) > 1.0


@pytest.fixture
def two() -> Scene:
    body = {"contacts": [0.0, 0.1], "links": {"stiffness": 10.0}}
    friction = {"forward": [0.2, 0.2], "backward": [0.6, 0.6]}
    return Scene.model_validate({"name": "two", "body": body, "friction": friction})


def test_the_expected_gain_of_two_contacts_is_the_mean_of_its_closed_form(two):
    """Two contacts that both slide only forward gain D - (mu_0 + mu_1) / k."""
    pytest.importorskip("cma")
    known = Posterior(NAMES[:2], np.array([0.2, 0.2]), np.diag([4e-4, 4e-4]))
    found = optimise(two, waypoints=2, stroke=(0.0, 0.1), robust_to=known, seconds=2)
    assert found.robustness is not None
    assert found.robustness.best_fit == pytest.approx(0.06, abs=1e-9)
    drawn = known.draw_bodies(np.random.default_rng(_SEED), 8)
    gains = 0.1 - sum(drawn.values()) / 10.0
    assert found.value == pytest.approx(gains.mean(), abs=1e-9)
    assert found.robustness.worst < found.robustness.mean


def test_a_number_that_was_not_excited_is_named_where_the_gain_depends_on_it(two):
    pytest.importorskip("cma")
    stiffness = "body.links.stiffness"
    known = Posterior(NAMES[:2], np.array([0.2, 0.2]), np.diag([1e-6, 1e-6]), unknown=(stiffness,))
    found = optimise(two, waypoints=2, stroke=(0.0, 0.1), robust_to=known, robust_of="worst", seconds=1)
    assert found.robustness is not None
    assert found.robustness.unknown == (stiffness,)
    assert found.summary()["robust_to"]["unknown"] == [stiffness]


def test_a_posterior_of_another_scene_is_refused(two):
    known = Posterior(("friction.sideways",), np.array([1.0]), np.array([[1.0]]))
    with pytest.raises(CrawlerError, match=r"friction\.sideways: two has no such number"):
        optimise(two, waypoints=2, stroke=(0.0, 0.1), robust_to=known)
