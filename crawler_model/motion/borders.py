"""Borders between patches of ground, as limits of the displacements of contacts inside the compiled event loops.

A contact stands in a patch or on a border; which of the two is data that `ground` changes (rounded positions do not
determine it). A ramp is followed until a sliding contact reaches its next border, and stops there, unless that is left
to the event loop of a chain. A contact that stands on a border reaches it as soon as it moves: it leaves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..body.places import AHEAD, BEHIND, ROUNDING_OF_PLACE, Stretches
from ..compiled import lean
from ..rounding import EPS, NOISE
from .state import RELATIVE, X_REST, X, shift

FOLLOWED, PASSED = 0, 2
"""How the following of ramps ended: at the last target or at a border; or after a ramp that was completed by a step,
which passes over borders. 1 and -1, from `put_on_ground`: before a ramp at whose end the ground holds nothing."""

SAME = 16.0 * EPS
"""Bounds closer than this, relative to their size, count as equal."""
_NEAR = 8.0 * EPS

JUMP_RAMP, JUMP_PART, JUMP_CONTACT, JUMP_BORDER, JUMP_DISTANCE, JUMP_LOSS, JUMP_OPEN = range(7)
"""Columns of a row of jumps, as the attributes of `Jump`; and the direction of a jump that has not ended, with the
displacement at the border in place of the distance, else 0."""
COUNT, LOST, OF_RAMP, STOPPED, SUM_FORWARD, SUM_BACKWARD = range(6)
"""Columns of the first row of jumps: their number, the sum of their losses on the present ramp, this ramp, AT_BORDER or
AT_JUMP if it has stopped at a border, and the sums of all forward and all backward bounds at its end."""
AT_BORDER, AT_JUMP = 1, 2
"""How a ramp stopped: as soon as contacts reached a border, or after some have crossed it, with jumps in progress."""
_HOLDS = 1e-9
"""Sums of bounds below this part of their size are computed anew, as they change at each border."""


class Patches(NamedTuple):
    """The ground under a body, for the compiled loops."""

    ground: np.ndarray
    """Rows as in `Track.find_ground`, shape (8, N)."""
    reached: np.ndarray
    """Output: 1 for a border reached forward, -1 backward, else 0; int8, shape (N,), zero before."""
    crosses: bool
    """Whether a chain may cross borders; `place` and `ground` then change, and `command` is in force at the start."""
    place: np.ndarray
    """As in `Track`, int64, shape (N,)."""
    position: np.ndarray
    """Reference positions, shape (N,) [m]."""
    stretches: Stretches
    command: np.ndarray
    """The target in force, for ground without patches, shape (S + 2 N,), with loads (S + 3 N,)."""
    meetings: np.ndarray
    """Memory of a chain for the tournament of the next borders, from `room_for_meetings`."""
    jumps: np.ndarray
    """Output: a row with COUNT .. SUM_BACKWARD, then a row for each jump, shape (J + 1, 7)."""


def room_for_meetings(contacts: int) -> np.ndarray:
    """Allocate the memory for the tournament of the next borders of the contacts of a chain.

    Args:
        contacts: number of contacts N.

    Returns:
        Shape (4 M,) with the least power of two M that is at least N.
    """
    return np.zeros(4 << max(contacts - 1, 1).bit_length())


def room_for_jumps(contacts: int) -> np.ndarray:
    """Allocate the rows for the jumps of one call; after so many, a call stops at a border.

    Args:
        contacts: number of contacts N.

    Returns:
        Shape (J + 1, 7).
    """
    return np.zeros((contacts + 16, 7))


@lean
def surely_holds(jumps):
    """Check whether the ground holds the body at the end of a ramp, beyond rounding.

    Args:
        jumps: the first row, shape (J + 1, 7).

    Returns:
        True if both sums of bounds are positive.
    """
    forward, backward = jumps[0, SUM_FORWARD], jumps[0, SUM_BACKWARD]
    return min(forward, backward) > _HOLDS * (abs(forward) + abs(backward))


@lean
def is_moving(velocity, fastest):
    """Check whether a velocity is more than rounding.

    Args:
        velocity: of a contact [m per unit of the ramp].
        fastest: the largest velocity.

    Returns:
        True if it is.
    """
    return abs(velocity) > NOISE * fastest


@lean
def gap_ahead(contacts, ground, i, direction):
    """Compute the distance of contact i from the next border in a direction, and the rounding error of it.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N).
        ground: rows as in `Track.find_ground`, shape (8, N).
        i: the contact.
        direction: positive or negative.

    Returns:
        The distance, infinite if there is no border, and its error [m].
    """
    if direction > 0.0:
        gap = (ground[AHEAD, i] - contacts[X, i]) - contacts[X_REST, i]
    else:
        gap = (contacts[X, i] - ground[BEHIND, i]) + contacts[X_REST, i]
    return gap, ground[ROUNDING_OF_PLACE, i] + _NEAR * abs(contacts[X, i])


@lean
def find_meeting(contacts, velocity, since, ground, i):
    """Find where on the ramp a contact reaches a border if its velocity stays as it is, see `find_border`.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N).
        velocity: of the contact, not zero [m per unit of the ramp].
        since: place on the ramp at which its displacement was last updated.
        ground: rows as in `Track.find_ground`, shape (8, N).
        i: the contact.

    Returns:
        The place on the ramp, at least `since` less rounding; infinite if there is no border.
    """
    gap, near = gap_ahead(contacts, ground, i, velocity)
    if gap == np.inf:
        return np.inf
    when = since + (gap - near) / abs(velocity)
    if when < 1.0 <= since + (gap + near) / abs(velocity):
        when = 1.0
    return when


@lean
def largest(velocity):
    """Find the largest velocity.

    Args:
        velocity: shape (N,) [m per unit of the ramp].

    Returns:
        Its absolute value.
    """
    found = 0.0
    for v in velocity:
        found = max(found, abs(v))
    return found


@lean
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
    fastest = largest(velocity)
    first = np.inf
    for i in range(velocity.shape[0]):
        if is_moving(velocity[i], fastest):
            first = min(first, max(find_meeting(contacts, velocity[i], since[i], ground, i), s))
    return first


@lean
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
    fastest = largest(velocity)
    soonest = 0
    side = 0
    least = np.inf
    arriving = False
    for i in range(velocity.shape[0]):
        reached[i] = 0
        if is_moving(velocity[i], fastest):
            gap, near = gap_ahead(contacts, ground, i, velocity[i])
            direction = 1 if velocity[i] > 0.0 else -1
            if gap <= 2.0 * near:
                reached[i] = direction
                arriving |= ground[AHEAD, i] != ground[BEHIND, i]
            if (gap - near) / abs(velocity[i]) < least:
                least = (gap - near) / abs(velocity[i])
                soonest, side = i, direction
    reached[soonest] = side
    if arriving:
        for i in range(velocity.shape[0]):
            if ground[AHEAD, i] == ground[BEHIND, i]:
                reached[i] = 0


@lean
def move_all(contacts, distance):
    """Move all contacts alike.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N), changed in place.
        distance: towards +x positive [m].
    """
    for i in range(contacts.shape[1]):
        shift(contacts, distance, 1.0, i, 1.0)
        contacts[RELATIVE, i] += distance
