"""Borders between patches of ground: a contact that slides onto one stands there, goes on, or falls.

On a border the ground ahead determines the forward bound, the ground behind the backward bound. A contact that
reaches a border stops where the ground beyond it holds more than the bound in force, and goes on where it holds the
same. Where it holds less, the bound in force stays, and falls to the ground's in a jump (`falls`).

Contacts fall together if they reach their borders at the same instant. Instants are compared by distances: a contact
is at a border if it is nearer than the rounding of `span`, one length for all contacts, so that neither the numbering
nor the distance from the origin matters. The path depends continuously on the order of all other events.
"""

from __future__ import annotations

import numpy as np

from ....compiled import inlined, lean
from ....rounding import CRITICAL, EPS
from ..advance import place_of
from ..records import AHEAD, BACKWARD, BEHIND, FORWARD, WALL
from .bounds import follow_ground, hold, set_bound, set_load
from .couplings import more_on
from .gradual import is_gradual
from .walls import is_at_wall, leave_wall, put_at_wall, rest_at_wall

ROUNDING = 64.0 * EPS
"""Part of the span within which a contact is at a border: positions are sums of a few rounded numbers."""
SLIDES = 1e-290
"""Velocities below this stand for contacts that are about to slide."""


@inlined
def border_of(foot, ground, coming):
    """Find the next border of a contact.

    Returns:
        Its number; -1 if there is none.
    """
    if coming == AHEAD:
        j = foot.place // 2
        return j if j < ground.borders.shape[0] else -1
    return (foot.place + 1) // 2 - 1


@inlined
def gap_of(c, foot, ground, coming, s):
    """Compute the distance of a contact from its next border at s.

    Returns:
        The distance, infinite without a border [m].
    """
    j = border_of(foot, ground, coming)
    if j < 0:
        return np.inf
    x = c.x + c.v * (s - c.since)
    gap = (ground.borders[j] - foot.home - x) - c.residue
    return gap if coming == AHEAD else -gap


@lean
def is_any_at_border(contacts, ground, ramp):
    """Determine whether a contact is at a border at the start of a ramp.

    Returns:
        Whether one is.
    """
    if ground is None:
        return False
    within = ROUNDING * ramp.span
    for i in range(contacts.shape[0]):
        c, foot = contacts[i], ground.feet[i]
        if min(gap_of(c, foot, ground, AHEAD, c.since), gap_of(c, foot, ground, BEHIND, c.since)) <= within:
            return True
    return False


@lean
def find_meeting(c, ground, i):
    """Find when a sliding contact reaches its next border, and note in `coming` which one that is.

    Returns:
        The place on the ramp, infinite if it reaches none.
    """
    if ground is None or c.v == 0.0:
        return np.inf
    coming = AHEAD if c.v > 0.0 else BEHIND
    gap = gap_of(c, ground.feet[i], ground, coming, c.since)
    if gap == np.inf:
        return np.inf
    c.coming = coming
    return c.since + max(gap, 0.0) / abs(c.v)


@lean
def leave_border(c, ground, ramp, i):
    """Let a contact that slides leave the border that it is on: the ground it slides onto sets both bounds.

    Args:
        c: CONTACT i, with its velocity.

    Returns:
        Whether it leaves one.
    """
    if ground is None:
        return False
    foot = ground.feet[i]
    leave_wall(c, foot, ground.walls)
    if foot.place % 2 == 0 or c.v == 0.0:
        return False
    side = FORWARD if c.v > 0.0 else BACKWARD
    foot.place += 1 if c.v > 0.0 else -1
    set_bound(c, foot, ground, BACKWARD if side == FORWARD else FORWARD, ramp)
    set_load(c, foot, ground, ramp)
    if c.forward + c.backward > 0.0 or c.d_forward + c.d_backward > 0.0:
        c.bounds_met &= side
        c.leaving &= side
    return True


