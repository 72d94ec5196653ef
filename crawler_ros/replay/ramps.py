"""The data of each ramp of a run: pieces with every contact, and a table of all ramps with a few numbers each.

A ramp is one straight line of the commands; a tick has one, or several if commands arrived in between. Pieces hold
every contact and are passed to sinks (a table on disk, a picture); the table in memory has a few numbers per ramp,
however large the body is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crawler_model.run.trajectory import TimedJump

from .cycles import CommandPath, signature_weights


@dataclass(frozen=True, eq=False)
class Piece:
    """Consecutive ramps. Unknown numbers are NaN.

    Attributes:
        run: number of the run between resets, shape (R,).
        start_ns: when each ramp begins, shape (R,) [ns, simulated].
        end_ns: when it ends, shape (R,) [ns, simulated].
        ends_tick: whether a tick ends there too, shape (R,).
        command: the command row in force at its end, shape (R, C); C = 0 where no command is known.
        position: of each shown contact, xi + x, shape (R, M), in the plane (R, M, 2) [m].
        gained: displacement of each shown contact in the ramp, shaped as `position` [m].
        station_gained: distance that each station of the body slides, shape (R, Q), in the plane (R, Q, 2) [m]; 0 for a
            point that does not touch the ground.
        forward: how far the body slid forward (`parts.Parts.slid`), shape (R,) [m].
        backward: how far it slid backward, shape (R,) [m].
        ground: force of the ground on each shown contact, -(g + f), shaped as `position` [N].
        elongation: elongation of each joint, shape (R, J), in the plane (R, J, 2) [m].
        tension: tension of each joint, shaped as `elongation` [N].
        least: least tension that its link may have while the others are unchanged, shape (R, J) [N].
        most: the greatest, shape (R, J) [N].
        net_translation: y, shape (R,), in the plane (R, 2) [m].
        work: work of the actuators, shape (R,) [J].
        loads_work: work of the loads, shape (R,) [J].
        dissipation: dissipated energy, shape (R,) [J].
        jump_loss: energy lost in jumps on patches of ground, shape (R,) [J].
        internal_dissipation: energy lost in springs with hysteresis, shape (R,) [J].
        stored: stored energy at the end, shape (R,) [J].
        margin: least distance of a spring force from its nearest bound at the end, shape (R,) [N].
        nearest: number of the contact with the least distance, shape (R,); -1 when it is not known.
        visited: how near all contacts came to sliding at once, shape (R,).
        unique: whether the translation was determined, shape (R,).
        jumps: the number of its run and each jump in the ramps, in order.
        yaw: yaw at the end, whole turns counted, shape (R,) [rad]; None where the body does not turn or is not known.
        stability: least stability margin, infinite where nothing moved, shape (R,) [1]; None as for `yaw`.
        origin: displacement of the origin of its frame, between the points of the heading, shape (R, 2) [m]; None as
            for `yaw`.

    For a body that turns, elongation and tension have shape (R, S + J): of links, then angles of joints [rad] and their
    torques [N m].
    """

    run: np.ndarray
    start_ns: np.ndarray
    end_ns: np.ndarray
    ends_tick: np.ndarray
    command: np.ndarray
    position: np.ndarray
    gained: np.ndarray
    station_gained: np.ndarray
    forward: np.ndarray
    backward: np.ndarray
    ground: np.ndarray
    elongation: np.ndarray
    tension: np.ndarray
    least: np.ndarray
    most: np.ndarray
    net_translation: np.ndarray
    work: np.ndarray
    loads_work: np.ndarray
    dissipation: np.ndarray
    jump_loss: np.ndarray
    internal_dissipation: np.ndarray
    stored: np.ndarray
    margin: np.ndarray
    nearest: np.ndarray
    visited: np.ndarray
    unique: np.ndarray
    jumps: tuple[tuple[int, TimedJump], ...] = ()
    yaw: np.ndarray | None = None
    stability: np.ndarray | None = None
    origin: np.ndarray | None = None


Sink = Callable[[Piece], None]
"""A callable that receives pieces in order."""

_COPIED = (
    *("run", "start_ns", "end_ns", "ends_tick", "work", "loads_work", "dissipation", "jump_loss", "stored"),
    *("internal_dissipation", "margin", "nearest", "visited", "unique", "forward", "backward"),
)


class RampTable:
    """Collects the numbers of all pieces that do not grow with the body: a `Sink`. `finish` builds the arrays."""

    def __init__(self) -> None:
        """Start empty."""
        self._parts: dict[str, list[np.ndarray]] = {}
        self.run = self.start_ns = self.end_ns = np.zeros(0, np.int64)
        self.ends_tick = self.unique = np.zeros(0, bool)
        self.work = self.loads_work = self.dissipation = self.jump_loss = self.stored = np.zeros(0)
        self.internal_dissipation = np.zeros(0)
        self.margin = self.visited = np.zeros(0)
        self.nearest = np.zeros(0, np.int64)
        self.forward = self.backward = np.zeros(0)
        """Distances slid, all contacts and segments together, shape (R,) [m]."""
        self.net_translation = np.zeros((0, 1))
        """Shape (R, d) [m]."""
        self.origin = np.zeros((0, 1))
        """As `net_translation`; for bodies that turn, translation of the origin of their frame, shape (R, d) [m]."""
        self.yaw = self.stability = np.zeros(0)
        """Yaw at the end of each ramp, and least stability margin, shape (R,) [rad, 1]; NaN where it is not known."""
        self.place = self.shape = np.zeros((0, 2))
        """Commands and elongations as two combinations, shape (R, 2)."""
        self.shape_size = 0.0
        self.commanded = False
        """Whether commands are known."""
        self.jumps: list[tuple[int, TimedJump]] = []
        """Every jump with the number of its run."""

    def __call__(self, piece: Piece) -> None:
        """Add a piece."""
        made = {name: getattr(piece, name) for name in _COPIED}
        rows = piece.run.size
        made["net_translation"] = piece.net_translation.reshape(rows, -1)
        made["origin"] = made["net_translation"] if piece.origin is None else piece.origin
        for name, known in (("yaw", piece.yaw), ("stability", piece.stability)):
            made[name] = np.full(rows, np.nan) if known is None else known
        made["place"] = piece.command @ signature_weights(piece.command.shape[1])
        shape = piece.elongation.reshape(rows, -1)
        made["shape"] = shape @ signature_weights(shape.shape[1])
        self.shape_size = max(self.shape_size, float(np.abs(shape).sum(axis=1).max(initial=0.0)))
        self.commanded |= piece.command.shape[1] > 0
        self.jumps += piece.jumps
        for name, values in made.items():
            self._parts.setdefault(name, []).append(np.array(values))

    def finish(self) -> RampTable:
        """Join the pieces.

        Returns:
            The table itself.
        """
        for name in list(self._parts):
            setattr(self, name, np.concatenate(self._parts.pop(name)))
        return self

    @property
    def turns(self) -> bool:
        """Whether the yaw is known: for bodies that turn."""
        return bool(np.isfinite(self.yaw).any())

    @property
    def gained(self) -> np.ndarray:
        """Net translation of each run between resets, from its first state to its last, shape (runs, D) [m]."""
        begins, ends = np.flatnonzero(np.diff(self.run, prepend=-1)), np.flatnonzero(np.diff(self.run, append=-1))
        return self.net_translation[ends] - self.net_translation[begins]

    @property
    def resets(self) -> int:
        """Number of resets between the runs."""
        return int(self.run[-1]) if self.run.size else 0

    @property
    def turned(self) -> float | None:
        """Angle by which the body turned in the first run between resets [rad]; None where the yaw is not known."""
        return float(self.yaw[self.run == 0][-1] - self.yaw[0]) if self.turns else None

    @property
    def size(self) -> float:
        """The largest length in the ramps, against which rounding is judged [m]."""
        return max(self.shape_size, float(np.abs(self.net_translation).max(initial=0.0)))

    def path(self, run: int) -> tuple[int, CommandPath]:
        """Return the path of the commands of a run; its first ramp is the state at its start.

        Args:
            run: number of the run between resets.

        Returns:
            The row of the run's first ramp, and the path.
        """
        rows = np.flatnonzero(self.run == run)
        return int(rows[0]), CommandPath(self.end_ns[rows], self.place[rows])
