"""Many scenes at once: each row is what the scene gives by itself, however the work is spread."""

from __future__ import annotations

import copy
import os
import pickle
import signal
import sys
import threading
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from crawler_lab import simulate_many, vary
from crawler_lab.sweep import batch, workers
from crawler_lab.sweep.many_runs import Settings, run_chunk
from crawler_model import CommandError, CrawlerError, Scene, SceneError, load_scene, simulate
from crawler_model.run.account import average_displacement
from crawler_model.run.transport import supporting_force
from tests.scenes import NOT_TURNING

from ...instrument.model.chains import coarse, scene

STRATEGIES = {
    "a": lambda a: np.maximum(a - 2, 0),
    "b": lambda a: np.clip(a - 1, 0, 2),
    "c": lambda a: np.maximum(a - 2, 0),
}
FIELDS = ("status", "net_translation", "gained", "per_period", "settling", "work", "dissipation", "stored", "residual")
FIELDS += ("violation", "visited_margin", "unique", "events", "overspent", "unsolved", "periods", "reason")
SLOW = {"drive.length": np.linspace(0.0, 6.0, 25), "drive.friction": [1.0, 1.25]}


def resting(name: str) -> Scene:
    document = load_scene(name).document()
    return Scene.model_validate(document | {"start": "relaxed"})


def same(one: Any, other: Any) -> None:
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def alone(run: Any) -> dict[str, Any]:
    """What a row holds, of a run by `simulate`."""
    gains = run.per_period
    return {
        "net_translation": run.net_translation[-1],
        "gained": run.net_translation[-1] - run.net_translation[0],
        "per_period": gains[-1] if len(gains) else np.full(run.net_translation.shape[1:], np.nan),
        "periods": len(gains),
        "work": run.energy.work,
        "dissipation": run.energy.dissipation,
        "stored": run.energy.stored,
        "residual": run.energy.relative_residual,
        "violation": run.violation,
        "visited_margin": run.visited_margin,
        "unique": run.unique,
        "events": run.events,
        "overspent": run.overspent,
        "unsolved": run.unsolved,
    }


@pytest.mark.parametrize("name", [n for n in NOT_TURNING if not n.startswith("planar")])
def test_a_row_is_what_simulate_finds_in_one_tick_to_the_bit(name):
    one = load_scene(name)
    drive = one.drive
    seconds = 3.0 * drive.period if drive.period is not None else float(drive.times[-1])
    runs = simulate_many([one], duration=seconds)
    assert runs.status[0] == "done"
    for field, value in alone(simulate(one, seconds, rate=1.0 / seconds)).items():
        rounding = 1e-15 if field == "residual" else 0.0  # a row follows its last period in a call of its own
        assert getattr(runs, field)[0] == pytest.approx(value, abs=rounding, rel=0.0, nan_ok=True), field


@pytest.mark.parametrize("elements", [1, 2, 7, 40, 101])
@pytest.mark.parametrize("name", ["peristaltic_segment", "hybrid_body"])
def test_a_row_of_a_segment_has_the_gain_of_simulate_to_the_bit(name, elements):
    one = coarse(name, elements)
    seconds = 7.0 * one.drive.period
    run = simulate(one, seconds, rate=1.0 / seconds)
    runs = simulate_many([one], duration=seconds)
    assert runs.per_period[0] == run.per_period[-1]
    assert runs.settling[0] == run.per_period[-1] - run.per_period[-2]
    assert runs.net_translation[0] == run.net_translation[-1] == run.waypoint_net_translation[-1]


@pytest.mark.parametrize("shape", [(50,), (50, 2)])
def test_an_average_does_not_depend_on_how_many_are_taken(shape):
    rng = np.random.default_rng(1)
    share = rng.uniform(size=50)
    body = SimpleNamespace(segments=(None,), share=share / share.sum())
    x = rng.normal(size=(33, *shape))
    together = average_displacement(body, x)
    for rows in (1, 2, 3, 8):
        assert (average_displacement(body, x[-rows:].copy()) == together[-rows:]).all()


@pytest.mark.parametrize("name", ["two_anchor_a", "ten_contact_wave", "three_springs", "hybrid_body"])
def test_the_rate_of_exact_is_only_rounding(name):
    one = load_scene(name)
    runs, run = simulate_many([one]), alone(simulate(one, rate=37.0))
    for field in ("net_translation", "per_period", "work", "dissipation", "stored"):
        assert getattr(runs, field)[0] == pytest.approx(run[field], abs=1e-12, rel=1e-12)


