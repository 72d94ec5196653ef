"""Our own methods as entrants."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from crawler_model import Crawler, Scene

from ..cases import Case
from .entrant import LEAST, Entrant

_MOST_NUMBERS = 5_000_000
"""Largest size of the commands of one call."""


class _Ours:
    """A run with all ticks of a lap in one call, or with one call per tick."""

    def __init__(self, scene: Scene, quarters: tuple[np.ndarray, ...], exact: bool, each: bool) -> None:
        planar = scene.dimension == 2
        self.crawler = Crawler(scene, "exact" if exact and not planar else "catch_up")
        self.quarters, self.each = quarters, each
        self.solves = self.failures = self.steps = 0
        self.chunk: tuple[list[np.ndarray], int] | None = None

    @property
    def displacement(self) -> np.ndarray:
        return self.crawler.displacement

    def _follow(self, targets: np.ndarray) -> float:
        follow = self.crawler.follow
        if self.each:
            rows = [row[None] for row in targets]
            began = time.perf_counter()
            for row in rows:
                follow(row)
            return time.perf_counter() - began
        began = time.perf_counter()
        follow(targets)
        return time.perf_counter() - began

    def quarter(self, number: int, deadline: float) -> float:
        return self._follow(self.quarters[number % 4])

    def lap(self, number: int, deadline: float) -> tuple[float, int]:
        if self.chunk is None:
            spent = sum(self._follow(targets) for targets in self.quarters)
            size = sum(targets.size for targets in self.quarters)
            if size > _MOST_NUMBERS:
                self.chunk = list(self.quarters), 1
            else:
                periods = max(1, min(int(LEAST / spent) + 1, _MOST_NUMBERS // size))
                self.chunk = [np.tile(np.concatenate(self.quarters), (periods, 1))], periods
        targets, periods = self.chunk
        return sum(self._follow(part) for part in targets), periods


def build_ours(case: Case, exact: tuple[int, ...], catch_up: tuple[int, ...], each: tuple[int, ...]) -> list[Entrant]:
    """Build entrants of our methods on a line.

    Returns:
        The entrants.
    """

    def start(ticks: int, is_exact: bool, one_call: bool = False) -> Callable[[], _Ours]:
        through = is_exact or ticks >= case.waypoints
        return lambda: _Ours(case.scene, case.quarters(ticks, through), is_exact, one_call)

    compiled, single = "all ticks in one call", "one call of Crawler.follow from Python for each tick"
    entrants = [Entrant("exact", t, start(t, True), compiled) for t in exact]
    entrants += [Entrant("catch_up", t, start(t, False), compiled) for t in catch_up]
    entrants += [
        Entrant("exact, one call a tick", t, start(t, True, True), single) for t in each if t >= case.waypoints
    ]
    entrants += [Entrant("catch_up, one call a tick", t, start(t, False, True), single) for t in each]
    return entrants


def build_planar(case: Case, tolerances: tuple[float, ...]) -> list[Entrant]:
    """Build entrants of our method in the plane, whose steps are refined to a tolerance.

    Returns:
        The entrants.
    """

    def start(tolerance: float) -> Callable[[], _Ours]:
        scene = Scene.model_validate(case.scene.document() | {"tolerance": tolerance})
        return lambda: _Ours(scene, case.quarters(4, True), False, False)

    return [
        Entrant(
            "catch_up, refined",
            max(4, case.waypoints),
            start(t),
            f"steps refined to {t:g} of the stroke",
            f"tolerance {t:.0e}".replace("e-0", "e-"),
        )
        for t in tolerances
    ]


def catch_up_displacement(case: Case, ticks: int, count: int) -> np.ndarray:
    """Compute the result of catch-up steps, to separate a peer's own error from the error of the steps.

    Returns:
        x at the end of each quarter, shape (count, N) [m].
    """
    run = _Ours(case.scene, case.quarters(ticks, ticks >= case.waypoints), False, False)
    found = []
    for number in range(count):
        run.quarter(number, np.inf)
        found.append(run.displacement)
    return np.array(found)
