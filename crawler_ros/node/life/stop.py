"""How a node is asked to end."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

_REPEAT_S = 1.0
"""A second signal within this time counts as the first one: launch and a process group send SIGINT twice."""


class StopFlag:
    """Whether a node has been asked to end.

    Not a `threading.Event`: that one has a lock, and a signal handler that sets it waits forever if it interrupts its
    own thread while that holds the lock.
    """

    def __init__(self) -> None:
        """Create it, not set."""
        self._is_set = False

    def set(self) -> None:
        """Ask the node to end."""
        self._is_set = True

    def is_set(self) -> bool:
        """Return whether the node has been asked to end."""
        return self._is_set


def end_on_signals(flag: StopFlag) -> None:
    """End a node on SIGINT or SIGTERM: in order at the first signal, at once at another one a second later.

    Args:
        flag: set at the first signal.
    """
    first = 0.0

    def on_signal(*_: Any) -> None:
        nonlocal first
        if not flag.is_set():
            first = time.monotonic()
            flag.set()
        elif time.monotonic() - first > _REPEAT_S:  # the recording process still finishes its file
            os._exit(130)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
