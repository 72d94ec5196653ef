"""Messages that were refused: counted by topic, and said in the log without flooding it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

_QUIET_S, _MOST_SAID = 1.0, 10  # a refusal is logged once a second, of all refusals ten
_MOST_CHARACTERS = 300


class Refusals:
    """Counts refused messages and logs them."""

    def __init__(self, warn: Callable[[str], Any]) -> None:
        """Begin with none.

        Args:
            warn: logs a line.
        """
        self.counts: dict[str, int] = {}
        self.last = ""
        self._warn = warn
        self._said: dict[str, float] = {}

    @property
    def total(self) -> int:
        """How many there were."""
        return sum(self.counts.values())

    def add(self, topic: str, why: str) -> None:
        """Count a message, and say why it was refused unless that was just said.

        Args:
            topic: where it came in.
            why: what is wrong with it; it may quote the message.
        """
        why = why if len(why) <= _MOST_CHARACTERS else why[:_MOST_CHARACTERS] + " ..."
        self.counts[topic] = self.counts.get(topic, 0) + 1
        self.last = f"{topic}: {why}"
        now = time.monotonic()
        self._said = {text: at for text, at in self._said.items() if now - at < _QUIET_S}
        if self.last not in self._said and len(self._said) < _MOST_SAID:
            self._said[self.last] = now
            self._warn(f"refused a message on {topic}: {why}")