@pytest.mark.parametrize("name", ["two_anchor_a", "ten_contact_wave", "three_springs"])
def test_catch_up_takes_the_ticks_of_the_rate_to_the_bit(name):
    one = load_scene(name)
    runs = simulate_many([one], duration=2.5, rate=30.0, method="catch_up")
    for field, value in alone(simulate(one, 2.5, 30.0, "catch_up")).items():
        if field != "residual":  # relative to the most stored at a vertex, there at a tick
            assert getattr(runs, field)[0] == pytest.approx(value, abs=0.0, rel=0.0, nan_ok=True), field


def test_planar_scenes_have_two_components():
    one = load_scene("planar_rectilinear")
    runs = simulate_many([one, load_scene("two_anchor_a")], duration=1.0, rate=4.0)
    run = simulate(one, 1.0, 4.0)
    assert runs.net_translation.shape == (2, 2)
    assert runs.net_translation[0].tolist() == run.net_translation[-1].tolist()
    assert runs.per_period[0].tolist() == run.per_period[-1].tolist()
    assert runs.per_period[1].tolist() == [2.0, 0.0]
    assert (simulate_many([one], method="exact").reason[0]).startswith("method: exact is for bodies on a line")


@pytest.mark.parametrize("name", STRATEGIES)
def test_the_strategies_follow_their_closed_forms_at_every_amplitude(name):
    amplitude = np.linspace(0.0, 8.0, 81)
    runs = simulate_many(vary(resting(f"two_anchor_{name}"), {"drive.length": amplitude}))
    assert runs.per_period == pytest.approx(STRATEGIES[name](amplitude), abs=1e-13)
    assert runs.settling == pytest.approx(0.0, abs=1e-13)
    assert (runs.periods == 10).all()
    assert runs.unique.all()


def test_workers_change_nothing(monkeypatch):
    variations = vary(resting("two_anchor_b"), SLOW)
    one = simulate_many(variations, workers=1)
    monkeypatch.setattr(workers, "_THREADS_SCALE", 0.0)
    for count in (2, 5):
        same(simulate_many(variations, workers=count), one)


def in_processes(monkeypatch) -> None:
    monkeypatch.setattr(workers, "_THREADS_SCALE", np.inf)
    monkeypatch.setattr(workers, "_WORTH_A_PROCESS_S", 0.0)
    monkeypatch.setattr(workers, "_PROBE", 2)
    monkeypatch.setattr(workers, "_MOST_IN_A_CHUNK", 3)


def test_processes_change_nothing(monkeypatch):
    in_processes(monkeypatch)
    answers = []
    run = workers._Helper.run
    monkeypatch.setattr(workers._Helper, "run", lambda *a: answers.append(run(*a)) or answers[-1])
    keys = {"body.segments.trunk.stiffness": np.linspace(0.5, 2.0, 40), "body.links.stiffness": [2.0, -1.0, 4.0]}
    variations = vary(coarse("hybrid_body"), keys)
    same(simulate_many(variations, workers=2), simulate_many(variations, workers=1))
    assert answers
    assert all(a is not None for a in answers)


def test_a_process_that_is_killed_loses_nothing(monkeypatch):
    in_processes(monkeypatch)
    variations = vary(resting("two_anchor_b"), SLOW)
    run = workers._Helper.run

    def killed_then_run(self, *arguments):
        if self.process is not None:
            os.kill(self.process.pid, signal.SIGKILL)
        return run(self, *arguments)

    monkeypatch.setattr(workers._Helper, "run", killed_then_run)
    same(simulate_many(variations, workers=3), simulate_many(variations, workers=1))


def test_a_helping_process_answers_raises_and_is_ended():
    helper, never, now = workers._Helper(), threading.Event(), threading.Event()
    assert helper.run(len, [1, 2, 3], never) == 3
    with pytest.raises(TypeError, match="int"):
        helper.run(int, [1, 2, 3], never)
    assert helper.run(len, [1], never) == 1  # an error does not end it
    now.set()
    assert helper.run(time.sleep, 1000.0, now) is None
    assert helper.process is None
    assert helper.run(len, [1], never) is None


def test_an_error_in_a_thread_stops_the_others_and_is_raised(monkeypatch):
    monkeypatch.setattr(workers, "_THREADS_SCALE", 0.0)
    monkeypatch.setattr(workers, "_PROBE", 2)
    told = []

    def progress(part: float) -> None:
        told.append(part)
        if threading.current_thread() is not threading.main_thread():
            raise ArithmeticError("enough")

    with pytest.raises(ArithmeticError, match="enough"):
        simulate_many(vary(resting("two_anchor_b"), SLOW), workers=2, progress=progress)
    assert told[-1] < 1.0


