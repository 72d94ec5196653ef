"""Identification in the plane, and on ground that differs from place to place, from differences of runs."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from crawler_lab import Measurements, identify, vary
from crawler_lab.identify.measurements import MeasurementError, channel_names
from crawler_lab.identify.sensor.sensor import PERFECT
from crawler_model import Scene, load_scene, simulate

NOISE = 2e-4


def record(scene: Scene | str, seconds: float, noise: float = NOISE) -> Measurements:
    """A scene, or one of the gallery, under its own drive, seen at 100 Hz with noise."""
    scene = load_scene(scene) if isinstance(scene, str) else scene
    run = simulate(scene, seconds, 100.0)
    position = (scene.body.position + run.displacement).reshape(run.time.size, -1)
    position = position + noise * np.random.default_rng(0).normal(size=position.shape)
    commands = scene.columns.names[: scene.columns.lengths]
    rows = scene.drive.sample(np.rint(run.time * 1e9).astype(np.int64))[:, : len(commands)]
    channels = tuple(name for name in channel_names(scene) if name.startswith("contact_"))
    if scene.body.segments:  # the strain and the elongation of its only part, whose elements are alike
        rows = rows * scene.body.springs / np.ptp(scene.body.position)
        channels, position = channel_names(scene), np.diff(position[:, [0, -1]] - position[0, [0, -1]])
    return Measurements("camera", run.time, channels, position, commands, rows, run.time)


def guess(name: str, **friction: Any) -> Scene:
    """The gallery's scene with other friction, relaxed at the start."""
    return Scene.model_validate(load_scene(name).document() | {"friction": friction, "start": "relaxed"})


def test_friction_in_the_plane_is_found() -> None:
    record_ = record("planar_three_points", 3.0)
    found = identify(
        guess("planar_three_points", isotropic=[0.36, 0.36, 0.24]), [record_], ["friction.isotropic"], sensor=PERFECT
    )
    assert found.model_fits, found.where
    for parameter, true in zip(found.parameters, (0.3, 0.3, 0.2), strict=True):
        assert parameter.verdict == "identified"
        low, high = parameter.interval
        assert low < true < high
        assert high - low < 0.1 * true
    assert found.playback().document()["drive"]["actuation"][0] == [[0.0, 0.0]] * 3


