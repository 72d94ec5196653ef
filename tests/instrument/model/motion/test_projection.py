"""The projection of a path onto its stasis domain, against interior points, brute force and rational numbers."""

from __future__ import annotations

from itertools import product

import numpy as np
import osqp
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

from crawler_model.compiled import compiled
from crawler_model.motion.line.project import project
from crawler_model.motion.line.records import BLOCK, BREAK, RAMP, Model, zeros


@compiled
def solve_block(block, breaks, matrix, ramps):
    model = Model(breaks, block, matrix, matrix, breaks, matrix, None, None, None)
    project(model, ramps[0], block.shape[0] - 1)


def solve(target, stiffness, lower, upper):
    """The tensions of the projection, and the sides of the contacts: a row of the block is a contact and its spring."""
    n = target.size
    block = zeros(n + 2, BLOCK)
    block["spring"] = block["cluster"] = -1
    block["lower"][:-1], block["upper"][:-1] = lower, upper
    block["spring"][1:-1], block["trial"][1:-1], block["compliance"][1:-1] = range(n), target, 1.0 / stiffness
    solve_block(block, zeros(2 * n + 2, BREAK), np.zeros((1, 1)), zeros(1, RAMP))
    tension, after = np.empty(n), 0.0
    for i in range(n - 1, -1, -1):
        after = tension[i] = min(max(block["zero"][i + 1], after - upper[i + 1]), after - lower[i + 1])
    return tension, block["side"][:-1].copy()


def random_problem(seed: int, most: int = 12, infinite: bool = True):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, most))
    stiffness = np.exp(rng.uniform(-3, 3, n))
    target = rng.normal(size=n) * 5
    lower, upper = -np.exp(rng.uniform(-3, 1, n + 1)), np.exp(rng.uniform(-3, 1, n + 1))
    if infinite and rng.random() < 0.5:
        lower[rng.random(n + 1) < 0.4] = -np.inf
        upper[rng.random(n + 1) < 0.4] = np.inf
    return target, stiffness, lower, upper


def kkt_error(target, stiffness, lower, upper, tension) -> float:
    """Largest violation of the conditions that single out the minimiser, the multipliers being velocities."""
    force = np.diff(np.concatenate(([0.0], tension, [0.0])))
    size = np.abs(np.concatenate((tension, target))).max() + 1.0
    primal = max((lower - force).max(), (force - upper).max())
    rate = (tension - target) / stiffness
    velocity = np.concatenate(([0.0], np.cumsum(rate)))
    near = 1e-9 * size
    low, high = force <= lower + near, force >= upper - near
    # v_i + c >= 0 where at the upper bound only, <= 0 at the lower only, = 0 between
    need_least = np.max(np.where(~low, -velocity, -np.inf), initial=-np.inf)
    need_most = np.min(np.where(~high, -velocity, np.inf), initial=np.inf)
    speed = np.abs(velocity).max() + 1e-300
    return max(primal / size, (need_least - need_most) / speed if need_least > need_most else 0.0)


def brute_force(target, stiffness, lower, upper):
    """Try every set of bounds that hold with equality; keep the cheapest admissible minimiser."""
    n = target.size
    difference = np.eye(n + 1, n) - np.eye(n + 1, n, -1)
    best, cheapest = None, np.inf
    for sides in product((-1, 0, 1), repeat=n + 1):
        held = np.array(sides) != 0
        bound = np.where(np.array(sides) > 0, upper, lower)[held]
        if not np.isfinite(bound).all():
            continue
        rows = difference[held]
        system = np.block([[np.diag(1 / stiffness), rows.T], [rows, np.zeros((len(rows), len(rows)))]])
        answer = np.linalg.lstsq(system, np.concatenate((target / stiffness, bound)), rcond=None)[0][:n]
        force = difference @ answer
        if (np.abs(rows @ answer - bound) > 1e-9).any() or (force < lower - 1e-9).any() or (force > upper + 1e-9).any():
            continue
        cost = ((answer - target) ** 2 / (2 * stiffness)).sum()
        if cost < cheapest:
            best, cheapest = answer, cost
    return best


@given(st.integers(0, 2**32 - 1))
def test_satisfies_the_optimality_conditions(seed):
    problem = random_problem(seed, most=40)
    assert kkt_error(*problem, solve(*problem)[0]) < 1e-11


@pytest.mark.parametrize("seed", range(60))
def test_agrees_with_osqp(seed):
    target, stiffness, lower, upper = problem = random_problem(seed)
    n = target.size
    difference = sp.diags([np.ones(n), -np.ones(n)], [0, -1], shape=(n + 1, n)).tocsc()
    solver = osqp.OSQP()
    solver.setup(
        *(sp.diags(1 / stiffness).tocsc(), -target / stiffness, difference, lower, upper),
        **{"verbose": False, "eps_abs": 1e-11, "eps_rel": 1e-11, "max_iter": 400_000},
    )
    tension, _ = solve(*problem)
    assert np.abs(tension - solver.solve().x).max() < 1e-7 * (1 + np.abs(target).max())


