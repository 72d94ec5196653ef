"""The search for the best gait beside general optimisers on the same kernels.

The body is that of many real crawlers: four contacts on bristles. MuJoCo, whose friction is the same in both
directions, cannot model it, and is left out for that reason.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from crawler_model import Scene
from crawler_model.optimise.optimise import build_space
from crawler_model.optimise.request import Request
from crawler_model.optimise.search import search
from crawler_model.optimise.space import Evaluator, Space

SECONDS, QUICK = 30.0, 3.0
"""Time for each method [s]."""
_SEEDS = (0, 1, 2)
_WITHIN = 0.01
_STEP = 1e-4
_Trace = list[tuple[float, float]]


def measure_search(seconds: float, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure how long each method takes to come within 1 % of the best gait that any of them found.

    Args:
        seconds: time for each method and seed [s].
        progress: called with the completed part, in [0, 1].

    Returns:
        A row for each method: best and median gain per period over three seeds [m], how many seeds came within 1 % of
        the best of all, and after how many seconds the slowest of these did. `crawler optimise` is ours; `cma` is
        CMA-ES with restarts, `slsqp` SLSQP from random starts with forward differences, `nevergrad` its default
        optimiser (if it is installed).
    """
    import cma as _loaded_before  # noqa: F401

    space = _space()
    space.scores([np.full(space.size, 0.5)])  # loads the kernels
    space.slopes(np.full(space.size, 0.5))
    methods = {"crawler optimise": _ours, "cma": _cma, "slsqp": _slsqp} | _nevergrad_if_installed()
    traces: dict[str, list[_Trace]] = {}
    for i, (name, method) in enumerate(methods.items()):
        traces[name] = []
        for j, seed in enumerate(_SEEDS):
            traces[name].append(method(space, seed, seconds))
            progress((i + (j + 1) / len(_SEEDS)) / len(methods))
    best = max(gain for several in traces.values() for trace in several for _, gain in trace)
    rows = []
    for name, several in traces.items():
        ends = [max((gain for _, gain in trace), default=-np.inf) for trace in several]
        reached = [next((t for t, gain in trace if gain >= (1.0 - _WITHIN) * best), None) for trace in several]
        within = [t for t in reached if t is not None]
        rows.append(
            {
                "case": "search",
                "method": name,
                "best": max(ends),
                "median": float(np.median(ends)),
                "seeds": len(_SEEDS),
                "within_1_percent": len(within),
                "slowest_s": max(within) if within else None,
                "limit_s": seconds,
            }
        )
    return rows


def _space() -> Space:
    """Build the gaits of four contacts with six waypoints, strokes up to 0.1 m."""
    scene = Scene.model_validate(
        {
            "name": "four",
            "body": {"contacts": [0.0, 0.1, 0.2, 0.3], "links": {"stiffness": 10.0}},
            "friction": {"forward": 0.2, "backward": 0.6},
        }
    )
    return build_space(scene, Request("translation", waypoints=6, stroke=(0.0, 0.1)))[1]


class _Clock:
    """Runs candidates and notes when a better one was found."""

    def __init__(self, space: Space, seconds: float) -> None:
        self.evaluator, self.seconds = Evaluator(space), seconds
        self.trace: _Trace = []
        self.began = time.perf_counter()

    def over(self) -> bool:
        return time.perf_counter() - self.began >= self.seconds

    def scores(self, points: list[np.ndarray]) -> np.ndarray:
        scores = self.evaluator.scores([np.clip(point, 0.0, 1.0) for point in points])
        best = float(scores.max(initial=-np.inf))
        if not self.trace or best > self.trace[-1][1]:
            self.trace.append((time.perf_counter() - self.began, best))
        return scores


def _ours(space: Space, seed: int, seconds: float) -> _Trace:
    found = search(space, seed, seconds, [np.full(space.size, 0.5)])
    return [(found.found_after_s, found.score)]


def _cma(space: Space, seed: int, seconds: float) -> _Trace:
    import cma

    clock, random = _Clock(space, seconds), np.random.default_rng(seed)
    while not clock.over():
        options = {"bounds": [0.0, 1.0], "seed": int(random.integers(1, 2**31)), "verbose": -9}
        strategy = cma.CMAEvolutionStrategy(random.random(space.size), 0.3, options)
        while not strategy.stop() and not clock.over():
            asked = strategy.ask()
            strategy.tell(asked, list(-clock.scores(asked)))
    clock.evaluator.close()
    return clock.trace


def _slsqp(space: Space, seed: int, seconds: float) -> _Trace:
    from scipy.optimize import minimize

    clock, random = _Clock(space, seconds), np.random.default_rng(seed)

    def stop(*_: Any) -> None:
        if clock.over():
            raise StopIteration

    def value_and_slope(point: np.ndarray) -> tuple[float, np.ndarray]:
        stop()
        toward = np.where(point > 0.5, -_STEP, _STEP)
        scores = clock.scores([point, *(point + np.diag(toward))])
        return -float(scores[0]), -(scores[1:] - scores[0]) / toward

    bounds = [(0.0, 1.0)] * space.size
    while not clock.over():
        try:
            minimize(value_and_slope, random.random(space.size), jac=True, bounds=bounds, method="SLSQP")
        except StopIteration:
            break
    clock.evaluator.close()
    return clock.trace


def _nevergrad_if_installed() -> dict[str, Callable[[Space, int, float], _Trace]]:
    try:
        import nevergrad
    except ModuleNotFoundError:
        return {}

    def run(space: Space, seed: int, seconds: float) -> _Trace:
        clock = _Clock(space, seconds)
        unknowns = nevergrad.p.Array(init=np.full(space.size, 0.5), lower=0.0, upper=1.0)
        unknowns.random_state.seed(seed)
        optimizer = nevergrad.optimizers.NGOpt(parametrization=unknowns, budget=100_000, num_workers=16)

        while not clock.over():
            asked = [optimizer.ask() for _ in range(16)]
            for one, score in zip(asked, clock.scores([one.value for one in asked]), strict=True):
                optimizer.tell(one, -float(score))
        clock.evaluator.close()
        return clock.trace

    return {"nevergrad": run}
