"""Long bodies in the plane: contacts at rest are left alone until a neighbour moves, and starts take few substeps."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Crawler, Scene

from ..planar_stage import CROSS, DISC, Step


@pytest.mark.parametrize("directions", [DISC, CROSS], ids=["discs", "polygons"])
@pytest.mark.parametrize("from_end", [False, True])
@pytest.mark.parametrize("guess", [0.0, 3.0])
def test_a_pull_at_one_end_wakes_as_many_contacts_as_it_moves(directions, from_end, guess):
    """A chain with k = 1 and mu = 1: a pull of 10.5 at its end moves ten contacts, by the sums of the tensions."""
    n, moving = 40, 10
    ends = np.array([(i, i + 1) for i in range(n - 1)])
    force = np.zeros((n, 2))
    force[0, 0] = moving + 0.5
    tension = force[0, 0] - np.arange(1, moving + 1)
    expected = np.zeros((n, 2))
    expected[:moving, 0] = np.cumsum(tension[::-1])[::-1]
    if from_end:
        force, expected = np.ascontiguousarray(force[::-1]), expected[::-1]
    friction = np.ones((n, max(len(directions), 1)))
    velocity, unique = Step(ends, np.ones(n - 1), force, friction, directions).solve(guess)
    assert unique
    np.testing.assert_allclose(velocity, expected, atol=1e-12)
    assert not velocity[expected[:, 0] == 0.0].any()  # exactly


def long_waves(n, tolerance):
    """Five waves along a body that start at once from rest."""
    times = np.arange(65) / 64
    turned = 2.0 * np.pi * (times[:, None] - 5.0 * (np.arange(n - 1) + 0.5) / (n - 1))
    lengths = np.stack((np.sin(turned), 0.5 * np.cos(turned)), axis=2)
    scene = {
        "name": "waves",
        "dimension": 2,
        "start": "relaxed",
        "body": {"contacts": [[i, 0] for i in range(n)], "links": {"stiffness": 1.0}},
        "friction": {"isotropic": 20.0 / n},
        "drive": {"times": times.tolist(), "actuation": lengths.tolist()},
        "tolerance": tolerance,
    }
    return Crawler(Scene.model_validate(scene)), lengths


def test_a_start_takes_few_substeps():
    """Almost all contacts start within a few ramps; a start ends a substep, and is seldom missed by the one before."""
    crawler, lengths = long_waves(60, 1e-4)
    moved = np.zeros(60, bool)
    starts, substeps = 0, 0
    for target in lengths[1:11]:
        step = crawler.advance(target)
        moves = crawler.contact_state != 0
        starts += int((moves & ~moved).sum())
        moved = moves
        substeps += step.events
        assert not step.overspent
    assert starts > 50
    assert substeps <= 2.5 * starts


@pytest.mark.parametrize("n", [60, 200])  # as a whole, and in parts
def test_starts_along_a_long_body_keep_the_tolerance(n):
    tolerance, ramps = 1e-4, 12
    (crawler, lengths), (fine, _) = long_waves(n, tolerance), long_waves(n, 1e-7)
    for count, target in enumerate(lengths[1 : ramps + 1], 1):
        step = crawler.advance(target)
        fine.advance(target)
        size = np.ptp(lengths, axis=0).max()
        assert np.abs(crawler.displacement - fine.displacement).max() <= count * tolerance * size
        assert abs(step.certificate.energy_residual) <= tolerance * size * 20.0


def test_ramps_followed_together_end_where_they_end_one_by_one():
    (together, lengths), (alone, _) = long_waves(20, 1e-4), long_waves(20, 1e-4)
    friction = np.full(20, 1.0)
    targets = np.array([np.concatenate((target.ravel(), friction)) for target in lengths[1:11]])
    together.follow(targets)
    for target in targets:
        alone.follow(target[None])
    assert together.displacement.any()
    np.testing.assert_array_equal(together.displacement, alone.displacement)
    np.testing.assert_array_equal(together.tension, alone.tension)
