"""What a drive does with a body: gain, work and positions, with their derivatives, and over bounds that may matter."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from crawler_model.errors import SceneError
from crawler_model.run.cycle import limit_cycle
from crawler_model.run.simulate import simulate
from crawler_model.scene.scene import Scene

from ...derivative.sensitivities import Sensitivities, sensitivities
from .posterior import Interval, beyond_bound

TOTALS = 4
"""Results before the positions: gain and work a period, and gain and work of the run."""
FARTHEST = 100.0
"""Factor beyond a bound up to which a drive is run."""
_FACTORS = (1.0 + 1e-6, 1.1, 1.3, 2.0, 5.0, 20.0, FARTHEST)
"""Places beyond a bound; the first is not the bound, where a contact that only just held would be at its limit."""
_HALVINGS = 8
"""Times that a stretch beyond a bound is halved, each time the one over which the gain changes most."""
_TOGETHER = 48
"""Combinations of several bounded parameters."""
_EFFECT, _DIFFERENT = 1e-9, 1e-6
"""Parts of the results below which an effect of a parameter, and a difference of two motions, are rounding."""
_LEAST = 1e-12
"""Size of the smallest parameter."""
_SETTLED = 1e-9
_MOST_PERIODS = 1000


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a drive does with one body.

    Attributes:
        results: gain and work a period, gain and work of the run, then positions row by row, shape (M,) [m, J].
        slopes: their derivatives with respect to the parameters, shape (M, P).
        values: of the parameters, shape (P,).
        size: largest displacement [m], and work [J]; results below a small part of it are rounding.
        effect: whether the results depend on each parameter, bool, shape (P,).
        time: times of the positions, shape (T,) [s].
        transient_left: estimate of how far the gain a period is from the limit cycle's [m]; 0 without a period.
        unique: whether the translation is determined everywhere.
        one_sided: parameters at a kink of the gain a period or of the run, bool, shape (P,).
        unresolved: parameters by which the derivatives of these depend on the elements, bool, shape (P,).
    """

    results: np.ndarray
    slopes: np.ndarray
    values: np.ndarray
    size: tuple[float, float]
    effect: np.ndarray
    time: np.ndarray
    transient_left: float
    unique: bool
    one_sided: np.ndarray
    unresolved: np.ndarray

    def differs(self, other: Outcome) -> bool:
        """Determine whether another body moves in another way.

        Args:
            other: what the drive does with it.

        Returns:
            True if a result differs by more than rounding.
        """
        change = np.abs(self.results - other.results)
        return bool((change > _DIFFERENT * _units(change.size, self.size)).any())


def _units(count: int, size: tuple[float, float]) -> np.ndarray:
    """Build the size of each result, of works apart, shape (M,) [m, J]."""
    units = np.full(count, size[0])
    units[1:TOTALS:2] = size[1]
    return units


def find_outcome(scene: Scene, names: Sequence[str], periods: int, rate: float) -> Outcome:
    """Run a drive, and differentiate what it does.

    Args:
        scene: the body with the drive.
        names: the parameters.
        periods: number of periods of the run, whose mean counts on ground that differs from place to place; without a
            period, the run is the whole drive.
        rate: samples of the positions per second [Hz].

    Returns:
        The results.
    """
    period = scene.drive.period
    duration = None if period is None else periods * period
    run = simulate(scene, duration, rate)
    slopes = sensitivities(scene, names, duration, rate) if names else None
    y, position, count = run.net_translation, run.position, len(names)
    totals = [float(y[-1] - y[0]), run.energy.work]
    jacobian = np.zeros((TOTALS + position.size, count))
    if slopes is not None:
        jacobian[2] = slopes.net_translation[-1] - slopes.net_translation[0]
        jacobian[3] = slopes.work
        jacobian[TOTALS:] = slopes.displacement.reshape(-1, count)
    regime, jacobian[:2], left, found = totals, jacobian[2:TOTALS], 0.0, slopes
    if period is not None and not scene.ground.differs:
        regime, left, found = _find_regime(scene, names)
        if found is not None:
            jacobian[0], jacobian[1] = found.per_period[-1], found.period_work[-1]
    elif period is not None:
        regime, jacobian[:2] = [total / periods for total in totals], jacobian[2:TOTALS] / periods
    results = np.concatenate((regime, totals, position.ravel()))
    size = max(float(np.ptp(run.displacement)), 1e-300), max(float(np.abs(run.energies.work).sum()), 1e-300)
    values = np.zeros(0) if slopes is None else slopes.values
    moved = np.abs(jacobian) * np.maximum(np.abs(values), _LEAST)
    effect = np.asarray((moved > _EFFECT * _units(results.size, size)[:, None]).any(axis=0))
    return Outcome(
        results=results,
        slopes=jacobian,
        values=values,
        size=size,
        effect=effect,
        time=run.time,
        transient_left=left,
        unique=run.unique,
        one_sided=np.zeros(0, np.bool_) if found is None else found.one_sided,
        unresolved=np.zeros(0, np.bool_) if found is None else found.unresolved,
    )


