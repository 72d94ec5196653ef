"""How well a fit predicts the rows that were not fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..fit.fit import Fit
from ..fit.problem import Problem, Residuals
from ..sensor.noise import find_spikes
from .verdicts import Parameter

_BAND = 1.96


@dataclass(frozen=True)
class HeldOut:
    """The score of the rows that were held out.

    Attributes:
        residual: root mean square of their residuals [m].
        coverage: part of them within the 95 % bands of the prediction, single outliers aside [1].
        size: root mean square in units of the predicted standard deviations, single outliers aside [1].
        gain_error: error of the net translation over these rows, of the recording where it is largest, relative to the
            measured one [1]; None without positions, or where there is none.
        worst: where the largest residual is, in words.
        errors: simulated minus measured, with offsets fitted also to recordings without a fitted row, for each
            recording, shape (T, M) [m]; NaN where nothing is measured.
        deviations: their predicted standard deviations, for each recording, shape (T, M) [m]; empty, shape (0, M), if
            all its rows were fitted.
    """

    residual: float
    coverage: float
    size: float
    gain_error: float | None
    worst: str
    errors: tuple[np.ndarray, ...] = field(compare=False, repr=False)
    deviations: tuple[np.ndarray, ...] = field(compare=False, repr=False)


def score_held_out(
    problem: Problem, fit: Fit, covariance: np.ndarray, parameters: Sequence[Parameter]
) -> HeldOut | None:
    """Score the rows that were not fitted.

    Args:
        parameters: with their verdicts. Where only a bound is known, held-out rows may lie between the paths at the
            bound and at the fit.

    Returns:
        The score; None if no row was held out.
    """
    errors, scaled, gains = [], [], []
    at_bounds = _compute_at_bounds(problem, fit, parameters)
    all_residuals, deviations = list(fit.residuals.all), [residuals[:0] for residuals in fit.residuals.all]
    worst, largest = "", 0.0
    for i, replica in enumerate(problem.replicas):
        measured = replica.measured
        out = np.isfinite(measured.values) & ~problem.rows[i][:, None]
        if not out.any():
            continue
        error = fit.residuals.all[i]
        if not problem.rows[i].any():
            error = error - _find_common(problem.designs[i][:, :, : problem.offsets[i]], error, out)
        moved = 0.0 if at_bounds is None else np.nan_to_num(at_bounds.all[i] - fit.residuals.all[i])
        deviation = np.sqrt(_find_variance(problem, fit, i, covariance) + moved**2)
        all_residuals[i], deviations[i] = error, deviation
        errors.append(error[out])
        scaled.append(_without_spikes(error / deviation, out))
        gains += _find_gain_errors(measured.values, error, out[:, measured.on_ground].all(axis=1), measured.on_ground)
        row, column = np.unravel_index(int(np.where(out, np.abs(error / deviation), 0.0).argmax()), out.shape)
        if abs(error[row, column] / deviation[row, column]) > largest:
            largest = abs(error[row, column] / deviation[row, column])
            worst = (
                f"{measured.name}: held-out rows, largest in {measured.channels[column]} at "
                f"{measured.time[row]:.4g} s, {abs(error[row, column]):.3g} m"
            )
    if not errors:
        return None
    all_errors, sizes = np.concatenate(errors), np.concatenate(scaled)
    return HeldOut(
        float(np.sqrt(np.mean(all_errors**2))),
        float(np.mean(np.abs(sizes) <= _BAND)),
        float(np.sqrt(np.mean(sizes**2))),
        max(gains, key=abs) if gains else None,
        worst,
        tuple(all_residuals),
        tuple(deviations),
    )


def _compute_at_bounds(problem: Problem, fit: Fit, parameters: Sequence[Parameter]) -> Residuals | None:
    """Compute the residuals with all bounded parameters at their bounds; None if there are none."""
    bounds = {p: parameter.value for p, parameter in enumerate(parameters) if parameter.verdict == "bound"}
    if not bounds:
        return None
    values = problem.space.to_values(fit.unknowns[: len(parameters)])
    values[list(bounds)] = list(bounds.values())
    return problem.compute(np.concatenate((problem.space.to_coordinates(values), fit.unknowns[len(parameters) :])))


def _without_spikes(scaled: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Select the residuals of rows that were held out, without single outliers, which no model predicts."""
    found = [column[rows] for column, rows in zip(scaled.T, out.T, strict=True) if rows.any()]
    return np.concatenate([values[~find_spikes(values, 1.0)] for values in found])


def _find_variance(problem: Problem, fit: Fit, i: int, covariance: np.ndarray) -> np.ndarray:
    """Compute the variance of the residuals of a recording, from noise, unknowns and drifts, shape (T, M)."""
    raw = problem.differentiate(fit.unknowns, i)
    names = [*range(problem.space.origin.size), *problem.places(i)]
    jacobian = raw - np.einsum("tmq,qu->mut", problem.designs[i], problem.project(i, raw)[1])
    own = covariance[np.ix_(names, names)]
    variance = np.einsum("mut,uv,mvt->tm", jacobian, own, jacobian, optimize=True)
    # offsets and drifts follow from few independent numbers where noise is slow: their own uncertainty
    design, gram = problem.designs[i], problem.grams[i]
    variance += np.einsum("tmq,qr,tmr->tm", design, np.linalg.pinv(gram), design, optimize=True)
    return np.asarray(variance + np.array([channel.noise.size**2 for channel in problem.channels[i]]))


def _find_common(offsets: np.ndarray, error: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Compute the part of residuals that offsets explain, of a recording that was not fitted, shape (M,)."""
    if offsets.shape[2] == 0:
        return np.zeros(error.shape[1])
    return np.asarray(offsets[0] @ np.linalg.lstsq(offsets[out], error[out], rcond=None)[0])


def _find_gain_errors(values: np.ndarray, error: np.ndarray, out: np.ndarray, ground: np.ndarray) -> list[float]:
    """Compute the relative error of the net translation over rows that were not fitted."""
    rows = np.flatnonzero(out)
    if not ground.any() or rows.size < 2:
        return []
    edge = max(1, rows.size // 50)
    first, last = rows[:edge], rows[-edge:]
    moved = float(values[last][:, ground].mean() - values[first][:, ground].mean())
    wrong = float(error[last][:, ground].mean() - error[first][:, ground].mean())
    return [wrong / moved] if abs(moved) > 0.05 * float(np.nanmax(np.ptp(values[rows][:, ground], axis=0))) else []