@pytest.mark.parametrize("when", ["in the first runs", "while the threads are waited for"])
def test_ctrl_c_is_no_error(monkeypatch, when):
    monkeypatch.setattr(workers, "_THREADS_SCALE", 0.0)
    monkeypatch.setattr(workers, "_PROBE", 2)

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    if when == "in the first runs":
        runs = simulate_many(vary(resting("two_anchor_b"), SLOW), workers=2, progress=stop)
        assert (runs.status == "done").sum() == 1
    else:
        monkeypatch.setattr(workers, "wait", stop)
        runs = simulate_many(vary(resting("two_anchor_b"), SLOW), workers=2)
        assert (runs.status == "done").sum() >= 2
    assert runs.interrupted


@pytest.mark.parametrize(("method", "asked_before"), [("exact", 4), ("catch_up", 1)])
def test_a_chunk_that_is_stopped_leaves_the_rest(monkeypatch, method, asked_before):
    """It is asked before each scene is built, and before each compiled call."""
    monkeypatch.setattr(batch, "_STEPS", 1)
    asked = []

    def stop() -> bool:
        asked.append(len(asked))
        return len(asked) > asked_before + 1

    some = [load_scene("two_anchor_a")] * 4
    rows, reasons = run_chunk(some, Settings(duration=1.0, method=method), stop)
    assert rows["status"].tolist() == [1, 0, 0, 0]
    assert reasons == {}
    asked.clear()
    variations = vary(load_scene("two_anchor_a"), {"body.links.stiffness": np.ones(4)})
    rows, _ = run_chunk(variations, Settings(duration=1.0), lambda: len(asked) > 2 or asked.append(0))
    assert rows["status"].tolist() == [1, 1, 0, 0]


def test_scenes_that_are_none_are_passed_over():
    runs = simulate_many(vary(load_scene("two_anchor_a"), {"body.links.stiffness": [-1.0, 1.0]}), duration=1.0)
    assert runs.status.tolist() == ["invalid", "done"]


def test_ctrl_c_keeps_what_is_done(monkeypatch):
    monkeypatch.setattr(workers, "_THREADS_SCALE", 0.0)
    variations = vary(resting("two_anchor_a"), {"drive.length": np.linspace(1.0, 6.0, 3000)})
    told = []

    def progress(part: float) -> None:
        told.append(part)
        if part > 0.1 and max(told[:-1]) <= 0.1:
            signal.raise_signal(signal.SIGINT)

    runs = simulate_many(variations, duration=100.0, workers=2, progress=progress)
    assert runs.interrupted
    done = runs.status == "done"
    assert 0.1 < done.mean() < 1.0
    assert (runs.status[~done] == "not run").all()
    assert np.isnan(runs.per_period[~done]).all()
    assert runs.per_period[done] == pytest.approx(np.maximum(np.linspace(1.0, 6.0, 3000)[done] - 2, 0), abs=1e-12)


def test_progress_is_told():
    parts: list[float] = []
    simulate_many(vary(resting("two_anchor_a"), SLOW), workers=2, progress=parts.append)
    assert parts == sorted(parts)
    assert parts[-1] == 1.0


def test_an_invalid_variation_does_not_stop_the_others():
    lengths = [0.0, 1.0, -np.pi, 3.0]
    runs = simulate_many(
        vary(load_scene("two_anchor_a"), {"start.displacement.1": [1.0, 7.0, 0.5], "drive.length": lengths})
    )
    invalid = np.repeat([False, True, False], 4)
    assert ((runs.status == "invalid") == invalid).all()
    assert all(("start.displacement: contact 0 is pulled" in r) == i for r, i in zip(runs.reason, invalid, strict=True))
    assert np.isfinite(runs.per_period[~invalid]).all()
    assert np.isnan(runs.work[invalid]).all()
    assert not runs.interrupted


def test_long_runs_go_in_blocks():
    one = load_scene("two_anchor_a")
    runs = simulate_many([one], duration=3000.3)
    run = simulate(one, 3000.3, rate=1.0 / 3000.3)
    assert runs.periods[0] == 3000
    assert runs.net_translation[0] == run.net_translation[-1]
    assert runs.per_period[0] == run.per_period[-1]
    assert runs.work[0] == pytest.approx(run.energy.work, rel=1e-11)


def test_no_scene_and_no_drive_are_no_mistakes():
    assert len(simulate_many([])) == 0
    runs = simulate_many([scene(3)] * 2)
    assert runs.gained.tolist() == [0.0, 0.0]
    assert np.isnan(runs.per_period).all()
    assert simulate_many([scene(3)], duration=1.0).status[0] == "done"


