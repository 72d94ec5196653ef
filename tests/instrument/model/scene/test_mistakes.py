"""Mistakes that people make in scene files: each is one line that names it."""

from __future__ import annotations

import pytest

from crawler_model import SceneError, load_scene
from crawler_model.scene.file import parse_scene

SCENE = """name: worm
body:
  contacts: [0.0, 1.0]
  links:
    stiffness: 1.0
friction: {forward: 1.0, backward: 2.0}
start: relaxed
drive:
  times: [0, 0.5, 1]
  period: 1.0
  actuation: [[0], [0.5], [0]]
"""
STIFFNESS, PERIOD, CONTACTS, FORWARD, NAME = (
    "stiffness: 1.0",
    "period: 1.0",
    "[0.0, 1.0]",
    "forward: 1.0",
    "name: worm",
)
TAB = "it is a tab: indent with spaces"
VALUES = [
    (STIFFNESS, "stiffness: 1,5", "body.links.stiffness: '1,5' is not a number; write 1.5"),
    (
        STIFFNESS,
        "stiffness: 1.0 N/m",
        "body.links.stiffness: '1.0 N/m' is not a number; write only the number, in N/m",
    ),
    (STIFFNESS, "stiffness: 50%", "body.links.stiffness: '50%' is not a number; write only the number, in N/m"),
    (STIFFNESS, "stiffness: 1/2", "body.links.stiffness: '1/2' is not a number"),
    (STIFFNESS, "stiffness: 2*3", "body.links.stiffness: '2*3' is not a number"),
    (STIFFNESS, "stiffness: stiff", "body.links.stiffness: 'stiff' is not a number"),
    (STIFFNESS, "stiffness: 1'000", """body.links.stiffness: "1'000" is not a number"""),
    (STIFFNESS, "stiffness: 0x10", "body.links.stiffness: '0x10' is not a number"),
    (STIFFNESS, "stiffness: 0o17", "body.links.stiffness: '0o17' is not a number"),
    (STIFFNESS, "stiffness: true", "body.links.stiffness: True is not a number"),
    (STIFFNESS, "stiffness: yes", "body.links.stiffness: True is not a number"),
    (STIFFNESS, "stiffness:", "body.links: stiffness: missing"),
    (STIFFNESS, "stiffness: ~", "body.links: stiffness: missing"),
    (STIFFNESS, "stiffness: .nan", "body.links.stiffness: nan is not finite"),
    (STIFFNESS, "stiffness: nan", "body.links.stiffness: nan is not finite"),
    (STIFFNESS, "stiffness: .inf", "body.links.stiffness: inf is not finite"),
    (STIFFNESS, "stiffness: Infinity", "body.links.stiffness: inf is not finite"),
    (STIFFNESS, "stiffness: 1e999", "body.links.stiffness: inf is not finite"),
    (STIFFNESS, "stiffness: 1e300", "body.links.stiffness: 1e+300 is too large; at most 1e+100"),
    (
        STIFFNESS,
        f"stiffness: {'9' * 400}",
        "body.links.stiffness: an integer of 1329 bits is too large; at most 1e+100",
    ),
    (STIFFNESS, f"stiffness: {'9' * 5000}", "in line 5: a number of 5000 digits"),
    (STIFFNESS, "stiffness: -1.0", "body.links.stiffness: link 0 has -1 N/m; it must be > 0"),
    (STIFFNESS, "stiffness: 0", "body.links.stiffness: link 0 has 0 N/m; it must be > 0"),
    (STIFFNESS, "stiffness:1.0", "body.links: 'stiffness:1.0'; it must be a mapping with stiffness"),
    (STIFFNESS, "stiffness: !N 1.0", "in line 5: could not determine a constructor for the tag '!N'"),
    (STIFFNESS, "stiffness: !!int abc", "in line 5: 'abc' is not a number"),
    (STIFFNESS, "stiffness: !!float abc", "in line 5: 'abc' is not a number"),
    (STIFFNESS, "stiffness: !!python/object/apply:os.system [ls]", "in line 5: could not determine a constructor"),
    (STIFFNESS, "stiffness: *k", "in line 5: found undefined alias"),
    (STIFFNESS, f"{STIFFNESS}\n    between: [[a, b]]", "body.links.between: link 0 joins 'a'; an end is a number"),
    (STIFFNESS, f"{STIFFNESS}\n    between: [[0, 7]]", "body.links.between: link 0 joins contact 7; there are"),
    (STIFFNESS, f"{STIFFNESS}\n    between: [[0, 0.5]]", "body.links.between.0.1: 0.5; it must be a valid integer"),
    (PERIOD, "period: 1s", "drive.period: '1s' is not a number; write only the number, in s"),
    (PERIOD, "period: 1:30", "drive.period: '1:30' is not a number"),
    (PERIOD, "period: 2024-01-01", "drive.period: '2024-01-01' is not a number"),
    (PERIOD, "period: -.inf", "drive.period: -inf is not finite"),
    (PERIOD, "period: !!timestamp 2024-13-45", "not plain YAML: month must be in 1..12"),
    (PERIOD, f"{PERIOD}\n  period: 2.0", "in line 11: key 'period' is given twice"),
    (FORWARD, "forward: 0,1", "in line 6: key 1 is not text; numbers have a decimal point: a comma begins another key"),
    (FORWARD, "forward: -1.0", "friction.forward: contact 0 has -1 N; friction must be >= 0"),
    (FORWARD, "forward: \u22121.0", "friction.forward: '\u22121.0' is not a number; write -1.0"),
    (FORWARD, "forward: &f [*f]", "in line 6: with its aliases expanded it holds more than"),
    ("{forward: 1.0, backward: 2.0}", "\n  forward: 0,1\n  backward: 2.0", "forward: '0,1' is not a number; write 0.1"),
    ("{forward: 1.0, backward: 2.0}", "[1.0, 2.0]", "friction: write {isotropic: [1.0, 2.0]}, or give `forward`"),
    ("{forward: 1.0, backward: 2.0}", "\n  <<: {forward: 1}\n  backward: 2", "key '<<' merges another mapping"),
    ("backward: 2.0}", "backward: 2.0", "in line 7: did not find expected ',' or '}'"),
    (CONTACTS, "[0,0, 1,0]", "body.contacts: contact 1 at 0 m does not lie beyond contact 0 at 0 m"),
    (CONTACTS, "[0.0, 1.0 m]", "body.contacts.1: '1.0 m' is not a number; write only the number, in m"),
    (CONTACTS, "[0.0, 1.0", "in line 4: did not find expected ',' or ']'"),
    (CONTACTS, "[0.0, null]", "body.contacts.1: None is not a number"),
    (CONTACTS, "[false, true]", "body.contacts.0: False is not a number"),
    (CONTACTS, "[1.0, 0.0]", "body.contacts: contact 1 at 0 m does not lie beyond contact 0 at 1 m"),
    (CONTACTS, "[[0.0, 1.0]]", "body.contacts: contact 0 is [0.0, 1.0]; on a line it is a number"),
    (CONTACTS, "[]", "body.contacts: 0 contact(s); a crawler needs at least 2"),
    (CONTACTS, "2", "body.contacts: 2; it must be a list"),
    (CONTACTS, "{a: 0.0, b: 1.0}", "body.contacts: {'a': 0.0, 'b': 1.0}; it must be a list"),
    ("[[0], [0.5], [0]]", "[[0], [0.5, 1], [0]]", "drive.actuation: row 1: 2 value(s) for 1 link(s)"),
    ("[[0], [0.5], [0]]", "[[0], [0.5]]", "drive.actuation: 2 row(s) for 3 time(s); give one row per time"),
    ("[0, 0.5, 1]", "[0, 0.5, 0.4]", "drive.times: entry 2 (0.4 s) does not come after entry 1 (0.5 s)"),
    ("[0, 0.5, 1]", "'0, 0.5, 1'", "drive.times: '0, 0.5, 1'; it must be a list"),
    (f"{NAME}\n", "", "name: missing"),
    (NAME, "name: 12", "name: 12; it must be text"),
    (NAME, "name: 'worm", "found unexpected end of stream"),
    (NAME, "name: wo\x07rm", "control characters are not allowed"),
    (NAME, "1: worm", "in line 1: key 1 is not text"),
    (NAME, "yes: worm", "in line 1: key True is not text"),
    (NAME, "[a]: worm", "in line 1: key [] is not text"),
    ("    stiffness", "\tstiffness", f"in line 5: found character that cannot start any token; {TAB}"),
    ("    stiffness", "  \tstiffness", f"in line 5: found character that cannot start any token; {TAB}"),
    ("  contacts", "\tcontacts", f"in line 3: found character that cannot start any token; {TAB}"),
    ("  contacts", "   contacts", "in line 4: did not find expected key"),
    ("friction:", "fricton:", "fricton: unknown key; the nearest known key is 'friction'"),
    ("friction:", "Friction:", "Friction: unknown key; the nearest known key is 'friction'"),
    ("start: relaxed", "start relaxed", "in line 8: could not find expected ':'"),
]
FILES = {
    "two documents": (f"{SCENE}---\n{SCENE}", "in line 12: but found another document"),
    "a list": ("- " + SCENE.replace("\n", "\n  "), "a scene is a mapping with the keys name, dimension, body"),
    "a word": ("worm\n", "a scene is a mapping with the keys name, dimension, body"),
    "nothing": ("# nothing\n", "a scene is a mapping with the keys name, dimension, body"),
    "a block of a page": (f"```yaml\n{SCENE}```\n", "in line 1: found character that cannot start any token"),
    "a key twice": (f"{SCENE}start: relaxed\n", "in line 12: key 'start' is given twice"),
    "a later YAML": (f"%YAML 3.0\n---\n{SCENE}", "in line 1: found incompatible YAML document"),
    "JSON with NaN": ('{"name": "worm", "body": {"contacts": [0, NaN]}}', "body.contacts.1: nan is not finite"),
    "JSON with a lone surrogate": ('{"name": "\\ud800"}', "name: '\\ud800' contains control characters"),
}


