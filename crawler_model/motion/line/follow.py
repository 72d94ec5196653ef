"""Straight ramps to one target after another: exactly, or each by one implicit step."""

from __future__ import annotations

import numpy as np

from ...compiled import entry, inlined, lean
from ...errors import LARGEST
from ...rounding import EPS, MISSED
from .. import account as entries
from .advance import advance, advance_spring
from .block import leave_bounds, size_of_terms
from .clusters import wake_all
from .critical.interval import add_interval, begin_interval, begin_strays, follow_all_strays
from .critical.margin import find_margin
from .events import follow_events
from .ground.borders import ROUNDING
from .ground.chords import begin_chords
from .ground.couplings import couplings_of, rest_couplings
from .ground.gradual import is_gradual
from .ground.ramp_bounds import begin_bounds, finish_bounds, place_anew
from .ground.steps import return_to_start
from .ground.walls import blocked_sides, has_walls
from .records import BACKWARD, DONE, FORWARD, SPENT, UNSOLVED, Couplings, Model, Terrain
from .springs.bends import begin_bend, energy_of, finish_bend, leash_of
from .springs.records import Curves
from .springs.sliders import energy_remembered
from .springs.slides import slide
from .step import take_step

ENDS, FOLLOWS, STEPS = range(3)
"""How a ramp goes on after a part of it: not at all; from event to event; by one implicit step to its end."""

_BLUR = 1e-9
"""Part of the terms that a force or an energy is a sum of, by which they may be rounded."""


@inlined
def _begin_contacts(contacts, model, ramp, target, springs):
    """Begin the ramp of all contacts; returns whether bounds or loads change, or one has yet to fall."""
    n, bounds, changed = contacts.shape[0], target[springs:], False
    span = friction = d_friction = 0.0  # the fields of a record are stored and loaded again in each round
    for i in range(n):
        c = contacts[i]
        span = max(span, begin_bounds(c, model.ground, ramp, bounds, i, n))
        changed = changed or c.d_forward != 0.0 or c.d_backward != 0.0 or c.d_load != 0.0 or c.fallen != 0
        friction += c.forward + c.backward
        d_friction += c.d_forward + c.d_backward
        c.since = c.pull = c.force_rate = 0.0
        c.next = np.inf
        c.leaving = c.side = c.noted = 0
    ramp.span, ramp.friction, ramp.d_friction = span, friction, d_friction
    return changed


@lean
def _begin(contacts, springs, model, ramp, target):
    """Begin a ramp: what its commands change, and the rates if no contact moves; returns whether anything changes."""
    ramp.s, ramp.end, ramp.witness = 0.0, 1.0, 0
    ramp.begun = ramp.stepping = ramp.search.hurries = ramp.shifted = ramp.fall.falling = ramp.fall.due = (
        ramp.parted
    ) = 0
    ramp.search.undetermined = ramp.search.loose = ramp.passed = 0
    begin_strays(model.curves)
    changed = _begin_contacts(contacts, model, ramp, target, springs.shape[0])
    begin_chords(model.ground, ramp)
    span = ramp.span
    for j in range(springs.shape[0]):
        spring = springs[j]
        spring.d_length = target[j] - spring.length
        changed = changed or spring.d_length != 0.0
        span = max(span, abs(spring.length) + abs(spring.d_length))
        begin_bend(spring, model.curves, ramp)
        spring.rate = -spring.stiffness * spring.d_length
        spring.since = 0.0
        spring.moved = 0
        contacts[spring.a].pull += spring.rate
        contacts[spring.b].pull -= spring.rate
    ramp.span = span
    for i in range(contacts.shape[0]):
        c = contacts[i]
        if c.bounds_met == 0:
            c.v = 0.0
            c.force_rate = c.pull
    return changed


@inlined
def _finish_contacts(contacts, model, ramp, target, springs):
    """Advance contacts to the end of what was followed of the ramp, and set bounds and loads to their values there."""
    n, bounds = contacts.shape[0], target[springs:]
    rest_couplings(couplings_of(model.ground), ramp.s)
    for i in range(n):
        c = contacts[i]
        leave_bounds(c, ramp)
        advance(c, ramp, ramp.s)
        finish_bounds(c, model.ground, ramp, bounds, i, n)
        c.force = 0.0


@inlined
def _softest(springs, ends, c):
    """Find the largest compliance of the springs of a contact [m/N]."""
    most = 0.0
    for k in range(c.first, c.last):
        most = max(most, springs[ends[k].spring].compliance)
    return most


