from __future__ import annotations

import copy
import dataclasses
import json
import re
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crawler_model import CommandError, Crawler, Scene, SceneError, gallery, load_scene, parse_scene, simulate
from crawler_model.scene.file import LARGEST_FILE
from crawler_model.scene.parts import SceneParts

GOOD: dict[str, Any] = {
    "name": "good",
    "body": {"contacts": [0.0, 1.0, 2.0], "links": {"stiffness": 2.0}},
    "friction": {"forward": 1.0, "backward": 2.0},
    "drive": {"times": [0, 1], "actuation": [[0, 0], [1, 1]]},
}


def change(path: str, value: Any) -> dict[str, Any]:
    data = copy.deepcopy(GOOD)
    place: Any = data
    *parents, last = path.split("/")
    for key in parents:
        place = place.setdefault(key, {})
    if value is None:
        del place[last]
    else:
        place[last] = value
    return data


def refusal(data: Any) -> str:
    with pytest.raises(SceneError) as error:
        parse_scene(json.dumps(data) if not isinstance(data, str) else data, "x.yaml")
    text = str(error.value)
    assert "\n" not in text
    assert text.startswith("x.yaml: ")
    return text


WAVES = ("wave", "friction_wave")
WRONG = [
    ("frictoin", {}, "frictoin: unknown key; the nearest known key is 'friction'"),
    ("friction/foward", 1, "friction.foward: unknown key; the nearest known key is 'forward'"),
    ("body/links/stifness", 1, "body.links.stifness: unknown key; the nearest known key is 'stiffness'"),
    ("drive/actuations", [], "drive.actuations: unknown key; the nearest known key is 'actuation'"),
    ("body/contacts", [0, 2, 1], "contact 2 at 1 m does not lie beyond contact 1 at 2 m"),
    ("body/contacts", [0, 1, 1], "contact 2 at 1 m does not lie beyond contact 1"),
    ("body/contacts", [0], "1 contact(s); a crawler needs at least 2"),
    ("body/contacts", [], "0 contact(s); a crawler needs at least 2"),
    ("body/contacts", 3, "body.contacts"),
    ("body/contacts", [0, 1, "far"], "body.contacts.2: 'far' is not a number"),
    ("body/contacts", [0, 1, "20 cm"], "body.contacts.2: '20 cm' is not a number; write only the number, in m"),
    ("body/links/stiffness", "20N/m", "body.links.stiffness: '20N/m' is not a number; write only the number, in N/m"),
    ("ground", {"slope": "8 deg"}, "ground.slope: '8 deg' is not a number; write only the number, in degrees"),
    ("body/links/stiffness", [1, 2, 3], "body.links.stiffness: 3 value(s) for 2 link(s); give one number or 2"),
    ("body/links/stiffness", 0, "link 0 has 0 N/m; it must be > 0"),
    ("body/links/stiffness", [1, -1], "link 1 has -1 N/m; it must be > 0"),
    ("body/links/stiffness", True, "True is not a number"),
    ("body/radius", [], "body: radius: 0 value(s) for 3 contact(s); give one number or 3"),
    ("body/radius", [0.1, 0.1], "body: radius: 2 value(s) for 3 contact(s); give one number or 3"),
    ("body/links/between", [[0, 1], [0, 3]], "body.links.between: link 1 joins contact 3; there are contacts 0 .. 2"),
    ("body/links/between", [[0, 1], [1, 1]], "body.links.between: link 1 joins contact 1 to itself"),
    ("body/links/between", [[0, 1]], "body.links.between: no links lead from contact 0 to contact 2"),
    ("body/links/between", [[0, 1], [1, "x.to"]], "body.links.between: link 1 joins x.to; there are contacts 0 .. 2"),
    ("body/links/between", [[0, 1], [1, "2"]], "body.links.between: link 1 joins '2'; an end is a number, `name.from`"),
    ("friction/forward", -1, "friction.forward: contact 0 has -1 N; friction must be >= 0"),
    ("friction/forward", [1, 1], "friction.forward: 2 value(s) for 3 contact(s)"),
    ("friction", {"directions": [0, 2, 4], "value": 1}, "friction.directions: only for planar scenes; on a line give"),
    ("friction/forward", None, "friction: give both `forward` and `backward`, or only `isotropic`"),
    ("friction/isotropic", 1, "friction: give both `forward` and `backward`, or only `isotropic`"),
    ("friction", None, "friction: missing"),
    ("friction", 0.3, "friction: write {isotropic: 0.3}, or give `forward` and `backward`"),
    ("body/links", None, "body.links: missing; give the springs between contacts and segments"),
    (
        "body/links",
        3,
        "body.links: 3; it must be a mapping with stiffness, curve, tension, passive, hysteresis, backlash, between",
    ),
    ("body/links/between", [], "body.links.between: no links lead from contact 0 to contact 1"),
    ("body/links/stiffness", 10**400, "too large; at most 1e+100"),
    ("body/links/stiffness", 1e200, "too large; at most 1e+100"),
    ("drive/times", [0, 1e-10], "waypoints are at least a nanosecond apart"),
    ("name", None, "name: missing"),
    ("loads", [[0, 0], [1, 0], [0, 0]], "loads: pairs; on a line each load is a number (or dimension: 2)"),
    ("loads", [1, [0, 0], 0], "loads: pairs; on a line each load is a number (or dimension: 2)"),
    ("start", {"displacement": [[0, 0]] * 3}, "start.displacement: on a line each entry is a number"),
    ("start", {"displacement": [0, 1]}, "start.displacement: 2 value(s) for 3 contact(s)"),
    (
        "start",
        {"displacement": [0, 2, 0]},
        "start.displacement: contact 1 is pulled by 8 N, 6 N more than its backward",
    ),
    ("drive/times", [0, 0], "drive.times: entry 1 (0 s) does not come after entry 0"),
    ("drive/times", [1, 2], "drive.times: the first time must be 0"),
    ("drive", {"times": [], "actuation": []}, "drive.times: empty; give at least the time 0"),
    ("drive/times", [0, 1, 2], "drive.actuation: 2 row(s) for 3 time(s)"),
    ("drive/actuation", [[0, 0], [1]], "drive.actuation: row 1: 1 value(s) for 2 link(s)"),
    ("drive/actuation", None, "drive: `actuation` is missing"),
    ("drive/actuation", [[[0, 0], [0, 0]]] * 2, "drive.actuation: row 0 holds lists; on a line each entry is a number"),
    (
        "drive/length",
        2,
        "drive: `length` does not belong to this kind of drive; its keys are actuation, friction, loads, period, times",
    ),
    ("drive/friction", 0.5, "friction: with `times`, give `isotropic`, or `forward` and `backward`, a row per time"),
    ("drive/period", 0, "drive: period: 0 s; it must be > 0"),
    ("drive/period", 1 + 1e-10, "s is less than a nanosecond after the last waypoint"),
    ("drive/period", 0.5, "drive.period: 0.5 s ends before the last waypoint at 1 s"),
    ("drive/period", 1, "drive.actuation: the last row, at the period's end, has 1 for link_0 and the first 0"),
    ("drive/strategy", "A", "give exactly one of"),
    ("drive/wave", {"amplitude": 1, "wavelength": 1, "period": 1}, "give exactly one of"),
    ("drive", {}, "give exactly one of"),
    (
        "drive",
        {"strategy": "A", "length": 1, "friction": 1},
        "strategies need 2 contacts and 1 link; this body has 3 contacts, 2 links",
    ),
    ("drive", {"strategy": "D", "length": 1, "friction": 1}, "drive.strategy"),
    ("drive", {"strategy": "A", "length": 1, "friction": -1}, "friction: -1 N; it must be >= 0"),
    (
        "drive",
        {kind: {"amplitude": 0.1, "mean": 1, "wavelength": 1, "period": i + 1} for i, kind in enumerate(WAVES)},
        "drive.friction_wave.period: it must equal drive.wave.period",
    ),
    ("drive", {"strategy": "A"}, "a strategy needs `length` (m) and `friction` (N)"),
    ("drive", {"wave": {"amplitude": 0.1, "wavelength": 0, "period": 1}}, "wavelength: 0 m; it must not be 0"),
    ("drive", {"wave": {"amplitude": 0.1, "wavelength": 1, "period": 0}}, "period: 0 s; it must be > 0"),
    ("drive", {"wave": {"amplitude": 0.1, "wavelength": 1, "period": 1, "samples": 2}}, "samples: 2; it must be"),
    (
        "drive",
        {"friction_wave": {"amplitude": 2, "mean": 1, "wavelength": 1, "period": 1}},
        "drive.friction_wave: mean 1 N is less than the amplitude 2 N",
    ),
    ("drive/friction", {"isotropic": [1, -1]}, "row 1, contact_0/forward: -1; friction must be >= 0"),
    ("drive/friction", {"isotropic": [1]}, "drive.friction.isotropic: 1 row(s) for 2 time(s)"),
]


