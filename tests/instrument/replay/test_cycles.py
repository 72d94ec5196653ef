"""Cycles are found from commands, whatever their speed."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Scene, load_scene
from crawler_ros.replay.cycles import CommandPath, find_cycles, signature_weights

TICK = 10_000_000


def path(rows, start: int = 0) -> CommandPath:
    rows = np.asarray(rows, dtype=float)
    return CommandPath(start + TICK * np.arange(len(rows)), rows @ signature_weights(rows.shape[1]))


def drive_rows(name: str, periods: float, rate: int = 100):
    scene = load_scene(name)
    ns = np.arange(round(periods * rate) + 1) * (10**9 // rate)
    return scene, scene.drive.sample(ns)


def find(made: CommandPath, scene=None):
    columns = 0 if scene is None else scene.columns.count
    return find_cycles(made, None if scene is None else scene.drive, signature_weights(columns))


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("name", ["two_anchor_a", "two_anchor_b", "two_anchor_c", "three_contacts_two_ways"])
def test_periods_of_a_drive_behind_a_wait(name, known):
    scene, rows = drive_rows(name, 4.25)
    wait = np.repeat(rows[:1], 30, axis=0)
    (found,) = find(path(np.vstack((wait, rows))), scene if known else None)
    assert found.bounds == (30, 130, 230, 330, 430)
    assert found.source == ("drive" if known else "recurrence")


def test_a_sampled_wave_recurs():
    t = np.arange(1000) % 100
    (found,) = find(path(np.column_stack((np.sin(2 * np.pi * t / 100), np.cos(2 * np.pi * t / 100)))))
    assert np.diff(found.bounds).tolist() == [100] * 9


def test_pauses_between_and_within_cycles_do_not_matter():
    _, rows = drive_rows("two_anchor_a", 4)
    held = [rows[:150], *[rows[149:150]] * 40, rows[150:300], *[rows[299:300]] * 77, rows[300:]]
    (found,) = find(path(np.vstack(held)))
    assert found.bounds == (0, 100, 240, 417, 517)


def test_a_drive_played_with_a_pause_counts_all_its_cycles():
    scene, rows = drive_rows("two_anchor_a", 4)
    (found,) = find(path(np.vstack((rows[:150], np.repeat(rows[149:150], 40, axis=0), rows[150:]))), scene)
    assert found.source == "recurrence"
    assert len(found.bounds) == 5


def test_five_times_the_speed_is_the_same_cycle():
    _, rows = drive_rows("two_anchor_a", 4)
    (found,) = find(path(np.vstack((rows[:200:5], rows[200:]))))
    assert found.bounds == (0, 20, 40, 140, 240)


def test_rounding_does_not_hide_a_cycle():
    _, rows = drive_rows("two_anchor_c", 4)
    rows = rows * (1 + 1e-14 * np.random.default_rng(0).standard_normal(rows.shape))
    (found,) = find(path(rows))
    assert len(found.bounds) == 5


def test_a_ramp_before_and_another_gait_behind():
    _, rows = drive_rows("two_anchor_a", 3)
    before = rows[0] + np.linspace(1, 0, 20)[:, None] * [5.0, 0.0, 0.0, 0.0, 0.0]
    other = rows.copy()
    other[:, 0] *= 0.5
    found = find(path(np.vstack((before[:-1], rows, other[1:]))))
    assert [len(s.bounds) - 1 for s in found] == [3, 3]


@pytest.mark.parametrize(
    "rows", [np.zeros((50, 3)), np.random.default_rng(1).random((300, 3)), np.zeros((1, 2)), np.zeros((0, 2))]
)
def test_nothing_repeats(rows):
    assert find(path(rows)) == []


def test_one_period_of_a_known_drive_is_a_cycle_and_of_an_unknown_one_is_not():
    scene, rows = drive_rows("two_anchor_a", 1)
    assert find(path(rows), scene)[0].bounds == (0, 100)
    assert find(path(rows)) == []


def test_a_dropped_waypoint_is_not_the_drive():
    scene, _ = drive_rows("two_anchor_a", 1)
    ns = np.arange(0, 3 * 10**9 + 1, 10**9 // 3 + 1)
    rows = scene.drive.sample(ns)
    assert find(CommandPath(ns, rows @ signature_weights(rows.shape[1])), scene) == []


def test_a_hundred_thousand_ticks_of_noise_come_to_an_end():
    rows = np.random.default_rng(2).integers(0, 5, (100_000, 3))
    assert isinstance(find(path(rows)), list)


def driven(times: list[float], lengths: list[float], period: float) -> Scene:
    document = load_scene("two_anchor_b").document()
    document["drive"] = {"times": times, "actuation": [[length] for length in lengths], "period": period}
    return Scene.model_validate(document)


@pytest.mark.parametrize("periods", [3.0, 3.75])
def test_the_period_of_the_drive_is_the_cycle_also_where_it_repeats_within(periods):
    """The halves of a period were taken for cycles of the recording, beside whole periods of its scene."""
    scene = driven([0.0, 0.5, 1.0, 1.5], [0.0, 1.0, 0.0, 1.0], 2.0)
    rows = scene.drive.sample(np.arange(round(200 * periods) + 1) * TICK)
    (found,) = find(path(rows), scene)
    assert found.bounds == (0, 200, 400, 600)
    assert found.source == "drive"


@pytest.mark.parametrize("wait", [0, 30])
def test_a_period_that_begins_with_a_pause_includes_it(wait):
    """The first cycle began where the commands did, and was shorter than the others."""
    scene = driven([0.0, 0.5, 1.0, 1.5], [0.0, 0.0, 1.0, 0.0], 2.0)
    rows = scene.drive.sample(np.arange(601) * TICK)
    (found,) = find(path(np.vstack((np.repeat(rows[:1], wait, axis=0), rows))), scene)
    assert np.diff(found.bounds).tolist() == [200, 200, 200]
    assert found.bounds[0] == wait
