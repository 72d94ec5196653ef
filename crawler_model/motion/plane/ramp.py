"""One ramp of the commands in the plane, to a tolerance, with its energy account.

A ramp is followed from event to event: `find_rates` finds the sliding contacts and predicts when a contact reaches its
bound; one implicit step leads there, which is exact where the path is straight. With discs the path may bend; it is
then followed in shorter, extrapolated substeps, none of which contains the start or stop of a contact (`attempt`). A
contact at rest stays exactly at rest. A step without displacement is exact.
"""

from __future__ import annotations

import math

import numpy as np

from ...compiled import compiled, lean
from ...rounding import SHORTEST_STRETCH
from ..state import (
    AMBIGUOUS,
    COMPLEMENTARITY,
    DISSIPATION,
    EVENTS,
    LOADS_WORK,
    OVERSPENT,
    RESIDUAL,
    VIOLATION,
    VISITED,
    WORK,
)
from ..state import PLANAR_ACTUATION as ACTUATION
from ..state import PLANAR_GAINED as GAINED
from ..state import PLANAR_LOAD as LOAD
from ..state import PLANAR_TENSION as TENSION
from ..state import PLANAR_X as X
from ..state import PLANAR_X_REST as X_REST
from .friction import CLOSE_ENOUGH, corners_of, excess, resistance
from .rates import BAND, find_rates
from .springs import diagonal
from .translation import choose_translation
from .walk import (
    DETERMINED,
    ERROR_LEFT,
    KNOWN,
    LENGTH,
    NOT_UNIQUE,
    PATIENCE,
    PLACE,
    STAGES,
    START,
    TRIALS,
    attempt,
    friction_at,
    load_at,
    pull,
    step,
    stretch,
)

_LAST_STEP = 1.0 / 256.0
"""Length of a step, as part of the ramp, after the limit of substeps is reached."""


@lean
def visited_margin(spring, friction, directions, corners):
    """Compute how far the forces are from letting all contacts slide at once, as part of all friction.

    Args:
        spring: force that friction balances on each contact, shape (n, 2) [N].
        friction: mu, shape (n, max(m, 1)) [N].
        directions: unit vectors, shape (m, 2).
        corners: corners of the polygons, shape (n, m, 2) [N].

    Returns:
        The part, in [0, 1].
    """
    near = 0.0
    sizes = 0.0
    for i in range(spring.shape[0]):
        g0 = spring[i, 0]
        g1 = spring[i, 1]
        if directions.shape[0] == 0:
            near += max(friction[i, 0] - math.hypot(g0, g1), 0.0)
            sizes += 2.0 * friction[i, 0]
            continue
        least = np.inf
        size = 0.0
        for k in range(directions.shape[0]):
            gap = friction[i, k] - g0 * directions[k, 0] - g1 * directions[k, 1]
            if gap < least:
                least = gap
                size = friction[i, k] + resistance(friction[i], corners[i], -directions[k, 0], -directions[k, 1])
        near += max(least, 0.0)
        sizes += size
    return near / sizes if sizes > 0.0 else 0.0


@lean
def set_spring(ends, stiffness, contacts, links, s, c, goal):
    """Set a coordinate of the rest length of a spring, and its tension from the displacements.

    Args:
        ends: the contacts of each spring, int, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        contacts: rows as in `follow_ramp`.
        links: rows TENSION and ACTUATION, shape (2, S, 2), changed in place.
        s: the spring.
        c: the coordinate.
        goal: the rest length [m].

    Returns:
        The energy that it gains [J].
    """
    a = ends[s, 0]
    b = ends[s, 1]
    old = links[TENSION, s, c]
    shape = contacts[X, b, c] - contacts[X, a, c] + (contacts[X_REST, b, c] - contacts[X_REST, a, c])
    new = stiffness[s] * (shape - goal)
    links[TENSION, s, c] = new
    links[ACTUATION, s, c] = goal
    return 0.5 * (new - old) * (new + old) / stiffness[s]


