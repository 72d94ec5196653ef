"""Derivatives of runs against central differences, closed forms and constructed kinks."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crawler_lab import Sensitivities, sensitivities, vary
from crawler_lab.derivative import parameters
from crawler_model import CommandError, Scene, SceneError, load_scene, simulate

from ...instrument.model.motion.test_turning import build, wriggle
from .drawn import KEYS, SEGMENT_KEYS, differences, draw, draw_bent, draw_segment

DURATION, RATE = 3.0, 7.0


def compare(document: dict[str, Any], keys: tuple[str, ...]) -> int:
    """Compare all derivatives of a run with differences; return how many were compared."""
    found = sensitivities(Scene.model_validate(document), keys, DURATION, RATE)
    assert found.differentiable
    return compare_columns(found, document)


def compare_columns(found: Sensitivities, document: dict[str, Any]) -> int:
    """Compare derivatives with differences, where they are two-sided; return how many were compared."""
    compared = 0
    for p, name in enumerate(found.parameters):
        expected = None if found.one_sided[p] else differences(document, name, DURATION, RATE)
        if expected is None:
            continue
        ours = np.concatenate((found.displacement[..., p].ravel(), found.per_period[:, p], [found.work[p]]))
        assert np.abs(ours - expected).max() <= 1e-8 * (1.0 + np.abs(ours).max()), name
        compared += 1
    return compared


@pytest.mark.parametrize("seed", range(24))
def test_random_crawlers_agree_with_differences(seed: int) -> None:
    document = draw(seed)
    assert compare(document, KEYS) >= 5


@pytest.mark.parametrize("seed", [1, 5, 10, 14, 21, 23, 25, 27])
def test_random_bent_crawlers_agree_with_differences(seed: int) -> None:
    """Links with limits, curves, return springs and stops, with respect to all their numbers.

    In the scene of seed 10 a spring is at a knot at the very end of a ramp.
    """
    document, keys = draw_bent(seed)
    found = sensitivities(Scene.model_validate(document), keys, DURATION, RATE)
    assert compare_columns(found, document) >= 5


def test_each_number_has_the_derivative_of_the_side_on_which_it_does_not_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first number jumps for larger values, the second one for smaller ones, the third for both."""
    scene = Scene.model_validate(motor(2.0))

    def arrays(value: float) -> np.ndarray:
        jumps = value > 1.0, -(value < 1.0), np.sign(value - 1.0), 0.0
        return np.array([2.0, 3.0, 4.0, 1.0]) * value + np.array(jumps, dtype=float)

    monkeypatch.setattr(parameters, "Variations", lambda _, columns, shape: [next(iter(columns.values()))[0]])
    monkeypatch.setattr(parameters, "_flat", lambda value: arrays(1.0 if value is scene else float(value))[None])
    monkeypatch.setattr(parameters, "_sizes", lambda _: np.abs(arrays(1.0)))
    found, jumps = parameters._differentiate_alone(scene, "x", 1.0, ("x",), "test")
    np.testing.assert_allclose(found, [2.0, 3.0, 0.0, 1.0], atol=1e-6)
    assert jumps


def test_a_start_that_jumps_on_both_sides_has_no_derivative_and_does_not_spoil_others() -> None:
    """A relaxed start leaves a slack contact where it is; where its tendon pulls, it moves to where it does not."""
    document, _ = draw_bent(111)
    scene, keys = Scene.model_validate(document), ("body.links[1].tension.least", "body.links[1].stiffness")
    both, alone = sensitivities(scene, keys, DURATION, RATE), sensitivities(scene, keys[1:], DURATION, RATE)
    assert both.one_sided[0]
    assert both.one_sided[1] == alone.one_sided[0]
    assert (np.abs(both.displacement) < 10.0).all()
    np.testing.assert_array_equal(both.displacement[..., 1:], alone.displacement)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(100, 300, 20))
def test_hundreds_of_random_bent_crawlers_agree_with_differences(first: int) -> None:
    compared = 0
    for seed in range(first, first + 20):
        document, keys = draw_bent(seed)
        compared += compare_columns(sensitivities(Scene.model_validate(document), keys, DURATION, RATE), document)
    assert compared >= 500


def motor(stall: float) -> dict[str, Any]:
    """Two contacts whose motor stalls; the gain of a period is D - 2 mu / k, or 0 if the stall force is below mu."""
    return {
        "name": "motor",
        "body": {
            "contacts": [0.0, 1.0],
            "links": [{"stiffness": 8.0, "tension": {"least": -stall, "most": stall}}],
        },
        "friction": {"forward": 0.5, "backward": 8.0},
        "drive": {"times": [0.0, 1.0, 2.0], "period": 2.0, "actuation": [[0.0], [1.0], [0.0]]},
    }