@pytest.mark.parametrize("seed", range(60))
def test_agrees_with_brute_force(seed):
    problem = random_problem(seed, most=5)
    tension, _ = solve(*problem)
    assert tension == pytest.approx(brute_force(*problem), abs=1e-10)


@given(st.integers(0, 2**32 - 1))
def test_says_at_which_bound_each_contact_is(seed):
    target, _stiffness, lower, upper = problem = random_problem(seed)
    tension, side = solve(*problem)
    force = np.diff(np.concatenate(([0.0], tension, [0.0])))
    size = 1e-12 * (1 + np.abs(target).max())
    assert np.abs(force - upper)[side == 1].max(initial=0.0) < size
    assert np.abs(force - lower)[side == -1].max(initial=0.0) < size
    assert (upper - force)[side == 0].min(initial=1.0) > 0
    assert (force - lower)[side == 0].min(initial=1.0) > 0


def test_a_target_inside_stays_to_the_bit():
    rng = np.random.default_rng(1)
    target = rng.uniform(-0.1, 0.1, 9)
    tension, side = solve(target, np.ones(9), np.full(10, -1.0), np.full(10, 1.0))
    assert (tension == target).all()
    assert not side.any()


@pytest.mark.parametrize("ratio", [1e6, 1e12])
def test_stiffness_and_friction_ratios(ratio):
    for seed in range(50):
        rng = np.random.default_rng(seed)
        target, _, lower, upper = random_problem(seed, most=8, infinite=False)
        stiffness = rng.choice([1.0, ratio], target.size)
        scale = rng.choice([1.0, 1 / ratio], target.size + 1)
        tension, _ = solve(target, stiffness, lower * scale, upper * scale)
        force = np.diff(np.concatenate(([0.0], tension, [0.0])))
        size = np.abs(target).max()
        assert (lower * scale - force).max() < 1e-14 * size
        assert (force - upper * scale).max() < 1e-14 * size
        assert tension == pytest.approx(exact_projection(target, stiffness, lower * scale, upper * scale), abs=1e-9)


def exact_projection(target, stiffness, lower, upper):
    """The same dynamic program in rational arithmetic, by bisection over breakpoints kept in a plain list."""
    from fractions import Fraction

    a, k = [Fraction(v) for v in target], [Fraction(v) for v in stiffness]
    low, high = [Fraction(v) for v in lower], [Fraction(v) for v in upper]
    zeros = []
    # the derivative of the cost-to-come as points (position, value), straight between, steep at the ends
    points = [(low[0], Fraction(0)), (high[0], Fraction(0))]
    for i in range(len(a)):
        points = [(t, v + (t - a[i]) / k[i]) for t, v in points]
        if points[0][1] >= 0:
            zero = points[0][0]
        elif points[-1][1] <= 0:
            zero = points[-1][0]
        else:
            j = next(j for j in range(len(points) - 1) if points[j][1] <= 0 < points[j + 1][1])
            (t0, v0), (t1, v1) = points[j], points[j + 1]
            zero = t0 + (t1 - t0) * -v0 / (v1 - v0) if t1 > t0 else t0
        zeros.append(zero)
        left = [(t + low[i + 1], v) for t, v in points if t <= zero and v < 0]
        right = [(t + high[i + 1], v) for t, v in points if t >= zero and v > 0]
        points = [*left, (zero + low[i + 1], Fraction(0)), (zero + high[i + 1], Fraction(0)), *right]
    tension, after = [], Fraction(0)
    for i in range(len(a) - 1, -1, -1):
        after = min(max(zeros[i], after - high[i + 1]), after - low[i + 1])
        tension.append(float(after))
    return tension[::-1]


@pytest.mark.parametrize("n", [1, 10, 1_000, 100_000])
def test_a_load_that_alternates_and_grows(n):
    """The worst case known for the moving of breakpoints between the stacks."""
    i = np.arange(n)
    problem = (0.01 * (-1.0) ** i * i, np.ones(n), np.full(n + 1, -0.3), np.full(n + 1, 0.1))
    tension, _ = solve(*problem)
    force = np.diff(np.concatenate(([0.0], tension, [0.0])))
    assert force.min() >= -0.3 - 1e-9
    assert force.max() <= 0.1 + 1e-9
    if n <= 1_000:
        assert kkt_error(*problem, tension) < 1e-10
