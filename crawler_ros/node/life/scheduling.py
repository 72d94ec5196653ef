"""How soon the threads of a node run: delays of Python and Linux, and the priority in the real-time scheduler."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from crawler_model import CommandError


def reduce_delays() -> None:
    """Reduce how long threads of this process wait for one another, and how late they wake up.

    By default Python passes on its lock after five milliseconds, and Linux ends a sleep up to 50 us late.
    """
    sys.setswitchinterval(0.0005)
    with contextlib.suppress(OSError):
        Path("/proc/self/timerslack_ns").write_text("1", encoding="ascii")


def check_priority(values: Mapping[str, Any]) -> None:
    """Check that the threads of a node may have the priority that its parameters name.

    Args:
        values: of the node's parameters, by name.

    Raises:
        CommandError: if the user has no permission, or no clock sets the node's pace: it would never wait, and leave no
            time to other programs.
    """
    priority = values["thread_priority"]
    if priority == 0:
        return
    if values["lock_step"] or values["real_time_factor"] == 0.0:
        pace = "lock_step" if values["lock_step"] else "real_time_factor 0"
        raise CommandError(
            f"thread_priority: {priority} with {pace}: the node would run as fast as possible and leave no time to "
            f"other programs; it must be 0 there"
        )
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        raise CommandError(
            f"thread_priority: {priority}: this user has no permission for real-time priorities; a line 'USER - rtprio "
            f"{priority}' in /etc/security/limits.conf gives it, and 0 needs none"
        ) from None
    os.sched_setscheduler(0, *before)


def raise_priority(priority: int) -> None:
    """Move all threads of this process to the real-time scheduler, ahead of everything in the ordinary one.

    Threads that they start later inherit the priority.

    Args:
        priority: priority of SCHED_FIFO, 1 to 99; 0 leaves the threads where they are.
    """
    for thread in os.listdir("/proc/self/task") if priority else ():
        with contextlib.suppress(ProcessLookupError):  # one that has just ended
            os.sched_setscheduler(int(thread), os.SCHED_FIFO, os.sched_param(priority))
