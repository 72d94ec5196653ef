"""Recordings of springs that remember: simulated again to the bit, with what the springs lose in the account."""

from __future__ import annotations

from crawler_model import load_scene
from crawler_ros.replay import analyse

from ..recordings import record


def test_a_recording_of_springs_that_remember_is_repeated_to_the_bit(tmp_path):
    replay = analyse(record(tmp_path / "bag", load_scene("rubber_worm"), 2))
    assert replay.problems == ()
    assert replay.comparison.identical
    assert replay.energy is not None
    assert replay.energy.internal_dissipation > 0.0
    assert replay.energy.residual < 1e-12
