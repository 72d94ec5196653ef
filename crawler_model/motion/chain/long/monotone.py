"""Ramps on which no contact turns round, which one implicit step solves exactly.

If contacts between two others at rest are all pushed forward by what changes, along a ramp with constant bounds, none
of them ever moves backward or stops: the forces of springs that pull neighbours together make the problem of their
velocities one with an M-matrix, whose solution grows with the forces and with the set of contacts that slide. The
displacements then solve an obstacle problem, whose solution at the end does not depend on the path. So one implicit
step is exact if, on its result, every contact that moved is pushed in the direction in which it moved, contacts that
moved in opposite directions have one at rest between them, and the contacts at rest cannot have reached a bound in
between.

A segment that is stretched is of this kind: its halves slide outwards, and its middle rests.
"""

from __future__ import annotations

from ....compiled import compiled, lean
from ....rounding import CRITICAL, EPS
from ...state import (
    ACTUATION,
    BACKWARD,
    COMPLIANCE,
    DISSIPATION,
    EVENTS,
    FORWARD,
    STIFFNESS,
    TENSION,
    VISITED,
    WORK,
)
from ..implicit_step import project_step, take_step
from ..memory import (
    ROW_D_ACTUATION,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    ROW_GAIN,
    ROW_STEP,
    ROW_TENSION,
    ROW_V,
)

_LEAST_CHANGE = 0.003
"""Least sum of the changes of lengths, as a part of that of the lengths and of the elongations under friction."""
_ROUNDING = 0.01
"""Displacements of a step may be rounding up to this part of a unit in the last place of all lengths, per contact (and
1 000 contacts more): forces are sums of bounds. Segments of 1e4 .. 1e5 elements show a tenth of it."""
_BESIDE = 1e-6
"""Part of a place on the ramp by which steps end before or behind it."""


@lean
def _push(stiffness, links, floats, i):
    """Compute the rate of the force on a contact if none moved; rounding counts as zero [N per unit of the ramp]."""
    push = 0.0
    size = 0.0
    if i > 0:
        push += stiffness[i - 1] * floats[ROW_D_ACTUATION, i - 1]
        size += stiffness[i - 1] * (abs(floats[ROW_D_ACTUATION, i - 1]) + abs(links[ACTUATION, i - 1]))
    if i < links.shape[1]:
        push -= stiffness[i] * floats[ROW_D_ACTUATION, i]
        size += stiffness[i] * (abs(floats[ROW_D_ACTUATION, i]) + abs(links[ACTUATION, i]))
    return push if abs(push) > 4.0 * EPS * size else 0.0


@lean
def _begins_monotone(elasticity, contacts, links, floats):
    """Determine whether an implicit step may be exact: bounds are constant, and contacts slide where they are pushed.

    The changes of the lengths must also be large enough: the rounding of a step is that of whole lengths and forces,
    of an event that of their changes.

    Returns:
        Whether it may be exact, and the size of displacements that may be rounding [m].
    """
    n = contacts.shape[1]
    bounds = 0.0
    compliance = 0.0
    changes = 0.0
    lengths = 0.0
    for i in range(n):
        if floats[ROW_D_FORWARD, i] != 0.0 or floats[ROW_D_BACKWARD, i] != 0.0:
            return False, 0.0
        if floats[ROW_V, i] * _push(elasticity[STIFFNESS], links, floats, i) < 0.0:
            return False, 0.0
        bounds += contacts[FORWARD, i] + contacts[BACKWARD, i]
        if i < n - 1:
            compliance += elasticity[COMPLIANCE, i]
            changes += abs(floats[ROW_D_ACTUATION, i])
            lengths += abs(links[ACTUATION, i])
    size = bounds * compliance + lengths
    return changes > _LEAST_CHANGE * size, _ROUNDING * (n + 1000.0) * EPS * (size + changes)


@lean
def _let_rest(floats, rounding):
    """Let contacts rest whose displacements are no larger than rounding, and do not count the links between them."""
    n = floats.shape[1]
    resting = False
    for i in range(n):
        moves = abs(floats[ROW_STEP, i]) > rounding
        if not moves:
            floats[ROW_STEP, i] = 0.0
            if resting:
                floats[ROW_GAIN, i - 1] = 0.0
        resting = not moves


