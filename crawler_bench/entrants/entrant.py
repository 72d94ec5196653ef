"""What takes part: a method at a number of ticks a period, and a run of it. All methods have this shape."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

LEAST = 2e-3
"""A lap lasts at least this long [s], so that the clock and the first call are small."""


class OutOfTime(Exception):
    """A method needs more time than its share."""


class Run(Protocol):
    """A crawler on its way, by some method.

    Attributes:
        solves: problems solved so far; 0 where the method solves none.
        failures: how many of them the solver itself called unsolved.
        steps: steps that the method took so far, where it chooses them; otherwise 0.
    """

    solves: int
    failures: int
    steps: int

    @property
    def displacement(self) -> np.ndarray:
        """X, shape (N,), in the plane (N, 2) [m]."""
        ...

    def quarter(self, number: int, deadline: float) -> float:
        """Go on for a quarter of a period.

        Args:
            number: which quarter since the start.
            deadline: of `time.perf_counter`, after which to give up [s].

        Returns:
            Time spent on what the method must do in every tick [s].

        Raises:
            OutOfTime: after the deadline.
        """
        ...

    def lap(self, number: int, deadline: float) -> tuple[float, int]:
        """Go on for whole periods, as fast as the method can.

        Args:
            number: the first quarter since the start.
            deadline: as above [s].

        Returns:
            Time spent [s] and number of periods.
        """
        ...


@dataclass(frozen=True, eq=False)
class Entrant:
    """A method at a number of ticks a period.

    Attributes:
        method: its name; entrants of the same method are one line in a picture.
        ticks: ticks a period; 0 where the method chooses its own steps.
        start: makes a run.
        label: what a picture writes at its point; by default the ticks.
        detail: what a reader should know about how it was run.
        largest: most contacts for which it can be run at all.
        implicit: whether it takes catch-up steps, so that it can be compared with ours at the same ticks.
    """

    method: str
    ticks: int
    start: Callable[[], Run]
    detail: str = ""
    label: str = ""
    largest: int = 1_000_000
    implicit: bool = False


def lap_by_quarters(run: Run, number: int, deadline: float) -> tuple[float, int]:
    """Go on quarter by quarter, for one period or as many short ones as make a lap worth timing.

    Args:
        run: the run.
        number: the first quarter since the start.
        deadline: of `time.perf_counter` [s].

    Returns:
        Time spent [s] and number of periods.
    """
    spent, periods = 0.0, 0
    while spent < LEAST and periods < 100:
        spent += sum(run.quarter(number + 4 * periods + k, deadline) for k in range(4))
        periods += 1
    return spent, periods


def check_time(deadline: float) -> None:
    """Give up after the deadline.

    Args:
        deadline: of `time.perf_counter` [s].

    Raises:
        OutOfTime: after it.
    """
    if time.perf_counter() > deadline:
        raise OutOfTime


class TickByTick:
    """The part of a run that is the same for all solvers that are called from Python for each tick.

    Attributes:
        quarters: targets of the ticks of each quarter of a period.
    """

    quarters: Sequence[np.ndarray]
    solves: int
    failures: int
    steps: int
    displacement: np.ndarray

    def tick(self, target: np.ndarray) -> None:
        """Take one implicit step to a target."""
        raise NotImplementedError

    def quarter(self, number: int, deadline: float) -> float:
        """Go on for a quarter of a period; see `Run`."""
        spent = 0.0
        for target in self.quarters[number % 4]:
            began = time.perf_counter()
            self.tick(target)
            spent += time.perf_counter() - began
            check_time(deadline)
        return spent

    def lap(self, number: int, deadline: float) -> tuple[float, int]:
        """Go on for a period; see `Run`."""
        return lap_by_quarters(self, number, deadline)