def test_derivatives_of_a_motor_are_those_of_its_closed_form() -> None:
    keys = ["body.links[0].stiffness", "body.links[0].tension.most", "friction.forward", "drive.actuation[1][0]"]
    strong = sensitivities(Scene.model_validate(motor(2.0)), keys, 20.0, 10.0)
    np.testing.assert_allclose(strong.per_period[-1], [2.0 * 0.5 / 64.0, 0.0, -2.0 / 8.0, 1.0], atol=1e-12)
    weak = sensitivities(Scene.model_validate(motor(0.4)), keys, 20.0, 10.0)
    assert (weak.per_period == 0.0).all()
    assert weak.work[1] == 0.0


def test_a_tendon_has_the_derivatives_of_its_closed_form() -> None:
    """The gain is (k_t D - mu)/(k_t + k_p) - mu/k_p."""
    document = motor(1.0)
    document["body"]["links"] = [{"stiffness": 8.0, "tension": {"least": 0.0}, "passive": {"stiffness": 2.0}}]
    keys = ["body.links[0].stiffness", "body.links[0].passive.stiffness", "friction.forward"]
    document["drive"]["actuation"] = [[0.0], [-1.0], [0.0]]
    found = sensitivities(Scene.model_validate(document), keys, 20.0, 10.0)
    expected = [(2.0 + 0.5) / 100.0, -(8.0 - 0.5) / 100.0 + 0.5 / 4.0, -1.0 / 10.0 - 1.0 / 2.0]
    np.testing.assert_allclose(found.per_period[-1], expected, atol=1e-12)


def test_a_stop_that_is_just_reached_is_a_kink() -> None:
    document = motor(2.0)
    document["body"]["links"] = [
        {"stiffness": 8.0, "passive": {"stops": {"shortest": -1.0, "longest": 0.9375, "stiffness": 100.0}}}
    ]
    key = "body.links[0].passive.stops.longest"
    found = sensitivities(Scene.model_validate(document), [key], 2.0, 10.0)
    assert found.one_sided.all()
    assert found.kinks[0].contacts == ("contact 0", "contact 1")


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 1000, 100))
def test_a_thousand_random_crawlers_agree_with_differences(first: int) -> None:
    assert sum(compare(draw(seed), KEYS) for seed in range(first, first + 100)) >= 1000


@pytest.mark.parametrize("seed", range(4))
def test_shape_and_work_of_random_segments_agree_with_differences(seed: int) -> None:
    """The translation belongs to the continuous body, where the point at rest moves; on a grid it jumps."""
    document = draw_segment(seed)
    found = sensitivities(Scene.model_validate(document), SEGMENT_KEYS, DURATION, RATE)
    assert not found.one_sided.any()
    compared, shape = 0, found.displacement.shape[:2]
    for p, name in enumerate(found.parameters):
        expected = differences(document, name, DURATION, RATE)
        if expected is None:
            continue
        ours = np.append(np.diff(found.displacement[..., p]), found.work[p])
        moved = expected[: shape[0] * shape[1]].reshape(shape)
        grid = np.append(np.diff(moved), expected[-1])
        assert np.abs(ours - grid).max() <= 1e-8 * (1.0 + np.abs(expected).max()), name
        compared += 1
    assert compared >= 5


@pytest.mark.parametrize("key", ["drive.wave.amplitude", "drive.wave.wavelength", "friction.forward"])
def test_waves_agree_with_differences(key: str) -> None:
    document = load_scene("ten_contact_wave").document()
    assert compare(document, (key,)) == 1


def test_the_instants_of_waypoints_passed_in_a_straight_line_do_not_matter() -> None:
    document = draw(3)
    drive = document["drive"]
    a, b = np.array(drive["actuation"][0]), np.array(drive["actuation"][1])
    drive["actuation"].insert(1, (a + 0.3 * (b - a)).tolist())
    drive["times"].insert(1, 0.3 * drive["times"][1])
    found = sensitivities(
        Scene.model_validate(document), ["drive.times[1]", "drive.times[2]", "drive.period"], 3.0, 1.0
    )
    size = np.abs(simulate(Scene.model_validate(document), 3.0, 1.0).per_period).max()
    assert np.abs(found.per_period).max() <= 1e-12 * size


def test_two_contacts_gain_as_the_closed_form_says() -> None:
    scene = load_scene("two_contacts_anisotropic")  # the gain is D - 2 mu_plus / k, the less for a softer link
    run = simulate(scene, 5.0, 1.0)
    stiffness = scene.body.stiffness[0]
    forward = scene.drive.forward[0, 0]
    found = sensitivities(scene, ["body.links.stiffness", "friction.forward"], 5.0, 1.0)
    assert run.per_period[-1] == pytest.approx(np.ptp(scene.drive.actuation) - 2.0 * forward / stiffness, abs=1e-15)
    assert found.per_period[-1] == pytest.approx([2.0 * forward / stiffness**2, -2.0 / stiffness], rel=1e-12)


