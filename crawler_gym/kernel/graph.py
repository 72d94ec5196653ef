"""Steps of many environments whose bodies are graphs of springs, in one compiled call."""

from __future__ import annotations

import numpy as np

from crawler_model.compiled import compiled
from crawler_model.motion.graph.ramp import follow

from .lane import BANDS, ELASTICITY, ENDS, ROUNDS, begin_step, end_step, part


@compiled
def step_graphs(
    lanes,
    clocks,
    status,
    actions,
    skipped,
    lane_at,
    floats,
    floats_at,
    ints,
    ints_at,
    settings,
    share,
    elements,
    budget,
    order,
    work,
    body_floats,
    changes,
    bytes_,
    pull,
    observes,
    observations,
    ended,
    logs,
):
    """Advance environments by one step: action, motion, readings, observation and reward.

    Args:
        lanes: the memory of each environment, shape (M, B), changed in place.
        clocks: whole numbers of each, shape (M, 3), changed in place.
        status: bits of the contacts, int8, shape (M, N), changed in place.
        actions: finite, shape (M, A).
        skipped: environments that do not move, shape (M,).
        lane_at: offsets of the parts of a lane, see `lane`.
        floats: shared numbers.
        floats_at: their offsets.
        ints: shared whole numbers.
        ints_at: their offsets.
        settings: see KIND .. ROUNDS.
        share: weight of each contact in the net translation, shape (N,).
        elements: both contacts of each element of a segment, shape (P, 2).
        budget: upper limit of work in a ramp.
        order: order of the contacts in the band matrices, shape (N,).
        work: memory from `active_set.workspace`.
        body_floats: memory from `scratch`, like the next two.
        changes: floats of the springs.
        bytes_: flags of the contacts.
        pull: memory, shape (2, N).
        observes: whether to observe; False where readings of segments have to be added first.
        observations: output, shape (M, O).
        ended: output: terminated, truncated, shape (M, 2).
        logs: output, see `note`, shape (M, T + 1, R), or (M, 0, R).
    """
    n, springs = status.shape[1], (ints_at[ENDS + 1] - ints_at[ENDS]) // 2
    ends, width = part(ints, ints_at, ENDS).reshape((springs, 2)), (lane_at[BANDS + 1] - lane_at[BANDS]) // n
    records = np.empty((0, 0))
    pieces = np.empty((0, 0))
    for m in range(lanes.shape[0]):
        if skipped[m]:
            continue
        lane, clock = lanes[m], clocks[m]
        contacts, links, targets, account = begin_step(
            lane, clock, actions[m], lane_at, floats, floats_at, ints, ints_at
        )
        follow(
            ends,
            part(lane, lane_at, ELASTICITY)[:springs],
            (order, part(lane, lane_at, BANDS).reshape((n, width))),
            work,
            contacts,
            links,
            status[m],
            targets,
            True,
            budget,
            elements,
            share,
            settings[ROUNDS],
            body_floats,
            changes,
            bytes_,
            account,
            records,
            None,
            None,
            pieces,
        )
        end_step(
            lane,
            clock,
            lane_at,
            floats,
            floats_at,
            ints,
            ints_at,
            settings,
            pull,
            False,
            observes,
            observations[m],
            ended[m],
            logs[m],
        )
