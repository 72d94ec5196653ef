"""What a simulator counts and measures in a run: ticks that need attention, jumps, certificates, inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crawler_model import Scene
from crawler_model.crawler.step import Step
from crawler_model.crawler.yields import YieldTimes, start_yield_times
from crawler_model.motion.state import AMBIGUOUS, OVERSPENT, UNSOLVED
from crawler_model.run.inertia import InertiaMeter, start_meter

from .certificates import Certificates, certificates_of


@dataclass
class Counts:
    """Counts since the start or the last reset.

    Attributes:
        ambiguous: ticks whose translation was not determined.
        overspent: ticks over the budget of work.
        unsolved: ticks that were not solved.
        jumps: jumps on patches of ground, or of a body that turns and loses its stability.
        jump_loss: energy lost in them [J].
        unheld: ticks that were refused because nothing would hold the body, or a body that turns found no equilibrium.
        stability: least stability margin of a body that turns [1].
    """

    ambiguous: int = 0
    overspent: int = 0
    unsolved: int = 0
    jumps: int = 0
    jump_loss: float = 0.0
    unheld: int = 0
    stability: float = np.inf

    def add(self, step: Step, stability: float | None = None) -> None:
        """Add the account of a tick, and its stability margin if the body turns."""
        self.ambiguous += not step.unique
        self.overspent += step.overspent
        self.unsolved += step.unsolved
        if step.jumps:
            self.jumps += len(step.jumps)
            self.jump_loss += step.jump_loss
        if stability is not None:
            self.stability = min(self.stability, stability)

    def add_many(self, accounts: np.ndarray) -> None:
        """Add the accounts of several ticks without jumps, shape (K, 15)."""
        self.ambiguous += int(np.count_nonzero(accounts[:, AMBIGUOUS]))
        self.overspent += int(accounts[:, OVERSPENT].sum())
        self.unsolved += int(accounts[:, UNSOLVED].sum())


def start_counts(scene: Scene, method: str) -> tuple[Certificates, Counts, YieldTimes | None, InertiaMeter | None]:
    """Start to count, at the start of a simulator or at a reset.

    Args:
        scene: the scene that runs.
        method: the method by which its ticks are computed.

    Returns:
        Certificates, counts, and the times of limits of tension and the inertia number, if the scene can have them.
    """
    return certificates_of(scene, method), Counts(), start_yield_times(scene.body), start_meter(scene)