def test_a_key_that_names_a_table_counts_for_each_number() -> None:
    scene = load_scene("three_contacts_two_ways")
    waypoints, links = len(scene.drive.times), 2
    found = sensitivities(scene, ["drive.actuation", "body.links.stiffness"], 2.0, 1.0)
    assert found.parameters[: waypoints * links] == tuple(
        f"drive.actuation[{row}][{link}]" for row in range(waypoints) for link in range(links)
    )
    assert found.displacement.shape == (3, 3, len(found.parameters))
    assert found.per_period.shape == (2, len(found.parameters))
    assert found.values[0] == scene.drive.actuation[0, 0]


def test_the_last_row_of_a_closed_drive_follows_the_first() -> None:
    document = load_scene("three_contacts_two_ways").document()
    assert document["drive"]["times"][-1] == document["drive"]["period"]
    closed = sensitivities(Scene.model_validate(document), ["drive.actuation"], 3.0, 3.0)
    for part in ("times", "actuation"):
        document["drive"][part] = document["drive"][part][:-1]
    opened = sensitivities(Scene.model_validate(document), ["drive.actuation"], 3.0, 3.0)
    count = len(opened.parameters)
    assert np.array_equal(closed.displacement[..., :count], opened.displacement)
    assert not closed.displacement[..., count:].any()


def test_results_do_not_depend_on_the_ticks() -> None:
    scene = Scene.model_validate(draw(8))
    coarse = sensitivities(scene, KEYS, 4.0, 1.0)
    fine = sensitivities(scene, KEYS, 4.0, 50.0)
    size = np.abs(coarse.displacement).max()
    assert np.abs(fine.displacement[::50] - coarse.displacement).max() <= 1e-12 * size
    assert np.abs(fine.work - coarse.work).max() <= 1e-12 * np.abs(coarse.work).max()


# -- kinks ----------------------------------------------------------------------------------------------------------


def pull(times: list[float], rows: list[list[float]], **more: Any) -> dict[str, Any]:
    """Two contacts, a link of 1 N/m, friction 1 N both ways."""
    return {
        "name": "kinks",
        "body": {"contacts": [0.0, 5.0], "links": {"stiffness": 1.0}},
        "friction": {"forward": [1.0, 1.0], "backward": [1.5, 1.5]},
        "drive": {"times": times, "actuation": rows},
    } | more


def test_a_waypoint_on_a_plateau_is_a_kink() -> None:
    scene = Scene.model_validate(pull([0.0, 1.0, 2.0, 3.0], [[0.0], [3.0], [3.0], [0.0]]))
    found = sensitivities(scene, ["drive.actuation"], 3.0, 10.0)
    assert not found.differentiable
    assert found.one_sided.tolist() == [False, False, True, False] or found.one_sided[2]
    assert any(kink.time == pytest.approx(2.0) and kink.contacts for kink in found.kinks)


def test_a_contact_that_starts_at_its_bound_is_a_kink() -> None:
    scene = Scene.model_validate(
        pull([0.0, 1.0], [[0.0], [2.0]]) | {"start": {"displacement": [0.0, 1.0]}}
    )  # the left contact is pulled by its forward friction
    found = sensitivities(scene, ["friction.forward[0]", "body.links.stiffness"], 1.0, 10.0)
    assert found.one_sided.all()
    assert "contact 0" in {name for kink in found.kinks for name in kink.contacts}


def test_a_waypoint_where_a_contact_just_reaches_its_bound_is_a_kink() -> None:
    scene = Scene.model_validate(pull([0.0, 1.0, 2.0], [[0.0], [-1.0], [0.0]]))  # |T| = 1 N at the waypoint
    found = sensitivities(scene, ["drive.actuation[1][0]"], 2.0, 10.0)
    assert not found.differentiable
    for step, slope in ((1e-3, None), (-1e-3, None)):
        scene = Scene.model_validate(pull([0.0, 1.0, 2.0], [[0.0], [-1.0 + step], [0.0]]))
        assert sensitivities(scene, ["drive.actuation[1][0]"], 2.0, 10.0).differentiable, slope


@pytest.mark.parametrize("duration", [1.0, 2.0])
def test_a_contact_that_reaches_its_bound_as_a_result_is_taken_makes_a_kink(duration: float) -> None:
    """At t = 1 s, at the end of the run or at a tick, the force is just at its bound: with a longer pull x moves."""
    scene = Scene.model_validate(pull([0.0, 2.0], [[0.0], [-2.0]]))
    found = sensitivities(scene, ["drive.actuation[1][0]"], duration, 10.0)
    assert found.one_sided.all()
    (kink,) = [kink for kink in found.kinks if kink.time == pytest.approx(1.0)]
    assert kink.contacts
    sides = []
    for step in (-1e-3, 1e-3):
        moved = Scene.model_validate(pull([0.0, 2.0], [[0.0], [-2.0 - step]]))
        other = sensitivities(moved, ["drive.actuation[1][0]"], duration, 10.0)
        assert other.differentiable
        sides.append(np.abs(other.displacement[10]).max())
    assert sides[0] == 0.0
    assert sides[1] > 0.1
    assert sensitivities(scene, ["drive.actuation[1][0]"], 2.0, 2.5).differentiable  # no tick at 1 s


