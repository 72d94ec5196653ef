"""Identification of what laboratories measure: random robots under imperfect sensors, and robots that fail."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from crawler_lab import Identification, Measurements, Prior, Sensor, identify
from crawler_model import CrawlerError, Scene, simulate

from .laboratory import KEYS, build_robot, guess_robot, identify_robot, measure_robot
from .mistakes import identify_mistake

LAG = "pixels, tracker, lag"
PATIENT = 120.0
"""Time limit of a fit [s], which ends before: on a busy machine the default one may end it too early."""
USUAL = ("one command negated", "positions in cm", "29.97 frames read as 30")
EXPLAINED = (*USUAL, "two columns exchanged", "clock 0.7 s late", "commands end early")
RARE = ("linear drift", "1 % outliers", "scale", "dropped frames", "unequal noise")
KINDS = ("white", "pixels", "tracker, AR(0.9)", LAG, "linear drift", "1 % outliers", "scale", "dropped frames")


@pytest.mark.parametrize(
    "kind", [*KINDS[:4], "nine digits", *(pytest.param(kind, marks=pytest.mark.slow) for kind in RARE)]
)
def test_intervals_contain_the_truth_whatever_the_camera_does(kind: str) -> None:
    rows = [identify_robot(seed, kind, PATIENT) for seed in (1, 3, 5)]
    assert all(row["fits"] for row in rows)
    intervals, inside = sum(row["intervals"] for row in rows), sum(row["inside"] for row in rows)
    assert intervals >= 12
    assert inside >= 0.8 * intervals
    assert np.median([width for row in rows for width in row["half_widths"]]) < 0.08


@pytest.mark.parametrize("seed", [17, 61, 79])
def test_a_contact_that_never_slides_in_a_wrong_minimum_slides_in_the_right_one(seed: int) -> None:
    row = identify_robot(seed, "white", PATIENT)
    assert row["fits"]
    assert row["ratio"] < 1.1
    assert row["inside"] >= row["intervals"] - 1


def test_a_wrong_minimum_that_fits_is_left() -> None:
    """In the wrong one, 0.4 mm of residuals pass for noise in 50 rows, and a contact slides too little."""
    document, measured = measure_robot(4, "white")
    few = slice(0, 200, 4)
    short = dataclasses.replace(measured, time=measured.time[few], values=measured.values[few])
    found = identify(guess_robot(document, 4), [short], KEYS, hold_out=0.0, seconds=PATIENT)
    assert found.model_fits, found.where
    assert found.residual < 2.5e-4
    low, _ = found["friction.forward[1]"].interval
    assert low is None or low < document["friction"]["forward"][1]


def sensors(found: Identification) -> dict[str, float]:
    return {one.name: one.value for one in found.sensors}


def test_the_sensor_is_found_with_the_robot() -> None:
    document, measured = measure_robot(1, "white")
    late = measured.time + 0.031
    drifted = measured.values * 1.003 + np.outer(np.linspace(-0.5, 0.5, late.size), [1e-3, -2e-3, 0.0, 1e-3])
    object.__setattr__(measured, "time", late)
    object.__setattr__(measured, "values", drifted)
    found = identify(guess_robot(document, 1), [measured], KEYS, hold_out=0.0)
    assert found.model_fits, found.where
    by_name = {one.name: one for one in found.sensors}
    for name, true in (("lag", 0.031), ("scale", 0.003), ("drift of contact_1", -2e-3), ("drift of contact_2", 0.0)):
        one = by_name[name]
        assert one.verdict == "identified"
        half = one.interval[1] - one.value
        assert abs(one.value - true) < 2.0 * half, name
    assert by_name["gain"].verdict == "held"
    assert found.drifts[0] == pytest.approx([1e-3, -2e-3, 0.0, 1e-3], abs=3e-4)


def test_the_gain_of_the_actuators_widens_every_friction() -> None:
    """A gain that is known only to 2 %, with a scale that is held: friction is known to 2 %, too."""
    document, measured = measure_robot(1, "white")
    guess = guess_robot(document, 1)
    fixed = identify(guess, [measured], KEYS, hold_out=0.0)
    free = identify(guess, [measured], KEYS, hold_out=0.0, sensor=Sensor(gain=Prior(0.0, 0.02), scale=Prior(0.0, 0.02)))
    gain = next(one for one in free.sensors if one.name == "gain")
    assert gain.verdict == "prior"
    widths = []
    for p, q in zip(fixed.parameters, free.parameters, strict=True):
        if p.verdict == q.verdict == "identified":
            widths.append(0.5 * np.log(q.interval[1] / q.interval[0]))
            assert widths[-1] > 0.5 * np.log(p.interval[1] / p.interval[0])
    assert widths
    assert min(widths) > 1.96 * 0.02 / np.sqrt(2.0)  # half of it is scale, half is gain


def test_a_stuck_link_is_told_with_contact_time_and_cause() -> None:
    found, first = identify_mistake(0, "a link sticks from some time on")
    assert first
    assert not found.model_fits
    worst = max(found.misfits, key=lambda one: one.ratio)
    assert worst.ratio > 10.0
    assert found.where is not None
    assert worst.channel in found.where
    assert "link_1 does not move from 6 s on" in found.explanations[0].what


def test_a_stiffer_link_explains_a_misfit_and_moves_values() -> None:
    found, first = identify_mistake(2, "a link 30 % stiffer")
    assert not found.model_fits
    assert first
    assert found.explanations[0].amount == pytest.approx(1.3, rel=0.03)
    moved = {name for one in found.explanations for name in one.moved}
    assert moved
    for name in moved:
        first = next(one for one in found.explanations if name in one.moved)
        assert f"if the misfit is {first.what}" in found[name].why


def test_a_number_of_the_sensor_far_from_its_prior_is_told_and_not_identified() -> None:
    document, measured = measure_robot(4, "white")
    late = dataclasses.replace(measured, time=measured.time + 0.18)
    found = identify(guess_robot(document, 4), [late], KEYS, hold_out=0.0)
    lag = next(one for one in found.sensors if one.name == "lag")
    assert lag.verdict == "doubtful"
    assert lag.value == pytest.approx(0.18, abs=0.01)
    (line,) = found.warnings
    assert "lag of 180 ms is 3.6 deviations from what was known, 0 ms +- 50 ms" in line


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[] if kind in USUAL else pytest.mark.slow) for kind in EXPLAINED]
)
def test_a_mistake_of_a_person_is_the_first_explanation(kind: str) -> None:
    found, first = identify_mistake(1, kind)
    assert not found.model_fits
    assert {p.verdict for p in found.parameters} <= {"doubtful", "not excited"}
    assert first
    assert found.explanations[0].explained > 0.9
    assert len(found.explanations) <= 3
    assert not any("nothing that was tried" in line for line in found.warnings)


def test_what_no_suspect_explains_is_told() -> None:
    document, measured = measure_robot(1, "white")
    wrong = measured.values + 5e-3 * np.sin(3.0 * np.pi * measured.time)[:, None] * np.array([1.0, -1.0, 1.0, -1.0])
    measured = dataclasses.replace(measured, values=wrong)
    found = identify(guess_robot(document, 1), [measured], KEYS, hold_out=0.0, seconds=1.0)
    assert not found.model_fits
    assert "nothing that was tried explains the misfit" in found.warnings


def test_held_out_rows_are_scored() -> None:
    document, measured = measure_robot(1, "tracker, AR(0.9)")
    found = identify(guess_robot(document, 1), [measured], KEYS, hold_out=0.3)
    assert found.score is not None
    assert found.score.coverage > 0.85
    assert abs(found.score.gain_error) < 0.05
    assert found.held_out < 2e-3


@pytest.mark.parametrize(
    ("number", "prior", "message"),
    [
        ("scale", (0.4, 0.2), "scale: 0.4 +- 0.2; it must be at most 0.5"),
        ("lag", (0.0, -1.0), "lag: 0 +- -1; the mean must be finite and the uncertainty 0 or more"),
        ("lag", (float("nan"), 0.0), "lag: nan"),
        ("drift", (1e-3, 0.0), "drift: 0.001 m; it may be unknown or 0"),
    ],
)
def test_impossible_sensors_are_refused(number: str, prior: tuple[float, float], message: str) -> None:
    with pytest.raises(CrawlerError, match="sensor: ") as caught:
        Sensor(**{number: Prior(*prior)})
    assert message in str(caught.value)


def test_recordings_with_and_without_commands_are_explained_together() -> None:
    document, times, rows = build_robot(2)
    drive = {"times": times.tolist(), "actuation": rows.tolist()}
    first, *others = document["body"]["links"]["stiffness"]
    stiffer = {"body": document["body"] | {"links": {"stiffness": [1.3 * first, *others]}}, "drive": drive}
    scene = Scene.model_validate(document | stiffer)
    run = simulate(scene, float(times[-1]), 50.0)
    values = scene.body.position + run.displacement
    contacts = tuple(f"contact_{i}" for i in range(values.shape[1]))
    links = tuple(f"link_{j}" for j in range(rows.shape[1]))
    own = Measurements("own drive", run.time, contacts, values)
    played = Measurements("played", run.time, contacts, values, links, rows, times)
    found = identify(Scene.model_validate(document | {"drive": drive}), [played, own], KEYS, starts=1, seconds=0.0)
    assert not found.model_fits
    assert found.explanations[0].what.startswith("stiffness of link_")
