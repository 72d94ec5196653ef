"""Derivatives of bodies with segments: those of the continuous body, not those of its elements."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_lab import sensitivities, vary
from crawler_model import Scene, load_scene, simulate

from ...model.segments import segment, unequal

_FINE = (397, 419, 443, 467, 491)
"""Meshes whose contacts lie differently: the mean of their errors vanishes to first order."""
_WAVES = 4
"""Which of the five kinds of `unequal` have waves."""
_STEP = 0.04
"""Step of the differences, as part of the value; the point at rest passes several cells."""


@pytest.mark.parametrize("elements", [1, 6, 38, 50])
@pytest.mark.parametrize("sides", [(0.11, 0.3), (0.3, 0.11), (0.1, 0.3), (0.3, 0.1)])
def test_a_homogeneous_segment_has_the_derivatives_of_its_closed_form(
    elements: int, sides: tuple[float, float]
) -> None:
    """The point at rest moves with friction; on a grid a contact takes its place, whatever the friction.

    With 0.1 and 0.3 the point is between the cells of two contacts, but for a single element.
    """
    stroke = 0.2
    scene = segment(stroke, elements=elements, friction=dict(zip(("forward", "backward"), sides, strict=True)))
    path = "body.segments[0]."
    keys = [path + "friction.forward", path + "friction.backward", path + "stiffness", "drive.actuation[1][0]"]
    found = sensitivities(scene, keys, 3.0, 2.0)
    weak, strong = min(sides), max(sides)
    part, beyond = (strong - weak) / (strong + weak), stroke - weak
    by_weak = -part - beyond * 2.0 * strong / (strong + weak) ** 2
    by_strong = beyond * 2.0 * weak / (strong + weak) ** 2
    expected = [by_weak, by_strong, part * weak, part]
    if sides[0] > sides[1]:
        expected = [-by_strong, -by_weak, -part * weak, -part]
    np.testing.assert_allclose(found.per_period[1:], [expected, expected], atol=1e-6 if 0.1 in sides else 1e-12)
    assert found.differentiable or elements < 10  # the first period has another closed form


def _cut(document: dict[str, Any], elements: int) -> Scene:
    parts = [part | {"elements": elements} for part in document["body"]["segments"]]
    return Scene.model_validate(document | {"body": document["body"] | {"segments": parts}})


def _gain(scene: Scene) -> float:
    """The gain of the last of two periods, or that of the whole run."""
    if scene.drive.period is None:
        return float(simulate(scene, rate=1.0).net_translation[-1])
    return float(simulate(scene, 2.0, 1.0).per_period[-1])


def _differences(document: dict[str, Any], key: str, value: float) -> tuple[float, float, float]:
    """Differentiate the gain by differences over several cells of fine grids: to less, to more, and their errors."""
    sides = []
    step = _STEP * value
    for elements in _FINE:
        scenes = vary(_cut(document, elements), {key: [value - step, value, value + step]})
        sides.append(np.diff([_gain(scene) for scene in scenes]) / step)
    less, more = np.mean(sides, axis=0)
    return float(less), float(more), 2.0 * float(np.std(sides, axis=0, ddof=1).max()) / len(_FINE) ** 0.5


def _keys(document: dict[str, Any]) -> list[str]:
    """Choose numbers of all parts of a body on one segment."""
    if "wave" in document["drive"]:
        return ["drive.wave.amplitude", "drive.friction_wave.mean", "body.segments[0].stiffness"]
    (part,) = document["body"]["segments"]
    entry = {True: ".value[1]", False: ""}[isinstance(part["stiffness"], dict)]
    names = [f"body.segments[0].{name}{entry}" for name in ("friction.forward", "friction.backward", "stiffness")]
    return [*names, f"drive.actuation[1][{len(document['drive']['actuation'][0]) - 1}]"]


def compare_with_differences(seed: int, elements: int) -> tuple[int, int]:
    """Compare derivatives of a random body; returns how many agree, and how many are flagged instead."""
    document, _ = unequal(seed)
    scene, keys = _cut(document, elements), _keys(document)
    found = sensitivities(scene, keys, None if scene.drive.period is None else 2.0, 1.0)
    ours = found.net_translation[-1] if scene.drive.period is None else found.per_period[-1]
    gain, agree, flagged = abs(_gain(_cut(document, 401))), 0, 0
    for p, key in enumerate(keys):
        if found.one_sided[p] or found.unresolved[p]:
            flagged += 1
            continue
        value = found.values[p]
        less, more, error = _differences(document, key, value)  # a kink may be within a step, on one side
        known = 0.05 * max(abs(less), abs(more), 0.02 * gain / abs(value)) + error
        assert min(less, more) - known <= ours[p] <= max(less, more) + known, (seed, key, ours[p], less, more, error)
        agree += 1
    return agree, flagged


@pytest.mark.parametrize("seed", [3, 5, 6, 7, 9, 27])
def test_derivatives_of_segments_agree_with_differences_over_several_cells_or_are_flagged(seed: int) -> None:
    agree, flagged = compare_with_differences(seed, 80)
    assert agree + flagged >= 3


@pytest.mark.slow
@pytest.mark.parametrize("kind", range(5))
def test_derivatives_of_random_segments_agree_with_differences_or_are_flagged(kind: int) -> None:
    """Of waves few are resolved, of hybrids more than half, of the other kinds most."""
    counts = np.array([compare_with_differences(seed, 80) for seed in range(kind, 55, 5)])
    agree, flagged = counts.sum(axis=0)
    assert agree > flagged or kind == _WAVES


def test_between_two_cells_a_coarse_grid_is_flagged_where_its_sides_differ() -> None:
    """With two elements the contact in the middle rests all the time if forward friction is a little larger."""
    keys = [f"body.segments[0].friction.{side}" for side in ("forward", "backward")]
    found = sensitivities(segment(0.2, elements=2), keys, 3.0, 2.0)
    assert found.one_sided.all()
    assert found.kinks


def test_derivatives_that_the_elements_do_not_resolve_are_flagged() -> None:
    document, _ = unequal(9)
    found = sensitivities(_cut(document, 40), _keys(document), 2.0, 1.0)
    assert found.unresolved.any()
    assert not found.differentiable
    assert "dependent on the elements" in repr(found)
    assert "dependent on the elements" in found._repr_html_()


def test_bodies_without_segments_depend_on_no_elements() -> None:
    found = sensitivities(load_scene("two_contacts_anisotropic"), ["friction.forward"], 2.0)
    assert not found.unresolved.any()
    assert found.tolerance == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_work_and_shape_have_the_derivatives_of_the_grid(seed: int) -> None:
    """They do not jump where another contact comes to rest; contacts begin to slide one after another."""
    document, _ = unequal(seed)
    scene, keys = _cut(document, 31), _keys(document)
    duration = None if scene.drive.period is None else 2.0
    found = sensitivities(scene, keys, duration, 3.0)
    for p, key in enumerate(keys):
        step = 1e-6 * abs(float(found.values[p]))
        runs = [simulate(one, duration, 3.0) for one in vary(scene, {key: found.values[p] + np.array([-step, step])})]
        work = (runs[1].energy.work - runs[0].energy.work) / (2.0 * step)
        shape = np.diff(runs[1].displacement - runs[0].displacement, axis=1) / (2.0 * step)
        assert abs(found.work[p] - work) <= 1e-5 * max(abs(work), abs(runs[0].energy.work / found.values[p]))
        ours = np.diff(found.displacement[..., p], axis=1)
        assert np.abs(ours - shape).max() <= 1e-4 * max(
            np.abs(shape).max(), np.ptp(runs[0].displacement) * 1e-3 / abs(found.values[p])
        )
