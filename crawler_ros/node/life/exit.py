"""Exit on Ctrl-C while there is nothing to clean up. Only the standard library is loaded here."""

from __future__ import annotations

import io
import os
import signal
import sys
from typing import Any

STOPPED = 130
"""The exit status of a program stopped by Ctrl-C."""


def leave_at_once(name: str) -> None:
    """Let Ctrl-C end the process with one line while there is nothing to clean up.

    An exception would not work: extension modules being imported and callbacks of the compiler swallow it or print it.

    Args:
        name: name of the executable.
    """

    def leave(*_: Any) -> None:
        os.write(2, f"{name}: stopped\n".encode())
        os._exit(STOPPED)

    signal.signal(signal.SIGINT, leave)


def prepare_streams() -> None:
    """Open the null device in place of each standard stream that is closed, as by `2>&-`, and let all print any text.

    Names of scenes, files and joints may hold letters that the locale's encoding lacks; they are then replaced.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                os.dup2(null, number)
                os.close(null)
            os.set_inheritable(number, True)
            setattr(sys, name, open(number, mode, closefd=False))  # noqa: SIM115 (it stays open)
    replace_unprintable()


def replace_unprintable() -> None:
    """Replace what the encoding of standard output lacks; on standard error, Python escapes it."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
