"""What equal implicit steps in the plane show about the motion between their ends."""

from __future__ import annotations

import math

from ...compiled import compiled, lean


@lean
def farthest(a, n):
    """Compute the largest Euclidean norm of the first rows of an array.

    Args:
        a: shape (m, 2), m >= n.
        n: number of rows.

    Returns:
        The norm.
    """
    most = 0.0
    for i in range(n):
        most = max(most, math.hypot(a[i, 0], a[i, 1]))
    return most


@compiled
def find_stop(velocity, part, total, last, pieces, negligible):
    """Estimate the part of a walk up to where the first point stops, from its velocity before and in the last step.

    Steps do not show a point that stops and moves back, unless it moves back by more than it moves forward in one of
    them. Its velocity before is that at the start, or the mean of the other steps, and is taken to change evenly.

    Args:
        velocity: at the start, shape (N, 2) [m per unit of the way].
        part: of the way, which the walk takes.
        total: displacement of the walk in its first N rows, shape (M, 2) [m].
        last: displacement of its last step, shape (N, 2) [m].
        pieces: number of its steps.
        negligible: a point may have moved back by this distance [m].

    Returns:
        The part of the walk; 1 if no point stops.
    """
    first = 1.0
    for i in range(last.shape[0]):
        size = math.hypot(total[i, 0], total[i, 1])
        if size == 0.0:
            continue
        before = 0.0
        latest = 0.0
        for c in range(2):
            along = total[i, c] / size
            others = part * velocity[i, c] if pieces == 1 else (total[i, c] - last[i, c]) * pieces / (pieces - 1.0)
            before += others * along
            latest += last[i, c] * pieces * along
        slowing = 2.0 * (before - latest)
        end = latest - 0.5 * slowing / pieces
        if end < 0.0 < before and end * end > 2.0 * slowing * negligible:
            first = min(first, 1.0 + end / slowing)
    return first
