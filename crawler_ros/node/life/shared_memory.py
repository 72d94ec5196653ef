"""Removal of shared memory that killed processes left behind."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
from pathlib import Path

_SHARED_MEMORY = Path("/dev/shm")
_SEGMENT = re.compile(r"fastrtps_[0-9a-f]{16}")


def remove_orphans() -> None:
    """Remove the shared memory segments of this user's Fast DDS processes that have died.

    A process creates and locks `fastrtps_*_el` before it creates the segment `fastrtps_*`, and holds the lock until it
    ends. A segment whose lock is free has therefore lost its process. The smaller files of ports are named after the
    domain, and the next process in that domain takes them over.
    """
    try:
        segments = [f for f in _SHARED_MEMORY.iterdir() if _SEGMENT.fullmatch(f.name)]
    except OSError:
        return
    for segment in segments:
        lock = segment.with_name(f"{segment.name}_el")
        with contextlib.suppress(OSError):  # another user's, in use, or removed in the meantime
            if segment.stat().st_uid != os.getuid():
                continue
            fd = os.open(lock, os.O_RDWR)
            try:
                fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
                segment.unlink()
                lock.unlink()
            finally:
                os.close(fd)
