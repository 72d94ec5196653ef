"""A node's end of the pipe to the process that empties its log."""

from __future__ import annotations

import contextlib
import fcntl
import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

_PIPE_BYTES = 1 << 20
_PATIENCE_S = 2.0


@contextlib.contextmanager
def unblocked_log() -> Iterator[None]:
    """Prevent standard error, and standard output where rcl logs to it, from blocking while the body runs.

    Files are left as they are: writing to them does not wait for a reader.

    Yields:
        Nothing.
    """
    with contextlib.ExitStack() as stack:
        stack.enter_context(_unblocked(2))
        if os.environ.get("RCUTILS_LOGGING_USE_STDOUT") == "1":
            stack.enter_context(_unblocked(1))
        yield


@contextlib.contextmanager
def _unblocked(fd: int) -> Iterator[None]:
    if not _may_block(fd):
        yield
        return
    if os.isatty(fd):  # rcutils would otherwise detect a pipe and switch colours off
        os.environ.setdefault("RCUTILS_COLORIZED_OUTPUT", "1")
    sink = os.dup(fd)
    source, inner = os.pipe()
    with contextlib.suppress(OSError):  # a larger pipe is not essential
        fcntl.fcntl(inner, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
    drain = subprocess.Popen(
        [sys.executable, "-I", "-S", str(Path(__file__).with_name("log_drain.py"))],
        stdin=source,
        stdout=sink,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    os.dup2(inner, fd)
    os.close(inner)
    os.close(source)
    try:
        yield
    finally:
        sys.stderr.flush()
        os.dup2(sink, fd)
        os.close(sink)
        with contextlib.suppress(subprocess.TimeoutExpired):  # another process still writes to it: it continues
            drain.wait(_PATIENCE_S)


def _may_block(fd: int) -> bool:
    try:
        mode = os.fstat(fd).st_mode
    except OSError:
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or os.isatty(fd)
