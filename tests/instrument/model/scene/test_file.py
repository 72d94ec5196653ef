"""Scene files that are hostile, broken or too large are answered in one line, soon and without harm."""

from __future__ import annotations

import json
import os
import resource
from pathlib import Path

import pytest

from crawler_model import SceneError, load_scene, parse_scene
from crawler_model.scene.file import LARGEST_FILE

GOOD = "{name: a, body: {contacts: [0, 1], links: {stiffness: 1}}, friction: {isotropic: 1}}"


def bomb(kind: str) -> str:
    """A few lines that stand for billions of values."""
    opening, closing = ("[", "]") if kind == "lists" else ("{<<: [", "]}")
    lines = ["a0: &a0 " + ("[1, 1]" if kind == "lists" else "{k: 1}")]
    for k in range(1, 30):
        items = ", ".join([f"*a{k - 1}"] * 10)
        lines.append(f"a{k}: &a{k} {opening}{items}{closing}")
    return "\n".join(
        [*lines, "name: bomb", "body: {contacts: *a29, links: {stiffness: 1}}", "friction: {isotropic: *a8}"]
    )


EVIL = {
    "python/object/apply": "name: !!python/object/apply:os.system ['touch {marker}']",
    "python/object/new": "name: !!python/object/new:os.system ['touch {marker}']",
    "python/name": "name: !!python/name:os.system",
    "python/module": "name: !!python/module:os",
    "python/object": "name: !!python/object:subprocess.Popen [touch, '{marker}']",
    "a tag": "name: !Evil x",
    "lists of lists": bomb("lists"),
    "merged maps": bomb("maps"),
    "keys": "? " + bomb("lists").replace("\n", "\n  ") + "\n: 1",
    "a list of itself": "name: a\nbody: &b {contacts: [0, *b], links: {stiffness: 1}}\nfriction: {isotropic: 1}",
    "a map of itself": "&a\nname: a\nbody: *a\n",
    "very deep": "name: " + "[" * 100_000,
    "no date": "name: 2026-13-45",
    "a long integer": "name: a\ndimension: " + "9" * 10_000,
    "a long number": GOOD.replace("isotropic: 1", "isotropic: 1" + "0" * 400),
    "base sixty": GOOD.replace("isotropic: 1", "isotropic: " + "1:" * 200_000 + "1"),
    "a long word": GOOD.replace("isotropic: 1", "isotropic: " + "x" * 1_000_000),
    "a long list": GOOD.replace("isotropic: 1", "isotropic: [[[" + "1, " * 10_000 + "1]]]"),
    "a file": "name: a\nbody: !include /etc/passwd",
    "nul": "name: a\0b",
    "two documents": GOOD + "\n---\n" + GOOD,
}


@pytest.mark.parametrize("name", list(EVIL))
def test_what_a_scene_file_must_not_do_is_one_line(tmp_path, name):
    marker = tmp_path / "done"
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(SceneError) as error:
        parse_scene(EVIL[name].replace("{marker}", str(marker)), "evil.yaml")
    text = str(error.value)
    assert text.startswith("evil.yaml: ")
    assert "\n" not in text
    assert len(text) < 1000
    assert not marker.exists()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000  # KiB


def test_aliases_that_stand_for_little_are_taken():
    text = "name: a\nbody: {contacts: [0, 1, 2], links: {stiffness: &k [1, 2]}}\nfriction: {forward: &f [1, 1, 1], backward: *f}"
    assert parse_scene(text).parts.friction.backward == (1.0, 1.0, 1.0)


def strange_paths(folder: Path) -> list[tuple[str, str]]:
    os.mkfifo(folder / "pipe.yaml")
    (folder / "folder.yaml").mkdir()
    (folder / "loop.yaml").symlink_to(folder / "loop.yaml")
    (folder / "zero.yaml").symlink_to("/dev/zero")
    (folder / "empty.yaml").touch()
    (folder / "latin.yaml").write_bytes(b"name: \xe9")
    with (folder / "huge.yaml").open("wb") as stream:
        stream.truncate(LARGEST_FILE + 1)
    return [
        ("../" * 40 + "etc/passwd", "a scene is a mapping"),
        ("/etc/passwd", "a scene is a mapping"),
        ("/dev/zero", "not a file"),
        ("/dev/stdin", "not a file"),
        ("/proc/kmsg", "it is empty"),
        ("/proc/self/environ", "it is empty"),
        (str(folder / "pipe.yaml"), "not a file"),
        (str(folder / "folder.yaml"), "not a file"),
        (str(folder / "loop.yaml"), "no such file"),
        (str(folder / "zero.yaml"), "not a file"),
        (str(folder / "empty.yaml"), "it is empty"),
        (str(folder / "latin.yaml"), "cannot be read"),
        (str(folder / "huge.yaml"), f"it has {LARGEST_FILE + 1} bytes"),
        ("two_anchor_a\0.yaml", "no such file"),
        ("scenes/../two_anchor_a", "no such file"),
        ("", "no such file"),
    ]


def test_a_path_may_have_no_suffix(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two_anchor_a").write_text(
        "name: mine\nbody: {contacts: [0, 1], links: {stiffness: 1}}\nfriction: {isotropic: 1}\n"
    )
    assert load_scene("./two_anchor_a").name == "mine"
    assert load_scene("two_anchor_a").name == "two_anchor_a"


def test_a_strange_scene_path_is_one_line(tmp_path):
    for path, said in strange_paths(tmp_path):
        with pytest.raises(SceneError) as error:
            load_scene(path)
        assert said in str(error.value), path
        assert "\n" not in str(error.value)
        assert "root:" not in str(error.value)


def chain(contacts: int) -> dict:
    return {
        "name": "long",
        "body": {"contacts": list(range(contacts)), "links": {"stiffness": 1}},
        "friction": {"isotropic": 1},
    }


def test_long_scenes_are_written_as_json():
    long = json.dumps(chain(60_000))
    assert parse_scene(long).body.contacts == 60_000
    with pytest.raises(SceneError, match="more than 50000 values or lines; write it as JSON"):
        parse_scene(long.replace('"', ""))
    assert parse_scene(json.dumps(chain(2_000)).replace('"', "")).body.contacts == 2_000
    with pytest.raises(SceneError, match="more than 1000000 values or lines; a scene has fewer"):
        parse_scene(json.dumps(chain(1_000_001)))


@pytest.mark.parametrize("quote", ["", '"'])
def test_lists_in_lists_are_counted(quote):
    def nested(depth: int) -> str:
        return f"{{{quote}name{quote}: {'[' * depth}{']' * depth}}}"

    with pytest.raises(SceneError, match=r"name: \[\[.*; it must be text"):
        parse_scene(nested(99))
    for depth in (5_000, 40_000, *(() if quote else (100, 500))):
        with pytest.raises(SceneError, match="more than 100 nested lists or mappings"):
            parse_scene(nested(depth))
