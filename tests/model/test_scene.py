from __future__ import annotations

import copy
import json
from importlib import resources
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from crawler_model import CommandError, Crawler, Scene, SceneError, gallery, load_scene, parse_scene, simulate

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
    ("body/links/stiffness", [1, 2, 3], "body.links.stiffness: 3 value(s) for 2 link(s); give one number or 2"),
    ("body/links/stiffness", 0, "link 0 has 0 N/m; it must be > 0"),
    ("body/links/stiffness", [1, -1], "link 1 has -1 N/m; it must be > 0"),
    ("body/links/stiffness", True, "True is not a number"),
    ("body/links/between", [[0, 1], [0, 3]], "body.links.between: link 1 joins contact 3; there are contacts 0 .. 2"),
    ("body/links/between", [[0, 1], [1, 1]], "body.links.between: link 1 joins contact 1 to itself"),
    ("body/links/between", [[0, 1]], "body.links.between: no links lead from contact 0 to contact 2"),
    ("body/links/between", [[0, 1], [1, "x.to"]], "body.links.between: link 1 joins x.to; there are contacts 0 .. 2"),
    ("body/links/between", [[0, 1], [1, "2"]], "body.links.between: link 1 joins '2'; an end is a number, `name.from`"),
    ("friction/forward", -1, "friction.forward: contact 0 has -1 N; friction must be >= 0"),
    ("friction/forward", [1, 1], "friction.forward: 2 value(s) for 3 contact(s)"),
    ("friction/forward", None, "friction: give both `forward` and `backward`, or `isotropic` alone"),
    ("friction/isotropic", 1, "friction: give both `forward` and `backward`, or `isotropic` alone"),
    ("friction", None, "friction: missing"),
    ("friction", 0.3, "friction: write {isotropic: 0.3}, or give `forward` and `backward`"),
    ("body/links/between", [], "body.links.between: no links lead from contact 0 to contact 1"),
    ("body/links/stiffness", 10**400, "too large; at most 1e+100"),
    ("body/links/stiffness", 1e200, "too large; at most 1e+100"),
    ("drive/times", [0, 1e-10], "waypoints are at least a nanosecond apart"),
    ("name", None, "name: missing"),
    ("start", {"displacement": [0, 1]}, "start.displacement: 2 value(s) for 3 contact(s)"),
    (
        "start",
        {"displacement": [0, 2, 0]},
        "start.displacement: contact 1 is pulled by 8 N, 6 N more than its backward",
    ),
    ("drive/times", [0, 0], "drive.times: entry 1 (0 s) does not come after entry 0"),
    ("drive/times", [1, 2], "drive.times: the first time must be 0"),
    ("drive/times", [0, 1, 2], "drive.actuation: 2 row(s) for 3 time(s)"),
    ("drive/actuation", [[0, 0], [1]], "drive.actuation: row 1: 1 value(s) for 2 link(s)"),
    ("drive/actuation", None, "drive: `actuation` is missing"),
    ("drive/period", 0.5, "drive.period: 0.5 s ends before the last waypoint at 1 s"),
    ("drive/period", 1, "drive.actuation: the last row, at the period's end, has 1 for link_0 and the first 0"),
    ("drive/strategy", "A", "give exactly one of"),
    ("drive/wave", {"amplitude": 1, "wavelength": 1, "period": 1}, "give exactly one of"),
    ("drive", {}, "give exactly one of"),
    ("drive", {"strategy": "A", "length": 1, "friction": 1}, "strategies drive 2 contacts, this body has 3"),
    ("drive", {"strategy": "D", "length": 1, "friction": 1}, "drive.strategy"),
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


def test_several_mistakes_are_counted():
    data = change("friction/forward", "a")
    data["body"]["links"]["stiffness"] = "b"
    assert "(and 1 more)" in refusal(data)


def test_an_inadmissible_start_says_what_would_be_right():
    data = change("start", {"displacement": [0, 2, 0]})
    assert "a start without tension is [0, 0, 0]" in refusal(data)


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
    assert scene.mesh.stiffness == [1000.0]


def test_a_scene_is_frozen_and_its_arrays_too():
    scene = Scene.model_validate(GOOD)
    with pytest.raises(ValidationError):
        scene.name = "other"
    for array in (scene.mesh.position, scene.commands.forward, scene.commands.actuation):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_load_by_path_and_by_name(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(json.dumps(GOOD))
    assert load_scene(file) == load_scene(str(file)) == Scene.model_validate(GOOD)
    assert load_scene("two_anchor_a").name == "two_anchor_a"
    with pytest.raises(SceneError, match="nearest is 'two_anchor_a'"):
        load_scene("two_ancor_a")
    with pytest.raises(SceneError, match="no such file"):
        load_scene(tmp_path / "none.yaml")
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
    assert json.loads(text) == Scene.model_json_schema()


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


def test_a_wave_travels_towards_plus_x():
    data = change("drive", {"wave": {"amplitude": 0.1, "mean": 0.2, "wavelength": 2.0, "period": 3.0}})
    data["start"] = {"displacement": [0.0, 0.1, 0.4]}
    drive = Scene.model_validate(data).commands
    t, m = drive.times[:, None], np.array([0.5, 1.5])
    assert drive.actuation == pytest.approx(0.2 + 0.1 * np.sin(2 * np.pi * (t / 3.0 - m / 2.0)))
    assert drive.times.size == 65
    assert (drive.actuation[0] == drive.actuation[-1]).all()


def test_a_friction_wave_goes_with_a_wave():
    wave = {"amplitude": 0.1, "wavelength": 2.0, "period": 1.0, "samples": 8}
    data = change("drive", {"wave": wave, "friction_wave": {**wave, "mean": 0.5, "samples": 12}})
    data["start"] = {"displacement": [0.0, -0.1, 0.0]}
    drive = Scene.model_validate(data).commands
    assert drive.times.size == 17  # 8 and 12 share the quarters
    x = np.array([0.0, 1.0, 2.0])
    assert drive.forward == pytest.approx(0.5 + 0.1 * np.sin(2 * np.pi * (drive.times[:, None] - x / 2.0)))
    assert (drive.forward == drive.backward).all()


def test_friction_of_a_drive_replaces_the_scenes():
    rows = {"forward": [[3, 3, 3], [1, 1, 1]], "backward": [[4, 4, 4], [1, 1, 1]]}
    drive = Scene.model_validate(change("drive/friction", rows)).commands
    assert drive.forward[0].tolist() == [3, 3, 3]
    assert drive.backward[0].tolist() == [4, 4, 4]
