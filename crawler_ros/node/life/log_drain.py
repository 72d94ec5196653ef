"""A process between a node's log and its reader, so that a reader that stops does not stop the node.

rclpy, Fast DDS and Python write to standard error synchronously while they hold the interpreter's lock, so that an
unread pipe or a paused terminal would stop a node with all its threads. A node therefore writes to a pipe that this
process always empties. Text without a reader waits in a bounded queue; text beyond that is dropped and counted. It is
a program of its own, without the packages around it, so that it starts at once and outlives a crash of the node.
"""

from __future__ import annotations

import os
import signal
import threading

_MOST_WAITING = 1 << 20
_BLOCK = 1 << 16
_PATIENCE_S = 0.5  # with a reader that does not read, once the node has ended


class Drain:
    """Copies one descriptor to another and never waits for the second while reading the first."""

    def __init__(self, source: int, sink: int) -> None:
        """Start the writing thread.

        Args:
            source: descriptor to read.
            sink: descriptor to write.
        """
        self._source, self._sink = source, sink
        self._changed = threading.Condition()
        self._waiting: list[bytes] = []
        self._size = self._dropped = self._written = 0
        self._ended = False
        self.thread = threading.Thread(target=self._write, daemon=True)
        self.thread.start()

    def read(self) -> None:
        """Read the source until it ends, then wait for the sink as long as it accepts data."""
        while block := os.read(self._source, _BLOCK):
            with self._changed:
                if self._size + len(block) > _MOST_WAITING:
                    self._dropped += block.count(b"\n")
                    continue
                self._waiting.append(block)
                self._size += len(block)
                self._changed.notify()
        with self._changed:
            self._ended = True
            self._changed.notify()
        written = -1
        while self.thread.is_alive() and self._written != written:
            written = self._written
            self.thread.join(_PATIENCE_S)

    def _write(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self._ended:
                    self._changed.wait()
                if not self._waiting:
                    return
                block = self._waiting.pop(0)
                self._size -= len(block)
                if self._dropped and not self._waiting:
                    block += b"" if block.endswith(b"\n") else b"\n"
                    block += f"{self._dropped} line(s) of this log were dropped because they were not read\n".encode()
                    self._dropped = 0
            while block:
                try:
                    block = block[os.write(self._sink, block) :]
                except OSError:  # the reader has gone
                    block = b""
                self._written += 1


def main() -> None:
    """Copy standard input to standard output."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends with the last process that writes to it
    Drain(0, 1).read()
    os._exit(0)  # a blocked writing thread must not keep the process alive


if __name__ == "__main__":
    main()
