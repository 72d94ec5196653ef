"""Implicit steps on ground that changes gradually, and where friction changes with elongations.

The bounds are those at the end of the step. On the stretches of ground where it ends, and on the pieces of what springs
add, they are straight lines, so the step is solved as the rates of a block are, with the stiffness of the ground. Where
the solution leads a contact beyond its stretch, or a spring beyond its piece, it is solved anew with the next one.

Where the ground lets go faster than springs do, a body jumps, or has several motions: a step that is not `is_steady` is
not taken, and the ramp is followed from event to event instead.
"""

from __future__ import annotations

import numpy as np

from ....compiled import lean
from ....rounding import CRITICAL
from ..records import BACKWARD, FORWARD
from .borders import ROUNDING
from .bounds import hold, place_on_track
from .couplings import couplings_of, follow_couplings, is_coupled, more_on, pass_kinks, place_couplings, rest_couplings
from .gradual import change_at, holds, slopes_of, stiffness_of


@lean
def begin_stretches(contacts, ground, ramp):
    """Begin an implicit step with the stretches and pieces where the body is."""
    if ground is not None:
        _begin_stretches(contacts, ground, ground.profile, ramp)


@lean
def _begin_stretches(contacts, ground, profile, ramp):
    if profile is None:
        return
    for i in range(contacts.shape[0]):
        foot = ground.feet[i]
        foot.stretch, foot.met = foot.place // 2, contacts[i].bounds_met
    place_couplings(contacts, couplings_of(ground), ramp)


@lean
def return_to_start(contacts, ground, ramp):
    """Undo what an implicit step that is not taken has changed of bounds, and of which contacts are at them."""
    if ground is not None:
        for i in range(contacts.shape[0]):
            contacts[i].bounds_met = ground.feet[i].met
        place_couplings(contacts, couplings_of(ground), ramp)
        follow_couplings(contacts, couplings_of(ground), 0.0)
        rest_couplings(couplings_of(ground), 0.0)


@lean
def _stretches_of(foot):
    """Find the stretches that a contact slides onto forward and backward, up to where the step ends."""
    return max((foot.place + 1) // 2, foot.stretch), min(foot.place // 2, foot.stretch)


@lean
def enter_end(c, e, ground, ramp, i, pull):
    """Enter the limits of a contact in an implicit step, and the stiffness of the ground where it ends.

    A contact that is to end on another stretch slides there: it has one limit.

    Args:
        c: CONTACT i.
        e: its BLOCK.
        pull: force of the flat springs on it [N].
    """
    if ground is not None:
        _enter_end(c, e, ground.feet[i], ground, ground.profile, ramp, pull)


@lean
def _enter_end(c, e, foot, ground, profile, ramp, pull):
    if profile is None:
        return
    (ahead, behind), p, s = _stretches_of(foot), place_on_track(c, foot), ramp.fraction
    e.ahead, e.behind = slopes_of(foot, profile, ahead, behind, s)
    e.upper = hold(foot, ground, ahead, FORWARD, s, p) + more_on(foot, FORWARD, 0.0) - pull
    e.lower = -hold(foot, ground, behind, BACKWARD, s, p) - more_on(foot, BACKWARD, 0.0) - pull
    if 2 * ahead > foot.place + 1:
        e.lower = -np.inf
    elif 2 * behind < foot.place - 1:
        e.upper = np.inf


@lean
def is_steady(contacts, springs, model, ground, ramp, count):
    """Determine whether the solution of an implicit step is one that a body comes to without jumps.

    The stiffness of springs and ground together is positive where contacts slide. A step that completes a ramp is taken
    in any case.

    Returns:
        Whether it is.
    """
    if ground is None:
        return True
    return _is_steady(contacts, springs, model, ground, ground.profile, ramp, count)


@lean
def _is_steady(contacts, springs, model, ground, profile, ramp, count):
    if profile is None:
        return True
    if ramp.exact or not (holds(model.block, ground, count) or is_coupled(couplings_of(ground))):
        return True
    return _is_positive(contacts, springs, model, ground, couplings_of(ground), count)


@lean
def _is_positive(contacts, springs, model, ground, couplings, count):
    """Determine whether all pivots of a solved block are positive; with couplings, whether no stiffness is negative."""
    positive = True
    for j in range(count):
        e = model.block[j]
        c, size = contacts[e.contact], abs(stiffness_of(e, ground))
        for k in range(c.first, c.last):
            size += springs[model.ends[k].spring].stiffness
        if e.side != 0:
            positive &= e.ground > CRITICAL * size if couplings is None else stiffness_of(e, ground) >= 0.0
    return positive if couplings is None else positive and couplings.gentle[0]


@lean
def change_stretches(contacts, ground, ramp, one_only):
    """Find the stretches and pieces at the end of an implicit step that has been solved, each at most one further.

    Args:
        one_only: whether only one changes.

    Returns:
        Whether some have changed, so that the step has to be solved anew.
    """
    if ground is None:
        return False
    return _change_stretches(contacts, ground, ground.profile, ramp, one_only)


@lean
def _change_stretches(contacts, ground, profile, ramp, one_only):
    if profile is None:
        return False
    borders, near, changed = ground.borders, ROUNDING * ramp.span, False
    for i in range(contacts.shape[0]):
        if changed and one_only:
            break
        c, foot = contacts[i], ground.feet[i]
        ahead, behind = _stretches_of(foot)
        onward = 1 if c.side > 0 or 2 * ahead > foot.place + 1 else -1
        at, nearer, farther = (ahead, ahead - 1, ahead) if onward > 0 else (behind, behind, behind - 1)
        passed = at != ((foot.place + 1) // 2 if onward > 0 else foot.place // 2)
        p, way = foot.home + (c.x + (c.v + c.residue)), 0
        if passed and (c.side == 0 or onward * (p - borders[nearer]) < -near):
            way = -onward
        elif c.side != 0 and 0 <= farther < borders.shape[0] and onward * (p - borders[farther]) > near:
            way = onward
        if way != 0:
            foot.stretch, changed = at + way, True
    return pass_kinks(contacts, couplings_of(ground), changed, one_only)


@lean
def end_stretches(contacts, ground):
    """Let bounds and loads change along an implicit step from those where it begins to those where it ends."""
    if ground is not None:
        _end_stretches(contacts, ground, ground.profile)


@lean
def _end_stretches(contacts, ground, profile):
    if profile is None:
        return
    follow_couplings(contacts, couplings_of(ground), 0.0)
    for i in range(contacts.shape[0]):
        c, foot = contacts[i], ground.feet[i]
        ahead, behind = _stretches_of(foot)
        p = place_on_track(c, foot) + c.v
        stretch = ahead if c.v > 0.0 else behind
        c.d_forward = (hold(foot, ground, ahead, FORWARD, 1.0, p) + more_on(foot, FORWARD, 1.0)) - c.forward
        c.d_backward = (hold(foot, ground, behind, BACKWARD, 1.0, p) + more_on(foot, BACKWARD, 1.0)) - c.backward
        if c.v != 0.0:
            rise = ground.rise[stretch] + change_at(profile, FORWARD, stretch, p)[1]
            c.d_load = (foot.load + foot.d_load - foot.weight * rise) - c.load
            foot.place = 2 * stretch
