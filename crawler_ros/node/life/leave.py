"""How a process leaves on Ctrl-C while it has nothing to tidy up. Only the standard library is loaded here."""

from __future__ import annotations

import os
import signal
from typing import Any

STOPPED = 130
"""The exit status of what Ctrl-C stopped."""


def leave_at_once(name: str) -> None:
    """Let Ctrl-C end the process with one line while there is nothing to tidy up.

    An exception would not do: extension modules that are being imported and callbacks of the compiler swallow it or
    print it.

    Args:
        name: the executable's.
    """

    def leave(*_: Any) -> None:
        os.write(2, f"{name}: stopped\n".encode())
        os._exit(STOPPED)

    signal.signal(signal.SIGINT, leave)
