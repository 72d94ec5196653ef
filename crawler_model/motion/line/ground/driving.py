"""Large blocks on ground that holds less and less: rates as a function of the velocity of one contact.

Where a block has too many sides to try all, it is mostly stable as soon as one of its contacts is held, or led at a
given velocity: pivoting then finds the others. What is left is one number, the velocity at which the force on that
contact meets its bound, by Newton's method on a piecewise linear function.
"""

from __future__ import annotations

from ....compiled import lean
from ..mesh import solve_mesh
from ..pivot import find_sides, meets_conditions
from .chords import is_long
from .couplings import couplings_of, exchange_pieces, keep_limits, restore_limits
from .unstable import tries_all, turns_unstable

_MOST_TURNS = 20
STIFF = 1e6
"""Stiffness, in terms of those of its springs, of what leads a contact at a velocity."""


@lean
def drive(contacts, springs, model, ground, ramp, count):
    """Find the rates in a block without the contacts that are held or led in turn.

    Returns:
        Whether rates were found.
    """
    if ground is None:
        return False
    return _drive(contacts, springs, model, ground, ground.profile, ramp, count)


@lean
def _drive(contacts, springs, model, ground, profile, ramp, count):
    if profile is None:
        return False
    if ramp.stepping or ramp.search.loose != 0 or ramp.search.woken or tries_all(ground, model.block, count):
        return False
    if is_long(ground, ramp) and turns_unstable(contacts, springs, model, ground, ramp, count):
        return False
    for row in range(count):
        if ramp.effort > ramp.budget:
            return False
        if _drive_one(contacts, springs, model, ground, ramp, count, row):
            return True
    return False


@lean
def _drive_one(contacts, springs, model, ground, ramp, count, row):
    """Find the rates in a block by holding one contact, or by leading it; returns whether they were found."""
    couplings, e = couplings_of(ground), model.block[row]
    restore_limits(couplings, model.block, count)
    c, upper, lower, ahead, behind, stiffness = contacts[e.contact], e.upper, e.lower, e.ahead, e.behind, 0.0
    for k in range(c.first, c.last):
        stiffness += springs[model.ends[k].spring].stiffness
    for j in range(count):
        model.block[j].side = 0
    side, velocity, found = 0, 0.0, False
    for turn in range(_MOST_TURNS):
        e.ahead = e.behind = STIFF * stiffness
        e.upper = e.lower = -e.ahead * velocity
        held = find_sides(contacts, springs, model, ramp, count)
        restore_limits(couplings, model.block, count)
        e.upper, e.lower, e.ahead, e.behind = upper, lower, ahead, behind
        keep_limits(couplings, model.block, count)
        if not held:
            break
        if turn == 0:
            side = 1 if e.force > upper else (-1 if e.force < lower else 0)
        e.side = side
        solve_mesh(contacts, springs, model, model.matrix, ramp, count)
        if meets_conditions(model.block, count) and exchange_pieces(couplings, False) == 0:
            found = True
            break
        velocity = e.v
        if velocity * side <= 0.0:
            break
    return found
