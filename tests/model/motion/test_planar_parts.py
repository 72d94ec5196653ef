"""Ramps in the plane that are followed in parts end where those of the whole body end."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model.arrays import frozen
from crawler_model.motion.plane.implicit_step import MOST_SWEEPS
from crawler_model.motion.plane.parts.division import divide
from crawler_model.motion.plane.parts.follow import follow_in_parts
from crawler_model.motion.plane.ramp import follow_ramp
from crawler_model.motion.plane.springs import build_springs
from crawler_model.motion.plane.walk import NOT_UNIQUE, PATIENCE, STAGES
from crawler_model.motion.state import (
    ACCOUNT_SIZE,
    AMBIGUOUS,
    COMPLEMENTARITY,
    DISSIPATION,
    EVENTS,
    LOADS_WORK,
    RESIDUAL,
    VIOLATION,
    VISITED,
    WORK,
)
from crawler_model.motion.state import PLANAR_ACTUATION as ACTUATION
from crawler_model.motion.state import PLANAR_GAINED as GAINED
from crawler_model.motion.state import PLANAR_LOAD as LOAD
from crawler_model.motion.state import PLANAR_TENSION as TENSION
from crawler_model.motion.state import PLANAR_X as X

# read-only, as a scene's are: the kernels would be compiled again for arrays that can be written
DISC = frozen(np.zeros((0, 2)))
CROSS = frozen([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
TOLERANCE, MOST = 1e-7, 1 << 16


class Body:
    """A body at rest at L = 0, in which some springs change."""

    def __init__(self, seed, directions, *, grid=False, loaded=False):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(70, 140))
        ends = [(i, i + 1) for i in range(n - 1)]
        if grid:
            width = int(rng.integers(4, 9))
            n -= n % width
            ends = [(i, i + 1) for i in range(n - 1) if (i + 1) % width] + [(i, i + width) for i in range(n - width)]
        numbers = rng.permutation(n) if seed % 2 else np.arange(n)  # neighbours may have any numbers
        ends = numbers[np.array(ends)]
        self.springs = build_springs(ends, np.exp(rng.uniform(-1.0, 1.0, len(ends))), n)
        self.directions = directions
        self.friction = np.exp(rng.uniform(-1.0, 1.0, (n, max(len(directions), 1))))
        self.contacts = np.zeros((4 if loaded else 3, n, 2))
        self.links = np.zeros((2, len(ends), 2))
        self.account = np.zeros(ACCOUNT_SIZE)
        self.account[VISITED] = np.inf
        self.rng = rng
        if loaded:
            self.contacts[LOAD] = rng.normal(size=(n, 2)) * 0.05

    def target(self, changing, size):
        """Change the rest lengths of some springs, and a little all frictions and loads."""
        rng = self.rng
        lengths, friction = self.links[ACTUATION].copy(), self.friction * rng.uniform(0.95, 1.05, self.friction.shape)
        some = rng.choice(len(lengths), changing, replace=False)
        lengths[some] += rng.normal(size=(changing, 2)) * size
        loads = self.contacts[LOAD:] + rng.normal(size=self.contacts[LOAD:].shape) * 0.01
        return np.concatenate((lengths.ravel(), friction.ravel(), loads.ravel()))

    def copy(self):
        twin = object.__new__(Body)
        twin.__dict__ = {
            name: value.copy() if type(value) is np.ndarray and value.flags.writeable else value
            for name, value in self.__dict__.items()
        }
        return twin

    def state(self):
        return self.contacts, self.links, self.friction

    def follow(self, target, tolerance=TOLERANCE):
        n = len(self.friction)
        progress = np.zeros(NOT_UNIQUE + STAGES)
        progress[PATIENCE] = np.inf
        memory = np.zeros((STAGES, n, 2)), np.zeros((STAGES, n), np.int64), np.empty((n, 2 + self.friction.shape[1]))
        limits = target, tolerance, MOST, self.account, progress, MOST_SWEEPS
        assert follow_ramp(self.springs, self.directions, *self.state(), *limits, *memory)

    def follow_in_parts(self, target, tolerance=TOLERANCE):
        limits = target, tolerance, MOST, self.account, MOST_SWEEPS
        return follow_in_parts(self.springs, self.directions, *self.state(), *limits)


def check_alike(parts, whole, tolerance):
    for found, expected in zip(parts.state(), whole.state(), strict=True):
        np.testing.assert_allclose(found, expected, atol=tolerance)
    for entry in (WORK, DISSIPATION, LOADS_WORK):
        assert parts.account[entry] == pytest.approx(whole.account[entry], rel=10.0 * tolerance, abs=10.0 * tolerance)
    size = 1.0 + abs(whole.account[WORK])
    assert abs(parts.account[RESIDUAL]) <= max(10.0 * abs(whole.account[RESIDUAL]), 10.0 * tolerance * size)
    assert parts.account[VIOLATION] <= max(10.0 * whole.account[VIOLATION], 0.1 * tolerance)
    assert parts.account[COMPLEMENTARITY] <= max(100.0 * whole.account[COMPLEMENTARITY], 1e-4)  # of one substep
    assert parts.account[AMBIGUOUS] == whole.account[AMBIGUOUS] == 0.0


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("grid", [False, True])
@pytest.mark.parametrize(("directions", "tolerance"), [(CROSS, 1e-9), (DISC, 20.0 * TOLERANCE)], ids=["cross", "disc"])
def test_random_ramps(directions, tolerance, grid, loaded):
    """Polygons let contacts move on straight lines between events, so that both ways agree to rounding."""
    followed, moved = 0, 0
    for seed in range(12):
        whole = Body(seed, directions, grid=grid, loaded=loaded)
        for _ in range(3):
            target = whole.target(int(whole.rng.integers(1, 6)), 3.0)
            parts = whole.copy()
            parts.account[:], whole.account[:] = 0.0, 0.0
            parts.account[VISITED] = whole.account[VISITED] = np.inf
            reached = parts.follow_in_parts(target)
            whole.follow(target)
            if reached < 1.0:
                continue
            followed += 1
            moved += int(np.abs(whole.contacts[GAINED]).max() > 0.0)
            check_alike(parts, whole, tolerance)
            assert parts.account[VISITED] >= 0.9 * whole.account[VISITED]  # sampled at other places
    assert followed > 20
    assert moved > 20


def pull(n, length):
    """A chain with k = 1, of which the first link becomes longer along x."""
    body = Body(0, DISC)
    body.springs = build_springs(np.array([(i, i + 1) for i in range(n - 1)]), np.ones(n - 1), n)
    body.friction, body.contacts, body.links = np.ones((n, 1)), np.zeros((3, n, 2)), np.zeros((2, n - 1, 2))
    lengths = np.zeros((n - 1, 2))
    lengths[n // 2, 0] = length
    return body, np.concatenate((lengths.ravel(), body.friction.ravel()))


def test_a_part_is_enlarged_until_its_outermost_contacts_rest():
    """The tension 20.5 of the longer link moves contacts on both sides, by the sums of the tensions."""
    n, moving = 200, 20
    tension = moving + 0.5 - np.arange(1, moving + 1)
    gains = np.cumsum(tension[::-1])[::-1]
    body, target = pull(n, 20.5 + 2.0 * gains[0])
    assert body.follow_in_parts(target) == 1.0
    expected = np.zeros((n, 2))
    expected[n // 2 + 1 :, 0][:moving] = gains
    expected[: n // 2 + 1, 0][::-1][:moving] = -gains
    np.testing.assert_allclose(body.contacts[X], expected, atol=1e-9)
    assert not body.contacts[X][expected[:, 0] == 0.0].any()  # exactly
    np.testing.assert_array_equal(body.links[ACTUATION].ravel(), target[: 2 * (n - 1)])
    assert body.account[EVENTS] >= moving


def test_two_parts_that_meet_become_one():
    body, target = pull(200, 30.0)
    lengths = target[: 2 * 199].reshape(199, 2)
    lengths[60], lengths[74] = [80.0, 20.0], [-80.0, -20.0]
    lengths[100] = 0.0
    whole = body.copy()
    assert body.follow_in_parts(target) == 1.0
    whole.follow(target)
    assert (whole.contacts[X][61:75, 0] > 0.0).all()  # all between the two links move
    np.testing.assert_allclose(body.contacts[X], whole.contacts[X], atol=20.0 * TOLERANCE)


def test_a_ramp_in_which_all_rest():
    body, target = pull(100, 0.5)
    assert body.follow_in_parts(target) == 1.0
    assert body.account[EVENTS] == 1.0
    assert not body.contacts[X].any()
    assert body.links[TENSION, 50, 0] == -0.5
    assert body.account[WORK] == pytest.approx(0.125, rel=1e-14)
    assert body.account[VISITED] == pytest.approx((100 - 1.0) / 200, rel=1e-14)


def test_what_no_part_can_follow_is_left_unchanged():
    """Bodies whose contacts almost all move are followed as a whole."""
    body = Body(3, DISC)
    target = body.target(len(body.links[0]), 50.0)
    before = [array.copy() for array in (*body.state(), body.account)]
    assert body.follow_in_parts(target) == 0.0
    for now, then in zip((*body.state(), body.account), before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_division():
    """Moving contacts with a single contact between them are in one part; others share the contacts between them."""
    n = 40
    springs = build_springs(np.array([(i, i + 1) for i in range(n - 1)]), np.ones(n - 1), n)
    moving, owner = np.zeros(n, np.bool_), np.empty(n, np.int64)
    moving[[10, 12, 15, 30]] = True
    divide(springs, moving, owner)
    assert owner[10] == owner[11] == owner[12] == owner[13]
    assert owner[14] == owner[15] != owner[12]
    np.testing.assert_array_equal(np.flatnonzero(owner == owner[30]), np.arange(26, 35))
    np.testing.assert_array_equal(np.flatnonzero(owner < 0), np.r_[0:5, 20:26, 35:40])