def test_a_crease_within_a_difference_of_runs_does_not_hide_that_only_ratios_are_determined() -> None:
    """The third bound never holds a contact back: it is not seen, and the others have no scale."""
    rows = np.zeros((3, 3, 2))
    rows[1] = [[0.1, 0.05], [-0.05, 0.02], [0.0, -0.06]]
    friction = {"directions": [0.0, 1.5708, 3.1416, 4.7124], "value": [0.2, 0.4, 0.5, 0.4]}
    document: dict[str, Any] = {
        "name": "triangle",
        "dimension": 2,
        "body": {
            "contacts": [[0.0, 0.0], [0.2, 0.0], [0.1, 0.15]],
            "links": {"stiffness": 20.0, "between": [[0, 1], [1, 2], [2, 0]]},
        },
        "friction": friction,
        "start": {"displacement": [[0.0, 0.0]] * 3},
        "drive": {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": rows.tolist()},
    }
    seen = record(Scene.model_validate(document), 2.0, 1e-4)
    document["body"]["links"]["stiffness"] = 18.0
    document["friction"] = friction | {"value": [0.22, 0.4, 0.5, 0.4]}
    first = Scene.model_validate(document)
    found = identify(first, [seen], ["body.links.stiffness", "friction.value"], seconds=4.0)
    verdicts = [parameter.verdict for parameter in found.parameters]
    assert verdicts == ["ratio", "ratio", "ratio", "not excited", "ratio"]
    assert [found.parameters[p].value for p in (1, 2, 4)] == pytest.approx([0.18, 0.36, 0.36], rel=0.01)


def test_from_positions_alone_only_ratios_are_found() -> None:
    keys = ["friction.forward", "body.links.stiffness"]
    found = identify(guess("ice", forward=0.26, backward=0.5), [record("ice", 4.0)], keys, sensor=PERFECT, seconds=0.0)
    assert all("only its ratio to" in parameter.why for parameter in found.parameters)
    assert found.parameters[1].value == pytest.approx(26.0, rel=0.01)


def test_the_friction_of_a_patch_is_found() -> None:
    scene = load_scene("ice")
    document = copy.deepcopy(scene.document()) | {"start": "relaxed"}
    document["ground"]["patches"][0]["friction"] = 0.32
    found = identify(
        Scene.model_validate(document), [record("ice", 7.0)], ["ground.patches[0].friction"], sensor=PERFECT
    )
    (patch,) = found.parameters
    assert patch.verdict == "identified"
    assert patch.value == pytest.approx(0.25, rel=0.05)
    assert patch.interval[0] < 0.25 < patch.interval[1]


def test_a_jump_at_the_time_of_a_row_is_no_derivative() -> None:
    """Contact 0 jumps at 7.76 s, a row: beside it a difference of runs is 300 000 times the derivatives."""
    rubber = {"stiffness": 20.0, "hysteresis": [{"stiffness": 40.0, "yield": 0.1}], "backlash": 0.004}
    scene = Scene.model_validate(
        {
            "name": "rubber_on_ice",
            "body": {"contacts": [0.0, 0.1], "links": [rubber]},
            "friction": {"forward": 0.2, "backward": 0.8},
            "ground": {"patches": [{"from": 0.25, "to": 0.4, "friction": 0.5}]},
            "start": "relaxed",
            "drive": {"times": [0, 1, 2], "period": 2, "actuation": [[0], [0.1], [0]]},
        }
    )
    keys = ["body.links[0].hysteresis[0].yield", "body.links[0].backlash", "ground.patches[0].friction"]
    found = identify(scene, [record(scene, 10.0, noise=0.0)], keys, seconds=0.0)
    for parameter, true in zip(found.parameters, (0.1, 0.004, 0.5), strict=True):
        assert parameter.verdict == "identified"
        assert parameter.interval == pytest.approx((true, true), rel=1e-3)


def test_beside_a_jump_no_friction_is_bounded_from_one_side_that_the_motion_bounds_from_both() -> None:
    """With 0.15 N a contact jumps at a waypoint: differences of runs show slopes of millions of times the right ones."""
    rows = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.08], [0.0, 0.08, 0.08], [0.08, 0.08, 0.08], [0.0, 0.0, 0.0]]
    data: dict[str, Any] = {
        "name": "gecko",
        "start": "relaxed",
        "body": {"contacts": [0.0, 0.1, 0.2, 0.3], "links": {"stiffness": [20.0, 30.0, 20.0]}},
        "friction": {"forward": 0.15, "backward": 0.6},
        "ground": {"patches": [{"from": 0.5, "to": 0.7, "friction": 0.3}]},
        "drive": {"times": [0.0, 0.25, 0.5, 0.75, 1.0], "period": 1.0, "actuation": rows},
    }
    scene = Scene.model_validate(data)
    forward, backward = identify(scene, [record(scene, 6.0)], ["friction.forward", "friction.backward"]).parameters
    for parameter, true in ((forward, 0.15), (backward, 0.6)):
        assert parameter.verdict == "identified"
        assert parameter.interval[0] < true < parameter.interval[1]
        assert parameter.interval[1] - parameter.interval[0] < 0.1 * true


