"""What the ground at the places of the contacts does to friction and loads, and where its next borders are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled import compiled
from ..rounding import CRITICAL, EPS

AHEAD_FACTOR, AHEAD_TILT, BEHIND_FACTOR, BEHIND_TILT, MEAN_TILT, AHEAD, BEHIND, ROUNDING_OF_PLACE = range(8)
"""Rows of the ground under each contact: factor on friction and additional load ahead, the same behind, the mean of
both loads; displacement at which the contact reaches the next border forward, infinite where there is none, the same
backward, -infinite where there is none, and the rounding error of both [m]. On a border AHEAD equals BEHIND."""

NEAR = 16.0 * EPS
"""A contact within this part of the positions that its place follows from stands on a border."""


class Stretches(NamedTuple):
    """The M + 1 stretches into which M borders divide the track, for the compiled loops."""

    borders: np.ndarray
    """Positions on the track, increasing, shape (M,) [m]."""
    grip: np.ndarray
    """Factor of each stretch on friction, forward and backward, shape (2, M + 1)."""
    pressed: np.ndarray
    """Further factor of each stretch on friction that follows from the weight, shape (M + 1,)."""
    rise: np.ndarray
    """Sine of the slope of each stretch less that of the track, shape (M + 1,)."""
    follows: np.ndarray
    """Whether the friction of each contact follows from its weight, shape (N,)."""
    weight: np.ndarray
    """Weight of each contact, shape (N,) [N]."""


@compiled
def survey(stretches, position, place, i, ground, column):
    """Find the ground under one contact.

    Args:
        stretches: the track.
        position: reference position of the contact [m].
        place: its place, as in `Track`.
        i: the contact.
        ground: output: rows AHEAD_FACTOR .. ROUNDING_OF_PLACE, shape (8, N) or (8, 1).
        column: of these rows.
    """
    borders = stretches.borders
    ahead = (place + 1) // 2
    behind = place // 2
    press_ahead = stretches.pressed[ahead] if stretches.follows[i] else 1.0
    press_behind = stretches.pressed[behind] if stretches.follows[i] else 1.0
    tilt_ahead = -stretches.weight[i] * stretches.rise[ahead]
    tilt_behind = -stretches.weight[i] * stretches.rise[behind]
    ground[AHEAD_FACTOR, column] = stretches.grip[0, ahead] * press_ahead
    ground[AHEAD_TILT, column] = tilt_ahead
    ground[BEHIND_FACTOR, column] = stretches.grip[1, behind] * press_behind
    ground[BEHIND_TILT, column] = tilt_behind
    ground[MEAN_TILT, column] = 0.5 * (tilt_ahead + tilt_behind)
    ground[AHEAD, column] = np.inf
    ground[BEHIND, column] = -np.inf
    size = 0.0
    if behind < borders.shape[0]:
        ground[AHEAD, column] = borders[behind] - position
        size = abs(borders[behind])
    if ahead > 0:
        ground[BEHIND, column] = borders[ahead - 1] - position
        size = max(size, abs(borders[ahead - 1]))
    ground[ROUNDING_OF_PLACE, column] = 0.5 * NEAR * (size + abs(position))


@compiled
def survey_all(stretches, position, place, ground):
    """Find the ground under all contacts.

    Args:
        stretches: the track.
        position: reference positions of the contacts, shape (N,) [m].
        place: their places, as in `Track`, shape (N,).
        ground: output: rows AHEAD_FACTOR .. ROUNDING_OF_PLACE, shape (8, N).
    """
    for i in range(place.shape[0]):
        survey(stretches, position[i], place[i], i, ground, i)


@compiled
def _bound_on(factor, tilt, bound, load):
    """Compute the bound that friction, shifted by a load, has on ground with a factor and an additional load."""
    if factor == 1.0 and tilt == 0.0:
        return bound
    return factor * (bound + load) - (load + tilt)


@compiled
def find_bounds(target, springs, contacts, i, ground, column):
    """Find the bounds of the spring force of one contact that a target for ground without patches has on its ground.

        forward = c_plus mu_plus - f,  backward = c_minus mu_minus + f,  f = load + tilt

    Args:
        target: rest lengths, forward and backward bounds and, with loads, loads, shape (S + 2 N,) or (S + 3 N,).
        springs: number of springs S.
        contacts: number of contacts N.
        i: the contact.
        ground: rows AHEAD_FACTOR .. MEAN_TILT at least, shape (5 or more, N) or (5 or more, 1).
        column: of these rows, which belongs to the contact.

    Returns:
        Forward bound, backward bound and load (on a border the mean of both sides) [N].
    """
    plus, minus = springs + i, springs + contacts + i
    load = target[minus + contacts] if target.shape[0] > springs + 2 * contacts else 0.0
    forward = _bound_on(ground[AHEAD_FACTOR, column], ground[AHEAD_TILT, column], target[plus], load)
    backward = _bound_on(ground[BEHIND_FACTOR, column], -ground[BEHIND_TILT, column], target[minus], -load)
    return forward, backward, load + ground[MEAN_TILT, column]


@compiled
def put_on_ground(target, springs, ground, out):
    """Turn a target for ground without patches into one for the places of the contacts, see `find_bounds`.

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
    for s in range(springs):
        out[s] = target[s]
    plus = 0.0
    minus = 0.0
    size = 0.0
    for i in range(n):
        forward, backward, load = find_bounds(target, springs, n, i, ground, i)
        out[springs + i] = forward
        out[springs + n + i] = backward
        out[springs + 2 * n + i] = load
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