@lean
def _examine(stiffness, contacts, links, floats, bytes_, account):
    """Determine whether an implicit step is exact; if so, update the visited margin with that at its end.

    The contacts that are at rest all along must be so far from their bounds that the body is nowhere critical.

    Returns:
        Whether the step is exact; if not, from which place on, 0 .. 1, it may not be, because both neighbours of a
        contact at rest move, in opposite directions. That place is estimated as if the tension of the link to a
        neighbour changed until the neighbour moved, and no more then. It is 0 if there is another reason.
    """
    n = contacts.shape[1]
    moved, lengths, tension = floats[ROW_STEP], floats[ROW_D_ACTUATION], floats[ROW_TENSION]
    until = 1.0
    exact = True
    near = 0.0
    surely = 0.0
    total = 0.0
    for i in range(n):
        total += contacts[FORWARD, i] + contacts[BACKWARD, i]
        push = _push(stiffness, links, floats, i)
        v = moved[i]
        left = moved[i - 1] if i > 0 else 0.0
        right = moved[i + 1] if i < n - 1 else 0.0
        if v != 0.0:
            if v * push < 0.0 or v * left < 0.0:
                return False, 0.0
            continue
        rise = max(push, 0.0)
        fall = min(push, 0.0)
        before = 0.0
        after = 0.0
        if i > 0:
            rise += stiffness[i - 1] * max(left, 0.0)
            fall += stiffness[i - 1] * min(left, 0.0)
            before -= links[TENSION, i - 1]
            after -= tension[i - 1]
        if i < n - 1:
            rise += stiffness[i] * max(right, 0.0)
            fall += stiffness[i] * min(right, 0.0)
            before += links[TENSION, i]
            after += tension[i]
        slack = min(contacts[FORWARD, i] - after, contacts[BACKWARD, i] + after)
        near += max(slack, 0.0)
        if rise == 0.0 or fall == 0.0:  # its force changes in one direction
            least = min(slack, contacts[FORWARD, i] - before, contacts[BACKWARD, i] + before)
        else:
            least = min(contacts[FORWARD, i] - before - rise, contacts[BACKWARD, i] + before + fall)
            if least < 0.0:
                exact = False
                if not left * right < 0.0:
                    return False, 0.0
                until = min(until, 1.0 - min(-left / lengths[i - 1], right / lengths[i]))
        surely += max(least, 0.0)
    if not exact:
        return False, until
    if surely <= 2.0 * CRITICAL * total:
        return False, 0.0
    account[VISITED] = min(account[VISITED], near / total)
    return True, 1.0


@lean
def _take(compliance, contacts, links, status, goal, floats, bytes_, account):
    """Take an implicit step that is exact, with its events, its work, and the lengths at its end."""
    account[WORK] -= account[DISSIPATION]
    for i in range(links.shape[1]):
        before, after = links[TENSION, i], floats[ROW_TENSION, i]
        account[WORK] += 0.5 * compliance[i] * (after - before) * (after + before)
    account[EVENTS] += take_step(contacts, links, status, goal, floats, bytes_, account)
    account[WORK] += account[DISSIPATION]
    for i in range(links.shape[1]):
        links[ACTUATION, i] = goal[i]


@compiled
def follow_monotone(elasticity, contacts, links, status, target, floats, bytes_, stacks, account):
    """Follow a ramp by implicit steps, as far as these are exact because no contact turns round.

    If one step is not exact because both neighbours of a contact at rest move, one step leads to before that, and
    another one, in which hardly anything moves, to behind it.

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (2, N - 1).
        contacts: rows of the contacts at the start of the ramp, changed in place.
        links: rows SHAPE .. ACTUATION_REF, shape (5, N - 1), likewise.
        status: bits AT_FORWARD and AT_BACKWARD, int8, shape (N,), likewise.
        target: L, mu_plus and mu_minus at the end of the ramp, shape (3 N - 1,) [m, N].
        floats: memory of the ramp, with the velocities at its start and the changes along it; these are changed to
            those along the rest of the ramp.
        bytes_: statuses within the ramp.
        stacks: memory for `project`.
        account: account of the ramp, added to. The work follows from the balance of energy, and each contact that
            reaches a bound counts as an event.

    Returns:
        The part of the ramp that was followed; if 0, state and velocities have not changed.
    """
    stiffness, compliance = elasticity[STIFFNESS], elasticity[COMPLIANCE]
    begins, rounding = _begins_monotone(elasticity, contacts, links, floats)
    if not begins:
        return 0.0
    project_step(elasticity, links, target, floats, bytes_, stacks, False)
    _let_rest(floats, rounding)
    exact, until = _examine(stiffness, contacts, links, floats, bytes_, account)
    if exact:
        _take(compliance, contacts, links, status, target, floats, bytes_, account)
        account[EVENTS] += 1.0
        return 1.0
    followed = 0.0
    goal = target.copy()
    for place in ((1.0 - _BESIDE) * until, (1.0 + _BESIDE) * until):
        if not followed < place < 1.0:
            break
        for i in range(links.shape[1]):
            before = links[ACTUATION, i]
            goal[i] = before + (place - followed) / (1.0 - followed) * (target[i] - before)
            floats[ROW_D_ACTUATION, i] = goal[i] - before
        project_step(elasticity, links, goal, floats, bytes_, stacks, False)
        _let_rest(floats, rounding)
        if not _examine(stiffness, contacts, links, floats, bytes_, account)[0]:
            break
        _take(compliance, contacts, links, status, goal, floats, bytes_, account)
        followed = place
    for i in range(links.shape[1]):
        floats[ROW_D_ACTUATION, i] = target[i] - links[ACTUATION, i]
    return followed
