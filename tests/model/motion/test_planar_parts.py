"""Ramps in the plane that are followed in parts end where those of the whole body end."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model.motion.plane.motion import PlaneMotion
from crawler_model.motion.plane.parts.division import divide, list_neighbours
from crawler_model.motion.plane.parts.follow import follow_in_parts
from crawler_model.motion.plane.ramp import LEFT, LENGTH, MARGIN, PATIENCE, PLACE, follow_ramp
from crawler_model.motion.state import (
    ACCOUNT_SIZE,
    AMBIGUOUS,
    COMPLEMENTARITY,
    DISSIPATION,
    EVENTS,
    LOADS_WORK,
    OVERSPENT,
    RESIDUAL,
    VIOLATION,
    VISITED,
    WORK,
)

from ..planar_stage import CROSS, DISC, body_of, command_of, frame_of

TOLERANCE = 1e-7


class Ramp:
    """A body on its way from a command to another one, with an account."""

    def __init__(self, ends, stiffness, friction, directions, loads=()):
        n = len(friction)
        self.frame = frame_of(ends, stiffness, n, directions)
        at_rest = np.concatenate((np.zeros(2 * len(ends)), np.ravel(friction), np.ravel(loads)))
        self.state = PlaneMotion(body_of(ends, stiffness, n), self.frame, TOLERANCE).start(np.zeros((n, 2)), at_rest)
        self.account = np.zeros(ACCOUNT_SIZE)
        self.account[VISITED] = np.inf

    @property
    def arrays(self):
        return self.state.x, self.state.gained, self.state.command, self.state.turned

    def copy(self):
        twin = object.__new__(Ramp)
        twin.frame, twin.state, twin.account = self.frame, self.state.copy(), self.account.copy()
        return twin

    def follow(self, target):
        progress = np.zeros(5)
        progress[LENGTH], progress[LEFT] = 1.0, TOLERANCE
        progress[MARGIN] = progress[PATIENCE] = np.inf
        velocity = np.zeros_like(self.state.x)
        assert follow_ramp(self.frame, self.arrays, target, TOLERANCE, velocity, self.account, progress)
        assert progress[PLACE] == 1.0

    def follow_in_parts(self, target):
        return follow_in_parts(self.frame, self.arrays, target, TOLERANCE, self.account)


class Random:
    """A random body at rest at L = 0, in which some springs change."""

    def __init__(self, seed, directions, *, grid=False, loaded=False):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(70, 140))
        ends = [(i, i + 1) for i in range(n - 1)]
        if grid:
            width = int(rng.integers(4, 9))
            n -= n % width
            ends = [(i, i + 1) for i in range(n - 1) if (i + 1) % width] + [(i, i + width) for i in range(n - width)]
        numbers = rng.permutation(n) if seed % 2 else np.arange(n)  # neighbours may have any numbers
        stiffness = np.exp(rng.uniform(-1.0, 1.0, len(ends)))
        self.friction = np.exp(rng.uniform(-1.0, 1.0, (n, max(len(directions), 1))))
        self.rng, self.directions, self.loaded = rng, directions, loaded
        loads = rng.normal(size=(n, 2)) * 0.05 if loaded else ()
        self.ramp = Ramp(numbers[np.array(ends)], stiffness, self.friction, directions, loads)

    def target(self, changing, size):
        """Change the rest lengths of some springs, and a little all frictions and loads."""
        rng, state = self.rng, self.ramp.state
        lengths = state.actuation.copy()
        friction = state.friction.reshape(self.friction.shape) * rng.uniform(0.95, 1.05, self.friction.shape)
        some = rng.choice(len(lengths), changing, replace=False)
        lengths[some] += rng.normal(size=(changing, 2)) * size
        loads = state.loads + rng.normal(size=state.loads.shape) * 0.01
        return command_of(self.directions, lengths, friction, loads)


def check_alike(parts, whole, tolerance):
    for found, expected in zip(parts.arrays, whole.arrays, strict=True):
        np.testing.assert_allclose(found, expected, atol=tolerance)
    for entry in (WORK, DISSIPATION, LOADS_WORK):
        assert parts.account[entry] == pytest.approx(whole.account[entry], rel=10.0 * tolerance, abs=10.0 * tolerance)
    size = 1.0 + abs(whole.account[WORK])
    assert abs(parts.account[RESIDUAL]) <= max(10.0 * abs(whole.account[RESIDUAL]), 10.0 * tolerance * size)
    assert parts.account[VIOLATION] <= max(10.0 * whole.account[VIOLATION], 0.1 * tolerance)
    assert parts.account[COMPLEMENTARITY] <= max(100.0 * whole.account[COMPLEMENTARITY], 1e-4)  # of one substep
    assert parts.account[AMBIGUOUS] == whole.account[AMBIGUOUS] == 0.0
    assert parts.account[OVERSPENT] == whole.account[OVERSPENT] == 0.0


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("grid", [False, True])
@pytest.mark.parametrize(("directions", "tolerance"), [(CROSS, 1e-9), (DISC, 20.0 * TOLERANCE)], ids=["cross", "disc"])
def test_random_ramps(directions, tolerance, grid, loaded):
    """Polygons let contacts move on straight lines between events, so that both ways agree to rounding."""
    followed, moved = 0, 0
    for seed in range(12):
        body = Random(seed, directions, grid=grid, loaded=loaded)
        whole = body.ramp
        for _ in range(3):
            target = body.target(int(body.rng.integers(1, 6)), 3.0)
            parts = whole.copy()
            parts.account[:], whole.account[:] = 0.0, 0.0
            parts.account[VISITED] = whole.account[VISITED] = np.inf
            reached = parts.follow_in_parts(target)
            whole.follow(target)
            if reached < 1.0:
                continue
            followed += 1
            moved += int(np.abs(whole.state.gained).max() > 0.0)
            check_alike(parts, whole, tolerance)
            assert parts.account[VISITED] >= 0.9 * whole.account[VISITED]  # sampled at other places
    assert followed > 20
    assert moved > 20


def pull(n, length):
    """A chain with k = 1, of which the middle link becomes longer along x."""
    friction, lengths = np.ones((n, 1)), np.zeros((n - 1, 2))
    lengths[n // 2, 0] = length
    body = Ramp([(i, i + 1) for i in range(n - 1)], np.ones(n - 1), friction, DISC)
    return body, command_of(DISC, lengths, friction)


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
    np.testing.assert_allclose(body.state.x, expected, atol=1e-9)
    assert not body.state.x[expected[:, 0] == 0.0].any()  # exactly
    np.testing.assert_array_equal(body.state.command, target)
    assert body.account[EVENTS] >= moving


def test_two_parts_that_meet_become_one():
    body, target = pull(200, 30.0)
    lengths = target[: 2 * 199].reshape(199, 2)
    lengths[60], lengths[74] = [80.0, 20.0], [-80.0, -20.0]
    lengths[100] = 0.0
    whole = body.copy()
    assert body.follow_in_parts(target) == 1.0
    whole.follow(target)
    assert (whole.state.x[61:75, 0] > 0.0).all()  # all between the two links move
    np.testing.assert_allclose(body.state.x, whole.state.x, atol=20.0 * TOLERANCE)


def test_a_ramp_in_which_all_rest():
    body, target = pull(100, 0.5)
    assert body.follow_in_parts(target) == 1.0
    assert body.account[EVENTS] == 1.0
    state = body.state
    assert not state.x.any()
    assert state.tension[50, 0] == -0.5
    assert body.account[WORK] == pytest.approx(0.125, rel=1e-14)
    assert body.account[VISITED] == pytest.approx((100 - 1.0) / 200, rel=1e-14)
    assert state.visited_margin(state.force) == pytest.approx((100 - 1.0) / 200, rel=1e-14)


def test_what_no_part_can_follow_is_left_unchanged():
    """Bodies whose contacts almost all move are followed as a whole."""
    random = Random(3, DISC)
    body = random.ramp
    target = random.target(len(body.frame.ends), 50.0)
    before = body.copy()
    assert body.follow_in_parts(target) == 0.0
    for now, then in zip((*body.arrays, body.account), (*before.arrays, before.account), strict=True):
        np.testing.assert_array_equal(now, then)


def test_division():
    """Moving contacts with a single contact between them are in one part; others share the contacts between them."""
    n = 40
    neighbours = list_neighbours(np.array([(i, i + 1) for i in range(n - 1)]), n)
    moving, owner = np.zeros(n, np.bool_), np.empty(n, np.int64)
    moving[[10, 12, 15, 30]] = True
    divide(neighbours, moving, owner)
    assert owner[10] == owner[11] == owner[12] == owner[13]
    assert owner[14] == owner[15] != owner[12]
    np.testing.assert_array_equal(np.flatnonzero(owner == owner[30]), np.arange(26, 35))
    np.testing.assert_array_equal(np.flatnonzero(owner < 0), np.r_[0:5, 20:26, 35:40])
