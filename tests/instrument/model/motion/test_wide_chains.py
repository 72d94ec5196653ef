"""Chains whose stiffness spans up to 12 decades, against rational arithmetic: right, or the certificate shows it."""

from __future__ import annotations

from fractions import Fraction as F

import numpy as np
import pytest

from crawler_model import Crawler, Scene, SceneError

from ..chains import from_rows
from ..hard_cases import WIDE_CHAINS, follow_wide
from ..rational_bends import NotUniqueError, RationalBentBody, RationalCurve, RationalLink
from .test_projection import exact_projection, random_problem


@pytest.mark.parametrize("case", range(len(WIDE_CHAINS)))
def test_every_displacement_is_right_or_flagged(case):
    error, rounding = follow_wide(WIDE_CHAINS[case])
    assert error <= max(1e-11, 30.0 * rounding)


def test_up_to_eight_decades_every_displacement_is_right():
    narrow = [case for case in WIDE_CHAINS if case["decades"] <= 8]
    assert len(narrow) >= 40
    assert max(follow_wide(case)[0] for case in narrow) < 1e-9


@pytest.mark.parametrize(("decades", "near"), [(0, 1e-14), (4, 1e-13), (8, 1e-13), (12, 1e-11)])
def test_elongations_keep_their_digits_in_one_step(decades, near):
    for seed in range(40):
        target, _, lower, upper = random_problem(seed, most=9, infinite=False)
        rng = np.random.default_rng(seed)
        stiffness = 2.0 ** np.round(rng.uniform(-0.5, 0.5, target.size) * decades * np.log2(10.0))
        body = {"contacts": list(range(target.size + 1)), "links": {"stiffness": stiffness.tolist()}}
        friction = {"forward": upper.tolist(), "backward": (-lower).tolist()}
        crawler = Crawler(Scene.model_validate({"name": "w", "body": body, "friction": friction}), "catch_up")
        crawler.advance(-target)  # trial tensions are k dL
        true = np.array(exact_projection(target * stiffness, stiffness, lower, upper))
        scale = np.abs(target) + np.abs(true / stiffness)
        assert (np.abs(crawler.tension - true) / stiffness).max() < near * scale.max()


def straight(stiffness: F) -> RationalCurve:
    """A linear spring, whose only knot is far away."""
    return RationalCurve([F(10**9)], [stiffness * 10**9], stiffness, stiffness)


@pytest.mark.parametrize("first", range(0, 60, 20))
def test_a_soft_spring_between_stiff_ones_adds_no_rounding_to_theirs(first):
    """Friction is commanded: a contact behind the soft spring stops, and a stiff spring keeps what it has by then."""
    compared = 0
    for seed in range(first, first + 20):
        rng = np.random.default_rng([seed, 63])
        stiffness = 10.0 ** np.array([rng.uniform(1, 4), rng.uniform(-6, -3), rng.uniform(4, 6)])
        forward, backward = np.exp(rng.uniform(-1.5, 0.5, (2, 9, 4)))
        lengths = np.vstack((np.zeros(3), rng.uniform(-2, 2, (8, 3))))
        crawler = Crawler(from_rows(stiffness, lengths, forward, backward))
        rational = [[[F(value) for value in row] for row in rows] for rows in (lengths, forward, backward)]
        links = [RationalLink(i, i + 1, straight(F(k)), straight(F(0))) for i, k in enumerate(stiffness)]
        body = RationalBentBody(4, links, rational[1][0], rational[2][0])
        for target, *row in zip(crawler.scene.drive.targets[1:], *(rows[1:] for rows in rational), strict=True):
            step = crawler.follow(target[None].copy())
            try:
                body.follow(*row)
            except NotUniqueError:
                break
            error = np.abs(crawler.displacement - [float(x) for x in body.x]).max()
            assert error <= max(1e-12, 30.0 * step.certificate.rounding)
            assert step.certificate.rounding < 1e-8
            compared += 1
    assert compared > 80


def test_stiffness_beyond_what_numbers_hold_is_refused():
    body = {"contacts": [0, 1, 2], "links": {"stiffness": [1e-7, 1e7]}}
    with pytest.raises(
        SceneError, match=r"body.links.stiffness: 1e-07 to 1e\+07 N/m; the largest may be at most 1e\+13"
    ):
        Scene.model_validate({"name": "w", "body": body, "friction": {"isotropic": 1.0}})