def test_two_events_at_once_are_a_kink_only_if_a_contact_stops() -> None:
    # three contacts pulled alike from both sides: the outer ones begin to slide together, and nobody stops
    document = {
        "name": "tie",
        "body": {"contacts": [0.0, 1.0, 2.0], "links": {"stiffness": [1.0, 1.0]}},
        "friction": {"forward": [0.5, 1.0, 1.0], "backward": [1.0, 1.0, 0.5]},
        "drive": {"times": [0.0, 1.0], "actuation": [[0.0, 0.0], [-2.0, -2.0]]},
    }
    found = sensitivities(Scene.model_validate(document), ["friction.forward[0]", "body.links.stiffness"], 1.0, 10.0)
    assert found.differentiable


def test_friction_that_leaves_the_translation_open_is_a_kink() -> None:
    scene = load_scene("two_contacts_critical")
    found = sensitivities(scene, ["drive.actuation[1][0]", "friction.forward"], 2.0, 2.0)
    assert found.one_sided[-1]


def compare_with_steps(scene: Scene, keys: list[str], duration: float) -> None:
    """Compare derivatives with differences of one small step."""
    found, step = sensitivities(scene, keys, duration, 4.0), 1e-7
    assert found.differentiable
    run = simulate(scene, duration, 4.0)
    for p, key in enumerate(keys):
        (other,) = vary(scene, {key: [found.values[p] + step]})
        difference = (simulate(other, duration, 4.0).displacement - run.displacement) / step
        assert np.abs(found.displacement[..., p] - difference).max() < 1e-6, key


@pytest.mark.parametrize("contact", [1, 2])
@pytest.mark.parametrize("rows", [[[-1.0, -0.3], [-1.0, -0.3]], [[0.1, 0.0], [0.05, 0.0], [0.05, 0.0], [0.0, 0.1]]])
def test_a_contact_without_friction_rests_at_the_bound_at_which_it_slid_last(contact: int, rows: list[Any]) -> None:
    """On a plateau nothing moves; with a little friction that contact would stay where it stopped."""
    forward, backward = [0.3, 0.25, 0.2], [0.5, 0.45, 0.6]
    forward[contact] = backward[contact] = 0.0
    document = {
        "name": "rest",
        "body": {"contacts": [0.0, 1.0, 2.0], "links": {"stiffness": [1.0, 2.0]}},
        "friction": {"forward": forward, "backward": backward},
        "drive": {"times": list(range(1 + len(rows))), "actuation": [[0.0, 0.0], *rows]},
    }
    scene = Scene.model_validate(document)
    compare_with_steps(scene, [f"friction.{side}[{contact}]" for side in ("forward", "backward")], float(len(rows)))


def test_level_ground_has_a_derivative_by_its_slope() -> None:
    document = pull([0.0, 1.0, 2.0], [[0.0], [4.0], [0.0]])
    document["body"] |= {"weights": 1.0}
    document |= {"friction": {"forward": 0.1, "backward": 0.3}, "ground": {"slope": 0.0}}
    assert compare(document, ("ground.slope",)) == 1
    loads = sensitivities(Scene.model_validate(document), ["loads[1]"], DURATION, RATE)
    with_loads = sensitivities(Scene.model_validate(document | {"loads": 0.0}), ["loads[1]"], DURATION, RATE)
    np.testing.assert_array_equal(loads.displacement, with_loads.displacement)
    assert np.abs(loads.displacement).max() > 0.1


@pytest.mark.parametrize("knot", [0, 1])
def test_knots_at_the_same_distance_from_zero_have_derivatives(knot: int) -> None:
    """The anchor of a piece between them must not change sides when one of them moves."""
    curve = {"elongation": [-0.25, 0.25, 0.75], "tension": [-0.25, 0.25, 1.25]}
    document = pull([0.0, 1.0, 2.0, 3.0], [[0.0], [0.6], [-0.3], [0.4]])
    document["body"] = {"contacts": [0.0, 1.0], "links": [{"curve": curve}]}
    document["friction"] = {"forward": 0.05, "backward": 0.15}
    scene = Scene.model_validate(document)
    compare_with_steps(scene, [f"body.links[0].curve.{what}[{knot}]" for what in ("elongation", "tension")], 3.0)


def test_a_relaxed_start_that_jumps_has_the_derivative_of_one_side() -> None:
    """A spring that may push rests at z = L, a tendon at z = 0, where it is slack; so it does if it must always pull."""
    document = pull([0.0, 1.0, 2.0], [[0.5], [-2.0], [0.0]])
    document["body"] = {"contacts": [0.0, 1.0], "links": [{"stiffness": 1.0, "tension": {"least": 0.0}}]}
    document["start"] = "relaxed"
    found = sensitivities(Scene.model_validate(document), ["body.links[0].tension.least", "friction.forward"], 2.0, 4.0)
    assert found.one_sided[[0, 2]].tolist() == [True, False]
    assert not found.displacement[0].any()
    assert np.isfinite(found.displacement).all()