@pytest.mark.parametrize(
    "options", [{"rate": 0.0}, {"duration": -1.0}, {"duration": np.nan}, {"method": "rk4"}, {"workers": 0}]
)
def test_out_of_range_is_refused(options):
    with pytest.raises(CommandError):
        simulate_many([load_scene("two_anchor_a")], **options)


def test_results_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        simulate_many([load_scene("two_anchor_a")]).work[0] = 0.0


# Variations


def test_a_grid_has_the_last_key_fastest():
    grid = vary(load_scene("two_anchor_a"), {"drive.length": [1, 2], "drive.friction": [1, 3, 5]})
    assert grid.shape == (2, 3)
    assert len(grid) == 6
    assert [(s.parts.drive.length, s.parts.drive.friction) for s in grid] == [(a, b) for a in (1, 2) for b in (1, 3, 5)]
    beside = vary(load_scene("two_anchor_a"), {"drive.length": [1, 2], "drive.friction": [1, 3]}, grid=False)
    assert [(s.parts.drive.length, s.parts.drive.friction) for s in beside] == [(1, 1), (2, 3)]
    assert "2 x 3 of drive.length, drive.friction" in repr(grid)


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("ten_contact_wave", "drive.wave.amplitude"),
        ("ten_contact_wave", "friction.forward"),
        ("ten_contact_wave", "body.links.stiffness"),
        ("ten_contact_wave", "start.displacement.3"),
        ("three_springs", "body.links.stiffness.2"),
        ("three_springs", "drive.actuation.1.0"),
        ("hybrid_body", "body.segments.trunk.friction.backward"),
        ("hybrid_body", "friction.backward"),
        ("planar_rectilinear", "friction.value.0"),
        ("planar_rectilinear", "tolerance"),
    ],
)
def test_a_variation_is_its_document(name, key):
    base = load_scene(name)
    node: Any = base.document()
    for step in key.replace("segments.trunk", "segments.0").split("."):
        node = node[int(step)] if isinstance(node, list) else node[step]
    value = (node[0] if isinstance(node, list) else node) * (1.0 - 1e-3)
    variations = vary(base, {key: [value]})
    other = Scene.model_validate(variations.document(0))
    assert variations[0] == other
    assert variations[0] != base
    same(simulate_many(variations, 1.0, 4.0), simulate_many([other], 1.0, 4.0))
    same(simulate_many(pickle.loads(pickle.dumps(variations)), 1.0, 4.0), simulate_many([other], 1.0, 4.0))


def test_a_row_of_friction_with_elongation_is_what_simulate_finds():
    document = load_scene("three_contacts_two_ways").document()
    entry = {"link": 0, "contacts": [0, 1], "elongation": [-0.2, 0.1], "added": [0.1, 0.0]}
    base = Scene.model_validate(document | {"friction": document["friction"] | {"with_elongation": [entry]}})
    values = {"friction.with_elongation[0].added[0]": [0.0, 0.1, 0.5], "friction.isotropic": [0.2, 0.3]}
    found, each = simulate_many(vary(base, values)), vary(base, values)
    gains = [simulate(each[i], rate=1.0).per_period[-1] for i in range(len(each))]
    assert found.per_period == pytest.approx(gains, abs=1e-13)
    assert len(set(found.per_period.round(6))) == 6


def test_friction_that_elongations_and_the_ground_add_to_commands_is_varied():
    entry = {"link": 0, "contacts": [0], "elongation": [-0.1, 0.0], "added": [0.5, 0.0]}
    sides = {"forward": [[0.2, 0.2]] * 3, "backward": [[0.8, 0.8]] * 3}
    document: dict[str, Any] = {
        "name": "gripper",
        "body": {"contacts": [0.0, 0.1], "links": {"stiffness": 20.0}},
        "friction": {"forward": 0.2, "backward": 0.8, "with_elongation": [entry]},
        "ground": {"patches": [{"from": 0.15, "to": 2.0, "friction": 1.0}]},
        "drive": {"times": [0, 1, 2], "period": 2, "actuation": [[0], [-0.1], [0]], "friction": sides},
    }
    base = Scene.model_validate(document)
    keys = ["friction.with_elongation[0].added[0]", "ground.patches[0].friction"]
    found, each = (of(vary(base, {keys[0]: [0.0, 0.5], keys[1]: [1.0, 1.5]})) for of in (simulate_many, list))
    assert found.per_period == pytest.approx([simulate(one, rate=1.0).per_period[-1] for one in each], abs=1e-13)
    assert np.unique(found.per_period.round(6)).size == 4
    with pytest.raises(SceneError, match="no effect, as the drive commands friction"):
        vary(base, {"friction.forward": [0.3]})


