"""Many ticks of a chain in one compiled call, with the sensor readings at the ends of some of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled import compiled
from ..motion.chain.ramp import follow
from ..motion.state import ACCOUNT_SIZE, GAINED, VISITED, X
from .crawler import Crawler
from .readout import Readout, read_line


def runs_in_one_call(crawler: Crawler) -> bool:
    """Determine whether `follow_ticks` applies to a crawler.

    Args:
        crawler: the crawler.

    Returns:
        True for a chain of links on ground that is the same everywhere: other bodies are followed tick by tick.
    """
    body, scene = crawler.body, crawler.scene
    return body.dimension == 1 and body.is_chain and not body.segments and scene.ground.track is None


def follow_ticks(
    crawler: Crawler,
    readout: Readout,
    targets: np.ndarray,
    first: np.ndarray,
    seconds: np.ndarray,
    read: np.ndarray,
    of_joints: np.ndarray,
    of_contacts: np.ndarray,
    moved: np.ndarray,
) -> np.ndarray:
    """Follow K ticks, each as `Crawler.follow` does, and read R of them as `Readout.read` does, all to the same bits.

    Args:
        crawler: the crawler, for which `runs_in_one_call` is true.
        readout: the readout of its body.
        targets: rows as returned by `Crawler.target`, of all ticks, shape (V, F).
        first: the first row of each tick, then V, shape (K + 1,).
        seconds: duration of each tick, shape (K,) [s].
        read: whether to read each tick at its end, R times true, shape (K,).
        of_joints: output: as for `Readout.read`, shape (R, 3, 1 + J).
        of_contacts: output: as for `Readout.read`, shape (R, 3, M).
        moved: output: displacement, and displacement gained in the tick, shape (R, 2, N) [m].

    Returns:
        The account of each tick, shape (K, 14).
    """
    accounts = np.zeros((seconds.size, ACCOUNT_SIZE))
    accounts[:, VISITED] = np.inf
    body, state = crawler.body, crawler._state
    line: Any = state
    _follow_ticks(
        body.elasticity,
        line.contacts,
        line.links,
        line.status,
        targets,
        first,
        crawler.method == "exact",
        crawler.budget,
        body.element_ends,
        body.share,
        *crawler._scratch,
        accounts,
        body.ends,
        readout.joints,
        readout.shown,
        body.position,
        readout.pull,
        seconds,
        read,
        of_joints,
        of_contacts,
        moved,
    )
    crawler._row = None if targets.shape[0] else crawler._row
    return accounts


@compiled
def _follow_ticks(
    elasticity,
    contacts,
    links,
    status,
    targets,
    first,
    exact,
    budget,
    elements,
    share,
    floats,
    bytes_,
    tree,
    stacks,
    long_floats,
    long_ints,
    accounts,
    ends,
    joints,
    shown,
    position,
    pull,
    seconds,
    read,
    of_joints,
    of_contacts,
    moved,
):
    """Follow and read ticks: arguments as for `follow` in `motion.chain.ramp`, `read_line` and `follow_ticks`."""
    records = np.empty((0, 0))
    pieces = np.empty((0, 0))
    row = 0
    for tick in range(seconds.shape[0]):
        follow(
            elasticity,
            contacts,
            links,
            status,
            targets[first[tick] : first[tick + 1]],
            exact,
            budget,
            elements,
            share,
            floats,
            bytes_,
            tree,
            stacks,
            long_floats,
            long_ints,
            accounts[tick],
            records,
            pieces,
        )
        if read[tick]:
            read_line(
                contacts,
                links,
                ends,
                joints,
                shown,
                position,
                pull,
                seconds[tick],
                of_joints[row],
                of_contacts[row],
            )
            moved[row, 0] = contacts[X]
            moved[row, 1] = contacts[GAINED]
            row += 1
