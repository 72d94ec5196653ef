"""Steps of many environments whose bodies are chains, in one compiled call."""

from __future__ import annotations

import numpy as np

from crawler_model.compiled import compiled
from crawler_model.motion.chain.ramp import follow

from .lane import begin_step, end_step
from .plan import ELASTICITY, SKIPPED, open_plan, part


@compiled
def step_chains(
    lanes,
    clocks,
    status,
    actions,
    floats,
    ints,
    share,
    elements,
    budget,
    body_floats,
    bytes_,
    tree,
    stacks,
    long_floats,
    long_ints,
    observes,
    logs,
):
    """Advance environments by one step: action, motion, readings, observation and reward.

    Args:
        lanes: the memory of each environment, shape (M, B), changed in place.
        clocks: whole numbers of each, shape (M, 4), changed in place.
        status: bits of the contacts, int8, shape (M, N), changed in place.
        actions: finite, shape (M, A).
        floats: shared numbers, see `open_plan`.
        ints: shared whole numbers, likewise.
        share: weight of each contact in the net translation, shape (N,).
        elements: both contacts of each element of a segment, shape (P, 2).
        budget: upper limit of work in a ramp.
        body_floats: memory from `scratch(N)`, like the next five.
        bytes_: statuses within a ramp.
        tree: tournament of the next events of the contacts.
        stacks: memory for `project`.
        long_floats: memory for long blocks.
        long_ints: likewise.
        observes: whether to observe; False where readings of segments have to be added first.
        logs: output, see `observe`, shape (M, T + 1, R), or (M, 0, R).
    """
    plan = open_plan(floats, ints)
    n = status.shape[1]
    records = np.empty((0, 0))
    pieces = np.empty((0, 0))
    for m in range(lanes.shape[0]):
        if clocks[m, SKIPPED]:
            continue
        lane, clock = lanes[m], clocks[m]
        contacts, links, targets, account = begin_step(lane, clock, actions[m], plan)
        follow(
            part(lane, plan, ELASTICITY).reshape((2, n - 1)),
            contacts,
            links,
            status[m],
            targets,
            True,
            budget,
            elements,
            share,
            body_floats,
            bytes_,
            tree,
            stacks,
            long_floats,
            long_ints,
            account,
            records,
            pieces,
        )
        end_step(lane, clock, plan, contacts, links, False, observes, logs[m])
