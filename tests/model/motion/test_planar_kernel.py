from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import block_diag, triu

from crawler_model.arrays import frozen
from crawler_model.body.directions import check_directions
from crawler_model.errors import SceneError
from crawler_model.motion.plane import follow as planar_ramps
from crawler_model.motion.plane.cone import solve_with_clarabel
from crawler_model.motion.plane.follow import follow as follow_planar
from crawler_model.motion.plane.implicit_step import MOST_SWEEPS, project_planar
from crawler_model.motion.plane.ramp import ACTUATION, GAINED, TENSION, X
from crawler_model.motion.plane.springs import build_springs, laplacian_of, solve_band_in_place
from crawler_model.motion.state import (
    ACCOUNT_SIZE,
    AMBIGUOUS,
    DISSIPATION,
    EVENTS,
    OVERSPENT,
    RESIDUAL,
    VIOLATION,
    VISITED,
    WORK,
)

from .test_projection import solve as project

# read-only, as a scene's are: the kernels would be compiled again for arrays that can be written
ISOTROPIC = frozen(np.zeros((0, 2)))
CROSS = frozen([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
TRIANGLE = np.array([[0, 1], [1, 2], [2, 0]])


def springs_of(laplacian):
    joined = triu(-laplacian, 1).tocoo()
    return build_springs(np.stack(joined.coords, 1).astype(np.int64), joined.data, laplacian.shape[0])


def solve(laplacian, force, friction, directions=ISOTROPIC):
    # in one piece, or the kernel would be compiled again for each layout
    force, friction = map(np.ascontiguousarray, (force, friction))
    directions = frozen(directions)
    velocity, motion = np.zeros_like(force), np.zeros(len(force), np.int64)
    springs = springs_of(laplacian)
    solved, residual, unique, _ = project_planar(springs, force, friction, directions, MOST_SWEEPS, velocity, motion)
    assert solved
    assert residual <= 1e-13
    return velocity, unique


def resistance(friction, directions, velocity):
    if not len(directions):
        return float((friction[:, 0] * np.hypot(*velocity.T)).sum())
    total = 0.0
    for mu, v in zip(friction, velocity, strict=True):
        following, after = np.roll(directions, -1, 0), np.roll(mu, -1)
        pairs = np.stack((directions, following), 1)
        corners = np.linalg.solve(pairs, np.stack((mu, after), 1)[..., None])[..., 0]
        total += (corners @ v).max()
    return total


def cost(laplacian, force, friction, directions, velocity):
    quadratic = 0.5 * np.sum(velocity * (laplacian @ velocity)) - np.sum(force * velocity)
    return quadratic + resistance(friction, directions, velocity)


def random_problem(seed, directional, ratio=1e3):
    """Connected bodies with redundant links; ties, friction zero in places, loads beyond the domain."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 12))
    links = [(i, i + 1) for i in range(n - 1)] + [tuple(rng.choice(n, 2, replace=False)) for _ in range(n // 2)]
    ends = np.array(links)
    stiffness = np.exp(rng.uniform(0, np.log(ratio), len(ends)))
    tension = rng.normal(size=(len(ends), 2)) * np.exp(rng.uniform(-2, 2))
    directions, friction = ISOTROPIC, np.exp(rng.uniform(-2, 2, (n, 1)))
    if directional:
        m = int(rng.integers(3, 9))
        angle = np.sort((np.arange(m) + rng.uniform(-0.2, 0.2, m)) * 2 * np.pi / m)
        directions = np.stack((np.cos(angle), np.sin(angle)), 1)
        points = rng.normal(size=(n, 5, 2))
        friction = ((points - points.mean(1, keepdims=True)) @ directions.T).max(1)
    if seed % 4 == 0:
        friction[:] = friction[0]
        tension = np.round(tension)
    if seed % 5 == 0:
        friction[rng.random(n) < 0.5] = 0.0
    force = np.zeros((n, 2))
    np.add.at(force, ends[:, 0], tension)
    np.add.at(force, ends[:, 1], -tension)
    return laplacian_of(ends, stiffness, n), force, friction, directions


@pytest.mark.parametrize("directional", [False, True])
def test_a_step_is_what_interior_points_find(directional):
    for seed in range(120):
        problem = random_problem(seed, directional)
        velocity, unique = solve(*problem)
        reference = solve_with_clarabel(*problem)
        scale = abs(cost(*problem, reference)) + 1e-300
        assert cost(*problem, velocity) <= cost(*problem, reference) + 1e-12 * scale, seed
        laplacian, force = problem[:2]
        close = 1e-4 * (np.abs(force).max() + problem[2].max())
        assert np.abs(laplacian @ (velocity - reference)).max() <= close, seed
        if unique and scale > 1e-6:
            assert cost(*problem, velocity) >= cost(*problem, reference) - 1e-6 * scale, seed


@pytest.mark.parametrize("directional", [False, True])
def test_stiffness_ratios_of_a_million_are_solved_to_rounding(directional):
    for seed in range(200):
        solve(*random_problem(seed, directional, 1e6))


@pytest.mark.parametrize("directional", [False, True])
def test_long_bodies_are_solved_as_short_ones(directional):
    """Copies of a body, each tied to the next by a soft spring between contacts that a large friction holds."""
    for seed in range(20):
        laplacian, force, friction, directions = random_problem(seed, directional)
        n, copies = len(force), 7
        friction[0] = 1e6
        alone, unique = solve(laplacian, force, friction, directions)
        long = block_diag([laplacian] * copies).tolil()
        for k in range(copies - 1):
            a, b = k * n, (k + 1) * n
            long[[a, b], [a, b]] = [long[a, a] + 1e-3, long[b, b] + 1e-3]
            long[[a, b], [b, a]] = -1e-3
        mixed = np.random.default_rng(seed).permutation(copies * n)
        repeated = np.tile(force, (copies, 1))[mixed], np.tile(friction, (copies, 1))[mixed]
        velocity, also = solve(long.tocsr()[mixed][:, mixed], *repeated, directions)
        assert unique == also
        np.testing.assert_allclose(velocity, np.tile(alone, (copies, 1))[mixed], atol=1e-10 * np.abs(alone).max())


def test_small_loads_move_nothing_at_all():
    laplacian, force, friction, directions = random_problem(1, False)
    velocity, _ = solve(laplacian, 0.99 * force * friction.min() / np.hypot(*force.T).max(), friction, directions)
    assert not velocity.any()


def test_all_sliding_with_a_determined_translation():
    laplacian = laplacian_of(np.array([[0, 1]]), np.array([1.0]), 2)
    velocity, unique = solve(laplacian, np.array([[10.0, 0.0], [-10.0, 0.0]]), np.array([[1.0], [2.0]]))
    assert unique
    np.testing.assert_allclose(velocity, [[9.0, 0.0], [0.0, 0.0]], atol=1e-14)  # only the weaker contact slides


def test_three_contacts_slide_about_a_weighted_median():
    """A stiff triangle that turns: the translation minimises the friction, and all slide."""
    rng = np.random.default_rng(0)
    laplacian = laplacian_of(TRIANGLE, np.ones(3), 3)
    friction = np.array([[1.0], [1.1], [1.2]])
    shape = np.array([[8.0, 0.0], [-5.0, 6.0], [-4.0, -7.0]])
    velocity, unique = solve(laplacian, laplacian @ shape, friction)
    assert unique
    assert np.hypot(*velocity.T).min() > 1.0
    pull = friction * velocity / np.hypot(*velocity.T)[:, None]
    np.testing.assert_allclose(pull.sum(0), 0.0, atol=1e-12)
    best = resistance(friction, ISOTROPIC, velocity)
    for shift in rng.normal(size=(50, 2)):
        assert resistance(friction, ISOTROPIC, velocity + shift) >= best


@pytest.mark.parametrize(
    ("friction", "directions"),
    [(np.ones((2, 1)), ISOTROPIC), (np.ones((2, 4)), CROSS), (np.zeros((2, 1)), ISOTROPIC), (np.zeros((2, 4)), CROSS)],
)
def test_of_many_translations_the_nearest_to_zero(friction, directions):
    laplacian = laplacian_of(np.array([[0, 1]]), np.array([1.0]), 2)
    velocity, unique = solve(laplacian, np.array([[6.0, 0.0], [-6.0, 0.0]]), friction, directions)
    assert not unique
    slip = 6.0 - friction.max()
    np.testing.assert_allclose(velocity, [[0.5 * slip, 0.0], [-0.5 * slip, 0.0]], atol=1e-12)


def test_frictionless_contacts_follow_the_others():
    laplacian = laplacian_of(np.array([[0, 1], [1, 2]]), np.ones(2), 3)
    velocity, unique = solve(
        laplacian, np.array([[0.0, 0.5], [2.0, 1.0], [-2.0, -1.5]]), np.array([[3.0], [0.0], [0.0]])
    )
    assert unique
    assert not velocity[0].any()
    np.testing.assert_allclose((laplacian @ velocity)[1:], [[2.0, 1.0], [-2.0, -1.5]], atol=1e-13)


def test_a_step_on_a_line_is_that_of_a_chain():
    for seed in range(100):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 10))
        stiffness = np.exp(rng.uniform(-2, 2, n - 1))
        trial = rng.normal(size=n - 1) * 3
        forward, backward = np.exp(rng.uniform(-2, 1, (2, n)))
        isotropic = seed % 2 == 0
        if isotropic:
            backward = forward
        tension, _ = project(trial, stiffness, -backward, forward)
        ends = np.stack((np.arange(n - 1), np.arange(1, n)), 1)
        force = np.zeros((n, 2))
        force[:-1, 0] += trial
        force[1:, 0] -= trial
        friction, directions = forward[:, None], ISOTROPIC
        if not isotropic:
            directions = CROSS
            friction = np.stack((forward, np.ones(n), backward, np.full(n, 2.0)), 1)
        velocity, _ = solve(laplacian_of(ends, stiffness, n), force, friction, directions)
        assert not velocity[:, 1].any()
        np.testing.assert_allclose(trial + stiffness * np.diff(velocity[:, 0]), tension, atol=1e-11)


@pytest.mark.parametrize("directional", [False, True])
@pytest.mark.parametrize(("length", "newton"), [(1e-9, 1e9), (1e9, 1e-9), (1e-9, 1.0), (1.0, 1e9)])
def test_units_scale_the_answer_and_nothing_else(directional, length, newton):
    for seed in range(20):
        laplacian, force, friction, directions = random_problem(seed, directional)
        velocity, unique = solve(laplacian, force, friction, directions)
        other, also = solve(laplacian * newton / length, force * newton, friction * newton, directions)
        assert unique == also
        np.testing.assert_allclose(other / length, velocity, rtol=1e-9, atol=1e-10 * np.abs(velocity).max())


@pytest.mark.parametrize("directional", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_turned_or_mirrored_the_answer_turns_too(directional, mirrored):
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    for seed in range(40):
        laplacian, force, friction, directions = random_problem(seed, directional)
        velocity, _ = solve(laplacian, force, friction, directions)
        change = turn @ np.diag([1.0, -1.0]) if mirrored else turn
        order = slice(None, None, -1) if mirrored and directional else slice(None)  # keep it counterclockwise
        other, _ = solve(laplacian, force @ change.T, friction[:, order], (directions @ change.T)[order])
        np.testing.assert_allclose(other, velocity @ change.T, atol=1e-10 * (np.abs(velocity).max() + 1e-300))


class Body:
    """What `follow_planar` changes, and a gait for it."""

    def __init__(self, friction, directions=ISOTROPIC, ends=TRIANGLE, stiffness=(1.0, 1.3, 0.8)):
        self.friction = np.array(friction, float)
        self.directions, self.ends, self.stiffness = frozen(directions), frozen(ends, np.int64), frozen(stiffness)
        n = len(self.friction)
        self.contacts, self.links = np.zeros((3, n, 2)), np.zeros((2, len(ends), 2))
        self.account = np.zeros(ACCOUNT_SIZE)

    def follow(self, actuation, tolerance=1e-6, friction=None, most=100_000):
        actuation = np.asarray(actuation, float)
        friction = np.broadcast_to(
            self.friction if friction is None else friction, (len(actuation), *self.friction.shape)
        )
        targets = np.hstack((actuation.reshape(len(actuation), -1), friction.reshape(len(actuation), -1)))
        n = len(self.friction)
        records = np.zeros((len(targets), self.contacts[1:].size + self.links[0].size))
        self.account[:] = 0.0
        self.account[VISITED] = np.inf
        args = (self.contacts, self.links, self.friction, targets, tolerance, most, self.account, records)
        follow_planar(build_springs(self.ends, self.stiffness, n), self.directions, *args)
        return records


def turning_gait(ramps=6):
    phase = 2 * np.pi * np.arange(1, ramps + 1)[:, None] / 6
    link = np.arange(3)
    along = 0.6 * np.cos(phase + 2.1 * link)[..., None] * np.stack((np.cos(2.1 * link), np.sin(2.1 * link)), -1)
    across = 0.3 * np.sin(1.3 * phase + link)[..., None] * np.stack((-np.sin(link), np.cos(link)), -1)
    return along + across


EQUAL_SIDES = (np.array([[0.1], [0.13], [0.2]]), ISOTROPIC)
CROSSED = (np.array([[0.1, 0.21, 0.157, 0.2], [0.12, 0.2, 0.31, 0.1], [0.203, 0.25, 0.2, 0.26]]), CROSS)


@pytest.mark.parametrize(("friction", "directions"), [EQUAL_SIDES, CROSSED])
def test_error_and_energy_residual_follow_the_tolerance(friction, directions):
    fine = Body(friction, directions).follow(turning_gait(), 1e-7)
    residuals = []
    for tolerance in (1e-3, 1e-4, 1e-5):
        body = Body(friction, directions)
        records = body.follow(turning_gait(), tolerance)
        assert np.abs(records - fine)[:, :6].max() <= 6 * 2 * tolerance  # six ramps
        assert body.account[OVERSPENT] == 0
        assert body.account[VIOLATION] <= 1e-2 * tolerance
        residuals.append(abs(body.account[RESIDUAL]))
        assert residuals[-1] <= 6 * 2 * tolerance * 3 * friction.max()
    assert residuals[-1] < max(1e-1 * residuals[0], 1e-13)  # straight paths are exact
    assert body.account[DISSIPATION] > 0.1


def test_state_is_consistent_after_a_gait():
    body = Body(*EQUAL_SIDES)
    records = body.follow(turning_gait(), 1e-4)
    shape = np.diff(body.contacts[X][body.ends], axis=1)[:, 0]
    np.testing.assert_allclose(
        body.links[TENSION], body.stiffness[:, None] * (shape - body.links[ACTUATION]), atol=1e-14
    )
    np.testing.assert_array_equal(body.links[ACTUATION], turning_gait()[-1])
    np.testing.assert_array_equal(records[-1, :6], body.contacts[X].ravel())
    np.testing.assert_allclose(body.contacts[GAINED], body.contacts[X], atol=1e-14)
    stored = 0.5 * np.sum(body.links[TENSION] ** 2 / body.stiffness[:, None])
    balance = stored + body.account[DISSIPATION] - body.account[WORK]
    assert balance == pytest.approx(body.account[RESIDUAL], abs=1e-13)


def test_two_contacts_on_a_line_crawl_as_in_one_dimension():
    """Triangle wave of amplitude D: max(0, D - 2 min(mu) / k) a period."""
    for amplitude in (1.5, 3.0):
        friction = [[1.0, 9.0, 2.0, 9.0]] * 2
        body = Body(friction, CROSS, np.array([[0, 1]]), [1.0])
        up, down = [[amplitude, 0.0]], [[0.0, 0.0]]
        records = body.follow([up, down] * 3, 1e-6)[:, :4].reshape(-1, 2, 2)
        gain = (records[5] - records[3]).mean(0)
        np.testing.assert_allclose(gain, [max(0.0, amplitude - 2.0), 0.0], atol=1e-5)


def test_friction_goes_along_the_ramp():
    body = Body([[1.0], [1.0]], ISOTROPIC, np.array([[0, 1]]), [1.0])
    body.follow([[[0.0, 0.8]]])
    assert not body.contacts[X].any()
    body.follow([[[0.0, 0.8]]], friction=[[0.5], [2.0]])
    np.testing.assert_allclose(body.contacts[X], [[0.0, -0.3], [0.0, 0.0]], atol=1e-9)
    np.testing.assert_array_equal(body.friction, [[0.5], [2.0]])


def test_critical_friction_is_told():
    body = Body([[1.0], [1.0]], ISOTROPIC, np.array([[0, 1]]), [1.0])
    body.follow([[[5.0, 0.0]]])
    assert body.account[AMBIGUOUS] == 1.0
    np.testing.assert_allclose(body.contacts[X].sum(0), 0.0, atol=1e-12)


def test_unchanged_commands_cost_nothing_and_stuck_ramps_one_step():
    body = Body(*EQUAL_SIDES)
    body.follow(np.zeros((5, 3, 2)))
    assert body.account[EVENTS] == 0
    body.follow(0.01 * turning_gait())
    assert body.account[EVENTS] == 6
    assert body.account[VIOLATION] == 0.0
    assert abs(body.account[RESIDUAL]) < 1e-16


def test_a_resting_body_never_creeps():
    body = Body(*EQUAL_SIDES)
    cycle = turning_gait()
    body.follow(cycle, 1e-5)
    resting = cycle[-1] + 0.02 * np.array([np.zeros((3, 2)), cycle[0], cycle[1]])
    body.follow(np.tile(resting, (100, 1, 1)), 1e-5)  # it shakes down first
    before = body.contacts[:2].copy(), body.links.copy()
    body.follow(np.tile(resting[[1, 2, 0]], (33_334, 1, 1)), 1e-5)
    body.follow(resting[[2]], 1e-5)
    np.testing.assert_array_equal(body.contacts[:2], before[0])
    np.testing.assert_array_equal(body.links, before[1])


def test_far_from_home_the_motion_is_the_same():
    near, far = Body(*EQUAL_SIDES), Body(*EQUAL_SIDES)
    far.contacts[X] += 1e9
    near.follow(turning_gait(), 1e-4)
    far.follow(turning_gait(), 1e-4)
    np.testing.assert_allclose(far.contacts[GAINED], near.contacts[GAINED], atol=1e-9)


def test_a_ramp_over_budget_is_finished_in_one_step():
    body = Body(*EQUAL_SIDES)
    body.follow(turning_gait(1), 1e-9, most=10)
    assert body.account[OVERSPENT] == 1
    np.testing.assert_array_equal(body.links[ACTUATION], turning_gait(1)[-1])


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
@pytest.mark.parametrize(("friction", "directions"), [EQUAL_SIDES, CROSSED])
def test_where_the_kernel_gives_up_interior_points_help(monkeypatch, friction, directions, tolerance):
    expected = Body(friction, directions).follow(turning_gait(2), tolerance)
    monkeypatch.setattr(planar_ramps, "MOST_SWEEPS", 0)
    np.testing.assert_allclose(Body(friction, directions).follow(turning_gait(2), tolerance), expected, atol=1e-6)


QUARTERS = np.array([0.0, 0.5, 1.0, 1.5]) * np.pi


def test_convex_friction_is_accepted():
    check_directions(QUARTERS, [1.0, 2.0, 3.0, 0.0])
    check_directions(QUARTERS, np.zeros((3, 4)))
    check_directions(np.arange(8) * np.pi / 4, np.ones(8))
    check_directions(np.arange(3) * 2 * np.pi / 3, [1.0, 1.0, 0.1])


@pytest.mark.parametrize(
    ("angles", "values", "message"),
    [
        (QUARTERS[:2], [1.0, 1.0], "at least 3 are needed"),
        (QUARTERS[:3], [1.0, 1.0, 1.0], "from direction 2 to the next"),
        (QUARTERS[[0, 2, 1, 3]], np.ones(4), "direction 2 at"),
        ([0.0, 2.0, 4.0, 6.3], np.ones(4), "direction 0 at"),
        ([0.0, np.nan, 3.0, 4.5], np.ones(4), "the angle of direction 1 is nan"),
        (QUARTERS, [1.0, 1.0, -1.0, 1.0], "-1 N in direction 2"),
        (QUARTERS, [1.0, 1.0, np.nan, 1.0], "nan N in direction 2"),
        (np.arange(8) * np.pi / 4, [1, 1, 1, 1.5, 1, 1, 1, 1], "not convex: contact 0 has 1.5 N in direction 3"),
        (QUARTERS, [1.0, 1.0, 1.0], "3 value"),
    ],
)
def test_other_friction_is_refused_by_name(angles, values, message):
    with pytest.raises(SceneError, match=message) as error:
        check_directions(angles, values)
    assert "\n" not in str(error.value)


def test_no_force_and_no_friction_move_nothing():
    laplacian = laplacian_of(TRIANGLE, np.ones(3), 3)
    assert not solve_with_clarabel(laplacian, np.zeros((3, 2)), np.zeros((3, 1)), ISOTROPIC).any()
    assert not solve(laplacian, np.zeros((3, 2)), np.zeros((3, 1)))[0].any()


def test_all_may_be_at_their_bounds_and_yet_the_translation_is_determined():
    """Friction |v_x| + |v_y|: who slides along y keeps the others from any translation along x, and the other way."""
    laplacian = laplacian_of(np.array([[0, 1], [1, 2], [2, 3]]), np.ones(3), 4)
    moved = np.array([[1.0, 0.0], [0.0, -1.0], [0.0, 0.0], [-1.0, 0.0]])
    held = np.array([[1.0, 0.0], [-1.0, -1.0], [1.0, 0.0], [-1.0, 1.0]])
    velocity, unique = solve(laplacian, laplacian @ moved + held, np.ones((4, 4)), CROSS)
    assert unique
    np.testing.assert_allclose(velocity, moved, atol=1e-13)


def test_an_infinite_force_is_not_solved():
    laplacian = laplacian_of(TRIANGLE, np.ones(3), 3)
    force = np.array([[np.inf, 0.0], [-np.inf, 0.0], [0.0, 0.0]])
    velocity, motion = np.zeros((3, 2)), np.zeros(3, np.int64)
    solved, residual, _, sweeps = project_planar(
        springs_of(laplacian), force, np.ones((3, 1)), ISOTROPIC, 7, velocity, motion
    )
    assert (solved, residual, sweeps) == (False, np.inf, 7)


def test_stiff_turns_of_almost_equal_contacts_leave_the_step_finite():
    """Contacts that hardly move turn against 1e17 times their stiffness, in which rounding hides the stiffness."""
    rng = np.random.default_rng(0)
    n = 20
    for _ in range(50):
        along = np.stack((np.cos(angle := rng.uniform(0.0, 7.0, n)), np.sin(angle)), 1)
        matrix, right = np.zeros((2 * n, 4)), rng.normal(size=2 * n)
        turn = 10.0 ** rng.uniform(14.0, 17.0, n)
        for i, (d0, d1) in enumerate(along):
            matrix[2 * i, :3] = 2.0 + turn[i] * d1 * d1, -turn[i] * d0 * d1, -1.0
            matrix[2 * i + 1, :3] = 2.0 + turn[i] * d0 * d0, 0.0, -1.0
        matrix[-2:, 2] = 0.0
        solve_band_in_place(matrix, right)
        assert np.isfinite(right).all()
        assert np.abs(right).max() < 1e6


def test_a_step_that_is_not_finite_is_not_solved():
    laplacian = laplacian_of(np.array([[0, 1]]), np.ones(1), 2)
    force = np.array([[np.nan, 0.0], [0.0, 0.0]])
    velocity, motion = np.zeros((2, 2)), np.zeros(2, np.int64)
    assert not project_planar(springs_of(laplacian), force, np.ones((2, 1)), ISOTROPIC, 5, velocity, motion)[0]
