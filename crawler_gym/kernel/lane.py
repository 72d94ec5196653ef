"""Lanes: the memory of an environment, from an action to a command and from a state to an observation.

A lane is one row of an array of doubles. It holds everything that differs between environments, so that a compiled
call has few arguments, and a lane is copied or reset as one piece. Its parts, and those of the numbers that all lanes
share, are found by offsets. The motion between command and observation is that of the model.
"""

from __future__ import annotations

import math

import numpy as np

from crawler_model.compiled import compiled
from crawler_model.crawler.readout import read_line
from crawler_model.motion.state import VISITED, WORK

(
    CONTACTS,  # rows of the contacts, see `crawler_model.motion.state`
    LINKS,  # rows of the springs, likewise
    ELASTICITY,  # k and 1 / k of each spring
    BANDS,  # band matrix of a graph; nothing for chains
    SLOPE,  # what the slope adds to the load of each contact; nothing without loads
    ROW,  # the command in force
    TARGET,  # the same for the kernels
    ACCOUNT,  # account of the last ramp
    JOINTS,  # readings of the root and the joints: positions, velocities, efforts
    FEET,  # readings of the contacts, likewise
    MEMORY,  # what the task remembers: place, then the three entries below
    QUEUE,  # the last actions, as many as the largest delay needs
    SIGMA,  # standard deviation of the noise of the sensors, relative to their scales
    RESULT,  # rows of results below
) = range(14)
"""Parts of a lane."""
FURTHEST, DISTANCE, BEGAN = range(3)
"""Entries of the memory behind the place: furthest place along the direction [m], size of the last error [m], place
along the direction at the start [m]."""
REWARD, GAINED, SPENT, ALONG = range(4)
"""Results of a step: reward [m], what the task gained [m], work of the actuators [J], place along the direction [m]."""

STEP, DELAY, RANDOM = range(3)
"""Whole numbers of a lane: steps done, delay of the actions in steps, state of the generator of noise."""

SIZE, LOW, HIGH = range(3)
"""Rows of the limits of a command's columns: largest change in a step, least and largest value."""
BOUND, SCALE = range(2)
"""Rows of the spans of an observation: largest size, and the size by which noise is multiplied."""

LIMITS, FACTOR, POSITION, WEIGHTS, SPANS, TASK = range(6)
"""Parts of the numbers that all lanes share. TASK holds the entries below, the direction, and the place to reach."""
TARGET_SPEED, TOLERANCE, PRICE = range(3)
"""Entries of a task: speed to keep [m/s], tolerance [m], price of work [m/J]."""
_TASK_ENTRIES = 3

OF, INDEX, STATIONS, SHOWN, ENDS, OBSERVED = range(6)
"""Parts of the whole numbers that all lanes share: action of each column or -1; column of each entry of a target;
contacts and springs of the joints; contacts that are read; ends of the springs; columns that are observed."""

KIND, AXES, LIMIT, RATE, RATE_BELOW, ROUNDS = range(6)
"""Settings: kind of task, dimensions, steps of an episode (0 for no limit), steps per second as a ratio."""
TRAVEL, SPEED, REACH = range(3)
"""Kinds of task."""

_NS = 1_000_000_000


@compiled
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


@compiled
def part(lane, at, which):
    """Find a part of a lane, or of shared numbers.

    Args:
        lane: the numbers.
        at: the first place of each part, and the end.
        which: the part.

    Returns:
        A view of it.
    """
    return lane[at[which] : at[which + 1]]


@compiled
def end_of_step(settings, step):
    """Compute the time at which a step ends, rounded as the ends of ticks are.

    Args:
        settings: see KIND .. ROUNDS.
        step: its number, 0 for the start.

    Returns:
        Simulated time [ns].
    """
    return step * _NS * settings[RATE_BELOW] // settings[RATE]


