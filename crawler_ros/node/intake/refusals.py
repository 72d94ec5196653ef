"""Counts and log lines of refused messages, without flooding the log."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Container
from dataclasses import dataclass
from typing import Any

_QUIET_S = 1.0
_MOST_CHARACTERS = 300
_MOST_REASONS = 32
_MOST_KINDS = 64
_PARTICULAR = re.compile(r"'[^']*'|\"[^\"]*\"|(?<![\w.+-])(?=[\w.+-]*\d)[\w.+-]+|\b(nan|inf)\b")
"""Numbers, names with numbers and quotations in a reason. Reasons quote what others send: no character is looked at
more than a few times, however long a word is."""


class Throttle:
    """Logs one line a second of each kind: the first at once, then the last of each second with the number of them.

    Lines on one subject that differ only in numbers and quoted names are of one kind. Beyond a number of kinds in a
    second, those on one subject count as one.
    """

    def __init__(self, warn: Callable[[str], Any]) -> None:
        """Start with nothing logged.

        Args:
            warn: function that logs a line.
        """
        self._warn = warn
        self._lock = threading.Lock()
        self._last: dict[tuple[str, str], float] = {}
        self._held: dict[tuple[str, str], tuple[int, str]] = {}

    def warn(self, subject: str, text: str) -> None:
        """Log a line, or hold it when one of its kind was logged within the last second.

        Args:
            subject: subject of the line, from a bounded set.
            text: the line.
        """
        now = time.monotonic()
        kind = subject, _PARTICULAR.sub("#", text)
        with self._lock:
            if kind not in self._last and len(self._last) >= _MOST_KINDS:
                kind = subject, ""
            if now - self._last.get(kind, -_QUIET_S) < _QUIET_S or kind in self._held:
                self._held[kind] = self._held.get(kind, (0, ""))[0] + 1, text
                return
            self._last[kind] = now
        self._warn(text)

    def flush(self) -> None:
        """Log the lines that have been held for a second, in the order of the first of each kind, once a second."""
        now = time.monotonic()
        with self._lock:
            due = [kind for kind in self._held if now - self._last[kind] >= _QUIET_S]
            lines = [(kind, *self._held.pop(kind)) for kind in due]
            self._last = {k: at for k, at in self._last.items() if now - at < _QUIET_S or k in self._held}
            self._last.update(dict.fromkeys(due, now))
        for (_, pattern), count, text in lines:
            more = f" (and {count - 1} more{' like it' if pattern else ''})" if count > 1 else ""
            self._warn(text + more)


@dataclass
class Reason:
    """The messages that were refused on a topic for one reason.

    Attributes:
        topic: the topic.
        why: the reason, in the words of the first of them.
        first_ns: simulated time at which the first arrived [ns].
        last_ns: the same of the last one.
        count: number of messages.
    """

    topic: str
    why: str
    first_ns: int
    last_ns: int
    count: int = 0


class Refusals:
    """Counts refused messages by topic and reason and logs them, each reason at most once a second.

    Reasons that differ only in numbers and quoted names count as one.
    """

    def __init__(self, throttle: Throttle) -> None:
        """Start with none.

        Args:
            throttle: logger of the refusals.
        """
        self.counts: dict[str, int] = {}
        self.last = ""
        self._throttle = throttle
        self._before = 0  # total when simulated time began
        self._reasons: dict[tuple[str, str], Reason] = {}

    @property
    def total(self) -> int:
        """Number of refused messages."""
        return sum(self.counts.values())

    @property
    def reasons(self) -> list[Reason]:
        """The reasons in the order of their first message."""
        return list(self._reasons.values())

    def restart(self) -> None:
        """Note that simulated time begins anew."""
        self._before = self.total

    def has_refused_at(self, now_ns: int, topics: Container[str]) -> bool:
        """Determine whether a message was refused at a time, since which no tick has passed if it is the present one.

        Args:
            now_ns: simulated time [ns].
            topics: the topics that count.

        Returns:
            Whether there is one since simulated time began.
        """
        last = [reason.last_ns for reason in self.reasons if reason.topic in topics]
        return self.total > self._before and now_ns in last

    def count_refusal(self, topic: str, why: str, now_ns: int) -> None:
        """Count a refused message and log the reason, each at most once a second for each topic.

        Args:
            topic: topic on which it arrived.
            why: the reason; it may quote the message.
            now_ns: simulated time [ns].
        """
        why = why if len(why) <= _MOST_CHARACTERS else why[:_MOST_CHARACTERS] + " ..."
        self.counts[topic] = self.counts.get(topic, 0) + 1
        self.last = f"{topic}: {why}"
        kind = topic, _PARTICULAR.sub("#", why)
        if kind not in self._reasons and len(self._reasons) >= _MOST_REASONS:
            kind, why = (topic, ""), "other reasons"
        reason = self._reasons.setdefault(kind, Reason(topic, why, now_ns, now_ns))
        reason.count, reason.last_ns = reason.count + 1, now_ns
        self._throttle.warn(f"refused {topic}", f"refused a message on {topic}: {why}")
