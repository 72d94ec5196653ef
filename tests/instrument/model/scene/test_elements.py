"""How many elements a segment is cut into, against closed forms and much finer meshes."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Crawler, Scene, SceneError, load_scene, simulate
from crawler_model.scene.assemble import _largest_change
from crawler_model.scene.elements import count_elements
from crawler_model.scene.friction_parts import TablePart, average

from ..segments import VARIOUS, accuracies, closed_form, gains, random_homogeneous, segment, unequal, various

PARAMETERS = [
    (1.0, 1.0, 0.1, 0.3, 0.1),
    (1.0, 1.0, 0.1, 0.3, 0.2),
    (2.0, 3.0, 0.37, 0.5, 0.9),
    (0.1, 50.0, 30.0, 7.0, 0.02),
    (1.0, 1.0, 0.05, 0.7, 0.2),
    (1.0, 1.0, 0.9, 1.0, 3.0),
]


@pytest.mark.parametrize("parameters", PARAMETERS)
@pytest.mark.parametrize("accuracy", [0.2, 0.05, 0.01, 0.003])
def test_a_segment_is_as_accurate_as_asked_and_no_finer_than_four_times_needed(parameters, accuracy):
    length, modulus, forward, backward, stroke = parameters
    exact = closed_form(*parameters)
    given = {"to": length, "stiffness": modulus, "friction": {"forward": forward, "backward": backward}}

    first = simulate(segment(stroke, elements=1601, **given), duration=1, rate=1.0).per_period[0]

    def error(scene):
        return np.abs(simulate(scene, duration=3, rate=1.0).per_period - [first, exact, exact]).max() / (
            length * stroke
        )

    scene = segment(stroke, accuracy=accuracy, **given)
    elements = scene.body.segments[0].elements
    assert error(scene) <= accuracy
    errors = np.array([error(segment(stroke, elements=n, **given)) for n in range(1, 161)])
    needed = 1 + int(np.flatnonzero(errors > accuracy).max(initial=-1)) + 1
    assert elements <= 4 * needed
    if needed <= 100:  # beyond, finer grids than were tried could still fail
        assert elements >= needed


def test_a_heterogeneous_segment_is_as_accurate_as_asked():
    scene = load_scene("heterogeneous_segment")
    document = scene.document()
    document["body"]["segments"][0] |= {"elements": 1201}
    fine = simulate(Scene.model_validate(document), duration=3, rate=1.0).per_period[1:]
    gained = simulate(scene, duration=3, rate=1.0).per_period[1:]
    assert np.abs(gained - fine).max() <= scene.parts.body.segments[0].accuracy * 0.4


@pytest.mark.parametrize("name", ["peristaltic_segment", "friction_wave_segment"])
def test_waves_along_a_segment_are_as_accurate_as_asked(name):
    scene = load_scene(name)
    document = scene.document()
    document["body"]["segments"][0] |= {"elements": 401}
    fine = simulate(Scene.model_validate(document), duration=3, rate=1.0).per_period[1:]
    gained = simulate(scene, duration=3, rate=1.0).per_period[1:]
    assert np.abs(gained - fine).max() <= scene.parts.body.segments[0].accuracy * 0.6
    assert np.abs(gained).min() > 0.1  # it does travel


def test_elements_are_counted_by_predictions_and_the_envelope_of_the_errors():
    def count(error, accuracy, predicted=0.0):
        return count_elements(
            lambda n: np.array([error(n), 0.0, 0.0]), np.zeros(3), lambda n: predicted / n, 1.0, accuracy
        )

    assert count(lambda n: 0.0, 1e-3) == 1
    assert 500 <= count(lambda n: 0.5 * (-1) ** n / n, 1e-3) <= 2000
    assert 223 <= count(lambda n: 0.5 / n**2, 1e-5) <= 900
    assert 500 <= count(lambda n: 0.0, 1e-3, predicted=0.5) <= 1000  # meshes that were lucky, all that were tried
    with pytest.raises(SceneError, match="elements"):
        count(lambda n: 100.0 / n, 1e-6)


@pytest.mark.parametrize("accuracy", [0.1, 0.01, 1e-3, 1e-4])
@pytest.mark.parametrize("stroke", [0.02, 0.04, 0.07])
def test_the_first_period_is_as_accurate_as_asked(stroke, accuracy):
    """While its middle stays at rest it moves only in the first period, by D^3/6 (1/mu_plus^2 - 1/mu_minus^2)."""
    exact = stroke**3 / 6.0 * (0.1**-2 - 0.3**-2)
    scene = segment(stroke, accuracy=accuracy)
    gained = simulate(scene, duration=2.0, rate=1.0).per_period
    np.testing.assert_allclose(gained, [exact, 0.0], atol=accuracy * stroke)


def _check(document, accuracy):
    """Check a body against fine grids, in all periods and in the uniqueness of its motion."""

    def run(**cut):
        parts = [part | cut for part in document["body"]["segments"]]
        scene = Scene.model_validate(document | {"body": document["body"] | {"segments": parts}})
        if scene.drive.period is None:
            found = simulate(scene, rate=1.0)
            return scene, found.waypoint_net_translation, found.unique
        found = simulate(scene, duration=5.0, rate=1.0)
        return scene, found.per_period, found.unique

    scene, gained, unique = run(accuracy=accuracy)
    # meshes whose contacts lie differently: the mean of their errors vanishes to first order
    fine = [run(elements=n)[1:] for n in (397, 419, 443, 467, 491)]
    known = 0.25 / 400 * _largest_change(scene)
    exact = np.mean([each for each, _ in fine], axis=0)
    assert np.abs(gained - exact).max() <= accuracy * _largest_change(scene) + known, document["name"]
    assert unique in [each for _, each in fine]
    return scene


@pytest.mark.parametrize("seed", range(len(VARIOUS)))
def test_bodies_of_all_kinds_are_as_accurate_as_asked_from_the_first_period_on(seed):
    scene = _check(*various(seed))
    assert len({segment.elements for segment in scene.body.segments}) == 1  # equal chambers have equal elements


@pytest.mark.slow
def test_eighty_bodies_are_as_accurate_as_asked_from_the_first_period_on():
    for seed in range(40):
        _check(*various(seed))
        _check(*unequal(seed))


def test_a_segment_whose_middle_does_not_touch_the_ground_moves_in_more_than_one_way():
    """Between both ends, which hold with equal friction, the body may stand anywhere."""
    table = {"at": [0.0, 0.3, 0.31, 0.69, 0.7, 1.0], "value": [0.1, 0.1, 0.0, 0.0, 0.1, 0.1]}
    widths = []
    for cut in ({"accuracy": 0.03}, {"accuracy": 0.01}, {"elements": 601}):
        scene = segment(0.3, friction={"isotropic": table}, **cut)
        step = Crawler(scene).follow(scene.drive.targets[1:])
        assert not step.unique
        widths.append(step.translation_interval)
    np.testing.assert_allclose(widths[0], widths[2], atol=0.03 * 0.3 * 2)
    np.testing.assert_allclose(widths[1], widths[2], atol=0.01 * 0.3 * 2)


@pytest.mark.parametrize("stroke", [0.3, -0.3])
def test_a_segment_with_friction_in_either_direction_everywhere_moves_in_one_way(stroke):
    """A point at rest is held by the friction before and behind it together."""
    forward = {"at": [0.0, 0.5, 0.5001, 1.0], "value": [0.1, 0.1, 0.0, 0.0]}
    backward = {"at": [0.0, 0.5, 0.5001, 1.0], "value": [0.0, 0.0, 0.1, 0.1]}
    for elements in (1, 2, 5, 8):
        run = simulate(segment(stroke, elements=elements, friction={"forward": forward, "backward": backward}), 2.0)
        assert run.unique, elements


@pytest.mark.parametrize("family", range(5))
def test_very_unequal_friction_tables_hybrids_and_waves_are_as_accurate_as_asked(family):
    for seed in range(family, 30, 5):
        document, accuracy = unequal(seed)
        scene, gained = gains(document, accuracy=accuracy)
        # meshes whose contacts lie differently: the mean of their errors vanishes to first order
        fine = np.mean([gains(document, elements=n)[1] for n in (397, 419, 443, 467, 491)], axis=0)
        asked = accuracy * _largest_change(scene)
        known = 0.25 / 400 * _largest_change(scene)
        assert np.abs(gained - fine).max() <= asked + known, (seed, scene.name)


@pytest.mark.parametrize("accuracy", [1e-2, 3e-3, 1e-3, 3e-4])
@pytest.mark.parametrize("share", [1.34e-3, 1e-2, 0.31])
def test_where_the_body_stands_in_the_first_cell_of_coarse_meshes(share, accuracy):
    """Of a homogeneous segment the closed form tells; elements by the thousand stay below four times 1 / accuracy."""
    parameters = length, modulus, forward, backward, stroke = 0.037, 5e3, 10.0 * share, 10.0 * (1.0 - share), 1e-3
    friction = {"forward": forward, "backward": backward}
    scene = segment(stroke, accuracy=accuracy, to=length, stiffness=modulus, friction=friction)
    gained = simulate(scene, duration=3, rate=1.0).per_period[1:]
    assert np.abs(gained - closed_form(*parameters)).max() <= accuracy * length * stroke
    assert scene.body.segments[0].elements <= 4 / accuracy


def test_short_waves_are_resolved():
    friction = {"amplitude": 0.1, "mean": 0.2, "period": 1.0, "wavelength": 1 / 293.5, "samples": 8}
    part = {"name": "foot", "from": 0, "to": 1, "stiffness": 1, "friction": {"isotropic": 0.2}, "accuracy": 0.01}
    drive = {"friction_wave": friction, "wave": friction | {"wavelength": 0.8, "amplitude": 0.6, "mean": 0.0}}
    scene = Scene.model_validate({"name": "x", "body": {"segments": [part]}, "drive": drive, "start": "relaxed"})
    assert 4 * 293.5 <= scene.body.segments[0].elements <= 4 * 294


def test_the_compliance_of_an_element_is_the_integral_of_one_over_the_modulus():
    """1 / k of a modulus that falls from a to b over a length: length ln(a / b) / (a - b), also where it is steep."""
    table = {"at": [0.0, 0.5, 0.75, 1.0], "value": [200.0, 0.5, 0.5, 200.0]}
    piece = np.log(200.0 / 0.5) / 199.5
    for elements in (1, 4, 7):
        scene = segment(0.1, elements=elements, stiffness=table)
        assert np.sum(1.0 / scene.body.stiffness) == pytest.approx(0.5 * piece + 0.25 / 0.5 + 0.25 * piece, rel=1e-12)


def test_tables_are_averaged_exactly_between_their_kinks():
    edges = np.array([0.0, 0.5, 2.0])
    kink = average(TablePart.model_validate({"at": [0.0, 0.2, 2.0], "value": [0.2, 0.0, 1.8]}), edges)
    assert kink == pytest.approx([(0.02 + 0.045) / 0.5, (1.62 - 0.045) / 1.5], rel=1e-13)


def test_elements_override_accuracy_and_are_kept_in_the_document():
    scene = segment(0.2, accuracy=0.01)
    assert scene.document()["body"]["segments"][0]["elements"] == scene.body.segments[0].elements
    assert segment(0.2, accuracy=0.01, elements=7).body.segments[0].elements == 7


def test_without_a_drive_an_accuracy_is_the_size_of_an_element():
    document = segment(0.2, elements=1).document()
    del document["drive"], document["body"]["segments"][0]["elements"]
    document["body"]["segments"][0]["accuracy"] = 0.03
    assert Scene.model_validate(document).body.segments[0].elements == 34


def test_two_segments_in_one_body_are_together_as_accurate_as_asked():
    parts = [
        {"name": name, "from": at, "to": at + 1.0, "stiffness": 1.0, "accuracy": 0.02}
        | {"friction": {"forward": forward, "backward": 0.3}}
        for name, at, forward in (("rear", 0.0, 0.1), ("front", 2.0, 0.13))
    ]
    scene = {
        "name": "two",
        "body": {"segments": parts, "links": {"stiffness": 2.0}},
        "drive": {
            "times": [0, 0.3, 0.6, 1],
            "period": 1,
            "actuation": [[0, 0, 0], [0, 0.4, 0], [0.2, 0.4, 0.5], [0, 0, 0]],
        },
    }
    rough = Scene.model_validate(scene)
    assert all(1 < s.elements < 400 for s in rough.body.segments)
    fine = Scene.model_validate(
        {**scene, "body": {**scene["body"], "segments": [p | {"elements": 401} for p in parts]}}
    )
    gained, exact = (simulate(s, duration=3.0, rate=1.0).per_period[1:] for s in (rough, fine))
    assert np.abs(gained - exact).max() <= 0.02 * 0.5
    assert np.abs(exact).min() > 0.01


@pytest.mark.parametrize("block", range(3))
def test_random_homogeneous_segments_are_as_accurate_as_asked(block):
    for seed in range(15 * block, 15 * block + 15):
        assert accuracies(*random_homogeneous(seed)) <= 1.0, seed
