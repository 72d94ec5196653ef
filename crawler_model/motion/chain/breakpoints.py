"""Breakpoints of the projection of a chain in balanced trees, for loads that move many of them at every link.

`projection.project` stores the breakpoints on two stacks that meet at the zero of the curve. A breakpoint that the
zero passes moves from one stack to the other, one at a time. Here a stack holds trees of breakpoints (`trees`): a tree
that the zero passes moves to the other stack as a whole, and only the tree in which the zero ends is cut. Neighbouring
trees of a stack are joined when there are too many. A shift of a whole stack is stored once.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled
from .trees import DEPTH, FIRST, FLOATS, JUMP, LAST, POSITION, RISE, SLOPE, TURN, cut, gather, move, plant, plant_row

REACH = 3
"""Row of a stack of breakpoints behind POSITION, SLOPE (its growth outwards) and JUMP: with one entry per link."""
_TREES = 40
"""A stack of more trees than this is joined to two trees."""


@compiled
def project_balanced(
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
        The number of breakpoints visited to find the zeros, times eight, as each costs as much as eight moves.
    """
    n = target.shape[0]
    size = n_left + n_right + 2 * (n - start)
    floats = np.empty((size, FLOATS))
    children = np.empty((size, 2), np.int64)
    path = np.empty(DEPTH, np.int64)
    lefts = np.empty(_TREES + 4, np.int64)
    rights = np.empty(_TREES + 4, np.int64)
    lefts[-1] = 0
    rights[-1] = 1
    used = 0
    for j in range(n_left):
        plant(floats, children, used, stacks[0, POSITION, j] + shift_left, -stacks[0, SLOPE, j], stacks[0, JUMP, j])
        used += 1
    for j in range(n_right):
        plant(floats, children, used, stacks[1, POSITION, j] + shift_right, stacks[1, SLOPE, j], stacks[1, JUMP, j])
        used += 1
    planted = np.arange(used + 1)
    planted[-1] = 0
    lefts[0] = plant_row(floats, children, planted, path, 0, n_left - 1)
    planted[-1] = 1
    rights[0] = plant_row(floats, children, planted, path, n_left, used - 1)
    n_left = min(n_left, 1)
    n_right = min(n_right, 1)
    shift_left = 0.0
    shift_right = 0.0
    looked = used
    for i in range(start, n):
        flat = compliance[i]
        zero = target[i]
        slope_left = flat
        slope_right = flat
        jump_left = 0.0
        jump_right = 0.0
        if n_left > 0 and zero < floats[lefts[n_left - 1], LAST] + shift_left:
            here = floats[lefts[n_left - 1], LAST] + shift_left
            height = (here - zero) * flat
            slope = flat
            while True:
                n_left -= 1
                root = lefts[n_left]
                looked += 1
                beyond = max(slope - floats[root, TURN], flat)
                length = floats[root, LAST] - floats[root, FIRST]
                fall = beyond * length + floats[root, RISE]
                if fall >= height:
                    kept, passed, zero, jump_right, jump_left, slope_right, slope_left, count = cut(
                        floats, children, path, root, -1.0, floats[root, LAST], height, slope, flat
                    )
                    zero += shift_left
                    looked += count
                    if kept >= 0:
                        lefts[n_left] = kept
                        n_left += 1
                    if passed >= 0:
                        move(floats, passed, shift_left - shift_right)
                        rights[n_right] = passed
                        n_right += 1
                        if n_right > _TREES:
                            n_right = gather(floats, children, path, rights, n_right)
                    break
                move(floats, root, shift_left - shift_right)
                here = floats[root, FIRST] + shift_right
                rights[n_right] = root
                n_right += 1
                if n_right > _TREES:
                    n_right = gather(floats, children, path, rights, n_right)
                height -= fall
                slope = beyond
                zero = here - height / slope
                slope_left = slope
                slope_right = slope
                if n_left == 0 or zero >= floats[lefts[n_left - 1], LAST] + shift_left:
                    break
                height -= slope * (here - (floats[lefts[n_left - 1], LAST] + shift_left))
        elif n_right > 0 and zero > floats[rights[n_right - 1], FIRST] + shift_right:
            here = floats[rights[n_right - 1], FIRST] + shift_right
            height = (zero - here) * flat
            slope = flat
            while True:
                n_right -= 1
                root = rights[n_right]
                looked += 1
                beyond = max(slope + floats[root, TURN], flat)
                length = floats[root, LAST] - floats[root, FIRST]
                rise = slope * length + floats[root, RISE]
                if rise >= height:
                    passed, kept, zero, jump_left, jump_right, slope_left, slope_right, count = cut(
                        floats, children, path, root, 1.0, floats[root, FIRST], height, slope, flat
                    )
                    zero += shift_right
                    looked += count
                    if kept >= 0:
                        rights[n_right] = kept
                        n_right += 1
                    if passed >= 0:
                        move(floats, passed, shift_right - shift_left)
                        lefts[n_left] = passed
                        n_left += 1
                        if n_left > _TREES:
                            n_left = gather(floats, children, path, lefts, n_left)
                    break
                move(floats, root, shift_right - shift_left)
                here = floats[root, LAST] + shift_left
                lefts[n_left] = root
                n_left += 1
                if n_left > _TREES:
                    n_left = gather(floats, children, path, lefts, n_left)
                height -= rise
                slope = beyond
                zero = here + height / slope
                slope_left = slope
                slope_right = slope
                if n_right == 0 or zero <= floats[rights[n_right - 1], FIRST] + shift_right:
                    break
                height -= slope * (floats[rights[n_right - 1], FIRST] + shift_right - here)
        tension[i] = zero
        low = -backward[i + 1]
        high = forward[i + 1]
        stacks[0, REACH, i] = reach
        reach = 0.0 if low == -np.inf and high == np.inf else reach + magnitude[i + 1]
        if low > -np.inf:
            shift_left += low
            plant(floats, children, used, zero + low - shift_left, -slope_left, jump_left)
            lefts[n_left] = used
            n_left += 1
            if n_left > _TREES:
                n_left = gather(floats, children, path, lefts, n_left)
            used += 1
            reach += abs(low)
        else:
            n_left = 0
            shift_left = 0.0
        if high < np.inf:
            shift_right += high
            plant(floats, children, used, zero + high - shift_right, slope_right, jump_right)
            rights[n_right] = used
            n_right += 1
            if n_right > _TREES:
                n_right = gather(floats, children, path, rights, n_right)
            used += 1
            reach += abs(high)
        else:
            n_right = 0
            shift_right = 0.0
    return 8 * looked
