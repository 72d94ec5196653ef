"""The one way in which this package compiles a function."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numba


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function with numba, without the interpreter's lock, cached on disk where a place is writable."""
    options: Any = {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba: "no locator available": a read-only install without a home to write to
        return numba.njit(**options)(function)


@contextlib.contextmanager
def said_if_slow(patience: float = 1.0) -> Iterator[None]:
    """Say on standard error that kernels are being compiled, if the body takes longer than `patience` [s]."""
    text = "crawler: compiling the kernels, once on this machine (about half a minute) ..."
    timer = threading.Timer(patience, lambda: print(text, file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
