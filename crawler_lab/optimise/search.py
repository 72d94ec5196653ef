"""Global search: random gaits, waves and symmetric gaits, local search, CMA-ES, and again from changed optima."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from crawler_model.compiled import clock

from .goal import best_first
from .limit import TimeLimit
from .polish import flip, improve, improves
from .space import Evaluator, Space
from .starts import Starts

_STALE_ROUNDS = {1: 12, 2: 4}
"""Rounds without a better gait after which the search ends, by the dimension of the body: in the plane one of each
kind, as each gait takes a hundred times longer than on a line."""
_BETTER = 1e-4
"""Improvements by a smaller part do not count as better for this."""
MOST_EVALUATIONS = 30_000
"""Candidates after which a search without a time limit ends."""
_KEPT = 32
_FLIPPED, _CLIMBED = 8, 2
"""How many of the best points of a kind are improved by flips, and how many of these by derivatives."""
_HOPS = {1: 8, 2: 1}
"""Local searches from changed or mixed optima in a round, by the dimension of the body."""
_TRIED = 8
"""Changed or mixed optima; the best one begins a local search."""
_COARSE, _ALIKE = 1e-2, 5e-2
"""Step at which a local search ends at first, and distance within which it then leads to an optimum that is known."""
_MIRRORED = 0.25
"""How often an optimum is mixed with its own image."""
_SAME = 1e-3
"""Gaits whose unknowns differ by less than this part of their bounds are the same."""


class Kind(Enum):
    """Kinds of gaits that a search tries in turn; the value is the text for people."""

    RANDOM = "random gaits"
    WAVES = "waves"
    MIRRORED = "gaits that are their own images"
    MIXED = "mixtures of optima"
    EVOLVED = "CMA-ES around the best"
    CHANGED = "changes of optima"


Scored = tuple[float, np.ndarray]
"""A score, and its point."""


@dataclass
class Found:
    """What a search has found.

    Attributes:
        point: the best point, shape (P,).
        score: its score [m or 1].
        optima: local optima, best first: score and point.
        evaluations: how many candidates were run, with derivatives or without.
        found_after_s: when the best one was found [s].
        interrupted: whether Ctrl-C ended the search.
        complete: whether it ended by itself, so that its result does not depend on the machine.
        exhausted: whether that was after `MOST_EVALUATIONS`.
        untried: kinds of gaits that were not tried, or not to their end.
    """

    point: np.ndarray
    score: float
    optima: list[Scored] = field(default_factory=list)
    evaluations: int = 0
    found_after_s: float = 0.0
    interrupted: bool = False
    complete: bool = False
    exhausted: bool = False
    untried: list[Kind] = field(default_factory=lambda: list(Kind))


def search(
    space: Space,
    seed: int,
    limit: TimeLimit,
    begin: list[np.ndarray],
    progress: Callable[[float], None] | None = None,
    rounds: int | None = None,
) -> Found:
    """Search the best candidate.

    Args:
        seed: of the random numbers.
        limit: the time limit; without one the search ends when several rounds found nothing better.
        begin: points to begin with.
        progress: called with the completed part, in [0, 1].
        rounds: how many rounds without a better gait end the search; None for 12, in the plane 4.

    Returns:
        What was found; after Ctrl-C the best so far.
    """
    import cma  # takes a second, and is needed only here  # noqa: F401

    run = _Search(space, seed, limit, progress, rounds)
    try:
        run.go(begin)
    except KeyboardInterrupt:
        run.found.interrupted = True
    finally:
        run.evaluator.close()
    point, score, when = run.evaluator.best
    if score > -np.inf:
        run.note(point, score, when)
    run.found.evaluations = run.evaluator.evaluations
    return run.found


class _Search:
    def __init__(
        self,
        space: Space,
        seed: int,
        limit: TimeLimit,
        progress: Callable[[float], None] | None,
        rounds: int | None,
    ) -> None:
        rounds = rounds or _STALE_ROUNDS[space.scenes[0].base.dimension]
        self.space, self.limit, self.rounds = space, limit, min(rounds, 3 + space.size)
        self.dimension = space.scenes[0].base.dimension
        self.random = np.random.default_rng(seed)
        self.starts = Starts(space, self.random)
        self.evaluator = Evaluator(space, None if limit.seconds is None else self.over)
        self.began = clock()
        self.progress = progress
        self.part = 0.0
        self.pool: list[Scored] = []
        self.found = Found(space.repair(np.full(space.size, 0.5)), -np.inf)

    def go(self, begin: list[np.ndarray]) -> None:
        stale = 0
        for number in itertools.count():
            before = self.found.score
            self.round(number, begin if number == 0 else [])
            stale = 0 if self.found.score > before + _BETTER * abs(before) or number == 0 else stale + 1
            if self.limit.seconds is None:
                self.report(max(stale / self.rounds, self.evaluator.evaluations / MOST_EVALUATIONS))
            over = self.over()
            self.found.exhausted = over and self.limit.seconds is None
            self.found.complete = stale >= self.rounds or self.found.exhausted
            if self.found.complete or over:
                return

    def over(self) -> bool:
        """Determine whether the time limit is reached, or without one the limit of the evaluations."""
        if self.limit.seconds is None:
            return self.evaluator.evaluations >= MOST_EVALUATIONS
        now = clock()
        each = (now - self.began) / max(self.evaluator.evaluations, 1)
        most = self.limit.seconds - self.limit.keep(self.limit.around + self.limit.last, each)
        self.report((now - self.limit.began) / most)
        return now - self.limit.began >= most

    def report(self, part: float) -> None:
        self.part = min(1.0, max(self.part, part))
        if self.progress is not None:
            self.progress(self.part)

    def note(self, point: np.ndarray, score: float, when: float | None = None) -> None:
        """Keep a point if it is the best one so far; it was found just now unless another time is given."""
        if improves(score, self.found.score) or not np.isfinite(self.found.score):
            self.found.point, self.found.score = point.copy(), score
            self.found.found_after_s = (clock() if when is None else when) - self.began

    def round(self, number: int, begin: list[np.ndarray]) -> None:
        """Search once: from random points and waves, from mixed or changed optima, or by CMA-ES around the best."""
        kind = (None, Kind.MIXED, Kind.EVOLVED, Kind.CHANGED)[number % 4]
        if kind is None:
            self.start_anew(begin)
            return
        if kind is Kind.EVOLVED:
            self.improve(*self.evolve(self.found.point, self.found.score))
        else:
            for _ in range(_HOPS[self.dimension]):
                if not self.over():
                    self.hop(self.mixed if kind is Kind.MIXED else self.changed)
        self.note_tried(kind)

    def note_tried(self, kind: Kind) -> None:
        """Note that a kind of gaits was tried to its end, unless the search is over."""
        if kind in self.found.untried and not self.over():
            self.found.untried.remove(kind)

    def start_anew(self, begin: list[np.ndarray]) -> None:
        """Improve the best of random points, of waves, and of gaits that are their own images."""
        for kind, points in (
            (Kind.RANDOM, [*begin, *self.starts.random_points()]),
            (Kind.WAVES, [*self.starts.waves(), *self.starts.on_off_waves(), *self.starts.delayed_points()]),
            (Kind.MIRRORED, self.starts.mirrored_points()),
        ):
            self.improve_best([self.space.repair(point) for point in points])
            self.note_tried(kind)

    def improve_best(self, points: list[np.ndarray]) -> None:
        """Flip the best of some points, and search locally from the best of these."""
        if not points or (np.isfinite(self.found.score) and self.over()):  # some gait is run whatever the time
            return
        scores = self.evaluator.scores(points)
        flipped = []
        for k in best_first(scores)[:_FLIPPED]:
            point, score = flip(self.evaluator, points[int(k)], float(scores[k]), self.over)
            self.note(point, score)
            flipped.append((point, score))
            self.pool = self.with_one(self.pool, point, score)
        for k in best_first([score for _, score in flipped])[:_CLIMBED]:
            self.climb(*flipped[int(k)])

    def hop(self, draw: Callable[[], np.ndarray]) -> None:
        """Search locally from the best of some points that are drawn."""
        points = [self.space.repair(draw()) for _ in range(_TRIED)]
        scores = self.evaluator.scores(points)
        k = int(best_first(scores)[0])
        self.climb(points[k], float(scores[k]))

    def climb(self, point: np.ndarray, score: float) -> None:
        """Search locally with coarse steps, and on with fine ones unless that leads to an optimum that is known."""
        point, score = improve(self.evaluator, point, score, self.over, _COARSE)
        if not self.is_known(point, score):
            self.improve(point, score)

    def is_known(self, point: np.ndarray, score: float) -> bool:
        """Determine whether a point that was found coarsely leads to one of the optima."""
        shape, canonical = self.space.canonical(point), self.space.canonical
        return any(
            not improves(score, best) and np.abs(canonical(other) - shape).max(initial=0.0) < _ALIKE
            for best, other in self.found.optima
        )

    def improve(self, point: np.ndarray, score: float) -> None:
        """Search locally, and keep the local optimum."""
        self.note(point, score)
        point, score = improve(self.evaluator, point, score, self.over)
        self.note(point, score)
        self.keep(point, score)

    def keep(self, point: np.ndarray, score: float) -> None:
        if score == -np.inf and self.found.optima:
            return
        self.found.optima = self.with_one(self.found.optima, point, score)
        self.pool = self.with_one(self.pool, point, score)

    def with_one(self, optima: list[Scored], point: np.ndarray, score: float) -> list[Scored]:
        """Put a point among others, the best first, and leave out equal ones and the last ones."""
        optima = sorted([*optima, (score, point.copy())], key=lambda pair: -pair[0])
        return distinct(optima, self.space.canonical)[:_KEPT]

    def parent(self) -> np.ndarray:
        """Draw one of the best points that flips do not improve, the better ones more often."""
        return self.pool[int(len(self.pool) * self.random.random() ** 2)][1].copy()

    def changed(self) -> np.ndarray:
        """Change some unknowns of an optimum."""
        point = self.parent()
        changed = self.random.random(point.size) < self.random.choice([0.1, 0.2, 0.4])
        changed[int(self.random.integers(0, point.size))] = True
        ends = self.random.integers(0, 2, point.size).astype(np.float64)
        drawn = np.where(self.random.random(point.size) < 0.7, ends, self.random.random(point.size))
        return np.where(changed, drawn, point)

    def mixed(self) -> np.ndarray:
        """Mix two optima: some numbers, and some waypoints or some links, of one and the rest of the other.

        The other one begins at any waypoint, or is its image in time or along the body. Sometimes one optimum is mixed
        with its own image instead, see `Starts.mirrored`.
        """
        point, other = self.parent(), self.parent()
        (numbers, rows), (more, others) = (self.space.scenes[0].split(one) for one in (point, other))
        numbers = np.where(self.random.random(numbers.size) < 0.5, numbers, more)
        table = self.space.scenes[0].table
        if table is None or rows is None or others is None:
            return numbers
        if self.random.random() < _MIRRORED:
            return self.starts.mirrored(point)
        others = np.roll(others, int(self.random.integers(0, len(others))), axis=0)
        image = self.random.integers(0, 4)
        if image == 1:
            others = others[::-1]
        elif image == 2:
            others = np.hstack((others[:, : table.links][:, ::-1], others[:, table.links :][:, ::-1]))
        across = self.random.random() < 0.5
        taken = self.random.random((1, rows.shape[1]) if across else (len(rows), 1)) < 0.5
        return np.concatenate((numbers, np.where(taken, rows, others).ravel()))

    def evolve(self, point: np.ndarray, score: float) -> tuple[np.ndarray, float]:
        """Run CMA-ES around a point."""
        import cma

        def draw(*shape: int) -> np.ndarray:
            return self.random.standard_normal(shape)

        options: dict[str, Any] = {
            "bounds": [0.0, 1.0],
            "seed": np.nan,
            "randn": draw,
            "verbose": -9,
            "maxiter": 30 + 2 * self.space.size,
        }
        if self.space.size == 1:
            return point, score
        strategy = cma.CMAEvolutionStrategy(np.clip(point, 0.05, 0.95), 0.2, options)
        while not strategy.stop() and not self.over():
            asked = strategy.ask()
            points = [self.space.repair(np.asarray(x)) for x in asked]
            scores = self.evaluator.scores(points)
            if not self.over():  # else candidates may be left out, and the loop ends
                strategy.tell(asked, list(-scores))
            k = int(best_first(scores)[0])
            if scores[k] > score:
                point, score = points[k], float(scores[k])
            self.note(points[k], float(scores[k]))
        return point, score


def distinct(optima: list[Scored], canonical: Callable[[np.ndarray], np.ndarray]) -> list[Scored]:
    """Leave out optima that are the same gait.

    Args:
        optima: scores and points, best first.
        canonical: maps a point to one that equal gaits share.

    Returns:
        The distinct ones.
    """
    kept: list[Scored] = []
    shapes: list[np.ndarray] = []
    for score, point in optima:
        shape = canonical(point)
        if not any(np.abs(other - shape).max(initial=0.0) < _SAME for other in shapes):
            kept.append((score, point))
            shapes.append(shape)
    return kept
