"""The courses of runs: which ramps a run follows, in blocks that fit in memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from crawler_model.body.body import Body
from crawler_model.body.drive import NS, Drive

_BLOCK, _NUMBERS = 4096, 4_000_000
"""Upper limits of the ramps followed in one call, and of the numbers recorded for them."""


def most_ramps(body: Body) -> int:
    """Compute how many ramps are followed in one call.

    Args:
        body: the body.

    Returns:
        The number of ramps, at least 1.
    """
    return min(_BLOCK, max(_NUMBERS // (body.dimension * (2 * body.contacts + body.springs)), 1))


def exact_course(drive: Drive, end_ns: int, most: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Find the ramps of a run from waypoint to waypoint, in blocks of whole periods.

    Args:
        drive: the drive, of W waypoints.
        end_ns: duration of the run [ns].
        most: number of ramps in a block, about.

    Yields:
        The waypoints that end the ramps of a block, and which of these ramps end a period, int64. A run that does not
        end at a waypoint has a last ramp to "waypoint" W.
    """
    period, waypoints = drive.period, drive.times.size
    after, periods = 0, max(most // waypoints, 1)
    while after < end_ns:
        until = end_ns
        if period is not None:
            count = round(after / NS / period) + periods
            until = min(int(np.rint(period * count * NS)), end_ns)
        way_ns, rows = drive.waypoints_between(after, until)
        ends = np.flatnonzero(rows == 0) if period is not None else np.zeros(0, np.int64)
        if not way_ns.size or way_ns[-1] != until:
            rows = np.append(rows, waypoints)
        yield rows, ends
        after = until