@pytest.mark.parametrize(("path", "value", "said"), WRONG)
def test_a_mistake_is_named(path, value, said):
    assert said in refusal(change(path, value))


@pytest.mark.parametrize("value", [".nan", ".inf", "-.inf", "NaN"])
def test_what_is_not_finite_is_refused(value):
    text = f"""
name: x
body: {{contacts: [0, 1], links: {{stiffness: {value}}}}}
friction: {{isotropic: 1}}
"""
    assert "body.links.stiffness" in refusal(text)


@pytest.mark.parametrize(
    "text",
    [
        "!!python/object/apply:os.system ['touch /tmp/never']",
        "name: !!python/object/apply:subprocess.check_output [[id]]",
        "name: !!python/name:os.system",
    ],
)
def test_yaml_cannot_run_code(text):
    assert "not plain YAML" in refusal(text)


@pytest.mark.parametrize("text", ["", "[]", "3", "name: [", "a: b: c", "\t", "name: x\nname: y", "1: 2"])
def test_what_is_no_scene_is_one_line(text):
    refusal(text)


def test_bytes_are_no_text():
    with pytest.raises(SceneError, match=r"^x\.yaml: bytes; the content of a scene file must be text$"):
        parse_scene(b"", "x.yaml")


def aliases(deep: int) -> str:
    lists = [f"l{i}: &l{i} [{', '.join([f'*l{i - 1}' if i else '0'] * 10)}]" for i in range(deep)]
    return "{" + ", ".join(lists) + "}"


def test_aliases_may_not_stand_for_more_than_a_scene_can_hold():
    assert "unknown key" in refusal(aliases(5))
    assert "not plain YAML in line 1: with its aliases expanded it holds more than" in refusal(aliases(6))


