"""Breakpoints of the projection of a chain in trees, for loads that move many of them at every link.

`projection.project` stores the breakpoints on two stacks that meet at the zero of the curve. A breakpoint that the
zero passes moves from one stack to the other, one at a time. Here the stacks hold trees of breakpoints (`trees`), which
move as a whole. A shift of a whole stack is stored once.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled
from .trees import FLOATS, near_end, pass_zero, plant

POSITION, SLOPE, JUMP, REACH = range(4)
"""Rows of a stack of breakpoints: positions relative to the shift of the stack, by how much the slope grows outwards,
how high the curve jumps, and the scale of the rounding error, with one entry per link."""


@compiled
def project_in_trees(
    target,
    compliance,
    backward,
    forward,
    magnitude,
    tension,
    stacks,
    start,
    n_left,
    n_right,
    shift_left,
    shift_right,
    reach,
):
    """Continue the forward pass of `projection.project` from a given link, with the breakpoints in trees.

    Args:
        target: trial tensions a, shape (n,) [N].
        compliance: 1 / k, shape (n,) [m/N].
        backward: bounds of T_{i-1} - T_i, shape (n + 1,) [N].
        forward: bounds of T_i - T_{i-1}, shape (n + 1,) [N].
        magnitude: magnitude of the numbers whose rounding affects the bounds, shape (n + 1,) [N].
        tension: output, zeros of the links from `start` on, shape (n,) [N].
        stacks: present breakpoints; REACH of the links from `start` on is written.
        start: first link to process.
        n_left: number of breakpoints on the left stack.
        n_right: number of breakpoints on the right stack.
        shift_left: common shift of all breakpoints of the left stack [N].
        shift_right: the same for the right stack.
        reach: as in `project`.

    Returns:
        The number of trees visited to find the zeros, times six, as each costs as much as six moves of a breakpoint.
    """
    n = target.shape[0]
    most = n_left + n_right + 2 * (n - start)
    floats = np.empty((2 * most, FLOATS))
    children = np.empty((2 * most, 2), np.int32)
    unused = np.array([-1, 0])
    lefts = np.empty(most, np.int32)
    rights = np.empty(most, np.int32)
    for j in range(n_left):
        position, slope, jump = stacks[0, POSITION, j], stacks[0, SLOPE, j], stacks[0, JUMP, j]
        lefts[j] = plant(floats, children, unused, position, -slope, jump)
    for j in range(n_right):
        position, slope, jump = stacks[1, POSITION, j], stacks[1, SLOPE, j], stacks[1, JUMP, j]
        rights[j] = plant(floats, children, unused, position, slope, jump)
    visited = 0
    for i in range(start, n):
        flat = compliance[i]
        zero = target[i]
        slope_left = flat
        slope_right = flat
        jump_left = 0.0
        jump_right = 0.0
        count = 0
        if n_left > 0 and zero < near_end(floats, lefts[n_left - 1], shift_left, -1.0):
            n_left, n_right, zero, jump_left, jump_right, slope_left, slope_right, count = pass_zero(
                floats, children, unused, lefts, n_left, shift_left, rights, n_right, shift_right, -1.0, zero, flat
            )
        elif n_right > 0 and zero > near_end(floats, rights[n_right - 1], shift_right, 1.0):
            n_right, n_left, zero, jump_right, jump_left, slope_right, slope_left, count = pass_zero(
                floats, children, unused, rights, n_right, shift_right, lefts, n_left, shift_left, 1.0, zero, flat
            )
        visited += count
        tension[i] = zero
        low = -backward[i + 1]
        high = forward[i + 1]
        stacks[0, REACH, i] = reach
        reach = 0.0 if low == -np.inf and high == np.inf else reach + magnitude[i + 1]
        if low > -np.inf:
            shift_left += low
            lefts[n_left] = plant(floats, children, unused, zero + low - shift_left, -slope_left, jump_left)
            n_left += 1
            reach += abs(low)
        else:
            n_left = 0
            shift_left = 0.0
        if high < np.inf:
            shift_right += high
            rights[n_right] = plant(floats, children, unused, zero + high - shift_right, slope_right, jump_right)
            n_right += 1
            reach += abs(high)
        else:
            n_right = 0
            shift_right = 0.0
    return 6 * visited
