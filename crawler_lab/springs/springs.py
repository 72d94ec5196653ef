"""What a loop of force over elongation tells about a spring, its elements and their dependence on the rate."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from crawler_model import CrawlerError

from ..identify.fit.misfit import FITS
from ..identify.sensor.noise import find_floor, find_quantile, guess_noise
from .fit import Fit, Target, find_reach, fit_loop
from .loop import build_path, compute_force, compute_spring, find_reversals
from .rate import Rate, judge_rate

_FEWEST = 30
"""Rows of a table."""
_SMALL = 0.03
"""Part of the width of the loop below which residuals are small."""
_BINS = 20
_LONG = 10.0
"""Elongations beyond this length are taken for ones in another unit [m]."""
_WIDER = 1.25
_BACKWARDS = 0.1
"""Part of the misfit by which a loop that is drawn backwards is open."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A number with its 95 % interval.

    Attributes:
        value: the number [N, N/m or m].
        low: lower end of the interval; None if nothing determines it [N, N/m or m].
        high: upper end of the interval; None if nothing determines it [N, N/m or m].
    """

    value: float
    low: float | None
    high: float | None


@dataclass(frozen=True, kw_only=True)
class Element:
    """A Maxwell-slip element.

    Attributes:
        stiffness: in N/m.
        limit: the force at which it yields, in N; `yield` of scene files.
        start: its force in the first row [N].
    """

    stiffness: Estimate
    limit: Estimate
    start: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Springs:
    """The spring and the elements that explain a loop.

    Attributes:
        name: of the table.
        force_at_zero: of the spring at elongation 0, in N.
        stiffnesses: of the pieces of the spring, in N/m.
        knots: elongations between the pieces, in m.
        curve: least elongation, knots and largest elongation [m], and the force of the spring there [N], shape (2, K).
        elements: the elements, in the order in which they yield.
        width: greatest difference between loading and unloading at the same elongation [N].
        widths: the same at a quarter and at three quarters of the elongations, shape (2,) [N].
        residual: root mean square of what the fit leaves [N].
        noise: standard deviation of a row from its neighbours [N].
        rate: whether the loop depends on the rate; None without times.
        notes: what else is to be known.
        time: of the rows, or their numbers, shape (R,) [s].
        elongation: measured, shape (R,) [m].
        force: measured, shape (R,) [N].
        fitted: force of the fit, shape (R,) [N].
    """

    name: str
    force_at_zero: Estimate
    stiffnesses: tuple[Estimate, ...]
    knots: tuple[Estimate, ...]
    curve: np.ndarray
    elements: tuple[Element, ...]
    width: float
    widths: tuple[float, float]
    residual: float
    noise: float
    rate: Rate | None
    notes: tuple[str, ...]
    time: np.ndarray
    elongation: np.ndarray
    force: np.ndarray
    fitted: np.ndarray

    @property
    def explained(self) -> bool:
        """Whether the residuals are noise, or small compared with the loop."""
        return self.residual <= max(FITS * self.noise, _SMALL * self.width)

    def scene_lines(self) -> str:
        """Write the spring as an entry of `links` of a scene file.

        Returns:
            Lines of YAML.
        """
        spring = f"stiffness: {self.stiffnesses[0].value:.5g}"
        if self.knots:
            z, tension = (", ".join(f"{one:.5g}" for one in row) for row in self.curve)
            spring = f"curve: {{elongation: [{z}], tension: [{tension}]}}"
        elements = ", ".join(
            f"{{stiffness: {one.stiffness.value:.5g}, yield: {one.limit.value:.5g}}}" for one in self.elements
        )
        lines = ["links:", f"  - {spring}"] + ([f"    hysteresis: [{elements}]"] if elements else [])
        return "\n".join(lines)

    def as_plain(self) -> dict[str, Any]:
        """Convert to the values that `crawler springs --json` prints.

        Returns:
            Plain numbers, lists and text, schema 1.
        """
        return {
            "schema": 1,
            "table": self.name,
            "rows": self.force.size,
            "force_at_zero": asdict(self.force_at_zero),
            "stiffnesses": [asdict(one) for one in self.stiffnesses],
            "knots": [asdict(one) for one in self.knots],
            "hysteresis": [
                {"stiffness": asdict(one.stiffness), "yield": asdict(one.limit), "start": one.start}
                for one in self.elements
            ],
            "width": self.width,
            "residual": self.residual,
            "noise": self.noise,
            "explained": self.explained,
            "rate": None if self.rate is None else asdict(self.rate) | {"speeds": list(self.rate.speeds)},
            "notes": list(self.notes),
            "scene_lines": self.scene_lines(),
        }


def fit_springs(name: str, elongation: np.ndarray, force: np.ndarray, time: np.ndarray | None = None) -> Springs:
    """Fit a spring with the least number of elements and pieces that explain a loop.

    Args:
        name: of the table, for messages.
        elongation: shape (R,) [m].
        force: shape (R,) [N].
        time: increasing, shape (R,) [s]; None if it was not measured.

    Returns:
        The spring.

    Raises:
        CrawlerError: if there are fewer than thirty rows, or if the elongation does not turn round.
    """
    if elongation.size < _FEWEST:
        raise CrawlerError(f"{name}: {elongation.size} rows with an elongation and a force; a loop needs {_FEWEST}")
    reach = find_reach(elongation)
    if reach[1] == 0.0:
        raise CrawlerError(
            f"{name}: no reversal: the elongation goes one way from {elongation[0]:g} to {elongation[-1]:g} m, which "
            "tells a spring that remembers from no other; measure the way back, too"
        )
    clock = np.arange(elongation.size, dtype=float) if time is None else time
    path = build_path(elongation)
    fit, target, _ = fit_loop(path, force, clock, reach)
    fitted = compute_force(path, fit.shape, fit.x)[0]
    residuals = force - fitted
    noise = guess_noise(residuals, 0.0, find_floor(force[:, None]))[0].white
    residual = float(np.sqrt(np.mean(residuals**2)))
    widths = _find_widths(elongation, force)
    width = float(widths.max(initial=0.0))
    quarters = (float(widths[_BINS // 4]), float(widths[-_BINS // 4 - 1]))
    allowed = max(FITS * noise, _SMALL * width)
    rate = None if time is None else judge_rate(target, fit, time, width, residual if residual > allowed else 0.0)
    numbers, elements = _estimate(target, fit)
    at = np.array([elongation.min(), *fit.x[2 + fit.shape.knots : fit.shape.first_element], elongation.max()])
    return Springs(
        name=name,
        force_at_zero=numbers[0],
        stiffnesses=tuple(numbers[1 : 2 + fit.shape.knots]),
        knots=tuple(numbers[2 + fit.shape.knots :]),
        curve=np.array([at, compute_spring(build_path(at), fit.shape, fit.x)[0]]),
        elements=tuple(elements),
        width=width,
        widths=quarters,
        residual=residual,
        noise=noise,
        rate=rate,
        notes=tuple(_find_notes(elongation, quarters, residual if residual > allowed else 0.0, elements)),
        time=clock,
        elongation=elongation,
        force=force,
        fitted=fitted,
    )


def _find_widths(elongation: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Find the differences between loading and unloading in parts of the elongations, shape (_BINS,) [N]."""
    span = float(np.ptp(elongation))
    part = np.minimum((elongation - elongation.min()) / span * _BINS, _BINS - 1).astype(int)
    ends = find_reversals(elongation, 0.05 * span)
    loads = np.repeat(np.diff(elongation[ends]) > 0.0, np.diff(ends, append=elongation.size)[:-1])
    sides = [np.append(loads, np.full(elongation.size - loads.size, loads[-1])) == side for side in (False, True)]
    counts = np.array([np.bincount(part[side], minlength=_BINS) for side in sides])
    means = np.array([np.bincount(part[side], force[side], _BINS) for side in sides]) / np.maximum(counts, 1)
    return np.where((counts > 0).all(axis=0), means[1] - means[0], 0.0)


