"""How near the contacts of a graph are to sliding all at once, and what rounding leaves of that question.

A contact that is at its bound by status has no distance from it. The springs pull and push with equal forces, so their
forces on all contacts add up to nothing: the bounds of all contacts that slide at once balance. What the bounds lack of
a balance is known to the rounding of the bounds alone, however stiff the springs. A distance of a free contact is
computed from its spring force, and a force is a small difference of large numbers where springs are stiff: k (z - L)
is known to the rounding of k |x| and k |L|. So all contacts count as sliding at once when their bounds balance and the
free ones are at theirs but for that rounding.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled
from ..state import ACTUATION, AT_BACKWARD, AT_FORWARD, BACKWARD, FORWARD, RELATIVE, TENSION
from ..translation import CRITICAL
from .active_set import EPS
from .memory import ROW_D_BACKWARD, ROW_D_FORWARD, ROW_FORCE, ROW_FORCE_RATE, ROW_GRAIN, ROW_ROUNDING

_LATE = 0.999
"""Where on a ramp an arrival may be one at its end, but for rounding."""
_BLUR = 32.0 * EPS
"""Rounding of a force, relative to the sum of the numbers that it is made of."""


@compiled
def distance_to_sliding(status, side, floats, contacts, s, ds):
    """Compute how far all contacts are from sliding at once, at s + ds.

    Args:
        status: bounds that contacts are at, at s, int8, shape (N,).
        side: bounds that they stay at, 1, 0 or -1, int8, shape (N,).
        floats: memory of the ramp, from `graph_memory`, with the forces at s and their rates.
        contacts: rows X .. RELATIVE, shape (6, N).
        s: where on the ramp, 0 .. 1.
        ds: how far from there.

    Returns:
        Sum of the distances of contacts that leave their bounds, known from rates; the same of free contacts, measured;
        what the nearest bounds of all lack of a balance; the sum of all bounds [N]; how many contacts are free.
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


@compiled
def _round_forces(ends, stiffness, contacts, links, change, rounding):
    """Compute the rounding of the force on each contact from the numbers that it is made of [N]."""
    for i in range(rounding.shape[0]):
        rounding[i] = 0.0
    for s in range(ends.shape[0]):
        a, b = ends[s, 0], ends[s, 1]
        lengths = abs(contacts[RELATIVE, a]) + abs(contacts[RELATIVE, b]) + abs(links[ACTUATION, s]) + abs(change[s])
        size = _BLUR * (stiffness[s] * lengths + abs(links[TENSION, s]))
        rounding[a] += size
        rounding[b] += size


@compiled
def put_off(ends, stiffness, contacts, links, change, coming, floats, when):
    """Let contacts arrive with the ramp's end whose forces would go beyond their bounds by no more than rounding.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: of the springs, shape (S,) [N/m].
        contacts: rows X .. RELATIVE, shape (6, N).
        links: rows SHAPE .. ACTUATION_REF, shape (5, S).
        change: of the rest lengths along the ramp, shape (S,) [m].
        coming: which bound each contact comes to, int8, shape (N,).
        floats: memory of the ramp, with the rates of the forces; when each contact arrives is changed.
        when: the first arrival.

    Returns:
        The first arrival then.
    """
    if not _LATE < when < 1.0:
        return when
    _round_forces(ends, stiffness, contacts, links, change, floats[ROW_ROUNDING])
    first = np.inf
    for i in range(contacts.shape[1]):
        left = 1.0 - floats[ROW_GRAIN, i]
        if left > 0.0:
            rate = floats[ROW_FORCE_RATE, i]
            forward, backward = floats[ROW_D_FORWARD, i], floats[ROW_D_BACKWARD, i]
            closing = rate - forward if coming[i] == AT_FORWARD else -rate - backward
            blur = _BLUR * (contacts[FORWARD, i] + contacts[BACKWARD, i] + abs(forward) + abs(backward))
            if closing * left <= floats[ROW_ROUNDING, i] + blur:
                floats[ROW_GRAIN, i] = 1.0
        first = min(first, floats[ROW_GRAIN, i])
    return first


@compiled
def _is_near(ends, stiffness, contacts, links, change, status, side, floats, distances, close):
    """Tell whether all contacts are at their bounds, within `close` and the rounding of forces.

    A single free contact bears what the bounds of all others leave to it: where these balance it is at its bound.
    """
    known, measured, balance, _, free = distances
    if max(known, abs(balance)) > close:
        return False
    if free < 2 or measured <= close:
        return True
    rounding = floats[ROW_ROUNDING]
    _round_forces(ends, stiffness, contacts, links, change, rounding)
    for i in range(side.shape[0]):
        if side[i] == 0 and status[i] == 0:
            close += rounding[i]
    return measured <= close


@compiled
def nearness_of(distances):
    """Compute the visited margin of what `distance_to_sliding` found.

    Args:
        distances: what it returned.

    Returns:
        The margin [1], never below what the bounds lack of a balance; 0 without friction.
    """
    known, measured, balance, total, free = distances
    near = max(known + (measured if free > 1 else 0.0), abs(balance))
    return near / total if total > 0.0 else 0.0


@compiled
def slides_at_once(ends, stiffness, contacts, links, change, status, side, floats, s, whole):
    """Tell whether all contacts are at their bounds from s up to the ramp's end, so that the translation may be open.

    A distance from the nearest bound is concave in s and never negative: what vanishes at two instants later on
    vanishes from here on. The ramp's ends are not among them: friction may be gone there.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: of the springs, shape (S,) [N/m].
        contacts: rows X .. RELATIVE, shape (6, N).
        links: rows SHAPE .. ACTUATION_REF, shape (5, S).
        change: of the rest lengths along the ramp, shape (S,) [m].
        status: bounds that contacts are at, int8, shape (N,).
        side: bounds that they stay at, int8, shape (N,).
        floats: memory of the ramp, with the forces at s and their rates.
        s: where on the ramp, 0 .. 1; 1 for the end alone.
        whole: sum of all bounds at the ramp's beginning and at its end [N].

    Returns:
        Whether they are, and the visited margin at s.
    """
    here = distance_to_sliding(status, side, floats, contacts, s, 0.0)
    margin = nearness_of(here)
    if whole == 0.0:
        return True, margin
    critical = _is_near(ends, stiffness, contacts, links, change, status, side, floats, here, CRITICAL * whole)
    for part in (3.0, 1.5):
        if critical and s < 1.0:
            later = distance_to_sliding(status, side, floats, contacts, s, (1.0 - s) / part)
            close = CRITICAL * later[3] + 8.0 * EPS * whole
            critical = _is_near(ends, stiffness, contacts, links, change, status, side, floats, later, close)
    return critical, margin
