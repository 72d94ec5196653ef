"""Which change of the model would explain a misfit: score tests, one for each change.

A score test needs only the derivatives of the motion with respect to the change at the fit (C. R. Rao, Proc. Cambridge
Philos. Soc. 44 (1948) 50): residuals r and derivatives d, both whitened and free of what the fitted unknowns explain,
explain (d.r)^2 / d.d of the sum of squares, by an amount -d.r / d.d of the change.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from crawler_model.scene.scene import Scene

from ..fit.fit import Fit
from ..fit.misfit import Misfit
from ..fit.problem import Problem
from ..fit.space import Space
from ..measurements import interpolate_rows
from ..replica.changes import Change
from ..replica.replica import Replica
from .suspects import try_suspects
from .verdicts import Parameter

_ROWS = 3000
"""Rows of each recording on which changes are compared."""
_AT_ONCE = 16
_ONSETS = 6
_MOST = 3
_CLEAR = 30.0
"""Decrease of the sum of squares from which a change explains anything."""
_PART = 0.3
"""Part of the sum of squares from which a suspect explains anything."""
_OFTEN = 0.02
"""Part of the sum of squares that the best change explains below which it explains nothing."""


@dataclass(frozen=True)
class Explanation:
    """A change of the model or of a table that would explain a part of the misfit.

    Attributes:
        what: the change with its amount, in words.
        amount: of the change, relative to what is changed, or the number of a suspect [1 or s].
        explained: part of the sum of squares of the whitened residuals that it explains [1].
        moved: parameters whose values the change would move beyond their intervals, with their values then.
    """

    what: str
    amount: float
    explained: float
    moved: dict[str, float]


def explain_misfit(
    scene: Scene, problem: Problem, fit: Fit, misfits: Sequence[Misfit], width: np.ndarray, suspects: bool
) -> tuple[list[Explanation], list[str]]:
    """Test changes of the model, and try suspects.

    Args:
        scene: the scene that was fitted.
        misfits: of its channels.
        width: half widths of the intervals of the coordinates of the parameters, shape (P,); inf if unknown.
        suspects: whether suspects are tried, which takes up to half a minute.

    Returns:
        What explains most, the best one first; and what was not tried.
    """
    found = _test_changes(problem, fit, width)
    tried, untried = try_suspects(scene, problem, fit, misfits) if suspects else ([], [])
    found += [Explanation(one.what, one.amount, one.part, {}) for one in tried[:_MOST] if one.part > _PART]
    return sorted(found, key=lambda one: -one.explained)[:_MOST], untried


def _test_changes(problem: Problem, fit: Fit, width: np.ndarray) -> list[Explanation]:
    """Test changes of the model: links stiffer or stuck, friction that depends on place, time or direction, a lag."""
    thin = _thin(problem)
    base = thin.compute(fit.unknowns)
    if base is None:
        return []
    basis = _find_basis(base.jacobian)
    found: list[tuple[float, float, str, np.ndarray]] = []
    for names, columns in _differentiate(thin, fit.unknowns):
        own = columns - basis @ (basis.T @ columns)
        size = (own**2).sum(axis=0)
        score = own.T @ base.fitted
        for k, name in enumerate(names):
            if size[k] > 1e-8 * float(columns[:, k] @ columns[:, k]):
                found.append((float(score[k] ** 2 / size[k]), float(-score[k] / size[k]), name, columns[:, k]))
    found.sort(key=lambda one: -one[0])
    least = max(_CLEAR, _OFTEN * base.cost)
    kept: list[Explanation] = []
    subjects: set[str] = set()
    for gain, amount, name, column in found:
        subject = name.split(" from ")[0]
        if gain < least or len(kept) == _MOST:
            break
        if subject not in subjects:
            subjects.add(subject)
            moved = _find_moved(problem.space, fit, base.jacobian, amount * column, width)
            kept.append(Explanation(_describe(name, amount), amount, gain / base.cost, moved))
    return kept


def remark(parameter: Parameter, explanations: Sequence[Explanation]) -> Parameter:
    """Add to a verdict what a misfit could do to its value.

    Args:
        parameter: the parameter.
        explanations: of the misfit.

    Returns:
        The parameter; with a remark if one of the changes would move it beyond its interval.
    """
    for one in explanations:
        if parameter.name in one.moved:
            more = f"; but {one.moved[parameter.name]:.4g} if the misfit is {one.what}"
            return replace(parameter, why=parameter.why + more)
    return parameter


def _describe(name: str, amount: float) -> str:
    """Write a change with its amount."""
    return f"{name}: {amount:+.3g} ms" if name.startswith("a lag") else f"{name}: {100.0 * amount:+.3g} %"


def _thin(problem: Problem) -> Problem:
    """Build the problem with evenly spaced rows of each recording, with the noise that was found."""
    strides = [max(1, r.measured.time.size // _ROWS) for r in problem.replicas]
    if max(strides) == 1:
        return problem
    replicas = [
        r.showing(replace(r.measured, time=r.measured.time[::k], values=r.measured.values[::k]))
        for r, k in zip(problem.replicas, strides, strict=True)
    ]
    rows = [rows[::k] for rows, k in zip(problem.rows, strides, strict=True)]
    thin = Problem(replicas, rows, problem.space, problem.offset, problem.sensor)
    thin.set_noise(
        [
            [(channel.noise, channel.extra[channel.rows % k == 0]) for channel in channels]
            for channels, k in zip(problem.channels, strides, strict=True)
        ]
    )
    return thin


def _find_basis(jacobian: np.ndarray) -> np.ndarray:
    """Build an orthonormal basis of what the fitted unknowns explain, shape (R, B)."""
    size = np.linalg.norm(jacobian, axis=0)
    seen = size > 1e-12 * size.max(initial=0.0)
    left, values, _ = np.linalg.svd(jacobian[:, seen] / size[seen], full_matrices=False)
    return left[:, values > 1e-8 * values[0]] if values.size else left


def _find_moved(
    space: Space, fit: Fit, jacobian: np.ndarray, effect: np.ndarray, width: np.ndarray
) -> dict[str, float]:
    """Find the parameters that a change of this effect on the residuals would move beyond their intervals."""
    step = -np.linalg.lstsq(jacobian, effect, rcond=1e-8)[0][: width.size]
    coordinates = fit.unknowns[: width.size]
    values = space.to_values(coordinates + np.clip(step, -1.0, 1.0) * np.isfinite(width))
    return {space.names[p]: float(values[p]) for p in np.flatnonzero(np.abs(step) > width)}


def _differentiate(problem: Problem, unknowns: np.ndarray) -> Iterator[tuple[list[str], np.ndarray]]:
    """Compute the derivatives of the whitened residuals with respect to changes, some at a time, each (R, E)."""
    count = problem.space.origin.size
    values = problem.space.to_values(unknowns[:count])
    starts = [problem.start(unknowns, i) for i in range(len(problem.replicas))]
    lists = [_list_changes(problem, *pair, values) for pair in zip(problem.replicas, starts, strict=True)]
    names = [change.name for change in lists[0]]
    lags = "lag" not in problem.names
    for first in range(0, len(names), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        parts = []
        for i, replica in enumerate(problem.replicas):
            sensor = problem.sensed(unknowns, i)
            start, own = problem.start(unknowns, i), lists[i][some]
            predicted = replica.predict(values, sensor["lag"], sensor["gain"], False, own, start)
            if predicted is None:
                return
            scale = (1.0 + sensor["scale"] * replica.measured.on_ground)[:, None, None]
            parts.append(problem.project(i, predicted.jacobian[:, count : count + len(own)] * scale)[0].T)
            if first == 0 and lags:
                late = problem.project(i, -1e-3 * predicted.velocity.T[:, None])[0].T
                parts[-1] = np.hstack((parts[-1], late))
        size = sum(part.shape[0] for part in parts)
        left = problem.compute(unknowns)
        assert left is not None
        zeros = np.zeros((left.fitted.size - size, parts[0].shape[1]))
        more = ["a lag of the measurements"] if first == 0 and lags else []
        yield names[some] + more, np.concatenate([*parts, zeros])


def _list_changes(problem: Problem, replica: Replica, start: np.ndarray | None, values: np.ndarray) -> list[Change]:
    """List the changes of the model that are tested, the same ones for all recordings.

    Without recorded commands the drive has the waypoints of one period, and what depends on time or place has
    no effect.
    """
    found = replica.motion_at(values, start)
    if found is None:
        return []
    scene, x = found
    drive, columns, fitted = scene.drive, scene.drive.columns, problem.space.names
    time, zero = drive.times, np.zeros(drive.rows.shape)
    duration = float(replica.measured.time[-1])
    changes: list[Change] = []
    replayed = 1.0 if replica.measured.command_names else 0.0

    def change(name: str, column: int, factor: np.ndarray) -> Change:
        rows = zero.copy()
        rows[:, column] = replayed * factor * drive.rows[:, column]
        return Change(name, rows)

    for j in range(columns.lengths):
        label = columns.names[j]
        if not any("stiffness" in name for name in fitted) and columns.lengths == scene.body.springs:
            stiffness = np.zeros(scene.body.springs)
            stiffness[j] = scene.body.stiffness[j]
            changes.append(Change(f"stiffness of {label}", zero, stiffness))
        for onset in duration * np.arange(_ONSETS) / _ONSETS:
            held = drive.rows[int(np.searchsorted(time, onset).clip(0, time.size - 1)), j]
            rows = zero.copy()
            rows[:, j] = replayed * np.where(time >= onset, drive.rows[:, j] - held, 0.0)
            changes.append(Change(f"stroke of {label} from {onset:.3g} s on", rows))
    along = interpolate_rows(time, replica.measured.time, x)
    middle, half = 0.5 * (along.max(axis=0) + along.min(axis=0)), 0.5 * np.maximum(np.ptp(along, axis=0), 1e-12)
    for c in range(columns.lengths, columns.lengths + columns.frictions):
        label = columns.names[c].replace("/", " ")
        contact = int(label.split("_")[1].split()[0]) if "contact_" in label else None
        if not any(name.startswith("friction") for name in fitted):
            changes.append(change(f"friction of {label}", c, np.ones(time.size)))
        changes.append(change(f"friction of {label} over the recording", c, 2.0 * time / max(duration, 1e-12) - 1.0))
        if contact is not None and contact < along.shape[1]:
            place = (along[:, contact] - middle[contact]) / half[contact]
            changes.append(change(f"friction of {label} along its way", c, place))
    return changes
