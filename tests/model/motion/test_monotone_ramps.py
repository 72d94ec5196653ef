"""Ramps on which no contact turns round are followed by implicit steps; the path is that of events."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Crawler, Scene
from crawler_model.motion.chain import memory
from crawler_model.motion.translation import FEW_CONTACTS

from ..long_chains import assert_same, chain, follow


def drawn(seed: int) -> tuple[Scene, list[np.ndarray]]:
    """A random chain on which a few ramps push contacts in the directions in which they move, and others do not."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(FEW_CONTACTS + 1, 500))
    stiffness, (forward, backward) = np.ones(n - 1), np.exp(rng.uniform(-1, 0, (2, n)))
    if seed % 2:
        stiffness = np.sort(np.exp(rng.uniform(-1, 1, n - 1)))
    if seed % 4 == 0:
        forward[:], backward[:] = 0.1, 0.3
    if seed % 5 == 1:
        forward[rng.integers(0, n, 20)] *= 1e-3
    place = np.arange(n - 1) / n
    rows = [np.zeros(n - 1)]
    for k in range(6):
        row = rows[-1].copy()
        kind = (seed // 2 + k) % 5
        if kind == 0:
            row += rng.normal() * 10.0 ** rng.uniform(0, 2)
        elif kind == 1:
            row[rng.integers(0, n - 1)] += rng.normal() * 10.0 ** rng.uniform(0, 3)
        elif kind == 2:
            row += np.where(place < rng.random(), 1.0, rng.normal()) * rng.uniform(-20, 20)
        elif kind == 3:
            row += np.sin(2 * np.pi * (place * rng.uniform(0.2, 2) + rng.random())) * rng.uniform(1, 10)
        else:
            row += rng.normal(size=n - 1) * 0.1
        rows.append(row)
    return chain(stiffness, forward, backward, np.full(n, 0.02) if seed % 3 == 0 and seed % 5 != 1 else None), rows[1:]


def count_without_events(scene: Scene, rows: list[np.ndarray]) -> int:
    """Count the ramps with more than two arrivals that are followed although no work at events is allowed."""
    crawler = Crawler(scene)
    count = 0
    for row in rows:
        idle = crawler.copy()
        idle.budget = 0
        step = idle.advance(row)
        count += step.overspent == 0 and step.events > 2
        crawler.advance(row)
    return count


@pytest.mark.parametrize("seed", range(20))
def test_random_chains_move_as_from_event_to_event(seed, monkeypatch):
    assert assert_same(*drawn(seed), monkeypatch, visits=memory.VISITS_BEFORE) > 4


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20, 500))
def test_many_random_chains_move_as_from_event_to_event(seed, monkeypatch):
    assert_same(*drawn(seed), monkeypatch, visits=memory.VISITS_BEFORE)


def test_some_ramps_of_the_random_chains_need_no_events():
    found = [count_without_events(*drawn(seed)) for seed in range(20)]
    assert sum(found) > 10
    assert sum(found) < 100  # nor are all of this kind


def uniform(n: int, forward: float = 0.1, backward: float = 0.3, stiffness: float = 1.0) -> Scene:
    return chain(np.full(n - 1, stiffness), np.full(n, forward), np.full(n, backward))


@pytest.mark.parametrize("change", [0.5, 3.0, 40.0, 1e3])
def test_a_stretched_body_needs_no_events(change, monkeypatch):
    """Neither if its ends slide alone, nor if all contacts but one slide at the end of a ramp."""
    n = 302
    rows = [np.full(n - 1, part * change) for part in (1.0, 0.0, 2.0, -1.0)]
    assert count_without_events(uniform(n), rows) == len(rows)
    assert assert_same(uniform(n), rows, monkeypatch) > 2 * len(rows)


def test_a_body_whose_contacts_all_slide_is_followed_by_events(monkeypatch):
    """With isotropic friction and an even number of contacts, the translation is not unique in the end."""
    n = 300
    scene = uniform(n, backward=0.1)
    assert count_without_events(scene, [np.full(n - 1, 40.0)]) == 0
    step = follow(scene, [np.full(n - 1, 40.0)], 32, monkeypatch)[0][2]
    assert not step.unique
    assert step.visited_margin == pytest.approx(0.0, abs=1e-12)


def test_a_weak_contact_that_is_dragged_and_returns_is_followed_by_events(monkeypatch):
    """It is pushed one way by one neighbour, before the other neighbour pushes it back."""
    n = 301
    forward, backward = np.full(n, 0.1), np.full(n, 0.1)
    forward[150] = backward[150] = 1e-3
    backward[:140] = 0.099
    scene = chain(np.ones(n - 1), forward, backward)
    rows = [np.full(n - 1, 40.0), np.zeros(n - 1)]
    assert_same(scene, rows, monkeypatch)


def test_the_account_of_a_stretched_body_is_that_of_events(monkeypatch):
    n = 300
    rows = [np.full(n - 1, 3.0), np.zeros(n - 1)]
    steps = [step for _, _, step in follow(uniform(n), rows, 32, monkeypatch)]
    events = [step for _, _, step in follow(uniform(n), rows, 10**9, monkeypatch)]
    for one, other in zip(steps, events, strict=True):
        assert one.events >= other.events  # simultaneous arrivals are counted one by one
        assert one.unique
        assert one.visited_margin == pytest.approx(other.visited_margin, rel=1e-12)
