"""Many ticks of a body on a line in one compiled call, with the sensor readings at the ends of some of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled import compiled
from ..motion.account import empty_account
from ..motion.line.follow import follow
from ..motion.line.motion import LineMotion
from .crawler import Crawler
from .readout import Readout, read_records


def runs_in_one_call(crawler: Crawler) -> bool:
    """Determine whether `follow_ticks` applies to a crawler.

    Args:
        crawler: the crawler.

    Returns:
        True for links on a line without backlash or loads, on ground that is the same everywhere, none of which
        pulls however short it is: other bodies, which nothing may hold, are followed tick by tick.
    """
    motion, body = crawler._motion, crawler.body
    simple = body.backlash is None and not body.segments and not crawler.scene.columns.loads
    held = not any(bend.pulls_on for bend in body.bends)
    return isinstance(motion, LineMotion) and motion.track is None and simple and held


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
        The account of each tick, shape (K, 15).
    """
    accounts = empty_account(read.size)
    line: Any = crawler._state
    motion: Any = crawler._motion
    scratch: Any = crawler._scratch
    scratch.budget[0], scratch.exact[0] = crawler.budget, crawler.method == "exact"
    ticks = (first, seconds, read, readout.joints, readout.seen)
    output = (accounts, of_joints, of_contacts, moved)
    memory = motion.memory_for(line, scratch)
    _follow_ticks(line.contacts, line.springs, scratch.ramps, memory, targets, ticks, output)
    crawler._row = None if targets.shape[0] else crawler._row
    return accounts


@compiled
def _follow_ticks(contacts, springs, ramps, memory, targets, ticks, output):
    """Follow and read ticks: arguments as for `follow` in `motion.line.follow`, `read_records` and `follow_ticks`."""
    first, seconds, read, joints, seen = ticks
    accounts, of_joints, of_contacts, moved = output
    records = np.empty((0, 0))
    row = 0
    for tick in range(read.shape[0]):
        ends = targets[first[tick] : first[tick + 1]]
        follow(contacts, springs, ramps, memory, ends, accounts[tick], records)
        if read[tick]:
            read_records(contacts, springs, joints, seen, seconds[tick], of_joints[row], of_contacts[row])
            for i in range(contacts.shape[0]):
                moved[row, 0, i] = contacts[i].x
                moved[row, 1, i] = contacts[i].gained
            row += 1
