"""Patches of ground: contacts that reach borders in one ramp, together or one by one, as rational numbers show."""

from __future__ import annotations

import itertools
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from crawler_model import Crawler, Scene
from crawler_model.motion.account import DISSIPATION, LOADS_WORK, OVERSPENT, RESIDUAL, UNSOLVED, WORK
from crawler_model.motion.jump import Jump

from ..bodies import Drawn
from ..rational_bends import NotUniqueError, RationalBentBody, RationalCurve, RationalGround, RationalLink
from ..test_patches import ice, two

ENERGIES = [WORK, DISSIPATION, LOADS_WORK]
TIED = {
    "contacts": [-108, -36, -12, 12, 36, 108],
    "stiffness": [6, 18, 18, 18, 6],
    "friction": [1944, 36, 72, 72, 36, 1944],
    "patch": [-54, 54, 1.5],
}


class Followed:
    """A body on patches, with the account and the jumps of all its ramps."""

    def __init__(self, scene: Scene, budget: int | None = None) -> None:
        self.scene, self.crawler = scene, Crawler(scene, budget=budget)
        self.step = self.crawler.follow(scene.drive.targets[:0])
        self.jumps: list[Jump] = []

    def go(self, targets: np.ndarray) -> np.ndarray:
        """Follow ramps; return the displacement after each."""
        n = self.scene.body.contacts
        out = np.zeros((len(targets), 2 * n + self.scene.body.springs))
        self.step = self.crawler.follow(targets, out, self.step)
        self.jumps += self.step.jumps
        return out[:, :n]

    @property
    def account(self) -> np.ndarray:
        return self.step.account

    def stretch(self, *lengths: Any) -> np.ndarray:
        """Follow ramps of the rest lengths, at constant friction."""
        targets = np.repeat(self.scene.drive.targets[:1], len(lengths), axis=0)
        targets[:, : self.scene.body.springs] = np.array(lengths, float).reshape(len(lengths), -1)
        return self.go(targets)


