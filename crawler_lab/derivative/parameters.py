"""The parameters of a scene, and the derivatives of its arrays with respect to them."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from crawler_model.body.body import Body
from crawler_model.errors import SceneError
from crawler_model.motion.plane.frame import build_frame
from crawler_model.rounding import EPS
from crawler_model.scene.assembly import Assembly
from crawler_model.scene.scene import Scene

from ..sweep.keys import expand_keys
from ..sweep.stack import shares_mesh, stack
from ..sweep.vary import Variations, vary

_STEP = 2.0**-7
"""Step of the differences of assembled arrays, relative to the value of the parameter."""
_STEP_OF_CURVES = 2.0**-10
"""The same in scenes with curves, whose knots may be close together."""
_SMALLEST = 0.125
"""Values are taken to be of this size at least."""
_CENTRAL, _ONE_SIDED = (-3, -2, -1, 0, 1, 2, 3), (0, 1, 2, 3, 4, 5, 6)
"""Places of the differences, in steps: their error is of sixth order."""
_TRIES, _FINER = 8, 16.0
"""Steps that are tried, and the ratio of each to the next one."""
_TOGETHER = 256
"""Parameters whose arrays are assembled in one call."""
_SAME = 1e-14
"""Numbers that change by a smaller part of their size change only by rounding."""
_AGREE, _NOISE = 1e-7, 64.0 * EPS
"""Part by which derivatives from two steps differ at most if the steps are short enough and no kink is between
them, and rounding errors of the arrays, relative to their sizes."""
_GROWS = 8.0
"""Factor by which a difference grows at least where a number jumps, when the step shrinks by `_FINER`."""
_START = 3
"""Which of `_arrays` is the displacement at the start."""
_LINEAR = 1e-13
"""Arrays whose second difference is below this part of their size depend on the parameter linearly."""


def _nothing() -> np.ndarray:
    return np.zeros(0)


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of the arrays of a scene with respect to P parameters.

    Attributes:
        names: names of the parameters.
        values: their values in the scene, shape (P,).
        stiffness: of k, shape (S, P); in the plane as in a `Frame`, shape (K, P).
        pieces: of the pieces of the curves of bent springs, actuator and passive spring of each in turn, columns as in
            `body.curves`, shape (R, 6, P); zero where they are infinite.
        targets: of the targets at the waypoints, shape (W, F, P).
        start: of x at the start, shape (N, P), in the plane (N, 2, P).
        times: of the times of the waypoints, shape (W, P) [s per unit of the parameter].
        period: of the period, shape (P,) [s per unit of the parameter]; zero without one.
        position: of the reference positions in the plane, shape (N, 2, P); empty on a line.
        rest: of the rest lengths and angles in the plane, as in a `Frame`, shape (K, P); empty on a line.
        offset: of the angles of the axes of friction in the plane, shape (N, P); empty on a line.
        jumps: whether an array jumps as the parameter changes, so that its derivative is one-sided, bool, shape (P,);
            empty if none does.
    """

    names: tuple[str, ...]
    values: np.ndarray
    stiffness: np.ndarray
    pieces: np.ndarray
    targets: np.ndarray
    start: np.ndarray
    times: np.ndarray
    period: np.ndarray
    position: np.ndarray = field(default_factory=_nothing)
    rest: np.ndarray = field(default_factory=_nothing)
    offset: np.ndarray = field(default_factory=_nothing)
    jumps: np.ndarray = field(default_factory=_nothing)


def differentiate_arrays(scene: Scene, keys: Sequence[str], caller: str) -> Derivatives:
    """Differentiate the arrays of a scene with respect to numbers of its document.

    Most arrays depend on most numbers linearly, so that their differences are exact; the others are differentiated by
    differences of sixth order.

    Args:
        scene: the scene.
        keys: as for `expand_keys`.
        caller: name of the function, for error messages.

    Returns:
        The derivatives.

    Raises:
        SceneError: if a key is unknown or its number cannot change, or springs or actuators remember their path.
    """
    if scene.body.memory:
        raise SceneError(
            f"{caller}: {scene.name} has {scene.body.memory}; derivatives of what they remember are not implemented: "
            "`crawler sweep` varies their numbers"
        )
    names = expand_keys(scene, keys, caller)
    everything = vary(scene, {name: [0.0] for name in names}, grid=False)
    for name, path in zip(names, everything.paths, strict=True):
        if "directions" in path:
            raise SceneError(f"{caller}: {name}: derivatives by directions are not computed; by the values they are")
    origin = {name: everything.origin(name) for name in names}
    changing = {name: changing_keys(scene, name, path) for name, path in zip(names, everything.paths, strict=True)}
    together = [name for name, path in zip(names, everything.paths, strict=True) if shares_mesh(scene, [path])]
    found = _differentiate_together(scene, origin, {name: changing[name] for name in together})
    jumps = np.zeros(len(names), dtype=bool)
    for p, name in enumerate(names):
        if name not in found:
            found[name], jumps[p] = _differentiate_alone(scene, name, origin[name], changing[name], caller)
    stacked = np.stack([found[name] for name in names], axis=-1)
    shapes = [np.shape(array) for array in _arrays(scene)]
    rows = np.split(stacked, np.cumsum([math.prod(shape) for shape in shapes])[:-1])
    parts = [part.reshape(*shape, len(names)) for shape, part in zip(shapes, rows, strict=True)]
    stiffness, pieces, targets, start, times, period, position, rest, offset = parts
    values, of_plane = np.array(list(origin.values())), (position, rest, offset)
    return Derivatives(names, values, stiffness, pieces, targets, start, times, period[0], *of_plane, jumps)


