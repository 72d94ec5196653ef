"""The least number of elements and pieces that explain a loop, by least squares and Schwarz's criterion."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..identify.sensor.noise import Noise, Whitening, build_whitening, estimate_noise, find_floor
from .loop import LoopPath, Shape, compute_force, find_reversals, follow_stop

_MOST = Shape(3, 4)
"""Most knots and elements."""
_ROWS = 1500
"""Rows by which the numbers of elements and pieces are chosen; all rows determine the parameters."""
_REACHES, _PARTS, _KNOTS = 20, (-1.0, 0.0, 1.0), 15
"""Elements and knots that are tried: reaches, first forces, places."""
_EDGE = 0.04
"""Part of the elongations at either end in which there is no knot."""
_CALLS = 60
_MEMORY = 0.1
"""Longest memory of noise as a part of a run: what is slower is explained, or is misfit."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The spring and the elements that fit a loop.

    Attributes:
        shape: the numbers of knots and elements.
        x: the parameters.
        misfit: sum of the squares of whitened residuals [1].
        free: which parameters are inside their bounds, shape (P,).
    """

    shape: Shape
    x: np.ndarray
    misfit: float
    free: np.ndarray


@dataclass(frozen=True, eq=False)
class Target:
    """What is fitted.

    Attributes:
        path: the elongations.
        force: of the rows, shape (R,) [N].
        whitening: of their noise.
        reach: least and largest elongation at which an element that the loop determines yields, shape (2,) [m].
        least: square of a whitened residual below which digits count [1].
    """

    path: LoopPath
    force: np.ndarray
    whitening: Whitening
    reach: np.ndarray
    least: float

    def score(self, fit: Fit) -> float:
        """Compute Schwarz's criterion, which is least for the fit to choose.

        Args:
            fit: a fit.

        Returns:
            The criterion [1].
        """
        rows = self.force.size
        return rows * float(np.log(max(fit.misfit / rows, self.least))) + fit.shape.size * float(np.log(rows))


def find_reach(elongation: np.ndarray) -> np.ndarray:
    """Find which elements a record of elongations determines: they yield to one side and then to the other.

    Args:
        elongation: shape (R,) [m].

    Returns:
        Least and largest elongation at which an element yields, shape (2,) [m]; both 0 if there is no reversal.
    """
    span = float(np.ptp(elongation))
    ways = np.abs(np.diff(elongation[find_reversals(elongation, 0.02 * span)]))
    largest = 0.5 * float(np.minimum(ways[1:], ways[:-1]).max(initial=0.0))
    steps = np.abs(np.diff(elongation))
    return np.array([min(float(np.median(steps[steps > 0.0])), 0.1 * largest) if largest else 0.0, largest])


def fit_loop(path: LoopPath, force: np.ndarray, time: np.ndarray, reach: np.ndarray) -> tuple[Fit, Target, Noise]:
    """Fit the least number of elements and pieces of a curve.

    Pieces and elements are added as long as the criterion falls. What is left tells the noise, whose memory makes rows
    count less; then all that explain no more than this noise are removed.

    Args:
        force: shape (R,) [N].
        time: of the rows, or their numbers, shape (R,) [s].
        reach: what `find_reach` has found, shape (2,) [m].

    Returns:
        The fit, what was fitted, and the noise, in N.
    """
    rows = np.unique(np.rint(np.linspace(0, force.size - 1, min(_ROWS, force.size))).astype(int))
    floor = find_floor(force[:, None])
    noise, extra = Noise(floor), np.zeros(force.size)
    few = Target(path.choose_rows(rows), force[rows], build_whitening(noise, time[rows], extra[rows]), reach, 1.0)
    slope = float(np.ptp(force)) / float(np.ptp(path.elongation))
    memory = _MEMORY * float(np.median(np.diff(time[find_reversals(path.elongation, 0.1 * np.ptp(path.elongation))])))
    best = refine(few, Shape(0, 0), np.array([float(force.mean()), slope]))
    best = _choose(few, _choose(few, best, _additions), _removals)
    for _ in range(2):
        residuals = compute_force(path, best.shape, best.x)[0] - force
        noise, extra = estimate_noise(time, residuals, 0.0, floor)
        noise = noise._replace(time=min(noise.time, memory))
        least = (floor / noise.size) ** 2
        few = Target(few.path, few.force, build_whitening(noise, time[rows], extra[rows]), reach, least)
        target = Target(path, force, build_whitening(noise, time, extra), reach, least)
        best = _choose(few, refine(few, best.shape, best.x), _removals)
        best = refine(target, best.shape, best.x)
    return best, target, noise


def _choose(target: Target, best: Fit, find_others: Callable[[Target, Fit], Iterator[tuple[Shape, np.ndarray]]]) -> Fit:
    """Change a fit by an element or a knot as long as the criterion falls."""
    while True:
        tried = [refine(target, shape, x) for shape, x in find_others(target, best)]
        found = min(tried, key=target.score, default=best)
        if target.score(found) >= target.score(best):
            return best
        best = found


def refine(target: Target, shape: Shape, x: np.ndarray) -> Fit:
    """Find the parameters with the least squares of the whitened residuals.

    Args:
        target: what is fitted.
        x: the first guess.

    Returns:
        The fit.
    """
    from scipy.optimize import least_squares

    low, high = _bound(target, shape, x)

    def residuals(x: np.ndarray) -> np.ndarray:
        return target.whitening.apply((compute_force(target.path, shape, x)[0] - target.force)[None])[0]

    found: Any = least_squares(
        residuals,
        np.clip(x, low, high),
        lambda x: target.whitening.apply(compute_force(target.path, shape, x)[1]).T,
        bounds=(low, high),
        x_scale="jac",
        max_nfev=_CALLS,
        ftol=1e-10,
        xtol=1e-12,
    )
    near = 1e-4 * np.where(np.isfinite(high - low), high - low, np.abs(x) + np.abs(found.x))
    free = (found.x > low + near) & (found.x < high - near)
    return Fit(shape, found.x, 2.0 * float(found.cost), free)


def _bound(target: Target, shape: Shape, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bound the parameters: nothing becomes softer than slack, knots stay between the middles to their neighbours."""
    low, high = np.zeros(shape.size), np.full(shape.size, np.inf)
    low[0] = -np.inf
    z = target.path.elongation
    edge = _EDGE * float(np.ptp(z))
    knots = x[2 + shape.knots : shape.first_element]
    middles = np.concatenate(([z.min() + edge], 0.5 * (knots[1:] + knots[:-1]), [z.max() - edge]))
    low[2 + shape.knots : shape.first_element] = middles[:-1]
    high[2 + shape.knots : shape.first_element] = middles[1:]
    low[shape.first_element + 1 :: 3], high[shape.first_element + 1 :: 3] = target.reach
    low[shape.first_element + 2 :: 3], high[shape.first_element + 2 :: 3] = -1.0, 1.0
    return low, high


