from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest

from crawler_lab import sensitivities, simulate_many
from crawler_model import CommandError, Crawler, load_scene, simulate
from crawler_model.run.ticks import rational_rate, tick_end_ns, tick_ends
from crawler_model.run.transport import supporting_force

from ..chains import scene

ONCE = {"times": [0, 0.25, 1.0], "actuation": [0, 3, -3]}


def test_ticks_end_without_drift():
    rate = Fraction(30000, 1001)
    assert tick_end_ns(30000 * 10**6, rate) == 1001 * 10**15
    assert [tick_end_ns(k, Fraction(3)) for k in range(4)] == [0, 333333333, 666666666, 10**9]


@pytest.mark.parametrize(
    ("rate", "first", "end_ns"),
    [
        (Fraction(100), 1, 95_000_000),
        (Fraction(99_999_999, 1_000_000), 8 * 10**8, 9 * 10**18),
        (Fraction(999_999_999_999_989, 999_983), 10**16, 9 * 10**18),
        (Fraction(1e-9), 1, 9 * 10**18),  # the second tick ends beyond all times
    ],
)
def test_many_ticks_end_where_each_ends_however_many_digits_the_rate_has(rate, first, end_ns):
    ends = tick_ends(first, first + 9, rate, end_ns)
    assert ends.tolist() == [min(tick_end_ns(k, rate), end_ns) for k in range(first, first + 10)]


@pytest.mark.parametrize("rate", [0.1, 1.0, 29.97, 100.0, 1000.0, 1e9, 1 / 3])
def test_a_rate_is_read_as_it_was_meant(rate):
    assert float(rational_rate(rate)) == pytest.approx(rate, rel=1e-12)
    assert rational_rate(29.97) == Fraction(2997, 100)


@pytest.mark.parametrize("name", ["rate", "duration"])
@pytest.mark.parametrize(
    ("value", "written"), [(10**400, "an integer of 1329 bits"), ("3", "'3'"), ([3.0], r"\[3.0\]")]
)
def test_what_is_no_number_or_beyond_all_floats_is_one_line(name, value, written):
    scene, given, said = (
        load_scene("three_contacts_one_way"),
        {name: value},
        f"^{name}: {written} .* must be .* and .*e9$",
    )
    with pytest.raises(CommandError, match=said):
        simulate(scene, **given)
    with pytest.raises(CommandError, match=said):
        sensitivities(scene, ["body.links.stiffness"], **given)


def test_the_summary_is_the_contract():
    summary = simulate(load_scene("two_anchor_a"), duration=3.0).summary()
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["schema"] == 1
    assert summary["scene"] == "two_anchor_a"
    assert summary["method"] == "exact"
    assert summary["rate_hz"] == 100.0
    assert summary["time"] == [0.0, 1.0, 2.0, 3.0]
    assert summary["displacement"] == [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0], [6.0, 7.0]]
    assert summary["net_translation"] == [0.5, 2.5, 4.5, 6.5]
    assert summary["per_period"] == [2.0, 2.0, 2.0]
    assert summary["energy"].keys() == {"work", "dissipation", "stored", "residual"}
    assert summary["unique"] is True
    assert summary["uniqueness_margin"] == 0.0
    assert summary["ticks"] == 300
    assert summary["events"] >= 300
    assert {"violation", "visited_margin", "wall_s"} <= summary.keys()
    assert summary["visited_margin_sampled"] is False
    assert summary["overspent"] == summary["unsolved"] == 0


@pytest.mark.parametrize(
    ("contacts", "method", "sampled"), [(256, "exact", False), (257, "exact", True), (3, "catch_up", True)]
)
def test_it_is_told_where_the_visited_margin_is_sampled(contacts, method, sampled):
    drive = {"times": [0, 1], "actuation": [[0.0] * (contacts - 1), [0.5] * (contacts - 1)]}
    assert simulate(scene(contacts, drive=drive), rate=1.0, method=method).visited_margin_sampled is sampled


@pytest.mark.parametrize("rate", [1.0, 0.5])
def test_a_contact_that_goes_and_comes_back_within_a_tick_went_nowhere(rate):
    drive = {"times": [0, 0.3, 1.0], "period": 1, "actuation": [0.1, 0.7, 0.1]}
    run = simulate(scene(2, 1.0, [0.1, 9.0], [0.1, 9.0], drive), duration=6.0, rate=rate)
    assert np.ptp(run.displacement[1:, 0]) < 1e-15
    assert not run.contact_state[2:].any()


def test_without_a_period_the_waypoints_are_reported():
    run = simulate(scene(2, drive=ONCE, backward=2.0))
    assert run.waypoint_time.tolist() == [0.0, 0.25, 1.0]
    assert run.per_period.size == 0
    assert run.time[-1] == 1.0
    longer = simulate(scene(2, drive=ONCE, backward=2.0), duration=2.0)
    assert longer.waypoint_time.tolist() == [0.0, 0.25, 1.0]
    assert (longer.displacement[100:] == longer.displacement[100]).all()


