"""Long blocks pass around a ring without touching their contacts; the path is that of short blocks.

The rows of a drive are rest lengths, or rest lengths, forward and backward friction.
"""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Crawler, Scene
from crawler_model.motion.chain import memory
from crawler_model.motion.graph import ring

from ..long_chains import NEVER, Row, assert_same, follow


def ring_scene(stiffness: np.ndarray, forward: np.ndarray, backward: np.ndarray, numbers: np.ndarray) -> Scene:
    """A ring whose contacts have the given numbers, in their order around it."""
    n = numbers.size
    between = np.stack((numbers, np.roll(numbers, -1)), axis=1).tolist()
    body = {"contacts": list(range(n)), "links": {"stiffness": stiffness.tolist(), "between": between}}
    friction = {"forward": forward.tolist(), "backward": backward.tolist()}
    return Scene.model_validate({"name": "ring", "body": body, "friction": friction})


def drawn(seed: int) -> tuple[Scene, list[Row]]:
    """A random ring of 260 to 400 contacts, driven by waves, noise, or stretch of a part, sometimes with waves of friction."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(260, 400))
    numbers = rng.permutation(n) if seed % 4 else np.arange(n)
    stiffness, (forward, backward) = np.exp(rng.uniform(-1, 1, n)), np.exp(rng.uniform(-2, 0, (2, n)))
    if seed % 2:
        stiffness[:], forward[:], backward[:] = 1.0, 0.1, 0.3
    place = np.arange(n) / n
    way = np.where(numbers < np.roll(numbers, -1), 1.0, -1.0)  # a link points to the contact with the larger number
    rows: list[Row] = []
    for _ in range(4):
        if seed % 3 == 0:
            row = np.sin(2 * np.pi * (place * rng.integers(1, 4) + rng.random())) * rng.uniform(0.2, 3)
        elif seed % 3 == 1:
            row = rng.normal(size=n) * 2
        else:
            row = np.where(place < rng.random(), 1.0, -1.0) * rng.uniform(-3, 3) + rng.normal(size=n) * 0.3 * (
                seed % 4 > 1
            )
        if seed % 5 > 2:
            wave = np.sin(2 * np.pi * (place * rng.integers(1, 8) + rng.random()))
            rows.append((way * row, forward * (1.0 + 0.9 * wave), backward * (1.0 - 0.9 * wave)))
        else:
            rows.append(way * row)
    return ring_scene(stiffness, forward, backward, numbers), rows


def waves(n: int) -> tuple[Scene, list[Row]]:
    """Five waves on a ring, on which few contacts are at rest at a time, and at the end none."""
    stiffness = np.full(n, 9e4)
    stiffness[:2] = 4.0, 1.0
    place = np.arange(n) / n
    rows: list[Row] = [np.sin(2 * np.pi * (5 * place - t / 16)) / n for t in range(12)]
    for row in rows:
        row[-1] *= -1.0
    return ring_scene(stiffness, np.full(n, 0.1 / n), np.full(n, 0.3 / n), np.arange(n)), rows


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("visits", [0.0, memory.VISITS_BEFORE])
def test_random_rings_move_as_with_short_blocks(seed, visits, monkeypatch):
    """Long blocks that begin with the ramp, and those that begin in the middle of one."""
    assert_same(*drawn(seed), monkeypatch, visits=visits)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20, 500))
def test_many_random_rings_move_as_with_short_blocks(seed, monkeypatch):
    assert_same(*drawn(seed), monkeypatch)


@pytest.mark.parametrize("seed", range(20))
def test_catch_up_steps_of_rings_do_not_depend_on_where_the_search_begins(seed, monkeypatch):
    scene, rows = drawn(seed)
    found = []
    for shortest in (NEVER, 8):  # of a ring that is too short for long blocks, all contacts are searched from rest
        monkeypatch.setattr(memory, "SHORTEST_LONG", shortest)
        crawler = Crawler(scene, "catch_up")
        steps = [crawler.advance(*(row if isinstance(row, tuple) else (row,))) for row in rows]
        found.append((crawler.displacement, np.array([step.dissipation for step in steps])))
    (x, lost), (other_x, other_lost) = found
    np.testing.assert_allclose(other_x, x, rtol=0, atol=1e-12 * max(1.0, np.abs(x).max()))
    np.testing.assert_allclose(other_lost, lost, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("n", [300, pytest.param(3_000, marks=pytest.mark.slow)])
def test_waves_on_stiff_rings_move_as_with_short_blocks(n, monkeypatch):
    """The stiffness spans almost five decades: tensions follow from displacements, so they are only known to 1e-11."""
    scene, rows = waves(n)
    assert_same(scene, rows, monkeypatch, 1e-9)
    short, long = (follow(scene, rows, shortest, monkeypatch) for shortest in (NEVER, 8))
    for (_, _, one), (_, _, other) in zip(short, long, strict=True):
        assert other.unique == one.unique


def test_long_blocks_of_a_ring_take_fewer_visits_than_short_ones(monkeypatch):
    """A budget that short blocks exceed, because they solve a whole block at each event, is enough for long ones."""
    n = 1_000
    scene, rows = waves(n)
    budget = 30 * n
    assert sum(step.overspent for _, _, step in follow(scene, rows[:1], NEVER, monkeypatch, budget=budget)) == 1
    assert sum(step.overspent for _, _, step in follow(scene, rows[:1], 128, monkeypatch, budget=budget)) == 0


def test_a_spent_budget_leaves_forces_within_bounds(monkeypatch):
    n = 300
    scene = ring_scene(np.ones(n), np.full(n, 0.1), np.full(n, 0.3), np.arange(n))
    row = np.random.default_rng(1).normal(size=n) * 5.0
    _, tension, step = follow(scene, [row], 8, monkeypatch, budget=2_000)[0]
    assert step.overspent == 1
    ends = Crawler(scene).body.ends
    force = np.bincount(ends[:, 0], tension, n) - np.bincount(ends[:, 1], tension, n)
    assert force.max() <= 0.1 + 1e-12
    assert force.min() >= -0.3 - 1e-12


@pytest.mark.parametrize(("load", "end"), [(0.05, 0.05), (0.0, 0.08)])
def test_loads_on_a_ring_do_the_same_work_as_with_short_blocks(load, end, monkeypatch):
    """Loads that stay do work in long blocks, too; loads that change are left to short ones."""
    n = 260
    scene = ring_scene(np.ones(n), np.full(n, 0.1), np.full(n, 0.3), np.arange(n))
    scene = Scene.model_validate(scene.document() | {"loads": [load] * n})
    row = np.sin(2 * np.pi * 3 * np.arange(n) / n)
    row[-1] *= -1.0
    steps = []
    for shortest in (NEVER, 8):
        monkeypatch.setattr(memory, "SHORTEST_LONG", shortest)
        monkeypatch.setattr(memory, "VISITS_BEFORE", 0.0)
        steps.append(Crawler(scene).advance(row, loads=[end] * n))
    short, long = steps
    assert short.loads_work > 1.0
    assert long.loads_work == pytest.approx(short.loads_work, rel=1e-12)
    assert long.dissipation == pytest.approx(short.dissipation, rel=1e-12)


def test_waves_that_let_all_contacts_slide_at_once_are_not_unique(monkeypatch):
    """Rounding separates contacts that reach their bounds at the same instant: some seem to rest, exactly at a bound."""
    n = 260
    scene = ring_scene(np.ones(n), np.full(n, 0.1), np.full(n, 0.1), np.arange(n))
    row = 2.0 * np.sin(2 * np.pi * np.arange(n) / 20)
    row[-1] *= -1.0
    for shortest in (NEVER, 8):
        _, _, step = follow(scene, [row], shortest, monkeypatch)[0]
        assert not step.unique
        assert step.translation_interval == pytest.approx((-0.75, 0.75), abs=1e-12)


def test_square_waves_that_balance_friction_are_not_unique(monkeypatch):
    n = 260
    scene = ring_scene(np.ones(n), np.full(n, 0.1), np.full(n, 0.3), np.arange(n))
    row = np.where(np.arange(n) % 20 < 10, 1.0, -1.0)
    row[-1] *= -1.0
    steps = [step for _, _, step in follow(scene, [2.0 * row, -3.0 * row], 8, monkeypatch)]
    assert not steps[1].unique
    assert steps[1].visited_margin <= 1e-15


def test_the_order_around_a_ring_follows_its_springs():
    numbers = np.random.default_rng(2).permutation(300)
    ends = np.stack((numbers, np.roll(numbers, -1)), axis=1)
    ends[::3] = ends[::3, ::-1]
    found = ring.memory(ends, 300)
    assert found is not None
    assert sorted(found.order) == list(range(300))
    for i, j, spring in zip(found.order, np.roll(found.order, -1), found.joints, strict=True):
        assert set(ends[spring]) == {i, j}


def test_other_bodies_have_no_order_around_a_ring():
    chain = np.stack((np.arange(299), np.arange(1, 300)), axis=1)
    tailed = np.concatenate((chain, [[298, 0]]))  # contact 299 has one spring
    short = np.stack((np.arange(200), np.roll(np.arange(200), -1)), axis=1)
    assert ring.memory(chain, 300) is None
    assert ring.memory(tailed, 300) is None
    assert ring.memory(short, 200) is None
