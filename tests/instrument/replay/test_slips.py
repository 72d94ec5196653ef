"""Slips from what contacts gained, however the run is cut into pieces."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crawler_ros.replay.slips import SlipFinder, sliding


def slips(gained, cuts=(), run=None):
    gained = np.asarray(gained, dtype=float)
    finder = SlipFinder()
    time = np.arange(len(gained) + 1)
    run = np.zeros(len(gained), int) if run is None else np.asarray(run)
    bounds = [0, *sorted(cuts), len(gained)]
    for a, b in itertools.pairwise(bounds):
        if b > a:
            finder.add_ramps(run[a:b], time[a:b], time[a + 1 : b + 1], gained[a:b])
    return finder.finish()


def test_a_slip_lasts_while_a_contact_slides_one_way():
    found = slips([[0, 1], [0, 2], [0, 0], [-1, 1], [-1, -1]])
    assert found.contact.tolist() == [1, 0, 1, 1]
    assert found.direction.tolist() == [1, -1, 1, -1]
    assert found.start_ns.tolist() == [0, 3, 3, 4]
    assert found.end_ns.tolist() == [2, 5, 4, 5]
    assert found.distance.tolist() == [3, 2, 1, 1]


def test_a_reset_ends_a_slip():
    found = slips([[1.0], [1.0], [1.0]], run=[0, 0, 1])
    assert found.run.tolist() == [0, 1]
    assert found.distance.tolist() == [2, 1]


def test_rounding_is_no_slip():
    assert sliding(np.array([[1.0, 1e-16], [1e-16, 0.0]])).tolist() == [[1, 0], [1, 0]]


def test_in_the_plane_a_slip_has_an_angle():
    found = slips([[[1.0, 0.0]], [[0.0, 1.0]], [[0.0, 0.0]]])
    assert found.direction == pytest.approx([np.pi / 4])
    assert found.distance == pytest.approx([2.0])


@settings(max_examples=80, deadline=None)
@given(st.lists(st.lists(st.integers(-1, 1), min_size=2, max_size=2), min_size=1, max_size=20), st.data())
def test_cutting_a_run_into_pieces_changes_nothing(rows, data):
    cuts = data.draw(st.lists(st.integers(0, len(rows)), max_size=4))
    whole, cut = slips(rows), slips(rows, cuts)
    for name in ("contact", "direction", "start_ns", "end_ns", "distance"):
        assert getattr(whole, name).tolist() == getattr(cut, name).tolist()
    assert whole.distance.sum() == np.abs(rows).sum()


def test_no_contact_and_no_ramp():
    assert slips(np.zeros((3, 0))).contact.size == 0
    assert SlipFinder().finish().contact.size == 0