def _estimate(target: Target, fit: Fit) -> tuple[list[Estimate], list[Element]]:
    """Find the intervals of the numbers of the spring, and of the elements."""
    x, shape = fit.x, fit.shape
    columns = target.whitening.apply(compute_force(target.path, shape, x)[1])[fit.free]
    freedom = max(target.force.size - len(columns), 1)
    covariance = np.zeros((x.size, x.size))
    inverse = np.linalg.pinv(columns @ columns.T, rcond=1e-14, hermitian=True)
    covariance[np.ix_(fit.free, fit.free)] = inverse * max(fit.misfit / freedom, target.least)
    quantile = find_quantile(freedom)
    half = np.where(fit.free, quantile * np.sqrt(np.diag(covariance)), np.nan)
    reach = x[shape.first_element + 1 :: 3]
    spread = np.nan_to_num(half[shape.first_element + 1 :: 3])  # an interval that contains a bound is open there
    stiff, soft = reach - spread < 1.001 * target.reach[0], reach + spread > 0.999 * target.reach[1]
    if soft.any():
        half[0] = np.nan  # its first force is then not known, and no offset differs from it
    numbers = [_between(x[i], x[i] - half[i], x[i] + half[i]) for i in range(shape.first_element)]
    elements = []
    for j in np.argsort(reach).tolist():
        first = shape.first_element + 3 * j
        limit, stiffness = x[first], x[first] / reach[j]
        relative = np.array([1.0 / limit, -1.0 / reach[j]])  # of the logarithm of the stiffness f/r
        wide = np.exp(quantile * np.sqrt(relative @ covariance[first : first + 2, first : first + 2] @ relative))
        ratio = np.exp(half[first] / limit)
        high, above = np.nan if stiff[j] else stiffness * wide, np.nan if soft[j] else limit * ratio
        stiffnesses, limits = _between(stiffness, stiffness / wide, high), _between(limit, limit / ratio, above)
        elements.append(Element(stiffness=stiffnesses, limit=limits, start=float(limit * x[first + 2])))
    return numbers, elements


def _between(value: float, low: float, high: float) -> Estimate:
    """Build an estimate; ends that are NaN are not known."""
    ends = [None if np.isnan(end) else float(end) for end in (low, high)]
    return Estimate(value=float(value), low=ends[0], high=ends[1])


def _find_notes(
    elongation: np.ndarray, widths: tuple[float, float], misfit: float, elements: list[Element]
) -> list[str]:
    notes = []
    if misfit > 0.0 and max(widths) < -_BACKWARDS * misfit:
        notes.append(
            "the force is larger on the way back than on the way out, so that the loop would give energy: are "
            "elongation and force exchanged, or is one of them negated?"
        )
    if np.ptp(elongation) > _LONG:
        notes.append(f"the elongation spans {np.ptp(elongation):g} m: is `--units mm` missing?")
    if misfit > 0.0 and min(widths) > 0.0 and max(widths) > _WIDER * min(widths):
        notes.append(
            f"the loop is {widths[0]:.3g} N wide at a quarter and {widths[1]:.3g} N at three quarters of its "
            "elongations: friction that grows with tension, as of a cable in a sheath, is not in the model"
        )
    if any(one.stiffness.high is None for one in elements):
        notes.append("an element yields within a step of the rows: it is at least as stiff as given")
    if any(one.limit.high is None for one in elements):
        notes.append("an element yields only beyond half of the longest stroke: measure longer ones")
    return notes