@compiled
def command(lane, clock, action, lane_at, floats, floats_at, ints, ints_at):
    """Turn an action into the next command, and a command that friction cannot hold into the one in force.

    Args:
        lane: the lane, changed in place.
        clock: its whole numbers.
        action: rates, from -1 to 1, clipped; shape (A,).
        lane_at: offsets of the parts of a lane.
        floats: shared numbers.
        floats_at: their offsets.
        ints: shared whole numbers.
        ints_at: their offsets.
    """
    actions = action.shape[0]
    queue = part(lane, lane_at, QUEUE)
    slots = queue.shape[0] // actions
    first = (clock[STEP] % slots) * actions
    for a in range(actions):
        queue[first + a] = min(max(action[a], -1.0), 1.0)
    given = clock[STEP] - clock[DELAY]
    if given < 0:
        return
    first = (given % slots) * actions
    of = part(ints, ints_at, OF)
    row = part(lane, lane_at, ROW)
    limits = part(floats, floats_at, LIMITS)
    columns = of.shape[0]
    loaded = lane_at[SLOPE + 1] > lane_at[SLOPE]
    held = row.copy() if loaded else row
    for c in range(columns):
        if of[c] >= 0:
            value = row[c] + limits[SIZE * columns + c] * queue[first + of[c]]
            row[c] = min(max(value, limits[LOW * columns + c]), limits[HIGH * columns + c])
    if not aim(lane, lane_at, floats, floats_at, ints, ints_at):
        row[:] = held
        aim(lane, lane_at, floats, floats_at, ints, ints_at)


@compiled
def aim(lane, lane_at, floats, floats_at, ints, ints_at):
    """Write the target of the command in force, as `Columns.target` does.

    Args:
        lane: the lane, changed in place.
        lane_at: offsets of the parts of a lane.
        floats: shared numbers.
        floats_at: their offsets.
        ints: shared whole numbers.
        ints_at: their offsets.

    Returns:
        Whether friction can hold the loads.
    """
    row, target = part(lane, lane_at, ROW), part(lane, lane_at, TARGET)
    index, factor = part(ints, ints_at, INDEX), part(floats, floats_at, FACTOR)
    for f in range(target.shape[0]):
        target[f] = row[index[f]] * factor[f]
    slope = part(lane, lane_at, SLOPE)
    n = slope.shape[0]
    if n == 0:
        return True
    first = target.shape[0] - 3 * n
    ahead, behind = 0.0, 0.0
    for i in range(n):
        load = target[first + 2 * n + i] + slope[i]
        target[first + 2 * n + i] = load
        target[first + i] -= load
        target[first + n + i] += load
        ahead += target[first + i]
        behind += target[first + n + i]
    near = -1e-12 * (ahead + behind)
    return not (ahead < near or behind < near)


@compiled
def _draw(clock):
    """Draw a number from the normal distribution: splitmix64, and the cosine of Box and Muller."""
    state = np.uint64(clock[RANDOM])
    each = np.empty(2)
    for k in range(2):
        state = state + np.uint64(0x9E3779B97F4A7C15)
        z = state
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
        each[k] = (float(z >> np.uint64(11)) + 0.5) * 2.0**-53
    clock[RANDOM] = np.int64(state)
    return math.sqrt(-2.0 * math.log(each[0])) * math.cos(2.0 * math.pi * each[1])


@compiled
def find_place(joints, weights, axes, place):
    """Compute the net translation from the readings of the joints.

    Args:
        joints: readings, shape (3, W).
        weights: of the readings, for each axis in turn, shape (axes * W,).
        axes: number of dimensions.
        place: output, shape (axes,) [m].
    """
    width = joints.shape[1]
    for d in range(axes):
        total = 0.0
        for j in range(width):
            total += weights[d * width + j] * joints[0, j]
        place[d] = total


