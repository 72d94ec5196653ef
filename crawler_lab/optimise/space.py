"""The unit box of the unknowns, in which gaits are searched, and the rates that waypoints have to keep."""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from crawler_model.compiled import clock
from crawler_model.errors import CrawlerError

from ..sweep.workers import available_cores
from .followed import find_followed_regime
from .goal import Goal
from .regime import Regime, differentiate_regime, find_peak, find_regimes
from .unknowns import Unknowns

_CHUNK = 64
"""Candidates that are run in one compiled call."""
_LONGEST = 0.05
"""Time that such a call may take where there is a time limit [s]."""


@dataclass(frozen=True, eq=False)
class Space:
    """The candidates: unknowns scaled to [0, 1], judged by a goal on one scene or on several.

    Attributes:
        scenes: the same unknowns for each scene; a candidate is as good as on the scene where it is worst.
        goal: the goal, a single objective if `mean`.
        mean: whether a candidate is as good as in the mean over the scenes instead.
    """

    scenes: tuple[Unknowns, ...]
    goal: Goal
    mean: bool = False

    @property
    def size(self) -> int:
        """Number of unknowns P."""
        return int(self.scenes[0].low.size)

    def values(self, unit: np.ndarray) -> np.ndarray:
        """Convert a point of the unit box to values of the unknowns.

        Returns:
            Shape (P,); exactly the bounds at 0 and 1.
        """
        low, high = self.scenes[0].low, self.scenes[0].high
        return np.asarray(np.where(unit >= 1.0, high, low + np.maximum(unit, 0.0) * (high - low)))

    def steps(self) -> np.ndarray | None:
        """Compute by how much an unknown may change from one waypoint to the next.

        Returns:
            In units of the box, shape (width,), infinite for friction; None without a rate or a table.
        """
        table = self.scenes[0].table
        if table is None or not np.isfinite(self.goal.rate):
            return None
        most = np.full(table.width, np.inf)
        ramp = table.period / table.waypoints
        lengths = (table.high - table.low)[: table.links] * table.span
        most[: table.links] = self.goal.rate * ramp / np.maximum(lengths, 1e-300)
        return most

    def repair(self, unit: np.ndarray) -> np.ndarray:
        """Move a point into the box, and waypoints so close together that they keep the rate.

        The mean of the largest sequence below and the smallest above that keep it is unchanged where it keeps it, and
        stays in the box.

        Returns:
            Shape (P,).
        """
        unit = np.clip(unit, 0.0, 1.0)
        most = self.steps()
        if most is None:
            return unit
        numbers, rows = self.scenes[0].split(unit)
        assert rows is not None
        count = rows.shape[0]
        apart = np.abs(np.arange(count)[:, None] - np.arange(count))
        apart = np.minimum(apart, count - apart)[:, :, None]
        reach = np.where(apart > 0, apart * np.where(np.isfinite(most), most, 2.0), 0.0)
        below, above = (rows + reach).min(axis=1), (rows - reach).max(axis=1)
        kept = np.where(np.isfinite(most), 0.5 * (below + above), rows)
        return np.concatenate((numbers, np.clip(kept, 0.0, 1.0).ravel()))

    def canonical(self, unit: np.ndarray) -> np.ndarray:
        """Choose the waypoint at which a period begins: the same gait may begin at any, but its frame turns with it.

        Returns:
            Shape (P,), the same for all beginnings; for a body that turns, and on patches, as it is.
        """
        numbers, rows = self.scenes[0].split(unit)
        base = self.scenes[0].base
        if rows is None or base.body.turning is not None or base.ground.differs:
            return unit
        turned = [np.roll(rows, -k, axis=0).ravel() for k in range(rows.shape[0])]
        return np.concatenate((numbers, max(turned, key=lambda row: np.round(row, 4).tolist())))

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Write the rates as linear inequalities, A u <= b.

        Returns:
            A, shape (R, P), and b, shape (R,); without rows if there are none.
        """
        most, table = self.steps(), self.scenes[0].table
        if most is None or table is None:
            return np.zeros((0, self.size)), np.zeros(0)
        limited = np.flatnonzero(most < 1.0)
        now = len(self.scenes[0].keys) + table.width * np.arange(table.waypoints)[:, None] + limited
        unit = np.eye(self.size)
        rows = unit[np.roll(now, -1, axis=0).ravel()] - unit[now.ravel()]
        return np.stack((rows, -rows), axis=1).reshape(-1, self.size), np.tile(np.repeat(most[limited], 2), len(now))

    def regimes(self, points: np.ndarray) -> list[list[Regime | None]]:
        """Compute the periodic regimes of candidates on each scene.

        Args:
            points: shape (M, P).

        Returns:
            For each candidate the regimes; None where it cannot be followed or numbers do not fit together.
        """
        values = np.array([self.values(point) for point in points])
        each = [self._regimes(unknowns, values) for unknowns in self.scenes]
        return [list(of_one) for of_one in zip(*each, strict=True)]

    def _regimes(self, unknowns: Unknowns, values: np.ndarray) -> list[Regime | None]:
        try:
            if not unknowns.base.has_exact_derivatives:
                return [find_followed_regime(unknowns.cycle(row), self.goal) for row in values]
            found = find_regimes(unknowns.cycles(values))
            if np.isfinite(self.goal.tension):
                for m, regime in enumerate(found):
                    if regime is not None:
                        found[m] = dataclasses.replace(regime, peak=find_peak(unknowns.cycle(values[m])))
        except CrawlerError:
            if values.shape[0] == 1:
                return [None]
            return [self._regimes(unknowns, row[None])[0] for row in values]
        return found

    def scores(self, points: Sequence[np.ndarray]) -> list[float]:
        """Compute the scores of candidates, the worst one or the mean of all scenes.

        Args:
            points: each of shape (P,).

        Returns:
            The scores.
        """
        return [self.score(regimes) for regimes in self.regimes(np.array(points))]

    def score(self, regimes: Sequence[Regime | None]) -> float:
        """Compute the score of a candidate.

        Args:
            regimes: its regimes on the scenes.

        Returns:
            The worst one, or the mean [1].
        """
        combine = _mean if self.mean else min
        return combine([min(self.goal.scores(regime)) for regime in regimes])

    def value(self, regimes: Sequence[Regime | None]) -> float:
        """Compute what the objective is named after for a candidate.

        Args:
            regimes: its regimes on the scenes; scenes without one do not count.

        Returns:
            On the scene where it is worst, or the mean [m or 1]; NaN where it has no value.
        """
        followed = [regime for regime in regimes if regime is not None]
        if not followed:
            return math.nan
        if self.mean:
            return _mean([self.goal.measure(regime) for regime in followed])
        return self.goal.measure(min(followed, key=lambda regime: min(self.goal.scores(regime))))

    def slopes(self, unit: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """Differentiate all scores of a candidate.

        Returns:
            Each score, or their mean, and its derivatives in units of the box, shape (P,); nothing if one of them has
            none.
        """
        if not self.scenes[0].base.has_exact_derivatives:
            return []
        values, width = self.values(unit), self.scenes[0].high - self.scenes[0].low
        found: list[tuple[float, np.ndarray]] = []
        try:
            for unknowns in self.scenes:
                regime = differentiate_regime(*unknowns.differentiate(values))
                found += [(value, slope * width) for value, slope in self.goal.derivatives(regime)]
        except CrawlerError:
            return []
        if self.mean:
            return [(_mean([value for value, _ in found]), np.mean([slope for _, slope in found], axis=0))]
        return found


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


class Evaluator:
    """Computes scores on all cores, and counts them. The scores do not depend on the number of threads."""

    def __init__(self, space: Space, over: Callable[[], bool] | None = None, evaluations: int = 0) -> None:
        """Start the threads, one per core.

        Args:
            over: tells that the time limit is reached, after which no candidates but the very first ones are run;
                None without a limit.
            evaluations: how many candidates were run before.
        """
        self.space, self.over = space, over
        self.evaluations = evaluations
        """How many candidates were run, with derivatives or without."""
        self.best = np.zeros(0), -math.inf, 0.0
        """The best of them, shape (P,), its score, and when it was found, as by `clock` [s]."""
        self._lock = threading.Lock()
        self._each = math.inf
        threads = available_cores()
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def scores(self, points: Sequence[np.ndarray]) -> np.ndarray:
        """Compute the scores of candidates.

        Args:
            points: in the unit box, each of shape (P,).

        Returns:
            Shape (M,); -inf for candidates that the time limit leaves out.
        """
        found = self.regimes(points)
        return np.array([-math.inf if regimes is None else self.space.score(regimes) for regimes in found])

    def regimes(self, points: Sequence[np.ndarray]) -> list[list[Regime | None] | None]:
        """Compute the periodic regimes of candidates.

        Args:
            points: in the unit box, each of shape (P,).

        Returns:
            For each candidate its regimes on all scenes; None if the time limit leaves it out.
        """
        if math.isinf(self._each) and self._may_wait and len(points) > 1 and not self.is_over():
            return self.regimes(points[:1]) + self.regimes(points[1:])
        first = self.evaluations < 2
        together = self._count_together()
        parts = [points[i : i + together] for i in range(0, len(points), together)]

        def run_part(i: int) -> list[list[Regime | None] | None]:
            left_out = self.is_over() and not (first and i == 0)
            return [None] * len(parts[i]) if left_out else self._run(parts[i])

        run = map if self._pool is None or len(parts) < 2 else self._pool.map
        return [regimes for part in run(run_part, range(len(parts))) for regimes in part]

    @property
    def _may_wait(self) -> bool:
        """Whether a time limit has to wait for candidates that are run together, as only on a line."""
        return self.over is not None and self.space.scenes[0].base.dimension == 1

    def _count_together(self) -> int:
        """Count the candidates of a compiled call, between which the time limit is looked at."""
        if self._may_wait:
            return int(np.clip(_LONGEST / max(self._each, 1e-9), 1, _CHUNK))
        return _CHUNK if self.space.scenes[0].base.dimension == 1 else 1

    def _run(self, points: Sequence[np.ndarray]) -> list[list[Regime | None] | None]:
        """Follow some candidates, which Ctrl-C does not lose."""
        begin = clock()
        found = self.space.regimes(np.array(points))
        self._each = (clock() - begin) / len(points)
        with self._lock:
            self.evaluations += len(points)
            for point, regimes in zip(points, found, strict=True):
                score = self.space.score(regimes)
                if score > self.best[1]:
                    self.best = point.copy(), score, clock()
        return list(found)

    def slopes(self, point: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """Differentiate the scores of a candidate.

        Args:
            point: in the unit box, shape (P,).

        Returns:
            As for `Space.slopes`.
        """
        self.evaluations += 1
        return self.space.slopes(point)

    def is_over(self) -> bool:
        """Determine whether the time limit is reached.

        Returns:
            False without a limit.
        """
        return self.over is not None and self.over()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
