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
_STEP = 1e-6
"""Step of differences in time [s]."""
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

    start = _reach_limits(seen, space, start) if limited else start
    balance = Balance(seen, space, sensor)
    count, first = space.origin.size, balance.begin(start)
    if first is None or not np.isfinite(balance.errors(first)).all():
        return None
    wide = np.full(first.size - count - 1, np.inf)
    low = np.concatenate((space.to_coordinates(space.low), [-_WIDEST], -wide))
    high = np.concatenate((space.to_coordinates(space.high), [_WIDEST], wide))
    options: Any = {"loss": "soft_l1", "f_scale": 0.02, "max_nfev": 60, "x_scale": 1.0}
    options["jac"] = balance.slopes if all(one.replica.is_affine for one in seen) else "2-point"
    try:
        found: Any = least_squares(balance.errors, np.clip(first, low, high), bounds=(low, high), **options)
    except ValueError:  # a difference stepped to values that are not valid
        return None
    slides = np.concatenate([*(one.sliding.ravel() != 0 for one in seen), np.zeros(first.size, np.bool_)])
    jacobian, coordinates = np.abs(found.jac[slides, :count]), found.x[:count]
    loose = space.logarithmic & (jacobian.max(axis=0) <= _LOOSE * jacobian.max())
    values = space.to_values(np.minimum(np.where(loose, coordinates + np.log(_MORE), coordinates), high[:count]))
    starts = [one.first + balance.shift(found.x, k) for k, one in enumerate(seen)]
    return values, balance.lag(found.x), starts


class Balance:
    """By how much contacts are out of balance, relative to the mean force, as a function of unknowns.

    These are the coordinates of the parameters, the lag in units of its deviation, and the shifts of the contacts of
    recordings whose start is unknown against the first contact, in units of the motion.
    """

    def __init__(self, seen: list[Seen], space: Space, sensor: Sensor) -> None:
        """Count the unknowns.

        Args:
            seen: the recordings.
            sensor: the prior of the lag.
        """
        self._seen, self._space, (self._mean, self._deviation) = seen, space, sensor.lag
        self._origin, self._begun = space.to_coordinates(space.origin), space.origin.size + 1
        self._spread = [float(np.ptp(one.x)) for one in seen]
        self._ends = np.cumsum([0, *(one.x.shape[1] - 1 if one.replica.starts else 0 for one in seen)])
        self._size = sum(one.x.size for one in seen) + self._begun + int(self._ends[-1])

    def _own(self, k: int) -> slice:
        """Select the unknown shifts of a recording."""
        return slice(self._begun + self._ends[k], self._begun + self._ends[k + 1])

    def begin(self, start: np.ndarray) -> np.ndarray | None:
        """Build the unknowns at which springs are relaxed in the first rows.

        Args:
            start: values of the parameters, shape (P,).

        Returns:
            Shape (U,); None if the values are not valid.
        """
        found = np.concatenate((self._space.to_coordinates(start), np.zeros(1 + self._ends[-1])))
        for k, one in enumerate(self._seen):
            if one.replica.starts:
                at = one.replica.displacement_at_start(start)
                if at is None:
                    return None
                apart = (at - at[0]) - (one.first - one.first[0])
                found[self._own(k)] = apart[1:] / self._spread[k]
        return found

    def lag(self, unknowns: np.ndarray) -> float:
        """Read the lag.

        Args:
            unknowns: all unknowns, shape (U,).

        Returns:
            The lag [s].
        """
        return self._mean + self._deviation * float(unknowns[self._begun - 1])

    def shift(self, unknowns: np.ndarray, k: int) -> np.ndarray:
        """Read by how much the contacts of a recording are displaced against the first one.

        Args:
            unknowns: all unknowns, shape (U,).
            k: number of the recording.

        Returns:
            Shape (N,) [m].
        """
        own = unknowns[self._own(k)]
        return np.append(0.0, self._spread[k] * own) if own.size else np.zeros(self._seen[k].x.shape[1])

    def errors(self, unknowns: np.ndarray) -> np.ndarray:
        """Compute the errors.

        Returns:
            Of all recordings, then small ones of the unknowns themselves, shape (R,); infinite at values that are not
            valid.
        """
        values = self._space.to_values(unknowns[: self._begun - 1])
        parts = [
            _errors(one, one.replica.balance(values, one.time - self.lag(unknowns), one.x + self.shift(unknowns, k)))
            for k, one in enumerate(self._seen)
        ]
        if any(part is None for part in parts):
            return np.full(self._size, np.inf)
        away = np.concatenate((unknowns[: self._begun - 1] - self._origin, unknowns[self._begun - 1 :]))
        return np.concatenate([*parts, _TOWARDS_ORIGIN * away])  # type: ignore[list-item]

    def slopes(self, unknowns: np.ndarray) -> np.ndarray:
        """Differentiate the errors of replicas that are affine.

        Returns:
            Shape (R, U).
        """
        count, lag = self._begun - 1, self.lag(unknowns)
        values = self._space.to_values(unknowns[:count])
        slope, found, first = self._space.slope(values), np.zeros((self._size, unknowns.size)), 0
        for k, one in enumerate(self._seen):
            time, x = one.time - lag, one.x + self.shift(unknowns, k)
            forces = one.replica.balance(values, time, x)
            assert forces is not None  # errors were finite there
            early = one.replica.balance(values, time - _STEP, x)
            assert early is not None
            d_force, d_bounds, d_shift = one.replica.balance_slopes(values, time, x)
            rows = np.zeros((*x.shape, unknowns.size)), np.zeros((2, *x.shape, unknowns.size))
            rows[0][..., :count], rows[1][..., :count] = d_force * slope, d_bounds[:, None] * slope
            late = self._deviation / _STEP
            rows[0][..., count] = (early[0] - forces[0]) * late
            rows[1][..., count] = (np.array(early[1:]) - np.array(forces[1:])) * late
            own = self._own(k)
            rows[0][..., own] = d_shift[:, 1:][:, : own.stop - own.start] * self._spread[k]
            found[first : first + x.size] = _slope_errors(one, forces, *rows)
            first += x.size
        found[first:] = _TOWARDS_ORIGIN * np.eye(unknowns.size)
        return found


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


