"""Contacts of a chain cross borders within a ramp; the path is that of ramps that stop at every border."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from crawler_model import Crawler, Scene, Step
from crawler_model.motion.chain.motion import ChainMotion
from crawler_model.motion.jump import Jump

RAMPS = 6


@dataclass(frozen=True)
class Path:
    """Displacements, tensions, places and accounts after each ramp, and how often a kernel was called."""

    x: np.ndarray
    tension: np.ndarray
    places: np.ndarray
    steps: list[Step]
    calls: int


def random_scene(seed: int) -> tuple[Scene, np.ndarray]:
    """A chain of 2 to 40 contacts on up to three patches for each of them, with slopes, and targets with friction."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 40))
    position = np.cumsum(rng.uniform(0.3, 1.5, n))
    count = int(rng.integers(1, 3 * n))
    cuts = np.sort(rng.uniform(position[0] - 1.0, position[-1] + 1.0, 2 * count))
    factors = np.exp(rng.uniform(-1.5, 1.0, (count, 2)))
    factors[rng.random(count) < 0.1] = 0.0 if seed % 3 == 1 else 1.0  # ice, or a border in name only
    slopes = np.degrees(rng.uniform(-0.1, 0.1, count)) * (seed % 3 == 0)
    patches = [
        {"from": a, "to": b, "forward": plus, "backward": minus} | ({"slope": slope} if slope else {})
        for (a, b), (plus, minus), slope in zip(
            cuts.reshape(-1, 2).tolist(), factors.tolist(), slopes.tolist(), strict=True
        )
    ]
    forward, backward = np.exp(rng.uniform(-1.5, 0.0, (2, n)))
    document = {
        "name": "random",
        "body": {
            "contacts": position.tolist(),
            "weights": 0.1,
            "links": {"stiffness": np.exp(rng.uniform(-1, 1, n - 1)).tolist()},
        },
        "friction": {"forward": forward.tolist(), "backward": backward.tolist()},
        "ground": {"patches": patches},
    }
    scene = Scene.model_validate(document)
    targets = np.repeat(scene.drive.targets[:1], RAMPS, axis=0)
    targets[:, : n - 1] += rng.uniform(-1, 1, (RAMPS, n - 1)) * rng.uniform(0.2, 3.0)
    if seed % 4 == 1:
        targets[:, n - 1 : 3 * n - 1] *= rng.uniform(0.5, 1.5, (RAMPS, 2 * n))
    return scene, targets