def test_an_alias_is_what_it_stands_for():
    text = "{name: x, body: {contacts: &c [0, 1], links: {stiffness: 1}}, friction: {forward: *c, backward: *c}}"
    assert parse_scene(text) == parse_scene(text.replace("&c ", "").replace("*c", "[0, 1]"))


def test_a_date_is_text_and_a_number_to_base_sixty_is_none():
    assert refusal("name: 2020-13-45") == "x.yaml: body: missing"
    assert "body.links.stiffness: '1:30' is not a number" in refusal(
        "{name: x, body: {contacts: [0, 1], links: {stiffness: 1:30}}, friction: {isotropic: 1}}"
    )


def test_large_scenes_are_json():
    assert "write it as JSON" in refusal("name: x\nbody: {contacts: [" + "0, " * 60_000 + "0]}")


def test_a_scene_from_data_or_by_name_is_refused_in_the_same_words():
    with pytest.raises(SceneError, match=r"^frictoin: unknown key; the nearest known key is 'friction'"):
        Scene.model_validate(change("frictoin", {}))
    with pytest.raises(SceneError, match=r"^zzz: unknown key; known keys are name, dimension, body"):
        Scene.model_validate(change("zzz", {}))
    with pytest.raises(SceneError, match=r"simulate: {'name': 'good', .* is not a Scene; load_scene builds one"):
        simulate(GOOD)
    with pytest.raises(SceneError, match="Crawler: 'two_anchor_a' is not a Scene"):
        Crawler("two_anchor_a")


def test_several_mistakes_are_counted():
    data = change("friction/forward", "a")
    data["body"]["links"]["stiffness"] = "b"
    assert "(and 1 more mistake)" in refusal(data)


@pytest.mark.parametrize("stiffness", [2.0, [3.0, 5.0]])
@pytest.mark.parametrize("rows", [[[0, 0], [1, 1]], [[0.25, -0.5], [1, 1]]])
@pytest.mark.parametrize("first", [0.0, 0.5, -3.0])
def test_the_start_that_an_error_proposes_has_no_tension(first, rows, stiffness):
    data = change("start", {"displacement": [first, first + 2, first]})
    data["drive"]["actuation"], data["body"]["links"]["stiffness"] = rows, stiffness
    (proposal,) = re.findall(r"a start without tension is \[(.*?)\], or write `start: relaxed`", refusal(data))
    data["start"] = {"displacement": [float(x) for x in proposal.split(", ")]}
    assert data["start"]["displacement"][0] == first
    assert Crawler(Scene.model_validate(data)).tension == pytest.approx(0.0, abs=1e-15)


def test_numbers_spread_over_all_entries():
    one = Scene.model_validate(GOOD)
    many = copy.deepcopy(GOOD)
    many["body"]["links"] = {"stiffness": [2.0, 2.0], "between": [[0, 1], [1, 2]]}
    many["friction"] = {"forward": [1.0] * 3, "backward": [2.0] * 3}
    many["drive"]["actuation"] = [0, 1]
    other = Scene.model_validate(many)
    assert simulate(one).displacement.tobytes() == simulate(other).displacement.tobytes()


def test_yaml_numbers_without_a_point_are_numbers():
    scene = parse_scene("{name: x, body: {contacts: [0, 1], links: {stiffness: 1e3}}, friction: {isotropic: 1e-3}}")
    assert scene.body.stiffness == [1000.0]


