"""ROS domains of their own for programs on this machine, reserved by a lock while they are in use."""

from __future__ import annotations

import contextlib
import fcntl
import os
import random
import tempfile
from collections.abc import Iterator
from pathlib import Path

from crawler_model import CrawlerError

DOMAINS = range(1, 102)
"""Not 0, the default of all programs; the ports of domains above 101 overlap with ports that the kernel assigns."""
_FIRST_PORT, _PORTS = 7400, 250  # DDS: of domain 0, and from one domain to the next


@contextlib.contextmanager
def reserved_domain() -> Iterator[int]:
    """Reserve a ROS domain that no other program on this machine uses.

    The reservation is a lock on a file, which all users of this function respect and which ends with the process at the
    latest. A domain is skipped if a program listens in it without a reservation.

    Yields:
        The number of the domain.

    Raises:
        CrawlerError: when every domain is taken.
    """
    folder = Path(tempfile.gettempdir()) / f"crawler_domains_{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    for number in random.SystemRandom().sample(DOMAINS, len(DOMAINS)):
        with (folder / str(number)).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            if number not in _domains_in_use():
                yield number
                return
    raise CrawlerError(f"all ROS domains from {DOMAINS[0]} to {DOMAINS[-1]} are taken on this machine")


def _domains_in_use() -> set[int]:
    """Find the domains whose UDP ports a program has open."""
    try:
        lines = Path("/proc/net/udp").read_text(encoding="ascii").splitlines()[1:]
    except OSError:  # not Linux
        return set()
    ports = [int(line.split()[1].rpartition(":")[2], 16) for line in lines]
    return {(port - _FIRST_PORT) // _PORTS for port in ports}


def domain_environment(domain: int) -> dict[str, str]:
    """Build the environment of a process in a domain on loopback.

    Args:
        domain: number of the domain.

    Returns:
        This process's environment with the variables of ROS 2 changed.
    """
    own = {name: value for name, value in os.environ.items() if name != "ROS_LOCALHOST_ONLY"}
    return own | {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
