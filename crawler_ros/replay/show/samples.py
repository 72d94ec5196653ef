"""Samples of a run for a picture: a few thousand, in which no slip is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.run.trajectory import TimedJump
from crawler_pictures.run.pixels import join_states

from ...recording.decode import JOINT_STATE, TRAJECTORY
from ..health import Survey
from ..ramps import Piece
from ..slips import sliding

_MOST, _LEAST, _MOST_NUMBERS = 4000, 1000, 4_000_000
_SAMPLED = ("end_ns", "position", "elongation", "tension", "least", "most", "net_translation", "stored", "command")
_SUMMED = ("work", "dissipation", "loads_work", "jump_loss", "internal_dissipation")


class Samples:
    """Samples the ramps of pieces at equal intervals: a `Sink`. Runs between resets are joined in time."""

    def __init__(self, survey: Survey) -> None:
        """Store the number of ramps to expect.

        Args:
            survey: survey of the recording.
        """
        self._expected = max(
            (t.stamp_ns.size for t in survey.topics.values() if t.type in (TRAJECTORY, JOINT_STATE)), default=0
        )
        self.every = 1
        """Ramps per sample; fewer samples are taken of large bodies."""
        self._parts: dict[str, list[np.ndarray]] = {name: [] for name in (*_SAMPLED, *_SUMMED, "state")}
        self._rest: dict[str, np.ndarray] | None = None
        self._count = 0
        self._sums = np.zeros(len(_SUMMED))
        self._run, self._offset, self._last = 0, 0, 0
        self.jumps: list[TimedJump] = []
        """All jumps, at times in sequence."""

    def __call__(self, piece: Piece) -> None:
        """Add a piece."""
        rows = piece.run.size
        if rows == 0:
            return
        state = sliding(piece.gained)
        if self._count == 0:
            most = min(_MOST, max(_LEAST, _MOST_NUMBERS // max(state.shape[1], 1)))
            self.every = max(-(-self._expected // most), 1)
        taken = {name: getattr(piece, name) for name in _SAMPLED} | {"end_ns": self._in_sequence(piece)}
        for k, name in enumerate(_SUMMED):
            taken[name] = self._sums[k] + np.cumsum(np.nan_to_num(getattr(piece, name)))
            self._sums[k] = taken[name][-1]
        last = np.flatnonzero((np.arange(self._count, self._count + rows) % self.every) == 0)
        ends = np.append(last, rows - 1) if last.size == 0 or last[-1] < rows - 1 else last
        joined = join_states(state, np.append(0, ends[:-1] + 1), ends + 1)
        if self._rest is not None:  # the first sample of this piece begins in the one before
            pair = np.vstack((self._rest["state"], joined[:1]))
            joined[0] = join_states(pair, np.zeros(1, np.int64), np.full(1, 2))[0]
        for name, values in taken.items():
            self._parts[name].append(values[last].copy())
        self._parts["state"].append(joined[: last.size])
        self._rest = None
        if ends.size > last.size:
            self._rest = {name: values[-1:].copy() for name, values in taken.items()} | {"state": joined[-1:].copy()}
        self._count += rows

    def _in_sequence(self, piece: Piece) -> np.ndarray:
        """Shift the times of runs so that each follows the one before."""
        ns = np.empty(piece.run.size, np.int64)
        for number in np.unique(piece.run).tolist():
            rows = piece.run == number
            if number != self._run:
                self._run, self._offset = number, self._last
            ns[rows] = piece.end_ns[rows] + self._offset
            self.jumps += [replace(j, time=j.time + self._offset / NS) for run, j in piece.jumps if run == number]
            self._last = int(ns[rows].max())
        return ns

    def get(self, name: str) -> np.ndarray:
        """Join the samples of one quantity; the last one ends with the run.

        Args:
            name: end_ns, position, elongation, tension, least, most, net_translation, stored, command or state; or
                work, dissipation, internal_dissipation, loads_work or jump_loss, which are sums since the start.

        Returns:
            Shape (T, ...); the state of a sample joins the states of its ramps, as `pixels.join_states` does.
        """
        parts = self._parts[name]
        if self._rest is not None:
            parts = [*parts, self._rest[name]]
        return np.concatenate(parts) if parts else np.zeros((0, 0))
