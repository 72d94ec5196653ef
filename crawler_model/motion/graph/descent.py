"""Steps that lower the cost which the active set of a graph minimises, without solving for all contacts."""

from __future__ import annotations

import numpy as np

from ...compiled import compiled
from ...rounding import EPS


@compiled
def _find_groups(band, sliding):
    """Number the groups of sliding contacts that springs join; each has the number of one of its contacts."""
    n, width = band.shape
    group = np.arange(n)
    for p in range(n):
        for d in range(min(width, n - 1 - p)):
            if band[p, d] != 0.0 and sliding[p] and sliding[p + 1 + d]:
                a, b = p, p + 1 + d
                while group[a] != a:
                    group[a] = group[group[a]]
                    a = group[a]
                while group[b] != b:
                    group[b] = group[group[b]]
                    b = group[b]
                group[max(a, b)] = min(a, b)
    for p in range(n):
        group[p] = group[group[p]]
    return group


@compiled
def search(band, lower, upper, velocity, trial, side, sliding, close, may_pass, parts):
    """Find the part of the way to `trial` at which the cost is least, for each group of contacts on its own.

    The slope of the cost is -(1 - part) q on the way, q = d' K d, d = trial - v, and jumps where a contact reverses its
    direction. If it may not, or has only begun to slide, the way ends there.

    Args:
        band: as in `Network`, shape (N, width) [N/m].
        lower: smallest force at rest, shape (N,) [N].
        upper: largest force at rest, shape (N,) [N].
        velocity: present velocities, shape (N,).
        trial: velocities that minimise the cost if no contact reverses, shape (N,).
        side: directions, int8, shape (N,).
        sliding: whether contacts slide, int8, shape (N,).
        close: rounding of `trial`.
        may_pass: whether contacts may reverse their directions.
        parts: output, shape (N,).

    Returns:
        Whether any part is less than 1.
    """
    n, width = band.shape
    count = 0
    whose = np.empty(n, np.int64)
    places = np.empty(n)
    for p in range(n):
        parts[p] = 1.0
        if side[p] * trial[p] < -close:
            whose[count] = p
            places[count] = velocity[p] / (velocity[p] - trial[p]) if velocity[p] != 0.0 else 0.0
            count += 1
    if count == 0:
        return False
    group = _find_groups(band, sliding)
    curvature = np.zeros(n)
    slope = np.zeros(n)
    for p in range(n):
        for d in range(min(width, n - 1 - p)):
            if band[p, d] != 0.0:
                q = p + 1 + d
                own = trial[p] - velocity[p] if sliding[p] else 0.0
                other = trial[q] - velocity[q] if sliding[q] else 0.0
                curvature[group[p if sliding[p] else q]] += band[p, d] * (own - other) ** 2
    ended = np.zeros(n, np.bool_)
    for j in np.argsort(places[:count]):
        p, at = whose[j], places[j]
        g = group[p]
        if ended[g] or slope[g] >= (1.0 - at) * curvature[g]:
            continue
        passes = may_pass and velocity[p] != 0.0
        slope[g] += abs(trial[p] - velocity[p]) * (upper[p] - lower[p]) if passes else np.inf
        if slope[g] >= (1.0 - at) * curvature[g]:
            parts[g] = at
            ended[g] = True
    for p in range(n):
        g = group[p]
        if g == p and not ended[g] and slope[g] > 0.0:
            parts[g] = 1.0 - slope[g] / curvature[g]
    for p in range(n):
        parts[p] = parts[group[p]]
    return parts.min() < 1.0


@compiled
def relax(band, load, lower, upper, magnitude, backwards, velocity, side):
    """Solve the problem of each contact in turn, which lowers the cost; whole rows of contacts start to slide.

    Args:
        band: as in `Network`, shape (N, width) [N/m].
        load: r, shape (N,) [N].
        lower: smallest force at rest, shape (N,) [N].
        upper: largest force at rest, shape (N,) [N].
        magnitude: magnitude of the numbers whose differences load and bounds are, shape (N,) [N].
        backwards: whether to begin with the last contact.
        velocity: shape (N,), changed in place.
        side: output: directions, int8, shape (N,).
    """
    n, width = band.shape
    for k in range(n):
        p = n - 1 - k if backwards else k
        pull = load[p]
        size = abs(load[p]) + magnitude[p]
        total = 0.0
        for d in range(min(width, n - 1 - p)):
            pull += band[p, d] * velocity[p + 1 + d]
            size += abs(band[p, d] * velocity[p + 1 + d])
            total += band[p, d]
        for d in range(min(width, p)):
            pull += band[p - 1 - d, d] * velocity[p - 1 - d]
            size += abs(band[p - 1 - d, d] * velocity[p - 1 - d])
            total += band[p - 1 - d, d]
        excess = pull - upper[p] if pull > upper[p] else (pull - lower[p] if pull < lower[p] else 0.0)
        if abs(excess) <= 32.0 * EPS * size:
            excess = 0.0
        velocity[p] = excess / total
        side[p] = 1 if excess > 0.0 else (-1 if excess < 0.0 else 0)
