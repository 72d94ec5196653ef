"""The parameters of a scene, and the derivatives of its arrays with respect to them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import SceneError
from ..scene.scene import Scene
from ..sweep.vary import Variations, key_steps, vary

_STEP = 2.0**-7
"""Step of the differences of assembled arrays, relative to the value of the parameter."""
_SMALLEST = 0.125
"""Values are taken to be of this size at least."""
_CENTRAL, _ONE_SIDED = (-3, -2, -1, 0, 1, 2, 3), (0, 1, 2, 3, 4, 5, 6)
"""Places of the differences, in steps: their error is of sixth order."""
_TRIES = 5
_LINEAR = 1e-13
"""Arrays whose second difference is below this part of their size depend on the parameter linearly."""


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of the arrays of a scene with respect to P parameters.

    Attributes:
        names: names of the parameters.
        values: their values in the scene, shape (P,).
        stiffness: of k, shape (S, P).
        targets: of the targets at the waypoints, shape (W, F, P).
        start: of x at the start, shape (N, P).
        times: of the times of the waypoints, shape (W, P) [s per unit of the parameter].
        period: of the period, shape (P,), likewise; zero without one.
    """

    names: tuple[str, ...]
    values: np.ndarray
    stiffness: np.ndarray
    targets: np.ndarray
    start: np.ndarray
    times: np.ndarray
    period: np.ndarray


def expand_keys(scene: Scene, keys: Sequence[str], caller: str) -> tuple[str, ...]:
    """List the numbers that keys name.

    Args:
        scene: the scene.
        keys: dotted keys as for `vary`; a key that names a table or a list counts once for each number in it, row by
            row.
        caller: name of the function, for error messages.

    Returns:
        Names such as `drive.actuation[3][1]`.

    Raises:
        SceneError: if a key is unknown, names no number, or is given twice.
    """
    if isinstance(keys, str) or not keys:
        raise SceneError(f"{caller}: {keys!r}; it must be a list of at least one key, for example ['friction.forward']")
    names: list[str] = []
    for key in keys:
        if not isinstance(key, str):
            raise SceneError(f"{caller}: {key!r}; a key is a string, for example friction.forward")
        node = _look_up(scene.document(), key_steps(key))
        names.extend(_names_below(node, key) if isinstance(node, list) else [key])
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"{caller}: {name} is named twice")
    return tuple(names)


def _look_up(node: Any, steps: Sequence[str]) -> Any:
    """Find what a key names in a document; None if it is not there."""
    for step in steps:
        if isinstance(node, list):
            named = [part for part in node if isinstance(part, dict) and part.get("name") == step]
            inside = step.isdecimal() and int(step) < len(node)
            node = named[0] if named else node[int(step)] if inside else None
        else:
            node = node.get(step) if isinstance(node, dict) else None
    return node


def _names_below(node: list[Any], name: str) -> Iterator[str]:
    for i, part in enumerate(node):
        if isinstance(part, list):
            yield from _names_below(part, f"{name}[{i}]")
        else:
            yield f"{name}[{i}]"


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
        SceneError: if a key is unknown or its number cannot change.
    """
    names = expand_keys(scene, keys, caller)
    body, drive = scene.body, scene.drive
    found = [_differentiate(scene, name, caller) for name in names]
    stacked = np.stack([derivative for _, derivative in found], axis=-1)
    shapes = (body.stiffness.shape, drive.targets.shape, body.position.shape, drive.times.shape, (1,))
    parts, first = [], 0
    for shape in shapes:
        size = int(np.prod(shape))
        parts.append(np.ascontiguousarray(stacked[first : first + size].reshape(*shape, len(names))))
        first += size
    values = np.array([value for value, _ in found])
    return Derivatives(names, values, *parts[:4], parts[4][0])


def _differentiate(scene: Scene, name: str, caller: str) -> tuple[float, np.ndarray]:
    """Compute the value of a parameter and the derivative of all arrays, one after another."""
    variations = vary(scene, {name: [0.0]})
    path = variations.paths[0]
    value = variations.origin(name)
    changing = _twin(scene, path, name, caller)
    base = _arrays(scene)
    if changing is None:
        return value, np.zeros(base.size)

    @functools.cache
    def at(step: float) -> np.ndarray:
        arrays = _arrays(Variations(scene, dict.fromkeys(changing, np.array([value + step])), (1,))[0])
        if arrays.size != base.size:
            raise SceneError(f"{caller}: {name} changes the number of waypoints or contacts; it has no derivative")
        return arrays

    step = _STEP * max(abs(value), _SMALLEST)
    error: SceneError | None = None
    for _ in range(_TRIES):
        for places, side in ((_CENTRAL, 1.0), (_ONE_SIDED, 1.0), (_ONE_SIDED, -1.0)):
            try:
                return value, _difference(at, base, places, side * step)
            except SceneError as refused:
                error = error or refused
        step /= 16.0
    assert error is not None
    raise SceneError(f"{caller}: {name}: no value near {value:g} is valid: {error}")


def _difference(at: Callable[[float], np.ndarray], base: np.ndarray, places: Sequence[int], step: float) -> np.ndarray:
    """Compute the derivative at 0 from values at some places; from the two outermost where it is linear."""
    first, last = at(places[0] * step) if places[0] else base, at(places[-1] * step)
    width = (places[-1] - places[0]) * step
    middle = at(0.5 * (places[0] + places[-1]) * step) if places[0] == 0 else base
    size = np.maximum(np.maximum(np.abs(first), np.abs(last)), np.abs(middle))
    if (np.abs((first + last) - 2.0 * middle) <= _LINEAR * size).all():
        return (last - first) / width
    rows = [at(place * step) if place else base for place in places]
    matrix = np.vander(np.array(places, dtype=np.float64), increasing=True).T
    unit = np.zeros(len(places))
    unit[1] = 1.0
    return np.asarray(np.linalg.solve(matrix, unit) @ (np.array(rows) - base) / step)


def _arrays(scene: Scene) -> np.ndarray:
    """Collect all arrays of a scene that a run depends on."""
    drive = scene.drive
    period = 0.0 if drive.period is None else drive.period
    parts = (scene.body.stiffness, drive.targets, scene.start_displacement, drive.times, [period])
    return np.concatenate([np.ravel(part) for part in parts])


def _twin(scene: Scene, path: tuple[str | int, ...], name: str, caller: str) -> tuple[str, ...] | None:
    """Find the keys that change with a number: the last row of a closed drive repeats the first, and is not used."""
    drive = scene.drive
    if path[0] != "drive" or drive.period is None or drive.period > drive.times[-1]:
        return (name,)
    last = drive.times.size - 1
    depth = next((i for i, step in enumerate(path) if isinstance(step, int)), None)
    if depth is None or scene.parts.drive is None or scene.parts.drive.times is None:
        return (name,)
    if path[1] == "times":
        if path[depth] == last:
            raise SceneError(f"{caller}: {name} is the end of the period; name drive.period instead")
        return (name,)
    if path[depth] == last:
        return None
    return (name, ".".join(map(str, (*path[:depth], last, *path[depth + 1 :])))) if path[depth] == 0 else (name,)
