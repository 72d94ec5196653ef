"""Robots that fail, or that have what their model lacks: the fault is found with its numbers."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pytest

from crawler_lab import Measurements, Sensor, identify
from crawler_lab.identify.fit.fit import Fit, fit_from
from crawler_lab.identify.fit.problem import Problem
from crawler_lab.identify.fit.space import build_space
from crawler_lab.identify.judge.faults import list_faults
from crawler_lab.identify.judge.seen import Seen, see_motion
from crawler_lab.identify.judge.trials import FaultProblem
from crawler_lab.identify.replica.replica import Replica
from crawler_lab.identify.replica.stepped import Dynamics, SteppedReplica, follow_dynamics
from crawler_lab.sweep.keys import expand_keys
from crawler_model import Scene

from .dynamics import step
from .laboratory import KEYS, build_robot, measure_robot
from .mistakes import KINDS, identify_mistake, spoil

PERSONS = 8
"""Mistakes of persons, the first kinds, have tests of their own."""


def build(scene: Scene, measured: Measurements) -> tuple[Replica, Problem, Fit]:
    keys = expand_keys(scene, KEYS, "identify")
    replica = Replica(scene, measured, keys)
    rows = np.ones(measured.time.size, np.bool_)
    problem = Problem([replica], [rows], build_space(keys, replica.start_values, None), "each", Sensor())
    fit = fit_from(problem, problem.unknowns(problem.space.origin), np.zeros(problem.count, np.bool_), tight=False)
    assert fit is not None
    return replica, problem, fit


def fit_fault(kind: str, what: str) -> tuple[float, float, np.ndarray]:
    """Fit a suspect: the parts that it explains of the sums of squares, and that noise leaves, and its numbers."""
    document, measured, _ = spoil(0, kind)
    scene = Scene.model_validate(document)
    _, problem, fit = build(scene, measured)
    seen = see_motion(problem, fit, 0, np.arange(0, measured.time.size, 3))
    assert seen is not None
    trial = FaultProblem(problem, [Replica(scene, seen.measured, problem.space.names)], [seen])
    fault = next(one for one in list_faults([seen], 6.0, True) if what in one.what(*one.guesses[0]))
    trial.suspect(fault, [seen])
    held = np.zeros(trial.count, np.bool_)
    ends = [fit_from(trial, trial.begin(fit.unknowns, guess), held, tight=False) for guess in fault.guesses]
    best = min((one for one in ends if one is not None), key=lambda one: one.cost)
    noise = 2e-4 / np.array([channel.noise.size for channel in trial.channels[0]])
    return fit.cost / 3.0, best.cost / (noise**2).sum() / seen.measured.time.size, trial.numbers(best.unknowns)


def test_friction_that_wears_is_found_with_its_loss():
    before, left, numbers = fit_fault("friction wears by 40 %", "during the recording")
    assert left < 1.2 < before
    assert numbers[0] == pytest.approx(-0.4, abs=0.01)


def test_a_contact_that_sticks_is_found_with_its_time():
    before, left, numbers = fit_fault("a contact sticks from some time on", "contact_0 sticks")
    assert left < 1.2 < before
    assert numbers[0] == pytest.approx(11.25, abs=0.1)


def test_a_lens_is_found_with_its_size():
    before, left, numbers = fit_fault("a lens, 5 mm", "lens")
    assert left < 1.2 < before
    assert numbers[0] == pytest.approx(5e-3, rel=0.1)


def test_a_light_body_that_is_stepped_follows_the_exact_path():
    document, measured = measure_robot(0, "white")
    scene = Scene.model_validate(document)
    replica, problem, _ = build(scene, measured)
    exact = replica.predict(problem.space.origin)
    stepped = SteppedReplica.of(replica, Dynamics(1e-4, 0.01), True).predict(problem.space.origin)
    assert exact is not None
    assert stepped is not None
    assert np.abs(stepped.values - exact.values).max() < 1e-3


@pytest.mark.slow
def test_explanations_do_not_depend_on_how_fast_the_machine_is(monkeypatch):
    kind = "two columns exchanged"
    usual, first = identify_mistake(1, kind)
    assert first
    ticks = itertools.count()
    for name in ("monotonic", "perf_counter", "process_time", "thread_time"):
        monkeypatch.setattr(time, name, lambda: 1e3 * next(ticks))
    assert identify_mistake(1, kind)[0].summary() == usual.summary()


def test_viscosity_without_mass_and_actuators_that_follow_late_have_their_closed_forms():
    """Two contacts, of which the rear one holds: the front one follows a ramp behind its friction."""
    stiffness, friction, speed, late = 20.0, 0.2, 0.1, 0.05
    time = np.arange(0.0, 1.0001, 2e-3)
    path, bounds = np.zeros((time.size, 2)), np.tile([friction, friction, 9.0, 9.0], (time.size, 1))
    bounds[:, 0] = 9.0
    spring = stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
    force = stiffness * speed * time[:, None] * np.array([-1.0, 1.0])
    follow_dynamics(path, *np.zeros((2, 2)), 0.0, spring, stiffness * late * np.eye(2), force, bounds)
    after = np.maximum(time - friction / stiffness / speed, 0.0)
    assert path[:, 0] == pytest.approx(0.0)
    assert path[:, 1] == pytest.approx(speed * (after - late * (1.0 - np.exp(-after / late))), abs=1e-6)

    ends = time[[0, -1]]
    measured = Measurements("ramp", ends, (), np.zeros((2, 0)), ("link_0",), speed * ends[:, None], ends)
    seen = Seen(measured, np.zeros(2), *np.zeros((2, 2, 2)), np.zeros((2, 1)), np.zeros(1, int))
    fault = next(one for one in list_faults([seen], None, False) if "time constant" in one.what(*one.guesses[0]))
    changed = fault.change(seen, late)
    at = changed.command_time
    assert changed.commands[:, 0] == pytest.approx(speed * (at - late * (1.0 - np.exp(-at / late))), abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", [Dynamics(0.06, 0.1), Dynamics(2e-3, 0.1, viscosity=0.3)])
def test_masses_and_viscosity_follow_another_stepper(dynamics):
    document, times, rows = build_robot(0)
    document["body"]["links"]["stiffness"] = [20.0, 20.0]
    damping = dynamics.drag / (2.0 * np.sqrt(10.0 * dynamics.mass))
    time, x = step(document, times, rows, 50.0, dynamics.mass, dynamics.viscosity, damping=damping)
    names = tuple(f"{what}_{i}" for what, n in (("contact", 3), ("link", 2)) for i in range(n))
    measured = Measurements("stepped", time, names[:3], x, names[3:], rows, times)
    replica, problem, _ = build(Scene.model_validate(document), measured)
    found = SteppedReplica.of(replica, dynamics, False).predict(problem.space.origin)
    assert found is not None
    assert np.abs(found.values - replica.body.position - x).max() < 5e-4


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS[PERSONS:])
def test_what_differs_in_a_robot_is_the_first_explanation(kind):
    seed = 2 if kind in ("a link 30 % stiffer", "viscosity of 0.3 N s/m") else 1
    found, first = identify_mistake(seed, kind)
    assert not found.model_fits
    assert first


def test_viscosity_is_not_called_inertia_where_dampers_imitate_it():
    """Only one of two contacts moves at a time, so that a damper between them resists as viscosity does."""
    document = {
        "name": "two",
        "start": "relaxed",
        "body": {"contacts": [0.0, 0.1], "links": {"stiffness": [20.0]}},
        "friction": {"forward": [0.2, 0.2], "backward": [0.6, 0.6]},
    }
    times = np.concatenate((np.arange(0.0, 24.0, 2.0), np.arange(24.0, 36.1, 0.5)))
    rows = 0.1 * (np.arange(times.size) % 2)[:, None]
    time, x = step(document, times, rows, 50.0, viscosity=0.3)
    values = np.array([0.0, 0.1]) + x + 1e-4 * np.random.default_rng(0).normal(size=x.shape)
    measured = Measurements("camera", time, ("contact_0", "contact_1"), values, ("link_0",), rows, times)
    found = identify(Scene.model_validate(document), [measured], ["friction.forward"], seconds=2.0)
    assert not found.model_fits
    assert found.explanations[0].what.startswith("viscosity: ")
    assert found.explanations[0].explained > 0.9
