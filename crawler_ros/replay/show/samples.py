"""Samples of a run for a picture: a few thousand, in which no slip is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.run.simulate import TimedJump

from ...recording.layouts import JOINT_STATE, TRAJECTORY
from ..health import Survey
from ..ramps import Piece
from ..slips import sliding

_MOST = 4000
_SAMPLED = ("end_ns", "position", "tension", "least", "most", "net_translation", "stored")


class Samples:
    """Samples the ramps of pieces at equal intervals: a `Sink`. Runs between resets are joined in time."""

    def __init__(self, survey: Survey) -> None:
        """Choose the number of ramps per sample.

        Args:
            survey: survey of the recording.
        """
        most = max((t.stamp_ns.size for t in survey.topics.values() if t.type in (TRAJECTORY, JOINT_STATE)), default=0)
        self.every = max(-(-most // _MOST), 1)
        self._parts: dict[str, list[np.ndarray]] = {name: [] for name in (*_SAMPLED, "state", "work", "dissipation")}
        self._count = 0
        self._moved: np.ndarray | None = None
        self._sums = np.zeros(2)
        self._run, self._offset, self._last = 0, 0, 0
        self.jumps: list[TimedJump] = []
        """All jumps, at times in sequence."""

    def __call__(self, piece: Piece) -> None:
        """Add a piece."""
        rows = piece.run.size
        if rows == 0:
            return
        state = sliding(piece.gained)
        work, dissipation = (np.cumsum(np.nan_to_num(v)) for v in (piece.work, piece.dissipation))
        last = np.flatnonzero((np.arange(self._count, self._count + rows) % self.every) == 0)
        begin = 0
        states = []
        for row in last.tolist():
            states.append(self._last_state(state[begin : row + 1]))
            self._moved, begin = None, row + 1
        if begin < rows:
            self._moved = self._last_state(state[begin:])
        for name in _SAMPLED:
            self._parts[name].append(getattr(piece, name)[last].copy())
        self._parts["end_ns"][-1] = self._in_sequence(piece)[last]
        self._parts["state"].append(np.array(states, np.int8).reshape(last.size, state.shape[1]))
        for k, (name, sums) in enumerate((("work", work), ("dissipation", dissipation))):
            self._parts[name].append(self._sums[k] + sums[last])
            self._sums[k] += sums[-1]
        self._count += rows

    def _last_state(self, state: np.ndarray) -> np.ndarray:
        """Return the last motion of each contact in some ramps; it sticks only if it sticks in all of them."""
        seen = np.zeros(state.shape[1], np.int8) if self._moved is None else self._moved
        moving = state != 0
        last = state.shape[0] - 1 - moving[::-1].argmax(axis=0)
        return np.where(moving.any(axis=0), state[last, np.arange(state.shape[1])], seen)

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
        """Join the samples of one quantity.

        Args:
            name: end_ns, position, tension, least, most, net_translation, stored, state, work or dissipation; the last
                two are sums since the start.

        Returns:
            Shape (T, ...).
        """
        parts = self._parts[name]
        return np.concatenate(parts) if parts else np.zeros((0, 0))
