"""The account of a run: work, dissipation, stored energy, certificate and average displacement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.body import Body
from ..crawler.step import Step


@dataclass(frozen=True)
class Energy:
    """The energy account of a run: stored + dissipation + jump_loss - work - loads_work = residual.

    Attributes:
        work: work of the actuators [J].
        dissipation: energy lost to friction [J].
        stored: change of the energy stored in the springs from start to end [J].
        residual: error of the balance [J].
        peak: largest energy stored during the run [J].
        loads_work: work of the loads [J].
        jump_loss: energy lost in jumps on patches of ground, beside that lost to friction [J].
    """

    work: float
    dissipation: float
    stored: float
    residual: float
    peak: float
    loads_work: float = 0.0
    jump_loss: float = 0.0

    @property
    def relative_residual(self) -> float:
        """The residual relative to the largest of work, dissipation, stored and peak energy [1]."""
        size = max(abs(self.work), abs(self.dissipation), abs(self.stored), self.peak)
        return abs(self.residual) / size if size > 0.0 else 0.0


@dataclass
class Total:
    """The account of all ramps of a run; entries as in `Step`.

    Attributes:
        visited: smallest visited margin [1].
        work: work of the actuators [J].
        dissipation: energy lost to friction [J].
        loads_work: work of the loads [J].
        jump_loss: energy lost in jumps [J].
        residual: error of the energy balance [J].
        violation: largest amount by which a spring force exceeds its bound [N].
        unique: whether the translation was determined on every ramp.
        events: number of linear pieces.
        overspent: number of ramps whose budget of work was exceeded.
        unsolved: number of ramps in which the active set of a graph did not converge.
    """

    visited: float
    work: float = 0.0
    dissipation: float = 0.0
    loads_work: float = 0.0
    jump_loss: float = 0.0
    residual: float = 0.0
    violation: float = 0.0
    unique: bool = True
    events: int = 0
    overspent: int = 0
    unsolved: int = 0

    def add(self, step: Step) -> None:
        """Add the account of further ramps.

        Args:
            step: the account of these ramps.
        """
        self.work += step.work
        self.dissipation += step.dissipation
        self.loads_work += step.loads_work
        self.jump_loss += step.jump_loss
        self.residual += step.certificate.energy_residual
        self.violation = max(self.violation, step.certificate.violation)
        self.visited = min(self.visited, step.visited_margin)
        self.unique = self.unique and step.unique
        self.events += step.events
        self.overspent += step.overspent
        self.unsolved += step.unsolved


def stored_energy(body: Body, tension: np.ndarray) -> np.ndarray:
    """Compute the energy of the springs.

    Args:
        body: the body.
        tension: tensions of its springs, shape (T, S), in the plane (T, S, 2) [N].

    Returns:
        Shape (T,) [J].
    """
    energy = 0.5 * tension**2 / body.stiffness.reshape(-1, *(1,) * (body.dimension - 1))
    return energy.reshape(energy.shape[0], -1).sum(axis=1)


def average_displacement(body: Body, x: np.ndarray) -> np.ndarray:
    """Average displacements over a body; every isolated contact and every segment has the same weight.

    Args:
        body: the body.
        x: displacements, shape (T, N), in the plane (T, N, 2) [m].

    Returns:
        y, shape (T,), in the plane (T, 2) [m].
    """
    if not body.segments:
        return x.mean(axis=1)
    return np.einsum("ti...,i->t...", x, body.share)  # not `@`: its last bit depends on how many rows there are
