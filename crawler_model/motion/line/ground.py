"""Borders between patches of ground: a contact that slides onto one stands there, goes on, or falls.

On a border the forward bound is that of the ground ahead, the backward bound that of the ground behind. A contact that
reaches a border stops where the ground beyond it holds more than the bound in force, and goes on where it holds the
same. Where it holds less, the bound in force stays, and falls to that of the ground in a jump (`line.jumps`).

Contacts fall together if they reach their borders at the same instant. Instants are compared by distances: a contact
is at a border if it is nearer than the rounding of `span`, one length for all contacts, so that neither the numbering
nor the distance from the origin matters. The path depends continuously on the order of all other events.
"""

from __future__ import annotations

import numpy as np

from ...compiled import lean
from ...rounding import CRITICAL, EPS
from .advance import advance
from .records import AHEAD, BACKWARD, BEHIND, FORWARD

_ROUNDING = 64.0 * EPS
"""Part of the span within which a contact is at a border: positions are sums of a few rounded numbers."""
_SLIDES = 1e-290
"""Velocities below this stand for contacts that are about to slide."""


@lean
def _hold(foot, stretches, stretch, side, s):
    """Compute the bound that a stretch of ground holds under a contact: c mu less the load, that of its slope included.

    Returns the commanded bound itself where the stretch is like the rest of the track.
    """
    factor = stretches.grip[0 if side == FORWARD else 1, stretch]
    if foot.follows:
        factor *= stretches.pressed[stretch]
    load, tilt = foot.load + s * foot.d_load, -foot.weight * stretches.rise[stretch]
    bound = foot.forward + s * foot.d_forward
    if side == BACKWARD:
        bound, load, tilt = foot.backward + s * foot.d_backward, -load, -tilt
    if factor == 1.0 and tilt == 0.0:
        return bound
    return factor * (bound + load) - (load + tilt)


@lean
def set_bound(c, foot, stretches, side):
    """Set a bound of a contact along the ramp to that of the ground at its place.

    Args:
        c: a CONTACT.
        foot: its FOOT.
        stretches: the track.
        side: FORWARD or BACKWARD.
    """
    stretch = (foot.place + 1) // 2 if side == FORWARD else foot.place // 2
    begin = _hold(foot, stretches, stretch, side, 0.0)
    change = _hold(foot, stretches, stretch, side, 1.0) - begin
    if side == FORWARD:
        c.forward, c.d_forward = begin, change
    else:
        c.backward, c.d_backward = begin, change


