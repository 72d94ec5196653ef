"""A ramp in one implicit step."""

from __future__ import annotations

from ...compiled import inlined, lean
from .critical.translation import choose_step
from .events import solve_listed
from .ground.steps import begin_stretches, change_stretches, end_stretches, is_steady
from .records import BACKWARD, FORWARD
from .springs.knots import change_pieces, end_step, keep_part, return_to_part, tighten
from .springs.parts import begin_parts, find_pull, next_part

_LEAST_EFFORT = 1000
"""Contacts solved, for each contact, before an implicit step is given up: it must end a ramp whose budget is spent."""
_SMALLEST_PART = 2.0**-20
"""Part of the commands of an implicit step below which the search for its solution is not divided any more."""


@lean
def _keep_step(contacts, springs, model, count):
    """Note which contacts of a solved block slide in an implicit step, and the forces at its end."""
    for j in range(count):
        e = model.block[j]
        c = contacts[e.contact]
        c.side = e.side
        c.force_rate = e.force + find_pull(contacts, springs, model, model.curves, e.contact)
        c.bounds_met = FORWARD if e.side > 0 else (BACKWARD if e.side < 0 else 0)
        if e.side != 0 and e.upper == e.lower:
            c.bounds_met = FORWARD | BACKWARD


@lean
def _solve_step(contacts, springs, model, curves, ramp):
    """Solve for the part of an implicit step that `ramp.fraction` tells; returns False if no solution was found.

    Flat springs divide the body, and each part is solved by itself. Where the solution leads bent springs beyond knots,
    it is solved anew with their pieces there (Newton's method for a piecewise linear function), and so it is on gradual
    ground.
    """
    n = contacts.shape[0]
    ramp.search.undetermined = 0
    if curves is None:
        for turn in range(ramp.turns + 10 * n):
            model.listed[0] = n - 1
            if not _solve_part(contacts, springs, model, ramp):
                return False
            if not change_stretches(contacts, model.ground, ramp, turn >= ramp.turns):
                return True
        return False
    for turn in range(ramp.turns + 10 * springs.shape[0]):
        if not _solve_parts(contacts, springs, model, curves, ramp):
            if not tighten(contacts, springs, model, curves, ramp):
                return False
            continue
        changed = change_pieces(contacts, springs, curves, ramp, turn >= ramp.turns)
        if not change_stretches(contacts, model.ground, ramp, turn >= ramp.turns) and not changed:
            return True
    return False


@inlined
def _solve_part(contacts, springs, model, ramp):
    """Solve an implicit step for the part of the listed contact; returns False if it has no solution."""
    if not solve_listed(contacts, springs, model, ramp, 1):
        return False
    _keep_step(contacts, springs, model, ramp.search.rows)
    if is_steady(contacts, springs, model, model.ground, ramp, ramp.search.rows):
        return True
    ramp.search.hurries = 0  # nor is it taken in shorter parts
    return False


@lean
def _solve_parts(contacts, springs, model, curves, ramp):
    """Solve an implicit step for each part of the body in turn; returns False if one has no solution."""
    begin_parts(contacts, springs, model, curves, ramp)
    ramp.search.loose = ramp.search.undetermined = 0
    while next_part(curves, ramp, contacts.shape[0]):
        model.listed[0] = curves.members[ramp.first]
        if not _solve_part(contacts, springs, model, ramp):
            return False
    return True


@lean
def take_step(contacts, springs, model, ramp):
    """Take an implicit step from the start to the end of a ramp.

    It is solved for all commands at once or, failing that, for parts of them, each from the solution before: from one
    part to the next, few contacts begin or cease to slide. A part for which the search makes no progress is halved; the
    whole is then solved once more, from its own solution, which takes rounding away.

    Args:
        ramp: the RAMP; at the end `s` is 1, to which contacts and springs have yet to advance.

    Returns:
        Whether it has a solution.
    """
    solved, step, divided = 0.0, 1.0, False
    most = ramp.effort + max(ramp.budget, _LEAST_EFFORT * contacts.shape[0])
    ramp.stepping = 1
    begin_stretches(contacts, model.ground, ramp)
    keep_part(contacts, model.curves, solved)
    while solved < 1.0:
        ramp.fraction = min(solved + step, 1.0)
        ramp.search.hurries = step > _SMALLEST_PART
        if _solve_step(contacts, springs, model, model.curves, ramp):
            if divided and ramp.fraction == 1.0:
                divided = False
            else:
                solved, step = ramp.fraction, 2.0 * step
                keep_part(contacts, model.curves, solved)
        elif ramp.search.hurries and ramp.effort <= most:
            step, divided = 0.5 * step, True
            return_to_part(contacts, springs, model, model.curves, ramp)
        else:
            end_step(contacts, springs, model.curves)
            return False
    for i in range(contacts.shape[0]):
        contacts[i].force_rate -= contacts[i].force
    end_stretches(contacts, model.ground)
    choose_step(contacts, springs, model, model.curves, ramp)
    end_step(contacts, springs, model.curves)
    ramp.s = 1.0
    return True
