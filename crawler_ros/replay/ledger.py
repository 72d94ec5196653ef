"""The ticks of a recorded ledger, and the ramps into which their points and ends divide them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..recording.bag import BagError


@dataclass(frozen=True, eq=False)
class Ticks:
    """Consecutive ticks.

    Attributes:
        start_ns: when each begins, shape (K,) [ns, simulated].
        first: its first point, then the number of points V, shape (K + 1,).
        offset_ns: when each point is due, after the start of its tick, shape (V,) [ns].
        rows: the commands there, shape (V, C).
    """

    start_ns: np.ndarray
    first: np.ndarray
    offset_ns: np.ndarray
    rows: np.ndarray

    def select(self, which: np.ndarray) -> Ticks:
        """Select ticks.

        Args:
            which: their indices, shape (J,).

        Returns:
            The ticks in this order.
        """
        counts = np.diff(self.first)[which]
        first = np.append(0, np.cumsum(counts))
        points = np.arange(first[-1]) + np.repeat(self.first[which] - first[:-1], counts)
        return Ticks(self.start_ns[which], first, self.offset_ns[points], self.rows[points])


def read_ticks(groups: Sequence[tuple[np.ndarray, np.ndarray, list[np.ndarray]]], columns: int, topic: str) -> Ticks:
    """Put messages of the ledger in order.

    Args:
        groups: as from `Decoder.read`.
        columns: number of columns C of a command.
        topic: name of the ledger, for errors.

    Returns:
        Their ticks.

    Raises:
        BagError: when a point has another number of columns.
    """
    for _, _, numbers in groups:
        for part in numbers:
            if part.shape[1] != columns:
                raise BagError(f"{topic}: a point of {part.shape[1]} numbers; a command of this scene has {columns}")
    at = np.concatenate([at for at, _, _ in groups])
    counts = np.concatenate([np.full(at.size, len(numbers)) for at, _, numbers in groups])
    rows = [np.stack(numbers, axis=1).reshape(-1, columns) for _, _, numbers in groups if numbers]
    ticks = Ticks(
        start_ns=np.concatenate([times[:, 0] for _, times, _ in groups]),
        first=np.append(0, np.cumsum(counts)),
        offset_ns=np.concatenate([times[:, 1:].ravel() for _, times, _ in groups]),
        rows=np.concatenate([np.empty((0, columns)), *rows]),
    )
    return ticks if len(groups) == 1 else ticks.select(np.argsort(at))


@dataclass(frozen=True, eq=False)
class Ramps:
    """The ramps of consecutive ticks of a run: a straight line to each point, then rest up to the end of the tick.

    Attributes:
        ticks: the ticks.
        end_ns: when each tick ends, shape (K,) [ns, simulated].
        first: the first ramp of each tick, then the number of ramps R, shape (K + 1,).
        moves: whether a ramp leads to a point, shape (R,).
        start_ns: when each ramp begins, shape (R,) [ns, simulated].
        until_ns: when it ends, shape (R,) [ns, simulated].
        rows: the command in force at its end, shape (R, C).
    """

    ticks: Ticks
    end_ns: np.ndarray
    first: np.ndarray
    moves: np.ndarray
    start_ns: np.ndarray
    until_ns: np.ndarray
    rows: np.ndarray

    @property
    def ends_tick(self) -> np.ndarray:
        """Whether a tick ends with each ramp, shape (R,)."""
        ends = np.zeros(self.moves.size, bool)
        ends[self.first[1:] - 1] = True
        return ends


def divide(ticks: Ticks, end_ns: np.ndarray, in_force: np.ndarray) -> Ramps:
    """Divide ticks into ramps.

    Args:
        ticks: the ticks.
        end_ns: when each ends, not before its start, shape (K,) [ns].
        in_force: the command before the first one, shape (C,).

    Returns:
        The ramps. Points are passed in order, none after the end of its tick; one that is due a nanosecond before the
        end is due at the end, because stamps are rounded.
    """
    length, counts = end_ns - ticks.start_ns, np.diff(ticks.first)
    tick = np.repeat(np.arange(counts.size), counts)
    due = np.clip(ticks.offset_ns, 0, length[tick])
    if (np.diff(due)[np.diff(tick) == 0] < 0).any():
        for k in np.flatnonzero(counts > 1).tolist():
            inside = slice(ticks.first[k], ticks.first[k + 1])
            due[inside] = np.maximum.accumulate(due[inside])
    some = counts > 0
    last = ticks.first[1:][some] - 1
    whole = due[last] >= length[some] - 1
    due[last[whole]] = length[some][whole]
    rests = np.ones(counts.size, bool)
    rests[some] = ~whole
    first = np.append(0, np.cumsum(counts + rests))
    moves = np.ones(first[-1], bool)
    moves[first[1:][rests] - 1] = False
    until = np.empty(moves.size, np.int64)
    until[moves], until[~moves] = ticks.start_ns[tick] + due, end_ns[rests]
    start = np.append(0, until[:-1])
    start[first[:-1]] = ticks.start_ns
    rows = np.vstack((in_force, ticks.rows))[np.cumsum(moves)]
    return Ramps(ticks, end_ns, first, moves, start, until, rows)
