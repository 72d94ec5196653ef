"""What a simulator counts in a run: ticks that need attention, and jumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crawler_model.crawler.step import Step
from crawler_model.motion.state import AMBIGUOUS, OVERSPENT, UNSOLVED


@dataclass
class Counts:
    """Counts since the start or the last reset.

    Attributes:
        ambiguous: ticks whose translation was not determined.
        overspent: ticks over the budget of work.
        unsolved: ticks that were not solved.
        jumps: jumps on patches of ground.
        unheld: ticks that were refused because nothing would hold the body.
    """

    ambiguous: int = 0
    overspent: int = 0
    unsolved: int = 0
    jumps: int = 0
    unheld: int = 0

    def add(self, step: Step) -> None:
        """Add the account of a tick."""
        self.ambiguous += not step.unique
        self.overspent += step.overspent
        self.unsolved += step.unsolved
        self.jumps += len(step.jumps)

    def add_many(self, accounts: np.ndarray) -> None:
        """Add the accounts of several ticks without jumps, shape (K, 14)."""
        self.ambiguous += int(np.count_nonzero(accounts[:, AMBIGUOUS]))
        self.overspent += int(accounts[:, OVERSPENT].sum())
        self.unsolved += int(accounts[:, UNSOLVED].sum())
