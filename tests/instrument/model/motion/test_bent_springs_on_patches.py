"""Bent springs on patches of ground: rational numbers, and slides that end at knots or borders."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

from crawler_model import Crawler, simulate
from crawler_model.errors import CommandError
from crawler_model.scene.file import parse_scene

from ..bent_bodies import draw_body
from ..bodies import Drawn
from ..rational_bends import NotUniqueError, RationalBentBody

COUNT = 60 * max(settings.default.max_examples // 100, 1)


def follow_both(document: dict[str, Any], body: RationalBentBody, rows: list[Any]) -> bool:
    """Follow a drive in both ways; returns whether its end was reached, with a motion that is unique."""
    scene, links = parse_scene(json.dumps(document)), len(body.links)
    crawler = Crawler(scene)
    for row, target in zip(rows[1:], scene.drive.targets[1:], strict=True):
        try:
            step = crawler.follow(target[None].copy())
        except CommandError:  # nothing holds the body there
            return False
        assert step.unsolved == step.overspent == 0
        assert abs(step.certificate.energy_residual) < 1e-12
        assert step.certificate.violation < 1e-12
        jumps = body.jumps
        try:
            body.follow(row[:links], row[links : links + body.n], row[links + body.n :])
        except NotUniqueError:
            return False
        assert step.unique
        assert len(step.jumps) == body.jumps - jumps
        np.testing.assert_allclose(crawler.displacement, [float(x) for x in body.x], rtol=0, atol=1e-11)
        np.testing.assert_allclose(crawler.tension, [float(t) for t in body.tensions()], rtol=0, atol=1e-11)
    return True


@pytest.mark.parametrize(("extra", "dyadic"), [(0, True), (0, False), (1, True), (2, False)])
def test_agrees_with_rational_numbers(extra, dyadic):
    """Chains and graphs of 2 to 4 contacts on slopes and on patches, with ties where all numbers are dyadic."""
    right = jumps = slides = 0
    for seed in range(COUNT):
        rng = np.random.default_rng([seed, extra, dyadic])
        document, body, rows = draw_body(rng, int(rng.integers(2, 5)), extra, patches=True, dyadic=dyadic)
        right += follow_both(document, body, rows)
        jumps, slides = jumps + body.jumps, slides + body.slides
    assert right > 0.6 * COUNT
    assert jumps > 0.2 * COUNT
    assert slides > 0 or extra


def weak_motor(patch: dict[str, float]) -> Crawler:
    """A motor that stalls at 1 N pulls contact 0 over a patch, towards contact 1, which is held."""
    document = {
        "name": "weak",
        "body": {"contacts": [0.0, 1.0], "links": [{"stiffness": 4.0, "tension": {"most": 1.0}}]},
        "friction": {"forward": 2.0, "backward": 100.0},
        "ground": {"patches": [patch]},
    }
    crawler = Crawler(parse_scene(json.dumps(document)))
    crawler.advance([-1.0])
    assert not crawler.displacement.any()
    return crawler


def test_friction_that_falls_to_a_stall_lets_the_motor_slide_to_a_border():
    """There, the ground holds twice as much, and 1 N at last."""
    crawler = weak_motor({"from": 0.5, "to": 0.75, "friction": 2.0})
    step = crawler.advance([-1.0], [0.6, 2.0], [100.0, 100.0])
    assert crawler.displacement.tolist() == [0.5, 0.0]
    assert step.unsolved == 0
    assert abs(step.certificate.energy_residual) < 1e-14


def test_a_slide_goes_on_over_softer_ground_to_the_knot_and_beyond():
    crawler = weak_motor({"from": 0.5, "to": 2.0, "friction": 0.5})
    step = crawler.advance([-1.0], [0.6, 2.0], [100.0, 100.0])
    assert crawler.displacement == pytest.approx([1.0 - 0.3 / 4.0, 0.0])
    assert [(jump.contact, jump.border) for jump in step.jumps] == [(0, 0.5)]
    assert abs(step.certificate.energy_residual) < 1e-14


def test_the_work_of_a_stalled_motor_counts_where_a_jump_ends_beside_it():
    """Contact 1 falls through a soft patch, and stops at its end, while the neighbouring motor shortens on."""
    document = {
        "name": "beside",
        "body": {
            "contacts": [0.0, 1.0, 2.0],
            "links": [{"stiffness": 1.0}, {"stiffness": 4.0, "tension": {"least": -0.25, "most": 0.25}}],
        },
        "friction": {"forward": [100.0, 0.5, 100.0], "backward": [100.0, 0.5, 100.0]},
        "ground": {"patches": [{"from": 1.25, "to": 1.375, "friction": 0.25}, {"from": 1.375, "to": 3.0, "friction": 2.0}]},
    }  # fmt: skip
    crawler = Crawler(parse_scene(json.dumps(document)))
    step = crawler.advance([1.0, -2.0])
    assert crawler.displacement.tolist() == [0.0, 0.375, 0.0]
    assert len(step.jumps) == 1
    assert abs(step.certificate.energy_residual) < 1e-14


def test_a_part_without_friction_between_flat_springs_stays_where_numbers_are():
    """Its translation is free; rounding of what the springs pull once made it infinite."""
    run = simulate(Drawn("bent hybrid on patches", 1, ties=True, bare=True).driven().scene, rate=1.0)
    assert np.isfinite(run.displacement).all()
