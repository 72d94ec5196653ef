"""Identification of the numbers of a scene from measured motion."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..derivative.parameters import expand_keys
from ..derivative.sensitivities import check_differentiable
from ..errors import CrawlerError
from ..scene.file import coerce_scene
from ..scene.scene import Scene
from ..sweep.vary import Variations
from .bounds import release_limits
from .fit import Fit, find_fit, fit_from, residuals_of, robust_size
from .measurements import MeasurementError, Measurements, check_measurements
from .playback import playback
from .replica import Replica, replay_scene
from .unknowns import Offset, Problem, build_space
from .verdicts import Parameter, Structure, find_structure, judge, noise_of, without_trust

_COARSE = 4000
"""Rows of all recordings together on which starts are compared."""
_WEIGHINGS = 2
_MANY = 5
"""From this number of recordings on, whole recordings are held out."""
_HELD_OUT_LEVEL = 1e-4
_INDIFFERENT = 20.0
"""Increase of the sum of squares, in units of the noise, by which a combination of parameters may still move."""


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """The result of an identification.

    Attributes:
        scene: the scene with the values found; parameters that are not determined keep their values.
        parameters: what is known about each parameter.
        residual: root mean square of the fitted residuals [m].
        noise: estimated standard deviation of the measurements, of all together [m].
        held_out: root mean square of the residuals that were not fitted [m]; None if nothing was held out.
        model_fits: whether the residuals are noise, and those held out are not larger.
        p_value: probability of such residuals if they were noise [1].
        where: where the model fails; None if it fits.
        warnings: one line each.
        recordings: the measurements.
        residuals: simulated minus measured, for each recording, shape (T, M) [m].
        fitted: the rows that were fitted, for each recording, bool, shape (T,).
        offsets: what was added to the model for each recording, shape (M,) [m].
        delays: for each recording [s].
        noises: estimated standard deviation of each channel, for each recording, shape (M,) [m]: one for its positions
            and one for its elongations if they differ.
        interrupted: whether Ctrl-C ended the search before all starts were tried.
    """

    scene: Scene
    parameters: tuple[Parameter, ...]
    residual: float
    noise: float
    held_out: float | None
    model_fits: bool
    p_value: float
    where: str | None
    warnings: tuple[str, ...]
    recordings: tuple[Measurements, ...]
    residuals: tuple[np.ndarray, ...]
    fitted: tuple[np.ndarray, ...]
    offsets: tuple[np.ndarray, ...]
    delays: tuple[float, ...]
    noises: tuple[np.ndarray, ...]
    interrupted: bool

    def playback(self, recording: int = 0) -> Scene:
        """Build the scene with the values found that plays a recording.

        Args:
            recording: its index.

        Returns:
            The scene; its drive is the recorded commands, straight between rows.
        """
        return playback(self.scene, self.recordings[recording])

    def __repr__(self) -> str:
        """Describe the result in one line."""
        return f"Identification({', '.join(f'{p.name}: {p.verdict}' for p in self.parameters)})"

    def __getitem__(self, name: str) -> Parameter:
        """Return the parameter of a name."""
        return next(p for p in self.parameters if p.name == name)

    def summary(self) -> dict[str, Any]:
        """Convert to the values that `crawler identify --json` prints.

        Returns:
            Plain numbers, lists and text, schema 1.
        """
        return {
            "schema": 1,
            "scene": self.scene.name,
            "parameters": [p.as_plain() for p in self.parameters],
            "residual": self.residual,
            "noise": self.noise,
            "held_out": self.held_out,
            "model_fits": self.model_fits,
            "p_value": self.p_value,
            "where": self.where,
            "warnings": list(self.warnings),
            "recordings": [
                {
                    "name": m.name,
                    "rows": int(m.time.size),
                    "fitted_rows": int(rows.sum()),
                    "offset": dict(zip(m.channels, added.tolist(), strict=True)),
                    "delay_s": delay,
                    "noise": dict(zip(m.channels, noise.tolist(), strict=True)),
                }
                for m, rows, added, delay, noise in zip(
                    self.recordings, self.fitted, self.offsets, self.delays, self.noises, strict=True
                )
            ],
            "complete": not self.interrupted,
        }


def identify(
    scene: Scene | str | Path,
    recordings: Sequence[Measurements],
    keys: Sequence[str],
    bounds: Mapping[str, tuple[float, float]] | None = None,
    hold_out: float = 0.2,
    offset: Offset = "frame",
    delay: bool = False,
    robust: bool = False,
    starts: int = 8,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    seconds: float = 10.0,
) -> Identification:
    """Find the numbers of a scene under which the model repeats measured motion, and what the motion tells about each.

    The sum of squares of simulated minus measured values is minimised with exact derivatives, from several starts.
    Offsets of the camera's frame, and if asked delays, are unknowns too.

    Args:
        scene: a scene on a line, a path or a gallery name; its numbers are the first start.
        recordings: the measurements; all are fitted together.
        keys: dotted keys, as for `sensitivities`.
        bounds: lower and upper bounds by key; positive numbers without bounds may change by a factor of 100.
        hold_out: fraction of the measurements that is not fitted but predicted [1]: the end of each recording, or from
            five recordings on whole recordings.
        offset: "frame" for one unknown constant in the positions of each recording, "each" for one per channel,
            "none" for positions in the frame of the scene.
        delay: whether the measurements of each recording have an unknown delay.
        robust: whether outliers count less (soft_l1).
        starts: number of starts, unless an earlier one leads to a fit.
        seed: of the random starts.
        progress: called with the fraction done, in [0, 1].
        seconds: time in which more starts are tried as long as none leads to a fit [s].

    Returns:
        The result.

    Raises:
        SceneError: if a key is unknown or has no effect, or the scene has no derivatives.
        MeasurementError: if a recording cannot be used.
        CrawlerError: if an option is out of range, or no motion exists at any start.
    """
    scene = coerce_scene(scene, "identify")
    if not recordings:
        raise CrawlerError("identify: no recording; at least one is needed")
    if not 0.0 <= hold_out <= 0.8:
        raise CrawlerError(f"identify: hold_out: {hold_out:g}; it must be between 0 and 0.8")
    if starts < 1:
        raise CrawlerError(f"identify: starts: {starts}; it must be at least 1")
    if not 0.0 <= seconds < np.inf:
        raise CrawlerError(f"identify: seconds: {seconds:g}; it must be 0 or more")
    if offset not in ("none", "frame", "each"):
        raise CrawlerError(f"identify: offset: {offset!r}; it must be none, frame or each")
    if scene.dimension == 2:
        raise CrawlerError(f"identify: {scene.name} is in the plane; identification is for bodies on a line")
    checked = [check_measurements(scene, m) for m in recordings]
    base = replay_scene(scene, checked[0])
    check_differentiable(base, "identify")
    names = expand_keys(base, keys, "identify")
    replicas = [Replica(scene, m, names) for m in checked]
    space = build_space(names, replicas[0].start_values, bounds)
    rows = _fitted_rows([m.time.size for m in checked], hold_out)
    problem = Problem(replicas, rows, space, offset, delay)
    numbers = sum(int(r.sum()) * len(m.channels) for r, m in zip(rows, checked, strict=True))
    if numbers <= problem.count:
        raise MeasurementError(f"identify: {numbers} measured values for {problem.count} unknowns are too few")
    coarse = _coarse(problem, scene, checked, offset, delay)
    searched = fit = find_fit(problem, coarse, starts, seconds, robust, np.random.default_rng(seed), progress)
    for _ in range(_WEIGHINGS):
        if searched.interrupted or not problem.weigh(fit.residuals):
            break
        fit = _fit_again(problem, fit)
    fit, structure = _settle(problem, release_limits(problem, fit))
    parameters = judge(problem, fit, structure)
    if progress is not None:
        progress(1.0)
    count, reached = searched.starts, searched.reached
    fit = dataclasses.replace(fit, interrupted=searched.interrupted, starts=count, reached=reached)
    return _conclude(scene, problem, fit, parameters)


def _fit_again(problem: Problem, fit: Fit) -> Fit:
    """Fit with new weights from where an earlier fit ended."""
    soft = None if fit.soft is None else robust_size(problem, fit.unknowns)
    again = fit_from(problem, fit.unknowns, np.zeros(problem.count, np.bool_), soft, tight=True, most=40)
    assert again is not None  # a motion exists where the earlier fit ended
    return again


def _fitted_rows(sizes: Sequence[int], hold_out: float) -> list[np.ndarray]:
    """Choose the rows that are fitted: of many recordings all rows of most, else the first rows of each."""
    if hold_out == 0.0:
        return [np.ones(size, np.bool_) for size in sizes]
    if len(sizes) >= _MANY:
        every = max(2, round(1.0 / hold_out))
        return [np.full(size, i % every != every - 1) for i, size in enumerate(sizes)]
    return [np.arange(size) < size - int(hold_out * size) for size in sizes]


def _coarse(problem: Problem, scene: Scene, checked: Sequence[Measurements], offset: Offset, delay: bool) -> Problem:
    """Build the problem with the first rows of each recording; the problem itself if it is small."""
    used = [i for i, rows in enumerate(problem.rows) if rows.any()]
    most = max(50, _COARSE // len(used))
    if len(used) == len(checked) and all(m.time.size <= most for m in checked):
        return problem
    heads = [checked[i].head(most) if i in used else checked[i].head(50) for i in range(len(checked))]
    rows = [rows[: m.time.size] for rows, m in zip(problem.rows, heads, strict=True)]
    return Problem([Replica(scene, m, problem.space.names) for m in heads], rows, problem.space, offset, delay)


def _settle(problem: Problem, fit: Fit) -> tuple[Fit, Structure]:
    """Find what is determined, and fit again with the scale of ratios fixed by the scene."""
    space, count = problem.space, problem.space.origin.size
    origin = space.to_coordinates(space.origin)
    structure = find_structure(problem, fit)
    for _ in range(count):
        held = np.zeros(problem.count, np.bool_)
        held[sorted(structure.unseen | structure.held | set(structure.weak))] = True
        moved = fit.unknowns.copy()
        for group in structure.groups:
            shifts = [origin[p] - moved[p] for p in group & structure.held]
            if len(shifts) == 1 and all(space.logarithmic[p] for p in group):
                _shift(problem, fit, group, next(iter(group & structure.held)), shifts[0], moved)
                for p in structure.unseen:  # bounds that hold; larger forces need larger ones
                    moved[p] += max(shifts[0], 0.0) * space.logarithmic[p]
        for p in structure.held:
            moved[p] = origin[p]
        again = fit_from(problem, moved, held, fit.soft, tight=True, most=40)
        spread = max(float(np.ptp(r.measured.values)) for r in problem.replicas)
        size = fit.residuals.fitted.size
        allowed = fit.cost * (1.0 + _INDIFFERENT / size) + size * (1e-11 * spread) ** 2
        if again is None or again.cost > allowed:
            return fit, structure
        later = find_structure(problem, again, structure)
        fit = again
        if later.held == structure.held and later.unseen == structure.unseen and later.weak == structure.weak:
            return fit, later
        structure = later
    return fit, structure


def _shift(problem: Problem, fit: Fit, group: set[int], first: int, shift: float, moved: np.ndarray) -> None:
    """Move a group along its null direction until its first member has the scene's value, in place."""
    members = sorted(group)
    part = fit.residuals.jacobian[:, members]
    direction = np.linalg.svd(part, full_matrices=False)[2][-1]
    own = direction[members.index(first)]
    if abs(own) > 1e-6:
        moved[members] += direction * (shift / own)


