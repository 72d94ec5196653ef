"""Scenes with values that are only bounded stand clear of their bounds, and all that reads them agrees."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import yaml

from crawler_command.screen import write_scene
from crawler_lab import Identification, identify, optimise
from crawler_lab.identify.forecast.predict import predict
from crawler_lab.identify.judge.verdicts import Parameter, doubt
from crawler_lab.optimise.landscape import profile
from crawler_lab.verbs.identify.command import _note_bounds
from crawler_model import Scene, limit_cycle, load_scene, simulate
from crawler_model.theory.uniqueness import uniqueness_margin

from .synthetic import RATE, chain, measure, walk


def robot(seed: int, forward: float = 3.0) -> dict[str, Any]:
    """A chain of three contacts, of which the middle one holds while both others slide, at least backwards."""
    rng = np.random.default_rng(seed)
    friction = {
        side: [float(rng.uniform(0.2, 0.4)), middle, float(rng.uniform(0.2, 0.4))]
        for side, middle in (("forward", forward), ("backward", 3.0))
    }
    return chain(3, friction=friction)


def fit(seed: int, forward: float = 3.0) -> tuple[dict[str, Any], float, Identification]:
    """Identify the friction of a robot; return the robot, the duration of its record, and what was found."""
    document = robot(seed, forward)
    times, rows = walk(2, 6.0, seed)
    guess = Scene.model_validate(document | {"friction": {"forward": [0.3] * 3, "backward": [0.3] * 3}})
    found = identify(guess, [measure(document, times, rows)], ["friction.forward", "friction.backward"])
    return document, float(times[-1]), found


@pytest.mark.parametrize("seed", range(5))
def test_a_contact_that_held_while_others_slid_does_not_make_the_scene_critical(seed: int, tmp_path: Any) -> None:
    document, end, found = fit(seed)
    bounded = [p for p in found.parameters if p.verdict == "bound"]
    assert {p.name for p in bounded} == {"friction.forward[1]", "friction.backward[1]"}
    write_scene(found.playback(), tmp_path / "found.yaml", _note_bounds(found))
    written = load_scene(tmp_path / "found.yaml")
    friction = written.document()["friction"]
    margin = uniqueness_margin(friction["forward"], friction["backward"])
    assert margin is not None
    assert margin > 1e-3
    head = [line for line in (tmp_path / "found.yaml").read_text().splitlines() if line.startswith("#")]
    assert all(any(p.name in line and "at least" in line for line in head) for p in bounded)
    assert yaml.safe_load((tmp_path / "found.yaml").read_text()) == written.document()
    truth = simulate(Scene.model_validate(document | {"drive": written.document()["drive"]}), end, RATE)
    run = simulate(written, end, RATE)
    assert run.unique
    assert np.abs(run.displacement - truth.displacement).max() < 1e-9
    forecast = predict(written, found.posterior)
    gained = run.net_translation[-1] - run.net_translation[0]
    assert forecast.run_gain.value == pytest.approx(gained, abs=1e-9)


def test_the_best_gait_of_a_written_scene_gains_the_same_wherever_it_is_computed(tmp_path: Any) -> None:
    """In the search, in its picture, in a simulation, in the limit cycle, and as a prediction."""
    pytest.importorskip("cma")
    _, _, found = fit(0, 0.1)
    write_scene(found.playback(), tmp_path / "found.yaml", _note_bounds(found))
    best = optimise(load_scene(tmp_path / "found.yaml"), waypoints=3)
    assert best.value > 1e-3
    at_bounds = np.flatnonzero((best.point == 0.0) | (best.point == 1.0))
    assert at_bounds.size
    _, around = profile(best)
    drawn = [around[i, -1 if best.point[i] else 0] for i in at_bounds]
    assert drawn == pytest.approx([best.value] * at_bounds.size, rel=1e-9)
    write_scene(best.scene, tmp_path / "best.yaml")
    played = load_scene(tmp_path / "best.yaml")
    run = simulate(played, 20.0 * played.drive.period, 1.0)
    assert run.unique
    assert run.per_period[-1] == pytest.approx(best.value, rel=1e-9)
    assert limit_cycle(played).gain == pytest.approx(best.value, rel=1e-9)
    assert predict(played, found.posterior).gain.value == pytest.approx(best.value, rel=1e-9)


def test_of_a_model_that_does_not_fit_a_bound_that_the_fit_reached_tells_nothing() -> None:
    """The misfit has driven it there: frictions of 0.2 N were "at most" the bound of 0.002 N."""
    reached = Parameter("friction.forward[0]", "bound", 0.002, (None, 0.002), (), "at most 0.002", ended=True)
    found = doubt(reached, "the model does not fit")
    assert (found.verdict, found.interval, found.ended) == ("doubtful", (None, None), True)
    assert found.why == "the model does not fit; at most 0.002"
