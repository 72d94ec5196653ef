"""Balanced trees of breakpoints of a piecewise-linear curve: treaps ordered by position.

A node stores the rise of the curve over its subtree, so that a tree which the zero of the curve passes moves as a
whole, and a tree in which the zero ends is searched and cut in O(log N). A shift of a whole tree is stored at its root,
from where it is pushed down to the children when needed.
"""

from __future__ import annotations

import numpy as np

from ...compiled import lean

POSITION, SLOPE, JUMP, _SHIFT, FIRST, LAST, TURN, RISE = range(8)
"""Columns of a node: its position, the growth of the slope from left to right at it and the jump of the curve; the
shift not yet applied to its children; the smallest and largest position in its subtree, the growth of the slope from
left to right over the subtree, and the rise of the curve over the subtree if its slope is 0 at the left."""
FLOATS = 8
_LEFT, _RIGHT = range(2)
DEPTH = 256
"""More nodes than any path from a root: the trees are balanced."""


@lean
def move(floats, root, by):
    """Move all breakpoints of a tree.

    Args:
        floats: the nodes, shape (B, 8), changed in place.
        root: root of the tree; -1 for none.
        by: by how much [N].
    """
    if root >= 0 and by != 0.0:
        floats[root, POSITION] += by
        floats[root, FIRST] += by
        floats[root, LAST] += by
        floats[root, _SHIFT] += by


@lean
def _push_down(floats, children, node):
    """Apply the pending shift of a node to its children."""
    by = floats[node, _SHIFT]
    if by != 0.0:
        move(floats, children[node, _LEFT], by)
        move(floats, children[node, _RIGHT], by)
        floats[node, _SHIFT] = 0.0


@lean
def _sum_up(floats, children, node):
    """Compute the subtree data of a node from its children."""
    position = floats[node, POSITION]
    first = position
    last = position
    turn = floats[node, SLOPE]
    rise = floats[node, JUMP]
    left = children[node, _LEFT]
    if left >= 0:
        first = floats[left, FIRST]
        turn += floats[left, TURN]
        rise += floats[left, RISE] + floats[left, TURN] * (position - floats[left, LAST])
    right = children[node, _RIGHT]
    if right >= 0:
        last = floats[right, LAST]
        rise += turn * (last - position) + floats[right, RISE]
        turn += floats[right, TURN]
    floats[node, FIRST] = first
    floats[node, LAST] = last
    floats[node, TURN] = turn
    floats[node, RISE] = rise


@lean
def _rank(node):
    """Return the priority of a node, highest at the root: pseudo-random, but the same in every run."""
    mixed = np.uint64(node + 1) * np.uint64(0x9E3779B97F4A7C15)
    mixed ^= mixed >> np.uint64(29)
    return mixed * np.uint64(0xBF58476D1CE4E5B9)


@lean
def plant(floats, children, node, position, slope, jump):
    """Create a tree with one breakpoint.

    Args:
        floats: the nodes, shape (B, 8), changed in place.
        children: children of the nodes, -1 for none, int, shape (B, 2), changed in place.
        node: the new node.
        position: its position [N].
        slope: by how much the slope grows from left to right.
        jump: how high the curve jumps.
    """
    floats[node, POSITION] = position
    floats[node, SLOPE] = slope
    floats[node, JUMP] = jump
    floats[node, _SHIFT] = 0.0
    children[node, _LEFT] = -1
    children[node, _RIGHT] = -1
    _sum_up(floats, children, node)


@lean
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


@lean
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


@lean
def cut(floats, children, path, root, direction, here, height, slope, flat):
    """Find where the curve has fallen (direction -1) or risen (1) by `height` outwards from `here`; cut the tree there.

    Args:
        floats: the nodes, shape (B, 8), changed in place.
        children: children of the nodes, int, shape (B, 2), changed in place.
        path: scratch memory, int, shape (DEPTH,).
        root: root of the tree.
        direction: -1.0 or 1.0.
        here: where the search begins, beside the tree [N].
        height: by how much the curve falls or rises.
        slope: slope of the curve at `here`.
        flat: its least slope.

    Returns:
        The trees below and above, the zero, the heights left before and beyond it, the slopes there, and the number of
        nodes visited. A breakpoint at the zero is in neither tree: its jump is split.
    """
    near, inner = (_RIGHT, LAST) if direction < 0.0 else (_LEFT, FIRST)
    outer = FIRST if direction < 0.0 else LAST
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
            turn = floats[beside, TURN]
            at_left = max(steep - turn, flat) if direction < 0.0 else steep
            left_over -= at_left * (floats[beside, LAST] - floats[beside, FIRST]) + floats[beside, RISE]
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


@lean
def _hang(floats, children, path, depth, node, near, far):
    """Place the next breakpoint outwards on a spine of `depth` nodes; returns the new depth."""
    rank = _rank(node)
    below = -1
    while depth > 0 and _rank(path[depth - 1]) < rank:
        depth -= 1
        children[path[depth], far] = below
        below = path[depth]
        _sum_up(floats, children, below)
    floats[node, _SHIFT] = 0.0
    children[node, near] = below
    path[depth] = node
    return depth + 1


@lean
def plant_row(floats, children, side, path, first, last):
    """Join neighbouring trees of one breakpoint each to one tree, in linear time.

    Args:
        floats: the nodes, shape (B, 8), changed in place.
        children: children of the nodes, int, shape (B, 2), changed in place.
        side: the roots of the trees of a stack; its last entry is 0 for the left stack, whose top is its rightmost
            tree, and 1 for the right stack.
        path: scratch memory, int, shape (DEPTH,).
        first: the first of the trees.
        last: the last one.

    Returns:
        The root; -1 without trees.
    """
    near, far = (_LEFT, _RIGHT) if side[-1] == 0 else (_RIGHT, _LEFT)
    depth = 0
    for j in range(first, last + 1):
        depth = _hang(floats, children, path, depth, side[j], near, far)
    below = -1
    while depth > 0:
        depth -= 1
        children[path[depth], far] = below
        below = path[depth]
        _sum_up(floats, children, below)
    return below


@lean
def gather(floats, children, path, side, count):
    """Join neighbouring trees of a stack until two are left; the last tree is the top.

    Args:
        floats: the nodes, shape (B, 8), changed in place.
        children: children of the nodes, int, shape (B, 2), changed in place.
        path: scratch memory, int, shape (DEPTH,).
        side: the roots of the trees, changed in place; its last entry as for `plant_row`.
        count: number of trees.

    Returns:
        The number of trees left.
    """
    kept = 0
    first = 0
    while first < count:
        last = first
        while last < count and children[side[last], _LEFT] < 0 and children[side[last], _RIGHT] < 0:
            last += 1
        if last > first + 1:
            side[kept] = plant_row(floats, children, side, path, first, last - 1)
            first = last
        else:
            side[kept] = side[first]
            first += 1
        kept += 1
    count = kept
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
