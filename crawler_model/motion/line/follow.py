"""Straight ramps to one target after another: exactly, or each by one implicit step."""

from __future__ import annotations

import numpy as np

from ...compiled import lean
from ...rounding import EPS
from ..pieces import begin_ramp
from ..state import (
    COMPLEMENTARITY,
    DISSIPATION,
    EVENTS,
    OVERSPENT,
    RESIDUAL,
    VIOLATION,
    VISITED,
    WORK,
    add_ramp,
    record_spent,
)
from ..state import (
    UNSOLVED as NOT_SOLVED,
)
from .advance import advance, advance_spring
from .block import settle
from .events import follow_events, solve_around
from .ground import gather_falls
from .jumps import begin_on_ground, find_runaway, finish_on_ground, place_anew, slide_to_border
from .records import BACKWARD, DONE, FORWARD, JUMPS, SPENT, UNSOLVED
from .translation import choose_step

ENDS, FOLLOWS, STEPS = range(3)
"""How a ramp goes on after a part of it: not at all; from event to event; by one implicit step to its end."""


@lean
def _begin_bounds(contacts, ground, ramp, target, springs):
    """Begin the ramp of bounds and loads; returns whether they change."""
    if ground is not None:
        return begin_on_ground(contacts, ground, ramp, target, springs)
    n = contacts.shape[0]
    loaded = target.shape[0] > springs + 2 * n
    changed = False
    for i in range(n):
        c = contacts[i]
        c.d_forward = target[springs + i] - c.forward
        c.d_backward = target[springs + n + i] - c.backward
        c.d_load = target[springs + 2 * n + i] - c.load if loaded else 0.0
        changed = changed or c.d_forward != 0.0 or c.d_backward != 0.0 or c.d_load != 0.0
    return changed


@lean
def _begin_contacts(contacts, model, ramp, target, springs):
    """Begin the ramp of all contacts; returns whether bounds or loads change."""
    changed = _begin_bounds(contacts, model.ground, ramp, target, springs)
    ramp.friction = ramp.d_friction = 0.0
    for i in range(contacts.shape[0]):
        c = contacts[i]
        ramp.friction += c.forward + c.backward
        ramp.d_friction += c.d_forward + c.d_backward
        c.since = c.pull = c.force_rate = 0.0
        c.next = np.inf
        c.leaving = c.side = 0
    return changed


@lean
def _begin(contacts, springs, model, ramp, target):
    """Begin a ramp: the changes of the commands, and the rates if no contact moves; returns whether commands change."""
    changed = _begin_contacts(contacts, model, ramp, target, springs.shape[0])
    for j in range(springs.shape[0]):
        spring = springs[j]
        spring.d_length = 0.0 if ramp.falling else target[j] - spring.length
        changed = changed or spring.d_length != 0.0
        spring.rate = -spring.stiffness * spring.d_length
        spring.since = 0.0
        spring.moved = 0
        contacts[spring.a].pull += spring.rate
        contacts[spring.b].pull -= spring.rate
        ramp.span = max(ramp.span, abs(spring.length) + abs(spring.d_length))
    for i in range(contacts.shape[0]):
        c = contacts[i]
        if c.at == 0:
            c.v = 0.0
            c.force_rate = c.pull
    ramp.s = 0.0
    ramp.begun = ramp.stepping = ramp.shifted = ramp.undetermined = ramp.jumping = 0
    return changed


@lean
def _finish_contacts(contacts, model, ramp, target, springs):
    """Advance contacts to the end of what was followed of the ramp, and set their bounds to those there."""
    for i in range(contacts.shape[0]):
        c = contacts[i]
        settle(c, ramp.s)
        advance(c, model.account, ramp.s)
    _finish_bounds(contacts, model.ground, ramp, target, springs)
    for i in range(contacts.shape[0]):
        contacts[i].force = 0.0


@lean
def _finish_bounds(contacts, ground, ramp, target, springs):
    """Set bounds and loads to those at the end of what was followed of the ramp."""
    n, s = contacts.shape[0], ramp.s
    loaded = target.shape[0] > springs + 2 * n
    for i in range(n):
        c = contacts[i]
        if ground is not None:
            finish_on_ground(c, ground, ramp, target[springs:], i)
        elif s == 1.0:
            c.forward, c.backward = target[springs + i], target[springs + n + i]
            c.load = target[springs + 2 * n + i] if loaded else 0.0
        else:
            c.forward += s * c.d_forward
            c.backward += s * c.d_backward
            c.load += s * c.d_load


