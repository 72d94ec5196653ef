"""The motion of a recording, as what a model may lack depends on it: places, elongations, rests."""

from __future__ import annotations

import dataclasses

import numpy as np

from crawler_model.body.body import Body

from ..fit.fit import Fit
from ..fit.problem import Problem
from ..measurements import Measurements, interpolate_rows
from ..sensor.noise import guess_noise

_MOST_ROWS = 1200
"""Rows of a recording at which its motion is taken, beside those of the commands."""
_WINDOW, _FEWEST = 0.08, 5
"""Time of the parabolas from which rates follow [s], and their least number of rows."""
_ANCHOR = 10
"""Rows at which positions are compared with the model, which is right there if anywhere."""
_SIDE = 3
"""Rows ahead or behind at which a contact must be nearly where it is, if it rests."""
_MOVES, _CLEAR = 0.05, 3.0
"""A contact rests that is slower than this part of its largest speed, or than this many times the noise shows."""


@dataclasses.dataclass(frozen=True)
class Seen:
    """The motion of a recording at the rows of finer commands.

    Attributes:
        measured: the recording, with its commands at these times.
        noise: of the positions of each contact, shape (N,) [m].
        place: positions of the contacts, in the frame of the scene, shape (K, N) [m].
        rests: whether contacts rest, between 0 and 1, shape (K, N).
        elongation: of each link, shape (K, S) [m].
        links: column of the commands of each link, shape (S,).
    """

    measured: Measurements
    noise: np.ndarray
    place: np.ndarray
    rests: np.ndarray
    elongation: np.ndarray
    links: np.ndarray

    @property
    def stretch(self) -> np.ndarray:
        """Elongation of each link beyond the length that is commanded, shape (K, S) [m]."""
        return np.asarray(self.elongation - self.measured.commands[:, self.links])

    @property
    def part(self) -> np.ndarray:
        """Time as a part of the recording, shape (K,) [1]."""
        time = self.measured.command_time
        return np.clip((time - time[0]) / max(float(self.measured.time[-1] - time[0]), 1e-12), 0.0, 1.0)

    @property
    def held_since(self) -> np.ndarray:
        """Time from which on each contact rests until the end, shape (N,) [s]."""
        away = np.abs(self.place - np.median(self.place[-_ANCHOR:], axis=0)) > 2.0 * _CLEAR * self.noise
        last = away.shape[0] - 1 - np.argmax(away[::-1], axis=0)
        return np.where(away.any(axis=0), self.measured.command_time[last], 0.0)


def see_motion(problem: Problem, fit: Fit, recording: int, kept: np.ndarray) -> Seen | None:
    """Take the motion of a recording from what was measured, of contacts that were not from the fit.

    Args:
        recording: its number.
        kept: indices of the rows of the recording that are compared.

    Returns:
        The motion; None if the fit has no motion, or not all links are commanded.
    """
    replica = problem.replicas[recording]
    measured, body = replica.measured, replica.body
    values = problem.space.to_values(fit.unknowns[: problem.space.origin.size])
    found = replica.motion_at(values, problem.start(fit.unknowns, recording))
    links = [f"link_{j}" for j in range(body.springs)]
    if found is None or not set(links) <= set(measured.command_names):
        return None
    place, noise = body.position + found[1], np.full(body.contacts, problem.floor)
    for m, channel in enumerate(measured.channels):
        seen = np.flatnonzero(np.isfinite(measured.values[:, m]))
        if channel.startswith("contact_") and seen.size > _ANCHOR:
            i, first = int(channel[8:]), seen[:_ANCHOR]
            offset = np.median(measured.values[first, m] - place[first, i])
            values, pixel = measured.values[seen, m], float(problem.pixels[recording][m])
            noise[i] = guess_noise(values, pixel, problem.floor)[0].white
            place[:, i] = np.interp(measured.time, measured.time[seen], values) - offset
    time, own = measured.time - problem.sensed(fit.unknowns, recording)["lag"], measured.command_time
    shown = time[:: max(1, time.size // _MOST_ROWS)]
    shown = np.concatenate((shown, 0.5 * (shown[1:] + shown[:-1])))
    at = np.unique(np.concatenate((own, shown[(shown > own[0]) & (shown < own[-1])])))
    finer = dataclasses.replace(
        measured,
        time=measured.time[kept],
        values=measured.values[kept],
        command_time=at,
        commands=interpolate_rows(at, own, measured.commands),
    )
    none, columns = np.zeros((0, 0)), np.array([measured.command_names.index(name) for name in links])
    return move(Seen(finer, noise, none, none, none, columns), body, time, place)


def move(seen: Seen, body: Body, time: np.ndarray, place: np.ndarray) -> Seen:
    """Replace the motion.

    Args:
        seen: the recording.
        body: the body.
        time: times of the positions, shape (T,) [s].
        place: positions of the contacts there, shape (T, N) [m].

    Returns:
        The recording with this motion.
    """
    from scipy.signal import savgol_filter

    even = np.linspace(time[0], time[-1], time.size)
    step = max(float(even[1] - even[0]), 1e-12)
    window = min(max(_FEWEST, 2 * int(0.5 * _WINDOW / step) + 1), time.size - 1 + time.size % 2)
    smooth = interpolate_rows(even, time, place)
    speed = savgol_filter(smooth, window, 2, 1, step, axis=0)
    # a contact that jumps rests before and after it, and moves between two rows
    near = _CLEAR * np.sqrt(2.0) * seen.noise
    far = np.maximum(_MOVES * np.abs(speed).max(axis=0) * step * _SIDE, near)
    way = np.abs(smooth[_SIDE:] - smooth[:-_SIDE])
    pad = np.zeros((_SIDE - 1, way.shape[1]))
    steadily = (np.vstack((way, pad)) > far) & (np.vstack((pad, way)) > far)
    moves = steadily | (np.abs(np.diff(smooth, axis=0)) > near)
    both = np.zeros((2 * even.size - 1, way.shape[1]))
    both[1::2] = moves
    both[2:-1:2] = moves[1:] & moves[:-1]
    halves = np.linspace(even[0], even[-1], both.shape[0])
    at = seen.measured.command_time
    shown = interpolate_rows(at, time, place)
    return dataclasses.replace(
        seen,
        place=shown,
        rests=1.0 - interpolate_rows(at, halves, both),
        elongation=body.elongation(shown - body.position),
    )
