"""What a step of a task gains, the reward, and whether the episode is over."""

from __future__ import annotations

import math

from crawler_model.compiled import lean
from crawler_model.motion.account import WORK

from .command import end_of_step
from .layout import (
    ACCOUNT,
    ALONG,
    AXES,
    BEGAN,
    DIRECTION,
    DISTANCE,
    FURTHEST,
    GAINED,
    KIND,
    LIMIT,
    NS,
    PRICE,
    REACH,
    RESULT,
    REWARD,
    SPEED,
    SPENT,
    STEP,
    TARGET_SPEED,
    TERMINATED,
    TOLERANCE,
    TRAVEL,
    TRUNCATED,
)


@lean
def measure_task(memory, clock, layout, along, before, observation, filled):
    """Measure what the task asks for, and what the step gained of it.

    Args:
        memory: of the lane, with the place of the body; changed in place.
        clock: whole numbers of the lane.
        layout: what all lanes share.
        along: place of the body along the direction of the task [m].
        before: that place at the beginning of the step [m].
        observation: output: what the task adds to it.
        filled: how many numbers it has.

    Returns:
        How many numbers the observation has then, what was gained, and the distance from the goal [m].
    """
    settings, task, axes, kind = layout.settings, layout.task, layout.settings[AXES], layout.settings[KIND]
    gained = along - before
    distance = 0.0
    if kind == TRAVEL:
        memory[axes + FURTHEST] = max(memory[axes + FURTHEST], along)
        observation[filled] = memory[axes + FURTHEST] - along
        filled += 1
    elif kind == SPEED:
        end, begin = end_of_step(settings, clock[STEP]), end_of_step(settings, clock[STEP] - 1)
        error = memory[axes + BEGAN] + task[TARGET_SPEED] * (end / NS) - along
        distance = abs(error)
        gained = task[TARGET_SPEED] * ((end - begin) / NS) - (distance - memory[axes + DISTANCE])
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
    return filled, gained, distance


@lean
def write_reward(lane, clock, layout, first, along, gained, distance):
    """Write the reward, which is what was gained less the price of the work, and whether the episode is over.

    Args:
        lane: the lane, changed in place.
        clock: its whole numbers.
        layout: what all lanes share.
        first: whether this is the start of an episode, which has no reward.
        along: place of the body along the direction of the task [m].
        gained: see `measure_task`.
        distance: see `measure_task`.
    """
    settings, task, at = layout.settings, layout.task, layout.at
    kind, result = settings[KIND], lane[at[RESULT] : at[RESULT + 1]]
    result[ALONG] = along
    result[SPENT] = 0.0 if first else lane[at[ACCOUNT] + WORK]
    result[GAINED] = 0.0 if first else gained
    result[REWARD] = result[GAINED] - task[PRICE] * result[SPENT]
    result[TERMINATED] = 1.0 if not first and kind == REACH and distance <= task[TOLERANCE] else 0.0
    result[TRUNCATED] = 1.0 if not first and 0 < settings[LIMIT] <= clock[STEP] else 0.0
