"""Records that begin in the middle of life: nothing tells the forces of the springs at the start."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from crawler_lab import Measurements, Sensor, identify, predict
from crawler_lab.identify.fit.balance import Balance, see
from crawler_lab.identify.fit.fit import fit_from
from crawler_lab.identify.fit.problem import Problem
from crawler_lab.identify.fit.space import build_space
from crawler_lab.identify.judge.bounds import release
from crawler_lab.identify.measurements import check_measurements
from crawler_lab.identify.replica.replica import Replica
from crawler_lab.identify.replica.start import begin_recordings
from crawler_lab.identify.sensor.sensor import PERFECT
from crawler_lab.sweep.keys import expand_keys
from crawler_model import Scene, simulate

from .laboratory import KEYS, count_inside, cut_robot, guess_robot
from .synthetic import chain, measure, scaled, walk


def robot() -> dict:
    """A chain each contact of which slides both ways."""
    return chain(3, friction={"forward": [0.2, 0.4, 0.3], "backward": [0.35, 0.25, 0.4]})


def cut(document: dict, seconds: float = 14.0, begin: float = 2.0, noise: float = 0.0) -> Measurements:
    """The record of a chain that walked before, without a start in its document."""
    times, rows = walk(len(document["body"]["contacts"]) - 1, seconds, 3)
    whole = measure(document, times, rows, noise=noise)
    kept, sent = whole.time >= begin - 1e-9, whole.command_time >= begin - 1e-9
    document.pop("start", None)
    return Measurements(
        "cut",
        whole.time[kept] - begin,
        whole.channels,
        whole.values[kept],
        whole.command_names,
        whole.commands[sent],
        whole.command_time[sent] - begin,
    )


def found_sums(measured: Measurements, document: dict):
    """Identify all frictions from a first guess that is wrong."""
    guess = scaled(document, {"friction.forward": 1.2, "friction.backward": 0.9})
    return guess, identify(guess, [measured], ["friction.forward", "friction.backward"], hold_out=0.0)


def check_robots(seeds: range) -> None:
    inside = count = sums = 0
    for seed in seeds:
        document, measured = cut_robot(seed)
        found = identify(guess_robot(document, seed), [measured], KEYS, hold_out=0.0)
        assert found.model_fits
        assert not any(p.verdict == "identified" for p in found.parameters)
        right, all_of_them = count_inside(document, found)
        inside, count = inside + right, count + all_of_them
        sums += sum(p.verdict == "sum" for p in found.parameters)
    assert sums >= 4 * len(seeds)
    assert inside >= 0.85 * count


def test_robots_that_walked_before_have_sums_that_contain_the_truth() -> None:
    check_robots(range(2, 5))


@pytest.mark.slow
def test_twelve_robots_that_walked_before_have_sums_that_contain_the_truth() -> None:
    check_robots(range(12))


def test_sums_are_exact_and_a_line_tells_what_would_add() -> None:
    document = robot()
    measured = cut(document)
    _, found = found_sums(measured, document)
    for i, forward in enumerate(document["friction"]["forward"]):
        p = found[f"friction.forward[{i}]"]
        assert p.verdict == "sum"
        assert p.partners == (f"friction.backward[{i}]",)
        assert p.value == pytest.approx(forward + document["friction"]["backward"][i], rel=1e-6)
    (line,) = found.warnings
    assert "of 6 frictions only sums are determined" in line
    assert "a record that begins at rest with slack springs would determine each friction" in line
    assert "relaxed" not in line
    played = simulate(found.playback(), float(measured.time[-1]), 50.0)
    moved = measured.values - measured.values[0]
    assert np.abs(played.displacement - played.displacement[0] - moved).max() < 1e-6


@pytest.mark.parametrize("told", [False, True])
def test_a_scene_that_its_found_friction_does_not_hold_starts_relaxed(told: bool) -> None:
    """The search ended in an error, without a result, where the scene's own drive begins beyond the friction found."""
    true = [0.2, 0.3, 0.25]
    document = robot() | {"friction": {"isotropic": true}}
    times, rows = walk(2, 14.0, 3)
    measured = measure(document, times, rows) if told else cut(document)
    document["drive"] = {"times": [0.0, 1.0], "actuation": [[0.22 / 20.0, 0.22 / 23.0]] * 2}
    document["start"] = {"displacement": [0.0] * 3} if told else None
    guess = scaled(document, {"friction.isotropic": 1.2})
    found = identify(guess, [measured], ["friction.isotropic"], hold_out=0.0)
    assert [p.value for p in found.parameters] == pytest.approx(true, rel=1e-6)
    (line,) = found.warnings
    assert "do not hold the springs of measured at the first waypoint of its own drive" in line
    assert found.scene.parts.start == "relaxed"
    assert abs(predict(guess, found.posterior).gain.value) < 1e-12
    played = simulate(found.playback(), float(measured.time[-1]), 50.0)
    moved = measured.values - measured.values[0]
    assert np.abs(played.displacement - played.displacement[0] - moved).max() < 1e-6