@lean
def _finish_spring(contacts, spring, model, ramp, length):
    """Advance a spring to the end of what was followed of the ramp; returns its energy.

    Its tension is integrated, and kept as near to that of its elongation as the rounding of displacements allows.
    """
    advance_spring(spring, model.account, ramp.s)
    a, b = contacts[spring.a], contacts[spring.b]
    at_target = ramp.s == 1.0 and not ramp.falling
    spring.length = length if at_target else spring.length + ramp.s * spring.d_length
    if spring.moved:
        z = (b.x - a.x) + (b.rest - a.rest)
        tension = spring.stiffness * (z - spring.length)
        leash = 4.0 * EPS * spring.stiffness * (abs(a.x) + abs(b.x) + abs(spring.length))
        spring.tension = min(max(spring.tension, tension - leash), tension + leash)
        spring.elongation = z
        spring.still_tension, spring.still_length = spring.tension, spring.length
    else:
        spring.tension = spring.still_tension - spring.stiffness * (spring.length - spring.still_length)
    a.force += spring.tension
    b.force -= spring.tension
    return 0.5 * spring.tension * spring.tension * spring.compliance


@lean
def _visit(contacts, account):
    """Update the visited margin by the present state."""
    near = total = 0.0
    for i in range(contacts.shape[0]):
        c = contacts[i]
        near += max(min(c.forward - c.force, c.backward + c.force), 0.0)
        total += c.forward + c.backward
    account[VISITED] = min(account[VISITED], near / total if total > 0.0 else 0.0)


@lean
def _certify(contacts, account):
    """Update the largest violations of the bounds, and of the rule that what slides is at its bound."""
    for i in range(contacts.shape[0]):
        c = contacts[i]
        above, below = c.forward - c.force, c.backward + c.force
        account[VIOLATION] = max(account[VIOLATION], -min(above, below))
        if c.v != 0.0:
            account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], abs(c.v * (above if c.v > 0.0 else below)))


@lean
def _finish(contacts, springs, model, ramp, target):
    """Set the state to the end of what was followed of the ramp and complete its account; returns the energy stored."""
    account = model.account
    _finish_contacts(contacts, model, ramp, target, springs.shape[0])
    stored = 0.0
    for j in range(springs.shape[0]):
        stored += _finish_spring(contacts, springs[j], model, ramp, target[j])
    _certify(contacts, account)
    if not ramp.jumping and (ramp.s == 1.0 or not ramp.falling):  # bounds in a jump are not those of the ground
        _visit(contacts, account)
    account[RESIDUAL] = (stored - ramp.stored) + account[DISSIPATION] - account[WORK]
    return stored


@lean
def _take_step(contacts, springs, model, ramp):
    """Take an implicit step from the start to the end of a ramp; returns False if it has no solution."""
    ramp.stepping = 1
    last = contacts.shape[0] - 1
    if not solve_around(contacts, springs, model, ramp, last):
        return False
    for j in range(contacts.shape[0]):
        e = model.block[j]
        c = contacts[e.contact]
        c.side = e.side
        c.force_rate = e.force - c.force
        c.at = FORWARD if e.side > 0 else (BACKWARD if e.side < 0 else 0)
        if e.side != 0 and e.upper == e.lower:
            c.at = FORWARD | BACKWARD
    choose_step(contacts, model, ramp)
    ramp.s = 1.0
    return True


@lean
def _slide(contacts, model, ground, ramp):
    """Slide a body that nothing holds to the next border, if there is one; returns whether it has moved."""
    if ground is None:
        return False
    direction = find_runaway(contacts)
    if direction == 0:
        return False
    if not slide_to_border(contacts, model.account, ground, ramp, direction):
        ramp.runaway = direction
        return False
    return True


