"""Many ticks along a path of commands in one compiled call."""

from __future__ import annotations

import numpy as np

from crawler_model.compiled import compiled, inner


@compiled
def follow_waypoints(due, near, times_ns, in_force):
    """Follow waypoints and the straight lines between them through ticks.

    Args:
        due: times of the last waypoint passed before, of the waypoints passed now, and of the next one if there is one,
            shape (W,) [ns].
        near: their rows, shape (W, C).
        times_ns: simulated time at the start of the first tick and at the end of each, shape (K + 1,) [ns].
        in_force: the command row in force, shape (C,).

    Returns:
        Times and rows of the vertices, the first vertex of each tick, and the tick in which the commands ended, as in
        `Vertices`.
    """
    ticks, columns = times_ns.size - 1, near.shape[1]
    due_ns, rows = np.empty(ticks + due.size, np.int64), np.empty((ticks + due.size, columns))
    first, ended = np.zeros(ticks + 1, np.int64), -1
    before, vertex = 0, 0
    for tick in range(ticks):
        while before + 1 < due.size and due[before + 1] <= times_ns[tick + 1]:
            before += 1
            _copy(rows[vertex], near[before])
            due_ns[vertex] = max(due[before], times_ns[0])
            vertex += _differs(rows[vertex], in_force if vertex == 0 else rows[vertex - 1])
            if before + 1 == due.size:
                ended = tick
        if before + 1 < due.size:
            part = max(times_ns[tick + 1] - due[before], 0) / (due[before + 1] - due[before])
            for c in range(columns):
                rows[vertex, c] = near[before, c] + part * (near[before + 1, c] - near[before, c])
            if part == 0.0:
                _copy(rows[vertex], near[before])  # a sum would change the bits of -0
            due_ns[vertex] = times_ns[tick + 1]
            vertex += _differs(rows[vertex], in_force if vertex == 0 else rows[vertex - 1])
        first[tick + 1] = vertex
    return due_ns[:vertex], rows[:vertex], first, ended


@inner
def _copy(row, other):
    """Copy a row into another, shape (C,): a slice that is assigned takes long to compile."""
    for c in range(row.size):
        row[c] = other[c]


@inner
def _differs(row, other):
    """Determine whether two rows differ in a bit, shape (C,)."""
    for c in range(row.size):
        if row[c] != other[c] or (row[c] == 0.0 and np.signbit(row[c]) != np.signbit(other[c])):
            return True
    return False
