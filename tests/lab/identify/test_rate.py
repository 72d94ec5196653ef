"""Whether a robot depends on the rate: the same drive at two speeds, in one recording or in two."""

from __future__ import annotations

import dataclasses
import io
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from crawler_lab import Identification, Measurements, identify
from crawler_lab.identify.sensor.sensor import PERFECT, Sensor
from crawler_lab.verbs.identify.report import print_identification
from crawler_model import Scene

from .synthetic import RATE, chain, measure

NOISE = 2e-4
GAIT = 0.1 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def gait(*periods: float, first: int = 0) -> tuple[list[float], np.ndarray]:
    """Times and rows of a gait whose cycles last so long, from one of its rows on."""
    times = np.concatenate(([0.0], np.cumsum(np.repeat(periods, len(GAIT)) / len(GAIT))))
    rows = np.roll(GAIT, -first, axis=0)
    return times.tolist(), np.vstack((*[rows] * len(periods), rows[:1]))


def follow_viscous(document: dict[str, Any], times: list[float], rows: np.ndarray, damping: float) -> Measurements:
    """Record a chain whose contacts have, besides friction, a resistance of `damping` in N s/m."""
    body, friction = document["body"], document["friction"]
    k, forward, backward = (
        np.array(v) for v in (body["links"]["stiffness"], friction["forward"], friction["backward"])
    )
    steps = 40
    clock = np.arange(round(times[-1] * RATE) + 1) / RATE
    fine = np.linspace(0.0, clock[-1], steps * (clock.size - 1) + 1)
    lengths = np.array([np.interp(fine, times, column) for column in rows.T]).T
    x, path = np.zeros(len(forward)), []
    for row in lengths:
        path.append(x)
        tension = k * (np.diff(x) - row)
        force = np.append(tension, 0.0) - np.append(0.0, tension)
        x = x + (force - np.clip(force, -backward, forward)) / damping / RATE / steps
    position = np.array(body["contacts"]) + np.array(path)[::steps]
    position += NOISE * np.random.default_rng(len(times)).normal(size=position.shape)
    names = tuple(f"contact_{i}" for i in range(position.shape[1]))
    return Measurements("viscous", clock, names, position, ("link_0", "link_1"), rows, np.array(times))


def fit(*recordings: Measurements, sensor: Sensor | None = PERFECT) -> Identification:
    """Fit friction forwards to recordings of the chain of three contacts."""
    scene = Scene.model_validate(chain(3))
    return identify(scene, list(recordings), ["friction.forward"], sensor=sensor, seconds=0.0, hold_out=0.0)


@pytest.mark.parametrize(("first", "cycles"), [(0, (3, 5)), (3, (3, 4))])
def test_a_robot_without_viscosity_is_rate_independent_in_two_recordings(first, cycles):
    slow = measure(chain(3), *gait(*[4.0] * 4), noise=NOISE)
    fast = measure(chain(3), *gait(*[1.0] * 6, first=first), noise=NOISE, seed=1)
    found = fit(slow, fast)
    assert not found.rate.depends
    assert found.rate.durations == pytest.approx((4.0, 1.0))
    assert found.rate.cycles == cycles  # the first of each depends on the start
    assert [change.channel for change in found.rate.changes] == ["contact_0", "contact_1", "contact_2"]
    assert max(change.ratio for change in found.rate.changes) < 0.5


@pytest.fixture(scope="module")
def viscous() -> Identification:
    return fit(*(follow_viscous(chain(3), *gait(*[pace] * 4), damping=1.0) for pace in (4.0, 1.0)))


def test_viscosity_shows_as_a_difference_of_the_size_that_it_has(viscous):
    assert viscous.rate.depends
    cycles = [  # the last three, at the same places of the drive, each less its mean
        one.values[::pace][-3 * int(RATE) :].reshape(3, int(RATE), -1)
        for one, pace in zip(viscous.recordings, (4, 1), strict=True)
    ]
    slow, fast = (np.mean(one - one.mean(axis=1, keepdims=True), axis=0) for one in cycles)
    sizes = np.sqrt(np.mean((fast - slow) ** 2, axis=0))
    assert [one.difference for one in viscous.rate.changes] == pytest.approx(
        sizes, rel=0.1
    )  # of means over a sixteenth of a cycle


@pytest.mark.parametrize("lag", [0.02, 0.1])
def test_actuators_that_lag_show_in_one_recording_of_two_speeds(lag):
    times, rows = gait(4.0, 4.0, 4.0, 1.0, 1.0, 1.0, 1.0)
    fine = np.arange(0.0, times[-1] + 1e-9, 0.02)
    commands = np.array([np.interp(fine, times, column) for column in rows.T]).T
    reached = commands.copy()
    for i in range(1, len(fine)):  # a lag of 0.02 s, one row, is none
        reached[i] = reached[i - 1] + 0.02 / lag * (commands[i] - reached[i - 1])
    record = measure(chain(3), fine.tolist(), reached, noise=NOISE)
    assert fit(dataclasses.replace(record, commands=commands)).rate.depends == (lag > 0.02)


def test_a_camera_that_lags_is_no_dependence_on_the_rate():
    records = [measure(chain(3), *gait(*[pace] * 4), noise=NOISE, seed=int(8 * pace)) for pace in (4.0, 1.0)]
    found = fit(*(dataclasses.replace(one, time=one.time + 0.03) for one in records), sensor=None)
    assert not found.rate.depends


def test_one_speed_tells_nothing():
    records = [measure(chain(3), *gait(*[pace] * 2)) for pace in (2.0, 1.1)]
    assert fit(*records).rate is None
    assert fit(records[0]).summary()["rate"] is None


def test_recordings_of_the_drive_of_the_scene_tell_nothing():
    times, rows = gait(2.0, 2.0)
    driven = Scene.model_validate(chain(3) | {"drive": {"times": times, "actuation": rows.tolist()}})
    record = dataclasses.replace(measure(chain(3), times, rows), command_names=(), commands=np.zeros((0, 0)))
    record = dataclasses.replace(record, command_time=np.zeros(0))
    assert identify(driven, [record], ["friction.forward"], seconds=0.0).rate is None


def test_the_report_names_the_channel_and_the_size(viscous):
    text = io.StringIO()
    print_identification(viscous, Console(file=text, width=400))
    line = next(one for one in text.getvalue().splitlines() if one.startswith("rate: "))
    worst = max(viscous.rate.changes, key=lambda one: one.ratio)
    assert "depends on the rate: from cycles of 4 s to cycles of 1 s" in line
    assert f"{worst.channel} changes by {worst.difference:.2g} m" in line
    plain = viscous.summary()["rate"]
    assert plain["verdict"] == "depends on the rate"
    assert plain["channels"][2]["ratio"] == viscous.rate.changes[2].ratio
