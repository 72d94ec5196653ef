"""Rates in a block whose springs form a path, from the tensions: O(n)."""

from __future__ import annotations

from ...compiled import inlined, lean
from ...rounding import CRITICAL, EPS, NOISE

_WIDE = 1e4
"""Ratio of compliances beyond which the rounding of a tension is none of the elongation of a soft spring."""


@inlined
def elongation_rate(flow, trial, compliance):
    """Compute the rate of the elongation of a spring; a difference of rates of tension within rounding is none.

    Args:
        flow: rate of the tension [N].
        trial: rate of the tension if no contact moves [N].
        compliance: 1 / k [m/N].

    Returns:
        The rate [m].
    """
    change = flow - trial
    return change * compliance if abs(change) > 16.0 * EPS * (abs(flow) + abs(trial)) else 0.0


@inlined
def limit_of(e):
    """Return the rate of the force on a sliding contact, which is the rate of the bound that it slides at.

    Args:
        e: a BLOCK.

    Returns:
        The rate [N].
    """
    return e.upper if e.side > 0 else e.lower


@inlined
def _find_first_flow(block, first, stop, count):
    """Find the rate of the tension before the first contact of a run of sliding contacts, and its scale.

    The rates of the elongations of all springs between two contacts at rest sum to zero; at a free end there is no
    tension.
    """
    rise = pull = compliance = size = 0.0
    for j in range(first, stop + 1):
        e = block[j]
        compliance += e.compliance
        pull += (e.trial - rise) * e.compliance
        size += abs(e.trial)
        if j < stop:
            rise += limit_of(e)
            size += abs(limit_of(e))
    flow = 0.0
    if block[first].spring >= 0:
        flow = -rise if block[stop].spring < 0 else pull / compliance
        flow = block[first].trial if first == stop else flow
    return flow, size


@inlined
def _slide_run(block, first, stop, flow):
    """Compute the rates of tensions and velocities in a run of sliding contacts, from the rate before the first one."""
    v = way = 0.0
    for j in range(first, stop + 1):
        e = block[j]
        e.flow = flow
        if j < stop:
            e.force = limit_of(e)
            flow += e.force
        if e.spring >= 0:
            w = elongation_rate(e.flow, e.trial, e.compliance)
            way += abs(w)
            v += w
        e.v = v
    if block[first].spring < 0:  # the contact at rest is behind it
        v = 0.0
        for j in range(stop, first, -1):
            v -= elongation_rate(block[j].flow, block[j].trial, block[j].compliance)
            block[j - 1].v = v
    elif block[stop].spring >= 0:
        _close_run(block, first, stop)
    for j in range(first, stop):
        e = block[j]
        small = abs(e.v) <= NOISE * way or (e.v * e.side < 0.0 and abs(e.v) <= CRITICAL * way)
        if small and e.cluster < 0:
            e.v = 0.0


@lean
def _close_run(block, first, stop):
    """Compute the velocities of a run from both contacts at rest up to its softest spring, if that is much softer.

    A soft spring turns the rounding of its tension into an error of its elongation. It must not be added to the
    velocities behind the spring: the tension of a stiff spring there would no longer fit its length.
    """
    softest, least = first, block[first].compliance
    for j in range(first + 1, stop + 1):
        least = min(least, block[j].compliance)
        if block[j].compliance > block[softest].compliance:
            softest = j
    if block[softest].compliance <= _WIDE * least:
        return
    v = 0.0
    for j in range(stop, softest, -1):
        v -= elongation_rate(block[j].flow, block[j].trial, block[j].compliance)
        block[j - 1].v = v


@inlined
def solve_path(block, count):
    """Solve for the velocities of the sliding contacts of a path and the rates of the forces on its contacts at rest.

    Row j of the block holds contact j and the spring before it; row `count` holds the spring after the last contact.

    Args:
        block: BLOCK, changed in place; at least one contact or one end of the path is at rest.
        count: number of contacts.
    """
    first = 0
    while first <= count:
        stop = first
        while stop < count and block[stop].side != 0:
            stop += 1
        flow, size = _find_first_flow(block, first, stop, count)
        block[first].scale = block[stop].scale = size
        _slide_run(block, first, stop, flow)
        first = stop + 1
    for j in range(count):
        e = block[j]
        if e.side == 0:
            e.v = 0.0
            e.force = block[j + 1].flow - e.flow
            e.scale += block[j + 1].scale
