"""Bodies whose springs form a graph: blocks that are paths, rings, implicit steps, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_model import Crawler, Scene, SceneError, load_scene
from crawler_model.motion.line import build_records

Between = list[tuple[int, int]]


def row(first: int, last: int) -> Between:
    return [(i, i + 1) for i in range(first, last)]


BODIES: dict[str, tuple[int, Between]] = {
    "triangle": (3, [*row(0, 2), (2, 0)]),
    "ring": (300, [*row(0, 299), (299, 0)]),
    "ring, springs in both directions": (60, [(b, a) if a % 3 else (a, b) for a, b in [*row(0, 59), (59, 0)]]),
    "ring with a tail": (280, [*row(0, 199), (199, 0), (100, 200), *row(200, 279)]),
    "three arms": (90, [*row(0, 30), (0, 31), *row(31, 60), (0, 61), *row(61, 89)]),
    "two rings": (80, [*row(0, 39), (39, 0), *row(40, 79), (79, 40), (5, 45)]),
}


def crawler(n: int, between: Between, stiffness: np.ndarray, friction: np.ndarray, copies: int) -> Crawler:
    """A body with each spring divided into equal ones side by side: two of them, and no contact has only two springs."""
    links = {
        "stiffness": np.repeat(stiffness / copies, copies).tolist(),
        "between": [pair for pair in between for _ in range(copies)],
    }
    body = {"contacts": list(range(n)), "links": links}
    mu = {"forward": friction[0].tolist(), "backward": friction[1].tolist()}
    return Crawler(Scene.model_validate({"name": "paths", "body": body, "friction": mu}), "exact")


def draws(kind: str, rng: Any, springs: int, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness, friction and targets; with whole numbers, contacts reach their bounds together."""
    if kind == "whole numbers":
        stiffness, friction = rng.integers(1, 4, springs) * 1.0, rng.integers(1, 4, (2, n)) * 1.0
        return stiffness, friction, rng.integers(-2, 3, (6, springs)) * 1.0
    decades = 4.0 if kind == "any stiffness" else 1.0
    stiffness, friction = 10.0 ** rng.uniform(-decades, decades, springs), rng.uniform(1.0, 3.0, (2, n))
    lengths = rng.uniform(-2.0, 2.0, (6, springs)) / np.sqrt(stiffness)
    if kind == "waves":
        stiffness = np.ones(springs)
        phases = 2.0 * np.pi * (3.0 * np.arange(springs) / springs - np.arange(6)[:, None] / 9.0)
        lengths = 0.25 * springs * np.sin(phases) * rng.uniform(0.9, 1.1, springs)
    return stiffness, friction, lengths


@pytest.mark.parametrize("kind", ["any numbers", "whole numbers", "any stiffness", "waves", "changing friction"])
@pytest.mark.parametrize("name", BODIES)
def test_paths_move_like_other_blocks(name, kind):
    n, between = BODIES[name]
    rng = np.random.default_rng(n)
    stiffness, friction, lengths = draws(kind, rng, len(between), n)
    one, two = (crawler(n, between, stiffness, friction, copies) for copies in (1, 2))
    events = 0
    for target in lengths:
        single, double = one.scene.drive.targets[0].copy(), two.scene.drive.targets[0].copy()
        single[: target.size], double[: 2 * target.size] = target, np.repeat(target, 2)
        if kind == "changing friction":
            bounds = (friction * rng.uniform(0.5, 2.0, friction.shape)).ravel()
            single[target.size :] = double[2 * target.size :] = bounds
        path, block = one.follow(single[None]), two.follow(double[None])
        events += path.events
        size = np.abs(one.displacement).max() + np.abs(target).max()
        assert one.displacement == pytest.approx(two.displacement, abs=1e-12 * size)
        tension = two.tension.reshape(-1, 2).sum(axis=1)
        assert one.tension == pytest.approx(tension, abs=1e-12 * (np.abs(tension) + stiffness * size).max())
        assert (path.unique, path.unsolved, path.overspent) == (block.unique, 0, 0)
        separated = 0.1 * block.events + 2.0 if kind == "whole numbers" else 0.0  # ties, by rounding
        assert abs(path.events - block.events) <= separated
        assert path.dissipation == pytest.approx(block.dissipation, rel=1e-11)
        assert path.work == pytest.approx(block.work, rel=1e-10, abs=1e-10 * block.dissipation)
        assert path.certificate.violation <= 1e-12 * np.abs(friction).max() + 1e-13 * np.abs(tension).max()
    assert events >= 6


def ring_scene(forward: Any, backward: Any, numbers: np.ndarray, stiffness: Any = 1.0) -> Scene:
    """A ring whose contacts have the given numbers, in their order around it."""
    body = {
        "contacts": list(range(numbers.size)),
        "links": {"stiffness": stiffness, "between": np.stack((numbers, np.roll(numbers, -1)), axis=1).tolist()},
    }
    return Scene.model_validate({"name": "ring", "body": body, "friction": {"forward": forward, "backward": backward}})


