"""Chains whose stiffness spans up to 24 decades, against rational arithmetic: right, or the certificate shows it."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model.motion.chain.projection import project, workspace
from crawler_model.motion.chain.wide import project_wide

from ..hard_cases import WIDE_CHAINS, follow_wide
from .test_chain_kernel import exact_projection, random_problem


def solve_wide(target, stiffness, lower, upper):
    n = target.size
    tension, side = np.empty(n), np.empty(n + 1, np.int8)
    project_wide(target, 1 / stiffness, -lower, upper, np.zeros(n + 1), tension, side)
    return tension, side


@pytest.mark.parametrize("case", range(len(WIDE_CHAINS)))
def test_every_displacement_is_right_or_flagged(case):
    error, rounding = follow_wide(WIDE_CHAINS[case])
    assert error <= max(1e-11, 30.0 * rounding)


def test_up_to_eight_decades_every_displacement_is_right():
    narrow = [case for case in WIDE_CHAINS if case["decades"] <= 8]
    assert len(narrow) >= 40
    assert max(follow_wide(case)[0] for case in narrow) < 1e-9


@pytest.mark.parametrize("decades", [0, 4, 8, 16])
def test_elongations_keep_their_digits_in_one_projection(decades):
    for seed in range(40):
        target, _, lower, upper = random_problem(seed, most=9, infinite=False)
        rng = np.random.default_rng(seed)
        stiffness = 2.0 ** np.round(rng.uniform(-0.5, 0.5, target.size) * decades * np.log2(10.0))
        target *= stiffness  # trial tensions are k dL
        tension, _ = solve_wide(target, stiffness, lower, upper)
        true = np.array(exact_projection(target, stiffness, lower, upper))
        scale = np.abs(target / stiffness) + np.abs(true / stiffness)
        assert (np.abs(tension - true) / stiffness).max() < 1e-14 * scale.max()


def test_both_projections_agree_where_stiffness_is_much_the_same():
    for seed in range(200):
        target, stiffness, lower, upper = random_problem(seed, most=40)
        n = target.size
        tension, side = np.empty(n), np.empty(n + 1, np.int8)
        project(target, 1 / stiffness, -lower, upper, np.zeros(n + 1), tension, side, workspace(n))
        other, other_side = solve_wide(target, stiffness, lower, upper)
        assert other == pytest.approx(tension, abs=1e-12 * np.abs(target).max())
        assert (side == other_side).all()
