"""Slips: intervals of time in which a contact or an end of a segment slides in one direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .ramps import Piece

ROUNDING = 1e-12
"""A contact whose displacement is less than this fraction of the largest one sticks: the rest is rounding."""


@dataclass(frozen=True, eq=False)
class Slips:
    """Slips in the order in which they begin.

    Attributes:
        contact: index among the stations, isolated contacts and then both ends of each segment, shape (K,).
        direction: 1 forward, -1 backward; in the plane the angle of the whole slip [rad]; shape (K,).
        run: number of the run between resets, shape (K,).
        start_ns: start, shape (K,) [ns, simulated].
        end_ns: end, shape (K,) [ns, simulated].
        distance: sum of the distances in each ramp, >= 0, shape (K,) [m].
    """

    contact: np.ndarray
    direction: np.ndarray
    run: np.ndarray
    start_ns: np.ndarray
    end_ns: np.ndarray
    distance: np.ndarray


def sliding(gained: np.ndarray) -> np.ndarray:
    """Compute in which direction contacts slid in each ramp.

    Args:
        gained: displacement of each contact, shape (R, M), in the plane (R, M, 2) [m].

    Returns:
        1 forward, -1 backward, 0 stuck; in the plane 1 for sliding; int8, shape (R, M).
    """
    if gained.ndim == 3:
        size = np.linalg.norm(gained, axis=2)
        return (size > ROUNDING * size.max(axis=1, initial=0.0, keepdims=True)).astype(np.int8)
    least = ROUNDING * np.abs(gained).max(axis=1, initial=0.0, keepdims=True)
    return (np.sign(gained) * (np.abs(gained) > least)).astype(np.int8)


class SlipFinder:
    """Finds slips in consecutive pieces of a run: a `Sink`. A pause in which nothing moves ends a slip."""

    def __init__(self) -> None:
        """Start empty; the first ramps determine the number of contacts."""
        self._found: list[np.ndarray] = []
        self._run, self._planar = 0, False
        self._start(0)

    def _start(self, contacts: int) -> None:
        self._direction = np.zeros(contacts, np.int8)
        self._since = np.zeros(contacts, np.int64)
        self._until = np.zeros(contacts, np.int64)
        self._sum = np.zeros((contacts, 3))

    def __call__(self, piece: Piece) -> None:
        """Add a piece, in which the stations of a body slide."""
        self.add_ramps(piece.run, piece.start_ns, piece.end_ns, piece.station_gained)

    def add_ramps(self, run: np.ndarray, start_ns: np.ndarray, end_ns: np.ndarray, gained: np.ndarray) -> None:
        """Add the next ramps.

        Args:
            run: number of the run of each, not decreasing, shape (R,).
            start_ns: when each begins, shape (R,) [ns].
            end_ns: when it ends, shape (R,) [ns].
            gained: displacement of each contact, shape (R, M), in the plane (R, M, 2) [m].
        """
        if self._direction.size == 0:
            self._start(gained.shape[1])
            self._planar = gained.ndim == 3
        for number in np.unique(run).tolist():
            rows = np.flatnonzero(run == number)
            if number != self._run:
                self._close(np.arange(self._direction.size))
                self._run = number
            self._add_run(start_ns[rows], end_ns[rows], gained[rows])

    def _add_run(self, start_ns: np.ndarray, end_ns: np.ndarray, gained: np.ndarray) -> None:
        direction = sliding(gained)
        size = np.linalg.norm(gained, axis=2) if self._planar else np.abs(gained)
        parts = np.zeros((gained.shape[0], gained.shape[1], 3))
        parts[..., 0] = size
        parts[..., 1 : 2 + self._planar] = gained if self._planar else gained[..., None]
        changed = np.flatnonzero((direction != np.vstack((self._direction[None], direction[:-1]))).any(axis=0))
        for contact in changed.tolist():
            column = direction[:, contact]
            edges = np.flatnonzero(column != np.append(self._direction[contact], column[:-1]))
            at = 0
            for edge in edges.tolist():
                if self._direction[contact]:
                    self._extend(contact, parts[at:edge, contact], end_ns[edge - 1])
                    self._close([contact])
                self._direction[contact], at = column[edge], edge
                self._since[contact], self._sum[contact] = start_ns[edge], 0.0
            if self._direction[contact]:
                self._extend(contact, parts[at:, contact], end_ns[-1])
        unchanged = np.setdiff1d(np.flatnonzero(self._direction), changed)
        self._sum[unchanged] = _add_in_order(self._sum[unchanged], parts[:, unchanged])
        self._until[unchanged] = end_ns[-1]

    def _extend(self, contact: int, parts: np.ndarray, end_ns: int) -> None:
        self._sum[contact] = _add_in_order(self._sum[contact], parts)
        if parts.size:
            self._until[contact] = end_ns

    def _close(self, contacts: np.ndarray | list[int]) -> None:
        for contact in contacts:
            if self._direction[contact]:
                distance, x, y = self._sum[contact]
                direction = np.arctan2(y, x) if self._planar else float(self._direction[contact])
                row = (contact, direction, self._run, self._since[contact], self._until[contact], distance)
                self._found.append(np.array(row, dtype=_ROW))
                self._direction[contact] = 0

    def finish(self) -> Slips:
        """End the open slips and return all of them.

        Returns:
            The slips by run and by start.
        """
        self._close(np.arange(self._direction.size))
        table = np.array(self._found, dtype=_ROW) if self._found else np.zeros(0, dtype=_ROW)
        table = table[np.lexsort((table["contact"], table["start_ns"], table["run"]))]
        return Slips(*(np.ascontiguousarray(table[name]) for name in _ROW.names or ()))


def _add_in_order(begin: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Add parts one after another, so that the bits of a sum do not depend on how pieces divide the run."""
    return np.cumsum(np.concatenate((begin[None], parts)), axis=0)[-1]


_ROW = np.dtype(
    [
        ("contact", np.int64),
        ("direction", np.float64),
        ("run", np.int64),
        ("start_ns", np.int64),
        ("end_ns", np.int64),
        ("distance", np.float64),
    ]
)
