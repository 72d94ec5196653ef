"""The interface of all methods: an entrant, which is a method at a number of ticks per period, and a run of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

LEAST = 2e-3
"""A lap lasts at least this long [s], so that the clock and the first call are negligible."""


class OutOfTime(Exception):
    """A method exceeded its time."""


class Run(Protocol):
    """A simulation of a crawler by some method.

    Attributes:
        solves: number of problems solved so far; 0 for methods that solve none.
        failures: number of these that the solver itself reported as unsolved.
        steps: number of steps so far, for methods that choose them; otherwise 0.
    """

    solves: int
    failures: int
    steps: int

    @property
    def displacement(self) -> np.ndarray:
        """X, shape (N,), in the plane (N, 2) [m]."""

    def quarter(self, number: int, deadline: float) -> float:
        """Simulate a quarter of a period.

        Returns:
            Time spent on the work of every tick [s].
        """

    def lap(self, number: int, deadline: float) -> tuple[float, int]:
        """Simulate whole periods as fast as the method can.

        Returns:
            Time spent [s] and number of periods.
        """


@dataclass(frozen=True, eq=False)
class Entrant:
    """A method at a number of ticks per period.

    Attributes:
        method: its name; entrants of the same method are one line in a picture.
        ticks: ticks per period; 0 for methods that choose their own steps.
        start: function that starts a run.
        label: label of its point in a picture; by default the number of ticks.
        detail: remarks on how it was run.
        largest: largest number of contacts for which it can be run.
        implicit: whether it takes catch-up steps, so that it can be compared with ours at the same ticks.
    """

    method: str
    ticks: int
    start: Callable[[], Run]
    detail: str = ""
    label: str = ""
    largest: int = 1_000_000
    implicit: bool = False


def check_time(deadline: float) -> None:
    """Stop after the deadline."""
    if time.perf_counter() > deadline:
        raise OutOfTime


class ByQuarters:
    """The common part of runs whose laps consist of quarters."""

    solves = failures = steps = 0

    def quarter(self, number: int, deadline: float) -> float:
        """Simulate a quarter of a period; see `Run`."""
        raise NotImplementedError

    def lap(self, number: int, deadline: float) -> tuple[float, int]:
        """Simulate one period, or as many short ones as a lap needs for its timing; see `Run`."""
        spent, periods = 0.0, 0
        while spent < LEAST and periods < 100:
            spent += sum(self.quarter(number + 4 * periods + k, deadline) for k in range(4))
            periods += 1
        return spent, periods


class TickByTick(ByQuarters):
    """The common part of runs of solvers that are called from Python for each tick.

    Attributes:
        quarters: targets of the ticks in each quarter of a period.
    """

    quarters: Sequence[np.ndarray]
    displacement: np.ndarray

    def tick(self, target: np.ndarray) -> None:
        """Take one implicit step to a target."""
        raise NotImplementedError

    def quarter(self, number: int, deadline: float) -> float:
        """Simulate a quarter of a period; see `Run`."""
        spent = 0.0
        for target in self.quarters[number % 4]:
            began = time.perf_counter()
            self.tick(target)
            spent += time.perf_counter() - began
            check_time(deadline)
        return spent