def random_scene(seed: int) -> tuple[Scene, np.ndarray]:
    """A chain of 2 to 20 contacts on up to three patches for each of them, with slopes, and targets with friction."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 20))
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
    targets = np.repeat(scene.drive.targets[:1], 6, axis=0)
    targets[:, : n - 1] += rng.uniform(-1, 1, (6, n - 1)) * rng.uniform(0.2, 3.0)
    if seed % 4 == 1:
        targets[:, n - 1 : 3 * n - 1] *= rng.uniform(0.5, 1.5, (6, 2 * n))
    return scene, targets


def rows_of_patches(n: int) -> tuple[Scene, np.ndarray]:
    """A wave along n equal contacts, over patches of half their wavelength, with a border for each ten contacts."""
    patches = [{"from": 20.0 * k + 0.31, "to": 20.0 * k + 10.37, "friction": 0.6} for k in range(n // 20)]
    body = {"contacts": list(range(n)), "links": {"stiffness": 1.0}}
    friction = {"forward": 0.1, "backward": 0.3}
    document = {"name": "rows", "body": body, "friction": friction, "ground": {"patches": patches}}
    scene = Scene.model_validate(document)
    turned = 2.0 * np.pi * (np.arange(1, 6 + 1)[:, None] / 16.0 - np.arange(n - 1) / 17.0)
    targets = np.repeat(scene.drive.targets[:1], 6, axis=0)
    targets[:, : n - 1] += np.sin(turned)
    return scene, targets


def chain(contacts: Any, stiffness: Any, friction: Any, patch: Any) -> Scene:
    begin, end, factor = patch
    document = {
        "name": "tied",
        "body": {"contacts": list(contacts), "links": {"stiffness": list(stiffness)}},
        "friction": {"isotropic": list(friction)},
        "ground": {"patches": [{"from": begin, "to": end, "friction": factor}]},
    }
    return Scene.model_validate(document)


def split(before: np.ndarray, targets: np.ndarray, parts: int) -> np.ndarray:
    """Divide each ramp into equal parts."""
    rows = np.vstack((before, targets))
    between = [a + (b - a) * (k / parts) for a, b in itertools.pairwise(rows) for k in range(1, parts)]
    split = np.repeat(targets, parts, axis=0)
    split[np.arange(len(split)) % parts < parts - 1] = between
    return split


@pytest.mark.parametrize("seed", range(0, 80, 4))
def test_a_ramp_in_many_parts_leads_to_the_same_place(seed: int) -> None:
    scene, targets = random_scene(seed)
    one, other = Followed(scene), Followed(scene)
    x = one.go(targets)
    np.testing.assert_allclose(x, other.go(split(scene.drive.targets[0], targets, 37))[36::37], rtol=0, atol=1e-10)
    assert (one.crawler.places == other.crawler.places).all()
    np.testing.assert_allclose(one.account[ENERGIES], other.account[ENERGIES], rtol=0, atol=1e-10)
    assert [(jump.contact, jump.border) for jump in one.jumps] == [(jump.contact, jump.border) for jump in other.jumps]
    for body in (one, other):
        certificate = body.step.certificate
        assert abs(certificate.energy_residual) < 1e-12 * (1.0 + body.step.dissipation)
        assert max(certificate.violation, certificate.complementarity) < 1e-12
        assert not body.account[[UNSOLVED, OVERSPENT]].any()


def test_a_copy_of_a_state_goes_on_as_the_state_does() -> None:
    """With memory of its own, which knows nothing of the ramps before."""
    scene, targets = random_scene(4)
    crawler = Crawler(scene)
    for k in range(0, len(targets), 2):
        other = crawler.copy()
        other.follow(targets[k : k + 2])
        crawler.follow(targets[k : k + 1])
        crawler.follow(targets[k + 1 : k + 2])
        assert (other.displacement == crawler.displacement).all()


def test_several_ramps_of_one_call_number_their_jumps() -> None:
    scene, targets = random_scene(7)
    together, each = Followed(scene), Crawler(scene)
    together.go(targets)
    expected = [
        (ramp, jump.contact, jump.border) for ramp, row in enumerate(targets) for jump in each.follow(row[None]).jumps
    ]
    assert [(jump.ramp, jump.contact, jump.border) for jump in together.jumps] == expected
    assert len({ramp for ramp, _, _ in expected}) > 1


def mirrored(document: dict[str, Any]) -> Scene:
    """Build the scene that a mirror shows: forward is backward, and the last contact the first."""
    body, friction = document["body"], document["friction"]
    patches = [
        patch | {"from": -patch["to"], "to": -patch["from"], "forward": patch["backward"], "backward": patch["forward"]}
        for patch in document["ground"]["patches"][::-1]
    ]
    slopes = ({"slope": -patch["slope"]} if "slope" in patch else {} for patch in patches)
    turned = {
        "body": body
        | {"contacts": [-x for x in body["contacts"][::-1]], "links": {"stiffness": body["links"]["stiffness"][::-1]}},
        "friction": {"forward": friction["backward"][::-1], "backward": friction["forward"][::-1]},
        "ground": {"patches": [patch | slope for patch, slope in zip(patches, slopes, strict=True)]},
    }
    return Scene.model_validate(document | turned)


def test_direction_does_not_matter() -> None:
    jumps = 0
    for seed in range(60):
        scene, targets = random_scene(seed)
        n = scene.body.contacts
        image = mirrored(scene.document())
        length, forward, backward, loads = np.split(targets, (n - 1, 2 * n - 1, 3 * n - 1), axis=1)
        one, other = Followed(scene), Followed(image)
        x = one.go(targets)
        turned = np.hstack((length[:, ::-1], backward[:, ::-1], forward[:, ::-1], -loads[:, ::-1]))
        np.testing.assert_allclose(other.go(turned)[:, ::-1], -x, rtol=0, atol=1e-11, err_msg=str(seed))
        np.testing.assert_allclose(one.account[ENERGIES], other.account[ENERGIES], rtol=0, atol=1e-11)
        np.testing.assert_allclose(
            sorted((jump.contact, jump.border, jump.distance, jump.loss) for jump in one.jumps),
            sorted((n - 1 - jump.contact, -jump.border, -jump.distance, jump.loss) for jump in other.jumps),
            rtol=0,
            atol=1e-10,
        )
        jumps += len(one.jumps)
    assert jumps > 1000


@pytest.mark.parametrize("parts", [1, 2, 3, 5, 7])
def test_contacts_that_reach_borders_together_fall_together(parts: int) -> None:
    """If one jump ends before the other begins, the body ends 0.2 m off."""
    body = Followed(chain(*TIED.values()))
    x = body.stretch(*([0, 23 * k / parts, 23 * k / parts, 23 * k / parts, 0] for k in range(1, parts + 1)))
    np.testing.assert_allclose(x[-1], [0, -19, -13 / 3, 13 / 3, 19, 0], rtol=0, atol=1e-12)
    assert abs(body.account[RESIDUAL]) < 1e-12 * body.account[WORK]
    assert sorted(jump.contact for jump in body.jumps) == [1, 4]
    assert body.jumps[0].loss == pytest.approx(body.jumps[1].loss, rel=1e-12)


def draw_tied(rng: np.random.Generator, symmetric: bool) -> tuple[tuple[Any, ...], np.ndarray]:
    """Draw a body in quarters around a contact that hardly ever slides, its patch, and three rows of rest lengths."""
    half = np.cumsum(rng.integers(1, 3, int(rng.integers(1, 4)))) * 4.0
    position = np.concatenate((-half[::-1], [0.0], half))
    n = position.size
    stiffness, friction = rng.integers(1, 9, n - 1) / 4.0, rng.integers(1, 9, n) / 4.0
    lengths = rng.integers(-12, 13, (3, n - 1)) * 1.0
    if symmetric:
        stiffness, friction = stiffness + stiffness[::-1], friction + friction[::-1]
        lengths += lengths[:, ::-1]
    friction[n // 2] = 64.0
    cut = float(rng.integers(1, int(half[-1]) + 4)) + 0.5
    patch = (-cut, cut, float(rng.choice([0.25, 0.5, 1.5, 2.0])))
    return (position.tolist(), stiffness.tolist(), friction.tolist(), patch), lengths


def linear(stiffness: Fraction) -> RationalCurve:
    """The curve of a linear spring, whose knot is out of reach."""
    far = Fraction(10**9)
    return RationalCurve([far], [stiffness * far], stiffness, stiffness)


@pytest.mark.parametrize("first", range(0, 100, 25))
def test_tied_jumps_are_those_of_rational_numbers(first: int) -> None:
    jumps = ties = 0
    for seed in range(first, first + 25):
        parts, lengths = draw_tied(np.random.default_rng(seed), symmetric=seed % 4 > 0)
        position, stiffness, friction, (begin, end, factor) = parts
        rational, n = [Fraction(f) for f in friction], len(friction)
        factors = [Fraction(1), Fraction(factor), Fraction(1)]
        truth = RationalBentBody(
            n,
            [RationalLink(i, i + 1, linear(Fraction(k)), linear(Fraction(0))) for i, k in enumerate(stiffness)],
            rational,
            rational,
            [Fraction(p) for p in position],
            RationalGround([Fraction(begin), Fraction(end)], factors, [[Fraction(0)] * n] * 3),
        )
        ours = Followed(chain(*parts))
        for length in lengths:
            before = truth.jumps
            try:
                truth.follow([Fraction(value) for value in length], rational, rational)
            except NotUniqueError:
                break
            x = ours.stretch(length)[0]
            np.testing.assert_allclose(x, [float(value) for value in truth.x], rtol=0, atol=1e-12, err_msg=str(seed))
            assert len(ours.jumps) == truth.jumps
            ties += seed % 4 > 0 and truth.jumps > before
        jumps += truth.jumps
        assert abs(ours.account[RESIDUAL]) < 1e-12
    assert jumps > 25
    assert ties > 10


def test_a_step_that_completes_a_ramp_finds_the_ground_that_it_leads_to() -> None:
    lengths = (0.2, 2.0, 2.5, 1.5)
    spent, exact = Followed(two(ice()), budget=0), Followed(two(ice()))
    np.testing.assert_allclose(spent.stretch(*lengths)[-1], exact.stretch(*lengths)[-1], rtol=0, atol=1e-12)
    assert spent.account[OVERSPENT]


@pytest.mark.parametrize("kind", ["chain on patches", "graph on patches"])
def test_a_step_that_completes_a_ramp_finishes_its_falls(kind: str) -> None:
    """However early the budget is spent, and wherever contacts stand then: before a border, on it, or in a fall."""
    spent = 0
    for seed in (*range(40), 64, 72, 93, 226, 316, 442):
        scene = Drawn(kind, seed, bool(seed & 1), bool(seed & 2), bool(seed & 4)).driven().scene
        for budget in (0, 5, 10, 20, 30, 60):
            crawler = Crawler(scene, budget=budget)
            for target in scene.drive.targets[1:]:
                step = crawler.follow(target[None].copy())
                assert step.unsolved == 0, (seed, budget)
                assert step.certificate.violation < 1e-12, (seed, budget)
                assert crawler.margins.min() > -1e-12, (seed, budget)
                assert np.array_equal(crawler.actuation, target[: scene.body.springs])
                spent += step.overspent
    assert spent > 100


def test_jumps_beyond_the_room_for_them_are_found_in_a_second_run() -> None:
    patches = [{"from": 1.25 + 0.5 * k, "to": 1.5 + 0.5 * k, "friction": 0.5} for k in range(40)]
    scene = two(patches)
    body = Followed(scene)
    x = body.stretch(21.0)
    assert len(body.jumps) == 40 > scene.body.contacts + 16
    assert abs(body.account[RESIDUAL]) < 1e-12
    assert x == pytest.approx(np.array([[0.0, 20.6]]), abs=1e-12)


def test_a_contact_that_reaches_harder_ground_as_a_ramp_ends_has_stopped() -> None:
    """A contact at 0 m is drawn to a patch at 1/4 m, on whose border the ground holds it: nothing is amiss there."""
    crawler = Crawler(
        Scene.model_validate(
            {
                "name": "stops",
                "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}},
                "friction": {"forward": [0.25, 10.0], "backward": [0.25, 10.0]},
                "ground": {"patches": [{"from": 0.25, "to": 0.5, "forward": 4.0, "backward": 4.0}]},
            }
        )
    )
    step = crawler.advance([-0.5])
    assert crawler.displacement.tolist() == [0.25, 0.0]
    assert step.certificate.complementarity == 0.0
