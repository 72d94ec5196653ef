"""Ramps in the plane end within the tolerance of where they lead, whatever starts, stops or turns on the way."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.optimize import nnls

from crawler_model.motion.plane.friction import corners_of
from crawler_model.motion.plane.implicit_step import MOST_SWEEPS, project_planar
from crawler_model.motion.plane.rates import find_rates, missed
from crawler_model.motion.plane.springs import build_springs, laplacian_of

from ..planar_ramps import Planar, on_a_line, polygon, random_line

DISC = np.zeros((0, 2))
CROSS = polygon(0.0, 4)
PAIR = build_springs(np.array([[0, 1]]), np.ones(1), 2)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-7])
@pytest.mark.parametrize("angle", [0.0, 2.3])
@pytest.mark.parametrize("corners", [0, 4, 6])
def test_contacts_that_exchange_roles_inside_a_ramp(tolerance, angle, corners):
    assert on_a_line([2], [1, 2], [([4], [1, 0.5])], tolerance, angle, corners) <= 1.0
    constant = [1, 0.75, 1.5]
    assert on_a_line([0.5, 2], constant, [([-3, -1.75], constant)], tolerance, angle, corners) <= 1.0


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-7])
@pytest.mark.parametrize("corners", [0, 6])
def test_random_ramps_of_a_line_in_the_plane(tolerance, corners):
    for seed in range(60):
        assert random_line(seed, tolerance, corners) <= 1.0, seed


@functools.cache
def planar(directional):
    return [Planar(seed, directional) for seed in (range(8) if not directional else range(25))]


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-7])
@pytest.mark.parametrize("directional", [False, True])
def test_random_ramps_in_two_dimensions(tolerance, directional):
    for number, ramps in enumerate(planar(directional)):
        assert ramps.error(tolerance) <= 1.0, number


def test_rates_are_those_of_least_squares():
    for seed in range(40):
        rng = np.random.default_rng(seed)
        n = 100 if seed % 10 == 9 else int(rng.integers(2, 7))  # one at a time, or many at once
        ends = np.array([(i, i + 1) for i in range(n - 1)])
        root = np.sqrt(np.exp(rng.uniform(-1, 1, n - 1)))
        incidence = np.zeros((n - 1, n))
        incidence[range(n - 1), ends[:, 0]], incidence[range(n - 1), ends[:, 1]] = -1.0, 1.0
        friction = np.exp(rng.uniform(-1, 1, (n, 1)))
        spring = rng.normal(size=(n, 2))
        spring *= friction / np.hypot(*spring.T)[:, None]
        spring[0] *= 0.5  # one holds
        longer = rng.normal(size=(n - 1, 2))
        push = incidence.T @ (root[:, None] ** 2 * longer)
        normals = (spring / friction)[1:]
        pull = (root[:, None, None] * incidence[:, 1:, None] * normals).transpose(0, 2, 1).reshape(-1, n - 1)
        speed = nnls(pull, (root[:, None] * longer).ravel())[0]
        band = np.full(n, 1e-11)
        for velocity in (np.zeros((n, 2)), rng.normal(size=(n, 2))):  # wherever the search starts
            find_rates(build_springs(ends, root**2, n), spring, push, friction, np.zeros((n, 1)), DISC, band, velocity)
            np.testing.assert_allclose(velocity[1:], speed[:, None] * normals, atol=1e-9)
            assert not velocity[0].any()


def rates(spring, push, friction, growth=None, directions=DISC):
    friction = np.array(friction, float)
    growth = np.zeros_like(friction) if growth is None else np.array(growth, float)
    velocity = np.zeros((2, 2))
    arrays = np.array(spring, float), np.array(push, float), friction, growth
    event = find_rates(PAIR, *arrays, directions, np.full(2, 1e-11), velocity)
    return event, velocity.tolist()


REST = [[0.0, 0.0], [0.0, 0.0]]


def test_the_next_event_is_foreseen():
    """Two contacts, k = 1; the spring pushes both, and what is foreseen is a part of the ramp."""
    apart = [[-1.0, 0.0], [1.0, 0.0]]
    assert rates(REST, apart, [[0.5], [2.0]]) == (0.5, REST)
    assert rates(REST, apart, [[0.5], [2.0]], [[0.5], [0.0]]) == (1.0, REST)
    assert rates(REST, apart, [[0.5], [2.0]], [[2.0], [2.0]]) == (np.inf, REST)  # bounds that grow are never reached
    assert rates(REST, REST, [[0.5], [2.0]], [[-1.0], [0.0]]) == (0.5, REST)
    assert rates(REST, apart, [[0.5] * 4, [2.0] * 4], directions=CROSS) == (0.5, REST)


def test_who_slides_at_once():
    apart, pulled = [[-1.0, 0.0], [1.0, 0.0]], [[-0.5, 0.0], [0.5, 0.0]]
    event, velocity = rates(pulled, apart, [[0.5], [2.0]])
    assert event > 1e9  # a rate of rounding
    np.testing.assert_allclose(velocity, [[-1.0, 0.0], [0.0, 0.0]], atol=1e-11)
    event, velocity = rates(pulled, apart, [[0.5] * 4, [2.0] * 4], directions=CROSS)
    np.testing.assert_allclose(velocity, [[-1.0, 0.0], [0.0, 0.0]], atol=1e-11)
    _, velocity = rates(REST, [[0.3, -0.4], [-0.3, 0.4]], [[0.0], [2.0]])  # no friction: it follows
    np.testing.assert_allclose(velocity, [[0.3, -0.4], [0.0, 0.0]], atol=1e-11)
    _, velocity = rates(REST, [[0.3, -0.4], [-0.3, 0.4]], [[0.0] * 4, [2.0] * 4], directions=CROSS)
    np.testing.assert_allclose(velocity, [[0.3, -0.4], [0.0, 0.0]], atol=1e-11)


def test_a_force_that_leaves_its_disc_may_come_back():
    """From (0.5, 0) on a disc of 0.5 N, along (-1, 1): the chord ends at (0, 0.5)."""
    event, velocity = rates([[0.5, 0.0], [-0.5, 0.0]], [[-1.0, 1.0], [1.0, -1.0]], [[0.5], [2.0]])
    assert event == pytest.approx(0.5, rel=1e-14)
    assert velocity == REST
    assert rates([[0.5, 0.0], [-0.5, 0.0]], [[-1.0, 1.0], [1.0, -1.0]], [[0.5], [9.0]], [[9.0], [9.0]])[0] == np.inf


def test_compliance_is_that_between_the_farthest():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 8))
        ends = np.array([(i, i + 1) for i in range(n - 1)] + [tuple(rng.choice(n, 2, replace=False)) for _ in range(2)])
        stiffness = np.exp(rng.uniform(-2, 2, len(ends)))
        laplacian = laplacian_of(ends, stiffness, n).toarray()
        inverse = np.linalg.pinv(laplacian)
        between = np.diag(inverse)[:, None] + np.diag(inverse) - 2.0 * inverse
        bound = build_springs(ends, stiffness, n).compliance
        assert between.max() * (1.0 - 1e-12) <= bound <= 2.0 * between.max()
        to_first = np.sort(np.diag(np.linalg.inv(laplacian[1:, 1:])))
        assert bound == pytest.approx(to_first[-2:].sum(), rel=1e-12)


@pytest.mark.parametrize("directional", [False, True])
def test_a_step_is_never_further_off_than_it_says(directional):
    """One implicit step for the whole of a first ramp, against the path: the bound on the shape is one."""
    seen = 0
    for body in planar(directional):
        n = len(body.friction)
        if not (body.frictions == body.friction).all():
            continue
        directions = DISC if body.directions is None else body.directions
        springs = build_springs(np.array(body.ends), body.stiffness, n)
        force = np.zeros((n, 2))
        for (a, b), k, longer in zip(body.ends, body.stiffness, body.lengths[1], strict=True):
            force[a] -= k * longer
            force[b] += k * longer
        moved, motion = np.zeros((n, 2)), np.zeros(n, np.int64)
        project_planar(springs, force, body.friction, directions, MOST_SWEEPS, moved, motion)
        corners = corners_of(body.friction, directions)
        limits = np.full(n, 1e-11), springs.compliance
        bound = missed(moved, np.zeros((n, 2)), body.friction, directions, corners, *limits)
        off = moved - body.places[0]
        apart = np.hypot(*(off[:, None] - off[None]).transpose(2, 0, 1)).max()
        assert apart <= bound * (1.0 + 1e-9) + 1e-9
        seen += apart > 1e-3
    assert seen > 0