@pytest.mark.parametrize(
    ("keys", "truth", "guesses"),
    [
        (["ground.profile.friction[0]", "ground.profile.friction[1]"], [1.0, 4.0], [1.5, 3.0]),
        (["ground.walls[0].at"], [0.42], [0.45]),
    ],
)
def test_the_numbers_of_gradual_ground_and_the_place_of_a_wall_are_found(
    keys: list[str], truth: list[float], guesses: list[float]
) -> None:
    profile = {"at": [0.0, 0.6], "friction": [1.0, 4.0]}
    document = load_scene("wall_pusher").document() | {"friction": {"forward": 0.2, "backward": 0.9}}
    document["start"] = "relaxed"
    document["ground"] = {"profile": profile, "walls": [{"at": 0.42, "stops": "forward"}]}
    scene = Scene.model_validate(document)
    first = vary(scene, {key: [value] for key, value in zip(keys, guesses, strict=True)}, grid=False)[0]
    found = identify(first, [record(scene, 6.0)], keys, sensor=PERFECT, seconds=0.0)
    assert found.model_fits, found.where
    for parameter, true in zip(found.parameters, truth, strict=True):
        assert parameter.verdict == "identified"
        assert parameter.interval[0] < true < parameter.interval[1]
        assert parameter.value == pytest.approx(true, rel=0.05)


def test_the_friction_that_links_add_is_found() -> None:
    """Where they reach; beyond, nothing tells."""
    entry = {"link": 0, "contacts": [0, 1], "elongation": [-0.2, -0.08, 0.0], "added": [1.0, 0.3, 0.0]}
    rows = [[0.0, 0.0], [-0.1, 0.0], [-0.1, -0.1], [0.0, -0.1], [0.0, 0.0]]
    data: dict[str, Any] = {
        "name": "worm",
        "start": "relaxed",
        "body": {"contacts": [0.0, 0.5, 1.0], "links": {"stiffness": 20.0}},
        "friction": {"isotropic": 0.1, "with_elongation": [entry]},
        "drive": {"times": [0.0, 1.0, 2.0, 3.0, 4.0], "period": 4.0, "actuation": rows},
    }
    keys = [f"friction.with_elongation[0].added[{j}]" for j in (0, 1)]
    scene = Scene.model_validate(data)
    first = vary(scene, {keys[0]: [0.8], keys[1]: [0.4]}, grid=False)[0]
    unreached, reached = identify(first, [record(scene, 8.0)], keys, sensor=PERFECT, seconds=0.0).parameters
    assert unreached.verdict == "not excited"
    assert reached.verdict == "identified"
    assert reached.interval[0] < 0.3 < reached.interval[1]
    assert reached.value == pytest.approx(0.3, rel=0.01)


def negate(measured: Measurements) -> Measurements:
    return dataclasses.replace(measured, commands=-measured.commands)


def exchange(measured: Measurements) -> Measurements:
    return dataclasses.replace(measured, values=measured.values[:, [1, 0, *range(2, measured.values.shape[1])]])


def mirror(measured: Measurements) -> Measurements:
    return dataclasses.replace(measured, values=measured.values * np.tile([1.0, -1.0], 3))


def delay(measured: Measurements) -> Measurements:
    return dataclasses.replace(measured, time=measured.time + 0.4)


def cut(measured: Measurements) -> Measurements:
    kept = 2 * measured.command_time.size // 3
    return dataclasses.replace(measured, commands=measured.commands[:kept], command_time=measured.command_time[:kept])