def test_a_relaxed_start_at_zero_has_derivatives_without_rounding() -> None:
    """Contact 2 hardly leaves 0, whichever number of a curve changes, so that no two differences agree but for rounding."""
    first = {"elongation": [-0.2935, -0.1101, 0.0, 0.2401], "tension": [-0.174, 0.0, 0.0, 0.474]}
    second = {"elongation": [0.0798, 0.5385, 0.9036, 1.0232], "tension": [0.0, 0.1526, 0.2683, 0.309]}
    passive = {"elongation": [-0.5, -0.1, 0.2, 0.6], "tension": [-0.7333, -0.2333, 0.4667, 2.4667]}
    stops = {"stiffness": 140.019, "longest": 0.1722, "shortest": -0.0754}
    document = {
        "name": "mesh",
        "body": {
            "contacts": [0.627, 1.469, 1.836],
            "links": [
                {"curve": first, "between": [0, 1]},
                {"curve": second, "passive": {"stiffness": 1.3979}, "between": [1, 2]},
                {"stiffness": 1.8499, "passive": {"curve": passive, "stops": stops}, "between": [0, 2]},
            ],
        },
        "friction": {"isotropic": 1.0},
        "start": "relaxed",
        "drive": {"times": [0, 1], "actuation": [[0, 0, 0], [0.3, 0.3, 0.3]]},
    }
    found = sensitivities(Scene.model_validate(document), ["body.links[1].curve.tension"], 1.0, 1.0)
    for knot in range(4):
        starts = []
        for step in (-1e-5, 1e-5):
            tension = list(second["tension"])
            tension[knot] += step
            other = copy.deepcopy(document)
            other["body"]["links"][1]["curve"]["tension"] = tension
            starts.append(Scene.model_validate(other).start_displacement)
        assert found.displacement[0, :, knot] == pytest.approx((starts[1] - starts[0]) / 2e-5, abs=1e-8)


# -- bad input ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "keys", "message"),
    [
        ("two_anchor_a", ["drive.strategy"], "drive.strategy: 'A' is not a number"),
        ("two_anchor_a", ["friction.up"], "friction.up: unknown key"),
        ("two_anchor_a", [], "at least one key"),
        ("two_anchor_a", "drive.length", "must be a list"),
        ("two_anchor_a", ["drive.length", "drive.length"], "named twice"),
        ("three_contacts_two_ways", ["drive.times[9]"], "drive.times has 4 entries, numbered from 0"),
    ],
)
def test_keys_without_a_derivative_are_refused(name: str, keys: Any, message: str) -> None:
    with pytest.raises(SceneError, match=r"^(sensitivities|vary): ") as refused:
        sensitivities(load_scene(name), keys)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_fixed_times_have_no_derivative() -> None:
    scene = load_scene("three_contacts_two_ways")
    found = sensitivities(scene, ["drive.times"], 2.0, 4.0)
    assert len(found.parameters) == scene.drive.times.size
    assert not found.displacement[..., [0, -1]].any()
    assert found.displacement[..., 1:-1].any()
    assert np.abs(found.per_period).max() <= 1e-15


POLYGONS = {
    "name": "polygons",
    "dimension": 2,
    "body": {
        "contacts": [[0.0, 0.0], [0.2, 0.03], [0.1, 0.17]],
        "links": {"stiffness": 20.0, "between": [[0, 1], [1, 2], [2, 0]]},
    },
    "friction": {"directions": [0.0, 1.2, 2.5, 3.6, 5.1], "value": [0.3, 0.25, 0.2, 0.28, 0.26]},
    "tolerance": 1e-6,
    "drive": {
        "times": [0.0, 0.33, 0.66, 1.0],
        "period": 1.0,
        "actuation": [
            [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]],
            [[-0.06, -0.03], [0.01, 0.02], [0.05, 0.03]],
            [[0.02, 0.01], [-0.06, -0.03], [0.06, 0.02]],
            [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]],
        ],
    },
}
SCALES = {
    "friction": {"law": "along_velocity", "angle": 0.2, "forward": 0.1, "backward": 1.0, "left": 0.5, "right": 0.5}
}
"""An inchworm whose friction does not dissipate the most, and whose axes are not its links."""


