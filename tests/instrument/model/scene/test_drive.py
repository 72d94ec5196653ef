"""Waypoints of drives: none is lost, however short or long a period is."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import Scene, SceneError, load_scene, simulate

NS = 10**9


def driven(times: list[float], period: float) -> Scene:
    document = load_scene("two_contacts_anisotropic").document()
    lengths = [[0.1 * (i % 2)] for i in range(len(times))]
    return Scene.model_validate(document | {"drive": {"times": times, "actuation": lengths, "period": period}})


@pytest.mark.parametrize("period", [2.0 / 3.0, 0.7000000001, np.pi, 1e6 / 3.0, 1e7])
def test_waypoints_of_all_periods_are_apart(period: float) -> None:
    """Rounding of late periods made two waypoints one, and a stroke was lost."""
    for first in (0.1, 0.1000000004, 0.1000000005):
        times = [0.0, first, first + 1e-9, first + 2.2e-9, period * (1.0 - 1e-14) - 2e-9]
        drive = driven(times, period).drive
        count = int((drive.times < drive.period).sum())  # rounding makes the last one the end of a long period
        for begin in (-1, round(1e8 * NS)):
            found, rows = drive.waypoints_between(begin, begin + round(20 * period * NS))
            assert (np.diff(found) > 0).all()
            assert (np.diff(rows) % count == 1).all()


@pytest.mark.parametrize("period", [1.0, 1e7])
def test_each_period_has_its_short_strokes(period: float) -> None:
    run = simulate(driven([0.0, 1e-9, 2e-9], period), 10 * period, 3 / period)
    assert run.per_period[1:] == pytest.approx(np.full(9, run.per_period[1]))
    assert run.per_period[1] > 0.0


@pytest.mark.parametrize(("name", "samples"), [("wave", (64, None)), ("friction_wave", (64, 65))])
def test_a_period_too_short_for_its_samples_is_refused(name: str, samples: tuple) -> None:
    wave = {"amplitude": 0.1, "wavelength": 0.5, "period": 6.3e-8}
    drive = {"wave": wave | {"samples": samples[0]}}
    if samples[1]:
        drive["friction_wave"] = {**wave, "mean": 0.3, "samples": samples[1]}
    document = load_scene("two_contacts_anisotropic").document() | {"drive": drive, "start": "relaxed"}
    with pytest.raises(SceneError, match=r"^drive.wave.period: 6.3e-08 s, with samples .* ns apart; they must be at"):
        Scene.model_validate(document)
    drive["wave"]["period"] = 6.4e-8 if not samples[1] else 1e-5
    if samples[1]:
        drive["friction_wave"]["period"] = 1e-5
    assert Scene.model_validate(document).drive.times.size == (65 if not samples[1] else 129)
