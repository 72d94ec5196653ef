"""Derivatives of displacement, gain and work with respect to the numbers of a scene."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model.arrays import frozen
from crawler_model.body.body import Body
from crawler_model.body.drive import NS
from crawler_model.errors import CommandError, SceneError
from crawler_model.notebook import write_html, write_numbers
from crawler_model.run.screw import largest_distance
from crawler_model.run.simulate import default_duration, simulate
from crawler_model.run.ticks import DEFAULT_RATE, check_duration, count_ticks, rational_rate, tick_ends
from crawler_model.run.trajectory import Trajectory
from crawler_model.scene.assembly import Assembly
from crawler_model.scene.file import coerce_scene
from crawler_model.scene.scene import Scene

from ..sweep.keys import check_form, expand_keys, with_loads
from .differences import differentiate_by_runs, differentiate_grid
from .grids import (
    RESOLVED,
    SCATTERED,
    SIDES,
    are_small,
    average_grids,
    compare_sides,
    compare_steps,
    find_trend,
    other_grids,
    tilt,
)
from .parameters import Derivatives, differentiate_arrays
from .plane_path import PlanePath, differentiate_gains, differentiate_yaw
from .tangent_path import Stretch, TangentPath, Vertices, build_vertices

_CHUNK = 4096
_MOST_NUMBERS = 200_000_000
_COARSER = 10.0
"""Factor for the tolerance of the path in the plane that the derivatives are compared with."""
_NOTHING = 1e-6
"""A derivative counts as none if it moves contacts by less than this part of their largest distance while the parameter
changes by its own value, or by 1 where that is 0."""
_MOST_SHOWN = 24
"""Parameters that a notebook shows."""


@dataclass(frozen=True)
class Kink:
    """An instant at which a derivative is one-sided.

    Attributes:
        time: simulated time [s].
        contacts: names of the contacts that reach their bounds together, or that are at a bound without
            sliding.
    """

    time: float
    contacts: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities:
    """Derivatives of a run with respect to P parameters. Arrays are read-only.

    Attributes:
        parameters: names of the parameters, shape (P,).
        values: their values in the scene, shape (P,).
        time: times of the start and of the end of each tick, as in `Trajectory`, shape (T,) [s].
        displacement: d x / d p, shape (T, N, P), in the plane (T, N, 2, P).
        net_translation: d y / d p, shape (T, P), in the plane (T, 2, P).
        yaw: derivatives of the yaw, shape (T, P); 0 for bodies that do not turn.
        per_period: derivatives of the net translation gained in each whole period, shape (periods, P), in the plane
            (periods, 2, P); for bodies that turn of dx, dy and dyaw as in `Trajectory`, shape (periods, 3, P).
        work: derivatives of the work of the actuators in the whole run, shape (P,).
        period_work: derivatives of that work in each whole period, shape (periods, P).
        one_sided: parameters with respect to which a result, be it the displacement at one tick, has a one-sided
            derivative, or none as a relaxed start or a contact jumps there, bool, shape (P,).
        kinks: where they are.
        tolerance: on a line 0, as derivatives are exact but for rounding; where they are differences of runs, by how
            much those to both sides differ, where they are not one-sided; for segments a bound of the error of the
            net translation's derivatives that are not in `unresolved`, in the plane of the displacement's derivatives
            that are not one-sided, relative to the largest one with respect to the same parameter (for segments at
            least to that which moves the body by 2 % of its travel as the parameter changes by its value); NaN where
            there are none [1].
        unresolved: parameters with respect to which the derivatives of the net translation of a body with segments, the
            means of several grids, may be off by more than a twentieth; bool, shape (P,). Small ones are, too, where a
            segment slides next to an end, but on all grids only within an element, or where they are differences of
            runs; and those that scatter where the gain itself depends on the grid.
    """

    parameters: tuple[str, ...]
    values: np.ndarray
    time: np.ndarray
    displacement: np.ndarray
    net_translation: np.ndarray
    yaw: np.ndarray
    per_period: np.ndarray
    work: np.ndarray
    period_work: np.ndarray
    one_sided: np.ndarray
    kinks: tuple[Kink, ...]
    tolerance: float = 0.0
    unresolved: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))

    @property
    def differentiable(self) -> bool:
        """Whether all derivatives are two-sided, and for segments do not depend on their elements."""
        return not (self.one_sided.any() or self.unresolved.any())

    def __repr__(self) -> str:
        """Describe the derivatives in one line."""
        state = "differentiable"
        counts = (int(self.one_sided.sum()), "one-sided"), (int(self.unresolved.sum()), "dependent on the elements")
        if not self.differentiable:
            state = ", ".join(f"{count} of them {what}" for count, what in counts if count)
        error = f", errors up to about {self.tolerance:.0e}" if self.tolerance > 0.0 else ""
        return f"Sensitivities({len(self.parameters)} parameters, {self.time.size} times, {state}{error})"

    def _repr_html_(self) -> str:
        """Show the derivatives of the gain in the last period, or at the end, in a notebook."""
        which = "per_period" if self.per_period.size else "net_translation"
        last = getattr(self, which)[-1].T
        sides = np.where(self.one_sided, " (one-sided somewhere)", "").astype(object)
        sides += np.where(self.unresolved, " (dependent on the elements)", "").astype(object)
        facts = [
            (f"{name} = {value:.6g}", write_numbers(derivative) + side)
            for name, value, derivative, side in zip(self.parameters, self.values, last, sides, strict=True)
        ]
        return write_html(f"Derivatives of {which}[-1] with respect to {len(facts)} parameters", facts[:_MOST_SHOWN])


def sensitivities(
    scene: Scene | str | Path, keys: Sequence[str], duration: float | None = None, rate: float = DEFAULT_RATE
) -> Sensitivities:
    """Differentiate a run of a scene with respect to its numbers.

    The derivatives are exact through events: the path is piecewise linear, and only contacts that stop remember how
    they moved. Where a derivative is one-sided, `one_sided` and `kinks` report it, and the derivative follows the path
    with the events in the order in which they are met. In the plane, where paths are curved, the path is followed to
    1e-8, and differentiated by the matrices of its implicit steps; `tolerance` is the difference to the derivatives of
    a path that is followed to 1e-7. Bodies with hysteresis or backlash, friction that changes with elongations, and
    ground with patches, a profile, regions or walls have central differences of runs; `tolerance` is by how much those
    to both sides, or of two sizes, differ.

    A waypoint's derivatives are taken at the moving waypoint for gains and work, and at the fixed time for
    displacements. The first time of a drive, which is 0, and the last waypoint of a drive that ends with its period,
    which repeats the first one, are fixed: their derivatives are 0.

    Args:
        scene: a scene, a path or a gallery name.
        keys: dotted keys, as for `vary`; a key that names a table or a list counts once for each number in it.
        duration: duration [s]; None for ten periods, or up to the last waypoint.
        rate: ticks per second [Hz].

    Returns:
        The derivatives at the times of `simulate(scene, duration, rate)`.

    Raises:
        SceneError: if a key is unknown or names no number of the scene, or if it has no drive.
        CommandError: if duration or rate is out of range, a ramp has too many events, or the body jumps.
    """
    scene = coerce_scene(scene, "sensitivities")
    check_differentiable(scene, "sensitivities")
    scene = with_loads(scene, keys)
    names = expand_keys(scene, keys, "sensitivities")
    check_form(scene, names, "sensitivities")
    seconds = default_duration(scene.drive) if duration is None else check_duration(duration)
    ratio = rational_rate(rate)
    times = seconds * float(ratio) + 1.0
    numbers = times * scene.body.contacts * len(names)
    if numbers > _MOST_NUMBERS:
        raise CommandError(
            f"sensitivities: {numbers:.1e} derivatives ({times:.0f} times, {scene.body.contacts} contacts, "
            f"{len(names)} parameters); at most {_MOST_NUMBERS:.0e}: choose a lower rate or fewer keys"
        )
    end_ns = round(seconds * NS)
    tick_ns = tick_ends(1, count_ticks(end_ns, ratio), ratio, end_ns)
    here = simulate(scene, seconds, rate) if scene.body.segments else None
    if scene.can_be_differenced:
        found = _differentiate_by_runs(scene, keys, tick_ns)
        return found if here is None else _average_over_grids(scene, found, keys, tick_ns, here, rate)
    derivatives = differentiate_arrays(scene, keys, "sensitivities")
    if scene.dimension == 1:
        found = _differentiate_on_line(scene, derivatives, tick_ns, 0.0 if here is None else _find_travel(here))
        return found if here is None else _average_over_grids(scene, found, keys, tick_ns, here, rate)
    paths = (PlanePath(scene, derivatives, factor) for factor in (_COARSER, 1.0))
    coarse, fine = (_differentiate(scene, derivatives, tick_ns, path) for path in paths)
    size = np.abs(fine.displacement).max(axis=(0, 1, 2))
    error = np.abs(fine.displacement - coarse.displacement).max(axis=(0, 1, 2))
    relative = (error / np.maximum(size, _find_smallest(scene, derivatives)))[~fine.one_sided]
    return dataclasses.replace(fine, tolerance=float(relative.max()) if relative.size else math.nan)


def _differentiate_by_runs(scene: Scene, keys: Sequence[str], tick_ns: np.ndarray) -> Sensitivities:
    """Differentiate a run without exact derivatives; of a body with segments on its grid."""
    found = differentiate_by_runs(scene, keys, tick_ns)
    return Sensitivities(
        parameters=found.names,
        values=frozen(found.values),
        time=frozen(np.concatenate(([0], tick_ns)) / NS),
        displacement=frozen(found.displacement),
        net_translation=frozen(np.einsum("n,tn...->t...", scene.body.share, found.displacement)),
        yaw=frozen(found.yaw),
        per_period=frozen(found.per_period),
        work=frozen(found.work),
        period_work=frozen(found.period_work),
        one_sided=frozen(found.one_sided, np.bool_),
        kinks=group_kinks(scene.body, *zip(*((ns / NS, i) for ns, i in found.kinks), strict=True))
        if found.kinks
        else (),
        tolerance=found.error,
        unresolved=frozen(np.zeros(found.values.size), np.bool_),
    )


def _average_over_grids(
    scene: Scene, found: Sensitivities, keys: Sequence[str], tick_ns: np.ndarray, here: Trajectory, rate: float
) -> Sensitivities:
    """Average derivatives of the net translation of a body with segments over grids; `here` is the run on its own."""
    travel = _find_travel(here)
    try:
        grids = [scene, *other_grids(scene)]
        others = (simulate(grid, float(found.time[-1]), rate) for grid in grids[1:])
        gains = [_last_gain(run) for run in (here, *others)]
        if scene.can_be_differenced:
            sides, hides = map(np.stack, zip(*(differentiate_grid(grid, keys, tick_ns) for grid in grids), strict=True))
            table, missed = sides.mean(axis=1), compare_steps(sides, travel, found.values)
        else:
            runs = [found]
            for grid in grids[1:]:
                derivatives = differentiate_arrays(grid, keys, "sensitivities")
                runs.append(_differentiate_on_line(grid, derivatives, tick_ns, travel))
            table = np.stack([np.concatenate((run.net_translation, run.per_period)) for run in runs])
            hides, missed = np.stack([run.unresolved for run in runs]), np.zeros(found.values.size)
    except (SceneError, CommandError):  # no derivative exists there
        everything = frozen(np.ones(len(found.parameters)), np.bool_)
        return dataclasses.replace(found, tolerance=math.nan, unresolved=everything)
    mean, error = average_grids(table, travel, found.values)
    error, small = np.maximum(error, missed), np.zeros(error.size, dtype=bool)
    first = tick_ns.size + 1
    parts = [slice(0, first), *(slice(k, k + 1) for k in range(first, mean.shape[0]))]
    for part in parts:  # each period beside itself: a first one that goes far hides no error of later ones
        error = np.maximum(error, average_grids(table[:, part], travel, found.values)[1])
        small |= are_small(mean[part], travel, found.values)
    trend = find_trend(gains, [grid.body.element_ends.shape[0] for grid in grids])
    error = np.where(error > SCATTERED, np.maximum(error, trend), error)
    unresolved = ~(error <= RESOLVED) | (hides.all(axis=0) & small)
    shift = np.where(np.isfinite(mean[:first]), mean[:first] - found.net_translation, 0.0)
    return dataclasses.replace(
        found,
        displacement=frozen(found.displacement + shift[:, None]),
        net_translation=frozen(found.net_translation + shift),
        per_period=frozen(np.where(np.isfinite(mean[first:]), mean[first:], found.per_period)),
        tolerance=math.nan if unresolved.all() else float(error[~unresolved].max()),
        unresolved=frozen(unresolved, np.bool_),
    )


def _find_travel(run: Trajectory) -> float:
    """Measure how far a body with segments moves [m]."""
    return float(np.ptp(run.net_translation))


def _last_gain(run: Trajectory) -> float:
    """Return the gain in the last whole period, or in all [m]."""
    return float(run.per_period[-1] if run.per_period.size else run.net_translation[-1])


def _differentiate_on_line(scene: Scene, derivatives: Derivatives, tick_ns: np.ndarray, travel: float) -> Sensitivities:
    """Differentiate a run on a line, on the grid of the scene; at a kink of the grid itself, on both sides of it.

    Where what slides next to the end of a segment is shorter than an element, all are `unresolved` on this grid.
    """
    path = TangentPath(scene, derivatives, samples=True)
    found = _differentiate(scene, derivatives, tick_ns, path)
    found = dataclasses.replace(found, unresolved=frozen(np.full(found.values.size, path.hides), np.bool_))
    if not path.between:
        return found
    first, second = (
        _differentiate(side, derivatives, tick_ns, TangentPath(side, derivatives, samples=True)) for side in tilt(scene)
    )
    names = "displacement", "net_translation", "per_period", "work", "period_work"
    mean: dict[str, Any] = {name: frozen(0.5 * (getattr(first, name) + getattr(second, name))) for name in names}
    differences = compare_sides(first.net_translation, second.net_translation, travel, found.values)
    one_sided = first.one_sided | second.one_sided | (differences > SIDES)
    kinks = found.kinks if one_sided.any() else ()
    return dataclasses.replace(found, **mean, one_sided=frozen(one_sided, np.bool_), kinks=kinks)


def _find_smallest(scene: Scene, derivatives: Derivatives) -> np.ndarray:
    """Find for each parameter the derivative to which an error is compared if its own is smaller, shape (P,)."""
    values = np.abs(derivatives.values)
    return _NOTHING * largest_distance(scene.body) / np.where(values > 0.0, values, 1.0)


def _differentiate(
    scene: Assembly, derivatives: Derivatives, tick_ns: np.ndarray, path: TangentPath | PlanePath
) -> Sensitivities:
    """Differentiate a run along a path."""
    x, dx = [scene.start_displacement[None]], [path.dx[None]]
    marks, d_works = [(x[0][0], path.dx, 0)], [np.zeros((0, len(derivatives.names)))]
    vertex_ns = [np.zeros(1, np.int64)]
    for first in range(0, tick_ns.size, _CHUNK):
        ends = tick_ns[first : first + _CHUNK]
        begin_ns = int(tick_ns[first - 1]) if first else 0
        vertices = build_vertices(scene.drive, derivatives, begin_ns, ends)
        stretch = path.follow_vertices(vertices)
        at = np.searchsorted(vertices.time_ns, ends)
        x.append(stretch.x[at])
        dx.append(_at_fixed_times(path, vertices, stretch, at, begin_ns))
        if scene.drive.period is not None:
            ramps = sum(map(len, d_works)) + 1
            done = np.flatnonzero((vertices.before == 0) & (vertices.part == 0.0) & (vertices.after == 0))
            marks.extend((stretch.x[i].copy(), stretch.dx[i].copy(), ramps + int(i)) for i in done)
        d_works.append(stretch.d_work)
        vertex_ns.append(vertices.time_ns)
    d_work, displacement = np.concatenate(d_works), np.concatenate(dx)
    spent = np.array([d_work[a:b].sum(axis=0) for (_, _, a), (_, _, b) in itertools.pairwise(marks)])
    columns = len(derivatives.names)
    translation = np.einsum("n,tn...->t...", scene.body.share, displacement)
    yaw = differentiate_yaw(scene.body, np.concatenate(x), displacement, derivatives.position)
    mark_x, mark_dx = (np.array([mark[k] for mark in marks]) for k in range(2))
    if scene.body.turning is None:
        gains = np.diff(np.einsum("n,tn...->t...", scene.body.share, mark_dx), axis=0)
    else:
        gains = differentiate_gains(scene.body, mark_x, mark_dx, derivatives.position)
    return Sensitivities(
        derivatives.names,
        frozen(derivatives.values),
        frozen(np.concatenate(([0], tick_ns)) / NS),
        frozen(displacement),
        frozen(translation),
        frozen(yaw),
        frozen(gains),
        frozen(d_work.sum(axis=0)),
        frozen(spent.reshape(-1, columns)),
        frozen(path.one_sided, np.bool_),
        _kinks(scene, path, np.concatenate(vertex_ns)),
        unresolved=frozen(np.zeros(columns), np.bool_),
    )


def check_differentiable(scene: Scene, caller: str) -> None:
    """Check that the path of a scene can be differentiated.

    Args:
        scene: the scene.
        caller: name of the function, for error messages.

    Raises:
        SceneError: if it has no drive.
    """
    if scene.parts.drive is None:
        raise SceneError(f"{caller}: {scene.name} has no drive; without one nothing moves")


def _at_fixed_times(
    path: TangentPath | PlanePath, vertices: Vertices, stretch: Stretch, at: np.ndarray, begin_ns: int
) -> np.ndarray:
    """Select the derivatives at ticks; where a waypoint moves past a tick, of the path at the fixed time."""
    dx = stretch.dx[at]
    for k in np.flatnonzero(vertices.d_time[at].any(axis=1)):
        i = int(at[k])
        begin = int(vertices.time_ns[i - 1]) if i else begin_ns
        speed = stretch.speed[i] * (NS / (int(vertices.time_ns[i]) - begin))
        dx[k] -= speed[..., None] * vertices.d_time[i]
        path.one_sided |= vertices.d_time[i] != 0.0
    return dx


def _kinks(scene: Assembly, path: TangentPath | PlanePath, vertex_ns: np.ndarray) -> tuple[Kink, ...]:
    """Find the times of kinks."""
    times = [
        (int(vertex_ns[ramp]) + place * (int(vertex_ns[ramp + 1]) - int(vertex_ns[ramp]))) / NS
        for ramp, place, _ in path.kinks
    ]
    return group_kinks(scene.body, times, [contact for _, _, contact in path.kinks])


def group_kinks(body: Body, times: Iterable[float], contacts: Iterable[int]) -> tuple[Kink, ...]:
    """Group kinks by time.

    Args:
        body: the body.
        times: of the kinks [s].
        contacts: the contact of each.

    Returns:
        A kink for each time, in order, each contact named once.
    """
    grouped: dict[float, list[str]] = {}
    for time, contact in zip(times, contacts, strict=True):
        names = grouped.setdefault(time, [])
        name = body.name_of(contact)
        if name not in names:
            names.append(name)
    return tuple(Kink(time, tuple(names)) for time, names in sorted(grouped.items()))