@compiled
def observe(lane, clock, lane_at, floats, floats_at, ints, ints_at, settings, first, observation, ended):
    """Write the observation after a step, the reward, and whether the episode is over.

    Args:
        lane: the lane, with the readings; changed in place.
        clock: its whole numbers, changed in place.
        lane_at: offsets of the parts of a lane.
        floats: shared numbers.
        floats_at: their offsets.
        ints: shared whole numbers.
        ints_at: their offsets.
        settings: see KIND .. ROUNDS.
        first: whether this is the start of an episode, not the end of a step.
        observation: output: elongations [m], tensions [N], velocities of the contacts [m/s], commanded frictions [N],
            error of the task [m]; shape (O,).
        ended: output: terminated, truncated.
    """
    axes, kind = settings[AXES], settings[KIND]
    joints = part(lane, lane_at, JOINTS).reshape((3, (lane_at[JOINTS + 1] - lane_at[JOINTS]) // 3))
    feet = part(lane, lane_at, FEET).reshape((3, (lane_at[FEET + 1] - lane_at[FEET]) // 3))
    memory, result = part(lane, lane_at, MEMORY), part(lane, lane_at, RESULT)
    task, row = part(floats, floats_at, TASK), part(lane, lane_at, ROW)
    find_place(joints, part(floats, floats_at, WEIGHTS), axes, memory)
    filled = 0
    for k in (0, 2):
        for j in range(axes, joints.shape[1]):
            observation[filled] = joints[k, j]
            filled += 1
    for i in range(feet.shape[1]):
        observation[filled] = feet[1, i]
        filled += 1
    for column in part(ints, ints_at, OBSERVED):
        observation[filled] = row[column]
        filled += 1
    along = 0.0
    for d in range(axes):
        along += task[_TASK_ENTRIES + d] * memory[d]
    if first:
        memory[axes + FURTHEST] = memory[axes + BEGAN] = result[ALONG] = along
    else:
        clock[STEP] += 1
    gained = along - result[ALONG]
    distance = 0.0
    if kind == TRAVEL:
        memory[axes + FURTHEST] = max(memory[axes + FURTHEST], along)
        observation[filled] = memory[axes + FURTHEST] - along
        filled += 1
    elif kind == SPEED:
        now, before = end_of_step(settings, clock[STEP]), end_of_step(settings, clock[STEP] - 1)
        error = memory[axes + BEGAN] + task[TARGET_SPEED] * (now / _NS) - along
        distance = abs(error)
        gained = task[TARGET_SPEED] * ((now - before) / _NS) - (distance - memory[axes + DISTANCE])
        observation[filled] = error
        filled += 1
    else:
        for d in range(axes):
            error = task[_TASK_ENTRIES + axes + d] - memory[d]
            distance += error * error
            observation[filled] = error
            filled += 1
        distance = math.sqrt(distance)
        gained = memory[axes + DISTANCE] - distance
    memory[axes + DISTANCE] = distance
    spans = part(floats, floats_at, SPANS)
    sigma = lane[lane_at[SIGMA]]
    for o in range(filled):
        value = observation[o]
        if sigma > 0.0:
            value += sigma * spans[SCALE * filled + o] * _draw(clock)
        observation[o] = min(max(value, -spans[BOUND * filled + o]), spans[BOUND * filled + o])
    result[ALONG] = along
    result[SPENT] = 0.0 if first else lane[lane_at[ACCOUNT] + WORK]
    result[GAINED] = 0.0 if first else gained
    result[REWARD] = result[GAINED] - task[PRICE] * result[SPENT]
    ended[0] = not first and kind == REACH and distance <= task[TOLERANCE]
    ended[1] = not first and 0 < settings[LIMIT] <= clock[STEP]


@compiled
def note(lane, clock, lane_at, log):
    """Note the command in force and the readings in a log, from which an episode is recorded.

    Args:
        lane: the lane.
        clock: its whole numbers.
        lane_at: offsets of the parts of a lane.
        log: for each step the command, the displacement and the readings, shape (T + 1, R), or no rows.
    """
    if clock[STEP] < log.shape[0]:
        line = log[clock[STEP]]
        filled = 0
        contacts = part(lane, lane_at, CONTACTS)
        for which in (ROW, JOINTS, FEET):
            for value in part(lane, lane_at, which):
                line[filled] = value
                filled += 1
        for i in range(log.shape[1] - filled):  # the first row of the contacts is their displacement
            line[filled + i] = contacts[i]


@compiled
def begin_step(lane, clock, action, lane_at, floats, floats_at, ints, ints_at):
    """Begin a step on a line: the next command, and an empty account.

    Args:
        lane: the lane, changed in place.
        clock: its whole numbers.
        action: rates, shape (A,).
        lane_at: offsets of the parts of a lane.
        floats: shared numbers.
        floats_at: their offsets.
        ints: shared whole numbers.
        ints_at: their offsets.

    Returns:
        The parts of the lane that the motion needs: contacts and springs, the target of the ramp, and its account.
    """
    command(lane, clock, action, lane_at, floats, floats_at, ints, ints_at)
    account = part(lane, lane_at, ACCOUNT)
    account[:] = 0.0
    account[VISITED] = np.inf
    n = part(floats, floats_at, POSITION).shape[0]
    contacts = part(lane, lane_at, CONTACTS).reshape(((lane_at[CONTACTS + 1] - lane_at[CONTACTS]) // n, n))
    links = part(lane, lane_at, LINKS).reshape((5, (lane_at[LINKS + 1] - lane_at[LINKS]) // 5))
    target = part(lane, lane_at, TARGET)
    return contacts, links, target.reshape((1, target.shape[0])), account


@compiled
def end_step(
    lane, clock, lane_at, floats, floats_at, ints, ints_at, settings, pull, first, observes, observation, ended, log
):
    """End a step on a line: read the sensors, observe and note.

    Args:
        lane: the lane, changed in place.
        clock: its whole numbers, changed in place.
        lane_at: offsets of the parts of a lane.
        floats: shared numbers.
        floats_at: their offsets.
        ints: shared whole numbers.
        ints_at: their offsets.
        settings: see KIND .. ROUNDS.
        pull: memory, shape (2, N).
        first: whether this is the start of an episode.
        observes: whether to observe; False where readings of segments have to be added first.
        observation: output, shape (O,).
        ended: output: terminated, truncated.
        log: output, see `note`.
    """
    n, springs = pull.shape[1], (lane_at[LINKS + 1] - lane_at[LINKS]) // 5
    stations, shown = (ints_at[STATIONS + 1] - ints_at[STATIONS]) // 3, part(ints, ints_at, SHOWN)
    seconds = (end_of_step(settings, clock[STEP] + 1) - end_of_step(settings, clock[STEP])) / _NS
    read_line(
        part(lane, lane_at, CONTACTS).reshape(((lane_at[CONTACTS + 1] - lane_at[CONTACTS]) // n, n)),
        part(lane, lane_at, LINKS).reshape((5, springs)),
        part(ints, ints_at, ENDS).reshape((springs, 2)),
        part(ints, ints_at, STATIONS).reshape((stations, 3)),
        shown,
        part(floats, floats_at, POSITION),
        pull,
        np.inf if first else seconds,
        part(lane, lane_at, JOINTS).reshape((3, stations)),
        part(lane, lane_at, FEET).reshape((3, shown.shape[0])),
    )
    if observes:
        observe(lane, clock, lane_at, floats, floats_at, ints, ints_at, settings, first, observation, ended)
        note(lane, clock, lane_at, log)


@compiled
def begin_episodes(
    lanes,
    clocks,
    which,
    lane_at,
    floats,
    floats_at,
    ints,
    ints_at,
    settings,
    pull,
    observes,
    observations,
    ended,
    logs,
):
    """Read the sensors at the start of episodes on a line, and observe.

    Args:
        lanes: the memory of each environment, shape (M, B), changed in place.
        clocks: whole numbers of each, shape (M, 3).
        which: environments whose episodes begin, shape (K,).
        lane_at: offsets of the parts of a lane.
        floats: shared numbers.
        floats_at: their offsets.
        ints: shared whole numbers.
        ints_at: their offsets.
        settings: see KIND .. ROUNDS.
        pull: memory, shape (2, N).
        observes: as for `end_step`.
        observations: output, shape (M, O).
        ended: output, shape (M, 2).
        logs: output, shape (M, T + 1, R), or (M, 0, R).
    """
    for m in which:
        end_step(
            lanes[m],
            clocks[m],
            lane_at,
            floats,
            floats_at,
            ints,
            ints_at,
            settings,
            pull,
            True,
            observes,
            observations[m],
            ended[m],
            logs[m],
        )


@compiled
def observe_some(
    lanes,
    clocks,
    which,
    lane_at,
    floats,
    floats_at,
    ints,
    ints_at,
    settings,
    first,
    observations,
    ended,
    logs,
):
    """Observe environments whose readings were completed outside.

    Args:
        lanes: the memory of each environment, shape (M, B), changed in place.
        clocks: whole numbers of each, shape (M, 3), changed in place.
        which: the environments, shape (K,).
        lane_at: offsets of the parts of a lane.
        floats: shared numbers.
        floats_at: their offsets.
        ints: shared whole numbers.
        ints_at: their offsets.
        settings: see KIND .. ROUNDS.
        first: whether this is the start of their episodes.
        observations: output, shape (M, O).
        ended: output, shape (M, 2).
        logs: output, shape (M, T + 1, R), or (M, 0, R).
    """
    for m in which:
        observe(
            lanes[m],
            clocks[m],
            lane_at,
            floats,
            floats_at,
            ints,
            ints_at,
            settings,
            first,
            observations[m],
            ended[m],
        )
        note(lanes[m], clocks[m], lane_at, logs[m])
