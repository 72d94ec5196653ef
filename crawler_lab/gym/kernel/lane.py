"""Lanes: from an action to a command, and from readings to an observation; the motion between is the model's."""

from __future__ import annotations

import math

import numpy as np

from crawler_model.compiled import entry, lean
from crawler_model.motion.account import WORK

from .layout import (
    ACCOUNT,
    ALONG,
    AXES,
    BEGAN,
    BOUND,
    DELAY,
    DIRECTION,
    DISPLACEMENT,
    DISTANCE,
    FEET,
    FURTHEST,
    GAINED,
    HELD,
    HIGH,
    JOINTS,
    KIND,
    LIMIT,
    LOW,
    MEMORY,
    NS,
    OBSERVATION,
    PRICE,
    QUEUE,
    RANDOM,
    RATE,
    RATE_BELOW,
    REACH,
    RESULT,
    REWARD,
    ROW,
    SCALE,
    SIGMA,
    SIZE,
    SLOPE,
    SPEED,
    SPENT,
    STEP,
    TARGET,
    TARGET_SPEED,
    TERMINATED,
    TOLERANCE,
    TRAVEL,
    TRUNCATED,
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


@lean
def _draw_evenly(clock):
    """Draw a number between 0 and 1: splitmix64."""
    z = np.uint64(clock[RANDOM]) + np.uint64(0x9E3779B97F4A7C15)
    clock[RANDOM] = np.int64(z)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return (float(z >> np.uint64(11)) + 0.5) * 2.0**-53


@lean
def _draw(clock):
    """Draw a number from the normal distribution: the cosine of Box and Muller."""
    return math.sqrt(-2.0 * math.log(_draw_evenly(clock))) * math.cos(2.0 * math.pi * _draw_evenly(clock))


@lean
def observe(lane, clock, layout, first, log):
    """Write the observation after a step, the reward, and whether the episode is over; note the step in the log.

    Args:
        lane: the lane, with the readings; changed in place.
        clock: its whole numbers, changed in place.
        layout: what all lanes share.
        first: whether this is the start of an episode, not the end of a step.
        log: output: for each step the command, the readings and the displacement, shape (T + 1, R), or no rows.
    """
    settings, task, at = layout.settings, layout.task, layout.at
    axes, kind = settings[AXES], settings[KIND]
    width, feet = (at[JOINTS + 1] - at[JOINTS]) // 3, (at[FEET + 1] - at[FEET]) // 3
    memory, result = lane[at[MEMORY] : at[MEMORY + 1]], lane[at[RESULT] : at[RESULT + 1]]
    observation = lane[at[OBSERVATION] : at[OBSERVATION + 1]]
    # positions and efforts of the joints, velocities of the contacts, and what is commanded
    filled = 0
    for row in (0, 2):
        for j in range(at[JOINTS] + row * width + axes, at[JOINTS] + (row + 1) * width):
            observation[filled] = lane[j]
            filled += 1
    for i in range(at[FEET] + feet, at[FEET] + 2 * feet):
        observation[filled] = lane[i]
        filled += 1
    for column in layout.observed:
        observation[filled] = lane[at[ROW] + column]
        filled += 1
    # where the body is along the direction of the task
    along = 0.0
    for d in range(axes):
        memory[d] = 0.0
        for j in range(width):
            memory[d] += layout.weights[d, j] * lane[at[JOINTS] + j]
        along += task[DIRECTION + d] * memory[d]
    if first:
        memory[axes + FURTHEST] = memory[axes + BEGAN] = result[ALONG] = along
    else:
        clock[STEP] += 1
    # what the task asks for, and what the step gained of it
    gained = along - result[ALONG]
    distance = 0.0
    if kind == TRAVEL:
        memory[axes + FURTHEST] = max(memory[axes + FURTHEST], along)
        observation[filled] = memory[axes + FURTHEST] - along
        filled += 1
    elif kind == SPEED:
        now, before = end_of_step(settings, clock[STEP]), end_of_step(settings, clock[STEP] - 1)
        error = memory[axes + BEGAN] + task[TARGET_SPEED] * (now / NS) - along
        distance = abs(error)
        gained = task[TARGET_SPEED] * ((now - before) / NS) - (distance - memory[axes + DISTANCE])
        observation[filled] = error
        filled += 1
    else:
        for d in range(axes):
            error = task[DIRECTION + axes + d] - memory[d]
            distance += error * error
            observation[filled] = error
            filled += 1
        distance = math.sqrt(distance)
        gained = memory[axes + DISTANCE] - distance
    memory[axes + DISTANCE] = distance
    # noise and bounds of the observation
    sigma = lane[at[SIGMA]]
    for o in range(filled):
        value = observation[o]
        if sigma > 0.0:
            value += sigma * layout.spans[SCALE, o] * _draw(clock)
        observation[o] = min(max(value, -layout.spans[BOUND, o]), layout.spans[BOUND, o])
    # the reward: what was gained less the price of the work
    result[ALONG] = along
    result[SPENT] = 0.0 if first else lane[at[ACCOUNT] + WORK]
    result[GAINED] = 0.0 if first else gained
    result[REWARD] = result[GAINED] - task[PRICE] * result[SPENT]
    result[TERMINATED] = 1.0 if not first and kind == REACH and distance <= task[TOLERANCE] else 0.0
    result[TRUNCATED] = 1.0 if not first and 0 < settings[LIMIT] <= clock[STEP] else 0.0
    if clock[STEP] < log.shape[0]:
        line = log[clock[STEP]]
        filled = 0
        for which in (ROW, JOINTS, FEET, DISPLACEMENT):
            for j in range(at[which], at[which + 1]):
                line[filled] = lane[j]
                filled += 1


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


@entry
def observe_some(lanes, clocks, which, floats, ints, first, logs):
    """Observe environments whose readings were completed outside.

    Args:
        lanes: the memory of each environment, shape (M, B), changed in place.
        clocks: whole numbers of each, shape (M, 4), changed in place.
        which: the environments, shape (K,).
        floats: shared numbers, see `open_layout`.
        ints: shared whole numbers, see `open_layout`.
        first: whether this is the start of their episodes.
        logs: output, see `observe`, shape (M, T + 1, R), or (M, 0, R).
    """
    layout = open_layout(floats, ints)
    for m in which:
        observe(lanes[m], clocks[m], layout, first, logs[m])
