"""Breakpoints of the projection of a chain in balanced trees, for loads that move many of them at every link.

`projection.project` stores the breakpoints on two stacks that meet at the zero of the curve. A breakpoint that the
zero passes moves from one stack to the other, one at a time. Here a stack holds trees of breakpoints, treaps ordered by
position. A node stores the rise of the curve over its subtree, so that a tree which the zero passes moves to the other
stack as a whole, and only the tree in which the zero ends is searched and cut, in O(log N). Neighbouring trees of a
stack are joined in pairs when there are too many. A shift of a whole stack is stored once, and that of a tree at its
root, from where it is pushed down to the children when needed.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled

POSITION, SLOPE, JUMP, REACH = range(4)
"""Rows of a stack of breakpoints: position, growth of the slope outwards, jump; REACH has one entry per link."""

_SHIFT, _FIRST, _LAST, _TURN, _RISE = range(3, 8)
"""Further columns of a tree, which has one row per node: the shift not yet applied to its children; the smallest and
largest position in its subtree, the growth of the slope from left to right over the subtree, and the rise of the curve
over the subtree if its slope is 0 at the left."""
_FLOATS = 8
_LEFT, _RIGHT = range(2)
_DEPTH = 256
_TREES = 40
"""A stack of more trees than this is joined to two trees."""


@compiled
def _move(floats, root, by):
    """Move all breakpoints of a subtree."""
    if root >= 0 and by != 0.0:
        floats[root, POSITION] += by
        floats[root, _FIRST] += by
        floats[root, _LAST] += by
        floats[root, _SHIFT] += by


@compiled
def _push_down(floats, children, node):
    """Apply the pending shift of a node to its children."""
    by = floats[node, _SHIFT]
    if by != 0.0:
        _move(floats, children[node, _LEFT], by)
        _move(floats, children[node, _RIGHT], by)
        floats[node, _SHIFT] = 0.0


@compiled
def _sum_up(floats, children, node):
    """Compute the subtree data of a node from its children."""
    position = floats[node, POSITION]
    first = position
    last = position
    turn = floats[node, SLOPE]
    rise = floats[node, JUMP]
    left = children[node, _LEFT]
    if left >= 0:
        first = floats[left, _FIRST]
        turn += floats[left, _TURN]
        rise += floats[left, _RISE] + floats[left, _TURN] * (position - floats[left, _LAST])
    right = children[node, _RIGHT]
    if right >= 0:
        last = floats[right, _LAST]
        rise += turn * (last - position) + floats[right, _RISE]
        turn += floats[right, _TURN]
    floats[node, _FIRST] = first
    floats[node, _LAST] = last
    floats[node, _TURN] = turn
    floats[node, _RISE] = rise


@compiled
def _rank(node):
    """Return the priority of a node, highest at the root: pseudo-random, but the same in every run."""
    mixed = np.uint64(node + 1) * np.uint64(0x9E3779B97F4A7C15)
    mixed ^= mixed >> np.uint64(29)
    return mixed * np.uint64(0xBF58476D1CE4E5B9)


@compiled
def _plant(floats, children, node, position, slope, jump):
    """Create a tree with one breakpoint."""
    floats[node, POSITION] = position
    floats[node, SLOPE] = slope
    floats[node, JUMP] = jump
    floats[node, _SHIFT] = 0.0
    children[node, _LEFT] = -1
    children[node, _RIGHT] = -1
    _sum_up(floats, children, node)


@compiled
def _climb(floats, children, path, depth, low, high):
    """Reattach the lower and the upper part of a tree to the nodes on the path to the cut."""
    for j in range(depth - 1, -1, -1):
        node = path[j] >> 1
        if path[j] & 1:  # the path went right: the node belongs to the lower part
            children[node, _RIGHT] = low
            low = node
        else:
            children[node, _LEFT] = high
            high = node
        _sum_up(floats, children, node)
    return low, high


@compiled
def _join(floats, children, path, low, high):
    """Join two trees; all positions of `low` come before those of `high`."""
    depth = 0
    while low >= 0 and high >= 0:
        if _rank(low) > _rank(high):
            _push_down(floats, children, low)
            path[depth] = 2 * low + 1
            low = children[low, _RIGHT]
        else:
            _push_down(floats, children, high)
            path[depth] = 2 * high
            high = children[high, _LEFT]
        depth += 1
    root = low if low >= 0 else high
    for j in range(depth - 1, -1, -1):
        node = path[j] >> 1
        children[node, _RIGHT if path[j] & 1 else _LEFT] = root
        _sum_up(floats, children, node)
        root = node
    return root


@compiled
def _cut(floats, children, path, root, direction, here, height, slope, flat):
    """Find where the curve has fallen (direction -1) or risen (1) by `height` outwards from `here`; cut the tree there.

    `slope` is the slope of the curve at `here`, beside the tree.

    Returns the trees below and above, the zero, the heights left before and beyond it, the slopes there,
    and the number of nodes visited. A breakpoint at the zero is in neither tree: its jump is split.
    """
    near, inner = (_RIGHT, _LAST) if direction < 0.0 else (_LEFT, _FIRST)
    outer = _FIRST if direction < 0.0 else _LAST
    depth = 0
    node = root
    low = -1
    high = -1
    while node >= 0:
        _push_down(floats, children, node)
        beside = children[node, near]
        start = here
        left_over = height
        steep = slope
        if beside >= 0:
            left_over -= steep * direction * (floats[beside, inner] - start)
            turn = floats[beside, _TURN]
            at_left = max(steep - turn, flat) if direction < 0.0 else steep
            left_over -= at_left * (floats[beside, _LAST] - floats[beside, _FIRST]) + floats[beside, _RISE]
            start = floats[beside, outer]
            steep = max(steep + direction * turn, flat)
        beyond = left_over - steep * direction * (floats[node, POSITION] - start)
        if left_over <= 0.0 and beside >= 0:  # before the last breakpoint on this side
            path[depth] = 2 * node + (direction < 0.0)
            depth += 1
            node = beside
            continue
        if beyond <= 0.0:  # between the subtree and the node
            zero = start + direction * left_over / steep
            path[depth] = 2 * node + (direction < 0.0)
            depth += 1
            if direction < 0.0:
                high = beside
            else:
                low = beside
            low, high = _climb(floats, children, path, depth, low, high)
            return low, high, zero, 0.0, 0.0, steep, steep, depth
        here = floats[node, POSITION]
        after = max(steep + direction * floats[node, SLOPE], flat)
        if floats[node, JUMP] >= beyond:  # at the node
            low, high = children[node, _LEFT], children[node, _RIGHT]
            low, high = _climb(floats, children, path, depth, low, high)
            return low, high, here, beyond, floats[node, JUMP] - beyond, steep, after, depth + 1
        height = beyond - floats[node, JUMP]
        slope = after
        path[depth] = 2 * node + (direction > 0.0)
        depth += 1
        node = children[node, 1 - near]
    low, high = _climb(floats, children, path, depth, low, high)
    return low, high, here + direction * height / slope, 0.0, 0.0, slope, slope, depth


@compiled
def _gather(floats, children, path, side, count):
    """Join neighbouring trees of a stack of `count` trees in pairs until two are left; the last tree is the top.

    `side` is 0 for the left stack, whose top is its rightmost tree, and 1 for the right stack.
    """
    while count > 2:
        kept = 0
        for j in range(0, count, 2):
            root = side[j]
            if j + 1 < count:
                low, high = (root, side[j + 1]) if side[-1] == 0 else (side[j + 1], root)
                root = _join(floats, children, path, low, high)
            side[kept] = root
            kept += 1
        count = kept
    return count


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
    floats = np.empty((size, _FLOATS))
    children = np.empty((size, 2), np.int64)
    path = np.empty(_DEPTH, np.int64)
    lefts = np.empty(_TREES + 4, np.int64)
    rights = np.empty(_TREES + 4, np.int64)
    lefts[-1] = 0
    rights[-1] = 1
    used = 0
    lefts[0] = -1
    rights[0] = -1
    for j in range(n_left):
        _plant(floats, children, used, stacks[0, POSITION, j] + shift_left, -stacks[0, SLOPE, j], stacks[0, JUMP, j])
        lefts[0] = _join(floats, children, path, lefts[0], used)
        used += 1
    for j in range(n_right):
        _plant(floats, children, used, stacks[1, POSITION, j] + shift_right, stacks[1, SLOPE, j], stacks[1, JUMP, j])
        rights[0] = _join(floats, children, path, used, rights[0])
        used += 1
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
        if n_left > 0 and zero < floats[lefts[n_left - 1], _LAST] + shift_left:
            here = floats[lefts[n_left - 1], _LAST] + shift_left
            height = (here - zero) * flat
            slope = flat
            while True:
                n_left -= 1
                root = lefts[n_left]
                looked += 1
                beyond = max(slope - floats[root, _TURN], flat)
                length = floats[root, _LAST] - floats[root, _FIRST]
                fall = beyond * length + floats[root, _RISE]
                if fall >= height:
                    kept, passed, zero, jump_right, jump_left, slope_right, slope_left, count = _cut(
                        floats, children, path, root, -1.0, floats[root, _LAST], height, slope, flat
                    )
                    zero += shift_left
                    looked += count
                    if kept >= 0:
                        lefts[n_left] = kept
                        n_left += 1
                    if passed >= 0:
                        _move(floats, passed, shift_left - shift_right)
                        rights[n_right] = passed
                        n_right += 1
                        if n_right > _TREES:
                            n_right = _gather(floats, children, path, rights, n_right)
                    break
                _move(floats, root, shift_left - shift_right)
                here = floats[root, _FIRST] + shift_right
                rights[n_right] = root
                n_right += 1
                if n_right > _TREES:
                    n_right = _gather(floats, children, path, rights, n_right)
                height -= fall
                slope = beyond
                zero = here - height / slope
                slope_left = slope
                slope_right = slope
                if n_left == 0 or zero >= floats[lefts[n_left - 1], _LAST] + shift_left:
                    break
                height -= slope * (here - (floats[lefts[n_left - 1], _LAST] + shift_left))
        elif n_right > 0 and zero > floats[rights[n_right - 1], _FIRST] + shift_right:
            here = floats[rights[n_right - 1], _FIRST] + shift_right
            height = (zero - here) * flat
            slope = flat
            while True:
                n_right -= 1
                root = rights[n_right]
                looked += 1
                beyond = max(slope + floats[root, _TURN], flat)
                length = floats[root, _LAST] - floats[root, _FIRST]
                rise = slope * length + floats[root, _RISE]
                if rise >= height:
                    passed, kept, zero, jump_left, jump_right, slope_left, slope_right, count = _cut(
                        floats, children, path, root, 1.0, floats[root, _FIRST], height, slope, flat
                    )
                    zero += shift_right
                    looked += count
                    if kept >= 0:
                        rights[n_right] = kept
                        n_right += 1
                    if passed >= 0:
                        _move(floats, passed, shift_right - shift_left)
                        lefts[n_left] = passed
                        n_left += 1
                        if n_left > _TREES:
                            n_left = _gather(floats, children, path, lefts, n_left)
                    break
                _move(floats, root, shift_right - shift_left)
                here = floats[root, _LAST] + shift_left
                lefts[n_left] = root
                n_left += 1
                if n_left > _TREES:
                    n_left = _gather(floats, children, path, lefts, n_left)
                height -= rise
                slope = beyond
                zero = here + height / slope
                slope_left = slope
                slope_right = slope
                if n_right == 0 or zero <= floats[rights[n_right - 1], _FIRST] + shift_right:
                    break
                height -= slope * (floats[rights[n_right - 1], _FIRST] + shift_right - here)
        tension[i] = zero
        low = -backward[i + 1]
        high = forward[i + 1]
        stacks[0, REACH, i] = reach
        reach = 0.0 if low == -np.inf and high == np.inf else reach + magnitude[i + 1]
        if low > -np.inf:
            shift_left += low
            _plant(floats, children, used, zero + low - shift_left, -slope_left, jump_left)
            lefts[n_left] = used
            n_left += 1
            if n_left > _TREES:
                n_left = _gather(floats, children, path, lefts, n_left)
            used += 1
            reach += abs(low)
        else:
            n_left = 0
            shift_left = 0.0
        if high < np.inf:
            shift_right += high
            _plant(floats, children, used, zero + high - shift_right, slope_right, jump_right)
            rights[n_right] = used
            n_right += 1
            if n_right > _TREES:
                n_right = _gather(floats, children, path, rights, n_right)
            used += 1
            reach += abs(high)
        else:
            n_right = 0
            shift_right = 0.0
    return 8 * looked
