"""What a scene offers as an object, and who takes one by name."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from crawler_lab import simulate_many, vary
from crawler_model import Crawler, Scene, SceneError, gallery, load_scene, parse_scene, simulate

RING = {
    "name": "ring",
    "body": {"contacts": [0, 1, 2], "links": {"stiffness": 1.0, "between": [[0, 1], [1, 2], [0, 2]]}},
    "friction": {"forward": 0.5, "backward": 1.0},
}
TRUNK = {
    "name": "trunk",
    "body": {
        "segments": [
            {"name": "trunk", "from": 0, "to": 1, "stiffness": 1, "friction": {"isotropic": 0.2}, "elements": 4}
        ],
        "contacts": [2.0],
        "links": {"stiffness": 1.0, "between": [["trunk.to", 0]]},
    },
    "friction": {"isotropic": 0.2},
}


def test_a_scene_has_a_name_a_hash_and_an_equal_copy():
    scene = load_scene("two_anchor_a")
    assert repr(scene) == "Scene(two_anchor_a: 2 contacts, 1 link)"
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert len({scene, load_scene("two_anchor_a")}) == 1
    assert scene != "two_anchor_a"


def test_a_copy_of_a_scene_whose_elements_follow_from_its_accuracy_is_equal():
    scene = load_scene("peristaltic_segment")
    assert pickle.loads(pickle.dumps(scene)) == scene == Scene.model_validate(scene.document())


def test_numbers_of_numpy_are_numbers():
    links = {"stiffness": np.array([1.0, 2.0], np.float32)}
    body = {"contacts": list(np.arange(3)), "links": links}
    given = {"name": "a", "body": body, "friction": {"isotropic": np.float32(0.5)}}
    scene = Scene.model_validate(given)
    assert scene.body.stiffness.tolist() == [1.0, 2.0]
    assert simulate(scene, np.float32(0.5), np.int64(10)).time.size == 6
    with pytest.raises(SceneError, match="True is not a number"):
        Scene.model_validate(given | {"friction": {"isotropic": np.True_}})


def test_variations_take_names_and_refuse_what_is_no_scene():
    assert len(vary("two_anchor_a", {"drive.length": [1.0, 2.0]})) == 2
    with pytest.raises(SceneError, match=r"^vary: 3; it must be a Scene, a path or a gallery name"):
        vary(3, {"drive.length": [1.0]})
    with pytest.raises(SceneError, match=r"^simulate_many: str; it must be a sequence of scenes"):
        simulate_many("two_anchor_a")
    with pytest.raises(SceneError, match=r"^simulate_many: entry 1 is a str"):
        simulate_many([load_scene("two_anchor_a"), "two_anchor_a"])


def test_a_key_given_twice_is_named_in_json_too():
    with pytest.raises(SceneError, match="key 'name' is given twice"):
        parse_scene('{"name": "a", "name": "b"}')


def test_a_merge_key_of_yaml_is_refused_in_the_words_of_scenes():
    with pytest.raises(SceneError, match="in line 2: key '<<' merges another mapping; write its keys out"):
        parse_scene("friction:\n  <<: {forward: 1.0}\n  backward: 2.0\n")


def test_the_gallery_lists_names_and_first_lines():
    assert gallery()["two_anchor_a"]


def test_forces_of_many_rows_are_those_of_each():
    body = Scene.model_validate(RING).body
    rows = np.arange(12.0).reshape(2, 2, 3)
    for index in np.ndindex(2, 2):
        assert (body.spring_force(rows)[index] == body.spring_force(rows[index])).all()


def test_places_on_a_body_have_names():
    body = Scene.model_validate(TRUNK).body
    assert [body.name_of(0), body.name_of(5)] == ["segment trunk at 0 m", "contact 0"]
    columns = Scene.model_validate(TRUNK).columns
    assert (columns.items("link"), Scene.model_validate(RING).columns.items("link")) == ("link and segment", "link")


def test_a_start_along_a_segment_is_straight_between_its_ends():
    start = {"displacement": [0.02, 0.0, 0.02]}
    scene = Scene.model_validate(TRUNK | {"start": start})
    assert scene.start_displacement[:5] == pytest.approx(np.linspace(0.0, 0.02, 5))


def test_margins_and_mean_of_a_crawler():
    crawler = Crawler(load_scene("two_anchor_a"))
    assert crawler.margins.shape == (2,)
    assert isinstance(crawler.net_translation, float)
    planar = Crawler(load_scene("planar_rectilinear"))
    assert planar.contact_state.tolist() == [0] * planar.body.contacts


def test_a_drive_that_is_too_short_or_never_is_refused():
    data = load_scene("three_contacts_one_way").document()
    data["drive"]["period"] = 1e-10
    with pytest.raises(SceneError, match="period"):
        Scene.model_validate(data)


def test_short_waves_ask_for_elements_by_their_number():
    segment = {"name": "trunk", "from": 0, "to": 1, "stiffness": 1, "friction": {"isotropic": 0.1}, "accuracy": 0.1}
    wave = {"amplitude": 0.1, "wavelength": 0.05, "period": 1.0, "samples": 3}
    scene = Scene.model_validate(
        {"name": "s", "body": {"segments": [segment]}, "drive": {"wave": wave}, "start": "relaxed"}
    )
    assert scene.body.segments[0].elements == 80
