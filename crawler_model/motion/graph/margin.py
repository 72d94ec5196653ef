"""How close the contacts of a graph are to sliding all at once, within rounding.

A contact that is at its bound by status has distance zero from it. The two forces of a spring are opposite, so the
spring forces on all contacts sum to zero: the bounds of contacts that all slide at once balance. The imbalance of the
bounds is known up to the rounding of the bounds, no matter how stiff the springs are. The distance of a free contact is
computed from its spring force, which for stiff springs is a small difference of large numbers: k (z - L) is known up to
the rounding of k |x| and k |L|. So all contacts count as sliding at once if their bounds balance and the free contacts
are at their bounds within that rounding.
"""

from __future__ import annotations

from ...compiled import inlined, lean
from ...rounding import CRITICAL, EPS
from ..state import ACTUATION, AT_BACKWARD, AT_FORWARD, BACKWARD, FORWARD, RELATIVE, TENSION
from .memory import CHANGE, ROW_D_BACKWARD, ROW_D_FORWARD, ROW_FORCE, ROW_FORCE_RATE

BLUR = 32.0 * EPS
"""Rounding error of a force, relative to the sum of the absolute values of its terms."""


@lean
def distance_to_sliding(status, side, floats, contacts, s, ds):
    """Compute the distance of all contacts from sliding at once, at s + ds.

    Args:
        status: bounds at which contacts are at s, int8, shape (N,).
        side: bounds at which they stay, 1, 0 or -1, int8, shape (N,).
        floats: memory of the ramp, from `memory.scratch`, with the forces at s and their rates.
        contacts: rows X .. RELATIVE, shape (6, N).
        s: place on the ramp, 0 .. 1.
        ds: distance from there.

    Returns:
        Sum of the distances of contacts that leave their bounds, from rates; the same for free contacts, from forces;
        imbalance of the nearest bounds of all contacts; sum of all bounds [N]; number of free contacts.
    """
    known = 0.0
    measured = 0.0
    balance = 0.0
    total = 0.0
    free = 0
    for i in range(contacts.shape[1]):
        forward = contacts[FORWARD, i] + (s + ds) * floats[ROW_D_FORWARD, i]
        backward = contacts[BACKWARD, i] + (s + ds) * floats[ROW_D_BACKWARD, i]
        total += max(forward + backward, 0.0)
        if side[i] != 0:
            balance += forward if side[i] > 0 else -backward
            continue
        g = floats[ROW_FORCE, i]
        climb = 0.0
        if ds > 0.0:
            climb = ds * floats[ROW_FORCE_RATE, i]
        above = ds * floats[ROW_D_FORWARD, i] - climb if status[i] & AT_FORWARD else forward - g - climb
        below = ds * floats[ROW_D_BACKWARD, i] + climb if status[i] & AT_BACKWARD else backward + g + climb
        balance += forward if above < below else -backward
        if status[i] != 0:
            known += abs(min(above, below))
        else:
            measured += abs(min(above, below))
            free += 1
    return known, measured, balance, total, free


@lean
def round_spring(stiffness, contacts, links, changes, spring, a, b):
    """Compute the rounding error of the tension of a spring from the magnitudes of its terms.

    Args:
        stiffness: stiffness of the springs, shape (S,) [N/m].
        contacts: rows X .. RELATIVE, shape (6, N).
        links: rows SHAPE .. ACTUATION_REF, shape (5, S).
        changes: changes of the springs, from `memory.scratch`.
        spring: the spring.
        a: one of its contacts.
        b: the other one.

    Returns:
        The error [N].
    """
    lengths = abs(contacts[RELATIVE, a]) + abs(contacts[RELATIVE, b])
    lengths += abs(links[ACTUATION, spring]) + abs(changes[CHANGE, spring])
    return BLUR * (stiffness[spring] * lengths + abs(links[TENSION, spring]))


@lean
def _is_near(ends, stiffness, contacts, links, changes, status, side, floats, distances, close):
    """Return whether all contacts are at their bounds, within `close` and the rounding of forces.

    A single free contact carries the imbalance of all other bounds: if the bounds balance, it is at its bound.
    """
    known, measured, balance, _, free = distances
    if max(known, abs(balance)) > close:
        return False
    if free < 2 or measured <= close:
        return True
    for spring in range(ends.shape[0]):
        a, b = ends[spring, 0], ends[spring, 1]
        free = (side[a] == 0 and status[a] == 0) + (side[b] == 0 and status[b] == 0)
        if free > 0:
            close += free * round_spring(stiffness, contacts, links, changes, spring, a, b)
    return measured <= close


@lean
def nearness_of(distances):
    """Compute the visited margin from the result of `distance_to_sliding`.

    Args:
        distances: that result.

    Returns:
        The margin [1], at least the imbalance of the bounds; 0 without friction.
    """
    known, measured, balance, total, free = distances
    near = max(known + (measured if free > 1 else 0.0), abs(balance))
    return near / total if total > 0.0 else 0.0


@inlined
def margin_at_rest(status, floats, contacts, side):
    """Compute the visited margin of a state from its forces.

    Args:
        status: bounds at which contacts are, int8, shape (N,).
        floats: memory of the ramp, with the forces.
        contacts: rows X .. RELATIVE, shape (6, N).
        side: scratch, int8, shape (N,).

    Returns:
        The margin [1].
    """
    for i in range(status.shape[0]):
        side[i] = 1 if status[i] & AT_FORWARD else (-1 if status[i] & AT_BACKWARD else 0)
    return nearness_of(distance_to_sliding(status, side, floats, contacts, 0.0, 0.0))


@inlined
def slides_at_once(ends, stiffness, contacts, links, changes, status, side, floats, s, whole):
    """Check whether all contacts are at their bounds from s to the end of the ramp; the translation may then be free.

    A distance from the nearest bound is concave in s and never negative: if it vanishes at two later instants, it
    vanishes from here on. The ends of the ramp are not used, as friction may vanish there.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: stiffness of the springs, shape (S,) [N/m].
        contacts: rows X .. RELATIVE, shape (6, N).
        links: rows SHAPE .. ACTUATION_REF, shape (5, S).
        changes: changes of the springs, from `memory.scratch`.
        status: bounds at which contacts are, int8, shape (N,).
        side: bounds at which they stay, int8, shape (N,).
        floats: memory of the ramp, with the forces at s and their rates.
        s: place on the ramp, 0 .. 1; 1 for the end alone.
        whole: sum of all bounds at the start and at the end of the ramp [N].

    Returns:
        Whether they are; the visited margin at s.
    """
    here = distance_to_sliding(status, side, floats, contacts, s, 0.0)
    margin = nearness_of(here)
    if whole == 0.0:
        return True, margin
    critical = _is_near(ends, stiffness, contacts, links, changes, status, side, floats, here, CRITICAL * whole)
    for part in (3.0, 1.5):
        if critical and s < 1.0:
            later = distance_to_sliding(status, side, floats, contacts, s, (1.0 - s) / part)
            close = CRITICAL * later[3] + 8.0 * EPS * whole
            critical = _is_near(ends, stiffness, contacts, links, changes, status, side, floats, later, close)
    return critical, margin
