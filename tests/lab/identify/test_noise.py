"""Noise of measurements: its covariance, its estimate, and what rests and cycles show of it."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg.lapack

from crawler_lab.identify.sensor.noise import (
    Noise,
    build_whitening,
    estimate_noise,
    find_noise_at_rest,
    find_noise_of_cycles,
    find_pixel,
    find_rounding,
    find_spikes,
    guess_noise,
)

SOME = Noise(2e-4, 5e-4, 0.3)


def covariance(noise: Noise, time: np.ndarray, extra: np.ndarray) -> np.ndarray:
    """The dense covariance of white noise and an Ornstein-Uhlenbeck process."""
    slow = noise.slow**2 * np.exp(-np.abs(time[:, None] - time) / noise.time)
    return slow + np.diag(noise.white**2 + extra)


def draw(noise: Noise, time: np.ndarray, rng: np.random.Generator, count: int = 1) -> np.ndarray:
    factor = np.linalg.cholesky(covariance(noise, time, np.zeros(time.size)))
    return factor @ rng.normal(size=(time.size, count))


@pytest.mark.parametrize("noise", [SOME, Noise(1e-3), Noise(1e-6, 5e-4, 0.02), Noise(1e-4, 1e-2, 50.0)])
def test_whitened_noise_has_the_inverse_covariance(noise: Noise) -> None:
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(0.01, 0.1, 60))  # with gaps
    extra = np.where(rng.random(60) < 0.1, 1e-5, 0.0)
    dense = covariance(noise, time, extra)
    whitening = build_whitening(noise, time, extra)
    whitened = whitening.apply(np.eye(60)).T
    assert whitened.T @ whitened @ dense == pytest.approx(np.eye(60), abs=1e-8)
    assert whitening.log_determinant == pytest.approx(np.linalg.slogdet(dense)[1], abs=1e-9)


@pytest.mark.parametrize("shape", [(0, 60), (3, 0)])
def test_nothing_is_whitened_without_lapack(shape: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """LAPACK's dtbtrs writes beyond empty arrays, and the process ends long after that, wherever it is."""
    monkeypatch.setattr(scipy.linalg.lapack, "dtbtrs", None)
    whitening = build_whitening(SOME, np.arange(shape[1]) / 50.0, np.zeros(shape[1]))
    assert whitening.apply(np.zeros(shape)).shape == shape


@pytest.mark.parametrize("noise", [SOME, Noise(3e-4), Noise(5e-5, 3e-4, 0.2)])
def test_noise_is_estimated_despite_outliers(noise: Noise) -> None:
    rng = np.random.default_rng(2)
    time = np.arange(1500) / 50.0
    residuals = draw(noise, time, rng)[:, 0]
    spoilt = residuals + np.where(rng.random(1500) < 0.01, rng.choice([-0.02, 0.02], 1500), 0.0)
    for values in (residuals, spoilt):
        found, extra = estimate_noise(time, values, 0.0, 1e-6)
        assert found.size == pytest.approx(noise.size, rel=0.15)
        if noise.slow:
            assert found.time == pytest.approx(noise.time, rel=0.5)
        else:
            assert found.slow < 0.3 * found.size
        assert (extra > 0.0).mean() < 0.06
    assert (extra[np.abs(spoilt) > 0.01] > 1e-5).all()


def test_exact_residuals_have_the_floor() -> None:
    time = np.arange(200) / 50.0
    found, extra = estimate_noise(time, 1e-13 * np.sin(time), 0.0, 1e-6)
    assert found == Noise(1e-6)
    assert not extra.any()


def test_pixels_are_found() -> None:
    rng = np.random.default_rng(3)
    x = 0.1 * np.sin(np.arange(800) / 30.0) + 0.3
    assert find_pixel(5e-4 * np.rint(x / 5e-4) + 1.23e-4) == pytest.approx(5e-4)
    assert find_pixel(1e-5 * np.rint(x / 1e-5)) == pytest.approx(1e-5)  # most values differ
    assert find_pixel(x) == 0.0
    assert find_pixel(x[:4]) == find_pixel(np.array([0.1, 0.1 + 3e-5, 0.1 + 9e-5])) == 0.0
    assert find_pixel(np.round(x + 2e-4 * rng.normal(size=800), 9)) == 0.0
    assert find_pixel(np.full(800, 0.1)) == 0.0


def test_the_covariance_of_rounding_is_that_of_many_cameras() -> None:
    """Rounding errors of one motion under cameras whose pixels lie elsewhere, against the sum of their harmonics."""
    rng = np.random.default_rng(4)
    time = np.arange(400) / 50.0
    x = np.where(np.sin(3.0 * time) > 0.0, 0.004 * time, 0.004 * np.floor(time))
    jacobian = np.column_stack((np.sin(time), np.cos(2.0 * time), time))
    pixel = 5e-4
    shift = rng.uniform(0.0, pixel, 4000)[:, None]
    error = pixel * np.rint((x + shift) / pixel) - shift - x
    scores = error @ jacobian
    white = float(np.sqrt(np.mean(error**2)))
    found = find_rounding(Noise(white, pixel=pixel), x / pixel, jacobian) * white**2
    assert found == pytest.approx(np.cov(scores.T), rel=0.12, abs=0.05 * np.abs(found).max())
    assert found.max() > 2.0 * white**2 * (jacobian.T @ jacobian).max()  # it is far from white


def test_rests_and_cycles_show_noise_whatever_the_model_misses() -> None:
    rng = np.random.default_rng(5)
    time = np.arange(800) / 50.0
    noise = Noise(2e-4, 1.5e-4, 0.05)
    sensor = draw(noise, time, rng)[:, 0]
    phase = time % 2.0
    rest = phase < 1.0
    missed = 5e-3 * np.sin(np.pi * np.maximum(phase - 1.0, 0.0)) + 2e-3 * np.floor(time / 2.0)
    assert find_noise_at_rest(sensor + missed, rest) == pytest.approx(noise.size, rel=0.25)
    assert find_noise_of_cycles(time, sensor + missed, 2.0) == pytest.approx(noise.size, rel=0.25)
    assert find_noise_at_rest(sensor, np.zeros(800, np.bool_)) is None
    assert find_noise_of_cycles(time, sensor, 10.0) is None


def test_spikes_are_single_values() -> None:
    rng = np.random.default_rng(6)
    residuals = 2e-4 * rng.normal(size=600)
    residuals[300:] += 0.05  # a step is no spike
    residuals[[50, 400]] += 0.01
    assert np.flatnonzero(find_spikes(residuals, 1e-6)).tolist() == [50, 400]
    noise, extra = guess_noise(residuals, 0.0, 1e-6)
    assert noise.white == pytest.approx(2e-4, rel=0.2)
    assert set(np.flatnonzero(extra > 0.0)) == {50, 400}
