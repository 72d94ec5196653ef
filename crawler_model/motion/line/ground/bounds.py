"""The bounds of contacts by the ground at their places, along a ramp."""

from __future__ import annotations

import numpy as np

from ....compiled import inlined, lean
from ..advance import place_of
from ..records import BACKWARD, FORWARD
from .couplings import more_on
from .gradual import change_at, commands_at, slopes_of


@inlined
def hold(foot, ground, stretch, side, s, p):
    """Compute the bound that a stretch of ground holds under a contact: c mu less the load, its slope's included.

    Args:
        stretch: number of the stretch.
        side: FORWARD or BACKWARD.
        p: place of the contact on the track [m].

    Returns:
        The bound; the commanded one itself where the stretch is like the rest of the track [N].
    """
    factor = ground.grip[0 if side == FORWARD else 1, stretch]
    if foot.follows:
        factor *= ground.pressed[stretch]
    steeper, higher = change_at(ground.profile, side, stretch, p)
    factor += steeper
    load, tilt = foot.load + s * foot.d_load, -foot.weight * (ground.rise[stretch] + higher)
    bound = foot.forward + s * foot.d_forward
    if side == BACKWARD:
        bound, load, tilt = foot.backward + s * foot.d_backward, -load, -tilt
    if factor == 1.0 and tilt == 0.0:
        return bound
    return factor * (bound + load) - (load + tilt)


@inlined
def _change_of(foot, ground, stretch, side, p):
    """Compute by how much commands change the bound that a stretch holds along the ramp, see `hold`."""
    if foot.d_forward == 0.0 and foot.d_backward == 0.0 and foot.d_load == 0.0:
        return 0.0
    return hold(foot, ground, stretch, side, 1.0, p) - hold(foot, ground, stretch, side, 0.0, p)


@inlined
def place_on_track(c, foot):
    """Find the place of a contact on the track.

    Returns:
        The place [m].
    """
    return foot.home + (c.x + c.residue)


@inlined
def set_bound(c, foot, ground, side, ramp):
    """Set a bound of a contact, along the ramp, to the bound of the ground at its place; in a fall commands rest.

    Args:
        side: FORWARD or BACKWARD.
    """
    stretch, p = (foot.place + 1) // 2 if side == FORWARD else foot.place // 2, place_on_track(c, foot)
    begin = hold(foot, ground, stretch, side, ramp.fall.rests if ramp.fall.falling else 0.0, p)
    change = 0.0 if ramp.fall.falling else _change_of(foot, ground, stretch, side, p)
    begin += more_on(foot, side, 0.0)
    change += foot.d_more_forward if side == FORWARD else foot.d_more_backward
    if side == FORWARD:
        c.forward, c.d_forward = begin, change
    else:
        c.backward, c.d_backward = begin, change