def test_a_scene_is_frozen_and_its_arrays_too():
    scene = Scene.model_validate(GOOD)
    with pytest.raises(AttributeError):
        scene.name = "other"
    with pytest.raises(dataclasses.FrozenInstanceError):
        scene.body = None
    for array in (scene.body.position, scene.drive.forward, scene.drive.actuation):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_a_file_that_is_named_without_its_ending_is_recognised(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text(json.dumps(GOOD))
    with pytest.raises(SceneError, match=r"mine: .* a file is named with its ending, mine\.yaml"):
        load_scene("mine")


def test_load_by_path_and_by_name(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(json.dumps(GOOD))
    assert load_scene(file) == load_scene(str(file)) == Scene.model_validate(GOOD)
    assert load_scene("two_anchor_a").name == "two_anchor_a"
    with pytest.raises(SceneError, match="nearest is 'two_anchor_a'"):
        load_scene("two_ancor_a")
    with pytest.raises(SceneError, match="no such file"):
        load_scene(tmp_path / "none.yaml")
    file.write_bytes(b"")
    with pytest.raises(SceneError, match="cannot be read: it is empty"):
        load_scene(file)
    with file.open("wb") as stream:
        stream.truncate(LARGEST_FILE + 1)
    with pytest.raises(SceneError, match=f"it has {LARGEST_FILE + 1} bytes; a scene has at most {LARGEST_FILE}"):
        load_scene(file)
    file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SceneError, match="cannot be read"):
        load_scene(file)


@pytest.mark.parametrize("name", gallery())
def test_every_gallery_scene_loads_and_says_what_to_look_for(name):
    scene = load_scene(name)
    assert scene.name == name
    text = (resources.files("msgs_config") / "scenes" / f"{name}.yaml").read_text()
    assert "Watch for:" in text
    assert gallery()[name].endswith(".")


def test_the_schema_on_disk_is_that_of_the_code():
    text = (resources.files("msgs_config") / "scene.schema.json").read_text()
    assert json.loads(text) == SceneParts.model_json_schema()


TRACK = {"ground": {"patches": [{"from": 0, "to": 1, "friction": 1}]}}
YIELDS = {"body": {"links": {"stiffness": 1, "hysteresis": [{"stiffness": 1, "yield": 1}]}}}


@pytest.mark.parametrize(
    ("document", "path", "name"),
    [
        ({"body": {"segments": [{"name": "t", "from": 0, "to": 1}]}}, "body/segments/0/from", "start"),
        ({"body": {"segments": [{"name": "t", "from": 0, "to": 1}]}}, "body/segments/0/to", "stop"),
        (TRACK, "ground/patches/0/from", "start"),
        (TRACK, "ground/patches/0/to", "stop"),
        (YIELDS, "body/links/hysteresis/0/yield", "yields_at"),
    ],
)
def test_a_key_has_the_name_of_the_schema_alone(document, path, name):
    """The attribute of the program that holds it may have another name."""
    parent = document = copy.deepcopy(document)
    *steps, key = path.split("/")
    for step in steps:
        parent = parent[int(step)] if isinstance(parent, list) else parent[step]
    parent[name] = parent.pop(key)
    with pytest.raises(SceneError, match=rf"{re.escape('.'.join(steps))}\.{name}: unknown key"):
        Scene.model_validate({"name": "x", **document})


LINE = {"name": "x", "body": {"contacts": [0, 1], "links": {"stiffness": 1}}, "friction": {"isotropic": 1}}
TRUNK = {"name": "t", "from": 0, "to": 1, "stiffness": 1, "friction": {"forward": 1, "backward": 2}, "elements": 4}
SEGMENT = {"name": "x", "body": {"segments": [TRUNK]}}
WAYPOINTS = {"times": [0, 1], "actuation": [[0], [0]], "friction": {"forward": 1, "backward": 2}}
WAVE = {"amplitude": 0.1, "wavelength": 1, "period": 1}
PLANE = {"name": "x", "dimension": 2, "body": {"contacts": [[0, 0], [1, 0]], "links": {"stiffness": 1}}}
WEIGHED = {"name": "x", "body": {**LINE["body"], "weights": 1}}
COEFFICIENTS = {**WEIGHED, "friction": {"coefficient": {"forward": 1, "backward": 1}}}
PATCHED = {**LINE, "body": WEIGHED["body"], "ground": {"patches": [{"from": 2, "to": 3, "slope": 0}]}}
STOPS = {"shortest": -1, "longest": 1, "stiffness": 10}
BENT = {
    **LINE,
    "body": {**LINE["body"], "links": [{"stiffness": 1, "passive": {"stiffness": 1, "stops": STOPS}}]},
}

SILICONE = {
    **LINE,
    "body": {**LINE["body"], "links": [{"stiffness": 1, "hysteresis": [{"stiffness": 1, "yield": 1}]}]},
}


def put(document: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    """Set a key; behind `=` the one that takes the place of all others in its part."""
    document = copy.deepcopy(document)
    place: Any = document
    *parents, last = path.split("=")[0].split("/")
    for key in parents:
        place = place[int(key) if isinstance(place, list) else key]
    place[int(last) if isinstance(place, list) else last] = {path.split("=")[1]: value} if "=" in path else value
    return document


SIDES = {"forward": 1, "backward": 1, "left": 1, "right": 1}
TURNING = {
    "name": "x",
    "dimension": 2,
    "body": {
        "points": [[0, 0], [1, 0], [2, 0]],
        "springs": "length",
        "weights": 1,
        "links": {"stiffness": 1},
        "joints": {"stiffness": 1},
    },
    "friction": SIDES,
    "drive": {"times": [0], "actuation": [[0, 0, 0]]},
}
BOUNDED = {
    ("BodyPart", "weights"): ({**LINE, "body": WEIGHED["body"]}, "body/weights"),
    ("BodyPart", "masses"): (LINE, "body/masses"),
    ("HysteresisPart", "stiffness"): (SILICONE, "body/links/0/hysteresis/0/stiffness"),
    ("HysteresisPart", "yield"): (SILICONE, "body/links/0/hysteresis/0/yield"),
    ("LinksPart", "backlash"): (LINE, "body/links/backlash"),
    ("LinkPart", "backlash"): (SILICONE, "body/links/0/backlash"),
    ("SegmentPart", "backlash"): (SEGMENT, "body/segments/0/backlash"),
    ("CoefficientPart", "forward"): (COEFFICIENTS, "friction/coefficient/forward"),
    ("CoefficientPart", "backward"): (COEFFICIENTS, "friction/coefficient/backward"),
    ("CoefficientPart", "isotropic"): (COEFFICIENTS, "friction/coefficient=isotropic"),
    ("CoefficientPart", "value"): (
        {
            **PLANE,
            "body": {**PLANE["body"], "weights": 1},
            "friction": {"coefficient": {"directions": [0, 2, 4], "value": 1}},
        },
        "friction/coefficient/value",
    ),
    ("GroundPart", "direction"): ({**PLANE, "friction": {"isotropic": 1}, "ground": {"slope": 0}}, "ground/direction"),
    ("GroundPart", "slope"): ({**LINE, "body": WEIGHED["body"], "ground": {"slope": 0}}, "ground/slope"),
    ("BodyPart", "radius"): ({**LINE, "body": {**LINE["body"], "radius": 1}}, "body/radius"),
    ("LinksPart", "stiffness"): (LINE, "body/links/stiffness"),
    ("LinksPart", "tension"): (put(LINE, "body/links/passive", {"stiffness": 1.0}), "body/links/tension"),
    ("LinkPart", "stiffness"): (BENT, "body/links/0/stiffness"),
    ("LinkPart", "tension"): (BENT, "body/links/0/tension"),
    ("PassivePart", "stiffness"): (BENT, "body/links/0/passive/stiffness"),
    ("StopsPart", "stiffness"): (BENT, "body/links/0/passive/stops/stiffness"),
    ("SegmentPart", "stiffness"): (SEGMENT, "body/segments/0/stiffness"),
    ("SegmentPart", "tension"): (
        put(SEGMENT, "body/segments/0/passive", {"stiffness": 1.0}),
        "body/segments/0/tension",
    ),
    ("SegmentPart", "accuracy"): (SEGMENT, "body/segments/0/accuracy"),
    ("SegmentPart", "elements"): (SEGMENT, "body/segments/0/elements"),
    ("SegmentPart", "shown"): (SEGMENT, "body/segments/0/shown"),
    ("SegmentFrictionPart", "forward"): (SEGMENT, "body/segments/0/friction/forward"),
    ("SegmentFrictionPart", "backward"): (SEGMENT, "body/segments/0/friction/backward"),
    ("SegmentFrictionPart", "isotropic"): (SEGMENT, "body/segments/0/friction=isotropic"),
    ("FrictionPart", "forward"): ({**LINE, "friction": {"forward": 1, "backward": 2}}, "friction/forward"),
    ("FrictionPart", "backward"): ({**LINE, "friction": {"forward": 1, "backward": 2}}, "friction/backward"),
    ("FrictionPart", "isotropic"): (LINE, "friction/isotropic"),
    ("FrictionPart", "value"): ({**PLANE, "friction": {"directions": [0, 2, 4], "value": 1}}, "friction/value"),
    ("FrictionRowsPart", "forward"): ({**LINE, "drive": WAYPOINTS}, "drive/friction/forward"),
    ("FrictionRowsPart", "backward"): ({**LINE, "drive": WAYPOINTS}, "drive/friction/backward"),
    ("FrictionRowsPart", "isotropic"): ({**LINE, "drive": WAYPOINTS}, "drive/friction=isotropic"),
    ("DrivePart", "period"): ({**LINE, "drive": {"strategy": "A", "length": 0, "friction": 1}}, "drive/period"),
    ("DrivePart", "friction"): ({**LINE, "drive": {"strategy": "A", "length": 0, "friction": 1}}, "drive/friction"),
    ("WavePart", "period"): ({**LINE, "drive": {"wave": WAVE}}, "drive/wave/period"),
    ("WavePart", "samples"): ({**LINE, "drive": {"wave": WAVE}}, "drive/wave/samples"),
    ("PatchPart", "friction"): (PATCHED, "ground/patches/0/friction"),
    ("PatchPart", "forward"): (PATCHED, "ground/patches/0/forward"),
    ("PatchPart", "backward"): (PATCHED, "ground/patches/0/backward"),
    ("RegionPart", "friction"): (
        {**PLANE, "friction": {"isotropic": 1}, "ground": {"regions": [{"left_of": [[0, 0], [0, 1]], "friction": 1}]}},
        "ground/regions/0/friction",
    ),
    **{
        ("SensorsPart", name): ({**LINE, "sensors": {}}, f"sensors/{name}")
        for name in (
            *("noise", "angle_noise", "force_noise", "drift", "drift_time"),
            *("pixel", "delay", "rate", "dropped", "seed"),
        )
    },
    ("PatchPart", "slope"): (PATCHED, "ground/patches/0/slope"),
    ("ProfilePart", "friction"): (
        {**PATCHED, "ground": {"profile": {"at": [0], "friction": [1]}}},
        "ground/profile/friction/0",
    ),
    ("ProfilePart", "slope"): ({**PATCHED, "ground": {"profile": {"at": [0], "slope": [1]}}}, "ground/profile/slope/0"),
    **{
        ("ProfileSidesPart", side): (
            {**PATCHED, "ground": {"profile": {"at": [0], "friction": {"forward": [1], "backward": [1]}}}},
            f"ground/profile/friction/{side}/0",
        )
        for side in ("forward", "backward")
    },
    **{
        (part, side): (put(TURNING, where, SIDES), f"{where.replace('=', '/')}/{side}")
        for part, where in (
            ("FrictionPart", "friction"),
            ("CoefficientPart", "friction=coefficient"),
            ("FrictionRowsPart", "drive/friction"),
        )
        for side in ("left", "right")
    },
    **{
        ("CouplingPart", side): (
            put(
                {**GOOD, "name": "x"},
                "friction/with_elongation",
                [{"link": 0, "contacts": [0], "elongation": [0.0], side: [1.0]}],
            ),
            f"friction/with_elongation/0/{side}/0",
        )
        for side in ("added", "forward", "backward")
    },
    ("JointsPart", "stiffness"): (TURNING, "body/joints/stiffness"),
    ("Scene", "tolerance"): ({**PLANE, "friction": {"isotropic": 1}}, "tolerance"),
}


RANGE = {"minimum": -1, "exclusiveMinimum": 0, "maximum": 1, "exclusiveMaximum": 0}
"""How far from a limit the nearest integer beyond it lies."""


def bounds() -> dict[tuple[str, str], dict[str, float]]:
    root = SceneParts.model_json_schema()
    found = {}
    for name, part in {**root["$defs"], "Scene": root}.items():
        for key, value in part["properties"].items():
            limits = {k: value[k] for k in RANGE if k in value}
            if limits:
                found[name, key] = limits
    return found


@pytest.mark.parametrize("key", bounds(), ids=".".join)
def test_the_ranges_in_the_schema_are_those_of_the_program(key):
    document, path = BOUNDED[key]
    limits = bounds()[key]
    whole = key[1] in ("elements", "samples", "shown", "seed")
    for kind, limit in limits.items():
        beyond = limit + RANGE[kind]
        with pytest.raises(SceneError) as error:
            parse_scene(json.dumps(put(document, path, beyond)), "x.yaml")
        assert re.search(r"must (be|lie)|are shown", str(error.value)), error.value
    least = limits.get("minimum", limits.get("exclusiveMinimum", 0) + 1e-3)
    if key[1] not in ("accuracy", "left", "right"):  # the first would take long, the others are 0 only together
        document = put(document, path, least if whole else float(least))
        document.pop("start", None)
        assert parse_scene(json.dumps(document), "x.yaml").name == "x"


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ({"actuation": [1.0]}, "actuation: shape (1,); it must be (2,)"),
        ({"actuation": [1.0, np.nan]}, "actuation: entry 1 is nan; it must be finite"),
        ({"actuation": [1.0, np.inf]}, "actuation: entry 1 is inf"),
        ({"actuation": [1.0, 1e101]}, "actuation: entry 1 is 1e+101; it must be at most 1e+100 in size"),
        ({"actuation": [1.0, "x"]}, "it must be 2 numbers"),
        ({"actuation": None}, "actuation: shape (); it must be (2,)"),
        ({"actuation": [0, 0], "forward": [1, 1, -1]}, "forward: contact_2/forward is -1; friction must be >= 0"),
        ({"actuation": [0, 0], "backward": [1, 1]}, "backward: shape (2,); it must be (3,)"),
    ],
)
def test_a_refused_command_changes_nothing(command, said):
    crawler = Crawler(Scene.model_validate(GOOD))
    crawler.advance([3.0, -2.0])
    before = crawler.copy()
    with pytest.raises(CommandError) as error:
        crawler.advance(**command)
    assert said in str(error.value)
    assert crawler == before