def test_friction_both_ways_is_varied_on_one_side():
    base = scene(2, drive={"times": [0, 0.5], "period": 1, "actuation": [0, 3]})
    base = Scene.model_validate(base.document() | {"friction": {"isotropic": 1.0}})
    runs = simulate_many(vary(base, {"friction.backward": [1.0, 1.2, 2.0]}))
    assert runs.unique.tolist() == [False, True, True]
    assert runs.per_period[1:] == pytest.approx(1.0)
    variations = vary(load_scene("two_contacts_anisotropic"), {"friction.isotropic": [0.3]})
    for (other,) in (variations, pickle.loads(pickle.dumps(variations))):  # other processes get them so
        assert other.parts.friction.sides == (0.3, 0.3)


def test_friction_both_ways_is_varied_on_one_side_of_a_segment():
    document = coarse("hybrid_body").document()
    document["body"]["segments"][0]["friction"] = {"isotropic": 0.2}
    (other,) = vary(Scene.model_validate(document), {"body.segments.trunk.friction.forward": [0.1]})
    assert other.parts.body.segments[0].friction.sides == (0.1, 0.2)
    (by_place,) = vary(Scene.model_validate(document), {"body.segments.0.friction.forward": [0.1]})
    assert by_place == other


def test_elements_stay_unless_the_accuracy_is_varied():
    base = load_scene("hybrid_body")
    elements = [s.body.segments[0].elements for s in vary(base, {"body.links.stiffness": [1.0, 9.0]})]
    assert elements == [base.body.segments[0].elements] * 2
    variations = vary(base, {"body.segments.trunk.accuracy": [0.2, 0.003]})
    counts = [s.body.segments[0].elements for s in variations]
    assert counts[0] < counts[1]
    assert [s.body.segments[0].elements for s in pickle.loads(pickle.dumps(variations))] == counts


@pytest.mark.parametrize(
    ("name", "keys", "said"),
    [
        ("two_anchor_a", {}, "no key"),
        ("two_anchor_a", {"drive.lenth": [1]}, "drive.lenth: unknown key; the nearest known key is 'drive.length'"),
        ("ten_contact_wave", {"friction.foward": [1]}, "the nearest known key is 'friction.forward'"),
        (
            "ten_contact_wave",
            {"drive.wave": [1]},
            "drive.wave: a part with more keys is not a number; vary drive.wave.a",
        ),
        ("ten_contact_wave", {"drive.friction_wave": [1]}, "unknown key"),
        ("ten_contact_wave", {"body.contacts.10": [1]}, "body.contacts has 10 entries, numbered from 0"),
        ("ten_contact_wave", {"friction.forward[10]": [1]}, "friction.forward has 10 entries, numbered from 0"),
        ("two_anchor_a", {"drive.strategy": [1]}, "drive.strategy: 'A' is not a number"),
        ("two_anchor_a", {"name.x": [1]}, "name.x: unknown key"),
        ("three_springs", {"drive.actuation": [1]}, "drive.actuation: a table is not a number; vary drive.actuation.0"),
        ("two_anchor_a", {"friction.forward": [1]}, "no effect, as the drive commands friction"),
        (
            coarse("hybrid_body"),
            {"body.segments.trunk.accuracy": [0.1]},
            "no effect, as the segment has fixed elements; vary elements instead",
        ),
        ("two_anchor_a", {"drive.length": []}, "at least one number"),
        ("two_anchor_a", {"drive.length": [np.nan]}, "all finite"),
        ("two_anchor_a", {"drive.length": 3}, "a list of"),
        ("two_anchor_a", {"drive.length": ["x"]}, "a list of numbers"),
        ("two_anchor_a", {"drive.length": np.zeros(10**4), "drive.period": np.ones(1001)}, "10010000 variations"),
        ("three_springs", {"body.links.stiffness": [1], "body.links.stiffness.0": [2]}, "set the same number"),
    ],
)
def test_a_mistake_in_a_key_is_one_clear_line(name, keys, said):
    with pytest.raises(SceneError) as error:
        vary(name if isinstance(name, Scene) else load_scene(name), keys)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
    with pytest.raises(SceneError, match="all keys need the same number of values"):
        vary(load_scene("two_anchor_a"), {"drive.length": [1, 2], "drive.friction": [1]}, grid=False)