def _differentiate_together(
    scene: Scene, origin: dict[str, float], changing: dict[str, tuple[str, ...]]
) -> dict[str, np.ndarray]:
    """Compute the derivatives of all arrays with respect to parameters that share a mesh.

    Parameters on which an array does not depend linearly are left out.
    """
    base = _flat(scene)[0]
    found = {name: np.zeros(base.size) for name, group in changing.items() if not group}
    names = [name for name, group in changing.items() if group]
    if not names:
        return found
    keys = [key for name in names for key in changing[name]]
    owner = np.array([i for i, name in enumerate(names) for _ in changing[name]])
    value = np.array([origin[name] for name in names])
    step = _STEP * np.maximum(np.abs(value), _SMALLEST)
    for first in range(0, len(names), _TOGETHER):
        which = np.arange(first, min(first + _TOGETHER, len(names)))
        moved = np.repeat(which, 2)
        shift = np.tile((-1.0, 1.0), which.size) * step[moved]
        columns = value[owner, None] + np.where(owner[:, None] == moved, shift, 0.0)
        variations = Variations(scene, dict(zip(keys, columns, strict=True)), (moved.size,))
        arrays = _flat(stack(variations, check=False).assembly, moved.size)
        for i, pair in zip(which, arrays.reshape(which.size, 2, -1), strict=True):
            size = np.maximum(np.abs(pair).max(axis=0), np.abs(base))
            if (np.abs(pair[0] + pair[1] - 2.0 * base) <= _LINEAR * size).all():
                found[names[i]] = (pair[1] - pair[0]) / (2.0 * step[i])
    return found


def _differentiate_alone(
    scene: Scene, name: str, value: float, changing: tuple[str, ...], caller: str
) -> tuple[np.ndarray, bool]:
    """Compute the derivative of all arrays, one after another, from scenes that are assembled one by one.

    Where a number jumps, the side on which it does not counts, and 0 where it jumps on both; whether one does is the
    second result.
    """
    base, size = _flat(scene)[0], _sizes(scene)

    @functools.cache
    def arrays_at(step: float) -> np.ndarray:
        arrays = _flat(Variations(scene, dict.fromkeys(changing, np.array([value + step])), (1,))[0])[0]
        if arrays.size != base.size:
            raise SceneError(
                f"{caller}: {name} changes the number of waypoints, contacts or knots; it has no derivative"
            )
        return arrays

    step = (_STEP_OF_CURVES if scene.body.bends else _STEP) * max(abs(value), _SMALLEST)
    found, left = np.zeros(base.size), np.ones(base.size, dtype=bool)
    valid, error = 0, SceneError("")
    for places, side in ((_CENTRAL, 1.0), (_ONE_SIDED, 1.0), (_ONE_SIDED, -1.0)):
        try:
            derivative, grows = _refine(arrays_at, (base, size), places, side * step)
        except SceneError as refused:
            error = refused
            continue
        found = np.where(left & ~grows, derivative, found)
        left, valid = left & grows, valid + 1
        if not left.any():
            break
    if not valid:
        raise SceneError(f"{caller}: {name}: no value near {value:g} is valid: {error}")
    return found, valid > 1 or bool(left.any())


