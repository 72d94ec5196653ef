"""Derivatives of runs in the plane: differences of fourth order between runs refined far below their steps.

In the plane paths are curved and are followed to a tolerance, so that a derivative has one, too. It is estimated from
differences of two orders and from the tolerance of the runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import SceneError
from ..run.simulate import simulate
from ..run.trajectory import Trajectory
from ..scene.scene import Scene
from ..sweep.vary import Variations, vary
from .parameters import changing_keys, expand_keys

_TOLERANCE = 1e-7
"""Tolerance of the runs whose differences are taken."""
_STEP = 2.0**-10
"""Step of the differences, relative to the value of the parameter."""
_SMALLEST = 2.0**-3
"""Values are taken to be of this size at least."""
_ONE_SIDED = 1e-2
"""Derivatives to both sides that differ by more than this part are those of a kink."""


@dataclass(frozen=True)
class PlanarDerivatives:
    """Derivatives of a run in the plane with respect to P parameters.

    Attributes:
        names: names of the parameters.
        values: their values in the scene, shape (P,).
        run: the run itself.
        displacement: d x / d p, shape (T, N, 2, P).
        net_translation: d y / d p, shape (T, 2, P).
        per_period: of the gain of each whole period, shape (periods, 2, P).
        work: of the work of the actuators in the whole run, shape (P,).
        one_sided: parameters with a kink within the step of the differences, bool, shape (P,).
        tolerance: estimate of the largest error of the derivatives, relative to the largest of each parameter [1].
    """

    names: tuple[str, ...]
    values: np.ndarray
    run: Trajectory
    displacement: np.ndarray
    net_translation: np.ndarray
    per_period: np.ndarray
    work: np.ndarray
    one_sided: np.ndarray
    tolerance: float


def differentiate_in_plane(
    scene: Scene, keys: Sequence[str], duration: float | None, rate: float, caller: str
) -> PlanarDerivatives:
    """Differentiate a run in the plane.

    Args:
        scene: a scene in the plane.
        keys: as for `expand_keys`.
        duration: as for `simulate` [s].
        rate: ticks per second [Hz].
        caller: name of the function, for error messages.

    Returns:
        The derivatives, from four runs for each parameter.

    Raises:
        SceneError: if a key is unknown, or no value near that of the scene is valid.
    """
    names = expand_keys(scene, keys, caller)
    everything = vary(scene, {name: [0.0] for name in names}, grid=False)
    document = scene.document()
    fine = Scene.model_validate(document | {"tolerance": _TOLERANCE})
    base = simulate(scene, duration, rate)
    columns, one_sided, errors = [], [], [0.0]
    middle = _numbers(simulate(fine, duration, rate))
    for name, path in zip(names, everything.paths, strict=True):
        value = everything.origin(name)
        changing = changing_keys(scene, name, path)
        if not changing:
            columns.append(np.zeros(middle.size))
            one_sided.append(False)
            continue
        step = _STEP * max(abs(value), _SMALLEST)

        def at(k: int) -> np.ndarray:
            values = dict.fromkeys(changing, np.array([value + k * step]))  # noqa: B023
            return _numbers(simulate(Variations(fine, values, (1,))[0], duration, rate))

        try:
            slope, error, kinked = _difference(at, middle, step)
        except SceneError as refused:
            raise SceneError(f"{caller}: {name}: values near {value:g} are not valid: {refused}") from None
        size = max(float(np.abs(slope).max()), 1e-300)
        columns.append(slope)
        one_sided.append(kinked)
        errors.append(0.0 if kinked else error / size)
    stacked = np.stack(columns, axis=-1)
    shapes = [array.shape for array in _arrays(base)]
    sizes = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
    x, y, gains, work = (
        part.reshape(*shape, len(names)) for part, shape in zip(np.split(stacked, sizes), shapes, strict=True)
    )
    values = np.array([everything.origin(name) for name in names])
    return PlanarDerivatives(names, values, base, x, y, gains, work[0], np.array(one_sided), max(errors))


def _difference(at: Callable[[int], np.ndarray], middle: np.ndarray, step: float) -> tuple[np.ndarray, float, bool]:
    """Compute a derivative, an estimate of its largest error, and whether both sides differ."""
    rows = {k: at(k) for k in (-2, -1, 1, 2)}
    narrow, wide = (rows[1] - rows[-1]) / (2.0 * step), (rows[2] - rows[-2]) / (4.0 * step)
    slope = (4.0 * narrow - wide) / 3.0
    ahead, behind = (rows[1] - middle) / step, (middle - rows[-1]) / step
    size = float(np.abs(slope).max())
    kinked = float(np.abs(ahead - behind).max()) > _ONE_SIDED * size
    return (ahead if kinked else slope), float(np.abs(slope - narrow).max()), kinked


def _arrays(run: Trajectory) -> tuple[np.ndarray, ...]:
    return run.displacement, run.net_translation, run.per_period, np.array([run.energy.work])


def _numbers(run: Trajectory) -> np.ndarray:
    return np.concatenate([array.ravel() for array in _arrays(run)])
