"""Stiff bodies in the plane keep the tolerance, and no command takes more work than its budget."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_model import CommandError, Crawler, Scene, load_scene
from crawler_model.motion.plane import motion

from ..planar_ramps import stiff, stiff_error
from ..planar_reference import Reference


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 2e-7])
@pytest.mark.parametrize("loaded", [False, True])
def test_forces_of_stiff_springs_settle_within_the_tolerance(loaded, tolerance):
    """One step over all of that is wrong by a translation, which steps of any length have in common."""
    for seed in range(60):
        assert stiff_error(seed, loaded, tolerance) < 1.0 / 3.0, seed


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("seed", [2, 6, 8, 12])
def test_stiff_ramps_lead_to_where_rates_do(seed, loaded):
    """Another method: rates by least squares, integrated by scipy through the transients. Each body was once off by 1.5."""
    document = stiff(seed, loaded)
    strokes, mu = np.array(document["drive"]["actuation"]), np.array(document["friction"]["isotropic"])
    links = document["body"]["links"]
    reference = Reference(links["between"], np.full(strokes.shape[1], links["stiffness"]), mu[:, None])
    reference.ramp(strokes[0], None, document.get("loads", np.zeros((mu.size, 2))))
    tolerances = (1e-4, 1e-6, 2e-7)
    crawlers = [Crawler(Scene.model_validate(document | {"tolerance": tolerance})) for tolerance in tolerances]
    for count, stroke in enumerate(strokes[1:], 1):
        place = reference.ramp(stroke)
        force = reference.force(reference.x, reference.length, reference.load)
        assert (np.hypot(*force.T) < mu * (1.0 + 1e-7)).all()
        for crawler, tolerance in zip(crawlers, tolerances, strict=True):
            crawler.advance(stroke)
            off = np.abs(crawler.displacement - place).max() / (count * tolerance * np.ptp(strokes, axis=0).max())
            assert off < 0.01, (count, tolerance)


def bodies() -> dict[str, dict[str, Any]]:
    discs = stiff(5, False)
    friction = {"directions": (np.arange(6) * np.pi / 3.0).tolist(), "value": 0.7}
    return {
        "discs": discs,
        "polygons": discs | {"friction": friction},
        "loads": stiff(5, True),
        "bodies that turn": load_scene("tripedal_star").document(),
    }


@pytest.mark.parametrize("name", bodies())
def test_a_budget_bounds_the_work_of_a_ramp_in_the_plane(name):
    """What suffices changes no bit; else one implicit step completes the ramp, whose residual follows from its
    energies."""
    document = bodies()[name]
    target = Scene.model_validate(document).drive.targets[1]
    found = []
    for budget in (None, 0, 30, 300, 3000, 10**9):
        crawler = Crawler(Scene.model_validate(document), budget=budget)
        before = stored(crawler)
        step = crawler.follow(target[None])
        spent = step.work + step.loads_work - step.dissipation - step.jump_loss
        assert stored(crawler) - before - spent == pytest.approx(step.certificate.energy_residual, abs=1e-9)
        assert step.certificate.violation < 1e-8
        assert np.array_equal(crawler._state.actuation.ravel(), target[: crawler._state.actuation.size])
        found.append((step.overspent, crawler._state.bits()))
    assert [overspent for overspent, _ in found[:2]] == [0, 1]
    assert [overspent for overspent, _ in found[1:]] == sorted((o for o, _ in found[1:]), reverse=True)
    assert all(bits == found[0][1] for overspent, bits in found if not overspent)


def stored(crawler: Crawler) -> float:
    tension = crawler.tension
    turning = crawler.body.turning
    stiffness = crawler.body.stiffness if turning is None else np.r_[crawler.body.stiffness, turning.joint_stiffness]
    return float((tension**2 / stiffness.reshape(-1, *[1] * (tension.ndim - 1))).sum() / 2.0)


def test_a_spent_budget_does_not_hide_a_jump_that_is_refused():
    scene = Scene.model_validate(bodies()["bodies that turn"] | {"on_instability": "refuse"})
    crawler = Crawler(scene, budget=100)
    before = crawler._state.bits()
    with pytest.raises(CommandError, match="the budget of work is spent, and the scene has on_instability: refuse"):
        crawler.follow(scene.drive.targets[1:2])
    assert crawler._state.bits() == before


@pytest.mark.parametrize("name", bodies())
def test_a_step_that_completes_a_ramp_balances_all_forces_or_is_refused(name, monkeypatch):
    """Its work is limited, too, wherever in the step the limit is reached."""
    scene = Scene.model_validate(bodies()[name])
    found = []
    for limit in (*range(40), 100, 10_000):
        monkeypatch.setattr(motion, "_COMPLETION", limit)
        crawler = Crawler(scene, budget=0)
        before = crawler._state.bits()
        try:
            step = crawler.follow(scene.drive.targets[1:2])
        except CommandError as error:
            assert "the budget of work is spent, and no equilibrium was found at its end" in str(error)  # noqa: PT017
            assert crawler._state.bits() == before
            found.append(0)
        else:
            assert step.certificate.violation < 1e-8
            found.append(step.overspent)
    assert found == sorted(found)
    assert set(found) == {0, 1}
