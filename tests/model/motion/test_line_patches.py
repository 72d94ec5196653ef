"""The engine of records on patches of ground: as the engine in use where nothing ties, as rational numbers where it does."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from crawler_model import CommandError, Scene, SceneError
from crawler_model.motion.follow import build_motion
from crawler_model.motion.line.motion import LineMotion
from crawler_model.motion.state import (
    ACCOUNT_SIZE,
    AMBIGUOUS,
    DISSIPATION,
    LOADS_WORK,
    OVERSPENT,
    RESIDUAL,
    UNSOLVED,
    VISITED,
    WORK,
)

from ..rational_patches import NotUniqueError, RationalBody
from ..test_patches import ice, random_body, two
from .test_crossings import random_scene

SAME = [WORK, DISSIPATION, LOADS_WORK, VISITED, AMBIGUOUS]
TIED = {
    "contacts": [-108, -36, -12, 12, 36, 108],
    "stiffness": [6, 18, 18, 18, 6],
    "friction": [1944, 36, 72, 72, 36, 1944],
    "patch": [-54, 54, 1.5],
}


class Followed:
    """A body on patches, followed by the engine of records or by the one in use."""

    def __init__(self, scene: Scene, records: bool = True, budget: int = 10**9) -> None:
        self.scene, self.budget = scene, budget
        self.motion: Any = LineMotion(scene.body, scene.ground.track)
        if records and scene.body.is_chain:  # one set of kernels serves chains and graphs
            scratch = self.motion.scratch()._replace(matrix=np.zeros((scene.body.contacts, 1)))
            object.__setattr__(self.motion, "scratch", lambda: scratch)
        if not records:
            self.motion = build_motion(scene)
        self.state = self.motion.start(scene.start_displacement, scene.drive.targets[0])
        self.account = np.zeros(ACCOUNT_SIZE)
        self.account[VISITED] = np.inf
        self.jumps: list[Any] = []

    def go(self, targets: np.ndarray) -> np.ndarray:
        """Follow ramps; return the displacement after each."""
        n = self.scene.body.contacts
        out = np.zeros((len(targets), 2 * n + self.scene.body.springs))
        found = self.motion.follow(self.state, self.motion.scratch(), targets, True, self.budget, self.account, out)
        self.jumps += found
        return out[:, :n]

    def stretch(self, *lengths: Any) -> np.ndarray:
        """Follow ramps of the rest lengths, at constant friction."""
        targets = np.repeat(self.scene.drive.targets[:1], len(lengths), axis=0)
        targets[:, : self.scene.body.springs] = np.array(lengths, float).reshape(len(lengths), -1)
        return self.go(targets)


def chain(contacts: Any, stiffness: Any, friction: Any, patch: Any) -> Scene:
    begin, end, factor = patch
    document = {
        "name": "tied",
        "body": {"contacts": list(contacts), "links": {"stiffness": list(stiffness)}},
        "friction": {"isotropic": list(friction)},
        "ground": {"patches": [{"from": begin, "to": end, "friction": factor}]},
    }
    return Scene.model_validate(document)


def test_motion_jumps_and_account_are_those_of_the_engine_in_use() -> None:
    cases = [random_scene(seed) for seed in range(60)]
    cases = [case for case in cases if case[0].body.contacts <= 10]
    for seed in range(40):
        try:
            scene, _, rng = random_body(seed)
        except SceneError:  # a slope that this body cannot start on
            continue
        targets = np.repeat(scene.drive.targets[:1], 4, axis=0)
        targets[:, : scene.body.springs] = rng.uniform(-2.0, 2.0, (4, scene.body.springs))
        cases.append((scene, targets))
    jumps = 0
    for number, (scene, targets) in enumerate(cases):
        ours, others = Followed(scene), Followed(scene, records=False)
        np.testing.assert_allclose(ours.go(targets), others.go(targets), rtol=0, atol=1e-12, err_msg=str(number))
        np.testing.assert_allclose(ours.account[SAME], others.account[SAME], rtol=0, atol=1e-11, err_msg=str(number))
        assert abs(ours.account[RESIDUAL]) < 1e-12
        assert not ours.account[[UNSOLVED, OVERSPENT]].any()
        for one, other in zip(sorted(ours.jumps, key=str), sorted(others.jumps, key=str), strict=True):
            assert (one.ramp, one.contact, one.border) == (other.ramp, other.contact, other.border)
            assert (one.part, one.distance, one.loss) == pytest.approx(
                (other.part, other.distance, other.loss), abs=1e-10
            )
            jumps += 1
    assert jumps > 100


@pytest.mark.parametrize("parts", [1, 2, 3, 5, 7])
def test_contacts_that_reach_borders_together_fall_together(parts: int) -> None:
    """The engine in use finishes one jump before it starts the other, and is 0.2 m off."""
    body = Followed(chain(*TIED.values()))
    x = body.stretch(*([0, 23 * k / parts, 23 * k / parts, 23 * k / parts, 0] for k in range(1, parts + 1)))
    np.testing.assert_allclose(x[-1], [0, -19, -13 / 3, 13 / 3, 19, 0], rtol=0, atol=1e-12)
    assert abs(body.account[RESIDUAL]) < 1e-12 * body.account[WORK]
    assert [jump.contact for jump in body.jumps] == [1, 4]
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


def test_tied_jumps_are_those_of_rational_numbers() -> None:
    jumps = ties = 0
    for seed in range(100):
        parts, lengths = draw_tied(np.random.default_rng(seed), symmetric=seed % 4 > 0)
        position, stiffness, friction, (begin, end, factor) = parts
        rational = [Fraction(f) for f in friction]
        truth = RationalBody(
            [Fraction(p) for p in position],
            [(i, i + 1, Fraction(k)) for i, k in enumerate(stiffness)],
            rational,
            rational,
            [Fraction(begin), Fraction(end)],
            [Fraction(1), Fraction(factor), Fraction(1)],
        )
        ours = Followed(chain(*parts))
        for length in lengths:
            before = truth.jumps
            try:
                truth.ramp([Fraction(value) for value in length])
            except NotUniqueError:
                break
            x = ours.stretch(length)[0]
            np.testing.assert_allclose(x, [float(value) for value in truth.x], rtol=0, atol=1e-12, err_msg=str(seed))
            assert len(ours.jumps) == truth.jumps
            ties += seed % 4 > 0 and truth.jumps > before
        jumps += truth.jumps
        assert abs(ours.account[RESIDUAL]) < 1e-12
    assert jumps > 100
    assert ties > 40


def test_ground_that_holds_nothing_is_refused_and_changes_nothing() -> None:
    scene = two([{"from": -1.0, "to": 1.25, "slope": 0.0}], 0.4, 1.0, slope=-80.0, body={"weights": 3.0})
    body = Followed(scene)
    body.stretch(0.6)
    kept, account = body.state.copy(), body.account.copy()
    with pytest.raises(CommandError, match=r"the loads sum to 5\.90885 N forward, but friction against .* to 0\.8 N"):
        body.stretch(0.7)
    assert body.state.bits() == kept.bits()
    assert (body.account == account).all()


def test_a_body_that_nothing_holds_slides_to_the_foot_of_the_hill() -> None:
    cliff = [{"from": 1.25, "to": 2.25, "slope": -80.0}]
    scene = two(cliff, 0.4, 1.0, body={"weights": 3.0})
    ours, others = Followed(scene), Followed(scene, records=False)
    np.testing.assert_allclose(ours.stretch(0.7), others.stretch(0.7), rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours.account[SAME], others.account[SAME], rtol=0, atol=1e-12)
    assert ours.jumps[0].loss == pytest.approx(others.jumps[0].loss, abs=1e-12)
    assert ours.state.feet is not None
    assert ours.state.feet["place"].tolist() == [0, 3]


def test_a_step_that_completes_a_ramp_finds_the_ground_that_it_leads_to() -> None:
    lengths = (0.2, 2.0, 2.5, 1.5)
    spent, exact = Followed(two(ice()), budget=0), Followed(two(ice()))
    np.testing.assert_allclose(spent.stretch(*lengths)[-1], exact.stretch(*lengths)[-1], rtol=0, atol=1e-12)
    assert spent.account[OVERSPENT]


def test_jumps_beyond_the_room_for_them_are_found_in_a_second_run() -> None:
    patches = [{"from": 1.25 + 0.5 * k, "to": 1.5 + 0.5 * k, "friction": 0.5} for k in range(40)]
    scene = two(patches)
    body = Followed(scene)
    x = body.stretch(21.0)
    assert len(body.jumps) == 40 > scene.body.contacts + 16
    assert abs(body.account[RESIDUAL]) < 1e-12
    other = Followed(scene, records=False)
    np.testing.assert_allclose(x, other.stretch(21.0), rtol=0, atol=1e-12)
