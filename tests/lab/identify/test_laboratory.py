"""Identification of what laboratories measure: random robots under imperfect sensors, and robots that fail."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from crawler_lab import Identification, Measurements, Prior, Sensor, identify
from crawler_model import CrawlerError, Scene, simulate

from .laboratory import KEYS, build_robot, guess_robot, identify_robot, measure_robot

LAG = "pixels, tracker, lag"
PATIENT = 120.0
"""Time limit of a fit [s], which ends before: on a busy machine the default one may end it too early."""
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


def spoil(seed: int, kind: str) -> Identification:
    """Identify a robot whose second link sticks after two thirds, or whose first one is stiffer than stated."""
    document, times, rows = build_robot(seed)
    true, real = rows.copy(), dict(document)
    if kind == "stuck":
        last = times.size * 2 // 3
        true[last:, 1] = true[last, 1]
    else:
        first, *others = document["body"]["links"]["stiffness"]
        real["body"] = document["body"] | {"links": {"stiffness": [1.3 * first, *others]}}
    scene = Scene.model_validate(real | {"drive": {"times": times.tolist(), "actuation": true.tolist()}})
    run = simulate(scene, float(times[-1]), 50.0)
    values = scene.body.position + run.displacement
    values = values + 2e-4 * np.random.default_rng(seed).normal(size=values.shape)
    contacts, links = (
        tuple(f"{what}_{i}" for i in range(n))
        for what, n in zip(("contact", "link"), (values.shape[1], rows.shape[1]), strict=True)
    )
    measured = Measurements(kind, run.time, contacts, values, links, rows, times)
    return identify(guess_robot(document, seed), [measured], KEYS, hold_out=0.0, seconds=1.0)


def test_a_stuck_link_is_told_with_contact_time_and_cause() -> None:
    found = spoil(0, "stuck")
    assert not found.model_fits
    worst = max(found.misfits, key=lambda one: one.ratio)
    assert worst.ratio > 20.0
    assert worst.since == pytest.approx(10.7, abs=0.7)
    assert found.where is not None
    assert worst.channel in found.where
    assert found.explanations[0].what.startswith("stroke of link_1 from 10.7 s on: -")


def test_a_stiffer_link_explains_a_misfit_and_moves_values() -> None:
    found = spoil(2, "stiffer")
    assert not found.model_fits
    first = found.explanations[0]
    assert first.what.startswith("stiffness of link_0: +")
    assert 0.1 < first.amount < 0.4
    assert first.moved
    for name in first.moved:
        assert "if the misfit is stiffness of link_0" in found[name].why


def test_a_number_of_the_sensor_far_from_its_prior_is_told_and_not_identified() -> None:
    document, measured = measure_robot(4, "white")
    late = dataclasses.replace(measured, time=measured.time + 0.18)
    found = identify(guess_robot(document, 4), [late], KEYS, hold_out=0.0)
    lag = next(one for one in found.sensors if one.name == "lag")
    assert lag.verdict == "doubtful"
    assert lag.value == pytest.approx(0.18, abs=0.01)
    (line,) = found.warnings
    assert "lag of 180 ms is 3.6 deviations from what was known, 0 ms +- 50 ms" in line


def mistake(kind: str, measured: Measurements) -> Measurements:
    """A record in which a person made a mistake."""
    commands, time, sent = measured.commands.copy(), measured.time, measured.command_time
    if kind == "negated":
        commands[:, 0] *= -1.0
        return dataclasses.replace(measured, commands=commands)
    if kind == "exchanged":
        return dataclasses.replace(measured, values=measured.values[:, [1, 0, *range(2, len(measured.channels))]])
    if kind == "centimetres":
        return dataclasses.replace(measured, values=100.0 * measured.values)
    if kind == "late":
        return dataclasses.replace(measured, time=time + 1.0)
    if kind == "29.97 read as 30":
        return dataclasses.replace(measured, time=time * 30.0 / 29.97)
    end = 2 * sent.size // 3
    return dataclasses.replace(measured, commands=commands[:end], command_time=sent[:end])


@pytest.mark.parametrize(
    ("kind", "first"),
    [
        ("negated", "command/link_0 is negated"),
        ("centimetres", "positions are 0.01 times as large"),
        ("29.97 read as 30", r"the clock of the positions runs 1\.00(09|1).* times as fast"),
        pytest.param("exchanged", "contact_0 and contact_1 are exchanged", marks=pytest.mark.slow),
        pytest.param("late", r"the clock of the positions is (0\.9|1).* s late", marks=pytest.mark.slow),
        pytest.param("ends", "the commands end early; rows after them do not count", marks=pytest.mark.slow),
    ],
)
def test_a_mistake_of_a_person_is_the_first_explanation(kind: str, first: str) -> None:
    document, measured = measure_robot(1, "white")
    found = identify(guess_robot(document, 1), [mistake(kind, measured)], KEYS, hold_out=0.0, seconds=1.0)
    assert not found.model_fits
    assert {p.verdict for p in found.parameters} <= {"doubtful", "not excited", "bound"}
    assert re.match(first, found.explanations[0].what)
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
