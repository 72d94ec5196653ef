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
        ramp.left = 0
    else:
        b = breaks[ramp.left]
        b.at, b.slope, b.jump = zero - ramp.low, left[0], left[1]
        ramp.left += 1
        ramp.low += e.lower
    if e.upper == np.inf:
        ramp.right = breaks.shape[0]
    else:
        ramp.right -= 1
        b = breaks[ramp.right]
        b.at, b.slope, b.jump = zero - ramp.high, right[0], right[1]
        ramp.high += e.upper


@lean
def _move_left(breaks, ramp, zero, v, slope):
    """Move the zero to the left of breakpoints, which change stacks, from a value v > 0 at the first of them."""
    while True:
        ramp.left -= 1
        b = breaks[ramp.left]
        beyond, jump = b.slope, b.jump
        if v <= jump:
            return zero, (beyond, jump - v), (slope, v)
        ramp.right -= 1
        b = breaks[ramp.right]
        b.at, b.slope, b.jump = zero - ramp.high, slope, jump
        v, slope = v - jump, beyond
        low = breaks[ramp.left - 1].at + ramp.low if ramp.left > 0 else -np.inf
        target = zero - v / (slope + ramp.compliance)
        if target >= low:
            return target, (slope, 0.0), (slope, 0.0)
        v -= (slope + ramp.compliance) * (zero - low)
        zero = low


@lean
def _move_right(breaks, ramp, zero, v, slope):
    """Move the zero to the right of breakpoints, which change stacks, from a value v < 0 at the first of them."""
    while True:
        b = breaks[ramp.right]
        beyond, jump = b.slope, b.jump
        ramp.right += 1
        if -v <= jump:
            return zero, (slope, -v), (beyond, jump + v)
        b = breaks[ramp.left]
        b.at, b.slope, b.jump = zero - ramp.low, slope, jump
        ramp.left += 1
        v, slope = v + jump, beyond
        high = breaks[ramp.right].at + ramp.high if ramp.right < breaks.shape[0] else np.inf
        target = zero - v / (slope + ramp.compliance)
        if target <= high:
            return target, (slope, 0.0), (slope, 0.0)
        v += (slope + ramp.compliance) * (high - zero)
        zero = high


@lean
def _find_zero(breaks, ramp, spring):
    """Add a spring to the function, which vanishes between the stacks, and find its zero.

    Slopes are stored without the compliance of all springs so far. The ends of the function are infinite jumps.

    Returns:
        The zero [N]; slope and jump to the left of it; the same to the right.
    """
    first, last, n = ramp.left, ramp.right, breaks.shape[0]
    low = breaks[first - 1].at + ramp.low if first > 0 else -np.inf
    high = breaks[last].at + ramp.high if last < n else np.inf
    rest, zero = -ramp.compliance, spring.trial
    ramp.compliance += spring.compliance
    if zero < low:
        return _move_left(breaks, ramp, low, spring.compliance * (low - zero), rest)
    if zero > high:
        return _move_right(breaks, ramp, high, spring.compliance * (high - zero), rest)
    return zero, (rest, 0.0), (rest, 0.0)


@lean
def project(model, ramp, count):
    """Find which contacts of a path slide, and write their sides in its block."""
    block, breaks = model.block, model.breaks
    ramp.left, ramp.right = 0, breaks.shape[0]
    ramp.low = ramp.high = ramp.compliance = 0.0
    zero, most = 0.0, 0.0
    left = right = (0.0, np.inf)
    if block[0].spring >= 0:
        ramp.compliance = block[0].compliance
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
        e.side = 1 if flow >= e.zero + e.upper - close else (-1 if flow <= e.zero + e.lower + close else 0)
        flow = e.zero if e.side == 0 else flow - (e.upper if e.side > 0 else e.lower)
