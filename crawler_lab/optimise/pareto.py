"""The compromises between going far and going cheaply."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model.compiled import clock
from crawler_model.notebook import write_html
from crawler_model.scene.file import coerce_scene
from crawler_model.scene.scene import Scene

from .goal import measure, score
from .limit import TimeLimit
from .optimise import build_space, check_found
from .request import Request, first_points
from .search import Found, Kind, search
from .space import Space

_POINTS = 7
_ROUNDS = 2


@dataclass(frozen=True, eq=False, repr=False)
class Compromise:
    """A gait that no other gait found beats both in gain and in cost of transport.

    Attributes:
        gain: gain per period [m].
        cost_of_transport: work / (distance * force) [1].
        values: the unknowns, shape (P,).
        scene: a scene that plays it.
    """

    gain: float
    cost_of_transport: float
    values: np.ndarray
    scene: Scene


@dataclass(frozen=True, eq=False, repr=False)
class Front:
    """The curve of translation against cost of transport.

    Attributes:
        points: the compromises, by falling gain.
        names: names of the unknowns, shape (P,).
        evaluations: how many candidates were run.
        seed: of the random numbers.
        complete: whether every search ended by itself; False where Ctrl-C or the time limit ended one, when the result
            depends on the machine.
        wall_s: wall-clock time [s].
        interrupted: whether Ctrl-C ended the search.
        untried: kinds of gaits that not every search tried to their end, because it was stopped.
    """

    points: tuple[Compromise, ...]
    names: tuple[str, ...]
    evaluations: int
    seed: int
    complete: bool
    wall_s: float
    interrupted: bool = False
    untried: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Describe the curve in one line."""
        return f"Front({len(self.points)} gaits, gain {self.points[-1].gain:.6g} to {self.points[0].gain:.6g} m)"

    def _repr_html_(self) -> str:
        """Show the compromises in a notebook."""
        facts = [(f"{p.gain:.6g} m", f"cost of transport {p.cost_of_transport:.6g}") for p in self.points]
        return write_html(f"Front of {len(self.points)} gaits: gain per period", facts)

    def summary(self) -> dict[str, Any]:
        """Build the summary that `crawler optimise --pareto --json` prints.

        Returns:
            Plain numbers, lists and strings; schema 1.
        """
        return {
            "schema": 1,
            "scene": self.points[0].scene.name,
            "front": [
                {
                    "gain": point.gain,
                    "cost_of_transport": point.cost_of_transport if math.isfinite(point.cost_of_transport) else None,
                    "unknowns": dict(zip(self.names, point.values.tolist(), strict=True)),
                    "drive": point.scene.document()["drive"],
                }
                for point in self.points
            ],
            "evaluations": self.evaluations,
            "seed": self.seed,
            "complete": self.complete,
            "interrupted": self.interrupted,
            "untried": list(self.untried),
            "wall_s": self.wall_s,
        }


def pareto(
    scene: Scene | str | Path,
    seconds: float | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    **limits: Any,
) -> Front:
    """Find the best compromises between gain per period and cost of transport.

    Both ends of the curve are optima of a single objective; a point between them is best for the smaller of two scores,
    each the part of the way from one end to the other, with several weights.

    Args:
        scene: a scene, a path or a gallery name.
        seconds: time limit, compiling aside [s], on which the result then depends; None for none.
        seed: of the random numbers.
        progress: called with the completed part, in [0, 1].
        limits: waypoints, stroke, free, rate, tension, robust, period, towards and periods, as for `optimise`.

    Returns:
        The curve.

    Raises:
        SceneError: as for `optimise`.
        CommandError: as for `optimise`.
        TypeError: if another argument is given.
    """
    began = clock()
    scene = coerce_scene(scene, "pareto")
    names = ("waypoints", "stroke", "free", "rate", "tension", "robust", "period", "towards", "periods")
    for name in limits:
        if name not in names:
            raise TypeError(f"pareto: unknown argument {name}")
    unknowns, space = build_space(scene, Request("translation", seconds=seconds, seed=seed, **limits))
    begin = first_points(unknowns)
    limit = TimeLimit(began, seconds)
    runs: list[Found] = []

    def go(space: Space, points: list[np.ndarray], rounds: int | None) -> Found:
        def report(part: float) -> None:
            if progress is not None:
                progress((len(runs) + part) / (_POINTS + 2))

        each = None if seconds is None else limit.left / (_POINTS + 2 - len(runs))
        runs.append(search(space, seed + len(runs), TimeLimit(clock(), each), points, report, rounds))
        return runs[-1]

    far = go(space, begin, None)
    check_found(space, far)
    found = [far.point]
    if not far.interrupted:
        goal = dataclasses.replace(space.goal, objective="cost-of-transport")
        cheap = go(dataclasses.replace(space, goal=goal), [far.point, *begin], None)
        if cheap.score > -math.inf:  # else Ctrl-C came before the first gait
            found.append(cheap.point)
        ends = [_scores(space, far.point), _scores(space, found[-1])]
        widths = ends[0][0] - ends[1][0], ends[1][1] - ends[0][1]
        for part in np.arange(1, _POINTS + 1) / (_POINTS + 1) if min(widths) > 0.0 else ():
            if runs[-1].interrupted or limit.over():
                break
            weights = (ends[1][0], 1.0 / (part * widths[0])), (ends[0][1], 1.0 / ((1.0 - part) * widths[1]))
            other = dataclasses.replace(space, goal=dataclasses.replace(goal, weights=weights))
            one = go(other, found, _ROUNDS)
            if one.score > -math.inf:
                found.append(one.point)
    points = _undominated([_compromise(space, point) for point in found])
    interrupted = any(run.interrupted for run in runs)
    complete = all(run.complete for run in runs) and not (interrupted or limit.over())
    evaluations = sum(run.evaluations for run in runs)
    stopped = [run.untried for run in runs if not run.complete]
    untried = tuple(kind.value for kind in Kind if any(kind in kinds for kinds in stopped))
    return Front(points, unknowns.names, evaluations, seed, complete, clock() - began, interrupted, untried)


def _scores(space: Space, point: np.ndarray) -> tuple[float, float]:
    """Compute the scores for translation and for the cost of transport, each the worst of all scenes."""
    regimes = [regime for regime in space.regimes(point[None])[0] if regime is not None]
    return (
        min(score("translation", regime) for regime in regimes),
        min(score("cost-of-transport", regime) for regime in regimes),
    )


def _compromise(space: Space, point: np.ndarray) -> Compromise:
    regimes = [regime for regime in space.regimes(point[None])[0] if regime is not None]
    unknowns, values = space.scenes[0], space.values(space.canonical(point))
    gain = min(regime.gain for regime in regimes)
    cost = max(measure("cost-of-transport", regime) for regime in regimes)
    return Compromise(gain, cost, values, Scene.model_validate(unknowns.document(values)))


def _undominated(points: list[Compromise]) -> tuple[Compromise, ...]:
    """Leave out the gaits that another one beats in gain and cost, and gaits that are as good as another one."""
    kept: list[Compromise] = []
    for point in sorted(points, key=lambda one: (-one.gain, one.cost_of_transport)):
        cost = kept[-1].cost_of_transport if kept else math.inf
        if not kept or point.cost_of_transport < cost * (1.0 - 1e-6):
            kept.append(point)
    return tuple(kept)
