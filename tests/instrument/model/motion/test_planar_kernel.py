"""Implicit steps of vector springs in the plane, and ramps of small bodies."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model.body.directions import check_directions
from crawler_model.errors import CommandError, SceneError
from crawler_model.motion.account import (
    ACCOUNT_SIZE,
    AMBIGUOUS,
    DISSIPATION,
    EVENTS,
    OVERSPENT,
    RESIDUAL,
    VIOLATION,
    WORK,
)
from crawler_model.motion.plane.motion import PlaneMotion

from ..cone_program import solve_with_clarabel
from ..planar_stage import CROSS, DISC, Rig, Step, body_of, frame_of
from .test_projection import solve as project

PAIR = np.array([[0, 1]])
TRIANGLE = np.array([[0, 1], [1, 2], [2, 0]])


def interior_points(step):
    return solve_with_clarabel(step.laplacian, step.force, step.friction, step.directions)


def random_problem(seed, directional, ratio=1e3):
    """Connected bodies with redundant links; ties, friction zero in places, loads beyond the domain."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 12))
    links = [(i, i + 1) for i in range(n - 1)] + [tuple(rng.choice(n, 2, replace=False)) for _ in range(n // 2)]
    ends = np.array(links)
    stiffness = np.exp(rng.uniform(0, np.log(ratio), len(ends)))
    tension = rng.normal(size=(len(ends), 2)) * np.exp(rng.uniform(-2, 2))
    directions, friction = DISC, np.exp(rng.uniform(-2, 2, (n, 1)))
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
    return Step(ends, stiffness, force, friction, directions)


@pytest.mark.parametrize("directional", [False, True])
def test_a_step_is_what_interior_points_find(directional):
    for seed in range(120):
        step = random_problem(seed, directional)
        velocity, unique = step.solve()
        reference = interior_points(step)
        least = step.cost(reference)
        scale = abs(least) + 1e-300
        assert step.cost(velocity) <= least + 1e-12 * scale, seed
        close = 1e-4 * (np.abs(step.force).max() + step.friction.max())
        assert np.abs(step.laplacian @ (velocity - reference)).max() <= close, seed
        if unique and scale > 1e-6:
            assert step.cost(velocity) >= least - 1e-6 * scale, seed


@pytest.mark.parametrize("directional", [False, True])
def test_stiffness_ratios_of_a_million_are_solved_to_rounding(directional):
    for seed in range(200):
        random_problem(seed, directional, 1e6).solve()


@pytest.mark.parametrize("directional", [False, True])
def test_long_bodies_are_solved_as_short_ones(directional):
    """Copies of a body, each tied to the next by a soft spring between contacts that a large friction holds."""
    for seed in range(20):
        short = random_problem(seed, directional)
        short.friction[0] = 1e6
        alone, unique = short.solve()
        n, copies = len(alone), 7
        starts = n * np.arange(copies)
        ends = np.concatenate((*(short.ends + start for start in starts), np.stack((starts[:-1], starts[1:]), 1)))
        stiffness = np.concatenate((np.tile(short.stiffness, copies), np.full(copies - 1, 1e-3)))
        mixed = np.random.default_rng(seed).permutation(copies * n)
        repeated = np.tile(short.force, (copies, 1))[mixed], np.tile(short.friction, (copies, 1))[mixed]
        velocity, also = Step(np.argsort(mixed)[ends], stiffness, *repeated, short.directions).solve()
        assert unique == also
        np.testing.assert_allclose(velocity, np.tile(alone, (copies, 1))[mixed], atol=1e-10 * np.abs(alone).max())


def test_small_loads_move_nothing_at_all():
    step = random_problem(1, False)
    small = 0.99 * step.force * step.friction.min() / np.hypot(*step.force.T).max()
    velocity, _ = step._replace(force=small).solve()
    assert not velocity.any()


def test_all_sliding_with_a_determined_translation():
    force = np.array([[10.0, 0.0], [-10.0, 0.0]])
    velocity, unique = Step(PAIR, np.ones(1), force, np.array([[1.0], [2.0]])).solve()
    assert unique
    np.testing.assert_allclose(velocity, [[9.0, 0.0], [0.0, 0.0]], atol=1e-14)  # only the weaker contact slides


def test_three_contacts_slide_about_a_weighted_median():
    """A stiff triangle that turns: the translation minimises the friction, and all slide."""
    rng = np.random.default_rng(0)
    shape = np.array([[8.0, 0.0], [-5.0, 6.0], [-4.0, -7.0]])
    friction = np.array([[1.0], [1.1], [1.2]])
    step = Step(TRIANGLE, np.ones(3), 3.0 * shape - shape.sum(0), friction)
    velocity, unique = step.solve()
    assert unique
    assert np.hypot(*velocity.T).min() > 1.0
    pull = friction * velocity / np.hypot(*velocity.T)[:, None]
    np.testing.assert_allclose(pull.sum(0), 0.0, atol=1e-12)
    best = step.resistance(velocity)
    for shift in rng.normal(size=(50, 2)):
        assert step.resistance(velocity + shift) >= best


@pytest.mark.parametrize(
    ("friction", "directions"),
    [(np.ones((2, 1)), DISC), (np.ones((2, 4)), CROSS), (np.zeros((2, 1)), DISC), (np.zeros((2, 4)), CROSS)],
)
def test_of_many_translations_the_nearest_to_zero(friction, directions):
    velocity, unique = Step(PAIR, np.ones(1), np.array([[6.0, 0.0], [-6.0, 0.0]]), friction, directions).solve()
    assert not unique
    slip = 6.0 - friction.max()
    np.testing.assert_allclose(velocity, [[0.5 * slip, 0.0], [-0.5 * slip, 0.0]], atol=1e-12)


def test_translations_that_contacts_at_corners_allow_are_the_common_part_of_their_cones():
    """Hexagons: one contact may slide between 60 and 120 degrees, the other between 120 and 180."""
    angle = np.radians(60.0 * np.arange(6))
    hexagon = np.stack((np.cos(angle), np.sin(angle)), 1)
    step = Step(PAIR, np.ones(1), np.zeros((2, 2)), np.ones((2, 6)), hexagon)
    moved = np.array([[0.0, 0.0], [-5.0, 2.0]])
    held = step.corners()[0, 1:3]
    velocity, unique = step._replace(force=step.laplacian @ moved + held).solve()
    assert not unique
    along = hexagon[1]  # the border of the first cone, on which the mean of both comes nearest to zero
    np.testing.assert_allclose(velocity, moved - (moved.mean(0) @ along) * along, atol=1e-12)


def test_frictionless_contacts_follow_the_others():
    force = np.array([[0.0, 0.5], [2.0, 1.0], [-2.0, -1.5]])
    step = Step(TRIANGLE[:2], np.ones(2), force, np.array([[3.0], [0.0], [0.0]]))
    velocity, unique = step.solve()
    assert unique
    assert not velocity[0].any()
    np.testing.assert_allclose((step.laplacian @ velocity)[1:], force[1:], atol=1e-13)


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
        friction, directions = forward[:, None], DISC
        if not isotropic:
            directions = CROSS
            friction = np.stack((forward, np.ones(n), backward, np.full(n, 2.0)), 1)
        velocity, _ = Step(ends, stiffness, force, friction, directions).solve()
        assert not velocity[:, 1].any()
        np.testing.assert_allclose(trial + stiffness * np.diff(velocity[:, 0]), tension, atol=1e-11)


@pytest.mark.parametrize("directional", [False, True])
@pytest.mark.parametrize(("length", "newton"), [(1e-9, 1e9), (1e9, 1e-9), (1e-9, 1.0), (1.0, 1e9)])
def test_units_scale_the_answer_and_nothing_else(directional, length, newton):
    for seed in range(20):
        step = random_problem(seed, directional)
        velocity, unique = step.solve()
        stiffness, force, friction = step.stiffness * newton / length, step.force * newton, step.friction * newton
        other, also = Step(step.ends, stiffness, force, friction, step.directions).solve()
        assert unique == also
        np.testing.assert_allclose(other / length, velocity, rtol=1e-9, atol=1e-10 * np.abs(velocity).max())


@pytest.mark.parametrize("directional", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_turned_or_mirrored_the_answer_turns_too(directional, mirrored):
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    for seed in range(40):
        step = random_problem(seed, directional)
        velocity, _ = step.solve()
        change = turn @ np.diag([1.0, -1.0]) if mirrored else turn
        order = slice(None, None, -1) if mirrored and directional else slice(None)  # keep it counterclockwise
        friction, directions = step.friction[:, order], (step.directions @ change.T)[order]
        other, _ = Step(step.ends, step.stiffness, step.force @ change.T, friction, directions).solve()
        np.testing.assert_allclose(other, velocity @ change.T, atol=1e-10 * (np.abs(velocity).max() + 1e-300))


def turning_gait(ramps=6):
    phase = 2 * np.pi * np.arange(1, ramps + 1)[:, None] / 6
    link = np.arange(3)
    along = 0.6 * np.cos(phase + 2.1 * link)[..., None] * np.stack((np.cos(2.1 * link), np.sin(2.1 * link)), -1)
    across = 0.3 * np.sin(1.3 * phase + link)[..., None] * np.stack((-np.sin(link), np.cos(link)), -1)
    return along + across


EQUAL_SIDES = (np.array([[0.1], [0.13], [0.2]]), DISC)
CROSSED = (np.array([[0.1, 0.21, 0.157, 0.2], [0.12, 0.2, 0.31, 0.1], [0.203, 0.25, 0.2, 0.26]]), CROSS)


@pytest.mark.parametrize(("friction", "directions"), [EQUAL_SIDES, CROSSED])
def test_error_and_energy_residual_follow_the_tolerance(friction, directions):
    fine = Rig(friction, directions).follow(turning_gait(), 1e-7)
    residuals = []
    for tolerance in (1e-3, 1e-4, 1e-5):
        body = Rig(friction, directions)
        records = body.follow(turning_gait(), tolerance)
        assert np.abs(records - fine)[:, :6].max() <= 6 * 2 * tolerance  # six ramps
        assert body.account[OVERSPENT] == 0
        assert body.account[VIOLATION] <= 1e-2 * tolerance
        residuals.append(abs(body.account[RESIDUAL]))
        assert residuals[-1] <= 6 * 2 * tolerance * 3 * friction.max()
    assert residuals[-1] < max(1e-1 * residuals[0], 1e-13)  # straight paths are exact
    assert body.account[DISSIPATION] > 0.1


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_straight_paths_are_divided_only_where_a_contact_starts_or_turns(tolerance):
    """Three ramps; on their way contacts start at five places, and one begins to slide across a corner of its polygon."""
    body = Rig(*CROSSED)
    body.follow(turning_gait(3), tolerance)
    assert body.account[EVENTS] == 3 + 5 + 1


def test_state_is_consistent_after_a_gait():
    body = Rig(*EQUAL_SIDES)
    records = body.follow(turning_gait(), 1e-4)
    state = body.state
    shape = np.diff(state.displacement[body.ends], axis=1)[:, 0]
    np.testing.assert_allclose(state.tension, body.stiffness[:, None] * (shape - state.actuation), atol=1e-14)
    np.testing.assert_array_equal(state.actuation, turning_gait()[-1])
    np.testing.assert_array_equal(records[-1, :6], state.displacement.ravel())
    np.testing.assert_allclose(state.gained, state.displacement, atol=1e-14)
    stored = 0.5 * np.sum(state.tension**2 / body.stiffness[:, None])
    balance = stored + body.account[DISSIPATION] - body.account[WORK]
    assert balance == pytest.approx(body.account[RESIDUAL], abs=1e-13)


def test_two_contacts_on_a_line_crawl_as_in_one_dimension():
    """Triangle wave of amplitude D: max(0, D - 2 min(mu) / k) a period."""
    for amplitude in (1.5, 3.0):
        friction = [[1.0, 9.0, 2.0, 9.0]] * 2
        body = Rig(friction, CROSS, PAIR, [1.0])
        up, down = [[amplitude, 0.0]], [[0.0, 0.0]]
        records = body.follow([up, down] * 3, 1e-6)[:, :4].reshape(-1, 2, 2)
        gain = (records[5] - records[3]).mean(0)
        np.testing.assert_allclose(gain, [max(0.0, amplitude - 2.0), 0.0], atol=1e-5)


def test_friction_goes_along_the_ramp():
    body = Rig([[1.0], [1.0]], DISC, PAIR, [1.0])
    body.follow([[[0.0, 0.8]]])
    assert not body.state.displacement.any()
    body.follow([[[0.0, 0.8]]], friction=[[0.5], [2.0]])
    np.testing.assert_allclose(body.state.displacement, [[0.0, -0.3], [0.0, 0.0]], atol=1e-9)
    np.testing.assert_array_equal(body.state.friction, [0.5, 2.0])


def test_critical_friction_is_told():
    body = Rig([[1.0], [1.0]], DISC, PAIR, [1.0])
    body.follow([[[5.0, 0.0]]])
    assert body.account[AMBIGUOUS] == 1.0
    np.testing.assert_allclose(body.state.displacement.sum(0), 0.0, atol=1e-12)


def test_unchanged_commands_cost_nothing_and_stuck_ramps_one_step():
    body = Rig(*EQUAL_SIDES)
    body.follow(np.zeros((5, 3, 2)))
    assert body.account[EVENTS] == 0
    body.follow(0.01 * turning_gait())
    assert body.account[EVENTS] == 6
    assert body.account[VIOLATION] == 0.0
    assert abs(body.account[RESIDUAL]) < 1e-16


def test_a_resting_body_never_creeps():
    body = Rig(*EQUAL_SIDES)
    cycle = turning_gait()
    body.follow(cycle, 1e-5)
    resting = cycle[-1] + 0.02 * np.array([np.zeros((3, 2)), cycle[0], cycle[1]])
    body.follow(np.tile(resting, (100, 1, 1)), 1e-5)  # it shakes down first
    before = body.state.copy()
    body.follow(np.tile(resting[[1, 2, 0]], (33_334, 1, 1)), 1e-5)
    body.follow(resting[[2]], 1e-5)
    np.testing.assert_array_equal(body.state.displacement, before.displacement)
    np.testing.assert_array_equal(body.state.tension, before.tension)


def test_far_from_home_the_motion_is_the_same():
    near, far = Rig(*EQUAL_SIDES), Rig(*EQUAL_SIDES, place=1e9)
    near.follow(turning_gait(), 1e-4)
    far.follow(turning_gait(), 1e-4)
    np.testing.assert_allclose(far.state.gained, near.state.gained, atol=1e-9)


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
        (QUARTERS, [1.0, 1.0, -1.0, 1.0], "-1 N in direction 2"),
        (QUARTERS, [1.0, 1.0, np.nan, 1.0], "nan N in direction 2"),
        (np.arange(8) * np.pi / 4, [1, 1, 1, 1.5, 1, 1, 1, 1], "not convex: contact 0 has 1.5 N in direction 3"),
    ],
)
def test_other_friction_is_refused_by_name(angles, values, message):
    with pytest.raises(SceneError, match=message) as error:
        check_directions(angles, values)
    assert "\n" not in str(error.value)


def test_no_force_and_no_friction_move_nothing():
    step = Step(TRIANGLE, np.ones(3), np.zeros((3, 2)), np.zeros((3, 1)))
    assert not interior_points(step).any()
    assert not step.solve()[0].any()


def test_all_may_be_at_their_bounds_and_yet_the_translation_is_determined():
    """Friction |v_x| + |v_y|: who slides along y keeps the others from any translation along x, and the other way."""
    step = Step(np.array([[0, 1], [1, 2], [2, 3]]), np.ones(3), np.zeros((4, 2)), np.ones((4, 4)), CROSS)
    moved = np.array([[1.0, 0.0], [0.0, -1.0], [0.0, 0.0], [-1.0, 0.0]])
    held = np.array([[1.0, 0.0], [-1.0, -1.0], [1.0, 0.0], [-1.0, 1.0]])
    velocity, unique = step._replace(force=step.laplacian @ moved + held).solve()
    assert unique
    np.testing.assert_allclose(velocity, moved, atol=1e-13)


@pytest.mark.parametrize("broken", [np.inf, np.nan])
def test_a_force_that_is_not_finite_is_not_solved(broken):
    force = np.array([[broken, 0.0], [-broken, 0.0], [0.0, 0.0]])
    for friction, directions in ((np.ones((3, 1)), DISC), (np.ones((3, 4)), CROSS)):
        assert not Step(TRIANGLE, np.ones(3), force, friction, directions).search()[0]


@pytest.mark.parametrize("directions", [DISC, CROSS], ids=["disc", "polygon"])
def test_loads_that_no_friction_holds_are_refused_and_change_nothing(directions):
    """Such commands are refused before they are followed; here only the motion is asked."""
    lengths, friction, pull = np.zeros((3, 2)), np.ones((3, max(len(directions), 1))), np.zeros((3, 2))
    motion = PlaneMotion(body_of(TRIANGLE, np.ones(3), 3), frame_of(TRIANGLE, np.ones(3), 3, directions), 1e-6)
    state = motion.start(np.zeros((3, 2)), np.concatenate((lengths.ravel(), friction.ravel(), pull.ravel())))
    before, account = state.bits(), np.zeros(ACCOUNT_SIZE)
    pull[:, 0] = 2.0
    target = np.concatenate((lengths.ravel(), friction.ravel(), pull.ravel()))
    with pytest.raises(
        CommandError, match=r"sum to \[6, 0\] N, 6 N at 0 degrees, .* direction with 3 N: no equilibrium"
    ):
        motion.follow(state, motion.scratch(), target[None], False, 0, account, np.zeros((0, 0)))
    assert state.bits() == before
