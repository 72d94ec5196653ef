"""What is shown while kernels are compiled: which kind, how many functions are done, how many are left."""

from __future__ import annotations

import contextlib
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from numba.core import event

KINDS = (
    ("crawler_model.motion.plane.", "bodies in the plane", 100),
    ("crawler_lab.derivative.", "derivatives", 80),
    ("crawler_model.", "bodies on a line", 150),
    ("crawler_lab.gym.", "environments", 15),
    ("crawler_ros.", "commands of the node", 45),
    ("benchmarks.", "peers of the bench", 10),
)
"""Beginning of a module, the kind of kernels in it, and about how many functions it takes: as many as are counted."""
_WIDTH = 12
_EVERY_S = 1.0


class Announcer(event.Listener):
    """Announces that kernels of this project are compiled (not when they are loaded), each kind once per process.

    Attributes:
        show: shows a text, or removes it when it is empty; None: one line per kind, which on a terminal is kept up to
            date and then removed.
        check: called before the first function is compiled.
    """

    show: Callable[[str], None] | None = None

    def __init__(self, check: Callable[[], None]) -> None:
        """Begin with nothing compiled.

        Args:
            check: called before the first function is compiled.
        """
        self.check = check
        self._depth = 0
        self._kind = ""
        self._done: dict[str, int] = {}
        self._seconds: dict[str, float] = {}
        self._loading = 0.0
        self._began = 0.0
        self._writing = threading.Lock()

    def on_start(self, event: Any) -> None:
        """Note that the compilation of a function begins; numba holds a lock, so that only one thread compiles.

        Args:
            event: the event of numba, whose data hold the function as `dispatcher`.
        """
        self._depth += 1
        if self._depth > 1:
            return
        module = getattr(getattr(event.data.get("dispatcher"), "py_func", None), "__module__", "")
        kind = next((kind for start, kind, _ in KINDS if module.startswith(start)), "")
        if not kind:
            return
        if not self._done:
            self.check()
        self._kind, self._began = kind, time.monotonic()
        silent = self.show is None and not sys.stderr.isatty()
        if silent and kind not in self._done:
            text = f"compiling the kernels of {kind}, once on this machine: about {self._total()} functions ..."
            print(f"crawler: {text}", file=sys.stderr, flush=True)
        self._done.setdefault(kind, 0)
        if silent:
            return
        threading.Thread(target=self._refresh, args=(self._began,), daemon=True).start()

    def on_end(self, event: Any) -> None:
        """Note that a function is compiled, or that compiling it failed.

        Args:
            event: the event of numba.
        """
        self._depth -= 1
        if not self._kind:
            return
        self._done[self._kind] += 1
        if self._depth == 0:
            with self._writing:
                self._seconds[self._kind] = self._elapsed()
                self._kind = ""
                self._put("")

    @contextlib.contextmanager
    def loading(self) -> Iterator[None]:
        """Measure how long a kernel is loaded; numba holds a lock.

        Yields:
            Nothing: the kernel is loaded meanwhile.
        """
        began = time.monotonic()
        yield
        if not self._kind:  # else it is loaded for one that is compiled
            self._loading += time.monotonic() - began

    def spent(self) -> float:
        """Measure for how long kernels have been compiled or loaded in this process.

        Returns:
            The time [s].
        """
        with self._writing:
            return self._loading + sum(self._seconds.values()) + (time.monotonic() - self._began if self._kind else 0.0)

    def _refresh(self, began: float) -> None:
        """Keep the text up to date: the last step of a large function takes many seconds."""
        while True:
            with self._writing:
                if not self._kind or self._began != began:
                    return
                self._put(self._describe())
            time.sleep(_EVERY_S)

    def _put(self, text: str) -> None:
        if self.show is not None:
            self.show(text)
        elif sys.stderr.isatty():
            room = shutil.get_terminal_size().columns - 1
            print(f"\r\x1b[K{(text and 'crawler: ' + text)[:room]}", end="", file=sys.stderr, flush=True)

    def _elapsed(self) -> float:
        return self._seconds.get(self._kind, 0.0) + time.monotonic() - self._began

    def _describe(self) -> str:
        done, total = self._done.get(self._kind, 0), self._total()
        bar = "━" * (_WIDTH * done // total)
        return f"compiling {self._kind} {bar:╌<{_WIDTH}} {done} of about {total}, {self._elapsed():.0f} s"

    def _total(self) -> int:
        expected = next((count for _, kind, count in KINDS if kind == self._kind), 1)
        return max(expected, self._done.get(self._kind, 0))
