"""Blocks on ground that holds less and less, where rates need not exist, and need not be the only ones.

With K the stiffness of the springs and H that of the ground, the sides of a block are a linear complementarity problem
of K + H, which is symmetric. As long as it is positive definite on all contacts at bounds there is one solution, which
principal pivoting finds. Else all sides are tried: none that fits is the beginning of a jump, several are different
paths.
"""

from __future__ import annotations

import numpy as np

from ....compiled import inlined, lean
from ....rounding import CRITICAL, EPS
from ..advance import place_of
from ..mesh import eliminate, solve_mesh
from ..records import BACKWARD, FORWARD
from .chords import is_curved, is_long
from .couplings import choose_pieces, exchange_pieces, is_coupled, is_dominant
from .gradual import is_gradual, stiffness_of
from .turns import enter_chord
from .walls import blocked_sides

_ROUNDING = 32.0 * EPS
_MOST_TRIALS = 2048
"""Combinations of sides that are tried; with more, pivoting may find one of several solutions, or none."""
_INSTANT = 64.0 * EPS
"""Part of a ramp within which events come at one instant: their places are quotients of a few rounded numbers."""
_CLOSE = 8.0 * EPS
"""Part of the forces on a contact within which it is at its bound."""
_FAR = 1e-3
"""Part of the friction and the load beyond which a contact is not at its bound, unless rounding of the tensions of its
springs is as large."""


@inlined
def end_of_instant(ground, ramp):
    """Find up to where on the ramp events are met together with that at s.

    Where several contacts come to their bounds or to borders at once, there may be several motions, of which rounding
    would choose one if it decided which of them comes first.

    Returns:
        The place; s on ground that leaves one motion, and along chords.
    """
    if is_gradual(ground) and not is_curved(ground, ramp):
        return min(ramp.s + _INSTANT, ramp.end)
    return ramp.s


@inlined
def meet_close_bounds(contacts, springs, model, ground, ramp, i):
    """Let a contact meet a bound that the force on it is at but for rounding, as where the ramp before has ended."""
    if is_gradual(ground) and not is_curved(ground, ramp) and contacts[i].bounds_met == 0:
        _meet_close_bounds(contacts, springs, model, ground, ramp, i)


@lean
def _meet_close_bounds(contacts, springs, model, ground, ramp, i):
    c, s = contacts[i], place_of(contacts[i], ramp)
    forward, backward = c.forward + s * c.d_forward, c.backward + s * c.d_backward
    size = abs(c.forward) + abs(c.backward) + abs(c.load)
    if min(forward - c.force, backward + c.force) > _FAR * size:
        return
    blocked = blocked_sides(ground, i)
    for k in range(c.first, c.last):
        size += abs(springs[model.ends[k].spring].tension)
    if forward - c.force <= _CLOSE * size and not blocked & FORWARD:
        c.bounds_met |= FORWARD
    if backward + c.force <= _CLOSE * size and not blocked & BACKWARD:
        c.bounds_met |= BACKWARD


@inlined
def is_stable(contacts, springs, model, ground, ramp, count):
    """Determine whether a block has one solution whatever its loads are: whether K + H is positive definite on it.

    Returns:
        Whether it is.
    """
    if ground is None:
        return True
    if is_coupled(ground.couplings) and not ramp.stepping:
        return is_dominant(ground.couplings, model.block, count)
    return _is_stable(contacts, springs, model, ground.profile, ramp, count)


@inlined
def _bound_compliance(block, ramp, count):
    """Find a compliance that is at least the displacement of any contact of a block by a force on it.

    Returns:
        That of all springs of a path that something holds; infinite for other blocks [m/N].
    """
    if ramp.search.path == 0 or not ramp.search.anchored:
        return np.inf
    compliance = 0.0
    for j in range(count + 1):
        compliance += block[j].compliance
    return compliance


