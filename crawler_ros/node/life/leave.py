"""Exit on Ctrl-C while there is nothing to clean up. Only the standard library is loaded here."""

from __future__ import annotations

import os
import signal
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
