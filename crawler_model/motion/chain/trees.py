"""Trees of breakpoints of a piecewise-linear curve, on two stacks that meet at the zero of the curve.

The leaves of a tree are breakpoints, and a tree stores the rise of the curve over all of them. A tree that the zero
passes moves to the other stack as a whole; a tree in which the zero ends is divided into its two subtrees until a leaf
or a gap is reached. Trees far from the zero thus stay whole, and those beside it are as small as the zero needs them.
"""

from __future__ import annotations

from ...compiled import lean

_PLACE, _REST, _LENGTH, _TURN, _RISE, _OFFSET = range(6)
"""Columns of a tree: the position of its leftmost breakpoint relative to the shift of its stack, as the sum of two
floats; its length; by how much the slope grows over it from left to right; the rise of the curve over it if the slope
at its left is 0; the distance between the leftmost breakpoints of its two subtrees. Lengths and distances do not change
when the tree moves, so that its rounding errors do not grow with the number of moves."""
FLOATS = 6
_LEFT, _RIGHT = range(2)
_MOST = 6
"""If the zero passes more trees than this at once, neighbours among them are joined."""


@lean
def _take(children, unused):
    """Return a row that is not used: `unused` is the head of the list of rows left, and the first row never used."""
    tree = unused[0]
    if tree >= 0:
        unused[0] = children[tree, _LEFT]
        return tree
    unused[1] += 1
    return unused[1] - 1


@lean
def _leave(children, unused, tree):
    """Add the row of a tree to the list of rows left."""
    children[tree, _LEFT] = unused[0]
    unused[0] = tree


@lean
def plant(floats, children, unused, position, turn, jump):
    """Create a tree of one breakpoint.

    Args:
        floats: the trees, shape (B, 6), changed in place.
        children: their subtrees, -1 for none, int, shape (B, 2), changed in place.
        unused: the last row left, -1 for none, and the first row never used, int, shape (2,), changed in place.
        position: the position of the breakpoint, relative to the shift of its stack [N].
        turn: by how much the slope grows from left to right.
        jump: how high the curve jumps.

    Returns:
        The new tree.
    """
    tree = _take(children, unused)
    floats[tree, _PLACE] = position
    floats[tree, _REST] = 0.0
    floats[tree, _LENGTH] = 0.0
    floats[tree, _TURN] = turn
    floats[tree, _RISE] = jump
    children[tree, _LEFT] = -1
    return tree


@lean
def _join(floats, children, unused, low, high):
    """Join two trees of the same stack; all positions of `low` come before those of `high`."""
    tree = _take(children, unused)
    offset = floats[high, _PLACE] - floats[low, _PLACE] + (floats[high, _REST] - floats[low, _REST])
    length = offset + floats[high, _LENGTH]
    turn = floats[low, _TURN]
    floats[tree, _PLACE] = floats[low, _PLACE]
    floats[tree, _REST] = floats[low, _REST]
    floats[tree, _LENGTH] = length
    floats[tree, _TURN] = turn + floats[high, _TURN]
    floats[tree, _RISE] = floats[low, _RISE] + floats[high, _RISE] + turn * (length - floats[low, _LENGTH])
    floats[tree, _OFFSET] = offset
    children[tree, _LEFT] = low
    children[tree, _RIGHT] = high
    return tree


@lean
def _divide(floats, children, unused, tree):
    """Divide a tree into its two subtrees."""
    low, high = children[tree, _LEFT], children[tree, _RIGHT]
    floats[low, _PLACE] = floats[tree, _PLACE]
    floats[low, _REST] = floats[tree, _REST]
    floats[high, _PLACE] = floats[tree, _PLACE] + floats[tree, _OFFSET]
    floats[high, _REST] = floats[tree, _REST]
    _leave(children, unused, tree)
    return low, high


@lean
def _move(floats, tree, by, rest):
    """Move a tree by the sum of two floats, without a rounding error of the size of its position."""
    before = floats[tree, _PLACE]
    after = before + by
    part = after - before
    floats[tree, _PLACE] = after
    floats[tree, _REST] += (before - (after - part)) + (by - part) + rest


@lean
def near_end(floats, tree, shift, direction):
    """Compute the position of the end of a tree that the zero reaches first.

    Args:
        floats: the trees, shape (B, 6).
        tree: the tree.
        shift: shift of its stack [N].
        direction: the direction in which the zero moves, -1.0 or 1.0.

    Returns:
        The position [N].
    """
    return floats[tree, _PLACE] + shift + (floats[tree, _REST] + (floats[tree, _LENGTH] if direction < 0.0 else 0.0))


@lean
def pass_zero(floats, children, unused, near, n_near, shift_near, far, n_far, shift_far, direction, zero, flat):
    """Move the zero of the curve outwards past trees of one stack, which move to the other stack.

    Args:
        floats: the trees, shape (B, 6), changed in place.
        children: their subtrees, int, shape (B, 2), changed in place.
        unused: as for `plant`.
        near: trees of the stack on the side to which the zero moves, top last, changed in place.
        n_near: their number.
        shift_near: common shift of their positions [N].
        far: trees of the other stack, changed in place.
        n_far: their number.
        shift_far: common shift of their positions [N].
        direction: the direction in which the zero moves, -1.0 or 1.0.
        zero: the zero of the curve if no breakpoint came; it is beyond the first one [N].
        flat: slope of the curve before the first breakpoint, and its least slope.

    Returns:
        The numbers of trees on both stacks, the zero, how high the curve jumps there on the near and on the far side,
        the slopes on both sides, and the number of trees visited. A breakpoint at the zero is in no tree: its jump is
        divided.
    """
    leftwards = direction < 0.0
    by = shift_near - shift_far
    part = by - shift_near
    rest = (shift_near - (by - part)) - (shift_far + part)
    tree = near[n_near - 1]
    here = near_end(floats, tree, shift_near, direction)
    height = direction * (zero - here) * flat
    slope = flat
    start = n_far
    visited = 0
    while True:
        visited += 1
        beyond = max(slope + direction * floats[tree, _TURN], flat)
        fall = (beyond if leftwards else slope) * floats[tree, _LENGTH] + floats[tree, _RISE]
        if fall >= height:
            n_near -= 1
            if children[tree, _LEFT] < 0:
                _leave(children, unused, tree)
                zero, jump_near, jump_far, slope_near = here, floats[tree, _RISE] - height, height, beyond
                break
            low, high = _divide(floats, children, unused, tree)
            near[n_near] = low if leftwards else high
            tree = high if leftwards else low
            near[n_near + 1] = tree
            n_near += 2
            continue
        n_near -= 1
        _move(floats, tree, by, rest)
        far[n_far] = tree
        n_far += 1
        here = near_end(floats, tree, shift_far, -direction)
        height -= fall
        slope = beyond
        if n_near > 0:
            tree = near[n_near - 1]
            further = near_end(floats, tree, shift_near, direction)
            fall = slope * direction * (further - here)
            if fall < height:
                height -= fall
                here = further
                continue
        zero, jump_near, jump_far, slope_near = here + direction * height / slope, 0.0, 0.0, slope
        break
    if n_far - start > _MOST:
        end = n_far
        n_far = start
        for j in range(start, end, 2):
            tree = far[j]
            if j + 1 < end:
                low, high = (far[j + 1], tree) if leftwards else (tree, far[j + 1])
                tree = _join(floats, children, unused, low, high)
            far[n_far] = tree
            n_far += 1
    return n_near, n_far, zero, jump_near, jump_far, slope_near, slope, visited