@lean
def _hold_beyond(foot, ground, coming, s):
    """Compute the bound beyond a border, as `hold`."""
    p = ground.borders[border_of(foot, ground, coming)]
    if coming == AHEAD:
        return hold(foot, ground, foot.place // 2 + 1, FORWARD, s, p)
    return hold(foot, ground, (foot.place + 1) // 2 - 1, BACKWARD, s, p)


@lean
def _hold_before(c, foot, ground, coming, s, force):
    """Return the bound in force before a border; on gradual ground that of the stretch there, where it comes to it."""
    if c.fallen != 0 or not is_gradual(ground):
        return force
    p = ground.borders[border_of(foot, ground, coming)]
    if coming == AHEAD:
        return hold(foot, ground, (foot.place + 1) // 2, FORWARD, s, p)
    return hold(foot, ground, foot.place // 2, BACKWARD, s, p)


@lean
def _exceeds(c, foot, ground, coming, ramp):
    """Determine whether the force on a contact is more than the ground beyond a border holds."""
    beyond = _hold_beyond(foot, ground, coming, ramp.fall.rests if ramp.fall.falling else ramp.s)
    beyond += more_on(foot, FORWARD if coming == AHEAD else BACKWARD, place_of(c, ramp))
    force = c.force if coming == AHEAD else -c.force
    return force - beyond > CRITICAL * (abs(beyond) + abs(force) + abs(c.load))


@inlined
def put_on_border(c, foot, ground, j):
    """Put a contact onto a border; its bounds are set elsewhere.

    Args:
        j: number of the border.
    """
    c.x, c.residue = ground.borders[j] - foot.home, 0.0
    foot.place = 2 * j + 1


@lean
def compare(c, foot, ground, coming, ramp):
    """Compare the bound beyond a border with the bound in force, which in a fall is not the ground's.

    Returns:
        -1 if it is less, 0 if they are equal, 1 if it is more.
    """
    s, commanded = place_of(c, ramp), ramp.fall.rests if ramp.fall.falling else ramp.s
    beyond = _hold_beyond(foot, ground, coming, commanded)
    force = c.forward + s * c.d_forward if coming == AHEAD else c.backward + s * c.d_backward
    more = more_on(foot, FORWARD if coming == AHEAD else BACKWARD, s)
    beyond += more
    force = _hold_before(c, foot, ground, coming, commanded, force - more) + more
    if abs(beyond - force) <= CRITICAL * (abs(beyond) + abs(force) + abs(c.load)):
        return 0
    return -1 if beyond < force else 1


@lean
def reach_border(c, ground, ramp, i):
    """Put a contact onto the border or to the wall that it has reached.

    Args:
        c: CONTACT i, which slides, advanced to s; `coming` is the border, or WALL.

    Returns:
        1 if the contact stands there, 0 if it goes on, -1 if it falls.
    """
    if ground is None:
        return 0
    foot = ground.feet[i]
    coming = c.coming
    if coming == WALL or is_at_wall(c, foot, ground.walls, i, ROUNDING * ramp.span):
        _stop_at_wall(c, foot, ground, ramp, i)
        return 1
    order = compare(c, foot, ground, coming, ramp)
    side = FORWARD if coming == AHEAD else BACKWARD
    j = border_of(foot, ground, coming)
    put_on_border(c, foot, ground, j)
    if order <= 0 and c.fallen != 0 and is_gradual(ground):  # its jump goes on
        leave_border(c, ground, ramp, i)
        return 0
    close_jump(c, ground, ramp, i)
    if order >= 0:
        set_bound(c, foot, ground, side, ramp)
        c.fallen &= ~side
    set_load(c, foot, ground, ramp)
    if order > 0:
        c.bounds_met = c.leaving = 0
        c.v = 0.0
        follow_ground(c, ground, ramp, i)
        return 1
    c.bounds_met |= side
    if order == 0:
        return 0
    c.fallen = side
    open_jump(c, ground, ramp, i, ground.borders[j])
    leave_border(c, ground, ramp, i)
    return -1


@lean
def _stop_at_wall(c, foot, ground, ramp, i):
    """Let a contact that slides stop at its wall, where a jump ends."""
    side = FORWARD if c.v > 0.0 else BACKWARD
    put_at_wall(c, foot, ground.walls, side, i)
    close_jump(c, ground, ramp, i)
    if c.fallen & side:
        set_bound(c, foot, ground, side, ramp)
        c.fallen &= ~side
    follow_ground(c, ground, ramp, i)


@lean
def catch(c, ground, ramp, i):
    """End the jump of a contact whose falling bound has met that of the ground, which need not hold its force.

    Args:
        c: CONTACT i, advanced to s.
    """
    if ground is None:
        return
    side = c.fallen
    c.fallen = 0
    set_bound(c, ground.feet[i], ground, side, ramp)
    close_jump(c, ground, ramp, i)


@lean
def open_jump(c, ground, ramp, i, border):
    """Begin a jump of a contact.

    Args:
        border: place of the border, or of the wall to which nothing holds the body [m].
    """
    foot = ground.feet[i]
    c.lost = 0.0
    ramp.fall.jumps += 1
    foot.jump = ramp.fall.jumps
    if ramp.fall.jumps <= ground.jumps.shape[0]:
        jump = ground.jumps[ramp.fall.jumps - 1]
        jump.ramp, jump.contact = ramp.number, i
        jump.fraction = ramp.done + (ramp.fall.rests if ramp.fall.falling else ramp.s) * (1.0 - ramp.done)
        jump.border, jump.x = border, c.x


@lean
def close_jump(c, ground, ramp, i):
    """End the jump of a contact, if it is in one, and add what is lost to the account."""
    foot = ground.feet[i]
    if foot.jump == 0:
        return
    lost = max(c.lost, 0.0)
    ramp.fall.lost += lost
    c.lost = 0.0
    if foot.jump <= ground.jumps.shape[0]:
        jump = ground.jumps[foot.jump - 1]
        jump.loss, jump.distance = lost, (c.x - jump.x) + c.residue
    foot.jump = 0


@inlined
def rest_on_border(c, ground, ramp, i):
    """Put a contact that stops within rounding of a border onto it, unless it falls there.

    Otherwise a contact that comes to rest there, or begins to slide as a ramp ends, would stand a hair away from it.
    """
    if ground is None:
        return
    foot, near = ground.feet[i], ROUNDING * ramp.span
    gap = min(abs(gap_of(c, foot, ground, AHEAD, c.since)), abs(gap_of(c, foot, ground, BEHIND, c.since)))
    if gap <= near or ground.walls.shape[1] > 0:
        _rest_on_border(c, foot, ground, ramp, i, near)


@lean
def _rest_on_border(c, foot, ground, ramp, i, near):
    rest_at_wall(c, foot, ground.walls, i, near)
    if foot.place % 2 == 1 or c.fallen != 0 or foot.walled != 0:
        return
    coming = 0
    for way in (AHEAD, BEHIND):
        if abs(gap_of(c, foot, ground, way, c.since)) <= near:
            coming = way
    if coming == 0:
        return
    order = compare(c, foot, ground, coming, ramp)
    side = FORWARD if coming == AHEAD else BACKWARD
    if order < 0 and (c.bounds_met & side or _exceeds(c, foot, ground, coming, ramp)):
        return
    put_on_border(c, foot, ground, border_of(foot, ground, coming))
    set_bound(c, foot, ground, side, ramp)
    set_load(c, foot, ground, ramp)
    if order > 0:
        c.bounds_met &= ~side
        if (c.v > 0.0) == (coming == AHEAD):
            c.v = 0.0  # it stops there as the ramp ends
