"""From readings to an observation, a reward, and whether the episode is over."""

from __future__ import annotations

import math

import numpy as np

from crawler_model.compiled import entry, lean

from .layout import (
    ALONG,
    AXES,
    BEGAN,
    BOUND,
    DIRECTION,
    DISPLACEMENT,
    FEET,
    FURTHEST,
    JOINTS,
    MEMORY,
    OBSERVATION,
    RANDOM,
    RESULT,
    ROW,
    SCALE,
    SIGMA,
    STEP,
    open_layout,
)
from .reward import measure_task, write_reward


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
    """Write the observation after a step, then the reward; note the step in the log.

    Args:
        lane: the lane, with the readings; changed in place.
        clock: its whole numbers, changed in place.
        layout: what all lanes share.
        first: whether this is the start of an episode, not the end of a step.
        log: output: for each step the command, the readings and the displacement, shape (T + 1, R), or no rows.
    """
    task, at, axes = layout.task, layout.at, layout.settings[AXES]
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
    filled, gained, distance = measure_task(memory, clock, layout, along, result[ALONG], observation, filled)
    # noise and bounds of the observation
    sigma = lane[at[SIGMA]]
    for o in range(filled):
        value = observation[o]
        if sigma > 0.0:
            value += sigma * layout.spans[SCALE, o] * _draw(clock)
        observation[o] = min(max(value, -layout.spans[BOUND, o]), layout.spans[BOUND, o])
    write_reward(lane, clock, layout, first, along, gained, distance)
    if clock[STEP] < log.shape[0]:
        line = log[clock[STEP]]
        filled = 0
        for which in (ROW, JOINTS, FEET, DISPLACEMENT):
            for j in range(at[which], at[which + 1]):
                line[filled] = lane[j]
                filled += 1


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