def rows_of_patches(n: int) -> tuple[Scene, np.ndarray]:
    """A wave along n equal contacts, over patches of half their wavelength, with a border for each ten contacts."""
    patches = [{"from": 20.0 * k + 0.31, "to": 20.0 * k + 10.37, "friction": 0.6} for k in range(n // 20)]
    body = {"contacts": list(range(n)), "links": {"stiffness": 1.0}}
    friction = {"forward": 0.1, "backward": 0.3}
    document = {"name": "rows", "body": body, "friction": friction, "ground": {"patches": patches}}
    scene = Scene.model_validate(document)
    turned = 2.0 * np.pi * (np.arange(1, RAMPS + 1)[:, None] / 16.0 - np.arange(n - 1) / 17.0)
    targets = np.repeat(scene.drive.targets[:1], RAMPS, axis=0)
    targets[:, : n - 1] += np.sin(turned)
    return scene, targets


def follow(scene: Scene, targets: np.ndarray, monkeypatch: pytest.MonkeyPatch, crosses: bool, parts: int = 1) -> Path:
    """Follow each ramp in so many equal parts, across borders or with a stop at each of them."""
    calls = 0
    original = ChainMotion.follow_to_border

    def counted(self: ChainMotion, *args: Any) -> tuple[int, float, int]:
        nonlocal calls
        calls += 1
        *others, patches = args
        return original(self, *others, patches._replace(crosses=crosses and patches.crosses))

    with monkeypatch.context() as patch:
        patch.setattr(ChainMotion, "follow_to_border", counted)
        crawler = Crawler(scene)
        rows, steps = [], []
        before = scene.drive.targets[0]
        for target in targets:
            for part in np.arange(1, parts + 1) / parts:
                steps.append(crawler.follow((before + part * (target - before) if part < 1.0 else target)[None]))
            before = target
            rows.append((crawler.displacement.copy(), crawler.tension.copy(), crawler.places.copy()))
    return Path(*(np.array(column) for column in zip(*rows, strict=True)), steps, calls)


def sorted_jumps(step: Step) -> list[Jump]:
    return sorted(step.jumps, key=lambda jump: (jump.contact, jump.border, jump.part))


def assert_same_account(one: Step, other: Step, size: float) -> None:
    """Compare energies and certificates relative to an energy."""
    for name in ("work", "dissipation", "loads_work", "jump_loss"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=0, abs=1e-11 * size), name
    assert abs(one.certificate.energy_residual) <= 1e-12 * size
    assert one.certificate.violation <= 1e-12 * size
    assert one.certificate.complementarity <= 1e-12 * size


@pytest.mark.parametrize("seed", range(40))
def test_crossing_borders_is_the_same_as_stopping_at_each(seed, monkeypatch):
    scene, targets = random_scene(seed)
    one = follow(scene, targets, monkeypatch, True)
    other = follow(scene, targets, monkeypatch, False)
    assert one.calls <= other.calls
    assert one.x == pytest.approx(other.x, abs=1e-11)
    assert one.tension == pytest.approx(other.tension, abs=1e-11)
    assert (one.places == other.places).all()
    for step, expected in zip(one.steps, other.steps, strict=True):
        assert_same_account(step, expected, 1.0 + abs(expected.work) + expected.dissipation)
        assert len(step.jumps) == len(expected.jumps)
        for jump, like in zip(sorted_jumps(step), sorted_jumps(expected), strict=True):
            assert (jump.ramp, jump.contact, jump.border) == (like.ramp, like.contact, like.border)
            near = (jump.part - like.part, jump.distance - like.distance, jump.loss - like.loss)
            assert np.abs(near).max() <= 1e-10


def test_these_ramps_cross_and_jump_often_and_seldom_stop(monkeypatch):
    crossing, stopping, jumps = 0, 0, 0
    for seed in range(40):
        scene, targets = random_scene(seed)
        one = follow(scene, targets, monkeypatch, True)
        crossing += one.calls - RAMPS
        stopping += follow(scene, targets, monkeypatch, False).calls - RAMPS
        jumps += sum(len(step.jumps) for step in one.steps)
    assert jumps > 2000
    assert stopping > 3 * jumps
    assert crossing < 0.02 * stopping


@pytest.mark.parametrize("seed", range(0, 40, 4))
def test_a_ramp_in_many_parts_leads_to_the_same_place(seed, monkeypatch):
    scene, targets = random_scene(seed)
    one = follow(scene, targets, monkeypatch, True)
    other = follow(scene, targets, monkeypatch, True, parts=37)
    assert one.x == pytest.approx(other.x, abs=1e-10)
    assert (one.places == other.places).all()
    loss, expected = (sum(step.jump_loss for step in path.steps) for path in (one, other))
    assert loss == pytest.approx(expected, abs=1e-10)


def test_many_contacts_of_a_long_body_cross_and_push_each_other_over_borders(monkeypatch):
    scene, targets = rows_of_patches(600)
    one = follow(scene, targets, monkeypatch, True)
    other = follow(scene, targets, monkeypatch, False)
    assert one.calls == RAMPS
    assert other.calls > 20 * RAMPS
    assert one.x == pytest.approx(other.x, abs=1e-10)
    assert (one.places == other.places).all()
    assert [len(step.jumps) for step in one.steps] == [len(step.jumps) for step in other.steps]


def test_several_ramps_of_one_call_number_their_jumps(monkeypatch):
    scene, targets = random_scene(7)
    crawler = Crawler(scene)
    together = crawler.follow(targets).jumps
    each = follow(scene, targets, monkeypatch, True).steps
    expected = [(ramp, jump.contact, jump.border) for ramp, step in enumerate(each) for jump in step.jumps]
    assert [(jump.ramp, jump.contact, jump.border) for jump in together] == expected
    assert len({ramp for ramp, _, _ in expected}) > 1
