"""Steps of many environments whose bodies move on a line, in one compiled call."""

from __future__ import annotations

import numpy as np

from crawler_model.compiled import entry, lean
from crawler_model.crawler.readout import read_records
from crawler_model.motion.account import VISITED
from crawler_model.motion.line.follow import follow

from .command import command, end_of_step
from .layout import ACCOUNT, DISPLACEMENT, FEET, JOINTS, NS, SKIPPED, STEP, TARGET, open_layout
from .observe import observe


@lean
def _read(lane, clock, layout, contacts, springs, seen, first):
    """Read the sensors of an environment after a step, or at the start of its episode."""
    settings = layout.settings
    seconds = np.inf
    if not first:
        seconds = (end_of_step(settings, clock[STEP] + 1) - end_of_step(settings, clock[STEP])) / NS
    at = layout.at
    joints, feet = lane[at[JOINTS] : at[JOINTS + 1]], lane[at[FEET] : at[FEET + 1]]
    joints, feet = joints.reshape((3, joints.shape[0] // 3)), feet.reshape((3, feet.shape[0] // 3))
    read_records(contacts, springs, layout.stations, seen, seconds, joints, feet)
    displacement = lane[at[DISPLACEMENT] : at[DISPLACEMENT + 1]]
    for i in range(contacts.shape[0]):
        displacement[i] = contacts[i].x


@entry
def step_lanes(lanes, clocks, bodies, actions, shared, memory, logs):
    """Advance environments by one step: action, motion, readings, observation and reward.

    Args:
        lanes: the memory of each environment, shape (M, B), changed in place.
        clocks: whole numbers of each, shape (M, 4), changed in place.
        bodies: CONTACT, shape (M, N), and SPRING, shape (M, S), changed in place.
        actions: finite, shape (M, A).
        shared: numbers and whole numbers, see `open_layout`; SEEN of the contacts that are read, shape (K,); and
            whether to observe, False where readings of segments have to be added first.
        memory: RAMP, with the budget and the method, shape (1,), and the fields of a `Model`.
        logs: output, see `observe`, shape (M, T + 1, R), or (M, 0, R).
    """
    contacts, springs = bodies
    floats, ints, seen, observes = shared
    ramps, model = memory
    layout = open_layout(floats, ints)
    for m in range(lanes.shape[0]):
        if clocks[m, SKIPPED]:
            continue
        lane, clock = lanes[m], clocks[m]
        command(lane, clock, actions[m], layout)
        account = lane[layout.at[ACCOUNT] : layout.at[ACCOUNT + 1]]
        target = lane[layout.at[TARGET] : layout.at[TARGET + 1]]
        for k in range(account.shape[0]):  # a loop is faster than a slice
            account[k] = 0.0
        account[VISITED] = np.inf
        follow(contacts[m], springs[m], ramps, model, target.reshape((1, target.shape[0])), account, logs[m, :0])
        _read(lane, clock, layout, contacts[m], springs[m], seen, False)
        if observes:
            observe(lane, clock, layout, False, logs[m])


@entry
def begin_episodes(lanes, clocks, bodies, which, shared, logs):
    """Read the sensors at the start of episodes, and observe.

    Args:
        lanes: the memory of each environment, shape (M, B), changed in place.
        clocks: whole numbers of each, shape (M, 4), changed in place.
        bodies: as for `step_lanes`.
        which: environments whose episodes begin, shape (K,).
        shared: as for `step_lanes`.
        logs: output, see `observe`, shape (M, T + 1, R), or (M, 0, R).
    """
    contacts, springs = bodies
    floats, ints, seen, observes = shared
    layout = open_layout(floats, ints)
    for m in which:
        _read(lanes[m], clocks[m], layout, contacts[m], springs[m], seen, True)
        if observes:
            observe(lanes[m], clocks[m], layout, True, logs[m])
