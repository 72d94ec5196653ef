"""Contacts that turn round, or begin to slide, within a chord of a curved path, see `chords`.

The velocities at the ends of a chord follow from the same matrices as those along chords: at its beginning that of the
commands there, at its end that of the chord, with rates of the bounds at the places to which it leads.
"""

from __future__ import annotations

from ....compiled import inlined
from ..mesh import solve_mesh
from .bounds import enter_ground
from .chords import cut_chord, is_long
from .couplings import couplings_of, keep_limits
from .gradual import holds

_SLOW = 1e-8
"""Part of the largest velocity of a block below which a contact stands: its way to there is less than rounding."""


@inlined
def enter_chord(contacts, block, ground, ramp, count, ds):
    """Enter stiffness and limits anew in all rows of a block: at the present chord, and at places further on.

    Args:
        ds: how far the contacts have moved on at their velocities.
    """
    for j in range(count):
        e = block[j]
        enter_ground(contacts[e.contact], e, ground, ramp, e.contact, ds * e.v)
    keep_limits(couplings_of(ground), block, count)


@inlined
def turns(contacts, springs, model, ground, ramp, count):
    """Shorten the chord to where a contact of a solved block turns round, or if one slides only at its beginning.

    Returns:
        Whether it has been shortened.
    """
    if ground is None:
        return False
    return _turns(contacts, springs, model, ground, ground.profile, ramp, count)


@inlined
def _turns(contacts, springs, model, ground, profile, ramp, count):
    if profile is None:
        return False
    if not is_long(ground, ramp) or not holds(model.block, ground, count):
        return False
    chord, until = ramp.chord, ramp.chord
    most = 0.0
    for j in range(count):
        e = model.block[j]
        e.before = e.v
        most = max(most, abs(e.v))
    # at its end
    enter_chord(contacts, model.block, ground, ramp, count, chord - ramp.s)
    solve_mesh(contacts, springs, model, model.matrix, ramp, count)
    for j in range(count):
        e = model.block[j]
        if e.v * e.side < -_SLOW * most:
            until = min(until, ramp.s + 0.5 * (chord - ramp.s) * (1.0 + e.before / (e.before - e.v)))
    # at its beginning
    ramp.chord = ramp.s
    enter_chord(contacts, model.block, ground, ramp, count, 0.0)
    solve_mesh(contacts, springs, model, model.matrix, ramp, count)
    for j in range(count):
        e = model.block[j]
        near = _SLOW * (e.scale + e.blur)
        if e.v * e.side < -_SLOW * most or (e.side == 0 and not e.lower - near <= e.force <= e.upper + near):
            until = min(until, 0.5 * (ramp.s + chord))
    ramp.chord = chord
    enter_chord(contacts, model.block, ground, ramp, count, 0.0)
    solve_mesh(contacts, springs, model, model.matrix, ramp, count)
    return cut_chord(ramp, until)
