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
        after: how many candidates are run after the search.
        stopped: whether Ctrl-C ended it.
    """

    began: float
    seconds: float | None
    after: int = 0
    stopped: bool = False

    @property
    def left(self) -> float:
        """Time that is left [s]."""
        if self.stopped:
            return 0.0
        return math.inf if self.seconds is None else self.began + self.seconds - clock()

    def over(self) -> bool:
        """Determine whether nothing more may begin.

        Returns:
            True as soon as no time is left.
        """
        return self.left <= 0.0

    def check(self, _: float = 0.0) -> None:
        """Stop a run that reports its progress.

        Args:
            _: what was done of the run, which does not matter here [1].

        Raises:
            OutOfTime: when the time is over.
        """
        if self.over():
            raise OutOfTime

    def search_seconds(self, per_evaluation: float) -> float:
        """Compute how long the search may take, so that time is left for what follows it.

        Args:
            per_evaluation: time of a candidate so far [s].

        Returns:
            The time from the beginning [s].
        """
        assert self.seconds is not None
        return self.seconds - min(self.after * per_evaluation, _MOST_KEPT * self.seconds)
