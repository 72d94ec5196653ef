"""Whether a loop depends on the speed at which it was drawn."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .fit import Fit, Target
from .loop import compute_force, compute_spring, find_reversals

_APART = 2.0
"""Ratio of two speeds."""
_LEAST = 0.01
"""Part of the width of a loop below which a difference is none."""
_CHANCE = 0.01


@dataclass(frozen=True, kw_only=True)
class Rate:
    """What a record decides about the dependence on the rate.

    Attributes:
        verdict: `rate independent`, `depends on the rate`, or `one speed only`.
        speeds: the slowest and the fastest run of the record [m/s].
        difference: root mean square of the change of the force from slow to fast runs; None without two speeds [N].
        part: the same as a part of the width of the loop [1].
        chance: probability that mere noise shows as large a difference [1].
    """

    verdict: str
    speeds: tuple[float, float]
    difference: float | None = None
    part: float | None = None
    chance: float | None = None


def judge_rate(target: Target, fit: Fit, time: np.ndarray, width: float, least: float) -> Rate | None:
    """Fit the fast runs of a record apart from the slow ones, by another offset, spring and size of the loop.

    Args:
        target: what was fitted.
        fit: the fit of all runs.
        time: shape (R,) [s].
        width: of the loop [N].
        least: difference below which the fit of all runs does not resolve any [N].

    Returns:
        The verdict; None if nothing moves.
    """
    from scipy.special import fdtrc

    z = target.path.elongation
    ends = find_reversals(z, 0.05 * float(np.ptp(z)))
    runs = [slice(a, b + 1) for a, b in pairwise(ends) if abs(z[b] - z[a]) > 0.05 * np.ptp(z)]
    if not runs:
        return None
    rates = [np.diff(z[run]) / np.diff(time[run]) for run in runs]
    signed = np.array([np.median(rate[rate != 0.0]) for rate in rates])
    speeds = np.abs(signed)
    fast = speeds > np.sqrt(speeds.min() * speeds.max())
    found = (float(speeds.min()), float(speeds.max()))
    both = all(np.unique(np.sign(signed[group])).size == 2 for group in (fast, ~fast))
    if found[1] < _APART * found[0] or not both:
        return Rate(verdict="one speed only", speeds=found)
    rows = np.zeros(z.size, bool)
    for run, quick in zip(runs, fast, strict=True):
        rows[run] |= quick
    force, derivatives = compute_force(target.path, fit.shape, fit.x)
    spring = compute_spring(target.path, fit.shape, fit.x)[0] - fit.x[0]
    apart = np.array([rows, rows * spring, rows * (force - spring - fit.x[0])])[: 3 if fit.shape.elements else 2]
    columns = target.whitening.apply(np.vstack((derivatives[fit.free], apart))).T
    left = target.whitening.apply((target.force - force)[None])[0]
    alone, sizes = (np.linalg.lstsq(part, left, rcond=None)[0] for part in (columns[:, : -len(apart)], columns))
    before, after = (
        float(np.sum((left - part @ size) ** 2))
        for part, size in ((columns[:, : -len(apart)], alone), (columns, sizes))
    )
    freedom = max(z.size - columns.shape[1], 1)
    gain = (before - after) / len(apart) / max(after / freedom, target.least)
    chance = float(fdtrc(len(apart), freedom, max(gain, 0.0)))
    difference = float(np.sqrt(np.mean((sizes[-len(apart) :] @ apart[:, rows]) ** 2)))
    depends = chance < _CHANCE and difference > max(_LEAST * width, least)
    verdict, part = (
        "depends on the rate" if depends else "rate independent",
        difference / width if width > 0.0 else None,
    )
    return Rate(verdict=verdict, speeds=found, difference=difference, part=part, chance=chance)
