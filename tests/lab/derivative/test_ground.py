"""Derivatives on ground that differs from place to place: closed forms, exact derivatives, and steps of other sizes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_lab import sensitivities, vary
from crawler_model import Scene, load_scene, simulate

from ...instrument.model.bodies import CHAIN, GRAPH, ON_GRADUAL_GROUND, Drawn
from ...instrument.model.segments import segment

K, MU, A, STROKE, LENGTH = 20.0, 0.2, 0.5, 0.1, 0.2


def two(ground: dict[str, Any], rows: Any = (0.0, STROKE, 0.0), period: float | None = 2.0, **more: Any) -> Scene:
    """Two contacts on one link; the rear one holds 50 N backward."""
    scene: dict[str, Any] = {
        "name": "two",
        "body": {"contacts": [0.0, LENGTH], "links": {"stiffness": K}},
        "friction": {"forward": 1.0, "backward": 50.0},
        "ground": ground,
        "drive": {"times": list(range(len(rows))), "period": period, "actuation": [[row] for row in rows]},
    }
    return Scene.model_validate(scene | more)


def walk(k: complex, mu: complex, a: complex, stroke: complex, periods: int) -> list[complex]:
    """The closed form: where the rear contact stands after each period on friction mu + a x."""
    q, places = 1.0 / (1.0 + a / k), [0j]
    for _ in range(periods):
        front = q * (places[-1] + LENGTH + stroke - mu / k)
        places.append(q * (front - LENGTH - mu / k))
    return places


def test_on_ground_that_holds_more_and_more_they_are_those_of_the_closed_form():
    """The closed form is differentiated by an imaginary step, which has no rounding error."""
    end, periods, step = 10.0, 5, 1e-30
    profile = {"at": [0.0, end], "friction": {"forward": [MU, MU + end * A], "backward": [1.0, 1.0]}}
    keys = ["body.links.stiffness", "ground.profile.friction.forward[0]", "ground.profile.friction.forward[1]"]
    keys += ["drive.actuation[1][0]", "friction.forward", "ground.profile.at[1]"]
    found = sensitivities(two({"profile": profile}), keys, 2.0 * periods, rate=1.0)
    # k, mu, a and the stroke, as far as each key changes them
    moves = [(1, 0, 0, 0), (0, 1, -1 / end, 0), (0, 0, 1 / end, 0), (0, 0, 0, 1), (0, MU, A, 0), (0, 0, -A / end, 0)]
    for p, move in enumerate(moves):
        values = (value + 1j * step * part for value, part in zip((K, MU, A, STROKE), move, strict=True))
        closed = np.array(walk(*values, periods)).imag / step
        assert found.displacement[::2, 0, p] == pytest.approx(closed, rel=1e-8)
    assert found.differentiable


def test_of_a_foot_that_presses_more_as_its_link_shortens_they_are_those_of_the_closed_form():
    """The rear slides (k D - mu)/(k + a) forward, a = added / 1 m."""
    entry = {"link": 0, "contacts": [0], "elongation": [-1.0, 0.0], "forward": [5.0, 0.0]}
    friction = {"forward": [MU, 50.0], "backward": 50.0, "with_elongation": [entry]}
    keys = ["friction.with_elongation[0].forward[0]", "friction.forward[0]", "body.links.stiffness"]
    scene = two({}, (0.0, -STROKE), None, friction=friction)
    found = sensitivities(scene, keys, 1.0, rate=1.0)
    way, total = (K * STROKE - MU) / (K + 5.0), K + 5.0
    assert found.displacement[-1, 0] == pytest.approx([-way / total, -1.0 / total, (STROKE - way) / total], rel=1e-8)


def test_the_front_stands_at_a_wall_and_moves_with_it():
    """A rear that the wall pushes back slides to w - L - D + B/k; one that the spring draws on stops at w - L - mu/k."""
    held, near = 0.5, 1e-8
    keys = [
        "ground.walls[0].at",
        "body.links.stiffness",
        "friction.backward",
        "friction.forward",
        "drive.actuation[1][0]",
    ]
    found = sensitivities(load_scene("wall_pusher"), keys, 8.0, rate=2.0)
    pushed = [1.0, -held / K**2, 1.0 / K, 0.0, -1.0]
    drawn = [1.0, 0.2 / K**2, 0.0, -1.0 / K, 0.0]
    assert found.displacement[-2] == pytest.approx(np.array([pushed, [1.0, 0.0, 0.0, 0.0, 0.0]]), abs=near)
    assert found.displacement[-1] == pytest.approx(np.array([drawn, [1.0, 0.0, 0.0, 0.0, 0.0]]), abs=near)
    assert found.per_period[-1] == pytest.approx(np.zeros(len(keys)), abs=near)


def test_a_jump_moves_with_the_border_where_it_begins():
    """Friction falls at the border: the contact ends where the spring balances what holds it there."""
    ground = {"patches": [{"from": 0.22, "to": 1.0, "friction": 0.2}]}
    keys = ["ground.patches[0].from", "ground.patches[0].friction", "friction.forward", "drive.actuation[1][0]"]
    scene = two(ground, rows=(0.0, 0.1), period=None, friction={"forward": 0.2, "backward": 1.0})
    found = sensitivities(scene, keys, rate=4.0)
    assert len(simulate(scene).jumps) == 1
    assert found.displacement[-1, 1] == pytest.approx(np.array([0.0, -0.2 / K, -0.2 / K, 1.0]), abs=1e-8)
    assert found.differentiable


def test_at_a_tick_at_which_a_contact_jumps_there_is_no_derivative():
    ground = {"patches": [{"from": 0.22, "to": 1.0, "friction": 0.2}]}
    scene = two(ground, rows=(0.0, 0.03, 0.03), period=None, friction={"forward": 0.2, "backward": 1.0})
    found = sensitivities(scene, ["drive.actuation[1][0]", "friction.backward"], rate=1.0)
    assert found.one_sided.tolist() == [True, False]
    assert found.kinks[0].contacts == ("contact 1",)


@pytest.mark.parametrize("kind", [CHAIN, GRAPH])
@pytest.mark.parametrize("seed", range(4))
def test_where_the_ground_changes_nothing_they_are_exact_ones(kind, seed):
    plain = Drawn(kind, seed).driven().data
    plain = {key: value for key, value in plain.items() if key != "ground"}
    place = float(plain["body"]["contacts"][0])
    level = plain | {"ground": {"profile": {"at": [place - 0.3, place + 0.4], "friction": [1.0, 1.0]}}}
    keys = ["body.links.stiffness", "friction.forward", "drive.actuation"]
    one, two = (sensitivities(Scene.model_validate(scene), keys, rate=3.0) for scene in (level, plain))
    sure = ~(one.one_sided | two.one_sided)
    assert sure.any()
    assert one.displacement[..., sure] == pytest.approx(two.displacement[..., sure], abs=1e-6)


def test_in_the_plane_a_jump_moves_with_the_region_where_it_begins():
    """The front slides along x onto a region, where the spring balances less friction."""
    region = {"left_of": [[0.15, 1.0], [0.15, -1.0]], "friction": 0.3}
    scene = Scene.model_validate(
        {
            "name": "onto_ice",
            "dimension": 2,
            "body": {"contacts": [[0.0, 0.0], [0.1, 0.0]], "links": {"stiffness": K}},
            "friction": {"isotropic": [1.0, MU]},
            "ground": {"regions": [region]},
            "drive": {"times": [0, 1], "actuation": [[[0.0, 0.0]], [[0.2, 0.0]]]},
        }
    )
    keys = ["drive.actuation[1][0][0]", "friction.isotropic[1]", "ground.regions[0].friction", "body.links.stiffness"]
    found = sensitivities(scene, keys, 1.0, rate=2.0)
    assert len(simulate(scene).jumps) == 1
    expected = [1.0, -0.3 / K, -MU / K, 0.3 * MU / K**2]
    assert found.displacement[-1, 1] == pytest.approx(np.array([expected, np.zeros(4)]), abs=1e-6)
    assert found.differentiable


def test_a_segment_on_ground_that_is_the_same_everywhere_has_the_derivatives_of_its_closed_form():
    """Differences over several cells; where the strong side moves the point within one, they are flagged."""
    stroke, weak, strong, path = 0.2, 0.1, 0.3, "body.segments[0]."
    ground = {"profile": {"at": [-1.0, 1.0], "friction": [1.0, 1.0]}}
    scene = Scene.model_validate(segment(stroke, elements=80).document() | {"ground": ground})
    keys = [path + "friction.forward", path + "friction.backward", path + "stiffness", "drive.actuation[1][0]"]
    found = sensitivities(scene, keys, 2.0, 1.0)
    part, beyond, twice = (strong - weak) / (strong + weak), stroke - weak, 2.0 / (strong + weak) ** 2
    expected = np.array([-part - beyond * strong * twice, beyond * weak * twice, part * weak, part])
    assert found.per_period[-1] == pytest.approx(expected, rel=0.05)
    assert (~found.unresolved).sum() >= 2
    assert 0.0 < found.tolerance <= 0.05


@pytest.mark.parametrize("kind", [*ON_GRADUAL_GROUND, "chain on patches", "chain between walls"])
@pytest.mark.parametrize("seed", range(2))
def test_steps_of_another_size_find_the_same(kind, seed):
    scene = Drawn(kind, seed).driven().scene
    keys = ["body.links.stiffness", "friction.forward", "drive.actuation"]
    if kind in ON_GRADUAL_GROUND:
        keys += [f"ground.profile.{key}" for key in ("at", "friction.forward", "friction.backward", "slope")]
    keys += [f"ground.walls[{i}].at" for i in range(len(scene.parts.ground.walls))]
    found = sensitivities(scene, keys, rate=1.7)
    assert found.one_sided.mean() < 0.1
    for p in np.flatnonzero(~found.one_sided)[seed::7]:
        step = 2.0**-17 * max(abs(found.values[p]), 0.125)
        sides = vary(scene, {found.parameters[p]: [found.values[p] - step, found.values[p] + step]})
        less, more = (simulate(side, rate=1.7).displacement for side in sides)
        derivative = found.displacement[..., p]
        assert (more - less) / (2.0 * step) == pytest.approx(derivative, abs=1e-5 * max(np.abs(derivative).max(), 1.0))