LOADED_KEYS = [
    {"ground.slope": [0.0, 3.0, 12.0]},
    {"loads": [-0.1, 0.0, 0.2]},
    {"loads[1]": [-0.1, 0.0, 0.2]},
    {"loads.0": [-0.1, 0.0, 0.2]},
    {"body.weights": [0.5, 1.0, 2.0]},
    {"body.weights[1]": [0.5, 1.0, 2.0]},
    {"friction.coefficient.forward[0]": [0.1, 0.2, 0.3]},
    {"friction.coefficient.isotropic": [0.3, 0.4]},
    {"body.links.stiffness[0]": [10.0, 30.0]},
    {"ground.slope": [2.0, 4.0], "loads[0]": [0.0, -0.1], "body.weights[1]": [1.0, 1.5]},
]


@pytest.mark.parametrize("base", ["level", "sloping"])
@pytest.mark.parametrize("values", LOADED_KEYS, ids=[",".join(values) for values in LOADED_KEYS])
def test_loads_weights_and_slopes_vary_as_if_written_in_the_scene(base, values):
    document = load_scene("slope_climber").document()
    if base == "level":
        del document["ground"]
    variations = vary(Scene.model_validate(document), values)
    runs = simulate_many(variations, duration=4.0)
    assert set(runs.status) == {"done"}
    assert len(set(runs.per_period)) > 1 or "friction.coefficient.isotropic" in values
    for i in range(len(variations)):
        written = copy.deepcopy(document)
        for key, column in variations.values.items():
            put_written(written, key, float(column[i]))
        run = simulate(Scene.model_validate(written), 4.0, rate=0.25)
        assert (runs.per_period[i], runs.work[i]) == (run.per_period[-1], run.energy.work)


def put_written(document, key, value):
    """Write a number where a person would."""
    *parents, last = key.replace("[", ".").replace("]", "").split(".")
    if last.isdecimal():
        *parents, name = parents
        node = document
        for step in parents:
            node = node.setdefault(step, {})
        now = node.get(name, 0.0)
        node[name] = list(now) if isinstance(now, (list, tuple)) else [now] * (1 if name == "stiffness" else 2)
        node[name][int(last)] = value
        return
    node = document
    for step in parents:
        node = node.setdefault(step, {})
    if last == "isotropic":
        node.clear()
    node[last] = value


def test_a_load_of_a_segment_and_of_a_contact_are_varied_one_by_one():
    one = coarse("hybrid_body")
    count = one.body.isolated.size + len(one.body.segments)
    variations = vary(one, {f"loads[{count - 1}]": [0.0, -0.02]})
    level, loaded = variations
    assert loaded.parts.loads == (0.0,) * (count - 1) + (-0.02,)
    written = Scene.model_validate(one.document() | {"loads": [0.0] * (count - 1) + [-0.02]})
    runs = simulate_many(variations, duration=3.0)
    assert runs.per_period[1] == simulate_many([written], duration=3.0).per_period[0] < runs.per_period[0]
    assert level.columns.loads == count


NO_LOADS = [
    ({"loads[2]": [0.1]}, r"vary: loads\[2\]: loads has 2 entries, numbered from 0"),
    ({"loads": [0.1], "loads[1]": [0.1]}, "set the same number"),
    ({"ground.slop": [1.0]}, "the nearest known key is 'ground.slope'"),
    ({"body.links.stiffness[1]": [1.0]}, "body.links.stiffness has 1 entry, numbered from 0"),
]


@pytest.mark.parametrize(("values", "text"), NO_LOADS)
def test_a_wrong_key_of_a_load_is_one_clear_line(values, text):
    with pytest.raises(SceneError, match=text):
        vary(load_scene("slope_climber"), values)


def test_a_slope_without_weights_and_loads_that_a_drive_commands_have_no_effect():
    with pytest.raises(SceneError, match=r"ground\.slope: no effect, as the contacts have no weights"):
        vary(load_scene("two_contacts_anisotropic"), {"ground.slope": [1.0]})
    assert len(vary(load_scene("two_contacts_anisotropic"), {"ground.slope": [1.0], "body.weights": [0.1]})) == 1
    document = load_scene("tow_puller").document()
    document["drive"]["loads"] = -0.1
    with pytest.raises(SceneError, match="loads: no effect, as the drive commands loads"):
        vary(Scene.model_validate(document), {"loads": [0.1]})


def test_the_cost_of_transport_of_a_climb_is_its_closed_form_whatever_the_stroke():
    """C_plus cos + sin uphill, c_minus cos - sin where it slides back."""
    slopes = np.array([-3.0, 0.0, 10.0, 16.0, 20.0])
    theta = np.radians(slopes)
    for stroke in (0.1, 0.2):
        document = load_scene("slope_climber").document()
        document["drive"]["actuation"] = [[0.0], [stroke], [0.0]]
        runs = simulate_many(vary(Scene.model_validate(document), {"ground.slope": slopes}))
        expected = np.where(slopes < 16.7, 0.2 * np.cos(theta) + np.sin(theta), 0.8 * np.cos(theta) - np.sin(theta))
        assert runs.cost_of_transport == pytest.approx(expected, abs=1e-12)
        assert runs.body_lengths == pytest.approx(runs.per_period / 0.2, abs=1e-15)
        assert runs.period_work == pytest.approx(expected * 2.0 * np.abs(runs.per_period), abs=1e-12)


