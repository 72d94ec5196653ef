"""What sensors measure: the statistics of each of their errors, and equal numbers for equal seeds."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from crawler_model import Scene, SceneError
from crawler_model.scene.sensors import Sensors, SensorsPart

UNITS = ("m", "m", "rad", "N", "")
NS = 10**9
TICK = NS // 100


def measure(count: int = 5000, seed: int | None = None, truth: float = 0.0, **given):
    sensors = Sensors(SensorsPart(**given), UNITS)
    if seed is not None:
        sensors.restart(seed)
    readings = np.full(len(UNITS), truth)
    return [(k * TICK, m) for k in range(count) for m in sensors.measure(k * TICK, readings)]


def values(found) -> np.ndarray:
    return np.array([m.values for _, m in found])


def test_without_errors_they_measure_the_truth_at_each_tick():
    found = measure(50, truth=0.1)
    assert [(now, m.ns) for now, m in found] == [(k * TICK, k * TICK) for k in range(50)]
    assert (values(found) == 0.1).all()
    assert not any(m.rates.any() for _, m in found)


def test_each_unit_has_noise_of_its_own():
    spread = values(measure(noise=1e-3, angle_noise=0.02, force_noise=0.5)).std(axis=0)
    assert spread[:4] == pytest.approx([1e-3, 1e-3, 0.02, 0.5], rel=0.05)
    assert spread[4] == 0.0


def test_drift_is_slow_and_of_lengths_only():
    """The correlation of an Ornstein-Uhlenbeck process falls to 1/e in its time."""
    drift = values(measure(80_000, drift=2e-3, drift_time=0.1))
    assert not drift[:, 2:].any()
    assert drift[:, 0].std() == pytest.approx(2e-3, rel=0.05)
    lag = 10  # ticks, a tenth of a second
    assert np.corrcoef(drift[:-lag, 0], drift[lag:, 0])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.05)
    assert abs(np.corrcoef(drift[:, 0], drift[:, 1])[0, 1]) < 0.1


def test_pixels_round_what_noise_and_drift_make():
    lengths = values(measure(noise=1e-3, pixel=5e-4))[:, :2]
    assert lengths / 5e-4 == pytest.approx(np.rint(lengths / 5e-4), abs=1e-9)
    assert len(np.unique(lengths)) > 5


def test_a_delay_keeps_the_time_of_the_measurement():
    found = measure(50, delay=0.035)
    assert all(now - m.ns == 4 * TICK for now, m in found)  # the first tick that is late enough
    assert found[0][1].ns == 0


@pytest.mark.parametrize("rate", [30.0, 29.97, 100.0, 250.0])
def test_a_rate_measures_so_often_and_never_twice_in_a_tick(rate):
    times = [m.ns for _, m in measure(1000, rate=rate)]
    assert len(times) == pytest.approx(min(rate, 100.0) * 10.0, abs=1)
    assert len(set(times)) == len(times)


def test_the_start_is_never_lost_and_of_the_others_a_fraction():
    found = measure(dropped=0.3)
    assert found[0][1].ns == 0
    assert 1.0 - len(found) / 5000 == pytest.approx(0.3, abs=0.03)
    assert len(measure(dropped=1.0)) == 1


def test_rates_are_differences_of_what_was_measured():
    found = [m for _, m in measure(200, noise=1e-3, angle_noise=0.01, force_noise=1.0, dropped=0.2)]
    for before, after in itertools.pairwise(found):
        expected = (after.values - before.values) / ((after.ns - before.ns) / NS)
        assert after.rates[:3] == pytest.approx(expected[:3], rel=1e-12)
        assert not after.rates[3:].any()


def test_an_angle_that_passes_half_a_turn_goes_on():
    sensors = Sensors(SensorsPart(), ("rad",))
    sensors.measure(0, np.array([3.1]))
    (found,) = sensors.measure(TICK, np.array([-3.1]))
    assert found.rates[0] == pytest.approx((2.0 * np.pi - 6.2) / 0.01)


def test_equal_seeds_measure_alike_to_the_bit_and_others_do_not():
    given = {"noise": 1e-3, "drift": 1e-3, "dropped": 0.1, "rate": 30.0}
    one, again, other = (values(measure(seed=s, **given)) for s in (3, 3, 4))
    assert one.tobytes() == again.tobytes() == values(measure(**given | {"seed": 3})).tobytes()
    assert one.tobytes() != other.tobytes()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"dropped": 1.5}, "dropped: 1.5; it must be at most 1"),
        ({"noise": -1.0}, "noise: -1; it must be at least 0"),
        ({"drift_time": 0.0}, "drift_time: 0; it must be above 0"),
        ({"seed": 0.5}, "0.5 is not a whole number"),
        ({"pixels": 1.0}, "the nearest known key is 'pixel'"),
    ],
)
def test_a_mistake_in_a_scene_is_named(given, said):
    body = {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}}
    document = {"name": "s", "body": body, "friction": {"forward": 1.0, "backward": 1.0}}
    with pytest.raises(SceneError, match="sensors") as error:
        Scene.model_validate(document | {"sensors": given})
    assert said in str(error.value)


def test_a_delay_of_whole_ticks_arrives_on_its_tick() -> None:
    """0.067 s is a little more than 67 000 000 ns in floating point, and arrived a tick late."""
    for milliseconds in range(1, 1000):
        sensors = Sensors(SensorsPart(delay=milliseconds / 1000), UNITS)
        readings = np.zeros(len(UNITS))
        sensors.measure(0, readings)
        assert len(sensors.measure(milliseconds * 1_000_000, readings)) == 1, milliseconds
