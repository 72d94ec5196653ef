"""Exact derivatives of displacement, gain and work with respect to the numbers of a scene."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import frozen
from ..body.body import Body
from ..body.drive import NS
from ..body.plan import refuse_turning
from ..errors import CommandError, SceneError
from ..notebook import write_html, write_numbers
from ..run.simulate import default_duration
from ..run.ticks import check_duration, count_ticks, rational_rate, tick_ends
from ..scene.file import coerce_scene
from ..scene.scene import Scene
from .parameters import differentiate_arrays
from .path import Stretch, TangentPath, Vertices, build_vertices
from .planar import PlanarDerivatives, differentiate_in_plane

_CHUNK = 4096
_MOST_NUMBERS = 200_000_000
_MOST_SHOWN = 24
"""Parameters that a notebook shows."""


@dataclass(frozen=True)
class Kink:
    """An instant at which a derivative is one-sided.

    Attributes:
        time: simulated time [s].
        contacts: names of the contacts: those that reach their bounds together, or that are at a bound without
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
        per_period: derivatives of the net translation gained in each whole period, shape (periods, P), in the plane
            (periods, 2, P).
        work: derivatives of the work of the actuators in the whole run, shape (P,).
        period_work: derivatives of that work in each whole period, shape (periods, P); in the plane shape (0, P).
        one_sided: parameters with respect to which a result, be it the displacement at one tick, has a one-sided
            derivative, bool, shape (P,).
        kinks: where they are; not located in the plane.
        tolerance: on a line 0, as derivatives are exact but for rounding; in the plane an estimate of their error,
            relative to the largest derivative with respect to the same parameter [1].
    """

    parameters: tuple[str, ...]
    values: np.ndarray
    time: np.ndarray
    displacement: np.ndarray
    net_translation: np.ndarray
    per_period: np.ndarray
    work: np.ndarray
    period_work: np.ndarray
    one_sided: np.ndarray
    kinks: tuple[Kink, ...]
    tolerance: float = 0.0

    @property
    def differentiable(self) -> bool:
        """Whether all derivatives are two-sided."""
        return not self.one_sided.any()

    def __repr__(self) -> str:
        """Describe the derivatives in one line."""
        state = "differentiable"
        if not self.differentiable:
            state = f"{int(self.one_sided.sum())} of them one-sided"
        error = f", errors up to about {self.tolerance:.0e}" if self.tolerance else ""
        return f"Sensitivities({len(self.parameters)} parameters, {self.time.size} times, {state}{error})"

    def _repr_html_(self) -> str:
        """Show the derivatives of the gain in the last period, or at the end, in a notebook."""
        which = "per_period" if self.per_period.size else "net_translation"
        last = getattr(self, which)[-1].T
        sides = np.where(self.one_sided, " (one-sided somewhere)", "").tolist()
        facts = [
            (f"{name} = {value:.6g}", write_numbers(derivative) + side)
            for name, value, derivative, side in zip(self.parameters, self.values, last, sides, strict=True)
        ]
        return write_html(f"Derivatives of {which}[-1] with respect to {len(facts)} parameters", facts[:_MOST_SHOWN])


def sensitivities(
    scene: Scene | str | Path, keys: Sequence[str], duration: float | None = None, rate: float = 100.0
) -> Sensitivities:
    """Differentiate a run of a scene with respect to its numbers.

    The derivatives are exact through events: the path is piecewise linear, and only contacts that stop remember how
    they moved. Where a derivative is one-sided, `one_sided` and `kinks` report it, and the derivative is that of the
    path with the events in the order in which they are met. In the plane, where paths are followed to a tolerance, the
    derivatives are differences of refined runs, four for each parameter, and `tolerance` estimates their error.

    A waypoint's derivatives are those at the moving waypoint for gains and work, and at the fixed time for
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
        SceneError: if a key is unknown or names no number, if the scene has no drive, or has patches of ground.
        CommandError: if duration or rate is out of range, or a ramp has too many events.
    """
    scene = coerce_scene(scene, "sensitivities")
    check_differentiable(scene, "sensitivities", plane=True)
    if scene.dimension == 2:
        return _in_plane(differentiate_in_plane(scene, keys, duration, rate, "sensitivities"))
    derivatives = differentiate_arrays(scene, keys, "sensitivities")
    seconds = default_duration(scene.drive) if duration is None else float(duration)
    check_duration(seconds)
    ratio = rational_rate(rate)
    times = seconds * float(ratio) + 1.0
    numbers = times * scene.body.contacts * len(derivatives.names)
    if numbers > _MOST_NUMBERS:
        raise CommandError(
            f"sensitivities: {numbers:.1e} derivatives ({times:.0f} times, {scene.body.contacts} contacts, "
            f"{len(derivatives.names)} parameters); at most {_MOST_NUMBERS:.0e}: choose a lower rate or fewer keys"
        )
    end_ns = round(seconds * NS)
    tick_ns = tick_ends(1, count_ticks(end_ns, ratio), ratio, end_ns)
    path = TangentPath(scene, derivatives, samples=True)
    dx = [path.dx[None]]
    marks, works, d_works = [(path.dx, 0)], np.zeros(0), [np.zeros((0, len(derivatives.names)))]
    vertex_ns = [np.zeros(1, np.int64)]
    for first in range(0, tick_ns.size, _CHUNK):
        ends = tick_ns[first : first + _CHUNK]
        vertices = build_vertices(scene.drive, derivatives, int(tick_ns[first - 1]) if first else 0, ends)
        stretch = path.follow(vertices)
        at = np.searchsorted(vertices.time_ns, ends)
        dx.append(_at_fixed_times(path, vertices, stretch, at))
        if scene.drive.period is not None:
            done = np.flatnonzero((vertices.before == 0) & (vertices.part == 0.0) & (vertices.after == 0))
            marks.extend((stretch.dx[i].copy(), works.size + int(i) + 1) for i in done)
        works = np.concatenate((works, stretch.work))
        d_works.append(stretch.d_work)
        vertex_ns.append(vertices.time_ns)
    d_work = np.concatenate(d_works)
    share = scene.body.share
    ends_of_periods = np.array([share @ mark for mark, _ in marks])
    spent = np.array([d_work[a:b].sum(axis=0) for (_, a), (_, b) in itertools.pairwise(marks)])
    columns = len(derivatives.names)
    displacement = np.concatenate(dx)
    return Sensitivities(
        derivatives.names,
        frozen(derivatives.values),
        frozen(np.concatenate(([0], tick_ns)) / NS),
        frozen(displacement),
        frozen(np.einsum("n,tnp->tp", share, displacement)),
        frozen(np.diff(ends_of_periods, axis=0).reshape(-1, columns)),
        frozen(d_work.sum(axis=0)),
        frozen(spent.reshape(-1, columns)),
        frozen(path.one_sided, np.bool_),
        _kinks(scene, path, np.concatenate(vertex_ns)),
    )


def _in_plane(found: PlanarDerivatives) -> Sensitivities:
    return Sensitivities(
        found.names,
        frozen(found.values),
        found.run.time,
        frozen(found.displacement),
        frozen(found.net_translation),
        frozen(found.per_period),
        frozen(found.work),
        frozen(np.zeros((0, len(found.names)))),
        frozen(found.one_sided, np.bool_),
        (),
        found.tolerance,
    )


def check_differentiable(scene: Scene, caller: str, plane: bool = False) -> None:
    """Check that the path of a scene can be differentiated.

    Args:
        scene: the scene.
        caller: name of the function, for error messages.
        plane: whether differences of runs in the plane will do.

    Raises:
        SceneError: if it has no drive, is in the plane, or has patches of ground.
    """
    refuse_turning(scene, caller)
    if scene.parts.drive is None:
        raise SceneError(f"{caller}: {scene.name} has no drive; without one nothing moves")
    if scene.dimension == 2 and not plane:
        raise SceneError(f"{caller}: {scene.name} is in the plane; derivatives are for bodies on a line")
    if scene.ground.track is not None:
        raise SceneError(f"{caller}: {scene.name} has ground.patches; derivatives across jumps are not implemented")


def _at_fixed_times(path: TangentPath, vertices: Vertices, stretch: Stretch, at: np.ndarray) -> np.ndarray:
    """Select the derivatives at ticks; where a waypoint moves past a tick, those of the path at the fixed time."""
    dx = stretch.dx[at]
    for k in np.flatnonzero(vertices.d_time[at].any(axis=1)):
        i = int(at[k])
        begin = int(vertices.time_ns[i - 1]) if i else int(vertices.time_ns[i]) - 1
        speed = stretch.speed[i] * (NS / (int(vertices.time_ns[i]) - begin))
        dx[k] -= speed[:, None] * vertices.d_time[i]
        path.one_sided |= vertices.d_time[i] != 0.0
    return dx


def _kinks(scene: Scene, path: TangentPath, vertex_ns: np.ndarray) -> tuple[Kink, ...]:
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