@lean
def excess_of(c, foot, stretches):
    """Compute by how much the bound in force of a contact that falls exceeds that of the ground, while commands rest.

    Args:
        c: a CONTACT.
        foot: its FOOT.
        stretches: the track.

    Returns:
        The excess [N]; 0 if it does not fall.
    """
    if c.fallen & FORWARD:
        return c.forward - _hold(foot, stretches, (foot.place + 1) // 2, FORWARD, 0.0)
    if c.fallen & BACKWARD:
        return c.backward - _hold(foot, stretches, foot.place // 2, BACKWARD, 0.0)
    return 0.0


@lean
def set_load(c, foot, stretches):
    """Set the load on a contact along the ramp to that at its place, on a border the mean of both sides.

    Args:
        c: a CONTACT.
        foot: its FOOT.
        stretches: the track.
    """
    rise = 0.5 * (stretches.rise[(foot.place + 1) // 2] + stretches.rise[foot.place // 2])
    c.load, c.d_load = foot.load - foot.weight * rise, foot.d_load


@lean
def border_of(foot, stretches, coming):
    """Find the next border of a contact.

    Args:
        foot: its FOOT.
        stretches: the track.
        coming: AHEAD or BEHIND.

    Returns:
        Its number; -1 if there is none.
    """
    if coming == AHEAD:
        j = foot.place // 2
        return j if j < stretches.borders.shape[0] else -1
    return (foot.place + 1) // 2 - 1


@lean
def gap_of(c, foot, stretches, coming, s):
    """Compute the distance of a contact from its next border at s.

    Args:
        c: a CONTACT.
        foot: its FOOT.
        stretches: the track.
        coming: AHEAD or BEHIND.
        s: place on the ramp.

    Returns:
        The distance, infinite without a border [m].
    """
    j = border_of(foot, stretches, coming)
    if j < 0:
        return np.inf
    x = c.x + c.v * (s - c.since)
    gap = (stretches.borders[j] - foot.home - x) - c.rest
    return gap if coming == AHEAD else -gap


@lean
def find_meeting(c, ground, i):
    """Find when a sliding contact reaches its next border, and note in `coming` which one that is.

    Args:
        c: CONTACT i.
        ground: a `Terrain`, or None.
        i: the contact.

    Returns:
        The place on the ramp, infinite if it reaches none.
    """
    if ground is None:
        return np.inf
    if c.v == 0.0:
        return np.inf
    coming = AHEAD if c.v > 0.0 else BEHIND
    gap = gap_of(c, ground.feet[i], ground.stretches, coming, c.since)
    if gap == np.inf:
        return np.inf
    c.coming = coming
    return c.since + max(gap, 0.0) / abs(c.v)


@lean
def leave_border(c, ground, i):
    """Let a contact that slides leave the border that it is on: both bounds become those of the ground it slides onto.

    Args:
        c: CONTACT i, with its velocity.
        ground: a `Terrain`, or None.
        i: the contact.
    """
    if ground is None:
        return
    foot = ground.feet[i]
    if foot.place % 2 == 0 or c.v == 0.0:
        return
    side = FORWARD if c.v > 0.0 else BACKWARD
    foot.place += 1 if c.v > 0.0 else -1
    set_bound(c, foot, ground.stretches, BACKWARD if side == FORWARD else FORWARD)
    set_load(c, foot, ground.stretches)
    if c.forward + c.backward > 0.0 or c.d_forward + c.d_backward > 0.0:
        c.at &= side
        c.leaving &= side


@lean
def _compare(c, foot, stretches, coming, s):
    """Compare the bound beyond a border with the bound in force: -1 if it is less, 0 if they are equal, 1 if more.

    The bound in force is that of the contact, which in a jump is not that of the ground.
    """
    if coming == AHEAD:
        beyond = _hold(foot, stretches, foot.place // 2 + 1, FORWARD, s)
        force = c.forward + s * c.d_forward
    else:
        beyond = _hold(foot, stretches, (foot.place + 1) // 2 - 1, BACKWARD, s)
        force = c.backward + s * c.d_backward
    if abs(beyond - force) <= CRITICAL * (abs(beyond) + abs(force) + abs(c.load)):
        return 0
    return -1 if beyond < force else 1


@lean
def reach_border(c, ground, ramp, i):
    """Put a contact onto the border that it has reached.

    Args:
        c: CONTACT i, advanced to s; `coming` is the border.
        ground: a `Terrain`, or None.
        ramp: the RAMP.
        i: the contact.

    Returns:
        1 if the contact stands there, 0 if it goes on, -1 if it falls.
    """
    if ground is None:
        return 0
    foot, stretches = ground.feet[i], ground.stretches
    coming = c.coming
    order = _compare(c, foot, stretches, coming, ramp.s)
    side = FORWARD if coming == AHEAD else BACKWARD
    j = border_of(foot, stretches, coming)
    c.x, c.rest = stretches.borders[j] - foot.home, 0.0
    close_jump(c, ground, ramp, i)
    foot.place = 2 * j + 1
    if order >= 0:
        set_bound(c, foot, stretches, side)
        c.fallen &= ~side
    set_load(c, foot, stretches)
    if order > 0:
        c.at = c.leaving = 0
        c.v = 0.0
        return 1
    c.at |= side
    if order == 0:
        return 0
    c.fallen = side
    if c.v == 0.0:
        c.v = _SLIDES if side == FORWARD else -_SLIDES
    open_jump(c, ground, ramp, i, j)
    leave_border(c, ground, i)
    return -1


@lean
def open_jump(c, ground, ramp, i, border):
    """Begin a jump of a contact.

    Args:
        c: CONTACT i.
        ground: a `Terrain`.
        ramp: the RAMP.
        i: the contact.
        border: number of the border.
    """
    foot = ground.feet[i]
    c.lost = 0.0
    ramp.jumps += 1
    foot.jump = ramp.jumps
    if ramp.jumps <= ground.jumps.shape[0]:
        jump = ground.jumps[ramp.jumps - 1]
        jump.ramp, jump.contact = ramp.number, i
        jump.part = ramp.done if ramp.falling else ramp.done + ramp.s * (1.0 - ramp.done)
        jump.border, jump.x = ground.stretches.borders[border], c.x


@lean
def close_jump(c, ground, ramp, i):
    """End the jump of a contact, if it is in one.

    Args:
        c: CONTACT i.
        ground: a `Terrain`.
        ramp: the RAMP; what is lost is added to.
        i: the contact.
    """
    foot = ground.feet[i]
    if foot.jump == 0:
        return
    lost = max(c.lost, 0.0)
    ramp.lost += lost
    c.lost = 0.0
    if foot.jump <= ground.jumps.shape[0]:
        jump = ground.jumps[foot.jump - 1]
        jump.loss, jump.distance = lost, (c.x - jump.x) + c.rest
    foot.jump = 0


@lean
def is_falling(c, ground, ramp, i):
    """Determine whether a sliding contact is, at s, at a border beyond which the ground holds less.

    Args:
        c: CONTACT i.
        ground: a `Terrain`, or None.
        ramp: the RAMP.
        i: the contact.

    Returns:
        Whether it is.
    """
    if ground is None:
        return False
    if abs(c.v) <= _SLIDES:
        return False
    coming = AHEAD if c.v > 0.0 else BEHIND
    foot, stretches = ground.feet[i], ground.stretches
    if foot.place % 2 == 1 or gap_of(c, foot, stretches, coming, ramp.s) > _ROUNDING * (ramp.span + abs(c.v)):
        return False
    return _compare(c, foot, stretches, coming, ramp.s) < 0


@lean
def gather_falls(contacts, account, ground, ramp):
    """Put all contacts that fall at s onto their borders.

    Args:
        contacts: CONTACT, shape (N,).
        account: of the ramp, added to, shape (14,).
        ground: a `Terrain`, or None.
        ramp: the RAMP.

    Returns:
        Whether there are any.
    """
    if ground is None:
        return False
    found = False
    for i in range(contacts.shape[0]):
        c = contacts[i]
        if is_falling(c, ground, ramp, i):
            advance(c, account, ramp.s)
            c.coming = AHEAD if c.v > 0.0 else BEHIND
            reach_border(c, ground, ramp, i)
            found = True
    return found


@lean
def has_fall(contacts, block, ground, ramp, count):
    """Determine whether a contact of a block falls at s, before the rates of the block change.

    Args:
        contacts: CONTACT, shape (N,).
        block: BLOCK.
        ground: a `Terrain`, or None.
        ramp: the RAMP.
        count: number of contacts of the block.

    Returns:
        Whether one does.
    """
    if ground is None:
        return False
    for j in range(count):
        i = block[j].contact
        if is_falling(contacts[i], ground, ramp, i):
            return True
    return False


@lean
def rest_on_border(c, ground, ramp, i):
    """Put a contact that stops within rounding of a border onto it, unless it falls there.

    Otherwise a contact that comes to rest there, or begins to slide as a ramp ends, would stand a hair beside it.

    Args:
        c: CONTACT i, advanced to s.
        ground: a `Terrain`, or None.
        ramp: the RAMP.
        i: the contact.
    """
    if ground is None:
        return
    foot, stretches = ground.feet[i], ground.stretches
    if foot.place % 2 == 1 or c.fallen != 0:
        return
    near = _ROUNDING * ramp.span
    coming = 0
    for way in (AHEAD, BEHIND):
        if abs(gap_of(c, foot, stretches, way, c.since)) <= near:
            coming = way
    if coming == 0:
        return
    order = _compare(c, foot, stretches, coming, ramp.s)
    side = FORWARD if coming == AHEAD else BACKWARD
    if order < 0 and c.at & side:
        return
    j = border_of(foot, stretches, coming)
    c.x, c.rest = stretches.borders[j] - foot.home, 0.0
    foot.place = 2 * j + 1
    set_bound(c, foot, stretches, side)
    set_load(c, foot, stretches)
    if order > 0:
        c.at &= ~side