def test_an_unknown_method_is_refused():
    with pytest.raises(CommandError, match="exact, catch_up"):
        Crawler(Scene.model_validate(GOOD), "euler")


@pytest.mark.parametrize("period", [0.3, 0.1 + 0.1 + 0.1, np.nextafter(0.3, 0.0)])
def test_a_drive_ends_as_it_begins_but_for_rounding(period):
    times = np.array([0.0, 0.1, 0.1 + 0.1, 0.1 + 0.1 + 0.1])
    angles = 2.0 * np.pi * times / times[-1]
    actuation = 0.1 * np.stack((np.sin(angles), np.cos(angles + 0.5)), axis=-1)
    assert (actuation[0] != actuation[-1]).any()
    data = change("drive", {"times": times.tolist(), "period": float(period), "actuation": actuation.tolist()})
    data["start"] = "relaxed"
    drive = Scene.model_validate(data).drive
    assert drive.period == times[-1]
    assert (drive.rows[0] == drive.rows[-1]).all()
    data["drive"]["actuation"][-1][1] += 1e-12
    assert re.search(r"has 0\.0877582561900\d+ for link_1 and the first 0\.087758256189\d+; a drive", refusal(data))


def test_a_wave_travels_towards_plus_x():
    data = change("drive", {"wave": {"amplitude": 0.1, "mean": 0.2, "wavelength": 2.0, "period": 3.0}})
    data["start"] = {"displacement": [0.0, 0.1, 0.4]}
    drive = Scene.model_validate(data).drive
    t, m = drive.times[:, None], np.array([0.5, 1.5])
    assert drive.actuation == pytest.approx(0.2 + 0.1 * np.sin(2 * np.pi * (t / 3.0 - m / 2.0)))
    assert drive.times.size == 65
    assert (drive.actuation[0] == drive.actuation[-1]).all()


