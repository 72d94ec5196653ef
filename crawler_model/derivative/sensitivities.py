"""Exact derivatives of displacement, gain and work with respect to the numbers of a scene."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np

from ..arrays import frozen
from ..body.drive import NS
from ..errors import CommandError, SceneError
from ..run.simulate import default_duration, rational_rate, tick_end_ns
from ..scene.file import coerce_scene
from ..scene.scene import Scene
from .parameters import differentiate_arrays
from .path import Stretch, TangentPath, Vertices, build_vertices

_CHUNK = 4096
_MOST_NUMBERS = 200_000_000


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
        displacement: d x / d p, shape (T, N, P).
        net_translation: d y / d p, shape (T, P).
        per_period: derivatives of the net translation gained in each whole period, shape (periods, P).
        work: derivatives of the work of the actuators in the whole run, shape (P,).
        period_work: derivatives of that work in each whole period, shape (periods, P).
        one_sided: parameters whose derivatives are one-sided somewhere on the path, bool, shape (P,).
        kinks: where they are.
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

    @property
    def differentiable(self) -> bool:
        """Whether all derivatives are two-sided."""
        return not self.one_sided.any()

    def __repr__(self) -> str:
        """Describe the derivatives in one line."""
        state = "differentiable" if self.differentiable else f"one-sided at {len(self.kinks)} kink(s)"
        return f"Sensitivities({len(self.parameters)} parameters, {self.time.size} times, {state})"


def sensitivities(
    scene: Scene | str | Path, keys: Sequence[str], duration: float | None = None, rate: float = 100.0
) -> Sensitivities:
    """Differentiate a run of a scene with respect to its numbers.

    The derivatives are exact through events: the path is piecewise linear, and only contacts that stop remember how
    they moved. Where a derivative is one-sided, `one_sided` and `kinks` report it, and the derivative is that of the
    path with the events in the order in which they are met.

    A waypoint's derivatives are those at the moving waypoint for gains and work, and at the fixed time for
    displacements. The first time of a drive, which is 0, and the last waypoint of a drive that ends with its period,
    which repeats the first one, are fixed: their derivatives are 0.

    Args:
        scene: a scene on a line, a path or a gallery name.
        keys: dotted keys, as for `vary`; a key that names a table or a list counts once for each number in it.
        duration: duration [s]; None for ten periods, or up to the last waypoint.
        rate: ticks per second [Hz].

    Returns:
        The derivatives at the times of `simulate(scene, duration, rate)`.

    Raises:
        SceneError: if a key is unknown or names no number, if the scene has no drive, is in the plane, or has patches
            of ground.
        CommandError: if duration or rate is out of range, or a ramp has too many events.
    """
    scene = coerce_scene(scene, "sensitivities")
    check_differentiable(scene, "sensitivities")
    derivatives = differentiate_arrays(scene, keys, "sensitivities")
    seconds = default_duration(scene.drive) if duration is None else float(duration)
    if not 0.0 <= seconds < 9e9:
        raise CommandError(f"duration: {seconds:g} s; it must be between 0 and 9e9")
    ratio = rational_rate(rate)
    times = seconds * float(ratio) + 1.0
    numbers = times * scene.body.contacts * len(derivatives.names)
    if numbers > _MOST_NUMBERS:
        raise CommandError(
            f"sensitivities: {numbers:.1e} derivatives ({times:.0f} times, {scene.body.contacts} contacts, "
            f"{len(derivatives.names)} parameters); at most {_MOST_NUMBERS:.0e}: choose a lower rate or fewer keys"
        )
    tick_ns = _tick_ends(seconds, ratio)
    path = TangentPath(scene, derivatives)
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


def check_differentiable(scene: Scene, caller: str) -> None:
    """Check that the path of a scene can be differentiated.

    Args:
        scene: the scene.
        caller: name of the function, for error messages.

    Raises:
        SceneError: if it has no drive, is in the plane, or has patches of ground.
    """
    if scene.parts.drive is None:
        raise SceneError(f"{caller}: {scene.name} has no drive; without one nothing moves")
    if scene.dimension == 2:
        raise SceneError(f"{caller}: {scene.name} is in the plane; derivatives are for bodies on a line")
    if scene.ground.track is not None:
        raise SceneError(f"{caller}: {scene.name} has ground.patches; derivatives across jumps are not implemented")


def _tick_ends(seconds: float, rate: Fraction) -> np.ndarray:
    """Compute the ends of all ticks [ns]; the last one may be cut short."""
    end_ns = round(seconds * NS)
    ticks = -(-end_ns * rate.numerator // (NS * rate.denominator))
    return np.array([min(tick_end_ns(k, rate), end_ns) for k in range(1, ticks + 1)], dtype=np.int64)


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
    """Group kinks by time."""
    grouped: dict[float, list[str]] = {}
    for ramp, place, contact in path.kinks:
        begin, end = int(vertex_ns[ramp]), int(vertex_ns[ramp + 1])
        names = grouped.setdefault((begin + place * (end - begin)) / NS, [])
        name = scene.body.name_of(contact)
        if name not in names:
            names.append(name)
    return tuple(Kink(time, tuple(names)) for time, names in sorted(grouped.items()))
