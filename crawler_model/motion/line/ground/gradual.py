"""Ground that changes gradually: on a gradient the bounds of a sliding contact change linearly with its place.

A contact that slides forward keeps its force at its forward bound F, so with its velocity v and dF/dp = h at its place

    force' = h v + what is commanded

as if one more spring of stiffness h joined it to the ground. h is negative where the ground holds less and less; the
sum of all stiffnesses need then not be positive, see `unstable`. A contact at rest has constant bounds. Rates stay
constant between events, of which the places of the profile are some: they are borders at which nothing jumps.
"""

from __future__ import annotations

from ....compiled import inlined, lean
from ..path import limit_of
from ..records import CATCH, FORWARD

NEUTRAL = 1e-9
"""Part of a stiffness below which the sum of that of the springs and of that of the ground is none: force and bound
change alike as the contact moves."""


@inlined
def change_at(profile, side, stretch, p):
    """Compute what a profile adds at a place to the factor and to the slope at the beginning of a stretch.

    Args:
        profile: as `body.ground.Track.profile`; None if the ground changes at borders alone.
        side: FORWARD or BACKWARD.
        stretch: number of the stretch.
        p: place on the track [m].

    Returns:
        What is added to the factor on friction, and to the sine of the slope.
    """
    if profile is None:
        return 0.0, 0.0
    away = p - profile[0, stretch]
    return profile[1 if side == FORWARD else 2, stretch] * away, profile[3, stretch] * away


@inlined
def profile_of(ground):
    """Find the profile of gradual ground.

    Returns:
        The profile; None without one.
    """
    return None if ground is None else ground.profile


@inlined
def is_given(part):
    """Determine whether there is a part of a body or its ground, as an argument of which numba knows that it is None.

    Args:
        part: a field of a `Model` or a `Terrain`.

    Returns:
        Whether there is.
    """
    return part is not None


@inlined
def is_gradual(ground):
    """Determine whether the ground changes gradually.

    Returns:
        Whether it does.
    """
    if ground is None:
        return False
    return is_given(ground.profile)


@inlined
def slopes_of(foot, profile, ahead, behind, s):
    """Compute how the force that keeps a contact at a bound grows with its displacement.

    Args:
        profile: as for `change_at`.
        ahead: stretch that the contact slides forward on.
        behind: stretch that it slides backward on.
        s: place on the ramp whose commands count.

    Returns:
        The growth at the forward and at the backward bound [N/m].
    """
    forward, backward, load = foot.forward + s * foot.d_forward, foot.backward + s * foot.d_backward, foot.load
    load += s * foot.d_load
    up = foot.weight * profile[3, ahead] + profile[1, ahead] * (forward + load)
    down = foot.weight * profile[3, behind] - profile[2, behind] * (backward - load)
    return up, down


@inlined
def commands_at(ramp):
    """Find the place on the ramp whose commands the stiffness of the ground follows from: where the chord leads.

    Returns:
        The place; 0 where friction is not commanded, or in a fall where commands rest.
    """
    if ramp.chords == 0.0:
        return 0.0
    return ramp.fall.rests if ramp.fall.falling else ramp.chord


@inlined
def stiffness_of(e, ground):
    """Return the stiffness of the ground under a sliding contact.

    Args:
        e: its BLOCK.

    Returns:
        The stiffness [N/m]; 0 on ground without a profile.
    """
    if ground is None:
        return 0.0
    return _stiffness_of(e, ground.profile)


@inlined
def _stiffness_of(e, profile):
    if profile is None:
        return 0.0
    return e.ahead if e.side > 0 else e.behind


@inlined
def force_of(e, ground):
    """Return the rate of the force on a sliding contact, which its bound has.

    Args:
        e: its BLOCK, with its velocity.

    Returns:
        The rate [N].
    """
    if ground is None:
        return limit_of(e)
    return _force_of(e, ground.profile)


@inlined
def _force_of(e, profile):
    if profile is None:
        return limit_of(e)
    return limit_of(e) + _stiffness_of(e, profile) * e.v


@inlined
def holds(block, ground, count):
    """Determine whether the ground determines the translation of a block all of whose contacts slide.

    Returns:
        Whether one of them slides on a gradient.
    """
    if ground is None:
        return False
    found = False
    for j in range(count):
        found |= block[j].side != 0 and _stiffness_of(block[j], ground.profile) != 0.0
    return found


@inlined
def find_catch(c, ground, ramp, when):
    """Find when the falling bound of a contact in a jump meets that of the ground at its place, if before `when`.

    Args:
        when: place of another event on the ramp.

    Returns:
        The place on the ramp, or `when`; `coming` is then CATCH.
    """
    if ground is None:
        return when
    return _find_catch(c, ground.profile, ramp, when)


@lean
def _find_catch(c, profile, ramp, when):
    if profile is None:
        return when
    if c.fallen == 0 or not ramp.fall.falling:
        return when
    falls = c.d_forward if c.fallen & FORWARD else c.d_backward
    change = falls - c.d_under
    excess = c.spare + c.since * change
    if not change < NEUTRAL * falls:  # both fall alike
        return when
    other = c.since + max(excess, 0.0) / -change
    if not other <= when or other >= ramp.end:
        return when
    c.coming = CATCH
    return other
