"""Recordings of bodies that remember or swell: simulated again to the bit, with what springs lose in the account."""

from __future__ import annotations

from crawler_model import Scene, load_scene
from crawler_ros.replay import analyse

from ...recordings import record


def test_a_recording_of_springs_that_remember_is_repeated_to_the_bit(tmp_path):
    replay = analyse(record(tmp_path / "bag", load_scene("rubber_worm"), 2))
    assert replay.problems == ()
    assert replay.comparison.identical
    assert replay.energy is not None
    assert replay.energy.internal_dissipation > 0.0
    assert replay.energy.residual < 1e-12


def test_a_recording_of_backlash_is_repeated_to_the_bit_from_its_start_alone(tmp_path):
    body = load_scene("rubber_worm").document()["body"]
    links = [{"stiffness": 20.0, "backlash": 0.01 * (1 + k)} for k in range(len(body["contacts"]) - 1)]
    document = load_scene("rubber_worm").document() | {"name": "loose", "body": body | {"links": links}}
    replay = analyse(record(tmp_path / "bag", Scene.model_validate(document), 2))
    assert replay.problems == ()
    assert replay.comparison.identical
    assert replay.energy.residual < 1e-12


def test_a_recording_of_friction_that_changes_with_elongations_is_repeated_to_the_bit(tmp_path):
    replay = analyse(record(tmp_path / "bag", load_scene("worm_in_a_tube"), 2))
    assert replay.problems == ()
    assert replay.comparison.identical
    assert replay.energy.residual < 1e-12