@inlined
def _finish_spring(contacts, springs, spring, model, ramp, length):
    """Advance a spring to the end of what was followed of the ramp; returns its energy.

    Its tension is integrated, and kept as near to the tension of its elongation as the rounding of displacements
    allows; for a stiff spring among soft ones, this is a difference of large numbers. The correction is an error of
    forces, which neighbouring soft springs turn into an error of displacements.
    """
    a, b = contacts[spring.a], contacts[spring.b]
    if not finish_bend(contacts, spring, model.curves, ramp, length):
        advance_spring(spring, model.curves, ramp, ramp.s)
        spring.length = length if ramp.s == 1.0 else spring.length + ramp.s * spring.d_length
        if spring.moved:
            z = (b.x - a.x) + (b.residue - a.residue)
            tension = spring.stiffness * (z - spring.length)
            leash = leash_of(contacts, spring, ramp)
            kept = min(max(spring.tension, tension - leash), tension + leash)
            if kept != spring.tension:
                softest = max(_softest(springs, model.ends, a), _softest(springs, model.ends, b))
                ramp.account.corrected = max(ramp.account.corrected, abs(kept - spring.tension) * softest)
                spring.tension = kept
            spring.elongation = z
            spring.still_tension, spring.still_length = spring.tension, spring.length
        else:
            spring.tension = spring.still_tension - spring.stiffness * (spring.length - spring.still_length)
    a.force += spring.tension
    b.force -= spring.tension
    return energy_of(spring, model.curves)


@inlined
def _certify(contacts, springs, model, ramp):
    """Update the largest violations of the bounds, and of the rule that what slides is at its bound.

    The displacement that would bring the worst force back onto its bound is an estimate of the rounding of positions;
    so is the displacement that the corrections of tensions lead to. A violation that no rounding explains is the error
    of a ramp that was not solved.
    """
    rounding, wrong, missed, total = ramp.account.corrected, 0.0, 0.0, 0.0
    for i in range(contacts.shape[0]):
        c = contacts[i]
        above, below, blocked = c.forward - c.force, c.backward + c.force, blocked_sides(model.ground, i)
        if blocked & FORWARD:
            above = np.inf
        if blocked & BACKWARD:
            below = np.inf
        excess, friction = -min(above, below), abs(c.forward) + abs(c.backward)
        total += friction
        if excess > 0.0:
            ramp.account.violation = max(ramp.account.violation, excess)
            rounding = max(rounding, excess * _softest(springs, model.ends, c))
            if excess > MISSED * friction:
                missed = max(missed, excess - _BLUR * size_of_terms(contacts, springs, model.ends, c))
        if c.v != 0.0:
            wrong = max(wrong, abs(c.v * (above if c.v > 0.0 else below)))
    ramp.account.complementarity = max(ramp.account.complementarity, wrong)
    ramp.account.rounding += rounding
    if ramp.exact and missed > _BLUR * total:
        ramp.account.unsolved = 1.0


@inlined
def _finish(contacts, springs, model, ramp, target):
    """Set the state to the end of what was followed of the ramp and complete its account; returns the energy stored."""
    wake_all(contacts, springs, model.clusters, ramp)
    _finish_contacts(contacts, model, ramp, target, springs.shape[0])
    stored = ramp.account.corrected = 0.0
    for j in range(springs.shape[0]):
        stored += _finish_spring(contacts, springs, springs[j], model, ramp, target[j])
    _certify(contacts, springs, model, ramp)
    own = ramp.account
    if ramp.s == 1.0 and (model.ground is None or ramp.stepping or contacts.shape[0] > ramp.few):
        own.visited = min(own.visited, find_margin(contacts, springs, model, model.curves, ramp, 1.0))
    own.residual = (stored - ramp.stored) + (own.dissipation + own.internal) - own.work
    return stored