def _conclude(scene: Scene, problem: Problem, fit: Fit, parameters: tuple[Parameter, ...]) -> Identification:
    """Test the residuals, and collect the result."""
    measured = [r.measured for r in problem.replicas]
    test = residuals_of(problem, fit)
    residuals = tuple(
        r if rows.any() else r - _common(shape, r)
        for r, rows, shape in zip(fit.residuals.all, problem.rows, problem.shapes, strict=True)
    )
    out = [r[~rows] for r, rows in zip(residuals, problem.rows, strict=True)]
    left = np.concatenate([r.ravel() for r in out])
    noise = noise_of(problem, dataclasses.replace(fit, soft=None))[0]
    noises = tuple(noise / weight for weight in problem.weights)
    used = np.concatenate([r[rows].ravel() for r, rows in zip(residuals, problem.rows, strict=True)])
    held_out = float(np.sqrt(np.mean(left**2))) if left.size else None
    where = test.where
    spread = max(float(np.ptp(m.values)) for m in measured)
    if where is None and held_out is not None and fit.soft is None:
        where = _held_out_failure(problem, out, max(noise, 1e-9 * spread))
    warnings = ["interrupted: this is the best of the starts that were tried"] if fit.interrupted else []
    warnings += [
        f"{p.name} ended at its bound {p.value:.6g}; widen it with bounds if it may lie beyond"
        for p in parameters
        if p.verdict == "bound" and "the fit ended" in p.why
    ]
    if where is not None:
        warnings.append(
            f"this is the best of {fit.starts} starts, and {fit.reached} of them ended here: if the model is right, it "
            "is a local minimum, which more time for starts may leave"
        )
        parameters = tuple(without_trust(p, where) for p in parameters)
    return Identification(
        _with_values(scene, problem, parameters),
        parameters,
        float(np.sqrt(np.mean(used**2))),
        float(np.sqrt(np.mean(np.concatenate(noises) ** 2))),
        held_out,
        where is None,
        test.p_value,
        where,
        tuple(warnings),
        tuple(measured),
        residuals,
        problem.rows,
        tuple(problem.added(fit.unknowns)),
        tuple(float(d) for d in problem.delays(fit.unknowns)),
        noises,
        fit.interrupted,
    )