@pytest.mark.parametrize("key", ["friction.forward", "friction.isotropic"])
def test_known_frictions_tell_the_start(key: str) -> None:
    document = robot()
    if key == "friction.isotropic":
        document["friction"] = {"isotropic": [0.2, 0.3, 0.25]}
    measured = cut(document)
    found = identify(scaled(document, {key: 1.2}), [measured], [key], hold_out=0.0)
    true = document["friction"][key.split(".")[1]]
    for p, value in zip(found.parameters, true, strict=True):
        assert p.verdict == "identified"
        assert p.value == pytest.approx(value, rel=1e-6)
    assert not found.warnings


def test_positions_in_the_frame_of_the_scene_tell_the_start() -> None:
    document = robot()
    measured = cut(document, noise=1e-5)
    keys = ["friction.forward", "friction.backward"]
    found = identify(scaled(document, {keys[0]: 1.2}), [measured], keys, offset="frame", sensor=PERFECT, hold_out=0.0)
    assert {p.verdict for p in found.parameters} == {"identified"}
    for p, value in zip(found.parameters, [v for side in document["friction"].values() for v in side], strict=True):
        low, high = p.interval
        assert abs(p.value - value) < high - low < 1e-3 * value


def test_markers_glued_by_hand_widen_what_positions_tell() -> None:
    document = robot()
    measured = cut(document, noise=1e-4)
    glued = dataclasses.replace(measured, values=measured.values + np.array([0.9e-3, -1.1e-3, 0.8e-3]))
    keys = ["friction.forward", "friction.backward"]
    guess = scaled(document, {keys[0]: 1.2})
    found = identify(guess, [glued], keys, offset="frame", hold_out=0.0)
    assert {p.verdict for p in found.parameters} == {"identified"}
    assert count_inside(document, found) == (6, 6)
    wide = found["friction.forward[0]"].interval
    exact = identify(guess, [glued], keys, offset="frame", sensor=PERFECT, hold_out=0.0)
    assert exact.model_fits
    assert count_inside(document, exact)[0] < 3
    narrow = exact["friction.forward[0]"].interval
    assert wide[1] - wide[0] > 10.0 * (narrow[1] - narrow[0])
    assert [one.name for one in found.sensors if one.name.startswith("place")] == [
        f"place of contact_{i}" for i in range(3)
    ]


def test_a_start_that_is_told_is_known() -> None:
    document = robot()
    times, rows = walk(2, 12.0, 3)
    measured = measure(document, times, rows)
    keys = ["friction.forward", "friction.backward"]
    found = identify(scaled(document, {keys[0]: 1.2}), [measured], keys, hold_out=0.0)
    assert {p.verdict for p in found.parameters} == {"identified"}
    assert found.starts == (None,)


@pytest.mark.parametrize("told", [True, False])
def test_slopes_of_the_balance_are_differences_of_its_errors(told: bool) -> None:
    document = robot()
    measured = cut(document, noise=1e-4)
    scene = Scene.model_validate(document | {"start": "relaxed"})
    keys = expand_keys(scene, [*KEYS, "body.links.stiffness[1]"], "identify")
    replica = Replica(scene, check_measurements(scene, measured), keys, unknown_start=not told)
    seen = see(replica, np.ones(replica.measured.time.size, np.bool_))
    assert seen is not None
    balance = Balance([seen], build_space(keys, replica.start_values, None), Sensor())
    first = balance.begin(replica.start_values * 1.1)
    assert first is not None
    at = first + 0.01 * np.random.default_rng(0).normal(size=first.size)
    slopes, errors = balance.slopes(at), balance.errors(at)
    for u, step in enumerate(1e-7 * np.eye(at.size)):
        ahead, behind = balance.errors(at + step), balance.errors(at - step)
        smooth = np.abs(ahead + behind - 2.0 * errors) < 1e-9
        assert smooth.mean() > 0.9
        difference = (ahead - behind) / 2e-7
        assert slopes[smooth, u] == pytest.approx(difference[smooth], abs=1e-5)


def test_a_prediction_from_sums_is_that_of_the_robot() -> None:
    document = robot()
    measured = cut(document)
    guess, found = found_sums(measured, document)
    drive = {"times": [0.0, 0.5, 1.0, 1.5], "period": 2.0}
    drive["actuation"] = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]]
    forecast = predict(guess, json.loads(json.dumps(found.summary())), drive)
    run = simulate(Scene.model_validate(document | {"drive": drive, "start": "relaxed"}), 20.0)
    assert forecast.gain.value == pytest.approx(float(np.diff(per_period(run, 2.0))[-1]), rel=1e-6)


def per_period(run, period: float) -> np.ndarray:
    """Mean displacement at the end of each period."""
    ends = np.searchsorted(run.time, np.arange(1.0, run.time[-1] / period + 0.5) * period - 1e-9)
    return run.displacement[ends].mean(axis=1)


