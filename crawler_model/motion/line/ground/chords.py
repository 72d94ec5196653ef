"""Friction that is commanded where its factor changes with place: bounds that are products of two straight lines.

With the friction f(s) that is commanded, a contact that slides over a gradient has the bound f(s) c(p): its path is
curved. Where it leads is known nevertheless. As long as the same contacts slide, equilibrium depends on where commands
and contacts are, and not on the way between. With the gradient at the end of a *chord*, a piece of the ramp, the bound

    f(s) c(p0) + f(end) c' (p - p0)

is a straight line that leads to the bound at the end of the chord, where it is f(end) c(p). So rates are constant
along a chord, and exact at its end. A chord that is longer than the way to the next event is shortened to that event
until both agree to rounding, which is the secant method.

A chord is shortened likewise to where a contact turns round (`turns`). Work and dissipation are those along chords,
which `LONGEST` bounds: their relative error is 7e-6 where friction doubles in one ramp, and less in shorter ones.
"""

from __future__ import annotations

from ....compiled import inlined, lean
from ....rounding import CRITICAL, EPS
from .gradual import is_gradual

LONGEST = 1.0 / 64.0
"""Part of itself by which commanded friction changes along a chord at most."""
_GROWTH = 4.0
_SHORTEST = 2.0**-40
"""A chord of this part of the ramp is a tangent."""


@lean
def begin_chords(ground, ramp):
    """Find into how many chords a ramp is divided at least, from what it commands: none where no bound is curved."""
    if ground is not None:
        _begin_chords(ground.feet, ground.profile, ramp)


@lean
def _begin_chords(feet, profile, ramp):
    ramp.chord = ramp.chords = 0.0
    ramp.cut, ramp.stride = 0, 1.0
    if profile is None:
        return
    most = 0.0
    for i in range(feet.shape[0]):
        f = feet[i]
        if f.d_forward == 0.0 and f.d_backward == 0.0 and f.d_load == 0.0:
            continue
        for friction, change in (
            (f.forward + f.load, f.d_forward + f.d_load),
            (f.backward - f.load, f.d_backward - f.d_load),
        ):
            size = abs(f.forward) + abs(f.backward) + abs(f.load) + abs(f.d_load)
            if abs(change) > CRITICAL * size:
                most = max(most, abs(change) / max(friction, friction + change))
    if most > 0.0 and _has_gradient(profile):
        ramp.chords = max(most / LONGEST, 1.0)


@lean
def _has_gradient(profile):
    """Determine whether factors on friction change along a stretch."""
    found = False
    for stretch in range(profile.shape[1]):
        found |= profile[1, stretch] != 0.0 or profile[2, stretch] != 0.0
    return found


@inlined
def is_curved(ground, ramp):
    """Determine whether bounds are curved at the present place on the ramp.

    Returns:
        Whether they are; never in a fall, where commands rest.
    """
    return is_gradual(ground) and ramp.chords > 0.0 and not ramp.fall.falling


@inlined
def begin_chord(ground, ramp):
    """Begin a chord at s, as long as it may be."""
    if is_curved(ground, ramp):
        ramp.chord = min(ramp.s + min(1.0 / ramp.chords, ramp.stride), 1.0)


@lean
def end_chord(ground, ramp, s):
    """Find where a chord ends: at its end, or at an event with which it ends.

    After a chord without an event the next one is at most a few times as long: where a force grazes its bound, a longer
    one would again be shortened to no length.

    Args:
        s: place of the next event.

    Returns:
        The place; that of the event where no bound is curved.
    """
    if not is_curved(ground, ramp):
        return s
    ramp.stride = 1.0 if s <= ramp.chord else _GROWTH * (ramp.chord - ramp.s)
    return min(s, ramp.chord)


@lean
def meets_chord(ground, ramp, s):
    """Shorten the chord to an event at s, unless it leads to it already, or no further.

    Returns:
        Whether it has been shortened, so that rates have to be found anew.
    """
    if not is_curved(ground, ramp):
        return False
    if ramp.chord - s <= 2.0 * EPS or s - ramp.s <= 2.0 * EPS:
        return False
    ramp.chord = s
    return True


@inlined
def is_long(ground, ramp):
    """Determine whether a chord differs from the tangent, whose rates decide whether there are any.

    Returns:
        Whether it does.
    """
    return is_curved(ground, ramp) and not ramp.stepping and ramp.chord - ramp.s > _SHORTEST


@lean
def cut_chord(ramp, until):
    """Shorten the chord, and note that it has been.

    Args:
        until: where it is to end.

    Returns:
        Whether that is before where it ends.
    """
    if ramp.chord - until <= 2.0 * EPS:
        return False
    ramp.chord, ramp.cut = until, 1
    return True


@lean
def halve_chord(ground, ramp):
    """Halve a chord along which no rates exist, unless it has just been shortened.

    Returns:
        Whether the chord is another one; not if it is the tangent.
    """
    if ramp.cut:
        ramp.cut = 0
        return True
    if ramp.search.loose != 0 or not is_long(ground, ramp):
        return False
    ramp.chord = ramp.s + 0.5 * (ramp.chord - ramp.s)
    return True