def test_a_friction_wave_goes_with_a_wave():
    wave = {"amplitude": 0.1, "wavelength": 2.0, "period": 1.0, "samples": 8}
    data = change("drive", {"wave": wave, "friction_wave": {**wave, "mean": 0.5, "samples": 12}})
    data["start"] = {"displacement": [0.0, -0.1, 0.0]}
    drive = Scene.model_validate(data).drive
    assert drive.times.size == 17  # 8 and 12 share the quarters
    x = np.array([0.0, 1.0, 2.0])
    own = np.isclose(drive.times * 12 % 1.0, 0.0) | np.isclose(drive.times * 12 % 1.0, 1.0)
    assert own.sum() == 13  # its own samples lie on the sine, the other wave's on straight lines between
    sine = 0.5 + 0.1 * np.sin(2 * np.pi * (drive.times[:, None] - x / 2.0))
    assert drive.forward[own] == pytest.approx(sine[own])
    assert np.abs(drive.forward[~own] - sine[~own]).max() > 1e-3
    assert (drive.forward == drive.backward).all()


def test_friction_of_a_drive_replaces_the_scenes():
    rows = {"forward": [[3, 3, 3], [1, 1, 1]], "backward": [[4, 4, 4], [1, 1, 1]]}
    drive = Scene.model_validate(change("drive/friction", rows)).drive
    assert drive.forward[0].tolist() == [3, 3, 3]
    assert drive.backward[0].tolist() == [4, 4, 4]