def _find_regime(scene: Scene, names: Sequence[str]) -> tuple[list[float], float, Sensitivities | None]:
    """Find gain and work of a period of the limit cycle, what is left of the transient, and the derivatives."""
    cycle = limit_cycle(scene, most_periods=_MOST_PERIODS)
    values = [float(cycle.gain), cycle.work]
    if not names:
        return values, cycle.transient_left, None
    period = scene.drive.period
    assert period is not None
    count = cycle.periods + 2
    while True:
        found = sensitivities(scene, names, count * period, 1.0 / period)
        rows = np.stack((found.per_period[-2:], found.period_work[-2:]), axis=1)
        change = np.abs(rows[1] - rows[0]).max(axis=1, initial=0.0)
        settled = (change <= _SETTLED * np.abs(rows[1]).max(axis=1, initial=1e-300)).all()
        if settled or 2 * count > _MOST_PERIODS:
            return values, cycle.transient_left, found
        count *= 2


Evaluate = Callable[[Mapping[str, float]], Outcome]
Step = tuple[dict[str, float], Outcome]
"""Values of the bounded parameters, and what the drive does there."""


def attempt(evaluate: Evaluate, values: Mapping[str, float]) -> list[Outcome]:
    """Run a drive at values that may not make a valid scene.

    Args:
        evaluate: runs the drive.
        values: of some parameters.

    Returns:
        What it does; nothing if the values are not valid.
    """
    try:
        return [evaluate(values)]
    except SceneError:
        return []


def explore(
    evaluate: Evaluate, bounds: Mapping[str, Interval], names: Sequence[str], rng: np.random.Generator
) -> tuple[list[Outcome], dict[str, bool]]:
    """Run a drive for all values that bounds allow, as far as they matter.

    Where nothing depends on a parameter at its bound, nothing depends on it beyond: a contact that holds, and a limit
    that is not reached, do so all the more.

    Args:
        evaluate: runs the drive at values of the bounded parameters.
        bounds: of the parameters that are only bounded.
        names: all parameters of `Outcome.effect`.
        rng: source of random numbers, for combinations of several.

    Returns:
        The outcomes, that at all bounds first, and the parameters on which they depend: whether they still do at the
        farthest value.
    """
    first = {name: beyond_bound(interval, _FACTORS[0]) for name, interval in bounds.items()}
    steps: list[Step] = [(first, evaluate(first))]
    walks: dict[str, list[Step]] = {}
    for values, outcome in steps:  # to which the walks add
        for column, name in enumerate(names):
            if name in bounds and name not in walks and outcome.effect[column]:
                walks[name] = _walk(evaluate, (values, outcome), name, bounds[name], column)
                steps += walks[name][1:]
    matter = [name for name, walk in walks.items() if any(walk[0][1].differs(outcome) for _, outcome in walk)]
    found = [steps[0][1], *(outcome for name in matter for _, outcome in walks[name])]
    if len(matter) > 1:
        places = [np.array([walks[name][k][0][name] for k in range(len(walks[name]))]) for name in matter]
        for chosen in _combinations([place.size for place in places], rng):
            moved = {name: float(place[k]) for name, place, k in zip(matter, places, chosen, strict=True)}
            found += attempt(evaluate, first | moved)
    return found, {name: bool(walks[name][-1][1].effect[list(names).index(name)]) for name in matter}


def _combinations(sizes: Sequence[int], rng: np.random.Generator) -> list[list[int]]:
    """Choose places of several parameters: all the farthest ones, all but one, and random ones."""
    far = [size - 1 for size in sizes]
    near = [[0 if i == j else far[i] for i in range(len(sizes))] for j in range(len(sizes))]
    return [far, *near, *([int(rng.integers(size)) for size in sizes] for _ in range(_TOGETHER))]


def _walk(evaluate: Evaluate, begin: Step, name: str, interval: Interval, column: int) -> list[Step]:
    """Move a parameter away from its bound until nothing depends on it, then halve where the gain changes most."""

    def step(factor: float) -> list[tuple[float, Step]]:
        values = {**begin[0], name: beyond_bound(interval, factor)}
        return [(factor, (values, outcome)) for outcome in attempt(evaluate, values)]

    steps = [(_FACTORS[0], begin)]
    for factor in _FACTORS[1:]:
        steps += step(factor)
        if steps[-1][0] != factor or not steps[-1][1][1].effect[column]:
            break
    for _ in range(_HALVINGS if len(steps) > 1 else 0):
        at = int(np.argmax([_jump(now, then) for now, then in itertools.pairwise(steps)]))
        between = step(float(np.sqrt(steps[at][0] * steps[at + 1][0])))
        if not between:
            break
        steps[at + 1 : at + 1] = between
    return [one for _, one in steps]


def _jump(now: tuple[float, Step], then: tuple[float, Step]) -> float:
    """Compute by how much the gain changes along a stretch; for stretches without a change the longest counts [m]."""
    before, after = now[1][1], then[1][1]
    change = np.abs(after.results[:TOTALS:2] - before.results[:TOTALS:2]).max()
    return float(change + 1e-6 * before.size[0] * (then[0] / now[0] - 1.0))
