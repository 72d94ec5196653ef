"""Borders between patches of ground, as limits of the displacements of contacts inside the compiled event loops.

A contact stands in a patch or on a border; which of the two is data that `ground` changes (rounded positions cannot
tell). A ramp is followed until a sliding contact reaches its next border, and stops there. A contact that stands on a
border reaches it as soon as it moves: it leaves.
"""

from __future__ import annotations

import numpy as np

from ..compiled import compiled
from ..rounding import EPS, NOISE
from .state import RELATIVE, X_REST, X, shift

AHEAD, BEHIND, ROUNDING_OF_PLACE = range(3)
"""Rows of the limits of each contact: displacement at which it reaches the next border forward, infinite where there is
none; the same backward, -infinite where there is none; rounding error of both [m]."""
LIMIT_ROWS = 3

_NEAR = 8.0 * EPS


@compiled
def _is_moving(velocity, i, fastest):
    """Check whether the velocity of contact i is more than rounding."""
    return abs(velocity[i]) > NOISE * fastest


@compiled
def _gap(contacts, velocity, limits, i):
    """Compute the distance of contact i from the border ahead of its motion, and the rounding error of it."""
    if velocity[i] > 0.0:
        gap = (limits[AHEAD, i] - contacts[X, i]) - contacts[X_REST, i]
    else:
        gap = (contacts[X, i] - limits[BEHIND, i]) + contacts[X_REST, i]
    return gap, limits[ROUNDING_OF_PLACE, i] + _NEAR * abs(contacts[X, i])


@compiled
def find_border(contacts, velocity, since, s, limits):
    """Find where on the ramp the first sliding contact reaches a border if velocities stay as they are.

    A border counts as reached when only rounding separates a contact from it: ties are then met together. If it is
    within rounding of where the ramp ends, it is met exactly there: what would be left of the ramp is rounding, too.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N).
        velocity: shape (N,) [m per unit of the ramp].
        since: place on the ramp at which the displacement of each contact was last updated, shape (N,).
        s: present place on the ramp.
        limits: rows AHEAD .. ROUNDING_OF_PLACE, shape (3, N).

    Returns:
        The place on the ramp, at least s; infinite if no contact slides towards a border.
    """
    fastest = np.abs(velocity).max()
    first = np.inf
    for i in range(velocity.shape[0]):
        if _is_moving(velocity, i, fastest):
            gap, near = _gap(contacts, velocity, limits, i)
            if gap < np.inf:
                when = max(since[i] + (gap - near) / abs(velocity[i]), s)
                if when < 1.0 <= since[i] + (gap + near) / abs(velocity[i]):
                    when = 1.0
                first = min(first, when)
    return first


@compiled
def mark_reached(contacts, velocity, limits, reached):
    """Mark the contacts that have reached a border; at least one, the nearest in time.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N), up to date.
        velocity: shape (N,) [m per unit of the ramp].
        limits: rows AHEAD .. ROUNDING_OF_PLACE, shape (3, N).
        reached: output: 1 for a border reached forward, -1 backward, else 0; int8, shape (N,).
    """
    fastest = np.abs(velocity).max()
    soonest = 0
    side = 0
    least = np.inf
    for i in range(velocity.shape[0]):
        reached[i] = 0
        if _is_moving(velocity, i, fastest):
            gap, near = _gap(contacts, velocity, limits, i)
            way = 1 if velocity[i] > 0.0 else -1
            if gap <= 2.0 * near:
                reached[i] = way
            if (gap - near) / abs(velocity[i]) < least:
                least = (gap - near) / abs(velocity[i])
                soonest, side = i, way
    reached[soonest] = side


@compiled
def move_all(contacts, distance):
    """Move all contacts alike.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N), changed in place.
        distance: towards +x positive [m].
    """
    for i in range(contacts.shape[1]):
        shift(contacts, distance, 1.0, i, 1.0)
        contacts[RELATIVE, i] += distance