def test_without_weights_the_force_is_the_mean_friction_of_all_contacts():
    runs = simulate_many([load_scene("two_contacts_anisotropic"), load_scene("two_anchor_a")])
    assert runs.cost_of_transport[0] == pytest.approx(0.4 * 0.08 / (0.08 * 0.7), abs=1e-12)
    work = (
        simulate(load_scene("two_anchor_a"), 10.0).energy.work - simulate(load_scene("two_anchor_a"), 9.0).energy.work
    )
    assert runs.period_work[1] == pytest.approx(work, abs=1e-12)
    assert runs.cost_of_transport[1] == pytest.approx(work / (2.0 * 2.0), abs=1e-12)  # mu = 1 N each, on average


def test_a_constant_factor_between_weights_and_friction_counts_once():
    """Friction as weights: the cost equals the cost of the coefficients."""
    document = load_scene("two_contacts_anisotropic").document()
    document["body"]["weights"] = 10.0
    runs = simulate_many([Scene.model_validate(document)])
    assert runs.cost_of_transport[0] == pytest.approx(0.2 / 10.0, abs=1e-12)


def test_what_does_not_travel_or_has_no_period_has_no_cost():
    still = simulate_many(vary(load_scene("slope_climber"), {"drive.actuation.1.0": [0.01]}))
    assert np.isnan(still.cost_of_transport).all()
    assert still.body_lengths.tolist() == [0.0]
    short = simulate_many([load_scene("slope_climber")], duration=0.5)
    assert np.isnan([short.cost_of_transport[0], short.body_lengths[0], short.period_work[0]]).all()


@pytest.mark.parametrize(("method", "rate"), [("exact", 100.0), ("catch_up", 7.0)])
@pytest.mark.parametrize("seconds", [3.0, 3.6])
def test_the_work_of_the_last_period_is_that_of_a_run_less_that_of_a_shorter_one(method, rate, seconds):
    one = load_scene("ten_contact_wave")
    runs = simulate_many([one], seconds, rate, method)
    if method == "exact":
        longer, shorter = (simulate(one, s, 1.0 / s).energy.work for s in (3.0, 2.0))
        assert runs.period_work[0] == pytest.approx(longer - shorter, abs=1e-14)
    assert runs.period_work[0] > 0.0


def test_in_the_plane_the_distance_counts_and_the_mean_friction_of_all_directions():
    one = load_scene("planar_three_points")
    runs = simulate_many([one], duration=3.0, rate=4.0)
    distance = np.linalg.norm(runs.per_period[0])
    force = runs.period_work[0] / (runs.cost_of_transport[0] * distance)
    assert force == pytest.approx(one.drive.targets[0, 2 * one.body.springs :].sum(), rel=1e-12)
    assert runs.body_lengths[0] == pytest.approx(distance / np.linalg.norm(np.ptp(one.body.position, axis=0)))


def test_the_distance_of_a_body_that_turns_is_that_of_its_frame():
    runs = simulate_many([load_scene("tripedal_star")], duration=3.0)
    dx, dy, dyaw = simulate(load_scene("tripedal_star"), duration=3.0).per_period[-1]
    assert (runs.dx[0], runs.dy[0], runs.dyaw[0]) == pytest.approx((dx, dy, dyaw), abs=1e-4)
    force = runs.period_work[0] / (runs.cost_of_transport[0] * np.hypot(runs.dx[0], runs.dy[0]))
    assert force == pytest.approx(supporting_force(load_scene("tripedal_star")), rel=1e-9)


def test_a_period_that_no_run_reaches_is_one_line():
    with pytest.raises(CommandError, match=r"duration: 1e\+13 s; it must be a number between 0 and 9e9"):
        simulate_many(vary(load_scene("two_contacts_anisotropic"), {"drive.period": [1.0, 1e12]}))


# Batches, rows and tables