def test_a_friction_is_released_that_only_noise_passes() -> None:
    """At its best place in a long record, noise of 0.2 mm looks like a slide of 0.2 mm."""
    rng = np.random.default_rng(3)
    stiffness, forward = rng.uniform(12.0, 30.0, 2), rng.uniform(0.1, 0.35, 3)
    backward = forward * rng.uniform(1.2, 3.0, 3)
    rng.random()
    stroke = rng.uniform(0.04, 0.09)
    posture, times = rng.uniform(-stroke, stroke, (5, 2)), 0.4 * np.arange(53)
    rows = np.array([posture[k % 5] * (1.0 if (k // 5) % 2 else 0.6) for k in range(times.size)])
    begin = 4.8 + round(rng.uniform(0.0, 0.39), 2)
    friction = {"forward": forward.tolist(), "backward": backward.tolist()}
    body = {"contacts": [0.0, 0.1, 0.2], "links": {"stiffness": stiffness.tolist()}}
    drive = {"times": times.tolist(), "actuation": rows.tolist()}
    robot = {"name": "walked", "body": body, "friction": friction}
    run = simulate(Scene.model_validate(robot | {"start": "relaxed", "drive": drive}), float(times[-1]), 100.0)
    shown = run.time >= begin - 1e-9
    time, x = run.time[shown][::2], run.displacement[shown][::2]
    values = np.array(body["contacts"]) + x + 2e-4 * rng.normal(size=x.shape)
    sent = np.append(begin, times[times > begin + 1e-9])
    commands = np.stack([np.interp(sent, times, column) for column in rows.T], axis=1)
    measured = Measurements(
        "late", time, ("contact_0", "contact_1", "contact_2"), values, ("link_0", "link_1"), commands, sent
    )
    scene = Scene.model_validate(robot)
    checked = check_measurements(scene, measured)
    keys = expand_keys(scene, ["friction.forward", "friction.backward"], "identify")
    begun, unknown = begin_recordings(scene, keys, [checked])
    replica = Replica(begun, checked, keys, "identify", unknown)
    fitted = np.arange(time.size) < 0.8 * time.size
    problem = Problem([replica], [fitted], build_space(keys, replica.start_values, None), "each", Sensor())
    start = problem.unknowns(np.array([0.30982804, 0.24445083, 0.11447617, 0.45019672, 0.37430033, 0.1925688]))
    start[6:] = -0.00027512, 0.000733, 0.0003325, -0.00701479
    held = np.zeros(problem.count, np.bool_)
    fit = fit_from(problem, start, held, tight=True)
    assert fit is not None
    problem.estimate_noise(fit.residuals)
    fit = fit_from(problem, fit.unknowns, held, tight=True)
    assert fit is not None
    slid = replica.motion_at(problem.space.to_values(fit.unknowns[:6]), problem.start(fit.unknowns, 0))
    assert np.diff(x[:, 1]).min() > -1e-9
    assert slid is not None
    assert np.diff(slid[1][:, 1]).clip(max=0.0).sum() < -1e-4
    released = release(problem, problem, fit)
    assert not released.residuals.jacobian[:, 4].any()
    assert fit.cost < released.cost < fit.cost + 12.0
    assert all(released.residuals.jacobian[:, p].any() for p in (0, 1, 2, 5))


PROFILE = {"profile": {"at": [0.0, 0.12, 0.3, 0.45], "friction": [1.1, 0.8, 1.3, 0.7]}}
PATCHES = {"patches": [{"from": 0.15, "to": 0.4, "friction": 0.7}], "walls": [{"at": 0.35, "stops": "forward"}]}


@pytest.mark.parametrize(("ground", "offset"), [(PROFILE, "none"), (PATCHES, "none"), (PATCHES, "each")])
def test_a_robot_that_walked_over_ground_that_differs_is_found(ground: dict, offset: str) -> None:
    """All values were doubtful: neither tensions nor the place at the start were unknowns of the fit."""
    document = chain(3, friction={"forward": 0.25, "backward": 0.4}, ground=ground)
    document["body"]["links"] = {"stiffness": 20.0}
    measured = cut(document, begin=3.0, noise=1e-4)
    guess = Scene.model_validate(document | {"friction": {"forward": 0.32, "backward": 0.34}})
    found = identify(guess, [measured], ["friction.forward", "friction.backward"], offset=offset)
    assert found.model_fits, found.warnings
    for p, true in zip(found.parameters, (0.25, 0.4), strict=True):
        assert p.verdict == "identified"
        assert p.value == pytest.approx(true, rel=5e-3)
    played = simulate(found.playback(), float(measured.time[-1]), 50.0)
    errors = played.position - measured.values
    assert np.abs(errors - (0.0 if offset == "none" else errors[0])).max() < 1e-3