def test_waves_that_let_all_contacts_of_a_ring_slide_at_once_are_not_unique() -> None:
    n = 260
    row = 2.0 * np.sin(2 * np.pi * np.arange(n) / 20)
    row[-1] *= -1.0  # a link points to the contact with the larger number
    step = Crawler(ring_scene(0.1, 0.1, np.arange(n))).advance(row)
    assert not step.unique
    assert step.translation_interval == pytest.approx((-0.75, 0.75), abs=1e-12)


def test_square_waves_that_balance_friction_are_not_unique() -> None:
    n = 260
    row = np.where(np.arange(n) % 20 < 10, 1.0, -1.0)
    row[-1] *= -1.0
    crawler = Crawler(ring_scene(0.1, 0.3, np.arange(n)))
    crawler.advance(2.0 * row)
    step = crawler.advance(-3.0 * row)
    assert not step.unique
    assert step.visited_margin <= 1e-15


@pytest.mark.parametrize("method", ["exact", "catch_up"])
def test_a_ring_with_a_contact_that_never_slides_is_a_chain_between_two(method: str) -> None:
    """The chain is followed, where it is long, by another solver."""
    n = 90
    rng = np.random.default_rng(5)
    mu, stiffness = rng.uniform(0.1, 0.3, (2, n)), rng.uniform(0.5, 2.0, n)
    mu[:, 0] = 1000.0
    ring = Crawler(ring_scene(*mu.tolist(), np.arange(n), stiffness.tolist()), method)
    ends = np.append(np.arange(n), 0)
    body = {"contacts": list(range(n + 1)), "links": {"stiffness": stiffness.tolist()}}
    friction = {"forward": mu[0, ends].tolist(), "backward": mu[1, ends].tolist()}
    chain = Crawler(Scene.model_validate({"name": "chain", "body": body, "friction": friction}), method)
    for phase in np.arange(1, 9) / 8:
        row = 4.0 * np.sin(2.0 * np.pi * (np.arange(n) / 30 - phase)) + rng.uniform(-0.5, 0.5, n)
        one = chain.advance(row)
        row[-1] *= -1.0
        other = ring.advance(row)
        np.testing.assert_allclose(ring.displacement, chain.displacement[:-1], rtol=0, atol=1e-11)
        assert other.dissipation == pytest.approx(one.dissipation, rel=1e-11)
        assert other.unique == one.unique


@pytest.mark.parametrize("n", [60, 300])
def test_waves_far_beyond_friction_are_caught_up_in_one_step(n: int) -> None:
    """All contacts slide far, in both directions: the sides change from the start almost everywhere."""
    mid = np.arange(n) + 0.5
    crawler = Crawler(ring_scene(0.1, 0.3, np.arange(n)), "catch_up")
    for phase in np.arange(1, 17) / 16:
        row = 5.0 * np.sin(2.0 * np.pi * (phase - 5 * mid / n)) + 5.0 * np.sin(2.0 * np.pi * 5 * mid / n)
        row[-1] *= -1.0
        before, length = crawler.displacement, crawler.actuation
        step = crawler.advance(row)
        assert step.unsolved == 0
        assert step.certificate.violation <= 1e-12
        change = crawler.displacement - before
        force = crawler.spring_force
        assert force[change > 0.0] == pytest.approx(0.1, abs=1e-12)
        assert force[change < 0.0] == pytest.approx(-0.3, abs=1e-12)
        assert np.abs(crawler.actuation - length).max() > 1.0


def test_a_command_that_is_in_force_changes_nothing() -> None:
    crawler = Crawler(load_scene("three_springs"))
    crawler.advance([0.3, 0.0, -0.2])
    before = crawler.copy()
    step = crawler.advance([0.3, 0.0, -0.2])
    assert (crawler.displacement == before.displacement).all()
    assert (crawler.tension == before.tension).all()
    assert not crawler.gained.any()
    assert (step.events, step.work, step.dissipation) == (0, 0.0, 0.0)


def test_contacts_that_are_joined_too_widely_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build_records, "_MOST_NUMBERS", 8)
    body = {"contacts": [0, 1, 2], "links": {"stiffness": 1.0, "between": [[0, 1], [1, 2], [0, 2]]}}
    triangle = {"name": "t", "body": body, "friction": {"isotropic": 1.0}}
    assert Crawler(Scene.model_validate(triangle)).advance([0.0] * 3).unique
    monkeypatch.setattr(build_records, "_MOST_NUMBERS", 5)
    with pytest.raises(SceneError, match=r"the links of 3 contacts need a band matrix with 6.0e\+00 entries"):
        Crawler(Scene.model_validate(triangle | {"name": "other"}))