def _errors(seen: Seen, forces: tuple[np.ndarray, ...] | None) -> np.ndarray | None:
    """Compute by how much each contact is out of balance, relative to the mean force, shape (T N,)."""
    if forces is None:
        return None
    force, forward, backward = forces
    ahead, behind = forward - force, backward + force
    wrong = np.minimum(ahead, 0.0) - np.minimum(behind, 0.0)
    wrong = np.where(seen.sliding > 0, ahead, np.where(seen.sliding < 0, -behind, wrong))
    return np.asarray(wrong / max(float(np.abs(force).mean()), 1e-300)).ravel()


def _slope_errors(seen: Seen, forces: tuple[np.ndarray, ...], d_force: np.ndarray, d_bounds: np.ndarray) -> np.ndarray:
    """Differentiate these errors, given the derivatives of forces and of both bounds, shape (T N, U)."""
    force, forward, backward = forces
    ahead = (seen.sliding > 0) | ((seen.sliding == 0) & (force > forward))
    behind = (seen.sliding < 0) | ((seen.sliding == 0) & (force < -backward))
    wrong = ahead[..., None] * (d_bounds[0] - d_force) - behind[..., None] * (d_bounds[1] + d_force)
    mean = max(float(np.abs(force).mean()), 1e-300)
    d_mean = np.mean(np.sign(force)[..., None] * d_force, axis=(0, 1))
    errors = _errors(seen, forces)
    assert errors is not None
    return np.asarray((wrong.reshape(errors.size, -1) - errors[:, None] * d_mean) / mean)
