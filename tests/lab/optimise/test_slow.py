from __future__ import annotations

import numpy as np
import pytest

from crawler_lab.identify.forecast.posterior import Posterior
from crawler_lab.identify.forecast.predict import predict
from crawler_lab.identify.replica.playback import measure_speeds
from crawler_lab.optimise.optimise import optimise
from crawler_lab.optimise.slow import slow_down
from crawler_model import CommandError, Scene, SceneError, load_scene, simulate


def weighed(name: str, mass: float = 0.05) -> Scene:
    document = load_scene(name).document()
    document["body"]["masses"] = mass
    return Scene.model_validate(document)


@pytest.mark.parametrize("name", ["two_contacts_anisotropic", "ten_contact_wave", "two_anchor_a"])
def test_a_slowed_drive_has_the_number_and_the_gain(name):
    """Of tables, waves and strategies."""
    scene = weighed(name)
    fast = simulate(scene)
    slow, factor = slow_down(scene, 0.5 * fast.inertia.number)
    assert factor == pytest.approx(2.0)
    assert slow.drive.period == pytest.approx(2.0 * scene.drive.period)
    run = simulate(slow)
    assert run.inertia.number == pytest.approx(0.5 * fast.inertia.number, rel=1e-6)
    assert run.per_period == pytest.approx(fast.per_period, abs=1e-12)
    assert slow_down(slow, fast.inertia.number) == (slow, 1.0)


def test_a_gait_keeps_within_the_number():
    scene, limits = weighed("two_contacts_anisotropic"), {"waypoints": 2, "stroke": (0.0, 0.1)}
    fast = optimise(scene, "translation", **limits)
    slow = optimise(scene, "translation", **limits, slower_than=0.1 * fast.inertia.number)
    assert slow.value == fast.value
    assert slow.inertia.number == pytest.approx(0.1 * fast.inertia.number, rel=1e-6)
    assert slow.scene.drive.period == pytest.approx(10.0 * fast.scene.drive.period)
    assert slow.summary()["inertia"]["contact"] == slow.inertia.contact


@pytest.mark.parametrize(
    ("mass", "most", "error"), [(None, 0.1, SceneError), (0.05, 0.0, CommandError), (0.05, np.nan, CommandError)]
)
def test_limits_that_cannot_be_kept_are_refused(mass, most, error):
    scene = load_scene("two_contacts_anisotropic") if mass is None else weighed("two_contacts_anisotropic", mass)
    with pytest.raises(error, match="slower_than"):
        optimise(scene, "translation", waypoints=2, stroke=(0.0, 0.1), slower_than=most)


def test_predictions_note_drives_that_are_faster_than_the_record():
    scene = weighed("two_contacts_anisotropic")
    speeds = measure_speeds(scene)
    fastest = np.abs(np.diff(scene.drive.rows[:, 0]) / np.diff(scene.drive.times)).max()
    assert speeds == {"link_0": pytest.approx(fastest)}
    for factor, noted in ((0.5, True), (1.0, False), (2.0, False)):
        record = {name: factor * speed for name, speed in speeds.items()}
        found = predict(scene, Posterior((), np.zeros(0), np.zeros((0, 0)), speeds=record))
        assert any("faster than the record was" in note for note in found.notes) == noted
        assert found.inertia == simulate(scene).inertia