@pytest.mark.parametrize(
    ("scene", "key"),
    [
        ("planar_three_points", "friction.isotropic[2]"),
        ("planar_rectilinear", "body.links.stiffness"),
        (POLYGONS, "friction.value[2]"),
        (POLYGONS, "drive.actuation[1][2][0]"),
        ("steering_inchworm", "body.links.stiffness"),
        ("steering_inchworm", "body.joints.stiffness"),
        ("steering_inchworm", "body.points[1][1]"),
        ("steering_inchworm", "friction.left"),
        ("steering_inchworm", "drive.actuation[1][0]"),
        ("steering_inchworm", "drive.times[1]"),
        (SCALES, "friction.angle"),
        (SCALES, "friction.right"),
    ],
)
def test_in_the_plane_derivatives_agree_with_differences(scene: str | dict[str, Any], key: str) -> None:
    document = load_scene(scene).document() if isinstance(scene, str) else scene
    document = load_scene("steering_inchworm").document() | scene if scene is SCALES else document
    made = Scene.model_validate(document)
    found = sensitivities(made, [key], 2.0, 3.0)
    assert found.displacement.shape == (7, made.body.contacts, 2, 1)
    assert found.differentiable
    assert found.tolerance < 1e-5
    step = 1e-3 * float(found.values[0])
    fine = Scene.model_validate(document | {"tolerance": 1e-8})
    low, high = (simulate(one, 2.0, 3.0) for one in vary(fine, {key: [found.values[0] - step, found.values[0] + step]}))
    size = np.abs(found.displacement).max()
    for name in ("displacement", "net_translation", "yaw", "per_period"):
        ours = getattr(found, name)[..., 0]
        expected = (getattr(high, name) - getattr(low, name)) / (2.0 * step)
        assert ours.shape == expected.shape
        assert np.abs(ours - expected).max() <= 1e-5 * size, name
    work = (high.energy.work - low.energy.work) / (2.0 * step)
    assert found.work[0] == pytest.approx(work, rel=1e-5, abs=1e-6 * size)
    assert found.period_work.sum() == pytest.approx(found.work[0], rel=1e-12, abs=1e-12)


def test_friction_to_the_left_counts_where_contacts_slide_to_their_left() -> None:
    points, joints = [[0, 0], [1, 0.1], [2, 0]], {"stiffness": 5.0, "between": [[0, 1, 2]]}
    friction = {"forward": 0.1, "backward": 0.3, "left": 0.2, "right": 0.6}
    drive = {"times": [0, 1], "actuation": [[0, 0, 0], [0.1, -0.05, 0.6]]}
    scene = build(points, {"stiffness": 20.0}, joints=joints, friction=friction, drive=drive)
    found = sensitivities(scene, ["friction.left"], 1.0, 1.0)
    low, high = (
        simulate(one, 1.0, 1.0).displacement for one in vary(scene, {"friction.left": [0.2 - 1e-4, 0.2 + 1e-4]})
    )
    expected = (high - low) / 2e-4
    assert np.abs(expected).max() > 0.5
    assert np.abs(found.displacement[..., 0] - expected).max() <= 1e-4


@pytest.mark.parametrize("seed", [3, 9])
def test_chains_that_turn_agree_with_differences(seed: int) -> None:
    """Many contacts start and stop, some because others start, and friction changes its quadrant."""
    body, goals = wriggle(seed)
    rows = [[0.0] * goals.shape[1], *goals[:2].tolist()]
    scene = build(**{**body, "drive": {"times": [0, 1, 2], "actuation": rows}, "tolerance": 1e-5})
    keys = ["body.links.stiffness", "body.joints.stiffness[1]", "drive.actuation[2][0]"]
    found = sensitivities(scene, keys, 2.0, 1.0)
    assert found.tolerance < 1e-4
    fine = Scene.model_validate(scene.document() | {"tolerance": 1e-8})
    for p, key in enumerate(keys):
        step = 1e-3 * abs(float(found.values[p]))
        low, high = (simulate(one, 2.0, 1.0) for one in vary(fine, {key: found.values[p] + np.array([-step, step])}))
        expected = (high.displacement - low.displacement) / (2.0 * step)
        assert np.abs(found.displacement[..., p] - expected).max() <= 1e-4 * np.abs(expected).max(), key


EVENTS = json.loads(Path(__file__).with_name("planar_events.json").read_text())
"""Bodies whose parts of ramps end a little late, where contacts rest that moved a little before, or slide on."""


@pytest.mark.parametrize(
    ("case", "rate"),
    [pytest.param(c, rate, id=f"{c['scene']['name']} at {rate:g} Hz") for c in EVENTS for rate in c["rates"]],
)
def test_derivatives_in_the_plane_do_not_depend_on_how_parts_end(case: dict[str, Any], rate: float) -> None:
    scene = Scene.model_validate(case["scene"] | {"tolerance": 1e-5})
    fine = Scene.model_validate(case["scene"] | {"tolerance": 1e-9})
    found = sensitivities(scene, case["keys"], case["duration"], rate)
    assert found.differentiable
    assert found.tolerance < 1e-3
    for p, key in enumerate(case["keys"]):
        value, step = found.values[p], 1e-4 * max(abs(found.values[p]), 0.1)
        pair = vary(fine, {key: value + np.array([-step, step])})
        low, high = (simulate(one, case["duration"], rate).displacement for one in pair)
        error = np.abs(found.displacement[..., p] - (high - low) / (2.0 * step)).max()
        assert error <= 3e-3 * np.abs(found.displacement[..., p]).max(), key