@lean
def excess_of(c, foot, ground):
    """Compute by how much the bound in force of a contact that falls exceeds the ground's, while commands rest.

    Returns:
        The excess [N]; 0 if it does not fall.
    """
    if c.fallen & FORWARD:
        return c.forward - hold(foot, ground, (foot.place + 1) // 2, FORWARD, 0.0, place_on_track(c, foot))
    if c.fallen & BACKWARD:
        return c.backward - hold(foot, ground, foot.place // 2, BACKWARD, 0.0, place_on_track(c, foot))
    return 0.0


@lean
def set_load(c, foot, ground, ramp):
    """Set the load on a contact, along the ramp, to that at its place, on a border the mean of both sides."""
    c.load, c.d_load = foot.load, foot.d_load
    if foot.weight != 0.0:
        ahead, behind, p = (foot.place + 1) // 2, foot.place // 2, place_on_track(c, foot)
        rise = 0.5 * (ground.rise[ahead] + ground.rise[behind])
        more = change_at(ground.profile, FORWARD, ahead, p)[1] + change_at(ground.profile, FORWARD, behind, p)[1]
        c.load -= foot.weight * (rise + 0.5 * more)
    if ramp.fall.falling:
        c.load, c.d_load = c.load + ramp.fall.rests * c.d_load, 0.0


@lean
def set_bounds(c, foot, ground, ramp):
    """Set both bounds of a contact and its load as the ground at its place demands, see `set_bound`."""
    set_bound(c, foot, ground, FORWARD, ramp)
    set_bound(c, foot, ground, BACKWARD, ramp)
    set_load(c, foot, ground, ramp)


@inlined
def follow_ground(c, ground, ramp, i):
    """Let the bounds and the load of a contact change with its place, at the velocity that was found.

    Args:
        c: CONTACT i, advanced to s.
    """
    if ground is not None:
        _follow_ground(c, ground.feet[i], ground, ground.profile, ramp)


@inlined
def _follow_ground(c, foot, ground, profile, ramp):
    if profile is None:
        return
    s, commanded, p = place_of(c, ramp), ramp.fall.rests if ramp.fall.falling else ramp.s, place_on_track(c, foot)
    ahead, behind = (foot.place + 1) // 2, foot.place // 2
    if c.v > 0.0:
        behind = ahead
    elif c.v < 0.0:
        ahead = behind
    up, down = slopes_of(foot, profile, ahead, behind, commands_at(ramp))
    moves = 0.0 if ramp.fall.falling else 1.0
    forward = hold(foot, ground, ahead, FORWARD, commanded, p)
    d_forward = moves * _change_of(foot, ground, ahead, FORWARD, p)
    backward = hold(foot, ground, behind, BACKWARD, commanded, p)
    d_backward = moves * _change_of(foot, ground, behind, BACKWARD, p)
    d_forward += up * c.v
    d_backward -= down * c.v
    forward, d_forward = forward + more_on(foot, FORWARD, s), d_forward + foot.d_more_forward
    backward, d_backward = backward + more_on(foot, BACKWARD, s), d_backward + foot.d_more_backward
    if c.fallen & FORWARD:
        c.spare, c.d_under = c.forward - (forward - s * d_forward), d_forward
    else:
        c.forward, c.d_forward = forward - s * d_forward, d_forward
    if c.fallen & BACKWARD:
        c.spare, c.d_under = c.backward - (backward - s * d_backward), d_backward
    else:
        c.backward, c.d_backward = backward - s * d_backward, d_backward
    set_load(c, foot, ground, ramp)
    slide = -foot.weight * profile[3, ahead] * c.v
    c.load, c.d_load = c.load - s * slide, c.d_load + slide


@inlined
def rate_at_bound(c, e, ground, side):
    """Find the rate of the force on a contact that is at a bound, which changes with its place on gradual ground.

    Args:
        c: the CONTACT, after `follow_ground`.
        e: its BLOCK.
        side: 1 at the forward bound, -1 at the backward bound.

    Returns:
        The rate [N].
    """
    if ground is None:
        return e.upper if side > 0 else e.lower
    return _rate_at_bound(c, e, ground.profile, side)


@inlined
def _rate_at_bound(c, e, profile, side):
    if profile is None:
        return e.upper if side > 0 else e.lower
    return c.d_forward if side > 0 else -c.d_backward


@inlined
def enter_ground(c, e, ground, ramp, i, away):
    """Enter the stiffness of gradual ground in a row of a block, and limits that do not contain it.

    Args:
        c: CONTACT i.
        e: its BLOCK.
        away: distance of the place where that is from where the contact is [m].
    """
    if ground is not None:
        _enter_ground(c, e, ground.feet[i], ground, ground.profile, ramp, away)


@inlined
def _enter_ground(c, e, foot, ground, profile, ramp, away):
    if profile is None:
        return
    ahead, behind, p = (foot.place + 1) // 2, foot.place // 2, place_on_track(c, foot) + away
    e.ahead, e.behind = slopes_of(foot, profile, ahead, behind, commands_at(ramp))
    moves = 0.0 if ramp.fall.falling else 1.0
    if c.fallen & FORWARD:
        e.ahead = 0.0
    elif e.upper < np.inf:
        e.upper = moves * _change_of(foot, ground, ahead, FORWARD, p)
    if c.fallen & BACKWARD:
        e.behind = 0.0
    elif e.lower > -np.inf:
        e.lower = -moves * _change_of(foot, ground, behind, BACKWARD, p)