@pytest.mark.parametrize("name", ["two_anchor_b", "three_springs", "slope_climber", "friction_wave_segment"])
@pytest.mark.parametrize("seconds", [None, 2.3])
def test_runs_together_are_the_runs_alone_to_the_bit(monkeypatch, name, seconds):
    base = coarse(name) if name.endswith("segment") else resting(name)
    key = "body.segments.foot.stiffness" if name.endswith("segment") else "body.links.stiffness"
    variations = vary(base, {key: [1.0, 1e-3, -1.0, 2.0, 5.0, 20.0]})
    together = simulate_many(variations, seconds)
    assert together.status.tolist() == ["done", "done", "invalid", "done", "done", "done"]
    alone = [simulate_many([scene], seconds) for scene in (variations[i] for i in (0, 1, 3, 4, 5))]
    for field in FIELDS:
        expected = [getattr(run, field)[0] for run in alone]
        found = [getattr(together, field)[i] for i in (0, 1, 3, 4, 5)]
        np.testing.assert_array_equal(found, expected, err_msg=field)
    monkeypatch.setattr(batch, "_STEPS", 1)
    same(simulate_many(variations, seconds), together)
    one = variations[4]
    end = (10.0 * one.drive.period) if seconds is None else seconds
    run = simulate(one, end, rate=1.0 / end)
    assert together.net_translation[4] == run.net_translation[-1]
    assert (together.work[4], together.stored[4]) == (run.energy.work, run.energy.stored)


def test_variations_of_the_times_run_together_where_their_ramps_are_alike():
    base = resting("two_contacts_anisotropic")
    for keys in ({"drive.period": [1.0, 1.2, 1.5]}, {"drive.times.1": [0.2, 0.3, 0.5]}):
        variations = vary(base, keys)
        for seconds in (None, 2.45):
            together = simulate_many(variations, seconds)
            for i, one in enumerate(variations):
                end = 10.0 * one.drive.period if seconds is None else seconds
                assert together.net_translation[i] == simulate(one, end, rate=1.0 / end).net_translation[-1]


def test_runs_are_a_sequence_of_rows():
    runs = simulate_many(vary(resting("two_anchor_a"), {"body.links.stiffness": [1.0, -1.0, 3.0]}))
    assert [row.status for row in runs] == ["done", "invalid", "done"]
    assert runs[-1].per_period == runs.per_period[2]
    assert runs[0].period_work == runs.period_work[0]
    assert runs[0].events == runs.events[0]
    assert "must be > 0" in runs[1].reason
    assert len(runs[1:]) == 2
    assert runs[1:].net_translation[1] == runs.net_translation[2]
    assert runs[::-1].reason == runs.reason[::-1]
    with pytest.raises(IndexError):
        runs[3]
    planar = simulate_many([load_scene("planar_rectilinear")], duration=1.0, rate=4.0)
    assert planar[0].per_period.shape == (2,)


def test_the_energy_of_a_period_and_what_it_gains():
    """In the periodic regime friction loses what the actuators do."""
    runs = simulate_many([resting("two_anchor_a")])
    assert runs.period_dissipation == pytest.approx(runs.period_work, abs=1e-12)
    assert runs.period_efficiency == pytest.approx(runs.per_period / runs.period_dissipation)
    assert runs.efficiency == pytest.approx(runs.gained / runs.dissipation)
    longer, shorter = (simulate(resting("two_anchor_a"), s, rate=1.0 / s).energy for s in (10.0, 9.0))
    assert runs.period_dissipation[0] == pytest.approx(longer.dissipation - shorter.dissipation, abs=1e-12)
    assert np.isnan(simulate_many([scene(3)], duration=1.0).period_efficiency).all()
    assert np.isnan(simulate_many([scene(3)], duration=1.0).efficiency).all()


def test_runs_convert_to_a_table():
    pytest.importorskip("pyarrow")
    runs = simulate_many(vary(load_scene("two_anchor_a"), {"body.links.stiffness": [1.0, -1.0]}))
    table = runs.to_table()
    assert table.column_names[:2] == ["body.links.stiffness", "status"]
    assert table["body.links.stiffness"].to_pylist() == [1.0, -1.0]
    assert runs[1:].to_table()["body.links.stiffness"].to_pylist() == [-1.0]
    assert table["per_period"].to_pylist() == [runs.per_period[0], None]
    assert table["status"].to_pylist() == ["done", "invalid"]
    assert table["reason"].to_pylist() == list(runs.reason)
    assert table["events"].to_pylist() == [runs.events[0], None]
    assert table.schema.field("period_work").metadata == {b"unit": b"J"}
    planar = simulate_many([load_scene("planar_rectilinear")], duration=1.0, rate=4.0).to_table()
    assert {"per_period_x", "efficiency_y"} <= set(planar.column_names)


def test_without_pyarrow_a_table_is_one_clear_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(CrawlerError, match=r"to_table: pyarrow is not installed; pip install 'crawler-ros\[tables\]'"):
        simulate_many([load_scene("two_anchor_a")]).to_table()
