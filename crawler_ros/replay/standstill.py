"""Detection of rests in a run and at its end, and their reasons: no commands, or forces too small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model.body.drive import NS

from ..recording.recorded_robot import Robot
from ..wire.topics import read_topics
from .cycle_table import Cycle
from .health import Survey
from .ramps import RampTable

_COMMANDS = tuple(topic.name for topic in read_topics().values() if topic.direction == "in")
_UNKNOWN = "the commands in force were not recorded"
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
            return f"{rest}: {_UNKNOWN}"
        if self.commanded_from is None:
            return f"{rest}: no command changed"
        near = "" if self.margin is None else f" (the nearest stayed {self.margin:.3g} N away)"
        begin = f" from {self.commanded_from:g} s on" if self.commanded_from > self.since else ""
        return f"{rest}: commands changed{begin}, but no spring force exceeded its bound{near}"


def find_rests(table: RampTable, cycles: Sequence[Cycle], standstill: Standstill | None) -> tuple[Rest, ...]:
    """Find the rests that last at least as long as the longest cycle, without cycles at least a second.

    Args:
        table: the ramps of the recording.
        cycles: its cycles.
        standstill: the rest at its end, which is left out.

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
            if standstill is not None and run == table.run[-1] and k == since.size - 1:
                continue
            inside = margin[(end > since[k]) & (start < until[k])]  # the slip may begin with a ramp of no duration
            first, last = np.searchsorted(changes, since[k], side="right"), np.searchsorted(begins, until[k])
            known = inside.size > 0 and bool(np.isfinite(inside).all())
            nearest = max(float(inside.min()), 0.0) if known else None
            begin = float(max(begins[first], since[k])) / NS if last > first else None
            times = float(since[k]) / NS, float(until[k]) / NS
            found.append(Rest(run, *times, begin, nearest, table.commanded))
    return tuple(found)


@dataclass(frozen=True)
class Standstill:
    """A rest at the end of a recording, longer than any before.

    Attributes:
        since: when the last slip ended [s]; the start of the run when there was none.
        until: the end of the recording [s].
        commanded_until: when the commands changed for the last time [s]; None when they never did, or are not known.
        margin: least distance of a spring force from its bound during the rest [N]; None when forces are not known.
        last_message: topic of the last command message; None when none was recorded.
        last_message_at: simulated time of its arrival [s]; None if that was before the last reset.
        commands_known: whether commands were recorded.
    """

    since: float
    until: float
    commanded_until: float | None
    margin: float | None
    last_message: str | None
    last_message_at: float | None
    commands_known: bool

    def explain(self) -> str:
        """Describe the rest in one line.

        Returns:
            Its time and its reason.
        """
        rest = f"at rest from {self.since:g} s to the end at {self.until:g} s"
        if not self.commands_known:
            return f"{rest}: {_UNKNOWN}{self._arrival()}"
        if self.commanded_until is None:
            return f"{rest}: no command changed anything{self._arrival()}"
        clauses = [f"{rest}: commands changed up to {self.commanded_until:g} s"]
        if self.commanded_until > self.since:
            near = "" if self.margin is None else f" (the nearest stayed {self.margin:.3g} N away)"
            clauses.append(f"meanwhile no spring force exceeded its bound{near}")
        if self.commanded_until < self.until:
            clauses.append("no change after that")
        return "; ".join(clauses) + self._arrival()

    def _arrival(self) -> str:
        if self.last_message is None:
            return "; no command message was recorded"
        when = "before the reset" if self.last_message_at is None else f"at {self.last_message_at:g} s"
        return f"; the last message on {self.last_message} had arrived {when}"


def find_standstill(table: RampTable, survey: Survey, robot: Robot) -> Standstill | None:
    """Find a rest at the end of the last run.

    Args:
        table: the ramps of the recording; without commands if none were recorded.
        survey: survey of the recording.
        robot: the crawler.

    Returns:
        The rest; None when the crawler moved to the end, or had rested as long before.
    """
    rows = np.flatnonzero(table.run == table.run[-1])
    start, end = table.start_ns[rows], table.end_ns[rows]
    slides = (table.forward + table.backward)[rows] > 0.0
    edges = np.concatenate(([start[0]], end[slides]))
    pauses = np.append(start[slides], end[-1]) - edges
    if pauses[-1] <= 0 or (pauses[:-1] >= pauses[-1]).any():
        return None
    _, path = table.path(int(table.run[-1]))
    changes = np.flatnonzero(path.moved())
    resting = table.margin[rows][end > edges[-1]]
    known = resting.size and np.isfinite(resting).all()
    topic, arrived = _last_message(survey, robot)
    return Standstill(
        since=float(edges[-1]) / NS,
        until=float(end[-1]) / NS,
        commanded_until=float(path.time_ns[changes[-1] + 1]) / NS if changes.size else None,
        margin=max(float(resting.min()), 0.0) if known else None,
        last_message=topic,
        last_message_at=arrived,
        commands_known=table.commanded,
    )


def _last_message(survey: Survey, robot: Robot) -> tuple[str | None, float | None]:
    """Find the last command message, and the time of the last state before it arrived; None before a reset."""
    recorded = {name: survey.topics.get(robot.recorded(name)) for name in _COMMANDS}
    received = {name: topic.log_ns[-1] for name, topic in recorded.items() if topic is not None}
    states = survey.topics.get(robot.recorded("joint_states"))
    if not received or states is None:
        return None, None
    topic = max(received, key=lambda name: int(received[name]))
    before = int(np.searchsorted(states.log_ns, received[topic], side="right")) - 1
    resets = np.flatnonzero(np.diff(states.stamp_ns) < 0)
    if resets.size and before <= resets[-1]:
        return topic, None
    return topic, float(states.stamp_ns[max(before, 0)]) / NS
