"""The engine of bodies on a line against rational solutions, and under its laws."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crawler_model import Crawler, Scene
from crawler_model.body.body import Body
from crawler_model.motion.account import (
    AMBIGUOUS,
    DISSIPATION,
    GAIN_LEAST,
    GAIN_MOST,
    LOADS_WORK,
    OVERSPENT,
    RESIDUAL,
    UNSOLVED,
    VIOLATION,
    VISITED,
    WORK,
    empty_account,
)
from crawler_model.motion.line import build_records
from crawler_model.motion.line.motion import LineMotion

from ..chains import from_rows

CASES = json.loads((Path(__file__).parents[1] / "exact_cases.json").read_text())["cases"]
BUDGET = 10**9
SAME = (AMBIGUOUS, GAIN_LEAST, GAIN_MOST, VISITED, WORK, DISSIPATION, LOADS_WORK)


def follow(motion: Any, rows: np.ndarray, exact: bool = True, start: Any = None) -> tuple[np.ndarray, np.ndarray]:
    """Follow the ramps between rows; return the displacement after each and the account."""
    body = motion.body
    state = motion.start(np.zeros(body.contacts) if start is None else start, rows[0])
    account = empty_account()
    records = np.zeros((len(rows) - 1, 2 * body.contacts + body.springs))
    motion.follow(state, motion.scratch(), rows[1:], exact, BUDGET, account, records)
    assert not account[UNSOLVED]
    assert not account[OVERSPENT]
    return records[:, : body.contacts], account


def split(rows: np.ndarray, parts: int) -> np.ndarray:
    """Divide each ramp into equal parts."""
    between = [
        b if k == parts else a + (b - a) * (k / parts) for a, b in itertools.pairwise(rows) for k in range(1, parts + 1)
    ]
    return np.array([rows[0], *between])


def build_body(stiffness: Any, ends: Any) -> Body:
    count = int(np.max(ends)) + 1
    links = {"stiffness": np.asarray(stiffness, float).tolist(), "between": np.asarray(ends).tolist()}
    body = {"contacts": list(range(count)), "links": links}
    return Scene.model_validate({"name": "b", "body": body, "friction": {"isotropic": 1.0}}).body


def draw(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw a body and its ramps in quarters, so that events, bounds and zero friction coincide; some have loads."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    ends = [(i, i + 1) for i in range(n - 1)]
    if n > 2 and rng.random() < 0.5:
        ends += [(a, b) for a in range(n) for b in range(a + 2, n) if rng.random() < 0.4]
    stiffness = rng.integers(1, 17, len(ends)) / 4.0
    count, least = int(rng.integers(2, 6)), int(seed % 3 == 0)
    lengths = rng.integers(-12, 13, (count, len(ends))) / 4.0
    lengths[0] = 0.0
    friction = rng.integers(least, 9, (count, 2 * n)) / 4.0
    if seed % 2 == 0:
        friction[:] = friction[0]
    rows = np.hstack((lengths, friction))
    if seed % 5 == 0:
        loads = rng.integers(-4, 5, (count, n)) / 8.0
        friction = friction + 1.0 + np.hstack((-loads, loads))
        rows = np.hstack((lengths, friction, loads))
    return np.array(ends), stiffness, rows


@pytest.fixture(scope="module")
def drawn() -> list[tuple[Body, np.ndarray]]:
    bodies = []
    for seed in range(240):
        ends, stiffness, rows = draw(seed)
        bodies.append((build_body(stiffness, ends), rows))
    return bodies


@pytest.mark.parametrize("parts", [1, 3, 7])
def test_rational_solutions_are_met_to_rounding(parts: int) -> None:
    for case in CASES:
        scene = Scene.model_validate(case["scene"])
        rows = split(scene.drive.targets, parts)
        x, account = follow(LineMotion(scene.body), rows, start=scene.start_displacement)
        assert np.abs(x[parts - 1 :: parts] - np.array(case["displacement"])[1:]).max() < 1e-13, scene.name
        assert abs(account[RESIDUAL]) < 1e-13 * account[WORK]
        assert not account[AMBIGUOUS]


def test_motion_account_and_interval_do_not_depend_on_which_contacts_sleep(
    drawn: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    ambiguous = 0
    for number, (body, rows) in enumerate(drawn):
        if body.is_chain:
            monkeypatch.setattr(build_records, "LONG", 10**9)
            expected, other = follow(LineMotion(body), rows)
            for name, value in (("LONG", 2), ("LEAF_SIZE", 2), ("SHORTEST_BLOCK", 2)):
                monkeypatch.setattr(build_records, name, value)
            x, account = follow(LineMotion(body), rows)
            np.testing.assert_allclose(x, expected, rtol=0, atol=1e-13, err_msg=str(number))
            np.testing.assert_allclose(account[[*SAME]], other[[*SAME]], rtol=1e-12, atol=1e-13, err_msg=str(number))
            ambiguous += int(account[AMBIGUOUS])
    assert ambiguous > 5


def test_a_ramp_in_parts_is_the_ramp(drawn: Any) -> None:
    for number, (body, rows) in enumerate(drawn):
        whole, account = follow(LineMotion(body), rows)
        if not account[AMBIGUOUS]:
            parts, _ = follow(LineMotion(body), split(rows, 4))
            np.testing.assert_allclose(parts[3::4], whole, rtol=0, atol=1e-13, err_msg=str(number))


def test_neither_numbering_nor_direction_matters(drawn: Any) -> None:
    rng = np.random.default_rng(0)
    for number, (body, rows) in enumerate(drawn):
        n, springs = body.contacts, body.springs
        x, account = follow(LineMotion(body), rows)
        if account[AMBIGUOUS]:
            continue
        order = rng.permutation(n)  # of the same contacts
        place = np.argsort(order)
        ends = place[body.ends]
        renamed = build_body(body.stiffness, np.sort(ends, axis=1))
        moved = rows.copy()
        moved[:, :springs] *= np.where(ends[:, 0] < ends[:, 1], 1.0, -1.0)  # a spring points to the later contact
        for first in range(springs, rows.shape[1], n):
            moved[:, first : first + n] = rows[:, first + order]
        other, _ = follow(LineMotion(renamed), moved)
        np.testing.assert_allclose(other[:, place], x, rtol=0, atol=1e-13, err_msg=str(number))
        mirror = build_body(body.stiffness, body.ends)
        turned = rows.copy()
        turned[:, :springs] *= -1.0
        turned[:, springs : springs + n] = rows[:, springs + n : springs + 2 * n]
        turned[:, springs + n : springs + 2 * n] = rows[:, springs : springs + n]
        turned[:, springs + 2 * n :] *= -1.0
        other, _ = follow(LineMotion(mirror), turned)
        np.testing.assert_allclose(other, -x, rtol=0, atol=1e-13, err_msg=str(number))


def test_a_critical_chain_is_followed_to_the_same_place_in_one_ramp_and_in_three() -> None:
    """In one ramp version 0.1.0 was 2.8 m off, and called it unique."""
    stiffness = [2, 4, 4, 2, 1, 4, 1, 4]
    forward = [0.375, 0.125, 0.5, 0.625, 0.25, 0.875, 0.375, 1, 0.5]
    backward = [0.5, 0.75, 0.75, 0.5, 0.125, 0.75, 1, 0.75, 0.375]
    lengths = [[0] * 8, [-1, -9, 1, 7, -1, -8, 9, -7], [-4, -6, -4, -2, -3, 2, -1, -5]]
    rows = np.array([[*length, *forward, *backward] for length in lengths], float)
    body = build_body(stiffness, [(i, i + 1) for i in range(8)])
    whole, account = follow(LineMotion(body), rows)
    parts, account_of_parts = follow(LineMotion(body), split(rows, 3))
    np.testing.assert_allclose(parts[2::3], whole, rtol=0, atol=1e-12)
    assert account[AMBIGUOUS]
    assert account_of_parts[AMBIGUOUS]
    assert abs(account[RESIDUAL]) < 1e-13


@pytest.mark.parametrize("seeds", [(2249, 2527, 8188, 16332, 19275), range(300)])
def test_friction_that_is_critical_to_the_last_digit_balances(seeds: Any) -> None:
    """The first seeds let contacts begin to leave their bounds as the translation is chosen that holds them there."""
    for seed in seeds:
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 8))
        back, unit = int(rng.integers(1, n)), rng.choice([0.1, 0.2, 0.3, 0.05, 1.0, 0.7])
        friction = np.array([unit * (n - back), unit * back])
        if rng.random() < 0.3:
            friction = friction.round(3)
        k, scale = float(rng.choice([2.0, 20.0, 5.0, 13.0])), float(rng.choice([0.05, 0.1, 0.3]))
        lengths = [np.zeros(n - 1)]
        for _ in range(int(rng.integers(2, 7))):
            length = rng.choice([0, 0.3, 0.5, 1.0, 1.0, 0.0], size=n - 1) * scale * 5 * unit * n / k
            nearly = rng.choice([0, 0, 1, -1], size=n - 1) * 2.0 ** -rng.integers(10, 45, size=n - 1)
            lengths.append(length + nearly * scale)
        cycle = [*lengths[1:], lengths[1]] if rng.random() < 0.5 else [*lengths[:-1], lengths[0]]
        rows = np.array([[*length, *np.repeat(friction, n)] for length in [cycle[0], *3 * cycle[1:]]])
        body = build_body([k] * (n - 1), [(i, i + 1) for i in range(n - 1)])
        _, account = follow(LineMotion(body), rows, start=np.append(0.0, cycle[0].cumsum()))
        assert account[VIOLATION] <= 1e-9 * friction.max(), seed
        assert abs(account[RESIDUAL]) <= 1e-9 * friction.max(), seed


def test_sliding_that_spreads_from_both_ends_by_one_contact_a_round_is_no_cycle() -> None:
    """A body of equal parts, stretched and released: one implicit step each."""
    n = 35
    body = build_body([34.0] * (n - 1), [(i, i + 1) for i in range(n - 1)])
    friction = [0.0015] + [0.003] * (n - 2) + [0.0015] + [0.0045] + [0.009] * (n - 2) + [0.0045]
    rows = np.array([[length] * (n - 1) + friction for length in (0.0, 0.006, 0.0, 0.006)])
    x, account = follow(LineMotion(body), rows, exact=False)
    assert account[UNSOLVED] == 0.0
    assert account[VIOLATION] <= 1e-14
    for (before, after), row in zip(itertools.pairwise(x), rows[2:], strict=True):
        tension = 34.0 * (np.diff(after) - row[: n - 1])
        force = np.diff(tension, prepend=0.0, append=0.0)
        moved = after - before
        np.testing.assert_allclose(force[moved > 1e-12], row[n - 1 : 2 * n - 1][moved > 1e-12], rtol=0, atol=1e-14)
        np.testing.assert_allclose(force[moved < -1e-12], -row[2 * n - 1 :][moved < -1e-12], rtol=0, atol=1e-14)
    assert np.abs(x).max() > 0.01


@pytest.mark.parametrize("first", [100, 200])
def test_a_contact_that_only_rounding_moves_has_not_slid(first: int) -> None:
    """Ties of numbers that are no floats: bounds are reached together, but for rounding."""
    for seed in range(first, first + 100):
        rng = np.random.default_rng(seed)
        n, parts = int(rng.integers(2, 8)), float(rng.choice([3, 5, 7, 10]))
        stiffness, forward, backward = (rng.integers(1, 5, size) / parts for size in (n - 1, n, n))
        lengths = np.vstack((np.zeros(n - 1), rng.integers(-9, 10, (8, n - 1)) / parts))
        factors = (
            np.vstack((np.ones((1, 2, n)), rng.integers(1, 5, (8, 2, n)) / parts)) if seed % 2 else np.ones((9, 2, n))
        )
        crawler = Crawler(from_rows(stiffness, lengths, forward * factors[:, 0], backward * factors[:, 1]))
        for target in crawler.scene.drive.targets[1:]:
            step = crawler.follow(target[None].copy())
            moved = np.abs(step.velocity)
            assert (moved[crawler.contact_state != 0] > 1e-9).all(), seed
            assert (moved[crawler.contact_state == 0] == 0.0).all()
