"""The inertia number of a simulator: the ramps of its ticks, with their times, for the meter of the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crawler_model.body.columns import Columns
from crawler_model.run.inertia import InertiaMeter

from .intake.commanded_path import Vertices


def add_ticks(
    meter: InertiaMeter,
    columns: Columns,
    taken: Vertices,
    x: Sequence[np.ndarray] = (),
    jumped: Sequence[int] = (),
) -> None:
    """Add K ticks; what is left of a tick after its vertices holds.

    Args:
        meter: the meter.
        columns: the layout of the commands.
        taken: what the ticks followed.
        x: displacement at the end of each, shape (N,), in the plane (N, 2) [m]; needed where the meter
            follows no pieces and takes each tick as one ramp.
        jumped: ticks in which the body jumped.
    """
    targets = np.vstack((meter.target, columns.target(taken.rows)))
    start_ns, ends_ns, after = int(taken.times_ns[0]), taken.times_ns[1:], taken.first[1:]
    if not meter.follows_pieces:
        meter.add_ramps(targets[after], start_ns, ends_ns, np.array(x), jumped)
        return
    due = np.insert(taken.due_ns, after, ends_ns)
    order = np.insert(np.arange(1, taken.due_ns.size + 1), after, after)  # targets[v] is in force after v vertices
    meter.add_ramps(np.ascontiguousarray(targets[order]), start_ns, np.maximum.accumulate(np.maximum(due, start_ns)))
