"""The keys of `/diagnostics` and the parts of log lines by which other programs read what a simulator reports.

They are stable; the words next to them are sentences for people and may change.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

REFUSED_ON = "refused on "
"""The start of a key that counts the messages refused on a topic, for all reasons or for one."""
_REASON = re.compile(rf"{REFUSED_ON}(?P<topic>\S+): (?P<why>.*)", re.S)
_TIMES = re.compile(r"(?P<count>\d+), first at (?P<first>\S+) s, last at (?P<last>\S+) s")


class Fact(str, Enum):
    """A key that stands for one fact; its value is a number unless another meaning is given.

    Counts of commands and late ticks cover the whole run of the node, all others the time since the last reset.
    """

    SIMULATED_TIME = "simulated time [s]"
    TICKS = "ticks"
    LATE_TICKS = "late ticks"
    FACTOR = "real-time factor achieved"
    LAG = "lag [s]"
    FIRST_LATE = "first late tick at [s]"
    WORST_LATE = "worst late tick at [s]"
    WORST_DELAY = "worst late tick by [s]"
    LEAST_FRICTION = "least friction of the scene"
    """A number, and its contact in brackets."""
    MARGIN = "uniqueness margin"
    """A number, or `not decided`."""
    UNDECIDED = "uniqueness margin not decided because"
    """The reason in words; only where it is not decided."""
    VISITED_MARGIN = "visited margin"
    AMBIGUOUS = "ticks without a determined translation"
    OVERSPENT = "ticks over the budget of work"
    UNSOLVED = "ticks not solved"
    YAW = "yaw [rad]"
    ORIENTATION = "orientation of the shape [rad]"
    JUMPS = "jumps"
    JUMP_LOSS = "energy lost in jumps [J]"
    STABILITY = "stability margin"
    LEAST_STABILITY = "least stability margin"
    INERTIA = "inertia number"
    INERTIA_FOUND = "inertia number found"
    """A contact and a time, or `nowhere`."""
    INERTIA_DEVIATION = "relative deviation of the gain by inertia"
    """Two numbers with their conditions, or `not to be predicted`."""
    RESIDUAL = "largest energy residual of a tick [J]"
    VIOLATION = "largest violation of a bound [N]"
    COMPLEMENTARITY = "largest complementarity [J]"
    REFUSED = "refused"
    FULL = "refused because the queue was full"
    OVERDUE = "trajectories wholly in the past"
    ROWS_DROPPED = "rows dropped"
    TICKS_REFUSED = "ticks refused"
    LOST = "lost"
    WAITING = "rows waiting"
    """A number `of` the largest number."""


class LogText(str, Enum):
    """A part of a line in a simulator's log by which `crawler run` recognises what the line reports."""

    WAITING = "waiting for commands on"
    RECORDED = "recorded "
    """With the folder of the recording."""
    STOPPED = "stopped after "
    """With what was counted; the simulator ends as it was meant to."""
    UNCOMMANDED = "no command was received"
    NOTHING_PASSES = "nothing passes between it and this node"
    """A peer of a topic whose messages cannot arrive."""
    NONE_RECEIVED = "none of its messages is received"
    """A publisher that the simulator cannot hear."""
    STANDS_STILL = "refused, and in lock-step nothing moves without one"
    """Why nothing moves any more."""


_ROWS_DROPPED_BEFORE = "dropped because "
"""The start of the key in recordings of version 0.1.0, which went on with the reason."""


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

    def entry(self) -> tuple[str, str]:
        """Write it as a key and a value; `read_refusals` reads them."""
        return (
            f"{REFUSED_ON}{self.topic}: {self.why}",
            f"{self.count}, first at {self.first:.9f} s, last at {self.last:.9f} s",
        )


def read_refusals(entries: Mapping[str, str]) -> tuple[Refusal, ...]:
    """Read the refusals for each reason; for recordings that hold no reasons, the counts of each topic.

    Args:
        entries: key-value pairs of the commands' part.

    Returns:
        The refusals in the order of the first of each.
    """
    found = []
    for key, value in entries.items():
        reason, times = _REASON.fullmatch(key), _TIMES.fullmatch(value)
        if reason and times:
            first, last = float(times["first"]), float(times["last"])
            found.append(Refusal(reason["topic"], reason["why"], int(times["count"]), first, last))
    if found:
        return tuple(sorted(found, key=lambda refusal: refusal.first or 0.0))
    topics = [key for key in entries if key.startswith(REFUSED_ON)]
    return tuple(Refusal(key.removeprefix(REFUSED_ON), "", read_count(entries, key), None, None) for key in topics)


def read_count(entries: Mapping[str, str], key: str) -> int:
    """Read a count; 0 where it is missing or no number."""
    value = entries.get(key, "0")
    return int(value) if value.isdigit() else 0


def read_number(entries: Mapping[str, str], key: Fact) -> float | None:
    """Read a number; None where it is missing or no number."""
    try:
        return float(entries[key.value])
    except (KeyError, ValueError):
        return None


def rows_dropped(entries: Mapping[str, str]) -> int:
    """Read how many accepted rows were dropped because nothing would hold the body."""
    old = [key for key in entries if key.startswith(_ROWS_DROPPED_BEFORE)]
    return sum(read_count(entries, key) for key in (Fact.ROWS_DROPPED.value, *old))


def ticks_refused(entries: Mapping[str, str]) -> int:
    """Read how many ticks were refused; in recordings of version 0.1.0 the key goes on with a reason."""
    return max((read_count(entries, key) for key in entries if key.startswith(Fact.TICKS_REFUSED.value)), default=0)
