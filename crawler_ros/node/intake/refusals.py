"""Counts and log lines of refused messages, without flooding the log."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

_QUIET_S = 1.0
_MOST_CHARACTERS = 300


class Throttle:
    """Logs one line a second for each subject: the first at once, then the last of each second."""

    def __init__(self, warn: Callable[[str], Any]) -> None:
        """Start with nothing logged.

        Args:
            warn: function that logs a line.
        """
        self._warn = warn
        self._lock = threading.Lock()
        self._last: dict[str, float] = {}
        self._held: dict[str, tuple[int, str]] = {}

    def warn(self, subject: str, text: str) -> None:
        """Log a line, or hold it when one on this subject was logged within the last second.

        Args:
            subject: subject of the line, from a bounded set.
            text: the line.
        """
        now = time.monotonic()
        with self._lock:
            if now - self._last.get(subject, -_QUIET_S) < _QUIET_S or subject in self._held:
                self._held[subject] = self._held.get(subject, (0, ""))[0] + 1, text
                return
            self._last[subject] = now
        self._warn(text)

    def flush(self) -> None:
        """Log the lines that have been held for a second; call it about once a second."""
        now = time.monotonic()
        with self._lock:
            due = [s for s in self._held if now - self._last[s] >= _QUIET_S]
            lines = [self._held.pop(s) for s in due]
            self._last.update(dict.fromkeys(due, now))
        for count, text in lines:
            self._warn(f"{text} (and {count - 1} more like it)" if count > 1 else text)


class Refusals:
    """Counts refused messages and logs them, one a second and topic."""

    def __init__(self, throttle: Throttle) -> None:
        """Start with none.

        Args:
            throttle: logger of the refusals.
        """
        self.counts: dict[str, int] = {}
        self.last = ""
        self._throttle = throttle

    @property
    def total(self) -> int:
        """Number of refused messages."""
        return sum(self.counts.values())

    def add(self, topic: str, why: str) -> None:
        """Count a refused message and log the reason, at most once a second for each topic.

        Args:
            topic: topic on which it arrived.
            why: the reason; it may quote the message.
        """
        why = why if len(why) <= _MOST_CHARACTERS else why[:_MOST_CHARACTERS] + " ..."
        self.counts[topic] = self.counts.get(topic, 0) + 1
        self.last = f"{topic}: {why}"
        self._throttle.warn(f"refused {topic}", f"refused a message on {topic}: {why}")
