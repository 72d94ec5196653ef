"""Derivatives of bodies that remember their path, and on ground that differs from place to place.

They are central differences of runs. On a line these are exact to rounding, and smooth but for kinks, so that the steps
can be so small that their squares are rounding, too; the differences to both sides tell whether there is a kink between
them. In the plane, and for segments, steps of two sizes tell what is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.crawler.crawler import Crawler
from crawler_model.errors import CommandError, SceneError
from crawler_model.motion.account import SPENT
from crawler_model.run.account import average_displacement
from crawler_model.run.screw import follow_turning, gain_in_frame
from crawler_model.scene.scene import Scene

from ..sweep.keys import expand_keys
from ..sweep.vary import Variations, vary
from .parameters import changing_keys

_STEP, _STEP_OF_TIMES = {1: 2.0**-18, 2: 2.0**-7}, 2.0**-12
"""Step of the differences by the dimension, relative to the value of the parameter; and of times on a line, which are
whole nanoseconds [1]."""
_STEP_OF_GRIDS = 0.125
"""Step for bodies with segments: the point at rest passes several cells [1]."""
_SMALLEST = 0.125
"""Values are taken to be of this size at least."""
_ROUNDING = {1: 1e-13, 2: 1e-6}
"""Errors of a run, relative to its largest displacement and work; the `tolerance` of runs in the plane."""
_SIDES = {1: 1e-3, 2: 1e-2}
"""Part of the largest derivative by which both sides, or two sizes of the step, may differ at most."""
_FACTORS = {1: (1.0, -1.0), 2: (0.5, -0.5, 1.0, -1.0)}
"""Steps to both sides, in units of the step: in the plane, where paths are curved, of two sizes."""


@dataclass(frozen=True, eq=False)
class Differences:
    """Derivatives of a run with respect to P parameters, with N contacts at T times.

    Attributes:
        names: of the parameters.
        values: their values in the scene, shape (P,).
        displacement: shape (T, N, P), in the plane (T, N, 2, P).
        yaw: shape (T, P).
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
    yaw: np.ndarray
    per_period: np.ndarray
    work: np.ndarray
    period_work: np.ndarray
    one_sided: np.ndarray
    kinks: tuple[tuple[int, int], ...]
    error: float


@dataclass(frozen=True, eq=False)
class _Run:
    """A run: displacement (T, N) or (T, N, 2) [m], yaw (T,), work [J], gain and work [J] of each whole period."""

    displacement: np.ndarray
    yaw: np.ndarray
    work: float
    gains: np.ndarray
    works: np.ndarray

    def flat(self, periods: int) -> np.ndarray:
        """Join all numbers, first whole periods included, shape (M,)."""
        motion = self.displacement.ravel(), self.yaw, self.gains[:periods].ravel()
        return np.concatenate((*motion, [self.work], self.works[:periods]))


class _Bundle:
    """A scene, and runs beside it in which one parameter differs."""

    def __init__(self, scene: Scene, keys: Sequence[str], tick_ns: np.ndarray) -> None:
        """Run the scene.

        Raises:
            SceneError: if a key is unknown.
        """
        if scene.dimension == 2:
            tolerance = min(scene.tolerance or _ROUNDING[2], _ROUNDING[2])
            scene = Scene.model_validate(scene.document() | {"tolerance": tolerance})
        self.scene, self.tick_ns = scene, tick_ns
        self.names = expand_keys(scene, keys, "sensitivities")
        everything = vary(scene, {name: [0.0] for name in self.names}, grid=False)
        self.paths = everything.paths
        pairs = zip(self.names, self.paths, strict=True)
        self.changing = [changing_keys(scene, name, path) for name, path in pairs]
        self.values = np.array([everything.origin(name) for name in self.names])
        self.here = _run(scene, tick_ns)

    def find_sides(self, p: int, step: float, factors: Sequence[float]) -> tuple[float, list[np.ndarray | None]]:
        """Compute a step [unit of the parameter], and the differences by multiples of it, shape (M,).

        None stands for those where there is no valid value, no motion, or a period less.
        """
        step *= max(abs(float(self.values[p])), _SMALLEST)
        return step, [self._find_side(p, factor * step) for factor in factors]

    def _find_side(self, p: int, step: float) -> np.ndarray | None:
        here = self.here.flat(self.here.gains.shape[0])
        if not self.changing[p]:
            return np.zeros(here.size)
        try:
            moved = Variations(self.scene, dict.fromkeys(self.changing[p], self.values[p : p + 1] + step), (1,))[0]
            there = _run(moved, self.tick_ns)
        except (SceneError, CommandError):
            return None
        periods = self.here.gains.shape[0]
        return None if there.gains.shape[0] < periods else (there.flat(periods) - here) / step


