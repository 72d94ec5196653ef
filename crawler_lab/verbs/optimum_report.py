"""Optimal gaits in words: what `crawler optimise` prints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..optimise.gait_table import describe_gait, name_number

if TYPE_CHECKING:
    from crawler_model import Scene

    from ..optimise.optimum import Optimum, Weakness
    from ..optimise.pareto import Front

_SHOWN_ROWS = 12
_NOTHING_BETTER = "; the search ended because several rounds in a row found nothing better"
_STOPPED_EARLY = "; stopped before the end, the result depends on the machine"
_MOVES = {"turn": "turns to the left", "screw": "comes nearer to the target"}
_HASTY = 4
"""Reversals of a link in a period: a stroke and its return are two."""


def describe_optimum(found: Optimum) -> list[str]:
    """Describe an optimum in a few lines.

    Args:
        found: the optimum.

    Returns:
        The lines.
    """
    words = {
        "translation": "gain per period",
        "cost-of-transport": "cost of transport",
        "travel": "gain / travel",
        "turn": "turn per period",
        "screw": "distance from the target",
    }
    unit = "" if found.unit == "1" else f" {found.unit}"
    worst = ", the worst over the box" if len(found.space.scenes) > 1 else ""
    if found.robustness is not None:
        kind = "the mean" if found.robustness.over == "expected" else "the worst"
        worst = f", {kind} of {found.robustness.drawn} bodies drawn from the posterior"
    lines = [f"{found.scene.name}: {words[found.objective]} {_number(found.value)}{unit}{worst}"]
    if found.motion is not None and len(found.motion) == 3:
        dx, dy, dyaw = found.motion
        lines.append(f"motion per period {dx:.6g} m forward, {dy:.6g} m to the left, {dyaw:.6g} rad")
    elif found.motion is not None:
        lines.append(f"motion per period {found.motion[0]:.6g} m along x, {found.motion[1]:.6g} m along y")
    if found.gain <= 0.0 and found.objective not in _MOVES:
        lines.append("no gait within these bounds was found that moves forward")
    lines += [_describe_numbers(found), _describe_pace(found)]
    shown = [pair for pair in zip(found.names, found.values, strict=True) if not pair[0].startswith("drive.")]
    lines += [f"  {name} = {value:.6g}" for name, value in shown[:_SHOWN_ROWS]]
    if len(shown) > _SHOWN_ROWS:
        lines.append(f"  ... and {len(shown) - _SHOWN_ROWS} more unknowns")
    if len(shown) < len(found.names):
        lines += describe_gait(found.scene, _SHOWN_ROWS)
    slope = "one-sided derivatives" if not found.differentiable else "differentiable"
    if not math.isnan(found.gradient_norm):
        slope = f"{slope}, projected gradient {found.gradient_norm:.1e}"
    if not found.scene.has_exact_derivatives:
        slope = "without derivatives"
    lines.append(
        f"{slope}; {len(found.active_bounds)} active bounds; "
        f"{'unique' if found.unique else 'not unique'} as far as the search has seen"
    )
    if found.flat:
        more = " ..." if len(found.flat) > 4 else ""
        flat = ", ".join(name_number(found.scene, name) for name in found.flat[:4])
        lines.append(f"{len(found.flat)} unknowns change nothing near it: {flat}{more}")
    if found.alternatives:
        lines.append("other local optima: " + ", ".join(f"{one.value:.6g}{unit}" for one in found.alternatives))
    for weakness in found.weaknesses:
        moves = _MOVES.get(found.objective, "moves forward")
        lines.append(f"robust: {_describe_weakness(weakness, moves)}")
    if found.robustness is not None:
        one = found.robustness
        lines.append(
            f"on {one.verified} other bodies: mean {_number(one.mean)}{unit}, worst {_number(one.worst)}{unit}; with "
            f"the best-fit values {_number(one.best_fit)}{unit}"
        )
        lines += [
            f"it depends on {name}, which the record did not excite: it keeps its value in the scene"
            for name in one.unknown
        ]
    if found.inertia is not None:
        lines.append(found.inertia.describe(found.scene.body))
    lines.append(
        f"found after {found.found_after_s:.3g} s, {found.evaluations} evaluations in {found.wall_s:.3g} s, "
        f"seed {found.seed}{_describe_end(found)}"
    )
    return lines


def _describe_end(found: Optimum) -> str:
    from ..optimise.search import MOST_EVALUATIONS

    if found.complete and found.exhausted:
        return f"; the search ended after {MOST_EVALUATIONS} evaluations, --seconds allows more"
    if found.complete:
        return _NOTHING_BETTER
    return _describe_stop(found.untried)


def _describe_stop(untried: Sequence[str]) -> str:
    return f"{_STOPPED_EARLY}; not tried to the end: {', '.join(untried)}" if untried else _STOPPED_EARLY


def _number(value: float, digits: int = 6) -> str:
    """Write a number; there is no cost of transport where nothing moves forward."""
    return "none" if math.isnan(value) else f"{value:.{digits}g}"


def _describe_numbers(found: Optimum) -> str:
    from ..optimise.goal import LEAST_GAIN

    end = f"transient left {found.transient_left:.1e} m"
    if math.isinf(found.transient_left):
        end = "whether periods settle was not found, and the gain belongs to the last one of the search"
    if found.periods is not None:
        end = f"the mean of the first {found.periods} periods, as the ground makes them differ"
    slow = math.isnan(found.cost_of_transport) and abs(found.gain) > LEAST_GAIN * found.travel
    cost = "none, as its periods settle too slowly" if slow else _number(found.cost_of_transport, 4)
    return (
        f"gain {found.gain:.6g} m a period, cost of transport {cost}, "
        f"travel {found.travel:.4g} m, largest tension {found.peak_tension:.4g} N; {end}"
    )


def _describe_pace(found: Optimum) -> str:
    """Describe a gait by what motors feel: the gain per second, per length of stroke and per reversal.

    A gait that reverses often without a limit of its rates has a remark.
    """
    turns = found.objective == "turn"
    name, gain, unit = ("turn", found.value, "rad") if turns else ("gain", found.gain, "m")
    period, reversals = _find_reversals(found.scene)
    most = max(reversals, default=0)
    per_stroke = f", {gain / found.travel:.4g} {unit} per m of stroke" if found.travel > 0.0 else ""
    per_reversal = f", {gain / sum(reversals):.4g} {unit} per reversal" if most else ""
    hint = "; --fastest limits the speed, --waypoints the number of reversals" if most > _HASTY else ""
    return (
        f"{name} {gain / period:.4g} {unit}/s{per_stroke}{per_reversal}; a link reverses up to {most / period:.3g} "
        f"times a second{hint}"
    )


def _find_reversals(scene: Scene) -> tuple[float, list[int]]:
    """Find the period of a gait [s], and how often each actuator reverses in it, a segment as its first element."""
    drive, sizes = scene.drive, scene.columns.actuation_sizes
    rows = drive.rows[:, : scene.columns.lengths]
    first = np.arange(rows.shape[1]) if scene.dimension == 2 else np.cumsum(sizes) - sizes
    return drive.period or float(drive.times[-1]), [_count_reversals(column) for column in rows.T[first]]


def _count_reversals(values: np.ndarray) -> int:
    """Count how often a quantity changes its direction in a period, whose first and last value, of (T,), are equal."""
    steps = np.diff(values)
    signs = np.sign(steps[np.abs(steps) > 1e-9 * np.ptp(values)])
    return int((signs != np.roll(signs, 1)).sum())


def _describe_weakness(weakness: Weakness, moves: str) -> str:
    """Describe at which change of a number a gait no longer does what it should."""
    key, below, above = weakness.key, weakness.below, weakness.above
    if below == above == 1.0:
        return f"the gait never {moves}"
    edges = [f"{factor:.4g}" for factor in (below, above) if factor is not None]
    if not edges:
        return f"no change of {key} by a factor of up to 100 stops the gait"
    return f"the gait no longer {moves} when {key} changes by the factor {' or '.join(edges)}"


def describe_front(found: Front) -> list[str]:
    """Describe the curve of gain against cost of transport.

    Args:
        found: the curve.

    Returns:
        The lines.
    """
    heads = "gain per period [m], cost of transport [1], gain [m/s], most reversals of a link [1/s]"
    lines = [f"{found.points[0].scene.name}: {heads}"]
    for point in found.points:
        period, reversals = _find_reversals(point.scene)
        pace = f"{point.gain / period:.6g}  {max(reversals, default=0) / period:.3g}"
        lines.append(f"  {point.gain:.6g}  {_number(point.cost_of_transport)}  {pace}")
    ending = _NOTHING_BETTER if found.complete else _describe_stop(found.untried)
    lines.append(f"{found.evaluations} evaluations in {found.wall_s:.3g} s, seed {found.seed}{ending}")
    return lines