def error_of(text: str) -> str:
    with pytest.raises(SceneError) as caught:
        parse_scene(text, "worm.yaml")
    return str(caught.value)


def check(error: str, message: str) -> None:
    assert error.startswith("worm.yaml: ")
    assert message in error
    assert "\n" not in error
    assert len(error) < 600


def test_the_scene_itself_is_valid():
    assert parse_scene(SCENE).name == "worm"


@pytest.mark.parametrize(("right", "wrong", "message"), VALUES, ids=[f"{wrong[:30]!a}" for _, wrong, _ in VALUES])
def test_a_mistake_is_one_line(right, wrong, message):
    assert SCENE.count(right) == 1
    check(error_of(SCENE.replace(right, wrong)), message)


@pytest.mark.parametrize(("text", "message"), FILES.values(), ids=FILES)
def test_a_file_that_is_no_scene_is_one_line(text, message):
    check(error_of(text), message)


@pytest.mark.parametrize(
    ("right", "also"),
    [
        (STIFFNESS, "stiffness:\t1.0"),
        (STIFFNESS, "stiffness: '1.0'"),
        (STIFFNESS, "stiffness: 01"),
        (STIFFNESS, "stiffness: 1_0e-1"),
        (STIFFNESS, "stiffness: 1e0"),
        (STIFFNESS, "stiffness: &k 1.0"),
    ],
)
def test_another_spelling_of_a_number_is_that_number(right, also):
    assert SCENE.count(right) == 1
    assert parse_scene(SCENE.replace(right, also)).document() == parse_scene(SCENE).document()


def test_a_name_that_looks_like_a_date_is_text():
    assert parse_scene(SCENE.replace(NAME, "name: 2024-01-01")).name == "2024-01-01"


@pytest.mark.parametrize(
    ("encoding", "message"),
    [
        ("utf-16", "its encoding is UTF-16; save it as UTF-8"),
        ("utf-16-le", "its encoding is UTF-16; save it as UTF-8"),
        ("utf-32", "its encoding is UTF-32; save it as UTF-8"),
        (
            "cp1252",
            "byte 0xfc in line 1 is not UTF-8; in the encoding cp1252 (Windows) it is 'ü': save the file as UTF-8",
        ),
    ],
)
def test_the_encoding_of_a_file_is_named(tmp_path, encoding, message):
    file = tmp_path / "worm.yaml"
    file.write_bytes(SCENE.replace("worm", "würm").encode(encoding))
    with pytest.raises(SceneError) as caught:
        load_scene(file)
    assert str(caught.value) == f"{file}: cannot be read: {message}"


def test_a_byte_order_mark_is_ignored(tmp_path):
    (tmp_path / "worm.yaml").write_text(SCENE, encoding="utf-8-sig")
    assert load_scene(tmp_path / "worm.yaml").name == "worm"
