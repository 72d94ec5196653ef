"""Measurements with gaps, and measurements that are refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from crawler_lab.identify.measurements import MeasurementError, check_measurements, find_copies
from crawler_lab.identify.recorded import read_bag
from crawler_model import Crawler, Scene, load_scene
from crawler_model.body.drive import NS

from ...recordings import attachments, messages, play, write
from .synthetic import chain, measure, walk

SCENE = Scene.model_validate(chain(3))


def measured():
    times, rows = walk(2, 1.0, 1)
    return measure(chain(3), times, rows, ("contact_0", "contact_2", "link_1"))


def changed(field, place, value):
    found = measured()
    array = np.array(getattr(found, field))
    array[place] = value
    return dataclasses.replace(found, **{field: array})


def test_gaps_are_kept_and_rows_without_any_value_are_dropped():
    values = measured().values.copy()
    values[[3, 4, 5], [0, 1, 2]] = np.nan
    values[[0, 10, 50]] = np.nan
    found = check_measurements(SCENE, dataclasses.replace(measured(), values=values))
    kept = np.delete(np.arange(51), [0, 10, 50])
    np.testing.assert_array_equal(found.values, values[kept])
    np.testing.assert_array_equal(found.time, measured().time[kept])
    np.testing.assert_array_equal(found.command_time, measured().command_time)


@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_infinite_values_are_refused(value):
    with pytest.raises(MeasurementError, match=r"contact_2 is -?inf in row 5 \(time 0.1 s\); it must be finite"):
        check_measurements(SCENE, changed("values", (5, 1), value))


@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_commands_without_a_finite_number_are_refused(value):
    with pytest.raises(MeasurementError, match=r"a gap: command/link_1 is (inf|nan) in row 2 \(time 0.4 s\)"):
        check_measurements(SCENE, changed("commands", (2, 1), value))


def test_a_channel_needs_eight_values():
    check_measurements(SCENE, changed("values", (slice(8, None), 2), np.nan))
    with pytest.raises(MeasurementError, match=r"link_1 has 7 value\(s\) .*; at least 8 are needed"):
        check_measurements(SCENE, changed("values", (slice(7, None), 2), np.nan))


def test_units_are_checked_where_both_ends_are_seen():
    wrong = changed("values", slice(None), measured().values * 1000.0)
    values = wrong.values.copy()
    values[:25, 0], values[20:, 2] = np.nan, np.nan
    for bad in (values, np.where([True, True, False], values, 0.0), np.where([False, False, True], values, 0.1)):
        with pytest.raises(
            MeasurementError, match=r"look like millimetres or pixels: divide millimetres by 1000, or use --units mm"
        ):
            check_measurements(SCENE, dataclasses.replace(wrong, values=bad))
    values[25:, 1] = np.nan
    values[:, 2] = 0.0
    check_measurements(SCENE, dataclasses.replace(wrong, values=values))
    with pytest.raises(MeasurementError, match=r"divide them by 1000, or leave out --units mm if .* in metres"):
        check_measurements(SCENE, changed("values", slice(None), measured().values / 1000.0))


NONE = np.zeros((51, 0))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"channels": (), "values": NONE}, "nothing is measured; it must have at least one of contact_0, contact_1"),
        (
            {"channels": ("contact_0", "contact_9", "link_1")},
            "column contact_9 does not belong to measured, which has contact_0",
        ),
        ({"channels": ("contact_0", "link_1", "link_1")}, "column link_1 is given twice"),
        ({"command_names": ("link_0", "link_0")}, "column link_0 is given twice"),
        (
            {"command_names": ("link_0", "link_9")},
            "command/link_9 does not belong to measured, whose commands are link_0, link_1",
        ),
        ({"command_names": ("link_0",)}, "no column command/link_1; the commands of all of link_0, link_1 are needed"),
        (
            {"command_names": ()},
            "no commands, and measured has no drive; add the columns command/link_0, command/link_1",
        ),
    ],
)
def test_columns_that_do_not_fit_the_scene_are_refused(changes, message):
    found = measured()
    changes = {"commands": found.commands[:, : len(changes.get("command_names", found.command_names))]} | changes
    with pytest.raises(MeasurementError) as error:
        check_measurements(SCENE, dataclasses.replace(found, **changes))
    assert message in str(error.value)


def test_of_commands_that_a_tick_followed_at_once_the_path_is_kept(tmp_path):
    """A trajectory that arrives late is followed from its first point; its last point alone would move otherwise."""
    scene = load_scene("three_contacts_two_ways")
    drive = scene.drive
    ticks = list(play(scene, 0, 3 * NS // 2))
    vertices = [row for _, _, rows in ticks for row in rows]
    late = [(start, [], []) for start, _, _ in ticks[:-1]]
    late.append((ticks[-1][0], [0] * (len(vertices) - 1) + [NS // 100], vertices))
    sent = list(messages(scene, late))
    (found,) = read_bag(write(tmp_path / "late", sent, attachments(scene)), scene, {})
    assert (np.diff(found.command_time) > 0.0).all()
    crawler = Crawler(scene)
    for row in found.commands:
        crawler.advance(row)
    moved = found.values[-1] - found.values[0]
    assert np.abs(moved).max() > 0.01 * np.abs(drive.actuation).max()
    assert crawler.displacement == pytest.approx(moved, abs=1e-12)
    at_rest = found.command_time < ticks[-1][0] / NS
    assert (found.commands[at_rest] == found.commands[0]).all()


def test_a_marker_that_is_used_twice_is_found():
    """Also with a constant, gaps and the digits of a table between them; not where both rest or noise differs."""
    times, rows = walk(2, 2.0, 1)
    plain = measure(chain(3), times, rows)
    values = plain.values.copy()
    assert find_copies(SCENE.body, plain) == []
    values[:, 2] = np.round(values[:, 1] + 0.1, 7)
    values[3:6, 1] = np.nan
    assert find_copies(SCENE.body, dataclasses.replace(plain, values=values)) == [("contact_1", "contact_2")]
    noisy = values + 1e-4 * np.random.default_rng(0).normal(size=values.shape)
    assert find_copies(SCENE.body, dataclasses.replace(plain, values=noisy)) == []
    values[:, 1:] = 0.1
    assert find_copies(SCENE.body, dataclasses.replace(plain, values=values)) == []
