"""Waiting for conditions, and processor time and memory of a process, as the kernel counts them."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
PATIENCE_S = 240.0
"""Time limit for hanging processes, beyond a first compilation on the busiest machine."""


def wait_until(condition: Callable[[], T], seconds: float = PATIENCE_S, what: str = "it") -> T:
    """Wait for a condition.

    Args:
        condition: function called a hundred times a second.
        seconds: longest time to wait [s].
        what: name of the event, for the error.

    Returns:
        The first true value of the condition.

    Raises:
        TimeoutError: when the condition does not become true.
    """
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        if time.monotonic() > deadline:
            raise TimeoutError(f"{what} did not happen within {seconds:g} s")
        time.sleep(0.01)
    return found


def cpu_seconds(pid: int) -> float:
    """Read the processor time that a process has used [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def children(pid: int) -> list[int]:
    """List the processes that a process has started."""
    return [int(p) for task in Path(f"/proc/{pid}/task").iterdir() for p in (task / "children").read_text().split()]


def memory_mb(pid: int) -> float:
    """Read the resident memory of a process [MiB]."""
    return _status_mb(pid, "VmRSS")


def peak_memory_mb(pid: int) -> float:
    """Read the peak resident memory of a process [MiB]; 0 when it has ended."""
    return _status_mb(pid, "VmHWM")


def _status_mb(pid: int, field: str) -> float:
    found = re.search(rf"{field}:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    return int(found[1]) / 1024.0 if found else 0.0