def _additions(target: Target, best: Fit) -> Iterator[tuple[Shape, np.ndarray]]:
    """Propose the elements and the knot that explain most of the residuals, as starts of fits."""
    force, derivatives = compute_force(target.path, best.shape, best.x)
    left = target.whitening.apply((target.force - force)[None])[0]
    basis = np.linalg.qr(target.whitening.apply(derivatives).T)[0]
    shape, x = best.shape, best.x

    def explain(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute the coefficients of columns added to all parameters, and how much each would explain by itself."""
        columns = target.whitening.apply(columns)
        columns = columns - (columns @ basis) @ basis.T
        square = np.maximum((columns**2).sum(axis=1), 1e-300)
        product = columns @ left
        return product / square, product**2 / square

    if shape.elements < _MOST.elements:
        first, last = target.reach
        tried = [(reach, part) for reach in np.geomspace(first, last, _REACHES) for part in _PARTS]
        size, gain = explain(np.array([follow_stop(target.path, *one)[0] / one[0] for one in tried]))
        gain = np.where(size > 0.0, gain, 0.0)
        for part in range(len(_PARTS)):
            k = part + len(_PARTS) * int(np.argmax(gain[part :: len(_PARTS)]))
            if gain[k] > 0.0:
                yield Shape(shape.knots, shape.elements + 1), np.append(x, [size[k], tried[k][0], 0.9 * tried[k][1]])
    if shape.knots < _MOST.knots:
        z = target.path.elongation
        edge = _EDGE * float(np.ptp(z))
        knots = x[2 + shape.knots : shape.first_element]
        places = np.linspace(z.min() + edge, z.max() - edge, _KNOTS + 2)[1:-1]
        places = np.array([one for one in places if np.all(np.abs(knots - one) > edge)])
        if places.size:
            size, gain = explain(np.maximum(z - places[:, None], 0.0))
            k = int(np.argmax(gain))
            piece = int(np.searchsorted(knots, places[k]))
            slopes = np.insert(x[1 : 2 + shape.knots], piece + 1, max(x[1 + piece] + size[k], 0.0))
            changed = (x[:1], slopes, np.insert(knots, piece, places[k]), x[shape.first_element :])
            yield Shape(shape.knots + 1, shape.elements), np.concatenate(changed)


def _removals(target: Target, best: Fit) -> Iterator[tuple[Shape, np.ndarray]]:
    """Leave out each element and each knot in turn."""
    shape, x = best.shape, best.x
    for j in range(shape.elements):
        gone = shape.first_element + 3 * j + np.arange(3)
        yield Shape(shape.knots, shape.elements - 1), np.delete(x, gone)
    for k in range(shape.knots):
        yield Shape(shape.knots - 1, shape.elements), np.delete(x, [2 + k, 2 + shape.knots + k])
