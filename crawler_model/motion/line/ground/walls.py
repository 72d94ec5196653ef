"""Walls: places of the track at which contacts stand, whatever force pushes them there.

`walled` of a foot holds the sides on which its contact stands at a wall, as bits. There its force has no bound: the
contact never counts as being at the bound of that side, and it leaves the wall as soon as it slides away. Bounds stay
finite, so that walls take part in no sum. A wall and a border at the same place are a wall.
"""

from __future__ import annotations

import numpy as np

from ....compiled import inlined, lean
from ..records import BACKWARD, FORWARD, WALL


@inlined
def blocked_sides(ground, i):
    """Find the sides on which contact i stands at a wall.

    Returns:
        FORWARD and BACKWARD as bits; 0 if it stands at none.
    """
    if ground is None:
        return 0
    return ground.feet[i].walled


@lean
def has_walls(ground):
    """Determine whether there are walls.

    Returns:
        Whether there are.
    """
    if ground is None:
        return False
    return ground.walls.shape[1] > 0


@inlined
def room_of(c, foot, walls, side, i, s):
    """Compute the distance of a contact from its wall at s.

    Args:
        walls: places of the wall ahead and of the wall behind each contact [m], as in `Terrain`.
        side: FORWARD for the wall ahead, BACKWARD for the wall behind.

    Returns:
        The distance, < 0 beyond the wall, infinite without one [m].
    """
    if walls.shape[1] == 0:
        return np.inf
    x = c.x + c.v * (s - c.since)
    if side == FORWARD:
        return (walls[0, i] - foot.home - x) - c.residue
    return (x - (walls[1, i] - foot.home)) + c.residue


@inlined
def find_wall(c, ground, i, when):
    """Find when a sliding contact reaches its wall, if that is not behind another event.

    Args:
        when: place of that event on the ramp.

    Returns:
        The place on the ramp, or `when`; `coming` is then WALL.
    """
    if ground is None:
        return when
    return _find_wall(c, ground.feet[i], ground.walls, i, when)


@lean
def _find_wall(c, foot, walls, i, when):
    if c.v == 0.0:
        return when
    room = room_of(c, foot, walls, FORWARD if c.v > 0.0 else BACKWARD, i, c.since)
    if room == np.inf:
        return when
    other = c.since + max(room, 0.0) / abs(c.v)
    if other > when:
        return when
    c.coming = WALL
    return other


@inlined
def put_at_wall(c, foot, walls, side, i):
    """Put a contact at its wall, where it rests.

    Args:
        walls: as for `room_of`.
        side: FORWARD or BACKWARD.
    """
    c.x, c.residue = walls[0 if side == FORWARD else 1, i] - foot.home, 0.0
    foot.walled |= side
    c.bounds_met &= ~side
    c.leaving &= ~side
    if (c.v > 0.0) == (side == FORWARD):
        c.v = 0.0


@inlined
def is_at_wall(c, foot, walls, i, near):
    """Determine whether a sliding contact has come to its wall.

    Args:
        walls: as for `room_of`.
        near: distance within which it has [m].

    Returns:
        Whether it has.
    """
    side = FORWARD if c.v > 0.0 else BACKWARD
    return c.v != 0.0 and room_of(c, foot, walls, side, i, c.since) <= near


@lean
def rest_at_wall(c, foot, walls, i, near):
    """Put a contact that stops within rounding of a wall at it.

    Args:
        walls: as for `room_of`.
        near: distance that is rounding [m].
    """
    for side in (FORWARD, BACKWARD):
        if not foot.walled & side and abs(room_of(c, foot, walls, side, i, c.since)) <= near:
            put_at_wall(c, foot, walls, side, i)


@inlined
def leave_wall(c, foot, walls):
    """Let a contact that slides away from its wall leave it.

    Args:
        walls: as for `room_of`.
    """
    if c.v != 0.0:
        foot.walled &= ~(BACKWARD if c.v > 0.0 else FORWARD)


@lean
def keep_before_walls(c, foot, walls, i):
    """Put a contact that an implicit step has led beyond a wall back to it.

    Args:
        walls: as for `room_of`.
    """
    for side in (FORWARD, BACKWARD):
        if room_of(c, foot, walls, side, i, c.since) < 0.0:
            put_at_wall(c, foot, walls, side, i)
