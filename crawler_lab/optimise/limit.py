"""The time limit of an optimisation, which covers the search and all that follows it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from crawler_model.compiled import clock

_MOST_KEPT = 0.4
"""Largest part of the time that is kept for what follows the search."""


class OutOfTime(Exception):
    """The time is over."""


@dataclass
class TimeLimit:
    """When an optimisation has to end.

    Attributes:
        began: when it began, as by `clock` [s].
        seconds: time limit, compiling aside [s]; None for none.
        around: how many candidates are run around the best gait after the search.
        last: how many are run after these.
        stopped: whether Ctrl-C ended it.
    """

    began: float
    seconds: float | None
    around: int = 0
    last: int = 0
    stopped: bool = False

    @property
    def left(self) -> float:
        """Time that is left [s]."""
        if self.stopped:
            return 0.0
        return math.inf if self.seconds is None else self.began + self.seconds - clock()

    def over(self, kept: float = 0.0) -> bool:
        """Determine whether nothing more may begin.

        Args:
            kept: for what follows [s].

        Returns:
            True as soon as no more time than this is left.
        """
        return self.left <= kept

    def check(self, _: float = 0.0) -> None:
        """Stop a run that reports its progress.

        Args:
            _: what was done of the run, which does not matter here [1].

        Raises:
            OutOfTime: when the time is over.
        """
        if self.over():
            raise OutOfTime

    def keep(self, candidates: int, per_evaluation: float) -> float:
        """Compute the time to keep for candidates after the search, which together have a part of the time at most.

        Args:
            candidates: how many of them.
            per_evaluation: time of a candidate so far [s].

        Returns:
            The time [s]; 0 without a limit.
        """
        if self.seconds is None:
            return 0.0
        return candidates * min(per_evaluation, _MOST_KEPT * self.seconds / max(self.around + self.last, 1))
