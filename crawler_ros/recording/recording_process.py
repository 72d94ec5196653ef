"""The recording process: it writes what a simulator puts into the ring of shared memory to a file.

`Recorder` starts it. It outlives a killed simulator and finishes the file.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .bag_writer import BagWriter
from .ring import read_ring

FLUSH_EVERY_S = 0.5
_FIRST_FLUSH_S = 0.1


def main() -> int:
    """Record the messages in the ring whose places arrive on standard input until it ends."""
    pieces = read_ring(int(sys.argv[1]), sys.stdin.fileno(), _FIRST_FLUSH_S)
    header = next(pieces, None)
    return 0 if header is None else _record(json.loads(bytes(header)), pieces)


def _record(header: dict[str, Any], pieces: Iterator[memoryview]) -> int:
    """Write the recording that a header describes; return the exit status."""
    folder, is_open = header["folder"], False
    try:
        bag = BagWriter(Path(folder), header["attachments"])
        for name, type_name, definition, metadata in header["channels"]:
            bag.add_channel(name, type_name, definition.encode(), metadata)
        _report("")  # it is open
        is_open = True
        _write(pieces, bag)
        trouble = bag.find_trouble()
        bag.close()
    except OSError as error:
        remains = is_open and not isinstance(error, FileNotFoundError)  # such as on a full disk: what was flushed
        _report(f"{folder}: {error}; crawler replay --recover writes what remains" if remains else str(error))
        return 1
    if trouble:
        _report(trouble)
    return 1 if trouble else 0


def _report(text: str) -> None:
    """Send the simulator, which may have been killed, a line with the problem; "" when it is over."""
    with contextlib.suppress(OSError):
        os.write(sys.stdout.fileno(), f"{' '.join(text.split())}\n".encode())


def _write(pieces: Iterator[memoryview], bag: BagWriter) -> None:
    """Write message records, flushing soon after the first ones and then twice a second."""
    rest, due, trouble = b"", math.inf, ""
    for piece in pieces:
        if piece and due == math.inf:  # not when the file is open: the simulator takes a while until it ticks
            due = time.monotonic() + _FIRST_FLUSH_S
        data = memoryview(rest + piece) if rest else piece  # a record may go on at the beginning of the ring
        rest = bytes(data[bag.write_records(data) :])
        if time.monotonic() >= due:
            bag.flush()
            due, before, trouble = time.monotonic() + FLUSH_EVERY_S, trouble, bag.find_trouble()
            if trouble != before:
                _report(trouble)


if __name__ == "__main__":
    sys.exit(main())
