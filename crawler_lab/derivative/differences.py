"""Derivatives of bodies that remember their path, and on ground that differs from place to place.

They are central differences of runs. These are exact to rounding, and smooth but for kinks, so that the steps can be
so small that their squares are rounding, too. The differences to both sides tell whether there is a kink between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model.crawler.crawler import Crawler
from crawler_model.errors import CommandError, SceneError
from crawler_model.motion.account import SPENT
from crawler_model.run.account import average_displacement
from crawler_model.scene.scene import Scene

from ..sweep.keys import expand_keys
from ..sweep.vary import Variations, vary
from .parameters import changing_keys

_STEP, _STEP_OF_TIMES = 2.0**-18, 2.0**-12
"""Step of the differences, relative to the value of the parameter; and of times, which are whole nanoseconds [1]."""
_SMALLEST = 0.125
"""Values are taken to be of this size at least."""
_ROUNDING = 1e-13
"""Rounding errors of a run, relative to its largest displacement and work."""
_SIDES = 1e-3
"""Part of the largest derivative by which both sides may differ at most."""


@dataclass(frozen=True, eq=False)
class Differences:
    """Derivatives of a run with respect to P parameters, with N contacts at T times.

    Attributes:
        names: of the parameters.
        values: their values in the scene, shape (P,).
        displacement: shape (T, N, P).
        per_period: of the gain in each whole period, shape (periods, P).
        work: of the work of the actuators in the whole run, shape (P,).
        period_work: of that work in each whole period, shape (periods, P).
        one_sided: parameters with respect to which one of these is one-sided, shape (P,).
        kinks: the times [ns] and contacts at which displacements begin to be one-sided.
        error: by how much the derivatives of both sides differ, relative to the largest one with respect to the same
            parameter: a bound of the error of those that are not one-sided [1].
    """

    names: tuple[str, ...]
    values: np.ndarray
    displacement: np.ndarray
    per_period: np.ndarray
    work: np.ndarray
    period_work: np.ndarray
    one_sided: np.ndarray
    kinks: tuple[tuple[int, int], ...]
    error: float


@dataclass(frozen=True, eq=False)
class _Run:
    """A run: displacement (T, N) [m], work [J], and gain [m] and work [J] of each whole period, shape (periods,)."""

    displacement: np.ndarray
    work: float
    gains: np.ndarray
    works: np.ndarray

    def flat(self, periods: int) -> np.ndarray:
        """Join all numbers, first whole periods included, shape (M,)."""
        return np.concatenate((self.displacement.ravel(), self.gains[:periods], [self.work], self.works[:periods]))


def differentiate_by_runs(scene: Scene, keys: Sequence[str], tick_ns: np.ndarray) -> Differences:
    """Differentiate a run of a body on a line by differences of runs.

    Args:
        scene: the scene, without segments.
        keys: as for `expand_keys`.
        tick_ns: the times of the displacements behind the start, shape (T - 1,) [ns].

    Returns:
        The derivatives; where they are one-sided, towards larger values, unless only smaller ones are valid.

    Raises:
        SceneError: if a key is unknown, or no value near the scene's is valid.
    """
    names = expand_keys(scene, keys, "sensitivities")
    everything = vary(scene, {name: [0.0] for name in names}, grid=False)
    values = np.array([everything.origin(name) for name in names])
    here = _run(scene, tick_ns)
    periods, size = here.gains.size, here.displacement.size
    scale = np.repeat([np.abs(here.displacement).max(), np.abs(here.works).max(initial=abs(here.work))], 2)
    unit = np.repeat(scale, (size, periods, 1, periods))
    columns, one_sided, kinks, error = [], np.zeros(len(names), dtype=bool), [], 0.0
    for p, (name, path) in enumerate(zip(names, everything.paths, strict=True)):
        timed = path[0] == "drive" and ("times" in path or "period" in path)
        step = (_STEP_OF_TIMES if timed else _STEP) * max(abs(float(values[p])), _SMALLEST)
        changing = changing_keys(scene, name, path)
        sides = [_find_side(scene, here, changing, values[p], side * step, tick_ns) for side in (1.0, -1.0)]
        known = [side for side in sides if side is not None]
        if not known:
            raise SceneError(f"sensitivities: {name}: no value near {values[p]:g} is valid")
        apart = np.abs(known[0] - known[-1])
        derivative = 0.5 * (known[0] + known[-1])
        for part, kind in ((slice(0, size + periods), 0), (slice(size + periods, None), 2)):
            largest = np.abs(derivative[part]).max()
            allowed = _SIDES * largest + 2.0 * _ROUNDING * scale[kind] / step
            if len(known) < 2 or apart[part].max() > allowed:
                one_sided[p] = True
            elif largest > _ROUNDING * scale[kind] / step:
                error = max(error, float(apart[part].max() / largest))
        if one_sided[p]:
            derivative = known[0]
            bent = apart[:size] > _SIDES * np.abs(derivative[:size]).max() + 2.0 * _ROUNDING * unit[:size] / step
            found = np.argwhere(bent.reshape(here.displacement.shape))
            kinks += [(int(tick_ns[t - 1]), int(i)) for t, i in found if t == found[0][0]]
        columns.append(derivative)
    table = np.stack(columns, axis=-1)
    x, gains, work, works = np.split(table, np.cumsum([size, periods, 1]))
    shape = (*here.displacement.shape, len(names))
    return Differences(names, values, x.reshape(shape), gains, work[0], works, one_sided, tuple(kinks), error)


def _find_side(
    scene: Scene, here: _Run, changing: Sequence[str], value: float, step: float, tick_ns: np.ndarray
) -> np.ndarray | None:
    """Compute the differences to one side, shape (M,); None if there is no motion, or a period less."""
    if not changing:
        return np.zeros(here.flat(here.gains.size).size)
    try:
        there = _run(Variations(scene, dict.fromkeys(changing, np.array([value + step])), (1,))[0], tick_ns)
    except (SceneError, CommandError):
        return None
    periods = here.gains.size
    return None if there.gains.size < periods else (there.flat(periods) - here.flat(periods)) / step


def _run(scene: Scene, tick_ns: np.ndarray) -> _Run:
    """Run a scene."""
    crawler, drive, n = Crawler(scene), scene.drive, scene.body.contacts
    ends, targets, at, rows = drive.ramps_between(0, tick_ns)
    records = np.empty((ends.size + 1, 2 * n + crawler.tension.size + SPENT))
    records[0, :n], records[0, n:] = crawler.displacement, 0.0
    crawler.follow(targets, records[1:])
    x, work = records[:, :n] + records[:, n : 2 * n], records[:, 2 - SPENT]
    ticks = np.append(0, 1 + np.searchsorted(ends, tick_ns))
    marks: Any = np.append(0, 1 + at[rows == 0]) if drive.period is not None else np.zeros(1, np.int64)
    gains = np.diff(average_displacement(scene.body, x[marks]))
    return _Run(x[ticks], float(work[-1]), gains, np.diff(work[marks]))