def _refine(
    arrays_at: Callable[[float], np.ndarray], origin: tuple[np.ndarray, np.ndarray], places: Sequence[int], step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the derivative at 0 with steps that shrink, until differences of two steps agree.

    Each number has the longest step that agrees with the next one: a start at rest has kinks where knots are met, and a
    derivative that is zero may agree with none. `origin` has the numbers at 0, and the sizes to which their rounding
    errors are relative. The second result is which differences grow as the steps shrink.
    """
    base, size = origin
    derivative, known = np.zeros(base.size), np.zeros(base.size, dtype=bool)
    grows = np.zeros(base.size, dtype=bool)
    error: SceneError | None = None
    valid = False
    for _ in range(_TRIES):
        try:
            found, finer = (_difference(arrays_at, base, places, length) for length in (step, step / _FINER))
        except SceneError as refused:
            error = error or refused
        else:
            valid = True
            derivative = np.where(known, derivative, finer)
            known |= _agree(found, finer, size, abs(step) / _FINER)
            least = np.maximum(_GROWS * np.abs(found), _AGREE * np.abs(base).max(initial=0.0) / abs(step))
            grows = (np.abs(finer) > least) & ~known
            if known.all():
                break
        step /= _FINER
    if error is not None and not valid:
        raise error
    return derivative, grows


def _agree(derivative: np.ndarray, finer: np.ndarray, size: np.ndarray, step: float) -> np.ndarray:
    """Determine where differences with two steps (the second is given) are equal up to their errors."""
    allowed = _AGREE * np.maximum(np.abs(derivative), np.abs(finer)) + _NOISE * size / step
    return np.asarray(np.abs(derivative - finer) <= allowed)


def _difference(
    arrays_at: Callable[[float], np.ndarray], base: np.ndarray, places: Sequence[int], step: float
) -> np.ndarray:
    """Compute the derivative at 0 from values at some places; from the two outermost where it is linear."""
    first, last = arrays_at(places[0] * step) if places[0] else base, arrays_at(places[-1] * step)
    width = (places[-1] - places[0]) * step
    middle = arrays_at(0.5 * (places[0] + places[-1]) * step) if places[0] == 0 else base
    size = np.maximum(np.maximum(np.abs(first), np.abs(last)), np.abs(middle))
    if (np.abs((first + last) - 2.0 * middle) <= _LINEAR * size).all():
        return np.where(np.abs(last - first) <= _SAME * size, 0.0, (last - first) / width)
    rows = np.array([arrays_at(place * step) if place else base for place in places])
    changes = np.ptp(rows, axis=0) > _SAME * size
    return np.where(changes, _weights(places) @ (rows - base) / step, 0.0)


@functools.cache
def _weights(places: tuple[int, ...]) -> np.ndarray:
    """Compute the weights with which values at some places add up to the derivative at 0."""
    matrix = np.vander(np.array(places, dtype=np.float64), increasing=True).T
    unit = np.zeros(len(places))
    unit[1] = 1.0
    return np.linalg.solve(matrix, unit)


def _arrays(scene: Assembly) -> tuple[np.ndarray, ...]:
    """Collect all arrays of a scene, or of variations, that a run depends on."""
    drive = scene.drive
    period = np.atleast_1d(0.0 * drive.times[..., :1] if drive.period is None else drive.period)
    stiffness, shape = scene.body.stiffness, (np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    if scene.dimension == 2:
        frame = build_frame(scene.body, scene.directions)
        stiffness, shape = frame.stiffness, (frame.position, frame.rest, frame.offset)
    start = scene.start_displacement
    return (stiffness, collect_pieces(scene.body), drive.targets, start, drive.times, period, *shape)


def _sizes(scene: Assembly) -> np.ndarray:
    """Find what rounding errors are relative to: the size of each number, for the start at least the body's."""
    arrays = [np.abs(array) for array in _arrays(scene)]
    arrays[_START] = np.maximum(arrays[_START], np.ptp(scene.body.position))
    return np.concatenate([array.ravel() for array in arrays])


def collect_pieces(body: Body) -> np.ndarray:
    """Collect the pieces of the curves of bent springs.

    Args:
        body: the body.

    Returns:
        Pieces of the actuator and of the passive spring of each in turn, columns as in `body.curves`, with 0 for
        infinity, shape (R, 6).
    """
    curves = [curve.pieces for bend in body.bends for curve in (bend.actuator, bend.passive)]
    pieces = np.concatenate([np.zeros((0, 6)), *curves])
    return np.where(np.isfinite(pieces), pieces, 0.0)


def _flat(scene: Assembly, count: int = 1) -> np.ndarray:
    """Join the arrays of a scene, or of so many variations that were assembled together, shape (count, size)."""
    return np.hstack([np.reshape(array, (count, -1)) for array in _arrays(scene)])


def changing_keys(scene: Scene, name: str, path: tuple[str | int, ...]) -> tuple[str, ...]:
    """Find the keys that change with a number.

    The first time of a drive is 0. The last waypoint of a drive that ends with its period repeats the first one, and is
    not used itself.

    Args:
        scene: the scene.
        name: key of the number.
        path: the same key as a path into the document.

    Returns:
        The key, and its twin in the last row if there is one; none if the number is fixed or not used.
    """
    drive = scene.drive
    if path == ("drive", "times", 0):
        return ()
    if path[0] != "drive" or drive.period is None or drive.period > drive.times[-1]:
        return (name,)
    last = drive.times.size - 1
    depth = next((i for i, step in enumerate(path) if isinstance(step, int)), None)
    if depth is None or scene.parts.drive is None or scene.parts.drive.times is None:
        return (name,)
    if path[depth] == last:
        return ()
    if path[1] == "times":
        return (name,)
    return (name, ".".join(map(str, (*path[:depth], last, *path[depth + 1 :])))) if path[depth] == 0 else (name,)
