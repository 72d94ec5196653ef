"""Derivatives of bodies with segments: of the continuous body, not of its elements."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_lab import sensitivities, vary
from crawler_lab.derivative.parameters import differentiate_arrays
from crawler_lab.derivative.tangent_path import Stretch, TangentPath, build_vertices
from crawler_model import Scene, load_scene, simulate
from crawler_model.crawler.budget import default_budget
from crawler_model.motion.account import ACCOUNT_SIZE
from crawler_model.motion.follow import build_motion
from crawler_model.motion.pieces import follow_pieces

from ...instrument.model.segments import segment, unequal, various

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
    """The gain of the last of two periods, or of the whole run."""
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


@pytest.mark.parametrize("seed", [11, 13, 42, 48])
def test_derivatives_that_scatter_from_grid_to_grid_are_resolved_by_their_mean(seed: int) -> None:
    document, _ = unequal(seed)
    found = sensitivities(_cut(document, 80), _keys(document), None if "period" not in document["drive"] else 2.0, 1.0)
    assert not found.unresolved.any()
    assert 0.0 < found.tolerance < 0.05


def test_where_a_segment_slides_within_an_element_next_to_its_end_small_derivatives_are_flagged() -> None:
    """Backward friction is so strong that what slides backward is shorter: on these grids, but not on finer ones, 0."""
    document, _ = unequal(77)
    found = sensitivities(_cut(document, 80), _keys(document), 2.0, 1.0)
    assert found.unresolved.tolist() == [False, True, False, False]


def test_later_periods_are_judged_beside_themselves_and_waves_by_the_gain() -> None:
    """A first period goes far, and of waves all grids share the error of the gain, 12 % on the coarsest."""
    for seed, flags in ((137, [True, False, True, True]), (229, [True, True, True])):
        document, _ = unequal(seed)
        assert sensitivities(_cut(document, 80), _keys(document), 2.0, 1.0).unresolved.tolist() == flags


def test_the_derivatives_of_contacts_add_up_to_those_of_the_net_translation() -> None:
    scene = _cut(unequal(42)[0], 31)
    found = sensitivities(scene, _keys(unequal(42)[0]), 2.0, 4.0)
    translation = np.einsum("n,tnp->tp", scene.body.share, found.displacement)
    np.testing.assert_allclose(translation, found.net_translation, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.diff(translation[::4], axis=0), found.per_period, rtol=1e-9, atol=1e-9)


def _follow(scene: Scene, keys: list[str], steady: bool, monkeypatch: pytest.MonkeyPatch) -> tuple[Stretch, Any, Any]:
    """Differentiate two periods; unless steady, from pieces with the velocities of all contacts, one by one."""
    derivatives = differentiate_arrays(scene, keys, "test")
    path = TangentPath(scene, derivatives, samples=True)
    with monkeypatch.context() as patch:
        if not steady:
            patch.setattr(TangentPath, "_find_steady", lambda _, vertices: np.zeros(vertices.time_ns.size, np.bool_))
        stretch = path.follow_vertices(
            build_vertices(scene.drive, derivatives, 0, np.array([400_000_000, 1_000_000_000]))
        )
    return stretch, path.one_sided.copy(), {(ramp, contact) for ramp, _, contact in path.kinks}


def _various(name: str) -> tuple[Scene, list[str]]:
    """A body by its kind and its seed or number of elements, and numbers of it."""
    kind, number = name.split()
    if kind == "even":
        scene = segment(0.2, elements=int(number), friction={"forward": 0.11, "backward": 0.3})
        return scene, ["body.segments[0].friction.forward", "body.segments[0].stiffness", "drive.actuation[1][0]"]
    document = (unequal if kind == "unequal" else various)(int(number))[0]
    return _cut(document, 25), _keys(document) if kind == "unequal" else [
        "body.segments[0].stiffness",
        "drive.actuation",
    ]


@pytest.mark.parametrize(
    "name",
    ["even 300", *(f"unequal {seed}" for seed in range(10)), *(f"various {seed}" for seed in range(9) if seed != 7)],
)
def test_what_events_change_is_enough_for_the_derivatives(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, keys = _various(name)
    by_changes, by_pieces = (_follow(scene, keys, steady, monkeypatch) for steady in (True, False))
    for part in ("dx", "d_work", "work", "speed"):
        ours, theirs = (np.asarray(getattr(stretch, part)) for stretch in (by_changes[0], by_pieces[0]))
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-9 * max(np.abs(theirs).max(), 1e-6))
    np.testing.assert_array_equal(by_changes[1], by_pieces[1])
    assert by_changes[2] == by_pieces[2]


def test_what_events_change_grows_with_the_number_of_elements() -> None:
    """The velocities of all contacts at every event would grow with its square."""
    sizes = []
    for elements in (150, 300):
        scene = segment(0.2, elements=elements)
        motion: Any = build_motion(scene)
        state = motion.start(scene.start_displacement, scene.drive.targets[0])
        targets, account = scene.drive.targets[1:].copy(), np.zeros(ACCOUNT_SIZE)
        records = np.empty((len(targets), 2 * scene.body.contacts + scene.body.springs))
        budget = default_budget(scene.body)
        sizes.append(follow_pieces(motion, state, motion.scratch(), targets, budget, account, records, True).size)
    assert sizes[0] > 150
    assert sizes[1] <= 2.2 * sizes[0]


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