@pytest.mark.parametrize(
    ("name", "seconds", "key", "change", "what"),
    [
        ("ice", 5.0, "friction.forward", negate, "all commands are negated"),
        ("ice", 5.0, "friction.forward", cut, "the commands end early"),
        pytest.param(
            *("rubber_worm", 5.0, "friction.forward", exchange, "contact_0 and contact_1 are exchanged"),
            marks=pytest.mark.slow,
        ),
        ("rubber_worm", 5.0, "friction.forward", delay, "the clock of the positions is 0."),
        ("continuous_segment", 3.0, "body.segments[0].friction.forward", negate, "positions increase the other way"),
        pytest.param(
            *("planar_three_points", 3.0, "friction.isotropic", mirror, "y increases the other way"),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_mistake_of_a_table_is_named_whatever_the_body_is(
    name: str, seconds: float, key: str, change: Callable[[Measurements], Measurements], what: str
) -> None:
    scene = Scene.model_validate(load_scene(name).document() | {"start": "relaxed"})
    whole = record(scene, seconds)
    measured = change(dataclasses.replace(whole, time=whole.time[::3], values=whole.values[::3]))
    found = identify(scene, [measured], [key], starts=1, seconds=1e-9, hold_out=0.0)
    assert not found.model_fits
    assert found.explanations[0].what.startswith(what)  # of an elongation alone two are the same
    assert found.explanations[0].explained > 0.95


def test_what_is_not_tried_is_named() -> None:
    whole = record("ice", 5.0)
    scene = Scene.model_validate(load_scene("ice").document() | {"start": "relaxed"})
    bent = whole.values + 0.02 * np.sin(3.0 * whole.time)[:, None]
    found = identify(
        scene, [dataclasses.replace(whole, values=bent)], ["friction.forward"], sensor=PERFECT, starts=1, seconds=1e-9
    )
    assert not found.model_fits
    assert sum(line.startswith("not tried: ") and "backlash" in line for line in found.warnings) == 1


def walked_before(name: str, begin: float) -> Measurements:
    """The record of a scene of the gallery whose first seconds are missing."""
    whole = record(name, begin + 3.0)
    kept = whole.time >= begin - 1e-9
    own = {"time": whole.time[kept] - begin, "command_time": whole.time[kept] - begin}
    return dataclasses.replace(whole, **own, values=whole.values[kept], commands=whole.commands[kept])


@pytest.mark.parametrize(
    ("name", "keys"),
    [
        ("continuous_segment", ["body.segments[0].friction.forward"]),
        ("planar_rectilinear", ["body.links.stiffness"]),
        ("rubber_worm", ["friction.forward"]),
    ],
)
def test_nothing_is_identified_of_a_robot_that_walked_before(name: str, keys: list[str]) -> None:
    document = load_scene(name).document()
    document.pop("start", None)
    if name == "rubber_worm":
        document["ground"] = {"patches": [{"from": 5.0, "to": 6.0, "friction": 0.5}]}
    found = identify(Scene.model_validate(document), [walked_before(name, 1.3)], keys, sensor=PERFECT, seconds=0.0)
    assert {p.verdict for p in found.parameters} <= {"doubtful", "not excited"}
    assert all(p.interval == (None, None) for p in found.parameters)
    assert not found.posterior.fits
    assert sum("nothing tells the forces of the springs at the start" in line for line in found.warnings) == 1
    placed = any("nor where it stood, which matters with ground.patches" in line for line in found.warnings)
    assert placed == (name == "rubber_worm")


def test_a_frame_in_the_plane_has_an_offset_along_each_axis() -> None:
    measured = record("planar_rectilinear", 3.0)
    moved = Measurements(**(vars(measured) | {"values": measured.values + np.tile([0.3, -0.2], 2)}))
    found = identify(
        "planar_rectilinear", [moved], ["body.links.stiffness"], offset="frame", sensor=PERFECT, seconds=0.0
    )
    assert found.model_fits, found.where
    assert found.offsets[0] == pytest.approx([0.3, -0.2, 0.3, -0.2], abs=1e-3)
    assert found.parameters[0].value == pytest.approx(20.0, rel=0.02)


def test_a_channel_on_a_line_is_none_in_the_plane() -> None:
    measured = record("planar_rectilinear", 1.0)
    wrong = Measurements(**(vars(measured) | {"channels": ("contact_0", *measured.channels[1:])}))
    with pytest.raises(MeasurementError, match="column contact_0 does not belong to planar_rectilinear, which has"):
        identify("planar_rectilinear", [wrong], ["body.links.stiffness"])