def differentiate_by_runs(scene: Scene, keys: Sequence[str], tick_ns: np.ndarray) -> Differences:
    """Differentiate a run by differences of runs.

    Args:
        scene: the scene; of one with segments, the derivatives are those of its grid.
        keys: as for `expand_keys`.
        tick_ns: the times of the displacements behind the start, shape (T - 1,) [ns].

    Returns:
        The derivatives; where they are one-sided, towards larger values, unless only smaller ones are valid.

    Raises:
        SceneError: if a key is unknown, or no value near the scene's is valid.
    """
    bundle = _Bundle(scene, keys, tick_ns)
    here, dimension = bundle.here, scene.dimension
    parts = here.displacement.size, here.yaw.size, here.gains.size, 1, here.works.size
    ends, factors, rounding = np.cumsum(parts), _FACTORS[dimension], _ROUNDING[dimension]
    scale = np.abs(here.displacement).max(), np.abs(here.works).max(initial=abs(here.work))
    columns, one_sided, kinks, error = [], np.zeros(len(bundle.names), dtype=bool), [], 0.0
    for p, (name, path) in enumerate(zip(bundle.names, bundle.paths, strict=True)):
        timed = dimension == 1 and path[0] == "drive" and ("times" in path or "period" in path)
        step, sides = bundle.find_sides(p, _STEP_OF_TIMES if timed else _STEP[dimension], factors)
        known = [side for side in sides if side is not None]
        if not known:
            raise SceneError(f"sensitivities: {name}: no value near {bundle.values[p]:g} is valid")
        derivative = np.mean(known, axis=0)
        apart, missed = _compare(known) if len(known) == len(factors) else (np.full(derivative.size, np.inf),) * 2
        for part, size in ((slice(0, ends[2]), scale[0]), (slice(ends[2], None), scale[1])):
            largest = np.abs(derivative[part]).max()
            if apart[part].max() > _SIDES[dimension] * largest + 2.0 * rounding * size / step:
                one_sided[p] = True
            elif largest > rounding * size / step:
                error = max(error, float(missed[part].max() / largest))
        if one_sided[p]:
            derivative = known[0]
            allowed = _SIDES[dimension] * np.abs(derivative[: ends[0]]).max() + 2.0 * rounding * scale[0] / step
            found = np.argwhere((apart[: ends[0]] > allowed).reshape(here.displacement.shape))
            kinks += [(int(tick_ns[t - 1]), int(i)) for t, i, *_ in found if t == found[0][0]]
        columns.append(derivative)
    table = np.stack(columns, axis=-1)
    x, yaw, gains, work, works = np.split(table, ends[:-1])
    names, values = bundle.names, bundle.values
    x, gains = x.reshape(*here.displacement.shape, values.size), gains.reshape(*here.gains.shape, values.size)
    return Differences(names, values, x, yaw, gains, work[0], works, one_sided, tuple(kinks), error)


def _compare(sides: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Find by how much differences disagree, and by how much their means may be off, shape (M,).

    Of one size, both sides differ by a kink, and little else; of two sizes, by what is left at no step.
    """
    if len(sides) == 2:
        apart = np.abs(sides[0] - sides[1])
        return apart, apart
    fine, coarse = sides[:2], sides[2:]
    missed = np.abs(np.subtract(np.mean(fine, axis=0), np.mean(coarse, axis=0)))
    bend = np.abs(2.0 * (fine[0] - fine[1]) - (coarse[0] - coarse[1]))
    return np.maximum(missed, bend), missed


def differentiate_grid(scene: Scene, keys: Sequence[str], tick_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Differentiate the net translation of a body with segments by differences over several cells of its grid.

    Args:
        scene: the scene, on a line.
        keys: as for `expand_keys`.
        tick_ns: as for `differentiate_by_runs`.

    Returns:
        The derivatives of the net translation at the start and at these times, then of the gains, to both sides by
        steps of two sizes, shape (4, T + periods, P); NaN where there are none. And whether the parameters change the
        scene, shape (P,): a difference may be small only because no point at rest passes a contact.
    """
    bundle = _Bundle(scene, keys, tick_ns)
    x, count = bundle.here.displacement, bundle.here.gains.size
    first = x.size + x.shape[0]
    found = np.full((4, x.shape[0] + count, len(bundle.names)), np.nan)
    for p in range(len(bundle.names)):
        for k, side in enumerate(bundle.find_sides(p, _STEP_OF_GRIDS, _FACTORS[2])[1]):
            if side is not None:
                translation = side[: x.size].reshape(x.shape) @ scene.body.share
                found[k, :, p] = np.concatenate((translation, side[first : first + count]))
    return found, np.array([bool(changing) for changing in bundle.changing])


def _run(scene: Scene, tick_ns: np.ndarray) -> _Run:
    """Run a scene."""
    crawler, drive, body = Crawler(scene), scene.drive, scene.body
    shape, width = crawler.displacement.shape, crawler.displacement.size
    ends, targets, at, rows = drive.ramps_between(0, tick_ns)
    records = np.empty((ends.size + 1, 2 * width + crawler.tension.size + SPENT))
    records[0, :width], records[0, width:] = crawler.displacement.ravel(), 0.0
    yaw = np.full(ends.size + 1, crawler.yaw)
    if body.turning is None:
        crawler.follow(targets, records[1:])
    else:
        yaw[1:] = follow_turning(crawler, targets, records[1:], ends / NS)[1]
    x, work = records[:, :width] + records[:, width : 2 * width], records[:, 2 - SPENT]
    x = x.reshape(-1, *shape)
    ticks = np.append(0, 1 + np.searchsorted(ends, tick_ns))
    marks: Any = np.append(0, 1 + at[rows == 0]) if drive.period is not None else np.zeros(1, np.int64)
    moved = np.diff(x[marks], axis=0)
    if body.turning is None:
        gains = average_displacement(body, moved)
    else:
        gains = gain_in_frame(body, x[marks[:-1]], moved, np.diff(yaw[marks]))
    return _Run(x[ticks], yaw[ticks], float(work[-1]), gains, np.diff(work[marks]))