@compiled
def _commit(moved, spent, part, ends, stiffness, directions, contacts, links, friction, target, account):
    """Apply a substep with dissipation `spent[0, 0]`, work `spent[0, 1]` and with loads their work `spent[1, 0]`."""
    n = moved.shape[0]
    loads = contacts[LOAD:]
    for i in range(n):
        for c in range(2):
            contacts[GAINED, i, c] += moved[i, c]
            change = moved[i, c] + contacts[X_REST, i, c]
            before = contacts[X, i, c]
            after = before + change
            applied = after - before
            contacts[X, i, c] = after
            contacts[X_REST, i, c] = (before - (after - applied)) + (change - applied)
    gained = 0.0
    for s in range(ends.shape[0]):
        for c in range(2):
            length = links[ACTUATION, s, c]
            goal = target[2 * s + c] if part == 1.0 else length + part * (target[2 * s + c] - length)
            gained += set_spring(ends, stiffness, contacts, links, s, c, goal)
    friction[:] = friction_at(friction, loads, target, part)
    corners = corners_of(friction, directions)
    spring = np.empty((n, 2))
    pull(ends, links[TENSION], loads, target, part, spring)
    for i in range(n):
        g0 = spring[i, 0]
        g1 = spring[i, 1]
        v0 = moved[i, 0]
        v1 = moved[i, 1]
        _, e0, e1 = excess(g0, g1, friction[i], directions, corners[i], 0.0)
        account[VIOLATION] = max(account[VIOLATION], math.hypot(e0, e1))
        lost = resistance(friction[i], corners[i], v0, v1) - (g0 * v0 + g1 * v1)
        account[COMPLEMENTARITY] = max(account[COMPLEMENTARITY], lost)
    dissipated = spent[0, 0]
    if loads.shape[0] > 0:
        dissipated -= spent[1, 0]
        account[LOADS_WORK] += spent[1, 0]
        for i in range(n):
            for c in range(2):
                loads[0, i, c] = load_at(loads, target, part, i, c)
    account[WORK] += spent[0, 1]
    account[DISSIPATION] += dissipated
    account[RESIDUAL] += gained + dissipated - spent[0, 1]
    account[VISITED] = min(account[VISITED], visited_margin(spring, friction, directions, corners))
    account[EVENTS] += 1.0


@compiled
def is_still(links, friction, contacts, target):
    """Return whether a target equals the command in force.

    Args:
        links: rows TENSION and ACTUATION, shape (2, S, 2).
        friction: mu, shape (n, max(m, 1)) [N].
        contacts: rows as in `follow_ramp`.
        target: end of the ramp.

    Returns:
        Whether it does.
    """
    loads = contacts[LOAD:]
    if loads.shape[0] > 0 and np.any(target[target.size - loads.size :] != loads.ravel()):
        return False
    for s in range(links.shape[1]):
        if target[2 * s] != links[ACTUATION, s, 0] or target[2 * s + 1] != links[ACTUATION, s, 1]:
            return False
    return bool(np.all(friction_at(friction, loads, target, 1.0) == friction))


@compiled
def _look_ahead(springs, directions, links, friction, loads, target, spring, band, velocity):
    """Compute the forces, their rounding tolerance and velocities; return the part of the way to the next event."""
    ends, stiffness = springs.ends, springs.stiffness
    pull(ends, links[TENSION], loads, target, 0.0, spring)
    push = np.empty_like(spring)
    rate = np.zeros_like(links[TENSION])
    stretch(ends, stiffness, np.zeros_like(spring), target, links, 1.0, rate)
    pull(ends, rate, loads, target, 1.0, push)
    for i in range(spring.shape[0]):
        band[i] = BAND * friction[i].max()
        if loads.shape[0] > 0:
            for c in range(2):
                push[i, c] -= loads[0, i, c]
                band[i] += BAND * (abs(loads[0, i, c]) + abs(load_at(loads, target, 1.0, i, c)))
    for s in range(ends.shape[0]):
        for c in range(2):
            size = abs(links[TENSION, s, c]) + abs(rate[s, c]) + stiffness[s] * abs(links[ACTUATION, s, c])
            for e in range(2):
                band[ends[s, e]] += BAND * size
    growth = friction_at(friction, loads, target, 1.0) - friction
    return find_rates(springs, spring, push, friction, growth, directions, band, velocity)


