"""Contacts of long sliding blocks sleep in runs; they move as contacts that are awake.

The rows of a drive are rest lengths, or rest lengths, forward and backward friction.
"""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Crawler, Scene, load_scene, simulate
from crawler_model.body.drive import NS
from crawler_model.motion.line.build_records import LEAF_SIZE

from ....scenes import wave_scene
from ..long_chains import NEVER, Row, assert_same, chain, follow

FRICTION = {"forward": 0.1, "backward": 0.3}
RING = [["s.to", 0], ["s.from", 0]]


def drawn(seed: int) -> tuple[Scene, list[np.ndarray]]:
    """A random chain of 40 to 300 contacts, driven by waves, noise or stretch; half of them are uniform."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(40, 300))
    stiffness, (forward, backward) = np.exp(rng.uniform(-1, 1, n - 1)), np.exp(rng.uniform(-2, 0, (2, n)))
    if seed % 2:
        stiffness[:], forward[:], backward[:] = 1.0, 0.1, 0.3
    place = np.arange(n - 1) / n
    rows = []
    for _ in range(4):
        if seed % 3 == 0:
            rows.append(np.sin(2 * np.pi * (place * rng.integers(1, 4) + rng.random())) * rng.uniform(0.2, 3))
        elif seed % 3 == 1:
            rows.append(rng.normal(size=n - 1) * 2)
        else:
            rows.append(np.full(n - 1, rng.uniform(-3, 3)) + rng.normal(size=n - 1) * 0.3 * (seed % 4 > 1))
    return chain(stiffness, forward, backward, np.full(n, 0.02) if seed % 5 == 0 else None), rows


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("leaf_size", [2, LEAF_SIZE])
def test_random_chains_move_as_if_awake(seed, leaf_size, monkeypatch):
    assert assert_same(*drawn(seed), monkeypatch, leaf_size=leaf_size) > 4


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(30, 1_000))
def test_many_random_chains_move_as_if_awake(seed, monkeypatch):
    assert_same(*drawn(seed), monkeypatch)


def drawn_with_friction(seed: int) -> tuple[Scene, list[Row]]:
    """A random chain whose friction changes on each ramp: by waves, by noise, or of a few contacts alone."""
    scene, rows = drawn(seed)
    rng = np.random.default_rng(1_000 + seed)
    n = rows[0].size + 1
    commanded: list[Row] = []
    for k, row in enumerate(rows):
        forward, backward = np.exp(rng.uniform(-1, 0, 2))[:, None] * np.ones((2, n)) * (0.2 if seed % 2 else 1.0)
        if seed % 4 == 0:
            wave = np.sin(2 * np.pi * (np.arange(n) * rng.integers(1, 8) / n + rng.random()))
            forward, backward = forward * (1.0 + 0.9 * wave), backward * (1.0 - 0.9 * wave)
        elif seed % 4 == 1:
            forward, backward = forward * rng.uniform(0.1, 1, n), backward * rng.uniform(0.1, 1, n)
        elif seed % 4 == 2:
            forward[rng.integers(0, n, 3)] *= 5.0
        commanded.append((row if k % 3 else 0.1 * row, forward, backward))
    return scene, commanded


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("leaf_size", [2, LEAF_SIZE])
def test_commanded_friction_moves_runs_as_contacts(seed, leaf_size, monkeypatch):
    assert assert_same(*drawn_with_friction(seed), monkeypatch, leaf_size=leaf_size) > 4


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(30, 1_000))
def test_commanded_friction_moves_many_runs_as_contacts(seed, monkeypatch):
    assert_same(*drawn_with_friction(seed), monkeypatch)


def hard(name: str, n: int) -> list[np.ndarray]:
    """Rows of commands under which long blocks grow, split, and meet many ties."""
    i = np.arange(n - 1)
    zero = np.zeros(n - 1)
    if name == "five waves":
        return [np.sin(2 * np.pi * (5 * i / n - t / 16)) for t in range(20)]
    if name == "stretched a little":
        return [zero + 2e-4, zero, zero + 2e-4]
    if name == "stretched a lot":
        return [zero + 0.5, zero - 0.5, zero + 0.1]
    if name == "alternating":
        return [(-1.0) ** i * i**1.5, zero, 1e-3 * (-1.0) ** i * i]
    return [np.where(i < n // 2, 1.0, -1.0), zero, np.where(i % 40 < 20, 1.0, -1.0)]


@pytest.mark.parametrize("name", ["five waves", "stretched a little", "stretched a lot", "alternating", "blocks"])
@pytest.mark.parametrize("n", [100, pytest.param(1_500, marks=pytest.mark.slow)])
def test_hard_drives_move_as_if_awake(name, n, monkeypatch):
    friction = 10.0 / n
    scene = chain(np.ones(n - 1), np.full(n, friction), np.full(n, 3.0 * friction))
    assert_same(scene, hard(name, n), monkeypatch, 1e-11)


def test_a_contact_that_rests_beside_long_blocks_stays_to_the_bit(monkeypatch):
    n = 401
    scene = chain(np.ones(n - 1), np.full(n, 0.1), np.full(n, 0.1))
    rows = [np.full(n - 1, change) for change in (0.3, -0.2, 0.3)]
    for x, _, _ in follow(scene, rows, 8, monkeypatch):
        assert x[n // 2] == 0.0
        assert np.abs(x + x[::-1]).max() <= 1e-13 * np.abs(x).max()


def test_a_spent_budget_leaves_forces_within_bounds(monkeypatch):
    n = 200
    scene = chain(np.ones(n - 1), np.full(n, 0.1), np.full(n, 0.3))
    row = np.full(n - 1, 5.0)
    _, tension, step = follow(scene, [row], 8, monkeypatch, budget=400)[0]
    assert step.overspent == 1
    force = np.diff(np.concatenate(([0.0], tension, [0.0])))
    assert force.max() <= 0.1 + 1e-12
    assert force.min() >= -0.3 - 1e-12


def test_runs_take_fewer_visits_than_contacts(monkeypatch):
    """A budget that is exceeded where each event solves all contacts of its block is enough for runs."""
    n = 1_000
    scene = chain(np.full(n - 1, float(n)), np.full(n, 0.1 / n), np.full(n, 0.3 / n))
    row = np.random.default_rng(n).uniform(0.4, 0.6, n - 1) / n
    assert follow(scene, [row], NEVER, monkeypatch, budget=100 * n)[0][2].overspent == 1
    there_and_back = follow(scene, [row, 0.0 * row, row], 128, monkeypatch, budget=100 * n)
    assert sum(step.overspent for _, _, step in there_and_back) == 0


def test_a_search_wakes_no_run_of_another_block():
    """The budget would be spent if it did, by five waves over a thousand contacts."""
    scene = wave_scene(1_000, 999 / 5.0, 0.1)
    rows = scene.drive.sample(np.arange(1, 65) * (NS // 64))
    crawler = Crawler(scene)
    crawler.follow(rows)
    crawler.budget = 11_000
    assert crawler.follow(rows).overspent == 0


@pytest.mark.parametrize(("foot", "budget"), [(False, 5_500), (True, 18_000)])
def test_fronts_of_strain_wake_few_contacts(foot, budget):
    """The budget would be spent if an event at a front woke its whole block: of a segment, or of a ring with a foot."""
    segment = {"name": "s", "from": 0, "to": 1, "stiffness": 1.0, "elements": 1_000, "friction": FRICTION}
    document = {"name": "waves", "body": {"segments": [segment]}, "start": "relaxed"}
    document["drive"] = {"wave": {"amplitude": 0.2, "wavelength": 0.2, "period": 1.0}}
    if foot:
        document["body"] |= {"contacts": [1.5], "links": {"stiffness": [4.0, 1.0], "between": RING}}
        document["friction"] = FRICTION
    scene = Scene.model_validate(document)
    rows = scene.drive.sample(np.arange(1, 9) * (NS // 64))
    crawler = Crawler(scene)
    crawler.follow(rows[:2])
    crawler.budget = budget
    assert crawler.follow(rows[2:]).overspent == 0


@pytest.mark.parametrize("leaf_size", [2, LEAF_SIZE])
@pytest.mark.parametrize("closes", [[0, 79], [20, 79]])
def test_rings_move_as_if_awake(leaf_size, closes, monkeypatch):
    """Rings, and rings with a tail, in two waves that pass along them."""
    n = 80
    open_chain = chain(np.ones(n - 1), np.full(n, 0.05), np.full(n, 0.15)).document()
    links = {"stiffness": 1.0, "between": [[i, i + 1] for i in range(n - 1)] + [closes]}
    scene = Scene.model_validate(open_chain | {"body": open_chain["body"] | {"links": links}})
    rows = [np.sin(2.0 * np.pi * (2.0 * np.arange(n) / n - t / 16)) for t in range(20)]
    assert assert_same(scene, rows, monkeypatch, 1e-11, leaf_size) > 100


def test_a_contact_at_its_bound_that_does_not_move_has_no_displacement():
    """Not even one of the size of rounding: pictures and slips depend on it."""
    document = load_scene("continuous_segment").document()
    document["body"]["segments"][0]["elements"] = 200
    run = simulate(Scene.model_validate(document), 3.0)
    middle = run.displacement[:, 80:120]
    assert (middle[200:224] == middle[200]).all()
    assert (middle[250:274] == middle[250]).all()
    assert (np.diff(middle[226:250], axis=0) > 0.0).all()