def test_vector_springs_do_not_depend_on_reference_positions() -> None:
    found = sensitivities(load_scene("planar_three_points"), ["body.contacts"], 2.0, 4.0)
    assert len(found.parameters) == 6
    assert not found.displacement.any()
    assert not found.work.any()


def test_a_derivative_that_is_none_has_no_large_error() -> None:
    scene = load_scene("scissors")
    found = sensitivities(scene, ["friction.forward[1]"], duration=2.0 * scene.drive.period, rate=4.0)
    assert np.abs(found.displacement).max() < 1e-9
    assert found.tolerance < 1e-3


@pytest.mark.parametrize(("rate", "differentiable"), [(20.0, True), (50.0, False), (99.0, True), (100.0, False)])
def test_a_start_at_the_end_of_a_tick_in_the_plane_is_a_kink(rate: float, differentiable: bool) -> None:
    """A contact of the scissors starts at 0.02 s, where some rates have a tick."""
    found = sensitivities(load_scene("scissors"), ["friction.left[1]"], 0.2, rate)
    assert found.differentiable == differentiable
    assert [kink.time for kink in found.kinks] == pytest.approx([] if differentiable else [0.02])


def test_errors_are_estimated_however_small_the_tolerance() -> None:
    document = load_scene("steering_inchworm").document() | {"tolerance": 1e-9}
    found = sensitivities(Scene.model_validate(document), ["body.links.stiffness"], 1.0, 2.0)
    assert 0.0 < found.tolerance < 1e-5
    found = sensitivities(load_scene("planar_three_points"), ["friction.isotropic[0]"], 1.0, 1.0)
    assert found.one_sided.all()
    assert np.isnan(found.tolerance)


def test_the_angle_of_friction_counts_where_a_drive_commands_friction() -> None:
    document = load_scene("steering_inchworm").document()
    values = {"forward": 0.1, "backward": 0.5, "left": 0.6, "right": 0.7}
    sides = {side: [[value] * 4, [value + 0.1] * 4] for side, value in values.items()}
    drive = {"times": [0.0, 1.0], "friction": sides, "actuation": [document["drive"]["actuation"][k] for k in (0, 1)]}
    few = Scene.model_validate(document | {"drive": drive, "friction": document["friction"] | {"angle": 0.3}})
    found = sensitivities(few, ["friction.angle"], 1.0, 2.0)
    low, high = (
        simulate(one, 1.0, 2.0).displacement for one in vary(few, {"friction.angle": [0.3 - 1e-4, 0.3 + 1e-4]})
    )
    difference = (high - low) / 2e-4
    assert np.abs(difference).max() > 1e-4
    assert np.abs(found.displacement[..., 0] - difference).max() <= 1e-3 * np.abs(difference).max()


def test_derivatives_by_directions_are_refused() -> None:
    with pytest.raises(SceneError, match=r"friction\.directions\[0\]: derivatives by directions are not computed"):
        sensitivities(Scene.model_validate(POLYGONS), ["friction.directions"], 1.0, 1.0)


def test_a_body_that_jumps_has_no_derivative() -> None:
    body = {"points": [[0, 0], [1, 0.1], [2, 0]], "links": {"stiffness": 50.0}, "springs": "length"}
    joints = {"stiffness": 0.05, "between": [[0, 1, 2]]}
    drive = {"times": [0, 1], "actuation": [[0.0, 0.0, 0.0], [0.0, 0.0, 1.2]]}
    document = {"name": "x", "dimension": 2, "body": body | {"joints": joints}, "drive": drive}
    document["friction"] = {"forward": 0.5, "backward": 0.5, "left": 0.05, "right": 0.05}
    scene = Scene.model_validate(document)
    assert simulate(scene, 1.0, 4.0).jumps
    with pytest.raises(CommandError, match=r"before [0-9.]+ s the body jumps"):
        sensitivities(scene, ["body.links.stiffness"], 1.0, 4.0)


def test_in_the_plane_kinks_are_found() -> None:
    found = sensitivities(load_scene("planar_three_points"), ["friction.isotropic"], 1.0, 1.0)
    assert found.one_sided.tolist() == [True, True, False]  # two contacts alike begin to slide together
    assert "2 of them one-sided" in repr(found)


def test_a_scene_without_a_drive_is_refused() -> None:
    document = draw(0)
    del document["drive"]
    with pytest.raises(SceneError, match="has no drive"):
        sensitivities(Scene.model_validate(document), ["friction.forward"])


def test_a_duration_out_of_range_is_refused() -> None:
    with pytest.raises(CommandError, match="duration"):
        sensitivities(load_scene("two_anchor_a"), ["drive.length"], duration=-1.0)
    with pytest.raises(CommandError, match="lower rate"):
        sensitivities(load_scene("ten_contact_wave"), ["friction.forward"], duration=1e5, rate=1e4)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1.0, 1e3])
