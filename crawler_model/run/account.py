"""The account of a run: work, dissipation, stored energy, certificate and average displacement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..body.body import Body
from ..body.plan import Plan
from ..body.turning import TURNING_TOLERANCE
from ..motion import account as entries


@dataclass(frozen=True)
class Energy:
    """The energy account of a run, whose parts balance.

    stored + dissipation + internal_dissipation + jump_loss - work - loads_work = residual.

    Of M runs every entry may have shape (M,).

    Attributes:
        work: work of the actuators [J].
        dissipation: energy lost to friction [J].
        stored: change of the energy stored in the springs from start to end [J].
        residual: error of the balance [J].
        peak: largest amount of energy stored during the run; for a bent spring it may be negative [J].
        loads_work: work of the loads [J].
        jump_loss: energy lost in jumps on patches of ground, not to friction [J].
        internal_dissipation: energy lost in springs with hysteresis [J].
    """

    work: float
    dissipation: float
    stored: float
    residual: float
    peak: float
    loads_work: float = 0.0
    jump_loss: float = 0.0
    internal_dissipation: float = 0.0

    @property
    def relative_residual(self) -> Any:
        """The residual relative to the largest of work, dissipation, stored and peak energy [1]."""
        size: Any = self.peak
        for part in (self.work, self.dissipation, self.stored):
            size = np.maximum(size, np.abs(part))
        ratio = np.abs(self.residual) / np.where(size > 0.0, size, np.inf)
        return ratio if np.ndim(ratio) else float(ratio)


@dataclass(frozen=True, eq=False, repr=False)
class TickEnergies:
    """Energies by tick. Each array has shape (T,), begins with the entry of the start, and is read-only.

    But for rounding (with catch_up, its error), the sum of dissipation, internal_dissipation, jump_loss and the change
    of stored since the tick before equals the sum of work and loads_work.

    Attributes:
        work: work of the actuators in the tick [J].
        dissipation: energy lost to friction in the tick [J].
        loads_work: work of the loads in the tick [J].
        jump_loss: energy lost in jumps on patches of ground in the tick [J].
        stored: energy stored in the springs at its end [J].
        internal_dissipation: energy lost in springs with hysteresis in the tick [J].
    """

    work: np.ndarray
    dissipation: np.ndarray
    loads_work: np.ndarray
    jump_loss: np.ndarray
    stored: np.ndarray
    internal_dissipation: np.ndarray

    def __post_init__(self) -> None:
        for array in vars(self).values():
            array.flags.writeable = False

    def __repr__(self) -> str:
        """Describe the energies in one line."""
        totals = ", ".join(f"{name} {getattr(self, name).sum():.6g} J" for name in ("work", "dissipation"))
        return f"TickEnergies({self.work.size - 1} ticks, in all {totals})"


@dataclass
class Total:
    """The account of all ramps of a run; entries as in `Step`. Of M runs every entry has shape (M,).

    Attributes:
        visited: smallest visited margin [1].
        work: work of the actuators [J].
        dissipation: energy lost to friction [J].
        loads_work: work of the loads [J].
        jump_loss: energy lost in jumps [J].
        internal_dissipation: energy lost in springs with hysteresis [J].
        residual: error of the energy balance [J].
        violation: largest amount by which a spring force exceeds its bound [N].
        unique: whether the translation was determined on every ramp.
        events: number of linear pieces.
        overspent: number of ramps whose budget of work was exceeded.
        unsolved: number of ramps that were not solved.
    """

    visited: Any
    work: Any = 0.0
    dissipation: Any = 0.0
    loads_work: Any = 0.0
    jump_loss: float = 0.0
    internal_dissipation: Any = 0.0
    residual: Any = 0.0
    violation: Any = 0.0
    unique: Any = True
    events: Any = 0.0
    overspent: Any = 0.0
    unsolved: Any = 0.0

    def add_account(self, account: np.ndarray, jump_loss: float = 0.0) -> None:
        """Add the account of further ramps.

        Args:
            account: account of these ramps, shape (15,), of M runs (M, 15).
            jump_loss: energy lost in jumps on them [J].
        """
        self.work = self.work + account[..., entries.WORK]
        self.dissipation = self.dissipation + (account[..., entries.DISSIPATION] + account[..., entries.LOADS_WORK])
        self.loads_work = self.loads_work + account[..., entries.LOADS_WORK]
        self.jump_loss += jump_loss
        self.internal_dissipation = self.internal_dissipation + account[..., entries.INTERNAL]
        self.residual = self.residual + account[..., entries.RESIDUAL]
        self.violation = np.maximum(self.violation, account[..., entries.VIOLATION])
        self.visited = np.minimum(self.visited, account[..., entries.VISITED])
        self.unique = self.unique & (account[..., entries.AMBIGUOUS] == 0.0)
        self.events = self.events + account[..., entries.EVENTS]
        self.overspent = self.overspent + account[..., entries.OVERSPENT]
        self.unsolved = self.unsolved + account[..., entries.UNSOLVED]


def average_displacement(body: Body, x: np.ndarray) -> np.ndarray:
    """Average displacements over a body; every isolated contact and every segment has the same weight.

    Points without friction have none.

    Args:
        body: the body.
        x: displacements, shape (T, N), in the plane (T, N, 2) [m].

    Returns:
        y, shape (T,), in the plane (T, 2) [m].
    """
    if not body.segments and body.turning is None:
        return x.mean(axis=1)
    return np.einsum("ti...,i->t...", x, body.share)  # not `@`: its last bit depends on how many rows there are


def tolerance_of(scene: Plan) -> float:
    """Find the error that a ramp may have, relative to its largest change of length.

    Args:
        scene: the scene.

    Returns:
        The tolerance of a scene in the plane [1]; 0 on a line, where only rounding is left.
    """
    if scene.body.dimension == 1:
        return 0.0
    from ..motion.plane.motion import DEFAULT_TOLERANCE  # its kernels are not needed on a line

    return scene.tolerance or (DEFAULT_TOLERANCE if scene.body.turning is None else TURNING_TOLERANCE)
