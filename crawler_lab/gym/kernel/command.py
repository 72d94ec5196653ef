"""From an action to the command in force."""

from __future__ import annotations

import math

from crawler_model.compiled import entry, lean

from .layout import (
    DELAY,
    HELD,
    HIGH,
    LOW,
    NS,
    QUEUE,
    RATE,
    RATE_BELOW,
    ROW,
    SIZE,
    SLOPE,
    STEP,
    TARGET,
    open_layout,
)


@entry
def find_bad(actions):
    """Find the first action that is not finite.

    Args:
        actions: shape (M, A).

    Returns:
        Its place in the flat array; -1 if all are finite.
    """
    for m in range(actions.shape[0]):
        for a in range(actions.shape[1]):
            if not math.isfinite(actions[m, a]):
                return m * actions.shape[1] + a
    return -1


@lean
def end_of_step(settings, step):
    """Compute the time at which a step ends, rounded as the ends of ticks are.

    Args:
        settings: see KIND .. RATE_BELOW.
        step: its number, 0 for the start.

    Returns:
        Simulated time [ns].
    """
    return step * NS * settings[RATE_BELOW] // settings[RATE]


@lean
def command(lane, clock, action, layout):
    """Turn an action into the next command; one that friction cannot hold leaves that in force.

    Args:
        lane: the lane, changed in place.
        clock: its whole numbers.
        action: rates, from -1 to 1, clipped; shape (A,).
        layout: what all lanes share.
    """
    actions, queue, row, held = action.shape[0], layout.at[QUEUE], layout.at[ROW], layout.at[HELD]
    slots = (layout.at[QUEUE + 1] - queue) // actions
    first = queue + (clock[STEP] % slots) * actions
    for a in range(actions):
        lane[first + a] = min(max(action[a], -1.0), 1.0)
    given = clock[STEP] - clock[DELAY]
    if given < 0:
        return
    first = queue + (given % slots) * actions
    for c in range(layout.at[HELD + 1] - held):
        lane[held + c] = lane[row + c]
    for c in range(layout.of.shape[0]):
        if layout.of[c] >= 0:
            value = lane[row + c] + layout.limits[SIZE, c] * lane[first + layout.of[c]]
            lane[row + c] = min(max(value, layout.limits[LOW, c]), layout.limits[HIGH, c])
    if not aim(lane, layout):
        for c in range(layout.of.shape[0]):
            lane[row + c] = lane[held + c]
        aim(lane, layout)


@lean
def aim(lane, layout):
    """Write the target of the command in force, as `Columns.target` does.

    Args:
        lane: the lane, changed in place.
        layout: what all lanes share.

    Returns:
        Whether friction can hold the loads.
    """
    row, target, slope = layout.at[ROW], layout.at[TARGET], layout.at[SLOPE]
    for f in range(layout.column.shape[0]):
        lane[target + f] = lane[row + layout.column[f]] * layout.factor[f]
    n = layout.at[SLOPE + 1] - slope
    if n == 0:
        return True
    first = layout.at[TARGET + 1] - 3 * n
    ahead, behind = 0.0, 0.0
    for i in range(n):
        load = lane[first + 2 * n + i] + lane[slope + i]
        lane[first + 2 * n + i] = load
        lane[first + i] -= load
        lane[first + n + i] += load
        ahead += lane[first + i]
        behind += lane[first + n + i]
    near = -1e-12 * (ahead + behind)
    return not (ahead < near or behind < near)


@entry
def command_one(lane, clock, action, floats, ints):
    """Turn the action of one environment into a command, see `command`.

    Args:
        lane: its memory, changed in place.
        clock: its whole numbers.
        action: rates, shape (A,).
        floats: shared numbers, see `open_layout`.
        ints: shared whole numbers, see `open_layout`.
    """
    command(lane, clock, action, open_layout(floats, ints))
