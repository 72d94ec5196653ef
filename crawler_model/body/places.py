"""What the ground at the places of the contacts does to friction and loads, and where its next borders are."""

from __future__ import annotations

import numpy as np

from ..compiled import compiled
from ..rounding import CRITICAL

AHEAD_FACTOR, AHEAD_TILT, BEHIND_FACTOR, BEHIND_TILT, MEAN_TILT, AHEAD, BEHIND, ROUNDING_OF_PLACE = range(8)
"""Rows of the ground under each contact: factor on friction and additional load ahead, the same behind, the mean of
both loads; displacement at which the contact reaches the next border forward, infinite where there is none, the same
backward, -infinite where there is none, and the rounding error of both [m]. On a border AHEAD equals BEHIND."""


@compiled
def _bound_on(factor, tilt, bound, load):
    """Compute the bound that friction, shifted by a load, has on ground with a factor and an additional load."""
    if factor == 1.0 and tilt == 0.0:
        return bound
    return factor * (bound + load) - (load + tilt)


@compiled
def put_on_ground(target, springs, ground, out):
    """Turn a target for ground without patches into one for the places of the contacts.

        forward = c_plus mu_plus - f,  backward = c_minus mu_minus + f,  f = load + tilt

    Args:
        target: rest lengths, forward and backward bounds and, with loads, loads, shape (S + 2 N,) or (S + 3 N,).
        springs: number of springs S.
        ground: rows AHEAD_FACTOR .. MEAN_TILT at least, shape (5 or more, N).
        out: output: rest lengths, forward bounds, backward bounds and loads (on a border the mean of both sides), shape
            (S + 3 N,).

    Returns:
        0 if the body has an equilibrium there; 1 if the loads exceed the friction against sliding forward, -1 backward.
    """
    n = ground.shape[1]
    loaded = target.shape[0] > springs + 2 * n
    for s in range(springs):
        out[s] = target[s]
    plus = 0.0
    minus = 0.0
    size = 0.0
    for i in range(n):
        load = target[springs + 2 * n + i] if loaded else 0.0
        forward = _bound_on(ground[AHEAD_FACTOR, i], ground[AHEAD_TILT, i], target[springs + i], load)
        backward = _bound_on(ground[BEHIND_FACTOR, i], -ground[BEHIND_TILT, i], target[springs + n + i], -load)
        out[springs + i] = forward
        out[springs + n + i] = backward
        out[springs + 2 * n + i] = load + ground[MEAN_TILT, i]
        plus += forward
        minus += backward
        size += abs(forward) + abs(backward)
    if plus < -CRITICAL * size:
        return 1
    return -1 if minus < -CRITICAL * size else 0


@compiled
def put_all_on_ground(targets, ground, out):
    """Turn the bounds and loads of many targets into those at the places of the contacts.

    Args:
        targets: as for `put_on_ground`, without rest lengths, shape (V, 2 N) or (V, 3 N).
        ground: as for `put_on_ground`.
        out: output, shape (V, 3 N).
    """
    for v in range(targets.shape[0]):
        put_on_ground(targets[v], 0, ground, out[v])


def keep_borders(ground: np.ndarray) -> np.ndarray:
    """Keep the borders of the ground only, for targets whose bounds and loads are those at the places already.

    Args:
        ground: rows AHEAD_FACTOR .. ROUNDING_OF_PLACE, shape (8, N).

    Returns:
        The rows of ground that changes neither friction nor loads, shape (8, N).
    """
    borders = ground.copy()
    borders[[AHEAD_FACTOR, BEHIND_FACTOR]] = 1.0
    borders[[AHEAD_TILT, BEHIND_TILT, MEAN_TILT]] = 0.0
    return borders