def test_without_a_drive_nothing_happens():
    run = simulate(scene(3), duration=1.0)
    assert run.time.size == 101
    assert not run.displacement.any()
    assert run.summary()["time"] == [0.0, 1.0]
    assert supporting_force(run.scene) == 3.0  # 1 N on each contact


@pytest.mark.parametrize("rate", [0.3, 3.0, 7.7, 1234.5])
def test_waypoints_are_met_on_a_tick_or_not(rate):
    one, other = (simulate(scene(2, drive=ONCE, backward=2.0), rate=r) for r in (rate, 100.0))
    assert one.waypoint_displacement == pytest.approx(other.waypoint_displacement, abs=1e-14)


def test_shapes_and_read_only_arrays():
    run = simulate(load_scene("three_contacts_one_way"), duration=0.5, rate=10.0)
    assert run.time == pytest.approx(np.arange(6) / 10)
    assert run.displacement.shape == run.contact_state.shape == (6, 3)
    assert run.tension.shape == (6, 2)
    assert run.net_translation == pytest.approx(run.displacement.mean(axis=1))
    for array in (run.time, run.displacement, run.tension, run.contact_state, run.per_period):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_a_tick_that_is_cut_short():
    run = simulate(load_scene("two_anchor_a"), duration=0.55, rate=10.0)
    assert run.ticks == 6
    assert run.time[-1] == 0.55


def test_a_tick_of_many_periods():
    run = simulate(load_scene("two_anchor_a"), duration=3000.0, rate=0.001)
    assert run.ticks == 3
    assert run.per_period.size == 3000
    assert run.per_period == pytest.approx(2.0, abs=1e-12)


def test_ticks_a_billionth_of_a_period():
    data = load_scene("two_anchor_a").document()
    data["drive"]["period"] = 1000.0
    slow = type(load_scene("two_anchor_a")).model_validate(data)
    run = simulate(slow, duration=2e-3, rate=1e6)  # 2000 ticks of 1e-9 periods
    assert run.net_translation[-1] == run.net_translation[0]
    assert run.energy.relative_residual < 1e-9


def test_progress_is_told():
    parts: list[float] = []
    simulate(load_scene("two_anchor_a"), duration=100.0, progress=parts.append)
    assert parts == sorted(parts)
    assert parts[-1] == 1.0
    assert len(parts) > 2


@pytest.mark.parametrize(
    "options",
    [
        {"duration": -1.0},
        {"duration": float("nan")},
        {"rate": 0.0},
        {"rate": float("inf")},
        {"rate": "5"},
        {"rate": 1e9, "duration": 1e9},
        {"rate": 1e-9, "duration": 8e9},
        {"method": "rk4"},
    ],
)
def test_out_of_range_is_refused(options):
    with pytest.raises(CommandError):
        simulate(load_scene("two_anchor_a"), **options)


def test_contact_states_are_those_of_the_tick():
    run = simulate(load_scene("two_anchor_a"), duration=1.0)
    moved = np.sign(np.diff(run.displacement, axis=0))
    assert (run.contact_state[1:] == moved).all()
    assert not run.contact_state[0].any()


def test_what_is_shown_of_a_run_a_step_and_many_runs():
    run = simulate(load_scene("two_anchor_a"), duration=3.0)
    assert repr(run) == "Trajectory(two_anchor_a, exact, 300 ticks at 100 Hz, net_translation 0.5 -> 6.5 m)"
    step = Crawler(scene(2, 1.0, 1.0, 2.0)).advance([3.0])  # 2 m of the stroke move contact 0 back or contact 1 forward
    assert repr(step).startswith("Step(events=2, work=2.5, dissipation=2.0, velocity=array([0., 2.]), unique=True, ")
    runs = simulate_many([load_scene("two_anchor_a")] * 2)
    assert repr(runs).startswith("ManyRuns(2 runs: 2 done, 0 invalid, ")


def test_no_times_no_samples():
    drive = load_scene("two_anchor_a").drive
    assert drive.sample(np.zeros(0, np.int64)).shape == (0, 5)


@pytest.mark.parametrize("name", ["two_anchor_a", "three_springs", "planar_three_points"])
def test_a_crawler_that_is_placed_goes_on_like_the_one_that_went_there(name):
    crawler = Crawler(load_scene(name))
    first, second = crawler.scene.drive.targets[1:3]
    crawler.follow(first[None])
    placed = Crawler(crawler.scene).placed(crawler.displacement, first)
    assert crawler != "a crawler"
    for each in (crawler, placed):
        each.follow(second[None])
    assert placed.displacement == pytest.approx(crawler.displacement, abs=1e-4)
    assert placed.tension == pytest.approx(crawler.tension, abs=1e-4)
