"""A lock that threads take in turn."""

from __future__ import annotations

import threading
from typing import Any


class FairLock:
    """A lock that passes to a thread that waits for it, even if the thread that releases it takes it again at once.

    A lock of `threading` may be taken again by the thread that just released it before a waiting thread has woken: a
    loop that holds it nearly always would keep all others out.
    """

    def __init__(self) -> None:
        """Create a lock that is free."""
        self._next = threading.Lock()  # held by the thread whose turn is next
        self._lock = threading.Lock()

    def acquire(self, blocking: bool = True) -> bool:
        """Take the lock.

        Args:
            blocking: wait for it.

        Returns:
            Whether the lock was taken; without `blocking` it is not while another thread holds or waits for it.
        """
        if not self._next.acquire(blocking):
            return False
        try:
            return self._lock.acquire(blocking)
        finally:
            self._next.release()

    def release(self) -> None:
        """Give the lock back."""
        self._lock.release()

    def __enter__(self) -> None:
        """Take the lock, waiting for it."""
        self.acquire()

    def __exit__(self, *_: Any) -> None:
        """Give the lock back."""
        self.release()
