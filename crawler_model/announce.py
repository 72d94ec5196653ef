"""What is shown while kernels are compiled: which kind, how many functions are done, how many are left."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from numba.core import event

KINDS = (
    ("crawler_model.motion.plane.", "bodies in the plane", 175),
    ("crawler_model.motion.turning.", "bodies that turn", 70),
    ("crawler_model.derivative.", "derivatives", 110),
    ("crawler_model.", "bodies on a line", 150),
    ("crawler_gym.", "environments", 30),
    ("crawler_ros.", "commands of the node", 2),
    ("crawler_bench.", "peers of the bench", 10),
)
"""Beginning of a module, the kind of kernels in it, and about how many functions it takes: as many as are counted."""
_WIDTH = 20
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
        self._began = 0.0

    def on_start(self, event: Any) -> None:
        """Note that the compilation of a function begins; numba holds a lock, so that only one thread compiles."""
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
        if self._kind not in self._done and self.show is None and not sys.stderr.isatty():
            print(f"crawler: {self._describe()} ...", file=sys.stderr, flush=True)
        self._done.setdefault(self._kind, 0)
        threading.Thread(target=self._refresh, args=(self._began,), daemon=True).start()

    def on_end(self, event: Any) -> None:
        """Note that a function is compiled, or that compiling it failed."""
        self._depth -= 1
        if not self._kind:
            return
        self._done[self._kind] += 1
        if self._depth == 0:
            self._seconds[self._kind] = self._elapsed()
            self._kind = ""
            self._put("")

    def _refresh(self, began: float) -> None:
        """Keep the text up to date: the last step of a large function takes many seconds."""
        while self._kind and self._began == began:
            self._put(self._describe())
            time.sleep(_EVERY_S)

    def _put(self, text: str) -> None:
        if self.show is not None:
            self.show(text)
        elif sys.stderr.isatty():
            print(f"\r\x1b[K{text and 'crawler: ' + text}", end="", file=sys.stderr, flush=True)

    def _elapsed(self) -> float:
        return self._seconds.get(self._kind, 0.0) + time.monotonic() - self._began

    def _describe(self) -> str:
        done, kind = self._done.get(self._kind, 0), self._kind
        total = max(next((count for _, name, count in KINDS if name == kind), 0), done)
        text = f"compiling the kernels of {kind}, once on this machine: "
        if kind not in self._done:
            return f"{text}about {total} functions"
        bar = "━" * (_WIDTH * done // total)
        return f"{text}{bar:╌<{_WIDTH}} {done} of about {total} functions, {self._elapsed():.0f} s"
