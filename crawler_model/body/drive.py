"""Open-loop commands: waypoints with linear interpolation, waves, and the strategies of [G] section 5.2."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import frozen
from .columns import Columns

NS = 1_000_000_000
"""Nanoseconds in a second. Waypoint times are whole nanoseconds; the commands there are not rounded."""


@dataclass(frozen=True, eq=False)
class Drive:
    """A piecewise linear path of commands.

    Variations have a leading axis in what varies: times (M, W), period (M, 1), rows (M, W, C).

    Attributes:
        times: waypoint times, increasing from 0, shape (W,) [s].
        period: the waypoints repeat after it [s]; None plays them once and then holds the last one.
        rows: command rows, shape (W, C).
        columns: layout of a row.
    """

    times: np.ndarray
    period: float | None
    rows: np.ndarray
    columns: Columns

    @functools.cached_property
    def targets(self) -> np.ndarray:
        """Targets at the waypoints, shape (W, S + 2 N)."""
        return frozen(self.columns.target(self.rows))

    @property
    def holds(self) -> bool:
        """Whether the command never changes, because there is a single waypoint."""
        return self.times.shape[-1] == 1

    @property
    def actuation(self) -> np.ndarray:
        """L of each spring, shape (W, S); in the plane x and y of each spring in turn, shape (W, 2 S) [m]."""
        return self.targets[..., : self._springs]

    @property
    def forward(self) -> np.ndarray:
        """The forward bound of each contact, mu_plus less the load, shape (W, N) [N]; for bodies on a line."""
        self.columns.check_two_sided("forward")
        return self.targets[..., self._springs : self._springs + self._contacts]

    @property
    def backward(self) -> np.ndarray:
        """The backward bound of each contact, mu_minus plus the load, shape (W, N) [N]; for bodies on a line."""
        self.columns.check_two_sided("backward")
        return self.targets[..., self._springs + self._contacts :][..., : self._contacts]

    @property
    def loads(self) -> np.ndarray:
        """The load on each contact, the slope's share included, shape (W, N), in the plane (W, 2 N), or (W, 0) [N]."""
        slope_load, size = self.columns.slope_load, 0
        if slope_load is not None:
            size = slope_load.shape[-1] if self.columns.planar is None else slope_load.size
        return self.targets[..., self.targets.shape[-1] - size :]

    @functools.cached_property
    def _springs(self) -> int:
        return int((self.columns.index < self.columns.lengths).sum())

    @property
    def _contacts(self) -> int:
        return (self.columns.index.size - self._springs) // (2 if self.columns.slope_load is None else 3)

    def waypoints_between(self, after_ns: int, until_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """Find the waypoints in a time interval.

        Args:
            after_ns: open start of the interval [ns], >= -1.
            until_ns: closed end of the interval [ns].

        Returns:
            Their times [ns], int64, and their row indices, each of shape (K,). The end of a period and the start of
            the next one are the same waypoint, the first row.
        """
        if self.period is None:
            found = np.rint(self.times * NS).astype(np.int64)
            rows = np.arange(found.size)
        else:
            rows = np.flatnonzero(self.times < self.period)
            span = self.period * NS
            first = max(int(np.floor((after_ns + 1) / span)) - 1, 0)
            count = int(np.ceil((until_ns - first * span) / span)) + 2
            starts = np.rint(span * np.arange(first, first + max(count, 0) + 1)).astype(np.int64)[:, None]
            found = starts[:-1] + np.rint(self.times[rows] * NS).astype(np.int64)
            found = np.minimum(found, starts[1:] - np.arange(rows.size, 0, -1)).ravel()  # rounding of the period
            rows = np.tile(rows, starts.size - 1)
        inside = (found > after_ns) & (found <= until_ns)
        return found[inside], rows[inside]

    def sample(self, times_ns: np.ndarray) -> np.ndarray:
        """Interpolate the commands at given times.

        Args:
            times_ns: shape (K,), int64, >= 0 and increasing [ns].

        Returns:
            Targets, shape (K, S + 2 N); for variations with the same times (M, K, S + 2 N).
        """
        return self._interpolate(self.targets, times_ns)

    def sample_rows(self, times_ns: np.ndarray) -> np.ndarray:
        """Interpolate the command rows at given times.

        Args:
            times_ns: shape (K,), int64, >= 0 and increasing [ns].

        Returns:
            Command rows, shape (K, C); for variations with the same times (M, K, C).
        """
        return self._interpolate(self.rows, times_ns)

    def _interpolate(self, table: np.ndarray, times_ns: np.ndarray) -> np.ndarray:
        """Interpolate a table with a row for each waypoint, shape (..., W, F)."""
        if times_ns.size == 0:
            return table[..., :0, :]
        _, rows, before, after, part = self.locate(times_ns)
        start = table[..., rows[before], :]
        return np.asarray(start + part[:, None] * (table[..., rows[after], :] - start))

    def locate(self, times_ns: np.ndarray) -> tuple[np.ndarray, ...]:
        """Find the waypoints around given times.

        Args:
            times_ns: shape (K,), int64, >= 0 and increasing, at least one [ns].

        Returns:
            The times [ns] and rows of the waypoints concerned, each of shape (J,); and for each time the waypoint
            before or at it and the one after it, as indices into these, and its place between them, 0 .. 1, each of
            shape (K,).
        """
        if self.period is None:
            known, rows = self.waypoints_between(-1, int(np.rint(self.times[-1] * NS)))
        else:
            margin = int(self.period * NS) + 2
            known, rows = self.waypoints_between(int(times_ns[0]) - margin, int(times_ns[-1]) + margin)
        before = np.clip(np.searchsorted(known, times_ns, side="right") - 1, 0, known.size - 1)
        after = np.minimum(before + 1, known.size - 1)
        gap = np.maximum(known[after] - known[before], 1)
        part = np.where(after > before, np.maximum(times_ns - known[before], 0) / gap, 0.0)
        return known, rows, before, after, part

    def ramps_between(
        self, after_ns: int, tick_ns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Divide ticks into straight ramps at the waypoints within them.

        Args:
            after_ns: start of the first tick [ns].
            tick_ns: ends of the ticks, increasing, at least one, shape (T,) [ns].

        Returns:
            The ends of the ramps, shape (V,) [ns]; the targets there, shape (V, S + 2 N), exact at waypoints; and which
            of them are waypoints, with their rows, each of shape (K,).
        """
        way_ns, way_rows = self.waypoints_between(after_ns, int(tick_ns[-1]))
        both_ns = np.sort(np.concatenate((tick_ns, way_ns)), kind="stable")
        vertex_ns = both_ns[np.append(True, np.diff(both_ns) > 0)]  # np.union1d takes thirty times as long
        targets = self.sample(vertex_ns)
        at = np.searchsorted(vertex_ns, way_ns)
        targets[at] = self.targets[way_rows]
        return vertex_ns, np.ascontiguousarray(targets), at, way_rows


def wave(
    mean: ArrayLike, amplitude: ArrayLike, wavelength: ArrayLike, phase: np.ndarray, position: np.ndarray
) -> np.ndarray:
    """Compute a travelling wave, mean + amplitude sin 2 pi (phase - position / wavelength).

    The first three are numbers, or arrays of shape (M, 1) for variations.

    Args:
        mean: mean value [any unit].
        amplitude: amplitude [the same unit].
        wavelength: not 0 [m]; positive for a wave towards +x, negative towards -x.
        phase: time divided by the period, shape (W,).
        position: shape (K,) [m].

    Returns:
        Values, shape (W, K), for variations (M, W, K). After whole periods they are bitwise equal to the values at
        phase 0.
    """
    mean, amplitude, wavelength = (np.asarray(value)[..., None] for value in (mean, amplitude, wavelength))
    angle = 2.0 * np.pi * (np.mod(phase, 1.0)[:, None] - position / wavelength)
    return np.asarray(mean + amplitude * np.sin(angle))


def strategy_waypoints(
    strategy: str, length: ArrayLike, friction: ArrayLike, period: ArrayLike
) -> tuple[np.ndarray, ...]:
    """Compute the waypoints of strategies A, B and C.

    The numbers may be arrays of shape (M, 1) for variations; the results then have a leading axis.

    Args:
        strategy: "A", "B" or "C".
        length: Lmax, the largest actuation [m].
        friction: mu, the mean friction of both contacts [N].
        period: duration of a period [s].

    Returns:
        times (5,) [s], actuation (5, 1) [m] and isotropic friction (5, 2) [N], one row per quarter of a period.

    Source: [G] section 5.2, Examples "Strategy A", "Strategy B", "Strategy C".
    """
    first = {"A": (1.0, 1.5, 1.0, 0.5, 1.0), "B": (0.5, 1.0, 1.5, 1.0, 0.5), "C": (0.5, 1.5, 1.5, 0.5, 0.5)}
    second = {"A": (1.0, 0.5, 1.0, 1.5, 1.0), "B": (1.5, 1.0, 0.5, 1.0, 1.5), "C": (0.5, 0.5, 1.5, 1.5, 0.5)}
    times = np.array([0.0, 0.25, 0.5, 0.75, 1.0]) * period
    actuation = np.asarray(length)[..., None] * np.array([[0.0], [0.5], [1.0], [0.5], [0.0]])
    return times, actuation, np.asarray(friction)[..., None] * np.column_stack((first[strategy], second[strategy]))
