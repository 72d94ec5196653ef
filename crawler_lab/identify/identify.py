"""Identification of the numbers of a scene from measured motion."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from crawler_model.errors import CrawlerError
from crawler_model.scene.file import coerce_scene
from crawler_model.scene.scene import Scene

from ..derivative.sensitivities import check_differentiable
from ..sweep.keys import expand_keys
from .fit.fit import AGREE, Fit, find_fit, fit_from
from .fit.minima import average_derivatives, explore_minima
from .fit.misfit import find_where, measure_misfit
from .fit.problem import Offset, Problem
from .fit.space import build_space
from .forecast.posterior import GAIN, collect_posterior
from .identification import Identification
from .judge.bounds import release
from .judge.explain import Explanation, explain_misfit, remark
from .judge.held_out import score_held_out
from .judge.intervals import find_intervals
from .judge.rate import judge_rate
from .judge.sensors import doubt_sensor, judge_sensors, warn_of_sensors
from .judge.structure import Structure, find_covariance, find_structure
from .judge.verdicts import Parameter, doubt, judge
from .measurements import (
    MeasurementError,
    Measurements,
    are_reversed,
    check_measurements,
    find_copies,
    leave_out_impossible,
)
from .replica.playback import replay_scene
from .replica.replica import Replica
from .replica.sampled import SampledReplica
from .replica.start import begin_recordings, is_start_told
from .sensor.sensor import Sensor

_COARSE = 16_000
"""Measured values of all recordings together on which starts are compared."""
_MANY = 5
"""From this number of recordings on, whole recordings are held out."""
_WORSE = 2.0
"""Residuals of held-out rows of more than this many times their predicted size are a misfit."""
_MOSTLY = 0.5
"""Part of a misfit from which an explanation explains it."""
_INDIFFERENT = 20.0
"""Increase of the sum of squares, in units of the noise, by which a combination of parameters may still move."""


def identify(
    scene: Scene | str | Path,
    recordings: Sequence[Measurements],
    keys: Sequence[str],
    bounds: Mapping[str, tuple[float, float]] | None = None,
    hold_out: float = 0.2,
    offset: Offset | None = None,
    sensor: Sensor | None = None,
    starts: int = 8,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    seconds: float = 10.0,
) -> Identification:
    """Find the numbers of a scene under which the model repeats measured motion, and what the motion tells about each.

    The sum of squares of simulated minus measured values, whitened by the noise that is estimated with them, is
    minimised with exact derivatives from several starts; in the plane and on patches with differences of runs. What the
    sensor does is a part of the fit, with priors.

    Args:
        scene: a scene, a path or a gallery name; its numbers are the first start.
        recordings: the measurements; all are fitted together.
        keys: dotted keys, as for `sensitivities`.
        bounds: lower and upper bounds by key; positive numbers without bounds may change by a factor of 100.
        hold_out: fraction of the measurements that is not fitted but predicted [1]: the end of each recording, or from
            five recordings on whole recordings.
        offset: "frame" for one unknown constant in the positions of each recording, "each" for one per channel,
            "none" for positions in the frame of the scene; None for "frame" if the start is fitted, else "each".
        sensor: priors of lag, scale, drifts and gain; None for wide ones of a camera.
        starts: number of starts, unless an earlier one leads to a fit.
        seed: of the random starts.
        progress: called with the fraction done, in [0, 1].
        seconds: time in which more starts are tried as long as none leads to a fit [s], counted by evaluations as on an
            ordinary processor, so that the result does not depend on the machine; 0 for only the first start.

    Returns:
        The result.

    Raises:
        SceneError: if a key is unknown or has no effect.
        MeasurementError: if a recording cannot be used.
        CrawlerError: if an option is out of range, or no motion exists at any start.
    """
    scene = coerce_scene(scene, "identify")
    one = isinstance(recordings, (str, Path, Measurements))
    if one or not all(isinstance(each, Measurements) for each in recordings):
        raise CrawlerError(f"identify: recordings: {recordings!r:.60}; it must be a list of Measurements")
    if not recordings:
        raise CrawlerError("identify: no recording; at least one is needed")
    if not 0.0 <= hold_out <= 0.8:
        raise CrawlerError(f"identify: hold_out: {hold_out:g}; it must be between 0 and 0.8")
    if starts < 1:
        raise CrawlerError(f"identify: starts: {starts}; it must be at least 1")
    if not 0.0 <= seconds < np.inf:
        raise CrawlerError(f"identify: seconds: {seconds:g}; it must be 0 or more")
    if offset is None:
        offset = "frame" if any(key.startswith("start") for key in keys) else "each"
    if offset not in ("none", "frame", "each"):
        raise CrawlerError(f"identify: offset: {offset!r}; it must be none, frame or each")
    sensor = Sensor() if sensor is None else sensor
    cleaned = [leave_out_impossible(scene, check_measurements(scene, m)) for m in recordings]
    checked, impossible = [m for m, _ in cleaned], [line for _, lines in cleaned for line in lines]
    begun, unknown = begin_recordings(scene, keys, checked)
    base = replay_scene(begun, checked[0])
    if base.has_exact_derivatives:
        check_differentiable(base, "identify")
    names = expand_keys(base, keys, "identify")
    kind = Replica if base.has_exact_derivatives else SampledReplica
    replicas = [kind(begun, m, names, "identify", unknown) for m in checked]
    if unknown and base.has_exact_derivatives and offset == "none":  # nothing tells where the first contact stands
        offset = "frame"
    space = build_space(names, replicas[0].start_values, bounds)
    rows = _fitted_rows([m.time.size for m in checked], hold_out, apart=not unknown)
    problem = Problem(replicas, rows, space, offset, sensor)
    numbers = sum(int(present.sum()) for present in problem.present)
    unknowns = problem.count + sum(design.shape[-1] for design in problem.designs)
    if numbers <= unknowns:
        raise MeasurementError(f"identify: {numbers} measured values for {unknowns} unknowns are too few")
    rng = np.random.default_rng(seed)
    fit, structure = _find(problem, _coarse(problem), starts, seconds, rng, progress)
    found = _conclude(scene, problem, fit, structure, seconds)
    if progress is not None:
        progress(1.0)
    return dataclasses.replace(found, warnings=(*impossible, *found.warnings))


def _find(
    problem: Problem,
    coarse: Problem,
    starts: int,
    seconds: float,
    rng: np.random.Generator,
    progress: Callable[[float], None] | None,
) -> tuple[Fit, Structure]:
    """Fit, and find what is determined; Ctrl-C behind the search ends one stage, without its fit."""
    searched = find_fit(problem, coarse, starts, seconds, rng, progress)
    fit, interrupted = searched, searched.interrupted
    try:
        fit = fit if interrupted else explore_minima(problem, fit, rng)
    except KeyboardInterrupt:
        interrupted = True
    try:
        fit = release(problem, coarse, fit)
    except KeyboardInterrupt:
        interrupted = True
    structure = find_structure(problem, fit)
    try:
        fit, structure = _fit_determined(problem, fit, structure)
        if not interrupted:
            held = np.isin(np.arange(problem.count), list(structure.fixed))
            fit = average_derivatives(problem, fit, held, rng)
    except KeyboardInterrupt:
        interrupted = True
    return dataclasses.replace(
        fit, interrupted=interrupted, starts=searched.starts, reached=searched.reached
    ), structure


def _fitted_rows(sizes: Sequence[int], hold_out: float, apart: bool) -> list[np.ndarray]:
    """Choose the rows that are fitted: of many recordings all rows of most, if `apart`, else the first rows of each.

    A recording whose start is unknown is no prediction without any fitted row.
    """
    if hold_out == 0.0:
        return [np.ones(size, np.bool_) for size in sizes]
    if len(sizes) >= _MANY and apart:
        every = max(2, round(1.0 / hold_out))
        return [np.full(size, i % every != every - 1) for i, size in enumerate(sizes)]
    return [np.arange(size) < size - int(hold_out * size) for size in sizes]


def _coarse(problem: Problem) -> Problem:
    """Build the problem with the first rows of each recording; the problem itself if it is small."""
    measured = [r.measured for r in problem.replicas]
    used = [i for i, rows in enumerate(problem.rows) if rows.any()]
    most = max(50, _COARSE // sum(len(measured[i].channels) for i in used))
    if len(used) == len(measured) and all(m.time.size <= most for m in measured):
        return problem
    replicas = [r.showing(r.measured.head(most if i in used else 50)) for i, r in enumerate(problem.replicas)]
    rows = [rows[: r.measured.time.size] for rows, r in zip(problem.rows, replicas, strict=True)]
    return Problem(replicas, rows, problem.space, problem.offset, problem.sensor)


def _fit_determined(problem: Problem, fit: Fit, structure: Structure) -> tuple[Fit, Structure]:
    """Fit again with the scale of ratios fixed by the scene, and find what is determined then."""
    space, count = problem.space, problem.space.origin.size
    origin = space.to_coordinates(space.origin)
    for _ in range(count):
        moved = fit.unknowns.copy()
        for group in structure.groups:
            kept = sorted(group & structure.kept)
            if len(kept) == 1 and all(space.logarithmic[p] for p in group):
                shift = origin[kept[0]] - moved[kept[0]]
                moved[list(group)] += shift
                for p in structure.unseen:  # bounds that hold; larger forces need larger ones
                    moved[p] += max(shift, 0.0) * space.logarithmic[p]
            moved[kept] = origin[kept]
        if np.array_equal(moved, fit.unknowns):  # there the sum of squares is least already
            return fit, structure
        held = np.isin(np.arange(problem.count), list(structure.fixed))
        again = fit_from(problem, moved, held, tight=True, most=40)
        if again is None or again.cost > fit.cost + _INDIFFERENT:
            return fit, structure
        later = find_structure(problem, again, structure)
        fit = dataclasses.replace(again, spread=fit.spread)
        if later.held == structure.held and later.unseen == structure.unseen and later.weak == structure.weak:
            return fit, later
        structure = later
    return fit, structure


def _conclude(scene: Scene, problem: Problem, fit: Fit, structure: Structure, seconds: float) -> Identification:
    """Judge the parameters, measure the misfit, explain it in some time, and collect the result."""
    count = problem.space.origin.size
    free = [p for p in range(count) if p not in structure.fixed]
    unknown = [*free, *range(count, problem.count)]
    covariance = np.zeros((problem.count, problem.count))
    own, freedom = find_covariance(problem, fit, fit.mean_jacobian, unknown)
    covariance[np.ix_(unknown, unknown)] = own
    below, above, ended = find_intervals(problem, fit, free, covariance, freedom, set(structure.weak))
    fit = dataclasses.replace(fit, interrupted=fit.interrupted or ended)
    parameters, plain = judge(problem, fit, structure, below, above, covariance, freedom)
    sensors = judge_sensors(problem, fit, covariance, freedom)
    misfits = tuple(measure_misfit(problem, fit.residuals))
    score = score_held_out(problem, fit, covariance, parameters)
    where = find_where(misfits)
    width = np.maximum(below, above)
    explained, tries = where is not None and not fit.interrupted, seconds > 0.0
    try:
        explanations, untried = explain_misfit(scene, problem, fit, misfits, width, tries) if explained else ([], [])
    except KeyboardInterrupt:
        explanations, untried, fit = [], [], dataclasses.replace(fit, interrupted=True)
    unexplained = explained and tries and not fit.interrupted and not _is_explained(explanations)
    if where is None and score is not None and score.size > _WORSE:
        where = score.worst
    slope = problem.space.slope(problem.space.to_values(fit.unknowns[:count]))
    used = np.concatenate([r[p] for r, p in zip(fit.residuals.all, problem.present, strict=True)])
    noises = tuple(np.array([channel.noise.size for channel in one]) for one in problem.channels)
    added = list(zip(problem.designs, problem.offsets, fit.residuals.linear, strict=True))
    weights, scatter = np.eye(problem.count)[:count] * slope[:, None], 0.0
    if problem.sensor.gain != (0.0, 0.0):
        gain, weight, scatter = _find_gain(problem, fit, covariance)
        plain.append({"name": GAIN, "verdict": "identified", "value": gain})
        weights = np.vstack((weights, weight))
    reason = "the model does not fit" if where is not None else ""
    if not reason and not problem.starts and not is_start_told(scene, problem.space.names):
        reason = "nothing tells how the record began, and its start is not found"
    known = weights @ covariance @ weights.T
    known[count:, count:] += scatter
    posterior = dataclasses.replace(collect_posterior(plain, known, freedom), fits=not reason)
    shown = tuple(doubt(p, reason) for p in parameters) if reason else parameters
    final = posterior.apply(scene)
    relaxed = final.parts.start == "relaxed" != scene.parts.start
    return Identification(
        scene=final,
        parameters=tuple(remark(p, explanations) for p in shown),
        sensors=tuple(doubt_sensor(one) for one in sensors) if reason else sensors,
        residual=float(np.sqrt(np.mean(used**2))),
        noise=float(np.sqrt(np.mean(np.concatenate(noises) ** 2))),
        held_out=None if score is None else score.residual,
        score=score,
        model_fits=where is None,
        where=where,
        misfits=misfits,
        explanations=tuple(explanations),
        rate=judge_rate(problem, fit.residuals, misfits),
        warnings=(
            *warn_of_sensors(problem, sensors),
            *_warn(scene, problem, fit, parameters, where),
            *([_describe_relaxed(scene)] if relaxed else []),
            *(["nothing that was tried explains the misfit"] if unexplained else []),
            *([f"not tried: {'; '.join(untried)}"] if untried else []),
        ),
        recordings=tuple(r.measured for r in problem.replicas),
        residuals=fit.residuals.all,
        fitted=problem.rows,
        offsets=tuple(0.5 * (design[0] + design[-1]) @ own for design, _, own in added),
        drifts=tuple((design[-1] - design[0])[:, offsets:] @ own[offsets:] for design, offsets, own in added),
        noises=noises,
        starts=tuple(_find_start(problem, fit, i, relaxed) for i in range(len(problem.replicas))),
        posterior=posterior,
        interrupted=fit.interrupted,
    )


def _is_explained(explanations: Sequence[Explanation]) -> bool:
    return max((one.explained for one in explanations), default=0.0) >= _MOSTLY


def _find_start(problem: Problem, fit: Fit, recording: int, replaced: bool) -> np.ndarray | None:
    """Compute the displacement at the start of a recording, shape (N,) [m]; None if the scene found has this start."""
    start = problem.start(fit.unknowns, recording)
    if start is None and not replaced:
        return None
    values = problem.space.to_values(fit.unknowns[: problem.space.origin.size])
    return problem.replicas[recording].displacement_at_start(values, start)


def _find_gain(problem: Problem, fit: Fit, covariance: np.ndarray) -> tuple[float, np.ndarray, float]:
    """Find the gain of all recordings, its weights of the unknowns, (U,), and the variance of what contradicts it."""
    gains = np.array([problem.sensed(fit.unknowns, i)[GAIN] for i in range(len(problem.replicas))])
    weight = np.zeros(problem.count)
    if GAIN not in problem.names:
        return float(gains.mean()), weight, 0.0
    places = [problem.places(i)[problem.names.index(GAIN)] for i in range(gains.size)]
    precision = 1.0 / np.maximum(np.diag(covariance)[places], 1e-300)
    weight[places] = precision / precision.sum()
    gain = float(gains @ weight[places])
    scatter = float(precision @ (gains - gain) ** 2) / max(gains.size - 1, 1)
    return gain, weight, max(scatter - 1.0, 0.0) / float(precision.sum())


def _describe_relaxed(scene: Scene) -> str:
    """Write that the friction that was found does not hold a scene where its own drive begins."""
    return (
        f"the values found do not hold the springs of {scene.name} at the first waypoint of its own drive: with them "
        "this drive begins relaxed"
    )


def _warn_of_start(scene: Scene, problem: Problem, parameters: Sequence[Parameter]) -> list[str]:
    """Write what is not known because nothing tells how the recordings start."""
    if is_start_told(scene, problem.space.names):
        return []
    if not problem.starts:
        place = f", nor where it stood, which matters with {scene.ground.differs}" if scene.ground.differs else ""
        return [
            f"nothing tells the forces of the springs at the start{place}, and {scene.name} is of a kind for "
            "which they are not found: all values are doubtful, as they hold only for a start that was guessed; a "
            "record that begins at rest with slack springs, which `start` of the scene then states, would determine "
            "them"
        ]
    sums = sum(p.verdict == "sum" for p in parameters)
    if not sums:
        return []
    return [
        f"nothing tells the forces of the springs at the start, so of {sums} frictions only sums are determined, which "
        "gait, gain and energy depend on; a record that begins at rest with slack springs would determine each "
        f"friction, and so would {problem.starts} of them that are known"
    ]


def _warn(scene: Scene, problem: Problem, fit: Fit, parameters: Sequence[Parameter], where: str | None) -> list[str]:
    """Write the warnings."""
    warnings = ["interrupted: this is the best of what was tried"] if fit.interrupted else []
    warnings += [
        f"{p.name} ended at its bound {p.value:.6g}; widen it with bounds if it may lie beyond"
        for p in parameters
        if p.ended
    ]
    warnings += _warn_of_start(scene, problem, parameters)
    if where is None:
        return warnings
    warnings += [
        f"{r.measured.name}: the contacts stand in the reverse order of the scene's; exchange the columns, or "
        "negate the positions if x increases the other way"
        for r in problem.replicas
        if are_reversed(scene.body, r.measured)
    ]
    warnings += [
        f"{r.measured.name}: {one} and {other} move exactly alike: a marker or a column is used twice"
        for r in problem.replicas
        for one, other in find_copies(scene.body, r.measured)
    ]
    if problem.starts and scene.ground.differs and problem.offset != "none":
        warnings.append(
            f"where the robot stood at the start is unknown, which matters with {scene.ground.differs}; positions in "
            "the frame of the scene, with offset none, would tell it"
        )
    tried = f"{fit.starts} starts, and {fit.reached} of them ended here" if fit.starts > 1 else "one start"
    found = (
        "if the model is right, it is a local minimum, which more time may leave"
        if fit.reached <= AGREE
        else "more time will hardly find a better one"
    )
    warnings.append(f"this is the best of {tried}: {found}")
    return warnings
