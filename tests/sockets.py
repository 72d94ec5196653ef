"""The sockets of a process, as the kernel lists them."""

from __future__ import annotations

import contextlib
import os
import re
import socket
from pathlib import Path


def addresses(*pids: int) -> set[tuple[str, str, int]]:
    """Protocol, address and port of every socket of some processes that has one."""
    found = set()
    for pid in pids:
        links = []
        for file in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(FileNotFoundError):  # closed meanwhile
                links.append(os.readlink(file))
        own = {m[1] for link in links if (m := re.fullmatch(r"socket:\[(\d+)\]", link))}
        for protocol in ("udp", "tcp", "udp6", "tcp6"):
            for line in Path(f"/proc/{pid}/net/{protocol}").read_text().splitlines()[1:]:
                words = line.split()
                if words[9] in own:
                    address, port = words[1].split(":")
                    packed = b"".join(bytes.fromhex(address[i : i + 8])[::-1] for i in range(0, len(address), 8))
                    family = socket.AF_INET6 if protocol.endswith("6") else socket.AF_INET
                    found.add((protocol, socket.inet_ntop(family, packed), int(port, 16)))
    return found