def test_derivatives_do_not_depend_on_the_unit_of_length(unit: float) -> None:
    body = {"contacts": [0.1 * i * unit for i in range(4)], "links": {"stiffness": 10.0 / unit}}
    wave = {"amplitude": 0.05 * unit, "wavelength": 0.5 * unit, "period": 1.0, "samples": 8}
    document = {"name": "wave", "body": body, "friction": {"forward": 0.2, "backward": 0.6}, "drive": {"wave": wave}}
    found = sensitivities(Scene.model_validate(document | {"start": "relaxed"}), ["drive.wave.wavelength"], 3.0, 8.0)
    assert found.per_period[-1, 0] == pytest.approx(-0.0222721533, rel=1e-7)


def test_a_slope_may_be_named_beside_the_weights_that_it_acts_on() -> None:
    document = draw(0)
    del document["body"]["weights"]
    document["ground"]["slope"] = 0.0
    document["drive"] = {"wave": {"amplitude": 0.3, "wavelength": 2.0, "period": 1.0}}
    keys = ["ground.slope", "body.weights", "drive.wave.period"]  # the period is not assembled with the others
    found = sensitivities(Scene.model_validate(document), keys, 1.0, 4.0)
    assert found.parameters == tuple(keys)


def test_a_segment_that_ends_with_its_table_has_exact_derivatives() -> None:
    """Where the table ends, the arrays have a kink in their second derivatives; steps become short enough."""
    values = [0.3, 0.3 - 1e-5, 0.3 + 1e-5]
    document = draw_segment(0)
    segment = document["body"]["segments"][0]
    key = f"body.segments.{segment['name']}.to" if "name" in segment else "body.segments[0].to"
    segment["from"], segment["to"] = 0.0, values[0]
    segment["friction"] = {"forward": {"at": [0.0, 0.3], "value": [0.5, 1.5]}, "backward": 4.0}
    scene = Scene.model_validate(document)
    found = sensitivities(scene, [key], 1.0, 4.0)
    runs = [simulate(one, 1.0, 4.0).displacement for one in vary(scene, {key: values[1:]})]
    expected = (runs[1] - runs[0]) / (values[2] - values[1])
    shape = np.diff(found.displacement[..., 0])  # the translation belongs to the continuous body
    np.testing.assert_allclose(shape, np.diff(expected), atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("rate", [4.0, 8.0])
def test_a_waypoint_at_the_first_tick_moves_past_it_with_the_speed_of_the_ramp(rate: float) -> None:
    drive = {"times": [0, 0.25, 1.0], "period": 1.0, "actuation": [[0], [1], [0]]}
    body = {"contacts": [0, 1], "links": {"stiffness": 8.0}}
    scene = Scene.model_validate(
        {"name": "two", "body": body, "friction": {"forward": 0.5, "backward": 8.0}, "drive": drive}
    )
    found = sensitivities(scene, ["drive.times[1]"], 1.0, rate)
    assert found.displacement[list(found.time).index(0.25), :, 0] == pytest.approx([0.0, -4.0])


def test_forces_on_edges_of_polygons_have_the_derivatives_of_these_edges() -> None:
    rng = np.random.default_rng(0)
    friction = [0.3, 0.25, 0.2, 0.28, 0.26]
    key, compared = "drive.actuation[1][0][0]", 0
    for angle in rng.uniform(0.0, 2.0 * np.pi, 60):
        document = {"name": "edges", "dimension": 2, "tolerance": 1e-8}
        document["body"] = {"contacts": [[0, 0], [0.2, 0]], "links": {"stiffness": 15.0}}
        document["friction"] = {
            "directions": [0.0, 1.2, 2.5, 3.6, 5.1],
            "value": [[10.0 * f for f in friction], friction],
        }
        way = [0.1 * np.cos(angle), 0.1 * np.sin(angle)]
        scene = Scene.model_validate(document | {"drive": {"times": [0, 1], "actuation": [[[0, 0]], [way]]}})
        found = sensitivities(scene, [key], 1.0, 10.0)
        runs = [simulate(one, 1.0, 10.0).displacement for one in vary(scene, {key: way[0] + 1e-5 * np.arange(-1, 2)})]
        left, right = (runs[1] - runs[0]) / 1e-5, (runs[2] - runs[1]) / 1e-5
        smooth = np.abs(left - right).max(axis=(1, 2)) < 1e-4
        if not found.one_sided[0]:
            np.testing.assert_allclose(found.displacement[smooth, ..., 0], left[smooth], atol=1e-3)
            compared += 1
    assert compared > 30


def test_isotropic_is_no_number_of_a_scene_with_friction_by_direction():
    with pytest.raises(
        SceneError, match=r"sensitivities: friction\.isotropic; the scene gives forward and backward there"
    ):
        sensitivities(load_scene("three_contacts_one_way"), ["friction.isotropic"])