SCENES_PAGE = (Path(__file__).parents[4] / "docs" / "scenes.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("text", re.findall(r"```yaml\n(.*?)```", SCENES_PAGE, re.S), ids=lambda t: t.split("\n")[0])
def test_the_scenes_of_the_docs_run(text):
    assert simulate(parse_scene(text, "docs")).ticks > 0


SEGMENT: dict[str, Any] = {"name": "trunk", "from": 0.0, "to": 1.0, "stiffness": 1.0, "elements": 4}
SEGMENT |= {"friction": {"isotropic": 1.0}}


def with_segments(*segments: dict[str, Any], contacts: Any = (), **more: Any) -> dict[str, Any]:
    body = {"segments": [SEGMENT | s for s in segments], "contacts": list(contacts), "links": {"stiffness": 1.0}}
    body["links"] |= more.pop("links", {})
    return {"name": "x", "body": body, "friction": {"isotropic": 1.0}, **more}


def plane(**more: Any) -> dict[str, Any]:
    body = {"contacts": [[0, 0], [1, 0]], "links": {"stiffness": 1.0}}
    return {"name": "x", "dimension": 2, "body": body, "friction": {"isotropic": 1.0}, **more}


PUSHED: dict[str, Any] = {"times": [0, 1], "actuation": [[[0, 0]], [[1, 0]]]}
WRONG_BODIES = [
    (with_segments({"accuracy": 2.0}), "body.segments.0: accuracy: 2; it must be between 1e-6 and 0.5"),
    (with_segments({"accuracy": 1e-9}), "accuracy: 1e-09; it must be between"),
    (with_segments({"elements": 0}), "elements: 0; it must be between 1 and 1000000"),
    (with_segments({"elements": None}), "give `accuracy` (of the net translation per period, relative) or `elements`"),
    (with_segments({"stifness": 1}), "body.segments.0.stifness: unknown key; the nearest known key is 'stiffness'"),
    (with_segments({"friction": {"law": 1}}), "body.segments.0.friction.law: unknown key; known keys are forward, "),
    (with_segments({"stiffness": {"at": [0], "v": [1]}}), "stiffness.v: unknown key; known keys are at, value"),
    (
        with_segments({"stiffness": {"at": ["1 m"], "value": [1]}}),
        "at.0: '1 m' is not a number; write only the number, in m",
    ),
    (with_segments({"stiffness": 0}), "body.segments.0.stiffness: 0 N; it must be > 0"),
    (with_segments({"stiffness": {"at": [0, 1], "value": [1]}}), "2 position(s) in `at` for 1 value(s)"),
    (with_segments({"stiffness": {"at": [1, 0], "value": [1, 1]}}), "positions in `at` must be strictly increasing"),
    (with_segments({"friction": {"forward": -1, "backward": 1}}), "friction.forward: -1 N/m; it must be >= 0"),
    (
        with_segments({"stiffness": {"at": [2, 3], "value": [1, 1]}}),
        "body.segments.0: the table of stiffness covers 2 .. 3 m, outside the segment's 0 .. 1 m",
    ),
    (with_segments({"friction": 0.3}), "body.segments.0.friction: write {isotropic: 0.3}"),
    (
        with_segments({"friction": {"coefficient": {"directions": [0, 2, 4], "value": 1}}}),
        "body.segments.0.friction: coefficient: directions; a segment lies on a line and has none",
    ),
    (
        with_segments({"friction": {"coefficient": {"isotropic": [0.1, 0.2]}}}),
        "body.segments.0.friction: coefficient: a list; a segment takes one number",
    ),
    (with_segments({"to": -1}), "to: -1 m; it must be greater than `from`, 0 m"),
    (with_segments({"name": "link_0"}), "name: 'link_0'; it must be a single word"),
    (with_segments({"shown": 1}), "shown: 1; it must be at least 2, as both ends are shown"),
    (
        with_segments({}, {"name": "b", "from": 0.5, "to": 2}),
        "segment b from 0.5 m lies inside segment trunk, which reaches to 1 m; segments must not overlap",
    ),
    (with_segments({}, {"from": 2, "to": 3}), "two segments are named 'trunk'"),
    (with_segments({}, contacts=[0.5]), "contact 0 at 0.5 m lies inside segment trunk, which reaches to 1 m"),
    (with_segments({}, contacts=[2], links={"between": [["trunk.end", 0]]}), "link 0 joins 'trunk.end'; an end is"),
    (with_segments({}, contacts=[2], links={"between": [["tail.to", 0]]}), "link 0 joins tail.to; there are contacts"),
    (with_segments({}, contacts=[2], links={"between": []}), "no links lead from segment trunk to contact 0"),
    (with_segments({}, start="relaxd"), "start: 'relaxd'; it must be 'relaxed', or a mapping with displacement"),
    (
        with_segments({}, contacts=[2], drive={"times": [0, 1], "actuation": [[0], [1]]}),
        "drive.actuation: row 0: 1 value(s) for 2 link(s) and segment(s); give one number or 2",
    ),
    (with_segments({}, dimension=2), "segments lie on a line"),
    (plane(dimension=1), "contact 0 is [0.0, 0.0]; on a line it is a number"),
    (
        plane(body={"contacts": [[0, 0], [0, 0]], "links": {"stiffness": 1.0}}),
        "body.contacts: contacts 0 and 1 are both at [0, 0] m",
    ),
    (
        plane(body={"contacts": [0, 1], "links": {"stiffness": 1.0}}),
        "body.contacts: contact 0 is 0.0; in a planar scene each contact is [x, y]",
    ),
    (plane(dimension=3), "dimension: 3; it must be 1 or 2"),
    (plane(friction={"forward": 1, "backward": 2}), "in the plane use `isotropic`, or `directions` and `value`"),
    (
        plane(drive={"times": [0, 1], "actuation": [[0], [1]]}),
        "row 0: entry 0 is 0.0; in a planar scene a row is [x, y] for each",
    ),
    (
        plane(drive={"times": [0, 1], "actuation": [[[0, 0]]]}),
        "drive.actuation: 1 row(s) for 2 time(s); give one row per time",
    ),
    (
        plane(drive=PUSHED | {"friction": {"forward": [1, 1], "backward": [1, 1]}}),
        "drive.friction: in a planar scene only `isotropic` is possible",
    ),
    (
        plane(drive=PUSHED | {"friction": {"isotropic": [1, 1]}}, friction={"directions": [0, 2, 4], "value": 1}),
        "drive.friction: direction-dependent friction is constant; remove this key",
    ),
    (plane(friction={"directions": [0, 2, 4]}), "give `directions` (rad) and `value` together and nothing else"),
    (
        plane(friction={"directions": [0, 2, 4], "value": [[1, 1, 1]] * 3}),
        "friction.value: 3 row(s) for 2 contact(s); give one row, or one per contact",
    ),
    (plane(drive={"wave": {"amplitude": 1, "wavelength": 1, "period": 1}}), "waves and strategies need a line"),
    (plane(drive={"times": [0], "actuation": 0.1}), "drive.actuation: 0 row(s) for 1 time(s); give one row per time"),
    (plane(friction={"isotropic": []}), "friction.isotropic: 0 value(s) for 2 contact(s)"),
    (plane(loads=[]), "loads: 0 number(s); in the plane give [x, y]"),
    (plane(start={"displacement": [[0, 0]]}), "in a planar scene it is [x, y] for each of 2 contacts"),
    (
        plane(start={"displacement": [[0.5, 0], [0, 9]]}),
        "contact 0 is pulled by [-0.5, 9] N, 8.01388 N more than its friction; `start: relaxed` is a start without",
    ),
    (
        plane(loads=[[0, 1.5], [0, -1.25]]),
        "contact 0 is pulled by [0, 1.5] N, 0.5 N more than its friction; a load exceeds the friction of its own contact",
    ),
    (plane(friction={"directions": [0, 1, 2, 3], "value": 1}), "friction.directions"),
    (plane(friction={"directions": [0, 1.57, 3.14, 4.71], "value": [1, 1, 1]}), "3 value(s) for 4 direction(s)"),
    (plane(tolerance=-1.0), "tolerance: -1"),
    (plane(tolerance=9e-10), "tolerance: 9e-10; it must be between 1e-09 and 0.5"),
    (change("tolerance", 1e-3), "tolerance: only planar scenes have a tolerance"),
]


def test_the_friction_that_an_error_proposes_is_the_largest_that_is_convex():
    """Of directions that are spaced unevenly, so that each neighbour has a share of its own."""

    def scene(value: float) -> dict[str, Any]:
        return plane(friction={"directions": [0.0, 0.8, 2.0, 3.0, 4.2, 5.3], "value": [1, 1, 1, 1, 2, value]})

    (proposal,) = re.findall(r"direction 5 at 5.3 rad; its neighbours allow at most (\S+) N", refusal(scene(4.0)))
    Scene.model_validate(scene(float(proposal) * (1.0 - 1e-5)))
    assert "not convex" in refusal(scene(float(proposal) * (1.0 + 1e-5)))


@pytest.mark.parametrize(("data", "said"), WRONG_BODIES, ids=[said for _, said in WRONG_BODIES])
def test_a_mistake_in_a_body_is_named(data, said):
    data = json.loads(json.dumps(data))
    for part in data["body"].get("segments", ()):
        if part["elements"] is None:
            del part["elements"]
    assert said in refusal(data)


@pytest.mark.parametrize("seed", range(20))
def test_a_relaxed_start_is_within_rounding_of_no_tension(seed):
    """Also for contacts without friction: lengths like 0.1 leave tensions of 1e-18 N."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 9))
    friction = np.where(rng.random(n) < 0.5, 0.0, 0.1)
    friction[0] = 0.1
    rows = np.cumsum(rng.normal(size=(2, n - 1)), axis=1)
    document = {
        "name": "relaxed",
        "body": {"contacts": list(range(n)), "links": {"stiffness": 10.0 ** rng.uniform(-3, 6, n - 1)}},
        "friction": {"isotropic": friction.tolist()},
        "drive": {"times": [0, 1], "actuation": rows.tolist()},
        "start": "relaxed",
    }
    document["body"]["links"]["stiffness"] = document["body"]["links"]["stiffness"].tolist()
    scene = Scene.model_validate(document)
    assert np.abs(Crawler(scene).tension).max() < 1e-9
