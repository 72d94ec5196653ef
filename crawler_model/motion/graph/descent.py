"""Steps that lower the cost which the active set of a graph minimises, without solving for all contacts."""

from __future__ import annotations

import numpy as np

from ...compiled import compiled, lean
from ...rounding import EPS
from .elimination import pull_at


@lean
def search(net, lower, upper, velocity, trial, side, sliding, close, may_pass, parts, groups, places):
    """Find the part of the way to `trial` at which the cost is least, for each group of contacts on its own.

    The slope of the cost is -(1 - part) q on the way, q = d' K d, d = trial - v, and jumps where a contact reverses its
    direction. If it may not, or has only begun to slide, the way ends there.

    Args:
        net: conductances of the `Network`, and heads and near of its `Layout`.
        lower: smallest force at rest, shape (N,) [N].
        upper: largest force at rest, shape (N,) [N].
        velocity: present velocities, shape (N,).
        trial: velocities that minimise the cost if no contact reverses, shape (N,).
        side: directions, int8, shape (N,).
        sliding: whether contacts slide, int8, shape (N,).
        close: rounding of `trial`.
        may_pass: whether contacts may reverse their directions.
        parts: output, shape (N,).
        groups: of the sliding contacts, from `eliminate`.
        places: positions of the contacts, as in `move`.

    Returns:
        Whether any part is less than 1.
    """
    count = 0
    passing = False
    for p in places:
        parts[p] = 1.0
        if side[p] * trial[p] < -close:
            count += 1
            passing |= may_pass and velocity[p] != 0.0 and upper[p] - lower[p] < np.inf
    if count == 0:
        return False
    if not passing:
        for p in places:
            if side[p] * trial[p] < -close:
                at = velocity[p] / (velocity[p] - trial[p]) if velocity[p] != 0.0 else 0.0
                parts[groups[p]] = min(parts[groups[p]], at)
        for p in places:
            parts[p] = parts[groups[p]]
        return True
    return _search_passing(
        net, lower, upper, velocity, trial, side, sliding, close, may_pass, parts, groups, places, count
    )


@compiled
def _search_passing(net, lower, upper, velocity, trial, side, sliding, close, may_pass, parts, groups, places, count):
    """Do the same where contacts may reverse, of which there are `count`."""
    conductances, heads, near = net
    n = heads.shape[0] - 1
    whose = np.empty(count, np.int64)
    ats = np.empty(count)
    count = 0
    for p in places:
        if side[p] * trial[p] < -close:
            whose[count] = p
            ats[count] = velocity[p] / (velocity[p] - trial[p]) if velocity[p] != 0.0 else 0.0
            count += 1
    curvature = np.empty(n)
    slope = np.empty(n)
    ended = np.empty(n, np.bool_)
    for p in places:
        curvature[p] = 0.0
        slope[p] = 0.0
        ended[p] = False
    for p in places:
        for k in range(heads[p], heads[p + 1]):
            q = near[k]
            if q > p and (sliding[p] or sliding[q]):
                own = trial[p] - velocity[p] if sliding[p] else 0.0
                other = trial[q] - velocity[q] if sliding[q] else 0.0
                curvature[groups[p if sliding[p] else q]] += conductances[k] * (own - other) ** 2
    for j in np.argsort(ats):
        p, at = whose[j], ats[j]
        g = groups[p]
        if ended[g] or slope[g] >= (1.0 - at) * curvature[g]:
            continue
        passes = may_pass and velocity[p] != 0.0
        slope[g] += abs(trial[p] - velocity[p]) * (upper[p] - lower[p]) if passes else np.inf
        if slope[g] >= (1.0 - at) * curvature[g]:
            parts[g] = at
            ended[g] = True
    for p in places:
        if groups[p] == p and not ended[p] and slope[p] > 0.0:
            parts[p] = 1.0 - slope[p] / curvature[p]
    least = 1.0
    for p in places:
        parts[p] = parts[groups[p]]
        least = min(least, parts[p])
    return least < 1.0


@lean
def relax(net, load, lower, upper, magnitude, backwards, velocity, side, places):
    """Solve the problem of each contact in turn, which lowers the cost; whole rows of contacts start to slide or stop.

    Args:
        net: conductances of the `Network`, and heads and near of its `Layout`.
        load: r, shape (N,) [N].
        lower: smallest force at rest, shape (N,) [N].
        upper: largest force at rest, shape (N,) [N].
        magnitude: magnitude of the numbers whose differences load and bounds are, shape (N,) [N].
        backwards: whether to begin with the last contact.
        velocity: shape (N,), changed in place.
        side: output: directions, int8, shape (N,).
        places: positions of the contacts, as in `move`.
    """
    for k in range(places.shape[0]):
        p = places[places.shape[0] - 1 - k if backwards else k]
        if lower[p] == -np.inf and upper[p] == np.inf:
            continue
        pull, size, total = pull_at(net, velocity, load, p)
        size += magnitude[p]
        excess = pull - upper[p] if pull > upper[p] else (pull - lower[p] if pull < lower[p] else 0.0)
        if abs(excess) <= 32.0 * EPS * size:
            excess = 0.0
        velocity[p] = excess / total
        side[p] = 1 if excess > 0.0 else (-1 if excess < 0.0 else 0)
