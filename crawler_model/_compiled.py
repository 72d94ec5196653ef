"""The one way in which this package compiles a function."""

from __future__ import annotations

import contextlib
import functools
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function with numba, without the interpreter's lock, cached on disk where a place is writable.

    numba takes a cached function as fresh when its own file is unchanged, even if a function of another file that was
    compiled into it has changed since. Here every file with compiled functions must be unchanged.

    Args:
        function: what to compile.

    Returns:
        The compiled function.
    """
    options: Any = {"nogil": True, "error_model": "numpy"}
    try:
        dispatcher = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba: "no locator available": a read-only install without a home to write to
        return numba.njit(**options)(function)
    index: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if hasattr(index, "_source_stamp"):
        index._source_stamp = _package_stamp()
    return dispatcher


@functools.cache
def _package_stamp() -> tuple[tuple[str, float, int], ...]:
    files = [f for f in sorted(Path(__file__).parent.glob("*.py")) if b"@compiled" in f.read_bytes()]
    return tuple((file.name, file.stat().st_mtime, file.stat().st_size) for file in files)


@contextlib.contextmanager
def said_if_slow(patience: float = 1.0) -> Iterator[None]:
    """Say on standard error that kernels are being compiled, if the body takes long.

    Args:
        patience: how long it may take without a word [s].

    Yields:
        Nothing.
    """
    text = "crawler: compiling the kernels, once on this machine (about half a minute) ..."
    timer = threading.Timer(patience, lambda: print(text, file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
