"""Steps of many environments whose bodies are graphs of springs, in one compiled call."""

from __future__ import annotations

import numpy as np

from crawler_model.compiled import compiled
from crawler_model.motion.graph.ramp import follow

from .lane import begin_step, end_step
from .plan import CONDUCTANCES, ELASTICITY, ROUNDS, SKIPPED, open_plan, part


@compiled
def step_graphs(
    lanes,
    clocks,
    status,
    actions,
    floats,
    ints,
    share,
    elements,
    budget,
    layout,
    work,
    ring,
    memory,
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
        layout: fields of the `Layout` of the springs.
        work: memory from `GraphMotion.scratch`, as the next two.
        ring: a `RingMemory`; None for other bodies, and for short rings.
        memory: of a ramp.
        observes: whether to observe; False where readings of segments have to be added first.
        logs: output, see `observe`, shape (M, T + 1, R), or (M, 0, R).
    """
    plan = open_plan(floats, ints)
    springs = plan.ends.shape[0]
    records = np.empty((0, 0))
    pieces = np.empty((0, 0))
    for m in range(lanes.shape[0]):
        if clocks[m, SKIPPED]:
            continue
        lane, clock = lanes[m], clocks[m]
        contacts, links, targets, account = begin_step(lane, clock, actions[m], plan)
        follow(
            plan.ends,
            part(lane, plan, ELASTICITY)[:springs],
            (layout, part(lane, plan, CONDUCTANCES)),
            work,
            ring,
            contacts,
            links,
            status[m],
            targets,
            True,
            budget,
            elements,
            share,
            plan.settings[ROUNDS],
            memory,
            account,
            records,
            pieces,
        )
        end_step(lane, clock, plan, contacts, links, False, observes, logs[m])
