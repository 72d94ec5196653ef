"""A first estimate from the balance of forces, without following any motion.

Measured positions determine the elongation of every spring and so, for given parameters, the force of the springs on
every contact: it equals a bound where the contact is seen to slide, and lies between both bounds where it rests. Unlike
the residuals of a motion, which jump where another contact starts to hold the body, these errors are smooth in the
parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..replica.knots import find_limits
from ..replica.replica import Replica
from ..sensor.noise import find_floor, find_pixel, guess_noise
from ..sensor.sensor import Sensor
from .space import Space

_MOST_ROWS = 400
_SLIDES = 0.2
"""A contact slides where it moves by this part of the largest step of any contact, before and after a row."""
_CLEAR = 30.0
"""The largest step of any contact between rows that are compared, in units of the noise."""
_NOISE = 4.0
"""Steps of this many times the noise are no rest."""
_LOOSE = 1e-4
_MORE = 1.5
"""Factor for bounds at which no contact slides, as the balance only tells what they held."""
_INSIDE = 0.2
"""Part of the largest tension or elongation by which a limit is moved to where it is reached."""
_WIDEST = 3.0
"""Standard deviations of the lag within which it is searched."""
_TOWARDS_ORIGIN = 1e-3
"""Weight that fixes the scale where only ratios follow from the balance."""


@dataclass(frozen=True)
class Seen:
    """What a recording shows about sliding.

    Attributes:
        replica: the recording.
        time: shape (T,) [s].
        x: displacement, but for a common shift, shape (T, N) [m].
        sliding: 1 forward, -1 backward, 0 at rest, shape (T, N).
        first: displacement in the first row, shape (N,) [m].
    """

    replica: Replica
    time: np.ndarray
    x: np.ndarray
    sliding: np.ndarray
    first: np.ndarray


def see(replica: Replica, rows: np.ndarray) -> Seen | None:
    """Find which contacts slide when.

    Args:
        replica: the recording.
        rows: the rows to use, bool, shape (T,).

    Returns:
        What is seen; None if the measurements do not determine the position of every contact, or the body is not on a
        line on ground that is the same everywhere.
    """
    if replica.derivative_error:
        return None
    matrix, added = replica.observation
    rows = rows & np.isfinite(replica.measured.values).all(axis=1)
    if np.linalg.matrix_rank(matrix) < matrix.shape[1] or rows.sum() < 3:
        return None
    values, time = replica.measured.values[rows], replica.measured.time[rows]
    noise = max(guess_noise(column, find_pixel(column), find_floor(values))[0].white for column in values.T)
    x = (values - added) @ np.linalg.pinv(matrix).T
    stride, first = 1, x[0]
    while np.abs(np.diff(x[::stride], axis=0)).max() < _CLEAR * noise and time.size > 100 * stride:
        stride *= 2
    x, time = x[::stride], time[::stride]
    step = np.diff(x, axis=0)
    least = max(_SLIDES * float(np.abs(step).max()), _NOISE * noise)
    before, after = step[:-1], step[1:]
    sliding = np.where((before > least) & (after > least), 1, 0) - np.where((before < -least) & (after < -least), 1, 0)
    rest = (np.abs(before) < least) & (np.abs(after) < least)
    some = (sliding != 0).any(axis=1) | rest.all(axis=1)
    keep = np.flatnonzero(some)
    keep = keep[:: max(1, keep.size // _MOST_ROWS)]
    if not (sliding != 0).any():
        return None
    return Seen(replica, time[1:-1][keep], x[1:-1][keep], sliding[keep], first)


def estimate(
    seen: list[Seen], space: Space, start: np.ndarray, sensor: Sensor, limited: bool
) -> tuple[np.ndarray, float, list[np.ndarray]] | None:
    """Estimate the parameters from the balance of forces.

    Where the start is unknown, so is the place of each contact against the next one.

    Args:
        seen: the recordings.
        start: their first values, shape (P,).
        sensor: the prior of the lag.
        limited: whether limits that no spring reaches are moved to where one does.

    Returns:
        Their values, shape (P,), the lag [s], and the displacement at the start of each recording, shape (N,) [m]; None
        if the arrays of the scene are not valid at the start.
    """
    from scipy.optimize import least_squares  # loads in 0.2 s

    origin = space.to_coordinates(space.origin)
    start = _reach_limits(seen, space, start) if limited else start

    mean, deviation = sensor.lag
    spread = [float(np.ptp(one.x)) for one in seen]
    ends = np.cumsum([0, *(one.x.shape[1] - 1 if one.replica.starts else 0 for one in seen)])
    begun = origin.size + 1

    def shift(unknowns: np.ndarray, k: int) -> np.ndarray:
        """Read by how much the contacts of a recording are displaced against the first one, shape (N,) [m]."""
        own = unknowns[begun + ends[k] : begun + ends[k + 1]]
        return np.append(0.0, spread[k] * own) if own.size else np.zeros(seen[k].x.shape[1])

    def errors(unknowns: np.ndarray) -> np.ndarray:
        coordinates = unknowns[: origin.size]
        values, lag = space.to_values(coordinates), mean + deviation * float(unknowns[begun - 1])
        parts = [_errors(one, values, lag, shift(unknowns, k)) for k, one in enumerate(seen)]
        if any(part is None for part in parts):
            return np.full(size, np.inf)
        away = np.concatenate((coordinates - origin, unknowns[begun - 1 :]))
        return np.concatenate([*parts, _TOWARDS_ORIGIN * away])  # type: ignore[list-item]

    size = sum(one.x.size for one in seen) + begun + int(ends[-1])
    wide = np.full(ends[-1], np.inf)
    first = np.concatenate((space.to_coordinates(start), [0.0], np.zeros(ends[-1])))
    for k, one in enumerate(seen):
        if one.replica.starts:  # as if the springs were relaxed in the first row
            at = one.replica.relaxed(start)
            if at is None:
                return None
            apart = (at - at[0]) - (one.first - one.first[0])
            first[begun + ends[k] : begun + ends[k + 1]] = apart[1:] / spread[k]
    if not np.isfinite(errors(first)).all():
        return None
    low = np.concatenate((space.to_coordinates(space.low), [-_WIDEST], -wide))
    high = np.concatenate((space.to_coordinates(space.high), [_WIDEST], wide))
    options: Any = {"loss": "soft_l1", "f_scale": 0.02, "max_nfev": 60, "x_scale": 1.0}
    try:
        found: Any = least_squares(errors, np.clip(first, low, high), "2-point", bounds=(low, high), **options)
    except ValueError:  # a difference stepped to values that are not valid
        return None
    slides = np.concatenate([*(one.sliding.ravel() != 0 for one in seen), np.zeros(begun + int(ends[-1]), np.bool_)])
    jacobian, coordinates = np.abs(found.jac[slides, : origin.size]), found.x[: origin.size]
    loose = space.logarithmic & (jacobian.max(axis=0) <= _LOOSE * jacobian.max())
    values = space.to_values(np.minimum(np.where(loose, coordinates + np.log(_MORE), coordinates), high[: origin.size]))
    starts = [one.first + shift(found.x, k) for k, one in enumerate(seen)]
    return values, mean + deviation * float(found.x[begun - 1]), starts


def _reach_limits(seen: list[Seen], space: Space, start: np.ndarray) -> np.ndarray:
    """Move limits and knots that no spring passes to where one does: beyond, they have no effect on the balance."""
    values = start.copy()
    for one in seen:
        found = one.replica.ways(start, one.time, one.x)
        if found is None:
            return start
        limits = find_limits(start, *found)
        for (p, at_least), limit in limits.items():
            if (p, not at_least) not in limits and np.isfinite(limit.value):
                inside = limit.value - _INSIDE * abs(limit.value) * (1.0 if at_least else -1.0)
                values[p] = min(inside, values[p]) if at_least else max(inside, values[p])
    return np.clip(values, space.low, space.high)


def _errors(seen: Seen, values: np.ndarray, lag: float, shift: np.ndarray) -> np.ndarray | None:
    """Compute by how much each contact is out of balance, relative to the mean force, shape (T N,)."""
    found = seen.replica.balance(values, seen.time - lag, seen.x + shift)
    if found is None:
        return None
    force, forward, backward = found
    ahead, behind = forward - force, backward + force
    wrong = np.minimum(ahead, 0.0) - np.minimum(behind, 0.0)
    wrong = np.where(seen.sliding > 0, ahead, np.where(seen.sliding < 0, -behind, wrong))
    return np.asarray(wrong / max(float(np.abs(force).mean()), 1e-300)).ravel()