@lean
def _continue(contacts, springs, model, ground, ramp, outcome):
    """Decide how a ramp goes on after a part of it.

    A part that spends the budget, or finds no rates, is completed by an implicit step; contacts that have passed
    borders in it fall from there. Between walls, a new budget follows one that is spent.

    Returns:
        ENDS, FOLLOWS or STEPS.
    """
    stepped, ramp.stepping = ramp.stepping, 0
    if outcome == DONE:
        if ground is None or not stepped:
            return ENDS
        if not place_anew(contacts, ground, ramp):
            return ENDS
        ramp.effort, ramp.done = 0, 1.0
        return FOLLOWS
    ramp.done += ramp.s * (1.0 - ramp.done)
    ramp.s = 0.0
    ramp.effort += contacts.shape[0]
    if outcome == UNSOLVED and slide(contacts, springs, model, ground, model.curves, ramp):
        return FOLLOWS
    if ramp.fall.runaway != 0:
        return ENDS
    if outcome == SPENT:
        ramp.account.overspent = 1.0
        if has_walls(ground) or is_gradual(ground):  # an implicit step would lead contacts through walls and slopes
            ramp.effort = 0
            return FOLLOWS
    else:
        ramp.account.unsolved = 1.0
    return STEPS


@lean
def _judge_balance(contacts, springs, ramp, stored):
    """Count a ramp as not solved if its energies do not balance, although no implicit step completed it."""
    own = ramp.account
    missed = abs(own.residual)
    energies = abs(stored) + abs(ramp.stored) + abs(own.dissipation) + own.internal + abs(own.work)
    if not ramp.exact or own.overspent or missed <= MISSED * energies:
        return
    for j in range(springs.shape[0]):
        missed -= _BLUR * ramp.span * (abs(springs[j].tension) + EPS * springs[j].stiffness * ramp.span)
    for i in range(contacts.shape[0]):
        missed -= _BLUR * ramp.span * max(min(contacts[i].forward, contacts[i].backward), 0.0)
    if missed > 0.0:
        own.unsolved = 1.0


@lean
def _follow_ramp(contacts, springs, model, ramp, target):
    """Follow a ramp that has begun, in parts if need be; returns the energy stored at its end."""
    exact, how = ramp.exact, FOLLOWS if ramp.exact else STEPS
    while True:
        outcome = DONE
        if how == STEPS and not take_step(contacts, springs, model, ramp):
            if ramp.exact or not is_gradual(model.ground):
                ramp.account.unsolved = 1.0
            else:  # it may jump, or have several motions
                return_to_start(contacts, model.ground, ramp)
                _begin(contacts, springs, model, ramp, target)
                ramp.exact, how = 1, FOLLOWS
        if how == FOLLOWS:
            outcome = follow_events(contacts, springs, model, ramp)
            follow_all_strays(contacts, springs, model.curves, ramp, ramp.s)
        stored = _finish(contacts, springs, model, ramp, target)
        how = _continue(contacts, springs, model, model.ground, ramp, outcome)
        if how == ENDS or not _begin(contacts, springs, model, ramp, target):
            _judge_balance(contacts, springs, ramp, stored)
            ramp.exact = exact
            return stored


@inlined
def _record(contacts, springs, curves, account, row):
    """Write displacements, their rounding rests and tensions to a row of the records, and what was spent."""
    n, count = contacts.shape[0], springs.shape[0]
    for i in range(n):
        row[i], row[n + i] = contacts[i].x, contacts[i].residue
    for j in range(count):
        row[2 * n + j] = springs[j].tension
    if row.shape[0] > 2 * n + count:
        entries.record_spent(account, row)
        _record_remembered(springs, curves, row)


@lean
def _record_remembered(springs, curves, row):
    """Write the energy stored in sliders to its place at the end of a row of the records."""
    if curves is None:
        return
    row[row.shape[0] - entries.SPENT] = energy_remembered(springs, curves.bends, curves.sliders)


@inlined
def _begin_account(ramp):
    """Empty the account of the ramp."""
    own = ramp.account
    own.work = own.dissipation = own.internal = own.loads_work = own.residual = own.rounding = 0.0
    own.violation = own.complementarity = own.ambiguous = own.gain_least = own.gain_most = 0.0
    own.overspent = own.unsolved = ramp.fall.lost = 0.0
    own.visited = np.inf
    own.events = 0.0 if ramp.exact else 1.0


