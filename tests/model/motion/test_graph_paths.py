"""Blocks of a graph that are paths: they move as if each contact had more than two springs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_model import Crawler, Scene

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
