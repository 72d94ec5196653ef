"""Exact ramps of graphs: on every linear piece the springs, bounds and velocities fulfil the laws of friction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_model import Crawler, Scene
from crawler_model.motion.account import DISSIPATION, OVERSPENT, UNSOLVED, WORK, empty_account
from crawler_model.motion.follow import build_motion
from crawler_model.motion.pieces import FROM, HEADER, RAMP, UNTIL, follow_pieces

from ..hard_cases import chords, grid, ladder

Between = list[tuple[int, int]]


def trees(n: int) -> Between:
    """A tree whose contacts have up to ten springs, closed by some more."""
    rng = np.random.default_rng(n)
    return [(int(rng.integers(max(0, i // 5 - 1), i // 5 + 1)), i) for i in range(1, n)] + [(n // 2, n - 1)]


BODIES = {
    "ring": (300, [(i, (i + 1) % 300) for i in range(300)]),
    "ring with chords": (270, chords(270)),
    "ladder": (258, ladder(258)),
    "grid": (289, grid(17)),
    "small grid": (64, grid(8)),
    "tree": (280, trees(280)),
}


def random_scene(n: int, between: Between, rng: Any, whole: bool) -> tuple[Scene, np.ndarray]:
    """A body and its ramps; with whole numbers, contacts reach their bounds together."""
    draw = (lambda low, high, size: rng.integers(low, high, size) * 1.0) if whole else rng.uniform
    stiffness = draw(1, 4, len(between)) if whole else 10.0 ** draw(-1.5, 1.5, len(between))
    body = {"contacts": list(range(n)), "links": {"stiffness": stiffness.tolist(), "between": between}}
    friction = {"forward": draw(1, 3, n).tolist(), "backward": draw(1, 4, n).tolist()}
    scene = Scene.model_validate({"name": "random", "body": body, "friction": friction})
    start = scene.drive.targets[0]
    targets = np.repeat(start[None], 6, axis=0)
    targets[:, : len(between)] += draw(-2, 3, (6, len(between))) / (1.0 if whole else np.sqrt(stiffness))
    targets[3:, len(between) :] *= draw(1, 3, (3, 2 * n))
    return scene, targets


@pytest.mark.parametrize("whole", [False, True], ids=["any numbers", "whole numbers"])
@pytest.mark.parametrize("name", BODIES)
def test_every_piece_fulfils_the_laws_of_friction(name, whole):
    n, between = BODIES[name]
    rng = np.random.default_rng(n)
    scene, targets = random_scene(n, between, rng, whole)
    body, motion = scene.body, build_motion(scene)
    k, a, b = body.stiffness, *body.ends.T
    springs = k.size
    now = scene.drive.targets[0]
    state = motion.start(np.zeros(n), now)
    account = empty_account()
    tension, x = np.zeros(springs), np.zeros(n)
    for target in targets:
        tension[:] = state.tension
        x[:] = state.displacement
        begun, dissipated, work = account.copy(), 0.0, 0.0
        records = np.empty((1, 2 * n + springs))
        pieces = follow_pieces(motion, state, motion.scratch(), target[None], 10**9, account, records)
        assert account[OVERSPENT] == account[UNSOLVED] == 0
        assert (pieces[:, RAMP] == 0).all()
        assert (pieces[1:, FROM] == pieces[:-1, UNTIL]).all()
        assert (pieces[0, FROM], pieces[-1, UNTIL]) == (0.0, 1.0)
        change = target - now
        for piece in pieces:
            v, ds = piece[HEADER : HEADER + n], piece[UNTIL] - piece[FROM]
            rate = k * (v[b] - v[a] - change[:springs])
            for s, t in ((piece[FROM], tension), (piece[UNTIL], tension + ds * rate)):
                force = np.bincount(a, t, n) - np.bincount(b, t, n)
                forward, backward = (now + s * change)[springs:].reshape(2, n)
                close = 1e-11 * (1.0 + np.abs(tension).max() + np.abs(rate).max())
                assert (force <= forward + close).all()
                assert (force >= -backward - close).all()
                assert force[v > 0.0] == pytest.approx(forward[v > 0.0], abs=close)
                assert force[v < 0.0] == pytest.approx(-backward[v < 0.0], abs=close)
            middle = (now + 0.5 * (piece[FROM] + piece[UNTIL]) * change)[springs:].reshape(2, n)
            dissipated += ds * (np.maximum(v, 0.0) @ middle[0] - np.minimum(v, 0.0) @ middle[1])
            work -= ds * ((tension + 0.5 * ds * rate) @ change[:springs])
            tension += ds * rate
            x += ds * v
        assert state.displacement == pytest.approx(x, abs=1e-11 * (1.0 + np.abs(x).max()))
        assert state.tension == pytest.approx(tension, abs=close)
        assert account[DISSIPATION] - begun[DISSIPATION] == pytest.approx(dissipated, rel=1e-10)
        assert account[WORK] - begun[WORK] == pytest.approx(work, rel=1e-10, abs=1e-10 * dissipated)
        now = target
    assert len(pieces) > 20


def test_the_pieces_of_a_large_graph_are_those_of_its_halves():
    """Two equal grids, joined by a spring whose ends do not slide, follow the same path as each of them alone."""
    n, between = 225, grid(15)
    rng = np.random.default_rng(7)
    mu = rng.uniform(0.1, 0.3, (2, n))
    mu[:, 0] = 100.0
    length = rng.uniform(-0.3, 0.3, (5, len(between)))

    def crawler(copies: int) -> Crawler:
        pairs = [(i + c * n, j + c * n) for c in range(copies) for i, j in between] + [(0, n)] * (copies - 1)
        body = {"contacts": list(range(copies * n)), "links": {"stiffness": 1.0, "between": pairs}}
        friction = {"forward": np.tile(mu[0], copies).tolist(), "backward": np.tile(mu[1], copies).tolist()}
        return Crawler(Scene.model_validate({"name": "grids", "body": body, "friction": friction}), "exact")

    one, two = crawler(1), crawler(2)
    assert (one.visited_margin_sampled, two.visited_margin_sampled) == (False, True)
    for row in length:
        alone, both = one.advance(row), two.advance([*row, *row, 0.0])
        assert min(both.events, alone.events) > 50
        assert two.displacement == pytest.approx(np.tile(one.displacement, 2), abs=1e-12)
        assert both.dissipation == pytest.approx(2.0 * alone.dissipation, rel=1e-12)
