"""What a simulator counts and measures in a run: ticks that need attention, jumps, certificates, inertia."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crawler_model import Scene
from crawler_model.crawler.yields import YieldTimes, start_yield_times
from crawler_model.motion.jump import Jump
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

    def add_ticks(self, ambiguous: float, overspent: float, unsolved: float) -> None:
        """Add ticks, as `sum_accounts` counts them."""
        self.ambiguous += int(ambiguous)
        self.overspent += int(overspent)
        self.unsolved += int(unsolved)

    def add_jumps(self, jumps: Sequence[Jump], stability: float | None) -> None:
        """Add the jumps of a tick, and its stability margin if the body turns."""
        if jumps:
            self.jumps += len(jumps)
            self.jump_loss += math.fsum(jump.loss for jump in jumps)
        if stability is not None:
            self.stability = min(self.stability, stability)


def start_counts(scene: Scene, method: str) -> tuple[Certificates, Counts, YieldTimes | None, InertiaMeter | None]:
    """Start to count, at the start of a simulator or at a reset.

    Args:
        scene: the scene that runs.
        method: the method by which its ticks are computed.

    Returns:
        Certificates, counts, and the times of limits of tension and the inertia number, if the scene can have them.
    """
    return certificates_of(scene, method), Counts(), start_yield_times(scene.body), start_meter(scene)
