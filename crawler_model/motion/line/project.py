"""Which contacts of a path slide, by dynamic programming: O(n), however far from the answer a search would begin.

Follow the path from its first contact. If the contacts so far are solved for a given rate f of the next tension, the
rate v of the last contact is a non-decreasing, piecewise linear function of f. A spring adds f / k to it. A contact
divides it at its zero: the part where the contact slides forward is shifted by the upper limit of its force, the other
part by the lower limit, and between them the contact rests. Only the zeros have to be known, so the pieces are kept on
two stacks that meet there. From the last contact back to the first, f then tells which contacts slide.

In an implicit step this is the projection onto the stasis domain ([G] Remark 9); Johnson's algorithm for the fused
lasso is of the same family.
"""

from __future__ import annotations

import numpy as np

from ...compiled import lean
from ...rounding import EPS


@lean
def _split(breaks, ramp, e, zero, left, right):
    """Divide the function at its zero by the limits of a contact; without a limit, that part of it is lost.

    Slope and jump on both sides of the zero are `left` and `right`.
    """
    if e.lower == -np.inf:
        ramp.search.left = 0
    else:
        b = breaks[ramp.search.left]
        b.at, b.slope, b.jump = zero - ramp.search.low, left[0], left[1]
        ramp.search.left += 1
        ramp.search.low += e.lower
    if e.upper == np.inf:
        ramp.search.right = breaks.shape[0]
    else:
        ramp.search.right -= 1
        b = breaks[ramp.search.right]
        b.at, b.slope, b.jump = zero - ramp.search.high, right[0], right[1]
        ramp.search.high += e.upper


@lean
def _move_left(breaks, ramp, zero, v, slope):
    """Move the zero to the left of breakpoints, which change stacks, from a value v > 0 at the first of them."""
    while True:
        ramp.search.left -= 1
        b = breaks[ramp.search.left]
        beyond, jump = b.slope, b.jump
        if v <= jump:
            return zero, (beyond, jump - v), (slope, v)
        ramp.search.right -= 1
        b = breaks[ramp.search.right]
        b.at, b.slope, b.jump = zero - ramp.search.high, slope, jump
        v, slope = v - jump, beyond
        low = breaks[ramp.search.left - 1].at + ramp.search.low if ramp.search.left > 0 else -np.inf
        target = zero - v / (slope + ramp.search.compliance)
        if target >= low:
            return target, (slope, 0.0), (slope, 0.0)
        v -= (slope + ramp.search.compliance) * (zero - low)
        zero = low


@lean
def _move_right(breaks, ramp, zero, v, slope):
    """Move the zero to the right of breakpoints, which change stacks, from a value v < 0 at the first of them."""
    while True:
        b = breaks[ramp.search.right]
        beyond, jump = b.slope, b.jump
        ramp.search.right += 1
        if -v <= jump:
            return zero, (slope, -v), (beyond, jump + v)
        b = breaks[ramp.search.left]
        b.at, b.slope, b.jump = zero - ramp.search.low, slope, jump
        ramp.search.left += 1
        v, slope = v + jump, beyond
        high = breaks[ramp.search.right].at + ramp.search.high if ramp.search.right < breaks.shape[0] else np.inf
        target = zero - v / (slope + ramp.search.compliance)
        if target <= high:
            return target, (slope, 0.0), (slope, 0.0)
        v += (slope + ramp.search.compliance) * (high - zero)
        zero = high


@lean
def _find_zero(breaks, ramp, spring):
    """Add a spring to the function, which vanishes between the stacks, and find its zero.

    Slopes are stored without the compliance of all springs so far. The ends of the function are infinite jumps.

    Returns:
        The zero [N]; slope and jump to the left of it; the same to the right.
    """
    first, last, n = ramp.search.left, ramp.search.right, breaks.shape[0]
    low = breaks[first - 1].at + ramp.search.low if first > 0 else -np.inf
    high = breaks[last].at + ramp.search.high if last < n else np.inf
    rest, zero = -ramp.search.compliance, spring.trial
    ramp.search.compliance += spring.compliance
    if zero < low:
        return _move_left(breaks, ramp, low, spring.compliance * (low - zero), rest)
    if zero > high:
        return _move_right(breaks, ramp, high, spring.compliance * (high - zero), rest)
    return zero, (rest, 0.0), (rest, 0.0)


@lean
def project(model, ramp, count):
    """Find which contacts of a path slide, and write their sides in its block."""
    block, breaks = model.block, model.breaks
    ramp.search.left, ramp.search.right = 0, breaks.shape[0]
    ramp.search.low = ramp.search.high = ramp.search.compliance = 0.0
    zero, most = 0.0, 0.0
    left = right = (0.0, np.inf)
    if block[0].spring >= 0:
        ramp.search.compliance = block[0].compliance
        zero, left, right = block[0].trial, (0.0, 0.0), (0.0, 0.0)
    for j in range(count):
        block[j].zero = zero
        most = max(most, abs(zero))
        _split(breaks, ramp, block[j], zero, left, right)
        spring = block[j + 1]
        if spring.spring < 0:
            zero = 0.0
            break
        zero, left, right = _find_zero(breaks, ramp, spring)
    flow, close = zero, 32.0 * EPS * most  # at a limit within rounding, the velocity decides
    for j in range(count - 1, -1, -1):
        e = block[j]
        if e.cluster < 0:  # else all its contacts slide on as they do
            e.side = 1 if flow >= e.zero + e.upper - close else (-1 if flow <= e.zero + e.lower + close else 0)
        flow = e.zero if e.side == 0 else flow - (e.upper if e.side > 0 else e.lower)