def _common(shape: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """Compute the part of residuals that offsets explain, of a recording that was not fitted, shape (M,)."""
    if shape.shape[1] == 0:
        return np.zeros(shape.shape[0])
    return np.asarray(shape @ np.linalg.lstsq(shape, residuals.mean(axis=0), rcond=None)[0])


def _held_out_failure(problem: Problem, out: Sequence[np.ndarray], noise: float) -> str | None:
    """Determine whether weighted residuals that were not fitted are larger than noise; describe where."""
    from scipy.stats import f

    weighted = [r * weight for r, weight in zip(out, problem.weights, strict=True)]
    count = sum(r.size for r in weighted)
    freedom = sum(int(rows.sum()) * r.shape[1] for rows, r in zip(problem.rows, out, strict=True))
    size = float(np.sqrt(sum(float((r**2).sum()) for r in weighted) / count))
    if f.sf((size / noise) ** 2, count, freedom) >= _HELD_OUT_LEVEL:
        return None
    worst = max((i for i in range(len(out)) if out[i].size), key=lambda i: float(np.abs(weighted[i]).max()))
    row, column = np.unravel_index(int(np.abs(weighted[worst]).argmax()), out[worst].shape)
    measured = problem.replicas[worst].measured
    time = measured.time[~problem.rows[worst]][row]
    return (
        f"{measured.name}: held-out rows have residuals of {size:.3g} m, the fitted ones {noise:.3g} m; the "
        f"largest is that of {measured.channels[column]} at {time:.4g} s"
    )


def _with_values(scene: Scene, problem: Problem, parameters: Sequence[Parameter]) -> Scene:
    """Build the scene with the values found; those that are only bounded stay as near to the scene's as they may."""
    values = {}
    for p, origin in zip(parameters, problem.space.origin, strict=True):
        low, high = p.interval
        if p.verdict == "bound":
            value = min(max(float(origin), -np.inf if low is None else low), np.inf if high is None else high)
            values[p.name] = np.array([value])
        elif p.value is not None:
            values[p.name] = np.array([p.value])
    return Variations(scene, values, (1,))[0] if values else scene