@compiled
def follow_ramp(
    springs, directions, contacts, links, friction, target, tolerance, most_steps, account, progress, *memory
):
    """Follow a straight ramp of the commands.

    Args:
        springs: the springs of the body, from `build_springs`.
        directions: unit vectors d_k, counterclockwise, shape (m, 2); m = 0 for isotropic friction.
        contacts: rows X, X_REST (the rounding rest of X) and GAINED (since the call) [m], and with loads LOAD [N],
            shape (3, n, 2) or (4, n, 2), changed in place.
        links: rows TENSION [N] and ACTUATION [m], shape (2, S, 2), changed in place.
        friction: mu, shape (n, max(m, 1)) [N], changed in place.
        target: L, mu and with loads the loads at the ramp's end, shape (2 S + n max(m, 1) [+ 2 n],).
        tolerance: approximate largest displacement error [m].
        most_steps: upper limit of implicit steps tried; equal steps then complete the ramp.
        account: total account, shape (14,), added to.
        progress: place on the ramp, see `walk`, changed in place; zero at its start.
        memory: upper limit of sweeps, and the arrays of `walk.step`: stages, motions and problem.

    Returns:
        False if a step has to be solved by the caller, else True: at the end of the ramp, or where the patience is at
        an end or a tied contact has moved, as the forces of the springs that tie it are commanded with the loads.
    """
    ends, stiffness = springs.ends, springs.stiffness
    most_sweeps, stages, motions, problem = memory
    n = friction.shape[0]
    spring = np.empty((n, 2))
    velocity = np.zeros((n, 2))
    band = np.empty(n)
    loads = contacts[LOAD:]
    if progress[LENGTH] == 0.0:
        progress[PLACE] = 0.0
        progress[LENGTH] = 1.0
        progress[START] = np.inf
        progress[ERROR_LEFT] = tolerance
        progress[TRIALS] = 0.0
    while progress[PLACE] < 1.0:
        forced = progress[TRIALS] >= most_steps
        if forced:  # the rest takes equal steps, whatever their error
            progress[LENGTH] = _LAST_STEP
        length = progress[LENGTH]
        rest = 1.0 - progress[PLACE]
        event = _look_ahead(springs, directions, links, friction, loads, target, spring, band, velocity) * rest
        event = min(event, progress[START])
        cut = not forced and event < min(length, rest) * (1.0 - 1e-9)
        if cut:
            length = event
        last = not cut and length >= rest - 1e-12
        if last:
            length = rest
        part = 1.0 if last else length / rest
        blur = 0.0
        for i in range(n):  # displacements that correspond to rounding of forces
            blur = max(blur, band[i] / diagonal(springs, i))
        allowed = np.inf if forced else max(tolerance * length, blur)
        if progress[KNOWN] == 0.0:
            stages[0] = part * velocity
        if loads.shape[0] > 0 and springs.tied.size == 0:
            reach = 0.5 * band / CLOSE_ENOUGH
            scratch = np.empty(n, np.int64)
            progress[DETERMINED] = choose_translation(velocity.copy(), spring, friction, directions, reach, scratch)
        ok, found, error, walks, growth = attempt(
            part,
            velocity,
            spring,
            band,
            tolerance,
            allowed,
            springs,
            directions,
            links,
            friction,
            loads,
            target,
            *memory,
            progress,
        )
        if not ok:
            return False
        moved = found[:n]
        paid = 0.0 if error <= allowed else error  # at starts and stops of contacts
        accepted = paid <= 0.125 * progress[ERROR_LEFT]
        if accepted and walks > 2:  # put the spring forces back onto the friction sets
            tension = links[TENSION].copy()
            stretch(ends, stiffness, moved, target, links, part, tension)
            pull(ends, tension, loads, target, part, spring)
            mu = friction_at(friction, loads, target, part)
            if progress[KNOWN] < STAGES:
                stages[STAGES - 1] = 0.0
            if not step(STAGES - 1, spring, mu, directions, springs, most_sweeps, stages, motions, problem, progress):
                return False
            moved = moved + stages[STAGES - 1]
            if loads.shape[0] > 0:
                for i in range(n):
                    for c in range(2):
                        found[n + 1, 0] += load_at(loads, target, part, i, c) * stages[STAGES - 1, i, c]
        if accepted:
            _commit(moved, found[n:], part, ends, stiffness, directions, contacts, links, friction, target, account)
            progress[PLACE] = 1.0 if last else progress[PLACE] + length
            progress[PATIENCE] -= 1.0
            progress[ERROR_LEFT] -= paid
            if length > SHORTEST_STRETCH and progress[NOT_UNIQUE:].max() > 0.0:
                account[AMBIGUOUS] = 1.0
            account[OVERSPENT] += forced and last
            for i in springs.tied:
                if moved[i, 0] != 0.0 or moved[i, 1] != 0.0:
                    return True
        growth = min(max(growth, 0.3), 4.0) if accepted else min(max(growth, 0.05), 0.95)
        if accepted and loads.shape[0] > 0 and allowed > tolerance * length:
            growth = max(growth, 2.0)  # the error is that of rounding, which shorter steps do not reduce
        longest = growth * length
        progress[START] = longest if walks == 0 and not accepted else np.inf
        if walks == 0 or (accepted and cut):  # an event ended it, not its error
            progress[LENGTH] = max(longest, progress[LENGTH])
        else:
            progress[LENGTH] = longest
        progress[TRIALS] += max(progress[KNOWN], 1.0)
        progress[KNOWN] = 0.0
        progress[NOT_UNIQUE:] = 0.0
        if progress[PATIENCE] == 0.0:
            break
    return True
