"""Refused commands and late ticks, from the /diagnostics that a recording holds."""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass

from .layouts import Walk

DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
Parts = dict[str, dict[str, str]]
"""Key-value pairs by part of a node: "simulation", "commands"."""

_REASON = re.compile(r"refused on (?P<topic>\S+): (?P<why>.*)", re.S)
_TIMES = re.compile(r"(?P<count>\d+), first at (?P<first>\S+) s, last at (?P<last>\S+) s")
_TOPIC = "refused on "


@dataclass(frozen=True)
class Refusal:
    """Command messages that were refused for one reason.

    Attributes:
        topic: the topic on which they arrived.
        why: the reason, in the words of the first of them; empty where it was not recorded.
        count: number of messages.
        first: simulated time at which the first arrived [s]; None where it was not recorded.
        last: the same of the last one.
    """

    topic: str
    why: str
    count: int
    first: float | None
    last: float | None


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
        The key-value pairs of each part of each node, whose names are those of the statuses, "node: part"; none where
        the bytes are not such a message.
    """
    found: dict[str, Parts] = {}
    walk = Walk(data, "replace")
    try:
        walk.stamp()
        walk.text()  # frame_id
        for _ in range(walk.count()):
            walk.place += 1  # level
            name, _, _ = walk.text(), walk.text(), walk.text()
            node, _, part = name.rpartition(": ")
            found.setdefault(node, {})[part] = {walk.text(): walk.text() for _ in range(walk.count())}
    except (struct.error, ValueError):  # the latter of a length that no message has
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
        if "/" + node.strip("/").rpartition("/")[0] == namespace and "ticks" in parts.get("simulation", {})
    ]
    if not own:
        return None
    simulation, commands = own[0]["simulation"], own[0].get("commands", {})
    return Incidents(
        refused=_count(commands, "refused"),
        refusals=_refusals(commands),
        dropped=sum(_counts(commands, "dropped because ")),
        held=max(_counts(simulation | commands, "ticks refused")),  # one count, in older recordings with a reason
        lost=_count(commands, "lost"),
        late=_count(simulation, "late ticks"),
        first_late=_number(simulation, "first late tick at [s]"),
        worst_late=_number(simulation, "worst late tick at [s]"),
        worst_delay=_number(simulation, "worst late tick by [s]"),
    )


def _refusals(commands: Mapping[str, str]) -> tuple[Refusal, ...]:
    """Read the reasons; of recordings that hold none, the counts of each topic."""
    found = []
    for key, value in commands.items():
        reason, times = _REASON.fullmatch(key), _TIMES.fullmatch(value)
        if reason and times:
            first, last = float(times["first"]), float(times["last"])
            found.append(Refusal(reason["topic"], reason["why"], int(times["count"]), first, last))
    if found:
        return tuple(sorted(found, key=lambda refusal: refusal.first or 0.0))
    topics = [key for key in commands if key.startswith(_TOPIC)]
    return tuple(Refusal(key.removeprefix(_TOPIC), "", _count(commands, key), None, None) for key in topics)


def _count(entries: Mapping[str, str], key: str) -> int:
    value = entries.get(key, "0")
    return int(value) if value.isdigit() else 0


def _counts(entries: Mapping[str, str], start: str) -> list[int]:
    """Read all entries whose keys have the same start, and 0 for none."""
    return [0, *(_count(entries, key) for key in entries if key.startswith(start))]


def _number(entries: Mapping[str, str], key: str) -> float | None:
    try:
        return float(entries[key])
    except (KeyError, ValueError):
        return None