@inlined
def _is_stable(contacts, springs, model, profile, ramp, count):
    if profile is None:
        return True
    if ramp.stepping:
        return True
    block, falls, compliance = model.block, 0.0, _bound_compliance(model.block, ramp, count)
    for j in range(count):
        e = block[j]
        e.tried = e.side
        up = e.ahead if e.upper < np.inf else np.inf
        down = e.behind if e.lower > -np.inf else np.inf
        falls -= min(up, down, 0.0)
        e.side = 1 if up <= down else -1
    stable = True
    if falls > 0.0 and falls * compliance >= 0.5:
        eliminate(contacts, springs, model, model.matrix, count)
        for j in range(count):
            c, size = contacts[block[j].contact], abs(stiffness_of(block[j], model.ground))
            for k in range(c.first, c.last):
                size += springs[model.ends[k].spring].stiffness
            stable &= block[j].ground > CRITICAL * size
    for j in range(count):
        block[j].side = block[j].tried
    ramp.effort += count
    return stable


@inlined
def turns_unstable(contacts, springs, model, ground, ramp, count):
    """Determine whether a block that is not stable at the end of a chord is stable where the chord begins.

    Returns:
        Whether it is.
    """
    if ground is None:
        return False
    return _turns_unstable(contacts, springs, model, ground, ground.profile, ramp, count)


@inlined
def _turns_unstable(contacts, springs, model, ground, profile, ramp, count):
    if profile is None:
        return False
    if not is_long(ground, ramp):
        return False
    chord, ramp.chord = ramp.chord, ramp.s
    enter_chord(contacts, model.block, ground, ramp, count, 0.0)
    stable = is_stable(contacts, springs, model, ground, ramp, count)
    ramp.chord = chord
    enter_chord(contacts, model.block, ground, ramp, count, 0.0)
    return stable


@inlined
def _fits(e):
    """Determine whether a contact fulfils its condition; that of one at rest, within the rounding of its springs."""
    if e.side != 0:
        return e.v * e.side > 0.0
    close = _ROUNDING * (e.scale + e.blur)
    return e.lower - close <= e.force <= e.upper + close


@lean
def _next_side(e):
    """Change the side of a contact to the next one: rest, forward, backward, then rest again; returns whether it is."""
    if e.side == 0 and e.upper < np.inf:
        e.side = 1
    elif e.side >= 0 and e.lower > -np.inf:
        e.side = -1
    else:
        e.side = 0
    return e.side == 0


@inlined
def tries_all(ground, block, count):
    """Determine whether a block has so few sides that all are tried.

    Returns:
        Whether it has.
    """
    if ground is None:
        return True
    trials = float(choose_pieces(ground.couplings, 0))
    for j in range(count):
        e = block[j]
        trials *= 1.0 + (e.upper < np.inf) + (e.lower > -np.inf)
    return trials <= _MOST_TRIALS


@lean
def search_sides(contacts, springs, model, ground, ramp, count):
    """Try all sides of a block that is not stable; the solution in which the first contacts rest is taken.

    Returns:
        How many solutions there are, of which that is one; -1 if there are too many sides to try.
    """
    if ground is None:
        return -1
    block, found, choice, chosen = model.block, 0, 0, 0
    choices = choose_pieces(ground.couplings, 0)
    if not tries_all(ground, block, count):
        ramp.account.ambiguous = 1.0
        return -1
    for j in range(count):
        block[j].side = 0
    while choice < choices:
        ramp.effort += count
        fits = solve_mesh(contacts, springs, model, model.matrix, ramp, count)
        fits &= exchange_pieces(ground.couplings, False) == 0
        for j in range(count):
            fits &= _fits(block[j])
        if fits:
            found += 1
            for j in range(count):
                if found == 1:
                    block[j].tried, chosen = block[j].side, choice
        row = count - 1
        while row >= 0 and _next_side(block[row]):
            row -= 1
        if row < 0:
            choice += 1
            choose_pieces(ground.couplings, choice)
    if found > 1:
        ramp.account.ambiguous = 1.0
    if found > 0:
        for j in range(count):
            block[j].side = block[j].tried
        choose_pieces(ground.couplings, chosen)
        solve_mesh(contacts, springs, model, model.matrix, ramp, count)
    return found