@inlined
def _add_ramp(account, ramp):
    """Add the account of the ramp to the total; what is lost in jumps is not lost to friction."""
    own = ramp.account
    account[entries.WORK] += own.work
    account[entries.DISSIPATION] += own.dissipation - ramp.fall.lost
    account[entries.LOADS_WORK] += own.loads_work
    account[entries.INTERNAL] += own.internal
    account[entries.RESIDUAL] += own.residual
    account[entries.EVENTS] += own.events
    account[entries.GAIN_LEAST] += own.gain_least
    account[entries.GAIN_MOST] += own.gain_most
    account[entries.OVERSPENT] += own.overspent
    account[entries.UNSOLVED] += own.unsolved
    account[entries.ROUNDING] += own.rounding
    account[entries.VIOLATION] = max(account[entries.VIOLATION], own.violation)
    account[entries.COMPLEMENTARITY] = max(account[entries.COMPLEMENTARITY], own.complementarity)
    account[entries.AMBIGUOUS] = max(account[entries.AMBIGUOUS], own.ambiguous, own.unsolved)
    account[entries.VISITED] = min(account[entries.VISITED], own.visited)


@lean
def _build_terrain(ground):
    """Name the parts of the ground; None without patches."""
    if ground is None:
        return None
    feet, jumps, drawn, nodes, walls, borders, grip, pressed, rise, profile, couplings = ground
    couplings = _build_couplings(couplings, feet)
    return Terrain(feet, jumps, drawn, nodes, walls, borders, grip, pressed, rise, profile, couplings)


@lean
def _build_couplings(couplings, feet):
    """Name the parts of the couplings; None without any."""
    if couplings is None:
        return None
    return Couplings(couplings[0], couplings[1], couplings[2], couplings[3], feet)


@lean
def _build_curves(curves):
    """Name the parts of the curves; None without bent springs."""
    if curves is None:
        return None
    bends, pieces, strays, members, sliders = curves
    return Curves(bends, pieces, strays, members, sliders)


@lean
def _forget_rounding(contacts, ramp):
    """Let contacts that have gained no more than the rounding of positions count as not having slid."""
    for i in range(contacts.shape[0]):
        if abs(contacts[i].gained) <= ROUNDING * ramp.span:
            contacts[i].gained = 0.0


@entry
def follow(contacts, springs, ramps, memory, targets, account, records):
    """Follow straight ramps to each of the targets in turn.

    Args:
        contacts: CONTACT, shape (N,), changed in place.
        springs: SPRING, shape (S,), changed in place.
        ramps: RAMP, memory with the budget and the method, shape (1,).
        memory: the fields of a `Model`.
        targets: L, bounds and, with loads, these at each ramp's end, shape (V, S + 2 N) or (V, S + 3 N).
        account: total account, shape (15,), added to; or shape (15 + N,), for a command that nobody has checked: its
            displacement gained follows the account.
        records: output: displacement, its rest and tension after each ramp, shape (V, 2 N + S), or no rows.

    Returns:
        0, or the direction in which nothing holds the body or a part of it, 1 or -1; it has then stopped. 2 if a length
        is not finite or too large; then nothing has changed.
    """
    checked = account.shape[0] == entries.ACCOUNT_SIZE
    if not checked:
        for j in range(springs.shape[0]):
            if not abs(targets[0, j]) <= LARGEST:
                return 2
    ends, block, listed, matrix, breaks, pieces, ground, clusters, curves = memory
    ground, curves = _build_terrain(ground), _build_curves(curves)
    model = Model(ends, block, listed, matrix, breaks, pieces, ground, clusters, curves)
    ramp = ramps[0]
    ramp.stored = 0.0
    ramp.fall.jumps = ramp.fall.runaway = ramp.search.block = 0
    ramp.span = 0.0
    begin_interval(model.curves, ramp)
    for i in range(contacts.shape[0]):
        contacts[i].gained = 0.0
        contacts[i].mark = 0
    for j in range(springs.shape[0]):
        ramp.stored += energy_of(springs[j], model.curves)
    for v in range(targets.shape[0]):
        target = targets[v]
        if _begin(contacts, springs, model, ramp, target):
            ramp.effort, ramp.number, ramp.done, ramp.slides = 0, v, 0.0, 0
            _begin_account(ramp)
            ramp.stored = _follow_ramp(contacts, springs, model, ramp, target)
            if ramp.fall.runaway != 0:
                return ramp.fall.runaway
            _add_ramp(account, ramp)
        if records.shape[0] > 0:
            _record(contacts, springs, curves, account, records[v])
    _forget_rounding(contacts, ramp)
    add_interval(contacts, model.curves, ramp, account)
    if account[entries.VISITED] == np.inf:  # no command changed
        account[entries.VISITED] = find_margin(contacts, springs, model, model.curves, ramp, contacts[0].since)
    if not checked:
        for i in range(contacts.shape[0]):
            account[entries.ACCOUNT_SIZE + i] = contacts[i].gained
    return 0
