"""The progress of long measurements, and their end by Ctrl-C without the loss of what was measured."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Steps:
    """Counts the steps of a measurement and reports each one when it begins."""

    def __init__(self, total: int, report: Callable[[float, str], None]) -> None:
        """Start at the first step."""
        self.interrupted = False
        """Whether Ctrl-C has ended the measurements."""
        self._total, self._report, self._done = total, report, 0

    def __call__(self, name: str) -> None:
        """Begin a step."""
        if self.interrupted:
            raise KeyboardInterrupt
        self._report(min(self._done / self._total, 1.0), name)
        self._done += 1

    @contextmanager
    def keep(self) -> Iterator[None]:
        """End the measurements in this context on Ctrl-C, and go on after it with what they found."""
        try:
            yield
        except KeyboardInterrupt:
            self.interrupted = True
