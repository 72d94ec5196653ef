"""Borders between patches of ground, as limits of the displacements of contacts inside the compiled event loops.

A contact stands in a patch or on a border; which of the two is data that `ground` changes (rounded positions cannot
tell). A ramp is followed until a sliding contact reaches its next border, and stops there. A contact that stands on a
border reaches it as soon as it moves: it leaves.
"""

from __future__ import annotations

import numpy as np

from ..body.places import AHEAD, BEHIND, ROUNDING_OF_PLACE
from ..compiled import compiled
from ..rounding import EPS, NOISE
from .state import RELATIVE, X_REST, X, shift

FOLLOWED, PASSED = 0, 2
"""How the following of ramps ended: at the last target or at a border; or after a ramp that was completed by a step,
which passes over borders. 1 and -1, from `put_on_ground`: before a ramp at whose end the ground holds nothing."""

_NEAR = 8.0 * EPS


@compiled
def _is_moving(velocity, i, fastest):
    """Check whether the velocity of contact i is more than rounding."""
    return abs(velocity[i]) > NOISE * fastest


@compiled
def _gap(contacts, velocity, ground, i):
    """Compute the distance of contact i from the border ahead of its motion, and the rounding error of it."""
    if velocity[i] > 0.0:
        gap = (ground[AHEAD, i] - contacts[X, i]) - contacts[X_REST, i]
    else:
        gap = (contacts[X, i] - ground[BEHIND, i]) + contacts[X_REST, i]
    return gap, ground[ROUNDING_OF_PLACE, i] + _NEAR * abs(contacts[X, i])


@compiled
def find_border(contacts, velocity, since, s, ground):
    """Find where on the ramp the first sliding contact reaches a border if velocities stay as they are.

    A border counts as reached when only rounding separates a contact from it: ties are then met together. If it is
    within rounding of where the ramp ends, it is met exactly there: what would be left of the ramp is rounding, too.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N).
        velocity: shape (N,) [m per unit of the ramp].
        since: place on the ramp at which the displacement of each contact was last updated, shape (N,).
        s: present place on the ramp.
        ground: rows as in `Track.find_ground`, shape (8, N).

    Returns:
        The place on the ramp, at least s; infinite if no contact slides towards a border.
    """
    fastest = np.abs(velocity).max()
    first = np.inf
    for i in range(velocity.shape[0]):
        if _is_moving(velocity, i, fastest):
            gap, near = _gap(contacts, velocity, ground, i)
            if gap < np.inf:
                when = max(since[i] + (gap - near) / abs(velocity[i]), s)
                if when < 1.0 <= since[i] + (gap + near) / abs(velocity[i]):
                    when = 1.0
                first = min(first, when)
    return first


@compiled
def mark_reached(contacts, velocity, ground, reached):
    """Mark the contacts that have reached a border; at least one, the nearest in time.

    If some contacts arrive at a border, those that are about to leave one are not marked: whether they leave depends on
    what the others do there.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N), up to date.
        velocity: shape (N,) [m per unit of the ramp].
        ground: rows as in `Track.find_ground`, shape (8, N).
        reached: output: 1 for a border reached forward, -1 backward, else 0; int8, shape (N,).
    """
    fastest = np.abs(velocity).max()
    soonest = 0
    side = 0
    least = np.inf
    arriving = False
    for i in range(velocity.shape[0]):
        reached[i] = 0
        if _is_moving(velocity, i, fastest):
            gap, near = _gap(contacts, velocity, ground, i)
            way = 1 if velocity[i] > 0.0 else -1
            if gap <= 2.0 * near:
                reached[i] = way
                arriving |= ground[AHEAD, i] != ground[BEHIND, i]
            if (gap - near) / abs(velocity[i]) < least:
                least = (gap - near) / abs(velocity[i])
                soonest, side = i, way
    reached[soonest] = side
    if arriving:
        for i in range(velocity.shape[0]):
            if ground[AHEAD, i] == ground[BEHIND, i]:
                reached[i] = 0


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
