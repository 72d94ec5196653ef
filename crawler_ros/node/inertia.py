"""The inertia number of a simulator: the ramps of its ticks, with their times, for the meter of the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crawler_model import Crawler
from crawler_model.body.columns import Columns
from crawler_model.crawler.step import Step
from crawler_model.run.inertia import InertiaMeter

from .intake.commanded_path import Vertex, Vertices


def add_tick(
    meter: InertiaMeter | None, crawler: Crawler, step: Step, vertices: Sequence[Vertex], span_ns: tuple[int, int]
) -> None:
    """Add a tick.

    Args:
        meter: the meter; None for a scene without masses and weights.
        crawler: the crawler at its end.
        step: the account of the tick.
        vertices: what it followed; none if it held.
        span_ns: simulated time at its start and at its end [ns].
    """
    if meter is None:
        return
    start_ns, end_ns = span_ns
    if meter.follows_pieces:
        due = np.array([v.due_ns for v in vertices], np.int64)
        rows = np.array([v.row for v in vertices]).reshape(len(vertices), crawler.scene.columns.count)
        first, ends = np.array([0, len(vertices)]), np.array([end_ns])
        add_ticks(meter, crawler.scene.columns, Vertices(due, rows, first, -1), start_ns, ends)
        return
    target = crawler.scene.columns.target(vertices[-1].row[None]) if vertices else meter.target[None]
    meter.add(target, start_ns, np.array([end_ns]), crawler.displacement[None], [0] if step.jumps else ())


def add_ticks(
    meter: InertiaMeter | None, columns: Columns, taken: Vertices, start_ns: int, ends_ns: np.ndarray
) -> None:
    """Add several ticks of a body whose pieces the meter follows; what is left of a tick after its vertices holds.

    Args:
        meter: the meter; None for a scene without masses and weights.
        columns: the layout of the commands.
        taken: the vertices of the ticks.
        start_ns: simulated time at the start of the first [ns].
        ends_ns: simulated time at the end of each, shape (K,) [ns].
    """
    if meter is None:
        return
    targets = np.vstack((meter.target, columns.target(taken.rows))) if taken.due_ns.size else meter.target[None]
    after = taken.first[1:]
    due = np.insert(taken.due_ns, after, ends_ns)
    order = np.insert(np.arange(1, taken.due_ns.size + 1), after, after)  # targets[v] is in force after v vertices
    meter.add(np.ascontiguousarray(targets[order]), start_ns, np.maximum.accumulate(np.maximum(due, start_ns)))