@lean
def _continue(contacts, model, ground, ramp, outcome):
    """Decide how a ramp goes on after a part of it that has not led to its end.

    A jump is a part at fixed commands. A part that spends the budget, or finds no rates, is completed by an implicit
    step; contacts that have passed borders in it jump from there.

    Returns:
        ENDS, FOLLOWS or STEPS.
    """
    stepped, ramp.stepping = ramp.stepping, 0
    if outcome == DONE and not ramp.falling:
        if ground is None or not stepped:
            return ENDS
        if not place_anew(contacts, ground, ramp):
            return ENDS
        ramp.effort, ramp.done, ramp.falling = 0, 1.0, 1
        return FOLLOWS
    if outcome == DONE:
        ramp.falling = 0
        return FOLLOWS
    if not ramp.falling:
        ramp.done += ramp.s * (1.0 - ramp.done)
    ramp.s = 0.0
    ramp.effort += contacts.shape[0]
    if outcome == JUMPS or (outcome == UNSOLVED and _slide(contacts, model, ground, ramp)):
        ramp.falling = 1
        return FOLLOWS
    if ramp.runaway != 0:
        return ENDS
    model.account[OVERSPENT if outcome == SPENT else NOT_SOLVED] = 1.0
    return STEPS


@lean
def _follow_ramp(contacts, springs, model, ramp, target, exact):
    """Follow a ramp that has begun, in parts if contacts jump; returns the energy stored at its end."""
    how = FOLLOWS if exact else STEPS
    while True:
        if how == FOLLOWS:
            outcome = follow_events(contacts, springs, model, ramp)
            if outcome == JUMPS:
                gather_falls(contacts, model.account, model.ground, ramp)
        else:
            outcome = DONE
            if not _take_step(contacts, springs, model, ramp):
                model.account[NOT_SOLVED] = 1.0
        stored = _finish(contacts, springs, model, ramp, target)
        how = _continue(contacts, model, model.ground, ramp, outcome)
        if how == ENDS:
            return stored
        if not _begin(contacts, springs, model, ramp, target) and not ramp.falling:
            return stored


@lean
def _record(contacts, springs, account, row):
    """Write displacements, their rounding rests and tensions to a row of the records, and what was spent."""
    n, count = contacts.shape[0], springs.shape[0]
    for i in range(n):
        row[i], row[n + i] = contacts[i].x, contacts[i].rest
    for j in range(count):
        row[2 * n + j] = springs[j].tension
    if row.shape[0] > 2 * n + count:
        record_spent(account, row)


@lean
def _begin_pieces(pieces, ramp):
    """Note which ramp the next pieces of the path belong to, if pieces are asked for."""
    if pieces is None:
        return
    begin_ramp(pieces, ramp)


@lean
def follow(contacts, springs, model, exact, targets, account, records):
    """Follow straight ramps to each of the targets in turn.

    Args:
        contacts: CONTACT, shape (N,), changed in place.
        springs: SPRING, shape (S,), changed in place.
        model: a `Model`; `ramps` holds the budget.
        exact: True to follow every event, False for one implicit step per ramp.
        targets: L, bounds and, with loads, these at each ramp's end, shape (V, S + 2 N) or (V, S + 3 N).
        account: total account, shape (14,), added to.
        records: output: displacement, its rest and tension after each ramp, shape (V, 2 N + S), or no rows.

    Returns:
        0, or the direction in which nothing holds the body on the ground that it has come to, 1 or -1.
    """
    ramp = model.ramps[0]
    ramp.stored = 0.0
    ramp.jumps = ramp.runaway = ramp.falling = 0
    for i in range(contacts.shape[0]):
        contacts[i].gained = 0.0
    for j in range(springs.shape[0]):
        ramp.stored += 0.5 * springs[j].tension * springs[j].tension * springs[j].compliance
    for v in range(targets.shape[0]):
        target = targets[v]
        if _begin(contacts, springs, model, ramp, target):
            _begin_pieces(model.pieces, v)
            model.account[:] = 0.0
            model.account[VISITED] = np.inf
            ramp.effort, ramp.number, ramp.done, ramp.lost = 0, v, 0.0, 0.0
            model.account[EVENTS] = 0.0 if exact else 1.0
            ramp.stored = _follow_ramp(contacts, springs, model, ramp, target, exact)
            model.account[DISSIPATION] -= ramp.lost
            if ramp.runaway != 0:
                return ramp.runaway
            add_ramp(account, model.account)
        if records.shape[0] > 0:
            _record(contacts, springs, account, records[v])
    if account[VISITED] == np.inf:  # no command changed
        _visit(contacts, account)
    return 0
