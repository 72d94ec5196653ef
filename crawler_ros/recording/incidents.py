"""Refused commands and late ticks, from the /diagnostics that a recording holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from crawler_model.errors import CommandError

from ..wire.cdr import CdrReader
from ..wire.facts import Fact, Refusal, read_count, read_number, read_refusals, rows_dropped, ticks_refused

DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
Parts = dict[str, dict[str, str]]
"""Key-value pairs by part of a node: "simulation", "commands"."""


@dataclass(frozen=True)
class Incidents:
    """What went wrong while a crawler ran, up to its last message on /diagnostics.

    Attributes:
        refused: number of refused command messages.
        refusals: the refused messages by reason, in the order of the first of each.
        dropped: number of accepted command rows that were dropped because no equilibrium holds their loads, or the
            frictions of a point do not fit together.
        held: number of ticks whose commands were refused because nothing would hold the body where they lead, or a body
            that turns cannot follow them.
        lost: number of command messages that did not arrive.
        overdue: number of trajectories that began when their last point was past.
        late: number of late ticks.
        first_late: simulated time of the first late tick [s]; None when there was none, or it was not recorded.
        worst_late: the same of the one that began latest.
        worst_delay: how late that one began [s, wall].
    """

    refused: int
    refusals: tuple[Refusal, ...]
    dropped: int
    held: int
    lost: int
    overdue: int
    late: int
    first_late: float | None
    worst_late: float | None
    worst_delay: float | None

    def explain(self) -> list[str]:
        """Describe what went wrong.

        Returns:
            A line for each reason; none when all went well.
        """
        lines = []
        for refusal in self.refusals:
            when = "" if refusal.first is None else f", the first at {refusal.first:g} s"
            when += "" if refusal.last is None or refusal.count == 1 else f", the last at {refusal.last:g} s"
            why = f": {refusal.why}" if refusal.why else ""
            lines.append(f"{refusal.count} message(s) refused on {refusal.topic}{when}{why}")
        if self.dropped:
            why = "no equilibrium holds their loads, or the frictions of a point do not fit together"
            lines.append(f"{self.dropped} command row(s) dropped: {why}")
        if self.held:
            lines.append(f"the commands of {self.held} tick(s) refused: the body could not follow them")
        if self.lost:
            lines.append(f"{self.lost} command message(s) lost on the way to the simulator")
        if self.overdue:
            lines.append(f"{self.overdue} trajectory message(s) wholly in the past, each followed within one tick")
        if self.late:
            worst = ""
            if self.worst_delay is not None and self.worst_late is not None and self.first_late is not None:
                worst = f", the first at {self.first_late:g} s, the worst by {1e3 * self.worst_delay:.3g} ms"
                worst += f" at {self.worst_late:g} s"
            lines.append(f"{self.late} late tick(s){worst}")
        return lines


def read_diagnostics(data: bytes) -> dict[str, Parts]:
    """Read a diagnostic_msgs/DiagnosticArray.

    Args:
        data: its CDR bytes, little-endian.

    Returns:
        The key-value pairs of each part of each node, named as its status, "node: part"; none where
        the bytes are not such a message.
    """
    found: dict[str, Parts] = {}
    try:
        walk = CdrReader(data)
        walk.skip(2, 4)  # stamp
        walk.text()  # frame_id
        for _ in range(walk.count()):
            walk.skip(1, 1)  # level
            name, _, _ = walk.text(), walk.text(), walk.text()
            node, _, part = name.rpartition(": ")
            found.setdefault(node, {})[part] = {walk.text(): walk.text() for _ in range(walk.count())}
    except CommandError:
        return {}
    return found


def find_incidents(nodes: Mapping[str, Parts], namespace: str) -> Incidents | None:
    """Find what went wrong with a crawler.

    Args:
        nodes: the last key-value pairs of each node on /diagnostics.
        namespace: namespace of the crawler's node.

    Returns:
        The counts; None when its diagnostics were not recorded.
    """
    own = [
        parts
        for node, parts in nodes.items()
        if "/" + node.strip("/").rpartition("/")[0] == namespace and Fact.TICKS.value in parts.get("simulation", {})
    ]
    if not own:
        return None
    simulation, commands = own[0]["simulation"], own[0].get("commands", {})
    return Incidents(
        refused=read_count(commands, Fact.REFUSED.value),
        refusals=read_refusals(commands),
        dropped=rows_dropped(commands),
        held=ticks_refused(simulation | commands),
        lost=read_count(commands, Fact.LOST.value),
        overdue=read_count(commands, Fact.OVERDUE.value),
        late=read_count(simulation, Fact.LATE_TICKS.value),
        first_late=read_number(simulation, Fact.FIRST_LATE),
        worst_late=read_number(simulation, Fact.WORST_LATE),
        worst_delay=read_number(simulation, Fact.WORST_DELAY),
    )
