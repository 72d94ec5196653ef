"""Detection of rests in a run, and their reasons: no commands, or forces too small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model.body.drive import NS

from .cycle_table import Cycle
from .ramps import RampTable

_LEAST_S = 1.0
"""A shorter rest is not reported where the commands do not repeat."""


@dataclass(frozen=True)
class Rest:
    """A rest that lasts at least a cycle of the commands.

    Attributes:
        run: number of the run between resets.
        since: when the slip before it ended [s]; the start of the run when there was none.
        until: when the next slip begins [s]; the end of the run when there is none.
        commanded_from: when commands began to change meanwhile [s]; None if they did not, or are not known.
        margin: least distance of a spring force from its bound meanwhile [N]; None when forces are not known.
        commands_known: whether commands were recorded.
    """

    run: int
    since: float
    until: float
    commanded_from: float | None
    margin: float | None
    commands_known: bool

    @property
    def commanded(self) -> bool | None:
        """Whether commands changed meanwhile; None if they are not known."""
        return self.commanded_from is not None if self.commands_known else None

    def as_plain(self) -> dict[str, Any]:
        """Convert to plain values for JSON.

        Returns:
            The attributes by name.
        """
        return {**self.__dict__, "commanded": self.commanded}

    def explain(self) -> str:
        """Describe the rest in one line.

        Returns:
            Its time and its reason.
        """
        rest = f"at rest from {self.since:g} s to {self.until:g} s"
        if not self.commands_known:
            return f"{rest}: the commands in force were not recorded"
        if self.commanded_from is None:
            return f"{rest}: no command changed"
        near = "" if self.margin is None else f" (the nearest stayed {self.margin:.3g} N away)"
        begin = f" from {self.commanded_from:g} s on" if self.commanded_from > self.since else ""
        return f"{rest}: commands changed{begin}, but no spring force exceeded its bound{near}"


def find_rests(table: RampTable, cycles: Sequence[Cycle]) -> tuple[Rest, ...]:
    """Find the rests that last at least as long as the longest cycle, without cycles at least a second.

    Args:
        table: the ramps of the recording.
        cycles: its cycles.

    Returns:
        The rests in order.
    """
    least = max((cycle.end - cycle.start for cycle in cycles), default=_LEAST_S) * NS
    found = []
    for run in np.unique(table.run).tolist():
        rows = np.flatnonzero(table.run == run)
        start, end, margin = table.start_ns[rows], table.end_ns[rows], table.margin[rows]
        slides = (table.forward + table.backward)[rows] > 0.0
        since = np.concatenate((start[:1], end[slides]))
        until = np.append(start[slides], end[-1])
        _, path = table.path(run)
        changing = np.flatnonzero(path.moved())  # ramps that change a command
        begins, changes = path.time_ns[changing], path.time_ns[changing + 1]
        for k in np.flatnonzero(until - since >= max(least, 1.0)).tolist():
            inside = margin[(end > since[k]) & (start < until[k])]  # the slip may begin with a ramp of no duration
            first, last = np.searchsorted(changes, since[k], side="right"), np.searchsorted(begins, until[k])
            known = inside.size > 0 and bool(np.isfinite(inside).all())
            nearest = max(float(inside.min()), 0.0) if known else None
            begin = float(max(begins[first], since[k])) / NS if last > first else None
            times = float(since[k]) / NS, float(until[k]) / NS
            found.append(Rest(run, *times, begin, nearest, table.commanded))
    return tuple(found)
