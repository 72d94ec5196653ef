"""The ticks of a ledger, their ramps, and two ways to follow them."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from crawler_model import Crawler, load_scene
from crawler_model.crawler.readout import Readout
from crawler_model.crawler.ticks import runs_in_one_call
from crawler_ros.recording.bag import BagError
from crawler_ros.replay.health import next_ticks_ns
from crawler_ros.replay.ledger import Ticks, divide, read_ticks
from crawler_ros.replay.ramp_rows import RampRows
from crawler_ros.wire.states import contact_names, joint_state_names, shown_contacts

from ...recordings import hold, play


@pytest.mark.parametrize("rate", [100.0, 7.0])
def test_ramps_followed_at_once_and_one_by_one_are_equal_to_the_bit(rate):
    """At 7 Hz waypoints lie within ticks, and in the first and last ones nothing is commanded."""
    scene = load_scene("three_contacts_one_way")
    played = [*play(scene, 500_000_000, 3_000_000_000, rate), *hold(round(3 * rate), 3, rate)]
    ticks = Ticks(
        np.array([start for start, _, _ in played]),
        np.cumsum([0, *(len(offsets) for _, offsets, _ in played)]),
        np.array([offset for _, offsets, _ in played for offset in offsets]),
        np.array([row for _, _, rows in played for row in rows]),
    )
    ends = next_ticks_ns(ticks.start_ns, Fraction(rate))
    body, widths = scene.body, (len(joint_state_names(scene.body)), len(contact_names(scene.body)))
    found = []
    for follow in (RampRows.follow_at_once, RampRows.follow_each):
        crawler = Crawler(scene)
        assert runs_in_one_call(crawler)
        rows = RampRows(scene, widths, 0, divide(ticks, ends, crawler.row))
        follow(rows, crawler, Readout(body, shown_contacts(body)), (ends - ticks.start_ns) / 1e9)
        piece = dataclasses.asdict(rows.piece(shown_contacts(body)))
        found.append(piece | {name: np.array(getattr(rows, name)) for name in ("joints", "contacts", "poses")})
    assert found[0]["ends_tick"].sum() == len(played)
    assert (found[0]["ends_tick"].size > len(played)) == (rate == 7.0)
    for name, values in found[0].items():
        assert np.array_equal(values, found[1][name], equal_nan=name not in ("jumps", "yaw", "stability", "origin"))


def test_ticks_are_divided_where_points_are_due_and_rest_up_to_their_ends():
    ticks = Ticks(
        start_ns=np.array([0, 100, 200]),
        first=np.array([0, 2, 2, 4]),
        offset_ns=np.array([60, 40, 10, 99]),  # the second one is due before the first: at once
        rows=np.arange(4.0)[:, None],
    )
    ramps = divide(ticks, np.array([100, 200, 300]), np.array([9.0]))
    assert ramps.start_ns.tolist() == [0, 60, 60, 100, 200, 210]
    assert ramps.until_ns.tolist() == [60, 60, 100, 200, 210, 300]
    assert ramps.rows.ravel().tolist() == [0.0, 1.0, 1.0, 1.0, 2.0, 3.0]
    assert ramps.moves.tolist() == [True, True, False, False, True, True]
    assert ramps.ends_tick.tolist() == [False, False, True, True, False, True]


def test_points_of_another_width_than_the_commands_of_the_scene_are_refused():
    groups = [(np.array([0]), np.array([[0, 10]]), [np.zeros((1, 2))])]
    with pytest.raises(BagError, match="/applied_commands: a point of 2 numbers; a command of this scene has 3"):
        read_ticks(groups, 3, "/applied_commands")


@pytest.mark.parametrize("rate", [Fraction(100), Fraction(1000, 3), Fraction(99_999_999, 1_000_000), Fraction(7)])
def test_ticks_end_where_the_next_ones_begin_however_many_digits_the_rate_has(rate):
    ns = np.array([k * 10**9 * rate.denominator // rate.numerator for k in (0, 1, 2, 12_345_678, 12_345_679)])
    assert next_ticks_ns(ns, rate)[[0, 1, 3]].tolist() == ns[[1, 2, 4]].tolist()
    assert next_ticks_ns(ns + 3, rate)[0] == 3 + 10**9 * rate.denominator // rate.numerator  # of no tick
